//! Constant velocity, disturbed at random.

use super::check_strength;
use pardalis_core::Error;

/// How the velocity changes over a step of Δt.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Disturbance {
    /// As published, for one fixed frame rate: x += vΔt + aΔt²/2, v += aΔt, a ~ N(0, σ²I) with σ in m/s² (Taiana 2007, eqs. 5.7 and 5.8).
    PiecewiseConstant {
        /// σ, in m/s².
        acceleration_sigma_mps2: f64,
    },
    /// Continuous white noise of density q in m²/s³: covariance q·[Δt³/3, Δt²/2; Δt²/2, Δt] an axis, so that two half steps have the distribution of one.
    White {
        /// q, in m²/s³: in one second the velocity's variance grows by q.
        acceleration_density_m2ps3: f64,
    },
    /// As published, for one fixed frame rate: x += vΔt, v += e, e ~ N(0, σ²I) per step, however long (Campos 2009, eq. 14).
    PerStep {
        /// σ, in m/s.
        velocity_sigma_mps: f64,
    },
}

/// Constant velocity.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ConstantVelocity {
    disturbance: Disturbance,
}

impl ConstantVelocity {
    /// Ours: white noise strong enough for a ball that is thrown and bounces.
    pub const DEFAULT: Self = Self {
        disturbance: Disturbance::White {
            acceleration_density_m2ps3: 100.0,
        },
    };

    /// Of a filter that knows of kicks and bounces by themselves: gravity and friction are left.
    pub const BETWEEN_KICKS: Self = Self {
        disturbance: Disturbance::White {
            acceleration_density_m2ps3: 20.0,
        },
    };

    /// Constant velocity under this disturbance, whose strength may be 0 to 1e9.
    pub fn new(disturbance: Disturbance) -> Result<Self, Error> {
        check_strength(match disturbance {
            Disturbance::PiecewiseConstant {
                acceleration_sigma_mps2: sigma,
            } => ("acceleration_sigma_mps2", sigma),
            Disturbance::White {
                acceleration_density_m2ps3: q,
            } => ("acceleration_density_m2ps3", q),
            Disturbance::PerStep {
                velocity_sigma_mps: sigma,
            } => ("velocity_sigma_mps", sigma),
        })?;
        Ok(Self { disturbance })
    }

    /// How the velocity changes.
    pub fn disturbance(&self) -> Disturbance {
        self.disturbance
    }

    /// The noise of position (m) and velocity (m/s) on an axis, as L·n of two standard normals n: the lower triangular factor L of the
    /// covariance L·Lᵀ.
    pub fn noise_factor(&self, dt_s: f64) -> [[f64; 2]; 2] {
        match self.disturbance {
            Disturbance::PiecewiseConstant {
                acceleration_sigma_mps2: sigma,
            } => [[0.5 * sigma * dt_s * dt_s, 0.0], [sigma * dt_s, 0.0]],
            Disturbance::White {
                acceleration_density_m2ps3: q,
            } => {
                let velocity = (q * dt_s).sqrt();
                let root = 3_f64.sqrt();
                [
                    [velocity * dt_s / root, 0.0],
                    [velocity * root / 2.0, velocity / 2.0],
                ]
            }
            Disturbance::PerStep {
                velocity_sigma_mps: sigma,
            } => [[0.0, 0.0], [0.0, sigma]],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faulty_settings_are_refused() {
        for disturbance in [
            Disturbance::White {
                acceleration_density_m2ps3: f64::NAN,
            },
            Disturbance::PiecewiseConstant {
                acceleration_sigma_mps2: -1.0,
            },
            Disturbance::PerStep {
                velocity_sigma_mps: f64::INFINITY,
            },
        ] {
            assert!(ConstantVelocity::new(disturbance).is_err());
        }
    }
}
