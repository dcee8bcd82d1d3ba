//! Damaged scenes and colour models: an error with a plausible line, never a panic.

use pardalis::color::{ColorModel, ColorRanges};
use pardalis::likelihood::{Cue, CueSettings, EdgeSettings, Sampling, WindowSettings};
use pardalis::tracker::{BodySettings, DetectedSettings, ExistenceSettings};
use pardalis_camera::CalibratedCamera;
use pardalis_camera::formats::Lens;
use pardalis_core::Error;
use pardalis_filter::motion::{
    AccelerationNoise, ConstantAcceleration, ConstantVelocity, JumpChance, Jumps, Motion,
    RandomWalk, VelocityNoise,
};
use pardalis_scene::{
    BodyConfig, Input, Protocol, Scene, StartConfig, TrackingConfig, VideoFormat, VideoInput,
    VideoPlace,
};

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

/// Parses a scene and checks that errors are in order, with lines of the text and messages; reports whether it is
/// valid.
fn check_scene(text: &str) -> bool {
    let Err(problems) = Scene::parse(text, &no_calibration) else {
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
fn texts_truncated_at_any_byte_are_read_or_rejected() {
    assert!(check_scene(SCENE) && check_colors(COLORS));
    let cut = |text: &'static str| (0..text.len()).filter_map(move |end| text.get(..end));
    // The rest is a valid scene only if a target has shape and colours and no setting is truncated: all others have
    // defaults.
    let sound: Vec<_> = cut(SCENE).filter(|text| check_scene(text)).collect();
    let begun = SCENE.find("\ncontour.spline").unwrap_or_default();
    assert!(sound.len() < 60, "{}", sound.len());
    assert!(sound.iter().all(|text| text.len() >= begun));
    let sound = cut(COLORS).filter(|text| check_colors(text)).count();
    assert!(sound <= 2, "{sound}");
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

#[test]
fn texts_with_random_bytes_are_read_or_rejected() {
    let mut sound = [0; 2];
    for seed in 0..2000 {
        sound[0] += usize::from(check_scene(&flipped(SCENE, seed)));
        sound[1] += usize::from(check_colors(&flipped(COLORS, seed)));
    }
    // Some replacements are harmless (in comments, digits, names), most are not.
    assert!(sound.iter().all(|n| (1..1500).contains(n)), "{sound:?}");
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

/// Parses a scene with one target that has these settings.
fn target(settings: &str) -> Result<Scene, Vec<String>> {
    let text = format!(
        "[cameras.a]\nimages = \"a\"\nfps = 25\nworld_from_camera = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]\n\
         model.equidistant = {{ f_px_per_rad = 145.56, center_px = [319.5, 239.5], field_of_view_deg = 185.0 }}\n\
         [targets.t]\ncolors = \"c\"\nstart.gaussian.position_m = [1, 2, 0]\n{settings}\n"
    );
    parsed(&text)
}

/// Parses a scene; returns its problems as text.
fn parsed(text: &str) -> Result<Scene, Vec<String>> {
    Scene::parse(text, &no_calibration)
        .map_err(|problems| problems.iter().map(ToString::to_string).collect())
}

#[test]
fn upright_shapes_have_their_own_defaults_that_a_scene_may_override() {
    let cylinder = "shape.cylinder = { radius_m = 0.25, height_m = 0.8 }";
    let robot = &target(cylinder).unwrap().targets[0].bodies[0];
    assert_eq!(robot.contour().unwrap().points, 120);
    let Sampling::Scaled(scaled) = robot.contour().unwrap().sampling else {
        panic!("{:?}", robot.contour().unwrap())
    };
    assert_eq!((scaled.inner_scale, scaled.outer_scale), (0.75, 1.25));
    assert_eq!(scaled.shared_pixels, None);
    assert!(robot.motion().is_planar(), "robots stay on the ground");
    let flying = format!("{cylinder}\nmotion.constant_velocity.acceleration_density_m2ps3 = 2");
    assert!(
        !target(&flying).unwrap().targets[0].bodies[0]
            .motion()
            .is_planar()
    );
    let ball = &target("shape.sphere.radius_m = 0.11\ncontour.spline = {}")
        .unwrap()
        .targets[0]
        .bodies[0];
    assert!(!ball.motion().is_planar());
    let Sampling::Spline(spline) = ball.contour().unwrap().sampling else {
        panic!("{:?}", ball.contour().unwrap())
    };
    assert_eq!(
        (spline.control_points, spline.steps, spline.middle),
        (12, 2, false)
    );
    assert_eq!(ball.contour().unwrap().sampling.samples(50), 100);
}

#[test]
fn cues_are_those_with_a_table_and_use_the_cameras_they_name() {
    let ball = "shape.sphere.radius_m = 0.11\n";
    let cues = |settings: &str| {
        target(&format!("{ball}{settings}")).unwrap().targets[0].bodies[0]
            .cues()
            .to_vec()
    };
    assert!(matches!(
        cues("")[..],
        [CueSettings {
            cue: Cue::Contour(_),
            cameras: None,
            ..
        }]
    ));
    let window = &cues("window = {}")[..];
    assert_eq!(window, [Cue::Window(WindowSettings::default()).into()]);
    let both = "contour.points = 40\nwindow = { size_px = 7, cameras = [\"a\"] }";
    let [contour, window] = &cues(both)[..] else {
        panic!("{both}")
    };
    assert!(matches!(contour.cue, Cue::Contour(contour) if contour.points == 40));
    assert_eq!(contour.cameras, None);
    assert_eq!(window.cue, Cue::Window(WindowSettings::of_size(7)));
    assert_eq!(window.cameras, Some(vec![0]));
    let ranges = &cues("window = { hue_deg = [330, 15], saturation = [0.3, 1], floor = 0.1 }")[0];
    let Cue::Window(settings) = ranges.cue else {
        panic!("{ranges:?}")
    };
    assert_eq!((settings.floor, settings.outside), (0.1, 0.04));
    assert_eq!(settings.ranges.unwrap().hue_deg, [330.0, 15.0]);
    assert_eq!(settings.ranges.unwrap().intensity, ColorRanges::INTENSITY);
}

#[test]
fn invalid_windows_are_rejected_by_key() {
    assert_rejected(
        ball,
        &[
            ("window.size_px = 4", "targets.t.window", "odd"),
            ("window.floor = 0", "targets.t.window", "above 0"),
            (
                "window.hue_deg = [10, 20]",
                "targets.t.window.saturation",
                "together",
            ),
            (
                "window = { hue_deg = [10, 400], saturation = [0, 1] }",
                "targets.t.window",
                "360",
            ),
            (
                "window.intensity = [0.1, 0.5]",
                "targets.t.window.intensity",
                "hue_deg",
            ),
            (
                "window.cameras = [\"b\"]",
                "targets.t.window.cameras",
                "allowed: a",
            ),
            ("window.cameras = []", "targets.t.window.cameras", "empty"),
            ("window.cameras = 3", "targets.t.window.cameras", "list"),
            ("window.hue = [1, 2]", "targets.t.window.hue", "size_px"),
        ],
    );
    // Only a window cue with its own colours needs no file.
    let bare = |settings: &str| {
        let text = "[cameras.a]\nimages = \"a\"\nfps = 25\nworld_from_camera = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]\n\
             model.pinhole = { f_px = [300, 300], center_px = [160, 120] }\n\
             [targets.t]\nshape.sphere.radius_m = 0.1\nstart.gaussian.position_m = [1, 2, 0]\n";
        Scene::parse(&format!("{text}{settings}"), &no_calibration)
    };
    let known = "window = { hue_deg = [330, 15], saturation = [0.3, 1] }";
    assert!(bare(known).unwrap().targets[0].bodies[0].colors.is_none());
    for unknown in ["", "window = {}"] {
        let problems = bare(unknown).unwrap_err();
        assert!(
            problems[0]
                .to_string()
                .contains("targets.t.colors: is missing"),
            "{problems:?}"
        );
    }
}

#[test]
fn invalid_motions_are_rejected_by_key() {
    assert_rejected(
        ball,
        &[
            (
                "motion.random_walk = { sigma_m = 1, density_m2ps = 2 }",
                "random_walk.density_m2ps",
                "remove one",
            ),
            (
                "motion.random_walk.sigma_m = -1",
                "random_walk.sigma_m",
                "0 to 1e9",
            ),
            (
                "motion.constant_velocity = { acceleration_sigma_mps2 = 1, velocity_sigma_mps = 2 }",
                "constant_velocity.velocity_sigma_mps",
                "remove one",
            ),
            (
                "motion.constant_velocity.velocity_sigma_mps = -1",
                "constant_velocity.velocity_sigma_mps",
                "0 to 1e9",
            ),
            (
                "motion.constant_acceleration = {}",
                "motion.constant_acceleration",
                "give acceleration_step_sigma_mps2 or jerk_density_m2ps5",
            ),
            (
                "motion.planar_constant_acceleration.jerk_density_m2ps5 = -1",
                "planar_constant_acceleration.jerk_density_m2ps5",
                "0 to 1e9",
            ),
            (
                "motion.random_walk.jumps = { min_m = [0, 0, 0], max_m = [1, 1, 1] }",
                "random_walk.jumps",
                "give probability or rate_hz",
            ),
            (
                "motion.random_walk.jumps = { probability = 2, min_m = [0, 0, 0], max_m = [1, 1, 1] }",
                "jumps.probability",
                "0 to 1",
            ),
            (
                "motion.random_walk.jumps = { probability = 0.1, min_m = [0, 0], max_m = [1, 1, 1] }",
                "jumps.min_m",
                "three",
            ),
            (
                "motion.planar_random_walk.jumps = { probability = 0.1, min_m = [0, 0], max_m = [1, 1, 1] }",
                "jumps.max_m",
                "two",
            ),
            (
                "motion.planar_random_walk.jumps = { rate_hz = 1, min_m = [0, 0], max_m = [1, -1] }",
                "jumps.max_m",
                "below that of min_m",
            ),
            (
                "motion.random_walk.jumps = { rate_hz = 1, probability = 0.1, area = 3 }",
                "jumps.area",
                "max_m, min_m, probability, rate_hz",
            ),
        ],
    );
}

/// Parses a scene with a ball that has these settings.
fn ball(settings: &str) -> Result<Scene, Vec<String>> {
    target(&format!("shape.sphere.radius_m = 0.11\n{settings}"))
}

/// Checks that settings are rejected with a problem that contains the key and the word.
fn assert_rejected(read: fn(&str) -> Result<Scene, Vec<String>>, cases: &[(&str, &str, &str)]) {
    for (settings, key, word) in cases {
        let problems = read(settings).unwrap_err();
        let found = problems.iter().any(|p| p.contains(key) && p.contains(word));
        assert!(found, "{settings}: {problems:?}");
    }
}

#[test]
fn invalid_shapes_and_contours_are_rejected_by_key() {
    let cylinder = "shape.cylinder = { radius_m = 0.25, height_m = 0.8 }";
    assert_rejected(
        target,
        &[
            ("shape.cylinder.radius_m = 0.25", "height_m", "missing"),
            (
                "shape.prism = { sides = 2, across_flats_m = 0.5, height_m = 1 }",
                "sides",
                "3 to 100",
            ),
            (
                "shape.prism = { sides = 8, across_flats_m = -1, height_m = 1 }",
                "across_flats_m",
                "above 0",
            ),
            (
                "shape.cylinder = { radius_m = 1, height_m = 1, outline = \"round\" }",
                "outline",
                "exact",
            ),
            (
                &format!("{cylinder}\nshape.sphere.radius_m = 1"),
                "shape",
                "sphere",
            ),
            (
                &format!("{cylinder}\ncontour = {{ spline = {{}}, inner_scale = 0.9 }}"),
                "inner_scale",
                "spline",
            ),
            (
                &format!("{cylinder}\ncontour.spline.control_points = 61"),
                "control_points",
                "3 to half of points, 60",
            ),
            (
                &format!("{cylinder}\ncontour.spline.reach_px = 0"),
                "reach_px",
                "above 0",
            ),
            (
                &format!("{cylinder}\ncontour.spline.middle = 1"),
                "middle",
                "true or false",
            ),
            (
                &format!("{cylinder}\ncontour.shared_pixels.max_share = 1"),
                "max_share",
                "below 1",
            ),
            (
                &format!("{cylinder}\ncontour.shared_pixels.reach_px = 1"),
                "reach_px",
                "distance_px",
            ),
            (
                &format!(
                    "{cylinder}\nmotion.planar_constant_velocity.acceleration_sigma_mps2 = -1"
                ),
                "acceleration_sigma_mps2",
                "0 to",
            ),
        ],
    );
}

#[test]
fn motions_are_read_with_their_settings() {
    let read = |settings: &str| {
        let text = format!("shape.sphere.radius_m = 0.1\nmotion.{settings}");
        target(&text).unwrap().targets[0].bodies[0]
            .motion()
            .to_owned()
    };
    let velocity = VelocityNoise::PerStep {
        velocity_sigma_mps: 0.3,
    };
    assert_eq!(
        read("constant_velocity.velocity_sigma_mps = 0.3"),
        ConstantVelocity::new(velocity).unwrap().into()
    );
    let published = AccelerationNoise::PerStep {
        acceleration_step_sigma_mps2: 2.0,
    };
    assert_eq!(
        read("constant_acceleration.acceleration_step_sigma_mps2 = 2"),
        ConstantAcceleration::new(published).unwrap().into()
    );
    let white = AccelerationNoise::White {
        jerk_density_m2ps5: 5.0,
    };
    assert_eq!(
        read("planar_constant_acceleration.jerk_density_m2ps5 = 5"),
        Motion::from(ConstantAcceleration::new(white).unwrap()).in_plane()
    );
    let [share, rate] = [
        JumpChance::PerStep { share: 0.1 },
        JumpChance::Rate { rate_hz: 2.0 },
    ];
    let jumps = Jumps::new(share, [-1.0, 2.0, 0.0], [3.0, 4.0, 1.0]).unwrap();
    assert_eq!(
        read("random_walk.jumps = { probability = 0.1, min_m = [-1, 2, 0], max_m = [3, 4, 1] }"),
        RandomWalk::PUBLISHED.with_jumps(jumps).into()
    );
    let jumps = Jumps::new(rate, [-1.0, 2.0, 0.0], [3.0, 4.0, 0.0]).unwrap();
    assert_eq!(
        read("planar_random_walk.jumps = { rate_hz = 2, min_m = [-1, 2], max_m = [3, 4] }"),
        Motion::from(RandomWalk::PUBLISHED.with_jumps(jumps)).in_plane()
    );
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
        TrackingConfig::Detected { .. } => panic!("{body:?}"),
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
    let told: Vec<String> = problems.iter().map(ToString::to_string).collect();
    for wanted in [
        "as set: seed: is a table; allowed: a whole number",
        "as set: targets.ball.filter.particles: is 0; allowed:",
        "as set: targets.ball.filter.partikles: is not a key; did you mean particles?",
        "as set: targets.ball.shape.sphere.radius_m: is the text \"big\"; allowed: a finite number",
        "line 5: cameras.dioptric.fps: is 0",
    ] {
        assert!(
            told.iter().any(|t| t.starts_with(wanted)),
            "no {wanted:?} in {told:#?}"
        );
    }
    assert_eq!(told.len(), 5, "{told:#?}");
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
        let told: Vec<String> = problems.iter().map(ToString::to_string).collect();
        assert!(told.len() == 1 && told[0].starts_with(expected), "{told:?}");
    }
}

/// Parses a scene with a ball that has these settings, and no start unless they include one.
fn without_start(settings: &str) -> Result<Scene, Vec<String>> {
    let (cameras, _) = SCENE.split_once("[targets.robot]").unwrap();
    let text = format!(
        "{cameras}[targets.ball]\nshape.sphere.radius_m = 0.1\ncolors = \"ball.toml\"\n{settings}\n"
    );
    parsed(&text)
}

/// Returns the settings of a scene's ball, which must be a detected target.
fn detected(settings: &str) -> DetectedSettings {
    let scene = without_start(settings).unwrap();
    let body = &scene.targets[0].bodies[0];
    let start = body.start().map(|start| match start.value {
        StartConfig::Here(start) => start,
        StartConfig::Track(_) => panic!("no track is given"),
    });
    let colors = include_str!("../../../../data/colors/pink-ball.hsi.colors.toml");
    let colors = ColorModel::from_text(colors).unwrap();
    match body.settings(Some(colors), start).unwrap() {
        BodySettings::Detected(settings) => settings,
        BodySettings::Initialized(settings) => panic!("{settings:?}"),
    }
}

#[test]
fn targets_without_start_are_detected_with_the_defaults_of_the_library() {
    let found = detected("");
    assert_eq!(found.edge, EdgeSettings::default());
    assert_eq!(found.start, None);
    assert_eq!(found.existence, ExistenceSettings::default());
    assert_eq!(found.particle_count, 500);
    let default = DetectedSettings::new(found.shape, found.colors.clone());
    assert_eq!(found.motion, default.motion);
    assert_eq!(found.particle_count, default.particle_count);

    let found = detected(
        "edge = { correspondence_lines = 100, likelihood_exponent = 0.3, shared_sigma_px = 0.1, learned_profile = false, lit_and_shaded_profiles = false, color_evidence = false, illumination_adaptation = false }\nexistence = { birth_rate_hz = 2, occlusion_rate_hz = 0.25 }\n\
         start.gaussian.position_m = [1, 2, 3]",
    );
    let mut edge = EdgeSettings::default();
    edge.correspondence_lines = 100;
    edge.likelihood_exponent = 0.3;
    edge.shared_sigma_px = 0.1;
    edge.learned_profile = false;
    edge.lit_and_shaded_profiles = false;
    edge.background_model = true;
    edge.color_evidence = false;
    edge.illumination_adaptation = false;
    assert_eq!(found.edge, edge);
    assert_eq!(found.start.unwrap().position_m, [1.0, 2.0, 3.0]);
    assert_eq!(found.existence.birth_rate_hz, 2.0);
    assert_eq!(found.existence.occlusion.occlusion_hz, 0.25);

    let scene = without_start("start.gaussian.position_m = [1, 2, 3]").unwrap();
    let cues = scene.targets[0].bodies[0].cues();
    assert!(
        matches!(cues[0].cue, Cue::Contour(_)),
        "a start without a cue is published"
    );
}

#[test]
fn incomplete_settings_are_rejected() {
    let body = |settings: &str| without_start(settings).unwrap().targets[0].bodies[0].clone();
    let error = body("").settings(None, None).unwrap_err();
    assert!(error.to_string().contains("colour model"), "{error}");
    let published = body("start.gaussian.position_m = [1, 2, 3]");
    let error = published.settings(None, None).unwrap_err();
    assert!(error.to_string().contains("start"), "{error}");
}

#[test]
fn contradictory_settings_of_detected_targets_are_rejected_by_key() {
    assert_rejected(
        without_start,
        &[
            ("edge = {}\ncontour = {}", "targets.ball.edge", "combined"),
            (
                "edge = {}\nstart.pixel.pixel_px = [3, 4]\nstart.pixel.camera = \"web\"",
                "targets.ball.start",
                "pixel",
            ),
            (
                "motion.constant_velocity.acceleration_sigma_mps2 = 3",
                "targets.ball.motion",
                "white",
            ),
            (
                "motion.constant_acceleration.jerk_density_m2ps5 = 3",
                "targets.ball.motion",
                "white",
            ),
            (
                "existence.death_rate_hz = -1",
                "targets.ball.existence.death_rate_hz",
                "0 to 1000",
            ),
            (
                "existence.reappearance_rate_hz = 0",
                "targets.ball.existence.reappearance_rate_hz",
                "above 0",
            ),
            (
                "existence.region.z_m = [3, 0]",
                "targets.ball.existence.region.z_m",
                "a greater one",
            ),
            (
                "edge.correspondence_lines = 3",
                "targets.ball.edge.correspondence_lines",
                "16 to 1000",
            ),
            (
                "edge.likelihood_exponent = nan",
                "targets.ball.edge.likelihood_exponent",
                "finite",
            ),
            (
                "edge.shared_sigma_px = 11",
                "targets.ball.edge.shared_sigma_px",
                "0 to 10",
            ),
            (
                "contour = {}\nexistence = {}\nstart.gaussian.position_m = [1, 2, 3]",
                "targets.ball.existence",
                "edge",
            ),
            ("contour = {}", "targets.ball.start", "start.gaussian"),
            (
                "window = {}\nedge = {}",
                "targets.ball.edge",
                "cannot be combined with other cues",
            ),
        ],
    );
}

/// Reads a scene whose camera has these lines instead of its images.
fn video(lines: &str) -> Result<Scene, Vec<String>> {
    let images = "images = \"up\"\n";
    assert!(SCENE.contains(images));
    parsed(&SCENE.replace(images, &format!("{lines}\n")))
}

/// Returns the video of that camera.
fn video_of(lines: &str) -> VideoInput {
    let scene = video(lines).unwrap_or_else(|problems| panic!("{lines}: {problems:#?}"));
    let camera = scene
        .cameras
        .into_iter()
        .find(|camera| camera.name == "mirror");
    match camera.map(|camera| camera.input) {
        Some(Input::Video { video, .. }) => video,
        other => panic!("{lines}: {other:?}"),
    }
}

#[test]
fn videos_are_files_devices_or_addresses() {
    let file = |name: &str| VideoPlace::File(name.to_owned());
    for name in [
        "a.mp4",
        "concat:a|b",
        "subfile,,start,0,end,0,,:a.mp4",
        "file:a.mp4",
        "-y",
    ] {
        assert_eq!(video_of(&format!("video = '{name}'")).place, file(name));
    }
    assert_eq!(video_of("video = '-'").place, VideoPlace::StandardInput);
    let device = video_of("video = '/dev/video2'\nfps = 30\nsize_px = [640, 480]");
    assert_eq!(device.place, VideoPlace::Device("/dev/video2".to_owned()));
    let settings = device.settings;
    assert_eq!(settings.format, Some(VideoFormat::V4l2));
    assert_eq!(
        (settings.fps, settings.size_px),
        (Some(30.0), Some([640, 480]))
    );
    let named = video_of("video = 'video=Integrated Camera'\ninput.format = 'dshow'");
    assert!(matches!(named.place, VideoPlace::Device(_)), "{named:?}");
    let address = video_of("video = 'rtsp://a/b'\ninput.rtsp_transport = 'tcp'");
    let wanted = VideoPlace::Address(Protocol::Rtsp, "rtsp://a/b".to_owned());
    assert_eq!(address.place, wanted);
}

#[test]
fn scenes_cannot_give_options_generators_or_other_protocols() {
    let key = "cameras.mirror.video";
    let at = |name: &str| format!("cameras.mirror.input.{name}");
    let (format, pixel_format) = (at("format"), at("pixel_format"));
    assert_rejected(
        video,
        &[
            (
                "video = 'a'\ninput_options = ['-f', 'lavfi']",
                "cameras.mirror.input_options",
                "is not a key",
            ),
            (
                "video = 'a'\ninput.dump_separator = 'x'",
                &at("dump_separator"),
                "is not a key",
            ),
            (
                "video = 'color=red'\ninput.format = 'lavfi'",
                &format,
                "allowed: \"v4l2\"",
            ),
            (
                "video = 'a'\ninput.format = 'concat'",
                &format,
                "is the text \"concat\"",
            ),
            (
                "video = 'a'\ninput.format = 'hls'",
                &format,
                "is the text \"hls\"",
            ),
            (
                "video = 'async:http://a'",
                key,
                "the protocol async:http; allowed: rtsp, rtp",
            ),
            (
                "video = 'http,method,POST,://a'",
                key,
                "protocol http,method,POST,",
            ),
            ("video = 'HTTP://a'", key, "protocol HTTP"),
            ("video = 'file:///etc/passwd'", key, "or the path of a file"),
            ("video = \"http://a\\r\\nX: y\"", key, "control character"),
            (
                "video = '/dev/video0'\ninput.pixel_format = 'a -y b'",
                &pixel_format,
                "letters, digits and underscores",
            ),
        ],
    );
}

#[test]
fn settings_of_videos_are_rejected_where_they_do_not_apply() {
    let input = "cameras.mirror.input";
    let at = |name: &str| format!("{input}.{name}");
    let (pixel_format, codec) = (at("pixel_format"), at("codec"));
    let (start_s, real_time, transport) = (at("start_s"), at("real_time"), at("rtsp_transport"));
    assert_rejected(
        video,
        &[
            (
                "video = 'a'\ninput.pixel_format = 'nv12'",
                &pixel_format,
                "devices and rawvideo only",
            ),
            (
                "video = 'a'\ninput.codec = 'mjpeg'",
                &codec,
                "v4l2 and dshow only",
            ),
            (
                "video = 'udp://a'\ninput.start_s = 1",
                &start_s,
                "files only",
            ),
            (
                "video = '/dev/video0'\ninput.real_time = true",
                &real_time,
                "files only",
            ),
            (
                "video = 'http://a'\ninput.rtsp_transport = 'udp'",
                &transport,
                "rtsp:// only",
            ),
            (
                "video = 'a'\nfps = 25",
                "cameras.mirror.fps",
                "have time stamps",
            ),
            (
                "video = 'a'\ninput.format = 'h264'",
                "cameras.mirror.fps",
                "h264 has no time stamps",
            ),
            (
                "video = 'a'\nfps = 25\ninput.format = 'rawvideo'",
                &pixel_format,
                "rawvideo does not state it",
            ),
            (
                "video = 'a'\nfps = 25\ninput = { format = 'rawvideo', pixel_format = 'nv12' }",
                "cameras.mirror.size_px",
                "rawvideo does not state it",
            ),
            (
                "images = 'up'\ninput.real_time = true",
                input,
                "applies to video only",
            ),
        ],
    );
}
