//! Motion models: how a state changes over the true time between two images.

mod constant_velocity;
mod random_walk;

pub use constant_velocity::{ConstantVelocity, Disturbance};
pub use random_walk::{RandomWalk, Stray};

use crate::particles::Particles;
use crate::rng::Draws;
use crate::simd::Level;

/// Particles a piece of work for one thread.
const CHUNK: usize = 1024;

/// Any motion model.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Motion {
    /// Constant velocity under random accelerations.
    ConstantVelocity(ConstantVelocity),
    /// A random walk.
    RandomWalk(RandomWalk),
}

impl Motion {
    /// The number of columns of its particles; the first three are the position.
    pub fn column_count(&self) -> usize {
        match self {
            Self::ConstantVelocity(_) => ConstantVelocity::COLUMNS,
            Self::RandomWalk(_) => RandomWalk::COLUMNS,
        }
    }

    /// The columns that hold the velocity.
    pub fn velocity_columns(&self) -> Option<[usize; 3]> {
        match self {
            Self::ConstantVelocity(_) => Some([3, 4, 5]),
            Self::RandomWalk(_) => None,
        }
    }

    /// Whether the height is fixed: particles then start at one height, without vertical velocity.
    pub fn is_planar(&self) -> bool {
        match self {
            Self::ConstantVelocity(model) => model.is_planar(),
            Self::RandomWalk(model) => model.is_planar(),
        }
    }

    /// Moves every particle by `dt_s` seconds. The noise is a function of the draws' key, the observation's number and the particle's.
    pub fn propagate(
        &self,
        particles: &mut Particles,
        dt_s: f64,
        draws: Draws,
        observation: u32,
        level: Level,
    ) {
        match self {
            Self::ConstantVelocity(model) => {
                model.propagate(particles, dt_s, draws, observation, level);
            }
            Self::RandomWalk(model) => {
                model.propagate(particles, dt_s, draws, observation, level);
            }
        }
    }

    /// The variance, on each axis along which the target may move, that the noise adds to the position over `dt_s` seconds, in m².
    pub fn position_variance_m2(&self, dt_s: f64) -> f64 {
        match self {
            _ if dt_s <= 0.0 => 0.0,
            Self::ConstantVelocity(model) => model.noise_gains(dt_s)[0].powi(2),
            Self::RandomWalk(model) => model.sigma_m(dt_s).powi(2),
        }
    }
}
