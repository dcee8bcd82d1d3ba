//! Gaussian prior over position and velocity, from which a filter is initialised.

use nalgebra::{IsometryMatrix3, Point3, Vector3};

use crate::estimate::{StateEstimate, covariance_matrix};
use pardalis_core::Error;

/// Largest magnitude of an initial coordinate, in metres, and of an initial velocity component, in
/// m/s. It keeps all later computations within single precision.
pub const MAX_START: f64 = 1e6;

/// Tolerance for rounded entries of a covariance, relative to the product of the standard
/// deviations.
const ROUNDING: f64 = 1e-5;
/// A residual variance below this share of the whole is rounding noise: the axis depends linearly
/// on the previous ones.
const DEPENDENT: f64 = 1e-12;

/// Gaussian prior of a target's state: a rough guess (thesis 5.2) or the estimate of another robot.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct GaussianStart {
    /// Mean position in the world frame, in metres.
    pub position_m: [f64; 3],
    /// Covariance of the position in m²: xx, xy, xz, yy, yz, zz.
    pub covariance_m2: [f64; 6],
    /// Mean velocity in m/s.
    pub velocity_mps: [f64; 3],
    /// Standard deviation of the velocity per axis, in m/s.
    pub velocity_sigma_mps: [f64; 3],
}

/// Returns the covariance (xx, xy, xz, yy, yz, zz) of independent axes with the given standard
/// deviations.
pub const fn diagonal_m2([x, y, z]: [f64; 3]) -> [f64; 6] {
    [x * x, 0.0, 0.0, y * y, 0.0, z * z]
}

impl GaussianStart {
    /// The default standard deviation of the position on each axis, in metres.
    pub const POSITION_SIGMA_M: [f64; 3] = [0.1; 3];
    /// The default standard deviation of the velocity on each axis, in m/s.
    pub const VELOCITY_SIGMA_MPS: [f64; 3] = [0.5; 3];

    /// At rest around a position in metres, with the default deviations.
    pub const fn at(position_m: [f64; 3]) -> Self {
        Self {
            position_m,
            covariance_m2: diagonal_m2(Self::POSITION_SIGMA_M),
            velocity_mps: [0.0; 3],
            velocity_sigma_mps: Self::VELOCITY_SIGMA_MPS,
        }
    }

    /// Creates a prior from an estimate, without the correlations of its velocity. An estimate without a
    /// velocity is taken for one at rest, with the default deviations.
    pub fn from_estimate(estimate: &StateEstimate) -> Self {
        let variances = estimate
            .velocity_covariance_m2ps2
            .map(|[xx, _, _, yy, _, zz]| [xx, yy, zz]);
        Self {
            position_m: estimate.position_m,
            covariance_m2: estimate.covariance_m2,
            velocity_mps: estimate.velocity_mps.unwrap_or_default(),
            velocity_sigma_mps: variances.map_or(Self::VELOCITY_SIGMA_MPS, |variances| {
                variances.map(f64::sqrt)
            }),
        }
    }

    /// Transforms the prior to another world frame, for example to pass one robot's estimate to
    /// another.
    #[must_use]
    pub fn moved(&self, world_from_other: &IsometryMatrix3<f64>) -> Self {
        let rotation = world_from_other.rotation.matrix();
        let moved = rotation * covariance_matrix(self.covariance_m2) * rotation.transpose();
        let variances = Vector3::from(self.velocity_sigma_mps).map(|sigma| sigma * sigma);
        let velocity_variances = rotation.component_mul(rotation) * variances;
        Self {
            position_m: (world_from_other * Point3::from(self.position_m)).into(),
            covariance_m2: [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)].map(|at| moved[at]),
            velocity_mps: (rotation * Vector3::from(self.velocity_mps)).into(),
            velocity_sigma_mps: velocity_variances.map(f64::sqrt).into(),
        }
    }

    /// Returns the prior without vertical spread and vertical velocity.
    pub fn in_plane(mut self) -> Self {
        for vertical in [2, 4, 5] {
            self.covariance_m2[vertical] = 0.0;
        }
        self.velocity_mps[2] = 0.0;
        self.velocity_sigma_mps[2] = 0.0;
        self
    }

    /// Checks that all numbers are finite and at most 1e6 in magnitude, the standard deviations are
    /// not negative and the covariance is positive semidefinite.
    pub fn check(&self) -> Result<(), Error> {
        for (name, values) in [
            ("position_m", self.position_m),
            ("velocity_mps", self.velocity_mps),
        ] {
            if let Some(value) = values.iter().find(|v| !(v.abs() <= MAX_START)) {
                return Err(Error::out_of_range(
                    name,
                    value,
                    "numbers between -1e6 and 1e6",
                ));
            }
        }
        check_sigma("velocity_sigma_mps", self.velocity_sigma_mps)?;
        self.check_covariance()
    }

    /// Rejects matrices that are not positive semidefinite: their Cholesky factor does not
    /// reproduce them.
    fn check_covariance(&self) -> Result<(), Error> {
        let covariance = self.covariance_m2;
        let reject = |allowed: &str| {
            let value = format!("{covariance:?}");
            Err(Error::out_of_range("covariance_m2", value, allowed))
        };
        let [xx, _, _, yy, _, zz] = covariance;
        let most = MAX_START * MAX_START;
        if !covariance.iter().all(|v| v.abs() <= most) || [xx, yy, zz].iter().any(|v| *v < 0.0) {
            return reject("[xx, xy, xz, yy, yz, zz] with xx, yy, zz of 0 to 1e12 m²");
        }
        let [a, b, c, d, e, f] = self.factor();
        let product = [
            a * a,
            a * b,
            a * c,
            b * b + d * d,
            b * c + d * e,
            c * c + e * e + f * f,
        ];
        let [sx, sy, sz] = [xx, yy, zz].map(f64::sqrt);
        let scales = [xx, sx * sy, sx * sz, yy, sy * sz, zz];
        let off = |i: usize| (product[i] - covariance[i]).abs() > ROUNDING * scales[i];
        if (0..6).any(off) {
            return reject(
                "[xx, xy, xz, yy, yz, zz] of a positive semidefinite matrix: for example, xy must lie between \
                 -sqrt(xx·yy) and +sqrt(xx·yy)",
            );
        }
        Ok(())
    }

    /// Returns the lower triangular Cholesky factor L of the covariance L·Lᵀ by columns: xx, yx,
    /// zx, yy, zy, zz. Axes that depend linearly on previous ones have no spread of their own.
    fn factor(&self) -> [f64; 6] {
        let [xx, xy, xz, yy, yz, zz] = self.covariance_m2;
        let root = |left: f64, whole: f64| {
            if left > DEPENDENT * whole {
                left.sqrt()
            } else {
                0.0
            }
        };
        let over = |value: f64, root: f64| if root > 0.0 { value / root } else { 0.0 };
        let a = root(xx, xx);
        let (b, c) = (over(xy, a), over(xz, a));
        let d = root(yy - b * b, yy);
        let e = over(yz - b * c, d);
        let f = root(zz - c * c - e * e, zz);
        [a, b, c, d, e, f]
    }

    /// Returns a function that converts three standard normal numbers to a position, in metres.
    pub fn sampler(&self) -> impl Fn([f64; 3]) -> [f64; 3] + use<> {
        let [a, b, c, d, e, f] = self.factor();
        let mean = self.position_m;
        move |[x, y, z]| {
            [
                mean[0] + a * x,
                mean[1] + (b * x + d * y),
                mean[2] + (c * x + e * y + f * z),
            ]
        }
    }
}

/// Rejects standard deviations that are negative or above 1e6.
pub fn check_sigma(name: &str, values: [f64; 3]) -> Result<(), Error> {
    match values.iter().find(|v| !(0.0..=MAX_START).contains(*v)) {
        None => Ok(()),
        Some(value) => Err(Error::out_of_range(name, value, "0 to 1e6")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Matrix3, Rotation3, Translation3};

    fn with(covariance_m2: [f64; 6]) -> GaussianStart {
        GaussianStart {
            covariance_m2,
            ..GaussianStart::default()
        }
    }

    #[test]
    fn only_positive_semidefinite_covariances_are_accepted() {
        for covariance_m2 in [
            [0.0; 6],
            [1.0, 0.0, 0.0, 2.0, 0.0, 3.0],
            // Rank one, rounded to few digits; and rank two.
            [0.01, 0.02, -0.03, 0.04, -0.06, 0.09],
            [0.0, 0.0, 0.0, 4.0, 1.0, 1.0],
            [1e-8, 9e-6, 0.0, 1e-2, 0.0, 1e4],
        ] {
            assert_eq!(with(covariance_m2).check(), Ok(()), "{covariance_m2:?}");
        }
        for covariance_m2 in [
            [-1.0, 0.0, 0.0, 1.0, 0.0, 1.0],
            [1.0, 1.1, 0.0, 1.0, 0.0, 1.0],
            [0.0, 0.1, 0.0, 1.0, 0.0, 1.0],
            // Each pair of axes is consistent, but the three together are not.
            [1.0, 0.9, 0.9, 1.0, -0.9, 1.0],
            [1.0, 0.0, f64::NAN, 1.0, 0.0, 1.0],
            [f64::INFINITY, 0.0, 0.0, 1.0, 0.0, 1.0],
        ] {
            let error = with(covariance_m2).check().unwrap_err().to_string();
            assert!(error.starts_with("covariance_m2 is ["), "{error}");
        }
    }

    #[test]
    fn diagonal_covariances_are_sampled_without_rounding() {
        let sigma = [0.1, 0.07, 1.0 / 3.0];
        let sample = with(diagonal_m2(sigma)).sampler();
        assert_eq!(sample([1.0; 3]), sigma);
    }

    #[test]
    fn an_estimate_is_transformed_by_the_pose() {
        // The other robot's x axis is our y, its y axis our −x; its origin is at (1, 2, 0.5).
        let world_from_other = IsometryMatrix3::from_parts(
            Translation3::new(1.0, 2.0, 0.5),
            Rotation3::from_matrix_unchecked(Matrix3::new(
                0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0,
            )),
        );
        let estimate = StateEstimate {
            position_m: [3.0, 1.0, 0.1],
            velocity_mps: Some([1.0, 0.0, -2.0]),
            velocity_covariance_m2ps2: Some([0.16, 0.05, 0.0, 0.09, -0.02, 0.25]),
            covariance_m2: [0.04, 0.01, 0.002, 0.09, 0.003, 0.0025],
            best_position_m: [0.0; 3],
            effective_sample_size: 10.0,
        };
        let start = GaussianStart::from_estimate(&estimate).moved(&world_from_other);
        let near = |a: &[f64], b: &[f64]| {
            let all_near = a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-12);
            assert!(all_near, "{a:?} {b:?}");
        };
        near(&start.position_m, &[0.0, 5.0, 0.6]);
        near(&start.velocity_mps, &[0.0, 1.0, -2.0]);
        let expected = [0.09, -0.01, -0.003, 0.04, 0.002, 0.0025];
        near(&start.covariance_m2, &expected);
        near(&start.velocity_sigma_mps, &[0.3, 0.4, 0.5]);
        assert_eq!(start.check(), Ok(()));
        let at_rest = GaussianStart::from_estimate(&StateEstimate {
            velocity_mps: None,
            velocity_covariance_m2ps2: None,
            ..estimate
        });
        assert_eq!(at_rest.velocity_mps, [0.0; 3]);
        assert_eq!(
            at_rest.velocity_sigma_mps,
            GaussianStart::VELOCITY_SIGMA_MPS
        );
    }
}
