//! Correspondence lines across an outline in one frame: the log-likelihood of the outline's shift along each line.

use super::corners::{Corner, Crossing, bend, corner, nearest, orientation};
use super::frame::{Octave, SECTORS};
use super::patch::Patch;
use super::streak::{Mixture, Streak};
use super::table::{BAND_PX, REACH_PX, SHIFTS, SHIFTS_A_PX};
use super::{EdgeFrame, EdgeSettings, Surrounding, Table};
use crate::color::{BodyColors, EdgePixel, Surroundings};
use crate::likelihood::outline::Coordinates;
use crate::tuning::EdgeTuning;
use pardalis_camera::LANES;
use pardalis_core::real::{exp_f32, ln_f32};
use pardalis_core::simd::Level;

/// Pixels farther from all points of the outline, with half the distance between these, are not in the band. Derivation: half as far again as the band reaches, for
/// pixels beside corners.
const FAR_PX: f32 = 13.5;
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
    /// The sector of each line.
    sectors: Vec<usize>,
}

impl LineBuffers {
    /// Pixels that there is room for in advance. Hand-set: enough for all but the longest outlines.
    const PIXELS: usize = 8192;
    /// Nodes of a streak for which there is. Hand-set, as the pixels: streaks of 150 pixels and more.
    const NODES: usize = 16_384;

    pub(super) fn new() -> Self {
        Self {
            pixels: Vec::with_capacity(Self::PIXELS),
            places: Vec::with_capacity(Self::PIXELS),
            corners: Vec::new(),
            streak: Streak::with_room(Self::NODES),
            mixtures: Vec::with_capacity(Self::PIXELS),
            sectors: Vec::new(),
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
    #[inline(always)]
    fn add_body(&mut self, sector: usize, weight: f32, color: Option<&[f32; 3]>) {
        self.bodies[sector] += weight;
        if let Some(color) = color {
            self.matching[sector] += weight;
            add(&mut self.body, color);
        }
    }
}

/// Adds a colour to a count and a sum of colours.
#[inline(always)]
fn add([count, sums @ ..]: &mut [f32; 4], yuv: &[f32; 3]) {
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
        (buffers, patch): (&mut LineBuffers, &mut Patch),
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
            ..
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
                    let (nearest, _) = nearest(corners, pixel, near);
                    (nearest, corners[nearest].distance_px(pixel))
                },
            );
            take_mixtures(
                (frame, octave, table.level()),
                (streak, count as f32, thinning),
                (pixels, places, mixtures),
                patch,
            );
        } else {
            take_pixels(
                (frame, octave, table.level()),
                (corners, thinning),
                (pixels, places),
                patch,
            );
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
        let exponent = settings.likelihood_exponent as f32;
        // The curvature is that with the exponent of the settings.
        self.likelihood_exponent = exponent;
        let shared = self.curvature() * (settings.shared_sigma_px as f32).powi(2);
        self.replace_exponent(exponent / (1.0 + shared), table.level());
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
        buffers: &mut LineBuffers,
        (weight, tuning): (f32, &EdgeTuning),
    ) -> SectorColors {
        buffers.sectors.clear();
        let sectors = (0..self.line_count()).map(|line| self.sector(line));
        buffers.sectors.extend(sectors);
        let mut colors = SectorColors::default();
        let log_ratios = &mut self.log_ratios;
        table.level().run(
            #[inline(always)]
            || {
                let pixels = buffers.pixels.iter().zip(&buffers.places);
                for (i, (pixel, &(line, matches))) in pixels.enumerate() {
                    let sector = buffers.sectors[line];
                    let local = surroundings.at(pixel);
                    let seen = (matches, local.side(), local.membership(&pixel.yuv));
                    if SURROUNDING_PX.contains(&pixel.distance_px) {
                        add(&mut colors.around[sector], &pixel.yuv);
                        colors.matching_around += f32::from(u8::from(matches));
                    }
                    if let Some(mixture) = buffers.mixtures.get(i) {
                        let around = local.around();
                        let own =
                            mixture.own_color(pixel.yuv, around, tuning.min_mixture, |color| {
                                frame.is_target_color(color)
                            });
                        if let Some((color, matches)) = own {
                            colors.add_body(sector, weight, matches.then_some(&color));
                        }
                        // A pale mixture says nothing by its colours alone.
                        let matches = own.map_or(pixel.distance_px < 0.0, |(_, matches)| matches);
                        let [nu, nv] = buffers.corners[line].crossing.normal;
                        let at_rest_px = |shift_px: f32| {
                            let shift = [nu * shift_px, nv * shift_px];
                            buffers.streak.shifted_px(mixture.pixel, shift)
                        };
                        table.add_streak(
                            (matches, seen.1, seen.2),
                            at_rest_px,
                            &mut log_ratios[line],
                        );
                    } else {
                        if BodyColors::DEPTH_PX.contains(&pixel.distance_px) {
                            colors.add_body(sector, weight, matches.then_some(&pixel.yuv));
                        }
                        table.add(seen, pixel.distance_px, &mut log_ratios[line]);
                    }
                }
            },
        );
        if weight != 1.0 {
            let log_ratios = self.log_ratios.iter_mut().flatten();
            log_ratios.for_each(|log_ratio| *log_ratio *= weight);
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
            let [less, here, more] = self.line_log_ratios(k, &[-0.5, 0.0, 0.5]);
            (2.0 * here - less - more) / 0.25
        };
        let sum: f32 = (0..self.line_count()).map(of_line).sum();
        sum.max(0.0)
    }

    /// Sets the exponent of the lines' likelihoods. Returns the one before.
    pub(super) fn replace_exponent(&mut self, exponent: f32, level: Level) -> f32 {
        let before = std::mem::replace(&mut self.likelihood_exponent, exponent);
        self.anywhere = level.run(
            #[inline(always)]
            || self.anywhere(),
        );
        before
    }

    #[inline(always)]
    fn anywhere(&self) -> [f32; SECTORS] {
        let sums = self.sector_sums();
        // All sectors at once.
        let sums: [[f32; SECTORS]; SHIFTS] =
            std::array::from_fn(|shift| std::array::from_fn(|sector| sums[sector][shift]));
        let mut most = [f32::NEG_INFINITY; SECTORS];
        for sums in &sums {
            for sector in 0..SECTORS {
                most[sector] = most[sector].max(sums[sector]);
            }
        }
        let mut totals = [0.0_f32; SECTORS];
        for sums in &sums {
            for sector in 0..SECTORS {
                totals[sector] += exp_f32(sums[sector] - most[sector]);
            }
        }
        std::array::from_fn(|sector| most[sector] + ln_f32(totals[sector] / SHIFTS as f32))
    }

    /// The sums over each sector of its lines' log-likelihood ratios, with the likelihood exponent, for the shifts of lines.
    #[inline(always)]
    pub(super) fn sector_sums(&self) -> [[f32; SHIFTS]; SECTORS] {
        let mut sums = [[0_f32; SHIFTS]; SECTORS];
        for (sector, sums) in sums.iter_mut().enumerate() {
            for line in self.lines_of(sector) {
                for (sum, log_ratio) in sums.iter_mut().zip(&self.log_ratios[line]) {
                    *sum += self.likelihood_exponent * log_ratio;
                }
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

    /// The log-likelihood ratios of line `k` for shifts, with the likelihood exponent, by a quadratic B-spline, which is smooth. Beyond the reach there is no edge of this
    /// body; a point of an outline that has no pixel says nothing.
    #[inline(always)]
    pub(super) fn line_log_ratios<const N: usize>(
        &self,
        k: usize,
        shifts_px: &[f32; N],
    ) -> [f32; N] {
        // Adding it rounds to an integer, which is then in the lowest bits.
        const ROUND: f32 = 8_388_608.0;
        const LAST: usize = SHIFTS - 2;
        let (mut nearest, mut offs) = ([0_u32; N], [0_f32; N]);
        for i in 0..N {
            let step = (shifts_px[i] + REACH_PX) * SHIFTS_A_PX as f32;
            // In this order NaN becomes a number, so that it can be an index.
            #[allow(clippy::manual_clamp)]
            let step = step.max(1.0).min(LAST as f32);
            let rounded = step + ROUND;
            nearest[i] = rounded.to_bits() & 0x7f;
            offs[i] = step - (rounded - ROUND);
        }
        let of_shifts = &self.log_ratios[k];
        let mut near = [[0_f32; N]; 3];
        for i in 0..N {
            let nearest = (nearest[i] as usize).clamp(1, LAST);
            for (j, near) in near.iter_mut().enumerate() {
                near[i] = of_shifts[nearest - 1 + j];
            }
        }
        let (mut inside, mut beyond) = ([0_f32; N], [0_f32; N]);
        for i in 0..N {
            let [before, at, after] = [near[0][i], near[1][i], near[2][i]];
            let (less, more) = (0.5 - offs[i], 0.5 + offs[i]);
            let middle = 0.75 - offs[i] * offs[i];
            inside[i] = self.likelihood_exponent
                * (0.5 * less * less * before + middle * at + 0.5 * more * more * after);
            beyond[i] = inside[i].min(0.0) - self.beyond_reach_nats;
        }
        let mut log_ratios = [0_f32; N];
        for i in 0..N {
            let log_ratio = if shifts_px[i].abs() < REACH_PX {
                inside[i]
            } else {
                beyond[i]
            };
            log_ratios[i] = if shifts_px[i].is_nan() {
                0.0
            } else {
                log_ratio
            };
        }
        log_ratios
    }

    /// The sums of the lines' log-likelihood ratios over each sector, for one outline: the first of a block.
    pub(super) fn sums_of_first(&self, outlines: &[Coordinates]) -> [f32; SECTORS] {
        std::array::from_fn(|sector| {
            let lines = self.lines_of(sector);
            let of_line = |k: usize| {
                let [u, v] = &outlines[k];
                let [log_ratio] = self.line_log_ratios(k, &[self.shift_px(k, [u[0], v[0]])]);
                log_ratio
            };
            lines.map(of_line).sum()
        })
    }

    /// The log-likelihood ratio of the whole outline against an edge anywhere, from the sums of [`CorrespondenceLines::line_log_ratios`] over each sector. A sector is visible, or
    /// occluded and says nothing.
    pub(super) fn log_likelihood_ratio(&self, sums: &[f32; SECTORS]) -> f32 {
        let of_sector = |sector: usize| self.sector_log_ratio(sector, sums[sector]);
        (0..SECTORS).map(of_sector).sum()
    }

    /// The same for a block of outlines, moved by offsets in the frame's pixels if there are any.
    pub(super) fn log_likelihood_ratios(
        &self,
        level: Level,
        outlines: &[Coordinates],
        offsets: Option<&[[f32; LANES]; 2]>,
    ) -> [f32; LANES] {
        level.run(
            #[inline(always)]
            || {
                let [du, dv] = offsets.copied().unwrap_or_default();
                let mut totals = [0_f32; LANES];
                for sector in 0..SECTORS {
                    let mut sums = [0_f32; LANES];
                    for k in self.lines_of(sector) {
                        let [u, v] = &outlines[k];
                        let mut shifts_px = [0_f32; LANES];
                        for lane in 0..LANES {
                            let point = [u[lane] + du[lane], v[lane] + dv[lane]];
                            shifts_px[lane] = self.shift_px(k, point);
                        }
                        let log_ratios = self.line_log_ratios(k, &shifts_px);
                        for lane in 0..LANES {
                            sums[lane] += log_ratios[lane];
                        }
                    }
                    for lane in 0..LANES {
                        totals[lane] += self.sector_log_ratio(sector, sums[lane]);
                    }
                }
                totals
            },
        )
    }

    #[inline(always)]
    fn sector_log_ratio(&self, sector: usize, sum: f32) -> f32 {
        let visible = self.visible[sector];
        let log_ratio = (sum - self.anywhere[sector]).min(60.0);
        ln_f32(visible * exp_f32(log_ratio) + 1.0 - visible)
    }

    /// The probability that each sector is visible, given its sum.
    pub(super) fn visible_given(&self, sums: &[f32; SECTORS]) -> [f32; SECTORS] {
        std::array::from_fn(|sector| {
            let visible = self.visible[sector];
            let likely = visible * exp_f32((sums[sector] - self.anywhere[sector]).min(60.0));
            likely / (likely + 1.0 - visible)
        })
    }

    /// The sector of line `k`.
    #[inline(always)]
    pub(super) fn sector(&self, k: usize) -> usize {
        k * SECTORS / self.crossings.len()
    }

    /// The lines of a sector.
    #[inline(always)]
    fn lines_of(&self, sector: usize) -> std::ops::Range<usize> {
        let first = |sector: usize| (sector * self.crossings.len()).div_ceil(SECTORS);
        first(sector)..first(sector + 1)
    }
}

/// ln of the mean of the exponentials.
pub(super) fn log_mean_exp(logs: &[f32]) -> f32 {
    let most = logs.iter().copied().fold(f32::NEG_INFINITY, f32::max);
    let total: f32 = logs.iter().map(|log| exp_f32(log - most)).sum();
    most + ln_f32(total / logs.len() as f32)
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
    (frame, octave, level): (&EdgeFrame, Octave, Level),
    (corners, thinning): (&[Corner], usize),
    (pixels, places): (&mut Vec<EdgePixel>, &mut Vec<(usize, bool)>),
    patch: &mut Patch,
) {
    pixels.clear();
    places.clear();
    let a_corner = 1.0 / corners.len() as f32;
    let far = BAND_PX.end();
    let (width, height) = octave.size(frame.size());
    // Casts of floats stay within the numbers.
    let bounds = |axis: usize, size: usize| {
        let along = corners.iter().map(|corner| corner.crossing.point[axis]);
        let least = along.clone().fold(f32::INFINITY, f32::min) - far;
        let most = along.fold(f32::NEG_INFINITY, f32::max) + far;
        (least.max(0.0) as usize)..(((most + 1.0).max(0.0) as usize).min(size))
    };
    let (columns, rows) = (bounds(0, width), bounds(1, height));
    patch.cover((octave, (width, height)), &columns, &rows);
    let widest_px = corners.iter().map(|corner| corner.length_px);
    let far_px = FAR_PX
        + 0.5
            * widest_px
                .filter(|length| length.is_finite())
                .fold(0.0, f32::max);
    for y in rows {
        let mut near = None;
        let mut next = columns.start + (columns.start + y) % thinning;
        while next < columns.end {
            let x = next;
            next += thinning;
            let pixel = [x as f32, y as f32];
            let (nearest, squared_px) = nearest(corners, pixel, near);
            near = Some(nearest);
            if squared_px > far_px * far_px {
                // The next pixels are too far as well.
                let beyond_px = squared_px.sqrt() - far_px;
                next += thinning * (beyond_px as usize / 2);
                continue;
            }
            let distance_px = corners[nearest].distance_px(pixel);
            if !BAND_PX.contains(&distance_px) {
                continue;
            }
            let Some((yuv, matches)) = patch.pixel((frame, level), x, y) else {
                continue;
            };
            pixels.push(EdgePixel {
                yuv,
                distance_px,
                turn: nearest as f32 * a_corner,
            });
            places.push((nearest, matches));
        }
    }
}

/// Gathers an octave's pixels near a streak.
fn take_mixtures(
    (frame, octave, level): (&EdgeFrame, Octave, Level),
    (streak, count, thinning): (&Streak, f32, usize),
    (pixels, places, mixtures): (
        &mut Vec<EdgePixel>,
        &mut Vec<(usize, bool)>,
        &mut Vec<Mixture>,
    ),
    patch: &mut Patch,
) {
    pixels.clear();
    places.clear();
    let (width, height) = octave.size(frame.size());
    let [columns, rows] = streak.bounds(*BAND_PX.end());
    let within = |[least, most]: [f32; 2], size: usize| {
        (least.max(0.0) as usize)..(((most + 1.0).max(0.0) as usize).min(size))
    };
    let (columns, rows) = (within(columns, width), within(rows, height));
    patch.cover((octave, (width, height)), &columns, &rows);
    for y in rows {
        for x in columns.clone().filter(|x| (x + y) % thinning == 0) {
            let pixel = [x as f32, y as f32];
            let Some(mixture) = streak.mixture(pixel) else {
                continue;
            };
            if mixture.hull_px > *BAND_PX.end() {
                continue;
            }
            let Some((yuv, matches)) = patch.pixel((frame, level), x, y) else {
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
