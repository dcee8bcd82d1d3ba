//! Temporal calibration from simulated detections of a moving ball with ground truth, and the errors for
//! insufficient recordings.

use nalgebra::{Point3, Vector3};
use pardalis::tracker::SizeTolerance;
use pardalis::view::View;
use pardalis_calibrate::{
    CalibrationError, Detection, DetectionFrame, TemporalCalibration, TimedCamera, calibrate_time,
};
use pardalis_camera::Pose;
use pardalis_camera::{Camera, Equidistant, Pinhole, Unified};
use pardalis_core::rng::{Draws, Stage};

const SIZE: (usize, usize) = (640, 480);
const NOISE_PX: f64 = 0.3;
const RADIUS_M: f64 = 0.035;

/// A camera with the rate, phase and time offset of its frames.
struct CameraClock {
    view: View,
    fps: f64,
    phase_s: f64,
    offset_s: f64,
}

/// Places a camera at `from`, facing the middle of the scene; cameras with mirrors face away from it.
fn looking(camera: Camera, from: [f64; 3]) -> View {
    let eye = Point3::from(from);
    let to_scene = Point3::new(0.0, 0.0, 0.3) - eye;
    let axis = if camera.looks_into_mirror() {
        -to_scene
    } else {
        to_scene
    };
    let camera_from_world = Pose::face_towards(&eye, &(eye + axis), &-Vector3::z());
    View::new(camera, camera_from_world, SIZE, None).unwrap()
}

fn pinhole(from: [f64; 3]) -> View {
    let model = Pinhole::new([500.0; 2], [319.5, 239.5], &[-0.1, 0.02, 0.0, 0.0]).unwrap();
    looking(Camera::Pinhole(model), from)
}

fn clock(view: View, offset_s: f64) -> CameraClock {
    CameraClock {
        view,
        fps: 25.0,
        phase_s: 0.0,
        offset_s,
    }
}

fn pair(offset_s: f64) -> Vec<CameraClock> {
    vec![
        clock(pinhole([1.2, 0.1, 0.5]), 0.0),
        clock(pinhole([-0.1, -1.2, 0.4]), offset_s),
    ]
}

/// A path back and forth in all directions that never repeats.
fn waved(time_s: f64) -> Point3<f64> {
    let wave = |hz: f64, phase: f64| libm::sin(std::f64::consts::TAU * hz * time_s + phase);
    Point3::new(
        0.2 * wave(0.53, 0.3),
        0.2 * wave(0.71, 1.1),
        0.3 + 0.15 * wave(0.62, 2.0),
    )
}

/// Simulates the detection of an object whose middle is here.
fn detection(view: &View, middle: Point3<f64>, noise_px: [f64; 2]) -> Option<Detection> {
    let middle = view.camera_from_world() * middle;
    let project = |place: Point3<f64>| view.camera().project(place.into());
    let pixel = project(middle)?;
    // To one side, across the line of sight.
    let across = middle.coords.cross(&Vector3::z()).normalize() * RADIUS_M;
    let side = project(middle + across)?;
    let radius_px = libm::hypot(side[0] - pixel[0], side[1] - pixel[1]);
    let pixel = [0, 1].map(|i| pixel[i] + noise_px[i]);
    detection_at(pixel, radius_px, middle.coords.norm())
}

/// Returns a detection at this pixel if it lies in the image.
fn detection_at(pixel: [f64; 2], radius_px: f64, distance_m: f64) -> Option<Detection> {
    let inside = |i: usize, side: usize| {
        pixel[i] > radius_px + 1.0 && pixel[i] < side as f64 - radius_px - 2.0
    };
    (inside(0, SIZE.0) && inside(1, SIZE.1)).then_some(Detection {
        pixel,
        radius_px,
        distance_m,
    })
}

/// Simulates the detections of a ball on this path by all cameras.
fn detections(
    clocks: &[CameraClock],
    path: impl Fn(f64) -> Point3<f64>,
    duration_s: f64,
    seed: u32,
) -> Vec<Vec<DetectionFrame>> {
    let of_camera = |(camera, clock): (usize, &CameraClock)| {
        let frame = |number: u32| {
            let time_s = clock.phase_s + f64::from(number) / clock.fps;
            let draws = Draws::new(seed, camera as u32);
            let [du, dv, ..] = draws.normals(number, 0, Stage::Motion, 0);
            let noise_px = [du, dv].map(|d| NOISE_PX * f64::from(d));
            let found = detection(&clock.view, path(time_s + clock.offset_s), noise_px);
            DetectionFrame {
                time_s,
                detections: found.into_iter().collect(),
            }
        };
        (0..(duration_s * clock.fps) as u32).map(frame).collect()
    };
    clocks.iter().enumerate().map(of_camera).collect()
}

fn estimate(
    clocks: &[CameraClock],
    frames: Vec<Vec<DetectionFrame>>,
) -> Result<Vec<TemporalCalibration>, CalibrationError> {
    let cameras: Vec<TimedCamera> = clocks
        .iter()
        .zip(frames)
        .zip(["first", "second", "third", "fourth"])
        .map(|((clock, frames), name)| TimedCamera {
            name,
            view: &clock.view,
            frames,
        })
        .collect();
    calibrate_time(&cameras, SizeTolerance::default(), 0.5)
}

fn fit(clocks: &[CameraClock], duration_s: f64, seed: u32) -> Vec<TemporalCalibration> {
    estimate(clocks, detections(clocks, waved, duration_s, seed)).unwrap()
}

/// Compares the offsets with the truth; `most_ms` is the largest accepted error in milliseconds.
#[track_caller]
fn check(clocks: &[CameraClock], fits: &[TemporalCalibration], most_ms: f64) {
    for (clock, fit) in clocks.iter().zip(fits) {
        let error_ms = 1e3 * (fit.offset_s - clock.offset_s);
        println!(
            "offset {:.4} s: error {error_ms:.3} ms, sd {:.3} ms, rms {:?} to {:.3} px, {} used",
            clock.offset_s,
            1e3 * fit.sigma_s,
            fit.rms_before_px,
            fit.rms_after_px,
            fit.detections.iter().filter(|s| !s.outlier).count()
        );
        assert!(error_ms.abs() < most_ms, "{error_ms} ms");
        assert!(
            error_ms.abs() <= 4e3 * fit.sigma_s,
            "{error_ms} ms with {} s",
            fit.sigma_s
        );
    }
}

#[test]
fn finds_offsets_of_two_cameras_within_a_millisecond() {
    for offset_s in [-0.12, -0.037, 0.0, 0.037, 0.12, 0.4] {
        let clocks = pair(offset_s);
        let fits = fit(&clocks, 6.0, 1);
        check(&clocks, &fits, 1.0);
        assert_eq!((fits[0].offset_s, fits[0].sigma_s), (0.0, 0.0));
        assert!(
            (0.2..0.45).contains(&fits[1].rms_after_px),
            "{}",
            fits[1].rms_after_px
        );
    }
}

#[test]
fn standard_deviations_match_the_errors() {
    let squares: Vec<f64> = (0..60)
        .map(|seed| {
            // Covers many phases between frames.
            let offset_s = 0.05 + 0.0013 * f64::from(seed);
            let found = &fit(&pair(offset_s), 4.0, seed)[1];
            ((found.offset_s - offset_s) / found.sigma_s).powi(2)
        })
        .collect();
    let mean = squares.iter().sum::<f64>() / squares.len() as f64;
    println!("mean of z^2: {mean:.3}");
    // Chi-square with 60 degrees of freedom: 0.62 to 1.5 with a probability of 99 %.
    assert!((0.6..1.55).contains(&mean), "{mean}");
    let far = squares.iter().filter(|z2| **z2 > 9.0).count();
    assert!(
        far <= 1,
        "{far} of 60 errors exceed three standard deviations"
    );
}

#[test]
fn combines_cameras_of_different_models_and_rates() {
    let fisheye = Equidistant::new(145.0, [319.5, 239.5], 3.0).unwrap();
    let mirror = Unified::new(0.9, 1.0, 260.0, [319.5, 239.5]).unwrap();
    let clocks = vec![
        clock(pinhole([1.2, 0.1, 0.5]), 0.0),
        CameraClock {
            fps: 30.0,
            phase_s: 0.011,
            ..clock(
                looking(Camera::Equidistant(fisheye), [-0.5, -0.4, 0.1]),
                0.213,
            )
        },
        CameraClock {
            fps: 20.0,
            ..clock(looking(Camera::Unified(mirror), [0.1, 0.6, 0.7]), -0.087)
        },
        CameraClock {
            fps: 25.02,
            ..clock(pinhole([-1.0, 0.4, 0.3]), 0.019)
        },
    ];
    check(&clocks, &fit(&clocks, 6.0, 3), 1.5);
}

#[test]
fn accepts_large_time_stamps_and_offsets_of_whole_frames() {
    let mut clocks = pair(0.08);
    for clock in &mut clocks {
        clock.phase_s = 1.7e9;
    }
    let late = |time_s| waved(time_s - 1.7e9);
    let frames = detections(&clocks, late, 6.0, 5);
    check(&clocks, &estimate(&clocks, frames).unwrap(), 1.0);
}

#[test]
fn tolerates_background_other_objects_and_gaps() {
    let clocks = vec![
        clock(pinhole([1.2, 0.1, 0.5]), 0.0),
        clock(pinhole([-0.1, -1.2, 0.4]), 0.045),
        clock(pinhole([-0.9, 0.8, 0.6]), -0.13),
    ];
    let mut frames = detections(&clocks, waved, 6.0, 7);
    for (number, frame) in frames[1].iter_mut().enumerate() {
        if number % 10 == 7 {
            // Partly covered: what is found is smaller, and its middle shifted.
            for found in &mut frame.detections {
                found.distance_m *= 1.3;
                found.pixel[0] += 5.0;
            }
        }
        // Likelier than the ball, so that it is listed first.
        let still = detection_at([500.0, 400.0], 36.0, 0.5);
        frame.detections.splice(0..0, still);
        if number % 10 == 3 {
            let wrong = [100.0 + 3.0 * (number % 7) as f64, 90.0];
            frame
                .detections
                .splice(0..0, detection_at(wrong, 31.0, 0.6));
        }
    }
    for frame in &mut frames[2][40..70] {
        frame.detections.clear();
    }
    let fits = estimate(&clocks, frames).unwrap();
    check(&clocks, &fits, 1.0);
}

/// The path of another object, in other directions.
fn swung(time_s: f64) -> Point3<f64> {
    let wave = |hz: f64, phase: f64| libm::sin(std::f64::consts::TAU * hz * time_s + phase);
    Point3::new(
        0.1 + 0.15 * wave(0.31, 2.3),
        -0.1 + 0.2 * wave(0.43, 0.4),
        0.25 + 0.1 * wave(0.57, 1.2),
    )
}

#[test]
fn objects_that_move_too_are_told_from_the_target() {
    let clocks = vec![
        clock(pinhole([1.2, 0.1, 0.5]), 0.0),
        clock(pinhole([-0.1, -1.2, 0.4]), 0.045),
        clock(pinhole([-0.9, 0.8, 0.6]), -0.13),
    ];
    let mut frames = detections(&clocks, waved, 6.0, 9);
    let others = detections(&clocks, swung, 6.0, 10);
    for (camera, (frames, others)) in frames.iter_mut().zip(others).enumerate() {
        for (number, (frame, mut other)) in frames.iter_mut().zip(others).enumerate() {
            // Larger than the target, and its middle is not where its outline suggests: it differs from camera to
            // camera. Listed first, and more often detected.
            for found in &mut other.detections {
                found.pixel[camera % 2] += 8.0;
                found.radius_px *= 1.5;
                found.distance_m /= 1.5;
            }
            if number % 3 == 0 {
                frame.detections.clear();
            }
            frame.detections.splice(0..0, other.detections);
        }
    }
    let fits = estimate(&clocks, frames).unwrap();
    check(&clocks, &fits, 1.0);
    // The target, not the other.
    for (fit, clock) in fits.iter().zip(&clocks) {
        for found in fit.detections.iter().filter(|found| !found.outlier) {
            let true_px = detection(&clock.view, waved(found.time_s + clock.offset_s), [0.0; 2]);
            let [u, v] = true_px.unwrap().pixel;
            let off_px = libm::hypot(found.pixel[0] - u, found.pixel[1] - v);
            assert!(off_px < 5.0 * NOISE_PX, "{off_px} px");
        }
    }
}

#[test]
fn rows_of_a_rolling_shutter_are_exposed_one_after_the_other() {
    let mut clocks = pair(0.04);
    // 19 ms from the first to the last row.
    let line_delay_s = 4e-5;
    let view = clocks[1].view.clone();
    clocks[1].view = view.with_line_delay_s(line_delay_s).unwrap();
    let mut frames = detections(&clocks, waved, 6.0, 11);
    for frame in &mut frames[1] {
        let time_s = frame.time_s + clocks[1].offset_s;
        for found in &mut frame.detections {
            let delay_s = line_delay_s * (found.pixel[1] - 239.5);
            let noise_px = detection(&clocks[1].view, waved(time_s), [0.0; 2])
                .map(|still| [0, 1].map(|i| found.pixel[i] - still.pixel[i]));
            let shown = detection(&clocks[1].view, waved(time_s + delay_s), noise_px.unwrap());
            *found = shown.unwrap_or(*found);
        }
    }
    check(&clocks, &estimate(&clocks, frames).unwrap(), 1.0);
}

#[track_caller]
fn assert_fails(outcome: Result<Vec<TemporalCalibration>, CalibrationError>, expected: &[&str]) {
    let Err(message) = outcome.map_err(|error| error.to_string()) else {
        panic!("the calibration succeeded");
    };
    println!("{message}");
    for expected in expected {
        assert!(message.contains(expected), "no {expected:?} in: {message}");
    }
}

#[test]
fn rejects_insufficient_recordings_with_the_reason() {
    let clocks = pair(0.04);
    let still = |_| Point3::new(0.0, 0.0, 0.3);
    assert_fails(
        estimate(&clocks, detections(&clocks, still, 4.0, 1)),
        &["first detects a moving object", "in 0 of its 100 frames"],
    );
    let creeping = |time_s: f64| Point3::new(0.002 * time_s, 0.003 * time_s, 0.3 + 0.002 * time_s);
    assert_fails(
        estimate(&clocks, detections(&clocks, creeping, 4.0, 1)),
        &["moves too little in the images of first", "move the target"],
    );
    let mut blind = detections(&clocks, waved, 4.0, 1);
    blind[1]
        .iter_mut()
        .for_each(|frame| frame.detections.clear());
    assert_fails(
        estimate(&clocks, blind),
        &["second detects", "at most one camera sees the target"],
    );
    let mut apart = detections(&clocks, waved, 4.0, 1);
    apart[1].iter_mut().for_each(|frame| frame.time_s += 100.0);
    assert_fails(
        estimate(&clocks, apart),
        &[
            "second never sees the target at the same times",
            "max-offset-s",
        ],
    );
    let far = pair(0.9);
    assert_fails(estimate(&far, detections(&far, waved, 6.0, 1)), &["second"]);
    assert_fails(
        estimate(&clocks[..1], detections(&clocks[..1], waved, 4.0, 1)),
        &["only one camera"],
    );
    let frames = detections(&clocks, waved, 4.0, 1);
    // With a wrong pose the rays do not meet for any offset.
    let wrong = vec![
        clock(pinhole([1.2, 0.1, 0.5]), 0.0),
        clock(pinhole([1.0, 1.2, 0.9]), 0.04),
    ];
    assert_fails(estimate(&wrong, frames), &["pose"]);
    let cameras = [];
    for nonsense in [0.0, -1.0, f64::NAN, 1e9] {
        assert!(calibrate_time(&cameras, SizeTolerance::Unknown, nonsense).is_err());
    }
}
