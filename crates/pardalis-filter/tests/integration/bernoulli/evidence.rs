//! Effects of measurement components and likelihoods on existence and weights, compared with recursions and integrals
//! computed separately.

use std::cell::RefCell;
use std::f64::consts::PI;

use nalgebra::{Matrix3, Vector3};
use pardalis_filter::Particles;
use pardalis_filter::bernoulli::{BernoulliFilter, BernoulliSettings, MeasurementComponent};
use pardalis_filter::gaussian::GaussianStart;

use super::{
    DENSITY_M2PS3, PARTICLES, START, certain, entries, filter, gaussian_ratio, lively, silent,
    slanted, velocity, walk,
};

/// A start at a single position with a single velocity variance, so that all particles have the same prediction.
const POINT_START: GaussianStart = GaussianStart {
    covariance_m2: [0.0; 6],
    velocity_sigma_mps: [0.4; 3],
    ..START
};

/// Returns the mean and the variance of the prediction of every particle from [`POINT_START`] after `dt_s` seconds.
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

/// Returns the probabilities that the target is where the particles predict it, and elsewhere, after `dt_s` seconds
/// with [`lively`] settings.
fn located_and_elsewhere(existence: f64, dt_s: f64) -> (f64, f64) {
    // Euler's method in small steps, for the equation that the filter solves in one.
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
    let mut tracked = filter(&lively(), 1);
    tracked.start(&START, 0.6).unwrap();
    let mut expected = 0.6;
    for step in 0..30 {
        let log_ratio = [0.7, -1.5, 0.0, 2.0, -0.5][step % 5];
        tracked.predict(0.25);
        let (located, elsewhere) = located_and_elsewhere(expected, 0.25);
        let error =
            (tracked.located() - located).abs() + (tracked.existence() - located - elsewhere).abs();
        assert!(error < 1e-6, "step {step}");
        tracked.update(&[], f64::INFINITY, |_, out| out.fill(log_ratio));
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
fn existence_follows_the_evidence_and_stays_without_any() {
    let mut steady = filter(&certain(velocity()), 1);
    steady.start(&START, 0.4).unwrap();
    for _ in 0..50 {
        steady.predict(0.04);
        steady.update(&[], f64::INFINITY, silent);
        assert!(
            (steady.existence() - 0.4).abs() < 1e-12,
            "{}",
            steady.existence()
        );
    }
    // However certain existence was, strong evidence soon changes it, in either direction.
    let mut lost = filter(&lively(), 1);
    lost.start(&START, 1.0).unwrap();
    for log_ratio in [500.0, 500.0, -500.0] {
        lost.predict(0.04);
        lost.update(&[], f64::INFINITY, |_, out| out.fill(log_ratio));
        assert!((lost.existence() > 0.99) == (log_ratio > 0.0));
    }
    assert!(lost.existence() > 0.0 && lost.existence() < 1e-200);
    // If all particles are impossible, the target certainly does not exist and has no estimate.
    lost.predict(0.04);
    lost.update(&[], f64::INFINITY, |_, out| out.fill(f32::NEG_INFINITY));
    assert_eq!((lost.existence(), lost.estimate(0.0)), (0.0, None));
    // A target that certainly exists remains as predicted if the images contradict it.
    let mut certain = filter(&certain(velocity()), 1);
    certain.start(&START, 1.0).unwrap();
    certain.predict(0.1);
    let before = (certain.estimate(0.0), certain.particles().clone());
    certain.update(&[], f64::INFINITY, |_, out| out.fill(f32::NEG_INFINITY));
    assert_eq!((certain.estimate(0.0), certain.particles().clone()), before);
    assert_eq!(certain.existence(), 1.0);
}

#[test]
fn evidence_for_existence_is_limited() {
    let (free, bounded) = (f64::INFINITY, 0.4);
    let [free, bounded] = [free, bounded].map(|most_nats| {
        let mut filter = filter(&lively(), 1);
        filter.start(&START, 0.6).unwrap();
        filter.predict(0.25);
        let place = Vector3::from(START.position_m);
        filter.update(
            &[],
            most_nats,
            gaussian_ratio(place, slanted(0.1, 0.02), 5.0),
        );
        filter
    });
    assert_eq!(free.estimate(0.0), bounded.estimate(0.0));
    assert!(free.existence() > 0.99);
    let (located, elsewhere) = located_and_elsewhere(0.6, 0.25);
    let exists = located + elsewhere;
    let there = exists * 0.4_f64.exp();
    let expected = there / (1.0 - exists + there);
    assert!((bounded.existence() - expected).abs() < 1e-5);
}

#[test]
fn the_predicted_density_is_that_of_the_mixture() {
    let mut settings = certain(velocity());
    settings.velocity_jump_rate_hz = 0.0;
    let mut tracked = filter(&settings, 1);
    let nowhere = tracked.predicted_density(START.position_m, &slanted(0.2, 0.03));
    assert_eq!(nowhere, 0.0);
    tracked.start(&POINT_START, 1.0).unwrap();
    tracked.predict(0.3);
    let (mean, variance) = predicted(0.3);
    for (off, along) in [(0.0, 0.2), (0.1, 0.05), (0.4, 0.3)] {
        let covariance = slanted(along, 0.03);
        let place = mean + Vector3::new(off, -0.5 * off, 0.2 * off);
        let found = tracked.predicted_density(place.into(), &covariance);
        let both = covariance + Matrix3::from_diagonal_element(variance);
        let expected = density(place, mean, both);
        assert!(
            (found / expected - 1.0).abs() < 1e-5,
            "{found} for {expected}"
        );
    }
    // With velocity jumps, a part of the prediction is wider.
    let (rate_hz, sigma_mps, dt_s) = (2.0, 3.0, 0.3_f64);
    settings.velocity_jump_rate_hz = rate_hz;
    settings.velocity_jump_sigma_mps = sigma_mps;
    let mut jumping = filter(&settings, 1);
    jumping.start(&POINT_START, 1.0).unwrap();
    jumping.predict(dt_s);
    let probability = 1.0 - (-rate_hz * dt_s).exp();
    // A jump at a random time in the step adds a third of the variance of one at its beginning.
    let wider = variance + sigma_mps.powi(2) * dt_s.powi(2) / 3.0;
    let place = mean + Vector3::new(0.1, 0.3, 0.0);
    let at = |variance| {
        density(
            place,
            mean,
            slanted(0.1, 0.02) + Matrix3::from_diagonal_element(variance),
        )
    };
    let expected = (1.0 - probability) * at(variance) + probability * at(wider);
    let found = jumping.predicted_density(place.into(), &slanted(0.1, 0.02));
    assert!(
        (found / expected - 1.0).abs() < 1e-5,
        "{found} for {expected}"
    );
}

#[test]
fn an_appearing_target_is_located_in_one_update() {
    let covariance = slanted(0.2, 0.02);
    let place = Vector3::new(-2.0, 3.0, 1.0);
    let component = MeasurementComponent {
        position_m: place.into(),
        covariance_m2: entries(&covariance),
        log_weight: 40.0,
    };
    for started in [false, true] {
        let mut settings = lively();
        settings.birth_velocity_sigma_mps = 0.8;
        let mut born = filter(&settings, 3);
        if started {
            born.start(&START, 0.9).unwrap();
        }
        born.predict(0.1);
        born.update(
            &[component],
            f64::INFINITY,
            gaussian_ratio(place, covariance, 40.0),
        );
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

/// Returns the growth of the variance of x over a time without images.
fn estimate_growth(filter: &BernoulliFilter, ahead_s: f64) -> f64 {
    let [now, later] = [0.0, ahead_s].map(|at| filter.estimate(at).unwrap().covariance_m2[0]);
    later - now
}

/// Runs one update from [`POINT_START`] with many seeds. Compares the means of the odds of existence, and of the
/// share of the weight around a point, with exact values within their standard errors.
fn check_one_update(
    settings: &BernoulliSettings,
    components: &[MeasurementComponent],
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
        filter.update(components, f64::INFINITY, &log_ratios);
        let existence = filter.existence();
        odds.push(existence / (1.0 - existence));
        if let Some((near_m, _)) = near {
            shares.push(filter.weight_within(near_m.into(), 1.0));
        }
    }
    check_mean(&odds, exact_odds, 0.0);
    if let Some((_, exact)) = near {
        // Weights normalised by their own sum have a bias of 1/N.
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
    // The test must be sensitive enough.
    assert!(allowed < 0.05 * exact, "{allowed} of {exact}");
}

#[test]
fn predictions_and_births_are_weighted_by_their_densities() {
    let settings = lively();
    let covariance = slanted(0.06, 0.01);
    let (mean, variance) = predicted(0.2);
    let near = mean + Vector3::new(0.2, 0.1, -0.1);
    let far = mean + Vector3::new(3.0, -2.0, 1.0);
    let (located, elsewhere) = located_and_elsewhere(0.7, 0.2);
    let absent = 1.0 - located - elsewhere;
    let continued = located * density(near, mean, covariance + Matrix3::identity() * variance);
    let born = elsewhere * settings.birth_density;
    let component_at = |position_m: Vector3<f64>| MeasurementComponent {
        position_m: position_m.into(),
        covariance_m2: entries(&covariance),
        log_weight: 2.0,
    };
    let plus = 2.0;
    let gain = f64::exp(plus) / absent;
    // Both with equal evidence. A birth may be at either of them.
    let [at_near, at_far] = [near, far].map(|place| gaussian_ratio(place, covariance, plus));
    let mut from_far = vec![0.0; PARTICLES];
    let both = RefCell::new(&mut from_far);
    check_one_update(
        &settings,
        &[component_at(far), component_at(near)],
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
    // The images support a component that does not agree with the prediction.
    let beyond = mean + Vector3::new(0.8, -0.5, 0.4);
    let strong = MeasurementComponent {
        log_weight: 62.0,
        ..component_at(beyond)
    };
    check_one_update(
        &settings,
        &[strong, component_at(near)],
        gaussian_ratio(beyond, covariance, plus),
        gain * born,
        None,
    );
    // The far one alone: a birth or a relocation.
    check_one_update(
        &settings,
        &[component_at(far)],
        gaussian_ratio(far, covariance, plus),
        gain * born,
        Some((far, 1.0)),
    );
}

/// Number of cells of an integral, in either direction.
const CELLS: i32 = 20_000;

#[test]
fn wrong_components_do_not_bias_the_weights() {
    // A likelihood of x alone and its numerical integral; components that are shifted, too precise, or arbitrary.
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
    let component = |dx: f64, width_m: f64, log_weight: f64| MeasurementComponent {
        position_m: (mean + Vector3::new(dx, -dx, 0.5 * dx)).into(),
        covariance_m2: entries(&slanted(width_m, width_m / 4.0)),
        log_weight,
    };
    let wrong = [
        component(0.1, 0.05, 5.0),
        component(-0.15, 0.3, 2.0),
        component(4.0, 1.0, -200.0),
    ];
    let settings = certain(velocity());
    for components in [&wrong[..], &wrong[..1], &[]] {
        check_one_update(
            &settings,
            components,
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
fn the_predicted_density_in_a_plane_is_per_square_metre() {
    let mut flat = filter(&certain(walk(0.2).in_plane()), 1);
    flat.start(&POINT_START, 1.0).unwrap();
    flat.predict(0.5);
    let [x, y, z] = START.position_m;
    let found = flat.predicted_density([x + 0.2, y, z + 9.0], &slanted(0.3, 0.1));
    let covariance =
        slanted(0.3, 0.1).fixed_view::<2, 2>(0, 0) + nalgebra::Matrix2::identity() * 0.1;
    let off = nalgebra::Vector2::new(0.2, 0.0);
    let squared = off.dot(&(covariance.try_inverse().unwrap() * off));
    let expected = (-0.5 * squared).exp() / (2.0 * PI * covariance).determinant().sqrt();
    assert!(
        (found / expected - 1.0).abs() < 1e-5,
        "{found} for {expected}"
    );
}

#[test]
fn the_vertical_axis_is_ignored_in_a_plane() {
    let mut settings = lively();
    settings.motion = walk(0.3).in_plane();
    settings.birth_density = 0.05;
    let variance = 0.3 * 0.2;
    let mean = Vector3::from(START.position_m);
    let near = mean + Vector3::new(0.3, -0.1, 0.0);
    let (xx, xy, yy) = (0.004, 0.0035, 0.005);
    // The vertical covariances are arbitrary.
    let component = MeasurementComponent {
        position_m: [near.x, near.y, 1.25],
        covariance_m2: [xx, xy, 7.0, yy, -3.0, 0.0],
        log_weight: 0.0,
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
        &settings,
        &[component],
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
    let mut filter = filter(&settings, 1);
    filter.start(&START, 0.7).unwrap();
    filter.predict(0.1);
    filter.update(&[], f64::INFINITY, silent);
    let estimate = filter.estimate(0.3).unwrap();
    assert_eq!(estimate.velocity_mps, None);
    assert_eq!(filter.particles().columns().len(), 3);
    let [_, _, xz, _, yz, zz] = estimate.covariance_m2;
    assert!(estimate.position_m[2] == 2.3 || (estimate.position_m[2] - 2.3).abs() < 1e-12);
    assert!([xz, yz, zz].iter().all(|v| v.abs() < 1e-12), "{estimate:?}");
}

#[test]
fn where_the_target_is_said_not_to_be_it_is_no_longer() {
    let mut tracked = filter(&certain(velocity()), 1);
    tracked.start(&START, 0.9).unwrap();
    tracked.predict(0.1);
    tracked.update(&[], f64::INFINITY, |particles, out| {
        for (log_ratio, x) in out.iter_mut().zip(particles.positions_m()[0]) {
            *log_ratio = 0.2 * x;
        }
    });
    let existence = tracked.existence();
    let middle_m = tracked.estimate(0.0).unwrap().position_m[0];
    let kept = |position_m: [f64; 3]| position_m[0] > middle_m + 0.01;
    let before = tracked.particles().clone();
    let weights = tracked.weights().to_vec();
    let there = |i: &usize| kept(before.position_m(*i));
    let share: f64 = (0..weights.len()).filter(there).map(|i| weights[i]).sum();
    let mean_m = |axis: usize| -> f64 {
        let of_kept = (0..weights.len()).filter(there);
        of_kept
            .map(|i| weights[i] / share * before.position_m(i)[axis])
            .sum()
    };

    tracked.keep(|_| false);
    assert_eq!(
        (tracked.existence(), tracked.weights()),
        (existence, &weights[..])
    );
    tracked.keep(kept);
    assert!((0.2..0.8).contains(&share), "{share}");
    assert!((tracked.existence() - share * existence).abs() < 1e-12);
    let estimate = tracked.estimate(0.0).unwrap();
    for axis in 0..3 {
        // Particles are single-precision copies of what the filter keeps.
        assert!((estimate.position_m[axis] - mean_m(axis)).abs() < 1e-6);
    }
    assert!(kept(estimate.best_position_m));
    // Nobody is left of them in the next step either.
    tracked.predict(1e-9);
    tracked.update(&[], f64::INFINITY, |_, out| out.fill(0.0));
    let after = tracked.particles();
    let mut weighted = tracked.weights().iter().enumerate();
    assert!(
        weighted.all(|(i, weight)| *weight == 0.0 || kept(after.position_m(i).map(|x| x + 1e-5)))
    );
}
