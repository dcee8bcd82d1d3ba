//! A body that other sensors measure as well.

use super::DetectedTarget;
use crate::tracker::measurements::Standing;

impl DetectedTarget {
    /// Predicts by `dt_s` seconds to a time in seconds, with what other sensors measured meanwhile.
    pub(super) fn advance(&mut self, time_s: f64, dt_s: f64) {
        let mut shared_m2 = [0.0; 6];
        self.add_shared(&mut shared_m2);
        let standing = Standing {
            is_known: self.track.is_known(),
            shared_m2,
            ground_z_m: self.is_planar.then_some(self.existence.ground_z_m),
            birth_velocity_sigma_mps: self.tuning.existence.birth_velocity_sigma_mps,
        };
        self.others
            .advance(&mut self.filter, (time_s, dt_s), &standing);
    }

    /// Whether its motion model has a velocity.
    pub(in crate::tracker) fn has_velocity(&self) -> bool {
        self.filter.has_velocity()
    }
}
