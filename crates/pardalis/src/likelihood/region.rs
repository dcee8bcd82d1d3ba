//! The colours of a region, channel by channel, against those of the target (Campos 2009, section 3.2).

use super::patch::{Patch, PatchSettings, squared_distance};
use crate::Error;
use crate::color::ChannelHistograms;
use crate::frame::{PixelFormat, with_pixels};
use crate::shape::Shape;
use crate::simd::Level;
use crate::view::Evidence;

/// The region cue of one target.
#[derive(Debug)]
pub(super) struct RegionCue {
    patch: Patch,
    /// The log-likelihood of the pixels around the target that its colours were learnt beside.
    background: f64,
}

impl RegionCue {
    pub(super) fn new(
        settings: PatchSettings,
        shape: &Shape,
        channels: &ChannelHistograms,
        level: Level,
    ) -> Result<Self, Error> {
        settings.check()?;
        let references = channels.shares(settings.bins);
        let distances = references
            .iter()
            .zip(channels.background_shares(settings.bins))
            .map(|(reference, background)| squared_distance(reference, &background));
        Ok(Self {
            background: settings.log_likelihood(distances.sum()),
            patch: Patch::new(settings, shape, &references, level)?,
        })
    }

    pub(super) fn background_log_likelihood(&self) -> f64 {
        self.background
    }

    /// Adds what one camera says of each particle.
    pub(super) fn add_camera(
        &mut self,
        evidence: &Evidence,
        positions: [&[f32]; 3],
        out: &mut [f32],
    ) {
        let (view, frame) = (evidence.view(), evidence.frame());
        let shift = 8 - self.patch.settings().bins.ilog2();
        let encoding = frame.encoding();
        with_pixels!(frame, components => {
            if frame.format() == PixelFormat::Rgb8 {
                self.patch.add(view, positions, out, |x, y| components(x, y).map(|v| v >> shift));
            } else {
                self.patch.add(view, positions, out, |x, y| {
                    encoding.rgb8_from_yuv(components(x, y)).map(|v| v >> shift)
                });
            }
        });
    }
}
