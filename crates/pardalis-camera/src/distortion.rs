//! Brown-Conrady distortion of normalised image coordinates, shared by several models.

use pardalis_core::real::Real;

/// Largest tan² of the angle from the axis: 89.9 degrees, enough for any image.
const MAX_S: f64 = 328_280.0;

/// Brown-Conrady distortion of normalised image coordinates (a, b). With s = a² + b² and g = (1 +
/// k1·s + k2·s² + k3·s³) / (1 + k4·s + k5·s² + k6·s³):
///
/// a' = a·g + 2·p1·a·b + p2·(s + 2a²) + s1·s + s2·s²
///
/// b' = b·g + p1·(s + 2b²) + 2·p2·a·b + s3·s + s4·s²
///
/// (Brown 1966; the rational and thin-prism terms and the order k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4
/// follow OpenCV.)
///
/// Domain: radii up to which the map neither folds nor mirrors in any direction. Beyond, points far
/// outside the view would get pixels inside it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Distortion<R> {
    coefficients: [R; 12],
    /// Largest s of the domain.
    max_s: R,
}

impl Distortion<f64> {
    pub(super) fn new(coefficients: [f64; 12]) -> Self {
        let mut distortion = Self {
            coefficients,
            max_s: MAX_S,
        };
        let asymmetric = [2, 3, 8, 9, 10, 11].iter().any(|&i| coefficients[i] != 0.0);
        let directions = if asymmetric { 24 } else { 1 };
        for i in 0..directions {
            let (sin, cos) =
                libm::sincos(f64::from(i) / f64::from(directions) * std::f64::consts::TAU);
            distortion.max_s = distortion.first_fold([cos, sin]);
        }
        distortion
    }

    /// Returns the smallest s at which the map folds in one direction, or the current bound.
    fn first_fold(&self, [cos, sin]: [f64; 2]) -> f64 {
        let unfolded = |s: f64| {
            let r = s.sqrt();
            let [j00, j01, j10, j11] = self.jacobian(r * cos, r * sin);
            let [.., k4, k5, k6, _, _, _, _] = self.coefficients;
            1.0 + s * (k4 + s * (k5 + s * k6)) > 0.0
                && j00 + j11 > 0.0
                && j00 * j11 - j01 * j10 > 0.0
        };
        // On the axis the map is the identity. Search in steps of 2% of √s, then by bisection.
        let (mut low, mut high) = (0.0, 1e-4);
        while unfolded(high) {
            if high >= self.max_s {
                return self.max_s;
            }
            low = high;
            high = (high * 1.04).min(self.max_s);
        }
        for _ in 0..60 {
            let middle = 0.5 * (low + high);
            if unfolded(middle) {
                low = middle;
            } else {
                high = middle;
            }
        }
        low
    }
}

impl<R: Real> Distortion<R> {
    /// Returns the distortion with other coefficients and the same domain.
    pub(super) fn vary<S: Real>(&self, coefficients: [S; 12]) -> Distortion<S> {
        Distortion {
            coefficients,
            max_s: S::of(self.max_s.to_f64()),
        }
    }

    /// Returns the coefficients in OpenCV's order.
    pub(super) fn coefficients(&self) -> [R; 12] {
        self.coefficients
    }

    /// Returns the distorted coordinates, and whether the point lies in the domain.
    #[inline(always)]
    pub(super) fn distort(&self, a: R, b: R) -> ([R; 2], bool) {
        let [k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4] = self.coefficients;
        let (one, two) = (R::of(1.0), R::of(2.0));
        let s = a * a + b * b;
        let g = (one + s * (k1 + s * (k2 + s * k3))) / (one + s * (k4 + s * (k5 + s * k6)));
        (
            [
                a * g + two * p1 * a * b + p2 * (s + two * a * a) + s * (s1 + s * s2),
                b * g + p1 * (s + two * b * b) + two * p2 * a * b + s * (s3 + s * s4),
            ],
            s <= self.max_s,
        )
    }

    /// Returns ∂a'/∂a, ∂a'/∂b, ∂b'/∂a, ∂b'/∂b.
    fn jacobian(&self, a: R, b: R) -> [R; 4] {
        let [k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4] = self.coefficients;
        let (one, two, three, six) = (R::of(1.0), R::of(2.0), R::of(3.0), R::of(6.0));
        let s = a * a + b * b;
        let over = one + s * (k1 + s * (k2 + s * k3));
        let under = one + s * (k4 + s * (k5 + s * k6));
        let g = over / under;
        // dg/ds
        let slope = (k1 + s * (two * k2 + s * three * k3)
            - g * (k4 + s * (two * k5 + s * three * k6)))
            / under;
        let (prism_a, prism_b) = (two * (s1 + two * s2 * s), two * (s3 + two * s4 * s));
        [
            g + two * a * a * slope + two * p1 * b + six * p2 * a + prism_a * a,
            two * a * b * slope + two * p1 * a + two * p2 * b + prism_a * b,
            two * a * b * slope + two * p1 * a + two * p2 * b + prism_b * a,
            g + two * b * b * slope + six * p1 * b + two * p2 * a + prism_b * b,
        ]
    }

    /// Returns the point of the domain with the given distorted coordinates, by Newton's method, or
    /// `None` if there is none.
    pub(super) fn undistort(&self, target: [R; 2]) -> Option<[R; 2]> {
        let [mut a, mut b] = target;
        // Move a start outside the domain onto its border.
        let s = a * a + b * b;
        if s > self.max_s {
            let shrink = (self.max_s / s).sqrt();
            (a, b) = (a * shrink, b * shrink);
        }
        for _ in 0..50 {
            let ([da, db], _) = self.distort(a, b);
            let (ea, eb) = (da - target[0], db - target[1]);
            let [j00, j01, j10, j11] = self.jacobian(a, b);
            let determinant = j00 * j11 - j01 * j10;
            if !(determinant.abs() > R::of(1e-12)) {
                return None;
            }
            let (mut step_a, mut step_b) = (
                (j11 * ea - j01 * eb) / determinant,
                (j00 * eb - j10 * ea) / determinant,
            );
            // Far from the axis the slope is small and a full step may leave the domain: limit
            // steps to half the distance from the axis to the border.
            let step = (step_a * step_a + step_b * step_b).sqrt();
            let room = R::of(0.5) * (R::of(1e-3) + self.max_s.sqrt());
            if step > room {
                (step_a, step_b) = (step_a * room / step, step_b * room / step);
            }
            (a, b) = (a - step_a, b - step_b);
            // The step that converges still updates the derivatives of dual numbers. Without
            // distortion it is the first one.
            if step.to_f64() < 1e-15 {
                break;
            }
        }
        let ([da, db], inside) = self.distort(a, b);
        let (ea, eb) = (da - target[0], db - target[1]);
        let size = R::of(1.0) + (target[0] * target[0] + target[1] * target[1]).sqrt();
        let solved = (ea * ea + eb * eb).sqrt() < R::of(1e-6) * size;
        (solved && inside).then_some([a, b])
    }
}
