//! The mirror of an exact mirror camera.

use std::fmt::Write as _;

use super::reader::Table;
use pardalis_camera::{ConstantResolution, MirrorForm, MirrorProfile, Resolution};

/// The mirror under the one of these keys that the table has: `profile`, rows of t, F and perhaps F'; or a table of a shape's parameters. With
/// `vertex_m` it stands at another distance from the pinhole than those say.
pub(super) fn read_profile(table: &Table) -> Option<MirrorProfile> {
    let vertex_m = table.optional("vertex_m");
    let profile = read_shape(table)?;
    match vertex_m {
        Some(vertex_m) => table.checked(profile.at_vertex(vertex_m)),
        None => Some(profile),
    }
}

fn read_shape(table: &Table) -> Option<MirrorProfile> {
    if let Some(rows) = table.optional::<Vec<Vec<f64>>>("profile") {
        for kind in KINDS.into_iter().filter(|kind| table.has(kind)) {
            table.table(kind);
            table.problem(kind, "stands beside profile; keep one of them");
        }
        return read_rows(table, &rows);
    }
    if table.has("profile") {
        return None;
    }
    let (kind, shape) = table.one_of(&KINDS)?;
    let profile = match kind {
        "sphere" => read_sphere(&shape),
        "cone" => read_cone(&shape),
        "paraboloid" => read_paraboloid(&shape),
        "hyperboloid" => read_hyperboloid(&shape),
        _ => read_constant_resolution(&shape),
    };
    shape.finish();
    profile
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
        Resolution::RimShows(r_m) => ("rim_shows_m", r_m),
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

const KINDS: [&str; 5] = [
    "sphere",
    "cone",
    "paraboloid",
    "hyperboloid",
    "constant_resolution",
];

fn read_rows(table: &Table, rows: &[Vec<f64>]) -> Option<MirrorProfile> {
    let rows_of_two: Option<Vec<[f64; 2]>> = columns(rows);
    let rows_of_three: Option<Vec<[f64; 3]>> = columns(rows);
    match (rows_of_two, rows_of_three) {
        (Some(rows), _) => table.checked(MirrorProfile::from_rows(&rows)),
        (_, Some(rows)) => table.checked(MirrorProfile::from_rows_with_slopes(&rows)),
        _ => {
            table.refuse("profile", "rows [t, F] or rows [t, F, F'], in metres");
            None
        }
    }
}

fn columns<const N: usize>(rows: &[Vec<f64>]) -> Option<Vec<[f64; N]>> {
    rows.iter()
        .map(|row| row.as_slice().try_into().ok())
        .collect()
}

fn read_sphere(table: &Table) -> Option<MirrorProfile> {
    let [vertex_m, radius_m, rim_m] =
        ["vertex_m", "radius_m", "rim_m"].map(|key| table.required(key));
    table.checked(MirrorProfile::sphere(vertex_m?, radius_m?, rim_m?))
}

fn read_cone(table: &Table) -> Option<MirrorProfile> {
    let [vertex_m, half_angle_deg, rim_m] =
        ["vertex_m", "half_angle_deg", "rim_m"].map(|key| table.required::<f64>(key));
    let half_angle_deg = half_angle_deg?;
    if !(0.1..90.0).contains(&half_angle_deg) {
        table.refuse("half_angle_deg", "0.1 to less than 90");
        return None;
    }
    let profile = MirrorProfile::cone(vertex_m?, half_angle_deg.to_radians(), rim_m?);
    table.checked(profile)
}

fn read_paraboloid(table: &Table) -> Option<MirrorProfile> {
    let [vertex_m, focal_m, rim_m] =
        ["vertex_m", "focal_m", "rim_m"].map(|key| table.required(key));
    table.checked(MirrorProfile::paraboloid(vertex_m?, focal_m?, rim_m?))
}

fn read_hyperboloid(table: &Table) -> Option<MirrorProfile> {
    let [vertex_m, a_m, b_m, rim_m] =
        ["vertex_m", "a_m", "b_m", "rim_m"].map(|key| table.required(key));
    table.checked(MirrorProfile::hyperboloid(vertex_m?, [a_m?, b_m?], rim_m?))
}

fn read_constant_resolution(table: &Table) -> Option<MirrorProfile> {
    let [vertex_m, rim_m, plane_z_m] =
        ["vertex_m", "rim_m", "plane_z_m"].map(|key| table.required(key));
    let per_metre = table.optional("resolution_per_m").map(Resolution::PerMetre);
    let rim_shows = table.optional("rim_shows_m").map(Resolution::RimShows);
    let offset = table.or("offset", 0.0);
    let resolution = match (per_metre, rim_shows) {
        (Some(resolution), None) | (None, Some(resolution)) => Some(resolution),
        (Some(_), Some(_)) => {
            table.problem(
                "rim_shows_m",
                "stands beside resolution_per_m; keep one of them",
            );
            None
        }
        (None, None) => {
            if !table.has("resolution_per_m") && !table.has("rim_shows_m") {
                table.problem_here("says no resolution; give resolution_per_m or rim_shows_m");
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
