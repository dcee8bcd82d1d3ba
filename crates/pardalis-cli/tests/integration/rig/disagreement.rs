//! Cameras whose pose, focal length or clock is wrong.

use std::fs;
use std::process::Command;

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
    let rig = Rig::new();
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
    let pardalis = |arguments: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_pardalis"));
        Run::of(command.current_dir(place.path("")).args(arguments)).fine();
    };
    pardalis(&["simulate", "world.toml", "-o", "swing"]);
    // Without its start, the ball is detected.
    let scene = fs::read_to_string(place.path("swing/scene.toml")).unwrap();
    let start = scene.find("[targets.ball.start").unwrap();
    place.write("swing/scene.toml", &scene[..start]);
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
