//! Tests of `pardalis calibrate time` with the real program on the webcam sequences with shifted time stamps.

use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};

use tempfile::TempDir;

// This file uses only some of the helpers.
#[allow(dead_code)]
use crate::common::{Run, rows_in};

fn data(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../../data")
        .join(path)
}

/// Creates a folder with a scene of a webcam sequence whose time stamps are early by these offsets, which are thus the
/// correct values of `time_offset_s`.
fn scene(sequence: &str, offsets_s: &[f64]) -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    let mut text = "seed = 1\n".to_owned();
    for (number, offset_s) in offsets_s.iter().enumerate() {
        let name = format!("cam{}", number + 1);
        let images = folder.path().join(&name);
        fs::create_dir(&images).unwrap();
        let mut times = "frame,time_s\n".to_owned();
        for entry in fs::read_dir(data(sequence).join("frames").join(&name)).unwrap() {
            let file = entry.unwrap().path();
            fs::copy(&file, images.join(file.file_name().unwrap())).unwrap();
        }
        for frame in 0..fs::read_dir(&images).unwrap().count() {
            let _ = writeln!(times, "{frame},{}", frame as f64 / 25.0 - offset_s);
        }
        fs::write(images.join("times.csv"), times).unwrap();
        let calibration = data(sequence).join("cameras.json");
        let _ = writeln!(
            text,
            "[cameras.{name}]  # number {number}\nimages = \"{name}\"\ncalibration = '{}'\n",
            calibration.display()
        );
    }
    let colors = data("colors/pink-ball.hsi.colors.toml");
    let [x, y, z] = truth(sequence)[0].1;
    let _ = write!(
        text,
        "[targets.ball]\nshape.sphere.radius_m = 0.035\ncolors = '{}'\nfilter.particles = 500\n\
         motion.constant_velocity.acceleration_density_m2ps3 = 1.0\n\
         start.gaussian = {{ position_m = [{x}, {y}, {z}], position_sigma_m = 0.01 }}\n",
        colors.display()
    );
    fs::write(folder.path().join("scene.toml"), text).unwrap();
    folder
}

/// Returns the true path of the ball: time in seconds, position in metres.
fn truth(sequence: &str) -> Vec<(f64, [f64; 3])> {
    let text = fs::read_to_string(data(sequence).join("truth.csv")).unwrap();
    let rows = text.lines().filter(|line| line.contains(",ball,cam1,"));
    rows.map(|line| {
        let number = |i: usize| line.split(',').nth(i).unwrap().parse().unwrap();
        (number(1), [number(4), number(5), number(6)])
    })
    .collect()
}

/// Reads the offset and standard deviation of every camera in seconds, and the RMS before and after in pixels.
fn offsets(folder: &TempDir) -> Vec<[f64; 4]> {
    let text = fs::read_to_string(folder.path().join("scene-time/offsets.csv")).unwrap();
    let rows = text.lines().skip(1).map(|line| {
        let field = |i: usize| line.split(',').nth(i).unwrap().parse().unwrap();
        [4, 5, 8, 9].map(field)
    });
    rows.collect()
}

/// Runs the command and compares every offset with the truth, within these milliseconds and standard deviations.
#[track_caller]
fn check(sequence: &str, offsets_s: &[f64], most_ms: f64, most_sigmas: f64) -> TempDir {
    let folder = scene(sequence, offsets_s);
    let arguments = ["calibrate", "time", "scene.toml", "--corrected", "new.toml"];
    let run = Run::pardalis(&folder, &arguments).fine();
    println!("{}", run.stdout);
    for (expected_s, [offset_s, sigma_s, before_px, after_px]) in
        offsets_s.iter().zip(offsets(&folder))
    {
        let error_s = offset_s - expected_s;
        assert!(1e3 * error_s.abs() < most_ms, "error of {error_s} s");
        assert!(
            error_s.abs() <= most_sigmas * sigma_s,
            "error of {error_s} s with a standard deviation of {sigma_s} s"
        );
        assert!(
            after_px < 1.0 && after_px <= before_px + 0.1,
            "{before_px} to {after_px} px"
        );
    }
    folder
}

/// Returns the root mean square error of a track in metres, against the truth at the track's times.
fn error_m(folder: &TempDir, scene: &str, sequence: &str) -> f64 {
    Run::pardalis(folder, &["track", scene, "-o", "out", "--no-plots"]).fine();
    let truth = truth(sequence);
    let text = fs::read_to_string(folder.path().join("out/tracks.csv")).unwrap();
    let (mut sum, mut count) = (0.0, 0.0);
    for row in rows_in(&text) {
        let number = |i: usize| row[i].parse::<f64>().unwrap();
        let place = number(1) * 25.0;
        let index = (place.max(0.0) as usize).min(truth.len() - 2);
        let share = place - index as f64;
        if !(0.0..=1.0).contains(&share) {
            continue;
        }
        for axis in 0..3 {
            let [a, b] = [truth[index].1[axis], truth[index + 1].1[axis]];
            sum += (number(4 + axis) - a - share * (b - a)).powi(2);
        }
        count += 1.0;
    }
    f64::sqrt(sum / count)
}

#[test]
fn finds_zero_offsets_of_synchronous_cameras() {
    check("webcams-two", &[0.0, 0.0], 1.0, 2.0);
    check("webcams-four", &[0.0, 0.0, 0.0, 0.0], 1.0, 2.0);
}

#[test]
fn corrected_scene_tracks_better() {
    let sequence = "webcams-two";
    let folder = check(sequence, &[0.0, -0.13], 1.0, 3.0);
    let [before_m, after_m] =
        ["scene.toml", "new.toml"].map(|file| error_m(&folder, file, sequence));
    println!(
        "error {:.1} mm, corrected {:.1} mm",
        1e3 * before_m,
        1e3 * after_m
    );
    assert!(after_m < 0.7 * before_m, "{before_m} m to {after_m} m");
    // The corrected scene has one more line per camera.
    let [old, new] = ["scene.toml", "new.toml"]
        .map(|name| fs::read_to_string(folder.path().join(name)).unwrap());
    let kept = new
        .lines()
        .filter(|line| !line.starts_with("time_offset_s = "));
    assert!(old.lines().eq(kept), "{new}");
    assert_eq!(new.lines().count(), old.lines().count() + 1);
    // The corrected scene needs no further correction, and its own offset is taken into account.
    let again = [
        "calibrate",
        "time",
        "new.toml",
        "-o",
        "scene-time",
        "--corrected",
        "new.toml",
    ];
    Run::pardalis(&folder, &again).fine();
    assert!(
        offsets(&folder)[1][0].abs() < 1e-5,
        "{:?}",
        offsets(&folder)
    );
    let newest = fs::read_to_string(folder.path().join("new.toml")).unwrap();
    assert_eq!(newest.lines().count(), new.lines().count());
    let offset = newest
        .lines()
        .find(|line| line.starts_with("time_offset_s"))
        .unwrap();
    let offset_s: f64 = offset["time_offset_s = ".len()..].parse().unwrap();
    assert!((offset_s + 0.13).abs() < 0.002, "{offset}");
}

#[test]
fn calibrates_four_cameras_despite_distractor_and_losses() {
    let folder = check("webcams-four", &[0.0, 0.04, -0.13, 0.0123], 1.0, 3.0);
    let page = fs::read_to_string(folder.path().join("scene-time/report.html")).unwrap();
    for wanted in ["cam4", "Residuals over time", "</html>"] {
        assert!(page.contains(wanted));
    }
    let detections = fs::read_to_string(folder.path().join("scene-time/detections.csv")).unwrap();
    assert!(
        detections.lines().count() > 150,
        "{}",
        detections.lines().count()
    );
}

/// A ball that moves among a sleeve, a can, a crate and a book in exactly its colour, seen by two cameras. The first two move
/// too, and are larger.
const CLUTTER: &str = r"
seed = 1
duration_s = 4.0
training_stills = 4

[cameras.cam1]
size_px = [400, 300]
model.pinhole = { f_px = [375, 375], center_px = [199.5, 149.5] }
look_from_m = [0.0, -0.35, 0.5]
look_at_m = [1.5, 0.0, 0.3]
timing = { fps = 25, phase_s = 0.011 }

[cameras.cam2]
size_px = [400, 300]
model.pinhole = { f_px = [388, 388], center_px = [199.5, 149.5] }
look_from_m = [0.1, 0.6, 0.6]
look_at_m = [1.5, 0.0, 0.3]
timing = { fps = 25, phase_s = 0.02, clock_offset_s = -0.0585 }

[image]
shutter_s = 0.012
instants = 3
samples = 1
blur_px = 0.7
shot_noise = 0.008
read_noise = 2.0

[ground]
z_m = -0.2
texture.noise = { size_m = 0.4, octaves = 3, colors_srgb = [[95, 115, 95], [135, 145, 125]] }

[objects.ball]
target = true
shape.sphere.radius_m = 0.035
color_srgb = [235, 110, 30]
highlight = 0.2
path.harmonic = { center_m = [1.4, 0.05, 0.35], x = [[0.2, 1.9, 60]], y = [[0.22, 1.5, 140]], z = [[0.15, 1.1, 250]] }

[objects.sleeve]
shape.capsule = { radius_m = 0.045, to_m = [0.02, 0.12, 0.22] }
color_srgb = [235, 110, 30]
path.harmonic = { center_m = [1.9, 0.1, 0.25], x = [[0.18, 2.6, 0]], y = [[0.18, 1.9, 200]], z = [[0.12, 2.2, 80]] }

[objects.can]
shape.cylinder = { radius_m = 0.05, height_m = 0.12 }
color_srgb = [235, 110, 30]
path.harmonic = { center_m = [1.7, -0.2, 0.3], x = [[0.2, 3.3, 20]], y = [[0.2, 2.7, 310]], z = [[0.14, 3.9, 110]] }

[objects.crate]
shape.box.size_m = [0.15, 0.2, 0.2]
color_srgb = [235, 110, 30]
heading_deg = 20
path.still.position_m = [2.0, -0.4, -0.1]

[objects.book]
shape.box.size_m = [0.03, 0.2, 0.28]
color_srgb = [235, 110, 30]
path.still.position_m = [2.2, 0.6, 0.2]
";

#[test]
fn other_things_in_the_colour_of_the_ball_do_not_mislead() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("world.toml"), CLUTTER).unwrap();
    Run::pardalis(&folder, &["simulate", "world.toml", "-o", "clutter"]).fine();
    let arguments = [
        "calibrate",
        "time",
        "clutter/scene.toml",
        "-o",
        "scene-time",
    ];
    let run = Run::pardalis(&folder, &arguments).fine();
    println!("{}", run.stdout);
    let [offset_s, sigma_s, ..] = offsets(&folder)[1];
    let error_s = offset_s - 0.0585;
    assert!(error_s.abs() < 0.0005, "error of {error_s} s");
    assert!(
        error_s.abs() <= 3.0 * sigma_s,
        "error of {error_s} s with a standard deviation of {sigma_s} s"
    );
}

#[test]
fn rejects_insufficient_recordings_without_writing() {
    let folder = scene("webcams-two", &[0.0, 0.0]);
    fs::create_dir(folder.path().join("other")).unwrap();
    let text = fs::read_to_string(folder.path().join("scene.toml")).unwrap();
    let write = |text: &str| fs::write(folder.path().join("scene.toml"), text).unwrap();
    let refused = |more: &[&str], wanted: &[&str]| {
        let arguments = [&["calibrate", "time", "scene.toml"], more].concat();
        Run::pardalis(&folder, &arguments).refused(wanted);
    };
    refused(
        &["--corrected", "other/new.toml"],
        &["other/new.toml", "another folder", "beside the scene"],
    );
    refused(
        &["--target", "cup"],
        &["scene.toml", "ball", "--target NAME"],
    );
    // The ball is at rest in the first 60 frames.
    write(&text.replace("calibration =", "frame_limit = 50\ncalibration ="));
    refused(&[], &["scene.toml", "objects at rest count as background"]);
    let second = text.find("[cameras.cam2]").unwrap()..text.find("[targets").unwrap();
    let mut alone = text.clone();
    alone.replace_range(second, "");
    write(&alone);
    refused(&[], &["scene.toml", "only one camera"]);
    assert!(!folder.path().join("scene-time").exists());
}
