//! Cameras that are known by a plane: points of it or the homography, and where the camera stands.

use nalgebra::Matrix3;

use super::camera::CameraConfig;
use super::reader::Table;
use crate::Error;
use crate::camera::{Camera, Plane};
use crate::plane::{Homography, PointPair, camera_center_m, fit};

/// The table `model.plane`.
pub(super) fn read_plane(table: &Table) -> Option<Plane<f64>> {
    let homography = match (table.knows("points"), table.knows("homography")) {
        (true, true) => {
            table.problem("homography", "stands beside points; keep one of them");
            None
        }
        (false, false) => {
            let message = "is missing; give four or more points of the plane, points = [[u, v, x, y], ...], in pixels and metres, or homography";
            table.problem("points", message);
            None
        }
        (true, false) => read_points(table),
        (false, true) => {
            let rows = table.optional::<[[f64; 3]; 3]>("homography");
            let matrix = rows.map(|rows| Matrix3::from_row_slice(rows.as_flattened()));
            matrix.and_then(|matrix| table.checked(Homography::new(matrix)))
        }
    };
    let center_m = read_center(table, homography.as_ref())?;
    table.checked(Plane::new(&homography?, center_m))
}

fn read_points(table: &Table) -> Option<Homography> {
    let rows = table.optional::<Vec<[f64; 4]>>("points")?;
    let pairs: Vec<PointPair> = rows
        .iter()
        .map(|&[u, v, x, y]| PointPair {
            pixel: [u, v],
            plane_m: [x, y],
        })
        .collect();
    let found = fit(&pairs)
        .map_err(|error| table.problem("points", error.to_string()))
        .ok()?;
    for &outlier in &found.outliers {
        let distance = found.residuals_px[outlier].map_or_else(
            || "behind the camera".to_owned(),
            |[du, dv]| format!("{:.1} px from there", libm::hypot(du, dv)),
        );
        let message = format!(
            "point {} does not agree with the others, which put it {distance}; it is left out",
            outlier + 1
        );
        table.warn("points", message);
    }
    Some(found.homography)
}

/// The camera's centre, given or by its intrinsics; `None` where it is faulty.
fn read_center(table: &Table, homography: Option<&Homography>) -> Option<Option<[f64; 3]>> {
    let has_intrinsics = table.has("f_px") || table.has("center_px");
    if table.knows("camera_center_m") {
        for key in ["f_px", "center_px"] {
            if table.knows(key) {
                table.problem(key, "stands beside camera_center_m; keep one of them");
            }
        }
        return table.optional::<[f64; 3]>("camera_center_m").map(Some);
    }
    if !has_intrinsics {
        return Some(None);
    }
    let f_px = table.required::<[f64; 2]>("f_px");
    let center_px = table.required::<[f64; 2]>("center_px");
    let center_m: Result<[f64; 3], Error> = camera_center_m(homography?, f_px?, center_px?);
    center_m
        .map_err(|error| table.problem("f_px", error.to_string()))
        .ok()
        .map(Some)
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
