//! Colour: what pixels mean, bins, histograms in all three dimensions or a channel, and colour models learnt from labelled pixels.

mod channels;
mod histogram;
mod model;
mod palette;
mod ranges;
mod space;

pub use channels::{ChannelBins, ChannelHistograms, ChannelTable};
pub use histogram::Histogram;
pub use model::{ColorLearner, ColorModel, Separation};
pub use palette::{MAX_BINS, MAX_CHANNEL_BINS, Palette, PixelKind, PixelTable};
pub use ranges::{ColorRanges, MatchTable};
pub use space::{YuvEncoding, YuvMatrix, YuvRange, hsi_from_rgb};
