//! Step 1, detection: where the frames show the target, near its predicted position and, when that is not enough, anywhere.

use nalgebra::{Matrix3, Vector3};

use super::candidates::{CandidateSearch, at};
use crate::likelihood::edge::{Detection, Detections, EdgeCue, EdgeFrame, NoFit};
use crate::shape::Shape;
use crate::tracker::candidate::{Candidate, Origin, Verdict};
use crate::tuning::{BlobTuning, DetectionTuning};
use pardalis_filter::estimate::StateEstimate;

/// Finds detections. Owns their buffers.
pub(super) struct Detector {
    tuning: DetectionTuning,
    shape: Shape,
    is_planar: bool,
    candidates: CandidateSearch,
    /// Frame sets since whole images were searched.
    since_search: u32,
    detections: Detections,
}

/// The Bernoulli filter's prediction for the instant of the frames.
pub(super) struct Prediction {
    /// Where the target is, if it exists.
    pub(super) estimate: Option<StateEstimate>,
    /// The probability that it exists.
    pub(super) existence: f64,
}

impl Detector {
    /// A detector of a body of this shape with outlines of this many points, on the ground at this height (metres) if its motion is planar.
    ///
    /// It has room for a detection near the prediction and one at each blob; only where rays of several cameras meet may there be more.
    pub(super) fn new(
        shape: Shape,
        ground_z_m: Option<f64>,
        (cameras, points): (usize, usize),
        (tuning, blobs): (DetectionTuning, BlobTuning),
    ) -> Self {
        let room = 1 + cameras * blobs.max_blobs;
        Self {
            tuning,
            shape,
            is_planar: ground_z_m.is_some(),
            candidates: CandidateSearch::new(shape, ground_z_m, (tuning, blobs)),
            since_search: 0,
            detections: Detections::with_room(room, cameras, points),
        }
    }

    /// The latest detections, the likeliest first, each place once.
    pub(super) fn detections(&self) -> &[Detection] {
        self.detections.as_slice()
    }

    /// Finds the detections in these frames, and lists all candidates with what ruled them out so far.
    pub(super) fn detect(
        &mut self,
        edge: &mut EdgeCue,
        frames: &[EdgeFrame],
        predicted: &Prediction,
        candidates: &mut Vec<Candidate>,
    ) {
        let tuning = self.tuning;
        self.detections.clear();
        candidates.clear();
        let is_expected = predicted.existence > tuning.min_predicted_existence;
        if let Some(estimate) = predicted.estimate.as_ref().filter(|_| is_expected) {
            let mean_m = estimate.position_m;
            let information = self.information(estimate.covariance_m2);
            let prior = Some((&Vector3::from(mean_m), &information));
            candidates.push(at(Origin::Prediction, mean_m));
            self.fit((edge, frames), prior, candidates, 0);
        }
        self.since_search += 1;
        let near = self.detections.as_slice().first();
        let is_sure = near.is_some_and(|found| found.coarse_log_ratio() > tuning.sure_log_ratio);
        if !is_sure
            || predicted.existence < tuning.sure_existence
            || self.since_search >= tuning.frames_between_searches
        {
            self.since_search = 0;
            let first = candidates.len();
            self.candidates.search(edge, frames, candidates);
            for number in first..candidates.len() {
                self.fit((edge, frames), None, candidates, number);
            }
        }
        let apart_m = tuning.distinct_diameters * self.shape.diameter_m();
        self.detections
            .keep_distinct(tuning.min_log_ratio, apart_m, tuning.max_detections);
        self.note_dropped(candidates, apart_m);
        if frames.is_empty() {
            // A prediction was not examined.
            candidates.clear();
        }
    }

    /// Fits the candidate of this number, unless it is ruled out already, with a prior if there is one.
    fn fit(
        &mut self,
        (edge, frames): (&mut EdgeCue, &[EdgeFrame]),
        prior: Option<(&Vector3<f64>, &Matrix3<f64>)>,
        candidates: &mut [Candidate],
        number: usize,
    ) {
        let candidate = &mut candidates[number];
        let Some(position_m) = candidate.position_m else {
            return;
        };
        let is_planar = self.is_planar;
        let fitted = self.detections.push_fit(number, |buffer| {
            edge.fit(frames, position_m, prior, is_planar, buffer)
        });
        match fitted {
            Ok(detection) => {
                candidate.position_m = Some(detection.position_m());
                candidate.outline_nats = Some(detection.judged_log_ratio());
                candidate.visible_share = Some(detection.visible_share());
                if detection.coarse_log_ratio() <= self.tuning.min_log_ratio {
                    candidate.verdict = Verdict::OtherOutline;
                }
            }
            Err(NoFit::OutOfView) => candidate.verdict = Verdict::OutOfView,
            Err(NoFit::NoEdges) => candidate.verdict = Verdict::NoEdges,
            Err(NoFit::Covered(visible_share)) => {
                candidate.visible_share = Some(visible_share.into());
                candidate.verdict = Verdict::Covered;
            }
        }
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
    fn information(&self, [xx, xy, xz, yy, yz, zz]: [f64; 6]) -> Matrix3<f64> {
        let least = (self.tuning.min_sigma_diameters * self.shape.diameter_m()).powi(2);
        let covariance = Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz)
            + Matrix3::from_diagonal_element(least);
        covariance.try_inverse().unwrap_or_else(Matrix3::zeros)
    }
}
