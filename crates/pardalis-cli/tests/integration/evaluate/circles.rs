//! `pardalis evaluate` with circles in images.

use std::fmt::Write as _;
use std::fs;

use serde_json::Value;

use crate::common::{Run, SCENE, Workplace, data, frame_file};

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
        "  not counted: 1 image of which the tracks have no row\n",
    ] {
        assert!(report.contains(line), "{line:?} in {report}");
    }

    // The same by times, of another name, and only a part of it.
    let mut times = "time_s,object,u_px,v_px,radius_px\n".to_owned();
    for (frame, [u, v, radius]) in circles.iter().enumerate() {
        let _ = writeln!(
            times,
            "{},toy,{u},{v},{radius}",
            0.04 * frame as f64 + 0.003
        );
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

/// Returns a table of all true circles.
fn table() -> String {
    let mut table = "frame,u_px,v_px,radius_px\n".to_owned();
    for (frame, [u, v, radius]) in true_circles().iter().enumerate() {
        let _ = writeln!(table, "{frame},{u},{v},{radius}");
    }
    table
}

#[test]
fn a_size_that_was_estimated_counts() {
    let place = tracked("");
    let table = table();
    let ratio = |place: &Workplace| {
        figures(place, &table, &[])["radius_ratio"]["median"]
            .as_f64()
            .unwrap()
    };
    let of_scene = ratio(&place);
    let rows = fs::read_to_string(place.path("out/tracks.csv")).unwrap();
    let mut lines = rows.lines();
    let header = lines.next().unwrap();
    let column = header
        .split(',')
        .position(|name| name == "radius_m")
        .unwrap();
    let mut estimated = header.to_owned() + "\n";
    for line in lines {
        let mut cells: Vec<&str> = line.split(',').collect();
        cells[column] = "0.121";
        estimated += &(cells.join(",") + "\n");
    }
    place.write("out/tracks.csv", estimated);
    assert!((ratio(&place) / of_scene - 1.1).abs() < 0.01);
}

/// The earlier of two runs has its own summary, and the scene must still be that of the rows.
#[test]
fn rows_are_compared_with_the_scene_that_they_were_made_with() {
    let place = tracked("");
    let (table, scene) = (
        table(),
        fs::read_to_string(place.path("scene.toml")).unwrap(),
    );
    place.track(&scene);
    place.write("circles.csv", &table);
    let of_earlier = ["evaluate", "out/tracks.previous.csv", "circles.csv"];
    let report = Run::pardalis(place.path(""), &of_earlier).fine().stdout;
    assert!(report.contains("100.0 %  8 of 8 visible"), "{report}");
    for (piece, other, key) in [
        ("145.5622506548578", "150", "cameras.cam1.model"),
        ("radius_m = 0.11", "radius_m = 0.2", "targets.ball.shape"),
        ("-1, 0.9]", "-1, 0.8]", "cameras.cam1.world_from_camera"),
    ] {
        place.write("scene.toml", scene.replacen(piece, other, 1));
        let run = evaluate(&place, &table, &[]);
        run.refused(&[&format!(
            "scene.toml: {key} has changed since out/tracks.csv was made"
        )]);
    }
    // What does not concern the circles may change.
    place.write("scene.toml", scene.replace("seed = 1", "seed = 2"));
    evaluate(&place, &table, &[]).fine();
}

/// Left-out frames are counted in no table, but have times. A second camera needs its name.
#[test]
fn times_and_cameras_tell_the_images_apart() {
    let place = tracked("");
    let scene = fs::read_to_string(place.path("scene.toml")).unwrap();
    let step = "fps = 25\nfirst_frame = 1\nframe_step = 3";
    let run = place.track(scene.replace("fps = 25", step));
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    let mut both = "frame,time_s,camera,u_px,v_px,radius_px\n".to_owned();
    for (frame, [u, v, radius]) in true_circles().iter().enumerate() {
        let time_s = 0.04 * frame as f64;
        let _ = writeln!(both, "{frame},{time_s:.3},cam1,{u},{v},{radius}");
    }
    let found = figures(&place, &both, &[]);
    assert_eq!(
        (&found["frames"], &found["on_object_frames"]),
        (&3.into(), &3.into())
    );
    assert_eq!(found["circles_without_rows"], 5);

    let lines: Vec<&str> = scene.lines().collect();
    let camera = lines[1..6].join("\n").replace("cam1", "cam2");
    let camera = camera
        .replace("images = \"images\"", "images = \"other\"")
        .replace("0.9]", "0.95]");
    fs::create_dir(place.path("other")).unwrap();
    for number in 0..FRAMES {
        let file = fs::read(frame_file(30 + number)).unwrap();
        place.write(&format!("other/{number:06}.jpg"), file);
    }
    let run = place.track(scene + &camera + "\n");
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    evaluate(&place, &table(), &[]).refused(&["the scene has several cameras (cam1, cam2)"]);
    assert_eq!(figures(&place, &both, &[])["camera"], "cam1");
}

#[test]
fn a_camera_on_a_platform_is_where_it_was() {
    let place = tracked("");
    let scene = fs::read_to_string(place.path("scene.toml")).unwrap();
    place.write(
        "poses.csv",
        "time_s,x_m,y_m,z_m,qx,qy,qz,qw\n0,5,0,0,0,0,0,1\n1,5,0,0,0,0,0,1\n",
    );
    let carried = scene.replace("fps = 25", "fps = 25\nplatform = \"robot\"")
        + "[platforms.robot]\nposes = \"poses.csv\"\n";
    let carried = carried.replace("world_from_camera", "platform_from_camera");
    let run = place.track(&carried);
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    let found = figures(&place, &table(), &[]);
    assert_eq!(found["on_object_share"], 1.0, "{found}");
    fs::remove_file(place.path("out/cameras.csv")).unwrap();
    evaluate(&place, &table(), &[]).refused(&["out/cameras.csv: does not say where cam1 was"]);
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
        "frame,u,v,r\n0,1,2,3\n",
        &[],
        "column \"u_px\" is missing; found: frame,u,v,r; circles need frame or time_s, u_px, v_px and radius_px",
    );
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
        "frame,u_px,v_px,r\n0,10,10,5\n",
        &[],
        "circles.csv, line 1: column \"radius_px\" is missing; found: frame,u_px,v_px,r",
    );
    // Positions with the pixels where they are seen, as simulated truth has both.
    refused(
        "time_s,object,y_m,z_m,u_px,v_px\n0,ball,0,1,10,10\n",
        &[],
        "circles.csv, line 1: column \"x_m\" is missing",
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
        "none of its circles is in an image of which out/tracks.csv has a row",
    );
    refused(
        &row("0,10,10,5"),
        &["--from", "3"],
        "none of its images was judged, or lies between --from and --to",
    );
    refused(
        "time_s,u_px,v_px,radius_px\n0,10,10,5\n0.001,10,10,5\n",
        &[],
        "two circles of object belong to the row of 0.001 s",
    );
    for (map, wanted) in [
        (
            &["ball=toy"][..],
            "--map ball=toy: circles.csv has no object \"toy\"; allowed: object",
        ),
        (
            &["toy=object"],
            "--map toy=object: scene.toml has no target \"toy\"; allowed: ball",
        ),
        (
            &["ball=object", "ball=object"],
            "target \"ball\" is mapped twice",
        ),
    ] {
        let options: Vec<&str> = map.iter().flat_map(|pair| ["--map", pair]).collect();
        refused(&row("0,10,10,5"), &options, wanted);
    }
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
