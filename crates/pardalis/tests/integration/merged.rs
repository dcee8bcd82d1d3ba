//! A ball that has grown together with something in its colours.

use nalgebra::Vector3;
use pardalis::camera::{Pinhole, Pose};
use pardalis::color::{ColorModel, YuvEncoding};
use pardalis::tracker::{DetectedSettings, Origin, PASSES_SIGMA_M, TrackState, Verdict};
use pardalis::view::View;
use pardalis::{PixelFormat, TargetId, Tracker};
use pardalis_core::simd::Level;
use pardalis_images::RgbImage;

use crate::common::{frame, set_of};

const SIZE: (u32, u32) = (320, 240);
const CENTER_PX: [f64; 2] = [159.5, 119.5];
const FOCAL_PX: f64 = 400.0;
const RADIUS_M: f64 = 0.1;
const BALL_M: [f64; 3] = [-0.1, 0.05, 1.6];

/// Returns a picture of a ball, in front of a bar in its colours of this length if any, and its mask.
fn picture(bar_px: f64) -> (RgbImage, Vec<bool>) {
    let ball_m = Vector3::from(BALL_M);
    let mut picture = RgbImage::new(SIZE.0, SIZE.1);
    let mut mask = Vec::new();
    for (x, y, pixel) in picture.enumerate_pixels_mut() {
        let [x, y] = [f64::from(x), f64::from(y)];
        let ray = Vector3::new(x - CENTER_PX[0], y - CENTER_PX[1], FOCAL_PX);
        let off = ray.angle(&ball_m) - (RADIUS_M / ball_m.norm()).asin();
        let ball = 0.5 * libm::erfc(off * FOCAL_PX);
        mask.push(ball > 0.5);
        let is_bar = (134.0..134.0 + bar_px).contains(&x) && (142.0..154.0).contains(&y);
        let share = ball.max(f64::from(u8::from(is_bar)));
        for (value, [orange, green]) in
            pixel
                .iter_mut()
                .zip([[230.0, 60.0], [110.0, 110.0], [20.0, 70.0]])
        {
            *value = (green + share * (orange - green)) as u8;
        }
    }
    (picture, mask)
}

#[test]
fn single_images_show_a_ball_that_has_grown_together_with_a_bar() {
    let rgb = |picture: &RgbImage| frame(picture, PixelFormat::Rgb8, YuvEncoding::default(), 0.0);
    let (still, mask) = picture(0.0);
    let colors = ColorModel::from_image(&rgb(&still), &mask).unwrap();
    let ball = DetectedSettings::ball(RADIUS_M, colors).unwrap();
    let lens = Pinhole::new([FOCAL_PX; 2], CENTER_PX, &[]).unwrap();
    let size = (SIZE.0 as usize, SIZE.1 as usize);
    let view = View::new(lens, Pose::identity(), size, None).unwrap();
    let mut tracker = Tracker::new(vec![view], vec![ball], 1, Level::best()).unwrap();
    for (bar_px, of_circle) in [(0.0, false), (100.0, true)] {
        let set = set_of(rgb(&picture(bar_px).0));
        let located = tracker.locate(&set, &[None], &PASSES_SIGMA_M).unwrap()[0];
        assert_eq!(located.state, TrackState::Tracking, "{bar_px}: {located:?}");
        let found_m = Vector3::from(located.kinematics.unwrap().position_m);
        let error_m = (found_m - Vector3::from(BALL_M)).norm();
        assert!(error_m < 0.05, "{bar_px}: {found_m}");
        let candidates = tracker.candidates(TargetId::new(0)).unwrap();
        let target = candidates
            .flatten()
            .find(|candidate| candidate.verdict == Verdict::Target);
        let origin = target.expect("what was found").origin;
        assert_eq!(
            matches!(origin, Origin::Circle(..)),
            of_circle,
            "{origin:?}"
        );
    }
}
