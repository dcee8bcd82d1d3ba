//! Settings of detected targets.

use pardalis::color::{ColorModel, YuvEncoding};
use pardalis::filter::bernoulli::ParticleRange;
use pardalis::likelihood::{Cue, EdgeSettings};
use pardalis::tracker::{BodySettings, DetectedSettings, ExistenceSettings, SizeTolerance};
use pardalis::{Frame, PixelFormat};
use pardalis_scene::{Scene, StartConfig};

use super::{SCENE, assert_rejected, parsed};

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
    let colors = include_str!("../../../../../data/colors/pink-ball.hsi.colors.toml");
    let colors = ColorModel::from_text(colors).unwrap();
    match body.settings(Some(colors), start).unwrap() {
        BodySettings::Detected(settings) => settings,
        other => panic!("{other:?}"),
    }
}

#[test]
fn any_number_of_targets_is_a_crowd() {
    let crowd = |settings: &str| without_start(settings).unwrap().targets[0].crowd;
    assert_eq!(crowd(""), None);
    assert_eq!(crowd("count = \"one\""), None);
    assert_eq!(crowd("count = \"any\""), Some(50));
    assert_eq!(crowd("count = \"any\"\nmax_count = 3"), Some(3));
}

#[test]
fn a_target_with_the_name_of_a_member_is_rejected() {
    let other =
        "count = \"any\"\n[targets.ball-2]\nshape.sphere.radius_m = 0.2\ncolors = \"ball.toml\"";
    let problems = without_start(other).unwrap_err();
    let named = problems
        .iter()
        .any(|problem| problem.contains("name a target ball-2"));
    assert!(named, "{problems:?}");
    assert!(without_start(&other.replace("ball-2", "ball-b")).is_ok());
}

#[test]
fn targets_that_cannot_be_a_crowd_are_rejected_by_key() {
    for (settings, expected) in [
        (
            "max_count = 3",
            "targets.ball.max_count: is only for count = \"any\"",
        ),
        ("count = \"any\"\nmax_count = 0", "targets.ball.max_count: "),
        ("count = \"two\"", "targets.ball.count: "),
        (
            "count = \"any\"\nstart.gaussian.position_m = [1, 2, 3]",
            "targets.ball.count: is \"any\", but",
        ),
        (
            "count = \"any\"\nedge = {}\nstart.gaussian.position_m = [1, 2, 3]",
            "targets.ball.count: is \"any\", but a start is that of one target",
        ),
    ] {
        let problems = without_start(settings).unwrap_err();
        let named = problems.iter().any(|problem| problem.contains(expected));
        assert!(named, "{settings}: {problems:?}");
    }
}

/// A scene with these settings of its camera and of its ball.
fn with_detector(camera: &str, ball: &str) -> Result<Scene, Vec<String>> {
    parsed(&format!(
        "[cameras.cam1]\nimages = \"frames\"\nfps = 25\n{camera}\n\
         model.equidistant = {{ f_px_per_rad = 145.56, center_px = [319.5, 239.5], field_of_view_deg = 185.0 }}\n\
         world_from_camera = [[0, -1, 0, 0], [-1, 0, 0, 0], [0, 0, -1, 0.9], [0, 0, 0, 1]]\n\
         [targets.ball]\nshape.sphere.radius_m = 0.11\n{ball}\n"
    ))
}

/// The camera's file.
const BOXES: &str = "detections = \"boxes.csv\"";

#[test]
fn a_target_with_a_detector_needs_no_colors() {
    let scene = with_detector(
        BOXES,
        "detector = { side_sigma = 0.1, min_score = 0.25 }\nexistence.ground_z_m = 0.1",
    );
    let scene = scene.unwrap();
    let body = &scene.targets[0].bodies[0];
    assert_eq!((body.class(), body.cues().len()), (Some("ball"), 0));
    assert_eq!(
        scene.cameras[0].detections.as_ref().unwrap().value,
        "boxes.csv"
    );
    let BodySettings::Boxed(settings) = body.settings(None, None).unwrap() else {
        panic!("{body:?}")
    };
    assert_eq!(
        (settings.detector.side_sigma, settings.detector.min_score),
        (0.1, 0.25)
    );
    assert_eq!(settings.detector.false_per_image, 0.5);
    assert_eq!(settings.existence.ground_z_m, 0.1);
    let crowd = "detector.class = \"sports ball\"\ncount = \"any\"";
    let named = with_detector(BOXES, crowd).unwrap();
    assert_eq!(named.targets[0].bodies[0].class(), Some("sports ball"));
    let bodies = vec![named.targets[0].bodies[0].settings(None, None).unwrap()];
    assert_eq!(named.targets[0].settings(bodies).bodies.len(), 50);
}

#[test]
fn a_ball_with_planar_motion_lies_on_the_floor() {
    let planar = "motion.planar_constant_velocity.acceleration_density_m2ps3 = 2";
    for (more, height_m) in [("", None), ("existence.ground_z_m = 0.5", Some(0.5))] {
        let found = detected(&format!("{planar}\n{more}"));
        let expected_m = height_m.unwrap_or(0.5 * found.shape.diameter_m());
        assert_eq!(found.existence.ground_z_m, expected_m);
        let boxed = with_detector(BOXES, &format!("detector = {{}}\n{planar}\n{more}"));
        let boxed = boxed.unwrap().targets[0].bodies[0].settings(None, None);
        let Ok(BodySettings::Boxed(boxed)) = boxed else {
            panic!("a target with a detector alone");
        };
        assert_eq!(boxed.existence.ground_z_m, height_m.unwrap_or(0.11));
    }
}

#[test]
fn a_detector_beside_colors_serves_the_edge_cue() {
    let text = "colors = \"b.toml\"\nedge.correspondence_lines = 40\ndetector = { class = \"sports ball\", min_score = 0.25 }";
    let scene = with_detector(BOXES, text).unwrap();
    let body = &scene.targets[0].bodies[0];
    assert_eq!(body.class(), Some("sports ball"));
    assert!(body.settings(None, None).is_err(), "without colours");
    let frame = Frame::new(
        PixelFormat::Rgb8,
        YuvEncoding::default(),
        2,
        1,
        vec![200, 20, 20, 20, 20, 200],
        0.0,
    );
    let colors = ColorModel::from_image(&frame.unwrap(), &[true, false]).unwrap();
    let BodySettings::Detected(settings) = body.settings(Some(colors), None).unwrap() else {
        panic!("{body:?}")
    };
    assert_eq!(settings.edge.correspondence_lines, 40);
    assert_eq!(settings.detector.map(|it| it.min_score), Some(0.25));
    // A start does not select the published cues if the edge cue is there.
    let start = "start.gaussian = { position_m = [0, 0, 0], position_sigma_m = 1 }";
    with_detector(BOXES, &format!("{text}\n{start}")).unwrap();
}

#[test]
fn detectors_without_files_and_with_other_cues_are_rejected_by_key() {
    for (camera, ball, expected) in [
        (
            "",
            "detector = {}",
            "targets: ball has a detector, and no camera has its detections",
        ),
        (
            BOXES,
            "colors = \"b.toml\"",
            "cameras: cam1 has detections, and no target has a detector",
        ),
        (BOXES, "detector = {}\nedge = {}", "targets.ball.edge: "),
        (
            BOXES,
            "detector = {}\ncolors = \"b.toml\"\ncontour = {}",
            "targets.ball.contour: ",
        ),
        (
            BOXES,
            "detector = {}\ncolors = \"b.toml\"\nstart.gaussian = { position_m = [0, 0, 0], position_sigma_m = 1 }",
            "targets.ball.detector: needs the edge cue",
        ),
        (
            BOXES,
            "detector = {}\ncolors = \"b.toml\"\ncount = \"any\"",
            "targets.ball.count: is \"any\", but boxes beside colours",
        ),
        (
            BOXES,
            "detector.side_sigma = 0",
            "targets.ball.detector.side_sigma: ",
        ),
        (
            BOXES,
            "detector.detection_probability = 1",
            "targets.ball.detector.detection_probability: ",
        ),
        (
            BOXES,
            "detector.sigma = 0.1",
            "targets.ball.detector.sigma: is not a key",
        ),
    ] {
        let problems = with_detector(camera, ball).unwrap_err();
        let named = problems.iter().any(|problem| problem.contains(expected));
        assert!(named, "{camera} {ball}: {problems:?}");
        // A cue that is given is no start that selects it.
        let misled = problems.iter().any(|it| it.contains("needs the edge cue"));
        assert_eq!(
            misled,
            expected.contains("needs the edge cue"),
            "{problems:?}"
        );
    }
}

#[test]
fn numbers_of_particles_are_read_and_checked() {
    for (text, min, max) in [
        ("filter.particles = 300", 300, 300),
        ("filter.min_particles = 100", 100, 500),
        ("filter = { particles = 300, min_particles = 20 }", 20, 300),
    ] {
        assert_eq!(
            detected(text).particles,
            ParticleRange { min, max },
            "{text}"
        );
    }
    assert_rejected(
        without_start,
        &[
            (
                "filter.min_particles = 501",
                "targets.ball.filter.min_particles",
                "is 501, and there are at most 500",
            ),
            (
                "filter.min_particles = 0",
                "targets.ball.filter.min_particles",
                "1 to 1000000",
            ),
        ],
    );
}

#[test]
fn targets_without_start_are_detected_with_the_defaults_of_the_library() {
    let found = detected("");
    assert_eq!(found.edge, EdgeSettings::default());
    assert_eq!(found.start, None);
    assert_eq!(found.existence, ExistenceSettings::default());
    assert_eq!(found.particles, ParticleRange::fixed(500));
    let default = DetectedSettings::new(found.shape, found.colors.clone());
    assert_eq!(found.motion, default.motion);
    assert_eq!(found.particles, default.particles);

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

#[test]
fn the_radius_of_a_ball_has_a_tolerance_or_is_unknown() {
    assert_eq!(detected("").size, SizeTolerance::Share(0.02));
    let (two, _) = SCENE.split_once("[targets.robot]").unwrap();
    let one = "[cameras.web]\nimages = \"frames\"\nfps = 25\nworld_from_camera = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]\n\
               model.pinhole = { f_px = [300, 301], center_px = [159.5, 119.5] }\n";
    let parse = |cameras: &str, settings: &str| {
        parsed(&format!(
            "{cameras}[targets.ball]\ncolors = \"ball.toml\"\n{settings}\n"
        ))
    };
    let size = |cameras, settings| parse(cameras, settings).unwrap().targets[0].bodies[0].size;
    let rough = "shape.sphere = { radius_m = 0.1, radius_tolerance = 0.1 }";
    assert_eq!(size(one, rough), SizeTolerance::Share(0.1));
    let unknown = "shape.sphere.radius_m = \"unknown\"";
    assert_eq!(size(two, unknown), SizeTolerance::Unknown);
    let planar =
        format!("{unknown}\nmotion.planar_constant_velocity.acceleration_density_m2ps3 = 1");
    assert_eq!(size(one, &planar), SizeTolerance::Unknown);
    let published = format!("{unknown}\ncontour = {{}}\nstart.gaussian.position_m = [1, 2, 3]");
    let both = "shape.sphere = { radius_m = \"unknown\", radius_tolerance = 0.1 }";
    let above = "shape.sphere = { radius_m = 0.1, radius_tolerance = 1.5 }";
    for (cameras, settings, key, message) in [
        (
            one,
            unknown,
            "targets.ball.shape",
            "one camera does not tell size from distance",
        ),
        (
            two,
            &*published,
            "targets.ball.shape",
            "the published cues need the size",
        ),
        (
            two,
            both,
            "targets.ball.shape.sphere.radius_tolerance",
            "remove it",
        ),
        (
            two,
            above,
            "targets.ball.shape.sphere.radius_tolerance",
            "0 to 1",
        ),
        (
            two,
            "shape.sphere.radius_m = \"big\"",
            "targets.ball.shape.sphere.radius_m",
            "\"unknown\"",
        ),
    ] {
        let problems = parse(cameras, settings).unwrap_err();
        assert_eq!(problems.len(), 1, "{settings}: {problems:?}");
        let key = format!(": {key}: ");
        assert!(
            problems[0].contains(&key) && problems[0].contains(message),
            "{problems:?}"
        );
    }
    let published = format!("{rough}\ncontour = {{}}\nstart.gaussian.position_m = [1, 2, 3]");
    let warnings = parse(two, &published).unwrap().warnings;
    let is_told = |warning: &pardalis_scene::Problem| warning.message.contains("has no effect");
    assert!(warnings.iter().any(is_told), "{warnings:?}");
}
