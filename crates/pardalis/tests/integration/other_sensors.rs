//! Other sensors beside a camera, on the rendered fisheye sequence: simulated measurements of the ball, which is painted over in some frames.

use nalgebra::Vector3;
use pardalis::shape::{Shape, Sphere, SphereOutline};
use pardalis::tracker::{
    BoxedSettings, Measurement, ObservedMeasurement, TargetSettings, TrackState,
};
use pardalis::{Error, Estimate, FrameSet, PixelFormat, TargetId, Tracker};
use pardalis_core::rng::{Draws, Stage};
use pardalis_core::simd::Level;
use pardalis_filter::motion::{Motion, PositionNoise, RandomWalk};

use crate::common::{FPS, detected_ball, fisheye_view, jump_picture, set_of};
use crate::seek::{as_frame, covered, error_m, tracker, truth_m};

const BALL: TargetId = TargetId::new(0);

/// Returns three standard normal numbers of this index.
fn noise(index: usize) -> Vector3<f64> {
    let [x, y, z, _] = Draws::new(8, 0).normals(index as u32, 0, Stage::Clock, 0);
    Vector3::new(x.into(), y.into(), z.into())
}

/// The ball's position as a sensor measures it, off by this many metres along x.
fn place(index: usize, sigma_m: f64, off_m: f64) -> Measurement {
    let mut measured_m = Vector3::from(truth_m(index)) + sigma_m * noise(index);
    measured_m.x += off_m;
    let variance = sigma_m * sigma_m;
    let covariance = [variance, 0.0, 0.0, variance, 0.0, variance];
    let time_s = index as f64 / FPS;
    Measurement::position(time_s, measured_m.map(Some).into(), covariance).unwrap()
}

/// Tracks the first frames with what is measured at them; those for which `is_hidden` holds do not show the ball.
fn run(
    frames: usize,
    is_hidden: impl Fn(usize) -> bool,
    measure: impl Fn(usize) -> Option<Measurement>,
) -> (Tracker, Vec<Estimate>) {
    let mut tracker = tracker(1);
    let step = |index: usize| {
        if let Some(measurement) = measure(index) {
            let observed = tracker.observe_measurement(BALL, &measurement).unwrap();
            assert_eq!(observed, ObservedMeasurement::Waiting);
        }
        let picture = if is_hidden(index) {
            covered(index)
        } else {
            jump_picture(index)
        };
        let frame = as_frame(&picture, index, PixelFormat::Rgb8);
        tracker.observe(&set_of(frame)).unwrap();
        tracker.estimate(BALL).unwrap()
    };
    let estimates = (0..frames).map(step).collect();
    (tracker, estimates)
}

fn rmse_m(estimates: &[Estimate], frames: std::ops::Range<usize>) -> f64 {
    let count = frames.len() as f64;
    let squares = frames.map(|index| error_m(&estimates[index], index).powi(2));
    (squares.sum::<f64>() / count).sqrt()
}

#[test]
fn a_sensor_keeps_a_ball_that_no_camera_sees() {
    let is_hidden = |index: usize| (8..24).contains(&index);
    let every_third = |index: usize| index.is_multiple_of(3).then(|| place(index, 0.03, 0.0));
    let (tracker, with) = run(24, is_hidden, every_third);
    let (_, without) = run(24, is_hidden, |_| None);
    for (index, estimate) in with.iter().enumerate().skip(9) {
        assert_eq!(estimate.state, TrackState::Occluded, "frame {index}");
    }
    let error = rmse_m(&with, 12..24);
    assert!(error < 0.15, "{error}");
    // Alone, the prediction goes astray, or the ball is given up.
    let alone = |(index, estimate): (usize, &Estimate)| {
        let known = estimate.kinematics.is_some();
        if known {
            error_m(estimate, index)
        } else {
            f64::INFINITY
        }
    };
    let last = without.iter().enumerate().map(alone).next_back().unwrap();
    assert!(last > 2.0 * error_m(&with[23], 23), "{last}");
    let counts = tracker.measurement_counts(BALL).unwrap();
    // The first one says where to search.
    assert_eq!((counts.used, counts.rejected, counts.late), (8, 0, 0));
    // A certain position makes the next ones certain.
    let variance = |index: usize| with[index].kinematics.unwrap().covariance_m2[0];
    assert!(
        variance(18) < 0.5 * variance(17),
        "{} {}",
        variance(18),
        variance(17)
    );
}

#[test]
fn a_range_tells_what_one_camera_hardly_does() {
    let from = fisheye_view()
        .camera_from_world()
        .inverse()
        .translation
        .vector;
    let range = |index: usize| {
        let way_m = Vector3::from(truth_m(index)) - from;
        let range_m = way_m.norm() + 0.01 * noise(index).x;
        let time_s = index as f64 / FPS;
        Some(Measurement::range(time_s, from.into(), range_m, 0.01).unwrap())
    };
    let (tracker, with) = run(25, |_| false, range);
    let (_, without) = run(25, |_| false, |_| None);
    let [with, without] = [with, without].map(|estimates| rmse_m(&estimates, 3..25));
    assert!(with < 0.6 * without, "{with} {without}");
    let counts = tracker.measurement_counts(BALL).unwrap();
    assert!(counts.used >= 22 && counts.rejected <= 1, "{counts:?}");
}

#[test]
fn outliers_are_rejected_and_do_no_harm() {
    let (_, without) = run(25, |_| false, |_| None);
    let (tracker, with) = run(
        25,
        |_| false,
        |index| (index > 3).then(|| place(index, 0.02, 1.5)),
    );
    let [with, without] = [with, without].map(|estimates| rmse_m(&estimates, 3..25));
    assert_eq!(with, without);
    let counts = tracker.measurement_counts(BALL).unwrap();
    assert_eq!((counts.used, counts.rejected), (0, 21));
}

#[test]
fn measurements_come_late_or_between_frames() {
    let mut tracker = tracker(1);
    let mut observe = |index: usize, measured: &[(Measurement, ObservedMeasurement)]| {
        for (measurement, wanted) in measured {
            let observed = tracker.observe_measurement(BALL, measurement).unwrap();
            assert_eq!(observed, *wanted);
        }
        let frame = as_frame(&jump_picture(index), index, PixelFormat::Rgb8);
        tracker.observe(&set_of(frame)).unwrap();
        tracker.measurement_counts(BALL).unwrap()
    };
    for index in 0..5 {
        observe(index, &[]);
    }
    let at = |time_s: f64| Measurement::range(time_s, truth_m(5), 0.1, 0.5).unwrap();
    let waiting = |time_s: f64| (at(time_s), ObservedMeasurement::Waiting);
    // Of later than the next frames, between frames, as late as the last ones, and later.
    let counts = observe(
        5,
        &[
            waiting(0.3),
            waiting(0.17),
            waiting(0.12),
            (at(0.02), ObservedMeasurement::Late),
        ],
    );
    assert_eq!((counts.used, counts.late), (2, 1));
    assert_eq!(observe(6, &[]).used, 2);
    assert_eq!(observe(8, &[]).used, 3);
}

fn refused(settings: impl Into<TargetSettings>, measurement: &Measurement) -> Error {
    let views = vec![fisheye_view()];
    let mut tracker = Tracker::new(views, vec![settings.into()], 1, Level::best()).unwrap();
    tracker.observe_measurement(BALL, measurement).unwrap_err()
}

#[test]
fn what_cannot_be_measured_is_refused() {
    let range = Measurement::range(0.0, [0.0; 3], 1.0, 0.1).unwrap();
    let crowd = TargetSettings::crowd(detected_ball(), 3);
    let error = refused(crowd, &range).to_string();
    assert!(error.contains("allowed: a target of one body"), "{error}");
    let shape = Shape::Sphere(Sphere::new(0.1, SphereOutline::Tangent).unwrap());
    let mut walker = BoxedSettings::new(shape);
    let noise = PositionNoise::Diffusion { density_m2ps: 1.0 };
    walker.motion = Motion::from(RandomWalk::new(noise).unwrap());
    let speed = [Some(1.0), None, None];
    let speed = Measurement::velocity(0.0, speed, [0.1, 0.0, 0.0, 0.0, 0.0, 0.0]).unwrap();
    let error = refused(walker, &speed).to_string();
    assert!(error.contains("no velocity"), "{error}");
    let error = tracker(1)
        .observe_measurement(TargetId::new(1), &range)
        .unwrap_err();
    assert!(error.to_string().starts_with("target is 1"), "{error}");
}

#[test]
fn a_target_of_boxes_is_measured_too() {
    let shape = Shape::Sphere(Sphere::new(0.1, SphereOutline::Tangent).unwrap());
    let mut settings = BoxedSettings::new(shape);
    settings.start = Some(pardalis_filter::gaussian::GaussianStart::at(truth_m(0)));
    let mut tracker = Tracker::new(vec![fisheye_view()], vec![settings], 1, Level::best()).unwrap();
    for index in 0..3 {
        tracker
            .observe_measurement(BALL, &place(index, 0.02, 0.0))
            .unwrap();
        tracker
            .observe(&FrameSet::without_frames(index as f64 / FPS).unwrap())
            .unwrap();
    }
    assert_eq!(tracker.measurement_counts(BALL).unwrap().used, 3);
    let places = tracker.particles(BALL).unwrap().next().unwrap();
    let [x, ..] = places.positions_m();
    let mean = x.iter().map(|x| f64::from(*x)).sum::<f64>() / x.len() as f64;
    assert!(
        (mean - truth_m(2)[0]).abs() < 0.06,
        "{mean} {}",
        truth_m(2)[0]
    );
}
