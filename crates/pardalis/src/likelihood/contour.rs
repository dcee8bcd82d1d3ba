//! Colour just inside and just outside the projected outline (Taiana 2007, sections 4.2 to 4.4).

use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use super::Likelihood;
use crate::camera::{Mask, Projection, with_model};
use crate::color::{ColorModel, Palette};
use crate::frame::with_pixels;
use crate::particles::Particles;
use crate::shape::{OutlineCircle, Shape, SphereOutline};
use crate::simd::Level;
use crate::view::{Evidence, View};
use crate::{Error, Frame};

/// Parameters of the contour cue.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct ContourSettings {
    /// The inner contour is the outline of the shape scaled by this, below 1.
    pub inner_scale: f64,
    /// The outer contour is the outline of the shape scaled by this, above 1.
    pub outer_scale: f64,
    /// Points on each contour.
    pub points: usize,
    /// κ: how much more the difference between inside and outside counts than the likeness of inside and model.
    pub kappa: f64,
    /// b of the Laplacian exp(−D/b).
    pub b: f64,
}

impl Default for ContourSettings {
    /// The paper's offline settings.
    fn default() -> Self {
        Self {
            inner_scale: 0.9,
            outer_scale: 1.1,
            points: 50,
            kappa: 1.5,
            b: 1.0 / 30.0,
        }
    }
}

impl ContourSettings {
    /// Refuses what makes no contour.
    pub fn check(&self) -> Result<(), Error> {
        let fail = |name, value: f64, allowed| Err(Error::out_of_range(name, value, allowed));
        if !(self.inner_scale > 0.0 && self.inner_scale < 1.0) {
            return fail("inner_scale", self.inner_scale, "above 0 and below 1");
        }
        if !(self.outer_scale > 1.0 && self.outer_scale <= 10.0) {
            return fail("outer_scale", self.outer_scale, "above 1 and at most 10");
        }
        if !(3..=10_000).contains(&self.points) {
            return fail("points", self.points as f64, "3 to 10000");
        }
        if !(self.kappa >= 0.0 && self.kappa <= 1e6) {
            return fail("kappa", self.kappa, "0 to 1e6");
        }
        if !(self.b > 0.0 && self.b <= 1e6) {
            return fail("b", self.b, "above 0 and at most 1e6");
        }
        Ok(())
    }

    /// The log-likelihood of inner and outer histograms of these similarities (eq. 4.11 and the Laplacian after it).
    #[inline(always)]
    pub fn log_likelihood(&self, model_inner_similarity: f64, outer_inner_similarity: f64) -> f64 {
        let distance = ((1.0 - model_inner_similarity) + self.kappa * outer_inner_similarity)
            / (self.kappa + 1.0);
        -distance.abs() / self.b
    }

    /// The log-likelihood of pure background, D = 1: what a camera contributes that does not see enough of the contours.
    pub fn background_log_likelihood(&self) -> f64 {
        self.log_likelihood(0.0, 1.0)
    }
}

/// Particles a block: the lanes of the projection kernel.
const LANES: usize = 16;
/// Particles whose points are counted side by side: counting waits for memory, and one waits while the other counts.
const ABREAST: usize = 4;
/// Rows apart in the number of a pixel, where look-ups need both its coordinates.
const COORDINATES_STRIDE: u32 = 1 << 16;
/// Particles a piece of work for one thread.
const CHUNK: usize = 16 * LANES;
/// Look-ups for each pixel of the image above which the whole image is turned into bins first: measured on 640 x 480 images, where
/// that costs about as much as 300 000 look-ups save.
const LOOK_UPS_A_PIXEL: usize = 1;
/// A contour point that carries no evidence.
const NO_PIXEL: u32 = u32::MAX;

/// The contour cue of one target, with the buffers that its kernels need.
#[derive(Debug)]
pub struct ContourCue {
    settings: ContourSettings,
    shape: Shape,
    palette: Palette,
    /// √h of the colour model, and 0 for the bin of points without a pixel.
    sqrt_model: Vec<f32>,
    /// √n for n up to the number of points.
    square_roots: Vec<f32>,
    /// Cosine and sine of each contour point's angle.
    angles: Vec<(f32, f32)>,
    scratch: Vec<Scratch>,
    /// The bin of every pixel of the camera at hand, row by row, or the bin of points without a pixel where it is masked. Empty where the
    /// particles are so few that each looks up the frame itself.
    binned: Vec<u16>,
    level: Level,
}

/// Buffers of one piece of work.
#[derive(Debug, Clone)]
struct Scratch {
    /// Pixels of the inner contours, then of the outer: `y * stride + x` or [`NO_PIXEL`], point by point, a lane a particle.
    pixels: Vec<[u32; LANES]>,
    /// Bins of the inner points of a few particles, then of their outer.
    bins: Vec<[u16; ABREAST]>,
    /// Inner and outer points in each bin, a column a particle; all zero between particles. The bin after the palette's holds the points
    /// without a pixel.
    inner_counts: Vec<[u16; ABREAST]>,
    outer_counts: Vec<[u16; ABREAST]>,
}

impl ContourCue {
    /// The cue of a target of this shape and these colours.
    pub fn new(
        settings: ContourSettings,
        shape: Shape,
        colors: &ColorModel,
        level: Level,
    ) -> Result<Self, Error> {
        settings.check()?;
        let points = settings.points;
        Ok(Self {
            settings,
            shape,
            palette: colors.palette(),
            sqrt_model: colors
                .histogram()
                .shares()
                .iter()
                .map(|h| h.sqrt() as f32)
                .chain([0.0])
                .collect(),
            square_roots: (0..=points).map(|n| (n as f64).sqrt() as f32).collect(),
            angles: (0..points)
                .map(|k| {
                    let (sin, cos) = libm::sincos(k as f64 / points as f64 * std::f64::consts::TAU);
                    (cos as f32, sin as f32)
                })
                .collect(),
            scratch: Vec::new(),
            binned: Vec::new(),
            level,
        })
    }

    /// The settings.
    pub fn settings(&self) -> &ContourSettings {
        &self.settings
    }

    /// The palette that evidence must be made with.
    pub fn palette(&self) -> Palette {
        self.palette
    }

    /// This cue's likelihood of the frames of one instant, each with its camera's number: the product over the cameras. The views
    /// are prepared for the frames and this cue's palette.
    pub fn of<'a>(
        &'a mut self,
        views: &'a [View],
        frames: &'a [(usize, Frame)],
    ) -> ContourLikelihood<'a> {
        ContourLikelihood {
            cue: self,
            views,
            frames,
        }
    }
}

/// The contour cue, looking at the frames of one instant.
#[derive(Debug)]
pub struct ContourLikelihood<'a> {
    cue: &'a mut ContourCue,
    views: &'a [View],
    frames: &'a [(usize, Frame)],
}

impl Likelihood for ContourLikelihood<'_> {
    fn log_likelihoods(&mut self, particles: &Particles, out: &mut [f32]) {
        out.fill(0.0);
        for (camera, frame) in self.frames {
            let evidence = self.views[*camera].evidence(frame);
            self.cue.add_camera(&evidence, particles.positions_m(), out);
        }
    }
}

impl ContourCue {
    /// Adds what one camera says of each particle.
    fn add_camera(&mut self, evidence: &Evidence, [x, y, z]: [&[f32]; 3], out: &mut [f32]) {
        let chunks = out.len().div_ceil(CHUNK);
        if self.scratch.len() < chunks {
            let empty = Scratch {
                pixels: vec![[NO_PIXEL; LANES]; 2 * self.settings.points],
                bins: vec![[0; ABREAST]; 2 * self.settings.points],
                inner_counts: vec![[0; ABREAST]; self.palette.bin_count() + 1],
                outer_counts: vec![[0; ABREAST]; self.palette.bin_count() + 1],
            };
            self.scratch.resize(chunks, empty);
        }
        self.bin_image(evidence, 2 * self.settings.points * out.len());
        let mut scratch = std::mem::take(&mut self.scratch);
        let this = &*self;
        let work = |(chunk, (out, scratch)): (usize, (&mut [f32], &mut Scratch))| {
            let range = chunk * CHUNK..chunk * CHUNK + out.len();
            let positions = [&x[range.clone()], &y[range.clone()], &z[range]];
            this.add_chunk(evidence, positions, out, scratch);
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

    /// Turns the whole image into bins where that is cheaper than so many look-ups one by one.
    fn bin_image(&mut self, evidence: &Evidence, look_ups: usize) {
        let (width, height) = evidence.view().size();
        self.binned.clear();
        if look_ups < LOOK_UPS_A_PIXEL * width * height {
            return;
        }
        let no_bin = self.palette.bin_count() as u16;
        self.binned.resize(width * height, no_bin);
        let table = evidence.table(self.palette);
        let open = evidence.view().mask().map(Mask::open);
        with_pixels!(evidence.frame(), components => {
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
        evidence: &Evidence,
        [x, y, z]: [&[f32]; 3],
        out: &mut [f32],
        scratch: &mut Scratch,
    ) {
        let (width, _) = evidence.view().size();
        let stride = if self.binned.is_empty() {
            COORDINATES_STRIDE
        } else {
            width as u32
        };
        let projector = Projector::new(evidence.view(), stride);
        let table = evidence.table(self.palette);
        let no_bin = self.palette.bin_count() as u16;
        for start in (0..out.len()).step_by(LANES) {
            let lanes = LANES.min(out.len() - start);
            let mut centers = [[0_f32; LANES]; 3];
            for (center, column) in centers.iter_mut().zip([x, y, z]) {
                center[..lanes].copy_from_slice(&column[start..start + lanes]);
            }
            self.find_pixels(evidence.view(), &projector, &centers, &mut scratch.pixels);
            let out = &mut out[start..start + lanes];
            if self.binned.is_empty() {
                Self::close_masked(evidence.view(), &mut scratch.pixels);
                with_pixels!(evidence.frame(), components => {
                    let bin_at = |pixel: u32| {
                        let (x, y) = (pixel % COORDINATES_STRIDE, pixel / COORDINATES_STRIDE);
                        if pixel == NO_PIXEL { no_bin } else { table.bin(components(x as usize, y as usize)) }
                    };
                    self.add_block(bin_at, out, scratch);
                });
            } else {
                // NO_PIXEL lies beyond every image.
                let bin_at =
                    |pixel: u32| self.binned.get(pixel as usize).copied().unwrap_or(no_bin);
                self.add_block(bin_at, out, scratch);
            }
        }
    }

    /// Writes the pixels of both contours of a block of particles, as `y * stride + x`.
    fn find_pixels(
        &self,
        view: &View,
        projector: &Projector,
        centers: &[[f32; LANES]; 3],
        pixels: &mut [[u32; LANES]],
    ) {
        let Shape::Sphere(sphere) = self.shape;
        let (inner, outer) = pixels.split_at_mut(self.settings.points);
        with_model!(view.camera(), model => {
            let model = model.to_f32();
            for (scale, pixels) in [(self.settings.inner_scale, inner), (self.settings.outer_scale, outer)] {
                let radius = (scale * sphere.radius_m) as f32;
                self.level.run(
                    #[inline(always)]
                    || projector.project_circles(&model, centers, radius, sphere.outline, &self.angles, pixels),
                );
            }
        });
    }

    /// Takes the evidence from the pixels that the mask closes.
    fn close_masked(view: &View, pixels: &mut [[u32; LANES]]) {
        let Some(mask) = view.mask() else { return };
        let (open, width) = (mask.open(), mask.width());
        for pixel in pixels.iter_mut().flatten().filter(|p| **p != NO_PIXEL) {
            if !open[(*pixel >> 16) as usize * width + (*pixel & 0xffff) as usize] {
                *pixel = NO_PIXEL;
            }
        }
    }

    /// Adds the log-likelihoods of a block of particles whose contours' pixels are known.
    #[inline(always)]
    fn add_block(&self, bin_at: impl Fn(u32) -> u16, out: &mut [f32], scratch: &mut Scratch) {
        let Scratch {
            pixels,
            bins,
            inner_counts,
            outer_counts,
        } = scratch;
        for (group, out) in out.chunks_mut(ABREAST).enumerate() {
            for (pixels, bins) in pixels.iter().zip(&mut *bins) {
                for (i, bin) in bins.iter_mut().enumerate() {
                    *bin = bin_at(pixels[group * ABREAST + i]);
                }
            }
            let (inner, outer) = bins.split_at(self.settings.points);
            let log_likelihoods = self.log_likelihoods(inner, outer, inner_counts, outer_counts);
            for (out, log_likelihood) in out.iter_mut().zip(log_likelihoods) {
                *out += log_likelihood;
            }
        }
    }

    /// The log-likelihoods of a few particles from the bins along both contours, one for each point. Leaves all counts zero.
    ///
    /// Both similarities are sums over the bins of inner points, and each bin is taken at the first of its points: no histogram is ever
    /// walked over.
    #[inline(always)]
    fn log_likelihoods(
        &self,
        inner: &[[u16; ABREAST]],
        outer: &[[u16; ABREAST]],
        inner_counts: &mut [[u16; ABREAST]],
        outer_counts: &mut [[u16; ABREAST]],
    ) -> [f32; ABREAST] {
        let points = self.settings.points;
        let no_bin = self.palette.bin_count();
        for (inner, outer) in inner.iter().zip(outer) {
            for i in 0..ABREAST {
                inner_counts[usize::from(inner[i])][i] += 1;
                outer_counts[usize::from(outer[i])][i] += 1;
            }
        }
        let seen = |unseen: [u16; ABREAST]| unseen.map(|n| points - usize::from(n));
        let inner_seen = seen(std::mem::take(&mut inner_counts[no_bin]));
        let outer_seen = seen(outer_counts[no_bin]);
        let root = |n: u16| self.square_roots[usize::from(n)];
        let mut model_inner = [0_f32; ABREAST];
        let mut outer_inner = [0_f32; ABREAST];
        for bins in inner {
            for i in 0..ABREAST {
                let bin = usize::from(bins[i]);
                let sqrt_inner = root(std::mem::take(&mut inner_counts[bin][i]));
                model_inner[i] += self.sqrt_model[bin] * sqrt_inner;
                outer_inner[i] += root(outer_counts[bin][i]) * sqrt_inner;
            }
        }
        for bins in outer {
            for i in 0..ABREAST {
                outer_counts[usize::from(bins[i])][i] = 0;
            }
        }
        std::array::from_fn(|i| {
            if 2 * inner_seen[i] < points || 2 * outer_seen[i] < points {
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

/// A camera's pose and image size in single precision.
struct Projector {
    rotation: [[f32; 3]; 3],
    translation: [f32; 3],
    /// Pixels up to these coordinates lie in the image.
    last_u_px: f32,
    last_v_px: f32,
    /// Rows apart in the number of a pixel.
    stride: u32,
}

impl Projector {
    fn new(view: &View, stride: u32) -> Self {
        let pose = view.camera_from_world();
        let (width, height) = view.size();
        Self {
            rotation: [0, 1, 2].map(|i| [0, 1, 2].map(|j| pose.rotation[(i, j)] as f32)),
            translation: [0, 1, 2].map(|i| pose.translation.vector[i] as f32),
            last_u_px: width as f32 - 0.5,
            last_v_px: height as f32 - 0.5,
            stride,
        }
    }

    /// Projects the outlines of spheres around `centers` in the world. Lanes are particles; plain loops that the compiler vectorises.
    #[inline(always)]
    fn project_circles<P: Projection<f32>>(
        &self,
        model: &P,
        centers: &[[f32; LANES]; 3],
        radius: f32,
        outline: SphereOutline,
        angles: &[(f32, f32)],
        pixels: &mut [[u32; LANES]],
    ) {
        let mut center = [[0_f32; LANES]; 3];
        let mut a = [[0_f32; LANES]; 3];
        let mut b = [[0_f32; LANES]; 3];
        let mut outside = [false; LANES];
        for lane in 0..LANES {
            let [x, y, z] = [centers[0][lane], centers[1][lane], centers[2][lane]];
            let in_camera = |i: usize| {
                let [r0, r1, r2] = self.rotation[i];
                r0 * x + r1 * y + r2 * z + self.translation[i]
            };
            let (circle, is_outside) = OutlineCircle::of_sphere(
                [in_camera(0), in_camera(1), in_camera(2)],
                radius,
                outline,
            );
            outside[lane] = is_outside;
            for axis in 0..3 {
                center[axis][lane] = circle.center[axis];
                a[axis][lane] = circle.a[axis];
                b[axis][lane] = circle.b[axis];
            }
        }
        for (&(cos, sin), pixels) in angles.iter().zip(pixels) {
            for lane in 0..LANES {
                let at = |i: usize| center[i][lane] + cos * a[i][lane] + sin * b[i][lane];
                let ([u, v], valid) = model.project([at(0), at(1), at(2)]);
                let inside = (u > -0.5) & (u < self.last_u_px) & (v > -0.5) & (v < self.last_v_px);
                let pixel = rounded(v) * self.stride + rounded(u);
                pixels[lane] = if valid & inside & outside[lane] {
                    pixel
                } else {
                    NO_PIXEL
                };
            }
        }
    }
}

/// The nearest whole number to a number between −0.5 and 2^14, ties to even: the addition shifts the fraction out.
#[inline(always)]
fn rounded(x: f32) -> u32 {
    (x + 12_582_912.0).to_bits() & 0xffff
}
