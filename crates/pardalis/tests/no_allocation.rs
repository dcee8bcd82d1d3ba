//! After the first frames, a step allocates no memory.
#![allow(unsafe_code)] // a counting allocator passes every call on to the system's

#[path = "integration/common/mod.rs"]
mod common;

use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicUsize, Ordering};

use common::robot::{self, mast_view, robot_target};
use common::{FPS, ball_target, detected_ball, fisheye_view, frame, jump_picture, open};
use nalgebra::Vector3;
use pardalis::color::{Palette, YuvEncoding};
use pardalis::tracker::TargetSettings;
use pardalis::view::View;
use pardalis::{CameraId, Estimate, FrameSet, PixelFormat, Tracker};
use pardalis_core::rng::Draws;
use pardalis_core::simd::Level;
use pardalis_filter::bernoulli::{BernoulliFilter, BernoulliSettings, MeasurementComponent};
use pardalis_filter::motion::Motion;
use pardalis_images::RgbImage;

struct Counting;

static ALLOCATIONS: AtomicUsize = AtomicUsize::new(0);

// SAFETY: every call is forwarded to the system allocator.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        ALLOCATIONS.fetch_add(1, Ordering::Relaxed);
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

/// Tracks targets through the sets, the first `warm_up` of which may allocate. Returns the last estimates.
fn check(
    what: &str,
    views: Vec<View>,
    targets: Vec<TargetSettings>,
    sets: &[FrameSet],
    warm_up: usize,
) -> Vec<Estimate> {
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(1)
        .build()
        .unwrap();
    let mut tracker = Tracker::new(views, targets, 1, Level::best()).unwrap();
    let mut step = |set: &FrameSet| {
        let before = ALLOCATIONS.load(Ordering::Relaxed);
        tracker.observe(set).unwrap();
        for target in tracker.targets() {
            let estimate = tracker.estimate_at(target, set.time_s()).unwrap();
            assert!(
                estimate.kinematics.is_some() || set.time_s() < 0.2,
                "{what}"
            );
        }
        ALLOCATIONS.load(Ordering::Relaxed) - before
    };
    pool.install(|| {
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
    check("two cameras", views, ball(), &of_two, 12);
}

/// Checks two detected balls of equal size and colours, with data association.
fn check_look_alikes() {
    let picture = |index: usize| open(&format!("dioptric-two-balls/frames/{index:06}.jpg"));
    let sets = sets(FPS, 0..78, |index| vec![picture(index)]);
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

/// Checks updates of the Bernoulli filter with and without measurement components.
fn check_bernoulli() {
    let settings = BernoulliSettings::of(Motion::DEFAULT);
    let mut filter = BernoulliFilter::new(settings, Draws::new(1, 0)).unwrap();
    let mut step = |components: &[MeasurementComponent]| {
        let before = ALLOCATIONS.load(Ordering::Relaxed);
        filter.predict(0.04);
        filter.update(components, f64::INFINITY, |particles, out| {
            for (x, out) in particles.columns()[0].iter().zip(out) {
                *out = 20.0 - 800.0 * x * x;
            }
        });
        assert!(filter.estimate(0.01).is_some() && filter.existence() > 0.5);
        ALLOCATIONS.load(Ordering::Relaxed) - before
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

/// The only test of this file, because allocations of others would be counted.
#[test]
fn steps_after_the_first_frames_do_not_allocate() {
    check_bernoulli();
    check_detected();
    check_look_alikes();
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
