//! Settings of initialised targets: shapes, published cues and motions.

use pardalis::color::ColorRanges;
use pardalis::likelihood::{Cue, CueSettings, Sampling, WindowSettings};
use pardalis_filter::motion::{
    AccelerationNoise, ConstantAcceleration, ConstantVelocity, JumpChance, Jumps, Motion,
    RandomWalk, VelocityNoise,
};
use pardalis_scene::Scene;

use super::{assert_rejected, no_calibration, parsed};

/// Parses a scene with one target that has these settings.
fn target(settings: &str) -> Result<Scene, Vec<String>> {
    let text = format!(
        "[cameras.a]\nimages = \"a\"\nfps = 25\nworld_from_camera = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]\n\
         model.equidistant = {{ f_px_per_rad = 145.56, center_px = [319.5, 239.5], field_of_view_deg = 185.0 }}\n\
         [targets.t]\ncolors = \"c\"\nstart.gaussian.position_m = [1, 2, 0]\n{settings}\n"
    );
    parsed(&text)
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
