//! Motion models: how a state changes over the time between two observations.

mod constant_acceleration;
mod constant_velocity;
mod jumps;
mod linear;
mod random_walk;

pub use constant_acceleration::{AccelerationNoise, ConstantAcceleration};
pub use constant_velocity::{ConstantVelocity, VelocityNoise};
pub use jumps::{JumpChance, Jumps};
pub(crate) use linear::taylor;
pub use random_walk::{PositionNoise, RandomWalk};

use linear::Step;

use crate::particles::Particles;
use pardalis_core::Error;
use pardalis_core::rng::Draws;
use pardalis_core::simd::Level;

/// State vector and process noise.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Model {
    RandomWalk(RandomWalk),
    ConstantVelocity(ConstantVelocity),
    ConstantAcceleration(ConstantAcceleration),
}

/// A motion model in space or in a horizontal plane. Construct it with `Motion::from`.
///
/// The columns of its particles are the position x, y, z (m), then the velocity vx, vy, vz (m/s)
/// and the acceleration ax, ay, az (m/s²) if the model has them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Motion {
    model: Model,
    /// Whether the target stays at its initial height.
    planar: bool,
}

impl Motion {
    /// The default: constant velocity in space.
    pub const DEFAULT: Self = Self::in_space(Model::ConstantVelocity(ConstantVelocity::DEFAULT));

    const fn in_space(model: Model) -> Self {
        Self {
            model,
            planar: false,
        }
    }

    /// Restricts the motion to a horizontal plane at the initial height (Taiana 2007, section
    /// 6.1.2).
    pub const fn in_plane(self) -> Self {
        Self {
            planar: true,
            ..self
        }
    }

    /// Returns the state vector and process noise.
    pub(crate) fn model(&self) -> &Model {
        &self.model
    }

    /// Reports whether the height is fixed. Particles then start at one height, without vertical
    /// velocity.
    pub fn is_planar(&self) -> bool {
        self.planar
    }

    /// Returns the number of axes along which the target can move: 2 (x and y) or 3.
    pub fn free_axes(&self) -> usize {
        if self.planar { 2 } else { 3 }
    }

    /// Returns the number of state components per axis: the position and its derivatives.
    pub fn orders(&self) -> usize {
        match self.model {
            Model::RandomWalk(_) => 1,
            Model::ConstantVelocity(_) => 2,
            Model::ConstantAcceleration(_) => 3,
        }
    }

    /// Returns the number of columns of its particles.
    pub fn column_count(&self) -> usize {
        3 * self.orders()
    }

    /// Moves every particle by `dt_s` > 0 seconds. The noise is a function of the key of `draws`,
    /// the observation's index and the particle's index.
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

    /// Returns the variance in m² that the process noise adds to the position over `dt_s` seconds,
    /// on each axis along which the target can move. Jumps do not count: they only serve the search
    /// and do not describe the target's motion.
    pub fn position_variance_m2(&self, dt_s: f64) -> f64 {
        self.noise_variances(dt_s)[0]
    }

    /// Returns the same of the velocity, in m²/s²; 0 if the model has none.
    pub fn velocity_variance_m2ps2(&self, dt_s: f64) -> f64 {
        self.noise_variances(dt_s)[1]
    }

    /// Returns the variances that the process noise adds to position and velocity.
    fn noise_variances(&self, dt_s: f64) -> [f64; 2] {
        if dt_s <= 0.0 {
            return [0.0; 2];
        }
        let squares = |row: &[f64]| row.iter().map(|factor| factor * factor).sum();
        match &self.model {
            Model::RandomWalk(model) => [squares(&model.noise_factor(dt_s)[0]), 0.0],
            Model::ConstantVelocity(model) => model.noise_factor(dt_s).map(|row| squares(&row)),
            Model::ConstantAcceleration(model) => {
                let [position, velocity, _] = model.noise_factor(dt_s);
                [squares(&position), squares(&velocity)]
            }
        }
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

/// Rejects noise strengths and rates outside 0 to 1e9, including NaN.
fn check_strength((name, value): (&str, f64)) -> Result<(), Error> {
    if (0.0..=1e9).contains(&value) {
        Ok(())
    } else {
        Err(Error::out_of_range(name, value, "0 to 1e9"))
    }
}
