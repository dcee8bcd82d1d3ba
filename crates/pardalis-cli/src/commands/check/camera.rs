//! What the cameras of a scene deliver.

use std::fmt::Write as _;

use pardalis::Frame;
use pardalis_scene::CameraConfig;

use crate::numbers::{counted, plain};
use crate::scene::Parts;
use crate::source::{Description, Source};

/// Number of frames that are read from each camera: those of a found target cost other than the first ones, in which it is searched for.
const FRAMES: usize = 11;

/// The most memory of the frames of a camera, in bytes, from its third frame on.
const FRAMES_BYTES: usize = 64 << 20;

/// A camera of which a frame could be read.
pub(super) struct Seen {
    /// Its first frames, one or more.
    pub(super) frames: Vec<Frame>,
    /// The interval between its frames in seconds, if it is known.
    pub(super) interval_s: Option<f64>,
    /// Whether the interval was measured with the first frames.
    is_measured: bool,
    /// The time from the first frame to the last one in seconds, if it is known.
    duration_s: Option<f64>,
    pub(super) is_live: bool,
    source: Description,
    /// Whether the scene states the size for which the camera's model holds.
    stated_size: Option<[f64; 2]>,
    /// Time from the exposure of one row to that of the next, in seconds, as the scene says.
    line_delay_s: f64,
}

/// Reads the first frames of all cameras, and adds the problems with them to those of the scene.
pub(super) fn examine(parts: &mut Parts) -> Vec<Option<Seen>> {
    let mut seen = Vec::new();
    for (camera, source) in parts.scene.cameras.iter().zip(&mut parts.sources) {
        let Some(source) = source else {
            seen.push(None);
            continue;
        };
        match look(camera, source) {
            Ok(look) => seen.push(Some(look)),
            Err(error) => {
                let problem = camera.input.place().problem(format!("{error:#}"));
                parts.assembly.problems.push(problem);
                seen.push(None);
            }
        }
    }
    seen
}

fn look(camera: &CameraConfig, source: &mut Source) -> anyhow::Result<Seen> {
    let span = source.span();
    let stated_s = span.and_then(|span| span.step_s).filter(|&s| s > 0.0);
    let (width, height) = source.size();
    let frame_bytes = source.describe().pixel_format.byte_count(width, height);
    let count = (FRAMES_BYTES / frame_bytes.max(1)).clamp(2, FRAMES);
    let frames = source.first_frames(count)?;
    let mut steps_s: Vec<f64> = frames
        .array_windows()
        .map(|[a, b]| b.time_s() - a.time_s())
        .filter(|&step_s| step_s > 0.0)
        .collect();
    steps_s.sort_by(f64::total_cmp);
    let measured_s = steps_s.get(steps_s.len() / 2).copied();
    Ok(Seen {
        frames,
        interval_s: stated_s.or(measured_s),
        is_measured: stated_s.is_none(),
        duration_s: span.map(|span| span.last_s - span.first_s),
        is_live: source.is_live(),
        source: source.describe().clone(),
        stated_size: camera.size_px.as_ref().map(|size| size.value),
        line_delay_s: camera.line_delay_s,
    })
}

impl Seen {
    /// Returns the number of its frames, if it is recorded and the number known.
    pub(super) fn recorded_frames(&self) -> Option<usize> {
        self.source.frame_count.filter(|_| !self.is_live)
    }

    /// Describes the camera of this name in two lines.
    pub(super) fn text(&self, name: &str) -> String {
        let Description {
            input,
            content,
            size_px: (width, height),
            frame_count,
            ..
        } = &self.source;
        let mut text = format!("cameras.{name}: {input}: {content}\n  {width} x {height} pixels");
        text += match self.stated_size {
            Some(stated) if stated == [width, height].map(|side| *side as f64) => {
                ", as the scene says"
            }
            Some(_) => ", but the scene says otherwise",
            None => "; the scene does not say for which size the model holds (size_px)",
        };
        // Writing to a String cannot fail.
        if let Some(interval_s) = self.interval_s {
            let rate = (100.0 / interval_s).round() / 100.0;
            let about = if self.is_measured { "about " } else { "" };
            let _ = write!(text, "; {about}{rate} frames per second");
        }
        if self.line_delay_s != 0.0 {
            let delay_us = (1e7 * self.line_delay_s).round() / 10.0;
            let _ = write!(text, "; rolling shutter, {} us a row", plain(delay_us));
        }
        if self.is_live {
            return text + "; live";
        }
        let count = frame_count.map(|count| counted(count as u64, "frame"));
        let rounded_s = |s: f64| plain((100.0 * s).round() / 100.0);
        let duration = self.duration_s.map(|s| format!("{} s", rounded_s(s)));
        let length: Vec<_> = [count, duration].into_iter().flatten().collect();
        if length.is_empty() {
            text + "; the number of frames is not known"
        } else {
            format!("{text}; {}", length.join(", "))
        }
    }
}
