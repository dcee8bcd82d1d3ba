//! `pardalis evaluate` with circles in images.

use std::fmt::Write as _;
use std::fs;

use serde_json::Value;

use crate::common::{Run, SCENE, Workplace, data};

const FRAMES: usize = 8;

/// Returns the true pixel of the ball of data/dioptric-jump in each frame, and its radius there.
fn true_circles() -> Vec<[f64; 3]> {
    let text = fs::read_to_string(data().join("truth.csv")).unwrap();
    let circle = |line: &str| {
        let cells: Vec<&str> = line.split(',').collect();
        let number = |name: usize| cells[name].parse::<f64>().unwrap();
        let (u_px, v_px) = (number(13), number(14));
        let [x_m, y_m, z_m] = [10, 11, 12].map(number);
        let away_m = x_m.hypot(y_m);
        let (angle, half) = (away_m.atan2(z_m), (0.11 / away_m.hypot(z_m)).asin());
        // The fisheye lens stretches across the radius.
        let stretch = (angle / angle.sin()).sqrt();
        [u_px, v_px, 145.562_250_654_857_8 * half * stretch]
    };
    text.lines().skip(1).take(FRAMES).map(circle).collect()
}

/// Tracks the ball in the first frames without a start, with more lines at the end of the scene.
fn tracked(more: &str) -> Workplace {
    let place = Workplace::with_frames(FRAMES);
    let (scene, _) = SCENE.split_once("contour").unwrap();
    let colors = data().join("../colors/orange-ball.hsi.colors.toml");
    let scene = scene.replace("ball.toml", colors.to_str().unwrap()) + more;
    let run = place.track(scene);
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    place
}

fn evaluate(place: &Workplace, circles: &str, more: &[&str]) -> Run {
    place.write("circles.csv", circles);
    let arguments = [&["evaluate", "out", "circles.csv"], more].concat();
    Run::pardalis(place.path(""), &arguments)
}

/// Returns the figures of the only target.
fn figures(place: &Workplace, circles: &str, more: &[&str]) -> Value {
    let run = evaluate(place, circles, &[&["--json", "-"], more].concat()).fine();
    let report: Value = serde_json::from_str(&run.stdout).unwrap();
    let [target] = &report["targets"].as_array().unwrap()[..] else {
        panic!("one target: {report}");
    };
    target.clone()
}

#[test]
fn a_track_is_on_the_object_on_something_else_or_missing() {
    let place = tracked("");
    let circles = true_circles();
    let mut table = "frame,object,u_px,v_px,radius_px,visible_fraction\n".to_owned();
    for (frame, [u, v, radius]) in circles.iter().enumerate() {
        let _ = match frame {
            // Elsewhere, beside it, absent, not judged, and hidden for the most part.
            3 => writeln!(table, "3,ball,{},{v},{radius},1", u + 2.0 * radius),
            4 => writeln!(table, "4,ball,{u},{},{radius},1", v + 1.25 * radius),
            5 => writeln!(table, "5,ball,,,,0"),
            6 => writeln!(table, "6,ball,{u},{v},{radius},"),
            7 => writeln!(table, "7,ball,{u},{v},{radius},0.3"),
            _ => writeln!(table, "{frame},ball,{u},{v},{radius},1"),
        };
    }
    table += "500,ball,1,2,3,1\n";
    let found = figures(&place, &table, &[]);
    assert_eq!(
        (&found["target"], &found["camera"]),
        (&"ball".into(), &"cam1".into())
    );
    let count = |name: &str| found[name].as_u64().unwrap();
    assert_eq!((count("frames"), count("visible_frames")), (7, 5));
    assert_eq!(
        (count("on_object_frames"), count("elsewhere_frames")),
        (3, 2)
    );
    assert_eq!(count("circles_without_rows"), 1);
    assert_eq!(found["elsewhere_in"], serde_json::json!([3, 5]));
    assert_eq!(found["missed_in"], serde_json::json!([]));
    let median = |name: &str| found[name]["median"].as_f64().unwrap();
    assert!(median("center_error_radii") < 0.1, "{found}");
    assert!((median("radius_ratio") - 1.0).abs() < 0.05, "{found}");
    let report = evaluate(&place, &table, &[]).fine().stdout;
    for line in [
        "  on the object                                   60.0 %  3 of 5 visible\n",
        "  on something else                               28.6 %  2 of 7 judged\n",
        "  on something else in frames 3, 5\n",
        "  1 row of circles have no row in the tracks and do not count\n",
    ] {
        assert!(report.contains(line), "{line:?} in {report}");
    }

    // The same by times, of another name, and only a part of it.
    let mut times = "time_s,object,u_px,v_px,radius_px\n".to_owned();
    for (frame, [u, v, radius]) in circles.iter().enumerate() {
        let _ = writeln!(times, "{},toy,{u},{v},{radius}", 0.04 * frame as f64 + 0.01);
    }
    let found = figures(&place, &times, &["--from", "0.1", "--to", "0.2"]);
    assert_eq!(
        (&found["frames"], &found["on_object_share"]),
        (&3.into(), &1.0.into())
    );
    // Not tracked in any.
    let rows = fs::read_to_string(place.path("out/tracks.csv")).unwrap();
    place.write("out/tracks.csv", rows.replace(",tracking,", ",occluded,"));
    let found = figures(&place, &times, &[]);
    assert_eq!(found["on_object_share"], 0.0);
    assert_eq!(found["missed_in"].as_array().unwrap().len(), FRAMES);
}

#[test]
fn a_size_that_was_estimated_counts() {
    let place = tracked("");
    let mut table = "frame,u_px,v_px,radius_px\n".to_owned();
    for (frame, [u, v, radius]) in true_circles().iter().enumerate() {
        let _ = writeln!(table, "{frame},{u},{v},{radius}");
    }
    let ratio = |place: &Workplace| {
        figures(place, &table, &[])["radius_ratio"]["median"]
            .as_f64()
            .unwrap()
    };
    let of_scene = ratio(&place);
    let summary = fs::read_to_string(place.path("out/summary.json")).unwrap();
    let estimated =
        r#""estimated_radii": { "targets.ball": { "radius_m": 0.121, "sigma_m": 0.001 } }"#;
    place.write(
        "out/summary.json",
        summary.replace(r#""estimated_radii": {}"#, estimated),
    );
    assert!((ratio(&place) / of_scene - 1.1).abs() < 0.01);
}

#[test]
fn unusable_circles_are_refused_with_the_remedy() {
    let place = tracked("");
    let refused = |circles: &str, more: &[&str], wanted: &str| {
        evaluate(&place, circles, more).refused(&[wanted]);
    };
    let header = "frame,u_px,v_px,radius_px\n";
    let row = |rest: &str| format!("{header}{rest}\n");
    refused(
        &row("0,10,10,0"),
        &[],
        "circles.csv, line 2: radius_px is 0; allowed: above 0",
    );
    refused(
        &row("0,10,,5"),
        &[],
        "circles.csv, line 2, column v_px: is empty",
    );
    refused(
        &row("0.5,10,10,5"),
        &[],
        "column frame: holds \"0.5\"; allowed: a whole number",
    );
    refused(
        &row("0,10,10,5\n0,11,10,5"),
        &[],
        "circles.csv, line 3: object already has a circle in this image in line 2",
    );
    refused(
        &row("700,10,10,5"),
        &[],
        "none of its circles is in an image that out/tracks.csv has",
    );
    refused(
        &row("0,10,10,5"),
        &["--align"],
        "--align: circles.csv has circles in images",
    );
    refused(
        "u_px,v_px,radius_px\n1,2,3\n",
        &[],
        "circles need the column frame or time_s",
    );
    refused(
        "frame,camera,u_px,v_px,radius_px\n0,cam2,1,2,3\n",
        &[],
        "the scene has no camera cam2; it has cam1",
    );
    let two = "frame,object,u_px,v_px,radius_px\n0,a,1,2,3\n0,b,1,2,3\n";
    refused(two, &[], "none of its objects (a, b) is a target (ball)");
    let mapped = figures(&place, two, &["--map", "ball=b"]);
    assert_eq!(mapped["object"], "b");
    fs::remove_file(place.path("out/summary.json")).unwrap();
    refused(
        &row("0,10,10,5"),
        &[],
        "out/summary.json: there is none, but circles are compared",
    );
}
