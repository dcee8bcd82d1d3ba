//! What the targets of a scene need to know of its cameras.

use super::camera::CameraConfig;
use super::plane::Center;
use pardalis_camera::Camera;

/// The cameras of a scene, as far as its targets need to know them.
#[derive(Debug)]
pub(super) struct CameraNames {
    /// All of them.
    pub(super) all: Vec<String>,
    /// Those that are known by a plane alone, so that they say nothing of heights over it.
    pub(super) without_height: Vec<String>,
    /// The one of those known by a plane that stands lowest, and its height in metres.
    pub(super) lowest: Option<(String, f64)>,
}

impl CameraNames {
    /// Collects the names of cameras; `all` also holds those that could not be read.
    pub(super) fn new(all: Vec<String>, cameras: &[CameraConfig]) -> Self {
        Self {
            all,
            without_height: without_height(cameras),
            lowest: lowest(cameras),
        }
    }
}

/// The camera of a plane that stands lowest over it, and its height in metres.
fn lowest(cameras: &[CameraConfig]) -> Option<(String, f64)> {
    let height = |camera: &CameraConfig| {
        let center_m = match (&camera.rectangle, &camera.camera) {
            (Some(rectangle), _) => match rectangle.value.center {
                Center::At(center_m) => Some(center_m),
                _ => None,
            },
            (None, Camera::Plane(plane)) => plane.center_m(),
            _ => None,
        };
        center_m.map(|[_, _, height_m]| (camera.name.clone(), height_m))
    };
    let heights = cameras.iter().filter_map(height);
    heights.min_by(|a, b| a.1.total_cmp(&b.1))
}

/// The names of cameras that are known by a plane alone.
fn without_height(cameras: &[CameraConfig]) -> Vec<String> {
    let is_one = |camera: &&CameraConfig| match (&camera.rectangle, &camera.camera) {
        (Some(rectangle), _) => rectangle.value.center == Center::Unknown,
        (None, Camera::Plane(plane)) => plane.center_m().is_none(),
        _ => false,
    };
    cameras
        .iter()
        .filter(is_one)
        .map(|camera| camera.name.clone())
        .collect()
}
