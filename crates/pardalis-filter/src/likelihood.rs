//! Interface between a filter and its observations.

use crate::Particles;

/// Likelihood of an observation given the state of each particle.
///
/// The filter calls it once per observation, for all particles at once.
pub trait Likelihood {
    /// Writes the log-likelihood of each particle to `out`, up to a constant common to all
    /// particles. Negative infinity and NaN mean that the observation is impossible.
    fn log_likelihoods(&mut self, particles: &Particles, out: &mut [f32]);
}
