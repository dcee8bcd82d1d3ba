//! Folders, scenes and runs of the real program, for the tests of `pardalis track`.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

pub(crate) mod run;

pub(crate) use run::{Run, rows_in};

/// The orange ball of data/dioptric-jump.
pub(crate) const BALL_COLORS: &str = r#"format = "pardalis color model 1"
pixel_count = 1553
image_count = 6
bins = [
    [0, 9, 1, 432],
    [0, 10, 1, 302],
    [0, 8, 2, 150],
    [0, 8, 1, 126],
    [0, 9, 2, 94],
    [1, 7, 1, 79],
    [0, 7, 2, 78],
    [1, 9, 1, 73],
    [1, 8, 1, 71],
    [1, 10, 1, 69],
    [1, 6, 1, 43],
    [1, 9, 0, 36],
]
[palette.hsi]
hue_bins = 12
saturation_bins = 12
intensity_bins = 4
"#;

/// The camera of data/dioptric-jump in OpenCV's fisheye format, which contains no pose and does not state its lens
/// model.
pub(crate) const OPENCV_FISHEYE: &str = "%YAML:1.0
---
image_width: 640
image_height: 480
K: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 145.5622506548578, 0., 319.5, 0., 145.5622506548578, 239.5, 0., 0., 1. ]
D: !!opencv-matrix
   rows: 1
   cols: 4
   dt: d
   data: [ 0., 0., 0., 0. ]
";

/// A scene that tracks the ball through the images in `images`, with the colours in ball.toml. Tests refer to its
/// line numbers.
pub(crate) const SCENE: &str = r#"seed = 1
[cameras.cam1]
images = "images"
fps = 25
model.equidistant = { f_px_per_rad = 145.5622506548578, center_px = [319.5, 239.5], field_of_view_deg = 185.0 }
world_from_camera = [[0, -1, 0, 0], [-1, 0, 0, 0], [0, 0, -1, 0.9], [0, 0, 0, 1]]
[targets.ball]
shape.sphere.radius_m = 0.11
colors = "ball.toml"
contour = { inner_scale = 0.9, outer_scale = 1.1 }
filter = { particles = 100 }
[targets.ball.motion.constant_velocity]
acceleration_density_m2ps3 = 100
[targets.ball.start.gaussian]
position_m = [1.35, -1.25, 0.62]
position_sigma_m = 0.1
"#;

/// Returns the scene with a piece of it replaced, which must occur in it.
pub(crate) fn scene_with(piece: &str, other: &str) -> String {
    assert!(SCENE.contains(piece), "{piece}");
    SCENE.replace(piece, other)
}

/// Returns the folder data/dioptric-jump.
pub(crate) fn data() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../data/dioptric-jump")
}

/// Returns a frame of data/dioptric-jump.
pub(crate) fn frame_file(number: usize) -> PathBuf {
    data().join(format!("frames/{number:06}.jpg"))
}

/// A folder for the files of one test, with the ball's colours and a folder of images.
pub(crate) struct Workplace {
    folder: tempfile::TempDir,
}

impl Workplace {
    /// Creates a folder with the first frames of data/dioptric-jump.
    pub(crate) fn with_frames(count: usize) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let place = Self { folder };
        fs::create_dir(place.path("images")).unwrap();
        for number in 0..count {
            fs::copy(frame_file(number), place.image(number)).unwrap();
        }
        place.write("ball.toml", BALL_COLORS);
        place
    }

    /// Returns the path of a file in the folder.
    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Returns the path of an image that is tracked.
    pub(crate) fn image(&self, number: usize) -> PathBuf {
        self.path(&format!("images/{number:06}.jpg"))
    }

    /// Writes a file.
    pub(crate) fn write(&self, name: &str, content: impl AsRef<[u8]>) {
        fs::write(self.path(name), content).unwrap();
    }

    /// Returns the command `pardalis track scene.toml` in the folder.
    pub(crate) fn command(&self, scene: impl AsRef<[u8]>, arguments: &[&str]) -> Command {
        self.write("scene.toml", scene);
        let mut command = Command::new(env!("CARGO_BIN_EXE_pardalis"));
        command
            .current_dir(self.folder.path())
            .args(["track", "scene.toml"])
            .args(arguments);
        command
    }

    /// Runs the program on a scene, with results in the folder `out` and without plots.
    pub(crate) fn track(&self, scene: impl AsRef<[u8]>) -> Run {
        self.track_with(scene, &["-o", "out", "--no-plots"])
    }

    /// Runs the program on a scene.
    pub(crate) fn track_with(&self, scene: impl AsRef<[u8]>, arguments: &[&str]) -> Run {
        Run::of(&mut self.command(scene, arguments))
    }

    /// Returns the fields of the rows of out/tracks.csv after checking that header and rows are complete.
    pub(crate) fn rows(&self) -> Vec<Vec<String>> {
        rows_in(&fs::read_to_string(self.path("out/tracks.csv")).unwrap())
    }
}

/// A robot on the first 20 frames of data/plane-robot, by the corners of the tape, with colour and motion fused. Its
/// landmarks follow; DATA stands for the folder of the data.
pub(crate) const PLANE_ROBOT: &str = r#"seed = 1
[cameras.mast]
images = "DATA/plane-robot/frames"
fps = 15
frame_limit = 20
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
filter = { particles = 500 }
motion.planar_constant_velocity.velocity_sigma_mps = 0.2
region = {}
difference = {}
"#;

/// The red landmark of [`PLANE_ROBOT`].
pub(crate) const FRONT_LANDMARK: &str = r#"[targets.robot.landmarks.front]
colors = "DATA/colors/landmark-red.colors.toml"
start.gaussian = { position_m = [-1.3, -0.35, 0], position_sigma_m = 0.05, velocity_sigma_mps = 0.1 }
"#;

/// The yellow landmark of [`PLANE_ROBOT`].
pub(crate) const REAR_LANDMARK: &str = r#"[targets.robot.landmarks.rear]
colors = "DATA/colors/landmark-yellow.colors.toml"
start.gaussian = { position_m = [-1.6, -0.35, 0], position_sigma_m = 0.05, velocity_sigma_mps = 0.1 }
"#;
