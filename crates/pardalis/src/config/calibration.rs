//! Calibration files: the cameras of a rig in tables `[cameras.NAME]`, with model, size and pose as scene files have them.

use std::fmt::Write as _;

use super::camera::{pose_of_model, read_model, read_pose};
use super::mirror::push_profile;
use super::reader::{Journal, Problem, Table};
use crate::camera::Camera;
use crate::frame::MAX_IMAGE_SIDE_PX;
use crate::rig::CalibratedCamera;

/// Reads a calibration's text whole. On failure: every problem, in the order of lines.
pub fn read(text: &str) -> Result<Vec<CalibratedCamera>, Vec<Problem>> {
    let (journal, root) = Journal::parse(text);
    let table = Table::root(&journal, &root);
    let cameras: Vec<_> = table
        .named_tables("cameras", "camera")
        .into_iter()
        .filter_map(|(name, table)| read_camera(name, table))
        .collect();
    table.finish();
    journal.finish().map(|_| cameras)
}

fn read_camera(name: String, table: Table) -> Option<CalibratedCamera> {
    let camera = read_model(&table);
    let size_px = table.optional::<[f64; 2]>("size_px");
    let whole = |v: f64| v.fract() == 0.0 && v >= 1.0 && v <= MAX_IMAGE_SIDE_PX as f64;
    if size_px.is_some_and(|size| !size.into_iter().all(whole)) {
        let allowed = format!("two whole numbers from 1 to {MAX_IMAGE_SIDE_PX}, [width, height]");
        table.refuse("size_px", &allowed);
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

/// The text of a calibration file; reading it gives the same cameras.
pub fn write(cameras: &[CalibratedCamera]) -> String {
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
                // Minus zero becomes zero.
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

/// The keys of a model's table.
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

/// Models whose keys are the names of their parameters, but for pairs.
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

/// Twice the angle in degrees: the roundest number that is read as the same angle.
fn field_of_view_deg(max_angle_rad: f64) -> f64 {
    let degrees = 2.0 * max_angle_rad.to_degrees();
    let round = (degrees * 1e6).round() / 1e6;
    if (round / 2.0).to_radians() == max_angle_rad {
        round
    } else {
        degrees
    }
}
