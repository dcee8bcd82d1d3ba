//! Patches: the colours of an image around an outline, converted once for all rounds of a fit.

use super::EdgeFrame;
use super::frame::Octave;

/// How far a patch reaches beyond the pixels that are asked for, in pixels of the octave. Hand-set: outlines seldom move farther during a fit.
const MARGIN_PX: usize = 4;

/// Larger patches are not kept: most of their pixels are far from the outline. Hand-set: 2 MiB.
const MAX_PIXELS: usize = 1 << 17;

/// What is known of a pixel.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Known {
    /// It has not been looked at.
    Nothing,
    /// Part of it is masked.
    Masked,
    /// Its mean colour (Y, U and V), and whether most of it is in the target's colours.
    Color([f32; 3], bool),
}

/// A part of an octave of one camera's frame. Its buffer is kept.
#[derive(Debug, Default)]
pub(super) struct Patch {
    octave: Octave,
    columns: std::ops::Range<usize>,
    rows: std::ops::Range<usize>,
    pixels: Vec<Known>,
}

impl Patch {
    /// Pixels that there is room for in advance. Hand-set: enough for outlines of the octaves in which they are judged.
    const PIXELS: usize = 8192;

    pub(super) fn with_room() -> Self {
        Self {
            pixels: Vec::with_capacity(Self::PIXELS),
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
        self.pixels.clear();
        let count = self.columns.len() * self.rows.len();
        if count <= MAX_PIXELS {
            self.pixels.resize(count, Known::Nothing);
        }
    }

    /// The mean colour of a pixel that is covered (Y, U and V) and whether most of it is in the target's colours; `None` if part of it is masked.
    #[inline(always)]
    pub(super) fn pixel(
        &mut self,
        frame: &EdgeFrame,
        column: usize,
        row: usize,
    ) -> Option<([f32; 3], bool)> {
        if self.pixels.is_empty() {
            return frame.pixel(self.octave, column, row);
        }
        let at = (row - self.rows.start) * self.columns.len() + (column - self.columns.start);
        match self.pixels[at] {
            Known::Color(yuv, matches) => Some((yuv, matches)),
            Known::Masked => None,
            Known::Nothing => {
                let seen = frame.pixel(self.octave, column, row);
                self.pixels[at] =
                    seen.map_or(Known::Masked, |(yuv, matches)| Known::Color(yuv, matches));
                seen
            }
        }
    }
}
