//! Comparison of the Bernoulli filter with exact inference.

mod belief;
mod best;
mod evidence;
mod faults;
mod kalman;
mod other_sensors;

use std::f64::consts::PI;

use nalgebra::{Matrix3, Vector3};
use pardalis_core::rng::{Draws, Stage};
use pardalis_filter::Particles;
use pardalis_filter::bernoulli::{
    BernoulliFilter, BernoulliSettings, MeasurementComponent, ParticleRange,
};
use pardalis_filter::gaussian::{GaussianStart, diagonal_m2};
use pardalis_filter::motion::{ConstantVelocity, Motion, PositionNoise, RandomWalk, VelocityNoise};

/// Default number of particles.
const PARTICLES: usize = 500;
/// Density of the acceleration noise, m²/s³.
const DENSITY_M2PS3: f64 = 2.0;

fn velocity() -> Motion {
    let noise = VelocityNoise::White {
        acceleration_density_m2ps3: DENSITY_M2PS3,
    };
    ConstantVelocity::new(noise).unwrap().into()
}

fn walk(density_m2ps: f64) -> Motion {
    let noise = PositionNoise::Diffusion { density_m2ps };
    RandomWalk::new(noise).unwrap().into()
}

/// Returns settings without births, deaths and relocations.
fn certain(motion: Motion) -> BernoulliSettings {
    let mut settings = BernoulliSettings::of(motion);
    settings.particles = ParticleRange::fixed(PARTICLES);
    settings.birth_rate_hz = 0.0;
    settings.death_rate_hz = 0.0;
    settings.relocation_rate_hz = 0.0;
    settings
}

/// Returns settings with births, deaths and relocations at different rates.
fn lively() -> BernoulliSettings {
    let mut settings = BernoulliSettings::of(velocity());
    settings.particles = ParticleRange::fixed(PARTICLES);
    settings.birth_rate_hz = 0.3;
    settings.death_rate_hz = 0.2;
    settings.relocation_rate_hz = 0.15;
    settings
}

fn filter(settings: &BernoulliSettings, seed: u32) -> BernoulliFilter {
    BernoulliFilter::new(*settings, Draws::new(seed, 0)).unwrap()
}

const START: GaussianStart = GaussianStart {
    position_m: [1.0, -0.5, 2.3],
    covariance_m2: diagonal_m2([0.1, 0.1, 0.1]),
    velocity_mps: [0.5, 0.0, -0.3],
    velocity_sigma_mps: [0.4, 0.6, 0.5],
};

fn matrix([xx, xy, xz, yy, yz, zz]: [f64; 6]) -> Matrix3<f64> {
    Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz)
}

fn entries(matrix: &Matrix3<f64>) -> [f64; 6] {
    [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)].map(|at| matrix[at])
}

/// Returns a covariance with the standard deviation `along_m` in an oblique direction and `across_m` perpendicular to
/// it, like that of a ball in a camera.
fn slanted(along_m: f64, across_m: f64) -> Matrix3<f64> {
    let direction = Vector3::new(2.0, -1.0, 0.5).normalize();
    let beam = direction * direction.transpose();
    beam * along_m.powi(2) + (Matrix3::identity() - beam) * across_m.powi(2)
}

/// Returns the logarithm of a normalised Gaussian likelihood of the position, plus a constant.
fn gaussian_ratio(
    mean_m: Vector3<f64>,
    covariance_m2: Matrix3<f64>,
    plus: f64,
) -> impl Fn(&Particles, &mut [f32]) {
    let precision = covariance_m2.try_inverse().unwrap();
    let log_height = -0.5 * (2.0 * PI * covariance_m2).determinant().ln();
    move |particles, out| {
        for (i, out) in out.iter_mut().enumerate() {
            let d = Vector3::from(particles.position_m(i)) - mean_m;
            *out = (plus + log_height - 0.5 * d.dot(&(precision * d))) as f32;
        }
    }
}

fn silent(_: &Particles, out: &mut [f32]) {
    out.fill(0.0);
}

/// Returns the measured position of an oscillating target, with errors of the stated covariance.
fn measured(step: usize, time_s: f64, covariance_m2: &Matrix3<f64>) -> Vector3<f64> {
    let truth = Vector3::new(
        1.0 + 0.6 * time_s,
        -0.5 + 0.3 * (1.5 * time_s).sin(),
        2.3 - 0.2 * time_s,
    );
    let factor = covariance_m2.cholesky().unwrap().l();
    let [x, y, z, _] = Draws::new(77, 0)
        .normals(step as u32, 0, Stage::Clock, 0)
        .map(f64::from);
    truth + factor * Vector3::new(x, y, z)
}

#[test]
fn the_result_depends_only_on_the_seed() {
    let run = |seed: u32| {
        let covariance = slanted(0.1, 0.01);
        let mut filter = filter(&lively(), seed);
        for step in 0..10 {
            let place = measured(step, 0.04 * step as f64, &covariance);
            let component = MeasurementComponent {
                position_m: place.into(),
                covariance_m2: entries(&covariance),
                log_weight: 1.0,
            };
            filter.predict(0.04);
            filter.update(
                &[component],
                f64::INFINITY,
                gaussian_ratio(place, covariance, 5.0),
            );
        }
        format!(
            "{:?} {:?} {:?}",
            filter.estimate(0.1),
            filter.existence(),
            filter.particles()
        )
    };
    assert_eq!(run(4), run(4));
    assert_ne!(run(4), run(5));
}
