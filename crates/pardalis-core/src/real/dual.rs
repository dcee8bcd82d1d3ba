//! Forward-mode automatic differentiation: code that is generic over [`Real`] is differentiated
//! exactly by evaluating it with [`Dual`] numbers.

use std::cmp::Ordering;
use std::ops::{Add, Div, Mul, Neg, Sub};

use super::Real;

/// A number and its partial derivatives with respect to `N` variables. Comparisons use the value
/// alone.
#[derive(Debug, Clone, Copy)]
pub struct Dual<const N: usize> {
    /// The value.
    pub value: f64,
    /// The partial derivatives.
    pub derivatives: [f64; N],
}

impl<const N: usize> Dual<N> {
    /// Creates a constant, whose derivatives are zero.
    pub fn constant(value: f64) -> Self {
        Self {
            value,
            derivatives: [0.0; N],
        }
    }

    /// Creates the variable with index `i`, whose derivative with respect to itself is 1.
    pub fn variable(value: f64, i: usize) -> Self {
        let mut derivatives = [0.0; N];
        derivatives[i] = 1.0;
        Self { value, derivatives }
    }

    /// Applies the chain rule for a function of one number with the given value and derivative.
    #[inline(always)]
    fn chain(self, value: f64, derivative: f64) -> Self {
        Self {
            value,
            derivatives: self.derivatives.map(|s| s * derivative),
        }
    }

    /// Applies the chain rule for a function of two numbers with the given value and partial
    /// derivatives.
    #[inline(always)]
    fn chain2(self, other: Self, value: f64, derivative: f64, other_derivative: f64) -> Self {
        Self {
            value,
            derivatives: std::array::from_fn(|i| {
                self.derivatives[i] * derivative + other.derivatives[i] * other_derivative
            }),
        }
    }
}

impl<const N: usize> PartialEq for Dual<N> {
    fn eq(&self, other: &Self) -> bool {
        self.value == other.value
    }
}

impl<const N: usize> PartialOrd for Dual<N> {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        self.value.partial_cmp(&other.value)
    }
}

impl<const N: usize> Add for Dual<N> {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        self.chain2(other, self.value + other.value, 1.0, 1.0)
    }
}

impl<const N: usize> Sub for Dual<N> {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        self.chain2(other, self.value - other.value, 1.0, -1.0)
    }
}

impl<const N: usize> Mul for Dual<N> {
    type Output = Self;
    fn mul(self, other: Self) -> Self {
        self.chain2(other, self.value * other.value, other.value, self.value)
    }
}

impl<const N: usize> Div for Dual<N> {
    type Output = Self;
    fn div(self, other: Self) -> Self {
        let (value, inverse) = (self.value / other.value, 1.0 / other.value);
        self.chain2(other, value, inverse, -value * inverse)
    }
}

impl<const N: usize> Neg for Dual<N> {
    type Output = Self;
    fn neg(self) -> Self {
        self.chain(-self.value, -1.0)
    }
}

impl<const N: usize> Real for Dual<N> {
    fn of(value: f64) -> Self {
        Self::constant(value)
    }
    fn to_f64(self) -> f64 {
        self.value
    }
    fn sqrt(self) -> Self {
        let root = Real::sqrt(self.value);
        // The derivative at zero is infinite. The differentiated functions are smooth in the square
        // (a radius near the axis), so that its value does not matter.
        let derivative = if root > 0.0 { 0.5 / root } else { 0.0 };
        self.chain(root, derivative)
    }
    fn abs(self) -> Self {
        self.chain(Real::abs(self.value), Real::signum(self.value))
    }
    fn atan2(self, x: Self) -> Self {
        let square = self.value * self.value + x.value * x.value;
        self.chain2(
            x,
            Real::atan2(self.value, x.value),
            x.value / square,
            -self.value / square,
        )
    }
    fn sin_cos(self) -> (Self, Self) {
        let (sin, cos) = Real::sin_cos(self.value);
        (self.chain(sin, cos), self.chain(cos, -sin))
    }
    fn sin_cos_turns(self) -> (Self, Self) {
        let (sin, cos) = Real::sin_cos_turns(self.value);
        let turn = std::f64::consts::TAU;
        (self.chain(sin, turn * cos), self.chain(cos, -turn * sin))
    }
    fn signum(self) -> Self {
        Self::constant(Real::signum(self.value))
    }
    fn floor(self) -> Self {
        Self::constant(Real::floor(self.value))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Combines every operation of [`Real`] in one formula of two variables.
    fn formula<R: Real>(x: R, y: R) -> R {
        let (sin, cos) = (x * y).sin_cos();
        let (sine, cosine) = (x + y).sin_cos_turns();
        (x / y + sin * cos + sine - cosine * (x - x.floor()))
            .abs()
            .sqrt()
            * (y - x).atan2(x)
            - -x * (x - y).signum()
    }

    #[test]
    fn derivatives_agree_with_finite_differences() {
        for (x, y) in [(0.3, 1.7), (2.1, 0.4), (-0.7, 1.1), (0.9, -2.3)] {
            let dual = formula(Dual::<2>::variable(x, 0), Dual::variable(y, 1));
            assert_eq!(dual.value, formula(x, y));
            let h = 1e-6;
            let numeric = [
                (formula(x + h, y) - formula(x - h, y)) / (2.0 * h),
                (formula(x, y + h) - formula(x, y - h)) / (2.0 * h),
            ];
            for (derivative, numeric) in dual.derivatives.into_iter().zip(numeric) {
                assert!(
                    (derivative - numeric).abs() < 1e-7 * (1.0 + numeric.abs()),
                    "{derivative} {numeric} at {x}, {y}"
                );
            }
        }
    }
}
