//! Cameras on moving platforms: the state is that in the world.

use nalgebra::{Point3, Rotation3, Vector3};
use pardalis::camera::Pose;
use pardalis::platform::{Increment, OdometryErrors, Platform, PoseCovariance, StampedPose};
use pardalis::tracker::{PlatformId, TrackState};
use pardalis::{Estimate, FrameSet, TargetId, Tracker};

use crate::common::drawn::{CENTER_PX, FOCAL_PX, RADIUS_M, Thing, settings_of, shown, view};
use crate::common::set_of;

const BALL: TargetId = TargetId::new(0);
const PLATFORM: PlatformId = PlatformId::new(0);
const STEP_S: f64 = 0.04;

/// Where the ball lies in the world, metres.
const BALL_M: [f64; 3] = [0.5, 0.1, 3.0];

/// Where the camera is in the frame of its platform.
fn platform_from_camera() -> Pose {
    Pose::from_parts(
        [0.1, -0.05, 0.2].into(),
        Rotation3::new(Vector3::y() * 0.05),
    )
}

/// Where the platform is at a time in seconds: it drives past the ball and turns towards it.
fn pose_at(time_s: f64) -> Pose {
    Pose::from_parts(
        [0.9 * time_s, 0.1 * time_s, 0.3 * time_s].into(),
        Rotation3::new(Vector3::new(0.02, -0.2, 0.05) * time_s),
    )
}

/// The image of the ball where the platform is at this pose.
fn ball_from(world_from_platform: &Pose) -> Thing {
    let camera_from_world = (world_from_platform * platform_from_camera()).inverse();
    let in_camera = camera_from_world * Point3::from(BALL_M);
    Thing {
        exponent: 2.0,
        radius_px: FOCAL_PX * RADIUS_M / in_camera.z,
        middle_px: [0, 1].map(|i| CENTER_PX[i] + FOCAL_PX * in_camera[i] / in_camera.z),
    }
}

fn tracker(odometry: OdometryErrors) -> Tracker {
    let mut setup = Tracker::builder();
    let platform = setup.platform(Platform::new(odometry).unwrap());
    let camera = view(platform_from_camera());
    setup.camera_on(platform, camera).unwrap();
    setup.target(settings_of(ball_from(&pose_at(0.0))));
    setup.build().unwrap()
}

fn stamped(time_s: f64, world_from_platform: Pose, covariance: &PoseCovariance) -> StampedPose {
    StampedPose {
        time_s,
        world_from_platform,
        covariance: *covariance,
    }
}

/// What the camera sees at a time, where the platform truly is.
fn frames_at(time_s: f64) -> FrameSet {
    set_of(shown(&[ball_from(&pose_at(time_s))], &[], time_s))
}

fn off_m(estimate: &Estimate, expected_m: [f64; 3]) -> f64 {
    let known = estimate.kinematics.unwrap();
    (Vector3::from(known.position_m) - Vector3::from(expected_m)).norm()
}

#[test]
fn a_ball_at_rest_is_at_rest_before_a_camera_that_drives_and_turns() {
    let mut tracker = tracker(OdometryErrors::default());
    // Ten poses a second, the last after the last frame.
    for step in 0..12 {
        let time_s = 0.1 * f64::from(step);
        let pose = stamped(time_s, pose_at(time_s), &PoseCovariance::zero());
        tracker.observe_pose(PLATFORM, &pose).unwrap();
    }
    for step in 0..26 {
        tracker
            .observe(&frames_at(STEP_S * f64::from(step)))
            .unwrap();
        let estimate = tracker.estimate(BALL).unwrap();
        assert_eq!(estimate.state, TrackState::Tracking, "frame {step}");
        if step >= 10 {
            let speed_mps =
                Vector3::from(estimate.kinematics.unwrap().velocity_mps.unwrap()).norm();
            assert!(
                off_m(&estimate, BALL_M) < 0.04 && speed_mps < 0.15,
                "{step}: {estimate:?}"
            );
        }
    }
    // Relative to the camera it moved by more than that in every frame.
    let seen_m = |time_s| pose_at(time_s).inverse() * Point3::from(BALL_M);
    assert!((seen_m(1.0) - seen_m(0.96)).norm() > 0.015);
}

#[test]
fn errors_of_poses_are_part_of_the_covariance() {
    let covariance_m2 = |covariance: &PoseCovariance| {
        let mut tracker = tracker(OdometryErrors::default());
        for step in 0..8 {
            let time_s = STEP_S * f64::from(step);
            let pose = stamped(time_s, pose_at(time_s), covariance);
            tracker.observe_pose(PLATFORM, &pose).unwrap();
            tracker.observe(&frames_at(time_s)).unwrap();
        }
        tracker
            .estimate(BALL)
            .unwrap()
            .kinematics
            .unwrap()
            .covariance_m2
    };
    let exact = covariance_m2(&PoseCovariance::zero());
    let uncertain = covariance_m2(&PoseCovariance::of_sigmas(0.03, 0.02).unwrap());
    // 3 cm, and 0.02 rad at the distance of 3 m across the line of sight.
    let across_m2 = uncertain[0] - exact[0];
    assert!(
        (across_m2 - (0.03_f64.powi(2) + 0.0036)).abs() < 0.0006,
        "{across_m2}"
    );
    let along_m2 = uncertain[5] - exact[5];
    assert!((along_m2 - 0.03_f64.powi(2)).abs() < 0.0002, "{along_m2}");
}

#[test]
fn frames_without_a_pose_are_not_used() {
    let mut tracker = tracker(OdometryErrors::default());
    let mut states = Vec::new();
    for step in 0..45 {
        let time_s = STEP_S * f64::from(step);
        if !(10..35).contains(&step) {
            let pose = stamped(time_s, pose_at(time_s), &PoseCovariance::zero());
            tracker.observe_pose(PLATFORM, &pose).unwrap();
        }
        tracker.observe(&frames_at(time_s)).unwrap();
        states.push(tracker.estimate(BALL).unwrap().state);
    }
    // A quarter of a second is extrapolated: six of 25 frames.
    assert_eq!(tracker.frames_without_pose(PLATFORM).unwrap(), 19);
    assert_eq!(states[15], TrackState::Tracking);
    assert_eq!(states[44], TrackState::Tracking);
    assert!(off_m(&tracker.estimate(BALL).unwrap(), BALL_M) < 0.04);
}

#[test]
fn increments_lead_on_from_a_pose() {
    let mut tracker = tracker(OdometryErrors::default());
    let start = stamped(0.0, pose_at(0.0), &PoseCovariance::zero());
    tracker.observe_pose(PLATFORM, &start).unwrap();
    for step in 0..25 {
        let [from_s, to_s] = [step, step + 1].map(|step| STEP_S * f64::from(step));
        tracker.observe(&frames_at(from_s)).unwrap();
        let increment = Increment {
            from_s,
            to_s,
            before_from_after: pose_at(from_s).inverse() * pose_at(to_s),
            covariance: PoseCovariance::zero(),
        };
        tracker.observe_increment(PLATFORM, &increment).unwrap();
    }
    let estimate = tracker.estimate(BALL).unwrap();
    assert!(off_m(&estimate, BALL_M) < 0.04, "{estimate:?}");
    // The error of scale, over the way.
    let state = tracker.platform(PLATFORM).unwrap().state_at(1.0).unwrap();
    let way_m = pose_at(1.0).translation.vector.x;
    let sigma_m = state.covariance.matrix()[(0, 0)].sqrt();
    assert!((sigma_m - 0.02 * way_m).abs() < 0.002, "{sigma_m}");
}

#[test]
fn targets_move_with_a_world_that_jumps() {
    let mut tracker = tracker(OdometryErrors::default());
    let correction = Pose::from_parts([1.5, -0.7, 0.4].into(), Rotation3::new(Vector3::y() * 0.4));
    for step in 0..25 {
        let time_s = STEP_S * f64::from(step);
        let world = if step < 15 {
            Pose::identity()
        } else {
            correction
        };
        let pose = stamped(time_s, world * pose_at(time_s), &PoseCovariance::zero());
        tracker.observe_pose(PLATFORM, &pose).unwrap();
        tracker.observe(&frames_at(time_s)).unwrap();
        let estimate = tracker.estimate(BALL).unwrap();
        assert_eq!(estimate.state, TrackState::Tracking, "frame {step}");
        let expected_m = world * Point3::from(BALL_M);
        if step >= 10 {
            assert!(
                off_m(&estimate, expected_m.into()) < 0.05,
                "{step}: {estimate:?}"
            );
        }
    }
    assert_eq!(tracker.platform(PLATFORM).unwrap().counts().jumps, 1);
}

#[test]
fn platforms_that_do_not_exist_are_refused() {
    let mut setup = Tracker::builder();
    let error = setup
        .camera_on(PLATFORM, view(Pose::identity()))
        .unwrap_err();
    assert!(error.to_string().contains("platform"), "{error}");
    let mut tracker = tracker(OdometryErrors::default());
    let pose = stamped(0.0, Pose::identity(), &PoseCovariance::zero());
    let error = tracker.observe_pose(PlatformId::new(1), &pose).unwrap_err();
    assert!(error.to_string().contains("platform is 1"), "{error}");
}
