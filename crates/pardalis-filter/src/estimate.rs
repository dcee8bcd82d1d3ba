//! State estimate of a filter at one instant.

use nalgebra::Matrix3;

/// Returns the matrix of a covariance that is listed as xx, xy, xz, yy, yz, zz.
pub fn covariance_matrix([xx, xy, xz, yy, yz, zz]: [f64; 6]) -> Matrix3<f64> {
    Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz)
}

/// Mean, covariance and best particle at one instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StateEstimate {
    /// Weighted mean of the position in the world frame, in metres.
    pub position_m: [f64; 3],
    /// Weighted mean of the velocity in m/s. `None` if the motion model has no velocity.
    pub velocity_mps: Option<[f64; 3]>,
    /// Covariance of the velocity in m²/s²: xx, xy, xz, yy, yz, zz. `None` if the motion model has no velocity.
    pub velocity_covariance_m2ps2: Option<[f64; 6]>,
    /// Covariance of the position in m²: xx, xy, xz, yy, yz, zz.
    pub covariance_m2: [f64; 6],
    /// Position of the best particle, metres (thesis eq. 5.4).
    ///
    /// [`ParticleFilter`](crate::particle_filter::ParticleFilter): the particle with the greatest weight, which is
    /// the most likely one if the filter resamples at every step, as published.
    /// [`BernoulliFilter`](crate::bernoulli::BernoulliFilter): the particle with the greatest likelihood ratio in the
    /// last update. Its greatest weight would not do, because weights are corrected for the proposal and are greatest
    /// where the proposal rarely draws.
    pub best_position_m: [f64; 3],
    /// Effective sample size, 1/Σw².
    pub effective_sample_size: f64,
}
