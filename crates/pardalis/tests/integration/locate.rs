//! Localisation in single images through mirrors, and re-initialisation from another robot's estimate.

use crate::common::{FPS, ball_target, data, fisheye_view, frame, jump_picture, open, set_of};
use nalgebra::Point3;
use pardalis::color::{ColorModel, Palette, YuvEncoding};
use pardalis::start::{PixelStart, Start};
use pardalis::tracker::{PASSES_SIGMA_M, TrackState};
use pardalis::view::View;
use pardalis::{Estimate, Frame, PixelFormat, TargetId, Tracker};
use pardalis_camera::{Camera, Mask};
use pardalis_camera::{Pose, pose_from_matrix};
use pardalis_core::rng::Draws;
use pardalis_core::simd::Level;
use pardalis_filter::Likelihood;
use pardalis_filter::Particles;
use pardalis_filter::gaussian::{GaussianStart, diagonal_m2};
use pardalis_filter::particle_filter::ParticleFilter;
use pardalis_scene::calibration;

const BALL: TargetId = TargetId::new(0);

/// Loads the calibrated mirror camera in a model: unified, perspective or exact.
fn mirror(model: &str) -> (Camera, Pose) {
    let file = data(&format!("calibration/catadioptric/{model}.toml"));
    let cameras = calibration::read(&std::fs::read_to_string(file).unwrap(), None).unwrap();
    (
        cameras[0].camera.clone(),
        cameras[0].world_from_camera.unwrap(),
    )
}

fn mirror_view(model: &str) -> View {
    let (camera, world_from_camera) = mirror(model);
    View::new(camera, world_from_camera, (640, 480), None).unwrap()
}

/// Returns a tracker of the ball with an uninformative start.
fn mirror_tracker(model: &str) -> Tracker {
    let colors = data("colors/orange-ball.catadioptric.hsi.colors.toml");
    let mut target = ball_target(Palette::HSI, 3000);
    target.colors = Some(ColorModel::from_text(&std::fs::read_to_string(colors).unwrap()).unwrap());
    Tracker::new(vec![mirror_view(model)], vec![target], 1, Level::best()).unwrap()
}

/// An image of data/catadioptric-static, with the ball's true position and the pixel of its centre.
struct Still {
    frame: Frame,
    position_m: [f64; 3],
    pixel: [f64; 2],
}

fn stills(numbers: impl IntoIterator<Item = usize>) -> Vec<Still> {
    let truth = std::fs::read_to_string(data("catadioptric-static/truth.csv")).unwrap();
    let still = |number: usize| {
        let picture = open(&format!("catadioptric-static/frames/{number:06}.jpg"));
        let row: Vec<&str> = truth.lines().nth(number + 1).unwrap().split(',').collect();
        let column = |i: usize| row[i].parse::<f64>().unwrap();
        Still {
            frame: frame(
                &picture,
                PixelFormat::Rgb8,
                YuvEncoding::default(),
                number as f64,
            ),
            position_m: [4, 5, 6].map(column),
            pixel: [13, 14].map(column),
        }
    };
    numbers.into_iter().map(still).collect()
}

fn distance_m(a: [f64; 3], b: [f64; 3]) -> f64 {
    (Point3::from(a) - Point3::from(b)).norm()
}

fn around(position_m: [f64; 3]) -> Start {
    Start::Gaussian(GaussianStart {
        position_m,
        ..GaussianStart::default()
    })
}

fn located(tracker: &mut Tracker, still: &Still, start: Start) -> Estimate {
    let set = set_of(still.frame.clone());
    let estimates = tracker.locate(&set, &[Some(start)], &PASSES_SIGMA_M);
    estimates.unwrap()[0]
}

/// Images with positions up to 2.2 m away, on the floor and 0.34 m high.
const NEAR_IMAGES: [usize; 12] = [0, 1, 2, 4, 5, 6, 16, 17, 18, 20, 21, 22];

#[test]
fn balls_are_located_through_mirrors_from_positions_and_from_clicks() {
    for model in ["unified", "perspective", "exact"] {
        let mut tracker = mirror_tracker(model);
        for (number, still) in NEAR_IMAGES.into_iter().zip(stills(NEAR_IMAGES)) {
            let click = Start::Pixel(PixelStart::at(0, still.pixel));
            // Along a ray, only the apparent size of the ball determines its distance: one pixel in ten is a
            // tenth.
            let range_m = distance_m(still.position_m, [0.0, 0.0, 0.82]);
            for (from, start, allowed_m) in [
                ("position", around(still.position_m), 0.25),
                ("click", click, 0.1 + 0.15 * range_m),
            ] {
                let estimate = located(&mut tracker, &still, start);
                assert_eq!(estimate.state, TrackState::Tracking);
                let found = estimate.kinematics.unwrap();
                let off_m = distance_m(found.position_m, still.position_m);
                assert!(
                    off_m < allowed_m,
                    "{model} {number} from a {from}: error {off_m} m"
                );
                // The direction is determined much better. The ball is seen from the mirror, 0.16 m above the
                // pinhole.
                let direction =
                    |p: [f64; 3]| (Point3::from(p) - Point3::new(0.0, 0.0, 0.98)).normalize();
                let off_rad = direction(found.position_m).angle(&direction(still.position_m));
                assert!(
                    off_rad < 0.05,
                    "{model} {number} from a {from}: error {off_rad} rad"
                );
                assert_eq!(found.velocity_mps, None);
                assert!(estimate.confidence > 0.5);
            }
        }
    }
}

#[test]
fn nothing_is_found_out_of_view() {
    let mut tracker = mirror_tracker("exact");
    let still = &stills([1])[0];
    // Beyond the mirror's rim.
    for start in [around([1.3, 0.0, 50.0]), around([0.0, 0.0, 1.5])] {
        let estimate = located(&mut tracker, still, start);
        assert_eq!(estimate.state, TrackState::Occluded);
        assert_eq!((estimate.kinematics, estimate.confidence), (None, 0.0));
        // The estimate holds until the next frames.
        assert_eq!(
            tracker
                .estimate_at(BALL, still.frame.time_s())
                .unwrap()
                .state,
            TrackState::Occluded
        );
    }
    let estimate = located(&mut tracker, still, around(still.position_m));
    assert_eq!(estimate.state, TrackState::Tracking);
}

#[test]
fn images_use_their_own_random_numbers_for_any_thread_count() {
    let still = &stills([1])[0];
    let twice = |threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        pool.unwrap().install(|| {
            let mut tracker = mirror_tracker("unified");
            [(); 2].map(|()| located(&mut tracker, still, around(still.position_m)))
        })
    };
    let [first, second] = twice(1);
    // Errors of images that shared their random numbers would not average out.
    assert_ne!(first, second);
    assert_eq!([first, second], twice(3));
}

#[test]
fn invalid_starts_and_passes_are_rejected_without_side_effects() {
    let mut tracker = mirror_tracker("exact");
    let still = &stills([1])[0];
    let set = set_of(still.frame.clone());
    let fine = Some(around(still.position_m));
    let no_camera = Some(Start::Pixel(PixelStart::at(1, still.pixel)));
    // The corner of the image lies outside the mirror.
    let no_ray = Some(Start::Pixel(PixelStart::at(0, [2.0, 2.0])));
    let nowhere = Some(around([f64::NAN; 3]));
    for (starts, passes, wanted) in [
        (&[fine, fine][..], &[0.1][..], "starts is 2; allowed: 1"),
        (&[None], &[0.1], "starts is none; allowed"),
        (&[no_camera], &[0.1], "camera is 1; allowed"),
        (&[no_ray], &[0.1], "pixel_px is [2.0, 2.0]; allowed"),
        (&[nowhere], &[0.1], "position_m is NaN; allowed"),
        (&[fine], &[], "passes_sigma_m is []; allowed"),
        (
            &[fine],
            &[0.1, 0.0],
            "passes_sigma_m is [0.1, 0.0]; allowed",
        ),
    ] {
        let error = tracker.locate(&set, starts, passes).unwrap_err();
        assert!(error.to_string().starts_with(wanted), "{error}");
    }
    assert_eq!(tracker.time_s(), None);
    let state = tracker.estimate_at(BALL, 1.0).unwrap().state;
    assert_eq!(state, TrackState::Searching);
}

/// A likelihood that falls with the distance to a point, which records the particles.
struct Near {
    target_m: Point3<f64>,
    seen: Option<Particles>,
}

impl Likelihood for Near {
    fn log_likelihoods(&mut self, particles: &Particles, out: &mut [f32]) {
        for (i, out) in out.iter_mut().enumerate() {
            *out = -(Point3::from(particles.position_m(i)) - self.target_m).norm() as f32;
        }
        self.seen = Some(particles.clone());
    }
}

#[test]
fn mirror_rays_end_at_the_ground_or_at_the_maximum_range() {
    // The second pose is tilted by 60 degrees, so that the camera's right side looks up.
    let (sin, cos) = 60_f64.to_radians().sin_cos();
    let tilted = pose_from_matrix([
        [cos, 0.0, -sin, 0.0],
        [0.0, 1.0, 0.0, 0.0],
        [sin, 0.0, cos, 1.0],
        [0.0, 0.0, 0.0, 1.0],
    ]);
    for model in ["unified", "perspective", "exact"] {
        let (camera, upright) = mirror(model);
        for (pose, pixel, ends_on_ground) in [
            (upright, [360.0, 250.0], true),
            (upright, [100.0, 200.0], true),
            (tilted.clone().unwrap(), [300.0, 239.5], true),
            (tilted.clone().unwrap(), [540.0, 239.5], false),
        ] {
            let view = View::new(camera.clone(), pose, (640, 480), None).unwrap();
            let start = PixelStart {
                pixel_sigma_px: 0.0,
                ..PixelStart::at(0, pixel)
            };
            start.check_in(&view).unwrap();
            let ray = camera.unproject(pixel).unwrap();
            let origin = pose * Point3::from(ray.origin);
            let direction = pose.rotation * nalgebra::Vector3::from(ray.direction);
            assert_eq!(direction.z < -0.05, ends_on_ground, "{model} {pixel:?}");
            let end_m = if ends_on_ground {
                (-origin.z / direction.z).min(start.max_range_m)
            } else {
                start.max_range_m
            };
            let target_m = origin + direction * (0.9 * end_m);
            let mut near = Near {
                target_m,
                seen: None,
            };
            let found = start.search(&view, &mut near, false, None, Draws::new(1, 0), 0);
            let off_m = distance_m(found.position_m, target_m.into());
            assert!(off_m < 0.01 * end_m, "{model} {pixel:?}: {off_m}");
            let seen = near.seen.unwrap();
            let ranges_m =
                (0..seen.count()).map(|i| (Point3::from(seen.position_m(i)) - origin).norm());
            let (nearest_m, farthest_m) = ranges_m.fold((f64::MAX, 0_f64), |(a, b), range_m| {
                (a.min(range_m), b.max(range_m))
            });
            assert!((nearest_m - start.min_range_m).abs() < 0.01, "{nearest_m}");
            assert!(
                (farthest_m - end_m).abs() < 0.01 * end_m,
                "{farthest_m} {end_m}"
            );
            assert!((0..seen.count()).all(|i| seen.position_m(i)[2] > -1e-4));
        }
    }
}

#[test]
fn ground_nearer_than_the_search_start_is_searched() {
    let start = PixelStart {
        min_range_m: 3.0,
        pixel_sigma_px: 0.0,
        ..PixelStart::at(0, [319.5, 239.5])
    };
    // Straight down, 0.9 m above the floor.
    let mut near = Near {
        target_m: Point3::origin(),
        seen: None,
    };
    let found = start.search(&fisheye_view(), &mut near, false, None, Draws::new(1, 0), 0);
    assert!(distance_m(found.position_m, [0.0; 3]) < 1e-6, "{found:?}");
}

#[test]
fn particles_have_the_covariance_of_the_start() {
    let start = GaussianStart {
        position_m: [1.0, -2.0, 0.5],
        covariance_m2: [0.04, 0.03, -0.005, 0.09, 0.01, 0.0125],
        velocity_mps: [0.5, 0.0, -1.0],
        velocity_sigma_mps: [0.1, 0.2, 0.3],
    };
    let settings = crate::common::ball_filter(200_000);
    let mut filter =
        ParticleFilter::new(settings, &start, Draws::new(3, 0), Level::best()).unwrap();
    let mut check = || {
        let estimate = filter.estimate(0.0);
        for axis in 0..3 {
            assert!((estimate.position_m[axis] - start.position_m[axis]).abs() < 0.003);
            let velocity_mps = estimate.velocity_mps.unwrap()[axis];
            assert!((velocity_mps - start.velocity_mps[axis]).abs() < 0.003);
        }
        for (found, wanted) in estimate.covariance_m2.iter().zip(start.covariance_m2) {
            assert!(
                (found - wanted).abs() < 0.001,
                "{:?}",
                estimate.covariance_m2
            );
        }
        let first = filter.particles().position_m(0);
        filter.start_over(&start);
        first
    };
    let particles = [check(), check(), check()];
    assert_ne!(particles[0], particles[1]);
    assert_ne!(particles[1], particles[2]);
}

/// Returns frames of data/dioptric-jump.
fn jump_frames(indices: std::ops::Range<usize>) -> impl Iterator<Item = Frame> {
    indices.map(|index| {
        let time_s = index as f64 / FPS;
        frame(
            &jump_picture(index),
            PixelFormat::Rgb8,
            YuvEncoding::default(),
            time_s,
        )
    })
}

/// Returns the ball's true position in a frame of data/dioptric-jump.
fn jump_truth_m(index: usize) -> [f64; 3] {
    let truth = std::fs::read_to_string(data("dioptric-jump/truth.csv")).unwrap();
    let row: Vec<&str> = truth.lines().nth(index + 1).unwrap().split(',').collect();
    [4, 5, 6].map(|i| row[i].parse().unwrap())
}

#[test]
fn an_external_estimate_recovers_a_lost_ball() {
    // The other robot tracks the ball in a world of its own.
    let mut other = Tracker::new(
        vec![fisheye_view()],
        vec![ball_target(Palette::HSI, 2000)],
        2,
        Level::best(),
    )
    .unwrap();
    let other_from_world = pose_from_matrix([
        [0.0, 1.0, 0.0, -2.0],
        [-1.0, 0.0, 0.0, 1.0],
        [0.0, 0.0, 1.0, 0.25],
        [0.0, 0.0, 0.0, 1.0],
    ])
    .unwrap();
    // Our tracker starts where there is no ball.
    let mut target = ball_target(Palette::HSI, 2000);
    target.start = Start::Gaussian(GaussianStart {
        position_m: [-1.5, 1.5, 0.3],
        covariance_m2: diagonal_m2([0.05; 3]),
        ..GaussianStart::default()
    });
    let mut ours = Tracker::new(vec![fisheye_view()], vec![target], 1, Level::best()).unwrap();
    let mut earlier = None;
    for (index, frame) in jump_frames(0..12).enumerate() {
        let time_s = frame.time_s();
        let set = set_of(frame);
        if index == 6 {
            let lost = ours.estimate_at(BALL, time_s).unwrap();
            let off_m = distance_m(lost.kinematics.unwrap().position_m, jump_truth_m(5));
            assert!(off_m > 1.0, "{off_m}");
            // The external estimate is two frames old when it arrives.
            let (estimate, earlier_s): (_, f64) = earlier.unwrap();
            ours.reinitialize(BALL, &estimate, earlier_s).unwrap();
            // Nothing changes before the next frames.
            assert_eq!(ours.estimate_at(BALL, time_s).unwrap(), lost);
        }
        other.observe(&set).unwrap();
        ours.observe(&set).unwrap();
        if index == 4 {
            let theirs = other.estimate_at(BALL, time_s).unwrap().kinematics.unwrap();
            let there = GaussianStart::from_estimate(&theirs).moved(&other_from_world);
            earlier = Some((there.moved(&other_from_world.inverse()), time_s));
        }
        if index >= 6 {
            let found = ours.estimate_at(BALL, time_s).unwrap();
            assert_eq!(found.state, TrackState::Tracking);
            let off_m = distance_m(found.kinematics.unwrap().position_m, jump_truth_m(index));
            assert!(off_m < 0.5, "frame {index}: error {off_m} m");
        }
    }
}

#[test]
fn external_estimates_are_predicted_to_the_current_time() {
    let mut tracker = mirror_tracker("exact");
    let still = &stills([1])[0];
    let sigma_m = 0.02;
    let start = GaussianStart {
        position_m: [3.0, 3.0, 20.0],
        covariance_m2: diagonal_m2([sigma_m; 3]),
        velocity_mps: [-1.0, 0.0, 2.0],
        velocity_sigma_mps: [0.0; 3],
    };
    // High up, where the images carry no information.
    tracker.reinitialize(BALL, &start, 0.5).unwrap();
    let later = still.frame.with_time_s(0.75).unwrap();
    tracker.observe(&set_of(later)).unwrap();
    let estimate = tracker.estimate_at(BALL, 0.75).unwrap();
    assert_eq!(estimate.state, TrackState::Occluded);
    let found = estimate.kinematics.unwrap();
    let motion = ball_target(Palette::HSI, 1).filter.motion;
    let sd_m = (sigma_m * sigma_m + motion.position_variance_m2(0.25)).sqrt();
    for (axis, wanted) in [2.75, 3.0, 20.5].into_iter().enumerate() {
        assert!((found.position_m[axis] - wanted).abs() < 0.1 * sd_m);
    }
    let found_sd_m = found.covariance_m2[0].sqrt();
    assert!((found_sd_m / sd_m - 1.0).abs() < 0.1, "{found_sd_m} {sd_m}");
    let sd_mps = motion.velocity_variance_m2ps2(0.25).sqrt();
    let found_sd_mps = found.velocity_covariance_m2ps2.unwrap()[0].sqrt();
    assert!(
        (found_sd_mps / sd_mps - 1.0).abs() < 0.1,
        "{found_sd_mps} {sd_mps}"
    );
}

#[test]
fn invalid_reinitialisations_are_rejected() {
    let mut tracker = mirror_tracker("exact");
    let fine = GaussianStart::default();
    let not_positive = GaussianStart {
        covariance_m2: [1.0, 2.0, 0.0, 1.0, 0.0, 1.0],
        ..fine
    };
    for (target, start, time_s, wanted) in [
        (
            1,
            fine,
            0.0,
            "target is 1; allowed: the number of a target, below 1",
        ),
        (0, fine, f64::NAN, "time_s is NaN; allowed"),
        (
            0,
            not_positive,
            0.0,
            "covariance_m2 is [1.0, 2.0, 0.0, 1.0, 0.0, 1.0]; allowed",
        ),
    ] {
        let error = tracker
            .reinitialize(TargetId::new(target), &start, time_s)
            .unwrap_err();
        assert!(error.to_string().starts_with(wanted), "{error}");
    }
}

#[test]
fn clicks_on_masked_pixels_are_rejected() {
    let (camera, world_from_camera) = mirror("unified");
    let mask = Mask::from_radius(640, 480, [319.5, 239.5], 236.0).unwrap();
    let size = (640, 480);
    let view = View::new(camera, world_from_camera, size, Some(mask)).unwrap();
    for (pixel, is_open) in [
        ([319.5, 60.0], true),
        ([5.0, 5.0], false),
        ([600.0, 239.5], false),
    ] {
        let checked = PixelStart::at(0, pixel).check_in(&view);
        assert_eq!(checked.is_ok(), is_open, "{pixel:?}: {checked:?}");
        if let Err(error) = checked {
            assert!(error.to_string().contains("mask"), "{error}");
        }
    }
}
