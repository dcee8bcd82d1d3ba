//! Correspondence lines across an outline in one frame: the log-likelihood of the outline's shift along each line.

use super::corners::{Corner, Crossing, bend, corner, nearest, orientation};
use super::frame::{Octave, SECTORS};
use super::streak::{Mixture, Streak};
use super::{EdgeFrame, EdgeSettings, Surrounding, Table};
use crate::color::{BodyColors, EdgePixel, Surroundings};
use crate::likelihood::outline::Coordinates;
use crate::tuning::EdgeTuning;

/// The reach of lines either way, in pixels. Hand-set: positions off by more are found by the next round of the fit.
pub(super) const REACH_PX: f32 = 5.0;
/// The shifts of a line: a quarter of a pixel apart, as the distances of edge profiles. Derivation: 2 · 5 px · 4 + 1.
pub(super) const SHIFTS: usize = 41;
pub(super) const SHIFTS_A_PX: usize = 4;
/// The band of pixels that are looked at, signed distances from the outline in pixels: reach plus the colours of either side. Hand-set.
const BAND_PX: std::ops::RangeInclusive<f32> = -9.0..=8.0;
/// Pixels that show what surrounds the body, signed distances from the outline in pixels. Hand-set: beyond the blur of edges.
const SURROUNDING_PX: std::ops::RangeInclusive<f32> = 3.0..=7.0;
/// The weight of squared differences in U and V against those in Y, when surroundings are compared. Hand-set: chroma changes less with shadows.
const CHROMA_WEIGHT: f32 = 2.0;

/// Why no outline was fitted. Of several cameras the one counts that came nearest to a fit, the last of these.
#[derive(Debug, Clone, Copy, PartialEq, PartialOrd)]
pub(crate) enum NoFit {
    /// Most of the outline lies outside of every image.
    OutOfView,
    /// Inside and outside have the same colours, or the edges determine no position.
    NoEdges,
    /// Only this share of the outline shows the target's colours.
    Covered(f32),
}

/// Correspondence lines across an outline in one camera's frame.
#[derive(Debug, Clone, Default)]
pub(super) struct CorrespondenceLines {
    /// The camera's number.
    pub(super) camera: usize,
    /// The octave in whose pixels lines are measured.
    pub(super) octave: Octave,
    /// The point of the frame at which each line crosses the outline, and its direction outwards.
    crossings: Vec<Crossing>,
    /// The log-likelihood ratio of each line's pixels for shifts of the outline from −5 to 5 px, against no body there.
    log_ratios: Vec<[f32; SHIFTS]>,
    /// Of each sector: the probability that the body is visible there, ...
    visible: [f32; SECTORS],
    /// ... and the log-likelihood of an edge anywhere along its lines: what a body of any other outline would give.
    anywhere: [f32; SECTORS],
    /// What surrounds the body in each sector.
    pub(super) surrounding: Surrounding,
    /// How far that is unchanged: 1, or down to 0 where something else has come, which may occlude the body.
    pub(super) unchanged: [f32; SECTORS],
    /// The exponent of the lines' likelihoods.
    pub(super) likelihood_exponent: f32,
    /// By how much a line speaks against shifts beyond its reach, nats.
    beyond_reach_nats: f32,
    /// The share of the outline along which the body's colours are visible.
    pub(super) visible_share: f32,
    /// The share of the pixels around it in the target's colours.
    pub(super) around_share: f32,
    /// The mean Y, U and V of its pixels there; NaN if there are none.
    pub(super) body_color: [f32; 3],
    /// How far the colours on both sides differ, grey levels.
    pub(super) contrast: f32,
    /// The log-likelihood ratio of the fitted outline, nats.
    pub(super) fitted_log_ratio: f32,
}

/// Buffers that lines are made with.
#[derive(Debug)]
pub(super) struct LineBuffers {
    pixels: Vec<EdgePixel>,
    /// The line of each pixel, and whether it has the body's colours.
    places: Vec<(usize, bool)>,
    corners: Vec<Corner>,
    streak: Streak,
    /// What each pixel is in a streak; none for a body at rest.
    mixtures: Vec<Mixture>,
}

impl LineBuffers {
    /// Pixels that there is room for in advance. Hand-set: enough for all but the longest outlines.
    const PIXELS: usize = 8192;

    pub(super) fn new() -> Self {
        Self {
            pixels: Vec::with_capacity(Self::PIXELS),
            places: Vec::with_capacity(Self::PIXELS),
            corners: Vec::new(),
            streak: Streak::with_room(Self::PIXELS),
            mixtures: Vec::with_capacity(Self::PIXELS),
        }
    }
}

/// Counts and sums of the colours of pixels near an outline.
#[derive(Default)]
struct SectorColors {
    /// The number of the body's pixels in each sector, and of those in the target's colours.
    bodies: [f32; SECTORS],
    matching: [f32; SECTORS],
    /// The colours around the body in each sector.
    around: [[f32; 4]; SECTORS],
    /// The number of pixels around it in the target's colours.
    matching_around: f32,
    /// The body's own colours.
    body: [f32; 4],
}

impl SectorColors {
    /// Adds a pixel of the body, with its colour if that is one of the target's.
    fn add_body(&mut self, sector: usize, weight: f32, color: Option<[f32; 3]>) {
        self.bodies[sector] += weight;
        if let Some(color) = color {
            self.matching[sector] += weight;
            add(&mut self.body, color);
        }
    }
}

/// Adds a colour to a count and a sum of colours.
fn add([count, sums @ ..]: &mut [f32; 4], yuv: [f32; 3]) {
    *count += 1.0;
    for (sum, value) in sums.iter_mut().zip(yuv) {
        *sum += value;
    }
}

/// The mean of a count and a sum of colours; NaN for none.
fn mean([count, sums @ ..]: &[f32; 4]) -> [f32; 3] {
    sums.map(|sum| sum / count)
}

impl CorrespondenceLines {
    /// Lines with room for an outline of this many points.
    pub(super) fn with_room(points: usize) -> Self {
        Self {
            crossings: Vec::with_capacity(points),
            log_ratios: Vec::with_capacity(points),
            ..Self::default()
        }
    }

    /// Places lines across an outline, given as the first lane of its points, in an octave of the frame. Returns why not if too little of it lies in the image, shows edges, or
    /// shows the body's colours.
    pub(super) fn place(
        &mut self,
        (frame, octave): (&EdgeFrame, Octave),
        (outline, displacement_px): (&[Coordinates], [f32; 2]),
        table: &Table,
        (settings, tuning): (&EdgeSettings, &EdgeTuning),
        buffers: &mut LineBuffers,
    ) -> Result<(), NoFit> {
        self.camera = frame.camera();
        self.octave = octave;
        self.beyond_reach_nats = tuning.beyond_reach_nats;
        let LineBuffers {
            pixels,
            places,
            corners,
            streak,
            mixtures,
        } = buffers;
        let count = outline.len();
        let orientation = orientation(outline);
        corners.clear();
        corners.extend((0..count).map(|k| corner(outline, octave, k, orientation)));
        bend(corners);
        self.crossings.clear();
        self.crossings.extend((0..count).map(|k| Crossing {
            point: outline[k].map(|lanes| lanes[0]),
            normal: corners[k].crossing.normal,
        }));
        let crossings = self.crossings.iter();
        let inside = crossings.filter(|crossing| frame.holds(crossing.point));
        if (inside.count() as f32) < tuning.min_inside_share * count as f32 {
            return Err(NoFit::OutOfView);
        }
        let lengths = corners.iter().map(|corner| corner.length_px);
        let lengths_are_finite = lengths.clone().all(f32::is_finite);
        let length_px: f32 = lengths.filter(|length| length.is_finite()).sum();
        let displacement = displacement_px.map(|v| octave.scale() * v);
        let is_streak = lengths_are_finite
            && libm::hypotf(displacement[0], displacement[1]) >= tuning.min_streak_px;
        if is_streak
            && libm::hypotf(displacement[0], displacement[1])
                > tuning.max_streak_outlines * length_px
        {
            return Err(NoFit::NoEdges);
        }
        let thinning = if is_streak || length_px > tuning.thinned_from_px {
            2
        } else {
            1
        };
        mixtures.clear();
        if is_streak {
            streak.map(
                corners,
                displacement,
                tuning.streak_edge_px,
                |pixel, near| {
                    let nearest = nearest(corners, pixel, near);
                    (nearest, corners[nearest].distance_px(pixel))
                },
            );
            take_mixtures(
                (frame, octave),
                (streak, count as f32, thinning),
                pixels,
                places,
                mixtures,
            );
        } else {
            take_pixels((frame, octave), corners, thinning, pixels, places);
        }
        let weight = thinning as f32;
        let Some(surroundings) = Surroundings::of(pixels) else {
            return Err(NoFit::NoEdges);
        };
        self.contrast = surroundings.contrast();
        self.log_ratios.clear();
        self.log_ratios.resize(count, [0.0; SHIFTS]);
        let colors = self.sum_pixels(frame, (&surroundings, table), buffers, (weight, tuning));
        self.find_visible(frame, &colors, tuning);
        self.likelihood_exponent = settings.likelihood_exponent as f32;
        self.likelihood_exponent /=
            1.0 + self.curvature() * (settings.shared_sigma_px as f32).powi(2);
        self.find_anywhere();
        if self.visible_share >= tuning.min_visible_share {
            Ok(())
        } else {
            Err(NoFit::Covered(self.visible_share))
        }
    }

    /// Sums the log-ratios of the pixels in the buffers for each line, and their colours for each sector.
    fn sum_pixels(
        &mut self,
        frame: &EdgeFrame,
        (surroundings, table): (&Surroundings, &Table),
        buffers: &LineBuffers,
        (weight, tuning): (f32, &EdgeTuning),
    ) -> SectorColors {
        let count = self.crossings.len();
        let mut colors = SectorColors::default();
        let pixels = buffers.pixels.iter().zip(&buffers.places);
        for (i, (pixel, &(line, matches))) in pixels.enumerate() {
            let sector = line * SECTORS / count;
            let membership = surroundings.membership(pixel);
            let side = surroundings.side(pixel);
            if SURROUNDING_PX.contains(&pixel.distance_px) {
                add(&mut colors.around[sector], pixel.yuv);
                colors.matching_around += f32::from(u8::from(matches));
            }
            let log_ratios = &mut self.log_ratios[line];
            if let Some(mixture) = buffers.mixtures.get(i) {
                let around = surroundings.around(pixel);
                let own = mixture.own_color(pixel.yuv, around, tuning.min_mixture, |color| {
                    frame.is_target_color(color)
                });
                if let Some((color, matches)) = own {
                    colors.add_body(sector, weight, matches.then_some(color));
                }
                // A pale mixture says nothing by its colours alone.
                let matches = own.map_or(pixel.distance_px < 0.0, |(_, matches)| matches);
                let [nu, nv] = buffers.corners[line].crossing.normal;
                let at_rest_px = |shift_px: f32| {
                    let shift = [nu * shift_px, nv * shift_px];
                    buffers.streak.shifted_px(mixture.pixel, shift)
                };
                table.add_streak((matches, side, membership), at_rest_px, weight, log_ratios);
            } else {
                if BodyColors::DEPTH_PX.contains(&pixel.distance_px) {
                    colors.add_body(sector, weight, matches.then_some(pixel.yuv));
                }
                let distance_px = pixel.distance_px;
                table.add((matches, side, membership), distance_px, weight, log_ratios);
            }
        }
        colors
    }

    /// Finds how far the body is visible in each sector, from the colours there.
    fn find_visible(&mut self, frame: &EdgeFrame, colors: &SectorColors, tuning: &EdgeTuning) {
        let SectorColors {
            bodies, matching, ..
        } = colors;
        let total: f32 = bodies.iter().sum();
        self.visible_share = matching.iter().sum::<f32>() / total.max(1e-6);
        let around: f32 = colors.around.iter().map(|[count, ..]| count).sum();
        self.around_share = colors.matching_around / around.max(1.0);
        self.compare_surroundings(&colors.around, frame.context().surrounding, tuning);
        self.body_color = mean(&colors.body);
        let unshared = unshared(frame, &self.crossings);
        for sector in 0..SECTORS {
            // A sector without pixels of its own takes the mean of all.
            let share = if bodies[sector] > 0.0 {
                matching[sector] / bodies[sector]
            } else {
                self.visible_share
            };
            let share = share * self.unchanged[sector] * unshared[sector];
            let least = tuning.min_uncertainty;
            self.visible[sector] = least + (1.0 - 2.0 * least) * share;
        }
    }

    /// Compares what surrounds the body with before: an edge between the body and something that has come belongs to that thing.
    fn compare_surroundings(
        &mut self,
        sums: &[[f32; 4]; SECTORS],
        known: Option<&Surrounding>,
        tuning: &EdgeTuning,
    ) {
        self.surrounding = sums.each_ref().map(mean);
        self.unchanged = [1.0; SECTORS];
        let Some(known) = known else {
            return;
        };
        let (same, other) = (tuning.unchanged_color, tuning.changed_color);
        for sector in 0..SECTORS {
            let off = |i: usize| (self.surrounding[sector][i] - known[sector][i]).powi(2);
            let distance = (off(0) + CHROMA_WEIGHT * off(1) + CHROMA_WEIGHT * off(2)).sqrt();
            let unchanged = (other - distance) / (other - same);
            if !unchanged.is_nan() {
                self.unchanged[sector] = unchanged.clamp(0.0, 1.0);
            }
        }
        let changed: f32 = self.unchanged.iter().map(|unchanged| 1.0 - unchanged).sum();
        if changed > tuning.moved_share * SECTORS as f32 {
            self.unchanged = [1.0; SECTORS];
        }
    }

    /// The curvature of the sum of all lines' log-likelihoods when the outline grows, 1/px².
    fn curvature(&self) -> f32 {
        let of_line = |k: usize| {
            let [less, here, more] =
                [-0.5, 0.0, 0.5].map(|shift_px| self.line_log_ratio(k, shift_px));
            (2.0 * here - less - more) / 0.25
        };
        let sum: f32 = (0..self.line_count()).map(of_line).sum();
        sum.max(0.0)
    }

    /// Sets the exponent of the lines' likelihoods. Returns the one before.
    pub(super) fn replace_exponent(&mut self, exponent: f32) -> f32 {
        let before = std::mem::replace(&mut self.likelihood_exponent, exponent);
        self.find_anywhere();
        before
    }

    fn find_anywhere(&mut self) {
        self.anywhere = self.sector_sums().map(|sums| log_mean_exp(&sums));
    }

    /// The sums over each sector of its lines' log-likelihood ratios, with the likelihood exponent, for the shifts of lines.
    pub(super) fn sector_sums(&self) -> [[f32; SHIFTS]; SECTORS] {
        let count = self.log_ratios.len();
        let mut sums = [[0_f32; SHIFTS]; SECTORS];
        for (line, log_ratios) in self.log_ratios.iter().enumerate() {
            for (sum, log_ratio) in sums[line * SECTORS / count].iter_mut().zip(log_ratios) {
                *sum += self.likelihood_exponent * log_ratio;
            }
        }
        sums
    }

    /// The shift of a point of the outline along line `k`, in the octave's pixels outwards.
    #[inline(always)]
    pub(super) fn shift_px(&self, k: usize, [u, v]: [f32; 2]) -> f32 {
        let Crossing { point, normal } = self.crossings[k];
        self.octave.scale() * ((u - point[0]) * normal[0] + (v - point[1]) * normal[1])
    }

    /// The direction of line `k`, outwards.
    pub(super) fn normal(&self, k: usize) -> [f32; 2] {
        self.crossings[k].normal
    }

    pub(super) fn line_count(&self) -> usize {
        self.crossings.len()
    }

    /// The log-likelihood ratio of line `k` for a shift, with the likelihood exponent, by a quadratic B-spline, which is smooth. Beyond the reach there is no edge of this
    /// body.
    #[inline(always)]
    pub(super) fn line_log_ratio(&self, k: usize, shift_px: f32) -> f32 {
        // One of the outlines has no pixel here.
        if shift_px.is_nan() {
            return 0.0;
        }
        let step = ((shift_px + REACH_PX) * SHIFTS_A_PX as f32).clamp(1.0, (SHIFTS - 2) as f32);
        let nearest = (step + 0.5) as usize;
        let off = step - nearest as f32;
        let [before, at, after] =
            [nearest - 1, nearest, nearest + 1].map(|i| self.log_ratios[k][i]);
        let (less, more) = (0.5 - off, 0.5 + off);
        let inside = self.likelihood_exponent
            * (0.5 * less * less * before + (0.75 - off * off) * at + 0.5 * more * more * after);
        if shift_px.abs() < REACH_PX {
            inside
        } else {
            inside.min(0.0) - self.beyond_reach_nats
        }
    }

    /// The log-likelihood ratio of the whole outline against an edge anywhere, from the sums of [`CorrespondenceLines::line_log_ratio`] over each sector. A sector is visible, or
    /// occluded and says nothing.
    #[inline(always)]
    pub(super) fn log_likelihood_ratio(&self, sums: &[f32; SECTORS]) -> f32 {
        let mut total = 0.0;
        for sector in 0..SECTORS {
            let visible = self.visible[sector];
            let log_ratio = (sums[sector] - self.anywhere[sector]).min(60.0);
            total += libm::logf(visible * libm::expf(log_ratio) + 1.0 - visible);
        }
        total
    }

    /// The probability that each sector is visible, given its sum.
    pub(super) fn visible_given(&self, sums: &[f32; SECTORS]) -> [f32; SECTORS] {
        std::array::from_fn(|sector| {
            let visible = self.visible[sector];
            let likely = visible * libm::expf((sums[sector] - self.anywhere[sector]).min(60.0));
            likely / (likely + 1.0 - visible)
        })
    }

    /// The sector of line `k`.
    #[inline(always)]
    pub(super) fn sector(&self, k: usize) -> usize {
        k * SECTORS / self.crossings.len()
    }
}

/// ln of the mean of the exponentials.
pub(super) fn log_mean_exp(logs: &[f32]) -> f32 {
    let most = logs.iter().copied().fold(f32::NEG_INFINITY, f32::max);
    let total: f32 = logs.iter().map(|log| libm::expf(log - most)).sum();
    most + libm::logf(total / logs.len() as f32)
}

/// The share of each sector that lies outside of look-alikes.
fn unshared(frame: &EdgeFrame, crossings: &[Crossing]) -> [f32; SECTORS] {
    let mut shares = [1.0_f32; SECTORS];
    let a_crossing = SECTORS as f32 / crossings.len() as f32;
    for (k, crossing) in crossings.iter().enumerate() {
        if frame.is_look_alike(crossing.point) {
            shares[k * SECTORS / crossings.len()] -= a_crossing;
        }
    }
    shares.map(|share| share.max(0.0))
}

/// Gathers an octave's pixels near an outline, each with its nearest corner; one in `thinning`, as on a chessboard.
fn take_pixels(
    (frame, octave): (&EdgeFrame, Octave),
    corners: &[Corner],
    thinning: usize,
    pixels: &mut Vec<EdgePixel>,
    places: &mut Vec<(usize, bool)>,
) {
    pixels.clear();
    places.clear();
    let count = corners.len();
    let far = BAND_PX.end();
    let (width, height) = octave.size(frame.size());
    // Casts of floats stay within the numbers.
    let bounds = |axis: usize, size: usize| {
        let along = corners.iter().map(|corner| corner.crossing.point[axis]);
        let least = along.clone().fold(f32::INFINITY, f32::min) - far;
        let most = along.fold(f32::NEG_INFINITY, f32::max) + far;
        (least.max(0.0) as usize)..(((most + 1.0).max(0.0) as usize).min(size))
    };
    let columns = bounds(0, width);
    for y in bounds(1, height) {
        let mut near = None;
        for x in columns.clone().filter(|x| (x + y) % thinning == 0) {
            let pixel = [x as f32, y as f32];
            let nearest = nearest(corners, pixel, near);
            near = Some(nearest);
            let distance_px = corners[nearest].distance_px(pixel);
            if !BAND_PX.contains(&distance_px) {
                continue;
            }
            let Some((yuv, matches)) = frame.pixel(octave, x, y) else {
                continue;
            };
            pixels.push(EdgePixel {
                yuv,
                distance_px,
                turn: nearest as f32 / count as f32,
            });
            places.push((nearest, matches));
        }
    }
}

/// Gathers an octave's pixels near a streak.
fn take_mixtures(
    (frame, octave): (&EdgeFrame, Octave),
    (streak, count, thinning): (&Streak, f32, usize),
    pixels: &mut Vec<EdgePixel>,
    places: &mut Vec<(usize, bool)>,
    mixtures: &mut Vec<Mixture>,
) {
    pixels.clear();
    places.clear();
    let (width, height) = octave.size(frame.size());
    let [columns, rows] = streak.bounds(*BAND_PX.end());
    let within = |[least, most]: [f32; 2], size: usize| {
        (least.max(0.0) as usize)..(((most + 1.0).max(0.0) as usize).min(size))
    };
    for y in within(rows, height) {
        for x in within(columns, width).filter(|x| (x + y) % thinning == 0) {
            let pixel = [x as f32, y as f32];
            let Some(mixture) = streak.mixture(pixel) else {
                continue;
            };
            if mixture.hull_px > *BAND_PX.end() {
                continue;
            }
            let Some((yuv, matches)) = frame.pixel(octave, x, y) else {
                continue;
            };
            pixels.push(EdgePixel {
                yuv,
                distance_px: mixture.at_rest_px,
                turn: mixture.corner as f32 / count,
            });
            places.push((mixture.corner, matches));
            mixtures.push(mixture);
        }
    }
}
