//! Rigs from simulated observations with ground truth: standard deviations, and shots that are not
//! simultaneous.

use nalgebra::{Point3, Rotation3, Translation3, Vector3};
use pardalis_calibrate::{
    CalibrationView, Correspondence, OUTLIER_SIGMAS, RigCamera, calibrate_rig,
};
use pardalis_camera::Pose;
use pardalis_camera::{Camera, Equidistant};
use pardalis_core::rng::{Draws, Stage};

const SHOTS: usize = 12;

/// Standard deviation of a coordinate.
const NOISE_PX: f64 = 0.2;

fn pose(turn: [f64; 3], shift_m: [f64; 3]) -> Pose {
    Pose::from_parts(
        Translation3::from(Vector3::from(shift_m)),
        Rotation3::new(Vector3::from(turn)),
    )
}

fn right_from_left() -> Pose {
    pose([0.02, -0.15, 0.05], [-0.3, 0.01, 0.04])
}

/// Returns the board's pose in a shot; the poses cover all parts of the image and rotations about all axes.
fn left_from_board(shot: usize) -> Pose {
    let [a, b] = [0.9, 1.7].map(|factor| factor * shot as f64);
    pose(
        [0.6 * a.sin(), 0.6 * b.cos(), 0.3 * b.sin()],
        [0.35 * a.cos(), 0.25 * b.sin() - 0.2, 0.9 + 0.2 * a.sin()],
    )
}

/// Returns a camera that saw the board in these shots, one after the other.
fn camera(name: &str, camera_from_left: Pose, shots: &[usize]) -> RigCamera {
    let camera = Camera::Equidistant(Equidistant::new(300.0, [319.5, 239.5], 1.2).unwrap());
    let draws = Draws::new(1, name.len() as u32);
    let view = |&shot: &usize| {
        let points = (0..48_u32).map(|i| [f64::from(i % 8), f64::from(i / 8), 0.0]);
        let seen = points.enumerate().map(|(i, corner)| {
            let point_m = corner.map(|c| 0.06 * c);
            let point = camera_from_left * left_from_board(shot) * Point3::from(point_m);
            let [u, v] = camera.project(point.into()).unwrap();
            let [du, dv, ..] = draws.normals(shot as u32, i as u32, Stage::Ray, 0);
            Correspondence {
                point_m,
                pixel: [u + NOISE_PX * f64::from(du), v + NOISE_PX * f64::from(dv)],
            }
        });
        Some(CalibrationView {
            name: format!("{name} {shot}"),
            correspondences: seen.collect(),
        })
    };
    RigCamera {
        name: name.to_owned(),
        views: shots.iter().map(view).collect(),
        camera: camera.clone(),
        size_px: (640, 480),
    }
}

/// Returns a left camera that saw all shots in order, and a right one that saw `right_shots` at the same times.
fn rig(right_shots: &[usize]) -> [RigCamera; 2] {
    let left_shots: Vec<usize> = (0..right_shots.len()).collect();
    [
        camera("left", Pose::identity(), &left_shots),
        camera("right", right_from_left(), right_shots),
    ]
}

#[test]
fn errors_of_distance_and_rotation_match_standard_deviations() {
    let all: Vec<usize> = (0..SHOTS).collect();
    let found = calibrate_rig(&rig(&all), OUTLIER_SIGMAS).unwrap();
    assert!(found.rejected_shots.is_empty() && found.outliers.is_empty());
    let truth = right_from_left().inverse();
    let right = found.cameras[1].world_from_camera.unwrap();
    let distance_m = |pose: &Pose| pose.translation.vector.norm();
    for (value, truth, sigma, most) in [
        (
            distance_m(&right),
            distance_m(&truth),
            found.baseline_sigma_m[1],
            1e-3,
        ),
        (
            right.rotation.angle(),
            truth.rotation.angle(),
            found.turn_sigma_rad[1],
            2e-3,
        ),
    ] {
        let error = (value - truth).abs();
        assert!(sigma > 1e-6 && sigma < most, "{sigma}");
        assert!(error < 3.0 * sigma, "{value} ± {sigma}, not {truth}");
    }
    assert_eq!(
        [found.baseline_sigma_m[0], found.turn_sigma_rad[0]],
        [0.0; 2]
    );
    // Two coordinates, minus the effect of the unknowns.
    let expected_px = 2.0_f64.sqrt() * NOISE_PX;
    for rms_px in &found.rms_px {
        assert!((rms_px / expected_px - 1.0).abs() < 0.1, "{rms_px}");
    }
}

#[test]
fn rejects_few_shots_that_are_not_simultaneous() {
    let mut shots: Vec<usize> = (0..SHOTS).collect();
    (shots[0], shots[5]) = (8, 2);
    let found = calibrate_rig(&rig(&shots), OUTLIER_SIGMAS).unwrap();
    assert_eq!(found.rejected_shots, [0, 5]);
    assert!(found.outliers.is_empty() && found.world_from_target[5].is_none());
    let (truth, right) = (
        right_from_left().inverse(),
        found.cameras[1].world_from_camera.unwrap(),
    );
    let shift_m = (right.translation.vector - truth.translation.vector).norm();
    assert!(shift_m < 2e-3, "{shift_m}");

    // One image is missing, which shifts all later ones.
    let shots: Vec<usize> = (1..SHOTS).collect();
    let error = calibrate_rig(&rig(&shots), OUTLIER_SIGMAS).unwrap_err();
    assert!(
        error.reason.contains("disagree on the target's position")
            && error.reason.contains(" of 11 shots: left 0 with right 1, "),
        "{error}"
    );
    assert!(error.remedy.contains("whether one is missing"), "{error}");
}
