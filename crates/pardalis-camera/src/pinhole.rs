//! Pinhole camera with Brown-Conrady distortion.

use super::distortion::Distortion;
use super::{Projection, Ray, check_coefficients, check_focals, check_principal_point};
use pardalis_core::Error;
use pardalis_core::real::Real;

/// Pinhole camera with Brown-Conrady distortion.
///
/// u = fx·a' + cx, v = fy·b' + cy, where (a', b') is (x/z, y/z) distorted by up to twelve
/// coefficients in OpenCV's order k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4. With s = a² + b² and g = (1 +
/// k1·s + k2·s² + k3·s³) / (1 + k4·s + k5·s² + k6·s³):
///
/// a' = a·g + 2·p1·a·b + p2·(s + 2a²) + s1·s + s2·s², b' = b·g + p1·(s + 2b²) + 2·p2·a·b + s3·s +
/// s4·s²
///
/// (Brown 1966; the rational and thin-prism terms follow OpenCV.)
///
/// Domain: z > 0, but only as far from the axis as the distortion does not fold back, so that a
/// point far outside the view never gets a pixel inside it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pinhole<R> {
    fx_px: R,
    fy_px: R,
    cx_px: R,
    cy_px: R,
    distortion: Distortion<R>,
}

impl Pinhole<f64> {
    /// Creates a camera from focal lengths and principal point in pixels and 0, 4, 5, 8 or 12
    /// distortion coefficients in OpenCV's order.
    pub fn new(
        f_px @ [fx_px, fy_px]: [f64; 2],
        [cx_px, cy_px]: [f64; 2],
        distortion: &[f64],
    ) -> Result<Self, Error> {
        check_focals(f_px)?;
        check_principal_point([cx_px, cy_px])?;
        check_coefficients("distortion", distortion)?;
        if ![0, 4, 5, 8, 12].contains(&distortion.len()) {
            return Err(Error::out_of_range(
                "distortion",
                format!("{} numbers", distortion.len()),
                "0, 4, 5, 8 or 12 numbers: k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4",
            ));
        }
        let mut coefficients = [0.0; 12];
        coefficients[..distortion.len()].copy_from_slice(distortion);
        Ok(Self {
            fx_px,
            fy_px,
            cx_px,
            cy_px,
            distortion: Distortion::new(coefficients),
        })
    }

    /// Returns the camera with other parameters, in the order of [`Self::NAMES`].
    #[allow(clippy::unused_self)] // uniform signature for all models
    pub(super) fn with_parameters(&self, p: [f64; 16]) -> Result<Self, Error> {
        Self::new([p[0], p[1]], [p[2], p[3]], &p[4..])
    }

    /// Returns the camera in single precision, for vectorised kernels.
    pub fn to_f32(&self) -> Pinhole<f32> {
        self.vary(self.parameters().map(|p| p as f32))
    }
}

impl<R: Real> Pinhole<R> {
    /// Names of the parameters, in order.
    pub(super) const NAMES: [&'static str; 16] = [
        "fx_px", "fy_px", "cx_px", "cy_px", "k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "s1",
        "s2", "s3", "s4",
    ];

    pub(super) fn parameters(&self) -> [R; 16] {
        let d = self.distortion.coefficients();
        std::array::from_fn(|i| match i {
            0 => self.fx_px,
            1 => self.fy_px,
            2 => self.cx_px,
            3 => self.cy_px,
            i => d[i - 4],
        })
    }

    /// Returns the model with other parameters, unchecked and of any number type, and the same domain.
    pub(super) fn vary<S: Real>(&self, p: [S; 16]) -> Pinhole<S> {
        Pinhole {
            fx_px: p[0],
            fy_px: p[1],
            cx_px: p[2],
            cy_px: p[3],
            distortion: self.distortion.vary(std::array::from_fn(|i| p[i + 4])),
        }
    }
}

impl<R: Real> Projection<R> for Pinhole<R> {
    #[inline(always)]
    fn project(&self, [x, y, z]: [R; 3]) -> ([R; 2], bool) {
        let in_front = z > R::of(0.0);
        let inverse = R::of(1.0) / if in_front { z } else { R::of(1.0) };
        let ([a, b], inside) = self.distortion.distort(x * inverse, y * inverse);
        (
            [self.fx_px * a + self.cx_px, self.fy_px * b + self.cy_px],
            in_front && inside,
        )
    }

    fn unproject(&self, [u, v]: [R; 2]) -> Option<Ray<R>> {
        let distorted = [(u - self.cx_px) / self.fx_px, (v - self.cy_px) / self.fy_px];
        let [a, b] = self.distortion.undistort(distorted)?;
        Some(Ray::towards([a, b, R::of(1.0)]))
    }
}
