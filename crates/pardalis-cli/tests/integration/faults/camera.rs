//! Cameras whose every byte a test decides: streams as ffmpeg writes them, and programs that stand in for ffmpeg.

use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::Path;
use std::process::{Child, Command, Stdio};

use pardalis_images::decode;
use serde_json::Value;

use crate::common::{Run, Workplace, frame_file, scene_with};

/// Width and height of the frames of [`ball`] in pixels.
pub(super) const SIZE_PX: (usize, usize) = (640, 480);

/// ffmpeg adds this to all time stamps, in seconds, as the program asks it to.
const OFFSET_S: i64 = 1 << 20;

/// Ticks a second.
const RATE: i64 = 9_000_000;

/// A frame without a time stamp has that of the last one and this, in seconds, as the program asks for.
pub(super) const MISSING_S: f64 = 1024.0 / RATE as f64;

/// Number of low bits of a short time stamp; all are written in full.
const SHORT_BITS: u32 = 7;

/// A stream of RGB frames in NUT, the container that ffmpeg writes for the program and that it also reads.
pub(super) struct Stream {
    pub(super) bytes: Vec<u8>,
}

impl Stream {
    /// Begins a stream as ffmpeg writes it, of frames of this width and height in pixels.
    pub(super) fn of(size_px: (usize, usize)) -> Self {
        let mut bytes = b"nut/multimedia container\0".to_vec();
        let mut main = Vec::new();
        // Version, streams, longest distance of frames, time bases.
        for value in [3, 1, 1 << 16, 1, 1, RATE as u64] {
            number(&mut main, value);
        }
        // One entry for all first bytes of frames: flags follow.
        for value in [4096, 6, 0, 1, 0, 0, 0, 255, 0] {
            number(&mut main, value);
        }
        packet(&mut bytes, 0x4E4D_7A56_1F5F_04AD, main);
        let mut stream = Vec::new();
        for value in [0, 0, 4] {
            number(&mut stream, value);
        }
        stream.extend(b"RGB\x18");
        let (width, height) = (size_px.0 as u64, size_px.1 as u64);
        for value in [
            0,
            SHORT_BITS as u64,
            1 << 20,
            0,
            0,
            0,
            width,
            height,
            0,
            0,
            0,
        ] {
            number(&mut stream, value);
        }
        packet(&mut bytes, 0x4E53_1140_5BF2_F9DB, stream);
        Self { bytes }
    }

    /// Adds a frame of any number of bytes at this time in seconds.
    pub(super) fn frame(mut self, time_s: f64, rgb: &[u8]) -> Self {
        write_frame(&mut self.bytes, OFFSET_S as f64 + time_s, rgb);
        self
    }

    /// Adds the frames of [`ball`] from this one on, 25 a second, beginning at this time in seconds.
    pub(super) fn ball(mut self, images: &[Vec<u8>], first_s: f64) -> Self {
        for (number, image) in images.iter().enumerate() {
            self = self.frame(first_s + 0.04 * number as f64, image);
        }
        self
    }

    /// Adds any bytes.
    pub(super) fn raw(mut self, bytes: &[u8]) -> Self {
        self.bytes.extend(bytes);
        self
    }
}

/// Writes a frame with its time in seconds from zero.
pub(super) fn write_frame(bytes: &mut Vec<u8>, time_s: f64, rgb: &[u8]) {
    let ticks = (time_s * RATE as f64).round() as u64;
    let mut sync = Vec::new();
    for value in [ticks, 0] {
        number(&mut sync, value);
    }
    packet(bytes, 0x4E4B_E4AD_EECA_4569, sync);
    // A key frame with its time, its length and a checksum of the header, which readers skip.
    bytes.push(0);
    for value in [1 | 8 | 32 | 64, ticks + (1 << SHORT_BITS), rgb.len() as u64] {
        number(bytes, value);
    }
    bytes.extend([0; 4]);
    bytes.extend(rgb);
}

fn packet(bytes: &mut Vec<u8>, code: u64, body: Vec<u8>) {
    bytes.extend(code.to_be_bytes());
    number(bytes, body.len() as u64 + 4);
    bytes.extend(&body);
    bytes.extend(checksum(&body).to_be_bytes());
}

/// Returns the CRC-32 of NUT: highest bit first, from zero, not inverted.
fn checksum(bytes: &[u8]) -> u32 {
    bytes.iter().fold(0, |crc: u32, byte| {
        (0..8).fold(crc ^ u32::from(*byte) << 24, |crc, _| {
            crc << 1 ^ if crc >> 31 == 1 { 0x04C1_1DB7 } else { 0 }
        })
    })
}

/// Writes a number: seven bits a byte, highest first.
fn number(bytes: &mut Vec<u8>, value: u64) {
    let groups = (u64::BITS - value.leading_zeros()).div_ceil(7).max(1);
    for group in (0..groups).rev() {
        let more = if group > 0 { 0x80 } else { 0 };
        bytes.push((value >> (7 * group)) as u8 & 0x7F | more);
    }
}

/// Returns the first frames of data/dioptric-jump, in which a ball is thrown, as RGB.
pub(super) fn ball(count: usize) -> Vec<Vec<u8>> {
    let image = |number| decode(&fs::read(frame_file(number)).unwrap()).unwrap();
    (0..count).map(|number| image(number).into_raw()).collect()
}

/// Connects a camera: what its next opening delivers, and nothing after the last one.
const NEXT_STREAM: &str = r#"[ -e "$camera.$opened" ] || { echo '[error] unplugged' >&2; exit 1; }
exec cat "$camera.$opened""#;

/// A scene of one or more cameras that a stand-in for ffmpeg delivers.
pub(super) struct Cameras {
    pub(super) place: Workplace,
    /// Number of cameras.
    count: usize,
    /// Further settings of each camera.
    settings: String,
}

impl Cameras {
    /// Creates this many cameras, cam1, cam2 and so on, with these settings. Their streams are those of [`Cameras::opening`].
    pub(super) fn new(count: usize, settings: &str) -> Self {
        Self::with_script(count, settings, NEXT_STREAM)
    }

    /// Creates cameras each opening of which runs a shell script instead of ffmpeg. In it, `$camera` is the name of the
    /// camera and `$opened` how often it has been opened.
    pub(super) fn with_script(count: usize, settings: &str, script: &str) -> Self {
        let place = Workplace::with_frames(0);
        stand_in(&place, script);
        Self {
            place,
            count,
            settings: settings.to_owned(),
        }
    }

    /// Decides what the opening of this number, from 1, of a camera delivers.
    pub(super) fn opening(&self, camera: &str, number: usize, stream: Stream) {
        self.place
            .write(&format!("{camera}.{number}"), stream.bytes);
    }

    /// Returns the scene, whose target is the thrown ball.
    pub(super) fn scene(&self) -> String {
        let source = |number: usize| {
            let settings = &self.settings;
            // All frames come at once.
            format!(
                "video = \"udp://lab:5000/cam{number}\"\ninput.when_behind = \"wait\"\n{settings}"
            )
        };
        let mut scene = scene_with("images = \"images\"\nfps = 25", &source(1));
        let rest = scene.find("model.").unwrap();
        let targets = scene.find("[targets").unwrap();
        let camera = scene[rest..targets].to_owned();
        for number in (2..=self.count).rev() {
            // A millimetre beside the one before.
            let camera = camera.replacen("-1, 0, 0]", &format!("-1, 0, 0.{number:03}]"), 1);
            let table = format!("[cameras.cam{number}]\n{}\n{camera}", source(number));
            scene.insert_str(targets, &table);
        }
        scene
    }

    /// Returns the scene of the first camera with a file in its place.
    pub(super) fn scene_of_file(&self, name: &str) -> String {
        let live = "\"udp://lab:5000/cam1\"\ninput.when_behind = \"wait\"";
        self.scene().replace(live, &format!("\"{name}\""))
    }

    /// Returns the command that tracks a scene with the stand-in for ffmpeg, with results in the folder `out`.
    pub(super) fn command(&self, scene: String) -> Command {
        let command = self.place.command(scene, &["-o", "out", "--no-plots"]);
        with_stand_in(&self.place, command)
    }

    /// Tracks the scene of the cameras.
    pub(super) fn track(&self) -> Run {
        self.track_scene(self.scene())
    }

    /// Tracks another scene.
    pub(super) fn track_scene(&self, scene: String) -> Run {
        Run::of(&mut self.command(scene))
    }

    /// Starts to track another scene.
    pub(super) fn start(&self, scene: String) -> Child {
        let mut command = self.command(scene);
        let command = command.stdout(Stdio::piped()).stderr(Stdio::piped());
        command.spawn().unwrap()
    }

    /// Returns the times of the rows in seconds, after checking that all rows are whole.
    pub(super) fn times_s(&self) -> Vec<f64> {
        let rows = self.place.rows();
        rows.iter().map(|row| row[1].parse().unwrap()).collect()
    }

    /// Returns what the summary says about a camera.
    pub(super) fn summary(&self, camera: &str) -> Value {
        let text = fs::read(self.place.path("out/summary.json")).unwrap();
        let summary: Value = serde_json::from_slice(&text).unwrap();
        summary["cameras"][camera].clone()
    }
}

/// Puts programs into the folder `bin` that stand in for ffmpeg and ffprobe.
pub(super) fn stand_in(place: &Workplace, script: &str) {
    fs::create_dir(place.path("bin")).unwrap();
    let colors = "[showinfo@pardalis @ 0] [info]";
    let ffmpeg = format!(
        "#!/bin/sh
case \"$*\" in *'-h long'*) echo ' -fps_mode'; exit;; esac
for word; do if [ \"$before\" = -i ]; then input=$word; fi; before=$word; done
camera=${{input##*[:/]}}
read -r opened 2>/dev/null < \"$camera.opened\" || opened=0
opened=$((opened + 1))
echo $opened > \"$camera.opened\"
echo '{colors} n: 0 pts: 0 fmt:rgb24 s:640x480' >&2
echo '{colors} color_range:pc color_space:gbr color_primaries:unknown' >&2
{script}
"
    );
    runnable(&place.path("bin/ffmpeg"), &ffmpeg);
    let stream = r#"{"streams": [{"codec_name": "rawvideo", "width": 640, "height": 480, "pix_fmt": "rgb24", "time_base": "1/9000000"}],
"format": {"format_name": "nut"}}"#;
    let ffprobe = format!("#!/bin/sh\nif [ -e probe ]; then . ./probe; fi\necho '{stream}'\n");
    runnable(&place.path("bin/ffprobe"), &ffprobe);
}

fn runnable(path: &Path, script: &str) {
    fs::write(path, script).unwrap();
    fs::set_permissions(path, fs::Permissions::from_mode(0o755)).unwrap();
}

/// Lets a command find the programs of [`stand_in`] first.
pub(super) fn with_stand_in(place: &Workplace, mut command: Command) -> Command {
    let path = std::env::var("PATH").unwrap_or_default();
    let bin = place.path("bin");
    command.env("PATH", format!("{}:{path}", bin.display()));
    command
}
