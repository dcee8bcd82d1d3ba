//! The target's colours counted in a small window around the projected position (Barrera 2005, section II.B).

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
pub struct WindowSettings {
    /// Width and height of the window in pixels, odd.
    pub size_px: usize,
    /// The likelihood where fewer pixels of the window match, so that a hidden target is not impossible.
    pub floor: f64,
    /// The likelihood where the position is outside the image or the camera's domain, or masked.
    pub outside: f64,
    /// The colours that match; those learnt with the target's colour model where there are none.
    pub ranges: Option<ColorRanges>,
}

impl WindowSettings {
    /// The published window of this size: one pixel always counts as matching, also outside the image.
    pub fn of_size(size_px: usize) -> Self {
        let one_pixel = 1.0 / (size_px as f64).powi(2);
        Self {
            size_px,
            floor: one_pixel,
            outside: one_pixel,
            ranges: None,
        }
    }

    /// Refuses what makes no window.
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

    /// The likelihood of a window in which `matching` pixels match (eqs. 6 and 7).
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

/// Particles a piece of work for one thread.
const CHUNK: usize = 64 * LANES;
/// What a pixel costs that is counted with all others around the windows, in look-ups of single pixels: above so many look-ups a pixel, sums over the
/// area around all windows are cheaper (measured; see the benchmark `window`).
const LOOK_UPS_A_SUMMED_PIXEL: f64 = 1.5;

/// How windows are counted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum WindowCounting {
    /// Whichever is cheaper for the particles at hand.
    Cheaper,
    /// Each pixel of each window is looked up.
    LookUps,
    /// Each pixel around all windows is looked up once, and sums over areas of the image are taken.
    Sums,
}

/// The window cue of one target, with the buffers that its kernels need.
#[derive(Debug)]
pub(super) struct WindowCue {
    settings: WindowSettings,
    ranges: ColorRanges,
    counting: WindowCounting,
    /// Logarithms of the likelihood for each number of matching pixels.
    log_likelihoods: Vec<f32>,
    log_outside: f32,
    /// The pixel of each particle, `y * stride + x` or [`NO_PIXEL`].
    pixels: Vec<u32>,
    sums: Sums,
    level: Level,
}

impl WindowCue {
    /// `ranges` take the place of settings without.
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

    /// The log-likelihood of pure background.
    pub(super) fn background_log_likelihood(&self) -> f64 {
        libm::log(self.settings.floor.max(self.settings.outside))
    }

    /// Adds what one camera says of each particle.
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
                look_ups > LOOK_UPS_A_SUMMED_PIXEL * area.pixel_count() as f64
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
                // The most usual case by the shortest way: the pixels of a row lie side by side.
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

/// The coordinates of a pixel in the image.
#[inline(always)]
fn coordinates(pixel: u32) -> (usize, usize) {
    (
        (pixel % COORDINATES_STRIDE) as usize,
        (pixel / COORDINATES_STRIDE) as usize,
    )
}

/// A rectangle of pixels, from the first up to but not including the ends.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
struct Area {
    first: [usize; 2],
    ends: [usize; 2],
}

impl Area {
    /// The part of the image that the windows around these pixels cover.
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

    /// The number of its pixels that match.
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

    /// The same of an RGB image of this width.
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

/// Numbers of matching pixels above and to the left of every pixel of an area (an integral image).
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
        // Sums along rows, each apart from the others; then along columns.
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

    /// The number of matching pixels of a window, which lies in the area.
    #[inline(always)]
    fn of(&self, window: Area) -> u32 {
        let stride = self.area.size()[0] + 1;
        let at = |x: usize, y: usize| self.sums[y * stride + x];
        let [left, top] = [0, 1].map(|axis| window.first[axis] - self.area.first[axis]);
        let [right, bottom] = [0, 1].map(|axis| window.ends[axis] - self.area.first[axis]);
        (at(right, bottom) + at(left, top)) - (at(left, bottom) + at(right, top))
    }
}
