//! Cues: how likely the images are, given where a particle says the target is.

mod boundary;
mod contour;
mod cues;
mod difference;
pub(crate) mod edge;
mod outline;
mod patch;
mod raster;
mod region;
mod window;

pub use boundary::{Overlap, Sampling, ScaledSampling, SplineSampling};
pub use contour::ContourSettings;
pub use cues::{Cue, CueSettings, Cues, CuesLikelihood};
pub use edge::EdgeSettings;
pub use patch::PatchSettings;
pub use window::{WindowCounting, WindowSettings};

use crate::particles::Particles;

/// The seam between the filter and vision: one call a frame for all particles.
pub trait Likelihood {
    /// Writes the logarithm of each particle's likelihood, up to a constant that all share. Negative infinity means impossible; NaN counts as that.
    fn log_likelihoods(&mut self, particles: &Particles, out: &mut [f32]);
}
