//! `pardalis measure` on a small experiment.

use std::fs;
use std::process::Command;

use crate::common::{Run, SCENE, Workplace, data};

const EXPERIMENT: &str = r#"name = "small"
question = "Does it measure?"
[[runs]]
name = "first frames, few particles"
scene = "scene.toml"
truth = "truth.csv"
seeds = 3
verify_seeds = 1
expect = { coverage = [1, 1], direction_max_rad = [0, 0.1] }
[[runs]]
name = "again"
scene = "scene.toml"
truth = "truth.csv"
seeds = 2
"#;

const FIGURES: &str = "coverage,on_target_share,lost_frames,ends_on_target,frames_to_find,frames_to_occluded,frames_to_tracking,elsewhere_frames,overconfident_frames,mean_m,sd_m,rmse_m,max_m,best_rmse_m,distance_mean_m,distance_sd_m,\
    elevation_mean_rad,elevation_sd_rad,azimuth_mean_rad,azimuth_sd_rad,direction_max_rad,mean_nees,nees_99_low,nees_99_high,\
    planar_mean_m,planar_sd_m,planar_rmse_m,bias_x_m,bias_y_m,bias_z_m,velocity_rmse_mps,velocity_nees,course_error_median_rad,course_rad,\
    true_course_rad,heading_error_median_rad,heading_error_p95_rad,heading_bias_rad,changed_target,calibration_error,confidence_max,gospa_m,switches,\
    longest_missed_frames,longest_false_frames,estimates,ms_a_frame";

/// Creates a folder with the experiment, its scene of three frames and their truth.
fn workplace(experiment: &str) -> Workplace {
    let place = Workplace::with_frames(3);
    place.write("scene.toml", SCENE);
    let truth = fs::read_to_string(data().join("truth.csv")).unwrap();
    let rows: Vec<_> = truth.lines().take(4).collect();
    place.write("truth.csv", rows.join("\n") + "\n");
    place.write("small.toml", experiment);
    place
}

fn pardalis(place: &Workplace, arguments: &[&str]) -> Run {
    Run::pardalis(place.path(""), arguments)
}

/// Returns the rows of out/small/results.csv after checking the header.
fn results(place: &Workplace) -> Vec<String> {
    let text = fs::read_to_string(place.path("out/small/results.csv")).unwrap();
    let mut lines = text.lines().map(str::to_owned);
    assert_eq!(
        lines.next().unwrap(),
        format!("run,seed,target,object,window,{FIGURES}")
    );
    lines.collect()
}

/// Returns the figures of a row; `None` for empty fields.
fn figures_of(row: &str) -> Vec<Option<f64>> {
    let fields: Vec<&str> = row.split(',').collect();
    let figures = &fields[fields.len() - FIGURES.split(',').count()..];
    figures
        .iter()
        .map(|f| (!f.is_empty()).then(|| f.parse().unwrap()))
        .collect()
}

/// Returns the figure of that name.
fn value(figures: &[Option<f64>], name: &str) -> Option<f64> {
    figures[FIGURES.split(',').position(|f| f == name).unwrap()]
}

#[test]
fn every_seed_of_every_run_is_tracked_evaluated_and_recorded() {
    let place = workplace(EXPERIMENT);
    let run = pardalis(
        &place,
        &["measure", "small.toml", "--record", "record/today"],
    )
    .fine();
    assert!(
        run.stdout
            .contains("first frames, few particles: 3 tracks, RMSE "),
        "{}",
        run.stdout
    );
    let rows = results(&place);
    let starts: Vec<_> = rows
        .iter()
        .map(|row| row.split(",ball,ball,").next().unwrap())
        .collect();
    let first = "\"first frames, few particles\"";
    let again = "\"again\"";
    let wanted = [(first, 1), (first, 2), (first, 3), (again, 1), (again, 2)];
    assert_eq!(starts, wanted.map(|(run, seed)| format!("{run},{seed}")));
    let figures: Vec<_> = rows.iter().map(|row| figures_of(row)).collect();
    // A seed determines a run completely; different seeds give different results.
    assert_eq!(figures[0], figures[3]);
    assert_ne!(figures[0], figures[1]);
    for row in &figures {
        let of = |name| value(row, name);
        assert_eq!(
            ["coverage", "lost_frames", "ends_on_target", "estimates"].map(of),
            [Some(1.0), Some(0.0), Some(1.0), Some(3.0)]
        );
        assert!(
            of("mean_m") <= of("rmse_m") && of("rmse_m") <= of("max_m"),
            "{row:?}"
        );
        assert!(
            of("planar_rmse_m") < of("rmse_m") && of("velocity_rmse_mps") > Some(0.0),
            "{row:?}"
        );
        // The ball is at rest and alone; nothing was timed.
        assert_eq!(
            [
                "course_rad",
                "true_course_rad",
                "changed_target",
                "ms_a_frame"
            ]
            .map(of),
            [None; 4]
        );
    }
    for file in [
        "first-frames--few-particles/seed-03/tracks.csv",
        "first-frames--few-particles/above.svg",
        "again/seed-02/summary.json",
        "again/coordinates.png",
    ] {
        assert!(place.path(&format!("out/small/{file}")).is_file(), "{file}");
    }

    let pooled = fs::read_to_string(place.path("record/today/small-pooled.csv")).unwrap();
    let names: Vec<_> = pooled
        .lines()
        .skip(1)
        .map(|row| row.split(",ball,").next().unwrap())
        .collect();
    assert_eq!(names, [first, again]);
    let kept = fs::read(place.path("record/today/small.csv")).unwrap();
    assert_eq!(kept, fs::read(place.path("out/small/results.csv")).unwrap());
    let facts = fs::read_to_string(place.path("record/today/small.facts.txt")).unwrap();
    for wanted in [
        "command   pardalis measure small.toml\n",
        "version   0.",
        "commit    ",
        "cores     ",
    ] {
        assert!(facts.contains(wanted), "no {wanted:?} in: {facts}");
    }
}

#[test]
fn a_closed_pipe_does_not_stop_the_experiment() {
    let place = workplace(EXPERIMENT);
    let mut command = Command::new(env!("CARGO_BIN_EXE_pardalis"));
    let (reader, writer) = std::io::pipe().unwrap();
    drop(reader);
    let command = command.current_dir(place.path("")).stdout(writer);
    let status = command.args(["measure", "small.toml"]).status().unwrap();
    assert_eq!(status.code(), Some(0));
    assert_eq!(results(&place).len(), 5);
}

#[test]
fn verify_runs_only_the_first_seeds() {
    let place = workplace(EXPERIMENT);
    pardalis(
        &place,
        &["measure", "small.toml", "--verify", "--threads", "1"],
    )
    .fine();
    let rows = results(&place);
    assert_eq!(rows.len(), 1);
    assert!(
        rows[0].starts_with("\"first frames, few particles\",1,ball,"),
        "{}",
        rows[0]
    );
    assert!(!place.path("out/small/again").exists());
}

#[test]
fn figures_outside_their_bands_are_named_and_fail() {
    let place = workplace(&EXPERIMENT.replace("direction_max_rad = [0, 0.1]", "rmse_m = [5, 6]"));
    let run = pardalis(&place, &["measure", "small.toml", "-o", "out"]);
    assert_eq!(run.code, Some(1), "{}", run.stderr);
    assert!(
        run.stderr.contains("3 figures lie outside"),
        "{}",
        run.stderr
    );
    for seed in 1..=3 {
        let wanted = format!("first frames, few particles, seed {seed}, ball: rmse_m is 0.");
        assert!(
            run.stderr.contains(&wanted),
            "no {wanted:?} in: {}",
            run.stderr
        );
    }
    assert!(run.stderr.contains("expected 5 to 6"), "{}", run.stderr);
    // The results are kept nevertheless.
    assert_eq!(results(&place).len(), 5);
}

#[test]
fn invalid_experiments_are_rejected_by_name() {
    let cases: [(&str, &str, &[&str]); 6] = [
        ("question", "qestion", &["small.toml", "qestion"]),
        ("seeds = 3\n", "", &["small.toml", "seeds"]),
        (
            "coverage =",
            "coverge =",
            &["small.toml", "line 9: runs[1].expect.coverge", "coverage"],
        ),
        ("scene.toml", "none.toml", &["none.toml"]),
        ("truth.csv", "none.csv", &["none.csv"]),
        (
            "\"again\"",
            "\"First frames- few particles\"",
            &["small.toml", "the same folder", "names"],
        ),
    ];
    for (piece, other, wanted) in cases {
        assert!(EXPERIMENT.contains(piece), "{piece}");
        let place = workplace(&EXPERIMENT.replacen(piece, other, 1));
        pardalis(&place, &["measure", "small.toml"]).refused(wanted);
    }
    let place = workplace(EXPERIMENT);
    pardalis(&place, &["measure", "none.toml"]).refused(&["none.toml"]);
}

mod definition;
mod resume;
mod worlds;
