//! Stands for a camera: paints an orange ball as any camera model sees it.

use nalgebra::{Point3, Vector3};
use pardalis::View;

/// Returns packed RGB of a grey room with an orange ball, and which pixels show the ball. Lengths are in metres in
/// the world frame.
pub(crate) fn ball(view: &View, center_m: [f64; 3], radius_m: f64) -> (Vec<u8>, Vec<bool>) {
    let center = Vector3::from((view.camera_from_world() * Point3::from(center_m)).coords);
    let (width, height) = view.size();
    let shows_ball = |pixel: [f64; 2]| {
        view.camera().unproject(pixel).is_some_and(|ray| {
            let to_center = center - Vector3::from(ray.origin);
            let direction = Vector3::from(ray.direction);
            let along = to_center.dot(&direction);
            along > 0.0 && (to_center - along * direction).norm() < radius_m
        })
    };
    let mut pixels = (0..height).flat_map(|v| (0..width).map(move |u| [u as f64, v as f64]));
    let mask: Vec<bool> = pixels.by_ref().map(shows_ball).collect();
    let color = |&shown: &bool| {
        if shown {
            [230, 120, 30]
        } else {
            [90, 100, 110]
        }
    };
    (mask.iter().flat_map(color).collect(), mask)
}
