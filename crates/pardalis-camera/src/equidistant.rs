//! Equidistant fisheye: the radius in the image is proportional to the angle from the optical axis.

use super::{Projection, Ray, axis_angle, check_angle, check_focal, check_principal_point};
use pardalis_core::Error;
use pardalis_core::real::Real;

/// Equidistant fisheye.
///
/// ρ = f·θ, u = cx + ρ·x/r, v = cy + ρ·y/r, with r = √(x² + y²) and θ = atan2(r, z) (Taiana 2007,
/// eq. 3.5).
///
/// Domain: θ ≤ `max_angle_rad`, which may exceed 90 degrees. The point straight behind the camera
/// is never valid.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Equidistant<R> {
    f_px_per_rad: R,
    cx_px: R,
    cy_px: R,
    max_angle_rad: R,
}

impl Equidistant<f64> {
    /// Creates a camera from the focal length in pixels per radian, the principal point in pixels
    /// and the largest angle from the axis in radians (at most π).
    pub fn new(
        f_px_per_rad: f64,
        [cx_px, cy_px]: [f64; 2],
        max_angle_rad: f64,
    ) -> Result<Self, Error> {
        check_focal("f_px_per_rad", f_px_per_rad)?;
        check_principal_point([cx_px, cy_px])?;
        check_angle("max_angle_rad", max_angle_rad)?;
        Ok(Self {
            f_px_per_rad,
            cx_px,
            cy_px,
            max_angle_rad,
        })
    }

    /// Returns the largest angle from the axis, in radians.
    pub fn max_angle_rad(&self) -> f64 {
        self.max_angle_rad
    }

    /// Returns the camera with other parameters, in the order of [`Self::NAMES`].
    pub(super) fn with_parameters(&self, [f, cx, cy]: [f64; 3]) -> Result<Self, Error> {
        Self::new(f, [cx, cy], self.max_angle_rad)
    }

    /// Returns the camera in single precision, for vectorised kernels.
    pub fn to_f32(&self) -> Equidistant<f32> {
        self.vary(self.parameters().map(|p| p as f32))
    }
}

impl<R: Real> Equidistant<R> {
    /// Names of the parameters, in order.
    pub(super) const NAMES: [&'static str; 3] = ["f_px_per_rad", "cx_px", "cy_px"];

    pub(super) fn parameters(&self) -> [R; 3] {
        [self.f_px_per_rad, self.cx_px, self.cy_px]
    }

    /// Returns the model with other parameters, unchecked and of any number type, and the same domain.
    pub(super) fn vary<S: Real>(&self, [f_px_per_rad, cx_px, cy_px]: [S; 3]) -> Equidistant<S> {
        Equidistant {
            f_px_per_rad,
            cx_px,
            cy_px,
            max_angle_rad: S::of(self.max_angle_rad.to_f64()),
        }
    }
}

impl<R: Real> Projection<R> for Equidistant<R> {
    #[inline(always)]
    fn project(&self, [x, y, z]: [R; 3]) -> ([R; 2], bool) {
        let (angle, angle_over_r, defined) = axis_angle([x, y, z]);
        let scale = self.f_px_per_rad * angle_over_r;
        let valid = angle <= self.max_angle_rad && defined;
        ([self.cx_px + scale * x, self.cy_px + scale * y], valid)
    }

    fn unproject(&self, [u, v]: [R; 2]) -> Option<Ray<R>> {
        let (x, y) = (u - self.cx_px, v - self.cy_px);
        let rho = (x * x + y * y).sqrt();
        let angle = rho / self.f_px_per_rad;
        // The tolerance absorbs rounding for pixels of points on the border.
        if !(angle <= self.max_angle_rad * R::of(1.0 + 1e-12)) {
            return None;
        }
        Some(Ray::at_angle(angle, [x, y], rho))
    }
}
