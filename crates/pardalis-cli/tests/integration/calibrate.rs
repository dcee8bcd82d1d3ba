//! Tests of `pardalis calibrate` with the real program: calibration from points and boards, and errors.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use tempfile::TempDir;

// This file uses only some of the helpers.
#[allow(dead_code)]
use crate::common::Run;

/// Columns of the rendered points with noise.
const NOISY: &str = "--columns u=u_noisy_px,v=v_noisy_px";

fn data(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../../data/calibration")
        .join(name)
}

/// Runs `pardalis ARGUMENTS` in a folder that contains the repository's data as `data`.
fn pardalis(folder: &TempDir, arguments: &str) -> Run {
    let data = data("").display().to_string();
    let arguments = arguments
        .split(' ')
        .map(|part| part.replace("data/", &data));
    Run::of(
        Command::new(env!("CARGO_BIN_EXE_pardalis"))
            .current_dir(folder.path())
            .args(arguments),
    )
}

fn folder() -> TempDir {
    tempfile::tempdir().unwrap()
}

/// Reads a table of results including its header.
fn table(folder: &TempDir, name: &str) -> Vec<Vec<String>> {
    let text = fs::read_to_string(folder.path().join(name)).unwrap();
    text.lines()
        .map(|line| line.split(',').map(str::to_owned).collect())
        .collect()
}

/// Returns the number in this column of the row with this first cell.
#[track_caller]
fn figure(table: &[Vec<String>], row: &str, column: &str) -> f64 {
    let place = table[0].iter().position(|name| name == column).unwrap();
    let row = table.iter().find(|cells| cells[0] == row).unwrap();
    row[place].parse().unwrap()
}

/// Reads the camera with this name, or the only one, from a calibration file.
fn camera(folder: &TempDir, file: &str, name: &str) -> toml::Table {
    let text = fs::read_to_string(folder.path().join(file)).unwrap();
    let mut file: toml::Table = text.parse().unwrap();
    let toml::Value::Table(mut cameras) = file.remove("cameras").unwrap() else {
        panic!("{text}");
    };
    let toml::Value::Table(camera) = cameras.remove(name).unwrap() else {
        panic!("{text}");
    };
    camera
}

fn numbers(value: &toml::Value) -> Vec<f64> {
    let values = value.as_array().unwrap().iter();
    values.map(|value| value.as_float().unwrap()).collect()
}

/// Returns the rows of `world_from_camera`.
fn pose(camera: &toml::Table) -> Vec<Vec<f64>> {
    let rows = camera["world_from_camera"].as_array().unwrap();
    rows.iter().map(numbers).collect()
}

/// Returns the distance between two positions and, for small rotations, the angle between two orientations.
fn pose_error(a: &[Vec<f64>], b: &[Vec<f64>]) -> (f64, f64) {
    let difference = |row: usize, column: usize| a[row][column] - b[row][column];
    let shift: f64 = (0..3).map(|row| difference(row, 3).powi(2)).sum();
    let turn: f64 = (0..9).map(|i| difference(i / 3, i % 3).powi(2)).sum();
    (shift.sqrt(), (0.5 * turn).sqrt())
}

fn json_matrix(value: &serde_json::Value) -> Vec<Vec<f64>> {
    serde_json::from_value(value.clone()).unwrap()
}

fn json(name: &str) -> serde_json::Value {
    serde_json::from_str(&fs::read_to_string(data(name)).unwrap()).unwrap()
}

#[track_caller]
fn assert_near(value: f64, truth: f64, bound: f64) {
    assert!(
        (value - truth).abs() <= bound,
        "found {value}, expected {truth}"
    );
}

#[test]
fn calibrates_fisheye_and_pose_from_points() {
    let folder = folder();
    let run = format!(
        "calibrate points data/dioptric/correspondences.csv --size 640x480 --model equidistant,pinhole {NOISY}"
    );
    let run = pardalis(&folder, &run).fine();
    assert!(
        run.stdout
            .contains("pinhole: the best camera of this model")
    );

    let truth = json("dioptric/camera.json");
    let found = camera(&folder, "correspondences-calibration/camera.toml", "camera");
    let model = &found["model"]["equidistant"];
    let f = truth["f_px_per_rad"].as_f64().unwrap();
    assert_near(model["f_px_per_rad"].as_float().unwrap(), f, 1e-3 * f);
    let center = numbers(&model["center_px"]);
    assert_near(center[0], truth["cx"].as_f64().unwrap(), 0.3);
    assert_near(center[1], truth["cy"].as_f64().unwrap(), 0.3);
    let (shift_m, turn_rad) =
        pose_error(&pose(&found), &json_matrix(&truth["T_world_from_camera"]));
    assert!(shift_m < 5e-3 && turn_rad < 2e-3, "{shift_m} {turn_rad}");

    let models = table(&folder, "correspondences-calibration/models.csv");
    assert!(figure(&models, "equidistant", "rms_px") <= 0.45);
    assert_eq!(figure(&models, "equidistant", "free_parameters"), 3.0);
    let residuals = table(&folder, "correspondences-calibration/residuals.csv");
    assert_eq!(residuals.len(), 41);
    let page = folder
        .path()
        .join("correspondences-calibration/report.html");
    let page = fs::read_to_string(page).unwrap();
    assert_eq!(page.matches("<figure>").count(), 4);

    let shown = pardalis(
        &folder,
        "camera show correspondences-calibration/camera.toml",
    );
    assert!(shown.fine().stdout.contains("equidistant"));
}

#[test]
fn evaluates_test_views_with_all_points() {
    let folder = folder();
    let text = fs::read_to_string(data("dioptric/correspondences.csv")).unwrap();
    let lines: Vec<&str> = text.lines().collect();
    let table_of = |rows: &[&str]| format!("{}\n{}\n", lines[0], rows.join("\n"));
    fs::write(folder.path().join("train.csv"), table_of(&lines[1..31])).unwrap();
    // The last point is above the camera, where this lens does not project.
    let unseen = "40,0.1,0.2,3.0,320,240,320,240";
    let test = [&lines[31..], &[unseen]].concat();
    fs::write(folder.path().join("test.csv"), table_of(&test)).unwrap();
    let run = format!(
        "calibrate points train.csv --test test.csv --size 640x480 --model equidistant --outliers inf {NOISY} -o out"
    );
    let run = pardalis(&folder, &run).fine();
    assert!(run.stdout.contains("RMS of test points (px)"));
    assert!(run.stdout.contains("1 of 11"));
    let models = table(&folder, "out/models.csv");
    let of = |column| figure(&models, "equidistant", column);
    assert_eq!(of("test_points"), 11.0);
    assert_eq!(of("test_points_not_projected"), 1.0);
    assert!((0.1..0.6).contains(&of("test_rms_px")));
    assert_eq!(of("outliers"), 0.0);
    let page = fs::read_to_string(folder.path().join("out/report.html")).unwrap();
    assert!(page.contains("RMS of test points"));
}

#[test]
fn calibrates_fisheye_from_a_board() {
    let folder = folder();
    let run = "calibrate board data/dioptric --board checkerboard:9x6:0.06 --model equidistant --distance board_0.jpg=0.686";
    let run = pardalis(&folder, run).fine();
    assert_eq!(run.stdout.matches(": 54 corners").count(), 6);
    let models = table(&folder, "dioptric-calibration/models.csv");
    assert!(figure(&models, "equidistant", "rms_px") <= 0.3);
    let views = table(&folder, "dioptric-calibration/views.csv");
    for number in 0..6 {
        let truth = json(&format!("dioptric/board_{number}.json"));
        let truth = json_matrix(&truth["T_camera_from_board"]);
        let of = |column| figure(&views, &format!("board_{number}.jpg"), column);
        // The first corner of a board with 9 x 6 corners is unambiguous.
        for (row, column) in ["x_m", "y_m", "z_m"].into_iter().enumerate() {
            assert_near(of(column), truth[row][3], 10e-3);
        }
    }

    let wrong = "calibrate board data/dioptric --board checkerboard:9x6:0.05 --model equidistant --distance board_0.jpg=0.686";
    pardalis(&folder, wrong).refused(&[
        "--distance board_0.jpg: measured 0.686 m, but the calibration gives 0.57",
        "a square of 0.0599",
        "measure the board",
    ]);
}

#[test]
fn stereo_pair_matches_the_published_intrinsics() {
    let folder = folder();
    let run = "calibrate board --rig left=data/opencv-stereo/left*.jpg --rig right=data/opencv-stereo/right*.jpg --board checkerboard:9x6:0.025 --model pinhole";
    let run = pardalis(&folder, run).fine();
    assert!(
        run.stdout
            .contains("Rig of 2 cameras in 13 shots, in the frame of left:")
    );
    assert!(!run.stdout.contains("-0.0000"), "{}", run.stdout);
    assert!(!run.stdout.contains("(held)"), "{}", run.stdout);
    let left = camera(&folder, "rig-calibration/rig.toml", "left");
    let f_px = numbers(&left["model"]["pinhole"]["f_px"]);
    for f in f_px {
        assert_near(f, 535.915_733_961_632, 0.01 * 535.9);
    }
    let right = pose(&camera(&folder, "rig-calibration/rig.toml", "right"));
    // The size of the squares is assumed, but the right camera is to the right for any size.
    assert!(right[0][3] > 0.05 && right[0][3] < 0.12);
    assert!(right[1][3].abs() < 0.01 && right[2][3].abs() < 0.01);
    let read = |name: &str| fs::read_to_string(folder.path().join(name)).unwrap();
    assert!(read("rig-calibration/left/report.html").contains("<figure>"));
    let page = read("rig-calibration/report.html");
    assert_eq!(page.matches("<figure>").count(), 4);
    for text in [&run.stdout, &page] {
        assert!(text.contains("one pose per shot"));
        assert!(text.contains("RMS on its own (px)"));
        assert!(text.contains("0.083169 ± 0.0000"), "{text}");
    }
}

#[test]
fn compares_mirror_models_and_their_poses() {
    let folder = folder();
    let points = "data/catadioptric/correspondences.csv";
    let run = format!(
        "calibrate points {points} --size 640x480 --model unified,perspective_mirror {NOISY} -o mirror"
    );
    let run = pardalis(&folder, &run).fine();
    assert!(run.stdout.contains("unified (best)"));
    let models = table(&folder, "mirror/models.csv");
    let rms = |model| figure(&models, model, "rms_px");
    // A mirror of this shape has no single viewpoint; the second parameter improves the fit.
    assert!(rms("unified") < rms("perspective_mirror"));
    assert!(rms("perspective_mirror") < 0.7);
    assert!(run.stdout.contains("0.470") && run.stdout.contains("0.621"));

    let run = format!("calibrate pose {points} --camera mirror/camera.toml {NOISY}");
    let run = pardalis(&folder, &run).fine();
    // Measured from the axis of the mirror's view, as in the calibration.
    assert!(run.stdout.contains("78.2"), "{}", run.stdout);
    let again = camera(&folder, "correspondences-pose/camera.toml", "camera");
    let before = camera(&folder, "mirror/camera.toml", "camera");
    let (shift_m, turn_rad) = pose_error(&pose(&again), &pose(&before));
    assert!(shift_m < 1e-3 && turn_rad < 1e-3, "{shift_m} {turn_rad}");
}

#[test]
fn exact_camera_and_points_give_the_exact_pose() {
    let folder = folder();
    let truth = json("dioptric/camera.json");
    let camera_file = "[cameras.lens]\nsize_px = [640, 480]\nmodel.equidistant = \
        { f_px_per_rad = 145.5622506548578, center_px = [319.5, 239.5], field_of_view_deg = 185.0 }\n";
    fs::write(folder.path().join("lens.toml"), camera_file).unwrap();
    let run = "calibrate pose data/dioptric/correspondences.csv --camera lens.toml --columns u=u_true_px,v=v_true_px -o out";
    pardalis(&folder, run).fine();
    let found = camera(&folder, "out/camera.toml", "lens");
    let (shift_m, turn_rad) =
        pose_error(&pose(&found), &json_matrix(&truth["T_world_from_camera"]));
    assert!(shift_m < 1e-5 && turn_rad < 1e-5, "{shift_m} {turn_rad}");
}

mod errors;
mod reports;
