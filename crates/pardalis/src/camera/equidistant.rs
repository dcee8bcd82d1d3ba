//! Equidistant fisheye: the radius in the image grows with the angle from the optical axis.

use crate::Error;
use crate::camera::{Projection, check_angle, check_focal, check_principal_point};
use crate::real::Real;

/// ρ = f·θ, u = cx + ρ·x/r, v = cy + ρ·y/r, with r = √(x² + y²) and θ = atan2(r, z) (Taiana 2007, eq. 3.5).
///
/// Domain: θ up to `max_angle_rad`, which may lie beyond 90 degrees; never the point straight behind the camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Equidistant<R> {
    f_px_per_rad: R,
    cx_px: R,
    cy_px: R,
    max_angle_rad: R,
}

impl Equidistant<f64> {
    /// `f_px_per_rad` in pixels per radian, the principal point in pixels, the largest angle from the axis in radians (at most pi).
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

    /// The same camera in single precision, for kernels.
    pub fn to_f32(self) -> Equidistant<f32> {
        Equidistant {
            f_px_per_rad: self.f_px_per_rad as f32,
            cx_px: self.cx_px as f32,
            cy_px: self.cy_px as f32,
            max_angle_rad: self.max_angle_rad as f32,
        }
    }
}

impl<R: Real> Projection<R> for Equidistant<R> {
    #[inline(always)]
    fn project(&self, [x, y, z]: [R; 3]) -> ([R; 2], bool) {
        let r = (x * x + y * y).sqrt();
        let angle = r.atan2(z);
        let on_axis = !(r > R::of(1e-30));
        // On the axis x/r has no value; the pixel is the principal point.
        let scale = self.f_px_per_rad * angle / if on_axis { R::of(1.0) } else { r };
        let valid = angle <= self.max_angle_rad && !(on_axis && z <= R::of(0.0));
        ([self.cx_px + scale * x, self.cy_px + scale * y], valid)
    }

    fn unproject(&self, [u, v]: [R; 2]) -> Option<[R; 3]> {
        let (x, y) = (u - self.cx_px, v - self.cy_px);
        let rho = (x * x + y * y).sqrt();
        let angle = rho / self.f_px_per_rad;
        // A hair beyond, so that the pixel of a point on the border has its ray despite rounding.
        if !(angle <= self.max_angle_rad * R::of(1.0 + 1e-12)) {
            return None;
        }
        let (sin, cos) = angle.sin_cos();
        let scale = if rho > R::of(0.0) {
            sin / rho
        } else {
            R::of(0.0)
        };
        Some([x * scale, y * scale, cos])
    }
}
