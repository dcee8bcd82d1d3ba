//! Frames of one instant that differ by some milliseconds: a ball in motion is looked for where it was at the time of each.

use nalgebra::Vector3;
use pardalis::color::ColorModel;
use pardalis::shape::{Shape, Sphere, SphereOutline};
use pardalis::tracker::{DetectedSettings, TrackState};
use pardalis::{CameraId, Frame, FrameSet, Tracker};

use crate::size::{RADIUS_M, painter, views};

const INTERVAL_S: f64 = 0.01;
const SPEED_MPS: f64 = 2.0;

/// Where the ball is at a time, metres.
fn truth_m(time_s: f64) -> [f64; 3] {
    [SPEED_MPS * time_s - 0.24, 0.05, 0.02]
}

fn ball() -> DetectedSettings {
    let (still, mask) = painter::ball(&views()[0], [0.0; 3], RADIUS_M);
    let still = Frame::from_rgb(320, 240, still, 0.0).unwrap();
    let colors = ColorModel::from_image(&still, &mask).unwrap();
    let shape = Shape::Sphere(Sphere::new(RADIUS_M, SphereOutline::Tangent).unwrap());
    DetectedSettings::new(shape, colors)
}

/// The root mean square of the errors of the position in metres and of the velocity in m/s, once the ball is found. The images of the first camera are taken `before_s` earlier than
/// those of the second, and stamped `stamped_s` earlier.
fn rms(before_s: f64, stamped_s: f64) -> [f64; 2] {
    let views = views();
    let mut setup = Tracker::builder();
    let cameras: Vec<CameraId> = views.iter().map(|v| setup.camera(v.clone())).collect();
    let target = setup.target(ball());
    let mut tracker = setup.build().unwrap();
    let mut squares = [0.0; 2];
    let frames = 8..24;
    for number in 0..frames.end {
        let time_s = INTERVAL_S * f64::from(number);
        let image = |camera: usize| {
            let earlier = if camera == 0 { 1.0 } else { 0.0 };
            let place_m = truth_m(time_s - earlier * before_s);
            let (rgb, _) = painter::ball(&views[camera], place_m, RADIUS_M);
            let image = Frame::from_rgb(320, 240, rgb, time_s - earlier * stamped_s).unwrap();
            (cameras[camera], image)
        };
        tracker
            .observe(&FrameSet::new([image(0), image(1)]).unwrap())
            .unwrap();
        if frames.contains(&number) {
            let estimate = tracker.estimate(target).unwrap();
            assert_eq!(estimate.state, TrackState::Tracking, "frame {number}");
            let known = estimate.kinematics.unwrap();
            let off_m = Vector3::from(known.position_m) - Vector3::from(truth_m(time_s));
            let off_mps = Vector3::from(known.velocity_mps.unwrap()) - SPEED_MPS * Vector3::x();
            for (sum, off) in squares.iter_mut().zip([off_m, off_mps]) {
                *sum += off.norm_squared() / frames.len() as f64;
            }
        }
    }
    squares.map(f64::sqrt)
}

#[test]
fn a_ball_is_looked_for_where_it_was_at_the_time_of_each_frame() {
    let [together_m, together_mps] = rms(0.0, 0.0);
    assert!(together_m < 0.5e-3, "{together_m}");
    for before_s in [0.001, 0.004 - 1e-9] {
        let [apart_m, apart_mps] = rms(before_s, before_s);
        assert!(
            apart_m < 1.2 * together_m + 0.1e-3,
            "{before_s}: {apart_m}, {together_m}"
        );
        assert!(
            apart_mps < 1.2 * together_mps + 0.01,
            "{before_s}: {apart_mps}, {together_mps}"
        );
    }
    // With stamps that are wrong the rays miss each other.
    let [wrong_m, _] = rms(0.004, 0.0);
    assert!(wrong_m > 2e-3, "{wrong_m}");
}
