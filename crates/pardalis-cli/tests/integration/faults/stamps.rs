//! Live sources on their way through the real ffmpeg: frames at once, time stamps as they are.

use std::fs;
use std::io::Write as _;
use std::process::{Child, Command, Stdio};

use serde_json::Value;

use super::camera::{SIZE_PX, Stream, ball, write_frame};
use crate::common::run::wait_for_lines;
use crate::common::{Run, Workplace};
use crate::live::video;

/// Number of frames that ffmpeg examines before it delivers the first: those of half a second, and some more.
const EXAMINED: usize = 20;

/// Tracks what comes over standard input: frames with these times in seconds, one at a time after those that ffmpeg examines. `None` without ffmpeg.
fn track(stamps_s: &[f64]) -> Option<(Workplace, Run)> {
    if Command::new("ffmpeg").arg("-version").output().is_err() {
        println!("skipped: ffmpeg is not installed");
        return None;
    }
    let place = Workplace::with_frames(0);
    let mut program = start(&place);
    let mut camera = program.stdin.take().unwrap();
    camera.write_all(&Stream::of(SIZE_PX).bytes).unwrap();
    let mut rows = 0;
    for (number, (time_s, image)) in stamps_s.iter().zip(&ball(stamps_s.len())).enumerate() {
        let mut frame = Vec::new();
        write_frame(&mut frame, *time_s, image);
        camera.write_all(&frame).unwrap();
        // Times that have been tracked get no second row.
        rows += usize::from(stamps_s[..number].iter().all(|before_s| before_s < time_s));
        if number >= EXAMINED {
            // The first line names the columns.
            wait_for_lines(&mut program, &place.path("out/tracks.csv"), 1 + rows);
        }
    }
    drop(camera);
    let run = Run::from(program.wait_with_output().unwrap());
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    Some((place, run))
}

fn start(place: &Workplace) -> Child {
    let scene = video("-\"\ninput.when_behind = \"wait");
    let mut command = place.command(scene, &["-o", "out", "--no-plots"]);
    let command = command.stdin(Stdio::piped()).stdout(Stdio::piped());
    command.stderr(Stdio::piped()).spawn().unwrap()
}

#[test]
fn a_live_frame_is_tracked_before_the_next_one_comes() {
    let stamps_s: Vec<f64> = (0..EXAMINED + 5).map(|n| 0.04 * n as f64).collect();
    if let Some((place, _)) = track(&stamps_s) {
        assert_eq!(place.rows().len(), stamps_s.len());
    }
}

#[test]
fn ffmpeg_changes_no_time_stamp_of_a_live_source() {
    const FRAMES: usize = EXAMINED + 10;
    let mut stamps_s: Vec<f64> = (0..FRAMES).map(|n| 1.8e9 + 0.04 * n as f64).collect();
    // Two are equal, and the clock is set back by an hour and by 57 years.
    stamps_s[EXAMINED + 1] = stamps_s[EXAMINED];
    stamps_s[EXAMINED + 5] -= 3600.0;
    stamps_s[EXAMINED + 6] -= 3600.0;
    for number in EXAMINED + 7..FRAMES {
        stamps_s[number] = 0.04 * number as f64;
    }
    let Some((place, run)) = track(&stamps_s) else {
        return;
    };
    let text = fs::read(place.path("out/summary.json")).unwrap();
    let summary: Value = serde_json::from_slice(&text).unwrap();
    let camera = &summary["cameras"]["cam1"];
    assert_eq!(camera["reopened"], 0, "{}", run.stderr);
    let frames = &camera["frames"];
    assert_eq!(frames["delivered"], FRAMES, "{camera}");
    assert_eq!(frames["repeated"], 1, "{camera}");
    assert_eq!(frames["dropped_late"], 5, "{camera}");
    assert_eq!(frames["first_time_s"], stamps_s[EXAMINED + 7]);
    let used = (0..EXAMINED + 5).filter(|&number| number != EXAMINED + 1);
    let wanted_s: Vec<f64> = used.map(|number| stamps_s[number]).collect();
    let rows = place.rows();
    let found_s: Vec<f64> = rows.iter().map(|row| row[1].parse().unwrap()).collect();
    assert_eq!(found_s.len(), wanted_s.len(), "{found_s:?}");
    let differ = |(found_s, wanted_s): (&f64, &f64)| (found_s - wanted_s).abs() > 1e-6;
    assert!(!found_s.iter().zip(&wanted_s).any(differ), "{found_s:?}");
}
