//! Bodies that turn, from simulated images: heading and position of boxes and of rectangles on the ground.

use std::f64::consts::{PI, TAU};
use std::fs;

use crate::common::{Run, rows_in};

/// A box drives around a corner and stops.
const WORLD: &str = r"seed = 1
duration_s = 3.0
training_stills = 4
[cameras.cam1]
size_px = [320, 240]
model.pinhole = { f_px = [260, 260], center_px = [159.5, 119.5] }
look_from_m = [0.0, -9.0, 7.0]
look_at_m = [0.0, 0.0, 0.0]
[timing]
fps = 20
[image]
instants = 1
samples = 2
blur_px = 0.6
read_noise = 2.0
[ground]
texture.noise = { size_m = 0.8, octaves = 5, colors_srgb = [[95, 100, 95], [135, 135, 130]] }
[objects.car]
target = true
shape.box.size_m = [1.8, 0.7, 0.5]
color_srgb = [30, 90, 200]
[objects.car.path.waypoints]
times_s = [0.0, 0.8, 1.6, 2.4]
positions_m = [[-2.0, -1.2, 0], [0.0, -1.2, 0], [1.2, -0.2, 0], [1.4, 1.6, 0]]
";

type Rows = Vec<Vec<String>>;

/// Simulates the world and tracks it with these changes to the scene; returns the rows, those of the filter if they were smoothed, and the truth.
fn tracked(world: &str, changes: &[(&str, &str)], options: &[&str]) -> (Rows, Option<Rows>, Rows) {
    let place = tempfile::tempdir().unwrap();
    fs::write(place.path().join("world.toml"), world).unwrap();
    let run = Run::pardalis(&place, &["simulate", "world.toml", "-o", "made"]);
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    let path = place.path().join("made/scene.toml");
    let mut scene = fs::read_to_string(&path).unwrap();
    for (piece, other) in changes {
        assert!(scene.contains(piece), "{scene}");
        scene = scene.replace(piece, other);
    }
    fs::write(&path, scene).unwrap();
    let track = ["track", "made/scene.toml", "-o", "out", "--annotate"];
    let run = Run::pardalis(&place, &[&track[..], options].concat());
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    let text = |path: &str| fs::read_to_string(place.path().join(path)).unwrap();
    let fields = |line: &str| line.split(',').map(str::to_owned).collect();
    let truth = text("made/truth.csv").lines().skip(1).map(fields).collect();
    let filtered = options
        .contains(&"--smooth")
        .then(|| rows_in(&text("out/filtered.csv")));
    (rows_in(&text("out/tracks.csv")), filtered, truth)
}

fn number(text: &str) -> f64 {
    text.parse().unwrap()
}

/// The errors of a row: of the position on the ground in metres, and of the heading in radians.
fn errors(row: &[String], truth: &[String]) -> (f64, f64) {
    assert_eq!(row[0], truth[0]);
    let [x, y] = [4, 5].map(|column| number(&row[column]) - number(&truth[column]));
    let off_rad = number(&row[10]) - number(&truth[16]);
    (x.hypot(y), (off_rad + PI).rem_euclid(TAU) - PI)
}

#[test]
fn boxes_and_rectangles_that_turn_are_followed_with_their_heading() {
    let flat = [(
        "shape.box.size_m = [1.8, 0.7, 0.01]",
        "shape.rectangle.size_m = [1.8, 0.7]",
    )];
    for (height, changes) in [("0.5]", &[][..]), ("0.01]", &flat)] {
        let world = WORLD.replace("0.5]\ncolor", &format!("{height}\ncolor"));
        let (rows, _, truth) = tracked(&world, changes, &[]);
        assert_eq!(rows.len(), 60);
        for (row, truth) in rows.iter().zip(&truth) {
            assert_eq!(row[3], "tracking", "{row:?}");
            let (off_m, off_rad) = errors(row, truth);
            // A twentieth of its length.
            assert!(off_m < 0.09, "{height} frame {}: {off_m} m", row[0]);
            let sigma_rad = number(&row[24]);
            if number(&row[1]) < 0.5 {
                // It may not be known yet where the front is.
                assert!(off_rad.abs() < 3.0 * sigma_rad, "{off_rad} {sigma_rad}");
            } else {
                assert!(off_rad.abs() < 0.04, "{height} frame {}: {off_rad}", row[0]);
                assert!(sigma_rad < 0.1, "{sigma_rad}");
            }
        }
    }
}

#[test]
fn smoothed_bodies_stay_on_the_ground() {
    let (rows, filtered, truth) = tracked(WORLD, &[], &["--smooth"]);
    assert!(
        rows.iter().all(|row| row[6] == "0" && row[9] == "0"),
        "{:?}",
        rows[0]
    );
    let filtered = filtered.unwrap();
    for (row, truth) in rows.iter().zip(&truth) {
        let (off_m, _) = errors(row, truth);
        assert!(off_m < 0.09, "frame {}: {off_m} m", row[0]);
    }
    // Headings stay those of the filter.
    assert!(rows.iter().zip(&filtered).all(|(a, b)| a[10] == b[10]));
}

#[test]
fn a_heading_is_not_learnt_from_what_is_left_of_a_body_behind_a_post() {
    let post = "[objects.post]\nshape.box.size_m = [0.5, 0.3, 2.0]\ncolor_srgb = [120, 90, 60]\npath.still.position_m = [0.75, -1.4, 0]\n";
    let (rows, _, truth) = tracked(&format!("{WORLD}{post}"), &[], &[]);
    let truth: Vec<_> = truth.into_iter().filter(|row| row[2] == "car").collect();
    let hidden = truth.iter().filter(|row| number(&row[15]) < 0.7).count();
    assert!(hidden > 5, "{hidden}");
    for (row, truth) in rows.iter().zip(&truth) {
        if number(&row[1]) > 0.5 && !row[10].is_empty() {
            let (_, off_rad) = errors(row, truth);
            let sigma_rad = number(&row[24]);
            assert!(off_rad.abs() < 3.0 * sigma_rad + 0.03, "{row:?}: {off_rad}");
        }
    }
}

#[test]
fn bodies_that_do_not_turn_by_their_scene_have_no_heading() {
    let size = "shape.box.size_m = [1.8, 0.7, 0.5]";
    let fixed = "shape.box = { size_m = [1.8, 0.7, 0.5], turns = false }";
    let (rows, ..) = tracked(WORLD, &[(size, fixed)], &[]);
    assert!(
        rows.iter()
            .all(|row| row[10].is_empty() && row[24].is_empty())
    );
    // Along the x axis it is as described.
    assert_eq!(rows[4][3], "tracking");
}

#[test]
fn published_cues_that_are_said_to_estimate_the_yaw_are_warned_of() {
    let place = tempfile::tempdir().unwrap();
    fs::write(place.path().join("world.toml"), WORLD).unwrap();
    let run = Run::pardalis(&place, &["simulate", "world.toml", "-o", "made"]);
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    let path = place.path().join("made/scene.toml");
    let scene = fs::read_to_string(&path).unwrap().replace(
        "shape.box.size_m = [1.8, 0.7, 0.5]",
        "shape.box = { size_m = [1.8, 0.7, 0.5], turns = true }\ncontour = {}\nstart.gaussian.position_m = [-2, -1.2, 0]",
    );
    fs::write(&path, scene).unwrap();
    let run = Run::pardalis(&place, &["track", "made/scene.toml", "-o", "out"]);
    let warning = "targets.car.shape: has turns = true, which has no effect on the published cues";
    assert!(run.stderr.contains(warning), "{}", run.stderr);
}
