//! Cameras without a common trigger: frames of some cameras between those of others.
//!
//! Cameras that see a target at the same instant tell its place by their rays. A camera alone tells the distance by the size of the outline, with an error that all its
//! frames share: of the size that is assumed, and of the outline. If others have just told where the target is, such a frame must not count as if it had no such error:
//! along the ray, its likelihood is wider by it.

use nalgebra::{Matrix3, Vector3};

use super::DetectedTarget;
use super::association::AssociatedDetection;
use super::detection::{Outline, Prediction};
use super::measurement::{matrix, measured_m};
use crate::likelihood::edge::Detection;
use pardalis_filter::bernoulli::MeasurementComponent;
use pardalis_filter::estimate::StateEstimate;

/// For how long the prediction of the distance is better than what a camera alone sees, seconds. Hand-set: a thrown ball is predicted to a few millimetres for as long.
const RECENT_S: f64 = 0.2;

/// The entries xx, xy, xz, yy, yz, zz of a covariance.
fn entries(covariance: &Matrix3<f64>) -> [f64; 6] {
    [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)].map(|at| covariance[at])
}

/// The likelihood of frames, wider along the ray to a detection.
#[derive(Debug, Clone, Copy)]
pub(super) struct Widened {
    /// The number of the detection among those associated.
    pub(super) associated: usize,
    /// Its position, metres.
    center_m: Vector3<f64>,
    /// The unit vector along which the error lies.
    along: Vector3<f64>,
    /// How near to the centre a place on this line counts, relative to where it is.
    nearness: f64,
    /// The variance of the error, m².
    error_m2: f64,
}

impl Widened {
    /// `sigma` is the standard deviation of the logarithm of the scale. `None` if the size says nothing.
    fn of(
        (associated, component): (usize, &MeasurementComponent),
        drift_m: [f64; 3],
        sigma: f64,
    ) -> Option<Self> {
        let error_m = sigma * Vector3::from(drift_m);
        let error_m2 = error_m.norm_squared();
        let along = error_m.try_normalize(0.0)?;
        let own_m2 = along.dot(&(matrix(component.covariance_m2) * along));
        Some(Self {
            associated,
            center_m: component.position_m.into(),
            along,
            nearness: (own_m2 / (own_m2 + error_m2)).sqrt(),
            error_m2,
        })
    }

    /// The covariance of the error, m².
    fn error(&self) -> Matrix3<f64> {
        self.error_m2 * self.along * self.along.transpose()
    }

    /// Widens what the detection contributes.
    fn widen(&self, associated: &mut AssociatedDetection) {
        let covariance = matrix(associated.component.covariance_m2) + self.error();
        associated.component.covariance_m2 = entries(&covariance);
        // Its likelihood integrates to the same.
        associated.log_ratio_offset += libm::log(self.nearness) as f32;
    }

    /// Writes where places (columns of metres) count.
    pub(super) fn move_places(&self, [x, y, z]: [&[f32]; 3], moved: &mut [Vec<f32>; 3]) {
        let [center, along] = [self.center_m, self.along].map(|v| v.map(|v| v as f32));
        let less = (1.0 - self.nearness) as f32;
        for column in &mut *moved {
            column.clear();
        }
        for ((&x, &y), &z) in x.iter().zip(y).zip(z) {
            let place = Vector3::new(x, y, z);
            let place = place - less * along.dot(&(place - center)) * along;
            for (column, component) in moved.iter_mut().zip(place.iter()) {
                column.push(*component);
            }
        }
    }
}

/// Which cameras saw the target last, and the error of its size in the estimate.
#[derive(Debug)]
pub(super) struct Sights {
    /// By the camera's number.
    saw: Vec<bool>,
    time_s: f64,
    /// The covariance of the part of it that the particles do not show, m²; `None` if it is that of the latest detection.
    error_m2: Option<Matrix3<f64>>,
}

impl Sights {
    pub(super) fn new(cameras: usize) -> Self {
        Self {
            saw: vec![false; cameras],
            time_s: f64::NEG_INFINITY,
            error_m2: None,
        }
    }

    pub(super) fn reset(&mut self) {
        self.saw.fill(false);
        self.error_m2 = None;
    }

    /// Forgets what was before a detection.
    pub(super) fn begin(&mut self) {
        self.error_m2 = None;
    }

    /// Widens the detection that is nearest to the prediction, if a camera without a frame now has just seen the target. `sigma` gives the standard deviation of the
    /// logarithm of a detection's scale.
    pub(super) fn widen(
        &self,
        (cameras, time_s): (impl Iterator<Item = usize> + Clone, f64),
        predicted: Option<&StateEstimate>,
        detections: &[Detection],
        associated: &mut [AssociatedDetection],
        sigma: impl Fn(&Detection) -> (Outline, f64),
    ) -> Option<Widened> {
        let is_other = |camera: usize| self.saw[camera] && !cameras.clone().any(|c| c == camera);
        if time_s - self.time_s > RECENT_S || !(0..self.saw.len()).any(is_other) {
            return None;
        }
        let predicted = predicted?;
        let widened = associated.iter().enumerate().filter_map(|(number, found)| {
            let (outline, sigma) = sigma(&detections[found.detection]);
            let widened = Widened::of((number, &found.component), outline.drift_m, sigma)?;
            let covariance = matrix(predicted.covariance_m2)
                + matrix(found.component.covariance_m2)
                + widened.error();
            let off_m = widened.center_m - Vector3::from(predicted.position_m);
            let squared = off_m.dot(&covariance.cholesky()?.solve(&off_m));
            Some((squared, widened))
        });
        let (_, widened) = widened.min_by(|(a, _), (b, _)| a.total_cmp(b))?;
        widened.widen(&mut associated[widened.associated]);
        Some(widened)
    }

    /// Notes a detection that is the target, and how much is left of the error of the size that the prediction had `before`, and which is not in its covariance.
    pub(super) fn note(
        &mut self,
        (detection, component): (&Detection, &MeasurementComponent),
        time_s: f64,
        is_widened: bool,
        predicted: Option<&StateEstimate>,
        before: [f64; 6],
    ) {
        self.saw.fill(false);
        for camera in detection.cameras() {
            self.saw[camera] = true;
        }
        self.time_s = time_s;
        self.error_m2 = predicted.filter(|_| is_widened).and_then(|predicted| {
            let prior = matrix(predicted.covariance_m2);
            let both = prior + matrix(component.covariance_m2);
            let gain = prior * both.cholesky()?.inverse();
            let kept = Matrix3::identity() - gain;
            // That of these frames is in the widened likelihood.
            Some(kept * matrix(before) * kept.transpose())
        });
    }

    /// The covariance of the error of the size in the estimate, given that of the latest detection: xx, xy, xz, yy, yz, zz in m².
    pub(super) fn error_m2(&self, latest: [f64; 6]) -> [f64; 6] {
        self.error_m2.as_ref().map_or(latest, entries)
    }
}

impl DetectedTarget {
    /// The covariance of the error of the size in the estimate: xx, xy, xz, yy, yz, zz in m².
    pub(super) fn size_error_m2(&self) -> [f64; 6] {
        let sigma = libm::hypot(self.size.known().sigma, self.outline.sigma);
        let [x, y, z] = self.outline.drift_m.map(|drift_m| sigma * drift_m);
        self.sights
            .error_m2([x * x, x * y, x * z, y * y, y * z, z * z])
    }

    /// Widens the likelihood of frames of some cameras between those of others.
    pub(super) fn widen(
        &self,
        instant: (impl Iterator<Item = usize> + Clone, f64),
        predicted: &Prediction,
        associated: &mut [AssociatedDetection],
    ) -> Option<Widened> {
        if self.is_planar || !self.track.is_known() {
            return None;
        }
        let sigma = |detection: &Detection| {
            let outline = Outline::of(detection, &self.tuning.detection);
            (outline, libm::hypot(self.size.known().sigma, outline.sigma))
        };
        let detections = self.detector.detections();
        let predicted = predicted.estimate.as_ref();
        self.sights
            .widen(instant, predicted, detections, associated, sigma)
    }

    /// Takes over what the detection that is the target says, if there is one.
    pub(super) fn take(
        &mut self,
        target: Option<&AssociatedDetection>,
        is_widened: bool,
        predicted: &Prediction,
        time_s: f64,
    ) {
        self.detected = target.map(|target| target.component);
        self.measured_m = None;
        let Some(target) = target else { return };
        let by_liveliness_m2 = predicted.by_liveliness_m2;
        let predicted = predicted.estimate.as_ref();
        self.measured_m = predicted.and_then(|known| {
            let covariances_m2 = by_liveliness_m2.unwrap_or([Some(known.covariance_m2), None]);
            let updated = (&self.filter.estimate(0.0)?, self.filter.calm_chance());
            measured_m(&target.component, &covariances_m2, updated)
        });
        let before = self.size_error_m2();
        let detection = &self.detector.detections()[target.detection];
        let found = (detection, &target.component);
        self.sights
            .note(found, time_s, is_widened, predicted, before);
        self.outline = Outline::of(detection, &self.tuning.detection);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The ray is a principal axis of what a camera alone sees.
    #[test]
    fn places_count_as_in_a_gaussian_that_is_wider_along_the_ray() {
        let along = Vector3::new(0.6, 0.0, 0.8_f64);
        let of_ray = along * along.transpose();
        let own: Matrix3<f64> = 1e-6 * (Matrix3::identity() - of_ray) + 4e-6 * of_ray;
        let component = MeasurementComponent {
            position_m: [0.5, 0.1, 0.9],
            covariance_m2: entries(&own),
            log_weight: 0.0,
        };
        let widened = Widened::of((0, &component), [0.24, 0.0, 0.32], 0.02).unwrap();
        let wide = own + 0.008_f64.powi(2) * of_ray;
        let squared = |place_m: Vector3<f64>, covariance: Matrix3<f64>| {
            let off_m = place_m - Vector3::from(component.position_m);
            off_m.dot(&(covariance.try_inverse().unwrap() * off_m))
        };
        let across = Vector3::new(0.8, 0.0, -0.6_f64);
        for (far_m, beside_m) in [(0.01, 0.0), (-0.02, 0.001), (0.003, -0.002), (0.0, 0.004)] {
            let place_m = widened.center_m + far_m * along + beside_m * across;
            let columns = place_m.map(|component| vec![component as f32]);
            let mut moved = [(); 3].map(|()| Vec::new());
            let [x, y, z] = [0, 1, 2].map(|axis| &columns[axis][..]);
            widened.move_places([x, y, z], &mut moved);
            let moved_m = Vector3::from_fn(|axis, _| f64::from(moved[axis][0]));
            let (found, expected) = (squared(moved_m, own), squared(place_m, wide));
            assert!(
                (found - expected).abs() < 1e-3 * expected + 1e-3,
                "{far_m} {beside_m}: {found} for {expected}"
            );
        }
        assert!(Widened::of((0, &component), [0.0; 3], 0.02).is_none());
    }
}
