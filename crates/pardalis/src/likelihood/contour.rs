//! The contour cue: colours just inside and just outside the projected outline (Taiana 2007, sections 4.2 to
//! 4.4).

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::boundary::{Sampling, ScaledSampling, SplineBasis, normals_by_neighbours};
use super::outline::{Coordinates, OutlineKernel, Points, Projector};
use super::raster::{COORDINATES_STRIDE, NO_PIXEL, Raster, share_pixels};
use crate::color::{ColorModel, Palette};
use crate::frame::with_pixels;
use crate::shape::{Shape, Stance};
use crate::view::{PreparedFrame, View};
use pardalis_camera::{LANES, Mask};
use pardalis_core::Error;
use pardalis_core::simd::Level;

/// Parameters of the contour cue.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[non_exhaustive]
pub struct ContourSettings {
    /// Number of points on the outline.
    pub points: usize,
    /// How the points on either side of the outline are found.
    pub sampling: Sampling,
    /// κ: the weight of the difference between inside and outside, relative to that of the similarity of
    /// inside and model.
    pub kappa: f64,
    /// b of the Laplacian exp(−D/b).
    pub b: f64,
}

impl Default for ContourSettings {
    /// The paper's offline settings for a ball.
    fn default() -> Self {
        Self {
            points: 50,
            sampling: Sampling::Scaled(ScaledSampling {
                inner_scale: 0.9,
                outer_scale: 1.1,
                shared_pixels: None,
            }),
            kappa: 1.5,
            b: 1.0 / 30.0,
        }
    }
}

impl ContourSettings {
    /// Returns the default for a shape: the paper's offline settings for balls and for robots (sections 6.1
    /// and 6.1.2).
    pub fn of_shape(shape: &Shape) -> Self {
        let ball = Self::default();
        match shape {
            Shape::Sphere(_) | Shape::Flat(_) => ball,
            Shape::Upright(_) => Self {
                points: 120,
                sampling: Sampling::Scaled(ScaledSampling {
                    inner_scale: 0.75,
                    outer_scale: 1.25,
                    shared_pixels: None,
                }),
                ..ball
            },
        }
    }

    /// Checks the settings.
    ///
    /// # Errors
    ///
    /// A number is out of range.
    pub fn check(&self) -> Result<(), Error> {
        let fail = |name, value: f64, allowed| Err(Error::out_of_range(name, value, allowed));
        if !(3..=10_000).contains(&self.points) {
            return fail("points", self.points as f64, "3 to 10000");
        }
        self.sampling.check(self.points)?;
        if !(self.kappa >= 0.0 && self.kappa <= 1e6) {
            return fail("kappa", self.kappa, "0 to 1e6");
        }
        if !(self.b > 0.0 && self.b <= 1e6) {
            return fail("b", self.b, "above 0 and at most 1e6");
        }
        Ok(())
    }

    /// Computes the log-likelihood from the similarities of the inner and outer histograms (eq. 4.11 and the
    /// Laplacian after it).
    #[inline(always)]
    pub fn log_likelihood(&self, model_inner_similarity: f64, outer_inner_similarity: f64) -> f64 {
        let distance = ((1.0 - model_inner_similarity) + self.kappa * outer_inner_similarity)
            / (self.kappa + 1.0);
        -distance.abs() / self.b
    }

    /// Returns the log-likelihood of pure background, D = 1, which a camera contributes that does not see
    /// enough of the contours.
    pub fn background_log_likelihood(&self) -> f64 {
        self.log_likelihood(0.0, 1.0)
    }
}

/// Particles counted side by side, which hides the latency of memory.
const GROUP: usize = 4;
/// Particles per work item of a thread.
const CHUNK: usize = 16 * LANES;
/// Look-ups per pixel of the image above which the whole image is binned first: measured on 640 x 480 images,
/// where binning costs about as much as it saves for 300 000 look-ups.
const LOOK_UPS_PER_PIXEL: usize = 1;

/// The contour cue of one target, with the buffers of its kernels.
#[derive(Debug)]
pub(super) struct ContourCue {
    settings: ContourSettings,
    /// Points on either side of the outline.
    samples: usize,
    outline: OutlineKernel,
    /// `Some` only if a spline is fitted.
    spline: Option<SplineBasis>,
    palette: Palette,
    /// √h of the colour model, and 0 for the bin of points without a pixel.
    sqrt_model: Vec<f32>,
    /// √n for n up to the number of samples.
    square_roots: Vec<f32>,
    scratch: Vec<Scratch>,
    /// The bin of every pixel of the current camera, row by row, or the bin of points without a pixel where
    /// it is masked. Empty if there are so few particles that each looks up the frame directly.
    binned: Vec<u16>,
    level: Level,
}

/// Buffers of one work item.
#[derive(Debug, Clone)]
struct Scratch {
    /// Outlines in the camera frame and in the image, their normals, and the control points of their splines.
    points: Vec<Points>,
    coordinates: Vec<Coordinates>,
    normals: Vec<Coordinates>,
    control: Vec<Coordinates>,
    /// Pixels of the inner contours, then of the outer ones: `y * stride + x` or [`NO_PIXEL`], point by
    /// point, one lane per particle.
    pixels: Vec<[u32; LANES]>,
    /// Bins of the inner points of a group of particles, then of their outer points.
    bins: Vec<[u16; GROUP]>,
    /// Inner and outer points in each bin, one column per particle; all zero between particles. The bin after
    /// those of the palette holds the points without a pixel.
    inner_counts: Vec<[u16; GROUP]>,
    outer_counts: Vec<[u16; GROUP]>,
}

impl ContourCue {
    /// Creates the cue of a target with the given shape and colours.
    pub(super) fn new(
        settings: ContourSettings,
        shape: Shape,
        colors: &ColorModel,
        level: Level,
    ) -> Result<Self, Error> {
        settings.check()?;
        let points = settings.points;
        let samples = settings.sampling.samples(points);
        Ok(Self {
            settings,
            samples,
            outline: OutlineKernel::new(shape, points),
            spline: match settings.sampling {
                Sampling::Scaled(_) => None,
                Sampling::Spline(spline) => Some(SplineBasis::new(points, spline.control_points)),
            },
            palette: colors.palette(),
            sqrt_model: colors
                .histogram()
                .shares()
                .iter()
                .map(|h| h.sqrt() as f32)
                .chain([0.0])
                .collect(),
            square_roots: (0..=samples).map(|n| (n as f64).sqrt() as f32).collect(),
            scratch: Vec::new(),
            binned: Vec::new(),
            level,
        })
    }

    /// Returns the settings.
    pub(super) fn settings(&self) -> &ContourSettings {
        &self.settings
    }

    /// Returns the palette with which frames must be prepared.
    pub(super) fn palette(&self) -> Palette {
        self.palette
    }

    /// Adds one camera's log-likelihood of each particle.
    pub(super) fn add_camera(
        &mut self,
        prepared: &PreparedFrame,
        [x, y, z]: [&[f32]; 3],
        out: &mut [f32],
    ) {
        let chunks = out.len().div_ceil(CHUNK);
        if self.scratch.len() < chunks {
            let (no_coordinates, points) = ([[0.0; LANES]; 2], self.settings.points);
            let control_points = match self.settings.sampling {
                Sampling::Scaled(_) => 0,
                Sampling::Spline(spline) => spline.control_points,
            };
            let empty = Scratch {
                points: vec![[[0.0; LANES]; 3]; points],
                coordinates: vec![no_coordinates; points],
                normals: vec![no_coordinates; points],
                control: vec![no_coordinates; control_points],
                pixels: vec![[NO_PIXEL; LANES]; 2 * self.samples],
                bins: vec![[0; GROUP]; 2 * self.samples],
                inner_counts: vec![[0; GROUP]; self.palette.bin_count() + 1],
                outer_counts: vec![[0; GROUP]; self.palette.bin_count() + 1],
            };
            self.scratch.resize(chunks, empty);
        }
        self.bin_image(prepared, 2 * self.samples * out.len());
        let mut scratch = std::mem::take(&mut self.scratch);
        let this = &*self;
        let work = |(chunk, (out, scratch)): (usize, (&mut [f32], &mut Scratch))| {
            let range = chunk * CHUNK..chunk * CHUNK + out.len();
            let positions = [&x[range.clone()], &y[range.clone()], &z[range]];
            this.add_chunk(prepared, positions, out, scratch);
        };
        if chunks == 1 || rayon::current_num_threads() == 1 {
            out.chunks_mut(CHUNK)
                .zip(&mut scratch)
                .enumerate()
                .for_each(work);
        } else {
            out.par_chunks_mut(CHUNK)
                .zip(&mut scratch)
                .enumerate()
                .for_each(work);
        }
        self.scratch = scratch;
    }

    /// Bins the whole image if that is cheaper than `look_ups` single look-ups.
    fn bin_image(&mut self, prepared: &PreparedFrame, look_ups: usize) {
        let (width, height) = prepared.view().size();
        self.binned.clear();
        if look_ups < LOOK_UPS_PER_PIXEL * width * height {
            return;
        }
        let no_bin = self.palette.bin_count() as u16;
        self.binned.resize(width * height, no_bin);
        let table = prepared.table(self.palette);
        let open = prepared.view().mask().map(Mask::open);
        with_pixels!(prepared.frame(), components => {
            self.binned.par_chunks_mut(width).enumerate().for_each(|(y, row)| {
                for (x, bin) in row.iter_mut().enumerate() {
                    if open.is_none_or(|open| open[y * width + x]) {
                        *bin = table.bin(components(x, y));
                    }
                }
            });
        });
    }

    fn add_chunk(
        &self,
        prepared: &PreparedFrame,
        [x, y, z]: [&[f32]; 3],
        out: &mut [f32],
        scratch: &mut Scratch,
    ) {
        let (width, _) = prepared.view().size();
        let stride = if self.binned.is_empty() {
            COORDINATES_STRIDE
        } else {
            width as u32
        };
        let projector = Projector::new(prepared.view());
        let raster = Raster::new(prepared.view(), stride);
        let table = prepared.table(self.palette);
        let no_bin = self.palette.bin_count() as u16;
        for start in (0..out.len()).step_by(LANES) {
            let lanes = LANES.min(out.len() - start);
            let mut centers = [[0_f32; LANES]; 3];
            for (center, column) in centers.iter_mut().zip([x, y, z]) {
                center[..lanes].copy_from_slice(&column[start..start + lanes]);
            }
            self.find_pixels(&projector, raster, &centers, scratch);
            let out = &mut out[start..start + lanes];
            if self.binned.is_empty() {
                Self::close_masked(prepared.view(), &mut scratch.pixels);
                with_pixels!(prepared.frame(), components => {
                    let bin_at = |pixel: u32| {
                        let (x, y) = (pixel % COORDINATES_STRIDE, pixel / COORDINATES_STRIDE);
                        if pixel == NO_PIXEL { no_bin } else { table.bin(components(x as usize, y as usize)) }
                    };
                    self.add_block(bin_at, out, scratch);
                });
            } else {
                // `NO_PIXEL` lies beyond every image.
                let bin_at =
                    |pixel: u32| self.binned.get(pixel as usize).copied().unwrap_or(no_bin);
                self.add_block(bin_at, out, scratch);
            }
        }
    }

    /// Writes the pixels on either side of the outlines of a block of particles.
    fn find_pixels(
        &self,
        projector: &Projector,
        raster: Raster,
        positions: &[[f32; LANES]; 3],
        scratch: &mut Scratch,
    ) {
        let level = self.level;
        let Scratch {
            points,
            coordinates,
            normals,
            control,
            pixels,
            ..
        } = scratch;
        let (inner, outer) = pixels.split_at_mut(self.samples);
        let project = |scale, points: &mut [Points], coordinates: &mut [Coordinates]| {
            let stance = Stance::scaled(scale);
            self.outline
                .project(level, projector, positions, stance, points, coordinates);
        };
        match &self.settings.sampling {
            Sampling::Scaled(scaled) => {
                for (scale, pixels) in [
                    (scaled.inner_scale, &mut *inner),
                    (scaled.outer_scale, outer),
                ] {
                    project(scale, points, coordinates);
                    level.run(
                        #[inline(always)]
                        || raster.write_pixels(coordinates, pixels),
                    );
                }
                let Some(shared_pixels) = scaled.shared_pixels else {
                    return;
                };
                let mut spread = [false; LANES];
                level.run(
                    #[inline(always)]
                    || spread = share_pixels(inner, outer, shared_pixels.max_share as f32),
                );
                if spread.contains(&true) {
                    project(1.0, points, coordinates);
                    let distance_px = shared_pixels.distance_px as f32;
                    level.run(
                        #[inline(always)]
                        || {
                            normals_by_neighbours(coordinates, normals);
                            raster.write_along_normals(
                                coordinates,
                                normals,
                                -distance_px,
                                &spread,
                                inner,
                            );
                            raster.write_along_normals(
                                coordinates,
                                normals,
                                distance_px,
                                &spread,
                                outer,
                            );
                        },
                    );
                }
            }
            Sampling::Spline(spline) => {
                let basis = self.spline.as_ref().expect("made with the settings");
                project(1.0, points, coordinates);
                level.run(
                    #[inline(always)]
                    || {
                        basis.fit(coordinates, control);
                        let origin = coordinates[0];
                        basis.trace(&origin, control, coordinates, normals);
                        let steps = usize::from(!spline.middle)..=spline.steps;
                        let sides = inner
                            .chunks_mut(self.settings.points)
                            .zip(outer.chunks_mut(self.settings.points));
                        for (step, (inner, outer)) in steps.zip(sides) {
                            let distance_px =
                                (spline.reach_px * step as f64 / spline.steps as f64) as f32;
                            let all = [true; LANES];
                            raster.write_along_normals(
                                coordinates,
                                normals,
                                -distance_px,
                                &all,
                                inner,
                            );
                            raster.write_along_normals(
                                coordinates,
                                normals,
                                distance_px,
                                &all,
                                outer,
                            );
                        }
                    },
                );
            }
        }
    }

    /// Replaces the pixels that the mask closes with `NO_PIXEL`.
    fn close_masked(view: &View, pixels: &mut [[u32; LANES]]) {
        let Some(mask) = view.mask() else { return };
        let (open, width) = (mask.open(), mask.width());
        for pixel in pixels.iter_mut().flatten().filter(|p| **p != NO_PIXEL) {
            if !open[(*pixel >> 16) as usize * width + (*pixel & 0xffff) as usize] {
                *pixel = NO_PIXEL;
            }
        }
    }

    /// Adds the log-likelihoods of a block of particles from the pixels of their contours.
    #[inline(always)]
    fn add_block(&self, bin_at: impl Fn(u32) -> u16, out: &mut [f32], scratch: &mut Scratch) {
        let Scratch {
            pixels,
            bins,
            inner_counts,
            outer_counts,
            ..
        } = scratch;
        for (group, out) in out.chunks_mut(GROUP).enumerate() {
            for (pixels, bins) in pixels.iter().zip(&mut *bins) {
                for (i, bin) in bins.iter_mut().enumerate() {
                    *bin = bin_at(pixels[group * GROUP + i]);
                }
            }
            let (inner, outer) = bins.split_at(self.samples);
            let log_likelihoods = self.log_likelihoods(inner, outer, inner_counts, outer_counts);
            for (out, log_likelihood) in out.iter_mut().zip(log_likelihoods) {
                *out += log_likelihood;
            }
        }
    }

    /// Computes the log-likelihoods of a group of particles from the bins along both contours, one bin per
    /// point. Leaves all counts at zero.
    ///
    /// Both similarities are sums over the bins of inner points, and each bin is evaluated at the first of
    /// its points, so that no histogram is ever traversed.
    #[inline(always)]
    fn log_likelihoods(
        &self,
        inner: &[[u16; GROUP]],
        outer: &[[u16; GROUP]],
        inner_counts: &mut [[u16; GROUP]],
        outer_counts: &mut [[u16; GROUP]],
    ) -> [f32; GROUP] {
        let samples = self.samples;
        let no_bin = self.palette.bin_count();
        for (inner, outer) in inner.iter().zip(outer) {
            for i in 0..GROUP {
                inner_counts[usize::from(inner[i])][i] += 1;
                outer_counts[usize::from(outer[i])][i] += 1;
            }
        }
        let seen = |unseen: [u16; GROUP]| unseen.map(|n| samples - usize::from(n));
        let inner_seen = seen(std::mem::take(&mut inner_counts[no_bin]));
        let outer_seen = seen(outer_counts[no_bin]);
        let root = |n: u16| self.square_roots[usize::from(n)];
        let mut model_inner = [0_f32; GROUP];
        let mut outer_inner = [0_f32; GROUP];
        for bins in inner {
            for i in 0..GROUP {
                let bin = usize::from(bins[i]);
                let sqrt_inner = root(std::mem::take(&mut inner_counts[bin][i]));
                model_inner[i] += self.sqrt_model[bin] * sqrt_inner;
                outer_inner[i] += root(outer_counts[bin][i]) * sqrt_inner;
            }
        }
        for bins in outer {
            for i in 0..GROUP {
                outer_counts[usize::from(bins[i])][i] = 0;
            }
        }
        std::array::from_fn(|i| {
            if 2 * inner_seen[i] < samples || 2 * outer_seen[i] < samples {
                return self.settings.background_log_likelihood() as f32;
            }
            let sqrt_inner = self.square_roots[inner_seen[i]];
            let model_inner = model_inner[i] / sqrt_inner;
            let outer_inner = outer_inner[i] / (sqrt_inner * self.square_roots[outer_seen[i]]);
            self.settings
                .log_likelihood(f64::from(model_inner), f64::from(outer_inner)) as f32
        })
    }
}
