//! Constant velocity with process noise.

use super::check_strength;
use pardalis_core::Error;

/// Process noise of the velocity over a step of Δt.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum VelocityNoise {
    /// Acceleration that is constant during a step: x += vΔt + aΔt²/2, v += aΔt, a ~ N(0, σ²I), as
    /// published for a fixed frame rate (Taiana 2007, eqs. 5.7 and 5.8).
    PiecewiseConstant {
        /// σ, in m/s².
        acceleration_sigma_mps2: f64,
    },
    /// Continuous white acceleration noise of density q: covariance q·[Δt³/3, Δt²/2; Δt²/2, Δt] per
    /// axis, so that two half steps have the distribution of one whole step.
    White {
        /// q, in m²/s³: the velocity variance added per second.
        acceleration_density_m2ps3: f64,
    },
    /// x += vΔt, v += e, e ~ N(0, σ²I) per step regardless of its length, as published for a fixed
    /// frame rate (Campos 2009, eq. 14).
    PerStep {
        /// σ, in m/s.
        velocity_sigma_mps: f64,
    },
}

/// Constant velocity with process noise.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ConstantVelocity {
    noise: VelocityNoise,
}

impl ConstantVelocity {
    /// The default: white noise strong enough for a ball that is thrown and bounces.
    pub const DEFAULT: Self = Self {
        noise: VelocityNoise::White {
            acceleration_density_m2ps3: 100.0,
        },
    };

    /// For filters that model velocity jumps (kicks and bounces) separately: the noise covers
    /// gravity and friction only.
    pub const BETWEEN_VELOCITY_JUMPS: Self = Self {
        noise: VelocityNoise::White {
            acceleration_density_m2ps3: 20.0,
        },
    };

    /// People and vehicles, whose velocity changes by about 1 m/s in a second.
    pub const WALKING: Self = Self {
        noise: VelocityNoise::White {
            acceleration_density_m2ps3: 1.0,
        },
    };

    /// Creates the model. The strength of the noise must lie between 0 and 1e9.
    pub fn new(noise: VelocityNoise) -> Result<Self, Error> {
        check_strength(match noise {
            VelocityNoise::PiecewiseConstant {
                acceleration_sigma_mps2: sigma,
            } => ("acceleration_sigma_mps2", sigma),
            VelocityNoise::White {
                acceleration_density_m2ps3: q,
            } => ("acceleration_density_m2ps3", q),
            VelocityNoise::PerStep {
                velocity_sigma_mps: sigma,
            } => ("velocity_sigma_mps", sigma),
        })?;
        Ok(Self { noise })
    }

    /// Returns the process noise.
    pub fn process_noise(&self) -> VelocityNoise {
        self.noise
    }

    /// Returns the lower triangular factor L of the noise covariance L·Lᵀ of position (m) and
    /// velocity (m/s) on one axis. The noise is L·n with two standard normal numbers n.
    pub fn noise_factor(&self, dt_s: f64) -> [[f64; 2]; 2] {
        match self.noise {
            VelocityNoise::PiecewiseConstant {
                acceleration_sigma_mps2: sigma,
            } => [[0.5 * sigma * dt_s * dt_s, 0.0], [sigma * dt_s, 0.0]],
            VelocityNoise::White {
                acceleration_density_m2ps3: q,
            } => {
                let velocity = (q * dt_s).sqrt();
                let root = 3_f64.sqrt();
                [
                    [velocity * dt_s / root, 0.0],
                    [velocity * root / 2.0, velocity / 2.0],
                ]
            }
            VelocityNoise::PerStep {
                velocity_sigma_mps: sigma,
            } => [[0.0, 0.0], [0.0, sigma]],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn invalid_noise_is_rejected() {
        for noise in [
            VelocityNoise::White {
                acceleration_density_m2ps3: f64::NAN,
            },
            VelocityNoise::PiecewiseConstant {
                acceleration_sigma_mps2: -1.0,
            },
            VelocityNoise::PerStep {
                velocity_sigma_mps: f64::INFINITY,
            },
        ] {
            assert!(ConstantVelocity::new(noise).is_err());
        }
    }
}
