//! An ffmpeg that hangs, dies, floods the program with messages, or cannot be started.

use std::fs;
use std::os::unix::process::CommandExt as _;
use std::process::Stdio;

use super::camera::{Cameras, SIZE_PX, Stream, ball};
use crate::common::run::{interrupt, interrupt_group, wait_for_lines};
use crate::common::{Run, rows_in};

const FRAMES: usize = 6;

/// Delivers the stream `stream`, in all of the first openings, and then goes on with another command.
fn stream_then(rest: &str, openings: usize, settings: &str) -> Cameras {
    let script = format!("[ $opened -le {openings} ] || exit 1\ncat stream\n{rest}");
    let cameras = Cameras::with_script(1, settings, &script);
    let stream = Stream::of(SIZE_PX).ball(&ball(FRAMES), 0.0);
    cameras.place.write("stream", stream.bytes);
    cameras
}

#[test]
fn a_live_ffmpeg_that_hangs_from_the_start_is_given_up() {
    let cameras = Cameras::with_script(1, "input.timeout_s = 1", "exec sleep 1000");
    let run = cameras.track();
    assert_eq!(run.code, Some(2), "{}", run.stderr);
    let wanted = "line 3: cameras.cam1.video: udp://lab:5000/cam1: no frame came within 1 s; check that the camera sends to this port";
    assert!(run.stderr.contains(wanted), "{}", run.stderr);
}

#[test]
fn a_live_ffmpeg_that_hangs_is_ended_and_started_again() {
    let settings = "input.timeout_s = 1\ninput.reopen_s = 1";
    let cameras = stream_then("exec sleep 1000", 2, settings);
    let run = cameras.track();
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    for wanted in [
        "no frame came for 1 s; opening it again for 1 s",
        "is back after",
    ] {
        assert!(run.stderr.contains(wanted), "{}", run.stderr);
    }
    // Those of the second opening as well.
    assert!(cameras.times_s().len() >= 2 * FRAMES, "{}", run.stderr);
}

/// The first Ctrl-C ends it as any other run.
#[test]
fn ctrl_c_ends_a_wait_for_an_ffmpeg_that_hangs_in_a_file() {
    let cameras = stream_then("exec sleep 1000", 1, "");
    cameras
        .place
        .write("ride.nut", "the stand-in passes another stream on");
    let scene = cameras.scene_of_file("ride.nut");
    let mut program = cameras.start(scene);
    let tracks = cameras.place.path("out/tracks.csv");
    wait_for_lines(&mut program, &tracks, FRAMES);
    let run = interrupt(program);
    assert_eq!(run.code, Some(1), "{}", run.stderr);
    let wanted = "error: interrupted after 6 frames; the rows written so far are complete";
    assert!(run.stderr.starts_with(wanted), "{}", run.stderr);
    assert!(rows_in(&fs::read_to_string(tracks).unwrap()).len() == FRAMES);
}

/// A terminal interrupts all that was started with the program. An ffmpeg that ended by itself would look like a camera that failed.
#[test]
fn ctrl_c_in_a_terminal_does_not_reach_ffmpeg() {
    let rest = "trap 'echo > interrupted' INT\necho > ready\nwhile :; do sleep 0.01; done";
    let cameras = stream_then(rest, 1, "");
    let mut command = cameras.command(cameras.scene());
    let command = command.process_group(0).stdout(Stdio::piped());
    let mut program = command.stderr(Stdio::piped()).spawn().unwrap();
    wait_for_lines(&mut program, &cameras.place.path("ready"), 1);
    wait_for_lines(&mut program, &cameras.place.path("out/tracks.csv"), FRAMES);
    interrupt_group(program).fine();
    assert!(!cameras.place.path("interrupted").exists());
}

#[test]
fn an_ffmpeg_that_dies_is_named_with_its_last_words() {
    for (ending, wanted) in [
        (
            "echo '[fatal] unplugged' >&2; exit 9",
            "ffmpeg failed (exit status: 9)",
        ),
        (
            "echo '[fatal] unplugged' >&2; kill -SEGV $$",
            "ffmpeg failed (signal: 11",
        ),
    ] {
        let cameras = stream_then(ending, 1, "input.reopen_s = 0");
        let run = cameras.track();
        assert_eq!(run.code, Some(0), "{}", run.stderr);
        let stopped = format!("warning: cameras.cam1: stopped: udp://lab:5000/cam1: {wanted}");
        assert!(run.stderr.contains(&stopped), "{}", run.stderr);
        assert!(run.stderr.contains("[fatal] unplugged"), "{}", run.stderr);
        assert_eq!(cameras.times_s().len(), FRAMES);
    }
}

#[test]
fn an_ffmpeg_that_cannot_run_is_named() {
    let cameras = Cameras::new(1, "");
    cameras.place.write("bin/ffmpeg", "#!/nowhere/at/all\n");
    let run = cameras.track();
    assert_ne!(run.code, Some(0), "{}", run.stderr);
    assert!(
        run.stderr.contains("cannot be started") || run.stderr.contains("ffmpeg cannot open it"),
        "{}",
        run.stderr
    );
    assert!(
        run.stderr.contains("line 3: cameras.cam1.video"),
        "{}",
        run.stderr
    );
}

#[cfg(target_os = "linux")]
#[test]
fn floods_of_messages_take_no_memory() {
    use super::process::peak_mib;
    for flood in [
        // A message without an end, many messages, and a stream without an end.
        "head -c 300000000 /dev/zero | tr '\\0' x >&2",
        "yes '[error] this is a message of ffmpeg' | head -c 30000000 >&2",
        "head -c 300000000 /dev/zero",
    ] {
        let rest = format!("{flood}\necho > over\nexec sleep 1000");
        let cameras = stream_then(&rest, 1, "input.reopen_s = 0");
        let mut program = cameras.start(cameras.scene());
        let mut peak = 0;
        let over = cameras.place.path("over");
        while !over.exists() && program.try_wait().unwrap().is_none() {
            peak = peak.max(peak_mib(program.id()).unwrap_or(0));
            std::thread::sleep(std::time::Duration::from_millis(10));
        }
        // A stream that cannot be read ends the run.
        let run = match program.try_wait().unwrap() {
            Some(_) => Run::from(program.wait_with_output().unwrap()),
            None => interrupt(program),
        };
        assert_eq!(run.code, Some(0), "{}", run.stderr);
        assert!((10..200).contains(&peak), "{flood}: {peak} MiB");
        assert_eq!(cameras.times_s().len(), FRAMES);
    }
}
