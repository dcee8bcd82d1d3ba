//! Disks that are full: whole rows stay, pictures do not cost rows, and the message names the cause.
//!
//! A limit of the size of files stands for the full disk where a real one cannot be mounted.
#![cfg(unix)]

use std::fs;
use std::path::PathBuf;
use std::process::Command;

use crate::common::{Run, SCENE, Workplace, rows_in};

const PROGRAM: &str = env!("CARGO_BIN_EXE_pardalis");

/// Returns a workplace with many frames that need little space.
fn long_sequence(frames: usize) -> Workplace {
    let place = Workplace::with_frames(6);
    for number in 6..frames {
        fs::hard_link(place.image(number % 6), place.image(number)).unwrap();
    }
    place.write("scene.toml", SCENE);
    place
}

/// Runs the program where no file may have more than this number of blocks, of 512 or 1024 bytes depending on the shell.
fn limited(place: &Workplace, blocks: usize, arguments: &[&str]) -> Run {
    // Without the trap, a signal ends the program.
    let script = format!("trap '' XFSZ; ulimit -f {blocks}; exec \"$0\" \"$@\"");
    let mut command = Command::new("/bin/sh");
    command.args(["-c", &script, PROGRAM]).args(arguments);
    Run::of(command.current_dir(place.path("")))
}

/// Returns the names in a folder.
fn names_in(folder: PathBuf) -> Vec<String> {
    let entries = fs::read_dir(folder).unwrap();
    let mut names: Vec<_> = entries
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    names.sort();
    names
}

#[test]
fn the_last_row_is_whole_and_the_cause_is_named() {
    let place = long_sequence(60);
    for arguments in [
        &["track", "scene.toml", "-o", "out"][..],
        &["track", "scene.toml", "-o", "out", "--explain"],
    ] {
        let run = limited(&place, 8, arguments);
        assert_eq!(run.code, Some(1), "{}", run.stderr);
        let cause = "error: out/tracks.csv: cannot be written: the disk is full";
        assert!(run.stderr.contains(cause), "{}", run.stderr);
        // Fails if a row is cut.
        let rows = place.rows();
        assert!((5..60).contains(&rows.len()), "{}", rows.len());
        let last = rows.len() - 1;
        assert_eq!(rows[last][0], last.to_string());
        assert!(
            names_in(place.path("out"))
                .iter()
                .all(|name| !name.ends_with(".partial"))
        );
    }
    let particles = ["track", "scene.toml", "-o", "-", "--particles", "all.csv"];
    let run = limited(&place, 64, &particles);
    assert_eq!(run.code, Some(1), "{}", run.stderr);
    assert_eq!(rows_in(&run.stdout).len(), 60);
    assert!(
        run.stderr
            .starts_with("warning: all.csv: cannot be written: the disk is full"),
        "{}",
        run.stderr
    );
    assert!(
        run.stderr.contains("the rows go on without it"),
        "{}",
        run.stderr
    );
    let text = fs::read_to_string(place.path("all.csv")).unwrap();
    assert!(text.lines().count() > 100 && text.ends_with('\n'));
    let fields = |line: &str| line.split(',').count();
    assert!(text.lines().all(|line| fields(line) == 12));
}

#[test]
fn pictures_that_do_not_fit_cost_no_row() {
    let place = long_sequence(12);
    let run = limited(
        &place,
        48,
        &[
            "track",
            "scene.toml",
            "-o",
            "out",
            "--annotate",
            "--no-plots",
        ],
    );
    assert_eq!(run.code, Some(1), "{}", run.stderr);
    assert_eq!(place.rows().len(), 12);
    let lines: Vec<&str> = run.stderr.lines().collect();
    let cause = "out/annotated/000000.jpg: cannot be written: the disk is full";
    assert_eq!(lines.len(), 2, "{}", run.stderr);
    assert!(
        lines[0].starts_with(&format!("warning: {cause}")),
        "{}",
        run.stderr
    );
    assert!(
        lines[1].starts_with(&format!("error: {cause}")),
        "{}",
        run.stderr
    );
    assert_eq!(
        names_in(place.path("out")),
        ["annotated", "summary.json", "tracks.csv"]
    );
    assert!(names_in(place.path("out/annotated")).is_empty());
}

/// A real file system without space, if this machine lets tests mount one.
#[cfg(target_os = "linux")]
#[test]
fn a_real_full_disk_keeps_whole_rows() {
    let place = long_sequence(400);
    fs::create_dir(place.path("small")).unwrap();
    let inside = |script: &str| {
        let mut command = Command::new("unshare");
        command
            .args(["--user", "--map-root-user", "--mount", "/bin/sh", "-c"])
            .args([
                &format!("mount -t tmpfs -o size=64k none small && {{ {script}; }}"),
                PROGRAM,
            ])
            .current_dir(place.path(""));
        command
    };
    if !inside("true").status().is_ok_and(|status| status.success()) {
        println!("skipped: no file system can be mounted");
        return;
    }
    let track = "\"$0\" track scene.toml -o small/out --no-plots";
    let output = inside(&format!(
        "{track}; echo code $?; cat small/out/tracks.csv > rows"
    ))
    .output()
    .unwrap();
    let stdout = String::from_utf8(output.stdout).unwrap();
    let stderr = String::from_utf8(output.stderr).unwrap();
    assert_eq!(stdout, "code 1\n", "{stderr}");
    let cause = "error: small/out/tracks.csv: cannot be written: the disk is full";
    assert!(stderr.starts_with(cause), "{stderr}");
    let rows = fs::read_to_string(place.path("rows")).unwrap();
    let rows = rows_in(&rows);
    assert!((100..400).contains(&rows.len()), "{}", rows.len());
}

#[test]
fn reports_that_do_not_fit_leave_the_previous_ones() {
    let place = Workplace::with_frames(1);
    let data = crate::common::data();
    place.write("report.json", "previous");
    place.write("scene.toml", SCENE);
    let truth = data.join("truth.csv");
    place.track(SCENE).fine();
    let arguments = [
        "evaluate",
        "out",
        truth.to_str().unwrap(),
        "--json",
        "report.json",
    ];
    let before = names_in(place.path(""));
    let run = limited(&place, 1, &arguments);
    assert_eq!(run.code, Some(1), "{}", run.stderr);
    assert!(
        run.stderr
            .contains("error: report.json: cannot be written: the disk is full"),
        "{}",
        run.stderr
    );
    assert_eq!(fs::read(place.path("report.json")).unwrap(), b"previous");
    assert_eq!(names_in(place.path("")), before);
}

#[test]
fn colours_are_written_before_their_pictures() {
    let place = Workplace::with_frames(1);
    let arguments = [
        "learn",
        "--image",
        "images/000000.jpg",
        "--rect",
        "430,60,60,60",
        "-o",
        "new.toml",
    ];
    let run = limited(&place, 16, &arguments);
    assert_eq!(run.code, Some(1), "{}", run.stderr);
    let cause = "error: new-learnt/histogram.svg: cannot be written: the disk is full";
    assert!(run.stderr.contains(cause), "{}", run.stderr);
    let scene = SCENE.replace("ball.toml", "new.toml");
    place.track(scene).fine();
}

#[test]
fn results_that_cannot_be_printed_are_an_error() {
    if !cfg!(target_os = "linux") {
        return;
    }
    let place = Workplace::with_frames(1);
    place.write("scene.toml", SCENE);
    let data = crate::common::data();
    let truth = data.join("truth.csv");
    for arguments in [
        &["--help"][..],
        &["track", "--help"],
        &["--version"],
        &["track", "scene.toml", "-o", "out", "--no-plots"],
        &["evaluate", "out", truth.to_str().unwrap()],
        &["locate", "scene.toml", "-o", "located"],
        &[
            "init",
            "images",
            "--fps",
            "25",
            "--colors",
            "ball.toml",
            "-o",
            "new.toml",
        ],
    ] {
        let full = fs::OpenOptions::new()
            .write(true)
            .open("/dev/full")
            .unwrap();
        let mut command = Command::new(PROGRAM);
        command
            .args(arguments)
            .current_dir(place.path(""))
            .stdout(full);
        let run = Run::of(&mut command);
        assert_eq!(run.code, Some(1), "{arguments:?}: {}", run.stderr);
        let cause = "error: standard output: cannot be written: No space left";
        assert!(run.stderr.contains(cause), "{arguments:?}: {}", run.stderr);
    }
}

#[test]
fn pictures_of_an_earlier_run_do_not_stay_beside_other_rows() {
    let place = Workplace::with_frames(3);
    place.track_with(SCENE, &["-o", "out", "--annotate"]).fine();
    assert_eq!(names_in(place.path("out")).len(), 11);
    assert_eq!(names_in(place.path("out/annotated")).len(), 3);
    place.write("out/notes.txt", "mine");
    place.write("out/annotated/best.jpg", "mine, too");
    fs::create_dir(place.path("out/annotated/cam2")).unwrap();
    place.write(
        "out/annotated/cam2/000000.jpg",
        "of a scene with two cameras",
    );
    place.track(SCENE).fine();
    assert_eq!(names_in(place.path("out/annotated")), ["best.jpg"]);
    assert_eq!(
        names_in(place.path("out")),
        [
            "annotated",
            "notes.txt",
            "summary.json",
            "summary.previous.json",
            "tracks.csv",
            "tracks.previous.csv"
        ]
    );
}
