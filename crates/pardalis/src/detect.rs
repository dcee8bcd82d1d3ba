//! Detection: where in an image a target's colours stand out, without any knowledge of where it might be.

use crate::color::{ColorModel, ColorRanges, IlluminationCorrection, Palette, PixelKind};
use crate::frame::with_pixels;
use crate::view::Evidence;
use pardalis_camera::Mask;

/// Smaller blobs are noise, in pixels.
const LEAST_AREA_PX: usize = 9;

/// The most blobs of one image that are told.
const MAX_BLOBS: usize = 8;

/// A connected part of an image in the target's colours.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Blob {
    /// The mean of its pixels, weighted by how much likelier each is the target's than the image's.
    pub centroid_px: [f64; 2],
    /// The number of its pixels.
    pub area_px: f64,
    /// Its least column and row.
    pub min_px: [usize; 2],
    /// Its largest column and row.
    pub max_px: [usize; 2],
    /// Whether it reaches the image's border or a masked pixel, so that part of it may be missing.
    pub cut_off: bool,
}

/// Rows and columns that a coarse look at an image's colours skips to.
pub(crate) const COARSE_PX: usize = 4;

/// For each bin, how much likelier a pixel of it is the target's than the image's: t / (t + f), of shares t of the target's and f of the image's
/// pixels, their light undone, so that nothing need be known of the background (the ratio of histograms of Swain and Ballard 1991). Every `step_px`th pixel of every
/// `step_px`th row is counted.
///
/// Panics where the frame was not prepared for the colours' palette ([`View::prepare`](crate::view::View::prepare)).
pub(crate) fn likeness(
    evidence: &Evidence,
    colors: &ColorModel,
    relight: &IlluminationCorrection,
    step_px: usize,
) -> Vec<f64> {
    let frame = evidence.frame();
    let table = evidence.table(colors.palette());
    let (width, height) = (frame.width(), frame.height());
    let open = evidence.view().mask().map(Mask::open);
    let mut counts = vec![0_u64; colors.palette().bin_count()];
    let mut total = 0_u64;
    with_pixels!(frame, components => for y in (0..height).step_by(step_px) {
        for x in (0..width).step_by(step_px) {
            if open.is_none_or(|open| open[y * width + x]) {
                counts[usize::from(table.bin(relight.bytes(components(x, y))))] += 1;
                total += 1;
            }
        }
    });
    let shares = colors.histogram().shares();
    let likeness = |(&share, &count): (&f64, &u64)| {
        let of_image = count as f64 / total.max(1) as f64;
        if share > 0.0 {
            share / (share + of_image)
        } else {
            0.0
        }
    };
    shares.iter().zip(&counts).map(likeness).collect()
}

/// From this likeness on, a pixel counts as the target's: its colour has twice the share among the target's pixels that it has in the image.
pub(crate) const LEAST_LIKENESS: f64 = 2.0 / 3.0;

/// The mean Y, U and V of an image's unmasked pixels.
pub(crate) fn mean_color(evidence: &Evidence) -> [f32; 3] {
    let frame = evidence.frame();
    let kind = PixelKind::of(frame);
    let (width, height) = (frame.width(), frame.height());
    let open = evidence.view().mask().map(Mask::open);
    let (mut sums, mut count) = ([0.0_f32; 3], 0.0_f32);
    with_pixels!(frame, components => for y in (0..height).step_by(COARSE_PX) {
        for x in (0..width).step_by(COARSE_PX) {
            if open.is_none_or(|open| open[y * width + x]) {
                let color = kind.full_range_yuv(components(x, y));
                (0..3).for_each(|i| sums[i] += color[i]);
                count += 1.0;
            }
        }
    });
    sums.map(|sum| sum / count.max(1.0))
}

/// The blobs of a target's colours in one image, the largest first, at most eight.
///
/// A colour stands out where its share among the target's pixels is at least twice that in the image. Panics where the frame was not prepared for the colours' palette
/// ([`View::prepare`](crate::view::View::prepare)).
pub fn blobs(evidence: &Evidence, colors: &ColorModel) -> Vec<Blob> {
    let likeness = likeness(evidence, colors, &IlluminationCorrection::NONE, 1);
    blobs_alike(
        evidence,
        colors.palette(),
        &likeness,
        None,
        &IlluminationCorrection::NONE,
    )
}

/// The same where the likeness of each bin is known, of pixels in these ranges alone, which the frame was prepared for, in light that is to be undone.
pub(crate) fn blobs_alike(
    evidence: &Evidence,
    palette: Palette,
    likeness: &[f64],
    ranges: Option<ColorRanges>,
    relight: &IlluminationCorrection,
) -> Vec<Blob> {
    let frame = evidence.frame();
    let table = evidence.table(palette);
    let (width, height) = (frame.width(), frame.height());
    let open = evidence.view().mask().map(Mask::open);
    let is_open = |i: usize| open.is_none_or(|open| open[i]);
    let mut bins = Vec::with_capacity(width * height);
    with_pixels!(frame, components => for y in 0..height {
        bins.extend((0..width).map(|x| table.bin(relight.bytes(components(x, y)))));
    });
    let mut alike: Vec<bool> = bins
        .iter()
        .enumerate()
        .map(|(i, &bin)| is_open(i) && likeness[usize::from(bin)] >= LEAST_LIKENESS)
        .collect();
    if let Some(ranges) = ranges {
        let in_ranges = evidence.match_table(ranges);
        with_pixels!(frame, components => for (i, alike) in alike.iter_mut().enumerate() {
            *alike = *alike && in_ranges.matches(relight.bytes(components(i % width, i / width))) == 1;
        });
    }
    let mut is_targets = majority(&alike, width);
    (0..is_targets.len()).for_each(|i| is_targets[i] &= is_open(i));
    let mut found = Vec::new();
    let mut stack = Vec::new();
    for seed in 0..is_targets.len() {
        if !std::mem::take(&mut is_targets[seed]) {
            continue;
        }
        stack.push(seed);
        let mut sums = Sums::default();
        while let Some(i) = stack.pop() {
            let (x, y) = (i % width, i / width);
            sums.add([x, y], likeness[usize::from(bins[i])]);
            let inside = [x > 0, x + 1 < width, y > 0, y + 1 < height];
            let neighbours = [
                i.wrapping_sub(1),
                i + 1,
                i.wrapping_sub(width),
                i.wrapping_add(width),
            ];
            for (neighbour, inside) in neighbours.into_iter().zip(inside) {
                if !inside || !is_open(neighbour) {
                    sums.cut_off = true;
                } else if std::mem::take(&mut is_targets[neighbour]) {
                    stack.push(neighbour);
                }
            }
        }
        if sums.count >= LEAST_AREA_PX {
            found.push(sums.blob());
        }
    }
    // A stable sort: those of one area stay in the order of rows.
    found.sort_by(|a: &Blob, b: &Blob| b.area_px.total_cmp(&a.area_px));
    found.truncate(MAX_BLOBS);
    found
}

/// The pixels most of whose 3 x 3 neighbours, themselves included, are set: lines of a pixel's width would tie blobs together.
fn majority(set: &[bool], width: usize) -> Vec<bool> {
    let height = set.len() / width;
    let mut columns = vec![0_u8; width];
    let mut result = Vec::with_capacity(set.len());
    for y in 0..height {
        for (x, column) in columns.iter_mut().enumerate() {
            let rows = y.saturating_sub(1)..(y + 2).min(height);
            *column = rows.map(|row| u8::from(set[row * width + x])).sum();
        }
        result.extend((0..width).map(|x| {
            let near = &columns[x.saturating_sub(1)..(x + 2).min(width)];
            near.iter().sum::<u8>() >= 5
        }));
    }
    result
}

/// What is gathered of a blob's pixels.
#[derive(Default)]
struct Sums {
    count: usize,
    weight: f64,
    weighted: [f64; 2],
    bounds: Option<[[usize; 2]; 2]>,
    cut_off: bool,
}

impl Sums {
    fn add(&mut self, pixel: [usize; 2], weight: f64) {
        self.count += 1;
        self.weight += weight;
        let [low, high] = self.bounds.get_or_insert([pixel; 2]);
        for i in 0..2 {
            self.weighted[i] += weight * pixel[i] as f64;
            low[i] = low[i].min(pixel[i]);
            high[i] = high[i].max(pixel[i]);
        }
    }

    fn blob(&self) -> Blob {
        let [min_px, max_px] = self.bounds.unwrap_or_default();
        Blob {
            centroid_px: self.weighted.map(|sum| sum / self.weight),
            area_px: self.count as f64,
            min_px,
            max_px,
            cut_off: self.cut_off,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::color::{ColorLearner, Palette, YuvEncoding};
    use crate::view::View;
    use crate::{Frame, PixelFormat};
    use pardalis_camera::Pose;
    use pardalis_camera::{Camera, Pinhole};

    const SIZE: (usize, usize) = (60, 40);

    /// Orange discs (centre, radius) on green.
    fn picture(discs: &[([f64; 2], f64)]) -> Frame {
        let mut bytes = Vec::new();
        for i in 0..SIZE.0 * SIZE.1 {
            let (x, y) = ((i % SIZE.0) as f64, (i / SIZE.0) as f64);
            let inside = |&([u, v], r): &([f64; 2], f64)| (x - u).hypot(y - v) <= r;
            let orange = discs.iter().any(inside);
            bytes.extend(if orange { [230, 110, 20] } else { [40, 90, 40] });
        }
        Frame::new(
            PixelFormat::Rgb8,
            YuvEncoding::default(),
            SIZE.0,
            SIZE.1,
            bytes,
            0.0,
        )
        .unwrap()
    }

    fn orange() -> ColorModel {
        let frame = picture(&[([20.0, 20.0], 5.0)]);
        let labels: Vec<bool> = (0..SIZE.0 * SIZE.1)
            .map(|i| frame.components(i % SIZE.0, i / SIZE.0)[0] > 200)
            .collect();
        let mut learner = ColorLearner::new(Palette::HSI).unwrap();
        learner.add(&frame, &labels).unwrap();
        learner.learn().unwrap()
    }

    fn found(discs: &[([f64; 2], f64)], mask: Option<Mask>) -> Vec<Blob> {
        let camera = Camera::Pinhole(Pinhole::new([50.0; 2], [30.0, 20.0], &[]).unwrap());
        let mut view = View::new(camera, Pose::identity(), SIZE, mask).unwrap();
        let frame = picture(discs);
        view.prepare(crate::color::PixelKind::of(&frame), Palette::HSI);
        blobs(&view.evidence(&frame), &orange())
    }

    #[test]
    fn blobs_are_found_with_centroid_area_and_box_the_largest_first() {
        let blobs = found(
            &[([12.0, 9.0], 4.0), ([41.0, 22.0], 6.0), ([5.0, 35.0], 1.0)],
            None,
        );
        assert_eq!(blobs.len(), 2, "the smallest is noise: {blobs:?}");
        for (blob, [u, v]) in blobs.iter().zip([[41.0, 22.0], [12.0, 9.0]]) {
            let [found_u, found_v] = blob.centroid_px;
            assert!((found_u - u).hypot(found_v - v) < 1e-9, "{blob:?}");
        }
        // The outermost pixels of a disc, alone in their rows, are smoothed away.
        assert_eq!((blobs[0].min_px, blobs[0].max_px), ([36, 17], [46, 27]));
        assert!(
            (blobs[0].area_px - 113.0).abs() < 6.0,
            "{}",
            blobs[0].area_px
        );
        assert!(blobs.iter().all(|blob| !blob.cut_off));
    }

    #[test]
    fn what_reaches_the_border_or_the_mask_is_told_as_cut_off() {
        assert!(found(&[([57.0, 20.0], 4.0)], None)[0].cut_off);
        assert!(found(&[([30.0, 1.0], 4.0)], None)[0].cut_off);
        assert!(!found(&[([30.0, 20.0], 4.0)], None)[0].cut_off);
        let mask = Mask::from_radius(SIZE.0, SIZE.1, [30.0, 20.0], 10.0).unwrap();
        let cut = found(&[([39.0, 20.0], 4.0)], Some(mask.clone()));
        assert!(cut[0].cut_off && cut[0].max_px[0] <= 40, "{cut:?}");
        assert!(found(&[([50.0, 20.0], 4.0)], Some(mask)).is_empty());
    }

    #[test]
    fn nothing_of_these_colours_is_no_blob() {
        assert!(found(&[], None).is_empty());
    }
}
