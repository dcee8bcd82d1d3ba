//! The ways in which a target may move in a step: with a velocity jump and without.

use super::BernoulliFilter;
use super::kinematics::Kinematics;

/// One way to move in a step.
pub(super) struct Way {
    /// Its probability.
    pub(super) chance: f64,
    /// The logarithm of the factor that corrects the weights of the particles that move like this: its probability over their share.
    pub(super) log_correction: f64,
    pub(super) kinematics: Kinematics,
}

/// The ways to move in a step.
pub(super) struct Ways {
    /// Without a velocity jump.
    pub(super) steady: Way,
    /// With one; `None` if that is impossible.
    pub(super) jumped: Option<Way>,
    jump_one_in: usize,
}

impl Ways {
    pub(super) fn all(&self) -> impl Iterator<Item = &Way> {
        std::iter::once(&self.steady).chain(&self.jumped)
    }

    /// Returns the way in which a particle moves. One in a few has a velocity jump, even if jumps are rare.
    pub(super) fn of_particle(&self, number: usize) -> &Way {
        match &self.jumped {
            Some(jumped) if number.is_multiple_of(self.jump_one_in) => jumped,
            _ => &self.steady,
        }
    }
}

impl BernoulliFilter {
    /// Returns the ways to move in a step of `dt_s` seconds.
    pub(super) fn ways(&self, dt_s: f64) -> Ways {
        let settings = &self.settings;
        let chance = -libm::expm1(-settings.velocity_jump_rate_hz * dt_s);
        let jumped = self
            .kinematics
            .jumped(settings.velocity_jump_sigma_mps, dt_s)
            .filter(|_| chance > 0.0);
        // Some particles must not jump.
        let jump_one_in = settings.proposal.jump_one_in.max(2);
        let share = 1.0 / jump_one_in as f64;
        let (chance, share) = jumped.map_or((0.0, 0.0), |_| (chance, share));
        let way = |chance: f64, share: f64, kinematics: Kinematics| Way {
            chance,
            log_correction: libm::log(chance / share),
            kinematics,
        };
        Ways {
            steady: way(1.0 - chance, 1.0 - share, self.kinematics),
            jumped: jumped.map(|jumped| way(chance, share, jumped)),
            jump_one_in,
        }
    }
}
