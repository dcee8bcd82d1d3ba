//! Balls so fast that they are only seen as pale streaks.

use nalgebra::{Rotation3, Translation3, Vector3};
use pardalis::camera::{Pinhole, Pose};
use pardalis::color::{ColorModel, YuvEncoding};
use pardalis::tracker::{Candidate, DetectedSettings, Origin, TrackState};
use pardalis::view::View;
use pardalis::{CameraId, FrameSet, PixelFormat, TargetId, Tracker};
use pardalis_core::simd::Level;
use pardalis_images::RgbImage;

use crate::common::frame;

const SIZE: (u32, u32) = (900, 160);
const FOCAL_PX: f64 = 500.0;
const RADIUS_M: f64 = 0.1;
const FPS: f64 = 30.0;
/// The share of the time between frames for which the shutter is open.
const EXPOSURE: f64 = 0.75;
/// The first frame with the ball.
const FIRST: usize = 8;
const FRAMES: usize = 20;

/// The ball in the middle of an exposure: it moves by two and a half diameters a frame.
fn ball_m(index: f64) -> Vector3<f64> {
    Vector3::new(0.55 * (index - FIRST as f64) - 3.0, 0.1, 4.0)
}

/// Returns a picture of a green ball in front of a grey wall with a window, and its mask.
fn picture(index: usize, exposure: f64) -> (RgbImage, Vec<bool>) {
    const PARTS: usize = 32;
    let centers = (0..PARTS).map(|part| {
        let moved = (part as f64 + 0.5) / PARTS as f64 - 0.5;
        ball_m(index as f64 + exposure * moved)
    });
    let centers: Vec<Vector3<f64>> = centers.filter(|_| index >= FIRST).collect();
    let mut picture = RgbImage::new(SIZE.0, SIZE.1);
    let mut mask = Vec::new();
    for (x, y, pixel) in picture.enumerate_pixels_mut() {
        let ray = Vector3::new(f64::from(x) - 449.5, f64::from(y) - 79.5, FOCAL_PX);
        let share_of = |center: &Vector3<f64>| {
            let off = ray.angle(center) - (RADIUS_M / center.norm()).asin();
            0.5 * libm::erfc(off * FOCAL_PX / 1.2)
        };
        let share = centers.iter().map(share_of).sum::<f64>() / PARTS as f64;
        mask.push(share > 0.5);
        let is_window = (300..420).contains(&x) && y < 40;
        let ground = if is_window {
            [200.0, 210.0, 220.0]
        } else {
            [150.0, 140.0, 130.0]
        };
        for (value, (ball, ground)) in pixel
            .iter_mut()
            .zip([100.0, 120.0, 85.0].into_iter().zip(ground))
        {
            *value = (ground + share * (ball - ground)) as u8;
        }
    }
    (picture, mask)
}

/// Tracks the ball. If there is another camera, which looks elsewhere, its frames come in between. Returns in how many frames the ball is tracked, how many radians it
/// is off in these at most, and whether something was examined because it moves.
fn tracked(has_other: bool, change: impl FnOnce(&mut DetectedSettings)) -> (usize, f64, bool) {
    let rgb = |picture: &RgbImage, time_s: f64| {
        frame(picture, PixelFormat::Rgb8, YuvEncoding::default(), time_s)
    };
    let (still, mask) = picture(FIRST + 6, 0.0);
    let colors = ColorModel::from_image(&rgb(&still, 0.0), &mask).unwrap();
    let mut ball = DetectedSettings::ball(RADIUS_M, colors).unwrap();
    change(&mut ball);
    let lens = Pinhole::new([FOCAL_PX; 2], [449.5, 79.5], &[]).unwrap();
    let size = (SIZE.0 as usize, SIZE.1 as usize);
    let backwards = Pose::from_parts(
        Translation3::identity(),
        Rotation3::from_axis_angle(&Vector3::y_axis(), std::f64::consts::PI),
    );
    let poses = [Pose::identity(), backwards].into_iter();
    let poses = poses.take(1 + usize::from(has_other));
    let views = poses.map(|pose| View::new(lens, pose, size, None).unwrap());
    let mut tracker = Tracker::new(views.collect(), vec![ball], 1, Level::best()).unwrap();
    let elsewhere = RgbImage::from_pixel(SIZE.0, SIZE.1, [40, 60, 90]);
    let target = TargetId::new(0);
    let (mut count, mut most_rad, mut is_moving) = (0, 0.0_f64, false);
    for index in 0..FRAMES {
        let time_s = index as f64 / FPS;
        let frames = [(CameraId::new(0), rgb(&picture(index, EXPOSURE).0, time_s))];
        tracker.observe(&FrameSet::new(frames).unwrap()).unwrap();
        let is_of_motion = |candidate: &Candidate| matches!(candidate.origin, Origin::Motion(..));
        let candidates = tracker.candidates(target).unwrap();
        is_moving |= candidates.flatten().any(is_of_motion);
        let estimate = tracker.estimate(target).unwrap();
        if has_other {
            let time_s = time_s + 0.5 / FPS;
            let frames = [(CameraId::new(1), rgb(&elsewhere, time_s))];
            tracker.observe(&FrameSet::new(frames).unwrap()).unwrap();
        }
        if estimate.state == TrackState::Tracking {
            count += 1;
            let found_m = Vector3::from(estimate.kinematics.unwrap().position_m);
            most_rad = most_rad.max(found_m.angle(&ball_m(index as f64)));
        }
    }
    (count, most_rad, is_moving)
}

#[test]
fn a_pale_streak_is_found_because_it_moves() {
    let (count, off_rad, is_moving) = tracked(false, |_| {});
    assert!(is_moving);
    // Two frames must agree.
    assert!(count >= FRAMES - FIRST - 2, "{count}");
    // A tenth of its radius.
    assert!(off_rad < 0.1 * RADIUS_M / 4.0, "{off_rad}");
    // Without motion its colours are too pale.
    let without = tracked(false, |ball| ball.tuning.background.min_change = 1000.0);
    assert!(without.0 + 3 <= count && !without.2, "{without:?}");
}

#[test]
fn frames_of_other_cameras_in_between_hide_no_motion() {
    let (count, _, is_moving) = tracked(true, |_| {});
    assert!(is_moving);
    let (alone, ..) = tracked(false, |_| {});
    assert!(count + 2 >= alone, "{count} {alone}");
}
