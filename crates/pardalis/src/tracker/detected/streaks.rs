//! Streaks: outlines that move while the shutter is open. How far follows from the velocity and the exposure, or from the form of a blob.

use nalgebra::Vector3;

use super::detection::{Detector, Priors};
use super::exposures::{BLOB_FACTORS, BLOBS, EXPOSURES, LIKELY_SHARE, MOVING_FACTORS, note};
use crate::detect::Blob;
use crate::likelihood::edge::{Detection, EdgeCue, EdgeFrame, SizePrior};
use crate::tracker::candidate::{Candidate, Origin, Verdict};
use crate::tracker::ids::CameraId;

impl Detector {
    /// Fits the prediction as a streak with each of the possible exposures, the likeliest first, until one is certain. `way_m` is how far the target moved since the frames
    /// before. The prediction has been fitted at rest.
    pub(super) fn fit_streaks(
        &mut self,
        (edge, frames): (&mut EdgeCue, &[EdgeFrame]),
        priors: Priors,
        candidates: &mut [Candidate],
        (position_m, way_m): ([f64; 3], [f64; 3]),
    ) {
        let at_rest = self.greatest_log_ratio();
        let ranked = self.exposures.ranked();
        let diameter_m = priors.size.scale() * self.shape.diameter_m();
        let least_m = self.tuning.min_streak_diameters * diameter_m;
        let way_m = Vector3::from(way_m);
        if EXPOSURES[ranked[0]] * way_m.norm() < least_m {
            return;
        }
        let is_sure = at_rest > self.tuning.sure_log_ratio;
        let likeliest = self.exposures.streaks[ranked[0]];
        if is_sure && likeliest < LIKELY_SHARE * self.exposures.at_rest {
            return;
        }
        note(&mut self.exposures.at_rest, at_rest);
        let enough = at_rest.max(self.tuning.sure_log_ratio);
        for exposure in ranked {
            let displacement_m = (EXPOSURES[exposure] * way_m).into();
            let streak_m = (position_m, displacement_m);
            let log_ratio = self.fit_streak((edge, frames), priors, candidates, (0, streak_m));
            note(&mut self.exposures.streaks[exposure], log_ratio);
            if log_ratio > enough {
                break;
            }
        }
    }

    /// Fits the largest long blobs as streaks, in the frame of a single camera, if no outline at rest is certain.
    pub(super) fn fit_streaks_of_blobs(
        &mut self,
        (edge, frames): (&mut EdgeCue, &[EdgeFrame]),
        size: SizePrior,
        candidates: &mut [Candidate],
        first: usize,
    ) {
        let [frame] = frames else {
            return;
        };
        let sure = self.tuning.sure_log_ratio;
        if self.greatest_log_ratio() > sure {
            return;
        }
        let mut count = 0;
        for number in first..candidates.len() {
            let candidate = &candidates[number];
            // Those without a position are ruled out.
            let Some(&blob) = candidate
                .origin
                .blob()
                .filter(|_| candidate.position_m.is_some())
            else {
                continue;
            };
            if blob.cut_off || count == BLOBS || !self.may_be_streak(frame, &blob) {
                continue;
            }
            count += 1;
            self.fit_streak_of_blob(
                (edge, frame),
                size,
                candidates,
                (number, &blob, &BLOB_FACTORS[..]),
            );
        }
    }

    /// Fits what moves in front of a camera at rest as streaks, as blobs are.
    pub(super) fn fit_moving_streaks(
        &mut self,
        (edge, frames): (&mut EdgeCue, &[EdgeFrame]),
        size: SizePrior,
        candidates: &mut Vec<Candidate>,
    ) {
        let [frame] = frames else {
            return;
        };
        // Everything moves in front of a moving camera.
        if frame.prepared().view().is_moving() {
            return;
        }
        let mut count = 0;
        self.candidates.find_moving(frame);
        for number in 0..self.candidates.moving().len() {
            let blob = self.candidates.moving()[number];
            if blob.cut_off || count == BLOBS || !self.may_be_streak(frame, &blob) {
                continue;
            }
            count += 1;
            let origin = Origin::Motion(CameraId::new(frame.camera()), blob);
            candidates.push(Candidate::new(origin, Verdict::NoEdges));
            let streak = (candidates.len() - 1, &blob, &MOVING_FACTORS[..]);
            if !self.fit_streak_of_blob((edge, frame), size, candidates, streak) {
                candidates.pop();
            }
        }
    }

    /// Fits a blob as streaks of several widths and lengths, until one is certain. Returns whether there is a position at which it may be one.
    fn fit_streak_of_blob(
        &mut self,
        (edge, frame): (&mut EdgeCue, &EdgeFrame),
        size: SizePrior,
        candidates: &mut [Candidate],
        (number, blob, factors): (usize, &Blob, &[[f64; 2]]),
    ) -> bool {
        let mut has_position = false;
        for &factors in factors {
            let Some(streak_m) = self.candidates.streak_m(edge, frame, blob, factors, &size) else {
                continue;
            };
            has_position = true;
            let frames = std::slice::from_ref(frame);
            let streak = (number, streak_m);
            if self.fit_streak((edge, frames), Priors::of_size(size), candidates, streak)
                > self.tuning.sure_log_ratio
            {
                break;
            }
        }
        has_position
    }

    /// Returns whether a blob is long enough, wide enough to have a form, and where the target may be.
    fn may_be_streak(&self, frame: &EdgeFrame, blob: &Blob) -> bool {
        if self.reach.is_some_and(|reach| !reach.holds(frame, blob)) {
            return false;
        }
        let [along, across] = blob.principal_variances_px2().map(f64::sqrt);
        across >= self.tuning.min_streak_sigma_px
            && along >= self.tuning.min_streak_elongation * across
    }

    /// Fits a candidate as a streak from this position, with this displacement. The candidate keeps the results of its likeliest fit. Returns the log-likelihood
    /// ratio.
    fn fit_streak(
        &mut self,
        (edge, frames): (&mut EdgeCue, &[EdgeFrame]),
        priors: Priors,
        candidates: &mut [Candidate],
        (number, (position_m, displacement_m)): (usize, ([f64; 3], [f64; 3])),
    ) -> f64 {
        let before = candidates[number];
        let of_candidate = self
            .detections()
            .iter()
            .filter(|found| found.candidate() == number);
        let greatest = of_candidate
            .map(Detection::coarse_log_ratio)
            .fold(f64::NEG_INFINITY, f64::max);
        candidates[number].position_m = Some(position_m);
        let log_ratio = self.fit((edge, frames), priors, candidates, (number, displacement_m));
        if log_ratio <= greatest || log_ratio == f64::NEG_INFINITY {
            candidates[number] = before;
        }
        log_ratio
    }
}
