//! Cameras without a common trigger: frames of some cameras between those of others.
//!
//! Cameras that see a target at the same instant tell its place by their rays. A camera alone tells the distance by the size of the outline, with an error that all its
//! frames share: of the size that is assumed, and of the outline. If others have just told where the target is, such a frame must not count as if it had no such error:
//! along the ray, its likelihood is wider by it.

use nalgebra::{Matrix3, Vector3};

use super::DetectedTarget;
use super::association::AssociatedDetection;
use super::detection::{Outline, Prediction};
use super::measurement::measured_m;
use super::shortfall::Shortfall;
use crate::likelihood::edge::{Detection, Widening};
use pardalis_filter::bernoulli::MeasurementComponent;
use pardalis_filter::estimate::{StateEstimate, covariance_matrix};

/// For how long the prediction of the distance is better than what a camera alone sees, seconds. Hand-set: a thrown ball is predicted to a few millimetres for as long.
const RECENT_S: f64 = 0.2;

/// The entries xx, xy, xz, yy, yz, zz of a covariance.
fn entries(covariance: &Matrix3<f64>) -> [f64; 6] {
    [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)].map(|at| covariance[at])
}

/// How the likelihood of a detection is wider along the ray to it.
#[derive(Debug)]
struct Widened {
    widening: Widening,
    /// The variance of the error, m².
    error_m2: f64,
}

impl Widened {
    /// `sigma` is the standard deviation of the logarithm of the scale. `None` if the size says nothing.
    fn of(component: &MeasurementComponent, drift_m: [f64; 3], sigma: f64) -> Option<Self> {
        let error_m = sigma * Vector3::from(drift_m);
        let error_m2 = error_m.norm_squared();
        let along = error_m.try_normalize(0.0)?;
        let own_m2 = along.dot(&(covariance_matrix(component.covariance_m2) * along));
        let widening = Widening {
            center_m: component.position_m.into(),
            along,
            nearness: (own_m2 / (own_m2 + error_m2)).sqrt(),
        };
        Some(Self { widening, error_m2 })
    }

    /// Widens what a detection contributes.
    fn widen(self, associated: &mut AssociatedDetection) {
        let along = self.widening.along;
        let error = self.error_m2 * along * along.transpose();
        let covariance = covariance_matrix(associated.component.covariance_m2) + error;
        associated.component.covariance_m2 = entries(&covariance);
        // Its likelihood integrates to the same.
        associated.log_ratio_offset += libm::log(self.widening.nearness) as f32;
        associated.widened = Some(self.widening);
    }
}

/// Which cameras saw the target last, and the errors of the estimate after a widened detection.
#[derive(Debug)]
pub(super) struct Sights {
    /// By the camera's number.
    saw: Vec<bool>,
    time_s: f64,
    /// `None` if the latest detection was not widened.
    after: Option<AfterWidened>,
}

/// Covariances of the estimate after a widened detection, in m².
#[derive(Debug, Clone, Copy)]
struct AfterWidened {
    /// That of the position, by the detection and the prediction.
    position: Matrix3<f64>,
    /// The part of the error of the size that the particles do not show.
    size: Matrix3<f64>,
}

impl Sights {
    pub(super) fn new(cameras: usize) -> Self {
        Self {
            saw: vec![false; cameras],
            time_s: f64::NEG_INFINITY,
            after: None,
        }
    }

    pub(super) fn reset(&mut self) {
        self.saw.fill(false);
        self.after = None;
    }

    /// Forgets what was before a detection.
    pub(super) fn begin(&mut self) {
        self.after = None;
    }

    /// Whether a camera that is not among these, of an instant, has just seen the target.
    fn has_others(&self, cameras: impl Iterator<Item = usize> + Clone, time_s: f64) -> bool {
        let is_other = |camera: usize| self.saw[camera] && !cameras.clone().any(|c| c == camera);
        time_s - self.time_s <= RECENT_S && (0..self.saw.len()).any(is_other)
    }

    /// Notes a detection that is the target, and, if it is widened, how much is left of the error of the size that the prediction had `before`, and which is not in its
    /// covariance.
    pub(super) fn note(
        &mut self,
        detection: &Detection,
        associated: &AssociatedDetection,
        time_s: f64,
        predicted: Option<&StateEstimate>,
        before: [f64; 6],
    ) {
        self.saw.fill(false);
        for camera in detection.cameras() {
            self.saw[camera] = true;
        }
        self.time_s = time_s;
        let predicted = predicted.filter(|_| associated.widened.is_some());
        self.after = predicted.and_then(|predicted| {
            let prior = covariance_matrix(predicted.covariance_m2);
            let both = prior + covariance_matrix(associated.component.covariance_m2);
            let gain = prior * both.cholesky()?.inverse();
            let kept = Matrix3::identity() - gain;
            Some(AfterWidened {
                position: kept * prior,
                // That of these frames is in the widened likelihood.
                size: kept * covariance_matrix(before) * kept.transpose(),
            })
        });
    }

    /// The covariance of the error of the size in the estimate, given that of the latest detection: xx, xy, xz, yy, yz, zz in m².
    pub(super) fn size_error_m2(&self, latest: [f64; 6]) -> [f64; 6] {
        self.after.map_or(latest, |after| entries(&after.size))
    }

    /// The covariance of the position by the latest detection, given its own: xx, xy, xz, yy, yz, zz in m². A widened one says little along its ray, and the prediction more.
    pub(super) fn position_m2(&self, latest: [f64; 6]) -> [f64; 6] {
        self.after.map_or(latest, |after| entries(&after.position))
    }
}

impl DetectedTarget {
    /// The covariance of the error of the size in the estimate: xx, xy, xz, yy, yz, zz in m².
    pub(super) fn size_error_m2(&self) -> [f64; 6] {
        let sigma = libm::hypot(self.size.known().sigma, self.outline.sigma);
        let [x, y, z] = self.outline.drift_m.map(|drift_m| sigma * drift_m);
        self.sights
            .size_error_m2([x * x, x * y, x * z, y * y, y * z, z * z])
    }

    /// Widens what is detected in the frames of some cameras if others have just seen the target.
    pub(super) fn widen(
        &self,
        cameras: impl Iterator<Item = usize> + Clone,
        time_s: f64,
        associated: &mut [AssociatedDetection],
    ) {
        let is_known = !self.is_planar && self.track.is_known();
        if !is_known || !self.sights.has_others(cameras, time_s) {
            return;
        }
        let detections = self.detector.detections();
        for found in associated {
            let outline = Outline::of(&detections[found.detection], &self.tuning.detection);
            let sigma = libm::hypot(self.size.known().sigma, outline.sigma);
            if let Some(widened) = Widened::of(&found.component, outline.drift_m, sigma) {
                widened.widen(found);
            }
        }
    }

    /// Takes over what the detection that is the target says, if there is one.
    pub(super) fn take(
        &mut self,
        target: Option<&AssociatedDetection>,
        predicted: &Prediction,
        time_s: f64,
    ) {
        self.detected = target.map(|target| target.component);
        self.measured_m = None;
        let Some(target) = target else { return };
        let predicted = predicted.estimate.as_ref();
        self.measured_m = predicted.and_then(|predicted| {
            measured_m(&target.component, predicted, &self.filter.estimate(0.0)?)
        });
        let before = self.size_error_m2();
        let detection = &self.detector.detections()[target.detection];
        if self.track.is_known() {
            let cameras = detection.camera_count() as f64;
            self.shortfall.add(detection.judged_log_ratio() / cameras);
        } else {
            self.shortfall = Shortfall::default();
        }
        self.agreement
            .note_sighting(detection.cameras(), time_s, &self.tuning.agreement);
        self.sights
            .note(detection, target, time_s, predicted, before);
        self.outline = Outline::of(detection, &self.tuning.detection);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The ray is a principal axis of what a camera alone sees.
    #[test]
    fn detections_are_wider_by_the_error_along_their_ray() {
        let along = Vector3::new(0.6, 0.0, 0.8_f64);
        let of_ray = along * along.transpose();
        let own: Matrix3<f64> = 1e-6 * (Matrix3::identity() - of_ray) + 4e-6 * of_ray;
        let component = MeasurementComponent {
            position_m: [0.5, 0.1, 0.9],
            covariance_m2: entries(&own),
            log_weight: 0.0,
        };
        let widened = Widened::of(&component, [0.24, 0.0, 0.32], 0.02).unwrap();
        assert!((widened.error_m2 - 0.008_f64.powi(2)).abs() < 1e-12);
        let wider = (4e-6_f64 + 0.008_f64.powi(2)) / 4e-6;
        assert!((widened.widening.nearness.powi(-2) / wider - 1.0).abs() < 1e-9);
        assert!((widened.widening.along - along).norm() < 1e-12);
        assert!(Widened::of(&component, [0.0; 3], 0.02).is_none());
    }
}
