//! How the cameras of a scene stand to one another: their clocks, and cameras that are one by mistake.

use super::camera::CameraConfig;
use super::reader::{Problem, Table};

/// The longest that frames may wait for others, in seconds: what is held lies in memory.
const MAX_DELAY_S: f64 = 60.0;

/// The setting `timing.max_delay_s`. One camera alone has no others to wait for.
pub(super) fn read_max_delay_s(root: &Table, camera_count: usize) -> f64 {
    let default_s = if camera_count > 1 { 0.1 } else { 0.0 };
    let Some(timing) = root.table("timing") else {
        return default_s;
    };
    let max_delay_s = timing.or("max_delay_s", default_s);
    if !(0.0..=MAX_DELAY_S).contains(&max_delay_s) {
        timing.refuse("max_delay_s", "0 to 60 seconds");
    }
    timing.finish();
    max_delay_s
}

/// A warning for each camera that has exactly the pose of one before it, as a copied table has.
pub(super) fn cameras_at_one_place(cameras: &[CameraConfig]) -> impl Iterator<Item = Problem> {
    cameras.iter().enumerate().filter_map(|(number, camera)| {
        let twin = cameras[..number]
            .iter()
            .find(|other| other.world_from_camera == camera.world_from_camera)?;
        Some(Problem {
            line: camera.input.place().line,
            key: format!("cameras.{}", camera.name),
            message: format!(
                "stands and looks exactly as {} does; give it a world_from_camera of its own, unless that is meant",
                twin.name
            ),
        })
    })
}
