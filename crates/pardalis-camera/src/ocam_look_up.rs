//! Scaramuzza's polynomial model for vectorised kernels: a look-up table refined by Newton steps,
//! branch-free and in single precision.

use super::{Projection, Ray};
use pardalis_core::real::Real;

/// Maximum number of coefficients of the polynomial.
pub(super) const MAX_COEFFICIENTS: usize = 8;
/// Number of intervals of the table.
const INTERVALS: usize = 256;
/// Newton steps after the table's linear interpolation. One step is within 0.001 px, except near
/// the border of lenses whose angle hardly increases there.
const STEPS: usize = 2;

/// Radii of rays at angles θ from the axis, tabulated over sin(θ/2), which is smooth enough for all
/// lenses up to 360 degrees.
pub(super) struct Radii {
    radii_px: [f32; INTERVALS + 1],
    intervals_per_sin: f32,
}

impl std::fmt::Debug for Radii {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Radii").finish_non_exhaustive()
    }
}

impl Radii {
    /// Tabulates `radius`, a function of sine and cosine of the angle, up to the angle with cosine
    /// `last_cos`.
    pub(super) fn new(last_cos: f64, radius: impl Fn([f64; 2]) -> f64) -> Self {
        let last_sin = (0.5 * (1.0 - last_cos)).sqrt();
        let radius_px = |i: usize| {
            let half_sin = last_sin * i as f64 / INTERVALS as f64;
            let half_cos = (1.0 - half_sin * half_sin).max(0.0).sqrt();
            let cos = 1.0 - 2.0 * half_sin * half_sin;
            radius([2.0 * half_sin * half_cos, cos]) as f32
        };
        Self {
            radii_px: std::array::from_fn(radius_px),
            intervals_per_sin: (INTERVALS as f64 / last_sin) as f32,
        }
    }
}

/// Returns f(ρ) and f'(ρ).
#[inline(always)]
pub(super) fn value_and_slope<R: Real>(polynomial: &[R; MAX_COEFFICIENTS], rho: R) -> (R, R) {
    let (mut value, mut slope) = (R::of(0.0), R::of(0.0));
    for &a in polynomial.iter().rev() {
        slope = slope * rho + value;
        value = value * rho + a;
    }
    (value, slope)
}

/// Scaramuzza's polynomial model in single precision.
#[derive(Debug, Clone, Copy)]
pub struct OcamLookUp<'a> {
    pub(super) radii: &'a Radii,
    pub(super) polynomial: [f32; MAX_COEFFICIENTS],
    pub(super) center_px: [f32; 2],
    pub(super) affine: [f32; 3],
    pub(super) last_radius_px: f32,
}

impl Projection<f32> for OcamLookUp<'_> {
    #[inline(always)]
    fn project(&self, [x, y, z]: [f32; 3]) -> ([f32; 2], bool) {
        let square = x * x + y * y;
        let (r, d) = (square.sqrt(), (square + z * z).sqrt());
        let off_origin = d > 0.0;
        let inverse = 1.0 / if off_origin { d } else { 1.0 };
        let (sin, cos) = (r * inverse, z * inverse);
        let ahead = z > 0.0;
        // d − z without cancellation near the axis.
        let far = d + z.abs();
        let near = square / if off_origin { far } else { 1.0 };
        let difference = if ahead { near } else { far };
        let half_sin = (0.5 * difference * inverse).sqrt();
        let position = half_sin * self.radii.intervals_per_sin;
        let position = if position < INTERVALS as f32 {
            position
        } else {
            INTERVALS as f32
        };
        // Adding 1.5·2²³ rounds to an integer. If `position` is an integer, either interval is
        // correct.
        let whole = (position - 0.5).max(0.0) + 12_582_912.0;
        let i = (whole.to_bits() & 0xffff) as usize % INTERVALS;
        let share = position - (whole - 12_582_912.0);
        let (low, high) = (self.radii.radii_px[i], self.radii.radii_px[i + 1]);
        let mut rho = low + share * (high - low);
        for _ in 0..STEPS {
            let (f, slope) = value_and_slope(&self.polynomial, rho);
            let newton = rho - (cos * rho + sin * f) / (cos + sin * slope);
            // The radius lies between the table's neighbouring entries; a NaN step is repositiond by
            // one of them.
            let bounded = if newton > low { newton } else { low };
            rho = if bounded < high { bounded } else { high };
        }
        let (f_last, _) = value_and_slope(&self.polynomial, self.last_radius_px);
        let behind = !(sin > 1e-30) & !ahead;
        let valid = off_origin & !behind & (cos * self.last_radius_px + sin * f_last >= 0.0);
        // ρ/r equals −f(ρ)/z; divide by the larger of r and z.
        let (f, _) = value_and_slope(&self.polynomial, rho);
        let along = cos > sin;
        let scale = if along { -f } else { rho } / if along { z } else { r };
        let (x, y) = (scale * x, scale * y);
        let [c, d, e] = self.affine;
        let [cx, cy] = self.center_px;
        ([x + e * y + cx, d * x + c * y + cy], valid)
    }

    fn unproject(&self, [u, v]: [f32; 2]) -> Option<Ray<f32>> {
        let (du, dv) = (u - self.center_px[0], v - self.center_px[1]);
        let [c, d, e] = self.affine;
        let determinant = c - d * e;
        let (x, y) = ((c * du - e * dv) / determinant, (dv - d * du) / determinant);
        let rho = (x * x + y * y).sqrt();
        if !(rho <= self.last_radius_px * (1.0 + 1e-6)) {
            return None;
        }
        let (f, _) = value_and_slope(&self.polynomial, rho);
        Some(Ray::towards([x, y, -f]))
    }
}
