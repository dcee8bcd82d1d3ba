//! The readers of files that other people and programs write, each with what must hold for any bytes, for fuzzing.
//!
//! The same checks serve `fuzz/run`, which is guided by coverage, and the tests below, which the gate runs.

mod calibrations;
mod images;
mod memory;
#[cfg(test)]
mod mutation;
#[cfg(feature = "mcap")]
mod recordings;
mod scenes;
mod tables;
#[cfg(test)]
mod tests;

use std::path::Path;

use pardalis_scene::Problem;

use crate::fuzzed_file::{FILE, check_error, check_message};
use crate::source::fuzzing as source;

/// A reader of files.
#[derive(Debug)]
pub struct Reader {
    /// Its name in `fuzz/samples.txt`, and in the arguments of `fuzz/run`.
    pub name: &'static str,
    /// Reads any bytes, and reports whether they were accepted.
    check: fn(&[u8]) -> bool,
}

/// Memory that a reader may take for a file without bytes, and for each byte of it, in bytes.
const MOST_BYTES: [usize; 2] = [16 << 20, 256];

impl Reader {
    /// Reads any bytes, and reports whether they were accepted. Panics if an invariant is violated: what is accepted keeps the
    /// promises of its type, and can be written and read again; an error names the file, the line or the key; and memory
    /// grows no more than with the length of the file.
    pub fn check(&self, bytes: &[u8]) -> bool {
        let (accepted, peak) = memory::peak_of(|| (self.check)(bytes));
        let most = MOST_BYTES[0] + MOST_BYTES[1] * bytes.len();
        assert!(peak <= most, "{peak} bytes; allowed: {most}");
        accepted
    }
}

/// All readers.
pub const READERS: &[Reader] = {
    const fn reader(name: &'static str, check: fn(&[u8]) -> bool) -> Reader {
        Reader { name, check }
    }
    &[
        reader("scene", scenes::scene),
        reader("world", scenes::world),
        reader("experiment", scenes::experiment),
        reader("colors", scenes::colors),
        reader("board", scenes::board),
        reader("summary", scenes::summary),
        // One reader for each format, though each takes the files of all: they differ in what they call.
        reader("calibration-pardalis", calibrations::calibration),
        reader("calibration-opencv", calibrations::ambiguous),
        reader("calibration-ros", calibrations::ambiguous),
        reader("calibration-kalibr", calibrations::calibration),
        reader("calibration-ocamcalib", calibrations::calibration),
        reader("calibration-basalt", calibrations::calibration),
        reader("calibration-sequence", calibrations::sequence),
        reader("tracks", tables::tracks),
        reader("truth", tables::truth),
        reader("circles", tables::circles),
        reader("points", tables::points),
        reader("starts", tables::starts),
        reader("poses", tables::poses),
        reader("odometry", tables::odometry),
        reader("pose-datagrams", tables::pose_datagram),
        reader("measurements", tables::measurements),
        reader("camera-poses", tables::camera_poses),
        reader("detections", tables::detections),
        reader("detections-coco", tables::detections_coco),
        reader("times", source::times),
        reader("png", images::png),
        reader("jpeg", images::jpeg),
        reader("exif", images::exif),
        reader("nut", source::nut),
        reader("ffprobe", source::ffprobe),
        reader("ffmpeg-messages", source::messages),
        reader("device-formats", tables::device_formats),
        #[cfg(feature = "mcap")]
        reader("mcap", recordings::mcap),
    ]
};

/// Returns the bytes as text, if they are UTF-8.
fn text_of(bytes: &[u8]) -> Option<String> {
    match crate::scene_files::text_in(Path::new(FILE), bytes.to_vec()) {
        Ok(text) => Some(text),
        Err(error) => {
            check_error(&error);
            None
        }
    }
}

/// Checks that problems are in lines of the text.
fn check_problems(problems: &[Problem], text: &str) {
    assert!(!problems.is_empty());
    let lines = 1..=text.matches('\n').count() + 1;
    for problem in problems {
        assert!(lines.contains(&problem.line), "no such line: {problem}");
        check_message(&problem.to_string());
    }
    assert!(problems.is_sorted_by_key(|problem| problem.line));
}

/// Checks that all numbers in a table are finite.
fn check_finite(value: &toml::Value) {
    match value {
        toml::Value::Float(number) => assert!(number.is_finite(), "{number}"),
        toml::Value::Array(values) => values.iter().for_each(check_finite),
        toml::Value::Table(table) => table.values().for_each(check_finite),
        _ => {}
    }
}
