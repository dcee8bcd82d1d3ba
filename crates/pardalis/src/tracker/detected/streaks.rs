//! Streaks: outlines that move while the shutter is open. How far follows from the velocity and the exposure, or from the form of a blob.

use nalgebra::Vector3;

use super::detection::Detector;
use crate::detect::Blob;
use crate::likelihood::edge::{Detection, EdgeCue, EdgeFrame, PositionPrior, SizePrior};
use crate::tracker::candidate::Candidate;

/// For what share of the time between frames the shutter may be open. Hand-set: longer by about a third each.
const EXPOSURES: [f64; 5] = [0.25, 0.4, 0.6, 0.8, 1.0];
/// The weight of one frame in the running means of log-likelihood ratios. Hand-set: exposures rarely change.
const RATE: f64 = 0.3;
/// Streaks whose means are less than this share of outlines' at rest are not looked for where an outline at rest fits. Hand-set.
const LIKELY_SHARE: f64 = 0.5;
/// By how much a target is wider than the blob of its streak, and the streak longer than follows from the blob, whose ends are too pale. Hand-set.
const BLOB_FACTORS: [[f64; 2]; 4] = [[1.3, 1.3], [1.3, 2.0], [1.8, 1.3], [1.8, 2.0]];
/// Of how many blobs streaks are looked for, the largest first. Hand-set: bounds the time.
const BLOBS: usize = 3;
/// The greatest number of streaks that are fitted in one instant.
pub(super) const MAX_FITS: usize = EXPOSURES.len() + BLOBS * BLOB_FACTORS.len();

/// How well each exposure explained the frames so far: running means of log-likelihood ratios, nats.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Exposures {
    at_rest: f64,
    streaks: [f64; EXPOSURES.len()],
}

impl Exposures {
    /// The exposures, the likeliest first.
    fn ranked(&self) -> [usize; EXPOSURES.len()] {
        let mut ranked = std::array::from_fn(|exposure| exposure);
        // Of equally likely ones the shortest comes first.
        ranked.sort_by(|&a, &b| self.streaks[b].total_cmp(&self.streaks[a]));
        ranked
    }
}

/// Moves a running mean of log-likelihood ratios. What does not fit counts 0.
fn note(mean: &mut f64, log_ratio: f64) {
    *mean += RATE * (log_ratio.max(0.0) - *mean);
}

impl Detector {
    /// Fits the prediction as a streak with each of the possible exposures, the likeliest first, until one is certain. `way_m` is how far the target moved since the frames
    /// before. The prediction has been fitted at rest.
    pub(super) fn fit_streaks(
        &mut self,
        (edge, frames): (&mut EdgeCue, &[EdgeFrame]),
        prior: (PositionPrior, SizePrior),
        candidates: &mut [Candidate],
        (position_m, way_m): ([f64; 3], [f64; 3]),
    ) {
        let at_rest = self.greatest_log_ratio();
        let ranked = self.exposures.ranked();
        let diameter_m = prior.1.scale() * self.shape.diameter_m();
        let least_m = self.tuning.min_streak_diameters * diameter_m;
        if EXPOSURES[ranked[0]] * Vector3::from(way_m).norm() < least_m {
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
            let displacement_m = way_m.map(|v| EXPOSURES[exposure] * v);
            let streak_m = (position_m, displacement_m);
            let log_ratio = self.fit_streak((edge, frames), prior, candidates, (0, streak_m));
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
            let Some(&blob) = candidates[number].origin.blob() else {
                continue;
            };
            if blob.cut_off || count == BLOBS || !self.may_be_streak(&blob) {
                continue;
            }
            count += 1;
            for factors in BLOB_FACTORS {
                let streak_m = self.candidates.streak_m(edge, frame, &blob, factors, &size);
                let Some(streak_m) = streak_m else {
                    continue;
                };
                let streak = (number, streak_m);
                if self.fit_streak((edge, frames), (None, size), candidates, streak) > sure {
                    break;
                }
            }
        }
    }

    /// Returns whether a blob is long enough, and wide enough to have a form.
    fn may_be_streak(&self, blob: &Blob) -> bool {
        let [along, across] = blob.principal_variances_px2().map(f64::sqrt);
        across >= self.tuning.min_streak_sigma_px
            && along >= self.tuning.min_streak_elongation * across
    }

    /// Fits a candidate as a streak, from a position and with a displacement. The candidate tells of the likeliest of its fits. Returns the log-likelihood ratio.
    fn fit_streak(
        &mut self,
        (edge, frames): (&mut EdgeCue, &[EdgeFrame]),
        prior: (PositionPrior, SizePrior),
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
        let log_ratio = self.fit((edge, frames), prior, candidates, (number, displacement_m));
        if log_ratio <= greatest || log_ratio == f64::NEG_INFINITY {
            candidates[number] = before;
        }
        log_ratio
    }
}
