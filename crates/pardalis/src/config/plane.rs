//! Cameras that are known by a plane: the homography, and where the camera stands.

use super::reader::Table;
use crate::camera::Plane;

/// The table `model.plane`.
pub(super) fn read_plane(table: &Table) -> Option<Plane<f64>> {
    let homography = table.required::<[[f64; 3]; 3]>("homography");
    let center_m = table.optional::<[f64; 3]>("camera_center_m");
    if center_m.is_none() && table.has("camera_center_m") {
        return None;
    }
    table.checked(Plane::new(homography?, center_m))
}
