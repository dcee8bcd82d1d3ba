//! Rates at which a detected target appears, disappears and becomes occluded.

use pardalis_core::Error;

/// Rates at which a visible target becomes occluded in a camera, and an occluded one reappears.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct OcclusionRates {
    /// Occlusions of a visible target per second, Hz.
    pub occlusion_hz: f64,
    /// Reappearances of an occluded target per second, Hz.
    pub reappearance_hz: f64,
}

impl Default for OcclusionRates {
    fn default() -> Self {
        Self {
            occlusion_hz: 0.5,
            reappearance_hz: 1.0,
        }
    }
}

impl OcclusionRates {
    /// Returns the fraction of time during which a target is visible.
    pub(super) fn stationary(&self) -> f64 {
        self.reappearance_hz / (self.reappearance_hz + self.occlusion_hz)
    }
}

/// Rates at which a detected target appears, disappears and becomes occluded.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct ExistenceSettings {
    /// Appearances per second while there is no target, Hz.
    pub birth_rate_hz: f64,
    /// Disappearances per second of a target that exists, Hz.
    pub death_rate_hz: f64,
    /// Relocations per second, in which the target moves to an arbitrary position faster than by itself, Hz.
    pub relocation_rate_hz: f64,
    /// Sudden changes of velocity per second, such as kicks and bounces, Hz.
    pub velocity_jump_rate_hz: f64,
    /// Standard deviation of such a change, on each axis, m/s.
    pub velocity_jump_sigma_mps: f64,
    /// Rates of occlusion and reappearance in each camera.
    pub occlusion: OcclusionRates,
    /// Height of the ground in the world, for targets that stay on it, metres.
    pub ground_z_m: f64,
}

impl Default for ExistenceSettings {
    fn default() -> Self {
        Self {
            birth_rate_hz: 0.5,
            death_rate_hz: 0.02,
            relocation_rate_hz: 0.02,
            velocity_jump_rate_hz: 1.0,
            velocity_jump_sigma_mps: 4.0,
            occlusion: OcclusionRates::default(),
            ground_z_m: 0.0,
        }
    }
}

impl ExistenceSettings {
    /// Returns an error for rates out of range.
    pub fn check(&self) -> Result<(), Error> {
        for (name, value) in [
            ("birth_rate_hz", self.birth_rate_hz),
            ("death_rate_hz", self.death_rate_hz),
            ("relocation_rate_hz", self.relocation_rate_hz),
            ("velocity_jump_rate_hz", self.velocity_jump_rate_hz),
            ("velocity_jump_sigma_mps", self.velocity_jump_sigma_mps),
            ("occlusion_rate_hz", self.occlusion.occlusion_hz),
        ] {
            if !(0.0..=1000.0).contains(&value) {
                return Err(Error::out_of_range(name, value, "0 to 1000"));
            }
        }
        let reappearance_hz = self.occlusion.reappearance_hz;
        if !(reappearance_hz > 0.0 && reappearance_hz <= 1000.0) {
            let allowed = "above 0 and at most 1000";
            return Err(Error::out_of_range(
                "reappearance_rate_hz",
                reappearance_hz,
                allowed,
            ));
        }
        if !(self.ground_z_m.abs() <= 1e6) {
            let allowed = "-1e6 to 1e6";
            return Err(Error::out_of_range("ground_z_m", self.ground_z_m, allowed));
        }
        Ok(())
    }
}
