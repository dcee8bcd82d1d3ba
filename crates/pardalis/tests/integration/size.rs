//! The size of a ball: two cameras find it, also if the settings are wrong; one camera takes it as given.

#[path = "../../examples/painter/mod.rs"]
pub(crate) mod painter;

use nalgebra::Vector3;
use pardalis::camera::{Pinhole, looking_at};
use pardalis::color::ColorModel;
use pardalis::shape::{Shape, Sphere, SphereOutline};
use pardalis::tracker::{DetectedSettings, SizeTolerance, TrackState};
use pardalis::{CameraId, Estimate, Frame, FrameSet, Tracker, View};

pub(crate) const RADIUS_M: f64 = 0.035;
const FRAMES: usize = 12;
/// How near radii are found: 0.3 px of 12, because the edge is learnt from a single image with hard edges.
const SHARE: f64 = 0.025;

/// Two cameras 0.8 m apart, 0.9 m from the ball.
pub(crate) fn views() -> Vec<View> {
    let view = |from_m: [f64; 3]| {
        let lens = Pinhole::new([320.0, 320.0], [159.5, 119.5], &[]).unwrap();
        let pose = looking_at(from_m.into(), Vector3::zeros(), 0.0).unwrap();
        View::new(lens, pose, (320, 240), None).unwrap()
    };
    vec![view([-0.4, -0.8, 0.3]), view([0.4, -0.8, 0.3])]
}

/// Where the ball is in a frame, metres.
fn truth_m(frame: usize) -> [f64; 3] {
    [0.004 * frame as f64, 0.05, 0.02]
}

/// The ball with a radius and this knowledge of it.
fn ball(radius_m: f64, size: SizeTolerance) -> DetectedSettings {
    let (still, mask) = painter::ball(&views()[0], [0.0; 3], RADIUS_M);
    let still = Frame::from_rgb(320, 240, still, 0.0).unwrap();
    let colors = ColorModel::from_image(&still, &mask).unwrap();
    let shape = Shape::Sphere(Sphere::new(radius_m, SphereOutline::Tangent).unwrap());
    let mut ball = DetectedSettings::new(shape, colors);
    ball.size = size;
    ball
}

/// The estimates of all frames. `sees` says which camera sees the ball in which frame; the others see the empty room.
fn track(
    views: Vec<View>,
    ball: DetectedSettings,
    sees: impl Fn(usize, usize) -> bool,
) -> Vec<Estimate> {
    let mut setup = Tracker::builder();
    let cameras: Vec<CameraId> = views
        .iter()
        .map(|view| setup.camera(view.clone()))
        .collect();
    let target = setup.target(ball);
    let mut tracker = setup.build().unwrap();
    let estimate = |frame: usize| {
        let time_s = frame as f64 / 25.0;
        let of_camera = |(number, view): (usize, &View)| {
            let behind_m = [0.0, -9.0, 9.0];
            let shown_m = if sees(number, frame) {
                truth_m(frame)
            } else {
                behind_m
            };
            let (rgb, _) = painter::ball(view, shown_m, RADIUS_M);
            let image = Frame::from_rgb(320, 240, rgb, time_s).unwrap();
            (cameras[number], image)
        };
        let frames = views.iter().enumerate().map(of_camera);
        tracker.observe(&FrameSet::new(frames).unwrap()).unwrap();
        tracker.estimate(target).unwrap()
    };
    (0..FRAMES).map(estimate).collect()
}

fn error_m(estimate: &Estimate, frame: usize) -> f64 {
    let known = estimate.kinematics.unwrap();
    (Vector3::from(known.position_m) - Vector3::from(truth_m(frame))).norm()
}

#[test]
fn two_cameras_overrule_a_wrong_radius() {
    for scale in [0.8, 0.9, 0.95, 1.0, 1.05, 1.1, 1.2] {
        let ball = ball(scale * RADIUS_M, SizeTolerance::default());
        let estimates = track(views(), ball, |_, _| true);
        for (frame, estimate) in estimates.iter().enumerate().skip(2) {
            assert_eq!(
                estimate.state,
                TrackState::Tracking,
                "{scale}, frame {frame}"
            );
            let error_m = error_m(estimate, frame);
            assert!(error_m < 1e-3, "{scale}, frame {frame}: {error_m}");
        }
        let radius = estimates[FRAMES - 1].radius.unwrap();
        let off_m = (radius.radius_m - RADIUS_M).abs();
        assert!(
            off_m < SHARE * RADIUS_M && off_m < 3.0 * radius.sigma_m,
            "{scale}: {radius:?}"
        );
        assert!(radius.sigma_m < 0.02 * RADIUS_M, "{scale}: {radius:?}");
    }
}

#[test]
fn an_unknown_radius_is_found_by_two_cameras_and_not_by_one() {
    for guess_m in [0.01, 0.05, 0.2] {
        // Only one camera sees the ball at first: that determines no position.
        let ball = ball(guess_m, SizeTolerance::Unknown);
        let estimates = track(views(), ball, |camera, frame| camera == 0 || frame >= 4);
        for (frame, estimate) in estimates.iter().enumerate() {
            if frame < 4 {
                assert_eq!(
                    estimate.state,
                    TrackState::Searching,
                    "{guess_m}, frame {frame}"
                );
            } else if frame > 5 {
                let error_m = error_m(estimate, frame);
                assert!(error_m < 1e-3, "{guess_m}, frame {frame}: {error_m}");
            }
        }
        let radius = estimates[FRAMES - 1].radius.unwrap();
        assert!(
            (radius.radius_m / RADIUS_M - 1.0).abs() < SHARE,
            "{guess_m}: {radius:?}"
        );
    }
    let mut alone = Tracker::builder();
    alone.camera(views().remove(0));
    alone.target(ball(RADIUS_M, SizeTolerance::Unknown));
    let error = alone.build().err().unwrap().to_string();
    assert!(
        error.contains("radius_m") && error.contains("one camera"),
        "{error}"
    );
}

#[test]
fn what_two_cameras_found_helps_when_one_is_left() {
    let ball = ball(1.2 * RADIUS_M, SizeTolerance::default());
    let estimates = track(views(), ball, |camera, frame| camera == 0 || frame < 8);
    let last = FRAMES - 1;
    // 0.3 px of 12 px in radius, 0.9 m away; the wrong radius would put it 180 mm off.
    let error_m = error_m(&estimates[last], last);
    assert!(error_m < 0.025, "{error_m}");
}

#[test]
fn one_camera_counts_the_tolerance_in_the_covariance_and_nowhere_else() {
    let of = |size: SizeTolerance| {
        let view = vec![views().remove(0)];
        track(view, ball(RADIUS_M, size), |_, _| true)
    };
    let (exact, tolerant) = (
        of(SizeTolerance::Share(0.0)),
        of(SizeTolerance::Share(0.05)),
    );
    let camera = Vector3::new(-0.4, -0.8, 0.3);
    for (exact, tolerant) in exact.iter().zip(&tolerant) {
        assert_eq!((exact.radius, tolerant.radius), (None, None));
        let (known, unsure) = (exact.kinematics.unwrap(), tolerant.kinematics.unwrap());
        assert_eq!(known.position_m, unsure.position_m);
        assert_eq!(exact.confidence, tolerant.confidence);
        let to_ball = Vector3::from(known.position_m) - camera;
        // The trace of the covariance along the ray.
        let added_m2: f64 = [0, 3, 5]
            .map(|entry| unsure.covariance_m2[entry] - known.covariance_m2[entry])
            .iter()
            .sum();
        let expected_m2 = (0.05 * to_ball.norm()).powi(2);
        assert!(
            (added_m2 / expected_m2 - 1.0).abs() < 0.1,
            "{added_m2} {expected_m2}"
        );
    }
}

#[test]
fn one_camera_finds_the_size_of_a_ball_that_stays_on_the_ground() {
    let view = vec![views().remove(0)];
    let mut ball = ball(1.15 * RADIUS_M, SizeTolerance::default());
    ball.motion = ball.motion.in_plane();
    ball.existence.ground_z_m = truth_m(0)[2];
    let estimates = track(view, ball, |_, _| true);
    let last = FRAMES - 1;
    assert!(error_m(&estimates[last], last) < 3e-3);
    let radius = estimates[last].radius.unwrap();
    assert!(
        (radius.radius_m / RADIUS_M - 1.0).abs() < SHARE,
        "{radius:?}"
    );
}

#[test]
fn tolerances_out_of_range_are_refused() {
    for share in [-0.1, 1.1, f64::NAN] {
        let mut setup = Tracker::builder();
        setup.camera(views().remove(0));
        setup.target(ball(RADIUS_M, SizeTolerance::Share(share)));
        let error = setup.build().err().unwrap().to_string();
        assert!(error.contains("radius_tolerance"), "{error}");
    }
}

/// The estimates after each frame of cameras without a common trigger: the second camera's images are taken a millisecond after those of the first. From a frame on,
/// something grey covers the ball's lower half.
fn track_apart(
    ball: DetectedSettings,
    cameras: usize,
    covered_from: usize,
) -> Vec<(usize, Estimate)> {
    let views = &views()[..cameras];
    let mut setup = Tracker::builder();
    for view in views {
        setup.camera(view.clone());
    }
    let target = setup.target(ball);
    let mut tracker = setup.build().unwrap();
    let mut estimates = Vec::new();
    for frame in 0..3 * FRAMES {
        for (number, view) in views.iter().enumerate() {
            let time_s = frame as f64 / 25.0 + 0.001 * number as f64;
            let (mut rgb, mask) = painter::ball(view, truth_m(frame), RADIUS_M);
            if frame >= covered_from {
                let rows = |v: &usize| (0..320).any(|u| mask[320 * v + u]);
                let (first, last) = ((0..240).find(rows), (0..240).rfind(rows));
                let middle = usize::midpoint(first.unwrap(), last.unwrap());
                rgb[3 * 320 * middle..].fill(128);
            }
            let image = Frame::from_rgb(320, 240, rgb, time_s).unwrap();
            let set = FrameSet::of(CameraId::new(number), image);
            tracker.observe(&set).unwrap();
            estimates.push((frame, tracker.estimate(target).unwrap()));
        }
    }
    estimates
}

/// A camera alone is wrong by as much as the size is. What another saw a moment before counts more, also if their images are never of the same time.
#[test]
fn cameras_without_a_trigger_tell_the_distance_by_their_rays() {
    // The root mean square after the frames of each camera.
    let rms_m = |cameras: usize, scale: f64| {
        let estimates = track_apart(
            ball(scale * RADIUS_M, SizeTolerance::default()),
            cameras,
            usize::MAX,
        );
        let mut squares = vec![0.0; cameras];
        // Once the ball is found.
        let later = &estimates[estimates.len() / 2..];
        for (number, (frame, estimate)) in later.iter().enumerate() {
            assert_eq!(
                estimate.state,
                TrackState::Tracking,
                "{scale}, frame {frame}"
            );
            let known = estimate.kinematics.unwrap();
            let [xx, _, _, yy, _, zz] = known.covariance_m2;
            let error_m = error_m(estimate, *frame);
            assert!(
                error_m < 3.0 * (xx + yy + zz).sqrt(),
                "{scale}, frame {frame}: {error_m}"
            );
            squares[number % cameras] += error_m * error_m;
        }
        let count = (later.len() / cameras) as f64;
        squares.into_iter().map(move |sum| (sum / count).sqrt())
    };
    for scale in [0.97, 1.05] {
        let alone_m = rms_m(1, scale).next().unwrap();
        let together_m: Vec<f64> = rms_m(2, scale).collect();
        assert!(alone_m > 0.02, "{scale}: {alone_m}");
        // In 40 ms the ball may have moved as far as the first is wrong; the second comes a millisecond later.
        assert!(
            together_m[0] < 0.65 * alone_m && together_m[1] < 0.05 * alone_m,
            "{scale}: {alone_m} {together_m:?}"
        );
    }
}

/// Half an outline says little of the distance, and nothing less certain may come of it where another camera has just told it by its ray.
#[test]
fn half_a_ball_leaves_the_distance_that_another_camera_has_just_told() {
    let estimates = track_apart(ball(RADIUS_M, SizeTolerance::default()), 2, 2 * FRAMES);
    let later = &estimates[estimates.len() / 3..];
    for (number, (frame, estimate)) in later.iter().enumerate() {
        let error_m = error_m(estimate, *frame);
        let [xx, _, _, yy, _, zz] = estimate.kinematics.unwrap().covariance_m2;
        let sigma_m = (xx + yy + zz).sqrt();
        // In 40 ms a ball that may be thrown moves by centimetres; the second camera's image comes a millisecond later.
        let most_m = if number % 2 == 0 { 0.04 } else { 0.005 };
        assert!(
            sigma_m < most_m && error_m < 3.0 * sigma_m && estimate.confidence > 0.9,
            "frame {frame}: {error_m} {sigma_m}, {}",
            estimate.confidence
        );
    }
}
