use super::*;
use pardalis_core::rng::{Draws, Stage};

/// The covariances of a measurement with independent errors of this standard deviation.
fn of_noise(sigma_m: f64) -> ([f64; 6], [f64; 6]) {
    let variance = sigma_m * sigma_m;
    ([variance, 0.0, 0.0, variance, 0.0, variance], [0.0; 6])
}

/// A thrown body: position and velocity after a time, integrated in small steps with Euler's method of mid-points.
fn thrown(drag: f64, spin: [f64; 3], after_s: f64) -> (Vector3<f64>, Vector3<f64>) {
    let gravity = Vector3::new(0.0, 0.0, -9.81);
    let spin = Vector3::from(spin);
    let mut position = Vector3::new(-1.3, 0.1, 0.3);
    let mut velocity = Vector3::new(6.0, 0.7, 2.0);
    let steps = (after_s / 1e-5).round() as usize;
    let acceleration = |v: &Vector3<f64>| gravity - drag * v.norm() * v + spin.cross(v);
    for _ in 0..steps {
        let h = after_s / steps as f64;
        let middle = velocity + 0.5 * h * acceleration(&velocity);
        position += h * middle;
        velocity += h * acceleration(&middle);
    }
    (position, velocity)
}

/// The flight of a thrown body that is measured this often until a time, with this standard deviation.
fn measured(drag: f64, spin: [f64; 3], (every_s, until_s): (f64, f64), sigma_m: f64) -> Flight {
    let mut flight = Flight::new(FlightSettings::default()).unwrap();
    let draws = Draws::new(7, 0);
    let count = (until_s / every_s).round() as u32;
    for number in 0..=count {
        let time_s = f64::from(number) * every_s;
        let (position, _) = thrown(drag, spin, time_s);
        let errors = draws.normals(number, 0, Stage::Start, 0);
        let position = [0, 1, 2].map(|axis| position[axis] + sigma_m * f64::from(errors[axis]));
        flight.add(time_s, position, of_noise(sigma_m));
    }
    flight
}

/// When and where a thrown body falls below a height.
fn lands(drag: f64, spin: [f64; 3], z_m: f64) -> (f64, Vector3<f64>) {
    let mut times = (1..2000).map(|step| f64::from(step) * 1e-3);
    let is_below = |time_s: &f64| thrown(drag, spin, *time_s).0.z < z_m;
    let after_s = times.find(is_below).unwrap();
    let (position, velocity) = thrown(drag, spin, after_s);
    let late_s = (position.z - z_m) / velocity.z;
    (after_s - late_s, position - late_s * velocity)
}

#[test]
fn landings_of_balls_with_drag_and_spin_are_predicted_with_the_error_they_have() {
    let floor = Plane::level(0.02).unwrap();
    for (drag, spin) in [
        (0.0, [0.0; 3]),
        (0.13, [0.0; 3]),
        (0.13, [0.3, 0.8, -0.2]),
        (0.02, [0.0, -0.5, 0.4]),
    ] {
        let (lands_s, lands_m) = lands(drag, spin, 0.02);
        let flight = measured(drag, spin, (0.01, lands_s - 0.2), 0.001);
        let crossing = flight.crossing(&floor).unwrap();
        let off_s = crossing.time_s - lands_s;
        let off_m = Vector3::from(crossing.position_m) - lands_m;
        assert!(off_m.norm() < 0.02, "{drag} {spin:?}: {off_m}");
        assert!(
            off_s.abs() < 4.0 * crossing.sigma_s && crossing.sigma_s < 0.004,
            "{off_s}"
        );
        let [xx, xy, _, yy, ..] = crossing.covariance_m2;
        let sigma_m = (xx + yy).sqrt();
        assert!(
            off_m.norm() < 4.0 * sigma_m && sigma_m < 0.02,
            "{off_m} {sigma_m}"
        );
        assert!(xx * yy > xy * xy);
        assert!(crossing.covariance_m2[5].abs() < 1e-9, "it is on the plane");
    }
}

#[test]
fn a_flight_begins_anew_after_a_contact() {
    let spin = [0.0; 3];
    let mut flight = measured(0.1, spin, (0.01, 0.3), 0.002);
    assert!(flight.crossing(&Plane::level(0.0).unwrap()).is_some());
    // It is hit at 0.3 s, and then flies from where it was in the first place.
    let (hit_m, _) = thrown(0.1, spin, 0.3);
    let wall = Plane::new([-3.0, 0.0, 0.0], [-2.0, 0.0, 0.0]).unwrap();
    for number in 1..=20 {
        let after_s = 0.01 * f64::from(number);
        let (way, _) = thrown(0.1, spin, after_s);
        let off = way - thrown(0.1, spin, 0.0).0;
        let position = hit_m + Vector3::new(-off.x, off.y, off.z);
        flight.add(0.3 + after_s, position.into(), of_noise(0.002));
    }
    let crossing = flight.crossing(&wall).unwrap();
    assert!((crossing.position_m[0] + 3.0).abs() < 1e-6);
    assert!(
        crossing.time_s > 0.5 && crossing.time_s < 1.5,
        "{crossing:?}"
    );
}

#[test]
fn what_does_not_fly_lands_nowhere() {
    let floor = Plane::level(-1.0).unwrap();
    let draws = Draws::new(3, 0);
    // It rests, rolls, and is moved to and fro by hand, which looks like a flight while it accelerates downwards.
    let rests: fn(f64) -> [f64; 3] = |_| [0.0, 0.0, 0.5];
    let rolls: fn(f64) -> [f64; 3] = |t| [2.0 * t, -t, 0.5];
    let is_carried: fn(f64) -> [f64; 3] = |t| {
        [
            0.3 * libm::sin(6.0 * t),
            0.0,
            0.5 + 0.2 * libm::cos(5.0 * t),
        ]
    };
    for (motion, most) in [(rests, 0), (rolls, 0), (is_carried, 8)] {
        let mut flight = Flight::new(FlightSettings::default()).unwrap();
        let mut landings = 0;
        for number in 0..200 {
            let time_s = 0.01 * f64::from(number);
            let errors = draws.normals(number, 0, Stage::Start, 0);
            let place = motion(time_s);
            let position = [0, 1, 2].map(|axis| place[axis] + 0.002 * f64::from(errors[axis]));
            flight.add(time_s, position, of_noise(0.002));
            landings += usize::from(flight.crossing(&floor).is_some());
        }
        assert!(landings <= most, "{landings}");
    }
}

#[test]
fn bad_settings_and_planes_are_refused_and_bad_measurements_left_out() {
    for settings in [
        FlightSettings {
            drag_per_m: -0.1,
            ..FlightSettings::default()
        },
        FlightSettings {
            spin_sigma_hz: f64::NAN,
            ..FlightSettings::default()
        },
        FlightSettings {
            gravity_mps2: [0.0, f64::INFINITY, 0.0],
            ..FlightSettings::default()
        },
    ] {
        assert!(Flight::new(settings).is_err());
    }
    assert!(Plane::new([0.0; 3], [0.0; 3]).is_err());
    assert!(Plane::level(f64::NAN).is_err());
    let mut flight = measured(0.1, [0.0; 3], (0.01, 0.3), 0.002);
    let before = flight.crossing(&Plane::level(0.0).unwrap());
    flight.add(0.1, [0.0; 3], of_noise(1.0));
    flight.add(0.4, [f64::NAN; 3], of_noise(f64::NAN));
    assert_eq!(flight.crossing(&Plane::level(0.0).unwrap()), before);
    flight.reset();
    assert_eq!(flight.crossing(&Plane::level(0.0).unwrap()), None);
}

#[test]
fn a_body_that_returns_after_hours_begins_a_new_flight_at_once() {
    let floor = Plane::level(0.02).unwrap();
    let mut flight = measured(0.1, [0.0; 3], (0.01, 0.3), 0.002);
    // Integrating a flight of a year would take longer than the test.
    let later_s = 3e7;
    for number in 0..=30 {
        let after_s = 0.01 * f64::from(number);
        let (position, _) = thrown(0.1, [0.0; 3], after_s);
        flight.add(later_s + after_s, position.into(), of_noise(0.002));
        assert_eq!(flight.points.len(), number as usize + 1);
    }
    let crossing = flight.crossing(&floor).unwrap();
    let (lands_s, lands_m) = lands(0.1, [0.0; 3], 0.02);
    assert!(
        (crossing.time_s - later_s - lands_s).abs() < 0.005,
        "{crossing:?}"
    );
    let off_m = Vector3::from(crossing.position_m) - lands_m;
    assert!(off_m.norm() < 0.03, "{off_m}");
}
