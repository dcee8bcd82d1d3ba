//! Constant acceleration, disturbed at random. Particles start without acceleration.

use super::check_strength;
use pardalis_core::Error;

/// How the acceleration changes over a step of Δt.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Jerk {
    /// As published, for one fixed frame rate: x += vΔt + aΔt²/2, v += aΔt, a += e, e ~ N(0, σ²I) per step, however long (Campos 2009, eq. 15).
    PerStep {
        /// σ, in m/s².
        acceleration_step_sigma_mps2: f64,
    },
    /// Continuous white noise of density q in m²/s⁵: covariance q·[Δt⁵/20, Δt⁴/8, Δt³/6; Δt⁴/8, Δt³/3, Δt²/2; Δt³/6, Δt²/2, Δt] an axis, so
    /// that two half steps have the distribution of one.
    White {
        /// q, in m²/s⁵: in one second the acceleration's variance grows by q.
        jerk_density_m2ps5: f64,
    },
}

/// Constant acceleration.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ConstantAcceleration {
    jerk: Jerk,
}

impl ConstantAcceleration {
    /// Constant acceleration under this jerk, whose strength may be 0 to 1e9.
    pub fn new(jerk: Jerk) -> Result<Self, Error> {
        check_strength(match jerk {
            Jerk::PerStep {
                acceleration_step_sigma_mps2: sigma,
            } => ("acceleration_step_sigma_mps2", sigma),
            Jerk::White {
                jerk_density_m2ps5: q,
            } => ("jerk_density_m2ps5", q),
        })?;
        Ok(Self { jerk })
    }

    /// The noise of position (m), velocity (m/s) and acceleration (m/s²) on an axis, as L·n of three standard normals n: the lower
    /// triangular factor L of the covariance L·Lᵀ.
    pub fn noise_factor(&self, dt_s: f64) -> [[f64; 3]; 3] {
        match self.jerk {
            Jerk::PerStep {
                acceleration_step_sigma_mps2: sigma,
            } => [[0.0; 3], [0.0; 3], [0.0, 0.0, sigma]],
            Jerk::White {
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
    fn faulty_settings_are_refused() {
        for jerk in [
            Jerk::White {
                jerk_density_m2ps5: -1.0,
            },
            Jerk::PerStep {
                acceleration_step_sigma_mps2: f64::NAN,
            },
        ] {
            assert!(ConstantAcceleration::new(jerk).is_err());
        }
    }
}
