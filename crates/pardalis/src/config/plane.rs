//! Cameras that are known by a plane: the homography, and where the camera stands.

use super::camera::CameraConfig;
use super::reader::Table;
use crate::camera::{Camera, Plane};

/// The table `model.plane`.
pub(super) fn read_plane(table: &Table) -> Option<Plane<f64>> {
    let homography = table.required::<[[f64; 3]; 3]>("homography");
    let center_m = table.optional::<[f64; 3]>("camera_center_m");
    if center_m.is_none() && table.has("camera_center_m") {
        return None;
    }
    table.checked(Plane::new(homography?, center_m))
}

/// The names of cameras that are known by a plane alone.
pub(super) fn without_height(cameras: &[CameraConfig]) -> Vec<String> {
    let is_one = |camera: &&CameraConfig| matches!(&camera.camera, Camera::Plane(plane) if plane.center_m().is_none());
    cameras
        .iter()
        .filter(is_one)
        .map(|camera| camera.name.clone())
        .collect()
}
