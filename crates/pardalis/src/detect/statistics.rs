//! Statistics of the colours of an image, on a grid of its pixels.

use crate::Frame;
use crate::color::{ColorModel, IlluminationCorrection, Palette, PixelKind};
use crate::frame::{Row, with_pixels};
use crate::view::PreparedFrame;
use pardalis_camera::Mask;
use pardalis_core::simd::Level;

/// The least distance between the rows and columns whose pixels image statistics sample, pixels. Hand-set: 640 x 480 pixels still give 19 200 samples. All targets share the
/// statistics.
const LEAST_SAMPLING_STEP_PX: usize = 4;
/// About the greatest number of samples. Hand-set: more say little else of an image, and take time.
const MAX_SAMPLES: usize = 40_000;
/// How often each bin of a palette occurs in an image.
#[derive(Debug, Clone, Default)]
pub(crate) struct BinCounts {
    counts: Vec<u64>,
    total: u64,
    /// Pixels of a row of the image.
    row: Row,
}

impl BinCounts {
    /// Counts the bins of every `step_px`th unmasked pixel of every `step_px`th row, after illumination correction.
    ///
    /// Panics if the frame was not prepared for the palette ([`View::prepare`](crate::view::View::prepare)).
    pub(crate) fn count(
        &mut self,
        prepared: &PreparedFrame,
        palette: Palette,
        correction: &IlluminationCorrection,
        (step_px, level): (usize, Level),
    ) {
        let frame = prepared.frame();
        let table = prepared.table(palette);
        let (width, height) = (frame.width(), frame.height());
        let open = prepared.view().mask().map(Mask::open);
        self.counts.clear();
        self.counts.resize(palette.bin_count(), 0);
        self.total = 0;
        let Self { counts, total, row } = self;
        level.run(
            #[inline(always)]
            || {
                for y in (0..height).step_by(step_px) {
                    row.sample(frame, y, step_px);
                    correction.row(row);
                    let [first, second, third] = row.components();
                    let pixels = first.iter().zip(second).zip(third);
                    let bins = pixels.map(|((a, b), c)| usize::from(table.bin([*a, *b, *c])));
                    if let Some(open) = open {
                        let open = open[y * width..][..width].iter().step_by(step_px);
                        for (bin, _) in bins.zip(open).filter(|(_, is_open)| **is_open) {
                            counts[bin] += 1;
                            *total += 1;
                        }
                    } else {
                        *total += first.len() as u64;
                        bins.for_each(|bin| counts[bin] += 1);
                    }
                }
            },
        );
    }

    /// Writes the colour posterior of each bin: t / (t + f), with the shares t of the target's pixels and f of the image's pixels in the bin.
    ///
    /// No model of the background is needed (ratio histogram; Swain and Ballard 1991).
    pub(crate) fn color_posterior(&self, colors: &ColorModel, posterior: &mut Vec<f64>) {
        let of_bin = |(&share, &count): (&f64, &u64)| {
            let of_image = count as f64 / self.total.max(1) as f64;
            if share > 0.0 {
                share / (share + of_image)
            } else {
                0.0
            }
        };
        let shares = colors.histogram().shares();
        posterior.clear();
        posterior.extend(shares.iter().zip(&self.counts).map(of_bin));
    }
}

/// Returns the distance between the rows and columns whose pixels image statistics sample, pixels.
pub(crate) fn sampling_step_px(frame: &Frame) -> usize {
    let pixels = frame.width() * frame.height();
    let enough = (pixels as f64 / MAX_SAMPLES as f64).sqrt().ceil() as usize;
    enough.max(LEAST_SAMPLING_STEP_PX)
}

/// Returns the mean Y, U and V of an image's unmasked pixels, of every `step_px`th pixel of every `step_px`th row.
pub(crate) fn mean_color(prepared: &PreparedFrame, step_px: usize) -> [f32; 3] {
    let frame = prepared.frame();
    let (width, height) = (frame.width(), frame.height());
    let open = prepared.view().mask().map(Mask::open);
    let (mut sums, mut count) = ([0_u64; 3], 0_u64);
    with_pixels!(frame, components => for y in (0..height).step_by(step_px) {
        for x in (0..width).step_by(step_px) {
            if open.is_none_or(|open| open[y * width + x]) {
                let bytes = components(x, y);
                (0..3).for_each(|i| sums[i] += u64::from(bytes[i]));
                count += 1;
            }
        }
    });
    let mean = sums.map(|sum| sum as f64 / count.max(1) as f64);
    PixelKind::of(frame).full_range_yuv_of_mean(mean)
}
