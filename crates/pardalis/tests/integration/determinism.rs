//! The same seed and frames give the same bits, for any number of threads and any CPU level.

use crate::common::robot::{self, mast_view, robot_target};
use crate::common::{FPS, ball_target, fisheye_view, frame, jump_picture, set_of};
use pardalis::color::{Palette, YuvEncoding};
use pardalis::tracker::TargetSettings;
use pardalis::view::View;
use pardalis::{Estimate, Frame, PixelFormat, TargetId, Tracker};
use pardalis_core::simd::Level;
use rayon::ThreadPoolBuilder;

/// Enough for every kernel to divide its work among threads, and not a multiple of the block size.
const PARTICLES: usize = 3001;

/// Tracks a target on a pool with this number of threads.
fn estimates(
    (view, target): &(View, TargetSettings),
    frames: &[Frame],
    threads: usize,
    level: Level,
    seed: u32,
) -> Vec<Estimate> {
    let pool = ThreadPoolBuilder::new()
        .num_threads(threads)
        .build()
        .unwrap();
    pool.install(|| {
        let (views, targets) = (vec![view.clone()], vec![target.clone()]);
        let mut tracker = Tracker::new(views, targets, seed, level).unwrap();
        frames
            .iter()
            .map(|frame| {
                tracker.observe(&set_of(frame.clone())).unwrap();
                let target = TargetId::new(0);
                let time_s = frame.time_s() + 0.01;
                tracker.estimate_at(target, time_s).unwrap()
            })
            .collect()
    })
}

/// Returns a text for each estimate that differs if any bit does: numbers are printed with all digits needed to read
/// back the same value.
fn bits(estimates: &[Estimate]) -> Vec<String> {
    estimates
        .iter()
        .map(|estimate| format!("{estimate:?}"))
        .collect()
}

/// Asserts that the estimates are the same for all levels and numbers of threads, and differ for another seed.
fn check(scene: &(View, TargetSettings), frames: &[Frame]) {
    let expected = estimates(scene, frames, 1, Level::BASELINE, 7);
    assert!(
        expected
            .iter()
            .all(|estimate| estimate.kinematics.is_some())
    );
    for level in Level::available() {
        for threads in [1, 2, 3, 8] {
            let found = estimates(scene, frames, threads, level, 7);
            assert_eq!(
                bits(&found),
                bits(&expected),
                "{threads} threads at {level:?}"
            );
        }
    }
    for (other, expected) in estimates(scene, frames, 1, Level::best(), 8)
        .iter()
        .zip(&expected)
    {
        assert_ne!(other, expected, "another seed must give other particles");
    }
}

#[test]
fn estimates_depend_on_the_seed_but_not_on_threads_and_levels() {
    let frame_at = |index: usize| {
        let time_s = index as f64 / FPS;
        frame(
            &jump_picture(index),
            PixelFormat::Rgb8,
            YuvEncoding::default(),
            time_s,
        )
    };
    let frames: Vec<Frame> = (20..32).map(frame_at).collect();
    let target = ball_target(Palette::HSI, PARTICLES);
    check(&(fisheye_view(), target.into()), &frames);
}

#[test]
fn estimates_of_landmarks_depend_on_the_seed_but_not_on_threads_and_levels() {
    let frame_at = |index: usize| {
        let time_s = index as f64 / robot::FPS;
        let format = [PixelFormat::Rgb8, PixelFormat::Nv12][index % 2];
        frame(
            &robot::picture(index),
            format,
            YuvEncoding::default(),
            time_s,
        )
    };
    let frames: Vec<Frame> = (0..8).map(frame_at).collect();
    check(&(mast_view(), robot_target(PARTICLES)), &frames);
}
