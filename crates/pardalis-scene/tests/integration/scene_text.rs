//! Scenes, experiments and colour models as text: settings, and damage, which gives an error with a plausible line, never a panic.

mod assembly;
mod detected;
mod initialized;
mod videos;

use pardalis::color::ColorModel;
use pardalis_camera::CalibratedCamera;
use pardalis_camera::formats::Lens;
use pardalis_core::Error;
use pardalis_scene::experiment::Experiment;
use pardalis_scene::{BodyConfig, Problem, Scene, TrackingConfig};

const SCENE: &str = r#"# A scene with every kind of setting.
seed = 7
[cameras.dioptric]
images = "frames" # földer
fps = 25.0
first_frame = 2
frame_limit = 100
time_offset_s = -0.5
mask = "mask.png"
mask_radius_px = 200
mask_center_px = [320, 240]
size_px = [640, 480]
model.equidistant = { f_px_per_rad = 145.56, center_px = [319.5, 239.5], field_of_view_deg = 185.0 }
world_from_camera = [[0, -1, 0, 0], [-1, 0, 0, 0], [0, 0, -1, 0.9], [0, 0, 0, 1]]
[cameras.web]
video = '/dev/video0'
input = { format = "v4l2", codec = "mjpeg", duration_s = 60 }
yuv = { matrix = "bt709", range = "full" }
world_from_camera = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
[cameras.web.model.pinhole]
f_px = [300, 301]
center_px = [159.5, 119.5]
distortion = [0.1, -0.2, 1e-3, 0, 0]
[cameras.mirror]
images = "up"
world_from_camera = [[0, -1, 0, 0], [1, 0, 0, 0], [0, 0, 1, 0.82], [0, 0, 0, 1]]
[cameras.mirror.model.exact_mirror]
f_px = [579, 579]
center_px = [319.5, 239.5]
constant_resolution = { vertex_m = 0.16, rim_m = 0.08, plane_z_m = -0.82, rim_view_m = 5, offset = 0 }
[targets.robot]
shape.prism = { sides = 8, across_flats_m = 0.5, height_m = 0.8, rotation_deg = 22.5, outline = "facing" }
colors = "robot.toml"
contour.spline = { control_points = 30, reach_px = 1.5, steps = 2, middle = false }
motion.planar_constant_velocity.acceleration_density_m2ps3 = 2
start.gaussian = { position_m = [1, 2, 0], covariance_m2 = [0.04, 0.03, 0, 0.09, 0, 0.01] }
[targets.post]
shape.cylinder = { radius_m = 0.1, height_m = 1, outline = "exact" }
colors = "post.toml"
contour.shared_pixels = { max_share = 0.4, distance_px = 3 }
start.track = { file = "theirs.csv", target = "post2", velocity_sigma_mps = 0.1, world_from_other = [[0, -1, 0, 0], [1, 0, 0, 0], [0, 0, 1, 1], [0, 0, 0, 1]] }
[targets.ball]
shape.sphere = { radius_m = 0.11, outline = "tangent" }
colors = "ball.toml"
contour = { inner_scale = 0.9, outer_scale = 1.1, points = 50, kappa = 1.5, b = 0.03 }
filter = { particles = 1_000, resampling = "residual", resample_below = 0.5 }
motion.constant_velocity.acceleration_sigma_mps2 = 3
[targets.ball.start.pixel]
camera = "web"
pixel_px = [46, 0x58]
min_range_m = 0.2
max_range_m = 5
[targets.other]
shape.sphere.radius_m = 0.2
colors = """other.toml"""
motion.planar_random_walk = { density_m2ps = 0.1, jumps = { probability = 0.1, min_m = [-1, 2], max_m = [3, 4] } }
start.gaussian = { position_m = [1, 2, 3], position_sigma_m = [0.1, 0.2, 0.3], velocity_mps = [0, 0, 1] }
"#;

const COLORS: &str = r#"format = "pardalis color model 1"
pixel_count = 30
image_count = 2
bins = [
    [0, 9, 1, 20],
    [11, 3, 3, 10],
]
[palette.hsi]
hue_bins = 12
saturation_bins = 12
intensity_bins = 4
"#;

/// Fails, because the scene names no calibration file.
fn no_calibration(file: &str, _: Option<Lens>) -> Result<Vec<CalibratedCamera>, String> {
    Err(format!("{file}: is not there"))
}

const EXPERIMENT: &str = include_str!("../reference/every-key-experiment.toml");

fn check_scene(text: &str) -> bool {
    check_problems(text, Scene::parse(text, &no_calibration).err())
}

fn check_experiment(text: &str) -> bool {
    check_problems(text, Experiment::parse(text).err())
}

/// Checks that problems are in order, with lines of the text and messages; reports whether there are none.
fn check_problems(text: &str, problems: Option<Vec<Problem>>) -> bool {
    let Some(problems) = problems else {
        return true;
    };
    assert!(!problems.is_empty());
    assert!(problems.is_sorted(), "{problems:?}");
    let last_line = text.matches('\n').count() + 1;
    for problem in &problems {
        assert!((1..=last_line).contains(&problem.line), "{problem}");
        assert!(!problem.message.is_empty());
    }
    false
}

fn check_colors(text: &str) -> bool {
    let last_line = text.matches('\n').count() + 1;
    match ColorModel::from_text(text) {
        Ok(_) => true,
        Err(Error::Parse { line, message }) => {
            assert!((1..=last_line).contains(&line), "line {line}: {message}");
            assert!(!message.is_empty());
            false
        }
        Err(other) => panic!("{other}: has no line"),
    }
}

#[test]
fn recorded_calibrations_of_rectified_images_are_read_as_such() {
    let lens_of = |keys: &str| {
        let text = format!(
            "[cameras.left]\n{keys}\n[targets.ball]\nshape.sphere.radius_m = 0.1\ncolors = \"ball.toml\"\n"
        );
        let asked = std::cell::Cell::new(None);
        let read = |file: &str, lens| {
            asked.set(Some(lens));
            no_calibration(file, lens)
        };
        assert!(Scene::parse(&text, &read).is_err());
        asked.get().expect("the calibration was asked for")
    };
    let recorded = |topic: &str| {
        lens_of(&format!(
            "mcap = \"ride.mcap\"\ntopic = \"{topic}\"\ncalibration = \"ride.MCAP\""
        ))
    };
    for topic in [
        "/left/image_rect",
        "/left/image_rect_color",
        "/left/image_rect/compressed",
        "image_rect_raw",
    ] {
        assert_eq!(recorded(topic), Some(Lens::Rectified), "{topic}");
    }
    for topic in [
        "/left/image_raw",
        "/image_rect/image",
        "/left/image_rectangle",
    ] {
        assert_eq!(recorded(topic), None, "{topic}");
    }
    // A lens that is stated counts, and a file may be of either images.
    let rectified = "mcap = \"ride.mcap\"\ntopic = \"/left/image_rect\"\ncalibration = ";
    let stated = format!("{rectified}\"ride.mcap\"\ncalibration_lens = \"pinhole\"");
    assert_eq!(lens_of(&stated), Some(Lens::Pinhole));
    assert_eq!(lens_of(&format!("{rectified}\"left.yaml\"")), None);
    let stated = format!("{rectified}\"left.yaml\"\ncalibration_lens = \"rectified\"");
    assert_eq!(lens_of(&stated), Some(Lens::Rectified));
}

#[test]
fn texts_truncated_at_any_byte_are_read_or_rejected() {
    assert!(check_scene(SCENE) && check_colors(COLORS) && check_experiment(EXPERIMENT));
    let cut = |text: &'static str| (0..text.len()).filter_map(move |end| text.get(..end));
    // The rest is a valid scene only if a target has shape and colours and no setting is truncated: all others have
    // defaults.
    let sound: Vec<_> = cut(SCENE).filter(|text| check_scene(text)).collect();
    let begun = SCENE.find("\ncontour.spline").unwrap_or_default();
    assert!(sound.len() < 60, "{}", sound.len());
    assert!(sound.iter().all(|text| text.len() >= begun));
    let sound = cut(COLORS).filter(|text| check_colors(text)).count();
    assert!(sound <= 2, "{sound}");
    // Sweeps and figures are not required, nor most of their keys.
    let sound = cut(EXPERIMENT)
        .filter(|text| check_experiment(text))
        .count();
    assert!((1..150).contains(&sound), "{sound}");
}

/// Replaces one to four random bytes of the text, and converts the result to valid UTF-8.
fn flipped(text: &str, seed: u64) -> String {
    // The generator of Numerical Recipes; any other would do.
    let mut state = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15);
    let mut next = |below: usize| {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (state >> 33) as usize % below
    };
    let mut bytes = text.as_bytes().to_vec();
    for _ in 0..=next(4) {
        let at = next(bytes.len());
        bytes[at] = match next(3) {
            0 => bytes[at] ^ (1 << next(8)),
            1 => next(256) as u8,
            _ => b"[]{}=.\"'#\n,-+_e0"[next(16)],
        };
    }
    String::from_utf8_lossy(&bytes).into_owned()
}

/// Reads `count` texts of each kind with random bytes.
fn check_texts_with_random_bytes(count: u64) {
    let mut sound = [0_u64; 3];
    for seed in 0..count {
        sound[0] += u64::from(check_scene(&flipped(SCENE, seed)));
        sound[1] += u64::from(check_colors(&flipped(COLORS, seed)));
        sound[2] += u64::from(check_experiment(&flipped(EXPERIMENT, seed)));
    }
    // Some replacements are harmless (in comments, digits, names), most are not.
    assert!(
        sound.iter().all(|&n| (1..count * 3 / 4).contains(&n)),
        "{sound:?}"
    );
}

#[test]
fn texts_with_random_bytes_are_read_or_rejected() {
    check_texts_with_random_bytes(300);
}

#[test]
#[ignore = "exhaustive: the gate runs it with --ignored"]
fn many_texts_with_random_bytes_are_read_or_rejected() {
    check_texts_with_random_bytes(2000);
}

#[test]
fn a_duplicate_key_hides_no_other_problem() {
    let text = SCENE
        .replace("fps = 25.0", "fps = 25.0\nfps = 30.0")
        .replace("radius_m = 0.11", "radius_m = -1")
        .replace("[cameras.web]", "[cameras.web]\nwide = 1");
    let problems = Scene::parse(&text, &no_calibration).unwrap_err();
    let lines: Vec<_> = problems.iter().map(|p| p.line).collect();
    assert_eq!(lines, [6, 17, 45], "{problems:?}");
}

/// Parses a scene; returns its problems as text.
fn parsed(text: &str) -> Result<Scene, Vec<String>> {
    Scene::parse(text, &no_calibration)
        .map_err(|problems| problems.iter().map(ToString::to_string).collect())
}

/// Checks that settings are rejected with a problem that contains the key and the word.
fn assert_rejected(read: fn(&str) -> Result<Scene, Vec<String>>, cases: &[(&str, &str, &str)]) {
    for (settings, key, word) in cases {
        let problems = read(settings).unwrap_err();
        let found = problems.iter().any(|p| p.contains(key) && p.contains(word));
        assert!(found, "{settings}: {problems:?}");
    }
}

fn target_of<'a>(scene: &'a Scene, name: &str) -> &'a BodyConfig {
    let mut targets = scene.targets.iter();
    &targets.find(|target| target.name == name).unwrap().bodies[0]
}

#[test]
fn replaced_values_override_the_text_and_are_checked_alike() {
    let replaced: toml::Table = r#"
        "targets.ball.filter.particles" = 77
        "targets.ball.motion" = { constant_velocity = { acceleration_density_m2ps3 = 5 } }
        "targets.ball.start" = { gaussian = { position_m = [1, 2, 3], position_sigma_m = 0.1 } }
        "targets.other.contour.points" = 30
    "#
    .parse()
    .unwrap();
    let scene = Scene::parse_with(SCENE, &replaced, &no_calibration).unwrap();
    let plain = Scene::parse(SCENE, &no_calibration).unwrap();
    let [ball, plain_ball] = [&scene, &plain].map(|scene| target_of(scene, "ball"));
    assert_eq!(ball.particle_count(), 77);
    let resampling = |body: &BodyConfig| match &body.tracking {
        TrackingConfig::Initialized { filter, .. } => filter.resampling,
        TrackingConfig::Detected { .. } | TrackingConfig::Boxed { .. } => panic!("{body:?}"),
    };
    assert_eq!(resampling(ball), resampling(plain_ball));
    assert_ne!(ball.start(), plain_ball.start());
    assert_eq!(target_of(&scene, "other").contour().unwrap().points, 30);
    assert_eq!(scene.cameras, plain.cameras);

    let wrong: toml::Table = r#"
        "targets.ball.filter.particles" = 0
        "targets.ball.filter.partikles" = 5
        "targets.ball.shape" = { sphere = { radius_m = "big" } }
        "seed.x" = 1
    "#
    .parse()
    .unwrap();
    // Replaced values do not shift the line numbers of the text.
    let text = SCENE.replace("fps = 25.0", "fps = 0");
    let problems = Scene::parse_with(&text, &wrong, &no_calibration).unwrap_err();
    let messages: Vec<String> = problems.iter().map(ToString::to_string).collect();
    for wanted in [
        "as set: seed: is a table; allowed: a whole number",
        "as set: targets.ball.filter.particles: is 0; allowed:",
        "as set: targets.ball.filter.partikles: is not a key; did you mean particles?",
        "as set: targets.ball.shape.sphere.radius_m: is the text \"big\"; allowed: a finite number, or \"unknown\"",
        "line 5: cameras.dioptric.fps: is 0",
    ] {
        assert!(
            messages.iter().any(|t| t.starts_with(wanted)),
            "no {wanted:?} in {messages:#?}"
        );
    }
    assert_eq!(messages.len(), 5, "{messages:#?}");
}

#[test]
fn guesses_are_warned_of_until_they_are_replaced() {
    let guessed = |keys: &str| SCENE.replacen("seed = 7", &format!("guessed = [{keys}]"), 1);
    let two = guessed(
        "\"cameras.web.model.pinhole.f_px\", \"cameras.mirror.model.exact_mirror.center_px\"",
    );
    let scene = Scene::parse(&two, &no_calibration).unwrap();
    let warnings: Vec<String> = scene.warnings.iter().map(ToString::to_string).collect();
    let expected = "line 2: guessed: positions are only as right as these guesses: f_px (line 21), center_px (line 29). ";
    assert!(
        warnings.len() == 1 && warnings[0].starts_with(expected),
        "{warnings:?}"
    );
    // A replaced value is no guess.
    let replaced: toml::Table = "\"cameras.web.model.pinhole.f_px\" = [310, 310]"
        .parse()
        .unwrap();
    let scene = Scene::parse_with(&two, &replaced, &no_calibration).unwrap();
    let warning = scene.warnings[0].to_string();
    assert!(
        !warning.contains("f_px") && warning.contains("center_px"),
        "{warning}"
    );
    for none in [SCENE, &guessed("")] {
        assert_eq!(Scene::parse(none, &no_calibration).unwrap().warnings, []);
    }
    for (keys, expected) in [
        (
            "\"cameras.web.model.pinhole.f\"",
            "line 2: guessed: names cameras.web.model.pinhole.f, which",
        ),
        ("\"\"", "line 2: guessed: names , which is not given"),
        ("\"seed.x\"", "line 2: guessed: names seed.x, which"),
        ("3", "line 2: guessed: is [3]; allowed: a list of texts"),
    ] {
        let problems = Scene::parse(&guessed(keys), &no_calibration).unwrap_err();
        let messages: Vec<String> = problems.iter().map(ToString::to_string).collect();
        assert!(
            messages.len() == 1 && messages[0].starts_with(expected),
            "{messages:?}"
        );
    }
}

#[test]
fn the_sound_parts_of_a_scene_come_with_its_problems() {
    let (scene, problems) = Scene::parse_parts(SCENE, &no_calibration);
    assert_eq!(problems, []);
    assert_eq!(scene, Scene::parse(SCENE, &no_calibration).unwrap());
    let wrong = SCENE.replace("fps = 25.0", "fps = -25.0");
    let (rest, problems) = Scene::parse_parts(&wrong, &no_calibration);
    assert_eq!(problems, Scene::parse(&wrong, &no_calibration).unwrap_err());
    assert_eq!(rest.cameras, scene.cameras[1..]);
    assert_eq!(rest.targets, scene.targets);
    // Cameras of which only the pose is missing can be shown, but that it is missing is a problem.
    let pose = "world_from_camera = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]\n";
    let poseless = SCENE.replace(pose, "");
    let (rest, problems) = Scene::parse_parts(&poseless, &no_calibration);
    assert_eq!(rest.cameras.len(), scene.cameras.len() - 1);
    let (shown, same) = Scene::parse_parts_without_poses(&poseless, &no_calibration);
    assert_eq!(same, problems);
    assert!(
        problems[0].message.starts_with("is missing"),
        "{problems:?}"
    );
    let with_poses = |scene: &Scene| -> Vec<bool> {
        scene.cameras.iter().map(|camera| camera.has_pose).collect()
    };
    assert_eq!(with_poses(&scene), [true, true, true]);
    assert_eq!(with_poses(&shown), [true, false, true]);
    // The rest may follow from it.
    let unclosed = SCENE.replace("seed = 7", "seed = [7");
    let (rest, problems) = Scene::parse_parts(&unclosed, &no_calibration);
    assert_eq!(problems.len(), 1, "{problems:?}");
    assert!(rest.cameras.is_empty() && rest.targets.is_empty());
}
