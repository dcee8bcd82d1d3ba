//! Trackers of scenes for callers who have the frames.

use pardalis::color::ColorModel;
use pardalis_camera::Mask;
use pardalis_filter::gaussian::GaussianStart;
use pardalis_scene::{Assembly, Files, Input, PlatformMotion, Problem, Scene, TrackStart};
use toml::Table;

/// Every mask is this wide and high, and no other file can be read.
struct SmallMasks;

impl Files for SmallMasks {
    fn colors(&self, name: &str) -> Result<ColorModel, String> {
        Err(format!("{name}: no colours"))
    }

    fn mask(&self, name: &str, size_px: (usize, usize)) -> Result<Mask, String> {
        match size_px {
            (4, 4) => Ok(Mask::from_grey(4, 4, &[255; 16]).unwrap()),
            (width, height) => Err(format!("{name}: no mask of {width} x {height}")),
        }
    }

    fn start_of_track(&self, start: &TrackStart) -> Result<(GaussianStart, f64), String> {
        Err(format!("{}: no tracks", start.file))
    }
}

const TEXT: &str = r#"
[platforms.robot]
scale_sigma = 0.1

[cameras.cam]
platform = "robot"
platform_from_camera = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
model.pinhole = { f_px = [300, 300], center_px = [1.5, 1.5] }
mask = "mask.png"

[targets.ball]
shape.sphere.radius_m = 0.1
colors = "ball.toml"

[targets.boxes]
shape.sphere.radius_m = 0.2
detector = {}
start.track = { file = "theirs.csv", target = "ball" }
"#;

/// Assembles the tracker of a scene with images of this size.
fn problems_of(scene: &Scene, size_px: (usize, usize)) -> Vec<Problem> {
    let mut assembly = Assembly::default();
    for camera in &scene.cameras {
        assembly.add_camera(camera, Some(size_px), &SmallMasks);
    }
    assembly.add_targets(scene, true, &SmallMasks);
    assembly.finish(scene).err().unwrap_or_default()
}

#[test]
fn a_caller_with_frames_needs_no_inputs() {
    let none = Table::new();
    let read = |text: &str| Scene::parse_without_inputs(text, &none, &|_, _| Err(String::new()));
    let scene = read(TEXT).unwrap();
    assert!(matches!(&scene.cameras[0].input, Input::Given(place) if place.line == 5));
    assert!(matches!(
        &scene.platforms[0].motion,
        PlatformMotion::Given(place, errors) if place.key == "platforms.robot" && errors.scale_sigma == 0.1
    ));
    let needed = Scene::parse(TEXT, &|_, _| Err(String::new())).unwrap_err();
    let needed: Vec<String> = needed.iter().map(Problem::to_string).collect();
    for text in [
        "line 5: cameras.cam: has no input",
        "line 2: platforms.robot: says nothing about its motion",
    ] {
        assert!(needed.iter().any(|p| p.contains(text)), "{needed:#?}");
    }
    // What is given is checked.
    let wrong = read(&TEXT.replace("mask =", "images = 3\nmask =")).unwrap_err();
    assert_eq!(wrong[0].key, "cameras.cam.images");
}

#[test]
fn problems_with_files_are_named_with_their_keys() {
    let none = Table::new();
    let scene = Scene::parse_without_inputs(TEXT, &none, &|_, _| Err(String::new())).unwrap();
    let texts = |size_px| -> Vec<String> {
        let problems = problems_of(&scene, size_px);
        problems.iter().map(Problem::to_string).collect()
    };
    let of_targets = [
        "line 13: targets.ball.colors: ball.toml: no colours; `pardalis learn` writes such files",
        "line 18: targets.boxes.start.track.file: theirs.csv: no tracks",
    ];
    assert_eq!(texts((4, 4)), of_targets);
    let of_mask = "line 9: cameras.cam.mask: mask.png: no mask of 4 x 3";
    assert_eq!(texts((4, 3)), [&[of_mask], &of_targets[..]].concat());
    // Without them there is a tracker.
    let (text, _) = TEXT.split_once("[targets.ball]").unwrap();
    let text = format!("{text}[targets.boxes]\nshape.sphere.radius_m = 0.2\ndetector = {{}}");
    let scene = Scene::parse_without_inputs(&text, &none, &|_, _| Err(String::new())).unwrap();
    assert_eq!(problems_of(&scene, (4, 4)), []);
    // Cameras after one that is missing would have its place.
    let mut assembly = Assembly::default();
    assembly.add_camera(&scene.cameras[0], None, &SmallMasks);
    assembly.add_targets(&scene, true, &SmallMasks);
    let problems = assembly.finish(&scene).err().unwrap();
    let texts: Vec<String> = problems.iter().map(Problem::to_string).collect();
    let expected = "line 5: cameras.cam: cam has no images of a known size; add it with one";
    assert_eq!(texts, [expected]);
}
