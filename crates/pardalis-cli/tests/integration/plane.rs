//! Tests of `pardalis calibrate plane`: rectangles on real and simulated floors, points, and errors.

use std::fs;
use std::path::{Path, PathBuf};

use crate::common::run::Run;

/// Corners of the tape's outer edge in data/plane-robot, in the image (pixels) and in the world (metres), beginning with the
/// one nearest to the image's bottom left.
const CORNERS: [[f64; 4]; 4] = [
    [184.3446, 327.5206, -0.845_247, -0.267_930],
    [448.7292, 304.7143, 1.149_881, -0.128_417],
    [402.4226, 198.8209, 1.045_247, 1.367_930],
    [195.5667, 212.6953, -0.949_881, 1.228_417],
];

/// Pixels of these corners: the tape was rendered 1.5 mm above the floor.
const CORNERS_PX: [[f64; 2]; 4] = [
    [184.3148, 327.3772],
    [448.7564, 304.5625],
    [402.4363, 198.6923],
    [195.5455, 212.5644],
];

fn data(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../../data")
        .join(name)
}

/// Parses the reported corners, in pixels.
fn corners(run: &Run) -> Vec<[f64; 2]> {
    let corner = |line: &str| {
        let (pixel, _) = line.split_once(": (")?.1.split_once(") px")?;
        let (u, v) = pixel.split_once(", ")?;
        Some([u.parse().ok()?, v.parse().ok()?])
    };
    run.stdout.lines().filter_map(corner).collect()
}

#[track_caller]
fn assert_within(found: &[[f64; 2]], expected: &[[f64; 2]], limit_px: f64) {
    assert_eq!(found.len(), expected.len());
    for (a, b) in found.iter().zip(expected) {
        assert!(
            (a[0] - b[0]).hypot(a[1] - b[1]) < limit_px,
            "{found:?} {expected:?}"
        );
    }
}

/// Finds the overexposed tape of plane-robot within 0.12 px, and the camera at (0, -3.2, 3.0) in the floor's frame.
#[test]
fn finds_tape_of_plane_robot() {
    let folder = tempfile::tempdir().unwrap();
    let frames = data("plane-robot/frames");
    let world = CORNERS.map(|[_, _, x, y]| format!("{x},{y}")).join(" ");
    let frames = frames.to_string_lossy();
    let calibrate = |output: &str| {
        let options = ["--corners", &world, "--focal", "560", "-o", output];
        let arguments = [&["calibrate", "plane", &*frames][..], &options].concat();
        Run::pardalis(folder.path(), &arguments).fine()
    };
    let run = calibrate("floor");
    assert_within(&corners(&run), &CORNERS_PX, 0.12);
    assert!(run.stdout.contains("bright tape"), "{}", run.stdout);
    let line = run
        .stdout
        .lines()
        .find(|line| line.starts_with("The camera is"))
        .unwrap();
    let numbers: Vec<f64> = line
        .split(|c: char| !(c.is_ascii_digit() || c == '.' || c == '-'))
        .filter_map(|n| n.parse().ok())
        .collect();
    for (found, expected) in numbers.iter().zip([3.0, 0.0, -3.2]) {
        assert!((found - expected).abs() < 0.05, "{line}");
    }
    assert!(folder.path().join("floor/corners.png").exists());
    // The program reads the camera file.
    Run::pardalis(folder.path(), &["camera", "show", "floor/camera.toml"]).fine();
    // The result is deterministic.
    let first = fs::read(folder.path().join("floor/camera.toml")).unwrap();
    calibrate("again");
    assert_eq!(
        fs::read(folder.path().join("again/camera.toml")).unwrap(),
        first
    );
}

/// The inner edge is inset by the tape's width of 0.05 m.
#[test]
fn finds_inner_edge_of_the_tape() {
    let folder = tempfile::tempdir().unwrap();
    let frames = data("plane-robot/frames");
    let run = Run::pardalis(
        folder.path(),
        &[
            "calibrate",
            "plane",
            &frames.to_string_lossy(),
            "--size",
            "1.9x1.4",
            "--edge",
            "inner",
        ],
    )
    .fine();
    let inner = [
        [191.8, 321.6],
        [440.3, 300.5],
        [398.5, 202.0],
        [200.8, 215.3],
    ];
    assert_within(&corners(&run), &inner, 0.5);
}

/// Simulates 9 images of a rectangle of 2 x 1.4 m around the origin, and runs the command on them.
fn simulated(folder: &Path, tape: &str, texture: &str, image: &str) -> Run {
    let text = format!(
        "seed = 1\nduration_s = 0.6\n[cameras.cam]\nsize_px = [640, 480]\n\
         model.pinhole = {{ f_px = [500, 500], center_px = [319.5, 239.5] }}\n\
         look_from_m = [-2.2, -2.4, 2.6]\nlook_at_m = [0.1, 0.0, 0.0]\n[timing]\nfps = 15\n\
         [image]\n{image}\n[ground]\n{texture}\n{tape}\n\
         [objects.robot]\ntarget = true\nshape.cylinder = {{ radius_m = 0.2, height_m = 0.3 }}\n\
         color_srgb = [45, 45, 50]\npath.still.position_m = [1.0, 0.3, 0]\n"
    );
    fs::write(folder.join("world.toml"), text).unwrap();
    Run::pardalis(folder, &["simulate", "world.toml", "-o", "world"]).fine();
    Run::pardalis(
        folder,
        &["calibrate", "plane", "world/frames", "--size", "2x1.4"],
    )
}

/// Returns the pixels of the corners of [`simulated`].
fn simulated_corners() -> Vec<[f64; 2]> {
    use nalgebra::Vector3;
    let center = Vector3::new(-2.2, -2.4, 2.6);
    let forward = (Vector3::new(0.1, 0.0, 0.0) - center).normalize();
    let right = forward.cross(&Vector3::z()).normalize();
    let down = forward.cross(&right);
    let pixel_of = |[x, y]: [f64; 2]| {
        let p = Vector3::new(x, y, 0.0) - center;
        let scale = 500.0 / forward.dot(&p);
        [319.5 + scale * right.dot(&p), 239.5 + scale * down.dot(&p)]
    };
    let world = [[-1.0, 0.7], [-1.0, -0.7], [1.0, -0.7], [1.0, 0.7]];
    world.map(pixel_of).to_vec()
}

/// Dark tape on bright, noisy tiles, with a robot on the far side.
#[test]
fn finds_dark_tape_on_tiles() {
    let folder = tempfile::tempdir().unwrap();
    let run = simulated(
        folder.path(),
        "tape = { size_m = [2.0, 1.4], width_m = 0.05, color_srgb = [30, 60, 180] }",
        "texture.checker = { size_m = 0.5, colors_srgb = [[190, 185, 180], [205, 200, 195]] }",
        "read_noise = 4.0\nblur_px = 0.7\nshot_noise = 0.008\njpeg_quality = 90",
    )
    .fine();
    assert_within(&corners(&run), &simulated_corners(), 1.0);
    assert!(run.stdout.contains("dark tape"), "{}", run.stdout);
}

/// Thin tape, two to four pixels wide in a blurred image: the steepest gradients are not at its edges.
#[test]
fn finds_thin_tape() {
    let folder = tempfile::tempdir().unwrap();
    let run = simulated(
        folder.path(),
        "tape = { size_m = [2.0, 1.4], width_m = 0.03, color_srgb = [215, 212, 205] }",
        "texture.checker = { size_m = 0.5, colors_srgb = [[128, 125, 118], [132, 125, 118]] }",
        "read_noise = 1.5\nblur_px = 0.7\nshot_noise = 0.006\njpeg_quality = 90",
    )
    .fine();
    assert_within(&corners(&run), &simulated_corners(), 0.06);
}

/// Tape 20 % brighter than white: every edge seems farther out.
#[test]
fn finds_saturated_tape() {
    let folder = tempfile::tempdir().unwrap();
    let run = simulated(
        folder.path(),
        "tape = { size_m = [2.0, 1.4], width_m = 0.05, color_srgb = [255, 252, 246] }",
        "texture.checker = { size_m = 0.5, colors_srgb = [[178, 170, 156], [174, 170, 160]] }",
        "read_noise = 1.5\nblur_px = 0.7\nshot_noise = 0.006\njpeg_quality = 90\n\
         gain_drift = 0.25\ndrift_period_s = 100000",
    )
    .fine();
    assert_within(&corners(&run), &simulated_corners(), 0.25);
}

/// Planks alone form no rectangle.
#[test]
fn rejects_floor_without_rectangle() {
    let folder = tempfile::tempdir().unwrap();
    let planks = "texture.stripes = { width_m = 0.12, rotation_deg = 30, colors_srgb = [[150, 120, 90], [165, 132, 98]] }";
    let noise = "read_noise = 2.5\nblur_px = 0.7\njpeg_quality = 90";
    simulated(folder.path(), "", planks, noise).refused(&["world/frames: "]);
}

/// Other sequences contain no rectangle.
#[test]
fn rejects_scenes_without_rectangle() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["dioptric-jump/frames", "webcams-two/frames/cam1"] {
        let frames = data(name);
        let run = Run::pardalis(
            folder.path(),
            &[
                "calibrate",
                "plane",
                &frames.to_string_lossy(),
                "--size",
                "2x1.5",
            ],
        );
        run.refused(&["there is no rectangle that stands out"]);
        assert!(!folder.path().join("frames-plane").exists());
    }
}

#[test]
fn reports_wrong_points() {
    let folder = tempfile::tempdir().unwrap();
    let row = |[u, v, x, y]: &[f64; 4]| format!("{u},{v},{x},{y}\n");
    let rows: String = CORNERS.iter().map(row).collect();
    // Two more points from the true camera, and a wrong row.
    let more = "358.5911,271.3232,0.5,0.3\n263.7491,224.7336,-0.3,1.0\n300,250,5,5\n";
    let path = folder.path().join("points.csv");
    fs::write(&path, format!("u_px,v_px,x_m,y_m\n{rows}{more}")).unwrap();
    let all = ["calibrate", "plane", "--points", "points.csv"];
    let run = Run::pardalis(folder.path(), &all).fine();
    assert!(run.stdout.contains("6 of 7 points"), "{}", run.stdout);
    assert!(
        run.stdout
            .contains("line 8: ignored, because the other points place it"),
        "{}",
        run.stdout
    );
    fs::write(
        &path,
        format!(
            "u_px,v_px,x_m,y_m\n{}",
            rows.lines().take(3).collect::<Vec<_>>().join("\n")
        ),
    )
    .unwrap();
    Run::pardalis(folder.path(), &all).refused(&["points.csv: 3 points are too few"]);
    let mirrored: String = CORNERS
        .iter()
        .map(|[u, v, x, y]| row(&[*u, *v, -x, *y]))
        .collect();
    fs::write(&path, format!("u_px,v_px,x_m,y_m\n{mirrored}")).unwrap();
    Run::pardalis(folder.path(), &all).refused(&["points.csv: the plane is mirrored"]);
    Run::pardalis(
        folder.path(),
        &[
            "calibrate",
            "plane",
            "--points",
            "points.csv",
            "--size",
            "2x1",
        ],
    )
    .rejected_by_usage();
}

impl Run {
    /// Checks that the command line itself is rejected.
    #[track_caller]
    fn rejected_by_usage(&self) {
        assert_eq!(self.code, Some(2), "{}", self.stderr);
        assert!(
            self.stderr.contains("cannot be used with"),
            "{}",
            self.stderr
        );
    }
}
