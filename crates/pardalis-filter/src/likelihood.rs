//! The seam between a filter and what it observes.

use crate::Particles;

/// How likely an observation is, given each particle's state: one call per observation for all particles.
pub trait Likelihood {
    /// Writes the logarithm of each particle's likelihood, up to a constant that all share. Negative infinity means impossible; NaN counts as
    /// impossible, too.
    fn log_likelihoods(&mut self, particles: &Particles, out: &mut [f32]);
}
