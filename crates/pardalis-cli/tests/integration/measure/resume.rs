//! Parallel tracking of seeds, and resumption of interrupted experiments.

use std::fs;
use std::process::{Command, Stdio};
use std::time::{Duration, SystemTime};

use super::{EXPERIMENT, pardalis, workplace};
use crate::common::run::interrupt;
use crate::common::{Run, SCENE, Workplace, data};

const CSV: &str = "out/small/results.csv";
const FIRST: &str = "out/small/first-frames--few-particles";

/// Runs the experiment and returns its outcome and the bytes of results.csv.
fn measured(place: &Workplace, options: &[&str]) -> (Run, Vec<u8>) {
    let run = pardalis(place, &[&["measure", "small.toml"], options].concat()).fine();
    (run, fs::read(place.path(CSV)).unwrap())
}

/// Returns the modification times of the tracks of each seed.
fn times(place: &Workplace) -> Vec<SystemTime> {
    let seeds = [
        format!("{FIRST}/seed-01"),
        format!("{FIRST}/seed-02"),
        format!("{FIRST}/seed-03"),
        "out/small/again/seed-01".to_owned(),
        "out/small/again/seed-02".to_owned(),
    ];
    let time = |seed: &String| fs::metadata(place.path(&format!("{seed}/tracks.csv")))?.modified();
    seeds.iter().map(|seed| time(seed).unwrap()).collect()
}

/// Reports for each seed whether it was tracked again.
fn tracked_again(before: &[SystemTime], after: &[SystemTime]) -> Vec<bool> {
    before.iter().zip(after).map(|(b, a)| b != a).collect()
}

#[test]
fn results_do_not_depend_on_the_number_of_threads() {
    let place = workplace(EXPERIMENT);
    let (run, one) = measured(&place, &["--threads", "1"]);
    assert!(!run.stdout.contains("taken"), "{}", run.stdout);
    let (run, four) = measured(&place, &["--threads", "4", "--fresh"]);
    assert!(!run.stdout.contains("taken"), "{}", run.stdout);
    assert_eq!(one, four);
}

#[test]
fn only_missing_or_changed_seeds_are_tracked_again() {
    let place = workplace(EXPERIMENT);
    let (_, first) = measured(&place, &[]);
    let before = times(&place);

    fs::remove_file(place.path(&format!("{FIRST}/seed-02/finished.json"))).unwrap();
    let (run, again) = measured(&place, &[]);
    assert!(
        run.stdout.starts_with("4 of 5 seeds are already tracked"),
        "{}",
        run.stdout
    );
    assert_eq!(again, first);
    let after = times(&place);
    assert_eq!(
        tracked_again(&before, &after),
        [false, true, false, false, false]
    );

    // A damaged record is ignored.
    let damaged = place.path("out/small/again/seed-01/finished.json");
    fs::write(damaged, "{").unwrap();
    let (run, again) = measured(&place, &[]);
    assert!(run.stdout.starts_with("4 of 5"), "{}", run.stdout);
    assert_eq!(again, first);

    // Bands and evaluation options do not affect the tracks.
    place.write("small.toml", EXPERIMENT.replace("[0, 0.1]", "[0, 0.2]"));
    let (run, again) = measured(&place, &[]);
    assert!(run.stdout.starts_with("5 of 5"), "{}", run.stdout);
    assert_eq!(again, first);

    let before = times(&place);
    let (_, again) = measured(&place, &["--fresh"]);
    assert_eq!(again, first);
    assert_eq!(tracked_again(&before, &times(&place)), [true; 5]);
}

#[test]
fn another_scene_colour_model_or_frame_tracks_everything_again() {
    let place = workplace(EXPERIMENT);
    let (_, first) = measured(&place, &[]);
    let changes: [(&str, &dyn Fn()); 3] = [
        ("scene", &|| {
            place.write(
                "scene.toml",
                SCENE.replace("particles = 100", "particles = 110"),
            );
        }),
        ("colours", &|| {
            let colors = fs::read_to_string(place.path("ball.toml")).unwrap();
            place.write(
                "ball.toml",
                colors.replace("1, 432]", "1, 431]").replace("1553", "1552"),
            );
        }),
        ("frame", &|| {
            fs::copy(data().join("frames/000040.jpg"), place.image(2)).unwrap();
        }),
    ];
    let mut before = first;
    for (what, change) in changes {
        change();
        let (run, after) = measured(&place, &[]);
        assert!(!run.stdout.contains("taken"), "{what}: {}", run.stdout);
        assert_ne!(after, before, "{what}");
        before = after;
    }
}

#[test]
fn an_interrupted_experiment_keeps_finished_seeds_and_resumes() {
    let many = EXPERIMENT
        .replace("seeds = 3", "seeds = 40")
        .replace("few particles", "few particles, many seeds");
    let place = workplace(&many);
    let mut child = Command::new(env!("CARGO_BIN_EXE_pardalis"))
        .current_dir(place.path(""))
        .args(["measure", "small.toml", "--threads", "2"])
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let third = place.path(&format!("{FIRST}--many-seeds/seed-03/finished.json"));
    while !third.exists() {
        assert!(child.try_wait().unwrap().is_none(), "it ended early");
        std::thread::sleep(Duration::from_millis(1));
    }
    let Run { code, stderr, .. } = interrupt(child);
    assert_eq!(code, Some(1), "{stderr}");
    assert!(
        stderr.contains("interrupted: ") && stderr.contains(" of 42 seeds"),
        "{stderr}"
    );
    assert!(!place.path(CSV).exists());

    let (run, resumed) = measured(&place, &[]);
    let taken: usize = run.stdout.split(' ').next().unwrap().parse().unwrap();
    assert!((2..42).contains(&taken), "{}", run.stdout);
    let (_, whole) = measured(&place, &["--fresh"]);
    assert_eq!(resumed, whole);
}
