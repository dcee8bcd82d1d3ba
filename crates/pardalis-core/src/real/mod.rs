//! Arithmetic for kernels that are generic over the precision: `f32` for speed, `f64` for reference
//! implementations and calibration.
//!
//! IEEE 754 rounds + − × ÷ √ correctly on every platform. The transcendental functions are
//! branch-free polynomials for `f32`, which vectorise over particles, and `libm` for `f64`. Results
//! therefore depend neither on the platform's mathematics library nor on the instruction set.

use std::ops::{Add, Div, Mul, Neg, Sub};

mod dual;

pub use dual::Dual;

/// A floating-point number.
pub trait Real:
    Copy
    + PartialOrd
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
    + Send
    + Sync
    + 'static
{
    /// Returns the nearest representable number.
    fn of(value: f64) -> Self;
    /// Converts to double precision.
    fn to_f64(self) -> f64;
    /// Returns the square root.
    fn sqrt(self) -> Self;
    /// Returns the absolute value.
    fn abs(self) -> Self;
    /// Returns the angle of the point `(x, self)` from the x axis, in radians.
    fn atan2(self, x: Self) -> Self;
    /// Returns the sine and cosine of an angle in radians.
    fn sin_cos(self) -> (Self, Self);
    /// Returns the sine and cosine of an angle in full turns.
    fn sin_cos_turns(self) -> (Self, Self);
    /// Returns 1 with the sign of `self`.
    fn signum(self) -> Self;
    /// Returns the largest integer that is not greater than `self`.
    fn floor(self) -> Self;
}

impl Real for f64 {
    #[inline(always)]
    fn of(value: f64) -> Self {
        value
    }
    #[inline(always)]
    fn to_f64(self) -> f64 {
        self
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        f64::sqrt(self)
    }
    #[inline(always)]
    fn abs(self) -> Self {
        f64::abs(self)
    }
    fn atan2(self, x: Self) -> Self {
        libm::atan2(self, x)
    }
    fn sin_cos(self) -> (Self, Self) {
        libm::sincos(self)
    }
    fn sin_cos_turns(self) -> (Self, Self) {
        libm::sincos(self * std::f64::consts::TAU)
    }
    #[inline(always)]
    fn signum(self) -> Self {
        1_f64.copysign(self)
    }
    #[inline(always)]
    fn floor(self) -> Self {
        f64::floor(self)
    }
}

impl Real for f32 {
    #[inline(always)]
    fn of(value: f64) -> Self {
        value as f32
    }
    #[inline(always)]
    fn to_f64(self) -> f64 {
        f64::from(self)
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        f32::sqrt(self)
    }
    #[inline(always)]
    fn abs(self) -> Self {
        f32::abs(self)
    }
    #[inline(always)]
    fn atan2(self, x: Self) -> Self {
        atan2_f32(self, x)
    }
    fn sin_cos(self) -> (Self, Self) {
        libm::sincosf(self)
    }
    #[inline(always)]
    fn sin_cos_turns(self) -> (Self, Self) {
        sin_cos_turns_f32(self - self.floor())
    }
    #[inline(always)]
    fn signum(self) -> Self {
        1_f32.copysign(self)
    }
    #[inline(always)]
    fn floor(self) -> Self {
        f32::floor(self)
    }
}

/// Computes `atan2` without branches. The error is below 4e-7 rad (half a unit in the last place of
/// π is 1.2e-7).
#[inline(always)]
fn atan2_f32(y: f32, x: f32) -> f32 {
    let (ax, ay) = (x.abs(), y.abs());
    let steep = ay > ax;
    let (small, large) = if steep { (ax, ay) } else { (ay, ax) };
    // For the origin the quotient is 0/MIN_POSITIVE = 0, and the angle is 0 or π.
    let t = small
        / if large > f32::MIN_POSITIVE {
            large
        } else {
            f32::MIN_POSITIVE
        };
    let s = t * t;
    // Minimax polynomial of atan(t) for t from 0 to 1.
    let mut p = 0.002_823_639_f32;
    p = p * s - 0.015_956_903;
    p = p * s + 0.042_504_99;
    p = p * s - 0.074_890_09;
    p = p * s + 0.106_347_93;
    p = p * s - 0.142_027_36;
    p = p * s + 0.199_926_96;
    p = p * s - 0.333_331_02;
    let mut angle = t + t * s * p;
    angle = if steep {
        std::f32::consts::FRAC_PI_2 - angle
    } else {
        angle
    };
    angle = if x < 0.0 {
        std::f32::consts::PI - angle
    } else {
        angle
    };
    angle.copysign(y)
}

/// Computes the natural logarithm of a normal positive number without branches. The relative error
/// is below 2e-7.
#[inline(always)]
pub fn ln_f32(x: f32) -> f32 {
    // x = m·2^e with m from 0.75 to 1.5 centres the series on 1.
    let bits = x.to_bits();
    let shifted = bits.wrapping_sub(0x3f40_0000);
    let e = (shifted as i32) >> 23;
    let m = f32::from_bits(bits.wrapping_sub((e << 23) as u32));
    let s = (m - 1.0) / (m + 1.0);
    let s2 = s * s;
    let mut p = 0.239_282_85_f32;
    p = p * s2 + 0.285_182_12;
    p = p * s2 + 0.400_005_88;
    p = p * s2 + 0.666_666_7;
    p = p * s2 + 2.0;
    s * p + e as f32 * std::f32::consts::LN_2
}

/// Computes the exponential without branches. Below −87 it is that of −87, and above 88 that of 88; NaN stays NaN. The relative
/// error is below 2e-7.
#[inline(always)]
pub fn exp_f32(x: f32) -> f32 {
    // Adding it rounds to an integer, which is then in the lowest bits.
    const ROUND: f32 = 12_582_912.0;
    let x = x.clamp(-87.0, 88.0);
    let rounded = x * std::f32::consts::LOG2_E + ROUND;
    let whole = rounded - ROUND;
    // ln 2 in two parts, of which the first has no more bits than leave the product exact.
    let r = x - whole * 0.693_359_4 + whole * 2.121_944_4e-4;
    // Taylor series to the 7th power; the argument is at most ln 2 / 2.
    let mut p = 1.0 / 5040.0;
    p = p * r + 1.0 / 720.0;
    p = p * r + 1.0 / 120.0;
    p = p * r + 1.0 / 24.0;
    p = p * r + 1.0 / 6.0;
    p = p * r + 0.5;
    p = p * r + 1.0;
    p = p * r + 1.0;
    // Its exponent rises by the integer.
    f32::from_bits(p.to_bits().wrapping_add(rounded.to_bits() << 23))
}

/// Computes the sine and cosine of `turns` full turns, 0 to 1, without branches. The error is below
/// 2e-7.
#[inline(always)]
pub fn sin_cos_turns_f32(turns: f32) -> (f32, f32) {
    let quadrant = (turns * 4.0 + 0.5) as i32;
    let x = (turns - quadrant as f32 * 0.25) * std::f32::consts::TAU;
    let s = x * x;
    // Taylor series to the 9th and 8th power; the argument is at most π/4.
    let sin =
        x + x * s * (-1.0 / 6.0 + s * (1.0 / 120.0 + s * (-1.0 / 5040.0 + s * (1.0 / 362_880.0))));
    let cos = 1.0 + s * (-0.5 + s * (1.0 / 24.0 + s * (-1.0 / 720.0 + s * (1.0 / 40_320.0))));
    let swap = quadrant & 1 == 1;
    let (a, b) = if swap { (cos, sin) } else { (sin, cos) };
    let sin_sign = if quadrant & 2 == 2 { -1.0 } else { 1.0 };
    let cos_sign = if (quadrant + 1) & 2 == 2 { -1.0 } else { 1.0 };
    (a * sin_sign, b * cos_sign)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn atan2_agrees_with_libm_in_all_quadrants() {
        for i in 0..100_000 {
            let angle = (i as f64 / 100_000.0 - 0.5) * 1.999_99 * std::f64::consts::PI;
            for radius in [1e-6, 1.0, 3e5] {
                let (y, x) = ((radius * angle.sin()) as f32, (radius * angle.cos()) as f32);
                let error =
                    (f64::from(atan2_f32(y, x)) - libm::atan2(f64::from(y), f64::from(x))).abs();
                assert!(error < 4e-7, "atan2({y}, {x}) is off by {error}");
            }
        }
        assert_eq!(atan2_f32(0.0, 0.0), 0.0);
        assert!((atan2_f32(0.0, -1.0) - std::f32::consts::PI).abs() < 1e-6);
    }

    #[test]
    fn ln_agrees_with_libm() {
        for i in 1..200_000_u32 {
            let x = i as f32 / 100_000.0;
            let expected = libm::log(f64::from(x));
            let error = (f64::from(ln_f32(x)) - expected).abs();
            assert!(
                error < 2e-7 * expected.abs().max(1.0),
                "ln({x}) is off by {error}"
            );
        }
        assert!((ln_f32(2_f32.powi(-25)) + 25.0 * std::f32::consts::LN_2).abs() < 1e-5);
    }

    #[test]
    fn exp_agrees_with_libm() {
        for i in -870_000..=880_000 {
            let x = i as f32 / 10_000.0;
            let expected = libm::exp(f64::from(x));
            let error = (f64::from(exp_f32(x)) / expected - 1.0).abs();
            assert!(error < 2e-7, "exp({x}) is off by {error}");
        }
        assert_eq!(exp_f32(0.0), 1.0);
        assert_eq!(exp_f32(-1e9), exp_f32(-87.0));
        assert_eq!(exp_f32(f32::INFINITY), exp_f32(88.0));
        assert!(exp_f32(f32::NAN).is_nan());
    }

    #[test]
    fn sin_cos_of_turns_agrees_with_libm() {
        for i in 0..100_000 {
            let turns = i as f32 / 100_000.0;
            let (sin, cos) = libm::sincos(f64::from(turns) * std::f64::consts::TAU);
            let (s, c) = sin_cos_turns_f32(turns);
            assert!(
                (f64::from(s) - sin).abs() < 5e-7 && (f64::from(c) - cos).abs() < 5e-7,
                "{turns}"
            );
        }
    }
}
