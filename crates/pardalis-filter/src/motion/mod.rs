//! Motion models: how a state changes over the true time between two images.

mod constant_acceleration;
mod constant_velocity;
mod jumps;
mod linear;
mod random_walk;

pub use constant_acceleration::{ConstantAcceleration, Jerk};
pub use constant_velocity::{ConstantVelocity, Disturbance};
pub use jumps::{JumpChance, Jumps};
pub(crate) use linear::taylor;
pub use random_walk::{RandomWalk, Stray};

use linear::Step;

use crate::particles::Particles;
use pardalis_core::Error;
use pardalis_core::rng::Draws;
use pardalis_core::simd::Level;

/// What a state holds and how it is disturbed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Model {
    RandomWalk(RandomWalk),
    ConstantVelocity(ConstantVelocity),
    ConstantAcceleration(ConstantAcceleration),
}

/// Any motion model, made of one of them (`Motion::from`), in space or in a horizontal plane.
///
/// Columns of its particles: x, y, z (m), then, where it has them, the velocity vx, vy, vz (m/s), then the acceleration ax, ay, az (m/s²).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Motion {
    model: Model,
    /// Whether the target stays at the height of its start.
    planar: bool,
}

impl Motion {
    /// Ours: constant velocity in space.
    pub const DEFAULT: Self = Self::in_space(Model::ConstantVelocity(ConstantVelocity::DEFAULT));

    const fn in_space(model: Model) -> Self {
        Self {
            model,
            planar: false,
        }
    }

    /// The same in a horizontal plane: the height is that of the start (Taiana 2007, section 6.1.2).
    pub const fn in_plane(self) -> Self {
        Self {
            planar: true,
            ..self
        }
    }

    /// What a state holds and how it is disturbed.
    pub(crate) fn model(&self) -> &Model {
        &self.model
    }

    /// Whether the height is fixed: particles then start at one height, without vertical velocity.
    pub fn is_planar(&self) -> bool {
        self.planar
    }

    /// How many axes the target may move along: the first two, or all three.
    pub fn free_axes(&self) -> usize {
        if self.planar { 2 } else { 3 }
    }

    /// How many numbers a state has on each axis: the position, then its derivatives.
    pub fn orders(&self) -> usize {
        match self.model {
            Model::RandomWalk(_) => 1,
            Model::ConstantVelocity(_) => 2,
            Model::ConstantAcceleration(_) => 3,
        }
    }

    /// The number of columns of its particles.
    pub fn column_count(&self) -> usize {
        3 * self.orders()
    }

    /// Moves every particle by `dt_s` seconds, above 0. The noise is a function of the draws' key, the observation's number and the particle's.
    pub fn propagate(
        &self,
        particles: &mut Particles,
        dt_s: f64,
        draws: Draws,
        observation: u32,
        level: Level,
    ) {
        let step = Step {
            dt_s,
            free_axes: self.free_axes(),
            draws,
            observation,
            level,
        };
        match &self.model {
            Model::RandomWalk(model) => {
                linear::propagate::<1, 3>(particles, &step, model.noise_factor(dt_s));
                if let Some(jumps) = model.jumps() {
                    jumps.propagate(particles, &step);
                }
            }
            Model::ConstantVelocity(model) => {
                linear::propagate::<2, 6>(particles, &step, model.noise_factor(dt_s));
            }
            Model::ConstantAcceleration(model) => {
                linear::propagate::<3, 9>(particles, &step, model.noise_factor(dt_s));
            }
        }
    }

    /// The variance, on each axis along which the target may move, that the noise adds to the position over `dt_s` seconds, in m². Jumps
    /// are a way to search and no belief about the target: they do not count.
    pub fn position_variance_m2(&self, dt_s: f64) -> f64 {
        if dt_s <= 0.0 {
            return 0.0;
        }
        let sigma_m = match &self.model {
            Model::RandomWalk(model) => model.noise_factor(dt_s)[0][0],
            Model::ConstantVelocity(model) => model.noise_factor(dt_s)[0][0],
            Model::ConstantAcceleration(model) => model.noise_factor(dt_s)[0][0],
        };
        sigma_m.powi(2)
    }
}

impl From<RandomWalk> for Motion {
    fn from(model: RandomWalk) -> Self {
        Self::in_space(Model::RandomWalk(model))
    }
}

impl From<ConstantVelocity> for Motion {
    fn from(model: ConstantVelocity) -> Self {
        Self::in_space(Model::ConstantVelocity(model))
    }
}

impl From<ConstantAcceleration> for Motion {
    fn from(model: ConstantAcceleration) -> Self {
        Self::in_space(Model::ConstantAcceleration(model))
    }
}

/// Refuses a strength of noise, or a rate, that is negative, beyond 1e9 or no number.
fn check_strength((name, value): (&str, f64)) -> Result<(), Error> {
    if (0.0..=1e9).contains(&value) {
        Ok(())
    } else {
        Err(Error::out_of_range(name, value, "0 to 1e9"))
    }
}
