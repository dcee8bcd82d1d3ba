//! How fast a ball is that rolls, and one that is hit, before a single camera with noisy images.

use nalgebra::{Matrix3, Vector3};
use pardalis::color::ColorModel;
use pardalis::filter::gaussian::GaussianStart;
use pardalis::shape::{Shape, Sphere, SphereOutline};
use pardalis::tracker::{DetectedSettings, TrackState};
use pardalis::{Frame, FrameSet, Tracker};
use pardalis_core::rng::{Draws, Stage};

use crate::size::{RADIUS_M, painter, views};

const INTERVAL_S: f64 = 0.04;
const SPEED_MPS: f64 = 0.4;
/// It rolls to and fro on a line across the line of sight, and turns round in this frame.
const TURN: u16 = 30;
const FRAMES: u16 = 50;

fn time_s(frame: u16) -> f64 {
    INTERVAL_S * f64::from(frame)
}

/// Position and velocity in a frame, in m and m/s.
fn truth(frame: u16) -> (Vector3<f64>, Vector3<f64>) {
    let along = Vector3::new(0.8, 0.6, 0.0);
    let since_turn_s = time_s(frame) - time_s(TURN);
    let velocity_mps = if frame > TURN {
        -SPEED_MPS * along
    } else {
        SPEED_MPS * along
    };
    (
        Vector3::new(0.1, 0.1, 0.0) + since_turn_s * velocity_mps,
        velocity_mps,
    )
}

/// An image of the ball at a place, with noise.
fn image(place_m: Vector3<f64>, frame: u16) -> Frame {
    let (mut rgb, _) = painter::ball(&views()[0], place_m.into(), RADIUS_M);
    let draws = Draws::new(7, u32::from(frame));
    for (pixel, rgb) in (0..).zip(rgb.chunks_exact_mut(3)) {
        let off = 16.0 * (draws.uniform(pixel, 0, Stage::Pixel) - 0.5);
        for value in rgb {
            *value = (f64::from(*value) + off) as u8;
        }
    }
    Frame::from_rgb(320, 240, rgb, time_s(frame)).unwrap()
}

fn ball(motion_modes: bool) -> DetectedSettings {
    let (still, mask) = painter::ball(&views()[0], [0.0; 3], RADIUS_M);
    let still = Frame::from_rgb(320, 240, still, 0.0).unwrap();
    let colors = ColorModel::from_image(&still, &mask).unwrap();
    let shape = Shape::Sphere(Sphere::new(RADIUS_M, SphereOutline::Tangent).unwrap());
    let mut ball = DetectedSettings::new(shape, colors);
    ball.existence.motion_modes = motion_modes;
    ball
}

/// The error of the velocity in m/s, and its normalised square, in each frame that has an estimate.
fn errors(settings: DetectedSettings) -> Vec<Option<[f64; 2]>> {
    let mut setup = Tracker::builder();
    let camera = setup.camera(views()[0].clone());
    let target = setup.target(settings);
    let mut tracker = setup.build().unwrap();
    let error = |frame: u16| {
        let (place_m, velocity_mps) = truth(frame);
        let frames = FrameSet::new([(camera, image(place_m, frame))]).unwrap();
        tracker.observe(&frames).unwrap();
        let estimate = tracker.estimate(target).unwrap();
        let known = estimate.kinematics?;
        assert_eq!(estimate.state, TrackState::Tracking);
        let off_mps = Vector3::from(known.velocity_mps.unwrap()) - velocity_mps;
        let [xx, xy, xz, yy, yz, zz] = known.velocity_covariance_m2ps2.unwrap();
        let covariance = Matrix3::new(xx, xy, xz, xy, yy, yz, xz, yz, zz);
        let square = off_mps.dot(&(covariance.try_inverse().unwrap() * off_mps));
        Some([off_mps.norm(), square])
    };
    (0..FRAMES).map(error).collect()
}

/// The root mean square of the errors, and the mean of their normalised squares.
fn summed(errors: &[Option<[f64; 2]>]) -> [f64; 2] {
    let mut sums = [0.0; 2];
    for error in errors {
        let [off_mps, square] = error.unwrap();
        sums[0] += off_mps.powi(2) / errors.len() as f64;
        sums[1] += square / errors.len() as f64;
    }
    [sums[0].sqrt(), sums[1]]
}

#[test]
fn what_rolls_has_a_better_velocity_than_its_motion_model_gives() {
    let (modes, model) = (errors(ball(true)), errors(ball(false)));
    let rolling = 10..usize::from(TURN);
    let [of_modes, square] = summed(&modes[rolling.clone()]);
    let [of_model, _] = summed(&model[rolling]);
    assert!(of_modes < 0.5 * of_model, "{of_modes} {of_model}");
    assert!(square < 6.0, "{square}");
    // Three frames after it was hit it is known again.
    let after = usize::from(TURN) + 4..usize::from(FRAMES);
    let [of_modes, square] = summed(&modes[after.clone()]);
    let [of_model, _] = summed(&model[after]);
    assert!(of_modes < of_model, "{of_modes} {of_model}");
    assert!(square < 6.0, "{square}");
}

#[test]
fn a_velocity_that_is_known_at_the_start_is_not_forgotten() {
    let (place_m, velocity_mps) = truth(0);
    let mut known = ball(true);
    let start = GaussianStart {
        position_m: place_m.into(),
        covariance_m2: [1e-4, 0.0, 0.0, 1e-4, 0.0, 1e-4],
        velocity_mps: velocity_mps.into(),
        velocity_sigma_mps: [0.01; 3],
    };
    known.start = Some(start);
    let [Some([known, _]), ..] = errors(known)[..] else {
        panic!("not found at once");
    };
    assert!(known < 0.02, "{known}");
}

/// The velocities of all frames that have an estimate, of a ball that is at these places, or out of sight.
fn velocities(place_m: impl Fn(u16) -> Option<Vector3<f64>>) -> Vec<(u16, Vector3<f64>)> {
    let mut setup = Tracker::builder();
    let camera = setup.camera(views()[0].clone());
    let target = setup.target(ball(true));
    let mut tracker = setup.build().unwrap();
    let out_of_sight_m = Vector3::new(0.0, -9.0, 9.0);
    let mut found = Vec::new();
    for frame in 0..FRAMES {
        let shown_m = place_m(frame).unwrap_or(out_of_sight_m);
        let frames = FrameSet::new([(camera, image(shown_m, frame))]).unwrap();
        tracker.observe(&frames).unwrap();
        if let Some(known) = tracker.estimate(target).unwrap().kinematics {
            found.push((frame, known.velocity_mps.unwrap().into()));
        }
    }
    found
}

#[test]
fn a_ball_that_rests_does_not_fall_while_it_is_hidden() {
    let hidden = |frame: u16| (frame < 30).then_some(Vector3::zeros());
    let hidden: Vec<_> = velocities(hidden)
        .into_iter()
        .filter(|(frame, _)| *frame >= 30)
        .collect();
    assert!(hidden.len() > 3, "{hidden:?}");
    for (frame, velocity_mps) in hidden {
        assert!(velocity_mps.norm() < 0.1, "{frame}: {velocity_mps}");
    }
}

#[test]
fn a_ball_that_is_put_elsewhere_rests_again_after_three_frames() {
    let moved = |frame: u16| {
        let there = if frame < 25 { 0.0 } else { 1.0 };
        Some(there * Vector3::new(0.3, 0.2, 0.1))
    };
    let moved = velocities(moved);
    assert_eq!(moved.last().unwrap().0, FRAMES - 1);
    for (frame, velocity_mps) in moved.into_iter().filter(|(frame, _)| *frame >= 28) {
        assert!(velocity_mps.norm() < 0.5, "{frame}: {velocity_mps}");
    }
}
