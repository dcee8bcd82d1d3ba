//! Constant velocity, disturbed by random accelerations.

use rayon::prelude::*;

use super::CHUNK;
use crate::Error;
use crate::particles::Particles;
use crate::rng::{Draws, Stage};
use crate::simd::Level;

/// How the acceleration disturbs the state over a step of Δt.
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
}

/// Constant velocity, columns x, y, z (m), vx, vy, vz (m/s).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ConstantVelocity {
    disturbance: Disturbance,
    /// Whether the target stays at the height of its start and has no vertical velocity.
    planar: bool,
}

impl ConstantVelocity {
    /// Ours: white noise strong enough for a ball that is thrown and bounces.
    pub const DEFAULT: Self = Self {
        disturbance: Disturbance::White {
            acceleration_density_m2ps3: 100.0,
        },
        planar: false,
    };

    /// The number of columns.
    pub const COLUMNS: usize = 6;

    /// Constant velocity under this disturbance.
    pub fn new(disturbance: Disturbance) -> Result<Self, Error> {
        let (name, value) = match disturbance {
            Disturbance::PiecewiseConstant {
                acceleration_sigma_mps2: s,
            } => ("acceleration_sigma_mps2", s),
            Disturbance::White {
                acceleration_density_m2ps3: q,
            } => ("acceleration_density_m2ps3", q),
        };
        if !(0.0..=1e9).contains(&value) {
            return Err(Error::out_of_range(name, value, "0 to 1e9"));
        }
        Ok(Self {
            disturbance,
            planar: false,
        })
    }

    /// The same in a horizontal plane: the state is x, y, vx, vy, the height that of the start (Taiana 2007, section 6.1.2).
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

    /// How accelerations disturb the state.
    pub fn disturbance(&self) -> Disturbance {
        self.disturbance
    }

    /// Noise of position and velocity as combinations of two independent standard normals an axis:
    /// `position += gains[0]·n1`, `velocity += gains[1]·n1 + gains[2]·n2`.
    pub fn noise_gains(&self, dt_s: f64) -> [f64; 3] {
        match self.disturbance {
            Disturbance::PiecewiseConstant {
                acceleration_sigma_mps2: sigma,
            } => [0.5 * sigma * dt_s * dt_s, sigma * dt_s, 0.0],
            Disturbance::White {
                acceleration_density_m2ps3: q,
            } => {
                // Cholesky factor of the covariance.
                let velocity = (q * dt_s).sqrt();
                [
                    velocity * dt_s / 3_f64.sqrt(),
                    velocity * 3_f64.sqrt() / 2.0,
                    velocity / 2.0,
                ]
            }
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
        let gains = self.noise_gains(dt_s).map(|g| g as f32);
        let dt_s = dt_s as f32;
        let axes = if self.planar { 2 } else { 3 };
        let [x, y, z, vx, vy, vz] = particles.columns_mut() else {
            unreachable!("a constant velocity filter has {} columns", Self::COLUMNS)
        };
        let positions = x
            .par_chunks_mut(CHUNK)
            .zip(y.par_chunks_mut(CHUNK))
            .zip(z.par_chunks_mut(CHUNK));
        let velocities = vx
            .par_chunks_mut(CHUNK)
            .zip(vy.par_chunks_mut(CHUNK))
            .zip(vz.par_chunks_mut(CHUNK));
        positions
            .zip(velocities)
            .enumerate()
            .for_each(|(chunk, (((x, y), z), ((vx, vy), vz)))| {
                let mut normals = [[0_f32; CHUNK]; 6];
                let count = x.len();
                let first = (chunk * CHUNK) as u32;
                let rows = normals.each_mut().map(|row| &mut row[..count]);
                draws.fill_normals(level, first, observation, Stage::Motion, rows);
                for (axis, (position, velocity)) in [(x, vx), (y, vy), (z, vz)]
                    .into_iter()
                    .take(axes)
                    .enumerate()
                {
                    let (n1, n2) = (&normals[axis], &normals[axis + 3]);
                    for i in 0..count {
                        position[i] += velocity[i] * dt_s + gains[0] * n1[i];
                        velocity[i] += gains[1] * n1[i] + gains[2] * n2[i];
                    }
                }
            });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn covariance(gains: [f64; 3]) -> [f64; 3] {
        [
            gains[0] * gains[0],
            gains[0] * gains[1],
            gains[1] * gains[1] + gains[2] * gains[2],
        ]
    }

    #[test]
    fn two_half_steps_of_white_noise_have_the_distribution_of_one() {
        let model = ConstantVelocity::new(Disturbance::White {
            acceleration_density_m2ps3: 3.0,
        })
        .unwrap();
        let (dt, half) = (0.08, 0.04);
        let whole = covariance(model.noise_gains(dt));
        let [pp, pv, vv] = covariance(model.noise_gains(half));
        // F Q F' + Q with F = [1, half; 0, 1].
        let twice = [
            pp + 2.0 * half * pv + half * half * vv + pp,
            pv + half * vv + pv,
            2.0 * vv,
        ];
        for (a, b) in whole.iter().zip(twice) {
            assert!((a - b).abs() < 1e-15, "{whole:?} {twice:?}");
        }
        let expected = [3.0 * dt.powi(3) / 3.0, 3.0 * dt * dt / 2.0, 3.0 * dt];
        for (a, b) in whole.iter().zip(expected) {
            assert!((a - b).abs() < 1e-15, "{whole:?} {expected:?}");
        }
    }

    #[test]
    fn particles_move_with_the_stated_mean_and_covariance() {
        let published = Disturbance::PiecewiseConstant {
            acceleration_sigma_mps2: 56.25,
        };
        let white = Disturbance::White {
            acceleration_density_m2ps3: 100.0,
        };
        for disturbance in [published, white] {
            let model = ConstantVelocity::new(disturbance).unwrap();
            let count = 100_000;
            let mut particles = Particles::new(count, ConstantVelocity::COLUMNS);
            for (column, value) in [(0, 1.0), (3, 2.0), (5, -4.0)] {
                particles.columns_mut()[column].fill(value);
            }
            let dt = 0.04;
            model.propagate(&mut particles, dt, Draws::new(3, 0), 1, Level::best());
            let mean = |c: &[f32]| c.iter().map(|&v| f64::from(v)).sum::<f64>() / count as f64;
            let c = particles.columns();
            let [pp, pv, vv] = covariance(model.noise_gains(dt));
            for (axis, (start, velocity)) in [(1.0, 2.0), (0.0, 0.0), (0.0, -4.0)]
                .into_iter()
                .enumerate()
            {
                let (mp, mv) = (mean(&c[axis]), mean(&c[axis + 3]));
                assert!(
                    (mp - start - velocity * dt).abs() < 5.0 * (pp / count as f64).sqrt(),
                    "{mp}"
                );
                assert!(
                    (mv - velocity).abs() < 5.0 * (vv / count as f64).sqrt(),
                    "{mv}"
                );
                let cross = c[axis]
                    .iter()
                    .zip(&c[axis + 3])
                    .map(|(&p, &v)| (f64::from(p) - mp) * (f64::from(v) - mv))
                    .sum::<f64>()
                    / count as f64;
                assert!((cross / pv - 1.0).abs() < 0.03, "{cross} {pv}");
            }
        }
    }

    #[test]
    fn in_a_plane_height_and_its_velocity_never_change() {
        let space = ConstantVelocity::DEFAULT;
        let plane = space.in_plane();
        assert!(plane.is_planar() && !space.is_planar());
        let mut particles = [(); 2].map(|()| Particles::new(2000, ConstantVelocity::COLUMNS));
        for (particles, model) in particles.iter_mut().zip([space, plane]) {
            particles.columns_mut()[2].fill(0.3);
            for observation in 0..3 {
                model.propagate(particles, 0.1, Draws::new(5, 0), observation, Level::best());
            }
        }
        let [space, plane] = &particles;
        assert!(plane.columns()[2].iter().all(|&z| z == 0.3));
        assert!(plane.columns()[5].iter().all(|&vz| vz == 0.0));
        assert!(space.columns()[2].iter().any(|&z| z != 0.3));
        // The other axes move as they do in space.
        for column in [0, 1, 3, 4] {
            assert_eq!(space.columns()[column], plane.columns()[column]);
        }
    }

    #[test]
    fn no_time_no_motion() {
        let model = ConstantVelocity::new(Disturbance::White {
            acceleration_density_m2ps3: 9.0,
        })
        .unwrap();
        let mut particles = Particles::new(10, ConstantVelocity::COLUMNS);
        let before = particles.clone();
        model.propagate(&mut particles, 0.0, Draws::new(1, 1), 0, Level::BASELINE);
        assert_eq!(particles, before);
        assert!(
            ConstantVelocity::new(Disturbance::White {
                acceleration_density_m2ps3: f64::NAN
            })
            .is_err()
        );
    }
}
