//! The soak: two cameras far faster than real time through the whole program, with faults at random, while memory, handles,
//! threads and the delay of estimates are watched. `scripts/soak` runs it for long.
#![expect(
    clippy::disallowed_methods,
    reason = "cameras have the clock of this computer, and a soak lasts for a time"
)]

use std::collections::BTreeMap;
use std::fs::{self, File, OpenOptions};
use std::io::Write;
use std::net::{TcpListener, TcpStream, UdpSocket};
use std::os::unix::fs::OpenOptionsExt;
use std::path::PathBuf;
use std::process::{Child, Command, Stdio};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::mpsc::sync_channel;
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant};

use super::camera::{Stream, stand_in, with_stand_in, write_frame};
use super::process::{Usage, usage};
use crate::common::run::interrupt;
use crate::common::{Run, Workplace, rows_in};

/// Width and height of the images in pixels.
const SIZE_PX: (usize, usize) = (240, 180);

/// Simulated images of each camera, which repeat, and how long they last in seconds.
const IMAGES: usize = 100;
const PERIOD_S: f64 = 2.0;

/// A ball that goes round in two seconds, seen by two cameras.
const WORLD: &str = r"seed = 5
duration_s = 2.0
training_stills = 6
[ring]
count = 2
center_m = [0.5, 0.5, 0.15]
radius_m = 0.6
height_m = 0.3
size_px = [240, 180]
model.pinhole = { f_px = [250, 250], center_px = [119.5, 89.5] }
[timing]
fps = 50
[image]
samples = 3
blur_px = 0.6
read_noise = 2.0
[ground]
texture.noise = { size_m = 0.2, octaves = 4, colors_srgb = [[120, 95, 70], [175, 150, 115]] }
[objects.ball]
target = true
shape.sphere.radius_m = 0.035
color_srgb = [225, 70, 130]
path.circle = { center_m = [0.5, 0.5, 0.15], radius_m = 0.12, period_s = 2 }
";

/// Images that cameras of 25 images per second give in an hour.
const IMAGES_IN_AN_HOUR: usize = 25 * 3600;

/// Images of each camera between two looks at memory, handles and threads.
const LOOK_IMAGES: usize = 100;

/// How long a thread waits before it looks whether the soak has ended.
const POLL: Duration = Duration::from_millis(100);

/// Frames that a camera must have delivered without a fault before handles and threads count.
const CALM_FRAMES: usize = 100;

/// What carries the frames from a camera to ffmpeg.
enum Wire {
    /// A pipe that the stand-in for ffmpeg reads.
    Pipe(PathBuf),
    /// A server to which the installed ffmpeg connects.
    Tcp(TcpListener),
}

impl Wire {
    /// Connects if something waits at the other end.
    fn connect(&self) -> Option<Box<dyn Write + Send>> {
        match self {
            Self::Pipe(path) => {
                // Opening a pipe without a reader would wait for one.
                const NONBLOCK: i32 = 0o4000;
                let look = OpenOptions::new()
                    .write(true)
                    .custom_flags(NONBLOCK)
                    .open(path);
                let _open = look.ok()?;
                Some(Box::new(OpenOptions::new().write(true).open(path).ok()?))
            }
            Self::Tcp(listener) => {
                let (connection, _): (TcpStream, _) = listener.accept().ok()?;
                connection.set_nonblocking(false).ok()?;
                Some(Box::new(connection))
            }
        }
    }
}

/// The faults of cameras.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Fault {
    Stops,
    StopsWithinAFrame,
    StaysAway,
    FallsSilent,
    SendsGarbage,
    ChangesSize,
    JumpsInTime,
    Freezes,
    Tears,
}

const FAULTS: [Fault; 9] = [
    Fault::Stops,
    Fault::StopsWithinAFrame,
    Fault::StaysAway,
    Fault::FallsSilent,
    Fault::SendsGarbage,
    Fault::ChangesSize,
    Fault::JumpsInTime,
    Fault::Freezes,
    Fault::Tears,
];

/// A camera with its faults.
struct Camera {
    wire: Wire,
    images: Vec<Vec<u8>>,
    connection: Option<Box<dyn Write + Send>>,
    random: Random,
    /// Frames until the next fault.
    until_fault: usize,
    /// Frames since the last fault ended.
    calm_frames: Arc<AtomicUsize>,
    /// Until when it does not connect, stays silent, or freezes.
    away_until: Option<Instant>,
    silent_until: Option<Instant>,
    frozen_frames: usize,
    last_image: Vec<u8>,
    /// How far its clock is wrong, in seconds.
    clock_s: f64,
    sent: usize,
    faults: BTreeMap<Fault, usize>,
    mean_frames_between_faults: usize,
}

impl Camera {
    /// Sends the frame of a time in seconds, unless a fault prevents it.
    fn send(&mut self, time_s: f64) {
        let now = Instant::now();
        if self.connection.is_none() {
            self.calm_frames.store(0, Ordering::Relaxed);
            if self.away_until.is_some_and(|until| now < until) {
                return;
            }
            let Some(mut connection) = self.wire.connect() else {
                return;
            };
            if connection.write_all(&Stream::of(SIZE_PX).bytes).is_err() {
                return;
            }
            self.connection = Some(connection);
        }
        if self.silent_until.is_some_and(|until| now < until) {
            return;
        }
        let mut image = self.images[(time_s / PERIOD_S * IMAGES as f64) as usize % IMAGES].clone();
        // No two images are equal, as those of a real camera.
        for (byte, value) in image.iter_mut().zip(self.sent.to_le_bytes()) {
            *byte = value;
        }
        let fault = (self.until_fault == 0).then(|| self.next_fault());
        self.until_fault = self.until_fault.saturating_sub(1);
        let mut bytes = Vec::new();
        if self.frozen_frames > 0 {
            self.frozen_frames -= 1;
            image.clone_from(&self.last_image);
        }
        let mut ends = false;
        match fault {
            Some(Fault::Stops | Fault::StopsWithinAFrame) => ends = true,
            Some(Fault::StaysAway) => {
                ends = true;
                self.away_until = Some(now + Duration::from_secs(3));
            }
            Some(Fault::FallsSilent) => self.silent_until = Some(now + Duration::from_secs(3)),
            Some(Fault::SendsGarbage) => {
                bytes.extend((0..50_000).map(|_| self.random.next() as u8));
            }
            Some(Fault::ChangesSize) => image.truncate(1000),
            Some(Fault::JumpsInTime) => {
                self.clock_s += if self.random.below(2) == 0 {
                    1000.0
                } else {
                    -300.0
                }
            }
            Some(Fault::Freezes) => self.frozen_frames = 30,
            Some(Fault::Tears) => {
                let from = self.random.below(image.len());
                let other = &self.images[self.random.below(IMAGES)];
                image[from..].copy_from_slice(&other[from..]);
            }
            None => drop(self.calm_frames.fetch_add(1, Ordering::Relaxed)),
        }
        // Early enough that no clock is before zero.
        write_frame(&mut bytes, 1e6 + self.clock_s + time_s, &image);
        if fault == Some(Fault::StopsWithinAFrame) {
            bytes.truncate(bytes.len() / 2);
        }
        self.sent += 1;
        self.last_image = image;
        if self
            .connection
            .as_mut()
            .is_some_and(|wire| wire.write_all(&bytes).is_err())
            || ends
        {
            self.connection = None;
        }
    }

    fn next_fault(&mut self) -> Fault {
        let fault = FAULTS[self.random.below(FAULTS.len())];
        *self.faults.entry(fault).or_default() += 1;
        let mean = self.mean_frames_between_faults;
        self.until_fault = mean / 2 + self.random.below(mean);
        self.calm_frames.store(0, Ordering::Relaxed);
        fault
    }
}

/// Random numbers by SplitMix64.
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mixed = (self.0 ^ self.0 >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        let mixed = (mixed ^ mixed >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
        mixed ^ mixed >> 31
    }

    fn below(&mut self, limit: usize) -> usize {
        (self.next() % limit as u64) as usize
    }
}

/// How long and how hard.
struct Settings {
    seed: u64,
    /// Images of each camera.
    images: usize,
    /// The time between two of them.
    interval: Duration,
    mean_frames_between_faults: usize,
    /// Whether the installed ffmpeg reads the cameras, and not a stand-in.
    ffmpeg: bool,
}

/// What was seen.
struct Report {
    run: Run,
    /// What it wrote to standard error.
    errors: String,
    seconds: f64,
    /// Seconds since the start and the use at that time, while no fault was about.
    calm: Vec<(f64, Usage)>,
    /// The same at any time.
    all: Vec<(f64, Usage)>,
    /// How old each estimate was when it was sent, in seconds.
    delays_s: Vec<f32>,
    faults: BTreeMap<Fault, usize>,
    place: Workplace,
}

/// Renders the images and writes the scene; returns the images of each camera as RGB.
fn simulate(place: &Workplace) -> Vec<Vec<Vec<u8>>> {
    place.write("world.toml", WORLD);
    let program = env!("CARGO_BIN_EXE_pardalis");
    let mut command = Command::new(program);
    let command = command.args(["simulate", "world.toml", "-o", "world"]);
    let run = Run::of(command.current_dir(place.path("")));
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    let folder = |camera| place.path(&format!("world/frames/cam{camera}"));
    let images = |camera| {
        let mut files: Vec<_> = fs::read_dir(folder(camera))
            .unwrap()
            .map(|entry| entry.unwrap().path())
            .collect();
        files.retain(|path| path.extension().is_some_and(|ending| ending != "csv"));
        files.sort();
        assert_eq!(files.len(), IMAGES);
        let image = |path: &PathBuf| {
            pardalis_images::decode(&fs::read(path).unwrap())
                .unwrap()
                .into_raw()
        };
        files.iter().map(image).collect()
    };
    (1..=2).map(images).collect()
}

/// Creates the cameras and the scene that tracks them.
fn cameras(place: &Workplace, settings: &Settings) -> Vec<Camera> {
    let images = simulate(place);
    let mut scene = fs::read_to_string(place.path("world/scene.toml")).unwrap();
    let mut cameras = Vec::new();
    for (number, images) in images.into_iter().enumerate() {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let port = listener.local_addr().unwrap().port();
        let wire = if settings.ffmpeg {
            listener.set_nonblocking(true).unwrap();
            Wire::Tcp(listener)
        } else {
            let pipe = place.path(&format!("{port}.pipe"));
            let made = Command::new("mkfifo").arg(&pipe).status();
            assert!(made.unwrap().success());
            Wire::Pipe(pipe)
        };
        let images_line = format!("images = \"frames/cam{}\"", number + 1);
        let source = format!(
            "video = \"tcp://127.0.0.1:{port}\"\ninput = {{ timeout_s = 2, reopen_s = 60, when_behind = \"drop\" }}"
        );
        assert!(scene.contains(&images_line), "{scene}");
        scene = scene.replace(&images_line, &source);
        cameras.push(Camera {
            wire,
            last_image: images[0].clone(),
            images,
            connection: None,
            random: Random(settings.seed << 8 | number as u64),
            until_fault: settings.mean_frames_between_faults / (number + 1),
            calm_frames: Arc::default(),
            away_until: None,
            silent_until: None,
            frozen_frames: 0,
            clock_s: 0.0,
            sent: 0,
            faults: BTreeMap::new(),
            mean_frames_between_faults: settings.mean_frames_between_faults,
        });
    }
    scene += "\n[timing]\nmax_delay_s = 0.003\n";
    place.write("world/live.toml", scene);
    if !settings.ffmpeg {
        stand_in(place, "exec cat \"$camera.pipe\"");
    }
    cameras
}

/// Starts the program on the cameras.
fn start(place: &Workplace, settings: &Settings, receiver: &UdpSocket) -> Child {
    let mut command = Command::new(env!("CARGO_BIN_EXE_pardalis"));
    command.args(["track", "world/live.toml", "-o", "out", "--threads", "2"]);
    let to = receiver.local_addr().unwrap();
    command.args(["--send", &format!("udp://{to}")]);
    command.current_dir(place.path(""));
    if !settings.ffmpeg {
        command = with_stand_in(place, command);
    }
    let errors = File::create(place.path("errors")).unwrap();
    command
        .stdout(Stdio::piped())
        .stderr(errors)
        .spawn()
        .unwrap()
}

/// Starts a thread that receives the estimates until the soak has ended. It returns how old each was when it was sent, in seconds.
fn receive(receiver: UdpSocket, has_ended: Arc<AtomicBool>) -> JoinHandle<Vec<f32>> {
    receiver.set_read_timeout(Some(POLL)).unwrap();
    thread::spawn(move || {
        let mut delays_s = Vec::new();
        let mut bytes = [0; 4096];
        while !has_ended.load(Ordering::Relaxed) {
            let Ok(length) = receiver.recv(&mut bytes) else {
                continue;
            };
            let line: serde_json::Value = serde_json::from_slice(&bytes[..length]).unwrap();
            let second = |key: &str| line[key].as_f64().unwrap();
            delays_s.push((second("sent_unix_s") - second("captured_unix_s")) as f32);
        }
        delays_s
    })
}

/// Runs the soak: both cameras take images at a constant rate.
fn soak(settings: &Settings) -> Report {
    let place = Workplace::with_frames(0);
    let cameras = cameras(&place, settings);
    let calm_frames: Vec<_> = cameras
        .iter()
        .map(|camera| Arc::clone(&camera.calm_frames))
        .collect();
    let receiver = UdpSocket::bind("127.0.0.1:0").unwrap();
    let mut program = start(&place, settings, &receiver);
    let has_ended = Arc::new(AtomicBool::new(false));
    let delays_s = receive(receiver, Arc::clone(&has_ended));
    let begin = Instant::now();
    let (mut calm, mut all) = (Vec::new(), Vec::new());
    // A camera that nobody reads must not stop the other one.
    let (senders, threads): (Vec<_>, Vec<_>) = cameras
        .into_iter()
        .map(|mut camera| {
            let (sender, times_s) = sync_channel(4);
            let thread = thread::spawn(move || {
                for time_s in times_s {
                    camera.send(time_s);
                }
                camera.faults
            });
            (sender, thread)
        })
        .unzip();
    for image in 0..settings.images {
        let time_s = image as f64 * settings.interval.as_secs_f64();
        thread::sleep(Duration::from_secs_f64(time_s).saturating_sub(begin.elapsed()));
        for sender in &senders {
            // A full queue loses the image, as a camera does.
            let _ = sender.try_send(time_s);
        }
        if image % LOOK_IMAGES == 0 {
            let Some(usage) = usage(program.id()) else {
                break;
            };
            let now_s = begin.elapsed().as_secs_f64();
            all.push((now_s, usage));
            if calm_frames
                .iter()
                .all(|frames| frames.load(Ordering::Relaxed) >= CALM_FRAMES)
            {
                calm.push((now_s, usage));
            }
        }
    }
    let seconds = begin.elapsed().as_secs_f64();
    let run = match program.try_wait().unwrap() {
        Some(_) => Run::from(program.wait_with_output().unwrap()),
        None => interrupt(program),
    };
    has_ended.store(true, Ordering::Relaxed);
    let errors = fs::read_to_string(place.path("errors")).unwrap();
    drop(senders);
    let mut faults = BTreeMap::new();
    for (fault, count) in threads
        .into_iter()
        .flat_map(|thread| thread.join().unwrap())
    {
        *faults.entry(fault).or_default() += count;
    }
    Report {
        run,
        errors,
        seconds,
        calm,
        all,
        delays_s: delays_s.join().unwrap(),
        faults,
        place,
    }
}

impl Report {
    /// Checks what holds for a soak of any length: it ends regularly, rows are whole and in order, estimates are sent, and memory, handles and
    /// threads do not grow after the first `first_s` seconds.
    fn check(&self, first_s: f64) {
        assert!(!self.all.is_empty(), "{}", self.errors);
        assert_eq!(self.run.code, Some(0), "{}", self.errors);
        assert!(!self.errors.contains("panicked"), "{}", self.errors);
        let text = fs::read_to_string(self.place.path("out/tracks.csv")).unwrap();
        let rows = rows_in(&text);
        assert!(
            2 * self.delays_s.len() > rows.len() && self.delays_s.len() <= rows.len(),
            "{} sent of {}",
            self.delays_s.len(),
            rows.len()
        );
        assert!(
            rows.iter()
                .enumerate()
                .all(|(number, row)| row[0] == number.to_string())
        );
        let times_s: Vec<f64> = rows.iter().map(|row| row[1].parse().unwrap()).collect();
        assert!(times_s.is_sorted());
        let tracked = rows.iter().filter(|row| row[3] == "tracking").count();
        assert!(2 * tracked > rows.len(), "{tracked} of {}", rows.len());
        let (before, after) = self.memory_kib(first_s);
        assert!(
            after < before + 5 * 1024,
            "memory grew from {before} to {after} KiB"
        );
        let counts = |count: fn(&Usage) -> usize| {
            let mut counts: Vec<_> = self.calm.iter().map(|(_, usage)| count(usage)).collect();
            counts.sort_unstable();
            counts.dedup();
            counts
        };
        assert_eq!(counts(|usage| usage.handles).len(), 1, "{:?}", self.calm);
        assert_eq!(counts(|usage| usage.threads).len(), 1, "{:?}", self.calm);
    }

    /// Returns the most memory in the first part of the time and after it, in KiB.
    fn memory_kib(&self, first_s: f64) -> (u64, u64) {
        let most = |is_first: bool| {
            let part = self
                .all
                .iter()
                .filter(|(now_s, _)| (*now_s < first_s) == is_first);
            part.map(|(_, usage)| usage.memory_kib).max().unwrap_or(0)
        };
        (most(true), most(false))
    }

    /// Prints the figures.
    fn print(&self, settings: &Settings, first_s: f64) {
        let (before, after) = self.memory_kib(first_s);
        println!(
            "seed: {}; ffmpeg: {}",
            settings.seed,
            if settings.ffmpeg {
                "installed"
            } else {
                "stand-in"
            }
        );
        println!(
            "images of each camera: {} in {:.0} s, {:.2} hours at 25 per second",
            settings.images,
            self.seconds,
            settings.images as f64 / IMAGES_IN_AN_HOUR as f64
        );
        println!(
            "faults: {} {:?}",
            self.faults.values().sum::<usize>(),
            self.faults
        );
        println!("memory: at most {before} KiB in the first {first_s:.0} s, {after} KiB after");
        if let (Some((_, first)), Some((_, last))) = (self.calm.first(), self.calm.last()) {
            println!(
                "handles: {} to {}; threads: {} to {}",
                first.handles, last.handles, first.threads, last.threads
            );
        }
        let hour = IMAGES_IN_AN_HOUR.min(self.delays_s.len() / 2);
        let percentiles_ms = |delays_s: &[f32]| {
            let mut sorted = delays_s.to_vec();
            sorted.sort_by(f32::total_cmp);
            [50, 99].map(|percent| 1e3 * sorted[(sorted.len() - 1) * percent / 100])
        };
        let [first_median, first] = percentiles_ms(&self.delays_s[..hour]);
        let [last_median, last] = percentiles_ms(&self.delays_s[self.delays_s.len() - hour..]);
        println!(
            "age of estimates when sent, first {hour}: median {first_median:.2} ms, p99 {first:.2} ms; last {hour}: median {last_median:.2} ms, p99 {last:.2} ms ({:+.1} %)",
            100.0 * (last / first - 1.0)
        );
        let summary = fs::read_to_string(self.place.path("out/summary.json")).unwrap();
        let summary: serde_json::Value = serde_json::from_str(&summary).unwrap();
        println!("summary: {}", summary["time"]);
        for camera in ["cam1", "cam2"] {
            let camera = &summary["cameras"][camera];
            println!(
                "  reopened {}, clock jumps {}, frames {}",
                camera["reopened"], camera["clock_jumps"], camera["frames"]
            );
        }
        println!("  {}", summary["targets"]["ball"]["rows"]);
    }
}

#[test]
fn memory_handles_and_threads_stay_as_they_are_whatever_cameras_do() {
    let settings = Settings {
        seed: 1,
        images: 5000,
        interval: Duration::from_millis(5),
        mean_frames_between_faults: 250,
        ffmpeg: false,
    };
    let report = soak(&settings);
    report.print(&settings, report.seconds / 3.0);
    report.check(report.seconds / 3.0);
    assert!(report.delays_s.len() >= 300, "{}", report.errors);
    assert!(
        report.faults.values().sum::<usize>() >= 3,
        "{:?}",
        report.faults
    );
}

#[test]
#[ignore = "soak: scripts/soak states for how long"]
fn soak_for_as_long_as_asked() {
    let number = |name: &str| std::env::var(name).ok()?.parse().ok();
    let Some(hours) = number("PARDALIS_SOAK_HOURS") else {
        println!("skipped: PARDALIS_SOAK_HOURS does not state for how long");
        return;
    };
    let settings = Settings {
        seed: number("PARDALIS_SOAK_SEED").unwrap_or(1),
        images: hours as usize * IMAGES_IN_AN_HOUR,
        interval: Duration::from_micros(2500),
        mean_frames_between_faults: 20_000,
        ffmpeg: Command::new("ffmpeg").arg("-version").output().is_ok(),
    };
    let report = soak(&settings);
    report.print(&settings, 60.0);
    report.check(60.0);
}
