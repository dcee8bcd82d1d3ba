//! Frames of a topic of an MCAP recording.

use std::path::Path;

use anyhow::Result;
use pardalis_scene::FrameRange;

use super::{Description, Pixels, TimeSpan, TimedBytes};
use crate::mcap::{Images, is_cut_off};

/// Opens the images of a topic, or of the only one with images. Returns them with their description and their time span, if they are known.
pub(super) fn open(
    file: &Path,
    topic: Option<&str>,
    range: FrameRange,
) -> Result<(
    Description,
    Option<TimeSpan>,
    impl Iterator<Item = Result<Pixels>> + Send + use<>,
)> {
    let images = Images::open(file, topic, range)?;
    let (size_px, pixel_format) = images.format();
    let description = Description {
        input: images.name(),
        content: "images of a recording".to_owned(),
        size_px,
        pixel_format,
        encoding: None,
        frame_count: images.frame_count(),
    };
    let span = images.span_s().map(|(first_s, last_s)| {
        let steps = images.frame_count().unwrap_or(0).saturating_sub(1);
        TimeSpan {
            first_s,
            last_s: last_s.max(first_s),
            step_s: (steps > 0).then(|| (last_s - first_s) / steps as f64),
        }
    });
    let frames = images.map(|image| {
        Ok(match image? {
            Ok(image) => Pixels::Frame(TimedBytes {
                bytes: image.bytes,
                time_s: image.time_s,
                arrival_s: Some(image.arrival_s),
            }),
            Err(error) => Pixels::Broken(error),
        })
    });
    Ok((description, span, frames))
}

/// Returns what the user should know although the recording opens.
pub(super) fn warning(file: &Path) -> Option<String> {
    is_cut_off(file).then(|| {
        "the recording is cut off: it has no end, or is still being written; its images up to there are used (`mcap recover` repairs it)"
            .to_owned()
    })
}
