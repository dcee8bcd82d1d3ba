//! Tests of videos with the installed ffmpeg.

mod formats;
mod inputs;
#[cfg(unix)]
mod stand_ins;
mod times;

use std::process::Command;

use tempfile::TempDir;

use super::*;
use crate::source::{Counters, Delivery, Source, SourceConfig, SourceKind};
use pardalis::Frame;
use pardalis_scene::{FrameRange, VideoPlace, VideoSettings};

/// Returns the installed programs; prints a note and returns `None` if these tests cannot run.
fn programs() -> Option<Programs> {
    let found = Programs::find(&std::env::var_os("PATH").unwrap_or_default()).ok();
    if found.is_none() {
        println!("skipped: ffmpeg is not installed");
    }
    found
}

/// Runs ffmpeg, which must succeed, and returns its standard output.
fn ffmpeg(arguments: &[&str]) -> Vec<u8> {
    let output = Command::new("ffmpeg")
        .args(["-loglevel", "error", "-nostdin", "-y"])
        .args(arguments)
        .output()
        .expect("ffmpeg runs");
    assert!(
        output.status.success(),
        "{arguments:?}: {}",
        String::from_utf8_lossy(&output.stderr)
    );
    output.stdout
}

/// A moving test picture of ffmpeg.
const PICTURE: &str = "testsrc2=size=640x480:rate=25";

fn path_in(folder: &TempDir, name: &str) -> String {
    folder.path().join(name).to_string_lossy().into_owned()
}

/// Creates a clip of six frames with these arguments.
fn clip(folder: &TempDir, name: &str, arguments: &[&str]) -> String {
    let path = path_in(folder, name);
    let input = ["-f", "lavfi", "-i", PICTURE, "-frames:v", "6"];
    ffmpeg(&[&input, arguments, &[path.as_str()]].concat());
    path
}

fn config(input: &str) -> SourceConfig {
    SourceConfig {
        kind: SourceKind::Video {
            video: VideoInput::of_path(input),
            encoding: None,
        },
        time_offset_s: 0.0,
        frames: FrameRange::ALL,
    }
}

/// A file that is opened with these settings.
fn opened(path: &str, settings: VideoSettings) -> SourceConfig {
    SourceConfig {
        kind: SourceKind::Video {
            video: VideoInput {
                place: VideoPlace::File(path.to_owned()),
                settings,
            },
            encoding: None,
        },
        ..config(path)
    }
}

/// Unwraps a frame; a video has no broken images that could be skipped.
fn frame_of(delivery: Delivery) -> Frame {
    match delivery {
        Delivery::Frame { frame, .. } => frame,
        Delivery::Broken(why) => panic!("{why}"),
    }
}

/// Reads the whole source: its description, all time stamps, all bytes and the statistics. Every frame must be valid.
fn read(config: &SourceConfig) -> (Description, Vec<f64>, Vec<u8>, Counters) {
    let mut source = Source::open(config).expect("opens");
    let (mut times, mut bytes) = (Vec::new(), Vec::new());
    for frame in source.by_ref() {
        let frame = frame_of(frame.expect("a frame"));
        times.push(frame.time_s());
        bytes.extend_from_slice(frame.bytes());
    }
    (source.describe().clone(), times, bytes, source.counters())
}

/// Returns the error of opening a source.
fn error_of(config: &SourceConfig) -> String {
    match Source::open(config) {
        Ok(source) => panic!("opens: {:?}", source.describe()),
        Err(error) => error.to_string(),
    }
}
