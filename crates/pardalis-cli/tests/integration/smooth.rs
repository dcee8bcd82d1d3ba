//! `pardalis track --smooth`.

use std::fs;
use std::path::Path;

use nalgebra::Vector3;

use crate::common::{FRONT_LANDMARK, PLANE_ROBOT, REAR_LANDMARK, Run, Workplace, rows_in};

/// The ball of data/dioptric-jump, found without a start.
const DETECTED: &str = r#"seed = 1
[cameras.cam1]
images = "DATA/dioptric-jump/frames"
fps = 25
model.equidistant = { f_px_per_rad = 145.5622506548578, center_px = [319.5, 239.5], field_of_view_deg = 185.0 }
world_from_camera = [[0, -1, 0, 0], [-1, 0, 0, 0], [0, 0, -1, 0.9], [0, 0, 0, 1]]
[targets.ball]
shape.sphere.radius_m = 0.11
colors = "DATA/colors/orange-ball.hsi.colors.toml"
"#;

fn with_data(scene: &str) -> String {
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../data");
    scene.replace("DATA", data.to_str().unwrap())
}

/// Returns the root mean square errors of positions (m), and the median one of velocities (m/s), of rows.
fn errors(rows: &[Vec<String>]) -> [f64; 2] {
    let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../data/dioptric-jump/truth.csv");
    let truth = fs::read_to_string(file).unwrap();
    let truth: Vec<Vec<String>> = truth
        .lines()
        .skip(1)
        .map(|line| line.split(',').map(str::to_owned).collect())
        .collect();
    let vector = |cells: &[String], at: usize| {
        Vector3::from([0, 1, 2].map(|axis| cells[at + axis].parse::<f64>().unwrap()))
    };
    assert_eq!(rows.len(), truth.len());
    let (mut squares, mut speeds) = (0.0, Vec::new());
    for (row, truth) in rows.iter().zip(&truth) {
        assert_eq!(row[1].parse::<f64>(), truth[1].parse::<f64>());
        squares += (vector(row, 4) - vector(truth, 4)).norm_squared();
        speeds.push((vector(row, 7) - vector(truth, 7)).norm());
    }
    speeds.sort_by(f64::total_cmp);
    [
        (squares / rows.len() as f64).sqrt(),
        speeds[speeds.len() / 2],
    ]
}

#[test]
fn what_comes_after_makes_a_track_better() {
    let place = Workplace::with_frames(1);
    let scene = with_data(DETECTED);
    let run = place.track(&scene);
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    let filtered = fs::read(place.path("out/tracks.csv")).unwrap();
    let run = place.track_with(&scene, &["-o", "out", "--smooth"]);
    assert_eq!((run.code, &*run.stderr), (Some(0), ""));
    assert!(run.stdout.contains("out/filtered.csv"), "{}", run.stdout);
    // The rows of the filter are those of a run without smoothing.
    assert_eq!(fs::read(place.path("out/filtered.csv")).unwrap(), filtered);
    let before = rows_in(&String::from_utf8(filtered).unwrap());
    let after = place.rows();
    for (before, after) in before.iter().zip(&after) {
        assert_eq!(before[..4], after[..4]);
    }
    let [before_m, before_mps] = errors(&before);
    let [after_m, after_mps] = errors(&after);
    println!("{before_m} {before_mps} -> {after_m} {after_mps}");
    assert!(after_m < 0.7 * before_m, "{after_m} after {before_m}");
    assert!(
        after_mps < 0.6 * before_mps && after_mps < 0.08,
        "{after_mps} after {before_mps}"
    );
    // The throw and the first two bounces off the floor: data/dioptric-jump/camera.json.
    let events = fs::read_to_string(place.path("out/events.csv")).unwrap();
    let mut lines = events.lines();
    let header = lines.next().unwrap();
    assert!(
        header.starts_with("time_s,target,event,x_m,y_m,z_m,vx_before_mps,"),
        "{header}"
    );
    let contacts: Vec<Vec<&str>> = lines.map(|line| line.split(',').collect()).collect();
    for (contact, frame) in contacts.iter().zip([26.0, 39.03, 50.93]) {
        assert_eq!(contact[1..3], ["ball", "contact"]);
        let number = |column: usize| contact[column].parse::<f64>().unwrap();
        let off_frames = 25.0 * number(0) - frame;
        assert!(off_frames.abs() < 0.5, "{frame}: {off_frames}");
        if frame > 30.0 {
            // On the floor the ball's centre is at its radius. The restitution is 0.75; smoothed velocities change less.
            assert!((number(5) - 0.11).abs() < 0.06, "{contact:?}");
            let restitution = -number(11) / number(8);
            assert!((0.5..0.85).contains(&restitution), "{restitution}");
        }
    }
    assert!((3..12).contains(&contacts.len()), "{events}");
    // A later run without smoothing leaves no old file.
    let run = place.track(&scene);
    assert_eq!(run.code, Some(0));
    assert!(!place.path("out/filtered.csv").exists());
}

#[test]
fn contacts_depend_on_what_the_scene_says_and_does_not_know() {
    let place = Workplace::with_frames(1);
    let options = ["-o", "out", "--smooth", "--no-plots"];
    let contacts = |place: &Workplace| {
        let events = fs::read_to_string(place.path("out/events.csv")).unwrap();
        events.lines().count() - 1
    };
    let scene = with_data(DETECTED);
    let run = place.track_with(&scene, &options).fine();
    assert!(!run.stderr.contains("guessed"), "{}", run.stderr);
    let usual = contacts(&place);

    let scene = scene.replace(
        "seed = 1",
        "seed = 1\nguessed = [\"cameras.cam1.world_from_camera\"]",
    ) + "existence.velocity_jump_rate_hz = 0\n";
    let run = place.track_with(&scene, &options);
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    let without = contacts(&place);
    assert!(without < usual, "{without} of {usual}");
    let warning = "gravity, which acts along -z of the world, but cameras.cam1.world_from_camera is guessed: contacts in events.csv may be";
    assert!(run.stderr.contains(warning), "{}", run.stderr);
}

#[test]
fn targets_that_cannot_be_smoothed_are_named() {
    let place = Workplace::with_frames(1);
    let scene = with_data(&format!("{PLANE_ROBOT}{FRONT_LANDMARK}{REAR_LANDMARK}"));
    let run = place.track_with(&scene, &["-o", "out", "--smooth", "--no-plots"]);
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    let warning =
        "warning: targets.robot: cannot be smoothed, and its rows are those of the filter";
    assert!(run.stderr.contains(warning), "{}", run.stderr);
    assert_eq!(
        fs::read(place.path("out/filtered.csv")).unwrap(),
        fs::read(place.path("out/tracks.csv")).unwrap()
    );
}

#[test]
fn smoothing_needs_a_folder() {
    let place = Workplace::with_frames(1);
    let run: Run = place.track_with(with_data(DETECTED), &["-o", "-", "--smooth"]);
    run.refused(&["--smooth: replaces rows once the recording is over; give -o a folder"]);
}
