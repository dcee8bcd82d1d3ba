//! Patches: the colours of an image around an outline, converted once for all rounds of a fit.

use super::EdgeFrame;
use super::frame::{CHUNK, Octave, OctavePixel};
use pardalis_core::simd::Level;

/// How far a patch reaches beyond the pixels that are asked for, in pixels of the octave. Hand-set: outlines seldom move farther during a fit.
const MARGIN_PX: usize = 4;

/// There is room for this many pixels; those of larger patches, most of which are far from the outline, are not kept. Hand-set: half a MiB.
const MAX_PIXELS: usize = 1 << 15;

/// A part of an octave of one camera's frame. Its buffers are kept.
#[derive(Debug, Default)]
pub(super) struct Patch {
    octave: Octave,
    columns: std::ops::Range<usize>,
    rows: std::ops::Range<usize>,
    /// Row by row, in chunks.
    pixels: Vec<[OctavePixel; CHUNK]>,
    /// Whether each chunk has been converted.
    converted: Vec<bool>,
}

impl Patch {
    pub(super) fn with_room() -> Self {
        Self {
            pixels: Vec::with_capacity(MAX_PIXELS / CHUNK),
            converted: Vec::with_capacity(MAX_PIXELS / CHUNK),
            ..Self::default()
        }
    }

    /// Forgets all pixels: those of another frame follow.
    pub(super) fn clear(&mut self) {
        self.columns = 0..0;
        self.rows = 0..0;
    }

    /// Makes sure that the pixels in these columns and rows of an octave can be asked for.
    pub(super) fn cover(
        &mut self,
        (octave, (width, height)): (Octave, (usize, usize)),
        columns: &std::ops::Range<usize>,
        rows: &std::ops::Range<usize>,
    ) {
        let holds = |outer: &std::ops::Range<usize>, inner: &std::ops::Range<usize>| {
            outer.start <= inner.start && inner.end <= outer.end
        };
        if self.octave == octave && holds(&self.columns, columns) && holds(&self.rows, rows) {
            return;
        }
        let widened = |range: &std::ops::Range<usize>, size: usize| {
            range.start.saturating_sub(MARGIN_PX)..(range.end + MARGIN_PX).min(size)
        };
        self.octave = octave;
        self.columns = widened(columns, width);
        self.rows = widened(rows, height);
        let chunks = self.chunks_a_row() * self.rows.len();
        self.converted.clear();
        if chunks * CHUNK <= MAX_PIXELS {
            self.converted.resize(chunks, false);
            // What they held before is not read.
            self.pixels.resize(chunks, [[0.0; 4]; CHUNK]);
        }
    }

    fn chunks_a_row(&self) -> usize {
        self.columns.len().div_ceil(CHUNK)
    }

    /// The mean colour of a pixel that is covered (Y, U and V) and whether most of it is in the target's colours; `None` if part of it is masked.
    #[inline(always)]
    pub(super) fn pixel(
        &mut self,
        (frame, level): (&EdgeFrame, Level),
        column: usize,
        row: usize,
    ) -> Option<([f32; 3], bool)> {
        let known = if self.converted.is_empty() {
            frame.pixels(level, self.octave, [column, row], 1)[0]
        } else {
            let [column, row] = [column - self.columns.start, row - self.rows.start];
            let (number, at) = (row * self.chunks_a_row() + column / CHUNK, column % CHUNK);
            if !self.converted[number] {
                self.pixels[number] = self.convert(frame, level, [column - at, row]);
                self.converted[number] = true;
            }
            self.pixels[number][at]
        };
        let [y, u, v, matches] = known;
        (!matches.is_nan()).then_some(([y, u, v], matches == 1.0))
    }

    /// Converts the chunk that begins at a pixel of the patch.
    #[inline(never)]
    fn convert(
        &self,
        frame: &EdgeFrame,
        level: Level,
        [column, row]: [usize; 2],
    ) -> [OctavePixel; CHUNK] {
        let count = CHUNK.min(self.columns.len() - column);
        let place = [self.columns.start + column, self.rows.start + row];
        frame.pixels(level, self.octave, place, count)
    }
}
