//! Mei's unified model with distortion, as in OpenCV's `omnidir` module.

use super::distortion::Distortion;
use super::{Projection, Ray, check_coefficients, check_focals, check_principal_point};
use pardalis_core::Error;
use pardalis_core::real::Real;

/// Mei's unified model with distortion.
///
/// (a, b) = (x, y) / (z + ξ·d) with d = √(x² + y² + z²), distorted by k1, k2, p1, p2 to (a', b'); u
/// = fx·a' + skew·b' + cx, v = fy·b' + cy (Mei and Rives 2007; OpenCV `omnidir`). The camera looks
/// along +z at the scene.
///
/// Domain: z > −ξ·d for ξ ≤ 1 and z > −d/ξ for ξ > 1, where (a, b) folds back, but only as far as
/// the distortion does not fold back.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mei<R> {
    fx_px: R,
    fy_px: R,
    skew_px: R,
    cx_px: R,
    cy_px: R,
    xi: R,
    distortion: Distortion<R>,
    /// Lower bound of z/d.
    min_cosine: R,
}

impl Mei<f64> {
    /// Creates a camera from focal lengths, skew and principal point in pixels, ξ from 0 to 1000
    /// and the distortion k1, k2, p1, p2.
    pub fn new(
        f_px @ [fx_px, fy_px]: [f64; 2],
        skew_px: f64,
        [cx_px, cy_px]: [f64; 2],
        xi: f64,
        distortion @ [k1, k2, p1, p2]: [f64; 4],
    ) -> Result<Self, Error> {
        check_focals(f_px)?;
        check_coefficients("skew_px", &[skew_px])?;
        check_principal_point([cx_px, cy_px])?;
        check_coefficients("distortion", &distortion)?;
        if !(0.0..=1e3).contains(&xi) {
            return Err(Error::out_of_range("xi", xi, "0 to 1000"));
        }
        let mut coefficients = [0.0; 12];
        coefficients[..4].copy_from_slice(&[k1, k2, p1, p2]);
        Ok(Self {
            fx_px,
            fy_px,
            skew_px,
            cx_px,
            cy_px,
            xi,
            distortion: Distortion::new(coefficients),
            min_cosine: if xi <= 1.0 { -xi } else { -1.0 / xi },
        })
    }

    /// Returns the camera with other parameters, in the order of [`Self::NAMES`].
    #[allow(clippy::unused_self)] // uniform signature for all models
    pub(super) fn with_parameters(&self, p: [f64; 10]) -> Result<Self, Error> {
        Self::new(
            [p[0], p[1]],
            p[2],
            [p[3], p[4]],
            p[5],
            [p[6], p[7], p[8], p[9]],
        )
    }

    /// Returns the camera in single precision, for vectorised kernels.
    pub fn to_f32(&self) -> Mei<f32> {
        self.vary(self.parameters().map(|p| p as f32))
    }
}

impl<R: Real> Mei<R> {
    /// Names of the parameters, in order.
    pub(super) const NAMES: [&'static str; 10] = [
        "fx_px", "fy_px", "skew_px", "cx_px", "cy_px", "xi", "k1", "k2", "p1", "p2",
    ];

    pub(super) fn parameters(&self) -> [R; 10] {
        let [k1, k2, p1, p2, ..] = self.distortion.coefficients();
        [
            self.fx_px,
            self.fy_px,
            self.skew_px,
            self.cx_px,
            self.cy_px,
            self.xi,
            k1,
            k2,
            p1,
            p2,
        ]
    }

    /// Returns the model with other parameters, unchecked and of any number type, and the same domain.
    pub(super) fn vary<S: Real>(&self, p: [S; 10]) -> Mei<S> {
        let mut coefficients = [S::of(0.0); 12];
        coefficients[..4].copy_from_slice(&p[6..]);
        Mei {
            fx_px: p[0],
            fy_px: p[1],
            skew_px: p[2],
            cx_px: p[3],
            cy_px: p[4],
            xi: p[5],
            distortion: self.distortion.vary(coefficients),
            min_cosine: S::of(self.min_cosine.to_f64()),
        }
    }
}

impl<R: Real> Projection<R> for Mei<R> {
    #[inline(always)]
    fn project(&self, [x, y, z]: [R; 3]) -> ([R; 2], bool) {
        let d = (x * x + y * y + z * z).sqrt();
        let in_view = z > self.min_cosine * d;
        let denominator = z + self.xi * d;
        let inverse = R::of(1.0) / if in_view { denominator } else { R::of(1.0) };
        let ([a, b], inside) = self.distortion.distort(x * inverse, y * inverse);
        (
            [
                self.fx_px * a + self.skew_px * b + self.cx_px,
                self.fy_px * b + self.cy_px,
            ],
            in_view && inside,
        )
    }

    fn unproject(&self, [u, v]: [R; 2]) -> Option<Ray<R>> {
        let b = (v - self.cy_px) / self.fy_px;
        let a = (u - self.cx_px - self.skew_px * b) / self.fx_px;
        let [a, b] = self.distortion.undistort([a, b])?;
        let one = R::of(1.0);
        let s = a * a + b * b;
        let discriminant = one + s * (one - self.xi * self.xi);
        if !(discriminant >= R::of(0.0)) {
            return None;
        }
        // With d = 1: z + ξ = factor, and factor²·s + z² = 1.
        let factor = (self.xi + discriminant.sqrt()) / (s + one);
        let z = factor - self.xi;
        (z > self.min_cosine).then(|| Ray::from_camera([a * factor, b * factor, z]))
    }
}
