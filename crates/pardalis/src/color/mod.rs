//! Colour: what pixels mean, bins, histograms, and colour models learnt from labelled pixels.

mod space;

pub use space::{YuvEncoding, YuvMatrix, YuvRange, hsi_from_rgb};
