//! Comparison with a Kalman filter for Gaussian measurements.

use std::f64::consts::PI;

use nalgebra::{Matrix3, Matrix3x6, Matrix6, Vector3, Vector6};
use pardalis_filter::bernoulli::{
    BernoulliFilter, BernoulliSettings, MeasurementComponent, ParticleRange,
};
use pardalis_filter::gaussian::{GaussianStart, diagonal_m2};

use super::{
    DENSITY_M2PS3, PARTICLES, START, certain, entries, filter, gaussian_ratio, matrix, measured,
    silent, slanted, velocity,
};

/// Exact inference of position and velocity in space.
struct Kalman {
    mean: Vector6<f64>,
    covariance: Matrix6<f64>,
}

impl Kalman {
    fn new(start: &GaussianStart) -> Self {
        let [a, b, c] = start.velocity_sigma_mps.map(|sigma| sigma * sigma);
        let mut covariance = Matrix6::zeros();
        covariance
            .fixed_view_mut::<3, 3>(0, 0)
            .copy_from(&matrix(start.covariance_m2));
        covariance
            .fixed_view_mut::<3, 3>(3, 3)
            .copy_from(&matrix([a, 0.0, 0.0, b, 0.0, c]));
        let [x, y, z] = start.position_m;
        let [vx, vy, vz] = start.velocity_mps;
        Self {
            mean: Vector6::new(x, y, z, vx, vy, vz),
            covariance,
        }
    }

    fn predict(&mut self, dt_s: f64) {
        let mut f = Matrix6::identity();
        for axis in 0..3 {
            f[(axis, axis + 3)] = dt_s;
        }
        self.mean = f * self.mean;
        self.covariance = f * self.covariance * f.transpose();
        for axis in 0..3 {
            let q = DENSITY_M2PS3;
            self.covariance[(axis, axis)] += q * dt_s.powi(3) / 3.0;
            self.covariance[(axis, axis + 3)] += q * dt_s.powi(2) / 2.0;
            self.covariance[(axis + 3, axis)] += q * dt_s.powi(2) / 2.0;
            self.covariance[(axis + 3, axis + 3)] += q * dt_s;
        }
    }

    /// Returns the logarithm of the measurement's density.
    fn update(&mut self, measured_m: Vector3<f64>, covariance_m2: Matrix3<f64>) -> f64 {
        let h = Matrix3x6::<f64>::identity();
        let expected: Matrix3<f64> = h * self.covariance * h.transpose() + covariance_m2;
        let inverse = expected.try_inverse().unwrap();
        let gain = self.covariance * h.transpose() * inverse;
        let off = measured_m - h * self.mean;
        self.mean += gain * off;
        // Joseph form: symmetric and positive definite despite rounding.
        let rest = Matrix6::identity() - gain * h;
        self.covariance =
            rest * self.covariance * rest.transpose() + gain * covariance_m2 * gain.transpose();
        -0.5 * (off.dot(&(inverse * off)) + (2.0 * PI * expected).determinant().ln())
    }

    fn block<const ROW: usize, const COLUMN: usize>(&self) -> Matrix3<f64> {
        self.covariance
            .fixed_view::<3, 3>(3 * ROW, 3 * COLUMN)
            .into()
    }
}

const STEPS: usize = 60;

/// Returns irregular steps in seconds, including a repeated time and a gap.
fn dt_s(step: usize) -> f64 {
    match step % 20 {
        7 => 0.0,
        13 => 0.3,
        other => 0.03 + 0.002 * other as f64,
    }
}

/// Checks that the mean over seeds agrees with the exact value within a number of standard errors; returns the
/// scatter of single runs in posterior standard deviations over √N.
pub(super) fn check_unbiased(values: &[f64], exact: f64, sigma: f64, place: &str) -> f64 {
    let count = values.len() as f64;
    let mean = values.iter().sum::<f64>() / count;
    let scatter = (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (count - 1.0)).sqrt();
    let error = mean - exact;
    // Weights normalised by their own sum have a bias of about scatter²/σ.
    let allowed = 4.5 * scatter / count.sqrt() + scatter.powi(2) / sigma;
    assert!(
        error.abs() < allowed,
        "{place}: {mean} for {exact}, scatter {scatter}, sigma {sigma}"
    );
    scatter * (PARTICLES as f64).sqrt() / sigma
}

/// Returns how far covariances are off, given the errors of their means, in coordinates in which the exact covariance is the unit matrix.
/// Law of total variance: particles whose mean deviates from the exact one are less scattered by that amount.
fn covariance_error(
    exact: &Matrix3<f64>,
    found: impl ExactSizeIterator<Item = (Vector3<f64>, [f64; 6])>,
) -> Matrix3<f64> {
    let count = found.len() as f64;
    let total: Matrix3<f64> = found
        .map(|(error, covariance)| matrix(covariance) + error * error.transpose())
        .sum::<Matrix3<f64>>()
        / count;
    let whitening = exact.cholesky().unwrap().l().try_inverse().unwrap();
    whitening * total * whitening.transpose() - Matrix3::identity()
}

/// Filters the measurements with 100 seeds, with or without measurement components, and compares the estimates with
/// the Kalman filter. Returns the average and the greatest scatter of positions, in σ/√N, where N is the least number of particles.
fn check_against_kalman(
    start: &GaussianStart,
    covariance_m2: Matrix3<f64>,
    has_components: bool,
    particles: ParticleRange,
) -> (f64, f64) {
    const SEEDS: u32 = 100;
    let mut settings = certain(velocity());
    settings.particles = particles;
    let mut kalman = Kalman::new(start);
    let mut filters: Vec<_> = (0..SEEDS)
        .map(|seed| {
            let mut filter = filter(&settings, seed);
            filter.start(start, 1.0).unwrap();
            filter
        })
        .collect();
    let mut time_s = 0.0;
    let mut scatters = Vec::new();
    for step in 0..STEPS {
        time_s += dt_s(step);
        let position_m = measured(step, time_s, &covariance_m2);
        kalman.predict(dt_s(step));
        kalman.update(position_m, covariance_m2);
        let component = MeasurementComponent {
            position_m: position_m.into(),
            covariance_m2: entries(&covariance_m2),
            log_weight: 3.0,
        };
        let components = if has_components {
            &[component][..]
        } else {
            &[]
        };
        let mut estimates = Vec::new();
        for filter in &mut filters {
            filter.predict(dt_s(step));
            filter.update(
                components,
                f64::INFINITY,
                gaussian_ratio(position_m, covariance_m2, 0.0),
            );
            assert_eq!(filter.existence(), 1.0);
            estimates.push(filter.estimate(0.0).unwrap());
        }
        let covariance = kalman.block::<0, 0>();
        let velocity_covariance = kalman.block::<1, 1>();
        for axis in 0..3 {
            let place = format!("step {step}, axis {axis}");
            let sigma = covariance[(axis, axis)].sqrt();
            let values: Vec<f64> = estimates.iter().map(|e| e.position_m[axis]).collect();
            scatters.push(check_unbiased(&values, kalman.mean[axis], sigma, &place));
            let sigma = velocity_covariance[(axis, axis)].sqrt();
            let values: Vec<f64> = estimates
                .iter()
                .map(|e| e.velocity_mps.unwrap()[axis])
                .collect();
            check_unbiased(&values, kalman.mean[axis + 3], sigma, &place);
        }
        let off = covariance_error(
            &covariance,
            estimates.iter().map(|e| {
                let error = Vector3::from(e.position_m) - kalman.mean.fixed_rows::<3>(0);
                (error, e.covariance_m2)
            }),
        );
        let velocity_off = covariance_error(
            &velocity_covariance,
            estimates.iter().map(|e| {
                let error = Vector3::from(e.velocity_mps.unwrap()) - kalman.mean.fixed_rows::<3>(3);
                (error, e.velocity_covariance_m2ps2.unwrap())
            }),
        );
        let effective = scatters[3 * step..]
            .iter()
            .copied()
            .fold(0.0, f64::max)
            .powi(-2)
            * PARTICLES as f64;
        let allowed = 6.0 * (2.0 / f64::from(SEEDS) / effective).sqrt();
        assert!(
            off.abs().max() < allowed,
            "step {step}: {off}, allowed {allowed}"
        );
        assert!(
            velocity_off.abs().max() < allowed,
            "step {step}: velocity {velocity_off}, allowed {allowed}"
        );
    }
    let of_least = (particles.min as f64 / PARTICLES as f64).sqrt();
    let average = scatters.iter().sum::<f64>() / scatters.len() as f64;
    let widest = scatters.iter().copied().fold(0.0, f64::max);
    (of_least * average, of_least * widest)
}

/// A constant number of particles, and as many as are needed.
const RANGES: [ParticleRange; 2] = [ParticleRange::fixed(PARTICLES), FEW_OR_MANY];
const FEW_OR_MANY: ParticleRange = ParticleRange {
    min: 200,
    max: PARTICLES,
};

#[test]
fn updates_draw_as_many_particles_as_they_need() {
    let range = FEW_OR_MANY;
    let mut settings = certain(velocity());
    settings.particles = range;
    let mut filter = filter(&settings, 1);
    filter.start(&START, 1.0).unwrap();
    assert_eq!(filter.particles().count(), range.max);
    let component = |covariance_m2: &Matrix3<f64>| MeasurementComponent {
        position_m: START.position_m,
        covariance_m2: entries(covariance_m2),
        log_weight: 3.0,
    };
    let covariance_m2 = slanted(0.1, 0.1);
    let place = Vector3::from(START.position_m);
    let mut counts = Vec::new();
    let mut update = |components: &[MeasurementComponent], sharpness: f64| {
        filter.predict(0.04);
        let ratio = gaussian_ratio(place, covariance_m2 / sharpness, 0.0);
        counts.clear();
        filter.update(components, f64::INFINITY, |particles, out| {
            ratio(particles, out);
            counts.push(particles.count());
        });
        assert_eq!(filter.particles().count(), filter.weights().len());
        assert_eq!(counts.last(), Some(&filter.weights().len()));
        let effective = filter.estimate(0.0).unwrap().effective_sample_size;
        (counts.clone(), effective)
    };
    // The images are what was detected.
    let component = component(&covariance_m2);
    for _ in 0..3 {
        assert_eq!(update(&[component], 1.0).0, [range.min]);
    }
    // Nothing was detected.
    assert_eq!(update(&[], 1.0).0, [range.max]);
    assert_eq!(update(&[component], 1.0).0, [range.min]);
    // The images say more than was detected: few of the first are effective, and others are drawn.
    let (counts, effective) = update(&[component], 3.0);
    assert!(counts.len() == 2 && counts[0] == range.min, "{counts:?}");
    assert!(
        (range.min + 1..range.max).contains(&counts[1]),
        "{counts:?}"
    );
    let least = settings.proposal.effective_share * range.min as f64;
    assert!(effective > 0.8 * least, "{effective}, {least}");
}

#[test]
fn sharp_measurements_agree_with_the_kalman_filter() {
    // Much more precise than the prediction: 1 mm in all directions, or 0.3 mm across and 6 mm along the line of
    // sight.
    let start = GaussianStart {
        covariance_m2: diagonal_m2([0.003; 3]),
        ..START
    };
    for covariance_m2 in [slanted(0.001, 0.001), slanted(0.006, 0.0003)] {
        for particles in RANGES {
            let (average, widest) = check_against_kalman(&start, covariance_m2, true, particles);
            assert!(average < 2.0 && widest < 6.0, "{average} {widest}");
        }
    }
}

#[test]
fn broad_measurements_agree_with_the_kalman_filter() {
    for has_components in [true, false] {
        for particles in RANGES {
            let covariance_m2 = slanted(0.15, 0.05);
            let (average, widest) =
                check_against_kalman(&START, covariance_m2, has_components, particles);
            assert!(average < 7.0 && widest < 15.0, "{average} {widest}");
        }
    }
}

/// Returns a filter after a third of a second without information.
fn after_occlusion(seed: u32) -> BernoulliFilter {
    let mut filter = filter(&certain(velocity()), seed);
    filter.start(&START, 1.0).unwrap();
    for _ in 0..8 {
        filter.predict(0.04);
        filter.update(&[], f64::INFINITY, silent);
    }
    filter
}

#[test]
fn the_first_draw_is_kept_if_the_second_is_impossible() {
    let covariance_m2 = slanted(0.05, 0.004);
    let position_m = Vector3::from(START.position_m);
    let component = MeasurementComponent {
        position_m: START.position_m,
        covariance_m2: entries(&covariance_m2),
        log_weight: 3.0,
    };
    let mut filter = after_occlusion(1);
    filter.predict(0.04);
    let ratio = gaussian_ratio(position_m, covariance_m2, 0.0);
    let mut calls = 0;
    filter.update(&[component], f64::INFINITY, |particles, out| {
        ratio(particles, out);
        calls += 1;
        if calls == 2 {
            out.fill(f32::NEG_INFINITY);
        }
    });
    assert_eq!(calls, 3);
    assert!((filter.weights().iter().sum::<f64>() - 1.0).abs() < 1e-9);
    let found_m = Vector3::from(filter.estimate(0.0).unwrap().position_m);
    assert!((found_m - position_m).norm() < 0.3, "{found_m}");
}

/// After an occlusion of a third of a second, particles are farther apart than the precision of a measurement.
#[test]
fn a_reappearing_target_is_weighted_by_the_moment_matched_prediction() {
    let covariance_m2 = slanted(0.05, 0.004);
    let mut kalman = Kalman::new(&START);
    for _ in 0..9 {
        kalman.predict(0.04);
    }
    // One standard deviation off along each axis.
    let spread = kalman.block::<0, 0>().diagonal().map(f64::sqrt);
    let position_m = kalman.mean.fixed_rows::<3>(0) + spread;
    kalman.update(position_m, covariance_m2);
    let component = MeasurementComponent {
        position_m: position_m.into(),
        covariance_m2: entries(&covariance_m2),
        log_weight: 3.0,
    };
    let mut estimates = Vec::new();
    for seed in 0..100 {
        let mut filter = after_occlusion(seed);
        filter.predict(0.04);
        let ratio = gaussian_ratio(position_m, covariance_m2, 0.0);
        filter.update(&[component], f64::INFINITY, ratio);
        let estimate = filter.estimate(0.0).unwrap();
        let effective = estimate.effective_sample_size;
        assert!(effective > 0.05 * PARTICLES as f64, "{seed}: {effective}");
        estimates.push(estimate);
    }
    for axis in 0..3 {
        let sigma = kalman.block::<0, 0>()[(axis, axis)].sqrt();
        let values: Vec<f64> = estimates.iter().map(|e| e.position_m[axis]).collect();
        let scatter = check_unbiased(&values, kalman.mean[axis], sigma, "position");
        assert!(scatter < 5.0, "axis {axis}: {scatter}");
        let sigma = kalman.block::<1, 1>()[(axis, axis)].sqrt();
        let velocities = estimates.iter().map(|e| e.velocity_mps.unwrap()[axis]);
        let values: Vec<f64> = velocities.collect();
        check_unbiased(&values, kalman.mean[axis + 3], sigma, "velocity");
    }
}

#[test]
fn predictions_in_one_or_several_steps_agree_with_the_kalman_filter() {
    let settings = BernoulliSettings::of(velocity());
    let mut filters = [[0.75, 0.0, 0.0], [0.25, 0.125, 0.375]].map(|pieces| {
        let mut filter = filter(&settings, 5);
        filter.start(&START, 0.75).unwrap();
        for dt_s in pieces {
            filter.predict(dt_s);
        }
        filter
    });
    let [a, b] = &filters;
    assert_eq!(a.estimate(0.25), b.estimate(0.25));
    assert_eq!(a.existence(), b.existence());
    assert_eq!(a.located(), b.located());
    let estimate = a.estimate(0.25).unwrap();
    let mut kalman = Kalman::new(&START);
    kalman.predict(1.0);
    let covariance = kalman.block::<0, 0>();
    for axis in 0..3 {
        let sigma = covariance[(axis, axis)].sqrt();
        let error = (estimate.position_m[axis] - kalman.mean[axis]) / sigma;
        assert!(error.abs() < 5.0 / (PARTICLES as f64).sqrt(), "{error}");
        let ratio = estimate.covariance_m2[[0, 3, 5][axis]] / sigma.powi(2);
        assert!((ratio - 1.0).abs() < 0.1, "{ratio}");
        let variance = kalman.block::<1, 1>()[(axis, axis)];
        let of_velocity_m2ps2 = estimate.velocity_covariance_m2ps2.unwrap();
        let ratio = of_velocity_m2ps2[[0, 3, 5][axis]] / variance;
        assert!((ratio - 1.0).abs() < 0.1, "velocity: {ratio}");
    }
    let bits = filters.each_mut().map(|filter| {
        filter.update(&[], f64::INFINITY, silent);
        format!("{:?}", filter.estimate(0.0))
    });
    assert_eq!(bits[0], bits[1]);
}

#[test]
fn predicted_velocities_may_jump_but_not_out_of_a_plane() {
    let (sigma_mps, jump_sigma_mps, time_s) = (0.5, 3.0, 0.4);
    let start = GaussianStart {
        velocity_sigma_mps: [sigma_mps; 3],
        ..START
    };
    let drawn = sigma_mps * sigma_mps + DENSITY_M2PS3 * time_s;
    // Jumps at random times, twice a second.
    let jumped = (1.0 - (-2.0 * time_s).exp()) * jump_sigma_mps * jump_sigma_mps;
    for (motion, vertical) in [(velocity(), 1.0), (velocity().in_plane(), 0.0)] {
        let mut settings = certain(motion);
        settings.velocity_jump_rate_hz = 2.0;
        settings.velocity_jump_sigma_mps = jump_sigma_mps;
        let mut filter = filter(&settings, 1);
        filter.start(&start, 1.0).unwrap();
        filter.predict(0.25 * time_s);
        let found = filter.estimate(0.75 * time_s).unwrap();
        let found = found.velocity_covariance_m2ps2.unwrap();
        let expected = drawn + jumped;
        let expected = [expected, 0.0, 0.0, expected, 0.0, vertical * expected];
        for (found, expected) in found.into_iter().zip(expected) {
            assert!((found - expected).abs() < 1e-12, "{found} for {expected}");
        }
    }
}
