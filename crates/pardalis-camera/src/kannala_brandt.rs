//! Kannala-Brandt fisheye: an odd polynomial in the angle from the optical axis, as in OpenCV's
//! `fisheye` module.

use super::{
    Projection, Ray, axis_angle, check_angle, check_coefficients, check_focals,
    check_principal_point,
};
use pardalis_core::Error;
use pardalis_core::real::Real;

/// Kannala-Brandt fisheye.
///
/// ρ = θ·(1 + k1·θ² + k2·θ⁴ + k3·θ⁶ + k4·θ⁸), u = cx + fx·ρ·x/r, v = cy + fy·ρ·y/r, with r = √(x² +
/// y²) and θ = atan2(r, z) (Kannala and Brandt 2006, eq. 6, with OpenCV's scaling).
///
/// Domain: θ ≤ `max_angle_rad`, but only as far as ρ increases with θ. The point straight behind
/// the camera is never valid.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct KannalaBrandt<R> {
    fx_px: R,
    fy_px: R,
    cx_px: R,
    cy_px: R,
    k: [R; 4],
    /// The requested largest angle.
    max_angle_rad: R,
    /// The angle up to which ρ increases, at most `max_angle_rad`.
    last_angle_rad: R,
}

impl KannalaBrandt<f64> {
    /// Creates a camera from focal lengths and principal point in pixels, OpenCV's four
    /// coefficients and the largest angle from the axis in radians (at most π).
    pub fn new(
        f_px @ [fx_px, fy_px]: [f64; 2],
        [cx_px, cy_px]: [f64; 2],
        k: [f64; 4],
        max_angle_rad: f64,
    ) -> Result<Self, Error> {
        check_focals(f_px)?;
        check_principal_point([cx_px, cy_px])?;
        check_coefficients("k", &k)?;
        check_angle("max_angle_rad", max_angle_rad)?;
        Ok(Self {
            fx_px,
            fy_px,
            cx_px,
            cy_px,
            k,
            max_angle_rad,
            last_angle_rad: largest_increasing_angle(k, max_angle_rad),
        })
    }

    /// Returns the requested largest angle from the axis, in radians.
    pub fn max_angle_rad(&self) -> f64 {
        self.max_angle_rad
    }

    /// Returns the camera with other parameters, in the order of [`Self::NAMES`].
    pub(super) fn with_parameters(&self, p: [f64; 8]) -> Result<Self, Error> {
        Self::new(
            [p[0], p[1]],
            [p[2], p[3]],
            [p[4], p[5], p[6], p[7]],
            self.max_angle_rad,
        )
    }

    /// Returns the camera in single precision, for vectorised kernels.
    pub fn to_f32(&self) -> KannalaBrandt<f32> {
        self.vary(self.parameters().map(|p| p as f32))
    }
}

/// Returns the first zero of dρ/dθ, or `max_angle_rad` if that is smaller.
fn largest_increasing_angle([k1, k2, k3, k4]: [f64; 4], max_angle_rad: f64) -> f64 {
    let slope = |angle: f64| {
        let s = angle * angle;
        1.0 + s * (3.0 * k1 + s * (5.0 * k2 + s * (7.0 * k3 + s * 9.0 * k4)))
    };
    let steps = 4000;
    let step = max_angle_rad / f64::from(steps);
    let Some(first) = (1..=steps).find(|&i| !(slope(f64::from(i) * step) > 0.0)) else {
        return max_angle_rad;
    };
    let (mut low, mut high) = (f64::from(first - 1) * step, f64::from(first) * step);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if slope(middle) > 0.0 {
            low = middle;
        } else {
            high = middle;
        }
    }
    low
}

impl<R: Real> KannalaBrandt<R> {
    /// Names of the parameters, in order.
    pub(super) const NAMES: [&'static str; 8] =
        ["fx_px", "fy_px", "cx_px", "cy_px", "k1", "k2", "k3", "k4"];

    pub(super) fn parameters(&self) -> [R; 8] {
        let [k1, k2, k3, k4] = self.k;
        [
            self.fx_px, self.fy_px, self.cx_px, self.cy_px, k1, k2, k3, k4,
        ]
    }

    /// Returns the model with other parameters, unchecked and of any number type, and the same domain.
    pub(super) fn vary<S: Real>(&self, p: [S; 8]) -> KannalaBrandt<S> {
        KannalaBrandt {
            fx_px: p[0],
            fy_px: p[1],
            cx_px: p[2],
            cy_px: p[3],
            k: [p[4], p[5], p[6], p[7]],
            max_angle_rad: S::of(self.max_angle_rad.to_f64()),
            last_angle_rad: S::of(self.last_angle_rad.to_f64()),
        }
    }

    /// Returns ρ/θ.
    #[inline(always)]
    fn stretch(&self, angle: R) -> R {
        let [k1, k2, k3, k4] = self.k;
        let s = angle * angle;
        R::of(1.0) + s * (k1 + s * (k2 + s * (k3 + s * k4)))
    }
}

impl<R: Real> Projection<R> for KannalaBrandt<R> {
    #[inline(always)]
    fn project(&self, [x, y, z]: [R; 3]) -> ([R; 2], bool) {
        let (angle, angle_over_r, defined) = axis_angle([x, y, z]);
        let scale = self.stretch(angle) * angle_over_r;
        let valid = angle <= self.last_angle_rad && defined;
        (
            [
                self.cx_px + self.fx_px * scale * x,
                self.cy_px + self.fy_px * scale * y,
            ],
            valid,
        )
    }

    /// Inverts the polynomial by Newton's method, bracketed to the domain, in which it increases.
    fn unproject(&self, [u, v]: [R; 2]) -> Option<Ray<R>> {
        let (x, y) = ((u - self.cx_px) / self.fx_px, (v - self.cy_px) / self.fy_px);
        let rho = (x * x + y * y).sqrt();
        let last = self.last_angle_rad;
        // The tolerance absorbs rounding for pixels of points on the border.
        if !(rho <= last * self.stretch(last) * R::of(1.0 + 1e-12)) {
            return None;
        }
        let [k1, k2, k3, k4] = self.k;
        let (mut low, mut high) = (R::of(0.0), last);
        let mut angle = if rho < last { rho } else { last };
        for _ in 0..60 {
            let error = angle * self.stretch(angle) - rho;
            if error > R::of(0.0) {
                high = angle;
            } else {
                low = angle;
            }
            let s = angle * angle;
            let slope = R::of(1.0)
                + s * (R::of(3.0) * k1
                    + s * (R::of(5.0) * k2 + s * (R::of(7.0) * k3 + s * R::of(9.0) * k4)));
            let newton = angle - error / slope;
            angle = if newton >= low && newton <= high {
                newton
            } else {
                R::of(0.5) * (low + high)
            };
        }
        Some(Ray::at_angle(angle, [x, y], rho))
    }
}
