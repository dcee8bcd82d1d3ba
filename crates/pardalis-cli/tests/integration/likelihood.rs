//! `pardalis likelihood` on the first frame of data/dioptric-jump.

use std::fs;

use crate::common::run::Run;
use crate::common::{SCENE, Workplace};

/// The position of the ball in the first frame.
const TRUTH: &str = "1.35,-1.25,0.62";

fn likelihood(place: &Workplace, scene: &str, arguments: &[&str]) -> Run {
    place.write("scene.toml", scene);
    let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_pardalis"));
    command
        .current_dir(place.path(""))
        .args(["likelihood", "scene.toml", "-o", "out"])
        .args(arguments);
    Run::of(&mut command)
}

/// Returns the header and the columns of a table of numbers.
fn table(place: &Workplace, name: &str) -> (String, Vec<Vec<f64>>) {
    let text = fs::read_to_string(place.path(&format!("out/{name}"))).unwrap();
    let (header, rows) = text.split_once('\n').unwrap();
    let row = |line: &str| line.split(',').map(|cell| cell.parse().unwrap()).collect();
    let rows: Vec<Vec<f64>> = rows.lines().map(row).collect();
    let columns = (0..rows[0].len()).map(|i| rows.iter().map(|row| row[i]).collect());
    (header.to_owned(), columns.collect())
}

/// Returns the position of the maximum of a curve.
fn peak(x: &[f64], y: &[f64]) -> f64 {
    let best = (0..y.len()).max_by(|&a, &b| y[a].total_cmp(&y[b])).unwrap();
    x[best]
}

#[test]
fn the_true_size_and_position_are_likely_and_wider_contours_give_flatter_curves() {
    let place = Workplace::with_frames(2);
    let arguments = ["--at", TRUTH, "--contours", "0.7,1.3"];
    likelihood(&place, SCENE, &arguments).fine();
    for name in ["sampled", "scales", "ray"] {
        for kind in ["svg", "png"] {
            assert!(place.path(&format!("out/{name}.{kind}")).is_file());
        }
    }
    let (header, scales) = table(&place, "scales.csv");
    assert!(header.contains("0.9 and 1.1") && header.contains("0.7 and 1.3"));
    let [scale, near, far] = &scales[..] else {
        panic!("{header}");
    };
    for curve in [near, far] {
        let best = peak(scale, curve);
        assert!((0.7..1.2).contains(&best), "{best}");
        // An outline of twice the size is hardly more likely than pure background.
        assert!(curve.last().unwrap() < &(0.5 * curve.iter().copied().fold(0.0, f64::max)));
    }
    // The share of scales within 3 nats of the best: "wider and flatter" in the thesis (section 6.3).
    let width = |curve: &[f64]| {
        let most = curve.iter().copied().fold(f64::NEG_INFINITY, f64::max);
        curve.iter().filter(|&&nats| nats > most - 3.0).count()
    };
    assert!(
        width(far) > width(near),
        "{} and {}",
        width(far),
        width(near)
    );

    let (header, ray) = table(&place, "ray.csv");
    assert!(header.starts_with("distance_m,"), "{header}");
    // The ball is 1.86 m from the camera at (0, 0, 0.9).
    let best_m = peak(&ray[0], &ray[1]);
    assert!((1.5..2.6).contains(&best_m), "{best_m}");
}

#[test]
fn invalid_requests_are_rejected() {
    let place = Workplace::with_frames(1);
    let (detected, _) = SCENE.split_once("contour = ").unwrap();
    for (scene, arguments, wanted) in [
        (SCENE, &["--at", TRUTH, "--frame", "7"][..], "--frame 7"),
        (SCENE, &["--at", TRUTH, "--target", "cube"], "allowed: ball"),
        (
            SCENE,
            &["--at", TRUTH, "--contours", "1.2,1.3"],
            "inner_scale",
        ),
        (SCENE, &["--at", "0,0,3"], "cannot see"),
        (detected, &["--at", TRUTH], "contour cue"),
    ] {
        let run = likelihood(&place, scene, arguments);
        assert_eq!(run.code, Some(2), "{arguments:?}: {}", run.stderr);
        assert!(run.stderr.contains(wanted), "{arguments:?}: {}", run.stderr);
    }
}
