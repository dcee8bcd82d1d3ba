//! Targets that appear, disappear and are relocated, detected among clutter and sometimes missed: existence
//! probabilities and covariances are consistent with the truth.

use nalgebra::Vector3;
use pardalis_core::rng::{Draws, Stage};
use pardalis_filter::bernoulli::{
    BernoulliFilter, BernoulliSettings, MeasurementComponent, ParticleRange,
};
use pardalis_filter::gaussian::diagonal_m2;

use super::{DENSITY_M2PS3, filter, velocity};

const STEP_S: f64 = 0.04;
/// Side in metres of the cube that contains births, relocations and clutter.
const SIDE_M: f64 = 5.0;
/// Detection probability.
const DETECTED: f64 = 0.8;
/// Maximum number of false detections per frame, and the probability of each.
const CLUTTER: u32 = 40;
const CLUTTERED: f64 = 0.05;
/// Standard deviation of a detection's position on each axis, metres.
const SIGMA_M: f64 = 0.03;
/// Standard deviation of the velocity after appearance or relocation, on each axis, m/s.
const VELOCITY_SIGMA_MPS: f64 = 1.0;
const RATE_HZ: f64 = 0.2;

fn settings() -> BernoulliSettings {
    let mut settings = BernoulliSettings::of(velocity());
    // The standard deviation of detections is four times that which a step adds to a position, so that velocities
    // sampled at a birth matter for long.
    settings.particles = ParticleRange::fixed(2000);
    settings.birth_rate_hz = RATE_HZ;
    settings.death_rate_hz = RATE_HZ;
    settings.relocation_rate_hz = RATE_HZ;
    settings.birth_density = SIDE_M.powi(-3);
    settings.birth_velocity_sigma_mps = VELOCITY_SIGMA_MPS;
    settings
}

/// A simulated world that obeys the models of the filter.
struct World {
    draws: Draws,
    step: u32,
    /// Position and velocity, if there is a target.
    target: Option<[Vector3<f64>; 2]>,
}

impl World {
    fn normals(&self, what: u32) -> Vector3<f64> {
        let [x, y, z, _] = self.draws.normals(what, self.step, Stage::Clock, 0);
        Vector3::new(x, y, z).map(f64::from)
    }

    fn uniforms(&self, what: u32) -> [f64; 4] {
        self.draws.uniforms(what, self.step, Stage::Drift)
    }

    fn uniform_position(&self, what: u32) -> Vector3<f64> {
        let [x, y, z, _] = self.uniforms(what);
        Vector3::new(x, y, z) * SIDE_M
    }

    /// Simulates one step and returns the detections.
    fn simulate_step(&mut self) -> Vec<Vector3<f64>> {
        self.step += 1;
        let chance = 1.0 - (-RATE_HZ * STEP_S).exp();
        let [dies, jumps, is_born, is_detected] = self.uniforms(0);
        let new = [
            self.uniform_position(1),
            self.normals(1) * VELOCITY_SIGMA_MPS,
        ];
        self.target = match self.target {
            None => (is_born < chance).then_some(new),
            Some(_) if dies < chance => None,
            Some(_) if jumps < chance => Some(new),
            Some([position, velocity]) => {
                let acceleration = self.normals(2) * (DENSITY_M2PS3 * STEP_S).sqrt();
                let rest = self.normals(3) * (DENSITY_M2PS3 * STEP_S.powi(3) / 12.0).sqrt();
                let moved = position + (velocity + acceleration / 2.0) * STEP_S + rest;
                Some([moved, velocity + acceleration])
            }
        };
        let seen = self.target.filter(|_| is_detected < DETECTED);
        let seen = seen.map(|[position, _]| position + self.normals(4) * SIGMA_M);
        let clutter = (10..10 + CLUTTER).filter(|&what| self.uniforms(what)[3] < CLUTTERED);
        seen.into_iter()
            .chain(clutter.map(|what| self.uniform_position(what)))
            .collect()
    }
}

fn step(filter: &mut BernoulliFilter, detections: &[Vector3<f64>]) {
    let components: Vec<MeasurementComponent> = detections
        .iter()
        .map(|&position| MeasurementComponent {
            position_m: position.into(),
            covariance_m2: diagonal_m2([SIGMA_M; 3]),
            log_weight: 0.0,
        })
        .collect();
    let clutter_density = f64::from(CLUTTER) * CLUTTERED / SIDE_M.powi(3);
    let height = (2.0 * std::f64::consts::PI * SIGMA_M * SIGMA_M).powf(-1.5) / clutter_density;
    filter.predict(STEP_S);
    filter.update(&components, f64::INFINITY, |particles, out| {
        for (i, out) in out.iter_mut().enumerate() {
            let position = Vector3::from(particles.position_m(i));
            let squared =
                |detection: &Vector3<f64>| (position - detection).norm_squared() / SIGMA_M.powi(2);
            let sum: f64 = detections.iter().map(|d| (-0.5 * squared(d)).exp()).sum();
            *out = (1.0 - DETECTED + DETECTED * height * sum).ln() as f32;
        }
    });
}

#[test]
fn existence_probabilities_and_covariances_are_calibrated() {
    const WORLDS: u32 = 20;
    const STEPS: u32 = 250;
    /// Upper limits of the bins of existence probabilities.
    const BINS: [f64; 6] = [0.02, 0.1, 0.5, 0.9, 0.98, 1.0];
    let mut bins = [[0.0; 3]; BINS.len()];
    // Squared errors normalised by the covariance, if the estimate is of the target and not of clutter.
    let (mut squared, mut located) = (0.0, 0.0);
    for seed in 0..WORLDS {
        let mut world = World {
            draws: Draws::new(seed, 1),
            step: 0,
            target: None,
        };
        let mut filter = filter(&settings(), seed);
        for _ in 0..STEPS {
            step(&mut filter, &world.simulate_step());
            let existence = filter.existence();
            let bin = &mut bins[BINS.partition_point(|&most| most < existence)];
            let is_there = f64::from(u8::from(world.target.is_some()));
            for (sum, value) in bin.iter_mut().zip([1.0, existence, is_there]) {
                *sum += value;
            }
            if let (Some([position, _]), true) = (world.target, existence > 0.9) {
                let estimate = filter.estimate(0.0).unwrap();
                let error = position - Vector3::from(estimate.position_m);
                if error.norm() < 0.5 {
                    let covariance = super::matrix(estimate.covariance_m2);
                    squared += error.dot(&(covariance.try_inverse().unwrap() * error));
                    located += 1.0;
                }
            }
        }
    }
    let off: f64 = bins.iter().map(|[_, said, was]| (said - was).abs()).sum();
    let calibration_error = off / f64::from(WORLDS * STEPS);
    assert!(calibration_error < 0.02, "{calibration_error}");
    // The expected value is 3, one per axis; errors of successive frames are correlated.
    let mean = squared / located;
    assert!((2.5..3.5).contains(&mean), "{mean} over {located}");
}
