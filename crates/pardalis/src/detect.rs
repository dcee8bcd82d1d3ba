//! Detection: finds where in an image a target's colours stand out, without prior knowledge of its position.

mod inscribed;
mod statistics;

pub(crate) use statistics::{BinCounts, mean_color, sampling_step_px};

use crate::Frame;
use crate::background::Background;
use crate::color::{ColorModel, ColorRanges, IlluminationCorrection, Palette};
use crate::frame::Row;
use crate::tuning::BlobTuning;
use crate::view::PreparedFrame;
use pardalis_camera::Mask;
use pardalis_core::simd::Level;

/// The length of the sides of the cells of an image, pixels. Hand-set: short, and a few times as long as the smallest blobs.
const CELL: usize = 16;
/// The distance between the rows and columns whose pixels are looked at first: cells are searched if one of these pixels in or beside them has the target's colours. Derivation:
/// wherever it is, a disc with a radius of 1.5 pixels covers one of them.
const FIRST_STEP_PX: usize = 2;
/// The number of pixels out of 3 x 3 that the majority filter asks for. Derivation: a majority.
const MAJORITY: u8 = 5;

/// A pixel that is not set after the majority filter.
const PIXEL_UNSET: u8 = 0;
/// A pixel that is set, and not yet part of anything.
const PIXEL_SET: u8 = 1;
/// A pixel that is part of a blob or of something smaller.
const PIXEL_OF_PART: u8 = 2;

/// A connected part of an image in the target's colours.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Blob {
    /// The mean of its pixels, weighted by their colour posterior, in pixels.
    pub centroid_px: [f64; 2],
    /// The number of its pixels.
    pub area_px: f64,
    /// Its smallest column and row.
    pub min_px: [usize; 2],
    /// Its largest column and row.
    pub max_px: [usize; 2],
    /// The covariance of its pixels about their mean: of columns, of columns and rows, and of rows, in px².
    pub covariance_px2: [f64; 3],
    /// Whether it touches the image's border or a masked pixel, so that part of it may be missing.
    pub cut_off: bool,
}

impl Blob {
    /// Turns a blob of blocks of pixels, with sides of this length, into one of pixels.
    fn enlarge(&mut self, block_px: f64) {
        let area_px = block_px * block_px;
        self.centroid_px = self.centroid_px.map(|at| (at + 0.5) * block_px - 0.5);
        self.area_px *= area_px;
        self.min_px = self.min_px.map(|at| at * block_px as usize);
        self.max_px = self.max_px.map(|at| (at + 1) * block_px as usize - 1);
        self.covariance_px2 = self.covariance_px2.map(|value| value * area_px);
    }

    /// The variances along its longest axis and across it, px².
    pub(crate) fn principal_variances_px2(&self) -> [f64; 2] {
        let [xx, xy, yy] = self.covariance_px2;
        let (middle, half) = (0.5 * (xx + yy), libm::hypot(0.5 * (xx - yy), xy));
        [middle + half, (middle - half).max(0.0)]
    }
}

/// Returns the blobs of a target's colours in one image, the largest first, at most eight.
///
/// A colour stands out if it is at least twice as frequent among the target's pixels as in the image. Panics if the frame was not prepared for the
/// colours' palette ([`View::prepare`](crate::view::View::prepare)).
pub fn blobs(prepared: &PreparedFrame, colors: &ColorModel) -> Vec<Blob> {
    search_image(prepared, colors).blobs
}

fn search_image(prepared: &PreparedFrame, colors: &ColorModel) -> BlobSearch {
    let (mut counts, mut posterior) = (BinCounts::default(), Vec::new());
    let correction = IlluminationCorrection::NONE;
    counts.count(prepared, colors.palette(), &correction, (1, Level::best()));
    counts.color_posterior(colors, &mut posterior);
    let mut search = BlobSearch::default();
    let colors = (colors.palette(), None);
    search.find(prepared, colors, &posterior, &correction, |_| false);
    search
}

/// Finds blobs. Owns its buffers: a search in an image no larger than those before allocates nothing.
#[derive(Debug, Default)]
pub(crate) struct BlobSearch {
    tuning: BlobTuning,
    level: Level,
    /// Whether each cell, row by row, has one of the target's colours on the grid of pixels that are looked at first.
    cells: Vec<bool>,
    /// Whether each row of pixels is searched. In the others, nothing is set in the following two.
    rows: Vec<bool>,
    /// Whether each pixel has the target's colours.
    matching: Vec<bool>,
    /// What became of each pixel after the majority filter.
    filtered: Vec<u8>,
    /// A row of the image.
    row: Row,
    /// Sums of three rows in each column.
    columns: Vec<u8>,
    /// Pixels of a blob whose neighbours are still to be visited.
    stack: Vec<usize>,
    blobs: Vec<Blob>,
    /// The first pixel of each blob.
    seeds: Vec<usize>,
    image_width: usize,
    left_out: Option<Blob>,
}

impl BlobSearch {
    pub(crate) fn new(tuning: BlobTuning, level: Level) -> Self {
        Self {
            tuning,
            level,
            ..Self::default()
        }
    }

    /// The greatest number of blobs that a search returns.
    pub(crate) fn max_blobs(&self) -> usize {
        self.tuning.max_blobs
    }

    /// The least area of a blob, in pixels.
    pub(crate) fn min_area_px(&self) -> usize {
        self.tuning.min_area_px
    }

    /// The largest part of the latest image that the search did not return: too small, or beyond the greatest number of blobs.
    pub(crate) fn left_out(&self) -> Option<&Blob> {
        self.left_out.as_ref()
    }

    /// Finds the blobs of pixels with a high posterior within these ranges, for which the frame was prepared, except of pixels that are taken. Returns them largest
    /// first.
    pub(crate) fn find(
        &mut self,
        prepared: &PreparedFrame,
        (palette, ranges): (Palette, Option<ColorRanges>),
        posterior: &[f64],
        correction: &IlluminationCorrection,
        is_taken: impl Fn([f32; 2]) -> bool,
    ) -> &[Blob] {
        let frame = prepared.frame();
        let table = prepared.table(palette);
        let in_ranges = ranges.map(|ranges| prepared.match_table(ranges));
        let (width, height) = (frame.width(), frame.height());
        let open = prepared.view().mask().map(Mask::open);
        let is_open = |i: usize| open.is_none_or(|open| open[i]);
        let min_posterior = self.tuning.min_posterior;
        let posterior_of = |bytes: [u8; 3]| posterior[usize::from(table.bin(bytes))];
        let matches = |bytes: [u8; 3]| {
            // The small table rules out most pixels.
            in_ranges.is_none_or(|table| table.matches(bytes) == 1)
                && posterior_of(bytes) >= min_posterior
        };
        self.begin((width, height));
        self.find_cells(frame, correction, matches);
        let columns = width.div_ceil(CELL);
        let Self {
            cells,
            rows,
            matching,
            row,
            ..
        } = self;
        self.level.run(
            #[inline(always)]
            || {
                for (y, is_searched) in rows.iter_mut().enumerate() {
                    let around =
                        (y / CELL).saturating_sub(1)..(y / CELL + 2).min(cells.len() / columns);
                    let cells = &cells[around.start * columns..around.end * columns];
                    let is_near = |cell: usize| {
                        let beside = cell.saturating_sub(1)..(cell + 2).min(columns);
                        let mut cells = cells.chunks_exact(columns);
                        cells.any(|cells| cells[beside.clone()].contains(&true))
                    };
                    *is_searched = cells.contains(&true);
                    if !*is_searched {
                        continue;
                    }
                    row.read(frame, y);
                    correction.row(row);
                    let [first, second, third] = row.components();
                    let matching = &mut matching[y * width..][..width];
                    for cell in (0..columns).filter(|&cell| is_near(cell)) {
                        for x in CELL * cell..width.min(CELL * (cell + 1)) {
                            matching[x] = matches([first[x], second[x], third[x]])
                                && is_open(y * width + x)
                                && !is_taken([x as f32, y as f32]);
                        }
                    }
                }
            },
        );
        self.connect((width, height), is_open, |i| {
            posterior_of(correction.bytes(frame.components(i % width, i / width)))
        });
        &self.blobs
    }

    /// Begins a search in an image of this size: no row is searched so far, and nothing is set.
    fn begin(&mut self, (width, height): (usize, usize)) {
        let Self {
            rows,
            matching,
            filtered,
            ..
        } = self;
        if (self.image_width, rows.len()) != (width, height) {
            self.image_width = width;
            rows.clear();
            rows.resize(height, true);
            matching.resize(width * height, false);
            filtered.resize(width * height, PIXEL_UNSET);
        }
        for (y, is_searched) in rows.iter_mut().enumerate() {
            if std::mem::take(is_searched) {
                matching[y * width..][..width].fill(false);
                filtered[y * width..][..width].fill(PIXEL_UNSET);
            }
        }
    }

    /// Finds the cells with a pixel that matches, among those looked at first.
    fn find_cells(
        &mut self,
        frame: &Frame,
        correction: &IlluminationCorrection,
        matches: impl Fn([u8; 3]) -> bool,
    ) {
        let Self {
            level, cells, row, ..
        } = self;
        let [columns, lines] = [frame.width(), frame.height()].map(|side| side.div_ceil(CELL));
        cells.clear();
        cells.resize(columns * lines, false);
        level.run(
            #[inline(always)]
            || {
                for y in (0..frame.height()).step_by(FIRST_STEP_PX) {
                    row.sample(frame, y, FIRST_STEP_PX);
                    correction.row(row);
                    let pixels = row
                        .components()
                        .map(|of_component| of_component.chunks(CELL / FIRST_STEP_PX));
                    let [first, second, third] = pixels;
                    let cells = cells[y / CELL * columns..][..columns].iter_mut();
                    for (((cell, first), second), third) in cells.zip(first).zip(second).zip(third)
                    {
                        let mut pixels = first.iter().zip(second).zip(third);
                        *cell = *cell || pixels.any(|((a, b), c)| matches([*a, *b, *c]));
                    }
                }
            },
        );
    }

    /// Finds what moves in front of a camera at rest and is a mixture of what is there without it and the target's colours: the streaks of fast targets.
    pub(crate) fn find_moving(
        &mut self,
        background: &Background,
        is_target: impl Fn([u8; 3]) -> bool,
    ) {
        self.begin(background.size());
        self.rows.fill(true);
        for (matching, change) in self.matching.iter_mut().zip(background.changes()) {
            *matching = change.is_some_and(|change| change.is_mixture(&is_target));
        }
        self.connect(background.size(), |i| background.is_open(i), |_| 1.0);
        for blob in &mut self.blobs {
            blob.enlarge(background.block_px() as f64);
        }
    }

    /// What was found last.
    pub(crate) fn found(&self) -> &[Blob] {
        &self.blobs
    }

    /// Finds connected parts of the pixels that match, after the majority filter.
    fn connect(
        &mut self,
        (width, height): (usize, usize),
        is_open: impl Fn(usize) -> bool,
        weight: impl Fn(usize) -> f64,
    ) {
        let Self {
            tuning,
            rows,
            matching,
            filtered,
            columns,
            stack,
            blobs,
            seeds,
            left_out,
            ..
        } = self;
        let (min_area_px, max_blobs) = (tuning.min_area_px, tuning.max_blobs);
        *left_out = None;
        majority(matching, (width, rows), columns, filtered);
        for (y, row) in filtered.chunks_exact_mut(width).enumerate() {
            for (x, pixel) in row.iter_mut().enumerate().filter(|_| rows[y]) {
                if *pixel == PIXEL_SET && !is_open(y * width + x) {
                    *pixel = PIXEL_UNSET;
                }
            }
        }
        blobs.clear();
        blobs.reserve(max_blobs);
        seeds.clear();
        seeds.reserve(max_blobs);
        stack.clear();
        // Each pixel is pushed once at most.
        stack.reserve(filtered.len());
        let mut next = 0;
        while let Some(seed) = next_set(filtered, (width, rows), next) {
            next = seed + 1;
            take(&mut filtered[seed]);
            stack.push(seed);
            let mut sums = Sums::default();
            while let Some(i) = stack.pop() {
                let (x, y) = (i % width, i / width);
                sums.add([x, y], weight(i));
                let inside = [x > 0, x + 1 < width, y > 0, y + 1 < height];
                let neighbors = [
                    i.wrapping_sub(1),
                    i + 1,
                    i.wrapping_sub(width),
                    i.wrapping_add(width),
                ];
                for (neighbor, inside) in neighbors.into_iter().zip(inside) {
                    if !inside || !is_open(neighbor) {
                        sums.cut_off = true;
                    } else if take(&mut filtered[neighbor]) {
                        stack.push(neighbor);
                    }
                }
            }
            let blob = sums.blob();
            // Blobs of equal area stay in row order.
            let rank = blobs.partition_point(|larger| larger.area_px >= blob.area_px);
            let last = if sums.count < min_area_px || rank == max_blobs {
                Some(blob)
            } else {
                let last = (blobs.len() == max_blobs).then(|| blobs.pop()).flatten();
                seeds.truncate(max_blobs - 1);
                blobs.insert(rank, blob);
                seeds.insert(rank, seed);
                last
            };
            if let Some(last) = last
                && left_out.is_none_or(|other| other.area_px < last.area_px)
            {
                *left_out = Some(last);
            }
        }
    }
}

/// Returns the first pixel from `next` on that is set and not yet part of anything, in the rows that are searched.
fn next_set(filtered: &[u8], (width, rows): (usize, &[bool]), next: usize) -> Option<usize> {
    let mut from = next;
    while from < filtered.len() {
        let row = &filtered[from..filtered.len().min((from / width + 1) * width)];
        // Most rows hold none, which is found out many pixels at a time.
        if rows[from / width] && row.contains(&PIXEL_SET) {
            let ahead = row.iter().position(|&pixel| pixel == PIXEL_SET);
            return ahead.map(|ahead| from + ahead);
        }
        from += row.len();
    }
    None
}

/// Makes a pixel that is set part of something; returns whether it was set.
fn take(pixel: &mut u8) -> bool {
    let is_set = *pixel == PIXEL_SET;
    if is_set {
        *pixel = PIXEL_OF_PART;
    }
    is_set
}

/// Sets the pixels of which most of the 3 x 3 neighbours, themselves included, are set, in the rows that are searched: lines one pixel wide would join blobs.
fn majority(
    set: &[bool],
    (width, searched): (usize, &[bool]),
    columns: &mut Vec<u8>,
    filtered: &mut [u8],
) {
    let rows = set.chunks_exact(width);
    // With a column of none on either side.
    columns.clear();
    columns.resize(width + 2, 0);
    let searched = filtered
        .chunks_exact_mut(width)
        .enumerate()
        .filter(|(y, _)| searched[*y]);
    for (y, filtered) in searched {
        columns[1..=width].fill(0);
        for row in rows
            .clone()
            .skip(y.saturating_sub(1))
            .take(if y > 0 { 3 } else { 2 })
        {
            for (column, &is_set) in columns[1..=width].iter_mut().zip(row) {
                *column += u8::from(is_set);
            }
        }
        let near = columns.iter().zip(&columns[1..]).zip(&columns[2..]);
        for (pixel, ((left, here), right)) in filtered.iter_mut().zip(near) {
            *pixel = if left + here + right >= MAJORITY {
                PIXEL_SET
            } else {
                PIXEL_UNSET
            };
        }
    }
}

/// Sums over the pixels of a blob.
#[derive(Default)]
struct Sums {
    count: usize,
    weight: f64,
    weighted: [f64; 2],
    /// Sums of columns and rows, and of their products, unweighted.
    first: [f64; 2],
    second: [f64; 3],
    bounds: Option<[[usize; 2]; 2]>,
    cut_off: bool,
}

impl Sums {
    fn add(&mut self, pixel: [usize; 2], weight: f64) {
        self.count += 1;
        self.weight += weight;
        let [x, y] = pixel.map(|at| at as f64);
        for (sum, at) in self.first.iter_mut().zip([x, y]) {
            *sum += at;
        }
        for (sum, product) in self.second.iter_mut().zip([x * x, x * y, y * y]) {
            *sum += product;
        }
        let [low, high] = self.bounds.get_or_insert([pixel; 2]);
        for i in 0..2 {
            self.weighted[i] += weight * pixel[i] as f64;
            low[i] = low[i].min(pixel[i]);
            high[i] = high[i].max(pixel[i]);
        }
    }

    fn blob(&self) -> Blob {
        let [min_px, max_px] = self.bounds.unwrap_or_default();
        // The majority filter may leave a few pixels whose posterior is 0: then the middle.
        let middle = |i: usize| 0.5 * (min_px[i] + max_px[i]) as f64;
        let mean = |i: usize| self.weighted[i] / self.weight;
        let count = self.count as f64;
        let covariance = |product: f64, i: usize, j: usize| {
            product / count - self.first[i] * self.first[j] / (count * count)
        };
        let [xx, xy, yy] = self.second;
        Blob {
            centroid_px: [0, 1].map(|i| {
                if self.weight > 0.0 {
                    mean(i)
                } else {
                    middle(i)
                }
            }),
            area_px: self.count as f64,
            min_px,
            max_px,
            covariance_px2: [
                covariance(xx, 0, 0),
                covariance(xy, 0, 1),
                covariance(yy, 1, 1),
            ],
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
    use pardalis_core::rng::{Draws, Stage};

    const SIZE: (usize, usize) = (60, 40);

    /// Draws orange discs (centre, radius) on green.
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
        search(discs, mask).blobs
    }

    pub(super) fn search(discs: &[([f64; 2], f64)], mask: Option<Mask>) -> BlobSearch {
        let camera = Camera::Pinhole(Pinhole::new([50.0; 2], [30.0, 20.0], &[]).unwrap());
        let mut view = View::new(camera, Pose::identity(), SIZE, mask).unwrap();
        let frame = picture(discs);
        view.prepare(crate::color::PixelKind::of(&frame), Palette::HSI);
        search_image(&view.prepared(&frame), &orange())
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
    fn blobs_at_the_border_or_the_mask_are_cut_off() {
        assert!(found(&[([57.0, 20.0], 4.0)], None)[0].cut_off);
        assert!(found(&[([30.0, 1.0], 4.0)], None)[0].cut_off);
        assert!(!found(&[([30.0, 20.0], 4.0)], None)[0].cut_off);
        let mask = Mask::from_radius(SIZE.0, SIZE.1, [30.0, 20.0], 10.0).unwrap();
        let cut = found(&[([39.0, 20.0], 4.0)], Some(mask.clone()));
        assert!(cut[0].cut_off && cut[0].max_px[0] <= 40, "{cut:?}");
        assert!(found(&[([50.0, 20.0], 4.0)], Some(mask)).is_empty());
    }

    #[test]
    fn the_largest_part_that_is_no_blob_is_left_out() {
        let small = ([5.0, 35.0], 1.5);
        let noise = search(&[([41.0, 22.0], 6.0), small], None);
        let left_out = noise.left_out().unwrap();
        let [u, v] = left_out.centroid_px;
        assert!((u - 5.0).hypot(v - 35.0) < 1e-9, "{left_out:?}");
        assert_eq!(noise.blobs.len(), 1);
        assert!(left_out.area_px < noise.min_area_px() as f64);
        // Ten equal discs: two more than are returned, after a larger one.
        let discs = (0..10).map(|i| {
            (
                [6.0 + 11.0 * f64::from(i % 5), 8.0 + 12.0 * f64::from(i / 5)],
                3.0,
            )
        });
        let mut discs: Vec<_> = discs.collect();
        discs.push(([30.0, 34.0], 4.5));
        let many = search(&discs, None);
        assert_eq!(many.blobs.len(), 8);
        assert!(many.blobs[0].area_px > many.blobs[1].area_px);
        let left_out = many.left_out().unwrap();
        assert_eq!(left_out.area_px, many.blobs[7].area_px);
        assert!(many.blobs.iter().all(|blob| blob != left_out));
        assert_eq!(search(&[], None).left_out(), None);
    }

    #[test]
    fn a_search_near_some_of_the_pixels_finds_what_a_search_of_all_finds() {
        let draws = Draws::new(5, 0);
        let number = |i: usize, of: usize| draws.uniform(i as u32, of as u32, Stage::Resampling);
        let (width, height) = (203, 121);
        let (mut found, mut search) = (0, BlobSearch::default());
        for image in 0..40 {
            // Down to discs of the least size, and specks everywhere.
            let discs: Vec<_> = (0..image % 7)
                .map(|disc| {
                    let at = |i: usize| number(100 * image + 10 * disc + i, 0);
                    let middle = [at(0) * width as f64, at(1) * height as f64];
                    (middle, 1.5 + 7.0 * at(2) * at(2))
                })
                .collect();
            let is_orange = |i: usize| {
                let (x, y) = ((i % width) as f64, (i / width) as f64);
                let inside = |&([u, v], r): &([f64; 2], f64)| (x - u).hypot(y - v) <= r;
                discs.iter().any(inside) || number(i, 1 + image) < 0.004
            };
            let pixel = |i| {
                if is_orange(i) {
                    [230, 110, 20]
                } else {
                    [40, 90, 40]
                }
            };
            let bytes: Vec<u8> = (0..width * height).flat_map(pixel).collect();
            let frame = Frame::from_rgb(width, height, bytes, 0.0).unwrap();
            let lens = Pinhole::new([50.0; 2], [100.0, 60.0], &[]).unwrap();
            let mut view = View::new(lens, Pose::identity(), (width, height), None).unwrap();
            view.prepare(crate::color::PixelKind::of(&frame), Palette::HSI);
            let (prepared, colors) = (view.prepared(&frame), orange());
            let mut posterior = vec![0.0; Palette::HSI.bin_count()];
            posterior[usize::from(Palette::HSI.bin_of_rgb([230.0, 110.0, 20.0]))] = 1.0;
            let (colors, none) = ((colors.palette(), None), IlluminationCorrection::NONE);
            search.find(&prepared, colors, &posterior, &none, |_| false);

            let mut all = BlobSearch::default();
            all.begin((width, height));
            all.rows.fill(true);
            all.matching = (0..width * height).map(is_orange).collect();
            let weight = |i| f64::from(u8::from(is_orange(i)));
            all.connect((width, height), |_| true, weight);
            assert_eq!(search.blobs, all.blobs, "image {image}");
            assert_eq!(search.left_out, all.left_out, "image {image}");
            found += all.blobs.len();
        }
        assert!(found > 60, "{found}");
    }

    #[test]
    fn images_without_these_colours_have_no_blobs() {
        assert!(found(&[], None).is_empty());
    }
}
