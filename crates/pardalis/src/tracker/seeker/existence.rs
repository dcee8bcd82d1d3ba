//! How a target comes, goes and hides.

use super::OcclusionRates;
use pardalis_core::Error;

/// How a target comes, goes and hides.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ExistenceSettings {
    /// How often a target appears where there was none, a second.
    pub birth_rate_hz: f64,
    /// How often one goes away, a second.
    pub death_rate_hz: f64,
    /// How often one is taken elsewhere, faster than it moves, a second.
    pub relocation_rate_hz: f64,
    /// How often something kicks it, or it bounces, a second, ...
    pub velocity_jump_rate_hz: f64,
    /// ... and the standard deviation, on each axis, by which that changes its velocity, m/s.
    pub velocity_jump_sigma_mps: f64,
    /// How often something hides it from a camera.
    pub occlusion: OcclusionRates,
    /// Where targets that stay on the ground stand, metres.
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
    /// Refuses what are no rates.
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
