//! The installed ffmpeg and ffprobe programs: finding them, probing a file, running a decode.

use std::collections::VecDeque;
use std::ffi::OsStr;
use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdout, Command, ExitStatus, Stdio};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;

use anyhow::{Context, Result};
use pardalis_images::MAX_PIXELS;
use pardalis_scene::{Protocol, VideoFormat, VideoInput, VideoPlace, VideoSettings};

use super::nut::Nut;
use super::probed::{ProbedStream, probed_in};
use super::start_thread;
use super::steps::{self, Steps};
use crate::output::{Shown, in_line};
use crate::user_error::user_error;

/// Number of ffmpeg's last messages that an error quotes.
const QUOTED_LINES: usize = 5;

/// Longer messages of ffmpeg are read in parts, in bytes.
const MAX_MESSAGE_BYTES: u64 = 1 << 16;

/// Name of the filter that reports the colours of a stream; it distinguishes these lines from all other messages.
const COLOR_FILTER: &str = "showinfo@pardalis";

/// The pixel formats that a stream keeps; ffmpeg converts others to the nearest of them.
const KEPT_FORMATS: &str = "yuv420p|yuvj420p|nv12|yuyv422|uyvy422|yuv422p|yuvj422p|rgb24";

/// Options that start live sources soon and deliver each frame at once. A stream is examined for half a second, and
/// several threads decode one frame instead of one frame each.
const LIVE_OPTIONS: [&str; 6] = [
    "-analyzeduration",
    "500000",
    "-fpsprobesize",
    "0",
    "-thread_type",
    "slice",
];

/// Options of the output of live sources. Several threads would each hold a frame until another one comes.
const LIVE_OUTPUT_OPTIONS: [&str; 2] = ["-threads:v", "1"];

/// Added to all time stamps, in seconds, because a NUT stream has none below zero.
const NUT_OFFSET_S: i64 = 1 << 20;

/// Stands for missing time stamps, in seconds. It is later than any clock says, and fits into ticks of a nanosecond.
const MISSING_S: f64 = 5e9;

/// Size of the buffer before the pipe, in bytes.
const PIPE_BYTES: usize = 1 << 16;

/// Paths of the programs.
#[derive(Clone)]
pub(super) struct Programs {
    ffmpeg: PathBuf,
    ffprobe: PathBuf,
    /// On Linux, the program that lets the kernel end another one together with its parent.
    setpriv: Option<PathBuf>,
}

impl Programs {
    /// Searches the folders of a search path in the format of the environment variable `PATH`. Fails if a program is
    /// not installed.
    pub(super) fn find(search_path: &OsStr) -> Result<Self> {
        let find = |name: &str| {
            let file = format!("{name}{}", std::env::consts::EXE_SUFFIX);
            std::env::split_paths(search_path)
                .map(|folder| folder.join(&file))
                .find(|path| path.is_file())
        };
        let required = |name: &str| {
            find(name).ok_or_else(|| {
                user_error!(
                    "the program {name}, which reads videos and cameras, is not installed or not in PATH; \
                     install the ffmpeg package, or extract the images into a folder"
                )
            })
        };
        Ok(Self {
            ffmpeg: required("ffmpeg")?,
            ffprobe: required("ffprobe")?,
            setpriv: find("setpriv").filter(|path| can_end_with_parent(path)),
        })
    }

    /// Returns what ffmpeg says about the formats of a camera of Linux, or why it cannot open the camera.
    pub(super) fn camera_formats(&self, device: &Path) -> Result<String> {
        let output = command(&self.ffmpeg)
            .args(["-hide_banner", "-loglevel", "info", "-f", "v4l2"])
            .args(["-list_formats", "all", "-i"])
            .arg(device)
            .output()
            .with_context(|| format!("{} cannot be started", self.ffmpeg.shown()))?;
        Ok(String::from_utf8_lossy(&output.stderr).into_owned())
    }

    /// Probes the first video stream. Fails if the input cannot be opened or has no video.
    pub(super) fn probe(&self, video: &VideoInput) -> Result<ProbedStream> {
        let input = &*name_of(&video.place);
        let output = self
            .command_that_ends_with_parent(&self.ffprobe)
            .args([
                "-v",
                "error",
                "-print_format",
                "json",
                "-show_streams",
                "-show_format",
                "-select_streams",
                "V:0",
            ])
            .args(opening(video))
            .args(["-i", &url(&video.place)])
            .output()
            .with_context(|| format!("{} cannot be started", self.ffprobe.shown()))?;
        if !output.status.success() {
            let messages = String::from_utf8_lossy(&output.stderr);
            let lines: Vec<_> = messages.lines().collect();
            if messages.contains("not on whitelist") {
                return Err(not_allowed(input, lines[0]));
            }
            return Err(user_error!(
                "{input}: ffprobe cannot open it; check the file; a raw stream needs input.format and fps. ffprobe's messages:\n{}",
                lines[lines.len().saturating_sub(QUOTED_LINES)..].join("\n")
            ));
        }
        probed_in(input, &output.stdout)
    }

    /// Starts to decode the first video stream of a file with these filters. Every frame of the stream is written once,
    /// with its own time stamp.
    pub(super) fn decode(
        &self,
        video: &VideoInput,
        stream: &ProbedStream,
        filter: &str,
    ) -> Result<Decode> {
        let time_base = stream.time_base.split_once('/');
        let time_base = time_base
            .and_then(|(n, d)| Some((n.parse().ok()?, d.parse().ok()?)))
            .filter(|&(n, d)| n > 0 && d > 0);
        let filter = format!("{}{filter}", deinterlacing(video, stream));
        // ffmpeg invents time stamps that are missing, and changes those that do not increase, unless those of decoding do.
        let filter = format!("{filter},setpts='if(isnan(PTS),{MISSING_S}/TB,PTS)'");
        let time_base = time_base.unwrap_or(steps::TIME_BASE);
        let before_all = NUT_OFFSET_S / 2 * time_base.1 / time_base.0;
        let stamps = format!("setts=pts=PTS:dts=N-{before_all}");
        self.run(video, (&[], &["-bsf:v", &stamps]), &filter, time_base)
    }

    /// Starts to decode the first video stream of a live source, like [`Programs::decode`], in its own pixel format if it
    /// is one of [`KEPT_FORMATS`].
    pub(super) fn decode_live(&self, video: &VideoInput) -> Result<Decode> {
        // Images of this format have no time stamps, for which ffmpeg substitutes 25 a second: they get the time of their
        // arrival, in seconds since 1970.
        let stamps = if video.settings.format == Some(VideoFormat::Mpjpeg) {
            let (numerator, denominator) = steps::TIME_BASE;
            format!("settb={numerator}/{denominator},setpts=RTCTIME/(1000000*TB),")
        } else {
            String::new()
        };
        let first = deinterlacing(video, &ProbedStream::default());
        let filter = format!("{stamps}{first}format={KEPT_FORMATS},{COLOR_FILTER}=checksum=0");
        let filter = format!("{filter},{}", Steps::filter());
        let mut decode = self.run(
            video,
            (&LIVE_OPTIONS, &LIVE_OUTPUT_OPTIONS),
            &filter,
            steps::TIME_BASE,
        )?;
        decode.frames.steps = Some(Steps::default());
        Ok(decode)
    }

    fn run(
        &self,
        video: &VideoInput,
        (input_options, output_options): (&[&str], &[&str]),
        filter: &str,
        (numerator, denominator): (i64, i64),
    ) -> Result<Decode> {
        let mut command = self.command_that_ends_with_parent(&self.ffmpeg);
        if video.place == VideoPlace::StandardInput {
            command.stdin(Stdio::inherit());
        }
        command
            .args([
                "-hide_banner",
                "-nostdin",
                "-nostats",
                "-loglevel",
                "repeat+level+info",
                "-copyts",
            ])
            .args(opening(video))
            .args(reading(&video.settings))
            .args(input_options)
            .args(["-i", &url(&video.place), "-map", "0:V:0", "-vf", filter])
            // Otherwise frames of another size are stretched.
            .args(["-autoscale", "0"])
            .args([self.frame_rate_option()?, "passthrough"])
            .args(["-enc_time_base", &format!("{numerator}:{denominator}")])
            .args(["-c:v", "rawvideo"])
            .args(output_options)
            .args(["-output_ts_offset", &NUT_OFFSET_S.to_string()])
            .args(["-avoid_negative_ts", "disabled", "-write_index", "0"])
            .args(["-flush_packets", "1", "-f", "nut", "pipe:1"])
            .stdout(Stdio::piped())
            .stderr(Stdio::piped());
        let mut child =
            spawn(command).with_context(|| format!("{} cannot be started", self.ffmpeg.shown()))?;
        let (Some(frames), Some(messages)) = (child.stdout.take(), child.stderr.take()) else {
            unreachable!("both are piped");
        };
        let process = Arc::new(Process {
            child: Mutex::new(child),
            error_count: AtomicUsize::new(0),
        });
        let (sender, colors) = channel();
        let reader = Arc::clone(&process);
        let log = start_thread(move || read_log(messages, sender, &reader.error_count));
        // Otherwise nothing would end it.
        let log = log.inspect_err(|_| process.kill())?;
        Ok(Decode {
            frames: Frames {
                nut: Nut::new(BufReader::with_capacity(PIPE_BYTES, frames)),
                steps: None,
            },
            colors,
            log: Some(log),
            process,
        })
    }

    /// Returns the command of an ffmpeg or ffprobe that does not outlive this program, even if this program is killed.
    /// Where that cannot be asked for, ffmpeg ends when it writes its next frame.
    fn command_that_ends_with_parent(&self, program: &Path) -> Command {
        let Some(setpriv) = &self.setpriv else {
            return command(program);
        };
        let mut command = command(setpriv);
        command.args(["--pdeathsig", "KILL", "--"]).arg(program);
        command
    }

    /// Returns the option that keeps ffmpeg from dropping and duplicating frames; ffmpeg 5.1 renamed it.
    fn frame_rate_option(&self) -> Result<&'static str> {
        let help = command(&self.ffmpeg)
            .args(["-hide_banner", "-h", "long"])
            .output()
            .with_context(|| format!("{} cannot be started", self.ffmpeg.shown()))?;
        let has_new_name = String::from_utf8_lossy(&help.stdout).contains("-fps_mode");
        Ok(if has_new_name { "-fps_mode" } else { "-vsync" })
    }
}

/// Reports whether the lines of the second field of each frame are filled in: on request, or if a file says that it is interlaced.
pub(super) fn is_deinterlaced(video: &VideoInput, stream: &ProbedStream) -> bool {
    let by_default = is_file(&video.place) && stream.is_interlaced();
    video.settings.deinterlace.unwrap_or(by_default)
}

/// Returns ffmpeg's filter for this, with a comma; empty if there is none. The time stamp stays that of the first field.
fn deinterlacing(video: &VideoInput, stream: &ProbedStream) -> &'static str {
    match video.settings.deinterlace {
        _ if !is_deinterlaced(video, stream) => "",
        // Single frames of a file may be progressive.
        None => "yadif=deint=interlaced,",
        Some(_) => "yadif=deint=all,",
    }
}

/// Reports whether this is the `setpriv` of util-linux; that of BusyBox lacks the option.
fn can_end_with_parent(setpriv: &Path) -> bool {
    let help = command(setpriv).arg("--help").output();
    help.is_ok_and(|help| String::from_utf8_lossy(&help.stdout).contains("--pdeathsig"))
}

/// Returns the error of a video whose format is not in the list of those that are allowed, with ffmpeg's message.
pub(super) fn not_allowed(input: &str, message: &str) -> anyhow::Error {
    if message.contains("[jpeg_pipe") {
        return without_stamps(input, "mjpeg");
    }
    user_error!(
        "{input}: its content names other files or addresses, or has a format that is not allowed; \
         convert it into a video file, such as MP4. ffmpeg's message:\n{message}"
    )
}

/// Returns the error of a raw stream of a format that the scene does not name: ffmpeg would take it for 25 frames a second.
pub(super) fn without_stamps(input: &str, format: &str) -> anyhow::Error {
    user_error!(
        "{input}: is a raw stream without time stamps; give input.format = \"{format}\" and fps, or put it into a container: \
         ffmpeg -f {format} -framerate FPS -i STREAM -c copy clip.mkv"
    )
}

/// Starts a command on a thread that lasts as long as this program, because `setpriv` ends what it started with the thread that started it, and sources
/// pass from thread to thread.
fn spawn(command: Command) -> Result<Child> {
    type Job = (Command, Sender<std::io::Result<Child>>);
    static STARTER: Mutex<Option<Sender<Job>>> = Mutex::new(None);
    let mut starter = STARTER.lock().unwrap_or_else(PoisonError::into_inner);
    let jobs = match &mut *starter {
        Some(jobs) => jobs,
        none => {
            let (sender, jobs) = channel::<Job>();
            start_thread(move || {
                for (mut command, answer) in jobs {
                    // Somebody waits for the answer.
                    let _ = answer.send(command.spawn());
                }
            })?;
            none.insert(sender)
        }
    };
    let (sender, answer) = channel();
    jobs.send((command, sender))?;
    Ok(answer.recv()??)
}

/// Returns a command without standard input that writes no report. Ctrl-C in a terminal does not reach it: this program ends it.
fn command(program: &Path) -> Command {
    let mut command = Command::new(program);
    command.stdin(Stdio::null()).env_remove("FFREPORT");
    #[cfg(unix)]
    std::os::unix::process::CommandExt::process_group(&mut command, 0);
    command
}

/// The containers that are recognised by their content. None of them names other files, as playlists do.
const CONTAINERS: &str = "asf,av1,avi,dv,flv,gif,gxf,h264,hevc,ivf,m4v,matroska,mjpeg,mov,mp4,mpeg,mpegts,mpegvideo,\
                          mpjpeg,mxf,nut,obu,ogg,yuv4mpegpipe";

/// Returns the place as the user wrote it, for messages.
pub(super) fn name_of(place: &VideoPlace) -> String {
    match place {
        VideoPlace::File(name) | VideoPlace::Device(name) | VideoPlace::Address(_, name) => {
            in_line(name)
        }
        VideoPlace::StandardInput => "standard input".to_owned(),
    }
}

/// Returns the argument of `-i`. A file is marked as such because ffmpeg takes a colon in a name for a protocol.
fn url(place: &VideoPlace) -> String {
    match place {
        VideoPlace::File(path) => format!("file:{path}"),
        VideoPlace::StandardInput => "pipe:0".to_owned(),
        VideoPlace::Device(name) | VideoPlace::Address(_, name) => name.clone(),
    }
}

/// Returns the options before `-i` that ffmpeg and ffprobe need to open a video, and nothing else than this video.
fn opening(video: &VideoInput) -> Vec<String> {
    let settings = &video.settings;
    // With the protocols below them, and those to which servers may redirect.
    let protocols = match &video.place {
        VideoPlace::File(_) | VideoPlace::Device(_) => "file",
        VideoPlace::StandardInput => "pipe",
        VideoPlace::Address(Protocol::Rtsp, _) => "rtsp,rtp,udp,tcp",
        VideoPlace::Address(Protocol::Rtp, _) => "rtp,udp",
        VideoPlace::Address(Protocol::Udp, _) => "udp",
        VideoPlace::Address(Protocol::Tcp, _) => "tcp",
        VideoPlace::Address(Protocol::Http | Protocol::Https, _) => "http,https,httpproxy,tls,tcp",
    };
    let formats = match (&video.place, settings.format) {
        (_, Some(format)) => format.name(),
        (VideoPlace::Address(Protocol::Rtsp, _), None) => "rtsp",
        (VideoPlace::Address(Protocol::Rtp, _), None) => "rtp",
        (_, None) => CONTAINERS,
    };
    let codec_option = match settings.format {
        Some(VideoFormat::V4l2) => "-input_format",
        _ => "-vcodec",
    };
    let size = settings
        .size_px
        .map(|[width, height]| format!("{width}x{height}"));
    let options = [
        // Bounds the memory of decoders, whatever the video claims.
        ("-max_pixels", Some(MAX_PIXELS.to_string())),
        ("-protocol_whitelist", Some(protocols.to_owned())),
        ("-format_whitelist", Some(formats.to_owned())),
        ("-f", settings.format.map(|format| format.name().to_owned())),
        ("-framerate", settings.fps.map(|fps| fps.to_string())),
        ("-video_size", size),
        ("-pixel_format", settings.pixel_format.clone()),
        (
            codec_option,
            settings.codec.map(|codec| codec.name().to_owned()),
        ),
        (
            "-rtsp_transport",
            settings
                .rtsp_transport
                .map(|transport| transport.name().to_owned()),
        ),
    ];
    given(options)
}

/// Returns the options before `-i` that only ffmpeg has.
fn reading(settings: &VideoSettings) -> Vec<String> {
    // Such a stream may state another rate, which ffmpeg prefers to `-framerate`.
    let may_state_rate = matches!(settings.format, Some(VideoFormat::H264 | VideoFormat::Hevc));
    let fps = settings.fps.filter(|_| may_state_rate);
    let mut arguments = given([
        ("-r", fps.map(|fps| fps.to_string())),
        (
            "-hwaccel",
            settings.hardware.map(|hardware| hardware.name().to_owned()),
        ),
        ("-ss", settings.start_s.map(|start_s| start_s.to_string())),
        (
            "-t",
            settings.duration_s.map(|duration_s| duration_s.to_string()),
        ),
    ]);
    if settings.real_time {
        arguments.push("-re".to_owned());
    }
    arguments
}

/// Returns the options that have a value.
fn given<const N: usize>(options: [(&str, Option<String>); N]) -> Vec<String> {
    let with_value = options
        .into_iter()
        .filter_map(|(name, value)| Some([name.to_owned(), value?]));
    with_value.flatten().collect()
}

/// Reports whether a video can be opened twice, and read at any speed: a file, but no pipe. What does not exist is taken
/// for a file.
pub(super) fn is_file(place: &VideoPlace) -> bool {
    let VideoPlace::File(path) = place else {
        return false;
    };
    std::fs::metadata(path).map_or(true, |metadata| metadata.is_file() || metadata.is_dir())
}

/// Reports whether frames arrive while they are taken: from all but files, and from files that are read at their own
/// rate.
pub(super) fn is_live(video: &VideoInput) -> bool {
    video.settings.real_time || !is_file(&video.place)
}

/// A running ffmpeg.
pub(super) struct Decode {
    pub(super) frames: Frames,
    /// Receives the colours of a live stream once, before its first frame; closed when ffmpeg ends.
    pub(super) colors: Receiver<ProbedStream>,
    /// Returns the last messages.
    pub(super) log: Option<JoinHandle<Vec<String>>>,
    pub(super) process: Arc<Process>,
}

impl Decode {
    /// Waits until ffmpeg has ended, and returns its exit status and its last messages. Call it after its pipe is
    /// closed or after [`Process::kill`].
    pub(super) fn end(&mut self) -> Result<(ExitStatus, Vec<String>)> {
        let messages = match self.log.take().map(JoinHandle::join) {
            Some(Ok(messages)) => messages,
            Some(Err(panic)) => std::panic::resume_unwind(panic),
            None => Vec::new(),
        };
        let status = self.process.wait().context("waiting for ffmpeg")?;
        Ok((status, messages))
    }
}

impl Drop for Decode {
    fn drop(&mut self) {
        self.process.kill();
        // Reaps the process; its exit status no longer matters.
        let _ = self.process.wait();
    }
}

/// The frames that ffmpeg writes, with their time stamps.
pub(super) struct Frames {
    nut: Nut<BufReader<ChildStdout>>,
    /// Of live sources.
    steps: Option<Steps>,
}

impl Frames {
    /// Waits for the stream and returns width and height in pixels; `None` if ffmpeg ends before.
    pub(super) fn size_px(&mut self) -> std::io::Result<Option<(usize, usize)>> {
        self.nut.size_px()
    }

    /// Waits for the next frame and returns its time stamp in seconds, if it has one, and its length in bytes; `None`
    /// at the end. Read its bytes with [`Frames::read`] before the next call.
    pub(super) fn next(&mut self) -> std::io::Result<Option<(Option<f64>, usize)>> {
        let Some(header) = self.nut.next_frame()? else {
            return Ok(None);
        };
        let time_base = self.nut.time_base();
        let ticks = without_offset(header.ticks, time_base);
        let time_s = match &mut self.steps {
            Some(steps) => steps.undone(ticks).map(|ticks| seconds(ticks, time_base)),
            None => Some(seconds(ticks, time_base)).filter(|&time_s| time_s < MISSING_S),
        };
        Ok(Some((time_s, header.byte_count)))
    }

    /// Reads the bytes of a frame.
    pub(super) fn read(&mut self, bytes: &mut [u8]) -> std::io::Result<()> {
        self.nut.read(bytes)
    }
}

/// Takes [`NUT_OFFSET_S`] from a stamp, rounded to ticks as ffmpeg does.
pub(super) fn without_offset(ticks: i64, (numerator, denominator): (u64, u64)) -> i64 {
    let offset = (NUT_OFFSET_S as f64 * denominator as f64 / numerator as f64).round();
    ticks.wrapping_sub(offset as i64)
}

/// Returns a time in seconds.
pub(super) fn seconds(ticks: i64, (numerator, denominator): (u64, u64)) -> f64 {
    (ticks as f64 * numerator as f64) / denominator as f64
}

/// The operating system's process, shared by everything that may have to end it.
pub(super) struct Process {
    child: Mutex<Child>,
    error_count: AtomicUsize,
}

impl Process {
    /// Ends ffmpeg, so that its pipes close. Does nothing if it has already ended.
    pub(super) fn kill(&self) {
        // An error means that it has just ended by itself.
        let _ = self.child().kill();
    }

    /// Waits for ffmpeg to end. Call it after its pipes are closed or after [`Process::kill`].
    pub(super) fn wait(&self) -> std::io::Result<ExitStatus> {
        self.child().wait()
    }

    /// Returns the number of errors that ffmpeg has reported so far.
    pub(super) fn error_count(&self) -> usize {
        self.error_count.load(Ordering::Relaxed)
    }

    fn child(&self) -> std::sync::MutexGuard<'_, Child> {
        self.child.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Drains ffmpeg's messages until it ends: forwards the colours, counts errors, and returns the last other messages.
pub(super) fn read_log(
    messages: impl Read,
    colors: Sender<ProbedStream>,
    error_count: &AtomicUsize,
) -> Vec<String> {
    let mut last = VecDeque::new();
    let mut colors = Some(colors);
    let mut stream = ProbedStream::default();
    let mut messages = BufReader::new(messages);
    let mut line = Vec::new();
    loop {
        line.clear();
        // Bytes instead of text: file names in messages may have any encoding.
        let mut part = messages.by_ref().take(MAX_MESSAGE_BYTES);
        match part.read_until(b'\n', &mut line) {
            Ok(0) | Err(_) => break,
            Ok(_) => {}
        }
        let line = String::from_utf8_lossy(&line);
        let line = line.trim();
        if let Some((_, report)) = line.split_once(COLOR_FILTER) {
            if colors.is_some() && add_report(&mut stream, report) {
                send(&mut colors, &stream);
            }
            continue;
        }
        if let Some(format) = format_in(line) {
            format.clone_into(&mut stream.format_name);
        }
        if let Some(codec) = codec_in(line) {
            codec.clone_into(&mut stream.codec_name);
        }
        if line.contains("[error]") || line.contains("[fatal]") || line.contains("[panic]") {
            error_count.fetch_add(1, Ordering::Relaxed);
        } else if !line.contains("[warning]") {
            continue;
        }
        if last.len() == QUOTED_LINES {
            last.pop_front();
        }
        last.push_back(line.to_owned());
    }
    if !stream.pix_fmt.is_empty() {
        send(&mut colors, &stream);
    }
    last.into()
}

/// Sends the colours, once.
fn send(colors: &mut Option<Sender<ProbedStream>>, stream: &ProbedStream) {
    if let Some(colors) = colors.take() {
        // The receiver is gone if the source was dropped.
        let _ = colors.send(stream.clone());
    }
}

/// Adds a line of the colour filter, such as `… n:   0 pts: … fmt:yuv420p … s:640x480 …`, which `… color_range:tv
/// color_space:bt709 …` follows in most versions of ffmpeg, and `i:T` or `i:B` for interlaced
/// frames. Reports whether nothing is left to add.
fn add_report(stream: &mut ProbedStream, report: &str) -> bool {
    let value_of = |key: &str| {
        let after = report.split_once(key)?.1;
        after.split_whitespace().next().map(str::to_owned)
    };
    let format = value_of(" fmt:");
    // Without colours, the next frame follows.
    let is_next = format.is_some() && !stream.pix_fmt.is_empty();
    if let Some(format) = format.filter(|_| !is_next) {
        stream.pix_fmt = format;
        stream.field_order = match value_of(" i:").as_deref() {
            Some("T") => "tt".to_owned(),
            Some("B") => "bb".to_owned(),
            _ => String::new(),
        };
    }
    let space = value_of("color_space:");
    let has_colors = space.is_some();
    stream.color_space = space.unwrap_or_default();
    stream.color_range = value_of("color_range:").unwrap_or_default();
    is_next || has_colors
}

/// Parses the format's name in `Input #0, mpjpeg, from 'http://...':`.
fn format_in(line: &str) -> Option<&str> {
    let (_, after) = line.split_once("Input #0, ")?;
    Some(after.split_once(", from ")?.0)
}

/// Parses the codec's name in `  Stream #0:1 -> #0:0 (h264 (native) -> rawvideo (native))`.
fn codec_in(line: &str) -> Option<&str> {
    let (_, after) = line.split_once(" -> #0:0 (")?;
    after.split_whitespace().next()
}

#[cfg(test)]
#[path = "ffmpeg_tests.rs"]
mod tests;
