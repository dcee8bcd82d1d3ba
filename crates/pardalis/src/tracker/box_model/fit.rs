//! Where a body is, given the boxes around it in one image or several.

use nalgebra::{Matrix3, Point3, Vector3};

use super::body_box::BodyBox;
use super::sight::{Fit, Sight, clipped, ray_through};
use crate::shape::Shape;
use crate::view::View;

/// Steps of the fit. Derivation: each is a Gauss-Newton step, damped where it does not improve; four are usual.
const STEPS: usize = 12;
/// A step below this share of the distance ends the fit, and is that of the numerical derivatives. Derivation: a thousandth of the most precise boxes' error.
const LEAST_STEP: f64 = 1e-5;
/// Bisections of the logarithm of a distance. Derivation: to a thousandth, from a range of ten thousand.
const BISECTIONS: usize = 20;
/// Positions are known by themselves within this many diameters, one standard deviation. Hand-set: keeps covariances finite.
const WIDEST_DIAMETERS: f64 = 30.0;
/// The farthest a body can be, diameters. Hand-set: it then measures less than a tenth of a pixel.
const FARTHEST_DIAMETERS: f64 = 1e4;

/// A body, and where it can be.
#[derive(Debug, Clone)]
pub(in crate::tracker) struct Body {
    pub(in crate::tracker) outline: BodyBox,
    pub(in crate::tracker) diameter_m: f64,
    /// The height of a body that stays on the ground, metres.
    pub(in crate::tracker) ground_z_m: Option<f64>,
}

/// The sum of squares at a position, with its derivatives.
struct Slopes {
    squares: f64,
    /// Half the gradient, downwards.
    down: Vector3<f64>,
    /// Half the curvature.
    information: Matrix3<f64>,
    /// Half the derivative of the gradient by the logarithm of the size.
    by_size: Vector3<f64>,
}

impl Body {
    /// A body of this shape, on the ground at this height (metres) if it stays there.
    pub(in crate::tracker) fn new(shape: &Shape, ground_z_m: Option<f64>) -> Self {
        Self {
            outline: BodyBox::new(shape),
            diameter_m: shape.diameter_m(),
            ground_z_m,
        }
    }

    /// Fits the position to boxes of one body, each in its camera's image. `None` if it would be out of the images, or there is no such position.
    pub(in crate::tracker) fn fit<'s>(
        &self,
        views: &[View],
        sights: impl Iterator<Item = &'s Sight> + Clone,
        start_m: Vector3<f64>,
    ) -> Option<Fit> {
        let mut position_m = start_m;
        if let Some(z) = self.ground_z_m {
            position_m.z = z;
        }
        let mut here = self.slopes(views, sights.clone(), position_m)?;
        let mut damping = 1e-3;
        for _ in 0..STEPS {
            let mut damped = here.information;
            for axis in 0..3 {
                damped[(axis, axis)] *= 1.0 + damping;
            }
            let step_m = damped.cholesky()?.solve(&here.down);
            let there_m = position_m + step_m;
            match self.slopes(views, sights.clone(), there_m) {
                Some(there) if there.squares <= here.squares => {
                    (position_m, here) = (there_m, there);
                    damping *= 0.1;
                    let distance_m = nearest_m(views, sights.clone(), position_m);
                    if step_m.norm() < LEAST_STEP * distance_m {
                        break;
                    }
                }
                _ => damping *= 10.0,
            }
        }
        let inverse = here.information.cholesky()?.inverse();
        let mut covariance_m2 = inverse;
        let mut drift_m = -inverse * here.by_size;
        if self.ground_z_m.is_some() {
            covariance_m2[(2, 2)] = 0.0;
            drift_m.z = 0.0;
        }
        Some(Fit {
            position_m,
            covariance_m2,
            drift_m,
            squares: here.squares,
        })
    }

    fn slopes<'s>(
        &self,
        views: &[View],
        sights: impl Iterator<Item = &'s Sight> + Clone,
        position_m: Vector3<f64>,
    ) -> Option<Slopes> {
        let least = (WIDEST_DIAMETERS * self.diameter_m).powi(-2);
        let mut slopes = Slopes {
            squares: 0.0,
            down: Vector3::zeros(),
            information: Matrix3::from_diagonal_element(least),
            by_size: Vector3::zeros(),
        };
        let free_axes = if self.ground_z_m.is_some() { 2 } else { 3 };
        let step_m = LEAST_STEP * nearest_m(views, sights.clone(), position_m);
        for sight in sights {
            let view = &views[sight.camera];
            let sides = |position_m: Vector3<f64>, scale: f64| {
                let sides = self.outline.sides_px(view, position_m.into(), scale)?;
                Some(clipped(sides, view.size()))
            };
            let here = sides(position_m, 1.0)?;
            let mut by_axis = [[0.0; 4]; 3];
            for (axis, by_axis) in by_axis.iter_mut().enumerate().take(free_axes) {
                let mut off = Vector3::zeros();
                off[axis] = step_m;
                let (after, before) =
                    (sides(position_m + off, 1.0)?, sides(position_m - off, 1.0)?);
                *by_axis =
                    std::array::from_fn(|side| (after[side] - before[side]) / (2.0 * step_m));
            }
            let larger = sides(position_m, 1.0 + LEAST_STEP)?;
            for side in 0..4 {
                let weight = sight.sigma_px.powi(-2);
                let residual = sight.sides_px[side] - here[side];
                let slope = Vector3::from_fn(|axis, _| by_axis[axis][side]);
                let by_size = (larger[side] - here[side]) / LEAST_STEP;
                slopes.squares += weight * residual * residual;
                slopes.down += weight * residual * slope;
                slopes.information += weight * slope * slope.transpose();
                slopes.by_size += weight * by_size * slope;
            }
        }
        Some(slopes)
    }

    /// The position that one box measures.
    pub(in crate::tracker) fn fit_one(&self, views: &[View], sight: &Sight) -> Option<Fit> {
        let view = &views[sight.camera];
        let (origin, direction) = sight.ray(view)?;
        let by_size = self.start_by_size(view, sight, (origin, direction));
        let sight = std::iter::once(sight);
        let on_ground = self.ground_z_m.and_then(|z| {
            let along_m = (z + self.outline.middle_m() - origin.z) / direction.z;
            (along_m > 0.0)
                .then(|| self.fit(views, sight.clone(), (origin + along_m * direction).coords))
        });
        let by_size = by_size.and_then(|start_m| self.fit(views, sight, start_m));
        let fits = [on_ground.flatten(), by_size].into_iter().flatten();
        fits.reduce(|best, next| {
            if next.squares < best.squares {
                next
            } else {
                best
            }
        })
    }

    /// The place along the ray through the middle of a box where the body is as large as the box, metres.
    fn start_by_size(
        &self,
        view: &View,
        sight: &Sight,
        ray: (Point3<f64>, Vector3<f64>),
    ) -> Option<Vector3<f64>> {
        let is_larger = |sides| sight.size_px(sides) > sight.size_px(sight.sides_px);
        let distance_m = self.distance_m(view, ray, is_larger)?;
        Some(self.along(ray, distance_m))
    }

    /// How far away, metres, the body's box in the middle of a camera's image has this size, in pixels; `None` if the image shows nothing there.
    pub(in crate::tracker) fn reach_m(&self, view: &View, size_px: f64) -> Option<f64> {
        let (width, height) = view.size();
        let middle = [width, height].map(|side| 0.5 * (side as f64 - 1.0));
        let is_larger = |[u0, v0, u1, v1]: [f64; 4]| (u1 - u0) * (v1 - v0) > size_px * size_px;
        self.distance_m(view, ray_through(view, middle)?, is_larger)
    }

    /// The position of the body with its middle on a ray, at a distance in metres.
    fn along(
        &self,
        (origin, direction): (Point3<f64>, Vector3<f64>),
        distance_m: f64,
    ) -> Vector3<f64> {
        let middle_m = (origin + distance_m * direction).coords;
        middle_m - Vector3::new(0.0, 0.0, self.outline.middle_m())
    }

    /// The least distance on a ray, metres, from which on the sides of the body's box are no larger than something. `None` if they always are.
    fn distance_m(
        &self,
        view: &View,
        ray: (Point3<f64>, Vector3<f64>),
        is_larger: impl Fn([f64; 4]) -> bool,
    ) -> Option<f64> {
        let is_larger = |log_m: f64| {
            let position_m = self.along(ray, libm::exp(log_m));
            let sides = self.outline.sides_px(view, position_m.into(), 1.0);
            // What is too near to be seen as a whole is too large.
            sides.is_none_or(&is_larger)
        };
        let [mut near, mut far] =
            [0.5, FARTHEST_DIAMETERS].map(|diameters| libm::log(diameters * self.diameter_m));
        if is_larger(far) {
            return None;
        }
        for _ in 0..BISECTIONS {
            let middle = 0.5 * (near + far);
            if is_larger(middle) {
                near = middle;
            } else {
                far = middle;
            }
        }
        Some(libm::exp(far))
    }

    /// Returns ln √|2πΣ| of a covariance Σ, in m³, or in m² on the ground.
    pub(in crate::tracker) fn log_volume(&self, covariance_m2: &Matrix3<f64>) -> f64 {
        let (axes, determinant) = if self.ground_z_m.is_some() {
            (2.0, covariance_m2.fixed_view::<2, 2>(0, 0).determinant())
        } else {
            (3.0, covariance_m2.determinant())
        };
        0.5 * (axes * libm::log(std::f64::consts::TAU) + libm::log(determinant))
    }
}

/// The distance of a position from the nearest camera that has a box, metres.
fn nearest_m<'s>(
    views: &[View],
    sights: impl Iterator<Item = &'s Sight>,
    position_m: Vector3<f64>,
) -> f64 {
    let distance_m = |sight: &Sight| {
        let from_m = views[sight.camera].world_from_camera().translation.vector;
        (position_m - from_m).norm()
    };
    sights.map(distance_m).fold(f64::INFINITY, f64::min)
}
