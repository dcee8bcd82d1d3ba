//! Inconsistent cameras are rejected before tracking starts, with the reason and a remedy.

use std::fs;

use super::place::Rig;
use crate::common::run::Run;

#[test]
fn different_numbers_of_images_are_rejected() {
    let rig = Rig::new();
    rig.by_fps();
    rig.remove("cam3", 119..120);
    rig.track("").refused(&[
        "scene.toml: a problem in the scene:",
        "line 10: cameras.cam3.images: camera cam1 has 120 images, 4.8 s at 25 per second, and cam3 has 119",
        "it is unknown which images a camera missed",
        "put times.csv next to the images",
    ]);
    // At another rate, the same duration is allowed, within a frame.
    rig.edit("cam3", "fps = 24.8\n");
    rig.track("").fine();
    rig.edit("cam3", "fps = 12.5\n");
    rig.track("").refused(&["119, 9.52 s at 12.5 per second"]);
    assert!(rig.path("out").exists());
    let cut = "fps = 25\nframe_limit = 60\n";
    for camera in Rig::CAMERAS {
        rig.edit(camera, cut);
    }
    rig.track("").fine();
}

#[test]
fn cameras_without_pose_are_rejected() {
    let rig = Rig::new();
    let model =
        "images = \"cam2\"\nmodel.pinhole = { f_px = [330, 330], center_px = [119.5, 159.5] }\n";
    rig.replace("cam2", model);
    rig.track("").refused(&[
        "line 4: cameras.cam2.world_from_camera: is missing; give four rows of four finite numbers",
    ]);
    let text = fs::read_to_string(rig.path("cameras.json")).unwrap();
    let text = text.replacen("T_world_from_camera", "unknown", 1);
    fs::write(rig.path("cameras.json"), text).unwrap();
    rig.edit("cam2", "");
    rig.track("").refused(&[
        "line 1: cameras.cam1.world_from_camera: is missing, and the calibration file has no pose either",
    ]);
}

#[test]
fn duplicate_camera_names_are_rejected() {
    let rig = Rig::new();
    let scene = rig.scene("").replace("[cameras.cam3]", "[cameras.cam1]");
    let run = Run::of(&mut rig.command(&scene, &["-o", "out"]));
    run.refused(&["line 7: two cameras are named cam1, the first in line 1; rename one"]);
    let scene = rig.scene("") + "[targets.ball]\n";
    let run = Run::of(&mut rig.command(&scene, &["-o", "out"]));
    run.refused(&["two targets are named ball, the first in line 13"]);

    let kalibr = "cam0:\n  camera_model: pinhole\ncam0:\n  camera_model: omni\n";
    let text = fs::read_to_string(rig.path("cameras.json")).unwrap();
    fs::write(rig.path("cameras.json"), kalibr).unwrap();
    rig.track("").refused(&[
        "cameras.json: line 3: duplicate key cam0; keep one, and give each camera its own name",
    ]);
    fs::write(rig.path("cameras.json"), text.replace("cam3", "cam2")).unwrap();
    rig.track("").refused(&[
        "cameras.json: line ",
        "has the name cam2, like camera 2 of the list (this is camera 3); give each camera its own name",
    ]);
    assert!(!rig.path("out").exists());
}

#[test]
fn time_stamps_in_other_units_or_of_other_clocks_are_rejected() {
    let rig = Rig::new();
    rig.times("cam2", false, |frame| (frame as f64 * 40.0, 0.0));
    rig.track("").refused(&[
        "line 5: cameras.cam2.images: camera cam1's time stamps run from 0 to 4.76 s, 0.040000 s apart",
        "camera cam2's time stamps run from 0 to 4760 s, 40.000000 s apart",
        "those of cam2 look like milliseconds; time stamps must be in seconds",
    ]);
    rig.times("cam2", false, |frame| (1.7e9 + frame as f64 * 0.04, 0.0));
    rig.track("").refused(&[
        "scene.toml: a problem in the scene:\n  line 5: cameras.cam2.images: ",
        "they have no time in common, so their clocks differ (one may count from 1970",
        "set time_offset_s (with -1700000000 for cam2",
    ]);
    rig.edit("cam2", "time_offset_s = -1.7e9\n");
    rig.track("").fine();
}

#[test]
fn cameras_with_the_same_input_or_pose_are_reported() {
    let rig = Rig::new();
    rig.edit("cam4", "");
    let scene = rig
        .scene("")
        .replace("images = \"cam4\"", "images = \"./cam2/../cam3\"");
    let run = Run::of(&mut rig.command(&scene, &["-o", "out"]));
    run.refused(&["line 11: cameras.cam4.images: cameras cam3 and cam4 read the same frames; give each camera its own"]);

    rig.edit("cam4", "calibration_camera = \"cam3\"\n");
    let run = rig.track("");
    assert_eq!(run.code, Some(0));
    let message = "warning: scene.toml: line 11: cameras.cam4: has the same pose as cam3";
    assert!(run.stderr.starts_with(message), "{}", run.stderr);
}
