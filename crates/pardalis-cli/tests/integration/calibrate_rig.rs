//! Tests of `pardalis calibrate rig` with the real program: the webcam sequences without their poses, a simulated world with
//! clocks that differ, and what is refused.

use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};

use nalgebra::{IsometryMatrix3, Matrix4, Point3, Rotation3, Vector3};
use pardalis_camera::CalibratedCamera;
use pardalis_scene::calibration;
use tempfile::TempDir;

use crate::common::{Run, rows_in};

fn data(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../../data")
        .join(path)
}

/// Returns the cameras of a calibration file.
fn cameras(file: &Path) -> Vec<CalibratedCamera> {
    calibration::read(&fs::read_to_string(file).unwrap(), None).unwrap()
}

/// Returns a scene of a webcam sequence, with the true poses or without poses. The focal length is this times the true one.
fn scene(sequence: &str, with_poses: bool, focal: f64) -> String {
    let mut text = String::new();
    let file = data(sequence).join("cameras.json");
    for camera in cameras(&file) {
        let name = &camera.name;
        let images = data(sequence).join("frames").join(name);
        let _ = writeln!(
            text,
            "[cameras.{name}]\nimages = '{}'\nfps = 25",
            images.display()
        );
        if with_poses {
            let _ = writeln!(text, "calibration = '{}'", file.display());
            continue;
        }
        let parameters = camera.camera.parameters();
        let value = |i: usize| parameters[i].1;
        let (f, center) = (focal * value(0), [value(2), value(3)]);
        let _ = writeln!(
            text,
            "[cameras.{name}.model.pinhole]\nf_px = [{f:?}, {f:?}] # px\ncenter_px = {center:?}"
        );
    }
    let colors = data("colors/pink-ball.hsi.colors.toml");
    text + &format!(
        "[targets.ball]\nshape.sphere.radius_m = 0.035\ncolors = '{}'\n",
        colors.display()
    )
}

/// Returns a table of where cameras see these points, to a tenth of a pixel.
fn points(sequence: &str, places_m: &[[f64; 3]]) -> String {
    let mut text = "view,u_px,v_px,x_m,y_m,z_m\n".to_owned();
    for camera in cameras(&data(sequence).join("cameras.json")) {
        let camera_from_world = camera.world_from_camera.unwrap().inverse();
        let (width, height) = camera.size_px.unwrap();
        for &[x, y, z] in places_m {
            let at = camera_from_world * Point3::new(x, y, z);
            let Some([u, v]) = camera.camera.project(at.into()) else {
                continue;
            };
            if (0.0..width as f64 - 1.0).contains(&u) && (0.0..height as f64 - 1.0).contains(&v) {
                let _ = writeln!(text, "{},{u:.1},{v:.1},{x},{y},{z}", camera.name);
            }
        }
    }
    text
}

/// Creates a folder with these files.
fn folder(files: &[(&str, String)]) -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    for (name, text) in files {
        fs::write(folder.path().join(name), text).unwrap();
    }
    folder
}

/// Returns the true path of the ball: its position in metres, by time in hundredths of a second.
fn truth(sequence: &str) -> impl Fn(f64) -> Vector3<f64> {
    let text = fs::read_to_string(data(sequence).join("truth.csv")).unwrap();
    let rows = text.lines().filter(|line| line.contains(",ball,cam1,"));
    let places: Vec<Vector3<f64>> = rows
        .map(|line| {
            let number = |i: usize| line.split(',').nth(i).unwrap().parse().unwrap();
            Vector3::new(number(4), number(5), number(6))
        })
        .collect();
    move |time_s| places[(25.0 * time_s).round() as usize]
}

/// Tracks with a scene, and returns estimated and true positions in metres.
fn tracked(folder: &TempDir, scene: &str, sequence: &str) -> Vec<[Vector3<f64>; 2]> {
    Run::pardalis(folder, &["track", scene, "-o", "out", "--no-plots"]).fine();
    let truth = truth(sequence);
    let text = fs::read_to_string(folder.path().join("out/tracks.csv")).unwrap();
    let rows = rows_in(&text);
    let pairs = rows.iter().map(|row| {
        let number = |i: usize| row[i].parse::<f64>().unwrap();
        [
            Vector3::new(number(4), number(5), number(6)),
            truth(number(1)),
        ]
    });
    pairs.collect()
}

/// Returns the root mean square distance of pairs of points.
fn rms_m(pairs: &[[Vector3<f64>; 2]]) -> f64 {
    let squares = pairs.iter().map(|[a, b]| (a - b).norm_squared());
    (squares.sum::<f64>() / pairs.len() as f64).sqrt()
}

/// Returns the pairs after the first points were moved nearest to the second ones, as a rigid body.
fn aligned(pairs: &[[Vector3<f64>; 2]]) -> Vec<[Vector3<f64>; 2]> {
    let mean =
        |i: usize| pairs.iter().map(|pair| pair[i]).sum::<Vector3<f64>>() / pairs.len() as f64;
    let (from, to) = (mean(0), mean(1));
    let products = pairs.iter().map(|[a, b]| (b - to) * (a - from).transpose());
    let svd = products.sum::<nalgebra::Matrix3<f64>>().svd(true, true);
    let turn = svd.u.unwrap() * svd.v_t.unwrap();
    assert!(turn.determinant() > 0.0, "the track is mirrored");
    let turn = Rotation3::from_matrix_unchecked(turn);
    let moved = pairs.iter().map(|[a, b]| [turn * (a - from) + to, *b]);
    moved.collect()
}

/// Removes the poses, calibrates the rig, and requires that tracks are at most 1.5 times as wrong as with true poses after they are
/// aligned with the truth, and at most this many times in the world of known points.
fn check_webcams(sequence: &str, places_m: &[[f64; 3]], in_world: f64) {
    let folder = folder(&[
        ("true.toml", scene(sequence, true, 1.0)),
        ("scene.toml", scene(sequence, false, 1.0)),
        ("points.csv", points(sequence, places_m)),
    ]);
    let true_m = rms_m(&tracked(&folder, "true.toml", sequence));
    let bound_m = 1.5 * true_m;
    let arguments = ["calibrate", "rig", "scene.toml", "--corrected", "new.toml"];
    let run = Run::pardalis(&folder, &arguments).fine();
    println!("{}", run.stdout);
    assert!(
        run.stdout.contains("the frame of cam1 is the world"),
        "{}",
        run.stdout
    );
    let pairs = tracked(&folder, "new.toml", sequence);
    let frames = tracked(&folder, "true.toml", sequence).len();
    // With one clock, all cameras share each frame set.
    assert_eq!(pairs.len(), frames);
    let error_m = rms_m(&aligned(&pairs));
    println!(
        "{:.3} mm after alignment, allowed {:.3} mm",
        1e3 * error_m,
        1e3 * bound_m
    );
    assert!(error_m < bound_m, "{error_m} m");
    let run = Run::pardalis(
        &folder,
        &[&arguments[..], &["--points", "points.csv"]].concat(),
    )
    .fine();
    println!("{}", run.stdout);
    let error_m = rms_m(&tracked(&folder, "new.toml", sequence));
    println!("{:.3} mm in the world", 1e3 * error_m);
    assert!(error_m < in_world * true_m, "{error_m} m");
    assert!(
        !run.stdout.contains("should show the point"),
        "{}",
        run.stdout
    );
    // One point is mistyped.
    let text = points(sequence, places_m);
    let row = text.lines().nth(2).unwrap();
    let (before, v) = row.split_at(row.match_indices(',').nth(1).unwrap().0);
    let (name, u) = before.split_once(',').unwrap();
    let wrong = format!("{name},{:.1}{v}", u.parse::<f64>().unwrap() + 40.0);
    fs::write(folder.path().join("wrong.csv"), text.replace(row, &wrong)).unwrap();
    let arguments = ["calibrate", "rig", "scene.toml", "--points", "wrong.csv"];
    let run = Run::pardalis(&folder, &arguments).fine();
    let place_m: Vec<&str> = row.split(',').skip(3).collect();
    let doubt = format!(
        "wrong.csv: {name} should show the point {}",
        place_m.join(", ")
    );
    assert!(run.stdout.contains(&doubt), "{}", run.stdout);
}

#[test]
fn two_webcams_track_as_with_their_true_poses() {
    check_webcams(
        "webcams-two",
        &[
            [0.4, 0.8, 0.0],
            [0.6, 0.8, 0.0],
            [0.4, 0.6, 0.2],
            [0.6, 0.7, 0.2],
            [0.3, 0.9, 0.1],
            [0.7, 0.9, 0.1],
            [0.6, 0.4, 0.05],
            [0.8, 0.5, 0.2],
        ],
        // The ball moves within a few centimetres, so that the cameras are turned by a third of a degree.
        4.0,
    );
}

#[test]
fn four_webcams_track_as_with_their_true_poses() {
    // A rectangle on the desk.
    check_webcams(
        "webcams-four",
        &[
            [0.3, 0.3, 0.0],
            [0.65, 0.3, 0.0],
            [0.65, 0.6, 0.0],
            [0.3, 0.6, 0.0],
        ],
        1.5,
    );
}

/// The pose of each camera in a file.
fn poses(file: &Path) -> Vec<IsometryMatrix3<f64>> {
    let cameras = cameras(file).into_iter();
    cameras
        .map(|camera| camera.world_from_camera.unwrap())
        .collect()
}

/// Renders a ball among four cameras with clocks that differ, and removes the poses from its scene.
fn simulated() -> TempDir {
    let text = fs::read_to_string(data("worlds/ring.toml")).unwrap();
    let (before, rest) = text.split_once("[ring]").unwrap();
    let rest = &rest[rest.find("[timing]").unwrap()..];
    let mut world = before.replace("duration_s = 4.0", "duration_s = 6.0");
    for (name, from_m, timing) in [
        ("cam1", "[1.1, 0.5, 0.35]", "fps = 25"),
        (
            "cam2",
            "[0.5, 1.1, 0.3]",
            "fps = 25, phase_s = 0.013, clock_offset_s = 0.0731",
        ),
        (
            "cam3",
            "[-0.1, 0.45, 0.4]",
            "fps = 30, clock_offset_s = -0.1042",
        ),
        ("cam4", "[0.55, -0.1, 0.35]", "fps = 25"),
    ] {
        let _ = writeln!(
            world,
            "[cameras.{name}]\nsize_px = [320, 240]\nmodel.pinhole = {{ f_px = [330, 330], center_px = [159.5, 119.5] }}\n\
             look_from_m = {from_m}\nlook_at_m = [0.5, 0.5, 0.15]\ntiming = {{ {timing} }}"
        );
    }
    world += &rest.replace(
        "shutter_s = 0.02",
        "shutter_s = 0.004\ninstants = 2\nsamples = 1",
    );
    // A board of 7 x 5 inner corners on the floor.
    world += "\n[objects.board]\nshape.box = { size_m = [0.32, 0.24, 0.01] }\npath.still.position_m = [0.4, 0.6, 0]\n\
        texture.checker = { size_m = 0.04, colors_srgb = [[20, 20, 20], [235, 235, 235]] }\n";
    let folder = folder(&[("world.toml", world)]);
    Run::pardalis(&folder, &["simulate", "world.toml", "-o", "ring"]).fine();
    let text = fs::read_to_string(folder.path().join("ring/scene.toml")).unwrap();
    let mut lenses = cameras(&folder.path().join("ring/cameras.toml"));
    for camera in &mut lenses {
        camera.world_from_camera = None;
    }
    let file = folder.path().join("ring/lenses.toml");
    fs::write(file, calibration::write_toml(&lenses)).unwrap();
    let text = text.replace(
        "calibration = \"cameras.toml\"",
        "calibration = \"lenses.toml\"",
    );
    fs::write(folder.path().join("ring/scene.toml"), text).unwrap();
    folder
}

#[test]
fn a_simulated_ring_is_calibrated_with_its_clocks() {
    let folder = simulated();
    let arguments = [
        "calibrate",
        "rig",
        "ring/scene.toml",
        "-o",
        "rig",
        "--corrected",
        "ring/new.toml",
    ];
    let run = Run::pardalis(&folder, &arguments).fine();
    println!("{}", run.stdout);
    let (wanted, found) = (
        poses(&folder.path().join("ring/cameras.toml")),
        poses(&folder.path().join("rig/rig.toml")),
    );
    let radius_m = 0.6;
    for (wanted_pose, pose) in wanted.iter().zip(&found) {
        let apart = (wanted[0].inverse() * wanted_pose).inverse() * (found[0].inverse() * pose);
        let (turn_deg, shift_m) = (
            apart.rotation.angle().to_degrees(),
            apart.translation.vector.norm(),
        );
        println!("{turn_deg:.3} degrees, {:.2} mm", 1e3 * shift_m);
        assert!(
            turn_deg < 0.3 && shift_m < 0.01 * radius_m,
            "{turn_deg}, {shift_m}"
        );
    }
    let table = fs::read_to_string(folder.path().join("rig/cameras.csv")).unwrap();
    let offsets: Vec<f64> = table
        .lines()
        .skip(1)
        .map(|line| line.split(',').nth(13).unwrap().parse().unwrap())
        .collect();
    for (found_s, wanted_s) in offsets.iter().zip([0.0, -0.0731, 0.1042, 0.0]) {
        assert!(
            (found_s - wanted_s).abs() < 0.001,
            "{found_s} instead of {wanted_s}"
        );
    }
    let page = fs::read_to_string(folder.path().join("rig/report.html")).unwrap();
    for wanted in [
        "cam4",
        "from above and from the side",
        "cam3: residuals",
        "</html>",
    ] {
        assert!(page.contains(wanted), "{wanted}");
    }
    assert!(page.matches("<svg").count() >= 6);
    // The results are the same bytes for any number of threads.
    let before = fs::read(folder.path().join("rig/rig.toml")).unwrap();
    let mut command = std::process::Command::new(env!("CARGO_BIN_EXE_pardalis"));
    command
        .current_dir(folder.path())
        .args(arguments)
        .env("RAYON_NUM_THREADS", "1");
    Run::of(&mut command).fine();
    assert_eq!(
        before,
        fs::read(folder.path().join("rig/rig.toml")).unwrap()
    );
    check_board(&folder, &wanted);
    // A scene that has them needs no further correction.
    let again = ["calibrate", "rig", "ring/new.toml", "-o", "again"];
    let run = Run::pardalis(&folder, &again).fine();
    assert!(run.stdout.contains("cam1 keeps the pose"), "{}", run.stdout);
    let table = fs::read_to_string(folder.path().join("again/cameras.csv")).unwrap();
    for line in table.lines().skip(1) {
        let offset_s: f64 = line.split(',').nth(10).unwrap().parse().unwrap();
        assert!(offset_s.abs() < 1e-4, "{line}");
    }
}

/// Calibrates the simulated ring in the world of the board, and compares it with the true poses.
fn check_board(folder: &TempDir, wanted: &[IsometryMatrix3<f64>]) {
    let board = "checkerboard:7x5:0.04";
    let arguments = [
        "calibrate",
        "rig",
        "ring/scene.toml",
        "-o",
        "on-board",
        "--board",
        board,
    ];
    let run = Run::pardalis(folder, &arguments).fine();
    println!("{}", run.stdout);
    let found = poses(&folder.path().join("on-board/rig.toml"));
    assert_eq!(found.len(), 4);
    for (wanted, found) in wanted.iter().zip(&found) {
        let world_from_board = wanted * found.inverse();
        let tilt_deg = (world_from_board * Vector3::z())
            .angle(&Vector3::z())
            .to_degrees();
        // The first corner is one of the outermost four, 0.12 and 0.08 m from the middle, on top of the board.
        let origin = world_from_board.translation.vector - Vector3::new(0.4, 0.6, 0.01);
        let off_m = (origin.abs() - Vector3::new(0.12, 0.08, 0.0)).norm();
        println!("{tilt_deg:.3} degrees, {:.2} mm", 1e3 * off_m);
        assert!(tilt_deg < 0.5 && off_m < 0.005, "{tilt_deg} {off_m}");
    }
}

#[test]
fn focal_lengths_are_refined_on_request() {
    let folder = folder(&[("scene.toml", scene("webcams-four", false, 1.06))]);
    let run = Run::pardalis(&folder, &["calibrate", "rig", "scene.toml"]).fine();
    println!("{}{}", run.stdout, run.stderr);
    assert!(
        run.stdout
            .contains("or refine the focal lengths (--refine-focal)"),
        "{}",
        run.stdout
    );
    let refine = [
        "calibrate",
        "rig",
        "scene.toml",
        "--refine-focal",
        "--corrected",
        "new.toml",
    ];
    let run = Run::pardalis(&folder, &refine).fine();
    println!("{}", run.stdout);
    let table = fs::read_to_string(folder.path().join("scene-rig/cameras.csv")).unwrap();
    let refined = table.lines().skip(1).filter(|line| line.ends_with(",1"));
    let rig = cameras(&folder.path().join("scene-rig/rig.toml"));
    let new = fs::read_to_string(folder.path().join("new.toml")).unwrap();
    let mut count = 0;
    for line in refined {
        let name = line.split(',').next().unwrap();
        let camera = rig.iter().find(|camera| camera.name == name).unwrap();
        let f_px = camera.camera.parameters()[0].1;
        assert!((f_px / 330.0 - 1.0).abs() < 0.03, "{name}: {f_px}");
        assert!(
            new.contains(&format!("f_px = [{f_px:?}, {f_px:?}] # px")),
            "{new}"
        );
        count += 1;
    }
    assert!(count > 0, "{table}");
}

/// Calibrates the rig and replaces the poses in the scene itself.
const IN_PLACE: [&str; 5] = [
    "calibrate",
    "rig",
    "scene.toml",
    "--corrected",
    "scene.toml",
];

#[test]
fn a_pose_in_the_scene_is_kept_and_guesses_are_replaced() {
    let matrix = |pose: &IsometryMatrix3<f64>| {
        let rows = pose.to_homogeneous();
        let row = |i: usize| format!("{:?}", (0..4).map(|j| rows[(i, j)]).collect::<Vec<_>>());
        format!("[{}]", (0..4).map(row).collect::<Vec<_>>().join(", "))
    };
    let truth = poses(&data("webcams-two").join("cameras.json"));
    let guess = matrix(&IsometryMatrix3::identity());
    let text = scene("webcams-two", false, 1.0)
        .replacen(
            "fps = 25",
            &format!("fps = 25\nworld_from_camera = {guess}"),
            1,
        )
        .replacen(
            "fps = 25\n[",
            &format!("fps = 25\nworld_from_camera = {}\n[", matrix(&truth[1])),
            1,
        );
    let text = format!("guessed = [\"cameras.cam1.world_from_camera\"]\n{text}");
    let folder = folder(&[("scene.toml", text)]);
    let run = Run::pardalis(&folder, &IN_PLACE);
    assert!(
        run.stderr.contains("guesses: world_from_camera"),
        "{}",
        run.stderr
    );
    assert!(run.stdout.contains("cam2 keeps the pose"), "{}", run.stdout);
    let found = poses(&folder.path().join("scene-rig/rig.toml"));
    let difference: Matrix4<f64> = found[1].to_homogeneous() - truth[1].to_homogeneous();
    assert!(difference.amax() < 1e-9, "{difference}");
    let apart = truth[0].inverse() * found[0];
    assert!(
        apart.rotation.angle() < 0.01 && apart.translation.vector.norm() < 0.006,
        "{apart}"
    );
    let new = fs::read_to_string(folder.path().join("scene.toml")).unwrap();
    assert!(new.starts_with("guessed = []\n"), "{new}");
    Run::pardalis(&folder, &["track", "scene.toml", "-o", "out", "--no-plots"]).fine();
}

#[test]
fn without_a_pose_the_first_guess_is_kept_and_all_poses_stay_guesses() {
    let text = scene("webcams-two", false, 1.0);
    // As `init` writes it: one metre above the floor, level.
    let guess = "[[0.0, 0.0, 1.0, 0.0], [-1.0, 0.0, 0.0, 0.0], [0.0, -1.0, 0.0, 1.0], [0.0, 0.0, 0.0, 1.0]]";
    let text = text.replace(
        "fps = 25",
        &format!("fps = 25\nworld_from_camera = {guess}"),
    );
    let names = ["cam1", "cam2"].map(|name| format!("\"cameras.{name}.world_from_camera\""));
    let listed = format!("guessed = [{}]\n", names.join(", "));
    let folder = folder(&[("scene.toml", format!("{listed}{text}"))]);
    // Once more, and nothing has become known.
    for _ in 0..2 {
        let run = Run::pardalis(&folder, &IN_PLACE);
        assert!(
            run.stdout.contains("cam1 keeps the guess of its pose"),
            "{}",
            run.stdout
        );
        let new = fs::read_to_string(folder.path().join("scene.toml")).unwrap();
        assert!(new.starts_with(&listed), "{new}");
        assert_eq!(new.matches(guess).count(), 1, "{new}");
    }
    // The second camera is where it is beside the first.
    let truth = poses(&data("webcams-two").join("cameras.json"));
    let found = poses(&folder.path().join("scene-rig/rig.toml"));
    let apart = (truth[0].inverse() * truth[1]).inverse() * (found[0].inverse() * found[1]);
    assert!(
        apart.rotation.angle() < 0.01 && apart.translation.vector.norm() < 0.006,
        "{apart}"
    );
    assert!((found[0].translation.vector.z - 1.0).abs() < 1e-9);
}

#[test]
fn what_does_not_determine_a_rig_is_refused_without_writing() {
    let text = scene("webcams-two", false, 1.0);
    let folder = folder(&[
        ("scene.toml", text.clone()),
        (
            "cup.csv",
            "view,u_px,v_px,x_m,y_m,z_m\ncup,1,2,0,0,0\n".to_owned(),
        ),
        (
            "few.csv",
            "view,u_px,v_px,x_m,y_m,z_m\ncam1,1,2,0,0,0\n".to_owned(),
        ),
        (
            "rest.csv",
            "time_s,x_m,y_m,z_m\n1,0,0,0\n3,1,0,0\n90,0,1,0\n".to_owned(),
        ),
        (
            "broken.csv",
            "view,u_px,v_px,x_m,y_m,z_m\ncam1,1,2,0,zero,0\n".to_owned(),
        ),
    ]);
    fs::create_dir(folder.path().join("other")).unwrap();
    let write = |text: &str| fs::write(folder.path().join("scene.toml"), text).unwrap();
    let refused = |more: &[&str], wanted: &[&str]| {
        let arguments = [&["calibrate", "rig", "scene.toml"], more].concat();
        Run::pardalis(&folder, &arguments).refused(wanted);
    };
    refused(
        &["--corrected", "other/new.toml"],
        &["other/new.toml", "beside the scene"],
    );
    refused(
        &["--target", "cup"],
        &["scene.toml", "ball", "--target NAME"],
    );
    for wrong in ["nan", "-1", "0"] {
        refused(&["--max-offset-s", wrong], &["max-offset-s", "allowed"]);
        refused(&["--duration", wrong], &["duration", "allowed"]);
    }
    refused(
        &["--points", "none.csv"],
        &["none.csv", "there is no such file"],
    );
    refused(
        &["--points", "broken.csv"],
        &["broken.csv", "line 2", "zero"],
    );
    refused(&["--points", "cup.csv"], &["cup.csv", "cup", "cam1, cam2"]);
    refused(
        &["--points", "few.csv"],
        &["few.csv", "at least four points"],
    );
    refused(
        &["--points", "rest.csv"],
        &["rest.csv", "the ball moved by", "around 3 s"],
    );
    refused(
        &["--board", "checkerboard:9x6:0.025"],
        &["--board", "no camera shows the board"],
    );
    // The ball is at rest in the first 60 frames.
    write(&text.replace("fps = 25", "fps = 25\nframe_limit = 50"));
    refused(&[], &["scene.toml", "objects at rest count as background"]);
    write(&text.replace("radius_m = 0.035", "radius_m = \"unknown\""));
    refused(&[], &["targets.ball", "measure the ball"]);
    write(&text.replace(
        "sphere.radius_m = 0.035",
        "cylinder = { radius_m = 0.03, height_m = 0.1 }",
    ));
    refused(&[], &["targets.ball", "is no ball"]);
    let second = text.find("[cameras.cam2]").unwrap()..text.find("[targets").unwrap();
    let mut alone = text.clone();
    alone.replace_range(second, "");
    write(&alone);
    refused(&[], &["scene.toml", "two or more"]);
    assert!(!folder.path().join("scene-rig").exists());
    // Tracking still needs poses.
    write(&text);
    let arguments = ["track", "scene.toml", "-o", "out"];
    Run::pardalis(&folder, &arguments).refused(&[
        "world_from_camera",
        "is missing",
        "`pardalis calibrate rig`",
    ]);
}

#[test]
fn a_corrected_scene_leaves_no_pose_beside_that_of_a_calibration_file() {
    let text = scene("webcams-two", true, 1.0);
    // One camera overrides the pose of its file.
    let moved =
        "fps = 25\nworld_from_camera = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 9], [0, 0, 0, 1]]";
    let folder = folder(&[
        ("scene.toml", text.clone()),
        ("moved.toml", text.replacen("fps = 25", moved, 1)),
    ]);
    for name in ["scene", "moved"] {
        let (from, to) = (format!("{name}.toml"), format!("{name}-new.toml"));
        Run::pardalis(&folder, &["calibrate", "rig", &from, "--corrected", &to]);
        let out = format!("{name}-out");
        // Without the warning that a pose overrides that of the file.
        Run::pardalis(&folder, &["track", &to, "-o", &out, "--no-plots"]).fine();
        // It tracks with the poses that were found: those of the rig's file.
        let new = fs::read_to_string(folder.path().join(&to)).unwrap();
        let rig = format!("calibration = \"{name}-rig/rig.toml\"");
        assert_eq!(new.matches(&rig).count(), 2, "{new}");
        assert_eq!(new.contains("world_from_camera"), name == "moved", "{new}");
    }
}

#[test]
fn live_cameras_are_watched_for_a_while() {
    let folder = folder(&[]);
    let mut text = scene("webcams-two", false, 1.0);
    for name in ["cam1", "cam2"] {
        let images = data("webcams-two").join("frames").join(name);
        let film = format!("{name}.mkv");
        let encoded = std::process::Command::new("ffmpeg")
            .args(["-v", "error", "-framerate", "25", "-i"])
            .arg(images.join("%06d.jpg"))
            .args(["-c:v", "mjpeg", "-q:v", "2", "-pix_fmt", "yuvj420p"])
            .arg(folder.path().join(&film))
            .status();
        if !encoded.is_ok_and(|status| status.success()) {
            println!("skipped: ffmpeg is not installed");
            return;
        }
        let recorded = format!("images = '{}'\nfps = 25", images.display());
        // At the rate of a camera.
        let live = format!("video = \"{film}\"\ninput.real_time = true");
        text = text.replace(&recorded, &live);
    }
    fs::write(folder.path().join("live.toml"), text).unwrap();
    let rig = ["calibrate", "rig", "live.toml"];
    Run::pardalis(&folder, &rig).refused(&["cam1.mkv", "is live", "--duration SECONDS"]);
    let enough = ["--duration", "5", "--corrected", "new.toml"];
    Run::pardalis(&folder, &[&rig[..], &enough].concat()).fine();
    let table = fs::read_to_string(folder.path().join("live-rig/cameras.csv")).unwrap();
    for row in table.lines().skip(1) {
        // Both were watched at once, and neither to its end.
        let frames: usize = row.split(',').nth(1).unwrap().parse().unwrap();
        assert!((60..160).contains(&frames), "{table}");
    }
    let found = poses(&folder.path().join("live-rig/rig.toml"));
    let truth = poses(&data("webcams-two").join("cameras.json"));
    let [found, truth] = [found, truth].map(|poses| poses[0].inverse() * poses[1]);
    let apart = truth.inverse() * found;
    assert!(
        apart.rotation.angle() < 0.05 && apart.translation.vector.norm() < 0.05,
        "{apart}"
    );
}
