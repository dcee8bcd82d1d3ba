//! How a camera shows a body: where in its image, how large, and how far away.

use nalgebra::{Point3, Vector3};
use pardalis::shape::{Shape, Stance};
use pardalis::view::View;
use pardalis_camera::{Camera, Pose};

/// Points of the outline from which its area is computed.
const OUTLINE_POINTS: usize = 128;

/// How a camera shows a body.
pub(crate) struct Sight {
    /// Pixel of the body's middle.
    pub(crate) pixel: [f64; 2],
    /// The middle of the area of the body's image in pixels: towards the border of an image farther out than the pixel of its middle.
    pub(crate) outline_center_px: [f64; 2],
    /// Radius of a circle with the area of the body's image, in pixels.
    pub(crate) radius_px: f64,
    /// Distance of the body's middle from the camera, in metres.
    pub(crate) distance_m: f64,
}

impl Sight {
    /// Computes how the camera of a view shows a body at a position in metres, in a stance. `None` if part of it is outside the domain of the camera model.
    pub(crate) fn of(
        view: &View,
        shape: &Shape,
        position_m: [f64; 3],
        stance: Stance,
    ) -> Option<Self> {
        let camera = (view.camera(), view.camera_from_world());
        Self::by(camera, shape, position_m, stance)
    }

    /// Computes the same for a camera and its pose, `camera_from_world`.
    pub(crate) fn by(
        (camera, camera_from_world): (&Camera, &Pose),
        shape: &Shape,
        position_m: [f64; 3],
        stance: Stance,
    ) -> Option<Self> {
        let middle = Point3::from(position_m) + Vector3::z() * shape.middle_height_m();
        let middle = camera_from_world * middle;
        let outline = shape.outline_px(
            camera,
            camera_from_world,
            position_m,
            stance,
            OUTLINE_POINTS,
        );
        let outline: Vec<[f64; 2]> = outline.into_iter().collect::<Option<_>>()?;
        // Twice the area, and six times its first moments, about the first point.
        let [u0, v0] = *outline.first()?;
        let (mut twice, mut moments) = (0.0, [0.0; 2]);
        for ([u, v], [x, y]) in outline.iter().zip(outline.iter().cycle().skip(1)) {
            let [u, v, x, y] = [u - u0, v - v0, x - u0, y - v0];
            let cross = u * y - x * v;
            twice += cross;
            moments[0] += cross * (u + x);
            moments[1] += cross * (v + y);
        }
        let center = |first: f64, moment: f64| first + moment / (3.0 * twice);
        Some(Self {
            pixel: camera.project(middle.into())?,
            outline_center_px: [center(u0, moments[0]), center(v0, moments[1])],
            radius_px: (0.5 * twice.abs() / std::f64::consts::PI).sqrt(),
            distance_m: middle.coords.norm(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use pardalis::shape::{Sphere, SphereOutline};
    use pardalis_camera::Pinhole;

    /// A sphere of half-angle a at an angle t from the axis is seen as an ellipse with the middle f sin t cos t / D and the semi-axes f sin a cos a / D and f sin a / sqrt(D),
    /// where D = cos² t - sin² a.
    #[test]
    fn the_middle_of_a_balls_outline_lies_farther_out_than_that_of_the_ball() {
        let (angle, half, f_px) = (0.5_f64, 0.1_f64, 800.0);
        let lens = Pinhole::new([f_px; 2], [320.0, 240.0], &[]).unwrap();
        let sphere = Sphere::new(half.sin() / angle.cos(), SphereOutline::Tangent).unwrap();
        let shape = Shape::Sphere(sphere);
        let position_m = [angle.tan(), 0.0, 1.0];
        let camera = (&Camera::from(lens), &Pose::identity());
        let sight = Sight::by(camera, &shape, position_m, Stance::default()).unwrap();
        let [sin_a, cos_a] = [half.sin(), half.cos()];
        let difference = angle.cos().powi(2) - sin_a.powi(2);
        let u_px = 320.0 + f_px * angle.sin() * angle.cos() / difference;
        let radius_px =
            (f_px * sin_a * cos_a / difference * f_px * sin_a / difference.sqrt()).sqrt();
        let close = |a: f64, b: f64, within: f64| assert!((a - b).abs() < within, "{a} {b}");
        close(sight.pixel[0], 320.0 + f_px * angle.tan(), 1e-9);
        close(sight.outline_center_px[0], u_px, 0.01);
        close(sight.outline_center_px[1], 240.0, 1e-9);
        // A polygon of 128 corners has 0.04 % less area.
        close(sight.radius_px / radius_px, 1.0, 0.0003);
    }
}
