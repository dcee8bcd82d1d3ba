//! The video of a camera and how it is opened.
//!
//! Scenes are shared, so they choose from closed lists what is opened and how. They never give options of ffmpeg, some of which write files.

use super::description::above;
use super::reader::Table;
use super::setting::Word;

/// What is opened, and how.
#[derive(Debug, Clone, PartialEq)]
pub struct VideoInput {
    /// What is opened.
    pub place: VideoPlace,
    /// How it is opened.
    pub settings: VideoSettings,
}

/// A source of video.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum VideoPlace {
    /// The file of this name, which may be a pipe.
    File(String),
    /// The program's standard input.
    StandardInput,
    /// A camera, by its name in the interface that [`VideoSettings::format`] states.
    Device(String),
    /// A stream from the network, by its full address.
    Address(Protocol, String),
}

/// How a video is opened.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct VideoSettings {
    /// The format of a file or stream, or the interface to a device; `None` recognises the format.
    pub format: Option<VideoFormat>,
    /// The frame rate of a device or of a format without time stamps, in frames per second.
    pub fps: Option<f64>,
    /// Width and height in pixels of a device's images or of raw video.
    pub size_px: Option<[usize; 2]>,
    /// The pixel format of a device or of raw video, by ffmpeg's name: letters, digits and underscores.
    pub pixel_format: Option<String>,
    /// The compression that a device is asked for.
    pub codec: Option<DeviceCodec>,
    /// What carries the frames of an RTSP stream.
    pub rtsp_transport: Option<RtspTransport>,
    /// How much of a file is skipped at the beginning, in seconds.
    pub start_s: Option<f64>,
    /// How much is read, in seconds.
    pub duration_s: Option<f64>,
    /// The hardware that decodes.
    pub hardware: Option<Hardware>,
    /// Whether the lines of each frame's second field are interpolated from its first; `None` does so for files that say that they are interlaced.
    pub deinterlace: Option<bool>,
    /// How long to wait for the first frame of anything but a file, in seconds.
    pub timeout_s: Option<f64>,
    /// How long to try to open a live source again that has ended or failed, in seconds.
    pub reopen_s: Option<f64>,
    /// Whether a file is read at the rate of its time stamps, as if it were live.
    pub real_time: bool,
    /// What happens to waiting frames while tracking is slower than a live source; `None` depends on the source.
    pub when_behind: Option<WhenBehind>,
}

/// Declares an enum whose values are words of scene files and names of ffmpeg.
macro_rules! words {
    ($(#[$about:meta])* $name:ident { $($value:ident = $word:literal),* $(,)? }) => {
        $(#[$about])*
        #[derive(Debug, Clone, Copy, PartialEq, Eq)]
        pub enum $name {
            $(#[doc = concat!("`", $word, "`")] $value),*
        }

        impl $name {
            /// Returns the word, which is also ffmpeg's name.
            pub fn name(self) -> &'static str {
                match self {
                    $(Self::$value => $word),*
                }
            }
        }

        impl Word for $name {
            const WORDS: &'static [(&'static str, Self)] = &[$(($word, Self::$value)),*];
        }
    };
}

words! {
    /// The format of a file or stream, or the interface to a device.
    VideoFormat {
        V4l2 = "v4l2",
        Libdc1394 = "libdc1394",
        Dshow = "dshow",
        Avfoundation = "avfoundation",
        Rawvideo = "rawvideo",
        Mjpeg = "mjpeg",
        H264 = "h264",
        Hevc = "hevc",
        Mpjpeg = "mpjpeg",
        Mpegts = "mpegts",
    }
}

words! {
    /// A network protocol.
    Protocol {
        Rtsp = "rtsp",
        Rtp = "rtp",
        Udp = "udp",
        Tcp = "tcp",
        Http = "http",
        Https = "https",
    }
}

words! {
    /// The compression of a device's images.
    DeviceCodec {
        Mjpeg = "mjpeg",
        H264 = "h264",
        Hevc = "hevc",
    }
}

words! {
    /// What carries the frames of an RTSP stream.
    RtspTransport {
        Udp = "udp",
        Tcp = "tcp",
    }
}

words! {
    /// What happens to waiting frames while tracking is slower than a live source.
    WhenBehind {
        Drop = "drop",
        Wait = "wait",
    }
}

words! {
    /// An interface to decoders in hardware.
    Hardware {
        Auto = "auto",
        Cuda = "cuda",
        D3d11va = "d3d11va",
        Dxva2 = "dxva2",
        Qsv = "qsv",
        Vaapi = "vaapi",
        Vdpau = "vdpau",
        Videotoolbox = "videotoolbox",
    }
}

impl VideoFormat {
    /// Reports whether this is an interface to devices.
    pub fn is_device(self) -> bool {
        matches!(
            self,
            Self::V4l2 | Self::Libdc1394 | Self::Dshow | Self::Avfoundation
        )
    }

    /// Reports whether a frame rate can be asked for, or is missing in the stream.
    fn takes_fps(self) -> bool {
        !matches!(self, Self::Mpjpeg | Self::Mpegts)
    }

    /// Reports whether size and pixel format can be asked for, or are missing in the stream.
    fn takes_pixels(self) -> bool {
        self.is_device() || self == Self::Rawvideo
    }
}

impl VideoInput {
    /// Returns how long to try to open this again after it has ended or failed, in seconds.
    pub fn reopen_s(&self) -> f64 {
        // A part of a stream has an end.
        let goes_on = self.is_camera() && self.settings.duration_s.is_none();
        let default_s = if goes_on { REOPEN_S } else { 0.0 };
        self.settings.reopen_s.unwrap_or(default_s)
    }

    /// Reports whether this is a camera, and cannot be a recording that somebody serves.
    fn is_camera(&self) -> bool {
        self.settings.format == Some(VideoFormat::Mpjpeg)
            || matches!(
                self.place,
                VideoPlace::Device(_)
                    | VideoPlace::Address(Protocol::Rtsp | Protocol::Rtp | Protocol::Udp, _)
            )
    }

    /// Returns what happens to waiting frames while tracking is slower than this live source: cameras go on, and what may be a recording waits.
    pub fn when_behind(&self) -> WhenBehind {
        let default = if self.settings.real_time || self.is_camera() {
            WhenBehind::Drop
        } else {
            WhenBehind::Wait
        };
        self.settings.when_behind.unwrap_or(default)
    }

    /// Returns the file or the camera of Linux of this name.
    pub fn of_path(path: &str) -> Self {
        let is_camera = LINUX_CAMERAS.iter().any(|start| path.starts_with(start));
        let format = is_camera.then_some(VideoFormat::V4l2);
        Self {
            place: match format {
                Some(_) => VideoPlace::Device(path.to_owned()),
                None => VideoPlace::File(path.to_owned()),
            },
            settings: VideoSettings {
                format,
                ..VideoSettings::default()
            },
        }
    }
}

/// How long to try to open a camera again, in seconds: longer than most cameras need to start.
const REOPEN_S: f64 = 60.0;

/// Names of cameras of Linux start with these: those with numbers, and links that stay the same.
const LINUX_CAMERAS: [&str; 2] = ["/dev/video", "/dev/v4l/"];

/// Reads the table `input` of a camera, if it is given.
pub(super) fn read_settings(camera: &Table) -> Option<VideoSettings> {
    camera.section(
        "input",
        "How a video is opened. Only for `video`.",
        |table| {
            let format = table
                .key(
                    "format",
                    "Interface to a device (`v4l2` on Linux, `libdc1394` for FireWire, `dshow` on Windows, `avfoundation` on macOS), or format of a file or stream that is not recognised by itself.",
                )
                .depends("`v4l2` for `/dev/video...` and `/dev/v4l/...`, otherwise recognised")
                .optional::<VideoFormat>();
            let pixel_format = table
                .key(
                    "pixel_format",
                    "Pixel format that a device is asked for, or that of `rawvideo`, by ffmpeg's name, such as `\"yuyv422\"`.",
                )
                .depends("that of the device")
                .optional::<String>();
            let is_name = |name: &String| {
                name.chars().all(|c| c.is_ascii_alphanumeric() || c == '_') && !name.is_empty()
            };
            if pixel_format.as_ref().is_some_and(|name| !is_name(name)) {
                table.reject("pixel_format", "a name of letters, digits and underscores");
            }
            let codec = table
                .key(
                    "codec",
                    "Compression that a device of `v4l2` or `dshow` is asked for.",
                )
                .depends("that of the device")
                .optional::<DeviceCodec>();
            Some(VideoSettings {
                format,
                fps: None,
                size_px: None,
                pixel_format,
                codec,
                rtsp_transport: table
                    .key("rtsp_transport", "What carries the frames of an RTSP stream.")
                    .depends("as the camera prefers")
                    .optional(),
                start_s: table
                    .key("start_s", "How much of a file to skip, from its first frame.")
                    .within(0.0..=1e9)
                    .depends("nothing")
                    .optional(),
                duration_s: table
                    .key("duration_s", "How much to read.")
                    .within(above(0.0, 1e9))
                    .depends("everything")
                    .optional(),
                hardware: table
                    .key("hardware", "Decode with this hardware; `auto` picks one that is there.")
                    .depends("none")
                    .optional(),
                deinterlace: table
                    .key(
                        "deinterlace",
                        "Keep the lines of the first field of each frame and interpolate the others. For interlaced video, such as from capture cards, whose moving edges look like combs.",
                    )
                    .depends("`true` for files marked as interlaced, otherwise `false`")
                    .optional(),
                timeout_s: table
                    .key(
                        "timeout_s",
                        "How long to wait for the first frame of a device, stream or pipe.",
                    )
                    .within(above(0.0, 1e6))
                    .depends("20")
                    .optional(),
                reopen_s: table
                    .key(
                        "reopen_s",
                        "How long to try to open a device or stream again that has ended, failed or given no frame for `timeout_s`; 0 for never.",
                    )
                    .within(0.0..=1e9)
                    .depends("60 for devices, `rtsp`, `rtp`, `udp` and the format `mpjpeg`; 0 for others of `tcp`, `http` and `https`, which may have an end")
                    .optional(),
                real_time: table
                    .key(
                        "real_time",
                        "Read a file at the rate of its time stamps, as if it were live.",
                    )
                    .or(false),
                when_behind: table
                    .key(
                        "when_behind",
                        "What happens while tracking is slower than a live source: `drop` leaves out the oldest frames that wait, so that estimates stay current; `wait` uses all, and the sender waits or loses some.",
                    )
                    .depends("`drop` for devices, `rtsp`, `rtp`, `udp`, the format `mpjpeg` and `real_time`; `wait` for pipes, `tcp`, `http` and `https`, which may be recordings")
                    .optional(),
            })
        },
    )
}

/// Combines the keys `video`, `fps` and `input` of a camera; `None` after reporting a problem.
pub(super) fn combine(
    camera: &Table,
    video: &str,
    fps: Option<f64>,
    given: Option<VideoSettings>,
) -> Option<VideoInput> {
    let mut settings = given.unwrap_or_default();
    if settings.format.is_none() {
        settings.format = VideoInput::of_path(video).settings.format;
    }
    let format = settings.format;
    let place = place_of(video, format)
        .map_err(|message| camera.problem("video", message))
        .ok()?;
    let is_file = matches!(place, VideoPlace::File(_));
    let is_reopened = matches!(place, VideoPlace::Device(_) | VideoPlace::Address(..));
    let is_rtsp = matches!(place, VideoPlace::Address(Protocol::Rtsp, _));
    let takes_codec = matches!(format, Some(VideoFormat::V4l2 | VideoFormat::Dshow));
    let takes_pixels = format.is_some_and(VideoFormat::takes_pixels);
    let input = camera.peek("input");
    let mut fine = true;
    for (key, is_given, applies, to) in [
        ("start_s", settings.start_s.is_some(), is_file, "files"),
        ("real_time", settings.real_time, is_file, "files"),
        (
            "when_behind",
            settings.when_behind.is_some(),
            !is_file || settings.real_time,
            "devices, addresses, pipes, and files with real_time",
        ),
        (
            "reopen_s",
            settings.reopen_s.is_some(),
            is_reopened,
            "devices and addresses",
        ),
        (
            "rtsp_transport",
            settings.rtsp_transport.is_some(),
            is_rtsp,
            "addresses with rtsp://",
        ),
        (
            "codec",
            settings.codec.is_some(),
            takes_codec,
            "the formats v4l2 and dshow",
        ),
        (
            "pixel_format",
            settings.pixel_format.is_some(),
            takes_pixels,
            "devices and rawvideo",
        ),
    ] {
        if let Some(input) = &input
            && is_given
            && !applies
        {
            input.problem(key, format!("applies to {to} only; remove it"));
            fine = false;
        }
    }
    if fps.is_some() && !format.is_some_and(VideoFormat::takes_fps) {
        camera.problem(
            "fps",
            "applies to folders of images, and to videos whose input.format is a device, rawvideo, mjpeg, h264 or hevc; \
             others have time stamps; remove it",
        );
        fine = false;
    }
    if let Some(format) = format
        && format.takes_fps()
        && !format.is_device()
        && fps.is_none()
    {
        let message = format!("is missing; {} has no time stamps", format.name());
        camera.problem("fps", message);
        fine = false;
    }
    if format == Some(VideoFormat::Rawvideo)
        && settings.pixel_format.is_none()
        && let Some(input) = &input
    {
        input.problem("pixel_format", "is missing; rawvideo does not state it");
        fine = false;
    }
    settings.fps = fps;
    fine.then_some(VideoInput { place, settings })
}

/// Asks a device for images of the camera's size, which raw video does not state.
pub(super) fn set_size_px(camera: &Table, settings: &mut VideoSettings, size_px: Option<[f64; 2]>) {
    if !settings.format.is_some_and(VideoFormat::takes_pixels) {
        return;
    }
    settings.size_px = size_px.map(|size_px| size_px.map(|side| side as usize));
    if size_px.is_none() && settings.format == Some(VideoFormat::Rawvideo) {
        camera.problem("size_px", "is missing; rawvideo does not state it");
    }
}

/// Names of the standard input as a file. ffmpeg would open its own, which is empty.
const STANDARD_INPUT_FILES: [&str; 3] = ["/dev/stdin", "/dev/fd/0", "/proc/self/fd/0"];

/// Interprets the key `video`; fails with a message if it is not allowed.
fn place_of(video: &str, format: Option<VideoFormat>) -> Result<VideoPlace, String> {
    if video.chars().any(char::is_control) {
        return Err("contains a control character; remove it".to_owned());
    }
    if format.is_some_and(VideoFormat::is_device) {
        return Ok(VideoPlace::Device(video.to_owned()));
    }
    if video == "-" {
        return Ok(VideoPlace::StandardInput);
    }
    if STANDARD_INPUT_FILES.contains(&video) {
        return Err("is standard input; write \"-\" for it".to_owned());
    }
    let Some((scheme, rest)) = video.split_once("://") else {
        return Ok(VideoPlace::File(video.to_owned()));
    };
    let found = Protocol::WORDS.iter().find(|(word, _)| *word == scheme);
    let Some(&(_, protocol)) = found else {
        let words: Vec<_> = Protocol::WORDS.iter().map(|(word, _)| *word).collect();
        return Err(format!(
            "has the protocol {scheme}; allowed: {}, or the path of a file",
            words.join(", ")
        ));
    };
    // ffmpeg would wait for frames all the same. The other protocols have a usual port.
    let needs_port = matches!(protocol, Protocol::Udp | Protocol::Rtp | Protocol::Tcp);
    if needs_port && !has_port(rest) {
        return Err(format!("has no port; give {scheme}://HOST:PORT"));
    }
    Ok(VideoPlace::Address(protocol, video.to_owned()))
}

/// Reports whether an address, without its protocol, has a port.
fn has_port(address: &str) -> bool {
    let end = address.find(['/', '?']).unwrap_or(address.len());
    let port = address[..end].rsplit_once(':').map(|(_, port)| port);
    port.is_some_and(|port| port.parse::<u16>().is_ok_and(|port| port > 0))
}
