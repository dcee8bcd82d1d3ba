//! The size of a ball: how it is weighed against the outlines when a position is fitted, and what the fit says of it.

/// The prior of a target's size: the logarithm of its scale relative to its shape. Its tails are heavy, those of a Cauchy distribution, so that
/// outlines that contradict a size overrule it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct SizePrior {
    /// The likeliest logarithm of the scale.
    pub(crate) log_scale: f64,
    /// Its standard deviation; 0 for a size that is certain.
    pub(crate) sigma: f64,
}

impl SizePrior {
    /// The likeliest scale.
    pub(crate) fn scale(&self) -> f64 {
        libm::exp(self.log_scale)
    }

    /// The logarithm of the density at a logarithm of the scale, relative to that of the likeliest one: 0 at most, -ln(1 + x²/2σ²).
    pub(crate) fn log_density(&self, log_scale: f64) -> f64 {
        let off = log_scale - self.log_scale;
        if off == 0.0 {
            return 0.0;
        }
        -libm::log1p(0.5 * (off / self.sigma).powi(2))
    }

    /// The inverse variance of the Gaussian around the likeliest scale that has the same slope there, 1/(σ² + x²/2).
    pub(crate) fn information(&self, log_scale: f64) -> f64 {
        let off = log_scale - self.log_scale;
        1.0 / (self.sigma * self.sigma + 0.5 * off * off)
    }

    /// The curvature of the logarithm of the density, downwards; 0 in the tails, where it bends the other way.
    pub(crate) fn curvature(&self, log_scale: f64) -> f64 {
        let (off, variance) = (log_scale - self.log_scale, self.sigma * self.sigma);
        let information = self.information(log_scale);
        information * information * (variance - 0.5 * off * off).max(0.0)
    }
}
