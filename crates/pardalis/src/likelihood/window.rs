//! The window cue: counts the target's colours in a small window around the projected position (Barrera 2005,
//! section II.B).

use rayon::prelude::*;

use super::outline::Projector;
use super::raster::{COORDINATES_STRIDE, NO_PIXEL, Raster};
use crate::color::{ColorRanges, MatchTable};
use crate::frame::{PixelFormat, with_pixels};
use crate::view::{PreparedFrame, View};
use pardalis_camera::{LANES, Mask};
use pardalis_core::Error;
use pardalis_core::simd::Level;

/// Parameters of the window cue.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct WindowSettings {
    /// Width and height of the window in pixels, odd.
    pub size_px: usize,
    /// Minimum likelihood of a window, so that an occluded target remains possible.
    pub floor: f64,
    /// Likelihood if the position is outside the image or the camera's domain, or masked.
    pub outside: f64,
    /// The colours that match; `None` to use those of the target's colour model.
    pub ranges: Option<ColorRanges>,
}

impl WindowSettings {
    /// Returns the published settings for a window of the given size: the likelihood never falls below that
    /// of one matching pixel, also outside the image.
    pub fn of_size(size_px: usize) -> Self {
        let one_pixel = 1.0 / (size_px as f64).powi(2);
        Self {
            size_px,
            floor: one_pixel,
            outside: one_pixel,
            ranges: None,
        }
    }

    /// Checks the settings.
    ///
    /// # Errors
    ///
    /// The size is even or not within 1 to 101, or a likelihood is not above 0 and at most 1.
    pub fn check(&self) -> Result<(), Error> {
        if self.size_px.is_multiple_of(2) || self.size_px > 101 {
            let allowed = "an odd number from 1 to 101";
            return Err(Error::out_of_range("size_px", self.size_px, allowed));
        }
        for (name, value) in [("floor", self.floor), ("outside", self.outside)] {
            if !(value > 0.0 && value <= 1.0) {
                return Err(Error::out_of_range(name, value, "above 0 and at most 1"));
            }
        }
        self.ranges.as_ref().map_or(Ok(()), ColorRanges::check)
    }

    /// Computes the likelihood of a window with `matching` matching pixels (eqs. 6 and 7).
    pub fn likelihood(&self, matching: u32) -> f64 {
        (f64::from(matching) / (self.size_px as f64).powi(2)).max(self.floor)
    }
}

impl Default for WindowSettings {
    /// As published: 5 x 5 pixels.
    fn default() -> Self {
        Self::of_size(5)
    }
}

/// Particles per work item of a thread.
const CHUNK: usize = 64 * LANES;
/// Cost of a pixel when all pixels around the windows are summed, in look-ups of single pixels. With more
/// look-ups than this per pixel, sums over the area around all windows are cheaper (measured; see the
/// benchmark `window`).
const LOOK_UPS_PER_SUMMED_PIXEL: f64 = 1.5;

/// How windows are counted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum WindowCounting {
    /// Whichever method is cheaper for the current particles.
    Cheaper,
    /// Each pixel of each window is looked up.
    LookUps,
    /// Each pixel around all windows is looked up once, into an integral image.
    Sums,
}

/// The window cue of one target, with the buffers of its kernels.
#[derive(Debug)]
pub(super) struct WindowCue {
    settings: WindowSettings,
    ranges: ColorRanges,
    counting: WindowCounting,
    /// Log-likelihood for each number of matching pixels.
    log_likelihoods: Vec<f32>,
    log_outside: f32,
    /// The pixel of each particle, `y * stride + x` or [`NO_PIXEL`].
    pixels: Vec<u32>,
    sums: Sums,
    level: Level,
}

impl WindowCue {
    /// Creates the cue; `ranges` replaces the ranges of `settings`.
    pub(super) fn new(
        settings: WindowSettings,
        ranges: ColorRanges,
        counting: WindowCounting,
        level: Level,
    ) -> Self {
        let pixels = settings.size_px.pow(2) as u32;
        let log_of = |matching| libm::log(settings.likelihood(matching)) as f32;
        Self {
            settings,
            ranges,
            counting,
            log_likelihoods: (0..=pixels).map(log_of).collect(),
            log_outside: libm::log(settings.outside) as f32,
            pixels: Vec::new(),
            sums: Sums::default(),
            level,
        }
    }

    pub(super) fn ranges(&self) -> ColorRanges {
        self.ranges
    }

    /// Returns the log-likelihood of pure background.
    pub(super) fn background_log_likelihood(&self) -> f64 {
        libm::log(self.settings.floor.max(self.settings.outside))
    }

    /// Adds one camera's log-likelihood of each particle.
    pub(super) fn add_camera(
        &mut self,
        prepared: &PreparedFrame,
        positions: [&[f32]; 3],
        out: &mut [f32],
    ) {
        self.find_pixels(prepared.view(), positions);
        let size = self.settings.size_px;
        let area = Area::around(&self.pixels, size / 2, prepared.view().size());
        let by_sums = match self.counting {
            WindowCounting::LookUps => false,
            WindowCounting::Sums => true,
            WindowCounting::Cheaper => {
                let inside = self.pixels.iter().filter(|pixel| **pixel != NO_PIXEL);
                let look_ups = (inside.count() * size * size) as f64;
                look_ups > LOOK_UPS_PER_SUMMED_PIXEL * area.pixel_count() as f64
            }
        };
        let table = prepared.match_table(self.ranges);
        let width = prepared.view().size().0;
        let open = prepared.view().mask().map(Mask::open);
        let Self {
            pixels,
            sums,
            log_likelihoods,
            log_outside,
            ..
        } = self;
        with_pixels!(prepared.frame(), components => {
            let matches = |x: usize, y: usize| {
                let is_open = open.is_none_or(|open| open[y * width + x]);
                u32::from(is_open) & table.matches(components(x, y))
            };
            let log_likelihood = |pixel: u32, count: &dyn Fn(Area) -> u32| {
                if pixel == NO_PIXEL {
                    return *log_outside;
                }
                let window = Area::around(&[pixel], size / 2, prepared.view().size());
                log_likelihoods[count(window) as usize]
            };
            let chunks = pixels.par_chunks(CHUNK).zip(out.par_chunks_mut(CHUNK));
            if by_sums {
                sums.count(area, matches);
                let sums = &*sums;
                chunks.for_each(|(pixels, out)| {
                    for (&pixel, out) in pixels.iter().zip(out) {
                        *out += log_likelihood(pixel, &|window| sums.of(window));
                    }
                });
            } else if prepared.frame().format() == PixelFormat::Rgb8 && open.is_none() {
                // Fast path for the most common case: the pixels of a row are contiguous.
                let bytes = prepared.frame().bytes();
                chunks.for_each(|(pixels, out)| {
                    for (&pixel, out) in pixels.iter().zip(out) {
                        *out += log_likelihood(pixel, &|window| window.count_rgb(bytes, width, table));
                    }
                });
            } else {
                chunks.for_each(|(pixels, out)| {
                    for (&pixel, out) in pixels.iter().zip(out) {
                        *out += log_likelihood(pixel, &|window| window.count(matches));
                    }
                });
            }
        });
    }

    /// Finds the pixel that each particle projects to.
    fn find_pixels(&mut self, view: &View, [x, y, z]: [&[f32]; 3]) {
        let projector = Projector::new(view);
        let raster = Raster::new(view, COORDINATES_STRIDE);
        let (open, width) = (view.mask().map(Mask::open), view.size().0);
        let level = self.level;
        self.pixels.resize(x.len(), NO_PIXEL);
        let work = |(chunk, pixels): (usize, &mut [u32])| {
            for (block, pixels) in pixels.chunks_mut(LANES).enumerate() {
                let start = chunk * CHUNK + block * LANES;
                let mut positions = [[0_f32; LANES]; 3];
                for (position, column) in positions.iter_mut().zip([x, y, z]) {
                    position[..pixels.len()].copy_from_slice(&column[start..start + pixels.len()]);
                }
                let mut found = [[NO_PIXEL; LANES]];
                raster.write_pixels(&[projector.project(level, &positions)], &mut found);
                pixels.copy_from_slice(&found[0][..pixels.len()]);
                if let Some(open) = open {
                    for pixel in pixels.iter_mut().filter(|p| **p != NO_PIXEL) {
                        let (x, y) = coordinates(*pixel);
                        if !open[y * width + x] {
                            *pixel = NO_PIXEL;
                        }
                    }
                }
            }
        };
        self.pixels.par_chunks_mut(CHUNK).enumerate().for_each(work);
    }
}

/// Returns the image coordinates of a pixel.
#[inline(always)]
fn coordinates(pixel: u32) -> (usize, usize) {
    (
        (pixel % COORDINATES_STRIDE) as usize,
        (pixel / COORDINATES_STRIDE) as usize,
    )
}

/// A rectangle of pixels; the ends are exclusive.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
struct Area {
    first: [usize; 2],
    ends: [usize; 2],
}

impl Area {
    /// Returns the part of the image covered by the windows around the given pixels.
    #[inline(always)]
    fn around(pixels: &[u32], half: usize, (width, height): (usize, usize)) -> Self {
        let (mut first, mut last) = ([usize::MAX; 2], [0; 2]);
        for &pixel in pixels.iter().filter(|pixel| **pixel != NO_PIXEL) {
            let (x, y) = coordinates(pixel);
            first = [first[0].min(x), first[1].min(y)];
            last = [last[0].max(x), last[1].max(y)];
        }
        if first[0] == usize::MAX {
            return Self::default();
        }
        Self {
            first: first.map(|c| c.saturating_sub(half)),
            ends: [
                (last[0] + half + 1).min(width),
                (last[1] + half + 1).min(height),
            ],
        }
    }

    #[inline(always)]
    fn size(self) -> [usize; 2] {
        [0, 1].map(|axis| self.ends[axis] - self.first[axis])
    }

    fn pixel_count(self) -> usize {
        let [width, height] = self.size();
        width * height
    }

    /// Counts the matching pixels.
    #[inline(always)]
    fn count(self, matches: impl Fn(usize, usize) -> u32) -> u32 {
        let mut count = 0;
        for y in self.first[1]..self.ends[1] {
            for x in self.first[0]..self.ends[0] {
                count += matches(x, y);
            }
        }
        count
    }

    /// Counts the matching pixels of an RGB image of the given width.
    #[inline(always)]
    fn count_rgb(self, bytes: &[u8], width: usize, table: &MatchTable) -> u32 {
        let mut count = 0;
        for y in self.first[1]..self.ends[1] {
            let [first, end] = [self.first[0], self.ends[0]].map(|x| 3 * (y * width + x));
            let (pixels, _) = bytes[first..end].as_chunks();
            for &pixel in pixels {
                count += table.matches(pixel);
            }
        }
        count
    }
}

/// Counts of matching pixels above and to the left of every pixel of an area (an integral image).
#[derive(Debug, Default)]
struct Sums {
    area: Area,
    /// One row and one column more than the area; the first of each is zero.
    sums: Vec<u32>,
}

impl Sums {
    fn count(&mut self, area: Area, matches: impl Fn(usize, usize) -> u32 + Sync) {
        let [width, height] = area.size();
        let stride = width + 1;
        self.area = area;
        self.sums.clear();
        self.sums.resize(stride * (height + 1), 0);
        let (_, rows) = self.sums.split_at_mut(stride);
        // Sums along rows, which are independent of each other, and then along columns.
        rows.par_chunks_mut(stride)
            .enumerate()
            .with_min_len(32)
            .for_each(|(y, row)| {
                let mut sum = 0;
                for (x, out) in row[1..].iter_mut().enumerate() {
                    sum += matches(area.first[0] + x, area.first[1] + y);
                    *out = sum;
                }
            });
        for y in 1..height {
            let (above, below) = rows.split_at_mut(y * stride);
            for (sum, above) in below[..stride].iter_mut().zip(&above[(y - 1) * stride..]) {
                *sum += above;
            }
        }
    }

    /// Returns the number of matching pixels of a window inside the area.
    #[inline(always)]
    fn of(&self, window: Area) -> u32 {
        let stride = self.area.size()[0] + 1;
        let at = |x: usize, y: usize| self.sums[y * stride + x];
        let [left, top] = [0, 1].map(|axis| window.first[axis] - self.area.first[axis]);
        let [right, bottom] = [0, 1].map(|axis| window.ends[axis] - self.area.first[axis]);
        (at(right, bottom) + at(left, top)) - (at(left, bottom) + at(right, top))
    }
}
