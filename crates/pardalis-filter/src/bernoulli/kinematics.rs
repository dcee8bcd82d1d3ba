//! Motion of a particle with a known position and a Gaussian velocity, on one axis.

use crate::motion::{Model, Motion, PositionNoise, VelocityNoise};
use pardalis_core::Error;

/// Variance that every step adds to a position, m²: 10 µm squared. Hand-set: keeps densities finite if no time has passed or
/// there is no process noise.
const STEP_VARIANCE_M2: f64 = 1e-10;

/// White noise on each axis. Two consecutive steps therefore equal one of the same total time.
#[derive(Debug, Clone, Copy)]
pub(super) enum Kinematics {
    /// No velocity: the position's variance grows by this much per second.
    Walk { diffusion_m2ps: f64 },
    /// Constant velocity: its variance grows by this much per second.
    Velocity { acceleration_density_m2ps3: f64 },
}

/// A particle's position after a step on one axis, and its velocity given that position.
pub(super) struct Step {
    /// Variance of the position around position + velocity·time, m².
    pub(super) variance_m2: f64,
    /// The regression of the velocity on the position, 1/s: their covariance over the variance of the position.
    pub(super) gain_hz: f64,
    /// Variance of the velocity given the new position, m²/s².
    pub(super) velocity_variance_m2ps2: f64,
}

impl Kinematics {
    /// Returns an error for motion that is not white noise on a random walk or on constant velocity.
    pub(super) fn of(motion: &Motion) -> Result<Self, Error> {
        match motion.model() {
            Model::RandomWalk(walk) => {
                if let (PositionNoise::Diffusion { density_m2ps }, None) =
                    (walk.process_noise(), walk.jumps())
                {
                    return Ok(Self::Walk {
                        diffusion_m2ps: density_m2ps,
                    });
                }
            }
            Model::ConstantVelocity(velocity) => {
                if let VelocityNoise::White {
                    acceleration_density_m2ps3,
                } = velocity.process_noise()
                {
                    return Ok(Self::Velocity {
                        acceleration_density_m2ps3,
                    });
                }
            }
            Model::ConstantAcceleration(_) => {}
        }
        Err(Error::refused(
            "this motion model has no velocity that can be marginalised for every time step",
            "use constant velocity with white acceleration, or a random walk with diffusion and without jumps (the filter has its own rate of jumps)",
        ))
    }

    pub(super) fn has_velocity(self) -> bool {
        matches!(self, Self::Velocity { .. })
    }

    /// Returns the variance that grows per second.
    pub(super) fn noise(self) -> f64 {
        match self {
            Self::Walk { diffusion_m2ps } => diffusion_m2ps,
            Self::Velocity {
                acceleration_density_m2ps3,
            } => acceleration_density_m2ps3,
        }
    }

    /// Returns the same kinematics with another noise.
    pub(super) fn with_noise(self, noise: f64) -> Self {
        match self {
            Self::Walk { .. } => Self::Walk {
                diffusion_m2ps: noise,
            },
            Self::Velocity { .. } => Self::Velocity {
                acceleration_density_m2ps3: noise,
            },
        }
    }

    /// Returns the kinematics of a step of `dt_s` seconds with a velocity jump of this standard deviation at a random
    /// time; `None` without a velocity or if no time passes.
    pub(super) fn jumped(self, velocity_jump_sigma_mps: f64, dt_s: f64) -> Option<Self> {
        match self {
            Self::Velocity {
                acceleration_density_m2ps3,
            } if dt_s > 0.0 => Some(Self::Velocity {
                acceleration_density_m2ps3: acceleration_density_m2ps3
                    + velocity_jump_sigma_mps * velocity_jump_sigma_mps / dt_s,
            }),
            _ => None,
        }
    }

    /// Returns the variance of the position, m², `dt_s` seconds after it was known, for a velocity of this variance.
    /// Steps back in time add no noise.
    pub(super) fn variance_m2(self, velocity_variance_m2ps2: f64, dt_s: f64) -> f64 {
        let forward_s = dt_s.max(0.0);
        match self {
            Self::Walk { diffusion_m2ps } => diffusion_m2ps * forward_s,
            Self::Velocity {
                acceleration_density_m2ps3: q,
            } => velocity_variance_m2ps2 * dt_s * dt_s + q * forward_s.powi(3) / 3.0,
        }
    }

    /// Returns the variance of the velocity, m²/s², `dt_s` seconds after it had this variance. Steps back in time add no noise.
    pub(super) fn velocity_variance_m2ps2(self, velocity_variance_m2ps2: f64, dt_s: f64) -> f64 {
        match self {
            Self::Walk { .. } => 0.0,
            Self::Velocity {
                acceleration_density_m2ps3: q,
            } => velocity_variance_m2ps2 + q * dt_s.max(0.0),
        }
    }

    /// Returns a step of `dt_s` seconds, at least 0.
    pub(super) fn step(self, velocity_variance_m2ps2: f64, dt_s: f64) -> Step {
        let variance_m2 = self.variance_m2(velocity_variance_m2ps2, dt_s) + STEP_VARIANCE_M2;
        match self {
            Self::Walk { .. } => Step {
                variance_m2,
                gain_hz: 0.0,
                velocity_variance_m2ps2: 0.0,
            },
            Self::Velocity {
                acceleration_density_m2ps3: q,
            } => {
                let (s, t) = (velocity_variance_m2ps2, dt_s);
                // The determinant of the covariance of position and velocity, multiplied out to avoid cancellation.
                let determinant =
                    q * t.powi(3) * (s / 3.0 + q * t / 12.0) + STEP_VARIANCE_M2 * (s + q * t);
                Step {
                    variance_m2,
                    gain_hz: (s * t + q * t * t / 2.0) / variance_m2,
                    velocity_variance_m2ps2: determinant / variance_m2,
                }
            }
        }
    }
}
