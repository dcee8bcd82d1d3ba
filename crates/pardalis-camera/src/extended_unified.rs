//! Extended unified model of wide-angle lenses.

use super::{Projection, Ray, check_focals, check_principal_point, domain_of_alpha};
use pardalis_core::Error;
use pardalis_core::real::Real;

/// Extended unified model of wide-angle lenses.
///
/// u = cx + fx·x/n, v = cy + fy·y/n with n = α·d + (1 − α)·z and d = √(β·(x² + y²) + z²)
/// (Khomutenko, Garcia and Martinet 2016). With β = 1 it is the unified model with ξ = α/(1 − α).
///
/// Domain: z > −w·d with w = α/(1 − α) for α ≤ 0.5 and (1 − α)/α for α > 0.5.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ExtendedUnified<R> {
    fx_px: R,
    fy_px: R,
    cx_px: R,
    cy_px: R,
    alpha: R,
    beta: R,
    /// Lower bound of z/d.
    min_cosine: R,
}

impl ExtendedUnified<f64> {
    /// Creates a camera from focal lengths and principal point in pixels, 0 ≤ α ≤ 1 and β > 0.
    pub fn new(
        f_px @ [fx_px, fy_px]: [f64; 2],
        [cx_px, cy_px]: [f64; 2],
        alpha: f64,
        beta: f64,
    ) -> Result<Self, Error> {
        check_focals(f_px)?;
        check_principal_point([cx_px, cy_px])?;
        let w = domain_of_alpha(alpha)?;
        if !(beta > 0.0 && beta <= 1e6) {
            return Err(Error::out_of_range("beta", beta, "above 0 and at most 1e6"));
        }
        Ok(Self {
            fx_px,
            fy_px,
            cx_px,
            cy_px,
            alpha,
            beta,
            min_cosine: -w,
        })
    }

    /// Returns the camera with other parameters, in the order of [`Self::NAMES`].
    #[allow(clippy::unused_self)] // uniform signature for all models
    pub(super) fn with_parameters(&self, p: [f64; 6]) -> Result<Self, Error> {
        Self::new([p[0], p[1]], [p[2], p[3]], p[4], p[5])
    }

    /// Returns the camera in single precision, for vectorised kernels.
    pub fn to_f32(&self) -> ExtendedUnified<f32> {
        self.vary(self.parameters().map(|p| p as f32))
    }
}

impl<R: Real> ExtendedUnified<R> {
    /// Names of the parameters, in order.
    pub(super) const NAMES: [&'static str; 6] =
        ["fx_px", "fy_px", "cx_px", "cy_px", "alpha", "beta"];

    pub(super) fn parameters(&self) -> [R; 6] {
        [
            self.fx_px, self.fy_px, self.cx_px, self.cy_px, self.alpha, self.beta,
        ]
    }

    /// Returns the model with other parameters, unchecked and of any number type, and the same domain.
    pub(super) fn vary<S: Real>(
        &self,
        [fx_px, fy_px, cx_px, cy_px, alpha, beta]: [S; 6],
    ) -> ExtendedUnified<S> {
        ExtendedUnified {
            fx_px,
            fy_px,
            cx_px,
            cy_px,
            alpha,
            beta,
            min_cosine: S::of(self.min_cosine.to_f64()),
        }
    }
}

impl<R: Real> Projection<R> for ExtendedUnified<R> {
    #[inline(always)]
    fn project(&self, [x, y, z]: [R; 3]) -> ([R; 2], bool) {
        let one = R::of(1.0);
        let d = (self.beta * (x * x + y * y) + z * z).sqrt();
        let valid = z > self.min_cosine * d;
        let n = self.alpha * d + (one - self.alpha) * z;
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
        let s = self.beta * (a * a + b * b);
        let inner = one - (two * self.alpha - one) * s;
        if !(inner >= R::of(0.0)) {
            return None;
        }
        let z =
            (one - self.alpha * self.alpha * s) / (self.alpha * inner.sqrt() + one - self.alpha);
        (z > self.min_cosine * (s + z * z).sqrt()).then(|| Ray::towards([a, b, z]))
    }
}
