use super::*;
use nalgebra::Rotation3;

/// The motion of a platform that drives an arc: 0.8 m/s ahead, 0.5 rad/s to the left.
const ARC: RigidMotion = RigidMotion {
    velocity_m: Vector3::new(0.8, 0.0, 0.0),
    turn_rad: Vector3::new(0.0, 0.0, 0.5),
};

/// Where it is at a time in seconds.
fn on_arc(time_s: f64) -> Pose {
    ARC.times(time_s).pose()
}

fn stamped(time_s: f64, world_from_platform: Pose) -> StampedPose {
    StampedPose {
        time_s,
        world_from_platform,
        covariance: PoseCovariance::zero(),
    }
}

fn increment(from_s: f64, to_s: f64) -> Increment {
    Increment {
        from_s,
        to_s,
        before_from_after: on_arc(from_s).inverse() * on_arc(to_s),
        covariance: PoseCovariance::zero(),
    }
}

/// Drives along the arc for 2 s, with 50 increments.
fn drive(platform: &mut Platform) {
    for step in 0..50 {
        let [from_s, to_s] = [step, step + 1].map(|step| 0.04 * f64::from(step));
        platform
            .observe_increment(&increment(from_s, to_s))
            .unwrap();
    }
}

fn platform() -> Platform {
    Platform::new(OdometryErrors::default()).unwrap()
}

/// By how much two poses differ, metres and radians.
fn apart(a: &Pose, b: &Pose) -> [f64; 2] {
    let motion = RigidMotion::to(&(a.inverse() * b));
    [motion.velocity_m.norm(), motion.turn_rad.norm()]
}

#[test]
fn poses_between_and_beyond_given_ones_lie_on_the_arc() {
    let mut platform = platform();
    assert!(platform.state_at(0.0).is_none());
    for step in 0..5 {
        let time_s = 0.2 * f64::from(step);
        let pose = stamped(time_s, on_arc(time_s));
        assert_eq!(platform.observe_pose(&pose).unwrap(), ObservedMotion::Used);
    }
    for time_s in [-0.2, 0.0, 0.07, 0.4, 0.79, 0.8, 1.0] {
        let state = platform.state_at(time_s).unwrap();
        let [off_m, off_rad] = apart(&state.world_from_platform, &on_arc(time_s));
        assert!(
            off_m < 1e-9 && off_rad < 1e-9,
            "{time_s}: {off_m} {off_rad}"
        );
        let rotation = on_arc(time_s).rotation;
        assert!((state.velocity_mps - rotation * ARC.velocity_m).norm() < 1e-9);
        assert!((state.turn_radps - ARC.turn_rad).norm() < 1e-9);
    }
    // Where poses are, they are exact; between and beyond them they are not.
    let sigma_m = |time_s: f64| platform.state_at(time_s).unwrap().covariance.0[(0, 0)].sqrt();
    assert_eq!(sigma_m(0.4), 0.0);
    assert!((sigma_m(0.5) - 0.01).abs() < 1e-9, "{}", sigma_m(0.5));
    assert!((sigma_m(1.0) - 0.04).abs() < 1e-9, "{}", sigma_m(1.0));
    assert!(platform.state_at(1.06).is_none() && platform.state_at(-0.26).is_none());
}

#[test]
fn long_gaps_have_no_pose_and_late_poses_are_ignored() {
    let mut platform = platform();
    for time_s in [0.0, 0.1, 1.3, 1.4] {
        platform
            .observe_pose(&stamped(time_s, on_arc(time_s)))
            .unwrap();
    }
    assert!(platform.state_at(0.2).is_none() && platform.state_at(1.2).is_none());
    assert!(platform.state_at(1.35).is_some());
    let late = platform.observe_pose(&stamped(1.0, on_arc(1.0))).unwrap();
    assert_eq!(late, ObservedMotion::Late);
    let late = platform.observe_increment(&increment(1.0, 1.1)).unwrap();
    assert_eq!(late, ObservedMotion::Late);
    assert!(platform.state_at(1.2).is_none());
    let counts = platform.counts();
    assert_eq!((counts.used, counts.late, counts.jumps), (4, 2, 0));
}

#[test]
fn increments_add_up_from_a_start() {
    let start = Pose::from_parts([1.0, 2.0, 0.0].into(), Rotation3::new(Vector3::z()));
    let mut platform = platform();
    platform.observe_pose(&stamped(0.0, start)).unwrap();
    drive(&mut platform);
    let state = platform.state_at(2.0).unwrap();
    let [off_m, off_rad] = apart(&state.world_from_platform, &(start * on_arc(2.0)));
    assert!(off_m < 1e-9 && off_rad < 1e-9, "{off_m} {off_rad}");
}

/// Where increments lead if their scale and their drift per metre are off.
fn with_errors(scale: f64, drift_rad_per_m: f64) -> Pose {
    let mut pose = Pose::identity();
    for step in 0..50 {
        let [from_s, to_s] = [step, step + 1].map(|step| 0.04 * f64::from(step));
        let mut motion = RigidMotion::to(&increment(from_s, to_s).before_from_after);
        let way_m = motion.velocity_m.norm();
        motion = motion.times(1.0 + scale);
        motion.turn_rad.z += drift_rad_per_m * way_m;
        pose *= motion.pose();
    }
    pose
}

#[test]
fn errors_that_increments_share_add_up_as_perturbed_odometry_does() {
    let errors = OdometryErrors {
        scale_sigma: 0.01,
        drift_sigma_rad_per_m: 0.02,
        tilt_sigma_rad: 0.0,
    };
    let mut platform = Platform::new(errors).unwrap();
    drive(&mut platform);
    let found = platform.state_at(2.0).unwrap();
    let truth = on_arc(2.0);
    let mut expected = Matrix6::zeros();
    for errors in [[0.01, 0.0], [0.0, 0.02]] {
        let off = with_errors(errors[0], errors[1]);
        let moved_m = off.translation.vector - truth.translation.vector;
        let turn = RigidMotion::to(&Pose::from_parts(
            nalgebra::Translation3::identity(),
            off.rotation * truth.rotation.inverse(),
        ));
        let error = Vector6::from_iterator(moved_m.iter().chain(&turn.turn_rad).copied());
        expected += error * error.transpose();
    }
    let off = (found.covariance.0 - expected).amax();
    assert!(
        off < 0.03 * expected.amax(),
        "{} {expected}",
        found.covariance.0
    );
}

#[test]
fn tilts_do_not_add_up() {
    let errors = OdometryErrors {
        scale_sigma: 0.0,
        drift_sigma_rad_per_m: 0.0,
        tilt_sigma_rad: 0.01,
    };
    let mut platform = Platform::new(errors).unwrap();
    drive(&mut platform);
    let covariance = platform.state_at(2.0).unwrap().covariance.0;
    let expected = Vector6::new(0.0, 0.0, 0.0, 1e-4, 1e-4, 0.0);
    assert!((covariance - Matrix6::from_diagonal(&expected)).amax() < 1e-12);
}

#[test]
fn independent_errors_of_increments_add_up_as_samples_do() {
    let covariance = PoseCovariance::of_sigmas(0.002, 0.004).unwrap();
    let exact = OdometryErrors {
        scale_sigma: 0.0,
        drift_sigma_rad_per_m: 0.0,
        tilt_sigma_rad: 0.0,
    };
    let mut platform = Platform::new(exact).unwrap();
    let steps: Vec<Increment> = (0..40)
        .map(|step| Increment {
            covariance,
            ..increment(0.05 * f64::from(step), 0.05 * f64::from(step + 1))
        })
        .collect();
    for step in &steps {
        platform.observe_increment(step).unwrap();
    }
    let found = platform.state_at(2.0).unwrap();
    let draws = pardalis_core::rng::Draws::new(1, 0);
    let mut sum = Matrix3::zeros();
    let samples = 4000;
    for sample in 0..samples {
        let mut pose = Pose::identity();
        for (number, step) in (0..).zip(&steps) {
            let stage = pardalis_core::rng::Stage::Motion;
            let [a, b] = [0, 1].map(|part| draws.normals(sample, number, stage, part));
            let noise = [a[0], a[1], a[2], b[0], b[1], b[2]].map(f64::from);
            let moved = Vector3::new(noise[0], noise[1], noise[2]) * 0.002;
            let turn = Rotation3::new(Vector3::new(noise[3], noise[4], noise[5]) * 0.004);
            let increment = &step.before_from_after;
            pose *= Pose::from_parts(
                (increment.translation.vector + moved).into(),
                turn * increment.rotation,
            );
        }
        let off_m = pose.translation.vector - on_arc(2.0).translation.vector;
        sum += off_m * off_m.transpose() / f64::from(samples);
    }
    let expected = found.covariance.0.fixed_view::<3, 3>(0, 0).into_owned();
    let off = (sum - expected).amax();
    assert!(off < 0.06 * expected.amax(), "{sum} {expected}");
}

#[test]
fn gaps_in_odometry_are_driven_on_and_jumps_left_out() {
    let mut platform = platform();
    for (from_s, to_s) in [(0.0, 0.1), (0.1, 0.2), (0.5, 0.6)] {
        platform
            .observe_increment(&increment(from_s, to_s))
            .unwrap();
    }
    let state = platform.state_at(0.6).unwrap();
    let [off_m, _] = apart(&state.world_from_platform, &on_arc(0.6));
    assert!(off_m < 1e-9, "{off_m}");
    // It might have driven elsewhere in 0.3 s.
    assert!(state.covariance.0[(0, 0)].sqrt() > 0.08);
    let mut jump = increment(0.6, 0.7);
    jump.before_from_after.translation.vector.x += 2.0;
    assert_eq!(
        platform.observe_increment(&jump).unwrap(),
        ObservedMotion::Jump
    );
    let state = platform.state_at(0.7).unwrap();
    let [off_m, _] = apart(&state.world_from_platform, &on_arc(0.7));
    assert!(off_m < 1e-9, "{off_m}");
    assert_eq!((platform.counts().gaps, platform.counts().jumps), (1, 1));
}

#[test]
fn a_localisation_that_jumps_moves_the_world() {
    let mut platform = platform();
    let correction = Pose::from_parts([0.5, -0.2, 0.0].into(), Rotation3::new(Vector3::z() * 0.3));
    for step in 0..20 {
        let time_s = 0.1 * f64::from(step);
        let pose = if step < 10 {
            on_arc(time_s)
        } else {
            correction * on_arc(time_s)
        };
        let outcome = platform.observe_pose(&stamped(time_s, pose)).unwrap();
        assert_eq!(outcome == ObservedMotion::Jump, step == 10, "{step}");
    }
    let moved = platform.jumped(0.9, 1.0).unwrap();
    let [off_m, off_rad] = apart(&moved, &correction);
    assert!(off_m < 1e-9 && off_rad < 1e-9, "{off_m} {off_rad}");
    assert!(platform.jumped(0.0, 0.9).is_none() && platform.jumped(1.0, 1.9).is_none());
    // Across the jump, the nearer pose holds.
    for (time_s, world) in [(0.93, Pose::identity()), (0.97, correction)] {
        let state = platform.state_at(time_s).unwrap();
        let [off_m, _] = apart(&state.world_from_platform, &(world * on_arc(time_s)));
        assert!(off_m < 1e-9, "{time_s}: {off_m}");
    }
}

#[test]
fn uncertain_rotations_move_distant_points() {
    let covariance = PoseCovariance::of_sigmas(0.01, 0.02).unwrap();
    let (platform_m, point_m) = (Vector3::new(1.0, 1.0, 0.0), Vector3::new(4.0, 1.0, 0.0));
    let of_point_m2 = covariance.of_point_m2(&platform_m, &point_m);
    let across_m2 = 0.01_f64.powi(2) + (3.0 * 0.02_f64).powi(2);
    assert!((of_point_m2[(0, 0)] - 1e-4).abs() < 1e-12);
    assert!((of_point_m2[(1, 1)] - across_m2).abs() < 1e-12);
    assert!((of_point_m2[(2, 2)] - across_m2).abs() < 1e-12);
}

#[test]
fn invalid_motions_are_refused() {
    let mut platform = platform();
    let nan = Pose::translation(f64::NAN, 0.0, 0.0);
    assert!(platform.observe_pose(&stamped(0.0, nan)).is_err());
    assert!(
        platform
            .observe_pose(&stamped(f64::INFINITY, Pose::identity()))
            .is_err()
    );
    assert!(
        platform
            .observe_pose(&stamped(0.0, Pose::translation(2e6, 0.0, 0.0)))
            .is_err()
    );
    let error = platform
        .observe_increment(&increment(0.2, 0.2))
        .unwrap_err();
    assert!(error.to_string().contains("to_s is 0.2"), "{error}");
    assert_eq!(platform.counts(), PlatformCounts::default());
    assert!(PoseCovariance::of_sigmas(-0.1, 0.0).is_err());
    let mut rows = [[0.0; 6]; 6];
    (rows[0][0], rows[1][1]) = (1.0, 1.0);
    assert!(PoseCovariance::from_matrix(rows).is_ok());
    (rows[0][1], rows[1][0]) = (2.0, 2.0);
    assert!(PoseCovariance::from_matrix(rows).is_err());
    rows[1][0] = 0.0;
    assert!(PoseCovariance::from_matrix(rows).is_err());
    let errors = OdometryErrors {
        scale_sigma: 1.5,
        ..OdometryErrors::default()
    };
    assert!(Platform::new(errors).is_err());
}
