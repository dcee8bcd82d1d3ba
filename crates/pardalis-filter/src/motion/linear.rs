//! Prediction step of the linear motion models with Gaussian noise.

use crate::particles::Particles;
use pardalis_core::rng::{Draws, Stage};
use pardalis_core::simd::Level;

/// Number of particles per unit of parallel work.
const CHUNK: usize = 1024;

/// Parameters of one prediction step.
pub(super) struct Step {
    /// Duration in seconds, above 0.
    pub(super) dt_s: f64,
    /// Number of axes along which particles move.
    pub(super) free_axes: usize,
    /// Source of the noise.
    pub(super) draws: Draws,
    /// Index of the observation.
    pub(super) observation: u32,
    /// Instruction set of the kernels.
    pub(super) level: Level,
}

/// Returns the contributions of position, velocity and acceleration to the position after `dt_s`
/// seconds: 1, Δt and Δt²/2.
pub(crate) fn taylor(dt_s: f64) -> [f64; 3] {
    [1.0, dt_s, dt_s * dt_s / 2.0]
}

/// Moves every particle: on each axis the state s of `ORDERS` numbers becomes F·s + L·n, where F is
/// the transition matrix of [`taylor`], L the lower triangular `noise_factor` and n standard
/// normal. `COLUMNS` is 3·`ORDERS`, the number of columns of the particles.
pub(super) fn propagate<const ORDERS: usize, const COLUMNS: usize>(
    particles: &mut Particles,
    step: &Step,
    noise_factor: [[f64; ORDERS]; ORDERS],
) {
    let noise_factor = noise_factor.map(|row| row.map(|factor| factor as f32));
    let taylor = taylor(step.dt_s).map(|factor| factor as f32);
    in_chunks::<COLUMNS>(particles, &|first, mut columns| {
        let count = columns[0].len();
        let mut normals = [[0_f32; CHUNK]; COLUMNS];
        let rows = normals.each_mut().map(|row| &mut row[..count]);
        let (draws, observation) = (step.draws, step.observation);
        draws.fill_normals(step.level, first, observation, Stage::Motion, rows);
        for axis in 0..step.free_axes {
            let state: [&mut [f32]; ORDERS] = std::array::from_fn(|order| {
                &mut std::mem::take(&mut columns[3 * order + axis])[..count]
            });
            let normals: [&[f32]; ORDERS] =
                std::array::from_fn(|order| &normals[3 * order + axis][..count]);
            for i in 0..count {
                for order in 0..ORDERS {
                    let mut change = 0.0;
                    for later in order + 1..ORDERS {
                        change += state[later][i] * taylor[later - order];
                    }
                    for (factor, normals) in noise_factor[order].iter().zip(normals).take(order + 1)
                    {
                        change += factor * normals[i];
                    }
                    state[order][i] += change;
                }
            }
        }
    });
}

/// Calls `work` for chunks of at most [`CHUNK`] particles, with the index of the chunk's first
/// particle and its columns. Chunks run in parallel.
pub(super) fn in_chunks<const COLUMNS: usize>(
    particles: &mut Particles,
    work: &(impl Fn(u32, [&mut [f32]; COLUMNS]) + Sync),
) {
    let Ok(columns) = <&mut [Vec<f32>; COLUMNS]>::try_from(particles.columns_mut()) else {
        unreachable!("the filter allocates the number of columns that the model requires")
    };
    divide(0, columns.each_mut().map(Vec::as_mut_slice), work);
}

/// Splits the columns in halves, one of them for another thread, down to chunks.
fn divide<const COLUMNS: usize>(
    first: usize,
    columns: [&mut [f32]; COLUMNS],
    work: &(impl Fn(u32, [&mut [f32]; COLUMNS]) + Sync),
) {
    let count = columns[0].len();
    if count <= CHUNK {
        return work(first as u32, columns);
    }
    let middle = (count / 2).next_multiple_of(CHUNK);
    let mut halves = columns.map(|column| column.split_at_mut(middle));
    let left = halves.each_mut().map(|(left, _)| std::mem::take(left));
    let right = halves.map(|(_, right)| right);
    rayon::join(
        || divide(first, left, work),
        || divide(first + middle, right, work),
    );
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::motion::{
        AccelerationNoise, ConstantAcceleration, ConstantVelocity, Motion, PositionNoise,
        RandomWalk, VelocityNoise,
    };
    use nalgebra::SMatrix;

    fn matrix<const N: usize>(rows: [[f64; N]; N]) -> SMatrix<f64, N, N> {
        SMatrix::from_fn(|row, column| rows[row][column])
    }

    fn covariance<const N: usize>(noise_factor: [[f64; N]; N]) -> SMatrix<f64, N, N> {
        let factor = matrix(noise_factor);
        factor * factor.transpose()
    }

    fn transition<const N: usize>(dt_s: f64) -> SMatrix<f64, N, N> {
        SMatrix::from_fn(|row, column| {
            if column < row {
                0.0
            } else {
                taylor(dt_s)[column - row]
            }
        })
    }

    /// Checks the noise covariance of a step, and that two half steps have the distribution of one
    /// whole step.
    fn check_white<const N: usize>(
        noise_factor: impl Fn(f64) -> [[f64; N]; N],
        stated: impl Fn(f64) -> [[f64; N]; N],
    ) {
        for dt_s in [0.08, 1.0, 3.0] {
            let half = covariance(noise_factor(dt_s / 2.0));
            let transition = transition(dt_s / 2.0);
            let twice = transition * half * transition.transpose() + half;
            let whole = covariance(noise_factor(dt_s));
            let stated = matrix(stated(dt_s));
            let allowed = 1e-14 * stated.abs();
            assert!((whole - stated).abs() <= allowed, "{whole}{stated}");
            assert!((whole - twice).abs() <= allowed, "{whole}{twice}");
        }
    }

    #[test]
    fn two_half_steps_of_white_noise_have_the_distribution_of_one() {
        let noise = PositionNoise::Diffusion { density_m2ps: 0.5 };
        let walk = RandomWalk::new(noise).unwrap();
        check_white(|dt| walk.noise_factor(dt), |dt| [[0.5 * dt]]);
        let noise = VelocityNoise::White {
            acceleration_density_m2ps3: 3.0,
        };
        let velocity = ConstantVelocity::new(noise).unwrap();
        check_white(
            |dt| velocity.noise_factor(dt),
            |dt| {
                let [position, mixed] = [dt.powi(3) / 3.0, dt.powi(2) / 2.0];
                [[position, mixed], [mixed, dt]].map(|row| row.map(|v| 3.0 * v))
            },
        );
        let noise = AccelerationNoise::White {
            jerk_density_m2ps5: 7.0,
        };
        let acceleration = ConstantAcceleration::new(noise).unwrap();
        check_white(
            |dt| acceleration.noise_factor(dt),
            |dt| {
                let power = |n: i32, divisor: f64| 7.0 * dt.powi(n) / divisor;
                [
                    [power(5, 20.0), power(4, 8.0), power(3, 6.0)],
                    [power(4, 8.0), power(3, 3.0), power(2, 2.0)],
                    [power(3, 6.0), power(2, 2.0), power(1, 1.0)],
                ]
            },
        );
    }

    const COUNT: usize = 100_000;
    const STATE: [f64; 9] = [1.0, 0.0, -0.5, 2.0, 0.0, -4.0, 30.0, 0.0, -9.0];

    /// Returns particles after one step from `STATE`.
    fn moved(motion: Motion, dt_s: f64) -> Particles {
        let mut particles = Particles::new(COUNT, motion.column_count());
        for (column, value) in particles.columns_mut().iter_mut().zip(STATE) {
            column.fill(value as f32);
        }
        motion.propagate(&mut particles, dt_s, Draws::new(3, 0), 1, Level::best());
        particles
    }

    /// Checks that mean and covariance of the particles on each axis are F·s and L·Lᵀ within the
    /// sampling error.
    fn check_moments<const N: usize>(motion: Motion, noise_factor: impl Fn(f64) -> [[f64; N]; N]) {
        let dt_s = 0.04;
        let particles = moved(motion, dt_s);
        let expected = covariance(noise_factor(dt_s));
        for axis in 0..3 {
            let state = SMatrix::<f64, N, 1>::from_fn(|order, _| STATE[3 * order + axis]);
            let means = transition::<N>(dt_s) * state;
            // Single precision rounds with or without noise.
            let rounding = means.map(|mean| 1e-6 * mean.abs());
            let sigmas = expected.diagonal().map(f64::sqrt);
            let deviation = |order: usize, i: usize| {
                f64::from(particles.columns()[3 * order + axis][i]) - means[order]
            };
            for row in 0..N {
                let mean = (0..COUNT).map(|i| deviation(row, i)).sum::<f64>() / COUNT as f64;
                let allowed = 5.0 * sigmas[row] / (COUNT as f64).sqrt() + rounding[row];
                assert!(mean.abs() <= allowed, "{motion:?}: {mean}");
                for column in 0..=row {
                    let product = |i: usize| deviation(row, i) * deviation(column, i);
                    let found = (0..COUNT).map(product).sum::<f64>() / COUNT as f64;
                    let off = (found - expected[(row, column)]).abs();
                    let [a, b] = [row, column].map(|order| sigmas[order] + rounding[order]);
                    assert!(off <= 0.025 * a * b, "{motion:?}: {found}");
                }
            }
        }
    }

    #[test]
    fn particles_move_with_the_stated_mean_and_covariance() {
        let diffusion = PositionNoise::Diffusion { density_m2ps: 0.5 };
        for noise in [PositionNoise::PerStep { sigma_m: 0.03 }, diffusion] {
            let model = RandomWalk::new(noise).unwrap();
            check_moments(model.into(), |dt| model.noise_factor(dt));
        }
        for noise in [
            VelocityNoise::PiecewiseConstant {
                acceleration_sigma_mps2: 56.25,
            },
            VelocityNoise::White {
                acceleration_density_m2ps3: 100.0,
            },
            VelocityNoise::PerStep {
                velocity_sigma_mps: 0.2,
            },
        ] {
            let model = ConstantVelocity::new(noise).unwrap();
            check_moments(model.into(), |dt| model.noise_factor(dt));
        }
        for noise in [
            AccelerationNoise::White {
                jerk_density_m2ps5: 2e5,
            },
            AccelerationNoise::PerStep {
                acceleration_step_sigma_mps2: 3.0,
            },
        ] {
            let model = ConstantAcceleration::new(noise).unwrap();
            check_moments(model.into(), |dt| model.noise_factor(dt));
        }
    }

    /// One of each model, with noise on the highest derivative.
    fn models() -> [Motion; 3] {
        let noise = AccelerationNoise::White {
            jerk_density_m2ps5: 100.0,
        };
        [
            RandomWalk::PUBLISHED.into(),
            ConstantVelocity::DEFAULT.into(),
            ConstantAcceleration::new(noise).unwrap().into(),
        ]
    }

    #[test]
    fn in_a_plane_height_never_changes_and_the_other_axes_move_as_in_space() {
        for space in models() {
            let plane = space.in_plane();
            assert!(plane.is_planar() && !space.is_planar());
            let [space, plane] = [space, plane].map(|motion| moved(motion, 0.1));
            for (number, (space, plane)) in space.columns().iter().zip(plane.columns()).enumerate()
            {
                if number % 3 == 2 {
                    let start = STATE[number] as f32;
                    assert!(plane.iter().all(|&v| v == start));
                    assert!(space.iter().any(|&v| v != start));
                } else {
                    assert_eq!(space, plane);
                }
            }
        }
    }

    #[test]
    fn chunks_cover_each_particle_once_with_its_index() {
        for count in [1, 1023, 1024, 1025, 4097, 30_000] {
            let mut particles = Particles::new(count, 3);
            in_chunks::<3>(&mut particles, &|first, columns| {
                assert!(columns.iter().all(|c| c.len() == columns[0].len()));
                for (i, value) in columns[2].iter_mut().enumerate() {
                    *value += (first as usize + i + 1) as f32;
                }
            });
            let expected: Vec<f32> = (1..=count).map(|number| number as f32).collect();
            assert_eq!(particles.columns()[2], expected, "{count}");
        }
    }
}
