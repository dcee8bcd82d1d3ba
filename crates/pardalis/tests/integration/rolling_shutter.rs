//! Cameras that expose one row after the other.

use nalgebra::Vector3;
use pardalis::camera::{Pinhole, Pose};
use pardalis::color::{ColorModel, YuvEncoding};
use pardalis::tracker::{DetectedSettings, TrackState};
use pardalis::{CameraId, Frame, FrameSet, PixelFormat, TargetId, Tracker, View};
use pardalis_images::RgbImage;

use crate::common::frame;

const SIZE: (u32, u32) = (640, 480);
const FOCAL_PX: f64 = 500.0;
const RADIUS_M: f64 = 0.1;
const FRAMES: usize = 18;
/// 29 ms from the first row to the last.
const LINE_DELAY_S: f64 = 60e-6;
/// The cameras are beside each other.
const PLACES_M: [f64; 2] = [-0.3, 0.3];

/// A ball in flight: it rises, falls and crosses the image.
fn ball_m(time_s: f64) -> Vector3<f64> {
    let below_m = 0.95 - 6.0 * time_s + 4.9 * time_s * time_s;
    Vector3::new(3.5 * time_s - 1.2, below_m, 2.5 + 0.8 * time_s)
}

/// What a camera shows at a time. A row is exposed this long, in seconds, after the row above it.
fn picture(x_m: f64, time_s: f64, line_delay_s: f64) -> (Frame, Vec<bool>) {
    let mut picture = RgbImage::new(SIZE.0, SIZE.1);
    let mut mask = Vec::new();
    for (x, y, pixel) in picture.enumerate_pixels_mut() {
        let row_time_s = time_s + line_delay_s * (f64::from(y) - 239.5);
        let center = ball_m(row_time_s) - Vector3::new(x_m, 0.0, 0.0);
        let ray = Vector3::new(f64::from(x) - 319.5, f64::from(y) - 239.5, FOCAL_PX);
        let off = ray.angle(&center) - (RADIUS_M / center.norm()).asin();
        let share = 0.5 * libm::erfc(off * FOCAL_PX / 1.2);
        mask.push(share > 0.5);
        let (ball, ground) = ([70.0, 150.0, 60.0], [150.0, 140.0, 130.0]);
        for (value, (ball, ground)) in pixel.iter_mut().zip(ball.into_iter().zip(ground)) {
            *value = (ground + share * (ball - ground)) as u8;
        }
    }
    let rgb = frame(&picture, PixelFormat::Rgb8, YuvEncoding::default(), time_s);
    (rgb, mask)
}

/// Tracks the ball with this number of cameras, which expose their rows with a delay, and are thought to do so with another one, both in seconds. Returns the mean errors of
/// position and velocity from the fifth frame on, in metres and m/s.
fn errors(cameras: usize, line_delay_s: f64, assumed_s: f64) -> [f64; 2] {
    let (still, mask) = picture(0.0, 0.4, 0.0);
    let colors = ColorModel::from_image(&still, &mask).unwrap();
    let lens = Pinhole::new([FOCAL_PX; 2], [319.5, 239.5], &[]).unwrap();
    let size = (SIZE.0 as usize, SIZE.1 as usize);
    let mut setup = Tracker::builder();
    for x_m in &PLACES_M[..cameras] {
        let pose = Pose::translation(*x_m, 0.0, 0.0);
        let view = View::new(lens, pose, size, None).unwrap();
        setup.camera(view.with_line_delay_s(assumed_s).unwrap());
    }
    let target: TargetId = setup.target(DetectedSettings::ball(RADIUS_M, colors).unwrap());
    let mut tracker = setup.build().unwrap();
    let mut sums = [0.0; 2];
    for index in 0..FRAMES {
        let time_s = 0.04 * index as f64;
        let frames = PLACES_M[..cameras].iter().enumerate().map(|(camera, x_m)| {
            let (frame, _) = picture(*x_m, time_s, line_delay_s);
            (CameraId::new(camera), frame)
        });
        tracker.observe(&FrameSet::new(frames).unwrap()).unwrap();
        if index >= 4 {
            let estimate = tracker.estimate(target).unwrap();
            assert_eq!(estimate.state, TrackState::Tracking, "{index}");
            let known = estimate.kinematics.unwrap();
            let velocity_mps = (ball_m(time_s + 1e-4) - ball_m(time_s - 1e-4)) / 2e-4;
            sums[0] += (Vector3::from(known.position_m) - ball_m(time_s)).norm();
            sums[1] += (Vector3::from(known.velocity_mps.unwrap()) - velocity_mps).norm();
        }
    }
    sums.map(|sum| sum / (FRAMES - 4) as f64)
}

#[test]
fn balls_are_where_they_are_at_the_time_of_the_frame() {
    for cameras in [1, 2] {
        let global = errors(cameras, 0.0, 0.0);
        let ignored = errors(cameras, LINE_DELAY_S, 0.0);
        let known = errors(cameras, LINE_DELAY_S, LINE_DELAY_S);
        assert!(
            known[0] < 0.25 * ignored[0],
            "{cameras}: {known:?} {ignored:?}"
        );
        // What is left is the delay times the error of the predicted velocity: gravity is not in the motion model.
        assert!(
            known[0] < global[0] + 6e-3,
            "{cameras}: {known:?} {global:?}"
        );
    }
}

#[test]
fn places_are_shown_where_their_rows_are_exposed() {
    let lens = Pinhole::new([FOCAL_PX; 2], [319.5, 239.5], &[]).unwrap();
    let size = (SIZE.0 as usize, SIZE.1 as usize);
    let view = View::new(lens, Pose::identity(), size, None).unwrap();
    let (place_m, velocity_mps) = ([0.4, 0.6, 2.5], [3.0, 2.0, 0.0]);
    assert_eq!(view.shown_position_m(place_m, velocity_mps), place_m);
    assert!(view.clone().with_line_delay_s(f64::NAN).is_err());
    let view = view.with_line_delay_s(LINE_DELAY_S).unwrap();
    let [x, y, z] = view.shown_position_m(place_m, velocity_mps);
    let row = 239.5 + FOCAL_PX * y / z;
    let late_s = LINE_DELAY_S * (row - 239.5);
    assert!(late_s > 0.007, "{late_s}");
    let expected = [0.4 + 3.0 * late_s, 0.6 + 2.0 * late_s, 2.5];
    for (found, expected) in [x, y, z].into_iter().zip(expected) {
        assert!((found - expected).abs() < 1e-9, "{found} {expected}");
    }
}
