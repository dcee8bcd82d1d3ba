//! The contents of an experiment file: settings, sweeps, windows, times.

use std::fs;

use super::{figures_of, pardalis, results, value, workplace};
use crate::common::{SCENE, Workplace, data};

const RUN: &str = r#"name = "small"
question = "Which settings are valid?"
[[runs]]
name = "a"
scene = "scene.toml"
truth = "truth.csv"
seeds = 1
"#;

/// Returns the run with additional lines.
fn run_with(lines: &str) -> String {
    format!("{RUN}{lines}\n")
}

/// Returns a setting of a seed as resolved by `pardalis track`.
fn setting(place: &Workplace, folder: &str, pointer: &str) -> serde_json::Value {
    let summary =
        fs::read(place.path(&format!("out/small/{folder}/seed-01/summary.json"))).unwrap();
    let summary: serde_json::Value = serde_json::from_slice(&summary).unwrap();
    summary["settings"].pointer(pointer).unwrap().clone()
}

#[test]
fn settings_of_a_run_override_those_of_the_scene() {
    let set = r#"set = { "targets.ball.filter.particles" = 150, "targets.ball.motion" = { constant_velocity.acceleration_sigma_mps2 = 3 } }"#;
    let place = workplace(&run_with(set));
    pardalis(&place, &["measure", "small.toml"]).fine();
    let with_set = results(&place);
    assert_eq!(setting(&place, "a", "/targets/ball/filter/particles"), 150);

    // A scene with the same settings gives the same track.
    let scene = SCENE.replace("particles = 100", "particles = 150").replace(
        "acceleration_density_m2ps3 = 100",
        "acceleration_sigma_mps2 = 3",
    );
    place.write("scene.toml", scene);
    place.write("small.toml", RUN);
    pardalis(&place, &["measure", "small.toml", "--fresh"]).fine();
    assert_eq!(results(&place), with_set);
}

#[test]
fn invalid_settings_name_experiment_run_scene_and_key() {
    let cases: [(&str, &[&str]); 3] = [
        (
            r#"set = { "targets.ball.filter.partikles" = 150 }"#,
            &["targets.ball.filter.partikles: is not a key; did you mean particles?"],
        ),
        (
            r#"set = { "targets.ball.filter.particles" = 0 }"#,
            &["as set: targets.ball.filter.particles: is 0"],
        ),
        (
            r#"set = { "targets.ball.colors" = "none.toml" }"#,
            &["as set: targets.ball.colors: none.toml: cannot be read"],
        ),
    ];
    for (set, wanted) in cases {
        let place = workplace(&run_with(set));
        let run = pardalis(&place, &["measure", "small.toml"]);
        run.refused(&["error: small.toml: run \"a\": scene.toml: a problem in the scene:"]);
        run.refused(wanted);
    }
    let place = workplace(&run_with(
        r#"set = { "targets.ball.filter.particles" = 0 }"#,
    ));
    place.write("scene.toml", SCENE.replace("fps = 25", "fps = -1"));
    let run = pardalis(&place, &["measure", "small.toml"]);
    run.refused(&[
        "2 problems in the scene",
        "line 4: cameras.cam1.fps: is -1",
        "as set: ",
    ]);
}

#[test]
fn sweeps_become_runs() {
    let sweeps = r#"
[[sweeps]]
name = "particles"
scene = "scene.toml"
truth = "truth.csv"
seeds = 1
set = { "targets.ball.contour.points" = 30 }
key = "targets.ball.filter.particles"
values = [50, 60]
[[sweeps]]
name = "scales"
scene = "scene.toml"
truth = "truth.csv"
seeds = 1
key = ["targets.ball.contour.inner_scale", "targets.ball.contour.outer_scale"]
values = [[0.9, 1.1], [0.7, 1.3]]
[[sweeps]]
name = "motion"
scene = "scene.toml"
truth = "truth.csv"
seeds = 1
key = "targets.ball.motion"
values = [{ constant_velocity.acceleration_sigma_mps2 = 3 }, { constant_velocity.acceleration_density_m2ps3 = 2 }]
names = ["smooth", "rough"]
"#;
    let place = workplace(&run_with(sweeps));
    pardalis(&place, &["measure", "small.toml"]).fine();
    let rows = results(&place);
    let names: Vec<_> = rows.iter().map(|r| r.split('"').nth(1).unwrap()).collect();
    let wanted = [
        "a",
        "particles: 50",
        "particles: 60",
        "scales: 0.9, 1.1",
        "scales: 0.7, 1.3",
        "motion: smooth",
        "motion: rough",
    ];
    assert_eq!(names, wanted);
    let target = "/targets/ball";
    let contour = |folder, key| setting(&place, folder, &format!("{target}/contour/{key}"));
    assert_eq!(contour("particles--60", "points"), 30);
    assert_eq!(
        setting(
            &place,
            "particles--60",
            &format!("{target}/filter/particles")
        ),
        60
    );
    assert_eq!(contour("scales--0-7--1-3", "inner_scale"), 0.7);
    assert_eq!(contour("scales--0-7--1-3", "outer_scale"), 1.3);

    for (piece, other, wanted) in [
        ("values = [50, 60]\n", "", "sweeps[1].values: is missing"),
        ("[0.9, 1.1]", "[0.9]", "not a list of 2 values"),
        (
            "\"smooth\", ",
            "",
            "the numbers of names and of values differ",
        ),
        ("names = [\"smooth\", \"rough\"]", "", "names = [..]"),
    ] {
        assert!(sweeps.contains(piece), "{piece}");
        place.write("small.toml", run_with(&sweeps.replace(piece, other)));
        pardalis(&place, &["measure", "small.toml"]).refused(&[
            "small.toml: ",
            ": sweeps[",
            wanted,
        ]);
    }
    place.write("small.toml", run_with("key = \"seed\"\nvalues = [1]"));
    pardalis(&place, &["measure", "small.toml"]).refused(&["runs[1].key", "[[sweeps]]"]);
}

#[test]
fn windows_are_evaluated_separately_with_their_own_bands() {
    let windows = r#"windows = [
    { name = "at first", from_s = 0, to_s = 0.04 },
    { name = "late", from_s = 0.08, to_s = 9, expect = { estimates = [1, 1], rmse_m = [5, 6] } },
]"#;
    let place = workplace(&run_with(windows));
    let run = pardalis(&place, &["measure", "small.toml"]);
    assert_eq!(run.code, Some(1), "{}", run.stderr);
    assert!(
        run.stderr.contains("1 figures lie outside"),
        "{}",
        run.stderr
    );
    assert!(
        run.stderr.contains("a, late, seed 1, ball: rmse_m is 0."),
        "{}",
        run.stderr
    );
    let rows = results(&place);
    let starts = [
        "\"a\",1,ball,ball,,",
        "\"a\",1,ball,ball,\"at first\",",
        "\"a\",1,ball,ball,\"late\",",
    ];
    assert_eq!(rows.len(), 3);
    let figures: Vec<_> = rows.iter().map(|row| figures_of(row)).collect();
    for (row, start) in rows.iter().zip(starts) {
        assert!(row.starts_with(start), "{row}");
    }
    let estimates: Vec<_> = figures.iter().map(|f| value(f, "estimates")).collect();
    assert_eq!(estimates, [Some(3.0), Some(2.0), Some(1.0)]);
    let square = |i: usize| value(&figures[i], "rmse_m").unwrap().powi(2);
    assert!((3.0 * square(0) - 2.0 * square(1) - square(2)).abs() < 1e-9);

    for (piece, other, wanted) in [
        ("from_s = 0,", "from_s = 1,", "from_s must be before to_s"),
        (
            "\"late\"",
            "\"at first\"",
            "its name is empty or used twice",
        ),
        (
            "rmse_m",
            "rmsee_m",
            "line 10: runs[1].windows[2].expect.rmsee_m: is not a figure",
        ),
        ("from_s = 0.08", "from_s = 7", "no frame of"),
    ] {
        place.write("small.toml", run_with(&windows.replace(piece, other)));
        let run = pardalis(&place, &["measure", "small.toml"]);
        assert_eq!(run.code, Some(2), "{}", run.stderr);
        for wanted in ["small.toml: ", wanted] {
            assert!(
                run.stderr.contains(wanted),
                "no {wanted:?} in: {}",
                run.stderr
            );
        }
    }
}

#[test]
fn angles_and_distances_are_relative_to_the_origin() {
    let place = workplace(&run_with("origin_m = [1.35, -1.25, -3.0]"));
    pardalis(&place, &["measure", "small.toml"]).fine();
    let from_below = figures_of(&results(&place)[0]);
    place.write("small.toml", RUN);
    pardalis(&place, &["measure", "small.toml"]).fine();
    let from_camera = figures_of(&results(&place)[0]);
    assert_eq!(value(&from_below, "rmse_m"), value(&from_camera, "rmse_m"));
    assert_ne!(
        value(&from_below, "distance_mean_m"),
        value(&from_camera, "distance_mean_m")
    );
}

#[test]
fn timed_runs_report_and_keep_the_time_per_frame() {
    let place = workplace(&run_with("timed = true"));
    pardalis(&place, &["measure", "small.toml"]).fine();
    let first = results(&place);
    let ms_a_frame = value(&figures_of(&first[0]), "ms_a_frame");
    assert!(ms_a_frame.is_some_and(|ms| ms > 0.0), "{ms_a_frame:?}");
    pardalis(&place, &["measure", "small.toml"]).fine();
    assert_eq!(results(&place), first);
}

#[test]
fn a_track_that_ends_on_another_object_is_reported() {
    let place = workplace(RUN);
    let truth = fs::read_to_string(data().join("truth.csv")).unwrap();
    let mut rows: Vec<String> = truth.lines().take(4).map(str::to_owned).collect();
    let twins = |dx_m: &str| -> Vec<String> {
        let rows = rows[1..].iter();
        rows.map(|row| {
            row.replacen(",ball,", ",twin,", 1)
                .replacen("1.350000", dx_m, 1)
        })
        .collect()
    };
    let far = twins("5.000000");
    let near = twins("1.351000");
    // The track has the name of the ball; its twin is far away.
    rows.extend(far);
    place.write("truth.csv", rows.join("\n") + "\n");
    pardalis(&place, &["measure", "small.toml"]).fine();
    assert_eq!(
        value(&figures_of(&results(&place)[0]), "changed_target"),
        Some(0.0)
    );
    // Now the object named like the ball is far away, and its twin is at the ball's position.
    let swapped: Vec<String> = rows[..4]
        .iter()
        .map(|row| row.replacen("1.350000", "5.000000", 1))
        .chain(near)
        .collect();
    place.write("truth.csv", swapped.join("\n") + "\n");
    pardalis(&place, &["measure", "small.toml"]).fine();
    assert_eq!(
        value(&figures_of(&results(&place)[0]), "changed_target"),
        Some(1.0)
    );
}

const FIGURES: &str = r#"
[[sweeps]]
name = "particles"
scene = "scene.toml"
truth = "truth.csv"
seeds = 2
timed = true
key = "targets.ball.filter.particles"
values = [50, 60]
[[figures]]
name = "over-one-another"
kind = "paths"
runs = ["a", "particles"]
[[figures]]
name = "distances"
kind = "errors"
runs = ["a", "particles: 60"]
[[figures]]
name = "cost"
kind = "sweep"
runs = ["particles"]
x_name = "particles"
"#;

#[test]
fn figures_show_several_runs_and_are_copied_as_png() {
    let place = workplace(&run_with(FIGURES));
    pardalis(&place, &["measure", "small.toml", "--figures", "pictures"]).fine();
    let svg =
        |name: &str| fs::read_to_string(place.path(&format!("out/small/{name}.svg"))).unwrap();
    for text in ["a", "particles: 50", "particles: 60"] {
        assert!(svg("over-one-another-top").contains(text), "{text}");
    }
    let errors = svg("distances-errors");
    assert!(errors.contains("particles: 60") && !errors.contains("particles: 50"));
    let sweep = svg("cost-sweep");
    assert!(sweep.contains("particles") && sweep.contains("time per frame (ms)"),);
    let mut copied: Vec<_> = fs::read_dir(place.path("pictures"))
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    copied.sort();
    let wanted = [
        "cost-sweep.png",
        "distances-errors.png",
        "over-one-another-3d.png",
        "over-one-another-top.png",
    ];
    assert_eq!(copied, wanted);

    for (piece, other, wanted) in [
        (
            "\"particles: 60\"",
            "\"particles: 70\"",
            "\"particles: 70\" is not a run or sweep",
        ),
        ("[\"particles\"]", "[\"a\"]", "\"a\" is not a sweep"),
        ("\"cost\"", "\"distances\"", "the name is used twice"),
        (
            "\"cost\"",
            "\"../cost\"",
            "allowed: 1 to 64 of the characters",
        ),
        (
            "x_name = \"particles\"",
            "figure = \"mean_nees\"",
            "allowed: mean_m, sd_m",
        ),
        ("\"errors\"", "\"erors\"", "erors"),
    ] {
        assert!(FIGURES.contains(piece), "{piece}");
        place.write("small.toml", run_with(&FIGURES.replace(piece, other)));
        pardalis(&place, &["measure", "small.toml"]).refused(&["small.toml", wanted]);
    }
}

#[test]
fn single_images_are_located_from_their_starts() {
    let place = workplace(&run_with("method = \"locate\"\nstarts = \"truth.csv\""));
    pardalis(&place, &["measure", "small.toml"]).fine();
    let first = results(&place);
    let figures = figures_of(&first[0]);
    assert_eq!(value(&figures, "estimates"), Some(3.0));
    assert_eq!(value(&figures, "velocity_rmse_mps"), None);
    assert!(
        value(&figures, "rmse_m").is_some_and(|m| m < 0.3),
        "{first:?}"
    );
    assert_eq!(
        setting(&place, "a", "/locate/starts").as_str(),
        Some("truth.csv")
    );
    // Other starts give other results.
    let taken = pardalis(&place, &["measure", "small.toml"]).fine().stdout;
    assert!(taken.starts_with("1 of 1 seeds"), "{taken}");
    let truth = fs::read_to_string(place.path("truth.csv")).unwrap();
    place.write("starts.csv", truth.replace("1.350000", "1.300000"));
    place.write(
        "small.toml",
        run_with("method = \"locate\"\nstarts = \"starts.csv\""),
    );
    pardalis(&place, &["measure", "small.toml"]).fine();
    assert_ne!(results(&place), first);

    place.write("small.toml", run_with("starts = \"truth.csv\""));
    pardalis(&place, &["measure", "small.toml"])
        .refused(&["runs[1].starts", "method = \"locate\""]);
    place.write("small.toml", run_with("method = \"find\""));
    pardalis(&place, &["measure", "small.toml"]).refused(&["small.toml", "find", "locate"]);
}

#[test]
fn the_example_in_the_help_text_is_valid() {
    let place = workplace(RUN);
    let help = pardalis(&place, &["measure", "--help"]).fine().stdout;
    let example = help.split("EXPERIMENT.toml:\n").nth(1).unwrap();
    place.write("small.toml", example.replace("ball.toml", "none.toml"));
    // Only its scene is missing.
    let run = pardalis(&place, &["measure", "small.toml"]);
    run.refused(&["run \"near\": none.toml: cannot be read: there is no such file"]);
}
