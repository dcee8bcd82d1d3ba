//! Properties of a scene's cameras that its targets depend on.

use super::camera::CameraConfig;
use super::plane::Center;
use pardalis_camera::Camera;

/// The cameras of a scene, as far as its targets depend on them.
#[derive(Debug)]
pub(super) struct CameraNames {
    /// The names of all cameras.
    pub(super) all: Vec<String>,
    /// Cameras of a plane with unknown position, which cannot measure heights above the plane.
    pub(super) without_height: Vec<String>,
    /// The lowest camera of a plane, and its height in metres.
    pub(super) lowest: Option<(String, f64)>,
}

impl CameraNames {
    /// Collects the names of cameras; `all` also contains those that could not be read.
    pub(super) fn new(all: Vec<String>, cameras: &[CameraConfig]) -> Self {
        Self {
            all,
            without_height: without_height(cameras),
            lowest: lowest(cameras),
        }
    }
}

/// Returns the lowest camera of a plane, and its height in metres.
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

/// Returns the names of cameras of a plane with unknown position.
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
