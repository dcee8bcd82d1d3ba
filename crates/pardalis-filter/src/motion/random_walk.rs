//! Random walk: a motion model without velocity.

use super::{Jumps, check_strength};
use pardalis_core::Error;

/// Process noise of the position over a step of Δt.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum PositionNoise {
    /// N(0, σ²) per axis and step regardless of the step's length, as published for a fixed frame
    /// rate (Barrera 2005, eqs. 1 to 3).
    PerStep {
        /// σ, in m.
        sigma_m: f64,
    },
    /// Diffusion: variance q·Δt per axis, so that two half steps have the distribution of one whole
    /// step.
    Diffusion {
        /// q, in m²/s: the variance added per second.
        density_m2ps: f64,
    },
}

/// A random walk with optional jumps.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RandomWalk {
    noise: PositionNoise,
    jumps: Option<Jumps>,
}

impl RandomWalk {
    /// The published model: σ = 0.03 m per step (Barrera 2005, section III).
    pub const PUBLISHED: Self = Self {
        noise: PositionNoise::PerStep { sigma_m: 0.03 },
        jumps: None,
    };

    /// Creates a random walk. The strength of the noise must lie between 0 and 1e9.
    pub fn new(noise: PositionNoise) -> Result<Self, Error> {
        check_strength(match noise {
            PositionNoise::PerStep { sigma_m } => ("sigma_m", sigma_m),
            PositionNoise::Diffusion { density_m2ps } => ("density_m2ps", density_m2ps),
        })?;
        Ok(Self { noise, jumps: None })
    }

    /// Adds jumps to the random walk.
    pub fn with_jumps(self, jumps: Jumps) -> Self {
        Self {
            jumps: Some(jumps),
            ..self
        }
    }

    /// Returns the process noise.
    pub fn process_noise(&self) -> PositionNoise {
        self.noise
    }

    /// Returns the jumps, or `None` if the model has none.
    pub fn jumps(&self) -> Option<&Jumps> {
        self.jumps.as_ref()
    }

    /// Returns the standard deviation per axis over `dt_s` > 0 seconds, in metres, as a 1×1 factor
    /// of a standard normal number.
    pub fn noise_factor(&self, dt_s: f64) -> [[f64; 1]; 1] {
        match self.noise {
            PositionNoise::PerStep { sigma_m } => [[sigma_m]],
            PositionNoise::Diffusion { density_m2ps } => [[(density_m2ps * dt_s).sqrt()]],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn invalid_noise_is_rejected() {
        for noise in [
            PositionNoise::PerStep { sigma_m: -0.1 },
            PositionNoise::Diffusion {
                density_m2ps: f64::NAN,
            },
        ] {
            assert!(RandomWalk::new(noise).is_err(), "{noise:?}");
        }
    }
}
