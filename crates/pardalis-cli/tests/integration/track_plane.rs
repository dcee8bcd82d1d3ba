//! `pardalis track` in the plane, on frames of data/plane-robot: two landmarks form one target with a heading;
//! invalid scenes.

use std::fs;
use std::path::{Path, PathBuf};

use crate::common::{FRONT_LANDMARK, PLANE_ROBOT, REAR_LANDMARK, Run, rows_in};

/// A scene with the front landmark first. The tests refer to its line numbers.
fn scene() -> String {
    [PLANE_ROBOT, FRONT_LANDMARK, REAR_LANDMARK].concat()
}

/// A colour model without histograms of channels, as older versions wrote it.
const OLD_COLORS: &str = r#"format = "pardalis color model 1"
pixel_count = 30
image_count = 2
bins = [[0, 9, 1, 20], [11, 3, 3, 10]]
[palette.hsi]
hue_bins = 12
saturation_bins = 12
intensity_bins = 4
"#;

fn data() -> PathBuf {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../data");
    folder.canonicalize().unwrap()
}

/// Runs `pardalis track` on the scene with a piece of it replaced, which must occur in it.
fn track(folder: &Path, piece: &str, other: &str) -> Run {
    let scene = scene();
    assert!(scene.contains(piece), "{piece}");
    let data = data();
    let scene = scene
        .replace(piece, other)
        .replace("DATA", data.to_str().unwrap());
    fs::write(folder.join("scene.toml"), scene).unwrap();
    Run::pardalis(folder, &["track", "scene.toml", "-o", "out", "--no-plots"])
}

/// Returns x, y and heading of the robot in each frame.
fn truth() -> Vec<[f64; 3]> {
    let text = fs::read_to_string(data().join("plane-robot/truth.csv")).unwrap();
    text.lines()
        .map(|line| line.split(',').collect::<Vec<_>>())
        .filter(|row| row[2] == "robot")
        .map(|row| [4, 5, 16].map(|column| row[column].parse().unwrap()))
        .collect()
}

#[test]
fn two_landmarks_are_one_target_with_a_heading() {
    let folder = tempfile::tempdir().unwrap();
    track(folder.path(), "", "").fine();
    let rows = rows_in(&fs::read_to_string(folder.path().join("out/tracks.csv")).unwrap());
    assert_eq!(rows.len(), 20);
    for (frame, (row, truth)) in rows.iter().zip(truth()).enumerate() {
        assert_eq!(row[0], frame.to_string());
        assert_eq!((&*row[2], &*row[3]), ("robot", "tracking"));
        let number = |column: usize| row[column].parse::<f64>().unwrap();
        assert_eq!(number(6), 0.0, "its place is on the plane");
        let error_m = (number(4) - truth[0]).hypot(number(5) - truth[1]);
        assert!(error_m < 0.05, "frame {frame}: {error_m} m off");
        let error_rad = number(10) - truth[2];
        assert!(error_rad.abs() < 0.15, "frame {frame}: {error_rad} rad off");
    }
}

#[test]
fn invalid_scenes_are_rejected_with_key_and_line() {
    let folder = tempfile::tempdir().unwrap();
    let refused = |piece, other, wanted: &[&str]| {
        let run = track(folder.path(), piece, other);
        run.refused(&[&["scene.toml: "], wanted].concat());
        assert!(!folder.path().join("out").exists());
    };
    let center = "camera_center_m = [0.0, -3.2, 3.0]";
    refused(
        "    [448.73, 304.71, 1.1498814, -0.1284166],\n",
        "",
        &[
            "line 7: cameras.mast.model.plane.points: 3 points are too few",
            "give four or more",
        ],
    );
    refused(
        center,
        "",
        &[
            "line 15: targets.robot.shape: rises above the plane, but the position of camera \"mast\" is unknown",
            "give cameras.mast.model.plane.camera_center_m",
        ],
    );
    refused(
        "region = {}",
        "region = {}\ncolors = \"c\"",
        &[
            "line 19: targets.robot.colors: cannot be combined with landmarks; move it into each landmark",
        ],
    );
    let disc = "shape.disc = { radius_m = 0.06, height_m = 0.406 }";
    refused(
        disc,
        "shape.sphere.radius_m = 0.06",
        &[
            "line 18: targets.robot.region: applies to flat targets only; give shape.disc or shape.rectangle",
        ],
    );
    fs::write(folder.path().join("old.toml"), OLD_COLORS).unwrap();
    refused(
        "DATA/colors/landmark-red.colors.toml",
        "old.toml",
        &[
            "line 21: targets.robot.landmarks.front.colors: ",
            "no histograms of red, green and blue",
            "learn it again",
        ],
    );
    // A heading needs both landmarks: without one there is no heading, and a warning.
    let run = track(folder.path(), "landmarks.rear", "landmarks.back");
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    let warning = "line 20: targets.robot.landmarks: has one of `front` and `rear`";
    assert!(run.stderr.contains(warning), "{}", run.stderr);
    let rows = rows_in(&fs::read_to_string(folder.path().join("out/tracks.csv")).unwrap());
    assert!(rows.iter().all(|row| row[10].is_empty()), "no heading");
}
