use super::*;
use crate::smoother::smooth;
use pardalis_core::rng::{Draws, Stage};

const STEP_S: f64 = 0.04;

fn often_hit() -> ModeSettings {
    ModeSettings {
        hit_rate_hz: 1.0,
        ..ModeSettings::default()
    }
}

/// The covariance of a ball at a distance along x: uncertain in depth.
const COVARIANCE_M2: [f64; 6] = [0.0016, 0.0002, 0.0, 0.0004, 0.0, 0.0001];

/// Normally distributed numbers, and one that is evenly distributed between 0 and 1.
struct Random {
    draws: Draws,
    number: u32,
}

impl Random {
    fn normals(&mut self) -> Vector3<f64> {
        self.number += 1;
        let [x, y, z, _] = self.draws.normals(self.number, 0, Stage::Motion, 0);
        Vector3::new(x, y, z).map(f64::from)
    }

    fn chance(&mut self) -> f64 {
        self.number += 1;
        self.draws.uniform(self.number, 0, Stage::Resampling)
    }

    /// Normally distributed with a covariance.
    fn drawn(&mut self, covariance: &Matrix3<f64>) -> Vector3<f64> {
        covariance.cholesky().unwrap().l() * self.normals()
    }
}

/// A target that moves as the modes say, with many hits, and what is measured of it.
fn simulated(seed: u32, steps: u32) -> (Vec<Measured>, Vec<Vector6<f64>>) {
    let settings = often_hit();
    let mut random = Random {
        draws: Draws::new(seed, 0),
        number: 0,
    };
    let transition = settings.transition(STEP_S);
    let shares = settings.shares();
    let pick = |random: &mut Random, chances: &dyn Fn(usize) -> f64| {
        let mut left = random.chance();
        let picked = (0..MODES).find(|&mode| {
            left -= chances(mode);
            left < 0.0
        });
        picked.unwrap_or(MODES - 1)
    };
    let mut mode = pick(&mut random, &|mode| shares[mode]);
    let mut state = Vector6::zeros();
    let velocity_mps = settings.velocity_sigma_mps * random.normals();
    state.fixed_rows_mut::<3>(3).copy_from(&velocity_mps);
    let mut measured = Vec::new();
    let mut states = Vec::new();
    for step in 0..steps {
        if step > 0 {
            let before = mode;
            mode = pick(&mut random, &|to| transition[(before, to)]);
            let here = Gaussian {
                mean: state,
                covariance: Matrix6::zeros(),
            };
            let way = settings.ways.get(mode).or(settings.ways.get(before));
            let next = here.moved(way.unwrap_or(&settings.ways[0]), 3, STEP_S);
            let factor = next.covariance.cholesky().unwrap().l();
            let [a, b] = [random.normals(), random.normals()];
            state = next.mean + factor * Vector6::new(a.x, a.y, a.z, b.x, b.y, b.z);
            if HITS.contains(&mode) {
                let jump_mps = settings.hit_sigma_mps * random.normals();
                let left_s = if mode == HITS[0] {
                    random.chance() * STEP_S
                } else {
                    0.0
                };
                let mut velocity = state.fixed_rows_mut::<3>(3);
                velocity += jump_mps;
                let mut position = state.fixed_rows_mut::<3>(0);
                position += left_s * jump_mps;
            }
        }
        let at = state.fixed_rows::<3>(0) + random.drawn(&covariance_matrix(COVARIANCE_M2));
        let is_seen = step % 5 != 3;
        measured.push(Measured {
            time_s: STEP_S * f64::from(step),
            position: is_seen.then_some((at.into(), COVARIANCE_M2)),
        });
        states.push(state);
    }
    (measured, states)
}

#[test]
fn each_measurement_gives_what_smoothing_ends_with() {
    let (measured, _) = simulated(3, 40);
    let measured: Vec<Measured> = measured
        .into_iter()
        .filter(|m| m.position.is_some())
        .collect();
    let settings = often_hit();
    let mut filter = ModeFilter::new(settings.clone());
    assert_eq!(filter.estimate(0.0), None);
    for (number, one) in measured.iter().enumerate() {
        filter.observe(one.time_s, one.position.unwrap());
        let smoothed = smooth(&measured[..=number], &settings);
        assert_eq!(filter.estimate(one.time_s), smoothed[number]);
    }
    filter.reset();
    assert_eq!(filter.estimate(0.0), None);
}

/// Nothing that rolls begins to fall because it is not seen, and one long step is as good as many short ones.
#[test]
fn what_is_hidden_goes_on_as_before() {
    for settings in [ModeSettings::default(), ModeSettings::planar()] {
        let is_planar = settings.is_planar;
        let mut filter = ModeFilter::new(settings);
        for frame in 0..50 {
            let time_s = STEP_S * f64::from(frame);
            let mut covariance_m2 = [1e-4, 0.0, 0.0, 1e-4, 0.0, 1e-4];
            if is_planar {
                covariance_m2[5] = 0.0;
            }
            filter.observe(time_s, ([0.4 * time_s, 0.0, 0.11], covariance_m2));
        }
        let last_s = STEP_S * 49.0;
        let mut sigma_mps = 0.0;
        for ahead_s in [0.0, 0.04, 0.5, 2.0] {
            let state = filter.estimate(last_s + ahead_s).unwrap();
            let [vx, _, vz] = state.velocity_mps;
            // A little of it may fly.
            let fallen_mps = 0.02 * GRAVITY_MPS2 * ahead_s + 0.01;
            assert!(
                (vx - 0.4).abs() < 0.02 && vz.abs() < fallen_mps,
                "{ahead_s}: {state:?}"
            );
            let [xx, _, xz, _, yz, zz] = state.velocity_covariance_m2ps2;
            assert!(xx.sqrt() > sigma_mps, "{ahead_s}: {state:?}");
            sigma_mps = xx.sqrt();
            if is_planar {
                assert_eq!([xz, yz, zz, vz], [0.0; 4]);
            }
        }
        assert!((1.0..4.0).contains(&sigma_mps), "{sigma_mps}");
    }
}

/// Mean normalized squared errors of position and velocity, 3 each for an exact filter, and errors of the velocity are those of the model from which targets are drawn.
#[test]
fn targets_that_move_as_the_modes_say_are_as_certain_as_they_should_be() {
    let mut sums = [0.0; 2];
    let mut count = 0.0;
    for seed in 0..300 {
        let (measured, states) = simulated(seed, 30);
        let mut filter = ModeFilter::new(often_hit());
        for (one, truth) in measured.iter().zip(&states) {
            if let Some(position) = one.position {
                filter.observe(one.time_s, position);
            }
            let state = filter.estimate(one.time_s).unwrap();
            let parts = [
                (state.position_m, state.covariance_m2),
                (state.velocity_mps, state.velocity_covariance_m2ps2),
            ];
            for (part, (mean, covariance)) in parts.into_iter().enumerate() {
                let off = truth.fixed_rows::<3>(3 * part) - Vector3::from(mean);
                let inverse = covariance_matrix(covariance).try_inverse().unwrap();
                sums[part] += off.dot(&(inverse * off));
            }
            count += 1.0;
        }
    }
    let nees = sums.map(|sum| sum / count);
    for nees in nees {
        assert!((2.7..3.3).contains(&nees), "{nees:?}");
    }
}

#[test]
fn what_is_known_at_the_start_counts() {
    let start = GaussianStart {
        position_m: [1.0, 2.0, 3.0],
        covariance_m2: COVARIANCE_M2,
        velocity_mps: [2.0, 0.0, -1.0],
        velocity_sigma_mps: [0.1, 0.2, 0.3],
    };
    let mut filter = ModeFilter::new(ModeSettings::default());
    filter.begin(5.0, &start);
    let state = filter.estimate(5.0).unwrap();
    assert_eq!(state.position_m, start.position_m);
    assert_eq!(state.velocity_mps, start.velocity_mps);
    let known = [
        (state.covariance_m2, COVARIANCE_M2),
        (
            state.velocity_covariance_m2ps2,
            [0.01, 0.0, 0.0, 0.04, 0.0, 0.09],
        ),
    ];
    for (covariance, expected) in known {
        for (entry, expected) in covariance.into_iter().zip(expected) {
            assert!((entry - expected).abs() < 1e-12);
        }
    }
    // What stays on a plane does not leave it, whatever is said.
    let mut filter = ModeFilter::new(ModeSettings::planar());
    filter.begin(5.0, &start);
    let moved = filter.estimate(5.5).unwrap();
    let expected = Vector3::new(2.0, 2.0, 3.0);
    assert!((Vector3::from(moved.position_m) - expected).norm() < 1e-9);
    assert_eq!(moved.modes[2], 0.0);
}
