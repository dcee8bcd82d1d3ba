//! The estimate of a detected body: position, velocity and heading with their uncertainties, and the confidence.

use super::DetectedTarget;
use crate::tracker::{Estimate, RadiusEstimate};
use pardalis_filter::estimate::StateEstimate;

impl DetectedTarget {
    /// The probability that the target exists and lies within one diameter of the estimate.
    pub(in crate::tracker) fn confidence(&self) -> f64 {
        self.confidence_ahead(0.0)
    }

    /// The same `ahead_s` seconds after the latest frames.
    fn confidence_ahead(&self, ahead_s: f64) -> f64 {
        let near = |known: StateEstimate| {
            self.filter
                .weight_within(known.position_m, self.diameter_m())
        };
        let known = self.filter.estimate(ahead_s);
        self.filter.existence() * known.map_or(0.0, near)
    }

    /// Adds to a covariance of positions (xx, xy, xz, yy, yz, zz in m²) that of errors which frames share: of the size and of the cameras.
    pub(super) fn add_shared(&self, covariance_m2: &mut [f64; 6]) {
        let of_size = self.size_error_m2();
        let of_cameras = self.agreement.covariance_m2(&self.tuning.agreement);
        let of_cameras = [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)].map(|at| of_cameras[at]);
        for (sum, more) in covariance_m2.iter_mut().zip(of_size) {
            *sum += more;
        }
        for (sum, more) in covariance_m2.iter_mut().zip(of_cameras) {
            *sum += more;
        }
    }

    /// Estimates the target `ahead_s` seconds after the latest frames; nothing changes.
    pub(in crate::tracker) fn estimate(&self, ahead_s: f64) -> Estimate {
        let is_known = self.track.is_known();
        let mut kinematics = self.filter.estimate(ahead_s).filter(|_| is_known);
        if let (Some(known), Some(detected)) = (&mut kinematics, &self.detected) {
            // The smaller the effective sample size, the less the scatter of the particles says.
            let detected_m2 = self.sights.position_m2(detected.covariance_m2);
            for (sum, variance) in known.covariance_m2.iter_mut().zip(detected_m2) {
                *sum += variance / known.effective_sample_size;
            }
        }
        if let Some(known) = &mut kinematics {
            self.add_shared(&mut known.covariance_m2);
            self.set_velocity(known, self.time_s + ahead_s);
        }
        let size = self.size.known();
        let heading = self.heading.filter(|_| is_known);
        let heading = heading.and_then(|heading| heading.estimate(ahead_s, &self.tuning.heading));
        let confidence = if is_known {
            // Around members of crowds, others hide a part of them again and again.
            let shortfall = self.shortfall.confidence();
            let shortfall = if self.number().is_some() {
                1.0
            } else {
                shortfall
            };
            self.confidence_ahead(ahead_s) * shortfall
        } else {
            // The probability that the target exists and is visible.
            self.filter.existence() * self.track.greatest_visibility()
        };
        Estimate {
            state: self.track.state(),
            kinematics,
            heading_rad: heading.map(|[heading_rad, _]| heading_rad),
            heading_sigma_rad: heading.map(|[_, sigma_rad]| sigma_rad),
            radius: self.size.is_estimated().then(|| {
                let radius_m = 0.5 * self.diameter_m();
                RadiusEstimate {
                    radius_m,
                    sigma_m: size.sigma * radius_m,
                }
            }),
            confidence,
        }
    }
}
