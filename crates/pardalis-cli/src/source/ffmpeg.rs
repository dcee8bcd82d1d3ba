//! The installed ffmpeg and ffprobe programs: finding them, probing a stream, running a decode.

use std::collections::VecDeque;
use std::ffi::OsStr;
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStderr, ChildStdout, Command, ExitStatus, Stdio};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;

use anyhow::{Context, Result};
use pardalis_scene::{Protocol, VideoFormat, VideoInput, VideoPlace, VideoSettings};
use serde::Deserialize;

use super::TimeSpan;
use crate::user_error::user_error;

/// Number of ffmpeg's last messages that an error quotes.
const QUOTED_LINES: usize = 5;

/// Name of the filter that reports time stamps; it distinguishes these lines from all other messages.
const STAMP_FILTER: &str = "showinfo@pardalis";

/// Paths of the programs.
pub(super) struct Programs {
    ffmpeg: PathBuf,
    ffprobe: PathBuf,
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
                .ok_or_else(|| {
                    user_error!(
                        "the program {name}, which reads videos and cameras, is not installed or not in PATH; \
                         install the ffmpeg package, or extract the images into a folder"
                    )
                })
        };
        Ok(Self {
            ffmpeg: find("ffmpeg")?,
            ffprobe: find("ffprobe")?,
        })
    }

    /// Probes the first video stream. Fails if the input cannot be opened or has no video.
    pub(super) fn probe(&self, video: &VideoInput) -> Result<ProbedStream> {
        let input = name_of(&video.place);
        let output = command(&self.ffprobe)
            .args([
                "-v",
                "error",
                "-print_format",
                "json",
                "-show_streams",
                "-select_streams",
                "V:0",
            ])
            .args(opening(video))
            .args(["-i", &url(&video.place)])
            .output()
            .with_context(|| format!("{} cannot be started", self.ffprobe.display()))?;
        if !output.status.success() {
            let messages = String::from_utf8_lossy(&output.stderr);
            let lines: Vec<_> = messages.lines().collect();
            if messages.contains("not on whitelist") {
                return Err(user_error!(
                    "{input}: its content names other files or addresses, or has a format that is not allowed; \
                     convert it into a video file, such as MP4. ffmpeg's message:\n{}",
                    lines.first().copied().unwrap_or_default()
                ));
            }
            return Err(user_error!(
                "{input}: ffprobe cannot open it; check the name and how it is opened. ffprobe's messages:\n{}",
                lines[lines.len().saturating_sub(QUOTED_LINES)..].join("\n")
            ));
        }
        let probed: Probed = serde_json::from_slice(&output.stdout)
            .with_context(|| format!("{input}: ffprobe's output cannot be parsed"))?;
        probed.streams.into_iter().next().ok_or_else(|| {
            user_error!("{input}: there is no video stream in it; give a file or device with video")
        })
    }

    /// Starts to decode the first video stream to filtered raw frames of a pixel format with ffmpeg's name.
    /// Every frame of the stream is written once, with its own time stamp.
    pub(super) fn decode(&self, video: &VideoInput, filter: &str) -> Result<Decode> {
        let mut child = command(&self.ffmpeg)
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
            .args(["-i", &url(&video.place), "-map", "0:V:0"])
            .args(["-vf", &format!("{filter},{STAMP_FILTER}=checksum=0")])
            .args([
                self.frame_rate_option()?,
                "passthrough",
                "-f",
                "rawvideo",
                "pipe:1",
            ])
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .with_context(|| format!("{} cannot be started", self.ffmpeg.display()))?;
        let (Some(pixels), Some(messages)) = (child.stdout.take(), child.stderr.take()) else {
            unreachable!("both are piped");
        };
        let process = Arc::new(Process {
            child: Mutex::new(child),
            error_count: AtomicUsize::new(0),
        });
        let (sender, stamps) = channel();
        let reader = Arc::clone(&process);
        Ok(Decode {
            pixels,
            stamps,
            log: Some(std::thread::spawn(move || {
                read_log(messages, &sender, &reader)
            })),
            process,
        })
    }

    /// Returns the option that keeps ffmpeg from dropping and duplicating frames; ffmpeg 5.1 renamed it.
    fn frame_rate_option(&self) -> Result<&'static str> {
        let help = command(&self.ffmpeg)
            .args(["-hide_banner", "-h", "long"])
            .output()
            .with_context(|| format!("{} cannot be started", self.ffmpeg.display()))?;
        let has_new_name = String::from_utf8_lossy(&help.stdout).contains("-fps_mode");
        Ok(if has_new_name { "-fps_mode" } else { "-vsync" })
    }
}

/// Returns a command without standard input that writes no report.
fn command(program: &Path) -> Command {
    let mut command = Command::new(program);
    command.stdin(Stdio::null()).env_remove("FFREPORT");
    command
}

/// The containers that are recognised by their content. None of them names other files, as playlists do.
const CONTAINERS: &str = "asf,av1,avi,dv,flv,gif,gxf,h264,hevc,ivf,m4v,matroska,mjpeg,mov,mp4,mpeg,mpegts,mpegvideo,\
                          mpjpeg,mxf,nut,obu,ogg,yuv4mpegpipe";

/// Returns the place as the user wrote it, for messages.
pub(super) fn name_of(place: &VideoPlace) -> &str {
    match place {
        VideoPlace::File(name) | VideoPlace::Device(name) | VideoPlace::Address(_, name) => name,
    }
}

/// Returns the argument of `-i`. A file is marked as such because ffmpeg takes a colon in a name for a protocol.
fn url(place: &VideoPlace) -> String {
    match place {
        VideoPlace::File(path) => format!("file:{path}"),
        VideoPlace::Device(name) | VideoPlace::Address(_, name) => name.clone(),
    }
}

/// Returns the options before `-i` that ffmpeg and ffprobe need to open a video, and nothing else than this video.
fn opening(video: &VideoInput) -> Vec<String> {
    let settings = &video.settings;
    // With the protocols below them, and those to which servers may redirect.
    let protocols = match &video.place {
        VideoPlace::File(_) | VideoPlace::Device(_) => "file",
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
    let mut arguments = given([
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

/// Reports whether frames arrive while they are taken: from a device, from an address, or from a file that is read at
/// its own rate.
pub(super) fn is_live(video: &VideoInput) -> bool {
    video.settings.real_time || !matches!(video.place, VideoPlace::File(_))
}

#[derive(Deserialize)]
struct Probed {
    #[serde(default)]
    streams: Vec<ProbedStream>,
}

/// ffprobe's description of a video stream, with its own field names.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(default)]
pub(super) struct ProbedStream {
    pub(super) codec_name: String,
    /// Width in pixels before any rotation.
    pub(super) width: usize,
    pub(super) height: usize,
    pub(super) pix_fmt: String,
    pub(super) color_space: String,
    pub(super) color_range: String,
    /// A number as text; empty if the container does not state it.
    pub(super) nb_frames: String,
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
        let is_sound = first_s.is_finite() && duration_s.is_finite() && step_s.is_finite();
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

/// A running ffmpeg.
pub(super) struct Decode {
    /// Raw frames, one after another.
    pub(super) pixels: ChildStdout,
    /// One stamp per raw frame, sent before the frame is written; closed when ffmpeg ends.
    pub(super) stamps: Receiver<Stamp>,
    /// Returns the last messages.
    pub(super) log: Option<JoinHandle<Vec<String>>>,
    pub(super) process: Arc<Process>,
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

/// ffmpeg's report about a frame, printed before the frame is written.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Stamp {
    /// Presentation time in seconds; `None` if the stream does not state it.
    pub(super) time_s: Option<f64>,
    /// Width and height in pixels.
    pub(super) size_px: (usize, usize),
}

/// Drains ffmpeg's messages until it ends: forwards time stamps, counts errors, and returns the last other messages.
fn read_log(messages: ChildStderr, stamps: &Sender<Stamp>, process: &Process) -> Vec<String> {
    let mut last = VecDeque::new();
    let mut time_base = (0, 1);
    let mut messages = BufReader::new(messages);
    let mut line = Vec::new();
    loop {
        line.clear();
        // Bytes instead of text: file names in messages may have any encoding.
        match messages.read_until(b'\n', &mut line) {
            Ok(0) | Err(_) => return last.into(),
            Ok(_) => {}
        }
        let line = String::from_utf8_lossy(&line);
        let line = line.trim();
        if let Some((_, report)) = line.split_once(STAMP_FILTER) {
            if let Some(found) = time_base_in(report) {
                time_base = found;
            } else if let Some(stamp) = stamp_in(report, time_base) {
                // The receiver is gone once the frames have been dropped; the pipe is drained nevertheless.
                let _ = stamps.send(stamp);
            }
            continue;
        }
        if line.contains("[error]") || line.contains("[fatal]") || line.contains("[panic]") {
            process.error_count.fetch_add(1, Ordering::Relaxed);
        } else if !line.contains("[warning]") {
            continue;
        }
        if last.len() == QUOTED_LINES {
            last.pop_front();
        }
        last.push_back(line.to_owned());
    }
}

/// Parses numerator and denominator of the time base in seconds from `… config in time_base: 1/12800, frame_rate: …`.
fn time_base_in(report: &str) -> Option<(i64, i64)> {
    let (_, after) = report.split_once("config in time_base: ")?;
    let (numerator, denominator) = after.split_once(',')?.0.split_once('/')?;
    Some((numerator.parse().ok()?, denominator.parse().ok()?))
}

/// Parses `… n:   3 pts:   1536 pts_time:0.12 … s:640x480 …`. The printed time in seconds is rounded and not used.
fn stamp_in(report: &str, (numerator, denominator): (i64, i64)) -> Option<Stamp> {
    let value_of = |key: &str| report.split_once(key)?.1.split_whitespace().next();
    let (width, height) = value_of(" s:")?.split_once('x')?;
    let ticks: Option<i64> = value_of(" pts:")?.parse().ok();
    let seconds = |ticks: i64| (ticks as f64 * numerator as f64) / denominator as f64;
    Some(Stamp {
        time_s: ticks.map(seconds),
        size_px: (width.parse().ok()?, height.parse().ok()?),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn programs_that_are_not_installed_are_named() {
        for search_path in ["", "/nonexistent"] {
            let error = Programs::find(OsStr::new(search_path))
                .err()
                .expect("nothing there")
                .to_string();
            assert!(error.contains("program ffmpeg"), "{error}");
            assert!(error.contains("install the ffmpeg package"), "{error}");
        }
    }

    #[test]
    fn ffmpeg_gets_nothing_but_what_the_settings_name() {
        let video = VideoInput {
            place: VideoPlace::Device("-report".to_owned()),
            settings: VideoSettings {
                format: Some(VideoFormat::V4l2),
                fps: Some(30.0),
                size_px: Some([1280, 720]),
                pixel_format: Some("yuyv422".to_owned()),
                codec: Some(pardalis_scene::DeviceCodec::Mjpeg),
                hardware: Some(pardalis_scene::Hardware::Vaapi),
                ..VideoSettings::default()
            },
        };
        assert_eq!(
            opening(&video).join(" "),
            "-protocol_whitelist file -format_whitelist v4l2 -f v4l2 -framerate 30 -video_size 1280x720 \
             -pixel_format yuyv422 -input_format mjpeg"
        );
        assert_eq!(reading(&video.settings).join(" "), "-hwaccel vaapi");
        // It follows `-i`.
        assert_eq!(url(&video.place), "-report");
        let file = VideoInput::of_path("concat:a|b");
        assert_eq!(url(&file.place), "file:concat:a|b");
        for (protocol, allowed) in [
            (Protocol::Rtsp, "rtsp,rtp,udp,tcp -format_whitelist rtsp"),
            (Protocol::Udp, "udp -format_whitelist asf,"),
            (
                Protocol::Https,
                "http,https,httpproxy,tls,tcp -format_whitelist asf,",
            ),
        ] {
            let url = format!("{}://camera", protocol.name());
            let video = VideoInput {
                place: VideoPlace::Address(protocol, url),
                settings: VideoSettings::default(),
            };
            let options = opening(&video).join(" ");
            let wanted = format!("-protocol_whitelist {allowed}");
            assert!(options.starts_with(&wanted), "{options}");
        }
        for generator in ["lavfi", "concat", "hls", "dash", "sdp", "image2"] {
            assert!(!CONTAINERS.split(',').any(|name| name == generator));
        }
    }

    #[test]
    fn reports_of_several_ffmpeg_versions() {
        let base = time_base_in(" @ 0x55] [info] config in time_base: 1/12800, frame_rate: 25/1");
        assert_eq!(base, Some((1, 12800)));
        let wanted = Stamp {
            time_s: Some(0.12),
            size_px: (640, 480),
        };
        for report in [
            " @ 0x55] [info] n:   3 pts:   1536 pts_time:0.12    pos:    14738 fmt:yuv420p sar:1/1 s:640x480 i:P iskey:0 type:B",
            " @ 0x55] [info] n:   3 pts:   1536 pts_time:0.12    duration:    512 duration_time:0.04    fmt:yuv420p cl:left sar:1/1 s:640x480 i:P iskey:1 type:I",
        ] {
            assert_eq!(stamp_in(report, (1, 12800)), Some(wanted.clone()));
        }
        let without = stamp_in(
            " n:   0 pts: NOPTS pts_time:NOPTS fmt:gray s:8x4 i:P",
            (1, 25),
        );
        assert_eq!(
            without,
            Some(Stamp {
                time_s: None,
                size_px: (8, 4)
            })
        );
        assert_eq!(
            stamp_in(" [info] color_range:tv color_space:bt470bg", (1, 25)),
            None
        );
    }
}
