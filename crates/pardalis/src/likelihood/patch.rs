//! Histograms of a flat region around each particle, shared by the region and difference cues (Campos 2009,
//! sections 3.2 and 3.3).
//!
//! The region is a level rectangle, as in a rectified image. Only its samples are projected, each to the
//! nearest pixel of the original image, so that no image is ever rectified as a whole.

use rayon::prelude::*;

use super::outline::{Coordinates, Points, Projector};
use super::raster::{COORDINATES_STRIDE, NO_PIXEL, Raster};
use crate::color::ChannelBins;
use crate::shape::{FlatForm, Shape, Stance};
use crate::view::View;
use pardalis_camera::{LANES, Mask};
use pardalis_core::Error;
use pardalis_core::simd::Level;

/// Particles per work item of a thread.
const CHUNK: usize = 4 * LANES;
/// Minimum share of visible samples for a region to be compared.
const MIN_VISIBLE_SHARE: f64 = 0.5;

/// The region around a target, and how its histograms are compared.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct PatchSettings {
    /// Width and height of the region, relative to the target's.
    pub scale: f64,
    /// Samples along each side of the region, evenly spaced.
    pub samples: usize,
    /// Bins per channel.
    pub bins: ChannelBins,
    /// σ of the likelihood exp(−D²/2σ²).
    pub sigma: f64,
}

impl PatchSettings {
    /// Returns settings for a region that shows little else than the target's colours: the rectangle itself,
    /// or the square inscribed in a disc. The paper does not give the numbers.
    pub fn within(shape: &Shape) -> Self {
        let is_disc =
            matches!(shape, Shape::Flat(flat) if matches!(flat.form, FlatForm::Disc { .. }));
        Self {
            scale: if is_disc {
                std::f64::consts::FRAC_1_SQRT_2
            } else {
                1.0
            },
            samples: 10,
            bins: ChannelBins::DEFAULT,
            sigma: 0.15,
        }
    }

    /// Returns settings for a larger region that includes what a target covers and uncovers as it moves, as
    /// the paper requires.
    pub fn around() -> Self {
        Self {
            scale: 1.5,
            samples: 16,
            bins: ChannelBins::DEFAULT,
            sigma: 0.15,
        }
    }

    /// Checks the settings.
    ///
    /// # Errors
    ///
    /// A number is out of range.
    pub fn check(&self) -> Result<(), Error> {
        let above_0 = |name, value: f64, most: f64| {
            if value > 0.0 && value <= most {
                return Ok(());
            }
            Err(Error::out_of_range(
                name,
                value,
                &format!("above 0 and at most {most}"),
            ))
        };
        above_0("scale", self.scale, 100.0)?;
        above_0("sigma", self.sigma, 1000.0)?;
        if !(1..=64).contains(&self.samples) {
            return Err(Error::out_of_range("samples", self.samples, "1 to 64"));
        }
        Ok(())
    }

    /// Computes the log-likelihood for the sum of the D² between histograms and their references (eqs. 10 and
    /// 12).
    pub fn log_likelihood(&self, squared_distances: f64) -> f64 {
        -squared_distances / (2.0 * self.sigma * self.sigma)
    }
}

/// Computes D² of two histograms: one minus their Bhattacharyya coefficient (eq. 9).
pub(super) fn squared_distance(a: &[f64], b: &[f64]) -> f64 {
    1.0 - a.iter().zip(b).map(|(a, b)| (a * b).sqrt()).sum::<f64>()
}

/// Compares the histograms of regions with references; owns the buffers.
#[derive(Debug)]
pub(super) struct Patch {
    settings: PatchSettings,
    /// Offset of each sample from the position, in metres along x and y.
    samples_m: Vec<[f32; 2]>,
    height_m: f32,
    /// √h of the references, channel by channel.
    sqrt_references: Vec<f32>,
    /// √n for n up to the number of samples.
    square_roots: Vec<f32>,
    scratch: Vec<Scratch>,
    level: Level,
}

/// Buffers of one work item.
#[derive(Debug, Clone)]
struct Scratch {
    points: Vec<Points>,
    coordinates: Vec<Coordinates>,
    pixels: Vec<[u32; LANES]>,
    /// Samples in each bin, channel by channel; all zero between particles.
    counts: Vec<u16>,
}

impl Patch {
    /// Creates the region of a flat shape, with one reference per channel, each with `settings.bins` shares
    /// that sum to one.
    pub(super) fn new(
        settings: PatchSettings,
        shape: &Shape,
        references: &[Vec<f64>],
        level: Level,
    ) -> Result<Self, Error> {
        settings.check()?;
        let Shape::Flat(flat) = shape else {
            let allowed = "a disc or rectangle, for region and difference cues";
            return Err(Error::out_of_range("shape", "not flat", allowed));
        };
        let count = settings.samples;
        let along = |i: usize, size_m: f64| {
            let share = (i as f64 + 0.5) / count as f64 - 0.5;
            (share * settings.scale * size_m) as f32
        };
        let [width_m, depth_m] = flat.size_m();
        Ok(Self {
            settings,
            samples_m: (0..count * count)
                .map(|k| [along(k % count, width_m), along(k / count, depth_m)])
                .collect(),
            height_m: flat.height_m as f32,
            sqrt_references: references
                .iter()
                .flatten()
                .map(|h| h.sqrt() as f32)
                .collect(),
            square_roots: (0..=count * count)
                .map(|n| (n as f64).sqrt() as f32)
                .collect(),
            scratch: Vec::new(),
            level,
        })
    }

    pub(super) fn settings(&self) -> &PatchSettings {
        &self.settings
    }

    /// Adds one camera's log-likelihood of each particle. `bins_of` returns the bin of a pixel (x, y) in each
    /// channel.
    pub(super) fn add<const CHANNELS: usize>(
        &mut self,
        view: &View,
        [x, y, z]: [&[f32]; 3],
        out: &mut [f32],
        bins_of: impl Fn(usize, usize) -> [u8; CHANNELS] + Sync,
    ) {
        let chunks = out.len().div_ceil(CHUNK);
        if self.scratch.len() < chunks {
            let samples = self.samples_m.len();
            let empty = Scratch {
                points: vec![[[0.0; LANES]; 3]; samples],
                coordinates: vec![[[0.0; LANES]; 2]; samples],
                pixels: vec![[NO_PIXEL; LANES]; samples],
                counts: vec![0; self.sqrt_references.len()],
            };
            self.scratch.resize(chunks, empty);
        }
        let mut scratch = std::mem::take(&mut self.scratch);
        let this = &*self;
        let projector = Projector::new(view);
        let raster = Raster::new(view, COORDINATES_STRIDE);
        let open = view.mask().map(Mask::open);
        let width = view.size().0;
        let bins = self.settings.bins.count();
        let work = |(chunk, (out, scratch)): (usize, (&mut [f32], &mut Scratch))| {
            for (block, out) in out.chunks_mut(LANES).enumerate() {
                let start = chunk * CHUNK + block * LANES;
                let mut positions = [[0_f32; LANES]; 3];
                for (position, column) in positions.iter_mut().zip([x, y, z]) {
                    position[..out.len()].copy_from_slice(&column[start..start + out.len()]);
                }
                this.find_pixels(&projector, raster, &positions, scratch);
                let Scratch { pixels, counts, .. } = scratch;
                for (lane, out) in out.iter_mut().enumerate() {
                    let mut seen = 0;
                    for pixel in pixels.iter().map(|lanes| lanes[lane]) {
                        let x = (pixel % COORDINATES_STRIDE) as usize;
                        let y = (pixel / COORDINATES_STRIDE) as usize;
                        if pixel == NO_PIXEL || open.is_some_and(|open| !open[y * width + x]) {
                            continue;
                        }
                        seen += 1;
                        for (channel, bin) in bins_of(x, y).into_iter().enumerate() {
                            counts[channel * bins + usize::from(bin)] += 1;
                        }
                    }
                    *out += this.log_likelihood::<CHANNELS>(seen, counts);
                }
            }
        };
        out.par_chunks_mut(CHUNK)
            .zip(&mut scratch)
            .enumerate()
            .for_each(work);
        self.scratch = scratch;
    }

    /// Computes the log-likelihood of the counts and resets them to zero.
    #[inline(always)]
    fn log_likelihood<const CHANNELS: usize>(&self, seen: usize, counts: &mut [u16]) -> f32 {
        let mut similarity = 0.0;
        for (count, sqrt_reference) in counts.iter_mut().zip(&self.sqrt_references) {
            similarity += self.square_roots[usize::from(*count)] * sqrt_reference;
            *count = 0;
        }
        let enough = seen as f64 >= MIN_VISIBLE_SHARE * self.samples_m.len() as f64;
        let similarity = if enough {
            similarity / self.square_roots[seen]
        } else {
            0.0
        };
        self.settings
            .log_likelihood(CHANNELS as f64 - f64::from(similarity)) as f32
    }

    fn find_pixels(
        &self,
        projector: &Projector,
        raster: Raster,
        positions: &[[f32; LANES]; 3],
        scratch: &mut Scratch,
    ) {
        let Scratch {
            points,
            coordinates,
            pixels,
            ..
        } = scratch;
        let level = self.level;
        level.run(
            #[inline(always)]
            || {
                projector.write_offset_points(
                    positions,
                    Stance::default(),
                    &self.samples_m,
                    self.height_m,
                    points,
                );
            },
        );
        projector.project_all(level, points, coordinates);
        level.run(
            #[inline(always)]
            || raster.write_pixels(coordinates, pixels),
        );
    }
}
