//! The same seed and frames give the same bits, for any number of threads and any CPU level.

use crate::common::robot::{self, mast_view, robot_target};
use crate::common::{FPS, ball_target, fisheye_view, frame, jump_picture, set_of};
use pardalis::color::{Palette, YuvEncoding};
use pardalis::tracker::TargetSettings;
use pardalis::view::View;
use pardalis::{Estimate, Frame, PixelFormat, TargetId, Tracker};
use pardalis_core::simd::Level;
use rayon::ThreadPoolBuilder;

/// Enough that every kernel splits its work among threads, and no whole number of blocks.
const PARTICLES: usize = 3001;

/// Follows a target on a pool of so many threads.
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

/// All bits of the estimates: the shortest text that reads back as the same number tells every two numbers apart.
fn bits(estimates: &[Estimate]) -> Vec<String> {
    estimates
        .iter()
        .map(|estimate| format!("{estimate:?}"))
        .collect()
}

/// Holds every level and number of threads to the first, and another seed to something else.
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
        assert_ne!(other, expected, "another seed draws other particles");
    }
}

#[test]
fn threads_and_levels_change_no_bit_and_the_seed_does() {
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
fn nor_do_they_with_landmarks_and_what_changes_between_frames() {
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
