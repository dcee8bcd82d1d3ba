//! Scenes with cameras from calibration files, run with the real program.

use crate::common::{OPENCV_FISHEYE, SCENE, Workplace, data, scene_with};

/// The scene's own camera as a Pardalis calibration file.
const RIG: &str = "[cameras.cam1]
size_px = [640, 480]
world_from_camera = [[0, -1, 0, 0], [-1, 0, 0, 0], [0, 0, -1, 0.9], [0, 0, 0, 1]]
[cameras.cam1.model.equidistant]
f_px_per_rad = 145.5622506548578
center_px = [319.5, 239.5]
field_of_view_deg = 185.0
[cameras.cam2.model.pinhole]
f_px = [300, 300]
center_px = [320, 240]
";

const MODEL: &str = "model.equidistant = { f_px_per_rad = 145.5622506548578, center_px = [319.5, 239.5], field_of_view_deg = 185.0 }";
const POSE: &str =
    "world_from_camera = [[0, -1, 0, 0], [-1, 0, 0, 0], [0, 0, -1, 0.9], [0, 0, 0, 1]]\n";

/// The scene with other lines instead of the camera's model, with or without its pose.
fn scene(lines: &str, pose: bool) -> String {
    let scene = scene_with(MODEL, lines);
    if pose { scene } else { scene.replace(POSE, "") }
}

#[test]
fn a_calibration_file_tracks_like_the_model_in_the_scene() {
    let place = Workplace::with_frames(3);
    place.track(SCENE).fine();
    let expected = place.rows();
    place.write("rig.toml", RIG);
    place
        .track(scene("calibration = \"rig.toml\"", false))
        .fine();
    assert_eq!(place.rows(), expected);

    // The scene's pose overrides the file's with a warning; an equal pose causes none.
    place
        .track(scene("calibration = \"rig.toml\"", true))
        .fine();
    place.write("moved.toml", RIG.replace("0.9]", "1.9]"));
    let run = place.track(scene("calibration = \"moved.toml\"", true));
    assert_eq!(
        (run.code, &*run.stderr),
        (
            Some(0),
            "warning: scene.toml: line 6: cameras.cam1.world_from_camera: overrides the pose in the calibration file; \
             remove it to use that pose\n"
        )
    );
    assert_eq!(place.rows(), expected);

    // The camera.json of a sequence folder is the same camera.
    std::fs::copy(data().join("camera.json"), place.path("camera.json")).unwrap();
    place
        .track(scene("calibration = \"camera.json\"", false))
        .fine();
    assert_eq!(place.rows(), expected);

    // The fisheye without coefficients is the same model except for rounding and the limit of its field of view.
    place.write("lens.yml", OPENCV_FISHEYE);
    place
        .track(scene(
            "calibration = \"lens.yml\"\ncalibration_lens = \"fisheye\"",
            true,
        ))
        .fine();
    let rows = place.rows();
    assert_eq!(rows.len(), expected.len());
    for (a, b) in rows.iter().zip(&expected) {
        for column in 4..7 {
            let value = |row: &[String]| row[column].parse::<f64>().unwrap();
            assert!((value(a) - value(b)).abs() < 0.02, "{a:?} {b:?}");
        }
    }
}

#[test]
fn a_calibration_can_select_its_camera() {
    let place = Workplace::with_frames(1);
    place.write("rig.toml", RIG.replace("cam1", "left"));
    let named = "calibration = \"rig.toml\"\ncalibration_camera = \"left\"";
    place.track(scene(named, false)).fine();
    place
        .track(scene("calibration = \"rig.toml\"", false))
        .refused(&[
            "scene.toml",
            "line 5: cameras.cam1.calibration: contains the cameras left, cam2; select one with calibration_camera",
        ]);
    place
        .track(scene(&named.replace("left", "up"), false))
        .refused(&[
            "line 6: cameras.cam1.calibration_camera: is the text \"up\"; allowed: left, cam2",
        ]);
}

#[test]
fn invalid_calibrations_are_rejected() {
    let place = Workplace::with_frames(1);
    place.write("rig.toml", RIG);
    place.write("lens.yml", OPENCV_FISHEYE);
    let file = "calibration = \"rig.toml\"";
    let refused = |scene: String, wanted: &[&str]| place.track(scene).refused(wanted);

    refused(
        scene("calibration = \"none.toml\"", true),
        &["line 5: cameras.cam1.calibration: none.toml: cannot be read: there is no such file"],
    );
    place.write("bad.toml", RIG.replace("145.5622506548578", "-1"));
    refused(
        scene("calibration = \"bad.toml\"", true),
        &[
            "line 5: cameras.cam1.calibration: bad.toml: line 5: cameras.cam1.model.equidistant.f_px_per_rad: is -1; allowed",
        ],
    );
    refused(
        scene("calibration = \"lens.yml\"", true),
        &[
            "line 5: cameras.cam1.calibration: lens.yml: line 10: D: has 4 numbers, which may be those of a pinhole",
        ],
    );
    refused(
        scene(
            "calibration = \"lens.yml\"\ncalibration_lens = \"fish\"",
            true,
        ),
        &[
            "line 6: cameras.cam1.calibration_lens: is the text \"fish\"; allowed: \"pinhole\", \"fisheye\"",
        ],
    );
    refused(
        scene(
            "calibration = \"lens.yml\"\ncalibration_lens = \"fisheye\"",
            false,
        ),
        &[
            "cameras.cam1.world_from_camera: is missing, and the calibration file has no pose either; give four rows",
        ],
    );
    refused(
        scene(&format!("{file}\n{MODEL}"), true),
        &["line 6: cameras.cam1.model: cannot be combined with calibration; remove one of them"],
    );
    refused(
        scene(&format!("{file}\nsize_px = [320, 240]"), true),
        &[
            "line 6: cameras.cam1.size_px: contradicts the calibration file, which is for images of 640 x 480",
        ],
    );
    refused(
        scene(&format!("{MODEL}\ncalibration_camera = \"left\""), true),
        &["line 6: cameras.cam1.calibration_camera: needs calibration; add calibration = \"FILE\""],
    );
    place.write("small.toml", RIG.replace("640, 480", "320, 240"));
    refused(
        scene("calibration = \"small.toml\"", true),
        &["line 5: cameras.cam1.calibration: is 320 x 240, but the images are 640 x 480"],
    );
    // Several problems at once, each with its position.
    refused(
        scene("calibration = \"none.toml\"", true).replace("radius_m = 0.11", "radius_m = 0"),
        &["2 problems", "none.toml", "radius_m: is 0"],
    );
}
