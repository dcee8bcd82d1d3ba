//! The Bernoulli filter against exact inference: a Kalman filter, the recursion of existence, integrals by hand.

use std::f64::consts::PI;

use nalgebra::{Matrix3, Matrix3x6, Matrix6, Vector3, Vector6};
use pardalis::bernoulli::{BernoulliFilter, BernoulliSettings, Peak};
use pardalis::gaussian::{GaussianStart, diagonal_m2};
use pardalis::motion::{
    ConstantAcceleration, ConstantVelocity, Disturbance, JumpChance, Jumps, Motion, RandomWalk,
    Stray,
};
use pardalis::particles::Particles;
use pardalis::rng::Draws;
use proptest::prelude::*;

const DENSITY_M2PS3: f64 = 2.0;

fn velocity() -> Motion {
    let disturbance = Disturbance::White {
        acceleration_density_m2ps3: DENSITY_M2PS3,
    };
    ConstantVelocity::new(disturbance).unwrap().into()
}

fn walk(density_m2ps: f64) -> Motion {
    let stray = Stray::Diffusion { density_m2ps };
    RandomWalk::new(stray).unwrap().into()
}

/// Neither births, nor deaths, nor jumps.
fn certain(motion: Motion) -> BernoulliSettings {
    BernoulliSettings {
        birth_rate_hz: 0.0,
        death_rate_hz: 0.0,
        jump_rate_hz: 0.0,
        ..BernoulliSettings::of(motion)
    }
}

fn filter(settings: BernoulliSettings, seed: u32) -> BernoulliFilter {
    BernoulliFilter::new(settings, Draws::new(seed, 0)).unwrap()
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

/// A covariance that is `along` wide in a slanted direction and `across` elsewhere, as a camera sees a ball.
fn slanted(along_m: f64, across_m: f64) -> Matrix3<f64> {
    let direction = Vector3::new(2.0, -1.0, 0.5).normalize();
    let beam = direction * direction.transpose();
    beam * along_m.powi(2) + (Matrix3::identity() - beam) * across_m.powi(2)
}

/// The logarithm of a normalised Gaussian likelihood of the position, plus a constant.
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
        // Joseph's form: symmetric and positive whatever is rounded.
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

/// Irregular steps, a repeated time and a gap among them.
fn dt_s(step: usize) -> f64 {
    match step % 20 {
        7 => 0.0,
        13 => 0.3,
        other => 0.03 + 0.002 * other as f64,
    }
}

/// Where a target that swings is measured to be, with errors of the stated covariance.
fn measured(step: usize, time_s: f64, covariance_m2: &Matrix3<f64>) -> Vector3<f64> {
    let truth = Vector3::new(
        1.0 + 0.6 * time_s,
        -0.5 + 0.3 * (1.5 * time_s).sin(),
        2.3 - 0.2 * time_s,
    );
    let factor = covariance_m2.cholesky().unwrap().l();
    let [x, y, z, _] = Draws::new(77, 0)
        .normals(step as u32, 0, pardalis::rng::Stage::Clock, 0)
        .map(f64::from);
    truth + factor * Vector3::new(x, y, z)
}

/// The mean over seeds of a number lies within so many standard errors of the exact one; returns the scatter of single runs in posterior standard
/// deviations over √N.
fn check_unbiased(values: &[f64], exact: f64, sigma: f64, place: &str) -> f64 {
    let count = values.len() as f64;
    let mean = values.iter().sum::<f64>() / count;
    let scatter = (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (count - 1.0)).sqrt();
    let error = mean - exact;
    // Weights that are normalised by their own sum are biased by about the share of the variance that the scatter is.
    let allowed = 4.5 * scatter / count.sqrt() + scatter.powi(2) / sigma;
    assert!(
        error.abs() < allowed,
        "{place}: {mean} for {exact}, scatter {scatter}, sigma {sigma}"
    );
    scatter * (PARTICLES as f64).sqrt() / sigma
}

const PARTICLES: usize = 500;

/// Follows the measurements with 100 seeds, with peaks or without, and holds them to the Kalman filter. Returns the average and the widest scatter of positions, in
/// σ/√N.
fn check_against_kalman(
    start: &GaussianStart,
    covariance_m2: Matrix3<f64>,
    has_peaks: bool,
) -> (f64, f64) {
    const SEEDS: u32 = 100;
    let mut kalman = Kalman::new(start);
    let mut filters: Vec<_> = (0..SEEDS)
        .map(|seed| {
            let mut filter = filter(certain(velocity()), seed);
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
        let peak = Peak {
            position_m: position_m.into(),
            covariance_m2: entries(&covariance_m2),
            log_evidence: 3.0,
        };
        let peaks = if has_peaks { &[peak][..] } else { &[] };
        let mut estimates = Vec::new();
        for filter in &mut filters {
            filter.predict(dt_s(step));
            filter.update(peaks, gaussian_ratio(position_m, covariance_m2, 0.0));
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
        // The law of total variance: a cloud that strays from the exact mean is narrower by as much. In the directions in which the exact covariance is the
        // unit matrix.
        let total: Matrix3<f64> = estimates
            .iter()
            .map(|e| {
                let error = Vector3::from(e.position_m) - kalman.mean.fixed_rows::<3>(0);
                matrix(e.covariance_m2) + error * error.transpose()
            })
            .sum::<Matrix3<f64>>()
            / f64::from(SEEDS);
        let whitening = covariance.cholesky().unwrap().l().try_inverse().unwrap();
        let off = whitening * total * whitening.transpose() - Matrix3::identity();
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
    }
    let average = scatters.iter().sum::<f64>() / scatters.len() as f64;
    (average, scatters.iter().copied().fold(0.0, f64::max))
}

#[test]
fn sharp_measurements_agree_with_the_kalman_filter() {
    // A fiftieth of what is predicted, and less across; 0.3 mm across and 6 mm along the line of sight.
    let start = GaussianStart {
        covariance_m2: diagonal_m2([0.003; 3]),
        ..START
    };
    for covariance_m2 in [slanted(0.001, 0.001), slanted(0.006, 0.0003)] {
        let (average, widest) = check_against_kalman(&start, covariance_m2, true);
        assert!(average < 2.0 && widest < 6.0, "{average} {widest}");
    }
}

#[test]
fn broad_measurements_agree_with_the_kalman_filter() {
    for has_peaks in [true, false] {
        let (average, widest) = check_against_kalman(&START, slanted(0.15, 0.05), has_peaks);
        assert!(average < 7.0 && widest < 15.0, "{average} {widest}");
    }
}

#[test]
fn predicting_in_pieces_is_predicting_at_once_and_agrees_with_the_kalman_filter() {
    let settings = BernoulliSettings::of(velocity());
    let mut filters = [[0.75, 0.0, 0.0], [0.25, 0.125, 0.375]].map(|pieces| {
        let mut filter = filter(settings, 5);
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
    }
    let bits = filters.each_mut().map(|filter| {
        filter.update(&[], silent);
        format!("{:?}", filter.estimate(0.0))
    });
    assert_eq!(bits[0], bits[1]);
}

/// The start with one velocity variance, at one place: every particle predicts the same.
const POINT_START: GaussianStart = GaussianStart {
    covariance_m2: [0.0; 6],
    velocity_sigma_mps: [0.4; 3],
    ..START
};

/// Mean of what every particle predicts from there after these seconds, and its variance.
fn predicted(dt_s: f64) -> (Vector3<f64>, f64) {
    let mean = Vector3::from(START.position_m) + Vector3::from(START.velocity_mps) * dt_s;
    (
        mean,
        0.4_f64.powi(2) * dt_s.powi(2) + DENSITY_M2PS3 * dt_s.powi(3) / 3.0,
    )
}

fn density(at_m: Vector3<f64>, mean_m: Vector3<f64>, covariance_m2: Matrix3<f64>) -> f64 {
    let d = at_m - mean_m;
    let squared = d.dot(&(covariance_m2.try_inverse().unwrap() * d));
    (-0.5 * squared).exp() / (2.0 * PI * covariance_m2).determinant().sqrt()
}

/// Existence with births, deaths and jumps as in the defaults but for these, and what has become of it after some seconds: the chances that the target is located, and elsewhere.
fn lively() -> BernoulliSettings {
    BernoulliSettings {
        birth_rate_hz: 0.3,
        death_rate_hz: 0.2,
        jump_rate_hz: 0.15,
        ..BernoulliSettings::of(velocity())
    }
}

fn located_and_elsewhere(existence: f64, dt_s: f64) -> (f64, f64) {
    // Many small steps of Euler's for what the filter solves in one.
    const STEPS: usize = 200_000;
    let h = dt_s / STEPS as f64;
    let (mut located, mut exists) = (existence, existence);
    for _ in 0..STEPS {
        located -= h * (0.2 + 0.15) * located;
        exists += h * (0.3 * (1.0 - exists) - 0.2 * exists);
    }
    (located, exists - located)
}

#[test]
fn existence_follows_its_recursion() {
    let mut tracked = filter(lively(), 1);
    tracked.start(&START, 0.6).unwrap();
    let mut expected = 0.6;
    for step in 0..30 {
        let log_ratio = [0.7, -1.5, 0.0, 2.0, -0.5][step % 5];
        tracked.predict(0.25);
        let (located, elsewhere) = located_and_elsewhere(expected, 0.25);
        let tell =
            (tracked.located() - located).abs() + (tracked.existence() - located - elsewhere).abs();
        assert!(tell < 1e-6, "step {step}");
        tracked.update(&[], |_, out| out.fill(log_ratio));
        let there = located * f64::from(log_ratio).exp();
        expected = there / (1.0 - located - elsewhere + there);
        let found = tracked.existence();
        assert!(
            (found - expected).abs() < 1e-5,
            "step {step}: {found} for {expected}"
        );
        assert!((tracked.located() - found).abs() < 1e-15);
        expected = found;
    }
}

#[test]
fn existence_stays_where_nobody_looks_and_goes_with_the_target() {
    let mut steady = filter(certain(velocity()), 1);
    steady.start(&START, 0.4).unwrap();
    for _ in 0..50 {
        steady.predict(0.04);
        steady.update(&[], silent);
        assert!(
            (steady.existence() - 0.4).abs() < 1e-12,
            "{}",
            steady.existence()
        );
    }
    // However sure it was, a target that is nowhere is soon known to be gone, and the other way round.
    let mut lost = filter(lively(), 1);
    lost.start(&START, 1.0).unwrap();
    for log_ratio in [500.0, 500.0, -500.0] {
        lost.predict(0.04);
        lost.update(&[], |_, out| out.fill(log_ratio));
        assert!((lost.existence() > 0.99) == (log_ratio > 0.0));
    }
    assert!(lost.existence() > 0.0 && lost.existence() < 1e-200);
    // All is impossible: gone for certain, with no estimate.
    lost.predict(0.04);
    lost.update(&[], |_, out| out.fill(f32::NEG_INFINITY));
    assert_eq!((lost.existence(), lost.estimate(0.0)), (0.0, None));
    // A target that certainly exists is predicted where the images deny it.
    let mut certain = filter(certain(velocity()), 1);
    certain.start(&START, 1.0).unwrap();
    certain.predict(0.1);
    let before = (certain.estimate(0.0), certain.particles().clone());
    certain.update(&[], |_, out| out.fill(f32::NEG_INFINITY));
    assert_eq!((certain.estimate(0.0), certain.particles().clone()), before);
    assert_eq!(certain.existence(), 1.0);
}

#[test]
fn a_target_that_comes_into_being_is_found_at_once() {
    let covariance = slanted(0.2, 0.02);
    let place = Vector3::new(-2.0, 3.0, 1.0);
    let peak = Peak {
        position_m: place.into(),
        covariance_m2: entries(&covariance),
        log_evidence: 40.0,
    };
    for started in [false, true] {
        let settings = BernoulliSettings {
            birth_velocity_sigma_mps: 0.8,
            ..lively()
        };
        let mut born = filter(settings, 3);
        if started {
            born.start(&START, 0.9).unwrap();
        }
        born.predict(0.1);
        born.update(&[peak], gaussian_ratio(place, covariance, 40.0));
        assert!(born.existence() > 0.999_999, "{}", born.existence());
        let estimate = born.estimate(0.0).unwrap();
        let effective = estimate.effective_sample_size;
        assert!(
            effective > if started { 50.0 } else { 120.0 },
            "{effective}"
        );
        let off = Vector3::from(estimate.position_m) - place;
        let whitening = covariance.cholesky().unwrap().l().try_inverse().unwrap();
        assert!(
            (whitening * off).abs().max() < 4.5 / effective.sqrt(),
            "{off}"
        );
        assert_eq!(estimate.velocity_mps, Some([0.0; 3]));
        let later = estimate_growth(&born, 0.5);
        let expected = 0.8_f64.powi(2) * 0.25 + DENSITY_M2PS3 * 0.125 / 3.0;
        assert!(
            (later / expected - 1.0).abs() < 1e-9,
            "{later} for {expected}"
        );
    }
}

/// By how much the variance of x grows over a time without images.
fn estimate_growth(filter: &BernoulliFilter, ahead_s: f64) -> f64 {
    let [now, later] = [0.0, ahead_s].map(|at| filter.estimate(at).unwrap().covariance_m2[0]);
    later - now
}

/// Runs one update of a start at one place, for many seeds, and holds existence's odds and the share of weight around `near_m` to what is exact, within standard errors.
fn check_one_update(
    settings: BernoulliSettings,
    peaks: &[Peak],
    log_ratios: impl Fn(&Particles, &mut [f32]),
    exact_odds: f64,
    near: Option<(Vector3<f64>, f64)>,
) {
    const SEEDS: u32 = 400;
    let (mut odds, mut shares) = (Vec::new(), Vec::new());
    for seed in 0..SEEDS {
        let mut filter = filter(settings, seed);
        filter.start(&POINT_START, 0.7).unwrap();
        filter.predict(0.2);
        filter.update(peaks, &log_ratios);
        let existence = filter.existence();
        odds.push(existence / (1.0 - existence));
        if let Some((near_m, _)) = near {
            shares.push(filter.weight_within(near_m.into(), 1.0));
        }
    }
    check_mean(&odds, exact_odds, 0.0);
    if let Some((_, exact)) = near {
        // Normalised by their own sum: a bias of 1/N.
        check_mean(&shares, exact, 2.0 * exact / PARTICLES as f64);
    }
}

fn check_mean(values: &[f64], exact: f64, bias: f64) {
    let count = values.len() as f64;
    let mean = values.iter().sum::<f64>() / count;
    let scatter = (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (count - 1.0)).sqrt();
    let allowed = 4.0 * scatter / count.sqrt() + bias;
    assert!(
        (mean - exact).abs() < allowed,
        "{mean} for {exact}, allowed {allowed}"
    );
    // And the test can tell.
    assert!(allowed < 0.05 * exact, "{allowed} of {exact}");
}

#[test]
fn near_and_far_are_weighed_by_their_densities() {
    let settings = lively();
    let covariance = slanted(0.06, 0.01);
    let (mean, variance) = predicted(0.2);
    let near = mean + Vector3::new(0.2, 0.1, -0.1);
    let far = mean + Vector3::new(3.0, -2.0, 1.0);
    let (located, elsewhere) = located_and_elsewhere(0.7, 0.2);
    let absent = 1.0 - located - elsewhere;
    let continued = located * density(near, mean, covariance + Matrix3::identity() * variance);
    let born = elsewhere * settings.birth_density;
    let peak_at = |position_m: Vector3<f64>| Peak {
        position_m: position_m.into(),
        covariance_m2: entries(&covariance),
        log_evidence: 2.0,
    };
    let plus = 2.0;
    let gain = f64::exp(plus) / absent;
    // Both, with equal evidence. One of the two is always elsewhere: a birth may be near, too.
    let [at_near, at_far] = [near, far].map(|place| gaussian_ratio(place, covariance, plus));
    let mut from_far = vec![0.0; PARTICLES];
    let both = std::cell::RefCell::new(&mut from_far);
    check_one_update(
        settings,
        &[peak_at(far), peak_at(near)],
        |particles, out| {
            let mut from_far = both.borrow_mut();
            at_near(particles, out);
            at_far(particles, &mut from_far);
            for (out, far) in out.iter_mut().zip(from_far.iter()) {
                *out = out.max(*far);
            }
        },
        gain * (continued + 2.0 * born),
        Some((near, (continued + born) / (continued + 2.0 * born))),
    );
    // The far one alone: it is a birth or a jump.
    check_one_update(
        settings,
        &[peak_at(far)],
        gaussian_ratio(far, covariance, plus),
        gain * born,
        Some((far, 1.0)),
    );
}

/// Cells of an integral.
const CELLS: i32 = 20_000;

#[test]
fn wrong_peaks_change_no_weights() {
    // A likelihood of x alone, its integral by trapezia; peaks that are off, too sure, and say nonsense.
    let ratio = |x: f64| 1.5 + (9.0 * x).sin() + 3.0 * (-((x - 1.3) / 0.05).powi(2)).exp();
    let (mean, variance) = predicted(0.2);
    let sigma = variance.sqrt();
    let integral: f64 = (-CELLS..CELLS)
        .map(|cell| {
            let z = 8.0 * (f64::from(cell) + 0.5) / f64::from(CELLS);
            let height = (-0.5 * z * z).exp() / (2.0 * PI).sqrt();
            height * ratio(mean.x + sigma * z) * 8.0 / f64::from(CELLS)
        })
        .sum();
    let peak = |dx: f64, width_m: f64, log_evidence: f64| Peak {
        position_m: (mean + Vector3::new(dx, -dx, 0.5 * dx)).into(),
        covariance_m2: entries(&slanted(width_m, width_m / 4.0)),
        log_evidence,
    };
    let wrong = [
        peak(0.1, 0.05, 5.0),
        peak(-0.15, 0.3, 2.0),
        peak(4.0, 1.0, -200.0),
    ];
    let settings = certain(velocity());
    for peaks in [&wrong[..], &wrong[..1], &[]] {
        check_one_update(
            settings,
            peaks,
            |particles, out| {
                for (i, out) in out.iter_mut().enumerate() {
                    *out = ratio(particles.position_m(i)[0]).ln() as f32;
                }
            },
            0.7 / 0.3 * integral,
            None,
        );
    }
}

#[test]
fn in_a_plane_densities_have_two_dimensions_and_particles_one_height() {
    let settings = BernoulliSettings {
        motion: walk(0.3).in_plane(),
        birth_density: 0.05,
        ..lively()
    };
    let variance = 0.3 * 0.2;
    let mean = Vector3::from(START.position_m);
    let near = mean + Vector3::new(0.3, -0.1, 0.0);
    let (xx, xy, yy) = (0.004, 0.0035, 0.005);
    // What is said of the vertical means nothing.
    let peak = Peak {
        position_m: [near.x, near.y, 1.25],
        covariance_m2: [xx, xy, 7.0, yy, -3.0, 0.0],
        log_evidence: 0.0,
    };
    let height = |variance: f64| {
        let [a, b] = [xx + variance, yy + variance];
        let determinant = a * b - xy * xy;
        move |x: f64, y: f64| {
            let squared = (b * x * x - 2.0 * xy * x * y + a * y * y) / determinant;
            (-0.5 * squared).exp() / (2.0 * PI * determinant.sqrt())
        }
    };
    let likelihood = height(0.0);
    let agreed = height(variance)(near.x - mean.x, near.y - mean.y);
    let (located, elsewhere) = located_and_elsewhere(0.7, 0.2);
    check_one_update(
        settings,
        &[peak],
        |particles, out| {
            for (i, out) in out.iter_mut().enumerate() {
                let [x, y, z] = particles.position_m(i);
                assert_eq!(z, 1.25);
                *out = likelihood(x - near.x, y - near.y).ln() as f32;
            }
        },
        (located * agreed + elsewhere * 0.05) / (1.0 - located - elsewhere),
        None,
    );
    let mut filter = filter(settings, 1);
    filter.start(&START, 0.7).unwrap();
    filter.predict(0.1);
    filter.update(&[], silent);
    let estimate = filter.estimate(0.3).unwrap();
    assert_eq!(estimate.velocity_mps, None);
    assert_eq!(filter.particles().columns().len(), 3);
    let [_, _, xz, _, yz, zz] = estimate.covariance_m2;
    assert!(estimate.position_m[2] == 2.3 || (estimate.position_m[2] - 2.3).abs() < 1e-12);
    assert!([xz, yz, zz].iter().all(|v| v.abs() < 1e-12), "{estimate:?}");
}

#[test]
fn the_seed_alone_decides() {
    let run = |seed: u32| {
        let covariance = slanted(0.1, 0.01);
        let mut filter = filter(lively(), seed);
        for step in 0..10 {
            let place = measured(step, 0.04 * step as f64, &covariance);
            let peak = Peak {
                position_m: place.into(),
                covariance_m2: entries(&covariance),
                log_evidence: 1.0,
            };
            filter.predict(0.04);
            filter.update(&[peak], gaussian_ratio(place, covariance, 5.0));
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

#[test]
fn other_motion_and_settings_out_of_range_are_refused() {
    let jumping = RandomWalk::new(Stray::Diffusion { density_m2ps: 1.0 })
        .unwrap()
        .with_jumps(Jumps::new(JumpChance::PerStep { share: 0.1 }, [0.0; 3], [1.0; 3]).unwrap());
    let walk_by_step = RandomWalk::new(Stray::PerStep { sigma_m: 0.1 }).unwrap();
    let velocity_by_step = ConstantVelocity::new(Disturbance::PerStep {
        velocity_sigma_mps: 0.1,
    })
    .unwrap();
    let accelerated = ConstantAcceleration::new(pardalis::motion::Jerk::White {
        jerk_density_m2ps5: 1.0,
    })
    .unwrap();
    for motion in [
        jumping.into(),
        walk_by_step.into(),
        velocity_by_step.into(),
        Motion::from(accelerated),
    ] {
        let error =
            BernoulliFilter::new(BernoulliSettings::of(motion), Draws::new(1, 0)).unwrap_err();
        assert!(
            error.to_string().contains("random walk that diffuses"),
            "{error}"
        );
    }
    let good = lively();
    for (settings, name) in [
        (
            BernoulliSettings {
                particle_count: 0,
                ..good
            },
            "particles",
        ),
        (
            BernoulliSettings {
                birth_rate_hz: -1.0,
                ..good
            },
            "birth_rate_hz",
        ),
        (
            BernoulliSettings {
                death_rate_hz: f64::NAN,
                ..good
            },
            "death_rate_hz",
        ),
        (
            BernoulliSettings {
                jump_rate_hz: f64::INFINITY,
                ..good
            },
            "jump_rate_hz",
        ),
        (
            BernoulliSettings {
                birth_density: -0.1,
                ..good
            },
            "birth_density",
        ),
        (
            BernoulliSettings {
                birth_velocity_sigma_mps: -0.1,
                ..good
            },
            "birth_velocity_sigma_mps",
        ),
    ] {
        let error = BernoulliFilter::new(settings, Draws::new(1, 0)).unwrap_err();
        assert!(error.to_string().starts_with(name), "{error}");
    }
    let mut filter = filter(good, 1);
    assert!(filter.start(&START, 1.5).is_err());
    assert!(
        filter
            .start(
                &GaussianStart {
                    position_m: [f64::NAN; 3],
                    ..START
                },
                0.5
            )
            .is_err()
    );
}

/// Weights sum to one, covariances are positive semidefinite, existence is a probability, nothing is NaN.
fn check_sane(filter: &BernoulliFilter) -> Result<(), TestCaseError> {
    let (existence, located) = (filter.existence(), filter.located());
    prop_assert!((0.0..=1.0).contains(&existence), "{}", existence);
    prop_assert!(
        (0.0..=existence).contains(&located),
        "{} {}",
        located,
        existence
    );
    let sum: f64 = filter.weights().iter().sum();
    prop_assert!((sum - 1.0).abs() < 1e-9, "{}", sum);
    prop_assert!(filter.weights().iter().all(|w| *w >= 0.0));
    prop_assert!(
        filter
            .particles()
            .columns()
            .iter()
            .flatten()
            .all(|v| v.is_finite())
    );
    if let Some(estimate) = filter.estimate(0.1) {
        let covariance = matrix(estimate.covariance_m2);
        let least = covariance.symmetric_eigenvalues().min();
        prop_assert!(least >= -1e-12 * covariance.trace(), "{:?}", estimate);
        let velocity = estimate.velocity_mps.unwrap_or_default();
        let numbers = [estimate.position_m, velocity, estimate.best_position_m];
        prop_assert!(numbers.as_flattened().iter().all(|v| v.is_finite()));
        prop_assert!(estimate.effective_sample_size >= 1.0 - 1e-9);
    }
    let within = filter.weight_within([0.0; 3], 2.0);
    prop_assert!((0.0..=1.0).contains(&within));
    Ok(())
}

fn number() -> impl Strategy<Value = f64> {
    prop_oneof![
        12 => -5.0..5.0_f64,
        1 => Just(0.0),
        1 => Just(f64::NAN),
        1 => Just(f64::INFINITY),
        1 => Just(-1e300),
        1 => Just(1e-200),
        1 => Just(9e5),
    ]
}

fn log_ratio() -> impl Strategy<Value = f32> {
    prop_oneof![
        8 => -600.0..600.0_f32,
        1 => Just(f32::NAN),
        1 => Just(f32::NEG_INFINITY),
        1 => Just(f32::INFINITY),
        1 => Just(f32::MAX),
        1 => Just(f32::MIN),
    ]
}

fn peak() -> impl Strategy<Value = Peak> {
    let numbers = || prop::array::uniform3(number());
    (numbers(), numbers(), numbers(), number()).prop_map(
        |(position_m, [a, b, c], [d, e, f], log_evidence)| Peak {
            position_m,
            covariance_m2: [a, b, c, d, e, f],
            log_evidence,
        },
    )
}

fn motion() -> impl Strategy<Value = Motion> {
    prop_oneof![
        Just(velocity()),
        Just(velocity().in_plane()),
        Just(walk(0.5)),
        Just(walk(0.0)),
        Just(walk(1e9).in_plane()),
    ]
}

proptest! {
    #[test]
    fn nothing_that_is_given_breaks_it(
        motion in motion(),
        rates_hz in prop::array::uniform3(prop_oneof![0.0..2.0_f64, Just(0.0), Just(1e9)]),
        birth_density in prop_oneof![0.0..2.0_f64, Just(0.0)],
        starts in any::<bool>(),
        steps in prop::collection::vec(
            (
                prop_oneof![6 => 0.0..0.5_f64, 1 => Just(f64::NAN), 1 => Just(-1.0), 1 => Just(f64::INFINITY)],
                prop::collection::vec(peak(), 0..4),
                prop::collection::vec(log_ratio(), 1..5),
            ),
            1..8,
        ),
    ) {
        let [birth_rate_hz, death_rate_hz, jump_rate_hz] = rates_hz;
        let settings = BernoulliSettings {
            particle_count: 37,
            motion,
            birth_rate_hz,
            death_rate_hz,
            jump_rate_hz,
            birth_density,
            birth_velocity_sigma_mps: 1.0,
        };
        let mut filter = filter(settings, 9);
        if starts {
            filter.start(&START, 0.8).unwrap();
        }
        for (dt_s, peaks, log_ratios) in steps {
            filter.predict(dt_s);
            check_sane(&filter)?;
            filter.update(&peaks, |_, out| {
                for (out, log_ratio) in out.iter_mut().zip(log_ratios.iter().cycle()) {
                    *out = *log_ratio;
                }
            });
            check_sane(&filter)?;
        }
    }
}
