//! The ways in which a target may move in a step: calmly or in a lively manner, and with a velocity jump.

use super::BernoulliFilter;
use super::kinematics::Kinematics;
use pardalis_core::Error;

/// How calm targets move. A target is lively, as the motion model says, or calm; which of both, the images show by and by.
///
/// A model that allows for throws says of a target at rest that it may be thrown at any moment. Without calm targets, the velocity of each would be as uncertain as that of
/// one that is thrown, and so would be where it is after an occlusion. Interacting motion models: Blom and Bar-Shalom 1988; here each particle has its own.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CalmMotion {
    /// The process noise of a calm target as a share of that of the motion model, 0 to 1.
    pub noise_share: f64,
    /// How often a lively target becomes calm, 1/s.
    pub calming_rate_hz: f64,
    /// How often a calm target becomes lively, 1/s. A velocity jump makes it lively, too.
    pub rousing_rate_hz: f64,
}

impl CalmMotion {
    pub(super) fn check(&self) -> Result<(), Error> {
        if !(0.0..=1.0).contains(&self.noise_share) {
            let allowed = "0 to 1";
            return Err(Error::out_of_range(
                "noise_share",
                self.noise_share,
                allowed,
            ));
        }
        for (name, rate_hz) in [
            ("calming_rate_hz", self.calming_rate_hz),
            ("rousing_rate_hz", self.rousing_rate_hz),
        ] {
            if !(0.0..=1e9).contains(&rate_hz) {
                return Err(Error::out_of_range(name, rate_hz, "0 to 1e9"));
            }
        }
        Ok(())
    }

    /// Returns the probability that a calm target is lively, or a lively one calm, `dt_s` seconds later.
    fn turn_chance(&self, is_calm: bool, dt_s: f64) -> f64 {
        let both_hz = self.calming_rate_hz + self.rousing_rate_hz;
        let away_hz = if is_calm {
            self.rousing_rate_hz
        } else {
            self.calming_rate_hz
        };
        if both_hz > 0.0 {
            -away_hz / both_hz * libm::expm1(-both_hz * dt_s.max(0.0))
        } else {
            0.0
        }
    }
}

/// One way to move in a step.
#[derive(Debug, Clone, Copy)]
pub(super) struct Way {
    /// Its probability.
    pub(super) chance: f64,
    /// The share of the particles that move like this, and the logarithm of the factor that corrects their weights for it.
    share: f64,
    pub(super) log_correction: f64,
    pub(super) kinematics: Kinematics,
    /// Whether the target is calm after the step.
    pub(super) is_calm: bool,
}

/// The ways of a target that was calm, or lively, before the step. Those that are impossible have the probability and the share 0.
#[derive(Debug, Clone, Copy)]
pub(super) struct Ways {
    /// As calm, or lively, as before, without a velocity jump.
    kept: Way,
    /// Otherwise than before, without a velocity jump.
    turned: Way,
    pub(super) jumped: Way,
    jump_one_in: usize,
    /// Which of every `2·jump_one_in` particles turns.
    turning: usize,
}

impl Ways {
    /// Returns the way in which a particle moves. A few move in each way that is possible, even if it is rare.
    pub(super) fn of_particle(&self, number: usize) -> &Way {
        if self.jumped.share > 0.0 && number.is_multiple_of(self.jump_one_in) {
            &self.jumped
        } else if self.turned.share > 0.0 && number % (2 * self.jump_one_in) == self.turning {
            &self.turned
        } else {
            &self.kept
        }
    }

    pub(super) fn possible(&self) -> impl Iterator<Item = &Way> {
        let all = [&self.kept, &self.turned, &self.jumped];
        all.into_iter().filter(|way| way.chance > 0.0)
    }

    /// Returns the way without a velocity jump after which the target is calm, or lively.
    pub(super) fn steady(&self, is_calm: bool) -> &Way {
        [&self.turned, &self.kept][usize::from(self.kept.is_calm == is_calm)]
    }
}

impl BernoulliFilter {
    /// Returns the ways to move in a step of `dt_s` seconds: of a target that was lively, and of one that was calm.
    pub(super) fn ways(&self, dt_s: f64) -> [Ways; 2] {
        let settings = &self.settings;
        let lively = self.kinematics;
        let calm = settings.calm.filter(|_| lively.has_velocity());
        let jumped = lively.jumped(settings.velocity_jump_sigma_mps, dt_s);
        let jump_chance = jumped.map_or(0.0, |_| {
            -libm::expm1(-settings.velocity_jump_rate_hz * dt_s)
        });
        let jump_one_in = settings.proposal.jump_one_in.max(2);
        // Another one in every update: particles that turned in the last one, and have not been resampled, would turn back. Never one that jumps.
        let at = self.observation as usize % (2 * (jump_one_in - 1));
        let turning = 1 + at + at / (jump_one_in - 1);
        let share_of = |chance: f64, one_in: usize| {
            if chance > 0.0 {
                1.0 / one_in as f64
            } else {
                0.0
            }
        };
        let way = |chance: f64, share: f64, kinematics: Kinematics, is_calm: bool| Way {
            chance,
            share,
            log_correction: libm::log(chance / share),
            kinematics,
            is_calm,
        };
        let jump_share = share_of(jump_chance, jump_one_in);
        let jumped = way(jump_chance, jump_share, jumped.unwrap_or(lively), false);
        [false, true].map(|was_calm| {
            let turn_chance = calm.map_or(0.0, |calm| calm.turn_chance(was_calm, dt_s));
            let turn_share = share_of(turn_chance, 2 * jump_one_in);
            let steady = |is_calm: bool, chance: f64, share: f64| {
                let kinematics = match calm {
                    Some(calm) if is_calm => lively.with_noise(calm.noise_share * lively.noise()),
                    _ => lively,
                };
                way((1.0 - jump_chance) * chance, share, kinematics, is_calm)
            };
            let kept_share = 1.0 - jumped.share - turn_share;
            Ways {
                kept: steady(was_calm, 1.0 - turn_chance, kept_share),
                turned: steady(!was_calm, turn_chance, turn_share),
                jumped,
                jump_one_in,
                turning,
            }
        })
    }

    /// Returns what moments of a step of `dt_s` seconds need: the velocity jump, and the kinematics with the mean noise of all ways but for its excess over that of a lively
    /// target, of a target that was lively and of one that was calm. Moments of a mixture are those of its mean noise, since they are linear in it.
    pub(super) fn mean_kinematics(&self, dt_s: f64) -> (Way, [Kinematics; 2]) {
        let lively = self.kinematics.noise();
        let ways = self.ways(dt_s);
        let mean = ways.map(|ways| {
            let calm = ways.steady(true);
            let calm = calm.chance * (calm.kinematics.noise() - lively);
            self.kinematics.with_noise(lively + calm)
        });
        (ways[0].jumped, mean)
    }
}
