//! Cameras whose pose, focal length or clock is wrong.

use std::fs;

use serde_json::{Value, json};

use super::place::Rig;
use crate::common::{Run, Workplace};

const BALL: &str = "shape.sphere.radius_m = 0.035\ncolors = \"ball.toml\"\n";

/// The pose of cam3 in data/webcams-four/cameras.json, turned by half a degree about its vertical axis.
const TURNED: &str = "world_from_camera = [
  [-0.567979, 0.304278, -0.764733, 0.92],
  [0.823037, 0.213642, -0.526277, 0.78],
  [0.003244, -0.928317, -0.371777, 0.36],
  [0, 0, 0, 1],
]
";

/// Tracks the ball with these settings of one camera. Returns the errors that the program names, by camera.
fn likely_errors(camera: &'static str, settings: &str) -> (String, Vec<(&'static str, Value)>) {
    likely_errors_of(&Rig::new(), camera, settings)
}

fn likely_errors_of(
    rig: &Rig,
    camera: &'static str,
    settings: &str,
) -> (String, Vec<(&'static str, Value)>) {
    rig.edit(camera, settings);
    let run = rig.track_ball(BALL);
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    let summary = rig.summary();
    let rows = &summary["targets"]["ball"]["rows"];
    assert_eq!((&rows["lost"], &rows["searching"]), (&0.into(), &0.into()));
    let errors = Rig::CAMERAS.map(|camera| {
        let agreement = &summary["cameras"][camera]["agreement"];
        assert!(
            agreement["comparisons"].as_u64().unwrap() > 50,
            "{agreement}"
        );
        (camera, agreement["likely_error"].clone())
    });
    let errors = errors
        .into_iter()
        .filter(|(_, error)| *error != json!(null));
    (run.stderr, errors.collect())
}

#[test]
fn cameras_that_agree_are_not_warned_of() {
    let (stderr, errors) = likely_errors("cam1", "");
    assert_eq!((&*stderr, &*errors), ("", &[][..]));
}

#[test]
fn a_wrong_clock_is_named_with_its_offset() {
    let (stderr, errors) = likely_errors("cam3", "time_offset_s = 0.04\n");
    let warning = "warning: cameras.cam3: disagrees with the other cameras by ";
    assert!(stderr.starts_with(warning), "{stderr}");
    assert!(
        stderr.contains("likely cause: its clock; add -"),
        "{stderr}"
    );
    let [("cam3", error)] = &errors[..] else {
        panic!("{errors:?}");
    };
    let correction_s = error["correction_s"].as_f64().unwrap();
    assert!((correction_s + 0.04).abs() < 0.01, "{error}");
}

#[test]
fn a_wrong_clock_of_slow_cameras_is_named() {
    let rig = Rig::new();
    for camera in Rig::CAMERAS {
        rig.times(camera, false, |place| (place as f64 / 6.0, 0.0));
    }
    let (stderr, errors) = likely_errors_of(&rig, "cam3", "time_offset_s = 0.06\n");
    let [("cam3", error)] = &errors[..] else {
        panic!("{errors:?} {stderr}");
    };
    let correction_s = error["correction_s"].as_f64().unwrap();
    assert!((correction_s + 0.06).abs() < 0.015, "{error}");
}

#[test]
fn a_turned_camera_is_named() {
    let (stderr, errors) = likely_errors("cam3", TURNED);
    let warning = "warning: cameras.cam3: disagrees with the other cameras by ";
    // The first warning is of the pose that the scene overrides.
    assert!(stderr.contains(warning), "{stderr}");
    assert!(stderr.contains("likely cause: its pose"), "{stderr}");
    let [("cam3", error)] = &errors[..] else {
        panic!("{errors:?}");
    };
    assert_eq!(error["cause"], "pose");
}

#[test]
fn exchanged_images_are_named() {
    let rig = Rig::new();
    let [one, three, other] = ["cam1", "cam3", "other"].map(|name| rig.path(name));
    fs::rename(&one, &other).unwrap();
    fs::rename(&three, &one).unwrap();
    fs::rename(&other, &three).unwrap();
    let run = rig.track_ball(BALL);
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    let summary = rig.summary();
    let elsewhere = |camera: &str| {
        let of_camera = &summary["targets"]["ball"]["cameras"][camera];
        ["elsewhere_frames", "searched_frames"].map(|key| of_camera[key].as_u64().unwrap())
    };
    let mut named = Vec::new();
    for camera in Rig::CAMERAS {
        let [elsewhere, searched] = elsewhere(camera);
        if elsewhere > 4 && 5 * elsewhere >= searched {
            named.push(format!(
                "cameras.{camera} ({elsewhere} of {searched} frames)"
            ));
        }
    }
    // What is exchanged; where the others agree, they see the ball.
    let is_exchanged =
        |name: &String| name.starts_with("cameras.cam1") || name.starts_with("cameras.cam3");
    assert!(named.iter().any(is_exchanged), "{summary}");
    let warning = format!(
        "warning: {}: what looks like ball there is not where other cameras show it",
        named.join(", ")
    );
    assert!(run.stderr.contains(&warning), "{}", run.stderr);
}

/// A ball that swings to and fro, with an acceleration of up to 30 m/s². The frames of one camera are taken midway between those of
/// the other, as those of webcams may be.
const SWING: &str = "
seed = 1
duration_s = 2.0
training_stills = 3

[cameras.cam1]
size_px = [320, 240]
model.pinhole = { f_px = [300, 300], center_px = [159.5, 119.5] }
look_from_m = [0.0, -0.35, 0.5]
look_at_m = [1.5, 0.0, 0.3]

[cameras.cam2]
size_px = [320, 240]
model.pinhole = { f_px = [310, 310], center_px = [159.5, 119.5] }
look_from_m = [0.1, 0.6, 0.6]
look_at_m = [1.5, 0.0, 0.3]
timing.phase_s = 0.02

[timing]
fps = 25

[image]
shutter_s = 0.004
instants = 1
samples = 2
blur_px = 0.7
read_noise = 2.0

[ground]
z_m = -0.2
texture.plain.color_srgb = [115, 130, 110]

[objects.ball]
target = true
shape.sphere.radius_m = 0.05
color_srgb = [235, 110, 30]
path.harmonic = { center_m = [1.4, 0.05, 0.35], x = [[0.15, 0.83, 60]], y = [[0.22, 0.61, 140]], z = [[0.15, 0.71, 250]] }
";

#[test]
fn cameras_that_agree_are_not_warned_of_while_the_ball_accelerates() {
    let place = Workplace::with_frames(0);
    place.write("world.toml", SWING);
    let pardalis = |arguments: &[&str]| Run::pardalis(place.path(""), arguments).fine();
    pardalis(&["simulate", "world.toml", "-o", "swing"]);
    pardalis(&["track", "swing/scene.toml", "-o", "out", "--no-plots"]);
    let summary: Value =
        serde_json::from_slice(&fs::read(place.path("out/summary.json")).unwrap()).unwrap();
    for camera in ["cam1", "cam2"] {
        let agreement = &summary["cameras"][camera]["agreement"];
        assert!(
            agreement["comparisons"].as_u64().unwrap() > 40,
            "{agreement}"
        );
        assert!(
            agreement["residual_px"].as_f64().unwrap() < 0.2,
            "{agreement}"
        );
        assert_eq!(agreement["likely_error"], json!(null));
    }
}

#[test]
fn a_camera_with_another_white_balance_is_named_until_its_images_are_labelled_too() {
    let place = Workplace::with_frames(0);
    let world = SWING
        .replace(
            "timing.phase_s",
            "image.gains = [0.6, 1.0, 1.8]\ntiming.phase_s",
        )
        .replace("[235, 110, 30]", "[210, 70, 110]");
    place.write("world.toml", world);
    let pardalis = |arguments: &[&str]| Run::pardalis(place.path(""), arguments);
    pardalis(&["simulate", "world.toml", "-o", "swing"]).fine();
    let track = || pardalis(&["track", "swing/scene.toml", "-o", "out", "--no-plots"]);
    let seen = || {
        let summary = fs::read(place.path("out/summary.json")).unwrap();
        let summary: Value = serde_json::from_slice(&summary).unwrap();
        let of_camera = &summary["targets"]["ball"]["cameras"]["cam2"];
        [&of_camera["visible_frames"], &of_camera["blind_frames"]].map(Value::as_u64)
    };
    // The training images are of both cameras.
    track().fine();
    assert_eq!(seen(), [Some(50), Some(0)]);
    // The first and the last are of cam1.
    for ending in [".png", "_ball_mask.png"] {
        fs::remove_file(place.path(&format!("swing/training/001{ending}"))).unwrap();
    }
    let learn = ["learn", "swing/training", "--masks", "_ball_mask.png", "-o"];
    pardalis(&[&learn[..], &["swing/ball.colors.toml"]].concat());
    let run = track();
    assert_eq!(run.code, Some(0));
    let warning =
        "warning: cameras.cam2: saw ball in 0 of 50 frames in which it had its place in view";
    assert!(run.stderr.starts_with(warning), "{}", run.stderr);
    assert_eq!(seen(), [Some(0), Some(50)]);
}
