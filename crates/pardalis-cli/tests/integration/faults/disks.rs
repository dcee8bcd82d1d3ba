//! Disks that vanish, are slow, or cannot be written. `full_disk.rs` tests full ones.

use std::fs;
use std::io::{BufRead, BufReader};
use std::process::{Command, Stdio};
use std::time::Duration;

use super::camera::{Cameras, SIZE_PX, Stream, ball};
use crate::common::run::wait_for_lines;
use crate::common::{Run, SCENE, Workplace, rows_in};

/// Returns a live camera whose frames come in two parts, the second of them when the file `go` is there.
fn in_two_parts() -> Cameras {
    let script = "cat first; while ! [ -e go ]; do sleep 0.02; done; exec cat second";
    let cameras = Cameras::with_script(1, "input.reopen_s = 0", script);
    let images = ball(12);
    let first = Stream::of(SIZE_PX).ball(&images[..6], 0.0).bytes;
    let both = Stream::of(SIZE_PX)
        .ball(&images[..6], 0.0)
        .ball(&images[6..], 0.24);
    cameras.place.write("second", &both.bytes[first.len()..]);
    cameras.place.write("first", first);
    cameras
}

#[test]
fn results_that_are_removed_are_an_error_that_names_them() {
    for options in [&[][..], &["--annotate"], &["--particles", "particles.csv"]] {
        let cameras = in_two_parts();
        let mut command = cameras.command(cameras.scene());
        let command = command.args(options).stdout(Stdio::piped());
        let mut program = command.stderr(Stdio::piped()).spawn().unwrap();
        wait_for_lines(&mut program, &cameras.place.path("out/tracks.csv"), 7);
        fs::rename(cameras.place.path("out"), cameras.place.path("moved")).unwrap();
        fs::remove_dir_all(cameras.place.path("moved")).unwrap();
        cameras.place.write("go", "");
        let run = Run::from(program.wait_with_output().unwrap());
        assert_eq!(run.code, Some(1), "{options:?}: {}", run.stderr);
        let error = "error: out/tracks.csv: was removed while it was written, and its rows are lost; choose a folder";
        assert!(run.stderr.contains(error), "{options:?}: {}", run.stderr);
    }
}

#[test]
fn results_that_are_moved_keep_their_rows() {
    let cameras = in_two_parts();
    let mut program = cameras.start(cameras.scene());
    wait_for_lines(&mut program, &cameras.place.path("out/tracks.csv"), 7);
    fs::rename(cameras.place.path("out"), cameras.place.path("moved")).unwrap();
    cameras.place.write("go", "");
    let run = Run::from(program.wait_with_output().unwrap());
    assert_ne!(run.code, Some(0), "{}", run.stderr);
    let error = "error: out/summary.json: cannot be written";
    assert!(run.stderr.contains(error), "{}", run.stderr);
    let rows = fs::read_to_string(cameras.place.path("moved/tracks.csv")).unwrap();
    assert_eq!(rows_in(&rows).len(), 12);
}

#[test]
fn images_that_vanish_are_named_and_the_rows_before_stay() {
    let place = Workplace::with_frames(6);
    for number in 6..2000 {
        fs::hard_link(place.image(number % 6), place.image(number)).unwrap();
    }
    let mut command = place.command(SCENE, &["-o", "out", "--no-plots"]);
    let command = command.stdout(Stdio::piped()).stderr(Stdio::piped());
    let mut program = command.spawn().unwrap();
    wait_for_lines(&mut program, &place.path("out/tracks.csv"), 10);
    fs::rename(place.path("images"), place.path("gone")).unwrap();
    let run = Run::from(program.wait_with_output().unwrap());
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    let start = "warning: cameras.cam1: left out a broken image: images/";
    assert!(run.stderr.starts_with(start), "{}", run.stderr);
    assert!(
        run.stderr.contains("cannot be read: there is no such file"),
        "{}",
        run.stderr
    );
    let rows = place.rows().len();
    assert!((9..2000).contains(&rows), "{rows}");
    let summary = fs::read_to_string(place.path("out/summary.json")).unwrap();
    let broken = format!("\"broken\": {}", 2000 - rows);
    assert!(summary.contains(&broken), "{broken} {summary}");
}

/// Whatever takes the rows slowly, as a slow disk does: none is lost, and the camera waits.
#[test]
fn a_slow_destination_loses_no_row() {
    let images = ball(12);
    let cameras = Cameras::new(1, "input.reopen_s = 0");
    cameras.opening("cam1", 1, Stream::of(SIZE_PX).ball(&images, 0.0));
    let made = Command::new("mkfifo")
        .arg(cameras.place.path("slow.csv"))
        .status();
    assert!(made.unwrap().success());
    let mut command = cameras.command(cameras.scene());
    command.args(["--particles", "slow.csv"]);
    let mut program = command.spawn().unwrap();
    let slow = fs::File::open(cameras.place.path("slow.csv")).unwrap();
    // 100 particles a frame; more than a pipe holds.
    let mut lines = 0;
    for line in BufReader::with_capacity(4096, slow).lines() {
        line.unwrap();
        lines += 1;
        if lines % 50 == 0 {
            std::thread::sleep(Duration::from_millis(20));
        }
    }
    assert!(program.wait().unwrap().success());
    assert_eq!(lines, 1 + 12 * 100);
    assert_eq!(cameras.times_s().len(), 12);
}

/// Folders that cannot be written, if this machine lets tests mount one: tests of the superuser may write everywhere else.
#[cfg(target_os = "linux")]
#[test]
fn a_folder_that_cannot_be_written_is_refused_before_tracking() {
    let place = Workplace::with_frames(3);
    place.write("scene.toml", SCENE);
    fs::create_dir(place.path("locked")).unwrap();
    let inside = |script: &str| {
        let mut command = Command::new("unshare");
        let script = format!("mount -t tmpfs -o ro none locked && {{ {script}; }}");
        command.args([
            "--user",
            "--map-root-user",
            "--mount",
            "/bin/sh",
            "-c",
            &script,
        ]);
        command.arg(env!("CARGO_BIN_EXE_pardalis"));
        command.current_dir(place.path(""));
        command
    };
    if !inside("true").status().is_ok_and(|status| status.success()) {
        println!("skipped: no file system can be mounted");
        return;
    }
    for output in ["locked", "locked/out"] {
        let run = Run::of(&mut inside(&format!(
            "exec \"$0\" track scene.toml -o {output}"
        )));
        run.refused(&[
            "locked",
            "cannot be written (Read-only file system",
            "choose an existing folder with write permission",
        ]);
    }
}
