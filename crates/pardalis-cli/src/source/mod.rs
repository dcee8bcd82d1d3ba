//! Where frames come from: a folder of images, or whatever an installed ffmpeg opens.

pub(crate) mod decode;
mod ffmpeg;
mod images;
mod times;
mod video;

use std::path::PathBuf;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, sync_channel};
use std::thread::JoinHandle;

use anyhow::Result;
use pardalis::color::YuvEncoding;
use pardalis::{Frame, PixelFormat};
use serde::Serialize;

use crate::fault::fault;
use crate::timing::Stopwatch;
use ffmpeg::{Process, Programs};
use images::ImageFrames;
use video::VideoFrames;

/// How many frames are decoded ahead of the one that is worked on.
const FRAMES_AHEAD: usize = 3;

/// What a camera's frames are read from.
#[derive(Debug, Clone)]
pub(crate) struct SourceConfig {
    /// The files or the device.
    pub(crate) kind: SourceKind,
    /// Added to every time stamp, in seconds.
    pub(crate) time_offset_s: f64,
    /// How many frames of the source are left out at its beginning.
    pub(crate) first_frame: usize,
    /// How many frames are read at most after those.
    pub(crate) frame_limit: Option<usize>,
}

/// The files or the device.
#[derive(Debug, Clone)]
pub(crate) enum SourceKind {
    /// JPEG and PNG images of one size.
    Images {
        /// The folder that holds them, and `times.csv`.
        folder: PathBuf,
        /// When they were taken.
        timing: Timing,
    },
    /// A video file, stream or camera device, by way of an installed ffmpeg.
    Video {
        /// As after ffmpeg's `-i`.
        input: String,
        /// ffmpeg's options before `-i`, such as `-f v4l2`.
        input_options: Vec<String>,
        /// What the numbers of YUV pixels mean, where the stream does not say or errs.
        encoding: Option<YuvEncoding>,
    },
}

/// When the images of a folder were taken.
#[derive(Debug, Clone)]
pub(crate) enum Timing {
    /// At a constant rate, in frames per second.
    Fps(f64),
    /// As `times.csv` beside the images says.
    TimesFile,
}

/// What a source delivers, for checks and summaries.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(crate) struct Description {
    /// The folder, file or device, as given.
    pub(crate) input: String,
    /// What is in it: number and names of images, or a video's codec and pixel format.
    pub(crate) content: String,
    /// Width and height of every frame in pixels.
    pub(crate) size_px: (usize, usize),
    /// How the pixels of the frames are laid out.
    pub(crate) pixel_format: PixelFormat,
    /// What the numbers of YUV pixels mean; none for RGB.
    pub(crate) encoding: Option<YuvEncoding>,
    /// How many frames there will be, where that is known.
    pub(crate) frame_count: Option<usize>,
}

/// What happened so far. Complete once the source has ended.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub(crate) struct Counters {
    /// Frames delivered.
    pub(crate) frames: usize,
    /// Frames with the same time stamp as the one before them.
    pub(crate) repeated_times: usize,
    /// Frames dropped because their time stamps run backwards.
    pub(crate) dropped_late: usize,
    /// Errors that ffmpeg reported while it went on: frames may be damaged.
    pub(crate) ffmpeg_errors: usize,
    /// Time spent decoding, beside tracking, in seconds. For videos: waiting for ffmpeg.
    pub(crate) decode_s: f64,
}

/// The pixels of one frame and its time stamp in the source, in seconds.
struct TimedBytes {
    bytes: Vec<u8>,
    time_s: f64,
}

/// A frame, or why there is none, and the time in seconds that it took.
type Decoded = (Result<Frame>, f64);

/// The frames of one camera in the order of their time stamps, decoded ahead on a thread of their own.
///
/// After an error there are no more frames.
pub(crate) struct Source {
    description: Description,
    counters: Counters,
    last_time_s: f64,
    /// A frame that was fetched to know its time.
    peeked: Option<Result<Frame>>,
    /// Nothing once the thread has ended.
    decoding: Option<(Receiver<Decoded>, JoinHandle<()>)>,
    process: Option<Arc<Process>>,
}

impl Source {
    /// Opens the source and starts to decode.
    ///
    /// Faults: whatever can be seen to be wrong before the first frame is decoded.
    pub(crate) fn open(config: &SourceConfig) -> Result<Self> {
        let (first, limit) = (config.first_frame, config.frame_limit);
        match &config.kind {
            SourceKind::Images { folder, timing } => {
                let frames = ImageFrames::open(folder, timing, first, limit)?;
                let input = folder.display().to_string();
                Ok(Self::of_images(input, frames, config.time_offset_s))
            }
            SourceKind::Video {
                input,
                input_options,
                encoding,
            } => {
                let search_path = std::env::var_os("PATH").unwrap_or_default();
                let programs =
                    Programs::find(&search_path).map_err(|error| fault!("{input}: {error}"))?;
                let (description, frames) =
                    VideoFrames::open(&programs, input, input_options, *encoding, first, limit)?;
                let process = Some(frames.process());
                Ok(Self::start(
                    description,
                    config.time_offset_s,
                    frames,
                    process,
                ))
            }
        }
    }

    /// One or more JPEG and PNG images of one size that have nothing to do with one another; their times are a second apart.
    pub(crate) fn stills(files: &[PathBuf]) -> Result<Self> {
        let input = "images of the command line".to_owned();
        Ok(Self::of_images(input, ImageFrames::stills(files)?, 0.0))
    }

    fn of_images(input: String, frames: ImageFrames, time_offset_s: f64) -> Self {
        let description = Description {
            input,
            content: frames.content(),
            size_px: frames.size_px(),
            pixel_format: PixelFormat::Rgb8,
            encoding: None,
            frame_count: Some(frames.frame_count()),
        };
        Self::start(description, time_offset_s, frames, None)
    }

    fn start(
        description: Description,
        time_offset_s: f64,
        mut pixels: impl Iterator<Item = Result<TimedBytes>> + Send + 'static,
        process: Option<Arc<Process>>,
    ) -> Self {
        let (sender, receiver) = sync_channel(FRAMES_AHEAD);
        let (width, height) = description.size_px;
        let format = description.pixel_format;
        let encoding = description.encoding.unwrap_or_default();
        let input = description.input.clone();
        let thread = std::thread::spawn(move || {
            loop {
                let watch = Stopwatch::start();
                let Some(pixels) = pixels.next() else { break };
                let frame = pixels.and_then(|TimedBytes { bytes, time_s }| {
                    let time_s = time_s + time_offset_s;
                    Frame::new(format, encoding, width, height, bytes, time_s).map_err(|error| {
                        fault!("{input}: {error}; check the frames and the settings of their times")
                    })
                });
                let failed = frame.is_err();
                // Nobody receives any more: the source was dropped.
                if sender.send((frame, watch.elapsed_s())).is_err() || failed {
                    break;
                }
            }
        });
        Self {
            description,
            counters: Counters::default(),
            last_time_s: f64::NEG_INFINITY,
            peeked: None,
            decoding: Some((receiver, thread)),
            process,
        }
    }

    /// Width and height of every frame in pixels.
    pub(crate) fn size(&self) -> (usize, usize) {
        self.description.size_px
    }

    /// How many frames there will be, where that is known.
    pub(crate) fn frame_count(&self) -> Option<usize> {
        self.description.frame_count
    }

    /// The time stamp of the next frame in seconds, once it is decoded; nothing where there is no such frame.
    pub(crate) fn next_time_s(&mut self) -> Option<f64> {
        if self.peeked.is_none() {
            self.peeked = self.next();
        }
        let next = self.peeked.as_ref()?.as_ref().ok()?;
        Some(next.time_s())
    }

    /// What the source delivers.
    pub(crate) fn describe(&self) -> &Description {
        &self.description
    }

    /// What happened so far.
    pub(crate) fn counters(&self) -> Counters {
        Counters {
            ffmpeg_errors: self
                .process
                .as_ref()
                .map_or(0, |process| process.error_count()),
            ..self.counters
        }
    }

    /// Stops decoding and waits until the thread, and ffmpeg, have ended. Gives the thread's panic, if any.
    fn stop(&mut self) -> std::thread::Result<()> {
        if let Some(process) = &self.process {
            process.kill();
        }
        let Some((receiver, thread)) = self.decoding.take() else {
            return Ok(());
        };
        drop(receiver);
        thread.join()
    }
}

impl Iterator for Source {
    type Item = Result<Frame>;

    fn next(&mut self) -> Option<Self::Item> {
        if let Some(peeked) = self.peeked.take() {
            return Some(peeked);
        }
        loop {
            let (receiver, _) = self.decoding.as_ref()?;
            let Ok((frame, decode_s)) = receiver.recv() else {
                if let Err(panic) = self.stop() {
                    std::panic::resume_unwind(panic);
                }
                return None;
            };
            self.counters.decode_s += decode_s;
            // After an error the thread ends, and the next call sees that.
            let frame = match frame {
                Ok(frame) => frame,
                Err(error) => return Some(Err(error)),
            };
            if frame.time_s() < self.last_time_s {
                self.counters.dropped_late += 1;
                continue;
            }
            if frame.time_s() == self.last_time_s {
                self.counters.repeated_times += 1;
            }
            self.counters.frames += 1;
            self.last_time_s = frame.time_s();
            return Some(Ok(frame));
        }
    }
}

impl Drop for Source {
    fn drop(&mut self) {
        // Whatever went wrong on the thread concerns nobody any more.
        let _ = self.stop();
    }
}

#[cfg(test)]
#[path = "source_tests.rs"]
mod tests;
