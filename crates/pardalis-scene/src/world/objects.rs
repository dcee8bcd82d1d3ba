//! The objects of a world.

use nalgebra::Vector3;

use super::super::description::Presence;
use super::super::reader::{Journal, Kind, Located, Table};
use super::{
    MAX_DISTANCE_M, MIN_LENGTH_M, color_key, length, read_color, read_point, read_texture,
};
use pardalis_simulate::{
    Body, Course, Mark, Object, Path, Pattern, Sine, Texture, Throw, Waypoints, linear_from_srgb,
};

/// Maximum number of objects of one world.
const MAX_OBJECTS: usize = 100;
/// Maximum number of points of a path, and of sines of an axis.
const MAX_POINTS: usize = 10_000;

/// Reads the objects; invalid ones are left out and reported to the journal.
pub(super) fn read(journal: &Journal, table: &Table) -> Vec<Object> {
    let about = "The objects, each by its name.";
    let tables = table.named_tables("objects", about, Presence::Required);
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
            course: Course::Attached { .. },
            ..
        }) = &objects[carrier]
        {
            let message =
                "is attached to another object itself; allowed: an object with its own path";
            journal.report(place.problem(message));
        }
    }
    let objects: Vec<Object> = objects.into_iter().flatten().collect();
    for object in objects.iter().filter(|object| object.crowd.is_some()) {
        let is_other = |other: &&Object| other.crowd == object.crowd && other.body != object.body;
        if let Some(other) = objects.iter().find(is_other) {
            let message = format!(
                "give {} and {} of the crowd {} different shapes or sizes; members look alike",
                object.name,
                other.name,
                object.target_name()
            );
            table.problem("objects", message);
            break;
        }
        let is_namesake =
            |other: &&Object| other.crowd.is_none() && other.name == object.target_name();
        if let Some(other) = objects.iter().find(is_namesake)
            && other.is_target
        {
            let message = format!(
                "name an object {} like a crowd; give one of them another name",
                other.name
            );
            table.problem("objects", message);
            break;
        }
    }
    if objects.len() == names.len() && !objects.is_empty() && !objects.iter().any(|o| o.is_target) {
        table.problem(
            "objects",
            "contain no target; set target = true in one of them",
        );
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
    let texture = read_colors(&table);
    let marks = read_marks(&table, body.as_ref());
    let highlight = table
        .key(
            "highlight",
            "Strength of the highlight: 0 is none, 1 is white.",
        )
        .within(0.0..=1.0)
        .or(0.0);
    let heading_deg: Option<f64> = table
        .key(
            "heading_deg",
            "Fixed heading, counterclockwise from the x axis.",
        )
        .depends("the direction in which it moves")
        .optional();
    let tilt_deg: f64 = table
        .key(
            "tilt_deg",
            "Forward tilt about its position, at 0 s: at 90 an upright cylinder lies.",
        )
        .or(0.0);
    let spin_deg_per_s: f64 = table
        .key(
            "spin_deg_per_s",
            "Rate of that tilt: a ball that rolls forward spins at its speed divided by its radius.",
        )
        .within(-MAX_SPIN_DEG_PER_S..=MAX_SPIN_DEG_PER_S)
        .or(0.0);
    let is_target = table
        .key(
            "target",
            "Whether the object is to be tracked: it is a target of the scene, and its colours are learned.",
        )
        .or(false);
    let crowd: Option<String> = table
        .key(
            "crowd",
            "The crowd of objects that look alike of which this target is one. Instead of the object, the scene has a target of this name with count = \"any\", and the colours are learned from all of the crowd.",
        )
        .optional();
    if crowd.is_some() && !is_target && !table.is_describing() {
        let message = "is given, but the object is no target; add target = true, or remove it";
        table.problem("crowd", message);
    }
    let is_plain = |c: char| c.is_ascii_alphanumeric() || c == '-' || c == '_';
    if crowd
        .as_ref()
        .is_some_and(|name| name.is_empty() || !name.chars().all(is_plain))
    {
        let message = "is not a name; give letters, digits, - and _ only";
        table.problem("crowd", message);
    }
    let is_sphere = matches!(body, Some(Body::Sphere { .. }));
    let is_upright = matches!(body, Some(Body::Cylinder { .. } | Body::Box { .. }));
    if is_target && body.is_some() && !is_sphere && !is_upright {
        let message = "is true of another shape; allowed: spheres, cylinders and boxes";
        table.problem("target", message);
    }
    for (key, angle) in [("tilt_deg", tilt_deg), ("spin_deg_per_s", spin_deg_per_s)] {
        if is_target && is_upright && angle != 0.0 {
            let message = "tilts a target that is no ball, which must be upright; remove it";
            table.problem(key, message);
        }
    }
    let course = read_course(&table, &name, names, carriers);
    table.finish();
    Some(Object {
        name,
        body: body?,
        texture: texture?,
        marks,
        highlight,
        course: course?,
        heading_rad: heading_deg.map(f64::to_radians),
        tilt_rad: tilt_deg.to_radians(),
        spin_rad_per_s: spin_deg_per_s.to_radians(),
        is_target,
        crowd,
    })
}

/// Maximum rate of a tilt, in degrees per second.
const MAX_SPIN_DEG_PER_S: f64 = 36_000.0;

/// Reads one colour, or a pattern of two.
fn read_colors(table: &Table) -> Option<Texture> {
    let texture = read_texture(table, Presence::Optional(""));
    let color = color_key(table).depends("unless `texture` is given");
    if table.has("texture") {
        if color.conditional::<[f64; 3]>().is_some() {
            table.conflict("color_srgb", "texture");
        }
        return texture;
    }
    let color = linear_from_srgb(color.required()?);
    Some(Texture {
        pattern: Pattern::Plain,
        colors: [color; 2],
    })
}

/// Reads what is painted on a ball; invalid marks are left out and reported.
fn read_marks(table: &Table, body: Option<&Body>) -> Vec<Mark> {
    let about = "Seams of a ball, along great circles at right angles to each other.";
    let seams = table.section("seams", about, |seams| {
        let color = read_color(seams);
        let width_m = length(seams, "width_m", "Width.");
        let about = "Number of seams: one is horizontal, the second runs ahead, the third across.";
        let count = seams
            .key("count", about)
            .within(1.0..=Mark::MAX_SEAMS as f64)
            .or(Mark::MAX_SEAMS);
        Some(Mark::Seams {
            count,
            width_m: width_m?,
            color: color?,
        })
    });
    let logo = table.section("logo", "A round logo on a ball.", |logo| {
        let color = read_color(logo);
        let radius_m = length(logo, "radius_m", "Radius.");
        let about =
            "Direction in which it faces: x ahead, y to the left, z up; any length except 0.";
        let direction = logo.key("direction", about).or([1.0, 0.0, 0.0]);
        let direction = Vector3::from(direction).try_normalize(1e-9);
        if direction.is_none() {
            logo.reject(
                "direction",
                "a direction from the ball's centre, not all zero",
            );
        }
        Some(Mark::Logo {
            direction: direction?,
            radius_m: radius_m?,
            color: color?,
        })
    });
    for key in ["seams", "logo"] {
        if table.has(key) && !matches!(body, None | Some(Body::Sphere { .. })) {
            table.problem(key, "is given for another shape; allowed: on spheres");
        }
    }
    seams.into_iter().chain(logo).collect()
}

const BODIES: [Kind; 6] = [
    ("sphere", "A ball."),
    ("cylinder", "An upright cylinder that stands on its base."),
    ("box", "An upright box that stands on its base."),
    ("cone", "An upright cone that stands on its base."),
    (
        "capsule",
        "A cylinder with round ends, such as a finger. Its position is the centre of one end.",
    ),
    (
        "cloth",
        "A hanging piece of cloth with folds and an irregular outline, which faces ahead. Its position is the middle of its lower edge.",
    ),
];

fn read_body(table: &Table) -> Option<Body> {
    let about = "Shape and size.";
    table.choice(
        "shape",
        about,
        &BODIES,
        Presence::Required,
        |kind, shape| match kind {
            "sphere" => {
                length(shape, "radius_m", "Radius.").map(|radius_m| Body::Sphere { radius_m })
            }
            "cylinder" => {
                let radius_m = length(shape, "radius_m", "Radius.");
                let height_m = length(shape, "height_m", "Height.");
                radius_m
                    .zip(height_m)
                    .map(|(radius_m, height_m)| Body::Cylinder { radius_m, height_m })
            }
            "box" => {
                let size_m = shape
                    .key("size_m", "Length ahead, width and height.")
                    .within(MIN_LENGTH_M..=MAX_DISTANCE_M)
                    .required::<[f64; 3]>();
                size_m.map(|size_m| Body::Box {
                    size_m: size_m.into(),
                })
            }
            "cone" => {
                let radius_m = length(shape, "radius_m", "Radius of the base.");
                let height_m = length(shape, "height_m", "Height.");
                radius_m
                    .zip(height_m)
                    .map(|(radius_m, height_m)| Body::Cone { radius_m, height_m })
            }
            "capsule" => {
                let radius_m = length(shape, "radius_m", "Radius.");
                let about =
                    "Centre of the other end in the object's frame: x ahead, y to its left, z up.";
                let to_m = read_point(shape, "to_m", about)?;
                if to_m.norm() < MIN_LENGTH_M {
                    shape.reject("to_m", "a point other than the first end; give a sphere");
                    return None;
                }
                radius_m.map(|radius_m| Body::Capsule { radius_m, to_m })
            }
            _ => {
                let size_m = shape
                    .key("size_m", "Width and height.")
                    .within(MIN_LENGTH_M..=MAX_DISTANCE_M)
                    .required::<[f64; 2]>();
                size_m.map(|size_m| Body::Cloth { size_m })
            }
        },
    )
}

/// The ways in which an object or a platform moves by itself.
pub(super) const PATHS: [Kind; 6] = [
    ("still", "At rest."),
    ("line", "Along a line at constant velocity."),
    ("circle", "Along a horizontal circle at constant speed."),
    (
        "waypoints",
        "Along a smooth curve through points; at rest before and after.",
    ),
    ("harmonic", "A sum of sines on each axis."),
    ("throw", "Thrown: a parabola, then bounces on the floor."),
];

const ATTACHED: Kind = ("attached", "Attached to another object.");

fn read_course(
    table: &Table,
    name: &str,
    names: &[String],
    carriers: &mut Vec<(usize, Located<()>)>,
) -> Option<Course> {
    let about = "How the object moves. A ball's position is its centre, that of any other body the centre of its base.";
    let [still, line, circle, waypoints, harmonic, throw] = PATHS;
    let kinds = [still, line, circle, waypoints, harmonic, throw, ATTACHED];
    table.choice("path", about, &kinds, Presence::Required, |kind, path| {
        if kind != ATTACHED.0 {
            return read_path(kind, path).map(Course::Path);
        }
        let carrier = read_carrier(path, name, names);
        let about = "Offset in the other object's frame: x ahead, y to its left, z up.";
        let offset_m = read_point(path, "offset_m", about);
        carriers.extend(carrier.map(|carrier| (carrier, path.at("to", ()))));
        Some(Course::Attached {
            carrier: carrier?,
            offset_m: offset_m?,
        })
    })
}

/// Reads a path of this kind, one of [`PATHS`].
pub(super) fn read_path(kind: &str, path: &Table) -> Option<Path> {
    match kind {
        "still" => {
            let position_m = read_point(path, "position_m", "Position.");
            position_m.map(|position_m| Path::Still { position_m })
        }
        "line" => {
            let position_m = read_point(path, "position_m", "Position at 0 s.");
            let velocity_mps = read_point(path, "velocity_mps", "Velocity.");
            position_m
                .zip(velocity_mps)
                .map(|(position_m, velocity_mps)| Path::Line {
                    position_m,
                    velocity_mps,
                })
        }
        "circle" => read_circle(path),
        "waypoints" => read_waypoints(path),
        "harmonic" => read_harmonic(path),
        _ => read_throw(path),
    }
}

fn read_carrier(path: &Table, name: &str, names: &[String]) -> Option<usize> {
    let to: String = path
        .key(
            "to",
            "Name of the other object, which must have its own path.",
        )
        .required()?;
    let carrier = names.iter().position(|other| *other == to && to != name);
    if carrier.is_none() {
        let others: Vec<_> = names
            .iter()
            .filter(|other| *other != name)
            .cloned()
            .collect();
        path.reject("to", &others.join(", "));
    }
    carrier
}

fn read_circle(path: &Table) -> Option<Path> {
    let center_m = read_point(path, "center_m", "Centre.");
    let radius_m = length(path, "radius_m", "Radius.");
    let period_s: Option<f64> = path
        .key(
            "period_s",
            "Time of one turn, 0.01 to 1000000 in magnitude; negative turns clockwise.",
        )
        .within(-GREATEST_PERIOD_S..=GREATEST_PERIOD_S)
        .required();
    let period_s = period_s.filter(|period_s| {
        let allowed = (LEAST_PERIOD_S..=GREATEST_PERIOD_S).contains(&period_s.abs());
        if !allowed {
            path.reject(
                "period_s",
                "0.01 to 1000000 seconds, or the negative of that to turn clockwise",
            );
        }
        allowed
    });
    let phase_deg: f64 = path
        .key(
            "phase_deg",
            "Angle from the x axis at 0 s, counterclockwise.",
        )
        .or(0.0);
    Some(Path::Circle {
        center_m: center_m?,
        radius_m: radius_m?,
        period_s: period_s?,
        phase_rad: phase_deg.to_radians(),
    })
}

/// Minimum period, in seconds.
const LEAST_PERIOD_S: f64 = 0.01;
/// Maximum period, in seconds.
const GREATEST_PERIOD_S: f64 = 1e6;

fn read_waypoints(path: &Table) -> Option<Path> {
    let times_s: Option<Vec<f64>> = path
        .key("times_s", "Time of each point, ascending.")
        .required();
    let rows: Option<Vec<Vec<f64>>> = path
        .key("positions_m", "The points [x, y, z], 2 to 10000.")
        .within(-MAX_DISTANCE_M..=MAX_DISTANCE_M)
        .required();
    let (times_s, rows) = (times_s?, rows?);
    let point = |row: &Vec<f64>| <[f64; 3]>::try_from(&row[..]).ok().map(Vector3::from);
    let points: Option<Vec<_>> = rows.iter().map(point).collect();
    let Some(points) = points.filter(|_| rows.len() <= MAX_POINTS) else {
        path.reject("positions_m", "at most 10000 points [x, y, z]");
        return None;
    };
    path.checked(Waypoints::new(times_s, points))
        .map(Path::Waypoints)
}

fn read_harmonic(path: &Table) -> Option<Path> {
    let center_m = read_point(path, "center_m", "Centre of the motion.");
    let [x, y, z] = ["x", "y", "z"].map(|axis| read_sines(path, axis));
    Some(Path::Harmonic {
        center_m: center_m?,
        sines: [x?, y?, z?],
    })
}

fn read_sines(path: &Table, axis: &'static str) -> Option<Vec<Sine>> {
    let about =
        "Sines on this axis: rows of [amplitude in metres, period in seconds, phase in degrees].";
    let rows: Vec<Vec<f64>> = path.key(axis, about).unit("m, s, degrees").or(Vec::new());
    sines_of(path, axis, &rows, "metres")
}

/// Returns the sines of rows, given under a key, with amplitudes in this unit.
pub(super) fn sines_of(
    path: &Table,
    key: &'static str,
    rows: &[Vec<f64>],
    unit: &str,
) -> Option<Vec<Sine>> {
    let sine = |row: &Vec<f64>| match row[..] {
        [amplitude_m, period_s, phase_deg]
            if amplitude_m.abs() <= MAX_DISTANCE_M
                && (LEAST_PERIOD_S..=GREATEST_PERIOD_S).contains(&period_s) =>
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
        let allowed = format!(
            "at most 10000 rows of [amplitude in {unit}, period in seconds (0.01 or more), phase in degrees]"
        );
        path.reject(key, &allowed);
    }
    sines
}

fn read_throw(path: &Table) -> Option<Path> {
    let position_m = read_point(path, "position_m", "Position from which it is thrown.");
    let velocity_mps = read_point(path, "velocity_mps", "Velocity with which it is thrown.");
    let start_s = path
        .key(
            "start_s",
            "Time at which it is thrown; it is at rest before.",
        )
        .within(-1e6..=1e6)
        .or(0.0);
    let rest_z_m: Option<f64> = path
        .key(
            "rest_z_m",
            "Height of its position at a bounce and at rest; not above `position_m`.",
        )
        .within(-MAX_DISTANCE_M..=MAX_DISTANCE_M)
        .required();
    let restitution = path
        .key(
            "restitution",
            "Share of the vertical speed that remains after a bounce.",
        )
        .within(0.0..=0.95)
        .or(Throw::DEFAULT_RESTITUTION);
    let drag_per_m = path
        .key(
            "drag_per_m",
            "Deceleration in the air divided by the square of the speed: 0.13 for a table tennis ball.",
        )
        .within(0.0..=10.0)
        .or(0.0);
    let spin_hz: [f64; 3] = path
        .key(
            "spin_hz",
            "Acceleration by spin (Magnus force) divided by the speed, along the axis of the spin: its cross product with the velocity is the acceleration. For a table tennis ball with a strong topspin about 0.5. Bounces do not change it.",
        )
        .within(-100.0..=100.0)
        .or([0.0; 3]);
    let (position_m, rest_z_m) = (position_m?, rest_z_m?);
    if rest_z_m > position_m.z {
        path.reject(
            "rest_z_m",
            "the height at which it bounces, not above the start of the throw",
        );
        return None;
    }
    Some(Path::Throw(Throw {
        position_m,
        velocity_mps: velocity_mps?,
        start_s,
        rest_z_m,
        bounce: restitution,
        air: (drag_per_m, spin_hz.into()),
    }))
}
