//! The time from decoded images to estimates, step by step: median, 99th and 99.9th percentile and maximum, with default settings on one thread.
//!
//! `cargo bench -p pardalis --bench latency` prints a table; `-- NAME` measures the runs whose names contain it, `-- --steps 1000` fewer steps of each,
//! `-- --level baseline` without wider instructions.
//! Before a figure is printed, the estimates of the same steps must have been right: most of them within a bound of the truth.

#![allow(clippy::disallowed_methods)] // It measures time.

#[path = "../tests/integration/common/mod.rs"]
mod common;

use std::f64::consts::TAU;
use std::time::Instant;

use common::{data, detected_ball, fisheye_view, open};
use nalgebra::Vector3;
use pardalis::camera::Pinhole;
use pardalis::color::{ColorModel, YuvEncoding};
use pardalis::tracker::{DetectedSettings, TrackState};
use pardalis::view::View;
use pardalis::{CameraId, Frame, FrameSet, PixelFormat, Tracker};
use pardalis_camera::looking_at;
use pardalis_core::simd::Level;

/// Steps of each run, unless others are asked for.
const STEPS: usize = 10_000;
/// A run ends after the pass that exceeds this time, seconds.
const MOST_S: f64 = 20.0;

/// Cameras, targets, and the images of one pass with the true positions of the targets in each.
struct Run {
    name: String,
    images: String,
    views: Vec<View>,
    targets: Vec<DetectedSettings>,
    fps: f64,
    /// The images of all cameras at each instant.
    sets: Vec<Vec<Frame>>,
    /// The position of each target at each instant, metres; unordered if the targets look alike.
    truth_m: Vec<Vec<Vector3<f64>>>,
    /// Most estimates must be this close to a true position.
    bound_m: f64,
}

impl Run {
    /// Tracks pass after pass, each with a new tracker, and prints how long its steps took. The first three steps of each pass find the targets and are not counted.
    fn measure(&self, steps: usize, level: Level) {
        let mut times_us = Vec::with_capacity(steps);
        let (mut right, mut estimates) = (0, 0);
        let begun = Instant::now();
        while times_us.len() < steps && begun.elapsed().as_secs_f64() < MOST_S {
            let views = self.views.clone();
            let mut tracker = Tracker::new(views, self.targets.clone(), 1, level).unwrap();
            for (number, (set, truth_m)) in self.sets.iter().zip(&self.truth_m).enumerate() {
                let time_s = number as f64 / self.fps;
                let frames = set.iter().enumerate();
                let frames = frames.map(|(camera, frame)| {
                    (CameraId::new(camera), frame.with_time_s(time_s).unwrap())
                });
                let set = FrameSet::new(frames).unwrap();
                let started = Instant::now();
                tracker.observe(&set).unwrap();
                let found: Vec<_> = tracker
                    .targets()
                    .map(|target| tracker.estimate(target).unwrap())
                    .collect();
                let time_us = started.elapsed().as_secs_f64() * 1e6;
                if number < 3 || times_us.len() == steps {
                    continue;
                }
                times_us.push(time_us);
                for estimate in found {
                    estimates += 1;
                    let is_right = estimate.kinematics.is_some_and(|state| {
                        let here = Vector3::from(state.position_m);
                        let is_near =
                            |truth_m: &Vector3<f64>| (here - truth_m).norm() < self.bound_m;
                        estimate.state == TrackState::Tracking && truth_m.iter().any(is_near)
                    });
                    right += usize::from(is_right);
                }
            }
        }
        let Self { name, bound_m, .. } = self;
        assert!(
            10 * right >= 9 * estimates,
            "{name}: only {right} of {estimates} estimates are within {bound_m} m"
        );
        times_us.sort_unstable_by(f64::total_cmp);
        let count = times_us.len();
        let quantile = |share: f64| times_us[((count - 1) as f64 * share).round() as usize];
        println!(
            "{name},{},{},{count},{:.0},{:.0},{:.0},{:.0}",
            self.images,
            self.targets.len(),
            quantile(0.5),
            quantile(0.99),
            quantile(0.999),
            quantile(1.0)
        );
    }
}

/// The rows of a bundled sequence's truth: frame, object, camera and position.
fn truth(sequence: &str, objects: &[&str], frames: usize) -> Vec<Vec<Vector3<f64>>> {
    let table = std::fs::read_to_string(data(&format!("{sequence}/truth.csv"))).unwrap();
    let mut truth_m = vec![Vec::new(); frames];
    for row in table.lines().skip(1) {
        let row: Vec<&str> = row.split(',').collect();
        let frame: usize = row[0].parse().unwrap();
        if objects.contains(&row[2]) && row[3] == "cam1" {
            let position = [4, 5, 6].map(|column| row[column].parse().unwrap());
            truth_m[frame].push(Vector3::from(position));
        }
    }
    truth_m
}

fn rgb(picture: &pardalis_images::RgbImage) -> Frame {
    common::frame(picture, PixelFormat::Rgb8, YuvEncoding::default(), 0.0)
}

/// Balls of the same look before the fisheye camera.
fn fisheye(name: &str, sequence: &str, objects: &[&str], frames: usize) -> Run {
    let picture = |number| vec![rgb(&open(&format!("{sequence}/frames/{number:06}.jpg")))];
    Run {
        name: name.to_owned(),
        images: "1 of 640 x 480".to_owned(),
        views: vec![fisheye_view()],
        targets: objects.iter().map(|_| detected_ball()).collect(),
        fps: common::FPS,
        sets: (0..frames).map(picture).collect(),
        truth_m: truth(sequence, objects, frames),
        bound_m: 0.15,
    }
}

/// A ball before several webcams.
fn webcams(name: &str, cameras: usize, frames: usize) -> Run {
    let sequence = format!("webcams-{name}");
    let calibration = std::fs::read_to_string(data(&format!("{sequence}/cameras.json"))).unwrap();
    let calibrated = pardalis_camera::formats::read(&calibration, None).unwrap();
    let view = |camera: &pardalis_camera::CalibratedCamera| {
        let (pose, size) = (camera.world_from_camera.unwrap(), camera.size_px.unwrap());
        View::new(camera.camera.clone(), pose, size, None).unwrap()
    };
    let colors = std::fs::read_to_string(data("colors/pink-ball.hsi.colors.toml")).unwrap();
    let colors = ColorModel::from_text(&colors).unwrap();
    let pictures = |number: usize| {
        let picture = |camera| {
            rgb(&open(&format!(
                "{sequence}/frames/cam{camera}/{number:06}.jpg"
            )))
        };
        (1..=cameras).map(picture).collect()
    };
    Run {
        images: format!("{cameras} of 320 x 240"),
        views: calibrated.iter().map(view).collect(),
        targets: vec![DetectedSettings::ball(0.035, colors).unwrap()],
        fps: common::FPS,
        sets: (0..frames).map(pictures).collect(),
        truth_m: truth(&sequence, &["ball"], frames),
        bound_m: 0.005,
        name: sequence,
    }
}

/// The radius of drawn balls, metres.
const DRAWN_RADIUS_M: f64 = 0.1;
/// Instants of a pass over drawn images.
const DRAWN_INSTANTS: usize = 20;

/// Equal balls that circle in a plane before cameras on a ring, drawn as discs, all in view and none before another.
fn drawn(cameras: usize, [width, height]: [usize; 2], balls: usize) -> Run {
    let columns = (balls as f64).sqrt().ceil() as usize;
    let spacing_m = 6.0 * DRAWN_RADIUS_M;
    let at_m = |ball: usize, instant: usize| {
        let [i, j] =
            [ball % columns, ball / columns].map(|at| at as f64 - 0.5 * (columns - 1) as f64);
        let (sin, cos) = libm::sincos(TAU * instant as f64 / 40.0);
        Vector3::new(spacing_m * i + 0.08 * cos, spacing_m * j + 0.08 * sin, 0.0)
    };
    // A ball has a radius of a fiftieth of the image's width, or less if there are many.
    let distance_m = 4.0 + 1.6 * spacing_m * columns as f64;
    let focal_px = 0.8 * width as f64;
    let size = (width, height);
    let center_px = [0.5 * (width - 1) as f64, 0.5 * (height - 1) as f64];
    let lens = Pinhole::new([focal_px; 2], center_px, &[]).unwrap();
    let views: Vec<View> = (0..cameras)
        .map(|camera| {
            let (sin, cos) = libm::sincos(TAU * camera as f64 / cameras as f64);
            let from_m = Vector3::new(0.3 * distance_m * cos, 0.3 * distance_m * sin, distance_m);
            let pose = looking_at(from_m, Vector3::zeros(), 0.0).unwrap();
            View::new(lens, pose, size, None).unwrap()
        })
        .collect();
    let picture = |view: &View, instant: usize| {
        let discs: Vec<_> = (0..balls)
            .map(|ball| {
                let place = view.camera_from_world() * nalgebra::Point3::from(at_m(ball, instant));
                let pixel = view.camera().project(place.into()).unwrap();
                (pixel, focal_px * DRAWN_RADIUS_M / place.z)
            })
            .collect();
        disc_picture(size, &discs)
    };
    let (first, mask) = picture(&views[0], 0);
    let colors = ColorModel::from_image(&first, &mask).unwrap();
    let sets = (0..DRAWN_INSTANTS).map(|instant| {
        let frames = views.iter().map(|view| picture(view, instant).0);
        frames.collect()
    });
    let at_instant = |instant| (0..balls).map(|ball| at_m(ball, instant)).collect();
    Run {
        name: format!("drawn-{cameras}-cameras-{width}x{height}-{balls}-balls"),
        images: format!("{cameras} of {width} x {height}"),
        targets: (0..balls)
            .map(|_| DetectedSettings::ball(DRAWN_RADIUS_M, colors.clone()).unwrap())
            .collect(),
        fps: common::FPS,
        sets: sets.collect(),
        truth_m: (0..DRAWN_INSTANTS).map(at_instant).collect(),
        bound_m: 5.0 * DRAWN_RADIUS_M,
        views,
    }
}

/// Orange discs with soft edges before a grainy green ground, and which pixels show them.
fn disc_picture((width, height): (usize, usize), discs: &[([f64; 2], f64)]) -> (Frame, Vec<bool>) {
    let mut shares = vec![0.0_f64; width * height];
    for &([u, v], radius_px) in discs {
        let around = |at: f64, size: usize| {
            let least = (at - radius_px - 4.0).max(0.0) as usize;
            least..((at + radius_px + 5.0).max(0.0) as usize).min(size)
        };
        for y in around(v, height) {
            for x in around(u, width) {
                let off_px = libm::hypot(x as f64 - u, y as f64 - v) - radius_px;
                let share = &mut shares[y * width + x];
                *share = share.max(0.5 * libm::erfc(off_px));
            }
        }
    }
    let mut grain = 0.0;
    let mut bytes = Vec::with_capacity(3 * width * height);
    for (i, share) in shares.iter().enumerate() {
        grain = (0.618 * (i % width) as f64 + 0.382 * (i / width) as f64 + 7.3 * grain).fract();
        for (orange, green) in [(230.0, 60.0), (110.0, 110.0), (20.0, 70.0)] {
            bytes.push((green + share * (orange - green) + 24.0 * (grain - 0.5)) as u8);
        }
    }
    let encoding = YuvEncoding::default();
    let frame = Frame::new(PixelFormat::Rgb8, encoding, width, height, bytes, 0.0).unwrap();
    (frame, shares.iter().map(|&share| share > 0.5).collect())
}

/// A run by name, made only when it is asked for.
type Named = (String, Box<dyn Fn() -> Run>);

fn runs() -> Vec<Named> {
    let mut runs: Vec<Named> = vec![
        (
            "fisheye".to_owned(),
            Box::new(|| fisheye("fisheye", "dioptric-jump", &["ball"], 110)),
        ),
        (
            "two-balls".to_owned(),
            Box::new(|| fisheye("two-balls", "dioptric-two-balls", &["ball1", "ball2"], 80)),
        ),
        (
            "webcams-two".to_owned(),
            Box::new(|| webcams("two", 2, 160)),
        ),
        (
            "webcams-four".to_owned(),
            Box::new(|| webcams("four", 4, 120)),
        ),
    ];
    let cameras = [1, 2, 4, 8, 16, 32].map(|cameras| (cameras, [320, 240], 1));
    let sizes = [[640, 480], [1280, 720], [1920, 1080], [3840, 2160]].map(|size| (1, size, 1));
    // A search finds eight blobs at most, too few for many more.
    let balls = [1, 3, 10].map(|balls| (1, [1280, 960], balls));
    for (cameras, size, balls) in [&cameras[..], &sizes, &balls].concat() {
        let [width, height] = size;
        let name = format!("drawn-{cameras}-cameras-{width}x{height}-{balls}-balls");
        runs.push((name, Box::new(move || drawn(cameras, size, balls))));
    }
    runs
}

fn main() {
    let (mut steps, mut level) = (STEPS, Level::best());
    let mut names = Vec::new();
    let mut words = std::env::args().skip(1);
    while let Some(word) = words.next() {
        match word.as_str() {
            // Cargo says so.
            "--bench" => {}
            "--steps" => {
                let count = words.next().and_then(|count| count.parse().ok());
                steps = count
                    .filter(|&count| count > 0)
                    .expect("--steps takes a number above 0");
            }
            "--level" => {
                let name = words.next();
                let mut available = Level::available().into_iter();
                let found = available.find(|level| name.as_deref() == Some(level.name()));
                level = found.expect("--level takes baseline or, if the CPU has it, avx2");
            }
            _ => names.push(word),
        }
    }
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1);
    pool.use_current_thread().build_global().unwrap();
    println!("run,images,targets,steps,median_us,p99_us,p999_us,max_us");
    for (name, run) in runs() {
        if names.is_empty() || names.iter().any(|part| name.contains(part)) {
            run().measure(steps, level);
        }
    }
}
