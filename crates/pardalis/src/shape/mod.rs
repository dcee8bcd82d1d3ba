//! Shapes of targets, and their outlines as seen by a camera.

mod flat;
mod sphere;
mod stance;
mod upright;

pub use flat::{Flat, FlatForm};
pub use sphere::{OutlineCircle, Sphere, SphereOutline};
pub use stance::Stance;
pub(crate) use upright::{OutlinePoint, Sides, SidesKind, VisibleBody};
pub use upright::{Section, Upright, UprightOutline};

use nalgebra::{Point3, Vector3};

use pardalis_camera::Camera;
use pardalis_camera::Pose;

/// The shape of a target.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Shape {
    /// A ball.
    Sphere(Sphere),
    /// A vertical cylinder, prism or box: a robot, a post, a car.
    Upright(Upright),
    /// A level disc or rectangle: a landmark on a robot, a car seen from above.
    Flat(Flat),
}

impl Shape {
    /// Returns the largest width in metres; for an upright body, its width across the axis.
    pub fn diameter_m(&self) -> f64 {
        match self {
            Self::Sphere(sphere) => 2.0 * sphere.radius_m,
            Self::Upright(upright) => upright.width_m(),
            Self::Flat(flat) => flat.size_m().into_iter().fold(0.0, f64::max),
        }
    }

    /// Returns the height of the centre above the position, in metres. The position of an upright body is the
    /// centre of its base, that of a flat shape the point of the ground below it.
    pub fn middle_height_m(&self) -> f64 {
        match self {
            Self::Sphere(_) => 0.0,
            Self::Upright(upright) => 0.5 * upright.height_m,
            Self::Flat(flat) => flat.height_m,
        }
    }

    /// Returns the least angle, in radians, after which the shape looks the same again when it turns about the vertical; `None` for a shape
    /// that always looks the same.
    pub fn turn_period_rad(&self) -> Option<f64> {
        match self {
            Self::Sphere(_) => None,
            Self::Upright(upright) => upright.turn_period_rad(),
            Self::Flat(flat) => flat.turn_period_rad(),
        }
    }

    /// Returns `count` pixels along the outline of the shape in a stance; `None` for a point that has
    /// no pixel. For display; the cues have their own kernels.
    pub fn outline_px(
        &self,
        camera: &Camera,
        camera_from_world: &Pose,
        position_in_world_m: [f64; 3],
        stance: Stance,
        count: usize,
    ) -> Vec<Option<[f64; 2]>> {
        let viewpoint = Point3::from(camera.viewpoint_m());
        match self {
            Self::Sphere(sphere) => {
                let center = camera_from_world * Point3::from(position_in_world_m);
                let (circle, outside) = OutlineCircle::of_sphere(
                    (center - viewpoint).into(),
                    stance.scale * sphere.radius_m,
                    sphere.outline,
                );
                (0..count)
                    .map(|i| {
                        let angle = i as f64 / count as f64 * std::f64::consts::TAU;
                        let (sin, cos) = libm::sincos(angle);
                        let point = Point3::from(circle.point(cos, sin)) + viewpoint.coords;
                        outside.then(|| camera.project(point.into())).flatten()
                    })
                    .collect()
            }
            Self::Upright(upright) => {
                let viewpoint = camera_from_world.inverse() * viewpoint;
                let sides = upright.sides(stance);
                let (seen, outside) = sides.seen_from(position_in_world_m, viewpoint.into());
                upright
                    .outline_points(count)
                    .iter()
                    .map(|outline_point| {
                        let point =
                            camera_from_world * Point3::from(sides.point(&seen, outline_point));
                        outside.then(|| camera.project(point.into())).flatten()
                    })
                    .collect()
            }
            Self::Flat(flat) => {
                let center = Point3::from(position_in_world_m);
                let [cos, sin] = stance.scaled_direction();
                flat.outline_points_m(count)
                    .into_iter()
                    .map(|[x, y]| {
                        let offset =
                            Vector3::new(cos * x - sin * y, sin * x + cos * y, flat.height_m);
                        camera.project((camera_from_world * (center + offset)).into())
                    })
                    .collect()
            }
        }
    }
}
