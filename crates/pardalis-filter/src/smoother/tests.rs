use super::*;
use crate::estimate::covariance_matrix;
use crate::modes::{GRAVITY_MPS2, Way};
use nalgebra::{DMatrix, DVector, Vector6};
use pardalis_core::rng::{Draws, Stage};

const STEP_S: f64 = 0.04;

/// Normally distributed numbers.
fn noise(number: u32) -> Vector3<f64> {
    let [x, y, z, _] = Draws::new(5, 0).normals(number, 0, Stage::Motion, 0);
    Vector3::new(f64::from(x), f64::from(y), f64::from(z))
}

/// Settings of which only this way to move counts.
fn single(density_m2ps3: f64) -> ModeSettings {
    let mut settings = ModeSettings {
        hit_rate_hz: 0.0,
        ..ModeSettings::default()
    };
    for way in &mut settings.ways {
        *way = Way {
            acceleration_mps2: [0.0; 3],
            density_m2ps3,
            leave_hz: 1.0,
            share: 1.0,
        };
    }
    settings
}

/// The covariance of a ball at a distance along x: uncertain in depth.
const COVARIANCE_M2: [f64; 6] = [0.0016, 0.0002, 0.0, 0.0004, 0.0, 0.0001];

#[test]
fn one_mode_gives_what_least_squares_over_all_states_gives() {
    let density = 2.0;
    let mut settings = single(density);
    settings.velocity_sigma_mps = 3.0;
    let times_s = [0.0, 0.04, 0.1, 0.13, 0.3, 0.34];
    let measured: Vec<Measured> = (0..)
        .zip(times_s)
        .map(|(number, time_s)| {
            let place = Vector3::new(1.0, 2.0, 3.0) * time_s + 0.02 * noise(number);
            Measured {
                time_s,
                position: (number != 3).then_some((place.into(), COVARIANCE_M2)),
            }
        })
        .collect();
    let smoothed = smooth(&measured, &settings);
    // The states are the unknowns; the measurements, the first velocity and the steps between states are equations.
    let count = 6 * times_s.len();
    let mut information = DMatrix::<f64>::zeros(count, count);
    let mut right = DVector::<f64>::zeros(count);
    let weight = covariance_matrix(COVARIANCE_M2).try_inverse().unwrap();
    for (number, one) in measured.iter().enumerate() {
        if let Some((position_m, _)) = one.position {
            let mut block = information.fixed_view_mut::<3, 3>(6 * number, 6 * number);
            block += weight;
            let mut side = right.fixed_view_mut::<3, 1>(6 * number, 0);
            side += weight * Vector3::from(position_m);
        }
    }
    for axis in 3..6 {
        information[(axis, axis)] += 1.0 / 9.0;
    }
    for (number, pair) in times_s.windows(2).enumerate() {
        let dt_s = pair[1] - pair[0];
        let state = Gaussian {
            mean: Vector6::zeros(),
            covariance: Matrix6::zeros(),
        };
        let process = state.moved(&settings.ways[0], 3, dt_s).covariance;
        let weight = process.try_inverse().unwrap();
        let step = transition_of(dt_s);
        let (a, b) = (6 * number, 6 * number + 6);
        let mut block = information.fixed_view_mut::<6, 6>(a, a);
        block += step.transpose() * weight * step;
        let mut block = information.fixed_view_mut::<6, 6>(b, b);
        block += weight;
        let mut block = information.fixed_view_mut::<6, 6>(a, b);
        block -= step.transpose() * weight;
        let mut block = information.fixed_view_mut::<6, 6>(b, a);
        block -= weight * step;
    }
    let covariance = information.try_inverse().unwrap();
    let expected = &covariance * right;
    for (number, state) in smoothed.iter().enumerate() {
        let state = state.unwrap();
        let found = state.position_m.into_iter().chain(state.velocity_mps);
        for (axis, found) in found.enumerate() {
            let expected = expected[6 * number + axis];
            assert!(
                (found - expected).abs() < 1e-5,
                "{number}: {found} {expected}"
            );
        }
        for (axis, at) in [0, 3, 5].into_iter().enumerate() {
            let at_axis = 6 * number + axis;
            let expected = covariance[(at_axis, at_axis)];
            assert!((state.covariance_m2[at] / expected - 1.0).abs() < 1e-3);
            let expected = covariance[(at_axis + 3, at_axis + 3)];
            assert!((state.velocity_covariance_m2ps2[at] / expected - 1.0).abs() < 1e-3);
        }
    }
}

/// A ball that is held, thrown, bounces and rolls.
fn thrown(time_s: f64) -> (Vector3<f64>, Vector3<f64>) {
    let fall = |since_s: f64, z: f64, vz: f64| {
        (
            z + vz * since_s - 0.5 * GRAVITY_MPS2 * since_s * since_s,
            vz - GRAVITY_MPS2 * since_s,
        )
    };
    // It leaves the hand at 1 m, and meets the floor (0.1 m) at 0.4 s + t1.
    let (start_s, vz) = (0.4, 2.0);
    let first_s = (vz + (vz * vz + 2.0 * GRAVITY_MPS2 * 0.9_f64).sqrt()) / GRAVITY_MPS2;
    let up = 0.7 * (GRAVITY_MPS2 * first_s - vz);
    let second_s = 2.0 * up / GRAVITY_MPS2;
    let x = 2.5 * (time_s - start_s).max(0.0);
    let vx = if time_s < start_s { 0.0 } else { 2.5 };
    let (z, vz) = if time_s < start_s {
        (1.0, 0.0)
    } else if time_s < start_s + first_s {
        fall(time_s - start_s, 1.0, vz)
    } else if time_s < start_s + first_s + second_s {
        fall(time_s - start_s - first_s, 0.1, up)
    } else {
        (0.1, 0.0)
    };
    (Vector3::new(x, 0.0, z), Vector3::new(vx, 0.0, vz))
}

/// The root mean square error of the position (m), the median one of the velocity (m/s), and the mean NEES of the position. In the frames at a contact, it is open whether the
/// velocity is that before or after it.
fn errors(states: &[Option<ModeState>]) -> [f64; 3] {
    let (mut position, mut velocities, mut nees) = (0.0, Vec::new(), 0.0);
    for (number, state) in (0..).zip(states) {
        let state = state.unwrap();
        let (place, speed) = thrown(STEP_S * f64::from(number));
        let off = Vector3::from(state.position_m) - place;
        position += off.norm_squared();
        velocities.push((Vector3::from(state.velocity_mps) - speed).norm());
        let inverse = covariance_matrix(state.covariance_m2)
            .try_inverse()
            .unwrap();
        nees += off.dot(&(inverse * off));
    }
    let count = states.len() as f64;
    velocities.sort_by(f64::total_cmp);
    let median_mps = velocities[velocities.len() / 2];
    [(position / count).sqrt(), median_mps, nees / count]
}

fn measured_throw() -> Vec<Measured> {
    let deviation = covariance_matrix(COVARIANCE_M2).cholesky().unwrap().l();
    let one = |number: u32| {
        let time_s = STEP_S * f64::from(number);
        let place = thrown(time_s).0 + deviation * noise(number);
        Measured {
            time_s,
            position: Some((place.into(), COVARIANCE_M2)),
        }
    };
    (0..60).map(one).collect()
}

#[test]
fn a_throw_is_smoother_and_its_modes_are_told() {
    let measured = measured_throw();
    let states = smooth(&measured, &ModeSettings::default());
    let [position_m, velocity_mps, nees] = errors(&states);
    // The measurements are off by 4.6 cm.
    assert!(position_m < 0.025, "{position_m}");
    assert!((0.5..4.0).contains(&nees), "{nees}");
    // Better than any one mode.
    for density in [1.0, 100.0] {
        let [one_m, one_mps, _] = errors(&smooth(&measured, &single(density)));
        assert!(position_m < 0.8 * one_m && velocity_mps < 0.8 * one_mps);
    }
    let flies = |time_s: f64| states[(time_s / STEP_S).round() as usize].unwrap().modes[2];
    assert!(flies(0.6) > 0.8 && flies(0.2) < 0.2 && flies(2.2) < 0.2);
}

#[test]
fn what_is_hidden_in_flight_is_filled_in() {
    let mut measured = measured_throw();
    for one in &mut measured[15..20] {
        one.position = None;
    }
    let states = smooth(&measured, &ModeSettings::default());
    for number in 15..20 {
        let state = states[number].unwrap();
        let off = Vector3::from(state.position_m) - thrown(STEP_S * number as f64).0;
        assert!(off.norm() < 0.08, "{number}: {off}");
    }
}

#[test]
fn nothing_is_said_before_the_first_and_after_the_last_measurement() {
    let mut measured = measured_throw();
    for number in [0, 1, 58, 59] {
        measured[number].position = None;
    }
    let states = smooth(&measured, &ModeSettings::default());
    let known: Vec<bool> = states.iter().map(Option::is_some).collect();
    assert!(known[2..58].iter().all(|known| *known));
    assert!(!known[0] && !known[1] && !known[58] && !known[59]);
    let none: Vec<Measured> = measured[..2].to_vec();
    assert_eq!(smooth(&none, &ModeSettings::default()), [None, None]);
}

#[test]
fn targets_on_a_plane_stay_on_it() {
    let on_plane = [0.0004, 0.0, 0.0, 0.0004, 0.0, 0.0];
    let one = |number: u32| {
        let time_s = STEP_S * f64::from(number);
        let mut place = Vector3::new(time_s, 0.0, 0.0) + 0.02 * noise(number);
        place.z = 0.4;
        Measured {
            time_s,
            position: Some((place.into(), on_plane)),
        }
    };
    let measured: Vec<Measured> = (0..40).map(one).collect();
    for state in smooth(&measured, &ModeSettings::planar()) {
        let state = state.unwrap();
        assert!((state.position_m[2] - 0.4).abs() < 1e-6, "{state:?}");
        assert!(state.velocity_mps[2].abs() < 1e-3 && state.modes[2] == 0.0);
        assert!(state.covariance_m2.iter().all(|v| v.is_finite()));
    }
}

/// When the ball is thrown, bounces and lands.
fn contact_times_s() -> [f64; 3] {
    let first_s = 0.4 + (2.0 + (4.0 + 2.0 * GRAVITY_MPS2 * 0.9_f64).sqrt()) / GRAVITY_MPS2;
    let bounce_mps = GRAVITY_MPS2 * (first_s - 0.4) - 2.0;
    [0.4, first_s, first_s + 1.4 * bounce_mps / GRAVITY_MPS2]
}

#[test]
fn contacts_are_found_within_half_a_frame() {
    let measured = measured_throw();
    let settings = ModeSettings::default();
    let states = smooth(&measured, &settings);
    let found = contacts(&measured, &states, &settings);
    let times_s: Vec<f64> = found.iter().map(|contact| contact.time_s).collect();
    let expected_s = contact_times_s();
    let bounce_mps = GRAVITY_MPS2 * (expected_s[1] - 0.4) - 2.0;
    assert_eq!(times_s.len(), 3, "{found:?}");
    for (found_s, expected_s) in times_s.iter().zip(expected_s) {
        assert!(
            (found_s - expected_s).abs() < 0.5 * STEP_S,
            "{times_s:?} {expected_s}"
        );
    }
    let bounce = found[1];
    assert!(
        (bounce.velocity_before_mps[2] + bounce_mps).abs() < 0.5,
        "{bounce:?}"
    );
    assert!((bounce.velocity_after_mps[2] - 0.7 * bounce_mps).abs() < 0.5);
    assert!((bounce.position_m[2] - 0.1).abs() < 0.03);
    // Rolling alone has none.
    let rolling = &measured[48..];
    let states = smooth(rolling, &settings);
    assert!(contacts(rolling, &states, &settings).is_empty());
}

#[test]
fn contacts_are_found_wherever_between_the_frames_they_are() {
    let settings = ModeSettings::default();
    let precise = [4e-6, 0.0, 0.0, 4e-6, 0.0, 4e-6];
    for phase in 0..20 {
        let one = |number: u32| {
            let time_s = STEP_S * (f64::from(number) + 0.05 * f64::from(phase));
            let place = thrown(time_s).0 + 0.002 * noise(60 * phase + number);
            Measured {
                time_s,
                position: Some((place.into(), precise)),
            }
        };
        let measured: Vec<Measured> = (0..60).map(one).collect();
        let states = smooth(&measured, &settings);
        let found = contacts(&measured, &states, &settings);
        let times_s: Vec<f64> = found.iter().map(|contact| contact.time_s).collect();
        assert_eq!(times_s.len(), 3, "{phase}: {times_s:?}");
        for (found_s, expected_s) in times_s.iter().zip(contact_times_s()) {
            assert!(
                (found_s - expected_s).abs() < 0.25 * STEP_S,
                "{phase}: {times_s:?}"
            );
        }
    }
}
