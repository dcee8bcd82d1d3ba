//! What is roughly known of a target before its filter starts: a Gaussian over position and velocity.

use nalgebra::{IsometryMatrix3, Matrix3, Point3, Vector3};

use crate::estimate::StateEstimate;
use pardalis_core::Error;

/// The farthest that a start may be from the world's origin along an axis, in metres, and its fastest speed, in m/s: single precision then
/// holds all that comes of it.
pub const MAX_START: f64 = 1e6;

/// Entries of a covariance that was rounded may be off by this share of the standard deviations' product.
const ROUNDING: f64 = 1e-5;
/// What is left of a variance below this share follows from rounding: the axis depends on those before it.
const DEPENDENT: f64 = 1e-12;

/// A Gaussian around a rough guess of the state (thesis 5.2), or around another robot's estimate.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct GaussianStart {
    /// Mean position in the world, metres.
    pub position_m: [f64; 3],
    /// Covariance of the position: xx, xy, xz, yy, yz, zz in m².
    pub covariance_m2: [f64; 6],
    /// Mean velocity, m/s.
    pub velocity_mps: [f64; 3],
    /// Standard deviation of the velocity an axis, m/s.
    pub velocity_sigma_mps: [f64; 3],
}

/// The covariance (xx, xy, xz, yy, yz, zz) of axes that know nothing of one another, from their standard deviations.
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

    /// Around an estimate. Estimates do not say how sure the velocity is: its standard deviation on each axis is the caller's.
    pub fn from_estimate(estimate: &StateEstimate, velocity_sigma_mps: f64) -> Self {
        Self {
            position_m: estimate.position_m,
            covariance_m2: estimate.covariance_m2,
            velocity_mps: estimate.velocity_mps.unwrap_or_default(),
            velocity_sigma_mps: [velocity_sigma_mps; 3],
        }
    }

    /// The same in another world: what one robot knows, told to another.
    #[must_use]
    pub fn moved(&self, world_from_other: &IsometryMatrix3<f64>) -> Self {
        let rotation = world_from_other.rotation.matrix();
        let [xx, xy, xz, yy, yz, zz] = self.covariance_m2;
        let covariance = Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz);
        let moved = rotation * covariance * rotation.transpose();
        let variances = Vector3::from(self.velocity_sigma_mps).map(|sigma| sigma * sigma);
        let velocity_variances = rotation.component_mul(rotation) * variances;
        Self {
            position_m: (world_from_other * Point3::from(self.position_m)).into(),
            covariance_m2: [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)].map(|at| moved[at]),
            velocity_mps: (rotation * Vector3::from(self.velocity_mps)).into(),
            velocity_sigma_mps: velocity_variances.map(f64::sqrt).into(),
        }
    }

    /// The same without vertical scatter and velocity.
    pub fn in_plane(mut self) -> Self {
        for vertical in [2, 4, 5] {
            self.covariance_m2[vertical] = 0.0;
        }
        self.velocity_mps[2] = 0.0;
        self.velocity_sigma_mps[2] = 0.0;
        self
    }

    /// Refuses numbers that are not finite or beyond 1e6, negative deviations, and what is no covariance.
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

    /// Refuses matrices that are not positive semidefinite: their factor does not make them up again.
    fn check_covariance(&self) -> Result<(), Error> {
        let wanted = self.covariance_m2;
        let refused = |allowed: &str| {
            let value = format!("{wanted:?}");
            Err(Error::out_of_range("covariance_m2", value, allowed))
        };
        let [xx, _, _, yy, _, zz] = wanted;
        let most = MAX_START * MAX_START;
        if !wanted.iter().all(|v| v.abs() <= most) || [xx, yy, zz].iter().any(|v| *v < 0.0) {
            return refused("[xx, xy, xz, yy, yz, zz] with xx, yy, zz of 0 to 1e12 m²");
        }
        let [a, b, c, d, e, f] = self.factor();
        let made = [
            a * a,
            a * b,
            a * c,
            b * b + d * d,
            b * c + d * e,
            c * c + e * e + f * f,
        ];
        let [sx, sy, sz] = [xx, yy, zz].map(f64::sqrt);
        let scales = [xx, sx * sy, sx * sz, yy, sy * sz, zz];
        let off = |i: usize| (made[i] - wanted[i]).abs() > ROUNDING * scales[i];
        if (0..6).any(off) {
            return refused(
                "[xx, xy, xz, yy, yz, zz] of a positive semidefinite matrix, one whose variance is nowhere negative, such as \
                 xy between -sqrt(xx·yy) and +sqrt(xx·yy)",
            );
        }
        Ok(())
    }

    /// The lower triangular factor L of the covariance L·Lᵀ, columns first: xx, yx, zx, yy, zy, zz (Cholesky). Axes that depend on others
    /// have no spread of their own.
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

    /// Makes positions, in metres, of three standard normal numbers each.
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

/// Refuses negative standard deviations and those beyond 1e6.
pub fn check_sigma(name: &str, values: [f64; 3]) -> Result<(), Error> {
    match values.iter().find(|v| !(0.0..=MAX_START).contains(*v)) {
        None => Ok(()),
        Some(value) => Err(Error::out_of_range(name, value, "0 to 1e6")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Rotation3, Translation3};

    fn with(covariance_m2: [f64; 6]) -> GaussianStart {
        GaussianStart {
            covariance_m2,
            ..GaussianStart::default()
        }
    }

    #[test]
    fn covariances_are_told_from_what_is_none() {
        for covariance_m2 in [
            [0.0; 6],
            [1.0, 0.0, 0.0, 2.0, 0.0, 3.0],
            // All on one line, as written with few digits, and a plane.
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
            // Each pair of axes is fine, the three are not.
            [1.0, 0.9, 0.9, 1.0, -0.9, 1.0],
            [1.0, 0.0, f64::NAN, 1.0, 0.0, 1.0],
            [f64::INFINITY, 0.0, 0.0, 1.0, 0.0, 1.0],
        ] {
            let error = with(covariance_m2).check().unwrap_err().to_string();
            assert!(error.starts_with("covariance_m2 is ["), "{error}");
        }
    }

    #[test]
    fn deviations_an_axis_are_used_as_they_are() {
        let sigma = [0.1, 0.07, 1.0 / 3.0];
        let sample = with(diagonal_m2(sigma)).sampler();
        assert_eq!(sample([1.0; 3]), sigma);
    }

    #[test]
    fn an_estimate_moves_with_the_pose() {
        // The other robot's x is our y, its y our −x; its origin is at (1, 2, 0.5).
        let world_from_other = IsometryMatrix3::from_parts(
            Translation3::new(1.0, 2.0, 0.5),
            Rotation3::from_matrix_unchecked(Matrix3::new(
                0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0,
            )),
        );
        let estimate = StateEstimate {
            position_m: [3.0, 1.0, 0.1],
            velocity_mps: Some([1.0, 0.0, -2.0]),
            covariance_m2: [0.04, 0.01, 0.002, 0.09, 0.003, 0.0025],
            best_position_m: [0.0; 3],
            effective_sample_size: 10.0,
        };
        let start = GaussianStart::from_estimate(&estimate, 0.3).moved(&world_from_other);
        let near = |a: &[f64], b: &[f64]| {
            let all_near = a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-12);
            assert!(all_near, "{a:?} {b:?}");
        };
        near(&start.position_m, &[0.0, 5.0, 0.6]);
        near(&start.velocity_mps, &[0.0, 1.0, -2.0]);
        let expected = [0.09, -0.01, -0.003, 0.04, 0.002, 0.0025];
        near(&start.covariance_m2, &expected);
        near(&start.velocity_sigma_mps, &[0.3; 3]);
        assert_eq!(start.check(), Ok(()));
    }
}
