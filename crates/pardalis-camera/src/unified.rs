//! Unified projection model of mirror cameras with a single viewpoint.

use super::{Projection, Ray, check_focal, check_principal_point};
use pardalis_core::Error;
use pardalis_core::real::Real;

/// Unified model of mirror cameras with a single viewpoint.
///
/// ρ = f·(l + m)·r / (l·d − z), with r = √(x² + y²) and d = √(r² + z²); u = cx + ρ·x/r, v = cy +
/// ρ·y/r (Geyer and Daniilidis 2000; Taiana 2007, section 3.1.1, eq. 3.3). The camera looks along +z into the
/// mirror, so that most of the scene has z < 0.
///
/// Domain: z < l·d for l ≤ 1 and z < d/l for l > 1, beyond which ρ folds back.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Unified<R> {
    l: R,
    m: R,
    f_px: R,
    cx_px: R,
    cy_px: R,
    /// Upper bound of z/d.
    max_cosine: R,
}

impl Unified<f64> {
    /// Creates a camera from `l` and `m` as in the paper, the focal scale `f_px` in pixels (1 if
    /// `m` is already in pixels) and the principal point in pixels.
    pub fn new(l: f64, m: f64, f_px: f64, [cx_px, cy_px]: [f64; 2]) -> Result<Self, Error> {
        if !(0.0..=1e6).contains(&l) {
            return Err(Error::out_of_range("l", l, "0 to 1e6"));
        }
        if !(m <= 1e6 && l + m > 0.0) {
            return Err(Error::out_of_range(
                "m",
                m,
                "a number up to 1e6 with l + m > 0",
            ));
        }
        check_focal("f_px", f_px)?;
        check_principal_point([cx_px, cy_px])?;
        Ok(Self {
            l,
            m,
            f_px,
            cx_px,
            cy_px,
            max_cosine: if l <= 1.0 { l } else { 1.0 / l },
        })
    }

    /// Returns the camera with other parameters, in the order of [`Self::NAMES`].
    #[allow(clippy::unused_self)] // uniform signature for all models
    pub(super) fn with_parameters(&self, [l, m, f, cx, cy]: [f64; 5]) -> Result<Self, Error> {
        Self::new(l, m, f, [cx, cy])
    }

    /// Returns the camera in single precision, for vectorised kernels.
    pub fn to_f32(&self) -> Unified<f32> {
        self.vary(self.parameters().map(|p| p as f32))
    }
}

impl<R: Real> Unified<R> {
    /// Names of the parameters, in order.
    pub(super) const NAMES: [&'static str; 5] = ["l", "m", "f_px", "cx_px", "cy_px"];

    pub(super) fn parameters(&self) -> [R; 5] {
        [self.l, self.m, self.f_px, self.cx_px, self.cy_px]
    }

    /// Returns the model with other parameters, unchecked and of any number type, and the same domain.
    pub(super) fn vary<S: Real>(&self, [l, m, f_px, cx_px, cy_px]: [S; 5]) -> Unified<S> {
        Unified {
            l,
            m,
            f_px,
            cx_px,
            cy_px,
            max_cosine: S::of(self.max_cosine.to_f64()),
        }
    }
}

impl<R: Real> Projection<R> for Unified<R> {
    #[inline(always)]
    fn project(&self, [x, y, z]: [R; 3]) -> ([R; 2], bool) {
        let d = (x * x + y * y + z * z).sqrt();
        let valid = z < self.max_cosine * d;
        let denominator = self.l * d - z;
        let scale_px = self.f_px * (self.l + self.m);
        let scale = scale_px / if valid { denominator } else { R::of(1.0) };
        ([self.cx_px + scale * x, self.cy_px + scale * y], valid)
    }

    fn unproject(&self, [u, v]: [R; 2]) -> Option<Ray<R>> {
        // With d = 1: r = k·(l − z) and r² + z² = 1. The scene is the smaller root of this
        // quadratic in z.
        let scale_px = self.f_px * (self.l + self.m);
        let (x, y) = ((u - self.cx_px) / scale_px, (v - self.cy_px) / scale_px);
        let k2 = x * x + y * y;
        let one = R::of(1.0);
        let discriminant = one + k2 * (one - self.l * self.l);
        if !(discriminant >= R::of(0.0)) {
            return None;
        }
        let z = (k2 * self.l - discriminant.sqrt()) / (one + k2);
        if !(z < self.max_cosine) {
            return None;
        }
        let factor = self.l - z;
        Some(Ray::from_camera([x * factor, y * factor, z]))
    }
}
