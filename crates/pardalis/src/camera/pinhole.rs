//! Pinhole camera with Brown-Conrady distortion.

use crate::Error;
use crate::camera::{Projection, check_coefficients, check_focal, check_principal_point};
use crate::real::Real;

/// With a = x/z, b = y/z, s = a² + b² and g = 1 + k1·s + k2·s² + k3·s³:
///
/// u = fx·(a·g + 2·p1·a·b + p2·(s + 2a²)) + cx, v = fy·(b·g + p1·(s + 2b²) + 2·p2·a·b) + cy
///
/// (Brown 1966, in OpenCV's order of coefficients). Domain: z > 0, and only as far from the axis as the radial distortion grows: beyond the
/// first maximum of √s·g the model folds back on itself, so that a point far outside the view would get a pixel inside it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pinhole<R> {
    fx_px: R,
    fy_px: R,
    cx_px: R,
    cy_px: R,
    k1: R,
    k2: R,
    p1: R,
    p2: R,
    k3: R,
    /// The largest s at which the radial distortion still grows.
    max_s: R,
}

/// Far enough from the axis for any image: 89.9 degrees.
const FARTHEST_S: f64 = 328_280.0;

impl Pinhole<f64> {
    /// Focal lengths and principal point in pixels; `distortion` is `[k1, k2, p1, p2, k3]`, zeros for an ideal pinhole.
    pub fn new(
        [fx_px, fy_px]: [f64; 2],
        [cx_px, cy_px]: [f64; 2],
        distortion: [f64; 5],
    ) -> Result<Self, Error> {
        check_focal("fx_px", fx_px)?;
        check_focal("fy_px", fy_px)?;
        check_principal_point([cx_px, cy_px])?;
        check_coefficients("distortion", &distortion)?;
        let [k1, k2, p1, p2, k3] = distortion;
        let max_s = largest_growing_s(k1, k2, k3);
        Ok(Self {
            fx_px,
            fy_px,
            cx_px,
            cy_px,
            k1,
            k2,
            p1,
            p2,
            k3,
            max_s,
        })
    }

    /// The same camera in single precision, for kernels.
    pub fn to_f32(self) -> Pinhole<f32> {
        Pinhole {
            fx_px: self.fx_px as f32,
            fy_px: self.fy_px as f32,
            cx_px: self.cx_px as f32,
            cy_px: self.cy_px as f32,
            k1: self.k1 as f32,
            k2: self.k2 as f32,
            p1: self.p1 as f32,
            p2: self.p2 as f32,
            k3: self.k3 as f32,
            max_s: self.max_s as f32,
        }
    }
}

/// The first zero of d(√s·g)/d√s = 1 + 3·k1·s + 5·k2·s² + 7·k3·s³, or [`FARTHEST_S`].
fn largest_growing_s(k1: f64, k2: f64, k3: f64) -> f64 {
    let slope = |s: f64| 1.0 + s * (3.0 * k1 + s * (5.0 * k2 + s * 7.0 * k3));
    // The slope is 1 on the axis; it is searched in steps of one in a hundred of √s, then by bisection.
    let mut low = 0.0;
    let mut high = 1e-6;
    while slope(high) > 0.0 {
        if high >= FARTHEST_S {
            return FARTHEST_S;
        }
        low = high;
        high = (high * 1.02).min(FARTHEST_S);
    }
    for _ in 0..100 {
        let middle = 0.5 * (low + high);
        if slope(middle) > 0.0 {
            low = middle;
        } else {
            high = middle;
        }
    }
    low
}

impl<R: Real> Pinhole<R> {
    /// The distorted normalised coordinates.
    #[inline(always)]
    fn distort(&self, a: R, b: R) -> [R; 2] {
        let two = R::of(2.0);
        let s = a * a + b * b;
        let g = R::of(1.0) + s * (self.k1 + s * (self.k2 + s * self.k3));
        [
            a * g + two * self.p1 * a * b + self.p2 * (s + two * a * a),
            b * g + self.p1 * (s + two * b * b) + two * self.p2 * a * b,
        ]
    }
}

impl<R: Real> Projection<R> for Pinhole<R> {
    #[inline(always)]
    fn project(&self, [x, y, z]: [R; 3]) -> ([R; 2], bool) {
        let in_front = z > R::of(0.0);
        let inverse = R::of(1.0) / if in_front { z } else { R::of(1.0) };
        let (a, b) = (x * inverse, y * inverse);
        let valid = in_front && a * a + b * b <= self.max_s;
        let [a, b] = self.distort(a, b);
        (
            [self.fx_px * a + self.cx_px, self.fy_px * b + self.cy_px],
            valid,
        )
    }

    /// Newton's iteration on the distortion, from the distorted point.
    fn unproject(&self, [u, v]: [R; 2]) -> Option<[R; 3]> {
        let target = [(u - self.cx_px) / self.fx_px, (v - self.cy_px) / self.fy_px];
        let (two, six) = (R::of(2.0), R::of(6.0));
        let [mut a, mut b] = target;
        // A start beyond the domain is drawn back onto its border.
        let s = a * a + b * b;
        if s > self.max_s {
            let shrink = (self.max_s / s).sqrt();
            (a, b) = (a * shrink, b * shrink);
        }
        for _ in 0..50 {
            let [da, db] = self.distort(a, b);
            let (ea, eb) = (da - target[0], db - target[1]);
            let s = a * a + b * b;
            let g = R::of(1.0) + s * (self.k1 + s * (self.k2 + s * self.k3));
            let dg = self.k1 + s * (two * self.k2 + s * R::of(3.0) * self.k3);
            let j00 = g + two * a * a * dg + two * self.p1 * b + six * self.p2 * a;
            let j01 = two * a * b * dg + two * self.p1 * a + two * self.p2 * b;
            let j11 = g + two * b * b * dg + six * self.p1 * b + two * self.p2 * a;
            let determinant = j00 * j11 - j01 * j01;
            if !(determinant.abs() > R::of(1e-12)) {
                return None;
            }
            let (mut step_a, mut step_b) = (
                (j11 * ea - j01 * eb) / determinant,
                (j00 * eb - j01 * ea) / determinant,
            );
            // Far out the slope is small and a full step may leave the domain: at most half the way to its border.
            let step = (step_a * step_a + step_b * step_b).sqrt();
            let room = R::of(0.5) * (R::of(1e-3) + self.max_s.sqrt());
            if step > room {
                (step_a, step_b) = (step_a * room / step, step_b * room / step);
            }
            (a, b) = (a - step_a, b - step_b);
        }
        let [da, db] = self.distort(a, b);
        let (ea, eb) = (da - target[0], db - target[1]);
        let size = R::of(1.0) + (target[0] * target[0] + target[1] * target[1]).sqrt();
        let solved = (ea * ea + eb * eb).sqrt() < R::of(1e-6) * size;
        let s = a * a + b * b;
        if !(solved && s <= self.max_s) {
            return None;
        }
        let inverse = R::of(1.0) / (s + R::of(1.0)).sqrt();
        Some([a * inverse, b * inverse, inverse])
    }
}
