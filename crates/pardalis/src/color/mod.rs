//! Colour: pixel encodings, histogram bins, 3D and per-channel histograms, illumination, edge profiles, and
//! colour models learnt from labelled pixels.

mod body_colors;
mod box_labels;
mod channels;
mod edge_learner;
mod edge_profile;
mod histogram;
mod illumination;
mod membership;
mod model;
mod outline_distance;
mod palette;
mod ranges;

pub use crate::color_space::{YuvEncoding, YuvMatrix, YuvRange, hsi_from_rgb};
pub use body_colors::BodyColors;
pub use channels::{ChannelBins, ChannelHistograms, ChannelTable};
pub(crate) use edge_learner::{COARSEST_OCTAVE, JUDGED_RADIUS_PX};
pub use edge_profile::{EdgeLogRatios, EdgeProfile};
pub use histogram::Histogram;
pub use illumination::{Illumination, IlluminationCorrection};
pub(crate) use membership::CHANNEL_WEIGHTS;
pub use membership::{EdgePixel, LocalColors, Side, Surroundings};
pub use model::{ColorLearner, ColorModel, Separation};
pub use palette::{MAX_BINS, MAX_CHANNEL_BINS, Palette, PixelKind, PixelTable};
pub use ranges::{ColorRanges, MatchTable};
