//! The things of a world.

use nalgebra::Vector3;

use super::super::reader::{Journal, Located, Table};
use super::super::target::kind_of;
use super::{MAX_DISTANCE_M, bounded, check_within, length, read_color, read_point, share};
use pardalis_simulate::{Body, Course, Object, Path, Sine, Throw, Waypoints};

/// The most things of one world.
const MAX_OBJECTS: usize = 100;
/// The most points of a path, and sines of an axis.
const MAX_POINTS: usize = 10_000;

/// Reads the things; those with a problem, which the journal then says, are left out.
pub(super) fn read(journal: &Journal, table: &Table) -> Vec<Object> {
    let tables = table.named_tables("objects", "object");
    if tables.len() > MAX_OBJECTS {
        let message = format!(
            "has {} objects; allowed: at most {MAX_OBJECTS}",
            tables.len()
        );
        table.problem("objects", message);
    }
    let names: Vec<String> = tables.iter().map(|(name, _)| name.clone()).collect();
    let mut carriers = Vec::new();
    let objects: Vec<_> = tables
        .into_iter()
        .map(|(name, table)| read_object(name, table, &names, &mut carriers))
        .collect();
    for (carrier, place) in carriers {
        if let Some(Object {
            course: Course::Rides { .. },
            ..
        }) = &objects[carrier]
        {
            let message =
                "rides on another object itself; allowed: an object with a path of its own";
            journal.report(place.problem(message));
        }
    }
    let objects: Vec<Object> = objects.into_iter().flatten().collect();
    if objects.len() == names.len() && !objects.is_empty() && !objects.iter().any(|o| o.is_target) {
        table.problem("objects", "holds no target; give one object target = true");
    }
    objects
}

fn read_object(
    name: String,
    table: Table,
    names: &[String],
    carriers: &mut Vec<(usize, Located<()>)>,
) -> Option<Object> {
    let body = read_body(&table);
    let color = read_color(&table, "color_srgb");
    let highlight = share(&table, "highlight", 0.0);
    let heading_deg: Option<f64> = table.optional("heading_deg");
    let is_target = table.or("target", false);
    if is_target && let Some(Body::Box { .. }) = body {
        table.problem("target", "is true of a box; allowed: spheres and cylinders");
    }
    let course = read_course(&table, &name, names, carriers);
    table.finish();
    Some(Object {
        name,
        body: body?,
        color: color?,
        highlight,
        course: course?,
        heading_rad: heading_deg.map(f64::to_radians),
        is_target,
    })
}

fn read_body(table: &Table) -> Option<Body> {
    let (kind, shape) = kind_of(table, "shape", &["sphere", "cylinder", "box"])?;
    let body = match kind {
        "sphere" => length(&shape, "radius_m").map(|radius_m| Body::Sphere { radius_m }),
        "cylinder" => {
            let (radius_m, height_m) = (length(&shape, "radius_m"), length(&shape, "height_m"));
            radius_m
                .zip(height_m)
                .map(|(radius_m, height_m)| Body::Cylinder { radius_m, height_m })
        }
        _ => shape.required::<[f64; 3]>("size_m").and_then(|size_m| {
            let allowed = "three sides from 1e-6 to 10000 metres";
            let inside = |side_m: &f64| (1e-6..=MAX_DISTANCE_M).contains(side_m);
            if !size_m.iter().all(inside) {
                shape.refuse("size_m", allowed);
                return None;
            }
            Some(Body::Box {
                size_m: size_m.into(),
            })
        }),
    };
    shape.finish();
    body
}

fn read_course(
    table: &Table,
    name: &str,
    names: &[String],
    carriers: &mut Vec<(usize, Located<()>)>,
) -> Option<Course> {
    let kinds = [
        "still",
        "line",
        "circle",
        "waypoints",
        "harmonic",
        "throw",
        "rides",
    ];
    let (kind, path) = kind_of(table, "path", &kinds)?;
    let course = match kind {
        "still" => read_point(&path, "position_m").map(|position_m| Path::Still { position_m }),
        "line" => {
            let (position_m, velocity_mps) = (
                read_point(&path, "position_m"),
                read_point(&path, "velocity_mps"),
            );
            position_m
                .zip(velocity_mps)
                .map(|(position_m, velocity_mps)| Path::Line {
                    position_m,
                    velocity_mps,
                })
        }
        "circle" => read_circle(&path),
        "waypoints" => read_waypoints(&path),
        "harmonic" => read_harmonic(&path),
        "throw" => read_throw(&path),
        _ => {
            let carrier = read_carrier(&path, name, names);
            let offset_m = read_point(&path, "offset_m");
            carriers.extend(carrier.map(|carrier| (carrier, path.at("on", ()))));
            path.finish();
            return Some(Course::Rides {
                carrier: carrier?,
                offset_m: offset_m?,
            });
        }
    };
    path.finish();
    course.map(Course::Path)
}

fn read_carrier(path: &Table, name: &str, names: &[String]) -> Option<usize> {
    let on: String = path.required("on")?;
    let carrier = names.iter().position(|other| *other == on && on != name);
    if carrier.is_none() {
        let others: Vec<_> = names
            .iter()
            .filter(|other| *other != name)
            .cloned()
            .collect();
        path.problem("on", format!("is \"{on}\"; allowed: {}", others.join(", ")));
    }
    carrier
}

fn read_circle(path: &Table) -> Option<Path> {
    let (center_m, radius_m) = (read_point(path, "center_m"), length(path, "radius_m"));
    let period_s = read_period(path);
    let phase_deg: f64 = path.or("phase_deg", 0.0);
    Some(Path::Circle {
        center_m: center_m?,
        radius_m: radius_m?,
        period_s: period_s?,
        phase_rad: phase_deg.to_radians(),
    })
}

/// A period in seconds; negative ones turn the other way.
fn read_period(path: &Table) -> Option<f64> {
    let period_s: f64 = path.required("period_s")?;
    let allowed = "0.01 to 1000000 seconds, or the negative of that to turn the other way";
    check_within(path, "period_s", period_s.abs(), PERIODS_S, allowed).then_some(period_s)
}

const PERIODS_S: std::ops::RangeInclusive<f64> = 0.01..=1e6;

fn read_waypoints(path: &Table) -> Option<Path> {
    let times_s: Option<Vec<f64>> = path.required("times_s");
    let rows: Option<Vec<Vec<f64>>> = path.required("positions_m");
    let (times_s, rows) = (times_s?, rows?);
    let point = |row: &Vec<f64>| {
        let point: [f64; 3] = row[..].try_into().ok()?;
        let near = point.iter().all(|c| c.abs() <= MAX_DISTANCE_M);
        near.then(|| Vector3::from(point))
    };
    let points: Option<Vec<_>> = rows.iter().map(point).collect();
    let few = rows.len() <= MAX_POINTS;
    let Some(points) = points.filter(|_| few) else {
        let allowed = "at most 10000 points [x, y, z], each coordinate from -10000 to 10000 metres";
        path.refuse("positions_m", allowed);
        return None;
    };
    path.checked(Waypoints::new(times_s, points))
        .map(Path::Waypoints)
}

fn read_harmonic(path: &Table) -> Option<Path> {
    let center_m = read_point(path, "center_m");
    let sines = ["x", "y", "z"].map(|axis| read_sines(path, axis));
    let [x, y, z] = sines;
    Some(Path::Harmonic {
        center_m: center_m?,
        sines: [x?, y?, z?],
    })
}

fn read_sines(path: &Table, axis: &'static str) -> Option<Vec<Sine>> {
    let rows: Vec<Vec<f64>> = path.or(axis, Vec::new());
    let sine = |row: &Vec<f64>| match row[..] {
        [amplitude_m, period_s, phase_deg]
            if amplitude_m.abs() <= MAX_DISTANCE_M && PERIODS_S.contains(&period_s) =>
        {
            Some(Sine {
                amplitude_m,
                period_s,
                phase_rad: phase_deg.to_radians(),
            })
        }
        _ => None,
    };
    let sines: Option<Vec<_>> = rows.iter().map(sine).collect();
    let sines = sines.filter(|sines| sines.len() <= MAX_POINTS);
    if sines.is_none() {
        let allowed = "at most 10000 rows of [amplitude in metres, period in seconds (0.01 or more), phase in degrees]";
        path.refuse(axis, allowed);
    }
    sines
}

fn read_throw(path: &Table) -> Option<Path> {
    let (position_m, velocity_mps) = (
        read_point(path, "position_m"),
        read_point(path, "velocity_mps"),
    );
    let start_s = bounded(path, "start_s", 0.0, -1e6..=1e6);
    let rest_z_m: Option<f64> = path.required("rest_z_m");
    let bounce = bounded(path, "bounce", 0.7, 0.0..=0.95);
    let (position_m, rest_z_m) = (position_m?, rest_z_m?);
    if !(rest_z_m.abs() <= MAX_DISTANCE_M && rest_z_m <= position_m.z) {
        path.refuse(
            "rest_z_m",
            "the height where it bounces, not above where it is thrown",
        );
        return None;
    }
    Some(Path::Throw(Throw {
        position_m,
        velocity_mps: velocity_mps?,
        start_s,
        rest_z_m,
        bounce,
    }))
}
