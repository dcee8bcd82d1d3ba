//! How fast the target moves, as the way in which it moves says.
//!
//! The particles must allow for a kick at any moment, and their velocities are as uncertain as that. A mixture of modes over the same detections tells what rolls or rests from what
//! is hit. It does not act on what is detected or tracked.

use super::DetectedTarget;
use crate::tracker::TrackState;
use crate::tracker::existence::ExistenceSettings;
use pardalis_filter::estimate::StateEstimate;
use pardalis_filter::gaussian::GaussianStart;
use pardalis_filter::modes::{Measured, ModeFilter, ModeSettings};

/// The filter of a target that rolls or rests, is moved, flies or is hit; `None` if its velocities are those of its motion model.
pub(super) fn mode_filter(
    existence: &ExistenceSettings,
    is_planar: bool,
    velocity_sigma_mps: f64,
) -> Option<ModeFilter> {
    let mut settings = if is_planar {
        ModeSettings::planar()
    } else {
        ModeSettings::default()
    };
    settings.velocity_sigma_mps = velocity_sigma_mps;
    // The particles' rate is generous, so that some of them are where a kick may lead.
    let usual = ExistenceSettings::default();
    settings.hit_rate_hz *= existence.velocity_jump_rate_hz / usual.velocity_jump_rate_hz;
    settings.hit_sigma_mps *= existence.velocity_jump_sigma_mps / usual.velocity_jump_sigma_mps;
    existence.motion_modes.then(|| ModeFilter::new(settings))
}

impl DetectedTarget {
    /// Begins with what is known at a time in seconds.
    pub(super) fn begin_velocity(&mut self, time_s: f64, start: &GaussianStart) {
        if let Some(modes) = &mut self.modes {
            modes.begin(time_s, start);
        }
    }

    /// Takes what the latest frames measured, at a time in seconds. If nothing was known of the motion, they showed the target where it was up to `skew_s` earlier or later.
    pub(super) fn follow_velocity(&mut self, time_s: f64, skew_s: f64) {
        let mut measurement = self.measurement();
        if let Some(measurement) = &mut measurement {
            let off_m = skew_s * self.tuning.existence.birth_velocity_sigma_mps;
            for at in [0, 3, 5] {
                measurement.covariance_m2[at] += off_m * off_m;
            }
        }
        let Some(modes) = &mut self.modes else { return };
        let state = self.track.state();
        if state == TrackState::Lost {
            modes.reset();
            return;
        }
        let measurement = measurement.filter(|_| state == TrackState::Tracking);
        modes.observe(&Measured {
            time_s,
            position: measurement.map(|m| (m.position_m, m.covariance_m2)),
        });
    }

    /// Sets the velocity of an estimate `ahead_s` seconds after the latest frames. What other sensors measure is in the particles only.
    pub(super) fn set_velocity(&self, known: &mut StateEstimate, ahead_s: f64) {
        if known.velocity_mps.is_none() || self.others.counts().used > 0 {
            return;
        }
        let modes = self.modes.as_ref();
        if let Some(state) = modes.and_then(|modes| modes.estimate(ahead_s)) {
            known.velocity_mps = Some(state.velocity_mps);
            known.velocity_covariance_m2ps2 = Some(state.velocity_covariance_m2ps2);
        }
    }
}
