//! Random jumps of particles into a search area, which recover a lost target (Campos 2009, eq. 13).

use super::check_strength;
use super::linear::{Step, in_chunks};
use crate::gaussian::MAX_START;
use crate::particles::Particles;
use pardalis_core::Error;
use pardalis_core::rng::Stage;

/// Probability that a particle jumps in a step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum JumpChance {
    /// Probability β per step regardless of its length, as published for a fixed frame rate.
    PerStep {
        /// β, 0 to 1.
        share: f64,
    },
    /// Rate r: probability 1 − exp(−rΔt) over a step of Δt, so that two half steps move as many
    /// particles as one whole step.
    Rate {
        /// r, in jumps per second.
        rate_hz: f64,
    },
}

/// Uniform jumps into an axis-aligned box of the world frame. In a plane, particles jump within the
/// box's rectangle and keep their height.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Jumps {
    chance: JumpChance,
    min_m: [f64; 3],
    max_m: [f64; 3],
}

impl Jumps {
    /// Creates jumps into the box between two corners. Coordinates must lie between -1e6 and 1e6,
    /// and no coordinate of `max_m` may be smaller than that of `min_m`.
    pub fn new(chance: JumpChance, min_m: [f64; 3], max_m: [f64; 3]) -> Result<Self, Error> {
        match chance {
            JumpChance::PerStep { share } if !(0.0..=1.0).contains(&share) => {
                return Err(Error::out_of_range("probability", share, "0 to 1"));
            }
            JumpChance::PerStep { .. } => {}
            JumpChance::Rate { rate_hz } => check_strength(("rate_hz", rate_hz))?,
        }
        let reject = |name, corner: [f64; 3], allowed| {
            Err(Error::out_of_range(name, format!("{corner:?}"), allowed))
        };
        for (name, corner) in [("min_m", min_m), ("max_m", max_m)] {
            if corner.iter().any(|v| !(v.abs() <= MAX_START)) {
                return reject(name, corner, "numbers between -1e6 and 1e6");
            }
        }
        if min_m.iter().zip(max_m).any(|(&min, max)| max < min) {
            return reject("max_m", max_m, "no coordinate below that of min_m");
        }
        Ok(Self {
            chance,
            min_m,
            max_m,
        })
    }

    /// Returns the probability that a particle jumps during a step of `dt_s` > 0 seconds.
    pub fn probability(&self, dt_s: f64) -> f64 {
        match self.chance {
            JumpChance::PerStep { share } => share,
            JumpChance::Rate { rate_hz } => -libm::expm1(-rate_hz * dt_s),
        }
    }

    /// Moves the particles that jump in this step.
    pub(super) fn propagate(&self, particles: &mut Particles, step: &Step) {
        let probability = self.probability(step.dt_s);
        in_chunks::<3>(particles, &|first, columns| {
            for i in 0..columns[0].len() {
                let particle = first + i as u32;
                let [chance, position @ ..] =
                    step.draws.uniforms(particle, step.observation, Stage::Jump);
                if chance < probability {
                    for axis in 0..step.free_axes {
                        let (min_m, max_m) = (self.min_m[axis], self.max_m[axis]);
                        columns[axis][i] = (min_m + position[axis] * (max_m - min_m)) as f32;
                    }
                }
            }
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::motion::{Motion, PositionNoise, RandomWalk};
    use pardalis_core::rng::Draws;
    use pardalis_core::simd::Level;

    const MIN_M: [f64; 3] = [-2.0, 1.0, 0.5];
    const MAX_M: [f64; 3] = [3.0, 1.5, 0.75];
    const COUNT: usize = 50_000;

    /// Runs a random walk with jumps from the origin for one second, divided into `steps` steps.
    fn walked(chance: JumpChance, planar: bool, steps: u32) -> Particles {
        let walk = RandomWalk::new(PositionNoise::PerStep { sigma_m: 0.01 }).unwrap();
        let mut motion = Motion::from(walk.with_jumps(Jumps::new(chance, MIN_M, MAX_M).unwrap()));
        if planar {
            motion = motion.in_plane();
        }
        let mut particles = Particles::new(COUNT, motion.column_count());
        for step in 0..steps {
            let dt_s = 1.0 / f64::from(steps);
            motion.propagate(&mut particles, dt_s, Draws::new(9, 1), step, Level::best());
        }
        particles
    }

    /// Returns the indices of the particles that jumped: the walk never reaches y = 0.9.
    fn jumped(particles: &Particles) -> Vec<usize> {
        let y = &particles.columns()[1];
        (0..COUNT).filter(|&i| y[i] > 0.9).collect()
    }

    #[test]
    fn share_of_jumps_is_as_stated_however_the_time_is_divided() {
        let rate = JumpChance::Rate { rate_hz: 0.3 };
        for (chance, steps, expected) in [
            (JumpChance::PerStep { share: 0.0 }, 1, 0.0),
            (JumpChance::PerStep { share: 0.1 }, 1, 0.1),
            (JumpChance::PerStep { share: 0.1 }, 2, 0.19),
            (rate, 1, 1.0 - (-0.3_f64).exp()),
            (rate, 4, 1.0 - (-0.3_f64).exp()),
        ] {
            let share = jumped(&walked(chance, false, steps)).len() as f64 / COUNT as f64;
            let five_errors = 5.0 * (expected * (1.0 - expected) / COUNT as f64).sqrt();
            assert!(
                (share - expected).abs() <= five_errors,
                "{chance:?}: {share}"
            );
        }
    }

    #[test]
    fn jumps_fill_the_box_evenly_and_keep_the_height_in_a_plane() {
        let chance = JumpChance::PerStep { share: 0.5 };
        let space = walked(chance, false, 1);
        for axis in 0..3 {
            // Eight equal parts of the box per axis.
            let mut parts = [0.0; 8];
            for i in jumped(&space) {
                let offset = f64::from(space.columns()[axis][i]) - MIN_M[axis];
                parts[(8.0 * offset / (MAX_M[axis] - MIN_M[axis])).min(7.0) as usize] += 1.0;
            }
            let total: f64 = parts.iter().sum();
            for part in parts {
                assert!(
                    (part - total / 8.0_f64).abs() < 5.0 * (total / 8.0_f64).sqrt(),
                    "{parts:?}"
                );
            }
        }
        let plane = walked(chance, true, 1);
        assert!(plane.columns()[2].iter().all(|&z| z == 0.0));
        for axis in 0..2 {
            assert_eq!(plane.columns()[axis], space.columns()[axis]);
        }
    }

    #[test]
    fn a_walk_without_jumps_draws_the_same_numbers() {
        let walk = RandomWalk::new(PositionNoise::PerStep { sigma_m: 0.01 }).unwrap();
        let mut plain = Particles::new(COUNT, 3);
        Motion::from(walk).propagate(&mut plain, 1.0, Draws::new(9, 1), 0, Level::best());
        let jumping = walked(JumpChance::PerStep { share: 0.1 }, false, 1);
        let jumped = jumped(&jumping);
        assert!(!jumped.is_empty());
        for i in (0..COUNT).filter(|i| jumped.binary_search(i).is_err()) {
            assert_eq!(plain.position_m(i), jumping.position_m(i));
        }
    }

    #[test]
    fn invalid_settings_are_rejected_by_name() {
        let share = JumpChance::PerStep { share: 0.1 };
        let lower = [MIN_M[0], MIN_M[1], 0.4];
        for (chance, min_m, max_m, name) in [
            (
                JumpChance::PerStep { share: 1.1 },
                MIN_M,
                MAX_M,
                "probability",
            ),
            (
                JumpChance::PerStep { share: f64::NAN },
                MIN_M,
                MAX_M,
                "probability",
            ),
            (JumpChance::Rate { rate_hz: -1.0 }, MIN_M, MAX_M, "rate_hz"),
            (share, [f64::NAN; 3], MAX_M, "min_m"),
            (share, MIN_M, [1e7; 3], "max_m"),
            (share, MIN_M, lower, "max_m"),
        ] {
            let error = Jumps::new(chance, min_m, max_m).unwrap_err().to_string();
            assert!(error.starts_with(name), "{error}");
        }
    }
}
