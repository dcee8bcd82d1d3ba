//! The pixels around a label: their colours, and the probability that they show the labelled body.

use crate::color::ellipse::Ellipse;
use crate::color::outline_distance::Part;

/// How far the window reaches from the centre of a label, in longer semi-axes. Derivation: the largest and farthest outline that
/// is tried, and its surroundings.
const REACH: f64 = 3.2;
/// The body's colours are taken within this multiple of the outline, those of its surroundings in this range. Hand-set: both
/// are clear of the blurred edge.
const BODY: f64 = 0.85;
const SURROUNDINGS: std::ops::Range<f64> = 1.2..2.2;
/// Pixels of the surroundings beyond the outline, at least, for small bodies.
const MIN_SURROUNDINGS_PX: f64 = 4.0;
/// Added to the share of every colour among the pixels of the body and of its surroundings, as a multiple of the share if all colours were equally frequent: colours
/// that hardly occur say nothing. Hand-set.
const UNSEEN: f64 = 0.5;

/// An image and the pixels that were drawn as the target's.
pub(in crate::color) struct LabelledImage<'a> {
    /// Whether each pixel, row by row, was drawn as the target's.
    pub(in crate::color) drawn: &'a [bool],
    /// The bin of each pixel's colour, below `bin_count`.
    pub(in crate::color) bins: &'a [u16],
    pub(in crate::color) bin_count: usize,
    pub(in crate::color) width: usize,
    /// The Y, U and V of a pixel by column and row.
    pub(in crate::color) yuv: &'a dyn Fn(usize, usize) -> [f32; 3],
    /// Whether what was drawn is exact, so that no outline is fitted.
    pub(in crate::color) is_exact: bool,
}

impl LabelledImage<'_> {
    /// Its width and height in pixels.
    pub(in crate::color) fn size(&self) -> (usize, usize) {
        (self.width, self.drawn.len() / self.width)
    }

    /// Reports whether an outline lies wholly within the image.
    pub(super) fn holds(&self, outline: &Ellipse) -> bool {
        let (width, height) = self.size();
        let within = |&[u, v]: &[f64; 2]| {
            u > 0.0 && v > 0.0 && u < width as f64 - 1.0 && v < height as f64 - 1.0
        };
        outline.outline_px(32).iter().all(within)
    }
}

/// A value for each pixel of a part of an octave.
pub(super) struct Plane<T> {
    /// The column and row of its first pixel.
    left: usize,
    top: usize,
    width: usize,
    /// Row by row.
    values: Vec<T>,
}

impl<T: Copy> Plane<T> {
    /// Returns the value of a pixel; `None` outside.
    pub(super) fn pixel(&self, x: usize, y: usize) -> Option<T> {
        let (x, y) = (x.checked_sub(self.left)?, y.checked_sub(self.top)?);
        if x >= self.width {
            return None;
        }
        self.values.get(y * self.width + x).copied()
    }

    /// Calls `take` with the column, row and value of each pixel.
    pub(super) fn for_each(&self, mut take: impl FnMut(usize, usize, T)) {
        for (i, &value) in self.values.iter().enumerate() {
            take(self.left + i % self.width, self.top + i / self.width, value);
        }
    }

    /// Returns the means over squares of 2^octave pixels. The first pixel is at a multiple of their side.
    fn means(&self, octave: usize, mean: impl Fn(&mut dyn Iterator<Item = T>, f32) -> T) -> Self {
        let size = 1 << octave;
        let (width, height) = (
            self.width >> octave,
            (self.values.len() / self.width) >> octave,
        );
        let count = (size * size) as f32;
        let block = |i: usize| {
            let (x, y) = (size * (i % width), size * (i / width));
            let at = |j: usize| self.values[(y + j / size) * self.width + x + j % size];
            mean(&mut (0..size * size).map(at), count)
        };
        Self {
            left: self.left >> octave,
            top: self.top >> octave,
            width,
            values: (0..width * height).map(block).collect(),
        }
    }
}

impl Plane<f32> {
    pub(super) fn reduced(&self, octave: usize) -> Self {
        self.means(octave, |values, count| values.sum::<f32>() / count)
    }

    /// Returns the value at a position, interpolated; `None` outside.
    pub(super) fn at(&self, [u, v]: [f64; 2]) -> Option<f32> {
        if u < 0.0 || v < 0.0 {
            return None;
        }
        let (x, y) = (u as usize, v as usize);
        let (along, down) = ((u - x as f64) as f32, (v - y as f64) as f32);
        let mix = |from: f32, to: f32, share: f32| from + share * (to - from);
        let row = |y: usize| Some(mix(self.pixel(x, y)?, self.pixel(x + 1, y)?, along));
        Some(mix(row(y)?, row(y + 1)?, down))
    }
}

impl Plane<[f32; 3]> {
    pub(super) fn reduced(&self, octave: usize) -> Self {
        self.means(octave, |values, count| {
            let add = |sum: [f32; 3], value: [f32; 3]| [0, 1, 2].map(|i| sum[i] + value[i]);
            values.fold([0.0; 3], add).map(|sum| sum / count)
        })
    }
}

/// The part of an image around a label.
pub(super) struct Window {
    colors: Plane<[f32; 3]>,
    bins: Plane<u16>,
    bin_count: usize,
    /// Pixels of other labels: not the surroundings of this one.
    is_other: Vec<bool>,
}

impl Window {
    pub(super) fn around(image: &LabelledImage, part: &Part, label: &Ellipse) -> Self {
        /// Squares of the coarsest octave begin at its multiples.
        const GRID: usize = 1 << super::COARSEST;
        let (width, height) = image.size();
        let [_, longer] = label.semi_axes_px();
        let range = |center: f64, size: usize| {
            let reach = REACH * longer + GRID as f64;
            let first = (center - reach).max(0.0) as usize / GRID * GRID;
            first..((center + reach).max(0.0) as usize + 1).min(size)
        };
        let [u, v] = label.center_px();
        let (columns, rows) = (range(u, width), range(v, height));
        let places = rows
            .clone()
            .flat_map(|y| columns.clone().map(move |x| (x, y)));
        let [left, top] = [columns.start, rows.start];
        let row = columns.len();
        let plane = |values| Plane {
            left,
            top,
            width: row,
            values,
        };
        let mut is_other: Vec<bool> = places
            .clone()
            .map(|(x, y)| image.drawn[y * width + x])
            .collect();
        for &(x, y) in part {
            is_other[(y - top) * row + x - left] = false;
        }
        Self {
            colors: plane(places.clone().map(|(x, y)| (image.yuv)(x, y)).collect()),
            bins: Plane {
                left,
                top,
                width: row,
                values: places.map(|(x, y)| image.bins[y * width + x]).collect(),
            },
            bin_count: image.bin_count,
            is_other,
        }
    }

    /// Its colours: Y, U and V.
    pub(super) fn colors(&self) -> &Plane<[f32; 3]> {
        &self.colors
    }

    /// Computes the probability that each pixel is the body's by its colour alone, if the body has this outline; `None` if either the body or its surroundings
    /// have no pixels.
    pub(super) fn probability(&self, outline: &Ellipse) -> Option<Plane<f32>> {
        let (mut body, mut around) = (vec![0.0; self.bin_count], vec![0.0; self.bin_count]);
        let [shorter, _] = outline.semi_axes_px();
        let most = SURROUNDINGS
            .end
            .max(SURROUNDINGS.start + MIN_SURROUNDINGS_PX / shorter);
        let mut index = 0;
        self.bins.for_each(|x, y, bin| {
            let scale = outline.scale_at([x as f64, y as f64]);
            if scale < BODY {
                body[usize::from(bin)] += 1.0;
            } else if (SURROUNDINGS.start..most).contains(&scale) && !self.is_other[index] {
                around[usize::from(bin)] += 1.0;
            }
            index += 1;
        });
        let [of_body, of_around] = [&body, &around].map(|counts| counts.iter().sum::<f64>());
        if of_body == 0.0 || of_around == 0.0 {
            return None;
        }
        let unseen = UNSEEN / self.bin_count as f64;
        let of_bin = |bin: usize| {
            let body = body[bin] / of_body + unseen;
            let around = around[bin] / of_around + unseen;
            (body / (body + around)) as f32
        };
        let by_bin: Vec<f32> = (0..self.bin_count).map(of_bin).collect();
        let of_pixel = |&bin: &u16| by_bin[usize::from(bin)];
        Some(Plane {
            left: self.bins.left,
            top: self.bins.top,
            width: self.bins.width,
            values: self.bins.values.iter().map(of_pixel).collect(),
        })
    }
}
