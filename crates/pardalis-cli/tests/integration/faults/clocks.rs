//! Clocks that are set while a camera is tracked, and recordings with wrong time stamps.

use super::camera::{Cameras, SIZE_PX, Stream, ball};

const FRAMES: usize = 12;

/// Returns the frames of a stream with a jump of its time stamps before the fifth frame.
fn jumping(images: &[Vec<u8>], jump_s: f64) -> Stream {
    let before = Stream::of(SIZE_PX).ball(&images[..4], 5000.0);
    before.ball(&images[4..], 5000.16 + jump_s)
}

#[test]
fn a_live_camera_whose_clock_is_set_goes_on_beside_the_other() {
    let images = ball(FRAMES);
    for jump_s in [3600.0, -3600.0] {
        let cameras = Cameras::new(2, "input.reopen_s = 0.5");
        cameras.opening("cam1", 1, jumping(&images, jump_s));
        cameras.opening("cam2", 1, Stream::of(SIZE_PX).ball(&images, 5000.0));
        let run = cameras.track();
        assert_eq!(run.code, Some(0), "{}", run.stderr);
        let wanted = format!(
            "warning: udp://lab:5000/cam1: its time stamps jumped by {}",
            jump_s as i64
        );
        // By a fraction of a second more or less, because all frames come at once.
        let start = &wanted[..wanted.len() - 2];
        assert!(run.stderr.contains(start), "{}", run.stderr);
        assert!(
            run.stderr
                .contains("the times go on by this computer's clock"),
            "{}",
            run.stderr
        );
        let times_s = cameras.times_s();
        assert!(
            times_s.iter().all(|s| (5000.0..5002.0).contains(s)),
            "{times_s:?}"
        );
        for (camera, jumps) in [("cam1", 1), ("cam2", 0)] {
            let summary = cameras.summary(camera);
            assert_eq!(summary["clock_jumps"], jumps);
            assert_eq!(summary["frames"]["delivered"], FRAMES, "{summary}");
            assert_eq!(summary["frames"]["dropped_late"], 0, "{summary}");
        }
    }
}

#[test]
fn many_jumps_are_counted_and_few_are_named() {
    let images = ball(FRAMES);
    let mut stream = Stream::of(SIZE_PX);
    for (number, image) in images.iter().enumerate() {
        stream = stream.frame(if number % 2 == 0 { 0.0 } else { 100.0 }, image);
    }
    let cameras = Cameras::new(1, "input.reopen_s = 0.5");
    cameras.opening("cam1", 1, stream);
    let run = cameras.track();
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    assert_eq!(run.stderr.matches("its time stamps jumped by").count(), 3);
    assert!(
        run.stderr
            .contains("further jumps are counted, but not named"),
        "{}",
        run.stderr
    );
    assert_eq!(cameras.summary("cam1")["clock_jumps"], FRAMES - 1);
    let times_s = cameras.times_s();
    assert_eq!(times_s.len(), FRAMES);
    assert!(times_s.is_sorted_by(|a, b| a < b), "{times_s:?}");
}

#[test]
fn a_camera_that_returns_with_another_clock_goes_on() {
    let images = ball(FRAMES);
    for first_s in [0.0, 86400.0] {
        let cameras = Cameras::new(1, "input.reopen_s = 1.5");
        cameras.opening("cam1", 1, Stream::of(SIZE_PX).ball(&images[..4], 5000.0));
        cameras.opening("cam1", 2, Stream::of(SIZE_PX).ball(&images[4..], first_s));
        let run = cameras.track();
        assert_eq!(run.code, Some(0), "{}", run.stderr);
        let times_s = cameras.times_s();
        assert_eq!(times_s.len(), FRAMES);
        // The pause before it is opened again.
        let gap_s = times_s[4] - times_s[3];
        assert!((0.4..60.0).contains(&gap_s), "{times_s:?}");
        assert_eq!(cameras.summary("cam1")["reopened"], 1);
    }
}

/// A recording is not changed: its rows have its own time stamps, and the order of time.
#[test]
fn a_recording_with_a_wrong_time_stamp_keeps_all_its_rows() {
    let images = ball(FRAMES);
    let mut stream = Stream::of(SIZE_PX);
    for (number, image) in images.iter().enumerate() {
        let time_s = if number == 4 {
            3600.0
        } else {
            0.04 * number as f64
        };
        stream = stream.frame(time_s, image);
    }
    let cameras = Cameras::new(1, "");
    cameras
        .place
        .write("ride.nut", "the stand-in passes another stream on");
    cameras.opening("ride.nut", 1, stream);
    let scene = cameras.scene_of_file("ride.nut");
    let run = cameras.track_scene(scene).fine();
    assert!(
        run.stdout.starts_with("processed 12 frames"),
        "{}",
        run.stdout
    );
    let times_s = cameras.times_s();
    assert_eq!(times_s.len(), FRAMES);
    assert!(times_s.is_sorted_by(|a, b| a < b), "{times_s:?}");
    assert_eq!(times_s[FRAMES - 1], 3600.0);
}
