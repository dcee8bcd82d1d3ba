//! What a stand-in for ffmpeg delivers: failures, surplus bytes, and times of all kinds.

use std::ffi::OsStr;
use std::path::PathBuf;

use super::*;
use crate::interrupt::Stop;
use crate::source::Clock;

/// Creates programs that replace ffmpeg's: the second runs the shell script.
fn stand_in(folder: &TempDir, script: &str) -> Programs {
    use std::os::unix::fs::PermissionsExt;
    let real = |name: &str| {
        std::env::split_paths(&std::env::var_os("PATH").unwrap_or_default())
            .map(|folder| folder.join(name))
            .find(|path| path.is_file())
            .expect("found before")
    };
    let write = |name: &str, text: String| {
        let path: PathBuf = folder.path().join(name);
        std::fs::write(&path, text).expect("written");
        std::fs::set_permissions(&path, PermissionsExt::from_mode(0o755)).expect("runnable");
    };
    let ffmpeg = real("ffmpeg").display().to_string();
    write(
        "ffprobe",
        format!("#!/bin/sh\nexec {} \"$@\"\n", real("ffprobe").display()),
    );
    write(
        "ffmpeg",
        format!(
            "#!/bin/sh\ncase \"$*\" in *'-h long'*) exec {ffmpeg} \"$@\";; esac\n{}\n",
            script.replace("FFMPEG", &ffmpeg)
        ),
    );
    Programs::find(OsStr::new(folder.path())).expect("both stand-ins")
}

/// Reads a clip of six frames with a stand-in; returns the times of the valid frames, the error and the statistics.
fn read_with(script: &str) -> Option<(Vec<f64>, Option<String>, Counters)> {
    programs()?;
    let folder = TempDir::new().expect("a folder");
    let path = clip(
        &folder,
        "clip.nut",
        &["-c:v", "rawvideo", "-pix_fmt", "nv12"],
    );
    let programs = stand_in(&folder, script);
    let (description, frames) = VideoFrames::open(
        &programs,
        &VideoInput::of_path(&path),
        None,
        FrameRange::ALL,
        &Stop::default(),
    )
    .expect("opens");
    let process = frames.process();
    let mut source = Source::start(description, Clock::Recorded, 0.0, frames).expect("a thread");
    source.process = Some(process);
    let (mut times, mut error) = (Vec::new(), None);
    for frame in source.by_ref() {
        match frame {
            Ok(delivery) => times.push(frame_of(delivery).time_s()),
            Err(found) => error = Some(found.to_string()),
        }
    }
    Some((times, error, source.counters()))
}

#[test]
fn frames_before_a_failure_are_delivered_and_the_failure_is_quoted() {
    // The third frame is truncated.
    let script = "FFMPEG \"$@\" | head -c 1000000; echo '[fatal] camera unplugged' >&2; exit 9";
    let Some((times, error, counters)) = read_with(script) else {
        return;
    };
    assert_eq!(times, [0.0, 0.04]);
    let error = error.expect("a failure");
    assert!(
        error.contains("clip.nut: ffmpeg failed (exit status: 9), after 2 frames"),
        "{error}"
    );
    assert!(error.contains("[fatal] camera unplugged"), "{error}");
    assert!(counters.ffmpeg_errors >= 1);
}

#[test]
fn what_is_no_frame_is_an_error() {
    for (script, frames, expected) in [
        ("FFMPEG \"$@\"; echo surplus", 6, "frame 6 is not"),
        ("FFMPEG \"$@\" | head -c 1000000", 2, "ended within a frame"),
        (
            "echo this is not a stream of frames",
            0,
            "it is not a NUT stream",
        ),
    ] {
        let Some((times, error, _)) = read_with(script) else {
            return;
        };
        assert_eq!(times.len(), frames);
        let error = error.expect("an error");
        assert!(error.contains(expected), "{error}");
    }
}

#[test]
fn times_do_not_depend_on_the_messages_of_ffmpeg() {
    let Some((times, error, _)) = read_with("FFMPEG \"$@\" 2> /dev/null") else {
        return;
    };
    assert_eq!(error, None);
    assert_eq!(times, [0.0, 0.04, 0.08, 0.12, 0.16, 0.2]);
}

/// Runs the installed ffmpeg with another filter before its own ones.
fn read_filtered(filter: &str) -> Option<(Vec<f64>, Option<String>, Counters)> {
    read_with(&format!(
        "for a; do shift; case \"$a\" in format=*) a=\"{filter},$a\";; esac; set -- \"$@\" \"$a\"; done; FFMPEG \"$@\""
    ))
}

#[test]
fn times_that_repeat_or_decrease_or_are_negative_are_kept() {
    let Some((times, error, _)) =
        read_filtered("setpts='if(eq(N,2),PTS-3/TB,if(eq(N,4),PTS-0.04/TB,PTS))'")
    else {
        return;
    };
    assert_eq!(error, None);
    let third = 0.08 - 3.0;
    assert!((times[2] - third).abs() < 1e-9, "{times:?}");
    let others = [times[0], times[1], times[3], times[4], times[5]];
    assert_eq!(others, [0.0, 0.04, 0.12, 0.12, 0.2]);
}

#[test]
fn a_missing_time_stamp_is_an_error() {
    let Some((times, error, _)) = read_filtered("setpts='if(eq(N,2),NAN,PTS)'") else {
        return;
    };
    assert_eq!(times, [0.0, 0.04]);
    let error = error.expect("an error");
    assert!(error.contains("frame 2 has no time stamp"), "{error}");
}
