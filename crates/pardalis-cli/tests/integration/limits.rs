//! `pardalis track --frames` and `--duration`: runs that end before the frames do.

use std::fs;
use std::io::Write as _;
use std::process::Stdio;

use crate::common::{Run, SCENE, Workplace, rows_in};
use crate::live::{video, with_stream};

/// Returns the lines of a table of rows after checking that they are whole.
fn lines(text: &str) -> Vec<&str> {
    rows_in(text);
    text.lines().collect()
}

#[test]
fn runs_of_images_end_at_their_limit() {
    let place = Workplace::with_frames(12);
    let all = place.track_with(SCENE, &["-o", "-"]).fine().stdout;
    for (arguments, rows) in [
        (&["--frames", "3"][..], 3),
        (&["--duration", "0.2"], 5),
        (&["--duration", "0.2", "--frames", "2"], 2),
        (&["--duration", "1e9", "--frames", "99"], 12),
    ] {
        let run = place.track_with(SCENE, &[&["-o", "out"], arguments].concat());
        let run = run.fine();
        assert!(
            run.stdout.starts_with(&format!("processed {rows} frames ")),
            "{}",
            run.stdout
        );
        let tracks = fs::read_to_string(place.path("out/tracks.csv")).unwrap();
        assert_eq!(lines(&tracks), lines(&all)[..=rows]);
        let summary = fs::read(place.path("out/summary.json")).unwrap();
        let summary: serde_json::Value = serde_json::from_slice(&summary).unwrap();
        assert_eq!(summary["frame_sets"], rows);
        assert_eq!(summary["limit_reached"], rows < 12);
        assert_eq!(summary["cameras"]["cam1"]["frames"]["delivered"], rows);
        assert!(place.path("out/above.png").exists());
        fs::remove_dir_all(place.path("out")).unwrap();
    }
}

#[test]
fn limits_that_allow_no_frame_are_refused() {
    let place = Workplace::with_frames(1);
    for arguments in [
        ["--frames", "0"],
        ["--frames", "-1"],
        ["--duration", "0"],
        ["--duration", "-1"],
        ["--duration", "nan"],
        ["--duration", "inf"],
    ] {
        let run = place.track_with(SCENE, &arguments);
        run.refused(&[arguments[0], "above 0"]);
    }
}

#[test]
fn a_live_session_ends_at_its_limit() {
    let Some(place) = with_stream(40) else {
        return;
    };
    let stream = fs::read(place.path("ride.ts")).unwrap();
    for (arguments, rows) in [(["--frames", "7"], 7), (["--duration", "0.4"], 10)] {
        let arguments = [&["-o", "out"][..], &arguments].concat();
        let mut command = place.command(video("-"), &arguments);
        let command = command.stdin(Stdio::piped()).stdout(Stdio::piped());
        let mut program = command.stderr(Stdio::piped()).spawn().unwrap();
        // The stream goes on, because the pipe stays open.
        let mut camera = program.stdin.take().unwrap();
        // The program may have ended before it takes everything.
        let _ = camera.write_all(&stream);
        let output = program.wait_with_output().unwrap();
        drop(camera);
        Run::from(output).fine();
        assert_eq!(place.rows().len(), rows);
        assert!(place.path("out/above.png").exists());
    }
}
