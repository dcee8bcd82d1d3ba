//! Video files, streams and camera devices, read with an installed ffmpeg in their own pixel format.

use std::io::Read;
use std::sync::Arc;

use anyhow::{Context, Error, Result};
use pardalis::PixelFormat;
use pardalis::color::{YuvEncoding, YuvMatrix, YuvRange};
use pardalis_core::error::MAX_IMAGE_SIDE_PX;
use pardalis_scene::{FrameRange, VideoInput};

use super::ffmpeg::{Decode, ProbedStream, Process, Programs, name_of};
use super::{Description, Pixels, TimeSpan, TimedBytes};
use crate::user_error::user_error;

/// A picture with at least this number of lines counts as high definition if it does not state its matrix.
const HIGH_DEFINITION_LINES: usize = 720;

/// The frames that are still to be delivered.
pub(super) struct VideoFrames {
    input: String,
    span: Option<TimeSpan>,
    size_px: (usize, usize),
    byte_count: usize,
    /// The frames to deliver.
    range: FrameRange,
    /// Maximum number of frames that are still to be delivered.
    remaining: Option<usize>,
    /// Frames read so far, including skipped ones.
    read: usize,
    decode: Decode,
    ended: bool,
}

impl VideoFrames {
    /// Opens the first video stream of an input of ffmpeg and delivers the frames of
    /// the range.
    pub(super) fn open(
        programs: &Programs,
        video: &VideoInput,
        encoding: Option<YuvEncoding>,
        range: FrameRange,
    ) -> Result<(Description, Self)> {
        let input = name_of(&video.place);
        if range.limit == Some(0) {
            return Err(user_error!("{input}: frame_limit is 0; allowed: 1 or more"));
        }
        let stream = programs.probe(video)?;
        let size_px = upright_size_px(&stream);
        let (width, height) = size_px;
        if width == 0 || height == 0 || width.max(height) > MAX_IMAGE_SIDE_PX {
            return Err(user_error!(
                "{input}: the video is {width} x {height} pixels; allowed: 1 to {MAX_IMAGE_SIDE_PX} a side"
            ));
        }
        let layout = Layout::of(&stream, encoding);
        let decode = programs.decode(video, &layout.filter)?;
        let description = Description {
            input: input.to_owned(),
            content: content(&stream, &layout),
            size_px,
            pixel_format: layout.format,
            encoding: layout.encoding,
            frame_count: stream
                .frame_count(&video.settings)
                .map(|count| range.count_of(count)),
        };
        let frames = Self {
            input: input.to_owned(),
            span: stream.span(&video.settings),
            size_px,
            byte_count: layout.format.byte_count(width, height),
            range,
            remaining: range.limit,
            read: 0,
            decode,
            ended: false,
        };
        Ok((description, frames))
    }

    /// Returns the process, which must be killed to end a wait for a frame.
    pub(super) fn process(&self) -> Arc<Process> {
        Arc::clone(&self.decode.process)
    }

    /// Returns the time span of the frames, if the container states it.
    pub(super) fn span(&self) -> Option<TimeSpan> {
        self.span
    }

    /// Reads one frame; `None` at the regular end.
    fn read_frame(&mut self) -> Result<Option<TimedBytes>> {
        let Ok(stamp) = self.decode.stamps.recv() else {
            return self.end().map(|()| None);
        };
        let mut bytes = vec![0; self.byte_count];
        let (width, height) = self.size_px;
        if stamp.size_px != self.size_px {
            return Err(user_error!(
                "{}: frame {} is {} x {} pixels where those before it are {width} x {height}; \
                 cut the video where its size changes",
                self.input,
                self.read,
                stamp.size_px.0,
                stamp.size_px.1
            ));
        }
        if self.decode.pixels.read_exact(&mut bytes).is_err() {
            self.end()?;
            return Err(self.error_with_messages("ffmpeg ended within a frame", &[]));
        }
        let Some(time_s) = stamp.time_s else {
            return Err(user_error!(
                "{}: frame {} has no time stamp; give input.format and fps, or extract the images into a folder",
                self.input,
                self.read
            ));
        };
        self.read += 1;
        Ok(Some(TimedBytes {
            bytes,
            time_s,
            arrival_s: None,
        }))
    }

    /// Checks why there are no more frames: succeeds at the end of the stream, otherwise fails with ffmpeg's messages.
    fn end(&mut self) -> Result<()> {
        let log = self.decode.log.take().map(std::thread::JoinHandle::join);
        let messages = match log {
            Some(Ok(messages)) => messages,
            Some(Err(panic)) => std::panic::resume_unwind(panic),
            None => Vec::new(),
        };
        let mut surplus = [0];
        if self
            .decode
            .pixels
            .read(&mut surplus)
            .is_ok_and(|count| count > 0)
        {
            return Err(
                self.error_with_messages("ffmpeg wrote more frames than time stamps", &messages)
            );
        }
        let status = self.decode.process.wait().context("waiting for ffmpeg")?;
        if !status.success() {
            return Err(self.error_with_messages(&format!("ffmpeg failed ({status})"), &messages));
        }
        if self.read == 0 {
            return Err(self.error_with_messages("ffmpeg found no frame to decode", &messages));
        }
        if self.read <= self.range.first {
            return Err(user_error!(
                "{}: first_frame is {}, but the video has {} frames; allowed: 0 to {}",
                self.input,
                self.range.first,
                self.read,
                self.read - 1
            ));
        }
        Ok(())
    }

    fn error_with_messages(&self, what: &str, messages: &[String]) -> Error {
        let details = if messages.is_empty() {
            "ffmpeg printed no further messages.".to_owned()
        } else {
            format!("ffmpeg's messages:\n{}", messages.join("\n"))
        };
        user_error!(
            "{}: {what}, after {} frames; check the file or the camera. {details}",
            self.input,
            self.read
        )
    }
}

impl Iterator for VideoFrames {
    type Item = Result<Pixels>;

    fn next(&mut self) -> Option<Self::Item> {
        while !self.ended && self.remaining != Some(0) {
            match self.read_frame() {
                Ok(Some(_)) if !self.range.takes(self.read - 1) => {}
                Ok(Some(frame)) => {
                    self.remaining = self.remaining.map(|remaining| remaining - 1);
                    return Some(Ok(Pixels::Frame(frame)));
                }
                Ok(None) => self.ended = true,
                Err(error) => {
                    self.ended = true;
                    return Some(Err(error));
                }
            }
        }
        None
    }
}

impl Drop for VideoFrames {
    fn drop(&mut self) {
        self.decode.process.kill();
        // Reaps the process; its exit status no longer matters.
        let _ = self.decode.process.wait();
    }
}

/// Returns the size at which ffmpeg delivers the frames, after rotating them upright.
fn upright_size_px(stream: &ProbedStream) -> (usize, usize) {
    if stream.rotation_deg().rem_euclid(180) == 90 {
        (stream.height, stream.width)
    } else {
        (stream.width, stream.height)
    }
}

/// Returns a description of the stream and its conversion.
fn content(stream: &ProbedStream, layout: &Layout) -> String {
    let conversion = if layout.pix_fmt == stream.pix_fmt {
        String::new()
    } else {
        format!(", converted to {}", layout.pix_fmt)
    };
    let turn = match stream.rotation_deg() {
        0 => String::new(),
        degrees => format!(", rotated by {degrees} degrees as the file requests"),
    };
    format!(
        "{} video in {}{conversion}{turn}",
        stream.codec_name, stream.pix_fmt
    )
}

/// The pixel format of the frames, and ffmpeg's conversion to it.
#[derive(Debug, PartialEq)]
struct Layout {
    format: PixelFormat,
    /// The same as ffmpeg's name.
    pix_fmt: String,
    /// `None` for RGB.
    encoding: Option<YuvEncoding>,
    /// ffmpeg's filters.
    filter: String,
}

impl Layout {
    /// Chooses the stream's own format if it is supported, otherwise the nearest one.
    fn of(stream: &ProbedStream, given: Option<YuvEncoding>) -> Self {
        let encoding = given.or_else(|| encoding_of(stream));
        let source = stream.pix_fmt.as_str();
        let (format, pix_fmt) = nearest_format(source);
        // Packed chroma cannot be rotated, and RGB replaces unsupported matrices.
        let packed = matches!(format, PixelFormat::Yuyv | PixelFormat::Uyvy);
        let (format, pix_fmt) = if (packed && stream.rotation_deg() != 0) || encoding.is_none() {
            (PixelFormat::Rgb8, "rgb24")
        } else {
            (format, pix_fmt)
        };
        let is_rgb = format == PixelFormat::Rgb8;
        let filter = if pix_fmt == source {
            format!("format={pix_fmt}")
        } else if !is_rgb {
            // Naming the same range on both sides keeps ffmpeg from rescaling the values.
            format!("scale=in_range=full:out_range=full,format={pix_fmt}")
        } else {
            let exact = "flags=accurate_rnd+full_chroma_int+full_chroma_inp";
            match encoding.filter(|_| source.contains("yuv")) {
                Some(YuvEncoding { matrix, range }) => format!(
                    "scale={exact}:in_color_matrix={}:in_range={},format=rgb24",
                    match matrix {
                        YuvMatrix::Bt601 => "bt601",
                        YuvMatrix::Bt709 => "bt709",
                    },
                    match range {
                        YuvRange::Full => "full",
                        YuvRange::Limited => "limited",
                    }
                ),
                None => format!("scale={exact},format=rgb24"),
            }
        };
        Self {
            format,
            pix_fmt: pix_fmt.to_owned(),
            encoding: encoding.filter(|_| !is_rgb),
            filter,
        }
    }
}

/// Returns the supported format that loses least, from ffmpeg's name.
fn nearest_format(pix_fmt: &str) -> (PixelFormat, &str) {
    match pix_fmt {
        "yuv420p" | "yuvj420p" => (PixelFormat::I420, pix_fmt),
        "nv12" => (PixelFormat::Nv12, pix_fmt),
        "yuyv422" => (PixelFormat::Yuyv, pix_fmt),
        "uyvy422" => (PixelFormat::Uyvy, pix_fmt),
        "nv21" => (PixelFormat::Nv12, "nv12"),
        "yvyu422" | "nv16" => (PixelFormat::Yuyv, "yuyv422"),
        // With alpha or more bits.
        _ if ["yuv420p", "yuva420p", "p01"]
            .iter()
            .any(|p| pix_fmt.starts_with(p)) =>
        {
            (PixelFormat::I420, "yuv420p")
        }
        _ if ["yuv422p", "yuvj422p", "yuva422p"]
            .iter()
            .any(|p| pix_fmt.starts_with(p)) =>
        {
            (PixelFormat::Yuyv, "yuyv422")
        }
        _ => (PixelFormat::Rgb8, "rgb24"),
    }
}

/// Returns the YUV encoding that the stream states, or the usual one if it states none; `None` if the matrix is not
/// supported.
fn encoding_of(stream: &ProbedStream) -> Option<YuvEncoding> {
    let matrix = match stream.color_space.as_str() {
        "bt709" => YuvMatrix::Bt709,
        "bt470bg" | "smpte170m" => YuvMatrix::Bt601,
        "" | "unknown" | "gbr" | "reserved" => {
            if stream.height < HIGH_DEFINITION_LINES {
                YuvMatrix::Bt601
            } else {
                YuvMatrix::Bt709
            }
        }
        _ => return None,
    };
    let range = match stream.color_range.as_str() {
        "pc" => YuvRange::Full,
        _ if stream.pix_fmt.starts_with("yuvj") => YuvRange::Full,
        _ => YuvRange::Limited,
    };
    Some(YuvEncoding { matrix, range })
}

#[cfg(test)]
#[path = "video_tests.rs"]
mod tests;
