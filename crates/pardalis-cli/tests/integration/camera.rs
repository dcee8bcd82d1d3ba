//! `pardalis camera`, run as a program: output, conversions and errors.

use std::fs;
use std::path::Path;
use std::process::Command;

use tempfile::TempDir;

// Only the scene and the outcome of a run are used here.
#[allow(dead_code)]
use crate::common::{Run, SCENE, data, frame_file};

use pardalis_images::RgbImage;
fn read_picture(path: std::path::PathBuf) -> RgbImage {
    pardalis_images::decode(&fs::read(path).unwrap()).unwrap()
}

/// A fisheye of 185 degrees with a circle of 470 pixels, 0.9 m above the floor and looking down.
const LENS: &str = r"[cameras.cam1]
size_px = [640, 480]
model.equidistant = { f_px_per_rad = 145.5622506548578, center_px = [319.5, 239.5], field_of_view_deg = 185.0 }
world_from_camera = [[0, -1, 0, 0], [-1, 0, 0, 0], [0, 0, -1, 0.9], [0, 0, 0, 1]]
";

/// A calibration of one camera without size and pose.
const LENS_ALONE: &str = r"[cameras.cam1.model.double_sphere]
f_px = [300.5, 301.25]
center_px = [319.5, 239.5]
xi = -0.2
alpha = 0.6
";

fn folder_with(name: &str, text: &str) -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join(name), text).unwrap();
    folder
}

fn camera(folder: &Path, arguments: &str) -> Run {
    Run::of(
        Command::new(env!("CARGO_BIN_EXE_pardalis"))
            .current_dir(folder)
            .arg("camera")
            .args(arguments.split(' ')),
    )
}

#[track_caller]
fn assert_prints(run: &Run, parts: &[&str]) {
    for part in parts {
        assert!(run.stdout.contains(part), "no {part:?} in: {}", run.stdout);
    }
}

#[test]
fn a_fisheye_is_shown_with_angles_and_pose_from_calibration_and_scene() {
    let folder = folder_with("lens.toml", LENS);
    fs::write(folder.path().join("scene.toml"), SCENE).unwrap();
    for arguments in ["show lens.toml", "show scene.toml --size 640x480"] {
        let run = camera(folder.path(), arguments).fine();
        let expected = [
            "equidistant",
            "185.00° horizontal, 185.00° vertical, 185.00° diagonal",
            "92.50° from z",
            // 1 - pi 235² / (640 x 480)
            "43.5 % of the pixels have no ray",
            "2.541 at the centre, 2.541 at the edge",
            "x 0.0000, y 0.0000, z 0.9000 m",
            "x 0.0000, y 0.0000, z -1.0000\n",
        ];
        assert_prints(&run, &expected);
    }
}

#[test]
fn pictures_of_the_lens_are_drawn() {
    let folder = folder_with("lens.toml", LENS);
    camera(folder.path(), "show lens.toml -o out").fine();
    for name in ["cam1-field-of-view", "cam1-distortion"] {
        let png = read_picture(folder.path().join(format!("out/{name}.png")));
        assert!(png.width() > 900, "{name}");
        let svg = fs::read_to_string(folder.path().join(format!("out/{name}.svg"))).unwrap();
        assert!(svg.contains('°'), "{name}");
    }
}

#[test]
fn overlapping_labels_of_angles_are_omitted() {
    let folder = folder_with("lens.toml", LENS);
    let labels = |file: &str| -> Vec<usize> {
        let run = camera(folder.path(), &format!("show {file} -o out")).fine();
        let svg = run
            .stdout
            .lines()
            .find(|line| line.ends_with("field-of-view.svg"));
        let svg = fs::read_to_string(folder.path().join(svg.unwrap().trim())).unwrap();
        let label = |i: &usize| svg.contains(&format!("\n{i}°\n"));
        (10..100).step_by(10).filter(label).collect()
    };
    assert_eq!(labels("lens.toml"), [10, 20, 30, 40, 50, 60, 70, 80, 90]);
    let mirror = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../../data/calibration/catadioptric/camera.toml");
    assert_eq!(labels(mirror.to_str().unwrap()), [20, 40, 50, 60, 70]);
}

#[test]
fn grid_lines_lie_where_the_camera_projects_them() {
    let folder = folder_with("lens.toml", LENS);
    fs::copy(frame_file(0), folder.path().join("image.jpg")).unwrap();
    camera(
        folder.path(),
        "show lens.toml --grid image.jpg --spacing 0.5 -o out",
    )
    .fine();
    let picture = read_picture(folder.path().join("out/cam1-grid.png"));
    let photo = read_picture(frame_file(0));
    assert_eq!(picture.dimensions(), (1280, 960));
    // Camera x is world -y, camera y is world -x, z points down: rho = f atan(r / 0.9).
    let pixel_of = |x_m: f64, y_m: f64| {
        let r_m = x_m.hypot(y_m);
        let rho_px = 145.562_250_654_857_8 * (r_m / 0.9).atan();
        [319.5 - rho_px * y_m / r_m, 239.5 - rho_px * x_m / r_m]
    };
    let yellow = |[u, v]: [f64; 2]| {
        let at = |c: f64| (2.0 * (c + 0.5)) as u32;
        (0..9).any(|i| {
            let [r, g, b] = picture.get_pixel(at(u) + i % 3 - 1, at(v) + i / 3 - 1);
            i32::from(r.min(g)) - i32::from(b) > 90
        })
    };
    for i in 1..20 {
        let along_m = 1.1 + 0.1 * f64::from(i);
        // On the lines x = 1 and y = -1.5, far from the labels, which are at the axes.
        assert!(yellow(pixel_of(1.0, along_m)), "x = 1 at {along_m}");
        assert!(yellow(pixel_of(-along_m, -1.5)), "y = -1.5 at {along_m}");
    }
    // Midway between lines near the camera, the photo is unchanged.
    for at_m in [[0.75, 1.25], [-0.75, 1.25], [1.25, -0.75]] {
        let [u, v] = pixel_of(at_m[0], at_m[1]);
        assert!(!yellow([u, v]), "{at_m:?}");
        let drawn = picture.get_pixel(2 * u.round() as u32, 2 * v.round() as u32);
        let seen = photo.get_pixel(u.round() as u32, v.round() as u32);
        for (a, b) in drawn.iter().zip(seen) {
            assert!(a.abs_diff(b) < 60, "{drawn:?} {seen:?}");
        }
    }
}

#[test]
fn cameras_round_trip_through_every_format_that_supports_them() {
    let pinhole = "[cameras.cam0]\nsize_px = [640, 480]\n[cameras.cam0.model.pinhole]\n\
                   f_px = [500.25, 501.5]\ncenter_px = [321.125, 239.75]\ndistortion = [-0.25, 0.125, 0.001, -0.002]\n";
    let kannala_brandt = "[cameras.cam0]\nsize_px = [640, 480]\n[cameras.cam0.model.kannala_brandt]\n\
                          f_px = [300.25, 301.5]\ncenter_px = [321.125, 239.75]\nk = [0.01, -0.002, 0.0005, 0.0]\n\
                          field_of_view_deg = 160.0\n";
    let ocam = "[cameras.cam0]\nsize_px = [640, 480]\n[cameras.cam0.model.ocam]\npolynomial = [-200.5, 0.0, 0.0015]\n\
                center_px = [320.25, 240.5]\naffine = [1.0, 0.001, -0.0005]\nmax_radius_px = 230.0\n";
    let parameters = |folder: &Path, file: &str, size: &str| {
        let run = camera(folder, &format!("show {file}{size}")).fine();
        // From the model's name to the image size: every parameter to its last digit.
        let begin = run.stdout.find("model").unwrap();
        let end = run.stdout.find("  image ").unwrap();
        run.stdout[begin..end].to_owned()
    };
    for (text, formats) in [
        (
            pinhole,
            &["pardalis", "opencv-yaml", "opencv-xml", "ros", "kalibr"][..],
        ),
        (
            kannala_brandt,
            &[
                "pardalis",
                "opencv-yaml",
                "opencv-xml",
                "ros",
                "kalibr",
                "basalt",
            ],
        ),
        (ocam, &["pardalis", "ocamcalib"]),
    ] {
        let folder = folder_with("in.toml", text);
        let before = parameters(folder.path(), "in.toml", "");
        for format in formats {
            // Kalibr and Basalt store extrinsics; the world is then their first camera.
            camera(
                folder.path(),
                &format!("convert in.toml --to {format} -o there"),
            )
            .fine();
            camera(folder.path(), "convert there --to pardalis -o back.toml").fine();
            let after = parameters(folder.path(), "back.toml", " --size 640x480");
            assert_eq!(after, before, "{format}");
        }
    }
}

#[test]
fn cameras_of_sequence_folders_are_read() {
    let folder = folder_with("lens.toml", LENS);
    fs::copy(
        data().join("camera.json"),
        folder.path().join("camera.json"),
    )
    .unwrap();
    let ours = camera(folder.path(), "show lens.toml").fine();
    let json = camera(folder.path(), "show camera.json").fine();
    assert_eq!(json.stdout, ours.stdout);
    camera(
        folder.path(),
        "convert camera.json --to pardalis -o back.toml",
    )
    .fine();
    let back = camera(folder.path(), "show back.toml").fine();
    assert_eq!(back.stdout, ours.stdout);

    let mirrors = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../data/calibration/catadioptric");
    let run = camera(&mirrors, "show camera.json").fine();
    assert_prints(
        &run,
        &["exact_mirror", "vertex_m           0.16", "z 0.8200 m"],
    );
    let text = fs::read_to_string(folder.path().join("camera.json")).unwrap();
    for (piece, other, wanted) in [
        (
            "\"fisheye_equidistant\"",
            "\"other\"",
            &["line 3: model: is \"other\"; allowed: fisheye_equidistant"][..],
        ),
        ("\"f_px_per_rad\"", "\"f\"", &["f_px_per_rad is missing"]),
        (
            "145.5622506548578",
            "-1",
            &["line 3: model: f_px_per_rad is -1"],
        ),
        ("\"width\": 640", "\"width\": 0", &["line 5: width: is 0"]),
    ] {
        assert!(text.contains(piece), "{piece}");
        fs::write(
            folder.path().join("bad.json"),
            text.replacen(piece, other, 1),
        )
        .unwrap();
        camera(folder.path(), "show bad.json").refused(wanted);
    }
}

#[test]
fn properties_lost_by_a_format_are_listed() {
    let folder = folder_with("lens.toml", LENS);
    for (format, left_out) in [
        ("ros", "not support it: pose, field of view\n"),
        ("kalibr", "not support it: field of view, name\n"),
        ("opencv-yaml", "not support it: field of view, name\n"),
    ] {
        let run = camera(
            folder.path(),
            &format!("convert lens.toml --to {format} -o there"),
        )
        .fine();
        assert_prints(
            &run,
            &[&format!("not written, because {format} does {left_out}")],
        );
    }
    let run = camera(folder.path(), "convert lens.toml --to pardalis -o there").fine();
    assert!(!run.stdout.contains("not written"), "{}", run.stdout);
    // A fisheye that was read without a limit of its field of view loses none.
    camera(folder.path(), "convert lens.toml --to ros -o lens.yaml").fine();
    let run = camera(folder.path(), "convert lens.yaml --to kalibr -o there").fine();
    assert!(!run.stdout.contains("field of view"), "{}", run.stdout);

    camera(folder.path(), "convert lens.toml --to ros -o ./lens.toml")
        .refused(&["-o ./lens.toml", "is the input file"]);
    assert_eq!(
        fs::read_to_string(folder.path().join("lens.toml")).unwrap(),
        LENS
    );
}

#[test]
fn convert_accepts_a_size_that_the_file_lacks() {
    let folder = folder_with("alone.toml", LENS_ALONE);
    let convert = "convert alone.toml --to kalibr -o there";
    camera(folder.path(), convert)
        .refused(&["the size of the images of camera cam1 is unknown", "--size"]);
    camera(folder.path(), &format!("{convert} --size 640x480")).fine();
    assert_prints(
        &camera(folder.path(), "show there").fine(),
        &["640 x 480 px"],
    );
}

#[test]
fn toml_errors_are_reported_with_their_line() {
    let folder = folder_with("lens.toml", LENS);
    let refused = |text: &str, wanted: &str| {
        fs::write(folder.path().join("bad.toml"), text).unwrap();
        let run = camera(folder.path(), "show bad.toml");
        run.refused(&[wanted]);
        run.stderr
    };
    let swapped = LENS.replace("[cameras.cam1]", "[camera.cam1]");
    refused(
        &swapped,
        "line 1: camera: is not a key; did you mean cameras?",
    );
    refused(
        "[package]\nname = \"x\"\n",
        "line 1: cameras: is missing; describe each in a table [cameras.NAME]",
    );
    // An error in the TOML syntax is reported alone.
    for cut in ["0.9], [0, 0, 0, 1]]", "480]"] {
        let message = refused(
            &LENS.replacen(cut, &cut[..cut.len() - 1], 1),
            "bad.toml: line ",
        );
        assert_eq!(message.matches("line ").count(), 1, "{message}");
        assert!(!message.contains("cameras.cam1"), "{message}");
    }
}

#[test]
fn options_must_agree_with_the_file() {
    let folder = folder_with("lens.toml", LENS);
    camera(folder.path(), "show lens.toml --as fisheye").fine();
    camera(folder.path(), "show lens.toml --as pinhole").refused(&[
        "camera cam1 is equidistant according to the file",
        "read as pinhole",
    ]);
    fs::write(folder.path().join("scene.toml"), SCENE).unwrap();
    camera(folder.path(), "show scene.toml --as fisheye").refused(&["--as fisheye", "is a scene"]);
    let help = camera(folder.path(), "show --help").fine();
    assert_prints(&help, &["pinhole, fisheye, omnidir", "--size"]);
}

#[test]
fn errors_name_the_cause_and_the_remedy() {
    let folder = folder_with("lens.toml", LENS);
    let path = folder.path();
    fs::write(path.join("alone.toml"), LENS_ALONE).unwrap();
    fs::copy(frame_file(0), path.join("image.jpg")).unwrap();
    let two = format!("{LENS}{}", LENS.replace("cam1", "cam2"));
    fs::write(path.join("two.toml"), two).unwrap();
    fs::write(path.join("broken.toml"), LENS.replace("185.0", "-3")).unwrap();
    let small = LENS.replace("[640, 480]", "[320, 240]");
    fs::write(path.join("small.toml"), small).unwrap();
    for (arguments, wanted) in [
        ("show nothing.toml", &["nothing.toml", "no such file"][..]),
        ("show lens.toml --camera cam3", &["--camera cam3", "cam1"]),
        (
            "show lens.toml --size 320x240",
            &["--size 320x240", "cam1", "640x480"],
        ),
        ("show alone.toml", &["alone.toml", "cam1", "--size"]),
        (
            "show broken.toml",
            &["broken.toml", "line 3", "field_of_view_deg"],
        ),
        (
            "show two.toml --grid image.jpg -o out",
            &["--grid", "--camera", "cam1, cam2"],
        ),
        (
            "show alone.toml --grid image.jpg -o out",
            &[
                "alone.toml",
                "no pose",
                "`pardalis calibrate pose`",
                "world_from_camera",
            ],
        ),
        (
            "show small.toml --grid image.jpg -o out",
            &["image.jpg", "640 x 480", "320 x 240"],
        ),
        (
            "show lens.toml --grid image.jpg -o out --spacing 0",
            &["--spacing 0"],
        ),
        (
            "show lens.toml --grid image.jpg -o out --extent 2,1,0,1",
            &["--extent", "ascending"],
        ),
        (
            "show lens.toml --grid image.jpg -o out --heights 2000 --extent 1,2,1,2 --spacing 1",
            &["--extent", "cam1"],
        ),
        (
            "convert lens.toml --to ocamcalib -o out.txt",
            &["lens.toml", "cam1", "equidistant", "kalibr"],
        ),
    ] {
        camera(path, arguments).refused(wanted);
    }
    let run = camera(path, "convert lens.toml --to word -o out.txt");
    assert_eq!(run.code, Some(2));
    assert!(run.stderr.contains("allowed: pardalis"), "{}", run.stderr);
}
