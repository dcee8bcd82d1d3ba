//! Step 1, detection: where the frames show the target, near its predicted position and, when that is not enough, anywhere.

use nalgebra::{Matrix3, Vector3};

use super::boxes::Boxes;
use super::candidates::{CandidateSearch, at};
use super::exposures::{self, Exposures};
use super::reach::Reach;
use crate::likelihood::edge::{
    Detection, Detections, EdgeCue, EdgeFrame, FitStart, NoFit, PositionPrior, SizePrior, YawPrior,
};
use crate::shape::Shape;
use crate::tracker::CameraId;
use crate::tracker::candidate::{Candidate, Origin, Verdict};
use crate::tuning::{DetectionTuning, HeadingTuning, Tuning};
use pardalis_core::simd::Level;
use pardalis_filter::estimate::{StateEstimate, covariance_matrix};

/// Finds detections. Owns their buffers.
pub(super) struct Detector {
    pub(super) tuning: DetectionTuning,
    pub(super) shape: Shape,
    is_planar: bool,
    /// The priors of the yaw of a body that turns in any direction; none for others.
    any_yaw: Vec<YawPrior>,
    /// From this standard deviation of the logarithm of its scale on, a target that one camera alone sees has no position.
    unknown_sigma: f64,
    pub(super) candidates: CandidateSearch,
    /// Frame sets since whole images were searched because that was due.
    since_search: u32,
    /// After any other search, the next one is due this many frame sets sooner: of several targets, each then searches in frames of its own.
    stagger: u32,
    /// Whether whole images were searched in the latest frames.
    has_searched: bool,
    /// For how long the shutters are open.
    pub(super) exposures: Exposures,
    pub(super) detections: Detections,
    /// Whether the target is one of a crowd: nobody else is mistaken for one that is where it was predicted.
    pub(super) is_of_crowd: bool,
    /// Where streaks are looked for; everywhere without one.
    pub(super) reach: Option<Reach>,
}

/// How certain the size of a detection's outline is, besides the edges along it.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Outline {
    /// How the position depends on the logarithm of the scale, metres.
    pub(super) drift_m: [f64; 3],
    /// The standard deviation of the logarithm of the outline's scale that colours cause which contradict it: within it such as those of fingers, where other edges are
    /// near, and around it the target's own, where it follows a stripe or a seam.
    pub(super) sigma: f64,
}

impl Outline {
    pub(super) fn of(detection: &Detection, tuning: &DetectionTuning) -> Self {
        let (hidden, around) = (1.0 - detection.visible_share(), detection.around_share());
        Self {
            drift_m: detection.drift_m(),
            sigma: tuning.contradicted_sigma * (hidden * hidden + around * around),
        }
    }
}

/// The Bernoulli filter's prediction for the instant of the frames.
pub(super) struct Prediction {
    /// Where the target is, if it exists.
    pub(super) estimate: Option<StateEstimate>,
    /// The probability that it exists.
    pub(super) existence: f64,
    /// The time since the frames before, seconds.
    pub(super) since_s: f64,
    /// Its size.
    pub(super) size: SizePrior,
    /// Its yaw, if it turns and that is known.
    pub(super) yaw: Option<YawPrior>,
    /// Whether something else may be the target.
    pub(super) is_challenged: bool,
    /// Whether it is nowhere but near the prediction: somebody known of a crowd.
    pub(super) is_confined: bool,
}

/// The priors with which an outline is fitted.
#[derive(Clone, Copy)]
pub(super) struct Priors<'a> {
    pub(super) position: PositionPrior<'a>,
    pub(super) size: SizePrior,
    /// `None` for a body that does not turn, or may face anywhere.
    pub(super) yaw: Option<YawPrior>,
}

impl Priors<'_> {
    /// The size alone.
    pub(super) fn of_size(size: SizePrior) -> Self {
        Self {
            position: None,
            size,
            yaw: None,
        }
    }
}

/// Whether fewer than half of the cameras that have a detection in view see it: to the others it is hidden, or they see the target elsewhere.
fn is_by_few(edge: &EdgeCue, frames: &[EdgeFrame], detection: &Detection) -> bool {
    let position_m = detection.position_m();
    let in_view = frames
        .iter()
        .filter(|frame| edge.is_in_view(frame, position_m));
    2 * detection.camera_count() < in_view.count()
}

/// Priors of the yaw of a shape that looks the same after turns by this angle: together they cover all of them.
fn any_yaw(period_rad: f64, tuning: &HeadingTuning) -> Vec<YawPrior> {
    let count = (period_rad / tuning.search_step_rad).ceil().max(1.0);
    let prior = |number| YawPrior {
        yaw_rad: f64::from(number) / count * period_rad,
        sigma_rad: 0.5 * period_rad,
    };
    (0..count as u32).map(prior).collect()
}

impl Detector {
    /// A detector of a body of this shape, that turns if an angle is given after which it looks the same, with outlines of this many points, on the ground at this height (metres) if its motion is planar.
    ///
    /// It has room for a detection near the prediction and one at each blob, and for streaks; only where rays of several cameras meet may there be more.
    pub(super) fn new(
        (shape, period_rad): (Shape, Option<f64>),
        ground_z_m: Option<f64>,
        (cameras, points): (usize, usize),
        (tuning, level): (&Tuning, Level),
    ) -> Self {
        let (unknown_sigma, blobs) = (tuning.size.unknown_sigma, tuning.blobs);
        let background = tuning.background;
        let any_yaw = period_rad.map_or(Vec::new(), |period_rad| {
            any_yaw(period_rad, &tuning.heading)
        });
        let tuning = tuning.detection;
        let directions = any_yaw.len().max(1);
        let room = directions * (1 + cameras * blobs.max_blobs) + exposures::MAX_FITS;
        Self {
            tuning,
            shape,
            is_planar: ground_z_m.is_some(),
            any_yaw,
            unknown_sigma,
            candidates: CandidateSearch::new(
                shape,
                ground_z_m,
                (cameras, level),
                (tuning, blobs, background),
            ),
            since_search: 0,
            stagger: 0,
            has_searched: false,
            exposures: Exposures::default(),
            detections: Detections::with_room(room, cameras, points),
            is_of_crowd: false,
            reach: None,
        }
    }

    /// The latest detections, the likeliest first, each place once.
    pub(super) fn detections(&self) -> &[Detection] {
        self.detections.as_slice()
    }

    /// Whether whole images were searched in the latest frames.
    pub(super) fn has_searched(&self) -> bool {
        self.has_searched
    }

    /// Staggers its searches with those of other targets, given its number among them.
    pub(super) fn stagger_searches(&mut self, number: usize) {
        self.stagger = number as u32 % self.tuning.frames_between_searches.max(1);
    }

    /// The greatest log-likelihood ratio of the detections found so far.
    pub(super) fn greatest_log_ratio(&self) -> f64 {
        let log_ratios = self.detections().iter().map(Detection::coarse_log_ratio);
        log_ratios.fold(f64::NEG_INFINITY, f64::max)
    }

    /// Finds the detections in these frames, and lists all candidates with what ruled them out so far.
    pub(super) fn detect(
        &mut self,
        (edge, frames): (&mut EdgeCue, &[EdgeFrame]),
        predicted: &Prediction,
        boxes: Option<&Boxes>,
        candidates: &mut Vec<Candidate>,
    ) {
        let tuning = self.tuning;
        self.detections.clear();
        candidates.clear();
        let confined = predicted.estimate.filter(|_| predicted.is_confined);
        let diameter_m = predicted.size.scale() * self.shape.diameter_m();
        self.reach = confined.and_then(|estimate| Reach::of(&estimate, diameter_m));
        let is_expected = predicted.existence > tuning.min_predicted_existence;
        if let Some(estimate) = predicted.estimate.as_ref().filter(|_| is_expected) {
            let mean_m = estimate.position_m;
            let information = self.information(estimate.covariance_m2, predicted.size.scale());
            let mean = Vector3::from(mean_m);
            let priors = Priors {
                position: Some((&mean, &information)),
                size: predicted.size,
                yaw: predicted.yaw,
            };
            candidates.push(at(Origin::Prediction, mean_m, predicted.size.log_scale));
            self.fit((edge, frames), priors, candidates, (0, [0.0; 3]));
            if let Some(velocity_mps) = estimate.velocity_mps {
                // All cameras of an instant are taken to move like the first.
                let way_m = frames.first().map_or([0.0; 3], |frame| {
                    let view = frame.prepared().view();
                    let relative_mps = view.relative_velocity_mps(mean_m, velocity_mps);
                    (relative_mps * predicted.since_s).into()
                });
                self.fit_streaks((edge, frames), priors, candidates, (mean_m, way_m));
            }
        }
        self.since_search += 1;
        let predicted_log_ratio = self.greatest_log_ratio();
        // Others of a crowd hide members all the time.
        let is_shown = |found: &Detection| self.is_of_crowd || !is_by_few(edge, frames, found);
        let is_sure = self
            .detections()
            .iter()
            .any(|found| found.coarse_log_ratio() > tuning.sure_log_ratio && is_shown(found));
        let is_due = self.since_search >= tuning.frames_between_searches && !self.is_of_crowd;
        self.has_searched = !is_sure
            || predicted.is_challenged
            || predicted.existence < tuning.sure_existence
            || is_due;
        if self.has_searched {
            self.since_search = if is_due { 0 } else { self.stagger };
            self.candidates.compare(frames);
            let first = candidates.len();
            self.candidates
                .search(edge, frames, &predicted.size, candidates);
            let boxes = boxes.into_iter();
            candidates.extend(boxes.flat_map(|boxes| boxes.candidates(&predicted.size)));
            for number in first..candidates.len() {
                if self.is_known((edge, frames), candidates, (first, number)) {
                    candidates[number].verdict = Verdict::SamePlace;
                    continue;
                }
                let priors = Priors::of_size(predicted.size);
                self.fit((edge, frames), priors, candidates, (number, [0.0; 3]));
            }
            // A target that probably exists is fitted as a streak where it is predicted.
            if predicted.existence < 0.5 {
                self.fit_streaks_of_blobs((edge, frames), predicted.size, candidates, first);
            }
            // After the streaks: these are fitted to each blob once.
            if self.greatest_log_ratio() <= tuning.sure_log_ratio {
                let first = candidates.len();
                candidates.extend_from_slice(self.candidates.circles());
                for number in first..candidates.len() {
                    let priors = Priors::of_size(predicted.size);
                    self.fit((edge, frames), priors, candidates, (number, [0.0; 3]));
                }
            }
            // What moves elsewhere is not the target while that is seen.
            if predicted_log_ratio < tuning.likely_log_ratio {
                self.fit_moving_streaks((edge, frames), predicted.size, candidates);
            }
        }
        let apart_m = tuning.distinct_diameters * diameter_m;
        self.detections
            .keep_distinct(tuning.min_log_ratio, apart_m, tuning.max_detections);
        self.note_dropped(candidates, apart_m);
        if frames.is_empty() {
            // A prediction was not examined.
            candidates.clear();
        }
    }

    /// Whether a sure detection of several cameras explains the candidate of this number, so that its fit would find that again or nothing: it lies at the same place and is
    /// as large, or one of the blobs whose rays meet there is that of the target itself, predicted before the search, whose candidates begin with the first.
    fn is_known(
        &self,
        (edge, frames): (&mut EdgeCue, &[EdgeFrame]),
        candidates: &[Candidate],
        (first, number): (usize, usize),
    ) -> bool {
        // Of a single camera, a fit without the prior of the prediction may find another distance.
        let candidate = &candidates[number];
        let (Some(position_m), true) = (candidate.position_m, frames.len() > 1) else {
            return false;
        };
        let sure = |known: &&Detection| known.coarse_log_ratio() > self.tuning.sure_log_ratio;
        self.detections().iter().filter(sure).any(|known| {
            let Some(blobs) = candidate.blobs else {
                return self.is_of((edge, frames), known, candidate);
            };
            let off_m = Vector3::from(position_m) - Vector3::from(known.position_m());
            let reach_m = self.tuning.distinct_diameters * known.scale() * self.shape.diameter_m();
            let resized = (candidate.log_scale - known.log_scale()).abs();
            let is_there = off_m.norm() < reach_m;
            if is_there && resized < libm::log(self.tuning.same_size_factor) {
                return true;
            }
            // What a single camera shows may have another distance, and what was not predicted other pairs of blobs.
            let is_target = known.candidate() < first && known.camera_count() > 1;
            let mut blobs = blobs.iter().filter(|_| is_target);
            blobs.any(|&blob| self.is_of((edge, frames), known, &candidates[blob]))
        })
    }

    /// Whether a candidate's blob is a detection's in the same camera: there, and as large, or a part of it, the rest of which may be hidden or out of view.
    fn is_of(
        &self,
        (edge, frames): (&mut EdgeCue, &[EdgeFrame]),
        known: &Detection,
        candidate: &Candidate,
    ) -> bool {
        let (reach, most) = (self.tuning.distinct_diameters, self.tuning.same_size_factor);
        let camera = candidate.origin.camera().map(CameraId::index);
        let mut frames = frames.iter();
        let frame = frames.find(|frame| Some(frame.camera()) == camera);
        let disc = frame.and_then(|frame| edge.disc_px(frame, known));
        let both = candidate.origin.blob().zip(disc);
        both.is_some_and(|(blob, (middle_px, area_px))| {
            let [u, v] = [0, 1].map(|i| blob.centroid_px[i] - middle_px[i]);
            let diameter_px = 2.0 * (area_px / std::f64::consts::PI).sqrt();
            let ratio = (blob.area_px / area_px).max(area_px / blob.area_px);
            let is_same = libm::hypot(u, v) < reach * diameter_px && ratio < most * most;
            let is_part = (0..2).all(|i| {
                let sides = [blob.min_px[i], blob.max_px[i]].map(|side| side as f64);
                let is_inside = |side: f64| (side - middle_px[i]).abs() < 0.5 * most * diameter_px;
                sides.into_iter().all(is_inside)
            });
            is_same || is_part
        })
    }

    /// Fits the candidate of this number, unless it is ruled out already, with a prior of its position if there is one and of its size, as an outline with this
    /// displacement during the exposure. A body that may face anywhere is fitted in several directions; the candidate keeps the results of its likeliest
    /// fit. Returns the log-likelihood ratio; minus infinity if there is no fit.
    pub(super) fn fit(
        &mut self,
        (edge, frames): (&mut EdgeCue, &[EdgeFrame]),
        priors: Priors,
        candidates: &mut [Candidate],
        (number, displacement_m): (usize, [f64; 3]),
    ) -> f64 {
        let candidate = &mut candidates[number];
        let Some(position_m) = candidate.position_m else {
            return f64::NEG_INFINITY;
        };
        let start = FitStart {
            position_m,
            displacement_m,
            log_scale: candidate.log_scale,
            prior: priors.position,
            size: priors.size,
            yaw: priors.yaw,
            is_planar: self.is_planar,
            min_log_ratio: self.tuning.min_log_ratio,
        };
        if priors.yaw.is_some() || self.any_yaw.is_empty() {
            return self.fit_from((edge, frames), &start, candidate, number);
        }
        let before = *candidate;
        let mut best = (f64::NEG_INFINITY, None);
        for direction in 0..self.any_yaw.len() {
            let yaw = Some(self.any_yaw[direction]);
            let mut fitted = before;
            let start = FitStart { yaw, ..start };
            let log_ratio = self.fit_from((edge, frames), &start, &mut fitted, number);
            if best.1.is_none() || log_ratio > best.0 {
                best = (log_ratio, Some(fitted));
            }
        }
        *candidate = best.1.unwrap_or(before);
        best.0
    }

    /// Fits a candidate, of this number, from one start.
    fn fit_from(
        &mut self,
        (edge, frames): (&mut EdgeCue, &[EdgeFrame]),
        start: &FitStart,
        candidate: &mut Candidate,
        number: usize,
    ) -> f64 {
        let is_unknown = start.size.sigma > self.unknown_sigma;
        let fitted = self.detections.push_fit(number, |buffer| {
            edge.fit(frames, start, buffer)?;
            if is_unknown && buffer.size().is_none() {
                return Err(NoFit::NoEdges);
            }
            Ok(())
        });
        match fitted {
            Ok(detection) => {
                candidate.position_m = Some(detection.position_m());
                candidate.log_scale = detection.log_scale();
                candidate.outline_nats = Some(detection.judged_log_ratio());
                candidate.visible_share = Some(detection.visible_share());
                if detection.coarse_log_ratio() <= self.tuning.min_log_ratio {
                    candidate.verdict = Verdict::OtherOutline;
                }
                return detection.coarse_log_ratio();
            }
            Err(NoFit::OutOfView) => candidate.verdict = Verdict::OutOfView,
            Err(NoFit::NoEdges) => candidate.verdict = Verdict::NoEdges,
            Err(NoFit::Covered(visible_share)) => {
                candidate.visible_share = Some(visible_share.into());
                candidate.verdict = Verdict::Covered;
            }
        }
        f64::NEG_INFINITY
    }

    /// Notes why fitted candidates are not among the detections.
    fn note_dropped(&self, candidates: &mut [Candidate], apart_m: f64) {
        let detections = self.detections();
        for (number, candidate) in candidates.iter_mut().enumerate() {
            let is_kept = detections.iter().any(|kept| kept.candidate() == number);
            let (Some(_), Some(position_m), false) =
                (candidate.outline_nats, candidate.position_m, is_kept)
            else {
                continue;
            };
            let here = Vector3::from(position_m);
            let is_here =
                |kept: &Detection| (here - Vector3::from(kept.position_m())).norm() <= apart_m;
            candidate.verdict = if candidate.verdict == Verdict::OtherOutline {
                Verdict::OtherOutline
            } else if detections.iter().any(is_here) {
                Verdict::SamePlace
            } else {
                Verdict::Surplus
            };
        }
    }

    /// The inverse of a covariance (xx, xy, xz, yy, yz, zz in m²), no sharper than the tuning says.
    fn information(&self, covariance_m2: [f64; 6], scale: f64) -> Matrix3<f64> {
        let diameter_m = scale * self.shape.diameter_m();
        let least = (self.tuning.min_sigma_diameters * diameter_m).powi(2);
        let covariance = covariance_matrix(covariance_m2) + Matrix3::from_diagonal_element(least);
        covariance.try_inverse().unwrap_or_else(Matrix3::zeros)
    }
}
