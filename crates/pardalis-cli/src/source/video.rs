//! Video files, streams and camera devices, read with an installed ffmpeg in their own pixel format.

use std::io::ErrorKind;
use std::sync::Arc;
use std::time::Duration;

use anyhow::{Error, Result};
use pardalis::PixelFormat;
use pardalis::color::{YuvEncoding, YuvMatrix, YuvRange};
use pardalis_core::error::MAX_IMAGE_SIDE_PX;
use pardalis_images::MAX_PIXELS;
use pardalis_scene::{FrameRange, VideoInput};

use super::ffmpeg::{Decode, Programs, is_deinterlaced, is_file, name_of, without_stamps};
use super::live::{self, Again, quoted, timeout};
use super::probed::ProbedStream;
use super::running::{Running, Watchdog};
use super::{Description, Pixels, TimeSpan, TimedBytes};
use crate::interrupt::Stop;
use crate::user_error::{SingleImages, user_error};

/// Formats without time stamps that ffmpeg recognises, and for which it assumes a frame rate.
const RAW_FORMATS: [&str; 3] = ["h264", "hevc", "mjpeg"];

/// A picture with at least this number of lines counts as high definition if it does not state its matrix.
const HIGH_DEFINITION_LINES: usize = 720;

/// The frames that are still to be delivered.
pub(super) struct VideoFrames {
    input: String,
    span: Option<TimeSpan>,
    size_px: (usize, usize),
    byte_count: usize,
    /// Whether ffmpeg delivers planar 4:2:2, which is packed here.
    is_planar: bool,
    /// The frames to deliver.
    range: FrameRange,
    /// Maximum number of frames that are still to be delivered.
    remaining: Option<usize>,
    /// Frames read so far, including skipped ones.
    read: usize,
    decode: Decode,
    running: Arc<Running>,
    /// How the source is opened again when it fails.
    again: Option<Again>,
    /// Ends a source that falls silent, if it can be opened again.
    watchdog: Option<Watchdog>,
    /// The format of the frames, which a source that is opened again must have as well.
    format: (PixelFormat, Option<YuvEncoding>),
    given_encoding: Option<YuvEncoding>,
    warning: Option<String>,
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
        stop: &Stop,
    ) -> Result<(Description, Self)> {
        let input = &*name_of(&video.place);
        if range.limit == Some(0) {
            return Err(user_error!("{input}: frame_limit is 0; allowed: 1 or more"));
        }
        let (stream, layout, size_px, decode) = if is_file(&video.place) {
            let stream = programs.probe(video)?;
            let size_px = upright_size_px(&stream);
            check_size(input, size_px)?;
            let layout = Layout::of(&stream, encoding);
            let decode = programs.decode(video, &stream, &layout.filter)?;
            (stream, layout, size_px, decode)
        } else {
            let (decode, stream, size_px) = live::open(programs, video, stop)?;
            check_size(input, size_px)?;
            if stream.format_name == "mpjpeg" && video.settings.format.is_none() {
                return Err(SingleImages(input.to_owned()).into());
            }
            let layout = Layout::of_live(input, &stream, encoding)?;
            (stream, layout, size_px, decode)
        };
        if video.settings.format.is_none() && RAW_FORMATS.contains(&&*stream.format_name) {
            return Err(without_stamps(input, &stream.format_name));
        }
        let (width, height) = size_px;
        let description = Description {
            input: input.to_owned(),
            content: content(&stream, &layout, is_deinterlaced(video, &stream)),
            size_px,
            pixel_format: layout.format,
            encoding: layout.encoding,
            frame_count: stream
                .frame_count(&video.settings)
                .map(|count| range.count_of(count)),
        };
        let is_undecided = stream.is_interlaced() && video.settings.deinterlace.is_none();
        let warning = (is_undecided && !is_file(&video.place)).then(|| {
            format!(
                "{input}: is marked as interlaced; set input.deinterlace = true in the table of this camera, or false to keep the frames as they are"
            )
        });
        let running = Arc::new(Running::new(Arc::clone(&decode.process)));
        if !is_file(&video.place) {
            running.joined();
        }
        let again = Again::of(programs, video);
        let watchdog = again
            .as_ref()
            .map(|_| Watchdog::start(Arc::clone(&running), timeout(video)))
            .transpose()?;
        let frames = Self {
            input: input.to_owned(),
            span: stream.span(&video.settings),
            size_px,
            byte_count: layout.format.byte_count(width, height),
            is_planar: layout.is_planar,
            range,
            remaining: range.limit,
            read: 0,
            decode,
            running,
            again,
            watchdog,
            format: (layout.format, layout.encoding),
            given_encoding: encoding,
            warning,
            ended: false,
        };
        Ok((description, frames))
    }

    /// Returns what must be stopped to end a wait for a frame.
    pub(super) fn process(&self) -> Arc<Running> {
        Arc::clone(&self.running)
    }

    /// Returns what the user should know of a source that opens nevertheless.
    pub(super) fn warning(&self) -> Option<&str> {
        self.warning.as_deref()
    }

    /// Returns the time span of the frames, if the container states it.
    pub(super) fn span(&self) -> Option<TimeSpan> {
        self.span
    }

    /// Opens a live source again that has ended, with an error or without. Reports whether there may be further frames;
    /// fails if it did not come back.
    fn comes_back(&mut self, why: Option<Error>) -> Result<bool> {
        let Some(again) = &mut self.again else {
            return why.map_or(Ok(false), Err);
        };
        if self.running.is_stopped_after(Duration::ZERO) {
            return Ok(false);
        }
        let check = |stream: &ProbedStream, size_px: (usize, usize)| {
            let layout = Layout::of_live(&self.input, stream, self.given_encoding)?;
            if size_px == self.size_px && (layout.format, layout.encoding) == self.format {
                return Ok(());
            }
            let (width, height) = self.size_px;
            Err(user_error!(
                "{}: came back with {} x {} pixels in {}, and not with {width} x {height} pixels in the format that it \
                 had; start again",
                self.input,
                size_px.0,
                size_px.1,
                layout.pix_fmt
            ))
        };
        self.decode = again.open(&self.running, why, check)?;
        Ok(true)
    }

    /// Reads one frame; `None` at the regular end. Those that are to be left out are counted.
    fn read_frame(&mut self) -> Result<Option<TimedBytes>> {
        while let Some((bytes, stamp_s)) = self.read_stamped()? {
            let time_s = match &mut self.again {
                Some(again) => again.time_s(&self.running, stamp_s),
                None => Some(stamp_s),
            };
            if let Some(time_s) = time_s {
                return Ok(Some(TimedBytes {
                    bytes,
                    time_s,
                    arrival_s: None,
                }));
            }
            self.running.count_left_out();
        }
        Ok(None)
    }

    /// Reads the bytes of a frame and its time stamp in seconds; `None` at the regular end.
    fn read_stamped(&mut self) -> Result<Option<(Vec<u8>, f64)>> {
        self.running.set_waiting(true);
        let next = self.decode.frames.next();
        self.running.set_waiting(false);
        let (time_s, byte_count) = match next {
            Ok(Some(next)) => next,
            Ok(None) => return self.end().map(|()| None),
            Err(error) => return Err(self.broken(&error)),
        };
        let (width, height) = self.size_px;
        let wanted = if self.is_planar {
            planar_byte_count(self.size_px)
        } else {
            self.byte_count
        };
        // The header precedes all frames; frames of later sizes differ in their number of bytes.
        let is_stated =
            matches!(self.decode.frames.size_px(), Ok(Some(size)) if size == self.size_px);
        if byte_count != wanted || !is_stated {
            return Err(user_error!(
                "{}: frame {} is not {width} x {height} pixels large, as announced; \
                 cut the video where its size changes",
                self.input,
                self.read
            ));
        }
        let Some(time_s) = time_s else {
            return Err(user_error!(
                "{}: frame {} has no time stamp; give input.format and fps, or extract the images into a folder",
                self.input,
                self.read
            ));
        };
        let mut bytes = vec![0; byte_count];
        if let Err(error) = self.decode.frames.read(&mut bytes) {
            return Err(self.broken(&error));
        }
        if self.is_planar {
            bytes = packed(&bytes, self.size_px);
        }
        self.read += 1;
        Ok(Some((bytes, time_s)))
    }

    /// Returns why a frame cannot be read.
    fn broken(&mut self, error: &std::io::Error) -> Error {
        if error.kind() == ErrorKind::UnexpectedEof {
            let ended = self.end().err();
            ended.unwrap_or_else(|| self.error_with_messages("ffmpeg ended within a frame", &[]))
        } else {
            self.decode.process.kill();
            let what = format!("what ffmpeg wrote cannot be read ({error})");
            self.error_with_messages(&what, &[])
        }
    }

    /// Checks why there are no more frames: succeeds at the end of the stream, otherwise fails with ffmpeg's messages.
    fn end(&mut self) -> Result<()> {
        let (status, messages) = self.decode.end()?;
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
        user_error!(
            "{}: {what}, after {} frames; check the file or the camera. {}",
            self.input,
            self.read,
            quoted(messages)
        )
    }
}

/// Fails if images of this size cannot be tracked.
pub(super) fn check_size(input: &str, (width, height): (usize, usize)) -> Result<()> {
    // ffmpeg reports no size for videos that are larger than it may decode.
    if width == 0 || height == 0 {
        return Err(user_error!(
            "{input}: its video states no size, or more than {MAX_PIXELS} pixels; scale it down, or give another file"
        ));
    }
    if width.max(height) > MAX_IMAGE_SIDE_PX {
        return Err(user_error!(
            "{input}: the video is {width} x {height} pixels; allowed: 1 to {MAX_IMAGE_SIDE_PX} a side"
        ));
    }
    if width * height > MAX_PIXELS {
        return Err(user_error!(
            "{input}: the video is {width} x {height} pixels; allowed: at most {MAX_PIXELS} in all; scale it down"
        ));
    }
    Ok(())
}

impl Iterator for VideoFrames {
    type Item = Result<Pixels>;

    fn next(&mut self) -> Option<Self::Item> {
        while !self.ended && self.remaining != Some(0) {
            let comes_back = match self.read_frame() {
                Ok(Some(_)) if !self.range.takes(self.read - 1) => Ok(true),
                Ok(Some(frame)) => {
                    self.remaining = self.remaining.map(|remaining| remaining - 1);
                    return Some(Ok(Pixels::Frame(frame)));
                }
                Ok(None) => self.comes_back(None),
                Err(error) => self.comes_back(Some(error)),
            };
            match comes_back {
                Ok(comes_back) => self.ended = !comes_back,
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
        self.running.stop();
        // It ends because the source is stopped.
        drop(self.watchdog.take());
    }
}

/// Returns the size at which ffmpeg delivers the frames, after rotating them upright.
pub(super) fn upright_size_px(stream: &ProbedStream) -> (usize, usize) {
    if stream.rotation_deg().rem_euclid(180) == 90 {
        (stream.height, stream.width)
    } else {
        (stream.width, stream.height)
    }
}

/// Returns a description of the stream and its conversion.
pub(super) fn content(stream: &ProbedStream, layout: &Layout, is_deinterlaced: bool) -> String {
    let conversion = if layout.pix_fmt == stream.pix_fmt {
        String::new()
    } else {
        format!(", converted to {}", layout.pix_fmt)
    };
    let turn = match stream.rotation_deg() {
        0 => String::new(),
        degrees => format!(", rotated by {degrees} degrees as the file requests"),
    };
    let fields = if is_deinterlaced {
        ", deinterlaced"
    } else {
        ""
    };
    format!(
        "{} video in {}{conversion}{turn}{fields}",
        stream.codec_name, stream.pix_fmt
    )
}

/// The pixel format of the frames, and ffmpeg's conversion to it.
#[derive(Debug, PartialEq)]
pub(super) struct Layout {
    format: PixelFormat,
    /// The same as ffmpeg's name.
    pix_fmt: String,
    /// `None` for RGB.
    encoding: Option<YuvEncoding>,
    /// Whether the frames are planar 4:2:2 before they are packed.
    is_planar: bool,
    /// ffmpeg's filters.
    filter: String,
}

impl Layout {
    /// Chooses the stream's own format if it is supported, otherwise the nearest one.
    pub(super) fn of(stream: &ProbedStream, given: Option<YuvEncoding>) -> Self {
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
            is_planar: false,
            filter,
        }
    }

    /// Returns the layout of a stream whose format ffmpeg has chosen.
    pub(super) fn of_live(
        input: &str,
        stream: &ProbedStream,
        given: Option<YuvEncoding>,
    ) -> Result<Self> {
        let (format, pix_fmt) = nearest_format(&stream.pix_fmt);
        let encoding = given.or_else(|| encoding_of(stream));
        let encoding = match format {
            PixelFormat::Rgb8 => None,
            _ => Some(encoding.ok_or_else(|| {
                user_error!(
                    "{input}: its colours are encoded as {}, which is not supported; state the nearest with yuv",
                    stream.color_space
                )
            })?),
        };
        Ok(Self {
            format,
            pix_fmt: pix_fmt.to_owned(),
            encoding,
            is_planar: stream.pix_fmt.contains("422p"),
            filter: String::new(),
        })
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

/// Returns the number of bytes of a planar 4:2:2 image.
fn planar_byte_count((width, height): (usize, usize)) -> usize {
    (width + 2 * width.div_ceil(2)) * height
}

/// Packs a planar 4:2:2 image as YUYV.
fn packed(planes: &[u8], (width, height): (usize, usize)) -> Vec<u8> {
    let half = width.div_ceil(2);
    let (luma, chroma) = planes.split_at(width * height);
    let (u, v) = chroma.split_at(half * height);
    let mut bytes = Vec::with_capacity(4 * half * height);
    for (i, (u, v)) in u.iter().zip(v).enumerate() {
        let (row, left) = (i / half * width, i % half * 2);
        let right = (left + 1).min(width - 1);
        bytes.extend([luma[row + left], *u, luma[row + right], *v]);
    }
    bytes
}

#[cfg(test)]
#[path = "video_tests/mod.rs"]
mod tests;
