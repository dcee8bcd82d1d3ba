//! `pardalis locate` on images of data/catadioptric-static, and starts from other tracks.

use std::fs;
use std::path::{Path, PathBuf};

use crate::common::{Run, SCENE, Workplace, rows_in, scene_with};
use pardalis_images::RgbImage;
use serde_json::Value;

/// Returns the path of a file in the data folder.
fn data(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../../data")
        .join(path)
}

/// Returns a scene of the still images with the camera in the given model and the ball at its position in
/// frame 1.
fn still_scene(model: &str) -> String {
    let [frames, calibration, colors] = [
        "catadioptric-static/frames".to_owned(),
        format!("calibration/catadioptric/{model}.toml"),
        "colors/orange-ball.catadioptric.hsi.colors.toml".to_owned(),
    ]
    .map(|path| data(&path).display().to_string());
    format!(
        r#"seed = 1
[cameras.cam1]
images = "{frames}"
fps = 1
calibration = "{calibration}"
mask_radius_px = 236
mask_center_px = [319.5, 239.5]
[targets.ball]
shape.sphere.radius_m = 0.11
colors = "{colors}"
filter.particles = 1500
start.gaussian.position_m = [1.3, 0, 0.11]
"#
    )
}

/// Returns the scene with only its first images.
fn first_stills(count: usize) -> String {
    still_scene("exact").replace("fps = 1\n", &format!("fps = 1\nframe_limit = {count}\n"))
}

/// Runs `pardalis locate scene.toml` in the folder.
fn locate(place: &Workplace, scene: &str, arguments: &[&str]) -> Run {
    place.write("scene.toml", scene);
    Run::pardalis(
        place.path(""),
        &[&["locate", "scene.toml"], arguments].concat(),
    )
}

/// Returns the rows of truth.csv of the still images: position and pixel.
fn truth() -> Vec<([f64; 3], [f64; 2])> {
    let text = fs::read_to_string(data("catadioptric-static/truth.csv")).unwrap();
    let row = |line: &str| {
        let fields: Vec<&str> = line.split(',').collect();
        let number = |i: usize| fields[i].parse().unwrap();
        ([4, 5, 6].map(number), [13, 14].map(number))
    };
    text.lines().skip(1).map(row).collect()
}

/// Returns the distance of a row's position from the truth.
fn error_m(row: &[String], truth_m: [f64; 3]) -> f64 {
    let squares =
        (0..3).map(|axis| (row[4 + axis].parse::<f64>().unwrap() - truth_m[axis]).powi(2));
    squares.sum::<f64>().sqrt()
}

#[test]
fn stills_are_located_from_true_positions_and_clicks() {
    let place = Workplace::with_frames(0);
    let truth_file = data("catadioptric-static/truth.csv");
    let truth_file = truth_file.to_str().unwrap();
    for model in ["unified", "exact"] {
        // Along the ray of a click, only the apparent size of the ball determines its distance.
        for (from, allowed_m) in [("--starts", 0.25), ("--clicks", 0.45)] {
            let run = locate(&place, &still_scene(model), &[from, truth_file, "-o", "-"]).fine();
            let rows = rows_in(&run.stdout);
            assert_eq!(rows.len(), 32);
            // At 3.2 m the ball is eight pixels wide, and partly beyond the mirror's rim if it is high up.
            let mut worst_m: f64 = 0.0;
            for (row, (truth_m, _)) in rows.iter().zip(truth()) {
                assert_eq!((&*row[2], &*row[3]), ("ball", "tracking"));
                // A single image has no velocities.
                assert!(row[7..11].iter().all(String::is_empty), "{row:?}");
                if truth_m[0].abs().max(truth_m[1].abs()) < 3.0 {
                    worst_m = worst_m.max(error_m(row, truth_m));
                }
            }
            assert!(worst_m < allowed_m, "{model} {from}: {worst_m} m");
        }
    }
}

#[test]
fn results_have_the_format_of_track() {
    let place = Workplace::with_frames(0);
    let truth_file = data("catadioptric-static/truth.csv");
    let arguments = [
        "--starts",
        truth_file.to_str().unwrap(),
        "--annotate",
        "-o",
        "out",
    ];
    let scene = first_stills(3);
    let run = locate(&place, &scene, &arguments).fine();
    let lines: Vec<&str> = run.stdout.lines().collect();
    assert!(lines[0].starts_with("frame 0: ball at 0.6"), "{}", lines[0]);
    assert!(
        lines[2].contains(" m ± ")
            && lines[2].ends_with(
                " mm, confidence 1.00; seen at 319, 123 px, radius 9 px, 2.36 m from the camera"
            ),
        "{}",
        lines[2]
    );
    assert!(run.stdout.contains("  out/tracks.csv\n"));
    let rows = place.rows();
    assert_eq!(rows.len(), 3);
    assert!(place.path("out/annotated/000002.jpg").is_file());
    assert!(!place.path("out/above.svg").exists());
    let summary: Value =
        serde_json::from_slice(&fs::read(place.path("out/summary.json")).unwrap()).unwrap();
    assert_eq!(summary["frame_sets"], 3);
    assert_eq!(summary["settings"]["locate"]["passes_m"][1], 0.07);
    assert_eq!(
        summary["settings"]["locate"]["starts"],
        truth_file.to_str().unwrap()
    );
    // The same again, with another number of threads; then another seed and other passes.
    let rows = fs::read_to_string(place.path("out/tracks.csv")).unwrap();
    let streamed = |more: &[&str]| {
        let arguments = [&arguments[..2], &["-o", "-"], more].concat();
        locate(&place, &scene, &arguments).fine().stdout
    };
    assert_eq!(streamed(&["--threads", "3"]), rows);
    assert_ne!(streamed(&["--seed", "2"]), rows);
    assert_ne!(streamed(&["--passes-m", "0.1,0.04"]), rows);
}

#[test]
fn images_on_the_command_line_replace_those_of_the_scene() {
    let place = Workplace::with_frames(0);
    let images = [2, 1].map(|n| data(&format!("catadioptric-static/frames/{n:06}.jpg")));
    let images = images.each_ref().map(|image| image.to_str().unwrap());
    let (truth_m, [u, v]) = truth()[1];
    let at = format!("{u},{v}");
    let run = locate(
        &place,
        &still_scene("exact"),
        &[images[1], "--at", &at, "-o", "-"],
    )
    .fine();
    let rows = rows_in(&run.stdout);
    assert_eq!(rows.len(), 1);
    assert!(error_m(&rows[0], truth_m) < 0.2);
    // The scene's start is the position of the ball in the second image.
    let run = locate(
        &place,
        &still_scene("exact"),
        &[images[0], images[1], "-o", "-"],
    )
    .fine();
    let rows = rows_in(&run.stdout);
    assert_eq!((rows.len(), &*rows[1][0], &*rows[1][1]), (2, "1", "1"));
    assert!(error_m(&rows[1], truth_m) < 0.2);
}

#[test]
fn no_position_is_given_out_of_view() {
    let place = Workplace::with_frames(0);
    let scene = first_stills(1).replace("[1.3, 0, 0.11]", "[1.3, 0, 50]");
    let run = locate(&place, &scene, &["-o", "out"]).fine();
    let message = "frame 0: ball not visible around the start (occluded)\n";
    assert!(run.stdout.starts_with(message), "{}", run.stdout);
    let rows = place.rows();
    assert_eq!(rows[0][3], "occluded");
    assert!(rows[0][4..18].iter().all(String::is_empty), "{:?}", rows[0]);
}

#[test]
fn tables_of_starts_are_matched_by_frame_and_object() {
    let place = Workplace::with_frames(0);
    // Frames count the images of the folder, of which the scene skips two; rows may be in any order.
    let scene = first_stills(1).replace("fps = 1\n", "fps = 1\nfirst_frame = 2\n");
    place.write(
        "starts.csv",
        "object,frame,x_m,y_m,z_m\ncup,2,0,0,0\nball,2,2.2,0,0.11\nball,1,1.3,0,0.11\nball,3,,,\n",
    );
    let run = locate(&place, &scene, &["--starts", "starts.csv", "-o", "-"]).fine();
    assert!(error_m(&rows_in(&run.stdout)[0], [2.2, 0.0, 0.11]) < 0.25);
    locate(&place, &scene, &["--starts", "starts.csv", "-o", "out"]).fine();
    let results = fs::read_to_string(place.path("out/tracks.csv")).unwrap();
    for (arguments, wanted) in [
        (
            "--starts starts.csv --object cat",
            "nothing is named \"cat\"; select one of these with --object: ball, cup",
        ),
        ("--starts none.csv", "none.csv: there is no such file"),
        (
            "--clicks starts.csv",
            "starts.csv, line 1: column \"u_px\" is missing",
        ),
        (
            "--object ball",
            "--object ball: selects the rows of a table",
        ),
        (
            "--starts twice.csv",
            "twice.csv, line 3: frame 2 already has a start in line 2",
        ),
        (
            "--starts half.csv",
            "half.csv, line 2, column y_m: is empty",
        ),
        (
            "--starts minus.csv",
            "minus.csv, line 2, column frame: holds \"-1\"; allowed: a whole number from 0",
        ),
        (
            "--starts other.csv",
            "other.csv: has no start of ball in frame 2; give each image a row",
        ),
        (
            "--starts far.csv",
            "far.csv, frame 2: position_m is 10000000; allowed",
        ),
        (
            "--clicks rim.csv",
            "rim.csv, frame 2: pixel_px is [2.0, 3.0]; allowed: a pixel of the 640 x 480 image",
        ),
        ("--at 2,3", "--at: pixel_px is [2.0, 3.0]; allowed"),
        ("--at -5,270", "--at: pixel_px is [-5.0, 270.0]; allowed"),
        (
            "--passes-m 0.1,-1",
            "--passes-m: passes_sigma_m is [0.1, -1.0]; allowed: one or more",
        ),
        ("nothing.jpg", "nothing.jpg: "),
        (
            "clip.mp4",
            "clip.mp4: is a video, not an image; leave it out if the scene names it, or",
        ),
    ] {
        place.write("clip.mp4", b"\0\0\0\x20ftypisom");
        place.write(
            "twice.csv",
            "frame,x_m,y_m,z_m\n2,2.2,0,0.11\n2,2.1,0,0.11\n",
        );
        place.write("half.csv", "frame,x_m,y_m,z_m\n2,2.2,,0.11\n");
        place.write("minus.csv", "frame,x_m,y_m,z_m\n-1,2.2,0,0.11\n");
        place.write("other.csv", "frame,x_m,y_m,z_m\n5,2.2,0,0.11\n");
        place.write("far.csv", "frame,x_m,y_m,z_m\n2,1e7,0,0.11\n");
        place.write("rim.csv", "frame,u_px,v_px\n2,2,3\n");
        let arguments: Vec<&str> = arguments.split(' ').chain(["-o", "out"]).collect();
        locate(&place, &scene, &arguments).refused(&[wanted]);
    }
    // None of them has cost the results of the first run.
    let kept = fs::read_to_string(place.path("out/tracks.csv")).unwrap();
    assert_eq!(kept, results);
    assert!(!place.path("out/tracks.previous.csv").exists());
    let usage = locate(&place, &scene, &["--at", "2", "3"]);
    assert_eq!(usage.code, Some(2));
    let wanted = "two numbers in pixels, U,V without a space, inside the image";
    assert!(usage.stderr.contains(wanted), "{}", usage.stderr);
}

#[test]
fn a_start_far_from_a_detected_target_is_reported() {
    let place = Workplace::with_frames(1);
    let (scene, _) = SCENE.split_once("contour").unwrap();
    let colors = data("colors/orange-ball.hsi.colors.toml");
    let scene = scene.replace("ball.toml", colors.to_str().unwrap());
    place.write("near.csv", "frame,x_m,y_m,z_m\n0,1.35,-1.25,0.62\n");
    place.write("far.csv", "frame,x_m,y_m,z_m\n0,1.35,0.75,0.62\n");
    place.write("clicks.csv", "frame,u_px,v_px\n0,320,88\n");
    for (start, wanted) in [
        (["--at", "462,90"], None),
        (["--at", "320,88"], Some((" px from the click", 140.0, 4.0))),
        (
            ["--clicks", "clicks.csv"],
            Some((" px from the click", 140.0, 4.0)),
        ),
        (["--starts", "near.csv"], None),
        (
            ["--starts", "far.csv"],
            Some((" m from the given start", 2.0, 0.1)),
        ),
    ] {
        let run = locate(&place, &scene, &[&start[..], &["-o", "out"]].concat()).fine();
        let line = run.stdout.lines().next().unwrap();
        assert!(line.starts_with("frame 0: ball at 1.3"), "{line}");
        let far = line.split_once("; found ").map(|(_, far)| far);
        assert_eq!(far.is_some(), wanted.is_some(), "{start:?}: {line}");
        if let (Some(far), Some((unit, away, allowed))) = (far, wanted) {
            let number: f64 = far.strip_suffix(unit).unwrap().parse().unwrap();
            assert!((number - away).abs() < allowed, "{start:?}: {line}");
        }
    }
}

#[test]
fn starts_accept_a_covariance() {
    let place = Workplace::with_frames(3);
    let with = |covariance: &str| scene_with("position_sigma_m = 0.1", covariance);
    // The same spread on each axis, given in two ways.
    place.track(SCENE).fine();
    let rows = fs::read_to_string(place.path("out/tracks.csv")).unwrap();
    place
        .track(with("position_sigma_m = [0.1, 0.1, 0.1]"))
        .fine();
    assert_eq!(
        fs::read_to_string(place.path("out/tracks.csv")).unwrap(),
        rows
    );
    place
        .track(with("covariance_m2 = [0.01, 0.005, 0, 0.01, 0, 0.01]"))
        .fine();
    assert_ne!(
        fs::read_to_string(place.path("out/tracks.csv")).unwrap(),
        rows
    );
    for (given, wanted) in [
        (
            "covariance_m2 = [0.01, 0.02, 0, 0.01, 0, 0.01]",
            "line 16: targets.ball.start.gaussian.covariance_m2: is a list of 6; allowed: [xx, xy, xz, yy, yz, zz] of a positive semidefinite matrix",
        ),
        (
            "covariance_m2 = [0.01, 0.01]",
            "line 16: targets.ball.start.gaussian.covariance_m2: is [0.01, 0.01]; allowed: six finite numbers, [xx, xy, xz, yy, yz, zz]",
        ),
        (
            "covariance_m2 = [1, 0, 0, 1, 0, 1]\nposition_sigma_m = 1",
            "line 17: targets.ball.start.gaussian.position_sigma_m: cannot be combined with covariance_m2; remove one of them",
        ),
    ] {
        place.track(with(given)).refused(&[wanted]);
    }
}

/// Returns the scene started from the track in other/tracks.csv, from frame `first_frame` on.
fn from_track(first_frame: usize, more: &str) -> String {
    let start = "start.gaussian]\nposition_m = [1.35, -1.25, 0.62]\nposition_sigma_m = 0.1";
    scene_with(
        start,
        &format!("start.track]\nfile = \"other/tracks.csv\"\n{more}"),
    )
    .replace(
        "fps = 25",
        &format!("fps = 25\nfirst_frame = {first_frame}"),
    )
    .replace("particles = 100", "particles = 1000")
}

#[test]
fn tracks_continue_from_another_track() {
    let place = Workplace::with_frames(10);
    let other = scene_with("fps = 25", "fps = 25\nframe_limit = 5")
        .replace("particles = 100", "particles = 1000")
        .replace("targets.ball", "targets.theirs");
    place
        .track_with(other, &["-o", "other", "--no-plots"])
        .fine();
    place.track(from_track(5, "target = \"theirs\"")).fine();
    let rows = place.rows();
    assert_eq!(rows.len(), 5);
    let at_m = |row: &[String]| [4, 5, 6].map(|i| row[i].parse::<f64>().unwrap());
    let theirs = rows_in(&fs::read_to_string(place.path("other/tracks.csv")).unwrap());
    let their_last_m = at_m(&theirs[4]);
    assert!(error_m(&rows[0], their_last_m) < 0.3);
    // The same track in another world, rotated by 180 degrees and shifted, gives a near result only with the
    // transform.
    let text = fs::read_to_string(place.path("other/tracks.csv")).unwrap();
    let moved: Vec<String> = rows_in(&text)
        .iter()
        .map(|row| {
            let mut row = row.clone();
            let [x, y, z] = at_m(&row);
            [row[4], row[5], row[6]] = [1.0 - x, 2.0 - y, z + 0.5].map(|v| v.to_string());
            row.join(",")
        })
        .collect();
    place.write(
        "other/tracks.csv",
        format!("{}\n{}\n", crate::common::run::HEADER, moved.join("\n")),
    );
    place
        .track(from_track(5, "target = \"theirs\"\nworld_from_other = [[-1, 0, 0, 1], [0, -1, 0, 2], [0, 0, 1, -0.5], [0, 0, 0, 1]]"))
        .fine();
    let again = place.rows();
    assert!(error_m(&again[0], at_m(&rows[0])) < 0.15);
    place.track(from_track(5, "target = \"theirs\"")).fine();
    assert!(error_m(&place.rows()[0], at_m(&rows[0])) > 0.5);
    // The velocity is as certain as the track says, unless the scene says otherwise.
    let started = |stated: f64, more: &str| {
        let rows = rows_in(&text).into_iter().map(|mut row| {
            for at in [25, 28, 30] {
                row[at] = stated.to_string();
            }
            for at in [26, 27, 29] {
                row[at] = "0".to_owned();
            }
            row.join(",")
        });
        let rows: Vec<String> = rows.collect();
        let header = crate::common::run::HEADER;
        place.write(
            "other/tracks.csv",
            format!("{header}\n{}\n", rows.join("\n")),
        );
        let more = format!("target = \"theirs\"\n{more}");
        place.track(from_track(5, &more)).fine();
        place.rows()[0].clone()
    };
    let certain = started(0.0001, "");
    assert_ne!(started(25.0, ""), certain);
    assert_eq!(started(25.0, "velocity_sigma_mps = 0.01"), certain);
}

#[test]
fn unusable_tracks_are_rejected_as_starts() {
    let place = Workplace::with_frames(3);
    fs::create_dir(place.path("other")).unwrap();
    let row = |time_s: &str, rest: &str| {
        format!(
            "{}\n0,{time_s},ball,{rest},,,,,,,,,,,,\n",
            crate::common::run::HEADER
        )
    };
    let seen = "tracking,1.3,-1.2,0.6,0,0,0,,0.01,0,0,0.01,0,0.01,50,1";
    let place_in_scene = "line 16: targets.ball.start.track.file: ";
    for (text, more, wanted) in [
        (String::new(), "", "other/tracks.csv: "),
        (
            row("0", seen),
            "target = \"cat\"",
            "other/tracks.csv: has no target \"cat\"; allowed: ball",
        ),
        (
            row("0.2", seen),
            "",
            "other/tracks.csv: has no estimate of \"ball\" at or before the first frame, at 0.04 s",
        ),
        (
            row("0", "lost,,,,,,,,,,,,,,,0"),
            "",
            "other/tracks.csv: has no estimate of \"ball\" at or before",
        ),
        (
            row("-20", seen),
            "",
            "is of -20 s; allowed: at most 10 s older",
        ),
        (
            row("0", "tracking,1.3,-1.2,0.6,0,0,0,,,,,,,,50,1"),
            "",
            "the estimate of \"ball\" at 0 s has no covariance; needed: the columns xx_m2",
        ),
        (
            row(
                "0",
                "tracking,1.3,-1.2,0.6,0,0,0,,0.01,9,0,0.01,0,0.01,50,1",
            ),
            "",
            "the estimate of \"ball\" at 0 s cannot be used as a start: covariance_m2 is [0.01, 9.0,",
        ),
    ] {
        place.write("other/tracks.csv", text);
        place
            .track(from_track(1, more))
            .refused(&[place_in_scene, wanted]);
    }
    let negative = row("0", seen).replace(",,,,,,,,,,,,\n", ",,,,,,,0.1,0,0,0.1,0,-0.1\n");
    place.write("other/tracks.csv", negative);
    place.track(from_track(1, "")).refused(&[
        place_in_scene,
        "the estimate of \"ball\" at 0 s has a negative variance of the velocity; needed: 0 or more in vxx_m2ps2",
    ]);
    place.write("other/tracks.csv", row("0", seen));
    place
        .track(from_track(
            1,
            "world_from_other = [[1, 0, 0, 1], [0, 2, 0, 2], [0, 0, 1, 0], [0, 0, 0, 1]]",
        ))
        .refused(&[
            "line 17: targets.ball.start.track.world_from_other: the pose matrix is not a rotation",
        ]);
    place
        .track(from_track(1, "velocity_sigma_mps = -1"))
        .refused(&[
            "line 17: targets.ball.start.track.velocity_sigma_mps: is -1; allowed: 0 to 1000000",
        ]);
    fs::remove_file(place.path("other/tracks.csv")).unwrap();
    place
        .track(from_track(1, ""))
        .refused(&[place_in_scene, "other/tracks.csv: there is no such file"]);
}

/// Returns the scene with a second camera, a millimetre beside the first, with the same images.
fn two_cameras(place: &Workplace) -> String {
    fs::create_dir_all(place.path("images2")).unwrap();
    fs::copy(place.image(0), place.path("images2/000000.jpg")).unwrap();
    let camera = &SCENE[SCENE.find("[cameras.cam1]").unwrap()..SCENE.find("[targets").unwrap()];
    let second = camera
        .replace("cam1", "cam2")
        .replace("\"images\"", "\"images2\"")
        .replace("[0, -1, 0, 0]", "[0, -1, 0, 0.001]");
    SCENE.replace("[targets.ball]\n", &format!("{second}[targets.ball]\n"))
}

#[test]
fn clicks_are_assigned_to_cameras_and_targets() {
    let place = Workplace::with_frames(1);
    let target = &SCENE[SCENE.find("[targets.ball]").unwrap()..];
    let two_targets = format!("{SCENE}{}", target.replace("targets.ball", "targets.cup"));
    place.write(
        "clicks.csv",
        "frame,camera,object,u_px,v_px\n0,cam1,ball,,\n0,cam2,ball,460,88\n0,cam1,cup,250,200\n",
    );
    let run = locate(
        &place,
        &two_cameras(&place),
        &["--clicks", "clicks.csv", "-o", "-"],
    )
    .fine();
    assert!(error_m(&rows_in(&run.stdout)[0], [1.35, -1.25, 0.62]) < 0.4);
    let run = locate(&place, &two_targets, &["--clicks", "clicks.csv", "-o", "-"]).fine();
    let rows = rows_in(&run.stdout);
    assert_eq!((&*rows[0][2], &*rows[1][2]), ("ball", "cup"));
    assert!(error_m(&rows[0], [1.35, -1.25, 0.62]) < 0.4);
    place.write("bare.csv", "frame,u_px,v_px\n0,460,88\n");
    place.write("third.csv", "frame,camera,u_px,v_px\n0,cam3,460,88\n");
    for (scene, arguments, wanted) in [
        (
            two_cameras(&place),
            "--at 460,88",
            "--at: scene.toml has 2 cameras and 1 targets",
        ),
        (
            two_cameras(&place),
            "images/000000.jpg",
            "scene.toml: the scene has 2 cameras, and the camera of images on the command line",
        ),
        (
            two_cameras(&place),
            "--clicks bare.csv",
            "bare.csv, line 1: column \"camera\" is missing",
        ),
        (
            two_cameras(&place),
            "--clicks third.csv",
            "third.csv, line 2, column camera: \"cam3\" is not a camera of the scene; allowed: cam1, cam2",
        ),
        (
            two_targets.clone(),
            "--at 460,88",
            "--at: scene.toml has 1 cameras and 2 targets",
        ),
        (
            two_targets.clone(),
            "--clicks bare.csv",
            "bare.csv, line 1: column \"object\" is missing",
        ),
        (
            two_targets,
            "--clicks clicks.csv --object ball",
            "--object: the scene has 2 targets; remove it",
        ),
    ] {
        let arguments: Vec<&str> = arguments.split(' ').chain(["-o", "out"]).collect();
        locate(&place, &scene, &arguments).refused(&[wanted]);
    }
}

#[test]
fn a_start_without_a_ball_has_little_confidence() {
    let place = Workplace::with_frames(0);
    let confidence = |start: &str| -> f64 {
        let scene = first_stills(2).replace("[1.3, 0, 0.11]", start);
        locate(&place, &scene, &["-o", "out"]).fine();
        // The ball is at 1.3 m in the second image.
        place.rows()[1][18].parse().unwrap()
    };
    assert!(confidence("[1.3, 0, 0.11]") > 0.95);
    for empty in ["[-1.3, 0, 0.11]", "[0, 1.3, 0.11]", "[-1, -1.5, 0.11]"] {
        let confidence = confidence(empty);
        assert!(confidence < 0.3, "{empty}: {confidence}");
    }
}

#[test]
fn nothing_is_found_in_an_image_all_in_the_colours_of_the_ball() {
    let place = Workplace::with_frames(1);
    let colors = data("colors/orange-ball.hsi.colors.toml");
    let scene = SCENE.replace("ball.toml", colors.to_str().unwrap());
    let with_ball = pardalis_images::decode(&fs::read(place.image(0)).unwrap()).unwrap();
    let [red, green, blue] = with_ball.get_pixel(460, 88);
    let uniform = RgbImage::from_pixel(640, 480, [red, green, blue]);
    // Sensors are never quite uniform.
    let noisy = RgbImage::from_fn(640, 480, |x, y| {
        let noise = (x * 7919 + y * 104_729 + x * y * 31) % 9;
        [red, green, blue].map(|c| c.saturating_sub(4) + noise as u8)
    });
    for (name, image) in [("uniform.png", &uniform), ("noisy.png", &noisy)] {
        place.write(name, pardalis_images::encode_png(image).unwrap());
    }
    let hue = "window = { size_px = 5, hue_deg = [10, 50], saturation = [0.3, 1], intensity = [0.1, 0.9] }";
    for (cue, scene) in [
        ("contour", scene.clone()),
        ("window", with_cue(&scene, "window = { size_px = 5 }")),
        (
            "ranges",
            with_cue(&scene, hue).replace(colors_line(&scene), ""),
        ),
    ] {
        for image in ["uniform.png", "noisy.png"] {
            let run = locate(&place, &scene, &[image, "--at", "460,88", "-o", "out"]).fine();
            let wanted = "frame 0: ball not visible around the start (lost)\n";
            assert!(
                run.stdout.starts_with(wanted),
                "{cue}, {image}: {}",
                run.stdout
            );
            assert_eq!((&*place.rows()[0][3], &*place.rows()[0][18]), ("lost", "0"));
        }
        let run = locate(&place, &scene, &["images/000000.jpg", "-o", "out"]).fine();
        let wanted = "frame 0: ball at 1.";
        assert!(run.stdout.starts_with(wanted), "{cue}: {}", run.stdout);
    }
}

/// Returns the scene with another cue than the contour.
fn with_cue(scene: &str, cue: &str) -> String {
    scene.replace("contour = { inner_scale = 0.9, outer_scale = 1.1 }", cue)
}

fn colors_line(scene: &str) -> &str {
    scene
        .lines()
        .find(|line| line.starts_with("colors"))
        .unwrap()
}
