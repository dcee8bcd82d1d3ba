//! Perspective model of a mirror camera: a cheap model for mirrors that preserve the proportions of
//! the floor.

use super::{Projection, Ray, check_focal, check_principal_point};
use pardalis_core::Error;
use pardalis_core::real::Real;

/// Perspective model of a mirror camera.
///
/// ρ = k·r/z with k = −m, which is the unified model with l = 0; u = cx + ρ·x/r, v = cy + ρ·y/r
/// (Taiana 2007, section 3.1.1, eq. 3.4). The camera looks along +z into the mirror; the scene has z < 0.
///
/// Domain: z < 0.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PerspectiveMirror<R> {
    m_px: R,
    cx_px: R,
    cy_px: R,
}

impl PerspectiveMirror<f64> {
    /// Creates a camera from `m_px` = −k > 0, in pixels, and the principal point in pixels.
    pub fn new(m_px: f64, [cx_px, cy_px]: [f64; 2]) -> Result<Self, Error> {
        check_focal("m_px", m_px)?;
        check_principal_point([cx_px, cy_px])?;
        Ok(Self { m_px, cx_px, cy_px })
    }

    /// Returns the camera with other parameters, in the order of [`Self::NAMES`].
    #[allow(clippy::unused_self)] // uniform signature for all models
    pub(super) fn with_parameters(&self, [m, cx, cy]: [f64; 3]) -> Result<Self, Error> {
        Self::new(m, [cx, cy])
    }

    /// Returns the camera in single precision, for vectorised kernels.
    pub fn to_f32(&self) -> PerspectiveMirror<f32> {
        self.vary(self.parameters().map(|p| p as f32))
    }
}

impl<R: Real> PerspectiveMirror<R> {
    /// Names of the parameters, in order.
    pub(super) const NAMES: [&'static str; 3] = ["m_px", "cx_px", "cy_px"];

    pub(super) fn parameters(&self) -> [R; 3] {
        [self.m_px, self.cx_px, self.cy_px]
    }

    /// Returns the model with other parameters, unchecked and of any number type.
    #[allow(clippy::unused_self)] // uniform signature for all models
    pub(super) fn vary<S: Real>(&self, [m_px, cx_px, cy_px]: [S; 3]) -> PerspectiveMirror<S> {
        PerspectiveMirror { m_px, cx_px, cy_px }
    }
}

impl<R: Real> Projection<R> for PerspectiveMirror<R> {
    #[inline(always)]
    fn project(&self, [x, y, z]: [R; 3]) -> ([R; 2], bool) {
        // The second condition is false only for NaN.
        let valid = z < R::of(0.0) && x * x + y * y >= R::of(0.0);
        let scale = self.m_px / if valid { -z } else { R::of(1.0) };
        ([self.cx_px + scale * x, self.cy_px + scale * y], valid)
    }

    fn unproject(&self, [u, v]: [R; 2]) -> Option<Ray<R>> {
        let (x, y) = ((u - self.cx_px) / self.m_px, (v - self.cy_px) / self.m_px);
        (u.to_f64() + v.to_f64())
            .is_finite()
            .then(|| Ray::towards([x, y, R::of(-1.0)]))
    }
}
