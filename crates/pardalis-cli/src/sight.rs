//! How a camera shows a body: where in its image, how large, and how far away.

use nalgebra::{Point3, Vector3};
use pardalis::shape::{Shape, Stance};
use pardalis::view::View;

/// Points of the outline from which its area is computed.
const OUTLINE_POINTS: usize = 32;

/// How a camera shows a body.
pub(crate) struct Sight {
    /// Pixel of the body's middle.
    pub(crate) pixel: [f64; 2],
    /// Radius of a circle with the area of the body's image, in pixels.
    pub(crate) radius_px: f64,
    /// Distance of the body's middle from the camera, in metres.
    pub(crate) distance_m: f64,
}

impl Sight {
    /// Computes how a camera shows a body at a position in metres, in a stance. `None` if part of it is outside the domain of the camera model.
    pub(crate) fn of(
        view: &View,
        shape: &Shape,
        position_m: [f64; 3],
        stance: Stance,
    ) -> Option<Self> {
        let middle = Point3::from(position_m) + Vector3::z() * shape.middle_height_m();
        let middle = view.camera_from_world() * middle;
        let (camera, pose) = (view.camera(), view.camera_from_world());
        let outline = shape.outline_px(camera, pose, position_m, stance, OUTLINE_POINTS);
        let outline: Vec<[f64; 2]> = outline.into_iter().collect::<Option<_>>()?;
        let next = outline.iter().cycle().skip(1);
        let crosses = outline.iter().zip(next);
        let crosses = crosses.map(|([u, v], [x, y])| u * y - x * v);
        let area_px = 0.5 * crosses.sum::<f64>().abs();
        Some(Self {
            pixel: camera.project(middle.into())?,
            radius_px: (area_px / std::f64::consts::PI).sqrt(),
            distance_m: middle.coords.norm(),
        })
    }
}
