//! Measurements of other sensors: against a Kalman filter where they are linear, against weighted samples where they are not, and whether covariances are right.

use nalgebra::{DMatrix, DVector, Matrix3, Vector3};
use pardalis_core::rng::{Draws, Stage};
use pardalis_filter::Measurement;
use pardalis_filter::bernoulli::{BernoulliFilter, Measured};
use pardalis_filter::estimate::StateEstimate;

use super::kalman::check_unbiased;
use super::{
    DENSITY_M2PS3, PARTICLES, START, certain, entries, filter, lively, matrix, slanted, velocity,
    walk,
};

const NONE_M2: [f64; 6] = [0.0; 6];
/// The standard deviations at which 99.9 % of a normal distribution lie on both sides.
const SIGMAS: f64 = 3.29;

/// A plain Kalman filter of position and velocity.
struct Naive {
    mean: DVector<f64>,
    covariance: DMatrix<f64>,
}

impl Naive {
    fn new() -> Self {
        let mut covariance = DMatrix::zeros(6, 6);
        for axis in 0..3 {
            covariance[(axis, axis)] = START.covariance_m2[[0, 3, 5][axis]];
            covariance[(axis + 3, axis + 3)] = START.velocity_sigma_mps[axis].powi(2);
        }
        let mean = START.position_m.into_iter().chain(START.velocity_mps);
        Self {
            mean: DVector::from_iterator(6, mean),
            covariance,
        }
    }

    fn predict(&mut self, dt_s: f64) {
        let mut f = DMatrix::identity(6, 6);
        for axis in 0..3 {
            f[(axis, axis + 3)] = dt_s;
        }
        self.mean = &f * &self.mean;
        self.covariance = &f * &self.covariance * f.transpose();
        for axis in 0..3 {
            let (x, v) = (axis, axis + 3);
            self.covariance[(x, x)] += DENSITY_M2PS3 * dt_s.powi(3) / 3.0;
            self.covariance[(x, v)] += DENSITY_M2PS3 * dt_s.powi(2) / 2.0;
            self.covariance[(v, x)] += DENSITY_M2PS3 * dt_s.powi(2) / 2.0;
            self.covariance[(v, v)] += DENSITY_M2PS3 * dt_s;
        }
    }

    /// Takes these rows of the state, of which each has a value.
    fn update(&mut self, rows: &[(usize, f64)], noise: &Matrix3<f64>) {
        let h = DMatrix::from_fn(rows.len(), 6, |i, column| f64::from(rows[i].0 == column));
        let measured = DVector::from_iterator(rows.len(), rows.iter().map(|(_, value)| *value));
        let noise = DMatrix::from_fn(rows.len(), rows.len(), |i, j| {
            noise[(rows[i].0 % 3, rows[j].0 % 3)]
        });
        let expected = &h * &self.covariance * h.transpose() + noise;
        let gain = &self.covariance * h.transpose() * expected.try_inverse().unwrap();
        self.mean += &gain * (measured - &h * &self.mean);
        self.covariance = (DMatrix::identity(6, 6) - gain * h) * &self.covariance;
    }
}

/// Standard normal numbers of this step and seed.
fn noise(seed: u32, step: usize, stage: Stage) -> Vector3<f64> {
    let [x, y, z, _] = Draws::new(seed, 9).normals(step as u32, 0, stage, 0);
    Vector3::new(x.into(), y.into(), z.into())
}

fn started(seed: u32) -> BernoulliFilter {
    let mut filter = filter(&certain(velocity()), seed);
    filter.start(&START, 1.0).unwrap();
    filter
}

/// Returns what is measured at a step: coordinates of the state, with a covariance.
fn linear(step: usize, precision: f64) -> (Vec<(usize, f64)>, Matrix3<f64>) {
    let time_s = 0.05 * step as f64;
    let covariance = slanted(0.1 * precision, 0.05 * precision);
    let off = covariance.cholesky().unwrap().l() * noise(5, step, Stage::Clock);
    let state = |row: usize| match row {
        0..3 => START.position_m[row] + START.velocity_mps[row] * time_s + off[row],
        _ => START.velocity_mps[row - 3] + off[row - 3],
    };
    let rows: &[usize] = match step % 4 {
        0 => &[0, 1, 2],
        1 => &[1],
        2 => &[3, 5],
        _ => &[3, 4, 5],
    };
    let rows = rows.iter().map(|&row| (row, state(row))).collect();
    (rows, covariance)
}

fn measurement(rows: &[(usize, f64)], noise: &Matrix3<f64>) -> Measurement {
    let mut values = [None; 3];
    for (row, value) in rows {
        values[row % 3] = Some(*value);
    }
    let made = if rows[0].0 < 3 {
        Measurement::position(0.0, values, entries(noise))
    } else {
        Measurement::velocity(0.0, values, entries(noise))
    };
    made.unwrap()
}

#[test]
fn positions_and_velocities_agree_with_a_kalman_filter() {
    const SEEDS: u32 = 60;
    for precision in [1.0, 4.0, 0.3] {
        let mut naive = Naive::new();
        let mut filters: Vec<_> = (0..SEEDS).map(started).collect();
        for step in 0..40 {
            let (rows, covariance) = linear(step, precision);
            naive.predict(0.05);
            naive.update(&rows, &covariance);
            let measurement = measurement(&rows, &covariance);
            let mut estimates: Vec<StateEstimate> = Vec::new();
            for filter in &mut filters {
                filter.predict(0.05);
                assert_eq!(
                    filter.measure(&measurement, 0.0, NONE_M2),
                    Measured::Used,
                    "{precision} {step}"
                );
                estimates.push(filter.estimate(0.0).unwrap());
            }
            let mut total = Matrix3::zeros();
            for estimate in &estimates {
                let off = Vector3::from(estimate.position_m) - naive.mean.fixed_rows::<3>(0);
                total +=
                    (matrix(estimate.covariance_m2) + off * off.transpose()) / f64::from(SEEDS);
            }
            for axis in 0..3 {
                let place = format!("precision {precision}, step {step}, axis {axis}");
                let variance = naive.covariance[(axis, axis)];
                let values: Vec<f64> = estimates.iter().map(|e| e.position_m[axis]).collect();
                let scatter = check_unbiased(&values, naive.mean[axis], variance.sqrt(), &place);
                assert!(scatter < 8.0, "{place}: {scatter}");
                let ratio = total[(axis, axis)] / variance;
                assert!((ratio - 1.0).abs() < 0.12, "{place}: {ratio}");
                let sigma = naive.covariance[(axis + 3, axis + 3)].sqrt();
                let values = estimates.iter().map(|e| e.velocity_mps.unwrap()[axis]);
                let values: Vec<f64> = values.collect();
                check_unbiased(&values, naive.mean[axis + 3], sigma, &place);
            }
        }
    }
}

#[test]
fn late_measurements_are_worth_almost_as_much() {
    const SEEDS: u32 = 60;
    let covariance = slanted(0.03, 0.02);
    // Measured 40 ms before the end, and told at the end.
    let mut naive = Naive::new();
    naive.predict(0.3);
    let rows: Vec<_> = (0..3).map(|axis| (axis, naive.mean[axis] + 0.05)).collect();
    naive.update(&rows, &covariance);
    naive.predict(0.04);
    let estimates: Vec<_> = (0..SEEDS)
        .map(|seed| {
            let mut filter = started(seed);
            filter.predict(0.34);
            let measurement = measurement(&rows, &covariance);
            assert_eq!(filter.measure(&measurement, 0.04, NONE_M2), Measured::Used);
            filter.estimate(0.0).unwrap()
        })
        .collect();
    for axis in 0..3 {
        let sigma = naive.covariance[(axis, axis)].sqrt();
        let mean = |value: &dyn Fn(&StateEstimate) -> f64| {
            estimates.iter().map(value).sum::<f64>() / f64::from(SEEDS)
        };
        let found = mean(&|estimate| estimate.position_m[axis]);
        assert!(
            (found - naive.mean[axis]).abs() < 0.1 * sigma,
            "{axis}: {found} {}",
            naive.mean
        );
        // What happened in the 40 ms counts twice.
        let variance = mean(&|estimate| estimate.covariance_m2[[0, 3, 5][axis]]);
        let ratio = variance / sigma.powi(2);
        assert!((0.97..1.2).contains(&ratio), "{axis}: {ratio}");
        let speed = mean(&|estimate| estimate.velocity_mps.unwrap()[axis]);
        assert!(
            (speed - naive.mean[axis + 3]).abs() < 0.02,
            "{axis}: {speed} {}",
            naive.mean
        );
        // Without the time, it would be taken for the position now.
        assert!(
            axis == 1 || (found - rows[axis].1).abs() > 0.005,
            "{axis}: {found}"
        );
    }
}

/// Compares the filter after a measurement with samples of its prediction, weighted by the plain likelihood.
fn check_against_samples(
    measured: &Measurement,
    log_likelihood: impl Fn(Vector3<f64>) -> f64,
    [most_off, most_wide]: [f64; 2],
) {
    const SEEDS: u32 = 40;
    let mut prior = Naive::new();
    prior.predict(0.3);
    let factor = prior.covariance.clone().cholesky().unwrap().l();
    let (mut sum, mut mean, mut square) = (0.0, Vector3::zeros(), Matrix3::zeros());
    let mut speed = Vector3::zeros();
    for sample in 0..200_000 {
        let [a, b] = [Stage::Clock, Stage::Drift].map(|stage| noise(3, sample, stage));
        let normal = DVector::from_iterator(6, a.iter().chain(b.iter()).copied());
        let state = &prior.mean + &factor * normal;
        let x = Vector3::new(state[0], state[1], state[2]);
        let weight = log_likelihood(x).exp();
        sum += weight;
        mean += weight * x;
        square += weight * x * x.transpose();
        speed += weight * Vector3::new(state[3], state[4], state[5]);
    }
    let (mean, speed) = (mean / sum, speed / sum);
    let covariance = square / sum - mean * mean.transpose();
    let (mut found, mut total, mut found_speed) =
        (Vector3::zeros(), Matrix3::zeros(), Vector3::zeros());
    for seed in 0..SEEDS {
        let mut filter = started(seed);
        filter.predict(0.3);
        assert_eq!(filter.measure(measured, 0.0, NONE_M2), Measured::Used);
        let estimate = filter.estimate(0.0).unwrap();
        let off = Vector3::from(estimate.position_m) - mean;
        found += Vector3::from(estimate.position_m) / f64::from(SEEDS);
        found_speed += Vector3::from(estimate.velocity_mps.unwrap()) / f64::from(SEEDS);
        total += (matrix(estimate.covariance_m2) + off * off.transpose()) / f64::from(SEEDS);
    }
    let whitening = covariance.cholesky().unwrap().l().try_inverse().unwrap();
    let off = whitening * (found - mean);
    let widths = (whitening * total * whitening.transpose()).symmetric_eigenvalues();
    assert!(off.norm() < most_off, "{measured:?}: {off}");
    assert!(
        widths.min() > 0.9 && widths.max() < most_wide,
        "{measured:?}: {widths}"
    );
    // The velocity's standard deviation is 0.9 m/s.
    assert!(
        (found_speed - speed).norm() < 0.9 * most_off,
        "{found_speed} {speed}"
    );
}

#[test]
fn ranges_and_bearings_agree_with_weighted_samples() {
    let truth = Vector3::new(1.25, -0.6, 2.15);
    // From a sensor that is far in comparison with the prediction's spread; and from one at five times the spread, where the second order does not suffice: the estimate is
    // less good than it could be, but says so.
    for (from, most) in [
        (Vector3::new(-3.0, 1.5, 1.0), [0.1, 1.15]),
        (Vector3::new(0.2, 0.3, 2.0), [0.35, 1.5]),
    ] {
        let direction = truth - from;
        let range_m = direction.norm();
        let range = Measurement::range(0.0, from.into(), range_m, 0.03).unwrap();
        let likelihood = |x: Vector3<f64>| -0.5 * (((x - from).norm() - range_m) / 0.03).powi(2);
        check_against_samples(&range, likelihood, most);
        let bearing = Measurement::bearing(0.0, from.into(), direction.into(), 0.05).unwrap();
        let likelihood = |x: Vector3<f64>| {
            let cos = (x - from).normalize().dot(&direction.normalize());
            -0.5 * (cos.min(1.0).acos() / 0.05).powi(2)
        };
        check_against_samples(&bearing, likelihood, most);
    }
}

/// Runs a simulated target past sensors of all kinds, of which some are late. Returns the NEES of its position at the end of each second.
fn nees_of_run(seed: u32) -> Vec<f64> {
    const DT_S: f64 = 0.04;
    let mut filter = started(seed);
    let deviations = Vector3::from([0, 3, 5].map(|i| START.covariance_m2[i].sqrt()));
    let start = noise(seed, 1000, Stage::Clock).component_mul(&deviations);
    let mut x = Vector3::from(START.position_m) + start;
    let deviations = Vector3::from(START.velocity_sigma_mps);
    let faster = noise(seed, 1000, Stage::Drift).component_mul(&deviations);
    let mut v = Vector3::from(START.velocity_mps) + faster;
    let mut all = Vec::new();
    let (from, side) = (Vector3::new(-2.0, 1.0, 1.0), Vector3::new(3.0, 3.0, 0.0));
    for step in 0..75 {
        let (a, b) = (
            noise(seed, step, Stage::Clock),
            noise(seed, step, Stage::Drift),
        );
        // The covariance of position and velocity noise.
        let [q, t] = [DENSITY_M2PS3, DT_S];
        let before_x = x;
        x += v * t + (q * t.powi(3) / 3.0).sqrt() * a;
        v += (q * t).sqrt() * (0.75_f64.sqrt() * a + 0.5 * b);
        filter.predict(DT_S);
        let errors = noise(seed, step, Stage::Box);
        let at = |x: Vector3<f64>, sigma: f64| {
            let place = (x + sigma * errors).map(Some).into();
            let variance = sigma * sigma;
            Measurement::position(0.0, place, [variance, 0.0, 0.0, variance, 0.0, variance])
        };
        let (measurement, ago_s) = match step % 5 {
            0 => {
                let range_m = (x - from).norm() + 0.05 * errors.x;
                (Measurement::range(0.0, from.into(), range_m, 0.05), 0.0)
            }
            1 => {
                let way = x - side;
                let first = way.cross(&Vector3::z()).normalize();
                let across = errors.x * first + errors.y * way.normalize().cross(&first);
                let way = way + 0.02 * way.norm() * across;
                (
                    Measurement::bearing(0.0, side.into(), way.into(), 0.02),
                    0.0,
                )
            }
            2 => {
                let speed = v + 0.2 * errors;
                let measured = [Some(speed.x), None, Some(speed.z)];
                (
                    Measurement::velocity(0.0, measured, [0.04, 0.0, 0.0, 0.0, 0.0, 0.04]),
                    0.0,
                )
            }
            3 => (at(before_x, 0.1), DT_S),
            _ => continue,
        };
        filter.measure(&measurement.unwrap(), ago_s, NONE_M2);
        if step % 25 == 23 {
            let estimate = filter.estimate(0.0).unwrap();
            let off = x - Vector3::from(estimate.position_m);
            let information = matrix(estimate.covariance_m2).try_inverse().unwrap();
            all.push(off.dot(&(information * off)));
        }
    }
    all
}

#[test]
fn covariances_are_right_over_many_runs() {
    const RUNS: u32 = 200;
    let runs: Vec<_> = (0..RUNS).map(nees_of_run).collect();
    for time in 0..3 {
        let mean = runs.iter().map(|run| run[time]).sum::<f64>() / f64::from(RUNS);
        // The mean of chi-square numbers with three degrees of freedom.
        let allowed = SIGMAS * (6.0 / f64::from(RUNS)).sqrt();
        assert!(
            (mean - 3.0).abs() < allowed,
            "{time}: {mean}, allowed {allowed}"
        );
    }
}

#[test]
fn what_is_very_uncertain_changes_nothing_and_what_is_precise_decides() {
    let position = |sigma_m: f64| {
        let variance = sigma_m * sigma_m;
        let at = [Some(1.3), Some(-0.4), Some(2.1)];
        Measurement::position(0.0, at, [variance, 0.0, 0.0, variance, 0.0, variance]).unwrap()
    };
    let far = [0.0, 0.0, 50.0];
    for vague in [
        position(1e4),
        Measurement::velocity(0.0, [Some(3.0), None, None], [1e8; 6]).unwrap(),
        Measurement::range(0.0, far, 49.0, 1e4).unwrap(),
        Measurement::bearing(0.0, far, [0.0, 0.1, -1.0], 1e3).unwrap(),
    ] {
        let mut filter = started(1);
        filter.predict(0.2);
        let before = filter.estimate(0.0).unwrap();
        assert_eq!(filter.measure(&vague, 0.0, NONE_M2), Measured::Used);
        let after = filter.estimate(0.0).unwrap();
        for axis in 0..3 {
            assert!((after.position_m[axis] - before.position_m[axis]).abs() < 1e-6);
        }
        for (after, before) in after.covariance_m2.iter().zip(before.covariance_m2) {
            assert!((after - before).abs() < 1e-6);
        }
    }
    for sigma_m in [0.03, 0.003, 0.0003] {
        let mut filter = started(1);
        filter.predict(0.2);
        assert_eq!(
            filter.measure(&position(sigma_m), 0.0, NONE_M2),
            Measured::Used
        );
        let after = filter.estimate(0.0).unwrap();
        for (axis, expected) in [1.3, -0.4, 2.1].into_iter().enumerate() {
            let off = (after.position_m[axis] - expected).abs();
            assert!(off < 0.6 * sigma_m, "{sigma_m}: {off}");
            let sigma = after.covariance_m2[[0, 3, 5][axis]].sqrt();
            assert!((sigma / sigma_m - 0.95).abs() < 0.15, "{sigma_m}: {sigma}");
        }
        assert!(
            after.effective_sample_size > 0.1 * PARTICLES as f64,
            "{after:?}"
        );
    }
}

#[test]
fn outliers_change_nothing_and_only_they_are_rejected() {
    let mut counts = [0; 2];
    for seed in 0..40 {
        for step in 0..50 {
            let mut filter = started(seed);
            filter.predict(0.2);
            let before = format!("{:?}", filter.estimate(0.0));
            let mut prior = Naive::new();
            prior.predict(0.2);
            let errors = noise(seed, step, Stage::Box);
            // A measurement of the target, and one of something else.
            for (number, off_m) in [0.0, 2.0].into_iter().enumerate() {
                let place = Vector3::from_fn(|axis, _| {
                    let sigma = (prior.covariance[(axis, axis)] + 0.01).sqrt();
                    prior.mean[axis] + sigma * errors[axis] + off_m
                });
                let variances = [0.01, 0.0, 0.0, 0.01, 0.0, 0.01];
                let place = Measurement::position(0.0, place.map(Some).into(), variances).unwrap();
                if filter.measure(&place, 0.0, NONE_M2) == Measured::Rejected {
                    counts[number] += 1;
                    assert_eq!(format!("{:?}", filter.estimate(0.0)), before);
                } else {
                    break;
                }
            }
        }
    }
    // One in a thousand of 2000, and all others.
    assert!(counts[0] <= 8 && counts[1] == counts[0], "{counts:?}");
    let mut filter = started(1);
    filter.predict(0.2);
    let place = [Some(3.0), Some(-0.5), Some(2.3)];
    let place = Measurement::position(0.0, place, [1e-4, 0.0, 0.0, 1e-4, 0.0, 1e-4]).unwrap();
    assert_eq!(filter.measure(&place, 0.0, NONE_M2), Measured::Rejected);
    // Unless the prediction may be that far off for other reasons.
    let shared_m2 = [1.0, 0.0, 0.0, 0.0, 0.0, 0.0];
    assert_eq!(filter.measure(&place, 0.0, shared_m2), Measured::Used);
}

#[test]
fn existence_stays_as_predicted() {
    let mut filter = filter(&lively(), 2);
    let place = Measurement::range(0.0, [0.0; 3], 2.5, 0.1).unwrap();
    assert_eq!(filter.measure(&place, 0.0, NONE_M2), Measured::NoTarget);
    filter.start(&START, 0.7).unwrap();
    filter.predict(0.5);
    let predicted = filter.existence();
    assert!(predicted != 0.7);
    for from_m in [[0.0; 3], [2.0, 3.0, 0.0]] {
        let range_m = (Vector3::from(START.position_m) - Vector3::from(from_m)).norm();
        let place = Measurement::range(0.0, from_m, range_m, 0.1).unwrap();
        assert_eq!(filter.measure(&place, 0.0, NONE_M2), Measured::Used);
        assert_eq!(filter.existence(), predicted);
    }
}

#[test]
fn in_a_plane_the_height_stays() {
    for motion in [velocity().in_plane(), walk(0.1).in_plane()] {
        let mut filter = filter(&certain(motion), 3);
        filter.start(&START, 1.0).unwrap();
        let variances = [4e-4, 0.0, 0.0, 4e-4, 0.0, 4e-4];
        let to = [1.2, -0.5];
        // Its height is another, because it is known.
        let place = [Some(to[0]), Some(to[1]), Some(7.0)];
        let place = Measurement::position(0.0, place, variances).unwrap();
        let from_m = [1.2, 4.5, 2.3];
        let range = Measurement::range(0.0, from_m, 5.0, 0.02).unwrap();
        for measurement in [place, range, place] {
            filter.predict(0.1);
            assert_eq!(filter.measure(&measurement, 0.0, NONE_M2), Measured::Used);
        }
        let estimate = filter.estimate(0.0).unwrap();
        // But for the sum of the weights.
        assert!((estimate.position_m[2] - START.position_m[2]).abs() < 1e-12);
        let heights = filter.particles().positions_m()[2];
        assert!(heights.iter().all(|z| *z == START.position_m[2] as f32));
        assert!(
            [2, 4, 5]
                .iter()
                .all(|&i| estimate.covariance_m2[i].abs() < 1e-20)
        );
        for (axis, to) in to.into_iter().enumerate() {
            let off = estimate.position_m[axis] - to;
            let sigma = estimate.covariance_m2[[0, 3][axis]].sqrt();
            assert!(
                off.abs() < 0.03 && sigma < 0.02 && sigma > 0.005,
                "{off} {sigma}"
            );
        }
    }
}
