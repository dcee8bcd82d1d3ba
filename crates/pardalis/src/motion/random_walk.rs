//! A random walk: the target may go anywhere, with no memory of where it went.

use rayon::prelude::*;

use super::CHUNK;
use crate::Error;
use crate::particles::Particles;
use crate::rng::{Draws, Stage};
use crate::simd::Level;

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

/// A random walk, columns x, y, z (m).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RandomWalk {
    stray: Stray,
    /// Whether the target stays at the height of its start.
    planar: bool,
}

impl RandomWalk {
    /// As published: σ = 0.03 m a step (Barrera 2005, section III).
    pub const PUBLISHED: Self = Self {
        stray: Stray::PerStep { sigma_m: 0.03 },
        planar: false,
    };

    /// The number of columns.
    pub const COLUMNS: usize = 3;

    /// A target that strays so.
    pub fn new(stray: Stray) -> Result<Self, Error> {
        let (name, value) = match stray {
            Stray::PerStep { sigma_m } => ("sigma_m", sigma_m),
            Stray::Diffusion { density_m2ps } => ("density_m2ps", density_m2ps),
        };
        if !(0.0..=1e9).contains(&value) {
            return Err(Error::out_of_range(name, value, "0 to 1e9"));
        }
        Ok(Self {
            stray,
            planar: false,
        })
    }

    /// The same in a horizontal plane, at the height of the start.
    pub fn in_plane(self) -> Self {
        Self {
            planar: true,
            ..self
        }
    }

    /// Whether the height is fixed.
    pub fn is_planar(&self) -> bool {
        self.planar
    }

    /// Standard deviation on each axis after `dt_s` seconds, above 0, in metres.
    pub fn sigma_m(&self, dt_s: f64) -> f64 {
        match self.stray {
            Stray::PerStep { sigma_m } => sigma_m,
            Stray::Diffusion { density_m2ps } => (density_m2ps * dt_s).sqrt(),
        }
    }

    /// Moves every particle by `dt_s`.
    pub fn propagate(
        &self,
        particles: &mut Particles,
        dt_s: f64,
        draws: Draws,
        observation: u32,
        level: Level,
    ) {
        let sigma_m = self.sigma_m(dt_s) as f32;
        let axes = if self.planar { 2 } else { 3 };
        let [x, y, z] = particles.columns_mut() else {
            unreachable!("a random walk has {} columns", Self::COLUMNS)
        };
        x.par_chunks_mut(CHUNK)
            .zip(y.par_chunks_mut(CHUNK))
            .zip(z.par_chunks_mut(CHUNK))
            .enumerate()
            .for_each(|(chunk, ((x, y), z))| {
                let mut normals = [[0_f32; CHUNK]; 3];
                let count = x.len();
                let first = (chunk * CHUNK) as u32;
                let rows = normals.each_mut().map(|row| &mut row[..count]);
                draws.fill_normals(level, first, observation, Stage::Motion, rows);
                for (position, normal) in [x, y, z].into_iter().zip(&normals).take(axes) {
                    for (position, normal) in position.iter_mut().zip(normal) {
                        *position += sigma_m * normal;
                    }
                }
            });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn particles_stray_with_the_stated_variance_whatever_way_the_time_is_divided() {
        let published = (RandomWalk::PUBLISHED, 0.03_f64.powi(2));
        let diffusion = Stray::Diffusion { density_m2ps: 0.5 };
        let ours = (RandomWalk::new(diffusion).unwrap(), 0.5 * 0.04);
        for ((model, variance_m2), steps) in [(published, 1), (ours, 1), (ours, 4)] {
            let count = 100_000;
            let mut particles = Particles::new(count, RandomWalk::COLUMNS);
            for step in 0..steps {
                let dt_s = 0.04 / f64::from(steps);
                model.propagate(&mut particles, dt_s, Draws::new(3, 0), step, Level::best());
            }
            for column in particles.columns() {
                let moment = |k: i32| {
                    let powers = column.iter().map(|&v| f64::from(v).powi(k));
                    powers.sum::<f64>() / count as f64
                };
                let five_errors_m = 5.0 * (variance_m2 / count as f64).sqrt();
                assert!(moment(1).abs() < five_errors_m, "{}", moment(1));
                let ratio = moment(2) / variance_m2;
                assert!((ratio - 1.0).abs() < 0.025, "{model:?}: {ratio}");
            }
        }
    }

    #[test]
    fn in_a_plane_the_height_never_changes() {
        let mut particles = Particles::new(500, RandomWalk::COLUMNS);
        particles.columns_mut()[2].fill(0.3);
        let plane = RandomWalk::PUBLISHED.in_plane();
        plane.propagate(&mut particles, 0.1, Draws::new(5, 0), 0, Level::best());
        assert!(particles.columns()[2].iter().all(|&z| z == 0.3));
        assert!(particles.columns()[0].iter().any(|&x| x != 0.0));
    }

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
