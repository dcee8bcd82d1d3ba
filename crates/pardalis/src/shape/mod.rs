//! Shapes of targets, and their outlines as seen by a camera.

mod sphere;

pub use sphere::{OutlineCircle, Sphere, SphereOutline};

use crate::camera::Camera;
use crate::rig::Pose;

/// Any shape.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Shape {
    /// A ball.
    Sphere(Sphere),
}

impl Shape {
    /// Its largest width in metres.
    pub fn diameter_m(&self) -> f64 {
        match self {
            Self::Sphere(sphere) => 2.0 * sphere.radius_m,
        }
    }

    /// The outline of the shape, scaled by `scale`, as `count` pixels all around; `None` where a point has no pixel. For people to
    /// look at; the cues have kernels of their own.
    pub fn outline_px(
        &self,
        camera: &Camera,
        camera_from_world: &Pose,
        position_in_world_m: [f64; 3],
        scale: f64,
        count: usize,
    ) -> Vec<Option<[f64; 2]>> {
        match self {
            Self::Sphere(sphere) => {
                let center = camera_from_world * nalgebra::Point3::from(position_in_world_m);
                let (circle, outside) = OutlineCircle::of_sphere(
                    center.into(),
                    scale * sphere.radius_m,
                    sphere.outline,
                );
                (0..count)
                    .map(|i| {
                        let angle = i as f64 / count as f64 * std::f64::consts::TAU;
                        let (sin, cos) = libm::sincos(angle);
                        outside
                            .then(|| camera.project(circle.point(cos, sin)))
                            .flatten()
                    })
                    .collect()
            }
        }
    }
}
