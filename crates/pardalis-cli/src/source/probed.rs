//! What ffprobe, or ffmpeg's own report, says of a video stream.

use anyhow::{Context, Result};
use pardalis_scene::VideoSettings;
use serde::Deserialize;

use super::TimeSpan;
use crate::user_error::user_error;

/// Parses the first stream in ffprobe's output. Errors name `input`.
pub(super) fn probed_in(input: &str, output: &[u8]) -> Result<ProbedStream> {
    let probed: Probed = serde_json::from_slice(output)
        .with_context(|| format!("{input}: ffprobe's output cannot be parsed"))?;
    let stream = probed.streams.into_iter().next().ok_or_else(|| {
        user_error!("{input}: there is no video stream in it; give a file or device with video")
    })?;
    Ok(ProbedStream {
        format_name: probed.format.format_name,
        ..stream
    })
}

#[derive(Deserialize)]
struct Probed {
    #[serde(default)]
    streams: Vec<ProbedStream>,
    #[serde(default)]
    format: ProbedFormat,
}

#[derive(Default, Deserialize)]
#[serde(default)]
struct ProbedFormat {
    format_name: String,
}

/// ffprobe's description of a video stream, with its own field names.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(default)]
pub(super) struct ProbedStream {
    /// ffmpeg's name of the format, or several names, separated by commas.
    pub(super) format_name: String,
    pub(super) codec_name: String,
    /// Width in pixels before any rotation.
    pub(super) width: usize,
    pub(super) height: usize,
    pub(super) pix_fmt: String,
    pub(super) color_space: String,
    pub(super) color_range: String,
    /// The order of the fields; `tt`, `bb`, `tb` or `bt` if the video is interlaced.
    pub(super) field_order: String,
    /// A number as text; empty if the container does not state it.
    pub(super) nb_frames: String,
    /// A fraction of a second as text.
    pub(super) time_base: String,
    /// Seconds as text, like the next field; empty if the container does not state it.
    pub(super) start_time: String,
    pub(super) duration: String,
    /// A fraction as text.
    pub(super) avg_frame_rate: String,
    pub(super) side_data_list: Vec<SideData>,
}

#[derive(Debug, Clone, Default, Deserialize)]
#[serde(default)]
pub(super) struct SideData {
    rotation: f64,
}

impl ProbedStream {
    /// Returns the angle in degrees by which ffmpeg rotates the frames, as the file requests.
    pub(super) fn rotation_deg(&self) -> i64 {
        self.side_data_list
            .iter()
            .map(|data| data.rotation.round() as i64)
            .find(|&rotation| rotation != 0)
            .unwrap_or(0)
    }

    /// Reports whether its frames consist of two fields that were taken one after the other.
    pub(super) fn is_interlaced(&self) -> bool {
        ["tt", "bb", "tb", "bt"].contains(&&*self.field_order)
    }

    /// Returns the time span of the frames that are read, if the container states it.
    pub(super) fn span(&self, settings: &VideoSettings) -> Option<TimeSpan> {
        let start_s = settings.start_s.unwrap_or(0.0);
        let first_s = self.start_time.parse::<f64>().ok()? + start_s;
        let left_s = self.duration.parse::<f64>().ok()? - start_s;
        let duration_s = left_s
            .min(settings.duration_s.unwrap_or(f64::INFINITY))
            .max(0.0);
        let (frames, seconds) = self.avg_frame_rate.split_once('/')?;
        let step_s = seconds.parse::<f64>().ok()? / frames.parse::<f64>().ok()?;
        let is_step = step_s.is_finite() && step_s > 0.0;
        let is_sound = first_s.is_finite() && duration_s.is_finite() && is_step;
        is_sound.then_some(TimeSpan {
            first_s,
            last_s: first_s + duration_s,
            step_s: Some(step_s),
        })
    }

    /// Returns the number of frames that are read, if the container states it.
    pub(super) fn frame_count(&self, settings: &VideoSettings) -> Option<usize> {
        let is_whole = settings.start_s.is_none() && settings.duration_s.is_none();
        is_whole.then(|| self.nb_frames.parse().ok())?
    }
}
