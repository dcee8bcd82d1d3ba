//! Simulated recordings: one for all seeds, or one for each.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use super::{pardalis, workplace};

const WORLD: &str = r"
duration_s = 0.2
training_stills = 2
[cameras.cam1]
size_px = [96, 72]
model.pinhole = { f_px = [100, 100], center_px = [47.5, 35.5] }
look_from_m = [-0.6, 0, 0.3]
look_at_m = [0, 0, 0.1]
[image]
read_noise = 3
[objects.ball]
target = true
shape.sphere.radius_m = 0.05
color_srgb = [225, 70, 130]
path.still.position_m = [0, 0, 0.1]
";

const FRESH: &str = r#"name = "small"
question = "Are confidences right?"
[[sweeps]]
name = "fresh"
world = "world.toml"
fresh_world = true
seeds = 2
set = { "targets.ball.filter.particles" = 100 }
key = "world.objects.ball.path.still.position_m"
values = [[0, 0, 0.1], [0.05, 0, 0.1]]
names = ["here", "there"]
windows = [{ name = "late", from_s = 0.1 }]
[[runs]]
name = "shared"
world = "world.toml"
seeds = 2
set = { "targets.ball.filter.particles" = 100 }
[[figures]]
name = "sure"
kind = "reliability"
runs = ["fresh", "shared"]
"#;

#[test]
fn each_seed_has_its_own_world_and_all_are_pooled() {
    let place = workplace(FRESH);
    place.write("world.toml", WORLD);
    pardalis(&place, &["measure", "small.toml"]).fine();
    let image = |run: &str, world: &str| {
        fs::read(place.path(&format!("out/small/{run}/{world}/frames/000000.png"))).unwrap()
    };
    assert_ne!(
        image("fresh--here", "world-01"),
        image("fresh--here", "world-02")
    );
    // The world's own seed is 1.
    assert_eq!(image("fresh--here", "world-01"), image("shared", "world"));

    let pooled = fs::read_to_string(place.path("out/small/pooled.csv")).unwrap();
    let mut rows = pooled.lines();
    assert_eq!(
        rows.next().unwrap(),
        "run,target,window,recordings,mean_nees,nees_99_low,nees_99_high,rows,calibration_error,confidence_max,elsewhere_frames,overconfident_frames"
    );
    let rows: Vec<Vec<&str>> = rows.map(|row| row.split(',').collect()).collect();
    let of = |column: usize| rows.iter().map(|row| row[column]).collect::<Vec<_>>();
    assert_eq!(of(0), ["\"shared\"", "\"fresh\"", "\"fresh\""]);
    assert_eq!(of(2), ["", "", "\"late\""]);
    // Five frames each; seeds that share their images count as one recording, whose scatter is unknown.
    assert_eq!((of(3), of(7)), (vec!["1", "4", "4"], vec!["10", "20", "8"]));
    let number = |row: usize, column: usize| rows[row][column].parse::<f64>().unwrap();
    assert!(number(1, 5) < number(1, 4) && number(1, 4) < number(1, 6));
    assert_eq!((rows[0][5], rows[0][6]), ("", ""));
    assert!((0.0..=1.0).contains(&number(1, 8)) && number(1, 9) <= 1.0);

    let svg = fs::read_to_string(place.path("out/small/sure-reliability.svg")).unwrap();
    let error = number(1, 8);
    assert!(svg.contains(&format!("{error:.3}")), "{error}");

    for (piece, other, wanted) in [
        (
            "world = \"world.toml\"",
            "scene = \"scene.toml\"\ntruth = \"truth.csv\"",
            "fresh_world needs the key world",
        ),
        (
            "\"targets.ball.filter.particles\" = 100",
            "\"world.seed\" = 4",
            "world.seed has no effect",
        ),
    ] {
        place.write("small.toml", FRESH.replace(piece, other));
        pardalis(&place, &["measure", "small.toml"]).refused(&[
            "small.toml: ",
            " in the experiment:",
            wanted,
        ]);
    }
}

/// Returns the bytes of all files in a folder.
fn files_in(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut files = BTreeMap::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            files.extend(files_in(&path));
        } else {
            let bytes = fs::read(&path).unwrap();
            files.insert(path, bytes);
        }
    }
    files
}

#[test]
fn worlds_simulated_in_parallel_equal_those_simulated_in_sequence() {
    let place = workplace(&FRESH.replace("seeds = 2", "seeds = 3"));
    place.write("world.toml", WORLD);
    let run = place.path("out/small/fresh--here");
    let worlds = |threads: &str| {
        let _ = fs::remove_dir_all(place.path("out"));
        pardalis(&place, &["measure", "small.toml", "--threads", threads]).fine();
        let worlds = ["world-01", "world-02", "world-03"].map(|world| files_in(&run.join(world)));
        // Each has five images and further files.
        assert!(worlds.iter().all(|files| files.len() > 5));
        worlds
    };
    let one_by_one = worlds("1");
    assert_eq!(worlds("2"), one_by_one);
    assert_eq!(worlds("5"), one_by_one);
}

#[test]
fn the_first_invalid_recording_is_reported_for_any_number_of_threads() {
    let place = workplace(&FRESH.replacen("ball.filter.particles", "ball.filter.partikles", 1));
    place.write("world.toml", WORLD);
    for threads in ["1", "3"] {
        let run = pardalis(&place, &["measure", "small.toml", "--threads", threads]);
        run.refused(&["run \"fresh: here\"", "world-01/scene.toml", "partikles"]);
    }
}
