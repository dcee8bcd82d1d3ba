//! A warm step allocates nothing: buffers belong to the filter and the cue.
#![allow(unsafe_code)] // a counting allocator passes every call on to the system's

#[path = "integration/common/mod.rs"]
mod common;

use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicUsize, Ordering};

use common::robot::{self, mast_view, robot_target};
use common::{FPS, ball_target, fisheye_view, frame, jump_picture};
use pardalis::color::{Palette, YuvEncoding};
use pardalis::tracker::TargetSettings;
use pardalis::view::View;
use pardalis::{Frame, PixelFormat, Tracker};
use pardalis_core::rng::Draws;
use pardalis_core::simd::Level;
use pardalis_filter::bernoulli::{BernoulliFilter, BernoulliSettings, MeasurementComponent};
use pardalis_filter::motion::Motion;
use pardalis_images::RgbImage;

struct Counting;

static ALLOCATIONS: AtomicUsize = AtomicUsize::new(0);

// SAFETY: every call is the system allocator's.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        ALLOCATIONS.fetch_add(1, Ordering::Relaxed);
        // SAFETY: the caller keeps the system allocator's rules.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: as above; the memory is the system allocator's.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// Pictures as frames in two formats by turns.
fn frames(fps: f64, picture: impl Fn(usize) -> RgbImage) -> Vec<[(usize, Frame); 1]> {
    let frame_at = |index: usize| {
        let format = [PixelFormat::Rgb8, PixelFormat::Yuyv][index % 2];
        let time_s = index as f64 / fps;
        [(
            0,
            frame(&picture(index), format, YuvEncoding::default(), time_s),
        )]
    };
    (20..30).map(frame_at).collect()
}

fn check(view: View, target: TargetSettings, frames: &[[(usize, Frame); 1]]) {
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(1)
        .build()
        .unwrap();
    let particle_count = target.bodies[0].filter.particle_count;
    let mut tracker = Tracker::new(vec![view], [target], 1, Level::best()).unwrap();
    let mut step = |frames: &[(usize, Frame)]| {
        let time_s = frames[0].1.time_s();
        let before = ALLOCATIONS.load(Ordering::Relaxed);
        tracker.observe(frames, time_s).unwrap();
        let estimate = tracker.estimate_at(0, time_s);
        assert!(estimate.kinematics.is_some());
        ALLOCATIONS.load(Ordering::Relaxed) - before
    };
    pool.install(|| {
        // The first frames of either format make tables and buffers.
        let first = step(&frames[0]) + step(&frames[1]);
        assert!(first > 0, "the allocator counts");
        for frames in &frames[2..] {
            assert_eq!(step(frames), 0, "{particle_count} particles");
        }
    });
}

/// Two updates with peaks, one of them after survivors were drawn, and one without.
fn check_bernoulli() {
    let settings = BernoulliSettings::of(Motion::DEFAULT);
    let mut filter = BernoulliFilter::new(settings, Draws::new(1, 0)).unwrap();
    let mut step = |peaks: &[MeasurementComponent]| {
        let before = ALLOCATIONS.load(Ordering::Relaxed);
        filter.predict(0.04);
        filter.update(peaks, f64::INFINITY, |particles, out| {
            for (x, out) in particles.columns()[0].iter().zip(out) {
                *out = 20.0 - 800.0 * x * x;
            }
        });
        assert!(filter.estimate(0.01).is_some() && filter.existence() > 0.5);
        ALLOCATIONS.load(Ordering::Relaxed) - before
    };
    let peaks = [-0.05, 0.05, 2.0].map(|x| MeasurementComponent {
        position_m: [x, 0.0, 1.0],
        covariance_m2: [0.01, 0.002, 0.0, 0.02, 0.0, 0.03],
        log_weight: 1.0,
    });
    assert!(step(&peaks) > 0, "the first peaks are kept");
    for peaks in [&peaks[..], &peaks[..1], &[], &peaks] {
        assert_eq!(step(peaks), 0, "{} peaks", peaks.len());
    }
}

/// The only test of this file: another's allocations would be counted too.
#[test]
fn a_warm_step_allocates_nothing() {
    check_bernoulli();
    let of_ball = frames(FPS, jump_picture);
    let of_robot = frames(robot::FPS, robot::picture);
    for particle_count in [300, 3001] {
        let ball = ball_target(Palette::HSI, particle_count);
        check(fisheye_view(), ball.into(), &of_ball);
        check(mast_view(), robot_target(particle_count), &of_robot);
    }
}
