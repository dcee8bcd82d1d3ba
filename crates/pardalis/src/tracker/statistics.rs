//! Statistics of a camera's image that do not depend on the target, computed once per frame for all targets.

use crate::color::{IlluminationCorrection, Palette};
use crate::detect::{BinCounts, mean_color, sampling_step_px};
use crate::view::PreparedFrame;
use pardalis_core::simd::Level;

/// Statistics of one camera's latest image. Owns its buffers.
#[derive(Debug, Default)]
pub(super) struct ImageStatistics {
    /// Counts of bins, by palette and illumination correction; the first `count` hold for the latest image.
    bins: Vec<(Palette, IlluminationCorrection, BinCounts)>,
    count: usize,
    mean_color: Option<[f32; 3]>,
    level: Level,
}

impl ImageStatistics {
    pub(super) fn new(level: Level) -> Self {
        Self {
            level,
            ..Self::default()
        }
    }

    /// Discards the statistics of the previous image.
    pub(super) fn clear(&mut self) {
        self.count = 0;
        self.mean_color = None;
    }

    /// Returns how often each bin of a palette occurs in the image after illumination correction. Counts some
    /// of its pixels, on a grid.
    pub(super) fn bin_counts(
        &mut self,
        prepared: &PreparedFrame,
        palette: Palette,
        correction: &IlluminationCorrection,
    ) -> &BinCounts {
        let is_it = |(of, by, _): &(Palette, IlluminationCorrection, BinCounts)| {
            (of, by) == (&palette, correction)
        };
        let number = match self.bins[..self.count].iter().position(is_it) {
            Some(number) => number,
            None => self.add(prepared, palette, correction),
        };
        &self.bins[number].2
    }

    fn add(
        &mut self,
        prepared: &PreparedFrame,
        palette: Palette,
        correction: &IlluminationCorrection,
    ) -> usize {
        if self.bins.len() == self.count {
            self.bins.push((palette, *correction, BinCounts::default()));
        }
        let (of, by, counts) = &mut self.bins[self.count];
        (*of, *by) = (palette, *correction);
        let step_px = sampling_step_px(prepared.frame());
        counts.count(prepared, palette, correction, (step_px, self.level));
        self.count += 1;
        self.count - 1
    }

    /// Returns the mean Y, U and V of the image.
    pub(super) fn mean_color(&mut self, prepared: &PreparedFrame) -> [f32; 3] {
        *self
            .mean_color
            .get_or_insert_with(|| mean_color(prepared, sampling_step_px(prepared.frame())))
    }
}
