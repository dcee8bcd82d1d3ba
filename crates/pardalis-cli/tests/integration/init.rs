//! `pardalis init`: each kind of input gives a scene that `pardalis track` accepts, with every guess marked.

use std::fs;
use std::process::Command;

use crate::common::{OPENCV_FISHEYE, Run, Workplace, data, frame_file};

/// Runs `pardalis init` in the folder.
fn init(place: &Workplace, arguments: &[&str]) -> Run {
    Run::pardalis(place.path(""), &[&["init"], arguments].concat())
}

/// Returns the scene that `pardalis init` wrote.
fn scene(place: &Workplace) -> String {
    fs::read_to_string(place.path("scene.toml")).unwrap()
}

/// Returns the keys of the lines marked CHANGE.
fn marked(scene: &str) -> Vec<&str> {
    let lines = scene.lines().filter(|line| line.contains("# CHANGE"));
    lines.map(|line| line.split(' ').next().unwrap()).collect()
}

/// Returns the scene without its list of guesses, as a user leaves it who has checked them.
fn confirmed(scene: &str) -> String {
    let Some((before, list)) = scene.split_once("guessed = [") else {
        return scene.to_owned();
    };
    let (_, after) = list.split_once("\n]\n").unwrap();
    before.to_owned() + after
}

/// Tracks with few particles and returns the number of rows.
#[track_caller]
fn tracked(place: &Workplace, scene: &str) -> usize {
    assert!(
        scene.contains("particles = 5000"),
        "the scene must start from a click"
    );
    let scene = scene.replace("particles = 5000", "particles = 100");
    place.track(confirmed(&scene)).fine();
    place.rows().len()
}

/// Creates a sequence folder with the calibration of data/dioptric-jump, modified by `edit`, and three frames
/// of each camera.
fn sequence(cameras: &[&str], edit: impl Fn(&mut serde_json::Value)) -> Workplace {
    let place = Workplace::with_frames(0);
    let mut camera: serde_json::Value = serde_json::from_str(&calibration(edit)).unwrap();
    fs::create_dir(place.path("ride")).unwrap();
    let put_frames = |folder: &str| {
        fs::create_dir_all(place.path(folder)).unwrap();
        for number in 0..3 {
            let name = format!("{folder}/{number:06}.jpg");
            fs::copy(frame_file(number), place.path(&name)).unwrap();
        }
    };
    if cameras.is_empty() {
        place.write("ride/camera.json", camera.to_string());
        put_frames("ride/frames");
    } else {
        let named = cameras.iter().map(|name| {
            put_frames(&format!("ride/frames/{name}"));
            camera["name"] = (*name).into();
            // No two cameras have the same position.
            camera["T_world_from_camera"][0][3] = (name.len() as f64 / 100.0).into();
            camera.clone()
        });
        let named: Vec<_> = named.collect();
        let file =
            serde_json::json!({"cameras": named, "sequence": {"fps": 20, "ball_radius_m": 0.035}});
        place.write("ride/cameras.json", file.to_string());
    }
    place
}

#[test]
fn only_guesses_are_marked() {
    let place = Workplace::with_frames(1);
    let run = init(&place, &["images"]).fine();
    let guesses = [
        "fps",
        "world_from_camera",
        "f_px",
        "center_px",
        "shape.sphere.radius_m",
    ];
    assert_eq!(marked(&scene(&place)), guesses);
    assert!(run.stdout.contains("marked CHANGE (5)"), "{}", run.stdout);
    assert!(run.stdout.contains("learn … -o ball.colors.toml"));
    assert!(scene(&place).contains("\ncolors = \"ball.colors.toml\""));
    init(&place, &["images", "--force", "--target", "robot"]).fine();
    assert!(scene(&place).contains("\ncolors = \"robot.colors.toml\""));

    let known = [
        "--fps",
        "5",
        "--radius-m",
        "0.2",
        "--pixel",
        "460,88",
        "--colors",
        "ball.toml",
    ];
    let run = init(&place, &[&["images", "--force"], &known[..]].concat()).fine();
    assert_eq!(marked(&scene(&place)), guesses[1..4]);
    assert!(!run.stdout.contains("learn"), "{}", run.stdout);
    let text = scene(&place);
    for line in [
        "fps = 5.0",
        "shape.sphere.radius_m = 0.2",
        "pixel_px = [460.0, 88.0]",
    ] {
        assert!(text.lines().any(|l| l == line), "{line}");
    }
}

#[test]
fn track_warns_of_guesses_until_they_are_replaced() {
    let place = Workplace::with_frames(2);
    let arguments = ["images", "--camera", "pinhole", "--colors", "ball.toml"];
    init(&place, &arguments).fine();
    let text = scene(&place);
    let run = place.track(&text);
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    let line_of = |mark: &str| {
        1 + text
            .lines()
            .position(|line| line.starts_with(mark))
            .unwrap()
    };
    let expected = format!(
        "guessed: positions are only as right as these guesses: fps (line {}), world_from_camera (line {}), f_px (line {}), \
         center_px (line {}), radius_m (line {}). Replace each and remove it from this list\n",
        line_of("fps"),
        line_of("world_from_camera"),
        line_of("f_px"),
        line_of("center_px"),
        line_of("shape.sphere.radius_m"),
    );
    assert!(run.stderr.starts_with("warning: "), "{}", run.stderr);
    assert!(run.stderr.contains(&expected), "{}\n{expected}", run.stderr);

    let text = text.replace("    \"cameras.camera.fps\",\n", "");
    let run = place.track(&text);
    assert!(!run.stderr.contains("fps"), "{}", run.stderr);
    assert!(run.stderr.contains("radius_m (line "), "{}", run.stderr);
    assert_warns_of_no_guess(&place.track(confirmed(&text)));

    let misspelt = text.replace("pinhole.f_px\"", "pinhole.f\"");
    place
        .track(&misspelt)
        .refused(&["guessed: names cameras.camera.model.pinhole.f, "]);
}

/// Checks that a run succeeded without a warning of guesses. At the place of the guessed camera the ball is not found.
#[track_caller]
fn assert_warns_of_no_guess(run: &Run) {
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    let warned = "warning: targets.ball: was not found in any of the 2 frames\n";
    assert!(run.stderr.starts_with(warned), "{}", run.stderr);
    assert!(!run.stderr.contains("guess"), "{}", run.stderr);
}

/// Returns a JPEG image of a frame's size with these EXIF data in place of its own.
fn with_exif(place: &Workplace, name: &str, film_focal_length_mm: u8) {
    let frame = fs::read(frame_file(0)).unwrap();
    let mut exif =
        b"\xFF\xE1\x00\x34Exif\0\0MM\0*\0\0\0\x08\0\x01\x87\x69\0\x04\0\0\0\x01\0\0\0\x1A\0\0\0\0\
                     \0\x01\xA4\x05\0\x03\0\0\0\x01\0\0\0\0\0\0\0\0"
            .to_vec();
    exif[47] = film_focal_length_mm;
    fs::write(place.path(name), [&frame[..2], &exif, &frame[2..]].concat()).unwrap();
}

/// Returns the line with the focal length of a scene.
fn focal_length_line(place: &Workplace) -> String {
    let text = scene(place);
    let line = text.lines().find(|line| line.starts_with("f_px = "));
    line.unwrap().to_owned()
}

#[test]
fn focal_lengths_come_from_the_angle_of_view_or_exif_data() {
    let place = Workplace::with_frames(2);
    let pinhole = [
        "images",
        "--camera",
        "pinhole",
        "--colors",
        "ball.toml",
        "--force",
    ];
    init(&place, &pinhole).fine();
    let line = focal_length_line(&place);
    assert!(
        line.starts_with("f_px = [554.3, 554.3]  # CHANGE: for 60 degrees"),
        "{line}"
    );

    for arguments in [
        &["images", "--fov", "90", "--force"][..],
        &[&pinhole[..], &["--fov", "90"]].concat(),
    ] {
        init(&place, arguments).fine();
        let expected = "f_px = [320.0, 320.0]  # 90 degrees across the longer side";
        assert_eq!(focal_length_line(&place), expected);
        assert_eq!(
            marked(&scene(&place)),
            ["fps", "world_from_camera", "shape.sphere.radius_m"]
        );
    }

    // 640 x 480 pixels have a diagonal of 800, film one of 43.27 mm.
    with_exif(&place, "images/000000.jpg", 26);
    init(&place, &pinhole).fine();
    let line = focal_length_line(&place);
    assert!(
        line.starts_with("f_px = [480.7, 480.7]  # from the EXIF data of 000000.jpg: 67.3 degrees"),
        "{line}"
    );
    assert_eq!(
        marked(&scene(&place)),
        ["fps", "world_from_camera", "shape.sphere.radius_m"]
    );
    assert_warns_of_no_guess(&place.track(confirmed(&scene(&place))));
    // The command line overrides the image.
    init(&place, &[&pinhole[..], &["--fov", "90"]].concat()).fine();
    assert!(focal_length_line(&place).starts_with("f_px = [320.0"));

    with_exif(&place, "photo.jpg", 52);
    init(&place, &["images", "--camera", "photo.jpg", "--force"]).fine();
    let line = focal_length_line(&place);
    assert!(
        line.starts_with("f_px = [961.5, 961.5]  # from the EXIF data of photo.jpg"),
        "{line}"
    );
}

#[test]
fn angles_of_view_that_do_not_apply_are_refused() {
    let place = Workplace::with_frames(2);
    for (arguments, expected) in [
        (&["--fov", "180"][..], "allowed: 1 to 170 degrees"),
        (&["--fov", "-60"], "allowed: 1 to 170 degrees"),
        (&["--fov", "wide"], "is not a number"),
        (
            &["--fov", "60", "--camera", "equidistant"],
            "--fov: applies to a pinhole camera of which nothing else is known; remove it with --camera equidistant",
        ),
        (
            &["--fov", "60", "--camera", "lens.yml"],
            "remove it with --camera lens.yml",
        ),
        (
            &["--camera", "images/000000.jpg"],
            "--camera images/000000.jpg: its EXIF data state no focal length; give the angle of view with --fov DEGREES",
        ),
        (&["--camera", "nowhere.jpg"], "nowhere.jpg: cannot be read"),
        (
            &["--camera", "images/000000.jpg", "--as", "fisheye"],
            "--as: applies to calibration files only",
        ),
    ] {
        init(&place, &[&["images"], arguments].concat()).refused(&[expected]);
    }
}

#[test]
fn unlikely_sizes_and_angles_are_warned_of() {
    let place = Workplace::with_frames(1);
    for (arguments, wanted) in [
        (
            ["--radius-m", "35"],
            "a radius of 35 m? --radius-m is in metres",
        ),
        (["--radius-m", "0.00035"], "a radius of 0.00035 m?"),
        (
            ["--fov", "165"],
            "--fov: 165 degrees are hardly those of a pinhole camera; for a fisheye lens use --camera equidistant",
        ),
    ] {
        let run = init(&place, &[&["images", "--force"], &arguments[..]].concat());
        assert_eq!(run.code, Some(0), "{}", run.stderr);
        assert!(run.stderr.starts_with("warning: --"), "{}", run.stderr);
        assert!(run.stderr.contains(wanted), "{}", run.stderr);
    }
    for arguments in [
        ["--radius-m", "2"],
        ["--radius-m", "0.002"],
        ["--fov", "120"],
    ] {
        init(&place, &[&["images", "--force"], &arguments[..]].concat()).fine();
    }
}

#[test]
fn a_missing_input_is_reported_before_an_existing_scene() {
    let place = Workplace::with_frames(1);
    place.write("scene.toml", "");
    init(&place, &["nothere.mp4"]).refused(&["nothere.mp4: no such file or folder"]);
    init(&place, &["images"]).refused(&["scene.toml: already exists"]);
    init(&place, &["."]).refused(&[".: the folder holds no images, but folders with images: images; give one of them; for several cameras"]);
    init(&place, &["images", "--pixel", "-5,270"]).refused(&["--pixel -5,270: outside the image"]);
    init(&place, &["images", "--colors", "images"]).refused(&["--colors: images is a folder"]);
}

#[test]
fn every_camera_model_gives_a_scene_that_tracks() {
    for model in ["equidistant", "pinhole", "unified", "perspective_mirror"] {
        let place = Workplace::with_frames(2);
        let arguments = [
            "images",
            "--camera",
            model,
            "--colors",
            "ball.toml",
            "--pixel",
            "460,88",
        ];
        init(&place, &arguments).fine();
        let text = scene(&place);
        assert!(text.contains(&format!(".model.{model}]")), "{text}");
        assert_eq!(tracked(&place, &text), 2, "{model}");
    }
}

#[test]
fn scenes_with_corrected_values_track_the_ball() {
    let place = Workplace::with_frames(3);
    let arguments = [
        "images",
        "--fps",
        "25",
        "--camera",
        "equidistant",
        "--colors",
        "ball.toml",
        "--pixel",
        "460,88",
    ];
    init(&place, &arguments).fine();
    let text = scene(&place)
        .replace("[0.0, 0.0, -1.0, 1.0]", "[0.0, 0.0, -1.0, 0.9]")
        .replace("f_px_per_rad = 148.7", "f_px_per_rad = 145.5622506548578");
    assert_eq!(tracked(&place, &text), 3);
    let row = place.rows().pop().unwrap();
    let [x, y, z]: [f64; 3] = std::array::from_fn(|i| row[4 + i].parse().unwrap());
    // The true position is (1.35, -1.25, 0.62); only the direction is certain.
    let off = f64::hypot(y / x + 1.25 / 1.35, (z - 0.9) / x - (0.62 - 0.9) / 1.35);
    assert!(off < 0.05, "({x}, {y}, {z})");
}

#[test]
fn a_single_image_gives_a_scene_that_locates_the_ball() {
    let place = sequence(&[], |_| {});
    let image = "ride/frames/000000.jpg";
    let camera = "ride/camera.json";
    let arguments = [image, "--camera", camera, "--colors", "ball.toml"];
    let run = init(&place, &arguments).fine();
    assert!(
        run.stdout.contains("pardalis locate scene.toml"),
        "{}",
        run.stdout
    );
    let text = scene(&place);
    assert!(
        text.contains("images = \"ride/frames/000000.jpg\""),
        "{text}"
    );
    assert!(!text.contains("fps"), "{text}");
    let mut locate = Command::new(env!("CARGO_BIN_EXE_pardalis"));
    let locate = locate.current_dir(place.path(""));
    Run::of(locate.args(["locate", "scene.toml", "-o", "out"])).fine();
    let rows = place.rows();
    assert_eq!((rows.len(), &*rows[0][3]), (1, "tracking"));
}

#[test]
fn sequence_folders_need_no_changes_and_the_ball_is_found() {
    let place = sequence(&[], |_| {});
    let run = init(&place, &["ride", "--colors", "ball.toml"]).fine();
    assert!(!run.stdout.contains("CHANGE"), "{}", run.stdout);
    let text = scene(&place);
    // The ball is detected automatically.
    assert!(!text.contains("pixel ="), "{text}");
    place.track(&text).fine();
    let rows = place.rows();
    assert_eq!(rows.len(), 3);
    assert!(rows.iter().all(|row| row[3] == "tracking"), "{rows:?}");
    let arguments = [
        "ride",
        "--colors",
        "ball.toml",
        "--pixel",
        "460,88",
        "--force",
    ];
    let run = init(&place, &arguments).fine();
    assert!(!run.stdout.contains("CHANGE"), "{}", run.stdout);
    let text = scene(&place);
    for line in ["[cameras.cam1]", "images = \"ride/frames\"", "fps = 25.0"] {
        assert!(text.lines().any(|l| l == line), "{line}");
    }
    assert_eq!(tracked(&place, &text), 3);
}

#[test]
fn several_cameras_and_the_ball_radius_are_imported() {
    let place = sequence(&["left", "right"], |_| {});
    init(
        &place,
        &["ride", "--colors", "ball.toml", "--pixel", "460,88"],
    )
    .fine();
    let text = scene(&place);
    for line in [
        "images = \"ride/frames/left\"",
        "images = \"ride/frames/right\"",
        "fps = 20.0",
        "camera = \"left\"",
        "shape.sphere.radius_m = 0.035",
    ] {
        assert!(text.lines().any(|l| l == line), "{line}");
    }
    assert_eq!(tracked(&place, &text), 3);
}

#[test]
fn a_pinhole_calibration_keeps_its_numbers() {
    let place = sequence(&[], |camera| {
        camera["model"] = "pinhole".into();
        camera["fx"] = 330.5.into();
        camera["fy"] = 331.5.into();
        camera["distortion"] = vec![0.1, -0.01].into();
    });
    init(
        &place,
        &["ride", "--colors", "ball.toml", "--pixel", "460,88"],
    )
    .fine();
    let text = scene(&place);
    assert!(
        text.contains("calibration = \"ride/camera.json\""),
        "{text}"
    );
    assert_eq!(tracked(&place, &text), 3);
    let mut command = Command::new(env!("CARGO_BIN_EXE_pardalis"));
    let command = command.current_dir(place.path(""));
    let shown = Run::of(command.args(["camera", "show", "scene.toml"])).fine();
    for number in ["330.5", "331.5", "0.1", "-0.01"] {
        assert!(shown.stdout.contains(&format!(" {number}\n")), "{number}");
    }
}

#[test]
fn scenes_refer_to_calibrations_of_any_format() {
    let place = Workplace::with_frames(2);
    fs::create_dir(place.path("lens")).unwrap();
    place.write("lens/cam.yml", OPENCV_FISHEYE);
    let common = [
        "--fps",
        "25",
        "--colors",
        "ball.toml",
        "--pixel",
        "460,88",
        "--force",
    ];
    let arguments = |file| [&["images", "--camera", file], &common[..]].concat();
    init(&place, &arguments("lens/cam.yml")).refused(&["lens/cam.yml", "line 10: D", "--as"]);
    init(
        &place,
        &[&arguments("lens/cam.yml")[..], &["--as", "fisheye"]].concat(),
    )
    .fine();
    let text = scene(&place);
    for line in [
        "calibration = \"lens/cam.yml\"",
        "calibration_lens = \"fisheye\"",
    ] {
        assert!(text.lines().any(|l| l.starts_with(line)), "{line}: {text}");
    }
    assert_eq!(
        marked(&text),
        ["world_from_camera", "shape.sphere.radius_m"]
    );
    assert_eq!(tracked(&place, &text), 2);

    // With a pose there is nothing to guess.
    let lens = "[cameras.left]
model.equidistant = { f_px_per_rad = 145.5, center_px = [319.5, 239.5], field_of_view_deg = 185.0 }
world_from_camera = [[0, -1, 0, 0], [-1, 0, 0, 0], [0, 0, -1, 0.9], [0, 0, 0, 1]]
";
    place.write("lens/camera.toml", lens);
    init(&place, &arguments("lens/camera.toml")).fine();
    let text = scene(&place);
    assert!(text.contains("[cameras.left]"), "{text}");
    assert!(!text.contains("world_from_camera ="), "{text}");
    assert_eq!(tracked(&place, &text), 2);

    // Each of several cameras has a folder of its own.
    place.write(
        "rig.toml",
        format!(
            "{lens}{}",
            lens.replace("left", "right")
                .replace("-1, 0, 0]", "-1, 0, 0.1]")
        ),
    );
    init(&place, &arguments("rig.toml")).refused(&["images/left", "rig.toml has 2 cameras"]);
    for name in ["left", "right"] {
        fs::create_dir(place.path(&format!("images/{name}"))).unwrap();
        let to = place.path(&format!("images/{name}/000000.jpg"));
        fs::copy(frame_file(0), to).unwrap();
    }
    init(&place, &arguments("rig.toml")).fine();
    assert_eq!(tracked(&place, &scene(&place)), 1);
}

#[test]
fn videos_use_a_calibration_and_their_own_time_stamps() {
    if Command::new("ffmpeg").arg("-version").output().is_err() {
        eprintln!("not tested: there is no ffmpeg");
        return;
    }
    let place = Workplace::with_frames(3);
    let made = Command::new("ffmpeg")
        .current_dir(place.path(""))
        .args(["-v", "error", "-framerate", "10", "-i", "images/%06d.jpg"])
        .args(["-c:v", "mjpeg", "-q:v", "2", "ride.avi"])
        .status();
    assert!(made.unwrap().success());
    let calibration = data().join("camera.json");
    let calibration = calibration.to_str().unwrap();
    let arguments = [
        "ride.avi",
        "--camera",
        calibration,
        "--colors",
        "ball.toml",
        "--pixel",
        "460,88",
    ];
    init(&place, &arguments).fine();
    let text = scene(&place);
    assert!(text.contains("video = \"ride.avi\""), "{text}");
    assert!(!text.contains("fps ="), "{text}");
    assert_eq!(tracked(&place, &text), 3);
    let times_s: Vec<_> = place.rows().into_iter().map(|row| row[1].clone()).collect();
    assert_eq!(times_s, ["0", "0.1", "0.2"]);
    init(&place, &["ride.avi", "--fps", "25", "--force"]).refused(&["--fps", "own time stamps"]);
}

#[test]
fn times_csv_replaces_the_frame_rate() {
    let place = Workplace::with_frames(2);
    place.write("images/times.csv", "frame,time_s\n0,0.5\n1,0.75\n");
    init(
        &place,
        &["images", "--colors", "ball.toml", "--pixel", "460,88"],
    )
    .fine();
    assert_eq!(tracked(&place, &scene(&place)), 2);
    assert_eq!(place.rows()[1][1], "0.75");
    init(&place, &["images", "--fps", "25", "--force"]).refused(&["--fps", "times.csv"]);
}

#[test]
fn paths_are_valid_from_another_folder() {
    let place = Workplace::with_frames(1);
    fs::create_dir(place.path("scenes")).unwrap();
    let arguments = [
        "images",
        "-o",
        "scenes/a.toml",
        "--colors",
        "ball.toml",
        "--pixel",
        "460,88",
    ];
    init(&place, &arguments).fine();
    let text = fs::read_to_string(place.path("scenes/a.toml")).unwrap();
    place.write("scenes/a.toml", confirmed(&text));
    let mut command = Command::new(env!("CARGO_BIN_EXE_pardalis"));
    let command = command.current_dir(place.path("scenes"));
    let run = Run::of(command.args(["track", "a.toml", "-o", "-"])).fine();
    assert_eq!(run.stdout.lines().count(), 2);
}

#[test]
fn scenes_move_together_with_what_lies_beside_them() {
    let place = Workplace::with_frames(1);
    fs::create_dir_all(place.path("project/scenes")).unwrap();
    fs::rename(place.path("images"), place.path("project/images")).unwrap();
    fs::rename(place.path("ball.toml"), place.path("project/ball.toml")).unwrap();
    let arguments = [
        "project/images",
        "-o",
        "project/scenes/a.toml",
        "--colors",
        "project/scenes/../ball.toml",
        "--pixel",
        "460,88",
    ];
    init(&place, &arguments).fine();
    let text = fs::read_to_string(place.path("project/scenes/a.toml")).unwrap();
    for line in ["images = \"../images\"", "colors = \"../ball.toml\""] {
        assert!(text.contains(line), "{text}");
    }
    place.write("project/scenes/a.toml", confirmed(&text));
    fs::rename(place.path("project"), place.path("moved")).unwrap();
    let scene = "moved/scenes/a.toml";
    let run = Run::pardalis(place.path(""), &["track", scene, "-o", "-"]).fine();
    assert_eq!(run.stdout.lines().count(), 2);
    // Colours that are still to be learnt.
    let arguments = [
        "moved/images",
        "-o",
        "moved/scenes/b.toml",
        "--colors",
        "moved/scenes/../later.toml",
    ];
    init(&place, &arguments).fine();
    let text = fs::read_to_string(place.path("moved/scenes/b.toml")).unwrap();
    assert!(text.contains("colors = \"../later.toml\""), "{text}");
}

#[test]
fn existing_scenes_are_kept_without_force() {
    let place = Workplace::with_frames(1);
    place.write("scene.toml", "mine");
    init(&place, &["images"]).refused(&["scene.toml", "already exists", "--force"]);
    assert_eq!(scene(&place), "mine");
    init(&place, &["images", "--force"]).fine();
    assert_ne!(scene(&place), "mine");
}

#[test]
fn invalid_input_is_named_and_nothing_is_written() {
    let place = sequence(&[], |camera| camera["width"] = 320.into());
    let frame = frame_file(0);
    fs::copy(&frame, place.image(0)).unwrap();
    fs::create_dir(place.path("empty")).unwrap();
    place.write(
        "moving.json",
        calibration(|c| {
            c["T_world_from_camera"] = "camera_pose.csv".into();
            c.as_object_mut().unwrap().remove("T_robot_from_camera");
        }),
    );
    place.write("mirror.json", calibration(|c| c["model"] = "other".into()));
    place.write(
        "no-f.json",
        calibration(|c| c["f_px_per_rad"] = serde_json::Value::Null),
    );
    let cases: [(&[&str], &[&str]); 18] = [
        (&["nowhere"], &["nowhere", "no such file or folder"]),
        (&["empty"], &["empty", "no images"]),
        (
            &[frame.to_str().unwrap(), "--fps", "25"],
            &["--fps", "single image", "leave it out"],
        ),
        (&["ball.toml"], &["ball.toml"]),
        (
            &["ride"],
            &["camera.json", "cam1", "320 x 480", "640 x 480"],
        ),
        (
            &["images", "--camera", "fisheye"],
            &[
                "--camera fisheye",
                "equidistant",
                "equidistant (fisheye lenses)",
            ],
        ),
        (
            &["images", "--camera", "ball.toml"],
            &["ball.toml", "cameras: is missing"],
        ),
        (
            &["images", "--camera", "moving.json"],
            &[
                "moving.json",
                "T_world_from_camera",
                "T_robot_from_camera for a moving camera",
            ],
        ),
        (
            &["images", "--camera", "mirror.json"],
            &["mirror.json", "other", "pinhole"],
        ),
        (
            &["images", "--camera", "no-f.json"],
            &["no-f.json", "f_px_per_rad: is empty"],
        ),
        (
            &["images", "--pixel", "640,3"],
            &["--pixel 640,3", "640 x 480"],
        ),
        (&["images", "--pixel", "3"], &["--pixel", "X,Y"]),
        (&["images", "--fps", "0"], &["--fps", "above 0"]),
        (&["images", "--radius-m", "-1"], &["--radius-m", "above 0"]),
        (
            &["images", "--target", "my ball"],
            &["--target", "A-Z a-z 0-9"],
        ),
        (
            &["rtsp://192.168.0.64/stream1"],
            &[
                "rtsp://192.168.0.64/stream1: init needs recorded images",
                "ffmpeg -i rtsp://192.168.0.64/stream1 -t 20 -c copy clip.mkv",
            ],
        ),
        (
            &["-"],
            &["-: init needs recorded images", "ffmpeg -i pipe:0"],
        ),
        (
            &["images", "-o", "none/scene.toml"],
            &["none/scene.toml", "cannot be written"],
        ),
    ];
    for (arguments, wanted) in cases {
        init(&place, arguments).refused(wanted);
        assert!(!place.path("scene.toml").exists(), "{arguments:?}");
    }
}

/// Returns the calibration of data/dioptric-jump, modified by `edit`.
fn calibration(edit: impl Fn(&mut serde_json::Value)) -> String {
    let text = fs::read_to_string(data().join("camera.json")).unwrap();
    let mut camera = serde_json::from_str(&text).unwrap();
    edit(&mut camera);
    camera.to_string()
}
