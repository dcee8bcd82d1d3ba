//! The reported velocity of a detected target.
//!
//! The particles allow for a kick at any moment, which makes their velocities noisy. A [`ModeFilter`] over the same detections finds out whether the target rolls, is moved, flies or was
//! hit, and estimates its velocity from that. Tracking uses it only to predict where rolling shutters and the other frames of a set show the target.

use super::DetectedTarget;
use crate::tracker::existence::ExistenceSettings;
use nalgebra::{Matrix3, Vector3};
use pardalis_filter::estimate::{StateEstimate, covariance_matrix};
use pardalis_filter::gaussian::GaussianStart;
use pardalis_filter::modes::{ModeFilter, ModeSettings, ModeState};

/// The filter of a target that rolls or rests, is moved, flies or is hit; `None` if its velocities are those of its motion model.
pub(super) fn mode_filter(
    existence: &ExistenceSettings,
    is_planar: bool,
    velocity_sigma_mps: f64,
) -> Option<ModeFilter> {
    let settings = ModeSettings {
        velocity_sigma_mps,
        ..existence.mode_settings(is_planar)
    };
    existence.motion_modes.then(|| ModeFilter::new(settings))
}

/// From this squared distance on, in standard deviations, the velocities of modes and particles contradict one another: one in 10⁵ by chance. Hand-set.
const CONTRADICTION: f64 = 26.0;

impl DetectedTarget {
    /// Begins with what is known at a time in seconds.
    pub(super) fn begin_velocity(&mut self, time_s: f64, start: &GaussianStart) {
        if let Some(modes) = &mut self.modes {
            modes.begin(time_s, start);
        }
    }

    /// Takes what the latest frames measured, at a time in seconds, of a target that was known before or not. If nothing was known of the motion, they showed the target where it was up
    /// to `skew_s` earlier or later.
    pub(super) fn follow_velocity(&mut self, time_s: f64, was_known: bool, skew_s: f64) {
        if self.modes.is_none() {
            return;
        }
        let measurement = self.measurement();
        let particles = self.filter.estimate(0.0);
        let Some(modes) = &mut self.modes else { return };
        if was_known && !self.track.is_known() {
            modes.reset();
        }
        let is_known = self.track.is_known();
        let Some(mut measurement) = measurement.filter(|_| is_known) else {
            return;
        };
        let off_m = skew_s * self.tuning.existence.birth_velocity_sigma_mps;
        for at in [0, 3, 5] {
            measurement.covariance_m2[at] += off_m * off_m;
        }
        modes.observe(time_s, (measurement.position_m, measurement.covariance_m2));
        // Only particles are relocated. A relocation is no hit.
        let Some((known, state)) = particles.zip(modes.estimate(time_s)) else {
            return;
        };
        if contradict(&known, &state).unwrap_or(false) {
            modes.begin(time_s, &GaussianStart::from_estimate(&known));
        }
    }

    /// Sets the velocity of an estimate at a time in seconds. What other sensors measure is in the particles only.
    pub(super) fn set_velocity(&self, known: &mut StateEstimate, time_s: f64) {
        if known.velocity_mps.is_none() || self.others.counts().used > 0 {
            return;
        }
        let modes = self.modes.as_ref();
        if let Some(state) = modes.and_then(|modes| modes.estimate(time_s)) {
            known.velocity_mps = Some(state.velocity_mps);
            known.velocity_covariance_m2ps2 = Some(state.velocity_covariance_m2ps2);
        }
    }
}

/// Whether the velocities of particles and modes contradict one another; `None` if there is none, or no covariance.
fn contradict(known: &StateEstimate, state: &ModeState) -> Option<bool> {
    let off_mps = Vector3::from(state.velocity_mps) - Vector3::from(known.velocity_mps?);
    let of_both = covariance_matrix(state.velocity_covariance_m2ps2)
        + covariance_matrix(known.velocity_covariance_m2ps2?);
    // On a plane there is none along z.
    let least = 1e-9 * of_both.trace();
    let inverse = (of_both + Matrix3::from_diagonal_element(least)).try_inverse()?;
    Some(off_mps.dot(&(inverse * off_mps)) > CONTRADICTION)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What particles and modes say of a velocity along x, m/s, with these standard deviations on each axis, and along z.
    fn contradicts(particles: [f64; 2], modes: [f64; 2], vertical_share: f64) -> bool {
        let covariance = |sigma: f64| {
            let variance = sigma * sigma;
            [variance, 0.0, 0.0, variance, 0.0, vertical_share * variance]
        };
        let known = StateEstimate {
            position_m: [0.0; 3],
            velocity_mps: Some([particles[0], 0.0, 0.0]),
            velocity_covariance_m2ps2: Some(covariance(particles[1])),
            covariance_m2: [0.0; 6],
            best_position_m: [0.0; 3],
            effective_sample_size: 100.0,
        };
        let state = ModeState {
            position_m: [0.0; 3],
            velocity_mps: [modes[0], 0.0, 0.0],
            covariance_m2: [0.0; 6],
            velocity_covariance_m2ps2: covariance(modes[1]),
            modes: [1.0, 0.0, 0.0, 0.0],
        };
        contradict(&known, &state).unwrap()
    }

    #[test]
    fn a_relocation_contradicts_and_a_kick_does_not() {
        for vertical_share in [1.0, 0.0] {
            // It is one metre away after 0.04 s: the particles there are new, and modes take it for a hit.
            assert!(contradicts([0.0, 1.5], [28.0, 1.9], vertical_share));
            assert!(!contradicts([12.0, 2.0], [8.0, 1.0], vertical_share));
            assert!(!contradicts([0.0, 0.5], [0.0, 0.1], vertical_share));
        }
    }
}
