//! Localisation with the published cues where there is no ball.

use crate::common::{ball_target, data, fisheye_view, frame, jump_picture, set_of};
use nalgebra::Point3;
use pardalis::color::{Palette, YuvEncoding};
use pardalis::start::{PixelStart, Start};
use pardalis::tracker::{PASSES_SIGMA_M, TrackState};
use pardalis::{PixelFormat, Tracker};
use pardalis_core::simd::Level;

/// Distance of pixels of the grid from each other, and from a ball that is not to be found, in pixels.
const STEP_PX: usize = 60;
const CLEAR_PX: f64 = 80.0;

/// Returns the true position and pixel of the ball in a frame of data/dioptric-jump.
fn truth(index: usize) -> ([f64; 3], [f64; 2]) {
    let text = std::fs::read_to_string(data("dioptric-jump/truth.csv")).unwrap();
    let row: Vec<&str> = text.lines().nth(index + 1).unwrap().split(',').collect();
    let column = |i: usize| row[i].parse::<f64>().unwrap();
    ([4, 5, 6].map(column), [13, 14].map(column))
}

#[test]
fn nothing_is_found_where_there_is_no_ball() {
    let target = ball_target(Palette::HSI, 1000);
    let mut tracker = Tracker::new(vec![fisheye_view()], vec![target], 1, Level::best()).unwrap();
    let (mut searched, mut found) = (0, 0);
    for index in [0, 40] {
        let (position_m, ball_px) = truth(index);
        let picture = jump_picture(index);
        let image = frame(&picture, PixelFormat::Rgb8, YuvEncoding::default(), 0.0);
        let set = set_of(image);
        let mut locate = |at_px: [f64; 2]| {
            let start = Start::Pixel(PixelStart::at(0, at_px));
            let located = tracker.locate(&set, &[Some(start)], &PASSES_SIGMA_M);
            located.ok().map(|estimates| estimates[0])
        };
        let at_ball = locate(ball_px).unwrap();
        assert_eq!(at_ball.state, TrackState::Tracking, "frame {index}");
        assert!(at_ball.confidence > 0.5, "frame {index}: {at_ball:?}");
        let rows = (0..480).step_by(STEP_PX);
        for (u, v) in rows.flat_map(|v| (0..640).step_by(STEP_PX).map(move |u| (u, v))) {
            let at_px = [u as f64, v as f64];
            let away_px = (at_px[0] - ball_px[0]).hypot(at_px[1] - ball_px[1]);
            // Outside of the field of view there is nothing to search.
            let Some(estimate) = locate(at_px).filter(|_| away_px > CLEAR_PX) else {
                continue;
            };
            searched += 1;
            if let Some(known) = estimate.kinematics {
                let off_m = (Point3::from(known.position_m) - Point3::from(position_m)).norm();
                // The search may have led to the ball.
                found += usize::from(off_m > 0.5);
            }
        }
    }
    assert!(searched > 60, "{searched} pixels");
    assert_eq!(found, 0, "of {searched} pixels");
}
