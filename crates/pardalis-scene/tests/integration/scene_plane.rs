//! Scenes of the plane: cameras of a plane or an image, flat shapes, region cues, targets with several landmarks;
//! errors with key and line.

use pardalis::color::ChannelBins;
use pardalis::likelihood::{Cue, PatchSettings};
use pardalis::shape::{Flat, Shape};
use pardalis_camera::CalibratedCamera;
use pardalis_camera::formats::Lens;
use pardalis_camera::{Camera, Plane};
use pardalis_scene::{Problem, Scene};

/// The tests refer to line numbers of this text.
const SCENE: &str = r#"[cameras.mast]
images = "frames"
fps = 15
[cameras.mast.model.plane]
points = [
    [184.34, 327.52, -0.8452467, -0.2679295],
    [448.73, 304.71, 1.1498814, -0.1284166],
    [402.42, 198.82, 1.0452467, 1.3679295],
    [195.57, 212.70, -0.9498814, 1.2284166],
]
camera_center_m = [0.0, -3.2, 3.0]
[targets.robot]
shape.disc = { radius_m = 0.06, height_m = 0.406 }
region = {}
difference = { scale = 2, samples = 8, bins = 32, sigma = 0.3 }
[targets.robot.landmarks.front]
colors = "red.toml"
start.gaussian = { position_m = [-1.3, -0.35, 0] }
[targets.robot.landmarks.rear]
shape.rectangle = { size_m = [0.2, 0.1] }
colors = "yellow.toml"
start.gaussian = { position_m = [-1.6, -0.35, 0] }
"#;

/// The position of the camera.
const CENTER: &str = "camera_center_m = [0.0, -3.2, 3.0]";

fn no_calibration(file: &str, _: Option<Lens>) -> Result<Vec<CalibratedCamera>, String> {
    Err(format!("{file}: is not there"))
}

/// Parses the scene with pieces of it replaced, which must occur in it.
fn scene_with(pieces: &[(&str, &str)]) -> Result<Scene, Vec<Problem>> {
    let replaced = |text: String, (piece, other): &(&str, &str)| {
        assert!(text.contains(piece), "{piece}");
        text.replace(piece, other)
    };
    let text = pieces.iter().fold(SCENE.to_owned(), replaced);
    Scene::parse(&text, &no_calibration)
}

fn plane(scene: &Scene) -> Plane<f64> {
    match &scene.cameras[0].camera {
        Camera::Plane(plane) => *plane,
        other => panic!("{other:?}"),
    }
}

#[track_caller]
fn assert_rejected(pieces: &[(&str, &str)], wanted: &str) {
    let problems = scene_with(pieces).unwrap_err();
    let found = problems.iter().any(|p| p.to_string().contains(wanted));
    assert!(found, "no {wanted:?} in {problems:#?}");
}

#[test]
fn landmarks_share_the_settings_of_their_target() {
    let scene = scene_with(&[]).unwrap();
    assert!(scene.warnings.is_empty(), "{:?}", scene.warnings);
    let robot = &scene.targets[0];
    assert_eq!(robot.heading, Some([0, 1]));
    let [front, rear] = &robot.bodies[..] else {
        panic!("{robot:?}")
    };
    assert_eq!((&*front.name, &*rear.name), ("front", "rear"));
    let disc = Shape::Flat(Flat::disc(0.06, 0.406).unwrap());
    assert_eq!(front.shape, disc);
    let rectangle = Shape::Flat(Flat::rectangle([0.2, 0.1], 0.0).unwrap());
    assert_eq!(rear.shape, rectangle);
    let mut difference = PatchSettings::around();
    difference.scale = 2.0;
    difference.samples = 8;
    difference.bins = ChannelBins::new(32).unwrap();
    difference.sigma = 0.3;
    let cues = [
        Cue::Region(PatchSettings::within(&disc)).into(),
        Cue::Difference(difference).into(),
    ];
    for body in [front, rear] {
        assert_eq!(body.cues(), cues);
        assert!(body.motion().is_planar(), "landmarks stay level");
    }
    // The difference alone needs no colours.
    let bare = [
        ("region = {}\n", ""),
        ("colors = \"red.toml\"\n", ""),
        ("colors = \"yellow.toml\"\n", ""),
    ];
    assert!(scene_with(&bare).is_ok());
    assert_rejected(
        &bare[1..2],
        "line 16: targets.robot.landmarks.front.colors: is missing",
    );
    // Names are arbitrary, but only front and rear determine a heading.
    let named = scene_with(&[
        ("landmarks.front", "landmarks.a"),
        ("landmarks.rear", "landmarks.b"),
    ]);
    let named = named.unwrap();
    assert_eq!((named.targets[0].heading, named.warnings.len()), (None, 0));
    let half = scene_with(&[("landmarks.rear", "landmarks.back")]).unwrap();
    assert_eq!(half.targets[0].heading, None);
    let warning = half.warnings[0].to_string();
    assert!(
        warning.contains("targets.robot.landmarks: has one of `front` and `rear`"),
        "{warning}"
    );
}

#[test]
fn planes_are_read_from_points_or_homography_and_positions_directly_or_from_intrinsics() {
    let by_points = plane(&scene_with(&[]).unwrap());
    let seen = |plane: Plane<f64>, place| Camera::Plane(plane).project(place).unwrap();
    for (pixel, place) in [
        ([184.34, 327.52], [-0.845_246_7, -0.267_929_5, 0.0]),
        ([402.42, 198.82], [1.045_246_7, 1.367_929_5, 0.0]),
    ] {
        let [u, v] = seen(by_points, place);
        assert!((u - pixel[0]).hypot(v - pixel[1]) < 1e-6, "{u} {v}");
    }
    assert_eq!(by_points.center_m(), Some([0.0, -3.2, 3.0]));
    // The homography of these points, with an arbitrary scale and sign.
    let (start, end) = (
        SCENE.find("points").unwrap(),
        SCENE.find("camera_center").unwrap(),
    );
    let points = &SCENE[start..end];
    let rows = by_points
        .pixel_from_plane()
        .map(|row| row.map(|v| -7.0 * v));
    let homography = format!("homography = {rows:?}\n");
    let by_homography = plane(&scene_with(&[(points, &homography)]).unwrap());
    let place = [0.3, 0.4, 0.406];
    let [[a, b], [c, d]] = [by_points, by_homography].map(|plane| seen(plane, place));
    assert!((a - c).hypot(b - d) < 1e-6);
    // The intrinsics of data/plane-robot determine the camera's position; the truth is in its camera.json.
    let lens = "f_px = [560, 560]\ncenter_px = [319.5, 239.5]";
    let found_m = plane(&scene_with(&[(CENTER, lens)]).unwrap())
        .center_m()
        .unwrap();
    for (found_m, true_m) in found_m.into_iter().zip([0.0, -3.2, 3.0]) {
        assert!((found_m - true_m).abs() < 0.02, "{found_m:?}");
    }
    // Without a camera position, and with an image as the plane, only targets on the plane can be tracked.
    let flat = ("height_m = 0.406", "height_m = 0");
    assert_eq!(
        plane(&scene_with(&[(CENTER, ""), flat]).unwrap()).center_m(),
        None
    );
    let model = &SCENE[SCENE.find("[cameras.mast.model").unwrap()..SCENE.find("[targets").unwrap()];
    let image = plane(&scene_with(&[(model, "model.image = {}\n"), flat]).unwrap());
    assert_eq!(seen(image, [12.0, 34.5, 0.0]), [12.0, 34.5]);
    assert_rejected(
        &[(CENTER, "")],
        "line 13: targets.robot.shape: rises above the plane, but the position of camera \"mast\" is unknown",
    );
}

#[test]
fn an_outlier_among_the_points_is_named() {
    // The projections of two points; the second one is moved by 30 px.
    let camera = Camera::Plane(plane(&scene_with(&[]).unwrap()));
    let [a, b] = [[0.4, 0.1, 0.0], [0.0, 0.6, 0.0]].map(|place| camera.project(place).unwrap());
    let rows = format!(
        "\n    [{:.2}, {:.2}, 0.4, 0.1],\n    [{:.2}, {:.2}, 0.0, 0.6],\n]",
        a[0],
        a[1],
        b[0] + 30.0,
        b[1]
    );
    let scene = scene_with(&[("\n]", &rows)]).unwrap();
    let warning = scene.warnings[0].to_string();
    assert!(
        warning.contains("line 5: cameras.mast.model.plane.points: point 6 disagrees with the others, which place it 30.0 px away"),
        "{warning}"
    );
    let [u, v] = Camera::Plane(plane(&scene))
        .project([0.4, 0.1, 0.0])
        .unwrap();
    assert!((u - a[0]).hypot(v - a[1]) < 0.1);
}

#[test]
fn invalid_planes_are_rejected_by_key() {
    let second = "[448.73, 304.71, 1.1498814, -0.1284166],";
    let third = "[402.42, 198.82, 1.0452467, 1.3679295],";
    let points = "line 5: cameras.mast.model.plane.points: ";
    let key = |key: &str| format!("cameras.mast.model.plane.{key}: ");
    for (piece, other, wanted) in [
        (second, "", format!("{points}3 points are too few")),
        (
            second,
            "[448.73, 304.71, 1.1498814],",
            format!("{points}is [["),
        ),
        (
            second,
            "[nan, 304.71, 1.1498814, -0.1284166],",
            points.to_owned(),
        ),
        (
            second,
            third,
            format!("{points}points 2 and 3 are the same"),
        ),
        // Crossed: two points of the plane swapped.
        (
            "1.1498814, -0.1284166],\n    [402.42, 198.82, 1.0452467, 1.3679295]",
            "1.0452467, 1.3679295],\n    [402.42, 198.82, 1.1498814, -0.1284166]",
            points.to_owned(),
        ),
        (
            "points = [",
            "homography = [[1, 0, 0], [0, -1, 0], [0, 0, 1]]\npoints = [",
            format!("{}cannot be combined with points", key("homography")),
        ),
        (
            CENTER,
            "camera_center_m = [0, 0, -3]",
            key("camera_center_m"),
        ),
        (CENTER, "camera_center_m = 3", key("camera_center_m")),
        (
            CENTER,
            "camera_center_m = [0, 0, 3]\nf_px = [560, 560]",
            format!("{}cannot be combined with camera_center_m", key("f_px")),
        ),
        (
            CENTER,
            "f_px = [560, 560]",
            format!("{}is missing", key("center_px")),
        ),
        (
            CENTER,
            "center_px = [1, 2]",
            format!("{}is missing", key("f_px")),
        ),
        // No camera with these intrinsics has this homography.
        (
            CENTER,
            "f_px = [10, 5000]\ncenter_px = [319.5, 239.5]",
            key("f_px"),
        ),
        (
            CENTER,
            "center_m = [0, 0, 3]",
            format!("{}is not a key", key("center_m")),
        ),
        (
            "fps = 15",
            "fps = 15\nworld_from_camera = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]",
            "line 4: cameras.mast.world_from_camera: cannot be combined with a camera of a plane"
                .to_owned(),
        ),
    ] {
        assert_rejected(&[(piece, other)], &wanted);
    }
    let (start, end) = (
        SCENE.find("points").unwrap(),
        SCENE.find("camera_center").unwrap(),
    );
    let points = &SCENE[start..end];
    assert_rejected(
        &[(points, "")],
        "cameras.mast.model.plane.points: is missing; give four or more",
    );
    for homography in ["[[1, 0, 0], [0, 1, 0], [1, 1, 0]]", "[[1, 0], [0, 1]]", "1"] {
        let text = format!("homography = {homography}\n");
        assert_rejected(
            &[(points, &text)],
            "line 5: cameras.mast.model.plane.homography: ",
        );
    }
}

#[test]
fn invalid_landmarks_and_regions_are_rejected_by_key() {
    let disc = "shape.disc = { radius_m = 0.06, height_m = 0.406 }";
    let front = &SCENE[SCENE.find("[targets.robot.landmarks.front]").unwrap()
        ..SCENE.find("[targets.robot.landmarks.rear]").unwrap()];
    let start = "start.gaussian = { position_m = [-1.3, -0.35, 0] }";
    for (piece, other, wanted) in [
        (
            disc,
            "shape.disc.radius_m = 0",
            "line 13: targets.robot.shape.disc.radius_m: is 0",
        ),
        (
            disc,
            "shape.disc = { radius_m = 1, height_m = -1 }",
            "line 13: targets.robot.shape.disc.height_m: is -1",
        ),
        (
            "size_m = [0.2, 0.1]",
            "size_m = [0.2]",
            "line 20: targets.robot.landmarks.rear.shape.rectangle.size_m: is [0.2]",
        ),
        (
            "size_m = [0.2, 0.1]",
            "size_m = [0.2, -1]",
            "line 20: targets.robot.landmarks.rear.shape.rectangle.size_m: is ",
        ),
        (
            "shape.rectangle = { size_m = [0.2, 0.1] }",
            "shape.sphere.radius_m = 0.1",
            "line 20: targets.robot.landmarks.rear.shape: is not flat",
        ),
        (
            disc,
            "shape.sphere.radius_m = 0.1",
            "targets.robot.region: applies to flat targets only; give shape.disc or shape.rectangle",
        ),
        (disc, "", "landmarks.front.shape: is missing"),
        (
            "scale = 2",
            "scale = 0",
            "line 15: targets.robot.difference.scale: is 0",
        ),
        (
            "samples = 8",
            "samples = 65",
            "line 15: targets.robot.difference.samples: is 65; allowed: 1 to 64",
        ),
        (
            "bins = 32",
            "bins = 10",
            "line 15: targets.robot.difference.bins: is 10; allowed: 2, 4, 8",
        ),
        (
            "sigma = 0.3",
            "sigma = -1",
            "line 15: targets.robot.difference.sigma: is -1",
        ),
        (
            "sigma = 0.3",
            "steps = 3",
            "line 15: targets.robot.difference.steps: is not a key",
        ),
        (
            "region = {}",
            "region.cameras = [\"up\"]",
            "line 14: targets.robot.region.cameras: names \"up\"; allowed: mast",
        ),
        (
            front,
            "",
            "targets.robot.landmarks: has one; give two or more",
        ),
        (
            "region = {}",
            "region = {}\ncolors = \"red.toml\"",
            "line 15: targets.robot.colors: cannot be combined with landmarks",
        ),
        (
            "region = {}",
            "region = {}\nstart.gaussian.position_m = [0, 0, 0]",
            "line 15: targets.robot.start: cannot be combined with landmarks",
        ),
        (
            start,
            "start.track.file = \"theirs.csv\"",
            "line 18: targets.robot.landmarks.front.start: is a track",
        ),
        (start, "", "targets.robot.landmarks.front.start: is missing"),
        (
            start,
            "filter.particles = 3",
            "targets.robot.landmarks.front.filter: is not a key",
        ),
    ] {
        assert_rejected(&[(piece, other)], wanted);
    }
}

#[test]
fn texts_truncated_at_any_byte_are_read_or_rejected() {
    let cut = (0..SCENE.len()).filter_map(|end| SCENE.get(..end));
    let is_sound = |text: &&str| match Scene::parse(text, &no_calibration) {
        Ok(_) => true,
        Err(problems) => {
            assert!(!problems.is_empty() && problems.is_sorted(), "{problems:?}");
            false
        }
    };
    // The rest is a valid scene only if it includes the last required key.
    let sound: Vec<&str> = cut.filter(is_sound).collect();
    assert!(sound.len() < 5, "{sound:?}");
}
