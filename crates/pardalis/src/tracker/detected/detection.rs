//! Step 1, detection: where the frames show the target, near its predicted position and, when that is not enough, anywhere.

use nalgebra::{Matrix3, Vector3};

use super::candidates::CandidateSearch;
use crate::likelihood::edge::{Detection, Detections, EdgeCue, EdgeFrame};
use crate::shape::Shape;
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

    /// Finds the detections in these frames.
    pub(super) fn detect(
        &mut self,
        edge: &mut EdgeCue,
        frames: &[EdgeFrame],
        predicted: &Prediction,
    ) {
        let tuning = self.tuning;
        self.detections.clear();
        let is_expected = predicted.existence > tuning.min_predicted_existence;
        if let Some(estimate) = predicted.estimate.as_ref().filter(|_| is_expected) {
            self.detect_near(edge, frames, estimate);
        }
        self.since_search += 1;
        let near = self.detections.as_slice().first();
        let is_sure = near.is_some_and(|found| found.coarse_log_ratio() > tuning.sure_log_ratio);
        if !is_sure
            || predicted.existence < tuning.sure_existence
            || self.since_search >= tuning.frames_between_searches
        {
            self.since_search = 0;
            for &position_m in self.candidates.positions_m(edge, frames) {
                let is_planar = self.is_planar;
                self.detections
                    .push_fit(|buffer| edge.fit(frames, position_m, None, is_planar, buffer));
            }
        }
        let apart_m = tuning.distinct_diameters * self.shape.diameter_m();
        self.detections
            .keep_distinct(tuning.min_log_ratio, apart_m, tuning.max_detections);
    }

    /// Detects the target near its predicted position, with the prediction as prior.
    fn detect_near(&mut self, edge: &mut EdgeCue, frames: &[EdgeFrame], predicted: &StateEstimate) {
        let mean_m = predicted.position_m;
        let information = self.information(predicted.covariance_m2);
        let prior = Some((&Vector3::from(mean_m), &information));
        let is_planar = self.is_planar;
        self.detections
            .push_fit(|buffer| edge.fit(frames, mean_m, prior, is_planar, buffer));
    }

    /// The inverse of a covariance (xx, xy, xz, yy, yz, zz in m²), no sharper than the tuning says.
    fn information(&self, [xx, xy, xz, yy, yz, zz]: [f64; 6]) -> Matrix3<f64> {
        let least = (self.tuning.min_sigma_diameters * self.shape.diameter_m()).powi(2);
        let covariance = Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz)
            + Matrix3::from_diagonal_element(least);
        covariance.try_inverse().unwrap_or_else(Matrix3::zeros)
    }
}
