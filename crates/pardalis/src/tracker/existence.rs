//! Rates at which a detected target appears, disappears and becomes occluded.

use nalgebra::{Matrix3, Vector3};
use pardalis_core::Error;
use pardalis_filter::modes::ModeSettings;

/// Where a target can be: a box along the axes of the world, whose sides may lie at infinity.
///
/// ```
/// use pardalis::tracker::Region;
///
/// // Above a floor and below a ceiling.
/// let mut region = Region::default();
/// (region.min_m[2], region.max_m[2]) = (0.0, 2.5);
/// assert!(region.check().is_ok() && region.contains([4.0, -7.0, 0.1]));
/// assert!(!region.contains([0.0, 0.0, -0.16]));
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
#[allow(clippy::exhaustive_structs)] // a box has two corners
pub struct Region {
    /// The least x, y and z of the target's position, metres.
    pub min_m: [f64; 3],
    /// The greatest, metres.
    pub max_m: [f64; 3],
}

impl Default for Region {
    /// Everywhere.
    fn default() -> Self {
        Self {
            min_m: [f64::NEG_INFINITY; 3],
            max_m: [f64::INFINITY; 3],
        }
    }
}

impl Region {
    /// Returns an error unless the least coordinates are below the greatest.
    pub fn check(&self) -> Result<(), Error> {
        for (axis, name) in ["x_m", "y_m", "z_m"].into_iter().enumerate() {
            let [least, greatest] = [self.min_m[axis], self.max_m[axis]];
            if !(least < greatest) {
                let value = format!("[{least}, {greatest}]");
                let allowed = "a number and then a greater one";
                return Err(Error::out_of_range(name, value, allowed));
            }
        }
        Ok(())
    }

    /// Returns whether a position in the world (metres) lies in it.
    pub fn contains(&self, position_m: [f64; 3]) -> bool {
        (0..3).all(|axis| (self.min_m[axis]..=self.max_m[axis]).contains(&position_m[axis]))
    }

    /// Returns the least squared distance of any of its points from a Gaussian's mean (metres), in standard deviations; `information` is the inverse of its
    /// covariance, 1/m².
    pub(super) fn squared_sigmas(&self, mean_m: [f64; 3], information: &Matrix3<f64>) -> f64 {
        let mean = Vector3::from(mean_m);
        let clamped = |axis: usize, value: f64| value.clamp(self.min_m[axis], self.max_m[axis]);
        let mut nearest = Vector3::from_fn(|axis, _| clamped(axis, mean[axis]));
        // Coordinate descent; a convex function of three coordinates.
        for _ in 0..SWEEPS {
            for axis in 0..3 {
                let own = information[(axis, axis)];
                if own > 0.0 {
                    let gradient = information.row(axis).transpose().dot(&(nearest - mean));
                    nearest[axis] = clamped(axis, nearest[axis] - gradient / own);
                }
            }
        }
        let off = nearest - mean;
        off.dot(&(information * off)).max(0.0)
    }
}

/// Sweeps over the coordinates. Derivation: each at least quarters what is left if the correlation of coordinates is below one half; rays are correlated more, and a
/// few per cent of the distance do not matter.
const SWEEPS: usize = 30;

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
    /// Whether velocities are those of a mixture of [modes](pardalis_filter::modes): the target rolls or rests, is moved, flies or is hit. Otherwise they are those of the motion model.
    pub motion_modes: bool,
    /// Rates of occlusion and reappearance in each camera.
    pub occlusion: OcclusionRates,
    /// Height of the ground in the world, for targets that stay on it, metres; of balls the height of their centres.
    pub ground_z_m: f64,
    /// Where the target can be.
    pub region: Region,
}

impl Default for ExistenceSettings {
    fn default() -> Self {
        Self {
            birth_rate_hz: 0.5,
            death_rate_hz: 0.02,
            relocation_rate_hz: 0.02,
            velocity_jump_rate_hz: 1.0,
            velocity_jump_sigma_mps: 4.0,
            motion_modes: true,
            occlusion: OcclusionRates::default(),
            ground_z_m: 0.0,
            region: Region::default(),
        }
    }
}

impl ExistenceSettings {
    /// Returns how a target with these sudden changes of velocity may move, on a plane or not, for [`smoother::smooth`](pardalis_filter::smoother::smooth).
    ///
    /// The rate and size of the mode of a hit are to their defaults as those of the sudden changes are to theirs, which are generous: particles must be where a kick may lead.
    pub fn mode_settings(&self, is_planar: bool) -> ModeSettings {
        let mut settings = if is_planar {
            ModeSettings::planar()
        } else {
            ModeSettings::default()
        };
        let usual = Self::default();
        settings.hit_rate_hz *= self.velocity_jump_rate_hz / usual.velocity_jump_rate_hz;
        settings.hit_sigma_mps *= self.velocity_jump_sigma_mps / usual.velocity_jump_sigma_mps;
        settings
    }

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
        self.region.check()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distances_from_a_region_are_those_of_a_fine_search() {
        let mut region = Region::default();
        (region.min_m[2], region.max_m[0]) = (0.0, 1.0);
        // Along a ray: coordinates are correlated.
        let spread = nalgebra::Matrix3::new(0.04, 0.0, 0.0, 0.0, 0.01, 0.018, 0.0, 0.018, 0.04);
        let information = spread.try_inverse().unwrap();
        let squared = |mean_m| region.squared_sigmas(mean_m, &information);
        assert!(squared([0.3, 2.0, 0.1]) < 1e-12, "inside");
        for mean_m in [[0.3, 2.0, -0.3], [1.2, 0.0, -0.1], [1.5, 1.0, 2.0]] {
            let mut least = f64::INFINITY;
            for i in 0..200 {
                for j in 0..200 {
                    let (x, z) = (1.0 - 0.01 * f64::from(i), 0.01 * f64::from(j));
                    for k in -100..100 {
                        let y = mean_m[1] + 0.005 * f64::from(k);
                        let off = Vector3::new(x, y, z) - Vector3::from(mean_m);
                        least = least.min(off.dot(&(information * off)));
                    }
                }
            }
            let found = squared(mean_m);
            assert!(
                (found - least).abs() < 0.02 * least.max(1.0),
                "{found} {least}"
            );
        }
    }
}
