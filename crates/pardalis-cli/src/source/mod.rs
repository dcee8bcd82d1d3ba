//! Sources of frames: a folder of images, or anything that an installed ffmpeg opens.

mod ahead;
pub(crate) mod decode;
mod ffmpeg;
#[cfg(any(test, feature = "fuzz"))]
pub(crate) mod fuzzing;
pub(crate) mod images;
mod live;
mod mcap;
mod nut;
mod open;
mod probed;
mod running;
mod steps;
mod times;
mod video;

use std::collections::VecDeque;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, TryRecvError};
use std::task::Poll;
use std::thread::JoinHandle;
use std::time::Duration;

use anyhow::{Context, Result};
use pardalis::color::YuvEncoding;
use pardalis::{Frame, PixelFormat};
use pardalis_scene::{FrameRange, VideoInput, WhenBehind};
use serde::Serialize;

use crate::interrupt::{self, Stop};
use crate::output::Shown;
use crate::timing::{Stopwatch, now_s};
use crate::user_error::user_error;
use ahead::{Ahead, Slot};
use ffmpeg::Programs;
use images::ImageFrames;
pub(crate) use open::OpenCameras;
use running::Running;
use video::VideoFrames;

/// Maximum number of frames that are decoded ahead.
const FRAMES_AHEAD: usize = 3;

/// Maximum memory of frames that are decoded ahead, in bytes; but a frame of any size is.
const BYTES_AHEAD: usize = 64 << 20;

/// How long to wait for each of the first frames of a live camera if they are needed at once.
const FIRST_FRAME_WAIT: Duration = Duration::from_secs(5);

/// How often a wait for a frame looks for an interrupt.
const INTERRUPT_POLL: Duration = Duration::from_millis(100);

/// Starts a thread. Fails if the system allows no further one.
fn start_thread<T: Send + 'static>(
    run: impl FnOnce() -> T + Send + 'static,
) -> Result<JoinHandle<T>> {
    std::thread::Builder::new().spawn(run).context(
        "no further thread can be started; use fewer cameras, or allow more memory or threads (ulimit -v, ulimit -u)",
    )
}

/// An ffmpeg that lists the formats of cameras.
pub(crate) struct CameraFormats(Programs);

impl CameraFormats {
    /// Finds ffmpeg. Fails if it is not installed.
    pub(crate) fn find() -> Result<Self> {
        let search_path = std::env::var_os("PATH").unwrap_or_default();
        Programs::find(&search_path).map(Self)
    }

    /// Returns ffmpeg's messages about the formats of a camera of Linux.
    pub(crate) fn messages_about(&self, device: &Path) -> Result<String> {
        self.0.camera_formats(device)
    }
}

/// Settings of the source of a camera's frames.
#[derive(Debug, Clone)]
pub(crate) struct SourceConfig {
    /// The files or the device.
    pub(crate) kind: SourceKind,
    /// Added to every time stamp, in seconds.
    pub(crate) time_offset_s: f64,
    /// The frames to read.
    pub(crate) frames: FrameRange,
}

/// The files or the device.
#[derive(Debug, Clone)]
pub(crate) enum SourceKind {
    /// JPEG and PNG images of one size.
    Images {
        /// The folder that holds them, and `times.csv`.
        folder: PathBuf,
        /// Their times.
        timing: Timing,
    },
    /// A video file, stream or camera device, read with an installed ffmpeg.
    Video {
        /// What ffmpeg opens, and how.
        video: VideoInput,
        /// Encoding of YUV pixels, if the stream does not state it or states it wrongly.
        encoding: Option<YuvEncoding>,
    },
    /// Images in an MCAP recording.
    Mcap {
        /// The recording.
        file: PathBuf,
        /// The topic of the images; `None` for the only one with images.
        topic: Option<String>,
    },
}

/// The times of the images of a folder.
#[derive(Debug, Clone)]
pub(crate) enum Timing {
    /// At a constant rate, in frames per second.
    Fps(f64),
    /// From `times.csv` in the folder of the images.
    TimesFile,
}

/// Description of a source, for checks and summaries.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(crate) struct Description {
    /// The folder, file or device, as given.
    pub(crate) input: String,
    /// Its content: number and names of images, or a video's codec and pixel format.
    pub(crate) content: String,
    /// Width and height of every frame in pixels.
    pub(crate) size_px: (usize, usize),
    /// Pixel format of the frames.
    pub(crate) pixel_format: PixelFormat,
    /// Encoding of YUV pixels; `None` for RGB.
    pub(crate) encoding: Option<YuvEncoding>,
    /// Number of frames, if it is known.
    pub(crate) frame_count: Option<usize>,
}

/// Statistics of decoding so far; complete once the source has ended.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(crate) struct Counters {
    /// Errors that ffmpeg reported without stopping: frames may be damaged.
    pub(crate) ffmpeg_errors: usize,
    /// How often a live source was opened again after it had failed.
    pub(crate) reopened: usize,
    /// How often the clock of a live source was set while it was open.
    pub(crate) clock_jumps: usize,
    /// Time spent decoding, in parallel with tracking, in seconds. For videos: time waiting for ffmpeg.
    pub(crate) decode_s: f64,
}

/// Time span of a recorded source, including its camera's time offset.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct TimeSpan {
    /// The earliest time stamp, in seconds.
    pub(crate) first_s: f64,
    /// The latest time stamp, in seconds.
    pub(crate) last_s: f64,
    /// The typical interval between frames, in seconds; `None` for a single frame.
    pub(crate) step_s: Option<f64>,
}

/// The next item of a source.
#[derive(Debug)]
pub(crate) enum Delivery {
    /// A frame.
    Frame {
        /// The frame with its time stamp, including the camera's time offset.
        frame: Frame,
        /// When it reached the program, in seconds. Recorded sources: on the clock of the time stamps, never
        /// decreasing. Live sources: on the program's clock.
        arrival_s: f64,
    },
    /// An image that cannot be used, with the reason; others may follow.
    Broken(anyhow::Error),
}

/// The pixels of one frame and its times in the source, in seconds.
struct TimedBytes {
    bytes: Vec<u8>,
    time_s: f64,
    /// `None` if the recording does not state it.
    arrival_s: Option<f64>,
}

/// The next item of a reader of files or streams. Nothing follows an error.
enum Pixels {
    Frame(TimedBytes),
    Broken(anyhow::Error),
}

/// A delivery, or the error that ended decoding, and the time that it took in seconds.
type Decoded = (Result<Delivery>, f64);

/// The frames of one camera in order of arrival, decoded ahead on a separate thread.
///
/// Nothing follows an error.
pub(crate) struct Source {
    description: Description,
    /// `None` if it is not known before the frames are read.
    span: Option<TimeSpan>,
    is_live: bool,
    /// The number of frames that were dropped because later ones were decoded, and not counted yet; `None` if all wait to be taken.
    overtaken: Option<Arc<AtomicUsize>>,
    /// What the user should know although the source opens.
    warning: Option<String>,
    counters: Counters,
    /// Deliveries received in advance to determine the time of the first frame.
    peeked: VecDeque<Result<Delivery>>,
    /// `None` once the thread has ended.
    decoding: Option<(Receiver<Slot>, JoinHandle<()>)>,
    process: Option<Arc<Running>>,
}

impl SourceConfig {
    /// Reports whether two sources have the same settings.
    pub(crate) fn is_same(&self, other: &Self) -> bool {
        format!("{self:?}") == format!("{other:?}")
    }

    /// Reports whether frames arrive while they are taken, and whether opening the source twice may fail.
    pub(crate) fn is_live(&self) -> bool {
        match &self.kind {
            SourceKind::Images { .. } | SourceKind::Mcap { .. } => false,
            SourceKind::Video { video, .. } => ffmpeg::is_live(video),
        }
    }
}

impl Source {
    /// Opens the source and starts to decode.
    ///
    /// Fails on every error that is detectable before the first frame is decoded.
    pub(crate) fn open(config: &SourceConfig) -> Result<Self> {
        Self::open_until(config, &Stop::default())
    }

    /// Opens the source as [`Source::open`] does, unless it is to stop while a live one is waited for, which fails.
    pub(crate) fn open_until(config: &SourceConfig, stop: &Stop) -> Result<Self> {
        match &config.kind {
            SourceKind::Images { folder, timing } => {
                let frames = ImageFrames::open(folder, timing, config.frames)?;
                let input = folder.shown();
                Self::of_images(input, frames, config.time_offset_s)
            }
            SourceKind::Mcap { file, topic } => {
                let opened = mcap::open(file, topic.as_deref(), config.frames);
                let (description, span, frames) = opened?;
                let offset_s = config.time_offset_s;
                let mut source = Self::start(description, Clock::Recorded, offset_s, frames)?;
                source.span = span.map(|span| span.moved(offset_s));
                source.warning = mcap::warning(file);
                Ok(source)
            }
            SourceKind::Video { video, encoding } => {
                let search_path = std::env::var_os("PATH").unwrap_or_default();
                let programs = Programs::find(&search_path)
                    .map_err(|error| user_error!("{}: {error}", ffmpeg::name_of(&video.place)))?;
                let (description, frames) =
                    VideoFrames::open(&programs, video, *encoding, config.frames, stop)?;
                let span = frames.span();
                let process = frames.process();
                let warning = frames.warning().map(str::to_owned);
                let is_live = ffmpeg::is_live(video);
                let clock = if is_live {
                    Clock::Live(video.when_behind())
                } else {
                    Clock::Recorded
                };
                let mut source = Self::start(description, clock, config.time_offset_s, frames)?;
                source.is_live = is_live;
                source.warning = warning;
                source.process = Some(process);
                source.span = span.map(|span| span.moved(config.time_offset_s));
                Ok(source)
            }
        }
    }

    /// Opens one or more unrelated JPEG and PNG images of one size; their times are one second apart.
    pub(crate) fn stills(files: &[PathBuf]) -> Result<Self> {
        let input = "images of the command line".to_owned();
        Self::of_images(input, ImageFrames::stills(files)?, 0.0)
    }

    fn of_images(input: String, frames: ImageFrames, time_offset_s: f64) -> Result<Self> {
        let description = Description {
            input,
            content: frames.content(),
            size_px: frames.size_px(),
            pixel_format: PixelFormat::Rgb8,
            encoding: None,
            frame_count: Some(frames.frame_count()),
        };
        let span = frames.span().moved(time_offset_s);
        let mut source = Self::start(description, Clock::Recorded, time_offset_s, frames)?;
        source.span = Some(span);
        Ok(source)
    }

    fn start(
        description: Description,
        clock: Clock,
        time_offset_s: f64,
        mut pixels: impl Iterator<Item = Result<Pixels>> + Send + 'static,
    ) -> Result<Self> {
        let (width, height) = description.size_px;
        let format = description.pixel_format;
        let ahead = BYTES_AHEAD / format.byte_count(width, height).max(1);
        let keeps_up = matches!(clock, Clock::Live(WhenBehind::Drop));
        let overtaken = keeps_up.then(Arc::default);
        let (mut ahead, receiver) = Ahead::new(ahead.clamp(1, FRAMES_AHEAD), overtaken.clone());
        let encoding = description.encoding.unwrap_or_default();
        let input = description.input.clone();
        let thread = start_thread(move || {
            let mut arrived_s = f64::NEG_INFINITY;
            loop {
                let watch = Stopwatch::start();
                let Some(pixels) = pixels.next() else { break };
                let delivery = pixels.and_then(|pixels| {
                    let timed = match pixels {
                        Pixels::Frame(timed) => timed,
                        Pixels::Broken(why) => return Ok(Delivery::Broken(why)),
                    };
                    let time_s = timed.time_s + time_offset_s;
                    arrived_s = match clock {
                        Clock::Recorded => timed.arrival_s.unwrap_or(time_s).max(arrived_s),
                        Clock::Live(_) => now_s(),
                    };
                    let frame = Frame::new(format, encoding, width, height, timed.bytes, time_s);
                    let frame = frame.map_err(|error| {
                        user_error!(
                            "{input}: {error}; check the frames and the settings of their times"
                        )
                    })?;
                    Ok(Delivery::Frame {
                        frame,
                        arrival_s: arrived_s,
                    })
                });
                let failed = delivery.is_err();
                // The receiver is gone: the source was dropped.
                if !ahead.send((delivery, watch.elapsed_s())) || failed {
                    break;
                }
            }
        })?;
        Ok(Self {
            description,
            span: None,
            is_live: false,
            overtaken,
            warning: None,
            counters: Counters::default(),
            peeked: VecDeque::new(),
            decoding: Some((receiver, thread)),
            process: None,
        })
    }

    /// Returns the width and height of every frame in pixels.
    pub(crate) fn size(&self) -> (usize, usize) {
        self.description.size_px
    }

    /// Returns the number of frames, if it is known.
    pub(crate) fn frame_count(&self) -> Option<usize> {
        self.description.frame_count
    }

    /// Returns the time span of the frames, if it is known before they are read.
    pub(crate) fn span(&self) -> Option<TimeSpan> {
        self.span
    }

    /// Reports whether frames arrive while they are taken, from a device or a stream.
    pub(crate) fn is_live(&self) -> bool {
        self.is_live
    }

    /// Reports whether its oldest frames are dropped while tracking is slower, rather than held back with the sender.
    pub(crate) fn keeps_up(&self) -> bool {
        self.overtaken.is_some()
    }

    /// Reports whether it is a live source that has failed and is being opened again.
    pub(crate) fn is_away(&self) -> bool {
        let running = self.process.as_ref();
        running.is_some_and(|running| running.is_away())
    }

    /// Returns the number of frames that were dropped since the last call because later ones were decoded, or came with them at once.
    pub(crate) fn take_overtaken(&mut self) -> usize {
        let overtaken = self.overtaken.as_ref();
        let overtaken = overtaken.map_or(0, |overtaken| overtaken.swap(0, Ordering::Relaxed));
        let left_out = self.process.as_ref();
        overtaken + left_out.map_or(0, |running| running.take_left_out())
    }

    /// Forgets what was counted, as if the source had only now been opened.
    #[cfg(feature = "studio")]
    pub(crate) fn count_anew(&mut self) {
        self.take_overtaken();
        self.counters.decode_s = 0.0;
        self.process.iter().for_each(|running| running.count_anew());
    }

    /// Returns what the user should know although the source opens.
    pub(crate) fn warning(&self) -> Option<&str> {
        self.warning.as_deref()
    }

    /// Waits for the first frames, at most this many, and returns those that come; they are delivered nevertheless. Call it
    /// before taking any frame.
    pub(crate) fn peek(&mut self, count: usize) -> impl Iterator<Item = &Frame> {
        let is_frame = |delivery: &&_| matches!(delivery, Ok(Delivery::Frame { .. }));
        while self.peeked.iter().filter(is_frame).count() < count
            && let Some(next) = self.receive()
        {
            self.peeked.push_back(next);
        }
        self.peeked.iter().filter_map(|delivery| match delivery {
            Ok(Delivery::Frame { frame, .. }) => Some(frame),
            _ => None,
        })
    }

    /// Waits for the first frame and returns its time stamp in seconds; `None` if there is no frame. Call it before
    /// taking any frame.
    pub(crate) fn first_time_s(&mut self) -> Option<f64> {
        loop {
            let first = self
                .peeked
                .iter()
                .find(|delivery| !matches!(delivery, Ok(Delivery::Broken(_))));
            match first {
                Some(Ok(Delivery::Frame { frame, .. })) => return Some(frame.time_s()),
                Some(_) => return None,
                None => {}
            }
            let next = self.receive_soon();
            self.peeked.push_back(next?);
        }
    }

    /// Waits for the first frames, at most this many, and returns those that come; they are delivered nevertheless. Call it
    /// before taking any frame.
    ///
    /// Errors: no frame comes, with the reason.
    pub(crate) fn first_frames(&mut self, count: usize) -> Result<Vec<Frame>> {
        let mut frames = Vec::new();
        let mut why = None;
        for number in 0.. {
            if number == self.peeked.len() {
                let Some(next) = self.receive_soon() else {
                    break;
                };
                self.peeked.push_back(next);
            }
            match &self.peeked[number] {
                Ok(Delivery::Frame { frame, .. }) => frames.push(frame.clone()),
                Ok(Delivery::Broken(error)) | Err(error) => {
                    why.get_or_insert_with(|| format!("{error:#}"));
                }
            }
            if frames.len() == count {
                break;
            }
        }
        match why {
            _ if !frames.is_empty() => Ok(frames),
            Some(why) => Err(user_error!("{why}")),
            None => Err(user_error!(
                "{}: gives no frame; check that it has not ended",
                self.description.input
            )),
        }
    }

    /// Returns the description of the source.
    pub(crate) fn describe(&self) -> &Description {
        &self.description
    }

    /// Returns the statistics of decoding so far.
    pub(crate) fn counters(&self) -> Counters {
        let running = self.process.as_ref();
        Counters {
            ffmpeg_errors: running.map_or(0, |running| running.error_count()),
            reopened: running.map_or(0, |running| running.reopened()),
            clock_jumps: running.map_or(0, |running| running.clock_jumps()),
            ..self.counters
        }
    }

    /// Returns the next delivery, or the end of the source, if it is available without waiting; otherwise pending.
    pub(crate) fn poll_next(&mut self) -> Poll<Option<Result<Delivery>>> {
        if !self.peeked.is_empty() {
            return Poll::Ready(self.next());
        }
        loop {
            let Some((receiver, _)) = &self.decoding else {
                return Poll::Ready(None);
            };
            match receiver.try_recv().map(|slot| slot.take()) {
                Ok(Some(decoded)) => return Poll::Ready(Some(self.counted(decoded))),
                Ok(None) => {}
                Err(TryRecvError::Empty) => return Poll::Pending,
                Err(TryRecvError::Disconnected) => return Poll::Ready(self.end()),
            }
        }
    }

    /// Waits for the next delivery. An interrupt ends the wait, in case that nothing ever comes.
    fn receive(&mut self) -> Option<Result<Delivery>> {
        while !interrupt::requested() {
            let (receiver, _) = self.decoding.as_ref()?;
            match receiver
                .recv_timeout(INTERRUPT_POLL)
                .map(|slot| slot.take())
            {
                Ok(Some(decoded)) => return Some(self.counted(decoded)),
                Err(RecvTimeoutError::Disconnected) => return self.end(),
                Ok(None) | Err(RecvTimeoutError::Timeout) => {}
            }
        }
        None
    }

    /// Waits for the next delivery, but not for long if the source is live.
    fn receive_soon(&mut self) -> Option<Result<Delivery>> {
        if !self.is_live {
            return self.receive();
        }
        let (receiver, _) = self.decoding.as_ref()?;
        let mut taken = None;
        // Places of dropped frames are empty, and others follow them.
        while taken.is_none() {
            taken = receiver.recv_timeout(FIRST_FRAME_WAIT).ok()?.take();
        }
        taken.map(|decoded| self.counted(decoded))
    }

    fn counted(&mut self, (delivery, decode_s): Decoded) -> Result<Delivery> {
        self.counters.decode_s += decode_s;
        delivery
    }

    /// Ends the source and propagates a panic of the thread.
    fn end(&mut self) -> Option<Result<Delivery>> {
        if let Err(panic) = self.stop() {
            std::panic::resume_unwind(panic);
        }
        None
    }

    /// Stops decoding and waits until the thread and ffmpeg have ended. Returns the thread's panic, if any.
    fn stop(&mut self) -> std::thread::Result<()> {
        if let Some(process) = &self.process {
            process.stop();
        }
        let Some((receiver, thread)) = self.decoding.take() else {
            return Ok(());
        };
        drop(receiver);
        thread.join()
    }
}

impl Iterator for Source {
    type Item = Result<Delivery>;

    fn next(&mut self) -> Option<Self::Item> {
        let peeked = self.peeked.pop_front();
        peeked.or_else(|| self.receive())
    }
}

impl Drop for Source {
    fn drop(&mut self) {
        // Errors on the thread no longer matter.
        let _ = self.stop();
    }
}

/// The clock of arrivals.
#[derive(Debug, Clone, Copy)]
enum Clock {
    /// The recording: a frame arrives at its recorded arrival time, else at its own time stamp, but never before the
    /// frame preceding it.
    Recorded,
    /// The program's clock, at the time when it receives the frame.
    Live(WhenBehind),
}

impl TimeSpan {
    /// Returns the span of one or more time stamps in seconds.
    fn of(mut times_s: Vec<f64>) -> Self {
        times_s.sort_by(f64::total_cmp);
        let mut steps_s: Vec<f64> = times_s.array_windows().map(|[a, b]| b - a).collect();
        steps_s.sort_by(f64::total_cmp);
        Self {
            first_s: times_s.first().copied().unwrap_or_default(),
            last_s: times_s.last().copied().unwrap_or_default(),
            step_s: steps_s.get(steps_s.len() / 2).copied(),
        }
    }

    fn moved(self, offset_s: f64) -> Self {
        Self {
            first_s: self.first_s + offset_s,
            last_s: self.last_s + offset_s,
            ..self
        }
    }
}

#[cfg(test)]
#[path = "source_tests.rs"]
mod tests;
