//! After the first frames, a step allocates no memory.
#![allow(unsafe_code)] // a counting allocator passes every call on to the system's

#[path = "integration/common/mod.rs"]
mod common;

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;

use common::robot::{self, mast_view, robot_target};
use common::{FPS, ball_target, detected_ball, fisheye_view, frame, jump_picture, open};
use nalgebra::Vector3;
use pardalis::camera::{Pinhole, Pose, looking_at};
use pardalis::color::{ColorModel, Palette, YuvEncoding};
use pardalis::platform::{OdometryErrors, Platform, PoseCovariance, StampedPose};
use pardalis::shape::{Flat, Shape, Sphere, SphereOutline};
use pardalis::tracker::{BoxedSettings, DetectedSettings, ImageBox, TargetSettings, TrackState};
use pardalis::view::View;
use pardalis::{CameraId, Estimate, FrameSet, PixelFormat, TargetId, Tracker};
use pardalis_core::rng::Draws;
use pardalis_core::simd::Level;
use pardalis_filter::bernoulli::{
    BernoulliFilter, BernoulliSettings, MeasurementComponent, ParticleRange,
};
use pardalis_filter::motion::Motion;
use pardalis_images::RgbImage;

struct Counting;

thread_local! {
    // Of each thread, because the harness allocates on its own.
    static ALLOCATIONS: Cell<usize> = const { Cell::new(0) };
}

// SAFETY: every call is forwarded to the system allocator.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        ALLOCATIONS.set(ALLOCATIONS.get() + 1);
        // SAFETY: the caller fulfils the contract of `GlobalAlloc::alloc`.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: as above; the memory was allocated by the system allocator.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// Converts pictures to frame sets in two alternating formats.
fn sets(
    fps: f64,
    indices: std::ops::Range<usize>,
    pictures: impl Fn(usize) -> Vec<RgbImage>,
) -> Vec<FrameSet> {
    let set_at = |index: usize| {
        let format = [PixelFormat::Rgb8, PixelFormat::Yuyv][index % 2];
        let time_s = index as f64 / fps;
        let frames = pictures(index).into_iter().enumerate();
        let frames = frames.map(|(camera, picture)| {
            let frame = frame(&picture, format, YuvEncoding::default(), time_s);
            (CameraId::new(camera), frame)
        });
        FrameSet::new(frames).unwrap()
    };
    indices.map(set_at).collect()
}

/// Runs this on a single thread, whose allocations are counted.
fn on_one_thread(run: impl FnOnce() + Send) {
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build();
    pool.unwrap().install(run);
}

/// Tracks targets through the sets, the first `warm_up` of which may allocate. Returns the last estimates.
fn check(
    what: &str,
    views: Vec<View>,
    targets: Vec<TargetSettings>,
    sets: &[FrameSet],
    warm_up: usize,
) -> Vec<Estimate> {
    let mut tracker = Tracker::new(views, targets, 1, Level::best()).unwrap();
    let mut step = |set: &FrameSet| {
        let before = ALLOCATIONS.get();
        tracker.observe(set).unwrap();
        for target in tracker.targets() {
            let estimate = tracker.estimate_at(target, set.time_s()).unwrap();
            assert!(
                estimate.kinematics.is_some() || set.time_s() < 0.2,
                "{what}"
            );
        }
        ALLOCATIONS.get() - before
    };
    on_one_thread(|| {
        let first: usize = sets[..warm_up].iter().map(&mut step).sum();
        assert!(first > 0, "the allocator must count the first allocations");
        for (number, set) in sets[warm_up..].iter().enumerate() {
            assert_eq!(step(set), 0, "{what}, frame {number} after the warm-up");
        }
    });
    let estimates = tracker.targets().map(|target| tracker.estimate(target));
    estimates.map(Result::unwrap).collect()
}

/// Checks a detected ball in one camera and in two.
fn check_detected() {
    let of_ball = sets(FPS, 0..40, |index| vec![jump_picture(index)]);
    let ball = || vec![detected_ball().into()];
    // The first searches of whole images in each format allocate buffers.
    check("fisheye", vec![fisheye_view()], ball(), &of_ball, 12);
    let of_two = sets(FPS, 0..40, |index| vec![jump_picture(index); 2]);
    let views = vec![fisheye_view(), fisheye_view()];
    check("two cameras", views.clone(), ball(), &of_two, 12);
    // Each frame comes between two of the other camera.
    let by_turns = (0..60).map(|index| {
        let time_s = index as f64 / FPS;
        let picture = jump_picture(index);
        let frame = frame(&picture, PixelFormat::Rgb8, YuvEncoding::default(), time_s);
        FrameSet::of(CameraId::new(index % 2), frame)
    });
    let by_turns: Vec<FrameSet> = by_turns.collect();
    check("two cameras by turns", views, ball(), &by_turns, 24);
    // As many particles as each update needs.
    let mut ball = detected_ball();
    ball.particles.min = 100;
    check(
        "few particles",
        vec![fisheye_view()],
        vec![ball.into()],
        &of_ball,
        12,
    );
}

/// Checks a ball that is found by boxes in two cameras, and a crowd.
fn check_boxed() {
    let lens = Pinhole::new([200.0; 2], [159.5, 119.5], &[]).unwrap();
    let view =
        |x_m: f64| View::new(lens, Pose::translation(x_m, 0.0, 0.0), (320, 240), None).unwrap();
    let ball = BoxedSettings::new(Shape::Sphere(
        Sphere::new(0.1, SphereOutline::Tangent).unwrap(),
    ));
    // 2 m ahead of both cameras, and one that moves to and fro beside it.
    let set = |index: usize| {
        let time_s = index as f64 / FPS;
        let aside_m = 0.5 + 0.1 * libm::sin(3.0 * time_s);
        let mut set = FrameSet::without_frames(time_s).unwrap();
        for (camera, x_m) in [0.0, 0.3].into_iter().enumerate() {
            let found = |at_m: f64| {
                let center_px = [159.5 + 100.0 * (at_m - x_m), 119.5];
                ImageBox::around_circle(center_px, 10.0).unwrap()
            };
            let camera = CameraId::new(camera);
            set = set
                .with_boxes(camera, TargetId::new(0), vec![found(0.0)])
                .unwrap();
            let both = vec![found(0.0), found(aside_m)];
            set = set.with_boxes(camera, TargetId::new(1), both).unwrap();
        }
        set
    };
    let sets: Vec<FrameSet> = (0..40).map(set).collect();
    let targets = vec![ball.clone().into(), TargetSettings::boxed_crowd(ball, 5)];
    check("boxes", vec![view(0.0), view(0.3)], targets, &sets, 12);
}

/// Checks a detected ball in a camera on a platform, which is observed before each frame.
fn check_moving() {
    let sets = sets(FPS, 0..40, |index| vec![jump_picture(index)]);
    let mut setup = Tracker::builder();
    let platform = setup.platform(Platform::new(OdometryErrors::default()).unwrap());
    setup.camera_on(platform, fisheye_view()).unwrap();
    let ball = setup.target(detected_ball());
    let mut tracker = setup.build().unwrap();
    on_one_thread(|| {
        for (number, set) in sets.iter().enumerate() {
            let before = ALLOCATIONS.get();
            let pose = StampedPose {
                time_s: set.time_s(),
                world_from_platform: Pose::translation(0.01 * number as f64, 0.0, 0.0),
                covariance: PoseCovariance::of_sigmas(0.01, 0.01).unwrap(),
            };
            tracker.observe_pose(platform, &pose).unwrap();
            tracker.observe(set).unwrap();
            let estimate = tracker.estimate(ball).unwrap();
            assert!(estimate.kinematics.is_some() || number < 5);
            let allocated = ALLOCATIONS.get() - before;
            assert!(allocated == 0 || number < 12, "moving, frame {number}");
        }
    });
}

/// Checks two detected balls of equal size and colours, with data association.
fn check_look_alikes() {
    let picture = |index: usize| open(&format!("dioptric-two-balls/frames/{index:06}.jpg"));
    let sets = sets(FPS, 0..78, |index| vec![picture(index)]);
    let crowd = TargetSettings::crowd(detected_ball(), 4);
    check("a crowd", vec![fisheye_view()], vec![crowd], &sets, 12);
    let balls = [detected_ball(), detected_ball()].map(TargetSettings::from);
    let estimates = check("two balls", vec![fisheye_view()], balls.into(), &sets, 12);
    let positions_m = estimates
        .iter()
        .map(|estimate| Vector3::from(estimate.kinematics.unwrap().position_m));
    let [one_m, other_m] = positions_m.collect::<Vec<_>>()[..] else {
        panic!("two targets");
    };
    assert!(
        (one_m - other_m).norm() > 0.5,
        "each target must be a different ball"
    );
}

/// Width and height of the pictures of a streak, in pixels, and the focal length of their camera.
const STREAK_SIZE: (u32, u32) = (1280, 120);
const STREAK_FOCAL_PX: f64 = 500.0;
const STREAK_RADIUS_M: f64 = 0.1;

/// The ball in the middle of an exposure: it moves by a diameter a frame.
fn streak_m(index: f64) -> Vector3<f64> {
    Vector3::new(2.0 * STREAK_RADIUS_M * index - 4.5, 0.0, 4.0)
}

/// Returns a picture of an orange ball that moves while the shutter is open, for this share of the time between
/// frames, and its mask.
fn streak_picture(index: usize, exposure: f64) -> (RgbImage, Vec<bool>) {
    const PARTS: usize = 16;
    let (width, height) = STREAK_SIZE;
    let centers: Vec<Vector3<f64>> = (0..PARTS)
        .map(|part| (part as f64 + 0.5) / PARTS as f64 - 0.5)
        .map(|moved| streak_m(index as f64 + exposure * moved))
        .collect();
    let mut picture = RgbImage::new(width, height);
    let mut mask = Vec::new();
    for (x, y, pixel) in picture.enumerate_pixels_mut() {
        let ray = Vector3::new(f64::from(x) - 639.5, f64::from(y) - 59.5, STREAK_FOCAL_PX);
        let share_of = |center: &Vector3<f64>| {
            let off = ray.angle(center) - (STREAK_RADIUS_M / center.norm()).asin();
            0.5 * libm::erfc(off * STREAK_FOCAL_PX / 1.2)
        };
        let is_near = ray.angle(&streak_m(index as f64)) < 0.1;
        let near = centers.iter().filter(|_| is_near);
        let share = near.map(share_of).sum::<f64>() / PARTS as f64;
        mask.push(share > 0.5);
        let ball_and_ground = [(230.0, 60.0), (110.0, 100.0), (20.0, 70.0)];
        for (value, (ball, ground)) in pixel.iter_mut().zip(ball_and_ground) {
            *value = (ground + share * (ball - ground)) as u8;
        }
    }
    (picture, mask)
}

/// Checks a ball in motion blur, whose streaks are fitted.
fn check_streaks() {
    let (still, mask) = streak_picture(20, 0.0);
    let still = frame(&still, PixelFormat::Rgb8, YuvEncoding::default(), 0.0);
    let colors = ColorModel::from_image(&still, &mask).unwrap();
    let sets = sets(FPS, 0..44, |index| vec![streak_picture(index, 0.6).0]);
    let view = || {
        let size = (STREAK_SIZE.0 as usize, STREAK_SIZE.1 as usize);
        let lens = Pinhole::new([STREAK_FOCAL_PX; 2], [639.5, 59.5], &[]).unwrap();
        vec![View::new(lens, Pose::identity(), size, None).unwrap()]
    };
    let mut ball = DetectedSettings::ball(STREAK_RADIUS_M, colors).unwrap();
    let estimate = check("streak", view(), vec![ball.clone().into()], &sets, 20)[0];
    assert_eq!(estimate.state, TrackState::Tracking);
    let found_m = Vector3::from(estimate.kinematics.unwrap().position_m);
    let off_rad = found_m.angle(&streak_m(43.0));
    assert!(off_rad < 0.002, "{off_rad}");
    // It is by its streaks that the ball is known all the time.
    ball.tuning.detection.min_streak_diameters = 1000.0;
    ball.tuning.detection.min_streak_elongation = 1000.0;
    let mut without = Tracker::new(view(), vec![ball], 1, Level::best()).unwrap();
    let is_known = |set: &&FrameSet| {
        without.observe(set).unwrap();
        let estimate = without.estimate(TargetId::new(0)).unwrap();
        estimate.kinematics.is_some()
    };
    let known = sets.iter().filter(is_known).count();
    assert!(known < 35, "{known} of {}", sets.len());
}

/// Size of the pictures of a rectangle that turns, in pixels, the focal length of their camera, and its height above the ground, in metres.
const GROUND_SIZE: (u32, u32) = (320, 240);
const GROUND_FOCAL_PX: f64 = 200.0;
const GROUND_HEIGHT_M: f64 = 3.0;

/// The place and the heading of the rectangle.
fn turning(index: usize) -> ([f64; 2], f64) {
    let heading_rad = 0.03 * index as f64;
    let (sin, cos) = libm::sincos(heading_rad);
    // It drives along a circle around (0, 0.7).
    ([0.7 * sin, 0.7 - 0.7 * cos], heading_rad)
}

/// Returns a picture of a blue rectangle of 0.8 by 0.3 m on the ground, seen from above, and its mask.
fn turning_picture(index: usize) -> (RgbImage, Vec<bool>) {
    let ([x, y], heading_rad) = turning(index);
    let (sin, cos) = libm::sincos(heading_rad);
    let m_per_px = GROUND_HEIGHT_M / GROUND_FOCAL_PX;
    let mut picture = RgbImage::new(GROUND_SIZE.0, GROUND_SIZE.1);
    let mut mask = Vec::new();
    for (u, v, pixel) in picture.enumerate_pixels_mut() {
        let [dx, dy] = [
            (f64::from(u) - 159.5) * m_per_px - x,
            (119.5 - f64::from(v)) * m_per_px - y,
        ];
        let (ahead, left) = (cos * dx + sin * dy, cos * dy - sin * dx);
        let off_m = (ahead.abs() - 0.4).max(left.abs() - 0.15);
        let share = 0.5 * libm::erfc(off_m / m_per_px / 1.2);
        mask.push(share > 0.5);
        let body_and_ground = [(30.0, 110.0), (80.0, 105.0), (200.0, 90.0)];
        for (value, (body, ground)) in pixel.iter_mut().zip(body_and_ground) {
            *value = (ground + share * (body - ground)) as u8;
        }
    }
    (picture, mask)
}

/// Checks a rectangle that turns, whose yaw is fitted.
fn check_turning() {
    let (still, mask) = turning_picture(5);
    let still = frame(&still, PixelFormat::Rgb8, YuvEncoding::default(), 0.0);
    let colors = ColorModel::from_image(&still, &mask).unwrap();
    let sets = sets(FPS, 0..60, |index| vec![turning_picture(index).0]);
    let size = (GROUND_SIZE.0 as usize, GROUND_SIZE.1 as usize);
    let lens = Pinhole::new([GROUND_FOCAL_PX; 2], [159.5, 119.5], &[]).unwrap();
    let above_m = Vector3::new(0.0, 0.0, GROUND_HEIGHT_M);
    let pose = looking_at(above_m, Vector3::zeros(), 0.0).unwrap();
    let view = View::new(lens, pose, size, None).unwrap();
    let shape = Shape::Flat(Flat::rectangle([0.8, 0.3], 0.0).unwrap());
    let target = DetectedSettings::new(shape, colors);
    let estimate = check("turning", vec![view], vec![target.into()], &sets, 12)[0];
    let ([x, y], heading_rad) = turning(59);
    let [found_x, found_y, _] = estimate.kinematics.unwrap().position_m;
    assert!((found_x - x).hypot(found_y - y) < 0.01, "{estimate:?}");
    let off_rad = estimate.heading_rad.unwrap() - heading_rad;
    assert!(off_rad.abs() < 0.01, "{off_rad}");
    assert!(estimate.heading_sigma_rad.unwrap() < 0.05);
}

/// Checks updates of the Bernoulli filter with and without measurement components.
fn check_bernoulli(particles: ParticleRange) {
    let mut settings = BernoulliSettings::of(Motion::DEFAULT);
    settings.particles = particles;
    let mut filter = BernoulliFilter::new(settings, Draws::new(1, 0)).unwrap();
    let mut step = |components: &[MeasurementComponent]| {
        let before = ALLOCATIONS.get();
        filter.predict(0.04);
        filter.update(components, f64::INFINITY, |particles, out| {
            for (x, out) in particles.columns()[0].iter().zip(out) {
                *out = 20.0 - 800.0 * x * x;
            }
        });
        assert!(filter.estimate(0.01).is_some() && filter.existence() > 0.5);
        ALLOCATIONS.get() - before
    };
    let components = [-0.05, 0.05, 2.0].map(|x| MeasurementComponent {
        position_m: [x, 0.0, 1.0],
        covariance_m2: [0.01, 0.002, 0.0, 0.02, 0.0, 0.03],
        log_weight: 1.0,
    });
    for components in [&components[..], &components[..1], &[], &components] {
        assert_eq!(step(components), 0, "{} components", components.len());
    }
}

#[test]
fn steps_after_the_first_frames_do_not_allocate() {
    for particles in [
        ParticleRange::fixed(500),
        ParticleRange { min: 50, max: 500 },
    ] {
        on_one_thread(|| check_bernoulli(particles));
    }
    check_detected();
    check_moving();
    check_boxed();
    check_look_alikes();
    check_streaks();
    check_turning();
    let of_ball = sets(FPS, 20..30, |index| vec![jump_picture(index)]);
    let of_robot = sets(robot::FPS, 20..30, |index| vec![robot::picture(index)]);
    for particle_count in [300, 3001] {
        let ball = ball_target(Palette::HSI, particle_count);
        let of = |target: &str| format!("{target}, {particle_count} particles");
        // The first frame in each format allocates tables and buffers.
        check(
            &of("ball"),
            vec![fisheye_view()],
            vec![ball.into()],
            &of_ball,
            2,
        );
        let robot = vec![robot_target(particle_count)];
        check(&of("robot"), vec![mast_view()], robot, &of_robot, 2);
    }
}
