//! Crowds: any number of targets that look alike, from simulated images.

use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::fs;

use serde_json::Value;

use crate::common::{Run, rows_in};

/// Three balls cross one another's lines of sight; the fourth leaves the image, and the fifth comes in later.
const WORLD: &str = r"seed = 1
duration_s = 1.6
training_stills = 4
[cameras.cam1]
size_px = [320, 240]
model.pinhole = { f_px = [210, 210], center_px = [159.5, 119.5] }
look_from_m = [0.0, -2.4, 0.9]
look_at_m = [0.0, 1.0, 0.0]
[timing]
fps = 25
[image]
instants = 1
samples = 2
blur_px = 0.6
read_noise = 2.0
[ground]
texture.noise = { size_m = 0.4, octaves = 5, colors_srgb = [[95, 115, 95], [135, 145, 125]] }
";

const PATHS: [[[f64; 2]; 2]; 5] = [
    [[-0.5, 0.0], [0.5, 0.0]],
    [[0.5, 0.5], [-0.5, 0.5]],
    [[-0.2, 1.1], [0.3, 1.1]],
    [[1.4, 0.2], [3.6, 0.2]],
    [[-4.2, 0.8], [-1.0, 0.8]],
];

/// Simulates the world and tracks it; returns the folder with the results in `out`.
fn tracked(arguments: &[&str]) -> (tempfile::TempDir, Run) {
    let place = tempfile::tempdir().unwrap();
    let mut world = WORLD.to_owned();
    for (number, [[x0, y0], [x1, y1]]) in PATHS.iter().enumerate() {
        let _ = write!(
            world,
            "[objects.ball{number}]\ntarget = true\ncrowd = \"ball\"\nshape.sphere.radius_m = 0.1\ncolor_srgb = [235, 110, 30]\n\
             path.waypoints = {{ times_s = [0, 1.6], positions_m = [[{x0}, {y0}, 0.1], [{x1}, {y1}, 0.1]] }}\n"
        );
    }
    fs::write(place.path().join("world.toml"), world).unwrap();
    let run = Run::pardalis(&place, &["simulate", "world.toml", "-o", "made"]);
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    let track = ["track", "made/scene.toml", "-o", "out"];
    let run = Run::pardalis(&place, &[&track[..], arguments].concat());
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    (place, run)
}

#[test]
fn members_come_and_go_and_keep_their_numbers_where_they_cross() {
    let (place, run) = tracked(&["--annotate"]);
    let scene = fs::read_to_string(place.path().join("made/scene.toml")).unwrap();
    assert!(scene.contains("[targets.ball]\ncount = \"any\""), "{scene}");
    assert!(
        run.stdout.contains("ball: found 5, at most 5 at once"),
        "{}",
        run.stdout
    );
    let rows = rows_in(&fs::read_to_string(place.path().join("out/tracks.csv")).unwrap());
    let names: BTreeSet<&str> = rows.iter().map(|row| &*row[2]).collect();
    let expected = ["ball-1", "ball-2", "ball-3", "ball-4", "ball-5"];
    assert_eq!(names, BTreeSet::from(expected));
    // Nobody has a row before being found, and the one who left has none at the end.
    let of_frame = |frame: &str| rows.iter().filter(|row| row[0] == frame).count();
    assert_eq!((of_frame("5"), of_frame("39")), (4, 4));
    assert!(place.path().join("out/annotated/000039.jpg").exists());

    let checked = Run::pardalis(&place, &["check", "made/scene.toml"]);
    assert!(
        checked.stdout.contains("4 found in the first frames"),
        "{}",
        checked.stdout
    );
    let evaluated = Run::pardalis(&place, &["evaluate", "out", "made", "--json", "-"]);
    let report: Value = serde_json::from_str(&evaluated.stdout).unwrap();
    let crowd = &report["crowds"][0];
    assert_eq!(crowd["crowd"], "ball");
    assert_eq!(crowd["switches"], 0, "{crowd}");
    assert!(
        crowd["longest_missed_frames"].as_u64().unwrap() <= 3,
        "{crowd}"
    );
    assert!(
        crowd["longest_false_frames"].as_u64().unwrap() <= 3,
        "{crowd}"
    );
    assert!(crowd["gospa_m"].as_f64().unwrap() < 0.2, "{crowd}");
    assert_eq!(report["targets"].as_array().unwrap().len(), 5);
    for (option, expected) in [
        (
            ["--map", "ball-1=ball3"],
            "ball-1 is a member of the crowd ball",
        ),
        (["--crowd", "team"], "has no target team-1"),
    ] {
        let evaluate = ["evaluate", "out", "made"];
        let run = Run::pardalis(&place, &[&evaluate[..], &option].concat());
        assert_eq!(run.code, Some(2));
        assert!(run.stderr.contains(expected), "{}", run.stderr);
    }
    let table = Run::pardalis(&place, &["evaluate", "out", "made"]);
    assert!(
        table.stdout.contains("crowd ball: 5 members of 5 objects"),
        "{}",
        table.stdout
    );
}

#[test]
fn members_are_smoothed_explained_and_located_one_by_one() {
    let (place, _) = tracked(&["--smooth", "--explain", "--particles", "particles.csv"]);
    let rows = |name: &str| rows_in(&fs::read_to_string(place.path().join(name)).unwrap());
    let (smoothed, filtered) = (rows("out/tracks.csv"), rows("out/filtered.csv"));
    let labels =
        |rows: &[Vec<String>]| rows.iter().map(|row| row[..4].to_vec()).collect::<Vec<_>>();
    assert_eq!(labels(&smoothed), labels(&filtered));
    assert_ne!(smoothed, filtered);
    for name in ["out/candidates.csv", "particles.csv"] {
        let text = fs::read_to_string(place.path().join(name)).unwrap();
        let cells = |line: &str| line.split(',').map(str::to_owned).collect();
        let rows: Vec<Vec<String>> = text.lines().skip(1).map(cells).collect();
        let of = |name: &str| rows.iter().any(|row| row[2] == name);
        assert!(of("ball-1") && of("ball-4"), "{name}");
    }
    let image = place.path().join("made/frames/000010.png");
    let located = Run::pardalis(
        &place,
        &[
            "locate",
            "made/scene.toml",
            image.to_str().unwrap(),
            "-o",
            "still",
        ],
    );
    assert_eq!(located.code, Some(0), "{}", located.stderr);
    assert_eq!(rows("still/tracks.csv").len(), 4, "{}", located.stdout);
}
