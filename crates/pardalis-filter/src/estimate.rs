//! What a filter estimates at one instant.

/// Mean, covariance and best particle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StateEstimate {
    /// Weighted mean of the position in the world, metres.
    pub position_m: [f64; 3],
    /// Weighted mean of the velocity, m/s, where the motion model has one.
    pub velocity_mps: Option<[f64; 3]>,
    /// Covariance of the position: xx, xy, xz, yy, yz, zz in m².
    pub covariance_m2: [f64; 6],
    /// The position of the particle of the greatest weight, metres.
    pub best_position_m: [f64; 3],
    /// Effective sample size, 1/Σw².
    pub effective_sample_size: f64,
}
