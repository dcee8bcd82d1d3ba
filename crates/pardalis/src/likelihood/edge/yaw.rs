//! The yaw of a body that is not round: how it is weighed against the outlines when a position is fitted.

/// The prior of a target's yaw: a Gaussian.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct YawPrior {
    /// The likeliest yaw, radians. Not wrapped: angles beyond half a turn from it are never considered.
    pub(crate) yaw_rad: f64,
    /// Its standard deviation, radians.
    pub(crate) sigma_rad: f64,
}

impl YawPrior {
    /// Its inverse variance, 1/rad².
    pub(crate) fn information(&self) -> f64 {
        self.sigma_rad.powi(-2)
    }

    /// The logarithm of the density at a yaw, relative to that of the likeliest one: 0 at most.
    pub(crate) fn log_density(&self, yaw_rad: f64) -> f64 {
        let off = yaw_rad - self.yaw_rad;
        -0.5 * off * off * self.information()
    }
}
