//! The timing of several cameras: waiting for late frames. Also checks for cameras with the same pose.

use super::Scene;
use super::camera::CameraConfig;
use super::reader::{Problem, Table};

/// Maximum time that frames may wait for others, in seconds, because waiting frames occupy memory.
const MAX_DELAY_S: f64 = 60.0;

/// Reads the setting `timing.max_delay_s`. A single camera has no others to wait for.
pub(super) fn read_max_delay_s(root: &Table, camera_count: usize) -> f64 {
    let default_s = Scene::default_max_delay_s(camera_count);
    let about = "How the frames of several cameras are put into order.";
    let max_delay_s = root.section("timing", about, |timing| {
        let max_delay_s = timing
            .key(
                "max_delay_s",
                "How long a frame waits, from its arrival, for earlier frames of other cameras.",
            )
            .within(0.0..=MAX_DELAY_S)
            .depends("0.1; 0 for one camera")
            .or(default_s);
        Some(max_delay_s)
    });
    max_delay_s.unwrap_or(default_s)
}

/// Returns a warning for each camera with exactly the pose of an earlier one, as in a copied table.
pub(super) fn cameras_at_one_place(cameras: &[CameraConfig]) -> impl Iterator<Item = Problem> {
    cameras.iter().enumerate().filter_map(|(number, camera)| {
        let twin = cameras[..number].iter().find(|other| {
            other.platform == camera.platform
                && other.has_pose
                && camera.has_pose
                && other.world_from_camera == camera.world_from_camera
        })?;
        Some(Problem {
            line: camera.input.place().line,
            key: format!("cameras.{}", camera.name),
            message: format!(
                "has the same pose as {}; correct its world_from_camera, unless that is intended",
                twin.name
            ),
        })
    })
}
