//! The tracker rejects invalid frame sets and unknown targets, and continues unchanged.

use crate::common::{detected_ball, fisheye_view, set_of};
use pardalis::color::YuvEncoding;
use pardalis::tracker::Observed;
use pardalis::{CameraId, Error, Frame, FrameSet, PixelFormat, TargetId, Tracker};
use pardalis_core::simd::Level;
use pardalis_filter::gaussian::GaussianStart;

const CAMERAS: [CameraId; 2] = [CameraId::new(0), CameraId::new(1)];
const BALL: TargetId = TargetId::new(0);

/// Returns a grey image of the fisheye camera.
fn grey(time_s: f64) -> Frame {
    let (width, height) = crate::common::SIZE;
    let bytes = vec![100; 3 * width * height];
    let encoding = YuvEncoding::default();
    Frame::new(PixelFormat::Rgb8, encoding, width, height, bytes, time_s).unwrap()
}

fn tracker() -> Tracker {
    let views = vec![fisheye_view(), fisheye_view()];
    Tracker::new(views, [detected_ball()], 1, Level::best()).unwrap()
}

/// Asserts that the message of the error begins with `wanted`.
fn refused<T: std::fmt::Debug>(result: Result<T, Error>, wanted: &str) {
    let error = result.unwrap_err().to_string();
    assert!(error.starts_with(wanted), "{error}");
}

#[test]
fn invalid_times_are_an_error() {
    for time_s in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY, 2e12] {
        refused(FrameSet::without_frames(time_s), "time_s is ");
        refused(grey(0.0).with_time_s(time_s), "time_s is ");
    }
    assert_eq!(FrameSet::without_frames(-3.0).unwrap().time_s(), -3.0);
}

#[test]
fn a_set_has_the_time_of_its_latest_frame() {
    let [left, right] = CAMERAS;
    let set = FrameSet::new([(left, grey(1.0005)), (right, grey(1.0))]).unwrap();
    assert_eq!(set.time_s(), 1.0005);
    let mut retained = set.clone();
    retained.retain(|camera, _| camera == right);
    let cameras: Vec<CameraId> = retained.frames().map(|(camera, _)| camera).collect();
    assert_eq!((cameras, retained.time_s()), (vec![right], 1.0005));
    let apart = FrameSet::new([(left, grey(1.0)), (right, grey(1.005))]);
    refused(apart, "time_s is 1.005; allowed: at most 0.004 s after 1");
    refused(FrameSet::new([]), "the set of frames is empty");
}

#[test]
fn two_frames_of_one_camera_are_an_error() {
    let [left, right] = CAMERAS;
    let twice = FrameSet::new([(left, grey(1.0)), (right, grey(1.0)), (left, grey(1.0))]);
    refused(twice, "camera is 0; allowed: cameras that have one frame");
}

#[test]
fn earlier_times_are_an_error_and_equal_times_are_repeated() {
    let mut tracker = tracker();
    assert_eq!(tracker.observe(&set_of(grey(1.0))), Ok(Observed::Used));
    let before = tracker.estimate_at(BALL, 1.0).unwrap();
    let late = tracker.observe(&set_of(grey(0.96)));
    refused(late, "time_s is 0.96; allowed: at or after 1, the time");
    assert_eq!(tracker.observe(&set_of(grey(1.0))), Ok(Observed::Repeated));
    assert_eq!(tracker.time_s(), Some(1.0));
    assert_eq!(tracker.estimate_at(BALL, 1.0).unwrap(), before);
    let later = FrameSet::without_frames(1.04).unwrap();
    assert_eq!(tracker.observe(&later), Ok(Observed::Used));
}

#[test]
fn unknown_cameras_are_an_error() {
    let mut tracker = tracker();
    let [left, _] = CAMERAS;
    let set = FrameSet::new([(left, grey(1.0)), (CameraId::new(2), grey(1.0))]).unwrap();
    let wanted = "camera is 2; allowed: the number of a camera, below 2";
    refused(tracker.observe(&set), wanted);
    refused(tracker.locate(&set, &[None], &[0.1]), wanted);
    assert_eq!(tracker.time_s(), None);
}

#[test]
fn images_of_another_size_are_an_error() {
    let mut tracker = tracker();
    let small = Frame::new(
        PixelFormat::Rgb8,
        YuvEncoding::default(),
        2,
        1,
        vec![0; 6],
        1.0,
    );
    let small = tracker.observe(&set_of(small.unwrap()));
    refused(small, "the image is 2 x 1 pixels, but 640 x 480");
    assert_eq!(tracker.time_s(), None);
}

#[test]
fn unknown_targets_are_an_error() {
    let mut tracker = tracker();
    let wanted = "target is 1; allowed: the number of a target, below 1";
    let other = TargetId::new(1);
    refused(tracker.estimate_at(other, 1.0), wanted);
    refused(tracker.bodies_at(other, 1.0), wanted);
    refused(tracker.contributions(other), wanted);
    refused(tracker.starts(other).map(|_| ()), wanted);
    refused(tracker.particles(other).map(|_| ()), wanted);
    let start = GaussianStart::default();
    refused(tracker.reinitialize(other, &start, 1.0), wanted);
    refused(tracker.estimate_at(BALL, f64::NAN), "time_s is NaN");
    assert_eq!(
        tracker.targets().map(TargetId::index).collect::<Vec<_>>(),
        [0]
    );
}
