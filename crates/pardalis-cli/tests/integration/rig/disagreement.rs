//! Cameras whose pose, focal length or clock is wrong.

use serde_json::{Value, json};

use super::place::Rig;

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
