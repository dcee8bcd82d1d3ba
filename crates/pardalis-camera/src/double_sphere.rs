//! Double sphere model of wide-angle lenses.

use super::{Projection, Ray, check_focals, check_principal_point, domain_of_alpha};
use pardalis_core::Error;
use pardalis_core::real::Real;

/// Double sphere model of wide-angle lenses.
///
/// u = cx + fx·x/n, v = cy + fy·y/n with n = α·d2 + (1 − α)·(ξ·d1 + z), d1 = √(x² + y² + z²), d2 =
/// √(x² + y² + (ξ·d1 + z)²) (Usenko, Demmel and Cremers 2018, eqs. 40 to 45).
///
/// Domain: z > −w2·d1, with w2 = (w1 + ξ)/√(2·w1·ξ + ξ² + 1), w1 = α/(1 − α) for α ≤ 0.5 and (1 −
/// α)/α for α > 0.5.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DoubleSphere<R> {
    fx_px: R,
    fy_px: R,
    cx_px: R,
    cy_px: R,
    xi: R,
    alpha: R,
    /// Lower bound of z/d1.
    min_cosine: R,
}

impl DoubleSphere<f64> {
    /// Creates a camera from focal lengths and principal point in pixels, −1 < ξ ≤ 1 and 0 ≤ α ≤ 1.
    pub fn new(
        f_px @ [fx_px, fy_px]: [f64; 2],
        [cx_px, cy_px]: [f64; 2],
        xi: f64,
        alpha: f64,
    ) -> Result<Self, Error> {
        check_focals(f_px)?;
        check_principal_point([cx_px, cy_px])?;
        if !(xi > -1.0 && xi <= 1.0) {
            return Err(Error::out_of_range("xi", xi, "above -1 and at most 1"));
        }
        let w1 = domain_of_alpha(alpha)?;
        Ok(Self {
            fx_px,
            fy_px,
            cx_px,
            cy_px,
            xi,
            alpha,
            min_cosine: -(w1 + xi) / (2.0 * w1 * xi + xi * xi + 1.0).sqrt(),
        })
    }

    /// Returns the camera with other parameters, in the order of [`Self::NAMES`].
    #[allow(clippy::unused_self)] // uniform signature for all models
    pub(super) fn with_parameters(&self, p: [f64; 6]) -> Result<Self, Error> {
        Self::new([p[0], p[1]], [p[2], p[3]], p[4], p[5])
    }

    /// Returns the camera in single precision, for vectorised kernels.
    pub fn to_f32(&self) -> DoubleSphere<f32> {
        self.vary(self.parameters().map(|p| p as f32))
    }
}

impl<R: Real> DoubleSphere<R> {
    /// Names of the parameters, in order.
    pub(super) const NAMES: [&'static str; 6] = ["fx_px", "fy_px", "cx_px", "cy_px", "xi", "alpha"];

    pub(super) fn parameters(&self) -> [R; 6] {
        [
            self.fx_px, self.fy_px, self.cx_px, self.cy_px, self.xi, self.alpha,
        ]
    }

    /// Returns the model with other parameters, unchecked and of any number type, and the same domain.
    pub(super) fn vary<S: Real>(
        &self,
        [fx_px, fy_px, cx_px, cy_px, xi, alpha]: [S; 6],
    ) -> DoubleSphere<S> {
        DoubleSphere {
            fx_px,
            fy_px,
            cx_px,
            cy_px,
            xi,
            alpha,
            min_cosine: S::of(self.min_cosine.to_f64()),
        }
    }
}

impl<R: Real> Projection<R> for DoubleSphere<R> {
    #[inline(always)]
    fn project(&self, [x, y, z]: [R; 3]) -> ([R; 2], bool) {
        let one = R::of(1.0);
        let s = x * x + y * y;
        let d1 = (s + z * z).sqrt();
        let valid = z > self.min_cosine * d1;
        let z1 = self.xi * d1 + z;
        let d2 = (s + z1 * z1).sqrt();
        let n = self.alpha * d2 + (one - self.alpha) * z1;
        let inverse = one / if valid { n } else { one };
        (
            [
                self.fx_px * x * inverse + self.cx_px,
                self.fy_px * y * inverse + self.cy_px,
            ],
            valid,
        )
    }

    fn unproject(&self, [u, v]: [R; 2]) -> Option<Ray<R>> {
        let (one, two) = (R::of(1.0), R::of(2.0));
        let (a, b) = ((u - self.cx_px) / self.fx_px, (v - self.cy_px) / self.fy_px);
        let (s, alpha, xi) = (a * a + b * b, self.alpha, self.xi);
        let inner = one - (two * alpha - one) * s;
        if !(inner >= R::of(0.0)) {
            return None;
        }
        let z1 = (one - alpha * alpha * s) / (alpha * inner.sqrt() + one - alpha);
        let outer = z1 * z1 + (one - xi * xi) * s;
        if !(outer >= R::of(0.0)) {
            return None;
        }
        let factor = (z1 * xi + outer.sqrt()) / (z1 * z1 + s);
        let z = factor * z1 - xi;
        (z > self.min_cosine).then(|| Ray::from_camera([factor * a, factor * b, z]))
    }
}
