//! `pardalis check`: all problems of a scene at once, what its cameras deliver, and whether its colours occur.

use std::fs;
use std::io::Write as _;
use std::net::TcpListener;

use crate::common::{Run, SCENE, Workplace, data, scene_with};
use crate::live::{video, with_stream};
use pardalis_images::RgbImage;

/// The camera of [`SCENE`] with a target that is detected.
const DETECTED: &str = r#"[targets.ball]
shape.sphere.radius_m = 0.11
colors = "ball.toml"
"#;

/// Colours that data/dioptric-jump lacks.
const BRIGHT_GREEN: &str = r#"format = "pardalis color model 1"
pixel_count = 100
image_count = 1
bins = [[4, 11, 3, 100]]
[palette.hsi]
hue_bins = 12
saturation_bins = 12
intensity_bins = 4
"#;

/// Runs `pardalis check scene.toml`.
fn checked(place: &Workplace, scene: &str) -> Run {
    place.write("scene.toml", scene);
    Run::pardalis(place.path(""), &["check", "scene.toml"])
}

/// Returns a scene of the camera of [`SCENE`] with other targets.
fn with_targets(targets: &str) -> String {
    let (camera, _) = SCENE.split_once("[targets.ball]").unwrap();
    [camera, targets].concat()
}

/// Checks that the lines begin in order with those wanted, each of which a line of the text begins with.
#[track_caller]
fn assert_lines(text: &str, wanted: &[&str]) {
    let mut lines = text.lines();
    for wanted in wanted {
        let found = lines.any(|line| line.starts_with(wanted));
        assert!(found, "no {wanted:?} in its place in:\n{text}");
    }
}

#[test]
fn a_sound_scene_is_described() {
    let place = Workplace::with_frames(5);
    let colors = data().join("../colors/orange-ball.hsi.colors.toml");
    place.write("ball.toml", fs::read(colors).unwrap());
    let run = checked(&place, &with_targets(DETECTED)).fine();
    assert_lines(
        &run.stdout,
        &[
            "cameras.cam1: images: 5 images, 000000.jpg to 000004.jpg",
            "  640 x 480 pixels; the scene does not say for which size the model holds (size_px); 25 frames per second; 5 frames, 0.16 s",
            "targets.ball:",
            "  in its colours: ",
            "  found in the first frames at 1.",
            "cost, measured on this computer by tracking the first 5 frames of each camera",
            "scene.toml: no problems",
        ],
    );
    let cost = run.stdout.lines().rev().nth(1).unwrap();
    assert!(
        cost.contains(" % of the 40 ms between frames; ") && cost.ends_with(" s for all frames"),
        "{cost}"
    );
    let colored = run
        .stdout
        .lines()
        .find(|line| line.starts_with("  in its colours: "));
    assert!(
        colored.unwrap().ends_with(" %) of the first frame of cam1"),
        "{colored:?}"
    );
    // It writes nothing.
    let mut names: Vec<_> = fs::read_dir(place.path(""))
        .unwrap()
        .map(|entry| entry.unwrap().file_name())
        .collect();
    names.sort();
    assert_eq!(names, ["ball.toml", "images", "scene.toml"]);
    // A target with a start is not searched for.
    let run = checked(
        &place,
        &scene_with("fps = 25", "fps = 25\nsize_px = [640, 480]"),
    )
    .fine();
    assert_lines(
        &run.stdout,
        &[
            "  640 x 480 pixels, as the scene says; 25 frames per second",
            "  is followed from its start, and not searched for",
        ],
    );
    // A rolling shutter is among the figures to compare with the camera's data sheet.
    let run = checked(
        &place,
        &scene_with("fps = 25", "fps = 25\nline_delay_s = -30.5e-6"),
    );
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    assert!(
        run.stdout
            .contains(" frames per second; rolling shutter, -30.5 us a row; 5 frames"),
        "{}",
        run.stdout
    );
}

#[test]
fn problems_of_text_and_files_are_reported_together() {
    let place = Workplace::with_frames(5);
    fs::create_dir(place.path("broken")).unwrap();
    // The header is whole, the rest is missing.
    let image = fs::read(place.image(0)).unwrap();
    place.write("broken/0.jpg", &image[..image.len() / 4]);
    let model = "model.pinhole = { f_px = [300, 300], center_px = [319.5, 239.5] }\nworld_from_camera = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 1], [0, 0, 0, 1]]";
    let unread = DETECTED.replace("ball.toml", "nowhere.toml");
    let scene = with_targets(&format!(
        "[cameras.gone]\nimages = \"gone\"\nfps = 25\n{model}\n\
         [cameras.other]\nimages = \"images/../images\"\nfps = 25\nsize_px = [320, 240]\n{model}\n\
         [cameras.torn]\nimages = \"broken\"\nfps = 0.5\n{model}\n\
         {unread}filter = {{ particles = 0 }}\n\
         [targets.robot]\nshape.cylinder = {{ radius_m = 0.1, height_m = 0.4 }}\ncolors = \"missing.toml\"\n[rest]\nhue = 3\n"
    ));
    let run = checked(&place, &scene);
    assert_eq!(run.code, Some(2), "{}", run.stderr);
    assert_lines(
        &run.stderr,
        &[
            "error: scene.toml: 8 problems in the scene:",
            "  line 8: cameras.gone.images: ",
            "  line 13: cameras.other.images: cameras cam1 and other read the same frames",
            "  line 15: cameras.other.size_px: is 320 x 240, but the images are 640 x 480",
            "  line 19: cameras.torn.images: broken/0.jpg: ",
            "  line 25: targets.ball.colors: nowhere.toml: cannot be read: there is no such file or folder; `pardalis learn` writes such files",
            "  line 26: targets.ball.filter.particles: is 0",
            "  line 29: targets.robot.colors: missing.toml: cannot be read",
            "  line 30: rest: is not a key",
        ],
    );
    // What can be examined is.
    assert_lines(
        &run.stdout,
        &["cameras.cam1: images: 5 images", "cameras.other: "],
    );
    // There is nothing to say of the targets, whose settings are missing.
    assert!(!run.stdout.contains("targets."), "{}", run.stdout);
    assert!(!run.stdout.contains("no problems"), "{}", run.stdout);
}

#[test]
fn missing_files_of_tables_with_problems_are_reported() {
    let place = Workplace::with_frames(1);
    let unsound = "colors = \"gone.toml\"\nparticles = 1";
    let scene = scene_with(
        "fps = 25",
        "fps = 25\nmask = \"gone.png\"\nfirst_frame = -1",
    )
    .replace("\"images\"", "\"gone\"")
    .replace("colors = \"ball.toml\"", unsound);
    checked(&place, &scene).refused(&[
        "5 problems in the scene:",
        "line 3: cameras.cam1.images: gone: cannot be read: there is no such file or folder\n",
        "line 5: cameras.cam1.mask: gone.png: cannot be read: there is no such file or folder\n",
        "line 6: cameras.cam1.first_frame: is -1",
        "line 11: targets.ball.colors: gone.toml: cannot be read",
        "line 12: targets.ball.particles: is not a key",
    ]);
    // Videos may also be addresses.
    for (video, has_problem) in [("gone.mp4", true), ("rtsp://127.0.0.1/gone", false)] {
        let video = format!("video = \"{video}\"\nfirst_frame = -1");
        let run = checked(&place, &scene_with("images = \"images\"\nfps = 25", &video));
        run.refused(&["line 4: cameras.cam1.first_frame: is -1"]);
        assert_eq!(
            run.stderr.contains("no such file"),
            has_problem,
            "{}",
            run.stderr
        );
    }
}

#[test]
fn after_a_syntax_error_nothing_else_is_reported() {
    let place = Workplace::with_frames(1);
    let scene = scene_with("images = \"images\"", "images = \"gone");
    let run = checked(&place, &scene);
    run.refused(&["scene.toml: a problem in the scene:\n  line 3: "]);
    checked(&place, "").refused(&["cameras: ", "targets: "]);
}

#[test]
fn colours_that_do_not_occur_and_guesses_are_warned_of() {
    let place = Workplace::with_frames(2);
    place.write("ball.toml", BRIGHT_GREEN);
    let scene = with_targets(DETECTED).replace(
        "seed = 1",
        "guessed = [\"targets.ball.shape.sphere.radius_m\"]",
    );
    let run = checked(&place, &scene);
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    assert_lines(
        &run.stderr,
        &[
            "warning: scene.toml: line 1: guessed: positions are only as right as these guesses: radius_m (line 8).",
            "warning: scene.toml: line 9: targets.ball.colors: these colours occur in no first frame",
        ],
    );
    assert_lines(
        &run.stdout,
        &[
            "  its colours do not occur in the first frame of cam1",
            "  not found in the first frames: nothing in the image has its colours (no-colors)",
            "scene.toml: no errors, 2 warnings",
        ],
    );
}

#[test]
fn videos_and_live_streams_are_opened_and_left() {
    let Some(place) = with_stream(30) else {
        return;
    };
    let run = checked(&place, &video("ride.ts")).fine();
    assert_lines(
        &run.stdout,
        &[
            "cameras.cam1: ride.ts: h264 video in yuvj420p",
            "  640 x 480 pixels; the scene does not say for which size the model holds (size_px); 25 frames per second; 1.2 s",
        ],
    );
    let server = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = format!("tcp://{}", server.local_addr().unwrap());
    let stream = fs::read(place.path("ride.ts")).unwrap();
    let served = std::thread::spawn(move || {
        let (mut connection, _) = server.accept().unwrap();
        // The program may close the connection before it has taken everything.
        let _ = connection.write_all(&stream);
    });
    let run = checked(&place, &video(&address)).fine();
    served.join().unwrap();
    let source = format!("cameras.cam1: {address}: h264 video in yuvj420p");
    let frames = "  640 x 480 pixels; the scene does not say for which size the model holds (size_px); about 25 frames per second; live";
    assert_lines(&run.stdout, &[&source, frames]);
    // Nothing comes.
    let silent = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = format!("tcp://{}", silent.local_addr().unwrap());
    let lines = format!("video = \"{address}\"\ninput.timeout_s = 1");
    let scene = scene_with("images = \"images\"\nfps = 25", &lines);
    let run = checked(&place, &scene);
    assert_eq!(run.code, Some(2), "{}", run.stderr);
    let given_up = format!("line 3: cameras.cam1.video: {address}: no frame came within 1 s");
    assert!(run.stderr.contains(&given_up), "{}", run.stderr);
}

#[test]
fn other_things_in_the_colours_of_the_target_are_not_taken_for_it() {
    let place = Workplace::with_frames(1);
    let colors = data().join("../colors/orange-ball.hsi.colors.toml");
    place.write("ball.toml", fs::read(colors).unwrap());
    let with_ball = pardalis_images::decode(&fs::read(place.image(0)).unwrap()).unwrap();
    let orange = with_ball.get_pixel(460, 88);
    // A book, without any ball.
    let book = RgbImage::from_fn(640, 480, |x, y| {
        let is_book = (250..400).contains(&x) && (200..300).contains(&y);
        if is_book { orange } else { [90, 100, 110] }
    });
    fs::remove_file(place.image(0)).unwrap();
    place.write("images/0.png", pardalis_images::encode_png(&book).unwrap());
    let run = checked(&place, &with_targets(DETECTED));
    assert_eq!(run.code, Some(0), "{}", run.stderr);
    assert_lines(
        &run.stdout,
        &[
            "targets.ball:",
            "  in its colours: 14996 pixels (4.9 %) of the first frame of cam1, but the target is not recognised there",
            "  not found in the first frames: ",
        ],
    );
    assert_lines(
        &run.stderr,
        &[
            "warning: scene.toml: line 9: targets.ball.colors: these colours occur in the first frames, but the target is not recognised there",
        ],
    );
}

#[test]
fn the_cost_is_measured_on_several_frames_of_each_camera() {
    let scene = data().join("../../experiments/edge/webcams-four.toml");
    let place = Workplace::with_frames(0);
    let run = Run::pardalis(place.path(""), &["check", scene.to_str().unwrap()]).fine();
    let mut lines = run.stdout.lines();
    let is_cost = |line: &&str| line.starts_with("cost, ");
    let cost = lines.find(is_cost).unwrap();
    assert!(
        cost.contains("by tracking the first 11 frames of each camera"),
        "{cost}"
    );
    let step = lines.next().unwrap().trim_start();
    let step_ms: f64 = step.split(' ').next().unwrap().parse().unwrap();
    assert!(step_ms > 0.0 && step.contains(" ms per step on "), "{step}");
}

#[test]
fn sizes_and_positions_in_other_units_are_asked_about() {
    let place = Workplace::with_frames(1);
    let colors = data().join("../colors/orange-ball.hsi.colors.toml");
    place.write("ball.toml", fs::read(colors).unwrap());
    let large = DETECTED.replace("0.11", "11");
    let run = checked(&place, &with_targets(&large));
    let question = "targets.ball: the radius of the ball is 11 m: is it in metres?";
    assert!(run.stderr.contains(question), "{}", run.stderr);
    // So it is by who does not check.
    let run = place.track_with(with_targets(&large), &["-o", "out"]);
    assert!(run.stderr.contains(question), "{}", run.stderr);

    let four = data().join("../../experiments/edge/webcams-four.toml");
    let right = fs::read_to_string(&four).unwrap();
    let folder = four.parent().unwrap().to_str().unwrap();
    let small = right.replace("radius_m = 0.035", "radius_m = 0.0005");
    assert_ne!(small, right);
    let small = small.replace("\"../../", &format!("\"{folder}/../../"));
    let run = checked(&place, &small);
    let question = "targets.ball: no two cameras can show it at the same time: the nearest, ";
    assert!(run.stderr.contains(question), "{}", run.stderr);
    assert!(
        run.stderr
            .contains(" up to 0.20 m from a camera: are their"),
        "{}",
        run.stderr
    );
}
