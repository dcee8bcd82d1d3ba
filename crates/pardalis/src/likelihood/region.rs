//! The region cue: per-channel colour histograms of a region, compared with those of the target (Campos 2009,
//! section 3.2).

use super::patch::{Patch, PatchSettings, squared_distance};
use crate::color::{ChannelHistograms, ChannelTable, PixelKind};
use crate::frame::with_pixels;
use crate::shape::Shape;
use crate::view::PreparedFrame;
use pardalis_core::Error;
use pardalis_core::simd::Level;

/// The region cue of one target.
#[derive(Debug)]
pub(super) struct RegionCue {
    patch: Patch,
    /// Log-likelihood of the target's surroundings in the training images, or of a complete mismatch if these
    /// show only the target.
    background: f64,
    /// One table for each kind of pixels met so far.
    tables: Vec<(PixelKind, ChannelTable)>,
}

impl RegionCue {
    pub(super) fn new(
        settings: PatchSettings,
        shape: &Shape,
        channels: &ChannelHistograms,
        level: Level,
    ) -> Result<Self, Error> {
        let references = channels.shares(settings.bins);
        let distances = match channels.background_shares(settings.bins) {
            Some(background) => [0, 1, 2]
                .map(|channel| squared_distance(&references[channel], &background[channel])),
            None => [1.0; 3],
        };
        Ok(Self {
            background: settings.log_likelihood(distances.iter().sum()),
            patch: Patch::new(settings, shape, &references, level)?,
            tables: Vec::new(),
        })
    }

    pub(super) fn background_log_likelihood(&self) -> f64 {
        self.background
    }

    /// Adds one camera's log-likelihood of each particle.
    pub(super) fn add_camera(
        &mut self,
        prepared: &PreparedFrame,
        positions: [&[f32]; 3],
        out: &mut [f32],
    ) {
        let kind = PixelKind::of(prepared.frame());
        let known = self.tables.iter().position(|(known, _)| *known == kind);
        let number = known.unwrap_or_else(|| {
            let table = ChannelTable::new(kind, self.patch.settings().bins);
            self.tables.push((kind, table));
            self.tables.len() - 1
        });
        let table = &self.tables[number].1;
        with_pixels!(prepared.frame(), components => {
            self.patch.add(prepared.view(), positions, out, |x, y| table.bins(components(x, y)));
        });
    }
}
