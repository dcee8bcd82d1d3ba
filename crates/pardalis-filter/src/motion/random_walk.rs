//! A random walk: the target may go anywhere, with no memory of where it went.

use super::{Jumps, check_strength};
use pardalis_core::Error;

/// How far a target strays over a step of Δt.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Stray {
    /// As published, for one fixed frame rate: N(0, σ²) on each axis and step, however long (Barrera 2005, eqs. 1 to 3).
    PerStep {
        /// σ, in m.
        sigma_m: f64,
    },
    /// Diffusion: variance q·Δt on each axis, so that two half steps have the distribution of one.
    Diffusion {
        /// q, in m²/s: the variance that one second adds.
        density_m2ps: f64,
    },
}

/// A random walk, in which some particles may jump instead.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RandomWalk {
    stray: Stray,
    jumps: Option<Jumps>,
}

impl RandomWalk {
    /// As published: σ = 0.03 m a step (Barrera 2005, section III).
    pub const PUBLISHED: Self = Self {
        stray: Stray::PerStep { sigma_m: 0.03 },
        jumps: None,
    };

    /// A target that strays so; the strength may be 0 to 1e9.
    pub fn new(stray: Stray) -> Result<Self, Error> {
        check_strength(match stray {
            Stray::PerStep { sigma_m } => ("sigma_m", sigma_m),
            Stray::Diffusion { density_m2ps } => ("density_m2ps", density_m2ps),
        })?;
        Ok(Self { stray, jumps: None })
    }

    /// The same with jumps.
    pub fn with_jumps(self, jumps: Jumps) -> Self {
        Self {
            jumps: Some(jumps),
            ..self
        }
    }

    /// How far it strays.
    pub fn stray(&self) -> Stray {
        self.stray
    }

    /// The jumps, where it has them.
    pub fn jumps(&self) -> Option<&Jumps> {
        self.jumps.as_ref()
    }

    /// The standard deviation on each axis after `dt_s` seconds, above 0, in metres, as a factor of a single standard normal.
    pub fn noise_factor(&self, dt_s: f64) -> [[f64; 1]; 1] {
        match self.stray {
            Stray::PerStep { sigma_m } => [[sigma_m]],
            Stray::Diffusion { density_m2ps } => [[(density_m2ps * dt_s).sqrt()]],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faulty_settings_are_refused() {
        for stray in [
            Stray::PerStep { sigma_m: -0.1 },
            Stray::Diffusion {
                density_m2ps: f64::NAN,
            },
        ] {
            assert!(RandomWalk::new(stray).is_err(), "{stray:?}");
        }
    }
}
