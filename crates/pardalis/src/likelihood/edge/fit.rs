//! Fits the position at which a target's outlines agree best with the frames: Newton's method on the log-likelihoods of correspondence lines, over all cameras at once.

use nalgebra::{Matrix3, Vector3};

use super::frame::{Octave, SECTORS};
use super::lines::{CorrespondenceLines, NoFit, log_mean_exp};
use super::{Coordinates, EdgeCue, EdgeFrame, LANES, Surrounding};
use crate::tuning::{AdaptationTuning, EdgeTuning};

/// Where a target is seen, by the frames of one instant alone. Nothing changes it once it is fitted.
#[derive(Debug, Clone, Default)]
pub(crate) struct Detection {
    position_m: [f64; 3],
    /// How far it moved while the shutter was open.
    displacement_m: [f64; 3],
    information: Matrix3<f64>,
    log_likelihood_ratio: f64,
    coarse_log_ratio: f64,
    judged_log_ratio: f64,
    /// The lines of each camera that sees it come first; the rest are buffers.
    lines: Vec<CorrespondenceLines>,
    camera_count: usize,
    /// The number of the candidate from which it was fitted.
    candidate: usize,
}

impl Detection {
    /// Its position in the world, metres.
    pub(crate) fn position_m(&self) -> [f64; 3] {
        self.position_m
    }

    /// How far it moved while the shutter was open, metres: zero unless it was fitted as a streak.
    pub(crate) fn displacement_m(&self) -> [f64; 3] {
        self.displacement_m
    }

    /// Whether it was fitted as a streak: an outline that moves while the shutter is open.
    pub(crate) fn is_streak(&self) -> bool {
        self.displacement_m != [0.0; 3]
    }

    /// The curvature of the log-likelihood at its position, 1/m²: the inverse of the position's covariance.
    pub(crate) fn information(&self) -> &Matrix3<f64> {
        &self.information
    }

    /// The log-likelihood ratio of its lines at its position against an edge anywhere nearby, summed over the cameras that see it, in nats.
    pub(crate) fn log_likelihood_ratio(&self) -> f64 {
        self.log_likelihood_ratio
    }

    /// The same in the octave in which it is judged.
    pub(crate) fn coarse_log_ratio(&self) -> f64 {
        self.coarse_log_ratio
    }

    /// How far its outline as a whole is the target's: the same in the octave in which it is judged, where each sector may deviate from the outline by a
    /// fraction of a pixel. Errors that the whole outline shares, as the fit has them, would excuse any contradiction, such as the corners of a book.
    pub(crate) fn judged_log_ratio(&self) -> f64 {
        self.judged_log_ratio
    }

    /// The number of the candidate from which it was fitted.
    pub(crate) fn candidate(&self) -> usize {
        self.candidate
    }

    /// The number of cameras that see it, 1 at least.
    pub(crate) fn camera_count(&self) -> usize {
        self.camera_count
    }

    /// The share of its outline along which the target's colours are visible, 0 to 1: the mean over the cameras that see it.
    pub(crate) fn visible_share(&self) -> f64 {
        let sum: f32 = self.lines().iter().map(|lines| lines.visible_share).sum();
        f64::from(sum) / self.camera_count as f64
    }

    /// The same for one camera; `None` if that does not see it.
    pub(crate) fn visible_share_in(&self, camera: usize) -> Option<f64> {
        let lines = self.lines_of(camera).next()?;
        Some(f64::from(lines.visible_share))
    }

    /// The mean Y, U and V within its outline, for each camera that sees it.
    pub(crate) fn body_colors(&self) -> impl Iterator<Item = (usize, [f32; 3])> {
        let lines = self.lines().iter();
        lines.map(|lines| (lines.camera, lines.body_color))
    }

    /// The same for one camera; `None` if that does not see it unoccluded.
    pub(crate) fn unoccluded_body_color(
        &self,
        camera: usize,
        tuning: &AdaptationTuning,
    ) -> Option<[f32; 3]> {
        let lines = self.lines_of(camera).next()?;
        (lines.visible_share >= tuning.unoccluded_share).then_some(lines.body_color)
    }

    /// Updates what surrounds the target in a camera's image: slowly, and not in sectors into which something else has come.
    pub(crate) fn update_surrounding(
        &self,
        camera: usize,
        known: &mut Option<Surrounding>,
        tuning: &AdaptationTuning,
    ) {
        let Some(lines) = self.lines_of(camera).next() else {
            return;
        };
        let known = known.get_or_insert(lines.surrounding);
        let is_new = |sector: usize| known[sector].iter().any(|value| value.is_nan());
        let rates: [f32; SECTORS] = std::array::from_fn(|sector| {
            if is_new(sector) {
                1.0
            } else {
                tuning.surrounding_rate * lines.unchanged[sector]
            }
        });
        for ((known, seen), rate) in known.iter_mut().zip(&lines.surrounding).zip(rates) {
            if seen.iter().all(|value| value.is_finite()) {
                for (known, value) in known.iter_mut().zip(seen) {
                    *known = if rate == 1.0 {
                        *value
                    } else {
                        *known + rate * (value - *known)
                    };
                }
            }
        }
    }

    /// A detection at a position without lines yet.
    #[cfg(test)]
    pub(super) fn at(position_m: [f64; 3]) -> Self {
        Self {
            position_m,
            ..Self::default()
        }
    }

    /// The correspondence lines of each camera that sees it.
    pub(super) fn lines(&self) -> &[CorrespondenceLines] {
        &self.lines[..self.camera_count]
    }

    /// Those of one camera.
    pub(super) fn lines_of(
        &self,
        camera: usize,
    ) -> impl Iterator<Item = &CorrespondenceLines> + Clone {
        let lines = self.lines().iter();
        lines.filter(move |lines| lines.camera == camera)
    }
}

/// Detections of one instant. Owns their buffers: no more of them than it has room for, or than before, allocate nothing.
#[derive(Debug)]
pub(crate) struct Detections {
    buffers: Vec<Detection>,
    count: usize,
}

impl Detections {
    /// Makes room for detections, each with an outline of this many points in each camera.
    pub(crate) fn with_room(detections: usize, cameras: usize, points: usize) -> Self {
        let lines = || {
            let lines = (0..cameras).map(|_| CorrespondenceLines::with_room(points));
            lines.collect()
        };
        let detection = |_| Detection {
            lines: lines(),
            ..Detection::default()
        };
        Self {
            buffers: (0..detections).map(detection).collect(),
            count: 0,
        }
    }

    /// Removes all.
    pub(crate) fn clear(&mut self) {
        self.count = 0;
    }

    /// Adds what `fit` makes of a buffer for the candidate of this number, if it finds something.
    pub(crate) fn push_fit(
        &mut self,
        candidate: usize,
        fit: impl FnOnce(&mut Detection) -> Result<(), NoFit>,
    ) -> Result<&Detection, NoFit> {
        if self.buffers.len() == self.count {
            self.buffers.push(Detection::default());
        }
        let detection = &mut self.buffers[self.count];
        detection.candidate = candidate;
        fit(detection)?;
        self.count += 1;
        Ok(detection)
    }

    /// The detections found so far.
    pub(crate) fn as_slice(&self) -> &[Detection] {
        &self.buffers[..self.count]
    }

    /// Keeps the best `most` detections above a log-likelihood ratio that lie farther than `apart_m` metres from one another, best first.
    pub(crate) fn keep_distinct(&mut self, min_log_ratio: f64, apart_m: f64, most: usize) {
        let found = &mut self.buffers[..self.count];
        // Of two equally likely ones that of the first candidate comes first.
        found.sort_unstable_by(|a, b| {
            let by_ratio = b.coarse_log_ratio.total_cmp(&a.coarse_log_ratio);
            by_ratio.then(a.candidate.cmp(&b.candidate))
        });
        let mut kept = 0;
        for i in 0..found.len() {
            let here = Vector3::from(found[i].position_m);
            let is_apart =
                |other: &Detection| (here - Vector3::from(other.position_m)).norm() > apart_m;
            if kept < most
                && found[i].coarse_log_ratio > min_log_ratio
                && found[..kept].iter().all(is_apart)
            {
                found.swap(kept, i);
                kept += 1;
            }
        }
        self.count = kept;
    }
}

/// Sums of the lines' log-likelihood ratios over each sector, for a block of outlines.
pub(super) struct SectorSums([[f32; LANES]; SECTORS]);

impl SectorSums {
    #[inline(always)]
    pub(super) fn of(lines: &CorrespondenceLines, outlines: &[Coordinates]) -> Self {
        let mut sums = [[0_f32; LANES]; SECTORS];
        for (k, [u, v]) in outlines.iter().enumerate() {
            let sum = &mut sums[lines.sector(k)];
            for lane in 0..LANES {
                sum[lane] += lines.line_log_ratio(k, lines.shift_px(k, [u[lane], v[lane]]));
            }
        }
        Self(sums)
    }

    pub(super) fn lane(&self, lane: usize) -> [f32; SECTORS] {
        std::array::from_fn(|sector| self.0[sector][lane])
    }
}

/// The damping of Newton steps (Levenberg-Marquardt), a share of the curvature: at first, ... Hand-set, as the following.
const FIRST_DAMPING: f64 = 1e-3;
/// ... its factors after a step that makes the fit better, and after one that does not, ...
const DAMPING_FACTORS: [f64; 2] = [0.1, 30.0];
/// ... and the least after one that does not.
const LEAST_FAILED_DAMPING: f64 = 1e-2;
/// The distance over which projections are differentiated, in diameters. Hand-set: single precision still tells the difference.
const STEP_DIAMETERS: f64 = 0.02;

/// The number of deviations of a sector that are tried when an outline is judged. Hand-set: a quarter of a pixel apart, as lines' shifts.
const DEVIATIONS: usize = 5;

/// The log-likelihood's gradient and curvature.
struct Slope {
    gradient: Vector3<f64>,
    curvature: Matrix3<f64>,
}

impl EdgeCue {
    /// Fits the best position near `position_m`; returns why not if no camera sees the target's colours there. `prior` is a Gaussian that is fitted
    /// along with the lines: mean and inverse covariance. Planar motion (`is_planar`) keeps the height. Writes into `detection`, whose buffers it reuses.
    ///
    /// The outline is fitted in the octave in which it is judged, then octave by octave down to the frame's own pixels as long as these agree.
    pub(crate) fn fit(
        &mut self,
        frames: &[EdgeFrame],
        (position_m, displacement_m): ([f64; 3], [f64; 3]),
        prior: Option<(&Vector3<f64>, &Matrix3<f64>)>,
        is_planar: bool,
        detection: &mut Detection,
    ) -> Result<(), NoFit> {
        detection.position_m = position_m;
        detection.displacement_m = displacement_m;
        self.fit_octave(frames, prior, (is_planar, 0), detection)?;
        detection.coarse_log_ratio = detection.log_likelihood_ratio;
        self.judge(frames, detection);
        if detection.is_streak() {
            // The edges of a streak are no sharper in finer octaves.
            return Ok(());
        }
        let octaves = detection.lines().iter().map(|lines| lines.octave.0);
        for finer in 1..=octaves.max().unwrap_or(0) {
            if !self.refine(frames, (is_planar, finer), detection) {
                break;
            }
        }
        Ok(())
    }

    /// Judges the outline at the detection's position, for which the lines were placed.
    pub(super) fn judge(&mut self, frames: &[EdgeFrame], detection: &mut Detection) {
        let position = detection.position_m.map(|v| [v as f32; LANES]);
        let exponent = self.settings.likelihood_exponent as f32;
        let tolerance_px = self.tuning.judged_tolerance_px;
        detection.judged_log_ratio = 0.0;
        for lines in &mut detection.lines[..detection.camera_count] {
            let Some(frame) = frames.iter().find(|frame| frame.camera() == lines.camera) else {
                continue;
            };
            self.project(frame.projector(), &position);
            let of_fit = lines.replace_exponent(exponent);
            let mut sums = [[0_f32; DEVIATIONS]; SECTORS];
            for (k, [u, v]) in self.coordinates.iter().enumerate() {
                let shift_px = lines.shift_px(k, [u[0], v[0]]);
                for (deviation, sum) in sums[lines.sector(k)].iter_mut().enumerate() {
                    let share = 2.0 * deviation as f32 / (DEVIATIONS - 1) as f32 - 1.0;
                    *sum += lines.line_log_ratio(k, shift_px + share * tolerance_px);
                }
            }
            let sums = sums.map(|sums| log_mean_exp(&sums));
            detection.judged_log_ratio += f64::from(lines.log_likelihood_ratio(&sums));
            lines.replace_exponent(of_fit);
        }
    }

    /// Fits in octaves finer by one than before, from the position and with the uncertainty found there. Returns whether the finer octaves agree; otherwise
    /// nothing changes.
    fn refine(
        &mut self,
        frames: &[EdgeFrame],
        (is_planar, finer): (bool, u8),
        detection: &mut Detection,
    ) -> bool {
        let cameras = detection.camera_count;
        let (position_m, log_ratio) = (detection.position_m, detection.log_likelihood_ratio);
        let (mean, information) = (Vector3::from(position_m), detection.information);
        let prior = Some((&mean, &information));
        let fitted = self.fit_octave(frames, prior, (is_planar, finer), detection);
        let moved = Vector3::from(detection.position_m) - mean;
        let agrees = fitted.is_ok()
            && detection.camera_count == cameras
            && (moved.transpose() * information * moved)[0]
                < self.tuning.max_refined_sigmas.powi(2)
            && detection.log_likelihood_ratio > self.tuning.min_refined_share * log_ratio;
        if !agrees {
            detection.position_m = position_m;
            // As before: there were lines.
            let _ = self.place_lines(frames, finer - 1, detection);
            detection.information = information;
            detection.log_likelihood_ratio = log_ratio;
        }
        agrees
    }

    /// Fits the position in octaves `finer` than those in which the outline is judged.
    fn fit_octave(
        &mut self,
        frames: &[EdgeFrame],
        prior: Option<(&Vector3<f64>, &Matrix3<f64>)>,
        (is_planar, finer): (bool, u8),
        detection: &mut Detection,
    ) -> Result<(), NoFit> {
        let EdgeTuning {
            rounds,
            steps,
            min_shift_px,
            max_shift_px,
            ..
        } = self.tuning;
        for round in 0..=rounds {
            self.place_lines(frames, finer, detection)?;
            if round == rounds {
                break;
            }
            let before = Vector3::from(detection.position_m);
            let mut damping = FIRST_DAMPING;
            let mut value = self.value(frames, detection, before, prior);
            let mut moved_px = 0.0_f64;
            for _ in 0..steps {
                let here = Vector3::from(detection.position_m);
                let (slope, shift_px) = self.slope(frames, detection, here, prior);
                let Some((step, size_px)) = solve(&slope, damping, is_planar, &shift_px) else {
                    break;
                };
                // Lines do not reach farther.
                let shrink = (max_shift_px / size_px).min(1.0);
                let (step, size_px) = (step * shrink, size_px * shrink);
                let there = here + step;
                let new_value = self.value(frames, detection, there, prior);
                if new_value > value {
                    value = new_value;
                    detection.position_m = there.into();
                    damping *= DAMPING_FACTORS[0];
                    moved_px += size_px;
                } else {
                    damping = (damping * DAMPING_FACTORS[1]).max(LEAST_FAILED_DAMPING);
                }
                if size_px < min_shift_px {
                    break;
                }
            }
            if moved_px < min_shift_px && round > 0 {
                break;
            }
        }
        let here = Vector3::from(detection.position_m);
        let (slope, _) = self.slope(frames, detection, here, None);
        detection.information = slope.curvature;
        detection.log_likelihood_ratio = self.value(frames, detection, here, None);
        if detection.log_likelihood_ratio.is_finite() {
            Ok(())
        } else {
            Err(NoFit::NoEdges)
        }
    }

    /// Places correspondence lines around the detection's position in each camera that shows the target's colours there, in octaves `finer` than those in which
    /// the outline is judged. Returns why not if none does.
    pub(super) fn place_lines(
        &mut self,
        frames: &[EdgeFrame],
        finer: u8,
        detection: &mut Detection,
    ) -> Result<(), NoFit> {
        let mut count = 0;
        let mut no_fit = NoFit::OutOfView;
        for frame in frames {
            let position = detection.position_m.map(|v| [v as f32; LANES]);
            self.project(frame.projector(), &position);
            if detection.lines.len() == count {
                detection.lines.push(CorrespondenceLines::default());
            }
            let octave = Octave(self.octave().0.saturating_sub(finer));
            let displacement_px = self.displacement_px(frame, detection);
            let table = &self.tables[usize::from(octave.0)];
            let lines = &mut detection.lines[count];
            let placed = lines.place(
                (frame, octave),
                (&self.coordinates, displacement_px),
                table,
                (&self.settings, &self.tuning),
                &mut self.buffers,
            );
            match placed {
                Ok(()) => count += 1,
                Err(reason) if reason > no_fit => no_fit = reason,
                Err(_) => {}
            }
        }
        detection.camera_count = count;
        if count > 0 { Ok(()) } else { Err(no_fit) }
    }

    /// Returns by how much the middle of the body moves in a frame during the exposure, in pixels.
    fn displacement_px(&self, frame: &EdgeFrame, detection: &Detection) -> [f32; 2] {
        if !detection.is_streak() {
            return [0.0; 2];
        }
        let mut places = [[0_f32; LANES]; 3];
        for axis in 0..3 {
            let middle = if axis == 2 {
                f64::from(self.middle_height_m)
            } else {
                0.0
            };
            for (lane, place) in places[axis].iter_mut().enumerate() {
                let share = if lane == 0 { -0.5 } else { 0.5 };
                let moved = share * detection.displacement_m[axis];
                *place = (detection.position_m[axis] + middle + moved) as f32;
            }
        }
        let [u, v] = frame.projector().project(self.level, &places);
        let displacement = [u[1] - u[0], v[1] - v[0]];
        if displacement.iter().all(|v| v.is_finite()) {
            displacement
        } else {
            [0.0; 2]
        }
    }

    /// Returns the log-likelihood ratio at a position plus the prior's log-density there.
    fn value(
        &mut self,
        frames: &[EdgeFrame],
        detection: &Detection,
        position: Vector3<f64>,
        prior: Option<(&Vector3<f64>, &Matrix3<f64>)>,
    ) -> f64 {
        let mut value = prior.map_or(0.0, |(mean, information)| {
            let off = position - mean;
            -0.5 * (off.transpose() * information * off)[0]
        });
        for lines in detection.lines() {
            let Some(frame) = frames.iter().find(|frame| frame.camera() == lines.camera) else {
                continue;
            };
            let single: [f64; 3] = position.into();
            self.project(frame.projector(), &single.map(|v| [v as f32; LANES]));
            let sums = SectorSums::of(lines, &self.coordinates).lane(0);
            value += f64::from(lines.log_likelihood_ratio(&sums));
        }
        value
    }

    /// Returns gradient and curvature at a position, and how many pixels the outline moves per metre along each axis.
    fn slope(
        &mut self,
        frames: &[EdgeFrame],
        detection: &Detection,
        position: Vector3<f64>,
        prior: Option<(&Vector3<f64>, &Matrix3<f64>)>,
    ) -> (Slope, [f64; 3]) {
        let mut slope = Slope {
            gradient: Vector3::zeros(),
            curvature: Matrix3::zeros(),
        };
        let span_px = self.tuning.span_px;
        let mut most = [0.0_f64; 3];
        // Either way along each axis.
        let step_m = STEP_DIAMETERS * self.diameter_m;
        let mut positions = [[0_f32; LANES]; 3];
        for lane in 0..LANES {
            for axis in 0..3 {
                let sign = [(1 + 2 * axis, 1.0), (2 + 2 * axis, -1.0)]
                    .into_iter()
                    .find_map(|(at, sign)| (at == lane).then_some(sign));
                positions[axis][lane] = (position[axis] + sign.unwrap_or(0.0) * step_m) as f32;
            }
        }
        let width_m: [f32; 3] = std::array::from_fn(|axis| {
            positions[axis][1 + 2 * axis] - positions[axis][2 + 2 * axis]
        });
        for lines in detection.lines() {
            let Some(frame) = frames.iter().find(|frame| frame.camera() == lines.camera) else {
                continue;
            };
            self.project(frame.projector(), &positions);
            let sums = SectorSums::of(lines, &self.coordinates).lane(0);
            let visible = lines.visible_given(&sums);
            for k in 0..lines.line_count() {
                let [u, v] = &self.coordinates[k];
                let [nu, nv] = lines.normal(k);
                let along = Vector3::from_fn(|axis, _| {
                    let [plus, minus] = [1 + 2 * axis, 2 + 2 * axis];
                    let moved = (u[plus] - u[minus]) * nu + (v[plus] - v[minus]) * nv;
                    f64::from(lines.octave.scale() * moved / width_m[axis])
                });
                // The outline has no pixel here.
                if along.iter().any(|v| v.is_nan()) {
                    continue;
                }
                for axis in 0..3 {
                    most[axis] = most[axis].max(along[axis].abs());
                }
                let shift_px = lines.shift_px(k, [u[0], v[0]]);
                let at = |d: f32| lines.line_log_ratio(k, shift_px + d);
                let [less, here, more] = [-span_px, 0.0, span_px].map(at);
                let gradient = (more - less) / (2.0 * span_px);
                let least = self.tuning.min_curvature * lines.likelihood_exponent;
                let curvature = ((2.0 * here - less - more) / (span_px * span_px)).max(least);
                let weight = f64::from(visible[lines.sector(k)]);
                slope.gradient += along * (weight * f64::from(gradient));
                slope.curvature += along * along.transpose() * (weight * f64::from(curvature));
            }
        }
        if let Some((mean, information)) = prior {
            slope.gradient -= information * (position - mean);
            slope.curvature += information;
        }
        (slope, most)
    }
}

/// Returns the damped Newton step, and by how many pixels it moves the outline at most.
fn solve(
    slope: &Slope,
    damping: f64,
    is_planar: bool,
    px_per_metre: &[f64; 3],
) -> Option<(Vector3<f64>, f64)> {
    let mut curvature = slope.curvature;
    let mut gradient = slope.gradient;
    for axis in 0..3 {
        curvature[(axis, axis)] *= 1.0 + damping;
    }
    if is_planar {
        for axis in 0..3 {
            curvature[(axis, 2)] = 0.0;
            curvature[(2, axis)] = 0.0;
        }
        curvature[(2, 2)] = 1.0;
        gradient[2] = 0.0;
    }
    let step = curvature.cholesky()?.solve(&gradient);
    let size_px: f64 = (0..3)
        .map(|axis| step[axis].abs() * px_per_metre[axis])
        .fold(0.0, f64::max);
    size_px.is_finite().then_some((step, size_px))
}
