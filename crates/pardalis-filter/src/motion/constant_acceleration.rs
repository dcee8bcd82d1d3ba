//! Constant acceleration with process noise. Particles start with zero acceleration.

use super::check_strength;
use pardalis_core::Error;

/// Process noise of the acceleration over a step of Δt.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum AccelerationNoise {
    /// x += vΔt + aΔt²/2, v += aΔt, a += e, e ~ N(0, σ²I) per step regardless of its length, as
    /// published for a fixed frame rate (Campos 2009, eq. 15).
    PerStep {
        /// σ, in m/s².
        acceleration_step_sigma_mps2: f64,
    },
    /// Continuous white jerk noise of density q: covariance q·[Δt⁵/20, Δt⁴/8, Δt³/6; Δt⁴/8, Δt³/3,
    /// Δt²/2; Δt³/6, Δt²/2, Δt] per axis, so that two half steps have the distribution of one whole
    /// step.
    White {
        /// q, in m²/s⁵: the acceleration variance added per second.
        jerk_density_m2ps5: f64,
    },
}

/// Constant acceleration with process noise.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ConstantAcceleration {
    noise: AccelerationNoise,
}

impl ConstantAcceleration {
    /// Creates the model. The strength of the noise must lie between 0 and 1e9.
    pub fn new(noise: AccelerationNoise) -> Result<Self, Error> {
        check_strength(match noise {
            AccelerationNoise::PerStep {
                acceleration_step_sigma_mps2: sigma,
            } => ("acceleration_step_sigma_mps2", sigma),
            AccelerationNoise::White {
                jerk_density_m2ps5: q,
            } => ("jerk_density_m2ps5", q),
        })?;
        Ok(Self { noise })
    }

    /// Returns the lower triangular factor L of the noise covariance L·Lᵀ of position (m), velocity
    /// (m/s) and acceleration (m/s²) on one axis. The noise is L·n with three standard normal
    /// numbers n.
    pub fn noise_factor(&self, dt_s: f64) -> [[f64; 3]; 3] {
        match self.noise {
            AccelerationNoise::PerStep {
                acceleration_step_sigma_mps2: sigma,
            } => [[0.0; 3], [0.0; 3], [0.0, 0.0, sigma]],
            AccelerationNoise::White {
                jerk_density_m2ps5: q,
            } => {
                let acceleration = (q * dt_s).sqrt();
                let velocity = acceleration * dt_s;
                let position = velocity * dt_s;
                let [root_3, root_5] = [3_f64.sqrt(), 5_f64.sqrt()];
                [
                    [position / (2.0 * root_5), 0.0, 0.0],
                    [velocity * root_5 / 4.0, velocity / (4.0 * root_3), 0.0],
                    [
                        acceleration * root_5 / 3.0,
                        acceleration / root_3,
                        acceleration / 3.0,
                    ],
                ]
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn invalid_noise_is_rejected() {
        for noise in [
            AccelerationNoise::White {
                jerk_density_m2ps5: -1.0,
            },
            AccelerationNoise::PerStep {
                acceleration_step_sigma_mps2: f64::NAN,
            },
        ] {
            assert!(ConstantAcceleration::new(noise).is_err());
        }
    }
}
