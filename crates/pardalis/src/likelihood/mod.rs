//! Cues: the likelihood of the images given a particle's hypothesis of the target's position.

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

pub use boundary::{Sampling, ScaledSampling, SharedPixels, SplineSampling};
pub use contour::ContourSettings;
pub use cues::{Cue, CueSettings, Cues, CuesLikelihood};
pub use edge::EdgeSettings;
pub use patch::PatchSettings;
pub use window::{WindowCounting, WindowSettings};
