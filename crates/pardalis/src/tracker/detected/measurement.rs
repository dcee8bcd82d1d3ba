//! What frames say of a target by themselves, without those before: smoothing needs it.

use nalgebra::{Matrix3, Vector3};

use super::DetectedTarget;
use crate::tracker::BodyMeasurement;
use pardalis_filter::bernoulli::MeasurementComponent;
use pardalis_filter::estimate::{StateEstimate, covariance_matrix};

/// Neighbouring frames share this part of the variance of a detection: of its edges and its background. Hand-set, from the errors of smoothed tracks.
const SHARED_SHARE: f64 = 0.25;

/// Where frames by themselves put a target, metres, given its detection and what the filter made of the prediction. The filter weighs the whole likelihood and not only its peak;
/// where the prediction says little in comparison, its mean is that of the frames alone.
pub(super) fn measured_m(
    detected: &MeasurementComponent,
    predicted: &StateEstimate,
    updated: &StateEstimate,
) -> Option<[f64; 3]> {
    let prior = covariance_matrix(predicted.covariance_m2);
    let least = Matrix3::from_diagonal_element(1e-9 * prior.trace());
    let inverse = (prior + covariance_matrix(detected.covariance_m2) + least).try_inverse()?;
    let peak = Vector3::from(detected.position_m);
    let off = Vector3::from(updated.position_m) - peak;
    Some((peak + prior * inverse * off).into())
}

impl DetectedTarget {
    /// What the latest frames say of the target by themselves; `None` if it was not detected, or the estimate does not follow the detection.
    pub(in crate::tracker) fn measurement(&self) -> Option<BodyMeasurement> {
        let is_followed = self.track.is_followed(self.time_s);
        let detected = self.detected.as_ref().filter(|_| is_followed)?;
        let mut covariance_m2 = detected.covariance_m2;
        let mut shared_m2 = covariance_m2.map(|v| SHARED_SHARE * v);
        self.add_shared(&mut shared_m2);
        if self.is_planar {
            // Its height is known.
            for at in [2, 4, 5] {
                (covariance_m2[at], shared_m2[at]) = (0.0, 0.0);
            }
        }
        Some(BodyMeasurement {
            position_m: self.measured_m.unwrap_or(detected.position_m),
            covariance_m2,
            shared_m2,
        })
    }
}
