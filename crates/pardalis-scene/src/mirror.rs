//! The mirror of an exact mirror camera.

use std::fmt::Write as _;

use super::reader::{Kind, Table};
use pardalis_camera::{ConstantResolution, MirrorForm, MirrorProfile, Resolution};

/// Reads the mirror: the key `profile` or one of the tables of [`KINDS`]. `vertex_m` moves it to another distance
/// from the pinhole.
pub(super) fn read_profile(table: &Table) -> Option<MirrorProfile> {
    let vertex_m = table
        .key(
            "vertex_m",
            "Distance of the mirror's vertex from the pinhole, in place of the one in the mirror's own table.",
        )
        .within(1e-6..=1000.0)
        .depends("as the mirror's own table states")
        .optional();
    let rows = table
        .key(
            "profile",
            "The mirror as rows [t, F] or [t, F, F']: distance from the axis and height above the pinhole in metres, and the slope.",
        )
        .unit("m")
        .depends("unless the mirror is one of the tables below")
        .conditional::<Vec<Vec<f64>>>();
    let profile = if table.has("profile") {
        for (kind, _) in KINDS {
            if table.knows(kind) {
                table.conflict(kind, "profile");
            }
        }
        read_rows(table, &rows?)
    } else {
        table.one_of(&KINDS, |kind, shape| match kind {
            "sphere" => read_sphere(shape),
            "cone" => read_cone(shape),
            "paraboloid" => read_paraboloid(shape),
            "hyperboloid" => read_hyperboloid(shape),
            _ => read_constant_resolution(shape),
        })
    };
    match vertex_m {
        Some(vertex_m) => table.checked(profile?.at_vertex(vertex_m)),
        None => profile,
    }
}

/// Writes a mirror under the key with which [`read_profile`] reads it.
pub(super) fn push_profile(text: &mut String, profile: &MirrorProfile) {
    let (kind, shape): (_, Vec<(_, f64)>) = match profile.form() {
        MirrorForm::Sphere { radius_m } => ("sphere", vec![("radius_m", radius_m)]),
        MirrorForm::Cone { half_angle_rad } => (
            "cone",
            vec![("half_angle_deg", half_angle_rad.to_degrees())],
        ),
        MirrorForm::Paraboloid { focal_m } => ("paraboloid", vec![("focal_m", focal_m)]),
        MirrorForm::Hyperboloid {
            semi_axes_m: [a, b],
        } => ("hyperboloid", vec![("a_m", a), ("b_m", b)]),
        MirrorForm::ConstantResolution(design) => {
            push_design(text, &design, profile.vertex_m());
            return;
        }
        MirrorForm::Rows(rows) => {
            text.push_str("profile = [\n");
            // Writing to a String cannot fail.
            for row in rows {
                let _ = writeln!(text, "    {row:?},");
            }
            text.push_str("]\n");
            return;
        }
    };
    let lengths = [("vertex_m", profile.vertex_m()), ("rim_m", profile.rim_m())];
    let values: Vec<_> = shape
        .into_iter()
        .chain(lengths)
        .map(|(key, value)| format!("{key} = {value:?}"))
        .collect();
    let _ = writeln!(text, "{kind} = {{ {} }}", values.join(", "));
}

fn push_design(text: &mut String, design: &ConstantResolution, vertex_m: f64) {
    let (key, value) = match design.resolution {
        Resolution::PerMetre(a) => ("resolution_per_m", a),
        Resolution::RimShows(r_m) => ("rim_view_m", r_m),
    };
    let (designed_m, rim_m) = (design.vertex_m, design.rim_m);
    let (plane_z_m, offset) = (design.plane_z_m, design.offset);
    if vertex_m != designed_m {
        let _ = writeln!(text, "vertex_m = {vertex_m:?}");
    }
    let _ = writeln!(
        text,
        "constant_resolution = {{ vertex_m = {designed_m:?}, rim_m = {rim_m:?}, plane_z_m = {plane_z_m:?}, \
         {key} = {value:?}, offset = {offset:?} }}"
    );
}

const KINDS: [Kind; 5] = [
    ("sphere", "A ball."),
    ("cone", "A cone with its tip towards the pinhole."),
    ("paraboloid", "A paraboloid."),
    ("hyperboloid", "A sheet of a hyperboloid."),
    (
        "constant_resolution",
        "A mirror that images a plane with constant resolution (Hicks and Bajcsy 2000).",
    ),
];

fn read_rows(table: &Table, rows: &[Vec<f64>]) -> Option<MirrorProfile> {
    let rows_of_two: Option<Vec<[f64; 2]>> = columns(rows);
    let rows_of_three: Option<Vec<[f64; 3]>> = columns(rows);
    match (rows_of_two, rows_of_three) {
        (Some(rows), _) => table.checked(MirrorProfile::from_rows(&rows)),
        (_, Some(rows)) => table.checked(MirrorProfile::from_rows_with_slopes(&rows)),
        _ => {
            table.reject("profile", "rows [t, F] or rows [t, F, F'], in metres");
            None
        }
    }
}

fn columns<const N: usize>(rows: &[Vec<f64>]) -> Option<Vec<[f64; N]>> {
    rows.iter()
        .map(|row| row.as_slice().try_into().ok())
        .collect()
}

/// Reads a length of the mirror, in metres.
fn length(table: &Table, name: &'static str, about: &'static str) -> Option<f64> {
    table.key(name, about).within(1e-6..=1000.0).required()
}

/// Reads the distance of the vertex and the radius of the rim, which every mirror has.
fn read_vertex_and_rim(table: &Table) -> [Option<f64>; 2] {
    [
        length(
            table,
            "vertex_m",
            "Distance of the vertex from the pinhole.",
        ),
        length(table, "rim_m", "Radius of the rim."),
    ]
}

fn read_sphere(table: &Table) -> Option<MirrorProfile> {
    let [vertex_m, rim_m] = read_vertex_and_rim(table);
    let radius_m = length(
        table,
        "radius_m",
        "Radius of the ball, greater than `rim_m`.",
    );
    table.checked(MirrorProfile::sphere(vertex_m?, radius_m?, rim_m?))
}

fn read_cone(table: &Table) -> Option<MirrorProfile> {
    let [vertex_m, rim_m] = read_vertex_and_rim(table);
    let half_angle_deg: Option<f64> = table
        .key("half_angle_deg", "Angle between the axis and the surface.")
        .within(0.1..90.0)
        .required();
    let profile = MirrorProfile::cone(vertex_m?, half_angle_deg?.to_radians(), rim_m?);
    table.checked(profile)
}

fn read_paraboloid(table: &Table) -> Option<MirrorProfile> {
    let [vertex_m, rim_m] = read_vertex_and_rim(table);
    let focal_m = length(table, "focal_m", "Focal length.");
    table.checked(MirrorProfile::paraboloid(vertex_m?, focal_m?, rim_m?))
}

fn read_hyperboloid(table: &Table) -> Option<MirrorProfile> {
    let [vertex_m, rim_m] = read_vertex_and_rim(table);
    let a_m = length(table, "a_m", "Semi-axis along the optical axis.");
    let b_m = length(table, "b_m", "Semi-axis across it.");
    table.checked(MirrorProfile::hyperboloid(vertex_m?, [a_m?, b_m?], rim_m?))
}

fn read_constant_resolution(table: &Table) -> Option<MirrorProfile> {
    let [vertex_m, rim_m] = read_vertex_and_rim(table);
    let plane_z_m = table
        .key(
            "plane_z_m",
            "Height z of the plane in the camera's frame, below `vertex_m`: negative for a floor below a camera that looks up.",
        )
        .within(-1e6..=1e6)
        .required();
    let per_metre = table
        .key(
            "resolution_per_m",
            "Image radius, in focal lengths, per metre on the plane.",
        )
        .within(1e-9..=1e6)
        .depends("unless `rim_view_m` is given")
        .conditional()
        .map(Resolution::PerMetre);
    let rim_shows = table
        .key(
            "rim_view_m",
            "Distance from the axis of the point of the plane that is visible at the rim.",
        )
        .within(1e-6..=1e6)
        .depends("unless `resolution_per_m` is given")
        .conditional()
        .map(Resolution::RimShows);
    let offset = table
        .key(
            "offset",
            "Offset of the image radius, in focal lengths; below 0 the mirror has a tip and does not show the points near the axis.",
        )
        .within(-1e6..=0.0)
        .or(0.0);
    let resolution = match (per_metre, rim_shows) {
        (Some(resolution), None) | (None, Some(resolution)) => Some(resolution),
        (Some(_), Some(_)) => {
            table.conflict("rim_view_m", "resolution_per_m");
            None
        }
        (None, None) => {
            if !table.has("resolution_per_m") && !table.has("rim_view_m") {
                table.problem_here("has no resolution; give resolution_per_m or rim_view_m");
            }
            None
        }
    };
    let design = ConstantResolution {
        vertex_m: vertex_m?,
        rim_m: rim_m?,
        plane_z_m: plane_z_m?,
        resolution: resolution?,
        offset,
    };
    table.checked(design.design())
}
