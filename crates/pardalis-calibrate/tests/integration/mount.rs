//! The pose of a camera on a platform, from a target at rest.

use nalgebra::{Point3, Rotation3, Translation3, Vector3};
use pardalis_calibrate::{
    CalibrationError, CalibrationView, Correspondence, MountCalibration, MountSettings, MountView,
    calibrate_mount,
};
use pardalis_camera::{Camera, Pinhole, Pose, RigidMotion, looking_at};
use pardalis_core::rng::{Draws, Stage};

const SIZE_PX: (usize, usize) = (640, 480);

fn camera() -> Camera {
    Pinhole::new([500.0, 505.0], [319.5, 239.5], &[-0.05, 0.01, 0.0, 0.0])
        .unwrap()
        .into()
}

/// A camera that looks ahead and down, on a robot.
fn mounted() -> Pose {
    looking_at(
        Vector3::new(0.12, -0.04, 0.45),
        Vector3::new(2.0, 0.1, 0.1),
        0.05,
    )
    .unwrap()
}

/// The corners of a board.
fn board() -> Vec<[f64; 3]> {
    let corners = (0..35).map(|i| [0.06 * f64::from(i % 7), 0.06 * f64::from(i / 7), 0.0]);
    corners.collect()
}

/// A robot that drives to and fro and turns: on even ground, or as if it were in the air.
fn robot(time_s: f64, is_even: bool) -> Pose {
    let [s, c] = [time_s.sin(), (0.7 * time_s).cos()];
    let tilts = if is_even {
        [0.0; 2]
    } else {
        [0.25 * s, 0.2 * c]
    };
    Pose::from_parts(
        Translation3::new(0.3 * s, 0.25 * c, if is_even { 0.0 } else { 0.1 * s * c }),
        Rotation3::from_euler_angles(tilts[0], tilts[1], 0.35 * (1.3 * time_s).sin()),
    )
}

/// Views of these points, whose pose in the world is given, with noise in pixels.
fn views(
    points: &[[f64; 3]],
    world_from_target: &Pose,
    robot: impl Fn(f64) -> Pose,
    noise_px: f64,
) -> Vec<MountView> {
    let draws = Draws::new(3, 0);
    let view = |number: u32| {
        let time_s = 0.2 * f64::from(number);
        let camera_from_target = (robot(time_s) * mounted()).inverse() * world_from_target;
        let mut correspondences = Vec::new();
        for (point_m, index) in points.iter().zip(0..) {
            let point = camera_from_target * Point3::from(*point_m);
            let [u, v] = camera().project(point.into())?;
            let inside = (0.0..639.0).contains(&u) && (0.0..479.0).contains(&v);
            let [nu, nv, ..] = draws.normals(number, index, Stage::Pixel, 0).map(f64::from);
            correspondences.push(Correspondence {
                point_m: *point_m,
                pixel: [u + noise_px * nu, v + noise_px * nv],
            });
            if !inside {
                return None;
            }
        }
        Some(MountView {
            view: CalibrationView {
                name: format!("view {number}"),
                correspondences,
            },
            time_s,
        })
    };
    (0..40).filter_map(view).collect()
}

/// Calibrates by the poses of a robot whose clock is late by `late_s`.
fn calibrated(
    views: &[MountView],
    robot: impl Fn(f64) -> Pose,
    late_s: f64,
    guess: Pose,
) -> Result<MountCalibration, CalibrationError> {
    let platform_at = |time_s: f64| {
        let [pose, next] = [0.0, 1e-4].map(|later_s| robot(time_s - late_s + later_s));
        let rates = RigidMotion::to(&(pose.inverse() * next)).times(1e4);
        Some((pose, rates))
    };
    let settings = MountSettings::new(guess, SIZE_PX);
    calibrate_mount(&camera(), views, &platform_at, &settings)
}

/// A board that stands in front of the robot.
fn standing() -> Pose {
    looking_at(
        Vector3::new(2.0, 0.2, 0.55),
        Vector3::new(0.0, 0.0, 0.5),
        0.1,
    )
    .unwrap()
        * Pose::from_parts(
            Translation3::identity(),
            Rotation3::from_euler_angles(std::f64::consts::PI, 0.2, 0.0),
        )
}

/// The difference of a pose from that of the camera, in millimetres and milliradians.
fn off(found: &Pose) -> ([f64; 3], f64) {
    let off = found.translation.vector - mounted().translation.vector;
    let turn = (found.rotation * mounted().rotation.inverse()).angle();
    ((off * 1e3).into(), 1e3 * turn)
}

/// A guess that is half a turn and a metre off.
fn bad_guess() -> Pose {
    Pose::from_parts(
        Translation3::new(0.8, 0.5, 0.45),
        Rotation3::new(Vector3::z() * 2.8) * mounted().rotation,
    )
}

#[test]
fn a_board_seen_from_an_arm_determines_everything() {
    let arm = |t| robot(t, false);
    let views = views(&board(), &standing(), arm, 0.1);
    assert!(views.len() > 20, "{}", views.len());
    let found = calibrated(&views, arm, 0.03, bad_guess()).unwrap();
    let (off_mm, off_mrad) = off(&found.platform_from_camera);
    println!(
        "{off_mm:?} {off_mrad} {:?} {:?}",
        found.position_sigma_m, found.time_offset_s
    );
    for (off_mm, sigma_m) in off_mm.iter().zip(found.position_sigma_m) {
        assert!(off_mm.abs() < 3.0 && off_mm.abs() < 4e3 * sigma_m);
        assert!(sigma_m < 1.5e-3);
    }
    assert!(off_mrad < 1.0);
    let [offset_s, sigma_s] = found.time_offset_s.unwrap();
    assert!((offset_s + 0.03).abs() < 4.0 * sigma_s && sigma_s < 1e-3);
    assert_eq!(found.undetermined, None);
    assert!((found.rms_px - 0.14).abs() < 0.02, "{}", found.rms_px);
}

#[test]
fn on_even_ground_the_height_is_kept() {
    let wheels = |t| robot(t, true);
    let views = views(&board(), &standing(), wheels, 0.1);
    let mut guess = bad_guess();
    guess.translation.vector.z = 0.47;
    let found = calibrated(&views, wheels, -0.02, guess).unwrap();
    let (off_mm, off_mrad) = off(&found.platform_from_camera);
    println!("{off_mm:?} {off_mrad} {:?}", found.position_sigma_m);
    assert_eq!(found.undetermined, Some([0.0, 0.0, 1.0]));
    assert!((off_mm[2] - 20.0).abs() < 0.01 && found.position_sigma_m[2] == 0.0);
    assert!(off_mm[0].abs() < 3.0 && off_mm[1].abs() < 3.0 && off_mrad < 1.5);
    // The board is as much too high.
    let high_m = found.world_from_target.translation.vector - standing().translation.vector;
    assert!((high_m.z - 0.02).abs() < 2e-3, "{high_m}");
}

#[test]
fn a_ball_at_rest_will_do_with_a_guess() {
    let point = [[0.0; 3]];
    let ball = Pose::translation(2.0, 0.15, 0.1);
    let arm = |t| robot(t, false);
    let views = views(&point, &ball, arm, 0.1);
    let guess = Pose::from_parts(
        Translation3::new(0.2, 0.05, 0.4),
        Rotation3::new(Vector3::new(0.1, -0.1, 0.15)) * mounted().rotation,
    );
    let found = calibrated(&views, arm, 0.01, guess).unwrap();
    let (off_mm, off_mrad) = off(&found.platform_from_camera);
    println!("{off_mm:?} {off_mrad} {:?}", found.position_sigma_m);
    for (off_mm, sigma_m) in off_mm.iter().zip(found.position_sigma_m) {
        assert!(off_mm.abs() < 20.0 && off_mm.abs() < 4e3 * sigma_m);
    }
    let [offset_s, sigma_s] = found.time_offset_s.unwrap();
    assert!(
        (offset_s + 0.01).abs() < 4.0 * sigma_s,
        "{offset_s} {sigma_s}"
    );
}

#[test]
fn clocks_may_differ_by_a_third_of_a_second() {
    let wheels = |t| robot(t, true);
    let views = views(&board(), &standing(), wheels, 0.1);
    for late_s in [-0.35, 0.35] {
        let found = calibrated(&views, wheels, late_s, mounted()).unwrap();
        let [offset_s, _] = found.time_offset_s.unwrap();
        assert!((offset_s + late_s).abs() < 1e-3, "{offset_s}");
        let (off_mm, off_mrad) = off(&found.platform_from_camera);
        assert!(off_mm[0].abs() < 3.0 && off_mm[1].abs() < 3.0 && off_mrad < 1.5);
    }
}

#[test]
fn deviations_are_those_of_repeated_calibrations() {
    let mut squares = 0.0;
    let mut count = 0.0;
    for period in 0..12 {
        let later = 0.37 * f64::from(period);
        let arm = |t| robot(t + later, false);
        let views = views(&board(), &standing(), arm, 0.3);
        let found = calibrated(&views, arm, 0.0, mounted()).unwrap();
        let (off_mm, _) = off(&found.platform_from_camera);
        for (off_mm, sigma_m) in off_mm.iter().zip(found.position_sigma_m) {
            squares += (1e-3 * off_mm / sigma_m).powi(2);
            count += 1.0;
        }
    }
    let rms = f64::sqrt(squares / count);
    assert!((0.6..1.5).contains(&rms), "{rms}");
}

#[test]
fn what_determines_nothing_is_refused() {
    let straight = |t: f64| Pose::translation(0.05 * t, 0.0, 0.0);
    let of_straight = views(&board(), &standing(), straight, 0.1);
    let error = calibrated(&of_straight, straight, 0.0, mounted()).unwrap_err();
    assert!(
        error.to_string().contains("turned by 0.0 degrees"),
        "{error}"
    );
    let arm = |t| robot(t, false);
    let all = views(&board(), &standing(), arm, 0.1);
    let error = calibrated(&all[..2], arm, 0.0, mounted()).unwrap_err();
    assert!(error.to_string().contains("seen in 2 views"), "{error}");
    // Poses of another drive.
    let error = calibrated(&all, |t| arm(3.0 - t), 0.0, mounted()).unwrap_err();
    let contradicted = "check that the target was at rest";
    assert!(error.to_string().contains(contradicted), "{error}");
}
