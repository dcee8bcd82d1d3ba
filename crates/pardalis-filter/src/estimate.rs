//! State estimate of a filter at one instant.

/// Mean, covariance and best particle at one instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StateEstimate {
    /// Weighted mean of the position in the world frame, in metres.
    pub position_m: [f64; 3],
    /// Weighted mean of the velocity in m/s. `None` if the motion model has no velocity.
    pub velocity_mps: Option<[f64; 3]>,
    /// Covariance of the position in m²: xx, xy, xz, yy, yz, zz.
    pub covariance_m2: [f64; 6],
    /// Position of the particle with the largest weight, in metres.
    pub best_position_m: [f64; 3],
    /// Effective sample size, 1/Σw².
    pub effective_sample_size: f64,
}
