//! What a camera at rest shows without what moves: the running mean of its images, and what differs from it.

use crate::Frame;
use crate::color::{CHANNEL_WEIGHTS, PixelKind};
use crate::frame::Row;
use crate::tuning::BackgroundTuning;
use crate::view::PreparedFrame;
use pardalis_camera::Mask;
use pardalis_core::simd::Level;

/// The greatest number of blocks in a row. Hand-set: streaks are much longer, and the mean of a block has less noise.
const COLUMNS: usize = 320;
/// Shares of the target in mixtures with what is there without it. Hand-set: streaks up to twice as long as the target.
const SHARES: [f32; 5] = [1.0, 0.75, 0.55, 0.4, 0.3];
/// How much the whole image has changed is measured on every 31st block. Derivation: most images then give at least a thousand samples. A step that divides the number
/// of columns would sample the same few columns in every row.
const SAMPLING_STEP: usize = 31;

/// The background of one camera's images, in blocks of pixels. Owns its buffers.
#[derive(Debug, Default)]
pub(crate) struct Background {
    tuning: BackgroundTuning,
    level: Level,
    block_px: usize,
    /// Columns and rows of blocks.
    size: (usize, usize),
    /// The mean raw bytes of each block in the latest image, and in those before it: the first, second and third apart. Blocks with masked pixels are NaN.
    latest: [Vec<f32>; 3],
    before: [Vec<f32>; 3],
    /// The kind of the raw bytes, and how Y, U and V change with each of them.
    kind: Option<PixelKind>,
    yuv_per_byte: [[f32; 3]; 3],
    /// The number of images.
    count: usize,
    samples: Vec<f32>,
    /// A row of the image, and the sums of a row of blocks in each of its columns.
    row: Row,
    columns: [Vec<u16>; 3],
    /// From this difference on a block has changed; `None` if most of the image has.
    threshold: Option<f32>,
}

/// The colours of a block that has changed: means of raw bytes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Change {
    now: [f32; 3],
    before: [f32; 3],
}

impl Change {
    /// Whether the block is a mixture of what was there before and one of the target's colours, given as raw bytes.
    pub(crate) fn is_mixture(&self, is_target: impl Fn([u8; 3]) -> bool) -> bool {
        SHARES.iter().any(|share| {
            let unmixed = |i: usize| self.before[i] + (self.now[i] - self.before[i]) / share;
            let bytes = [0, 1, 2].map(unmixed);
            bytes.iter().all(|value| (0.0..=255.0).contains(value))
                && is_target(bytes.map(|value| (value + 0.5) as u8))
        })
    }
}

impl Background {
    pub(crate) fn new(tuning: BackgroundTuning, level: Level) -> Self {
        Self {
            tuning,
            level,
            ..Self::default()
        }
    }

    /// The length of the sides of blocks, pixels.
    pub(crate) fn block_px(&self) -> usize {
        self.block_px
    }

    /// Columns and rows of blocks.
    pub(crate) fn size(&self) -> (usize, usize) {
        self.size
    }

    /// Whether no pixel of a block is masked.
    pub(crate) fn is_open(&self, block: usize) -> bool {
        !self.latest[0][block].is_nan()
    }

    /// Compares an image with those before it.
    pub(crate) fn compare(&mut self, prepared: &PreparedFrame) {
        let frame = prepared.frame();
        let block_px = frame.width().div_ceil(COLUMNS);
        let size = (frame.width() / block_px, frame.height() / block_px);
        let kind = PixelKind::of(frame);
        if (block_px, size, Some(kind)) != (self.block_px, self.size, self.kind) {
            (self.block_px, self.size, self.count) = (block_px, size, 0);
            (self.kind, self.yuv_per_byte) = (Some(kind), kind.full_range_slopes());
        }
        self.remember();
        self.average(prepared);
        if self.count == 0 {
            self.before.clone_from(&self.latest);
        }
        self.count += 1;
        self.find_threshold();
    }

    /// Makes the latest image one of those before the next.
    fn remember(&mut self) {
        let rate = self.tuning.rate.max(1.0 / self.count.max(1) as f32);
        let Self {
            before,
            latest,
            level,
            ..
        } = self;
        level.run(
            #[inline(always)]
            || {
                for (before, latest) in before.iter_mut().zip(latest) {
                    for (before, latest) in before.iter_mut().zip(latest) {
                        *before += rate * (*latest - *before);
                    }
                }
            },
        );
    }

    /// Averages the pixels of each block.
    fn average(&mut self, prepared: &PreparedFrame) {
        let frame = prepared.frame();
        let (side, (columns, rows)) = (self.block_px, self.size);
        let open = prepared.view().mask().map(Mask::open);
        let width = frame.width();
        let blocks = columns * rows;
        self.latest
            .iter_mut()
            .for_each(|of_component| of_component.resize(blocks, 0.0));
        for row in 0..rows {
            let ys = row * side..(row + 1) * side;
            self.add_rows(frame, ys.clone());
            let blocks = row * columns..(row + 1) * columns;
            for (latest, sums) in self.latest.iter_mut().zip(&self.columns) {
                let means = &mut latest[blocks.clone()];
                self.level.run(
                    #[inline(always)]
                    || match side {
                        1 => average::<1>(means, sums),
                        2 => average::<2>(means, sums),
                        3 => average::<3>(means, sums),
                        4 => average::<4>(means, sums),
                        6 => average::<6>(means, sums),
                        _ => average_by(side, means, sums),
                    },
                );
            }
            let Some(open) = open else {
                continue;
            };
            for (column, block) in blocks.enumerate() {
                let xs = column * side..(column + 1) * side;
                let mut pixels = ys.clone().flat_map(|y| &open[y * width..][xs.clone()]);
                if !pixels.all(|is_open| *is_open) {
                    self.latest
                        .iter_mut()
                        .for_each(|latest| latest[block] = f32::NAN);
                }
            }
        }
    }

    /// Adds up these rows of pixels.
    fn add_rows(&mut self, frame: &Frame, rows: std::ops::Range<usize>) {
        let Self {
            row,
            columns,
            level,
            ..
        } = self;
        for sums in columns.iter_mut() {
            sums.clear();
            sums.resize(frame.width(), 0);
        }
        level.run(
            #[inline(always)]
            || {
                for y in rows {
                    row.read(frame, y);
                    for (sums, bytes) in columns.iter_mut().zip(row.components()) {
                        for (sum, byte) in sums.iter_mut().zip(bytes) {
                            // There are some 50 rows at most: no overflow.
                            *sum += u16::from(*byte);
                        }
                    }
                }
            },
        );
    }

    /// By how much a block differs from the images before, in grey levels; NaN if it is masked.
    fn difference(&self, block: usize) -> f32 {
        let [a, b, c] = [0, 1, 2].map(|i| self.latest[i][block] - self.before[i][block]);
        let squared = |i: usize| {
            let slopes = self.yuv_per_byte[i];
            let difference = slopes[0] * a + slopes[1] * b + slopes[2] * c;
            CHANNEL_WEIGHTS[i] * difference * difference
        };
        (0..3).map(squared).sum::<f32>().sqrt()
    }

    /// Finds from which difference on a block has changed.
    fn find_threshold(&mut self) {
        let mut samples = std::mem::take(&mut self.samples);
        let blocks = (0..self.latest[0].len()).step_by(SAMPLING_STEP);
        let differences = blocks.map(|block| self.difference(block));
        samples.clear();
        samples.extend(differences.filter(|difference| !difference.is_nan()));
        self.threshold = self.threshold_of(&mut samples);
        self.samples = samples;
    }

    /// From which of these differences on blocks have changed; `None` if most have.
    fn threshold_of(&self, samples: &mut [f32]) -> Option<f32> {
        let middle = samples.len() / 2;
        if samples.is_empty() {
            return None;
        }
        let (_, &mut median, _) = samples.select_nth_unstable_by(middle, f32::total_cmp);
        let threshold = self
            .tuning
            .min_change
            .max(self.tuning.noise_factor * median);
        let changed = samples.iter().filter(|&&sample| sample > threshold).count();
        let share = changed as f64 / samples.len() as f64;
        (share <= self.tuning.max_changed_share).then_some(threshold)
    }

    /// The change of each block; `None` for those that have not changed.
    pub(crate) fn changes(&self) -> impl Iterator<Item = Option<Change>> {
        let threshold = self.threshold.unwrap_or(f32::INFINITY);
        (0..self.latest[0].len()).map(move |block| {
            (self.difference(block) > threshold).then(|| Change {
                now: self.latest.each_ref().map(|latest| latest[block]),
                before: self.before.each_ref().map(|before| before[block]),
            })
        })
    }
}

/// Averages each `SIDE` sums of columns of as many pixels.
#[inline(always)]
fn average<const SIDE: usize>(means: &mut [f32], sums: &[u16]) {
    average_by(SIDE, means, sums);
}

/// The same for any length of the sides: for those known in advance, the loop is vectorised.
#[inline(always)]
fn average_by(side: usize, means: &mut [f32], sums: &[u16]) {
    let scale = 1.0 / (side * side) as f32;
    for (mean, sums) in means.iter_mut().zip(sums.chunks_exact(side)) {
        *mean = scale * sums.iter().map(|sum| u32::from(*sum)).sum::<u32>() as f32;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::color::YuvEncoding;
    use crate::view::View;
    use crate::{Frame, PixelFormat};
    use pardalis_camera::{Camera, Pinhole, Pose};

    const SIZE: (usize, usize) = (700, 90);
    const GREY: [u8; 3] = [150, 140, 130];
    const GREEN: [u8; 3] = [40, 160, 60];

    fn view(mask: Option<Mask>) -> View {
        let camera = Camera::Pinhole(Pinhole::new([500.0; 2], [350.0, 45.0], &[]).unwrap());
        View::new(camera, Pose::identity(), SIZE, mask).unwrap()
    }

    /// A picture of this colour at each pixel, with noise of two grey levels.
    fn picture(seed: usize, color: impl Fn(usize, usize) -> [u8; 3]) -> Frame {
        let of_pixel = |i: usize| {
            let noise = ((i + seed) * 7919 % 5) as u8;
            color(i % SIZE.0, i / SIZE.0).map(|value| value - 2 + noise)
        };
        let bytes: Vec<u8> = (0..SIZE.0 * SIZE.1).flat_map(of_pixel).collect();
        let (width, height) = SIZE;
        Frame::new(
            PixelFormat::Rgb8,
            YuvEncoding::default(),
            width,
            height,
            bytes,
            0.0,
        )
        .unwrap()
    }

    /// Grey, with a pale green streak (two fifths of the ball) at columns from `left` to `left` + 120 and rows 30 to 59.
    fn streak(seed: usize, left: usize) -> Frame {
        picture(seed, |x, y| {
            if (left..left + 120).contains(&x) && (30..60).contains(&y) {
                [0, 1, 2].map(|i| (0.6 * f32::from(GREY[i]) + 0.4 * f32::from(GREEN[i])) as u8)
            } else {
                GREY
            }
        })
    }

    fn changed(background: &Background) -> Vec<usize> {
        let changes = background.changes().enumerate();
        let changed = changes.filter_map(|(block, change)| change.map(|_| block));
        changed.collect()
    }

    /// Whether a colour is that of the green ball, within a few grey levels.
    fn is_green(rgb: [u8; 3]) -> bool {
        (0..3).all(|i| rgb[i].abs_diff(GREEN[i]) < 15)
    }

    #[test]
    fn blocks_of_a_streak_have_changed_and_are_mixtures_with_its_color() {
        let view = view(None);
        let mut background = Background::new(BackgroundTuning::default(), Level::best());
        for seed in 0..6 {
            background.compare(&view.prepared(&picture(seed, |_, _| GREY)));
            assert_eq!(changed(&background), []);
        }
        background.compare(&view.prepared(&streak(7, 300)));
        assert_eq!(
            (background.block_px(), background.size()),
            (3, (233, 30)),
            "700 pixels in at most 320 columns"
        );
        let expected: Vec<usize> = (10..20)
            .flat_map(|row| (100..140).map(move |column| row * 233 + column))
            .collect();
        assert_eq!(changed(&background), expected);
        let mut changes = background.changes().flatten();
        assert!(changes.all(|change| change.is_mixture(is_green)));
        let is_red = |rgb: [u8; 3]| (0..3).all(|i| rgb[i].abs_diff([200, 40, 60][i]) < 15);
        let mut changes = background.changes().flatten();
        assert!(!changes.any(|change| change.is_mixture(is_red)));
    }

    #[test]
    fn what_has_moved_on_leaves_no_mixture_with_its_color() {
        let view = view(None);
        let mut background = Background::new(BackgroundTuning::default(), Level::best());
        for seed in 0..6 {
            background.compare(&view.prepared(&streak(seed, 60)));
        }
        background.compare(&view.prepared(&streak(6, 400)));
        let green: Vec<usize> = background
            .changes()
            .enumerate()
            .filter(|(_, change)| change.is_some_and(|change| change.is_mixture(is_green)))
            .map(|(block, _)| block % 233)
            .collect();
        assert!(!green.is_empty());
        assert!(green.iter().all(|column| (133..174).contains(column)));
    }

    #[test]
    fn nothing_moves_where_most_of_the_image_changes_or_is_masked() {
        let open = view(None);
        let mut background = Background::new(BackgroundTuning::default(), Level::best());
        for seed in 0..6 {
            background.compare(&open.prepared(&picture(seed, |_, _| GREY)));
        }
        let brighter = picture(6, |x, _| if x < 400 { GREY.map(|v| v + 40) } else { GREY });
        background.compare(&open.prepared(&brighter));
        assert_eq!(changed(&background), []);
        let of_pixel = |i: usize| if i % SIZE.0 < 290 { 255 } else { 0 };
        let grey: Vec<u8> = (0..SIZE.0 * SIZE.1).map(of_pixel).collect();
        let masked = view(Some(Mask::from_grey(SIZE.0, SIZE.1, &grey).unwrap()));
        let mut background = Background::new(BackgroundTuning::default(), Level::best());
        for seed in 0..6 {
            background.compare(&masked.prepared(&picture(seed, |_, _| GREY)));
        }
        background.compare(&masked.prepared(&streak(6, 300)));
        assert_eq!(changed(&background), []);
        assert!(background.is_open(0) && !background.is_open(100));
    }

    #[test]
    fn differences_of_blocks_are_those_of_their_pixels_converted_one_by_one() {
        let view = view(None);
        let frames = [90, 120]
            .map(|blue| picture(3, |x, y| [(x % 200) as u8 + 20, (y * 2) as u8 + 10, blue]));
        let mut background = Background::new(BackgroundTuning::default(), Level::best());
        for frame in &frames {
            background.compare(&view.prepared(frame));
        }
        for block in [0, 100, 233 * 29 + 232] {
            let (column, row) = (block % 233, block / 233);
            let mean = |frame: &Frame| {
                let mut sums = [0.0_f32; 3];
                for i in 0..9 {
                    let bytes = frame.components(3 * column + i % 3, 3 * row + i / 3);
                    let yuv = PixelKind::Rgb.full_range_yuv(bytes);
                    (0..3).for_each(|channel| sums[channel] += yuv[channel] / 9.0);
                }
                sums
            };
            let [before, now] = [0, 1].map(|i| mean(&frames[i]));
            let squared = |i: usize| CHANNEL_WEIGHTS[i] * (now[i] - before[i]).powi(2);
            let expected = (0..3).map(squared).sum::<f32>().sqrt();
            let found = background.difference(block);
            assert!((found - expected).abs() < 0.01, "{found} {expected}");
        }
    }
}
