//! Calibration files of every format: Pardalis TOML, whose tables `[cameras.NAME]` contain model, size and pose like
//! scene files, and the [formats of other programs](pardalis_camera::formats).

use std::fmt::Write as _;

use super::camera::read_pose;
use super::description::{KeyDescription, Presence};
use super::keys::keys_of;
use super::mirror::push_profile;
use super::model::{pose_of_model, read_model};
use super::reader::{Journal, Problem, Table};
use pardalis_camera::CalibratedCamera;
use pardalis_camera::Camera;
use pardalis_camera::formats::{self, Format, Lens};
use pardalis_core::Error;
use pardalis_core::error::MAX_IMAGE_SIDE_PX;

/// A format of calibration files.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CalibrationFormat {
    /// Pardalis TOML: the camera tables of scene files. Supports every model, and poses.
    Pardalis,
    /// The format of another program.
    Foreign(Format),
}

impl CalibrationFormat {
    /// All formats.
    pub const ALL: [Self; 7] = {
        let [a, b, c, d, e, f] = Format::ALL;
        [
            Self::Pardalis,
            Self::Foreign(a),
            Self::Foreign(b),
            Self::Foreign(c),
            Self::Foreign(d),
            Self::Foreign(e),
            Self::Foreign(f),
        ]
    };

    /// Returns the name of the format in commands.
    pub fn name(self) -> &'static str {
        match self {
            Self::Pardalis => "pardalis",
            Self::Foreign(format) => format.name(),
        }
    }

    /// Reports whether the format supports a model with this name (see [`Camera::kind`]).
    pub fn holds(self, kind: &str) -> bool {
        match self {
            Self::Pardalis => true,
            Self::Foreign(format) => format.holds(kind),
        }
    }
}

/// Reads the cameras of a calibration file of any format, recognised by its content; see [`formats::read`].
pub fn read(text: &str, lens: Option<Lens>) -> Result<Vec<CalibratedCamera>, Error> {
    formats::read_or(text, lens, |text| {
        let is_toml = text.lines().any(is_toml_line);
        is_toml.then(|| read_toml(text).map_err(one_error))
    })
}

/// Returns the text of a calibration file; see [`formats::write`].
pub fn write(format: CalibrationFormat, cameras: &[CalibratedCamera]) -> Result<String, Error> {
    match format {
        CalibrationFormat::Pardalis => {
            formats::check_names(cameras)?;
            Ok(write_toml(cameras))
        }
        CalibrationFormat::Foreign(format) => formats::write(format, cameras),
    }
}

/// Reports whether a line is a table's header or a setting, which exist in no other format.
fn is_toml_line(line: &str) -> bool {
    let line = line.trim();
    let begins_name = |text: &str| text.starts_with(|c: char| c.is_ascii_alphabetic() || c == '_');
    let part_of_key = |c: char| c.is_ascii_alphanumeric() || "_-. ".contains(c);
    begins_name(line.trim_start_matches('[')) && line.starts_with('[')
        || line
            .split_once('=')
            .is_some_and(|(key, _)| begins_name(key) && key.chars().all(part_of_key))
}

/// Joins the problems of a Pardalis TOML file into one error, at the line of the first.
fn one_error(problems: Vec<Problem>) -> Error {
    const MAX_LISTED: usize = 20;
    let line = problems.first().map_or(1, |problem| problem.line);
    let listed: Vec<_> = problems
        .iter()
        .take(MAX_LISTED)
        .map(ToString::to_string)
        .collect();
    let message = listed.join("; ");
    let prefix = format!("line {line}: ");
    let message = message.strip_prefix(&prefix).unwrap_or(&message);
    Error::Parse {
        line,
        message: message.to_owned(),
    }
}

/// Reads the text of a calibration in Pardalis TOML. Returns every problem on failure, in the order of lines.
pub fn read_toml(text: &str) -> Result<Vec<CalibratedCamera>, Vec<Problem>> {
    let (journal, root) = Journal::parse(text);
    let table = Table::root(&journal, &root);
    let cameras = read_cameras(&table);
    table.finish();
    journal.finish().map(|_| cameras)
}

/// Returns the keys of calibration files.
pub fn keys() -> Vec<KeyDescription> {
    keys_of(|_, table| {
        read_cameras(table);
    })
}

fn read_cameras(table: &Table) -> Vec<CalibratedCamera> {
    table
        .named_tables(
            "cameras",
            "The cameras, each by its name.",
            Presence::Required,
        )
        .into_iter()
        .filter_map(|(name, table)| read_camera(name, table))
        .collect()
}

fn read_camera(name: String, table: Table) -> Option<CalibratedCamera> {
    let camera = read_model(&table);
    let size_px = table
        .key("size_px", "Width and height of the images.")
        .within(1.0..=MAX_IMAGE_SIDE_PX as f64)
        .depends("not known")
        .optional::<[f64; 2]>();
    let whole = |v: f64| v.fract() == 0.0 && v >= 1.0 && v <= MAX_IMAGE_SIDE_PX as f64;
    if size_px.is_some_and(|size| !size.into_iter().all(whole)) {
        let allowed = format!("two whole numbers from 1 to {MAX_IMAGE_SIDE_PX}, [width, height]");
        table.reject("size_px", &allowed);
    }
    let world_from_camera = read_pose(&table).or(camera.as_ref().and_then(pose_of_model));
    table.finish();
    Some(CalibratedCamera {
        name,
        camera: camera?,
        size_px: size_px.map(|[width, height]| (width as usize, height as usize)),
        world_from_camera,
    })
}

/// Returns the text of a calibration in Pardalis TOML; reading it returns the same cameras.
pub fn write_toml(cameras: &[CalibratedCamera]) -> String {
    let mut text = "# Camera calibration: models in pixels, poses in metres.\n".to_owned();
    for camera in cameras {
        // Writing to a String cannot fail.
        let _ = writeln!(text, "\n[cameras.{}]", camera.name);
        if let Some((width, height)) = camera.size_px {
            let _ = writeln!(text, "size_px = [{width}, {height}]");
        }
        if let (Some(pose), None) = (&camera.world_from_camera, pose_of_model(&camera.camera)) {
            let matrix = pose.to_homogeneous();
            text.push_str("world_from_camera = [\n");
            for row in matrix.row_iter() {
                // Adding zero turns minus zero into zero.
                let row: Vec<f64> = row.iter().map(|v| v + 0.0).collect();
                let _ = writeln!(text, "    {row:?},");
            }
            text.push_str("]\n");
        }
        let _ = writeln!(
            text,
            "\n[cameras.{}.model.{}]",
            camera.name,
            camera.camera.kind()
        );
        push_model(&mut text, &camera.camera);
    }
    text
}

/// Appends the keys of a model's table.
fn push_model(text: &mut String, camera: &Camera) {
    let values: Vec<f64> = camera.parameters().iter().map(|&(_, v)| v).collect();
    let mut push = |key: &str, value: &dyn std::fmt::Debug| {
        let _ = writeln!(text, "{key} = {value:?}");
    };
    match camera {
        Camera::Equidistant(model) => {
            push("f_px_per_rad", &values[0]);
            push("center_px", &&values[1..3]);
            push(
                "field_of_view_deg",
                &field_of_view_deg(model.max_angle_rad()),
            );
        }
        Camera::Pinhole(_) => {
            push("f_px", &&values[..2]);
            push("center_px", &&values[2..4]);
            let distortion = &values[4..];
            let zero_after = |count: usize| distortion[count..].iter().all(|&v| v == 0.0);
            let count = [0, 4, 5, 8].into_iter().find(|&count| zero_after(count));
            push("distortion", &&distortion[..count.unwrap_or(12)]);
        }
        Camera::KannalaBrandt(model) => {
            push("f_px", &&values[..2]);
            push("center_px", &&values[2..4]);
            push("k", &&values[4..]);
            push(
                "field_of_view_deg",
                &field_of_view_deg(model.max_angle_rad()),
            );
        }
        Camera::Mei(_) => {
            push("f_px", &&values[..2]);
            push("skew_px", &values[2]);
            push("center_px", &&values[3..5]);
            push("xi", &values[5]);
            push("distortion", &&values[6..]);
        }
        Camera::Ocam(model) => {
            push("polynomial", &model.polynomial());
            push("center_px", &&values[..2]);
            push("affine", &&values[2..5]);
            push("max_radius_px", &model.max_radius_px());
        }
        Camera::ExactMirror(model) => {
            push("f_px", &&values[..2]);
            push("center_px", &&values[2..4]);
            push_profile(text, model.profile());
        }
        Camera::Plane(model) => {
            let rows = model.pixel_from_plane().map(|row| format!("{row:?}"));
            let _ = writeln!(text, "homography = [{}]", rows.join(", "));
            if let Some(center_m) = model.center_m() {
                let _ = writeln!(text, "camera_center_m = {center_m:?}");
            }
        }
        Camera::Unified(_)
        | Camera::PerspectiveMirror(_)
        | Camera::DoubleSphere(_)
        | Camera::ExtendedUnified(_) => push_by_name(&camera.parameters(), push),
    }
}

/// Appends the keys of models whose keys are the names of their parameters, except for pairs.
fn push_by_name(
    parameters: &[(&'static str, f64)],
    mut push: impl FnMut(&str, &dyn std::fmt::Debug),
) {
    for pair in parameters.windows(2) {
        match (pair[0].0, pair[1].0) {
            ("fx_px", "fy_px") => push("f_px", &[pair[0].1, pair[1].1]),
            ("cx_px", "cy_px") => push("center_px", &[pair[0].1, pair[1].1]),
            _ => {}
        }
    }
    let paired = ["fx_px", "fy_px", "cx_px", "cy_px"];
    for (name, value) in parameters.iter().filter(|(name, _)| !paired.contains(name)) {
        push(name, value);
    }
}

/// Returns twice the angle in degrees, as the roundest number that is read as the same angle.
fn field_of_view_deg(max_angle_rad: f64) -> f64 {
    let degrees = 2.0 * max_angle_rad.to_degrees();
    let round = (degrees * 1e6).round() / 1e6;
    if (round / 2.0).to_radians() == max_angle_rad {
        round
    } else {
        degrees
    }
}
