//! Cameras that freeze, tear, change their size, stop, return and send garbage.

use super::camera::{Cameras, MISSING_S, SIZE_PX, Stream, ball};

/// Frames that a test needs to see that tracking goes on.
const FRAMES: usize = 12;

#[test]
fn a_frozen_camera_gives_rows_and_is_counted() {
    let images = ball(FRAMES);
    let frozen: Vec<_> = (0..FRAMES)
        .map(|number| images[number.min(4)].clone())
        .collect();
    let cameras = Cameras::new(1, "input.reopen_s = 0");
    cameras.opening("cam1", 1, Stream::of(SIZE_PX).ball(&frozen, 0.0));
    let run = cameras.track();
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    assert_eq!(cameras.times_s().len(), FRAMES);
    assert_eq!(cameras.summary("cam1")["frames"]["frozen"], 7);
    let warning = "cameras.cam1: only 5 of its 12 frames were used";
    assert!(run.stderr.contains(warning), "{}", run.stderr);
}

#[test]
fn torn_frames_cost_no_row_and_the_target_is_kept() {
    let mut images = ball(FRAMES);
    // The lower part is noise, that of the frame before, or black; the ball is in it.
    let part = 640 * 3 * 100;
    for (number, byte) in images[4][part..].iter_mut().enumerate() {
        *byte = (number * number) as u8;
    }
    let before = images[5][part..].to_vec();
    images[6][part..].copy_from_slice(&before);
    images[8][part..].fill(0);
    let cameras = Cameras::new(1, "input.reopen_s = 0");
    cameras.opening("cam1", 1, Stream::of(SIZE_PX).ball(&images, 0.0));
    cameras.track().fine();
    let rows = cameras.place.rows();
    assert_eq!(rows.len(), FRAMES);
    assert_eq!(rows[FRAMES - 1][3], "tracking");
}

#[test]
fn a_camera_that_changes_its_size_is_opened_again_until_it_has_the_first_one() {
    let images = ball(FRAMES);
    let cameras = Cameras::new(1, "input.reopen_s = 3");
    let small = vec![7; 320 * 240 * 3];
    let changing = Stream::of(SIZE_PX)
        .ball(&images[..4], 0.0)
        .frame(0.16, &small);
    cameras.opening("cam1", 1, changing);
    cameras.opening("cam1", 2, Stream::of((320, 240)).frame(0.2, &small));
    cameras.opening("cam1", 3, Stream::of(SIZE_PX).ball(&images[6..], 0.24));
    let run = cameras.track();
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    let lines: Vec<&str> = run.stderr.lines().collect();
    let wanted = "udp://lab:5000/cam1: frame 4 is not 640 x 480 pixels large";
    assert!(lines[0].contains(wanted), "{}", run.stderr);
    assert!(
        lines[1].contains("udp://lab:5000/cam1: is back after "),
        "{}",
        run.stderr
    );
    assert_eq!(cameras.times_s().len(), 10);
    assert_eq!(cameras.summary("cam1")["reopened"], 1);
    // Bytes of the wrong size were neither tracked nor taken for the next frame.
    assert!(cameras.place.rows().iter().all(|row| row[3] == "tracking"));
}

#[test]
fn a_camera_that_sends_garbage_is_opened_again() {
    let images = ball(FRAMES);
    let garbage: Vec<u8> = (0..100_000_u32)
        .map(|n| (n.wrapping_mul(2_654_435_761) >> 13) as u8)
        .collect();
    let cut = images[4][..1000].to_vec();
    let whole = Stream::of(SIZE_PX).ball(&images[4..5], 0.16).bytes;
    for (name, ending) in [
        ("garbage", garbage.clone()),
        (
            "a frame without its end",
            whole[..whole.len() - 1000].to_vec(),
        ),
        ("a short frame", Stream::of(SIZE_PX).frame(0.16, &cut).bytes),
        (
            "a frame without a time",
            Stream::of(SIZE_PX)
                .frame(0.12 + MISSING_S, &images[4])
                .bytes,
        ),
    ] {
        let cameras = Cameras::new(1, "input.reopen_s = 2");
        let stream = Stream::of(SIZE_PX).ball(&images[..4], 0.0).raw(&ending);
        cameras.opening("cam1", 1, stream);
        // It is garbage from the beginning.
        cameras.opening(
            "cam1",
            2,
            Stream {
                bytes: garbage.clone(),
            },
        );
        cameras.opening("cam1", 3, Stream::of(SIZE_PX).ball(&images[5..], 0.2));
        let run = cameras.track();
        assert_eq!(run.code, Some(0), "{name}: {}", run.stderr);
        let opened = "opening it again for 2 s";
        assert!(run.stderr.contains(opened), "{name}: {}", run.stderr);
        assert!(
            run.stderr.contains("is back after "),
            "{name}: {}",
            run.stderr
        );
        assert_eq!(cameras.times_s().len(), FRAMES - 1, "{name}");
        assert_eq!(cameras.summary("cam1")["reopened"], 1, "{name}");
    }
}

#[test]
fn a_camera_that_stops_for_good_is_named_and_does_not_stop_the_other() {
    let images = ball(FRAMES);
    let cameras = Cameras::new(2, "input.reopen_s = 1");
    cameras.opening("cam1", 1, Stream::of(SIZE_PX).ball(&images, 0.0));
    cameras.opening("cam2", 1, Stream::of(SIZE_PX).ball(&images[..4], 0.0));
    let run = cameras.track();
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    let wanted = "cameras.cam2: stopped: udp://lab:5000/cam2: did not come back within 1 s: ";
    assert!(run.stderr.contains(wanted), "{}", run.stderr);
    // What ffmpeg said last.
    assert!(run.stderr.contains("[error] unplugged"), "{}", run.stderr);
    let times_s = cameras.times_s();
    assert_eq!(times_s.len(), FRAMES, "{times_s:?}");
    let stopped = &cameras.summary("cam2")["stopped"];
    assert_eq!(stopped["time_s"], 0.12);
    // All that had been delivered before is used.
    for (camera, used) in [("cam1", FRAMES), ("cam2", 4)] {
        let summary = cameras.summary(camera);
        assert_eq!(summary["frames"]["used"], used, "{summary}");
    }
}
