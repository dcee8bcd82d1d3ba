//! The same seed and frames give the same bits, for any number of threads and any CPU level.

mod common;

use common::{FPS, ball_target, fisheye_view, frame, jump_picture};
use pardalis::color::{Palette, YuvEncoding};
use pardalis::simd::Level;
use pardalis::{Estimate, Frame, PixelFormat, Tracker};
use rayon::ThreadPoolBuilder;

/// Enough that every kernel splits its work among threads, and no whole number of blocks.
const PARTICLES: usize = 3001;

/// Follows the ball on a pool of so many threads.
fn estimates(frames: &[Frame], threads: usize, level: Level, seed: u32) -> Vec<Estimate> {
    let pool = ThreadPoolBuilder::new()
        .num_threads(threads)
        .build()
        .unwrap();
    pool.install(|| {
        let target = ball_target(Palette::HSI, PARTICLES);
        let mut tracker = Tracker::new(vec![fisheye_view()], vec![target], seed, level).unwrap();
        frames
            .iter()
            .map(|frame| {
                tracker
                    .observe(&[(0, frame.clone())], frame.time_s())
                    .unwrap();
                tracker.estimate_at(0, frame.time_s() + 0.01)
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
    let expected = estimates(&frames, 1, Level::BASELINE, 7);
    assert!(
        expected
            .iter()
            .all(|estimate| estimate.kinematics.is_some())
    );
    for level in Level::available() {
        for threads in [1, 2, 3, 8] {
            let found = estimates(&frames, threads, level, 7);
            assert_eq!(
                bits(&found),
                bits(&expected),
                "{threads} threads at {level:?}"
            );
        }
    }
    for (other, expected) in estimates(&frames, 1, Level::best(), 8)
        .iter()
        .zip(&expected)
    {
        assert_ne!(other, expected, "another seed draws other particles");
    }
}
