//! Scaramuzza's polynomial model of mirror cameras and fisheyes, as written by OCamCalib.

use std::sync::{Arc, OnceLock};

use super::ocam_look_up::{MAX_COEFFICIENTS, OcamLookUp, Radii, value_and_slope};
use super::{Projection, Ray, check_coefficients, check_focal, check_principal_point};
use pardalis_core::Error;
use pardalis_core::real::Real;

/// The iteration stops at steps below this share of the largest radius.
const SETTLED: f64 = 2e-7;
/// Maximum number of iterations; half of them suffice for any lens.
const MAX_STEPS: u32 = 60;

/// Scaramuzza's polynomial model of mirror cameras and fisheyes.
///
/// The pixel (u, v) at (du, dv) from the centre has sensor coordinates (x', y') = A⁻¹·(du, dv), A =
/// [1 e; d c], and looks along (x', y', −f(ρ)), with ρ = √(x'² + y'²) and f(ρ) = a0 + a1·ρ + a2·ρ² +
/// … (Scaramuzza, Martinelli and Siegwart 2006, with OCamCalib's signs, a0 < 0). In OCamCalib, x
/// points down in the image, y to the right, and the camera looks along −z: its coordinates (x, y,
/// z) are (y, x, −z) here. Projection solves for ρ and does not use the toolbox's inverse
/// polynomial.
///
/// Domain: ρ ≤ `max_radius_px`, but only as far as the angle from the axis increases with ρ.
#[derive(Debug, Clone)]
pub struct Ocam<R> {
    polynomial: [R; MAX_COEFFICIENTS],
    coefficients: usize,
    cx_px: R,
    cy_px: R,
    affine: [R; 3],
    /// The requested largest radius.
    max_radius_px: R,
    /// The radius up to which the angle increases, at most `max_radius_px`.
    last_radius_px: R,
    /// Look-up table, built on first use.
    radii: Arc<OnceLock<Radii>>,
}

impl PartialEq for Ocam<f64> {
    /// Compares the cameras, regardless of whether their look-up tables are built.
    fn eq(&self, other: &Self) -> bool {
        self.parameters() == other.parameters()
            && self.coefficients == other.coefficients
            && self.max_radius_px == other.max_radius_px
    }
}

impl Ocam<f64> {
    /// Creates a camera from the polynomial a0, a1, a2, … with 1 to 8 coefficients and a0 < 0, the
    /// centre (column, row) in pixels, the affine parameters c, d, e and the largest radius in
    /// pixels.
    pub fn new(
        polynomial: &[f64],
        [cx_px, cy_px]: [f64; 2],
        affine @ [c, d, e]: [f64; 3],
        max_radius_px: f64,
    ) -> Result<Self, Error> {
        if !(1..=MAX_COEFFICIENTS).contains(&polynomial.len()) {
            return Err(Error::out_of_range(
                "polynomial",
                format!("{} numbers", polynomial.len()),
                "1 to 8 numbers: a0, a1, a2, ...",
            ));
        }
        check_coefficients("polynomial", polynomial)?;
        if !(polynomial[0] < 0.0) {
            return Err(Error::out_of_range(
                "polynomial",
                format!("{} in first position", polynomial[0]),
                "a negative a0, as OCamCalib writes it",
            ));
        }
        check_principal_point([cx_px, cy_px])?;
        check_coefficients("affine", &affine)?;
        if !(c - d * e > 1e-3) {
            return Err(Error::out_of_range(
                "affine",
                format!("{affine:?}"),
                "c, d, e with c - d e above 0.001 (about 1, 0, 0)",
            ));
        }
        check_focal("max_radius_px", max_radius_px)?;
        let mut padded = [0.0; MAX_COEFFICIENTS];
        padded[..polynomial.len()].copy_from_slice(polynomial);
        Ok(Self {
            polynomial: padded,
            coefficients: polynomial.len(),
            cx_px,
            cy_px,
            affine,
            max_radius_px,
            last_radius_px: largest_increasing_radius(&padded, max_radius_px),
            radii: Arc::default(),
        })
    }

    /// Returns the camera with a polynomial of at least this degree, up to 7; the added
    /// coefficients are zero.
    pub fn of_degree(&self, degree: usize) -> Result<Self, Error> {
        let coefficients = self.coefficients.max(degree + 1);
        Self::new(
            &self.polynomial[..coefficients],
            [self.cx_px, self.cy_px],
            self.affine,
            self.max_radius_px,
        )
    }

    /// Returns the polynomial a0, a1, a2, …
    pub fn polynomial(&self) -> &[f64] {
        &self.polynomial[..self.coefficients]
    }

    /// Returns the requested largest radius, in pixels.
    pub fn max_radius_px(&self) -> f64 {
        self.max_radius_px
    }

    /// Returns the camera with other parameters, in the order of [`Self::NAMES`].
    pub(super) fn with_parameters(&self, p: [f64; 13]) -> Result<Self, Error> {
        Self::new(
            &p[5..5 + self.coefficients],
            [p[0], p[1]],
            [p[2], p[3], p[4]],
            self.max_radius_px,
        )
    }

    /// Returns the camera in single precision, for vectorised kernels. The first call builds a
    /// look-up table.
    pub fn to_f32(&self) -> OcamLookUp<'_> {
        let radii = self.radii.get_or_init(|| {
            let [_, cos] = self.angle_at(self.last_radius_px());
            Radii::new(cos, |sin_cos| self.radius(sin_cos))
        });
        OcamLookUp {
            radii,
            polynomial: self.polynomial.map(|a| a as f32),
            center_px: [self.cx_px as f32, self.cy_px as f32],
            affine: self.affine.map(|a| a as f32),
            last_radius_px: self.last_radius_px as f32,
        }
    }

    /// Returns sine and cosine of the angle from the axis that is seen at a radius.
    pub(super) fn angle_at(&self, rho_px: f64) -> [f64; 2] {
        let (f, _) = value_and_slope(&self.polynomial, rho_px);
        let length = libm::hypot(rho_px, f);
        [rho_px / length, -f / length]
    }

    /// Returns the largest radius of the domain, in pixels.
    pub(super) fn last_radius_px(&self) -> f64 {
        self.last_radius_px
    }
}

/// Returns the first radius at which the angle atan2(ρ, −f) stops increasing, or `max_radius_px` if
/// that is smaller.
fn largest_increasing_radius(polynomial: &[f64; MAX_COEFFICIENTS], max_radius_px: f64) -> f64 {
    // The derivative of the angle has the sign of ρ·f' − f.
    let increasing = |rho: f64| {
        let (f, slope) = value_and_slope(polynomial, rho);
        rho * slope - f > 0.0
    };
    let steps = 4000;
    let step = max_radius_px / f64::from(steps);
    let Some(first) = (1..=steps).find(|&i| !increasing(f64::from(i) * step)) else {
        return max_radius_px;
    };
    let (mut low, mut high) = (f64::from(first - 1) * step, f64::from(first) * step);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if increasing(middle) {
            low = middle;
        } else {
            high = middle;
        }
    }
    low
}

impl<R: Real> Ocam<R> {
    /// Names of the parameters, in order.
    pub(super) const NAMES: [&'static str; 13] = [
        "cx_px", "cy_px", "c", "d", "e", "a0", "a1", "a2", "a3", "a4", "a5", "a6", "a7",
    ];

    pub(super) fn parameters(&self) -> [R; 13] {
        let [c, d, e] = self.affine;
        std::array::from_fn(|i| match i {
            0 => self.cx_px,
            1 => self.cy_px,
            2 => c,
            3 => d,
            4 => e,
            i => self.polynomial[i - 5],
        })
    }

    /// Returns the model with other parameters, unchecked and of any number type, and the same
    /// domain.
    pub(super) fn vary<S: Real>(&self, p: [S; 13]) -> Ocam<S> {
        Ocam {
            polynomial: std::array::from_fn(|i| p[i + 5]),
            coefficients: self.coefficients,
            cx_px: p[0],
            cy_px: p[1],
            affine: [p[2], p[3], p[4]],
            max_radius_px: S::of(self.max_radius_px.to_f64()),
            last_radius_px: S::of(self.last_radius_px.to_f64()),
            radii: Arc::default(),
        }
    }

    /// Returns the radius at which a ray with this sine and cosine of the angle is seen. Solves
    /// cos·ρ + sin·f(ρ) = 0 by Newton's method, bracketed between the axis and the last radius,
    /// where the equation has one root.
    pub(super) fn radius(&self, [sin, cos]: [R; 2]) -> R {
        let last = self.last_radius_px;
        let (mut low, mut high) = (R::of(0.0), last);
        let mut rho = sin * last;
        for _ in 0..MAX_STEPS {
            let (f, slope) = value_and_slope(&self.polynomial, rho);
            let error = cos * rho + sin * f;
            let beyond = error > R::of(0.0);
            high = if beyond { rho } else { high };
            low = if beyond { low } else { rho };
            let newton = rho - error / (cos + sin * slope);
            let next = if newton >= low && newton <= high {
                newton
            } else {
                R::of(0.5) * (low + high)
            };
            // Newton's method converges quadratically: the remaining error is about the square of
            // the step.
            let settled = (next - rho).abs() <= R::of(SETTLED) * last;
            rho = next;
            if settled {
                break;
            }
        }
        rho
    }
}

impl<R: Real> Projection<R> for Ocam<R> {
    /// Solves for the radius iteratively, in any precision. [`Ocam::to_f32`] is faster.
    fn project(&self, [x, y, z]: [R; 3]) -> ([R; 2], bool) {
        let (zero, one) = (R::of(0.0), R::of(1.0));
        let r = (x * x + y * y).sqrt();
        let d = (x * x + y * y + z * z).sqrt();
        let off_origin = d > zero;
        let inverse = one / if off_origin { d } else { one };
        let (sin, cos) = (r * inverse, z * inverse);
        let last = self.last_radius_px;
        let (f_last, _) = value_and_slope(&self.polynomial, last);
        let behind = !(sin > R::of(1e-30)) && !(cos > zero);
        let valid = off_origin && !behind && cos * last + sin * f_last >= zero;
        let rho = self.radius([sin, cos]);
        // ρ/r equals −f(ρ)/z; divide by the larger of r and z.
        let ahead = cos > sin;
        let (f, _) = value_and_slope(&self.polynomial, rho);
        let scale = if ahead { -f } else { rho } / if ahead { z } else { r };
        let (x, y) = (scale * x, scale * y);
        let [c, d, e] = self.affine;
        ([x + e * y + self.cx_px, d * x + c * y + self.cy_px], valid)
    }

    fn unproject(&self, [u, v]: [R; 2]) -> Option<Ray<R>> {
        let (du, dv) = (u - self.cx_px, v - self.cy_px);
        let [c, d, e] = self.affine;
        let determinant = c - d * e;
        let (x, y) = ((c * du - e * dv) / determinant, (dv - d * du) / determinant);
        let rho = (x * x + y * y).sqrt();
        // The tolerance absorbs rounding for pixels of points on the border.
        if !(rho <= self.last_radius_px * R::of(1.0 + 1e-12)) {
            return None;
        }
        let (f, _) = value_and_slope(&self.polynomial, rho);
        Some(Ray::towards([x, y, -f]))
    }
}
