//! Fixtures of the plane sequence: the camera calibrated by the tape rectangle, and the robot with two
//! landmarks.

use pardalis::color::ColorModel;
use pardalis::likelihood::{Cue, PatchSettings};
use pardalis::shape::{Flat, Shape};
use pardalis::start::Start;
use pardalis::tracker::{InitializedSettings, TargetSettings};
use pardalis::view::View;
use pardalis_calibrate::plane::{PointPair, fit};
use pardalis_camera::Pose;
use pardalis_camera::{Camera, Plane};
use pardalis_filter::gaussian::{GaussianStart, diagonal_m2};
use pardalis_images::RgbImage;

use super::{SIZE, data, open};

/// Frame rate of the sequence in frames per second.
pub(crate) const FPS: f64 = 15.0;
/// Outer corners of the tape: u, v, x, y.
const CORNERS: [[f64; 4]; 4] = [
    [184.34, 327.52, -0.845_246_7, -0.267_929_5],
    [448.73, 304.71, 1.149_881_4, -0.128_416_6],
    [402.42, 198.82, 1.045_246_7, 1.367_929_5],
    [195.57, 212.70, -0.949_881_4, 1.228_416_6],
];
/// Position of the camera in metres.
const CENTER_M: [f64; 3] = [0.0, -3.2, 3.0];

/// Loads a picture of data/plane-robot.
pub(crate) fn picture(index: usize) -> RgbImage {
    open(&format!("plane-robot/frames/{index:06}.jpg"))
}

/// Returns the camera calibrated by the corners, with or without its position.
pub(crate) fn mast(has_position: bool) -> Plane<f64> {
    let pairs = CORNERS.map(|[u, v, x, y]| PointPair {
        pixel: [u, v],
        plane_m: [x, y],
    });
    let found = fit(&pairs).unwrap();
    Plane::new(&found.homography, has_position.then_some(CENTER_M)).unwrap()
}

/// Returns the view of the sequence's camera; the camera frame is the world.
pub(crate) fn mast_view() -> View {
    View::new(Camera::Plane(mast(true)), Pose::identity(), SIZE, None).unwrap()
}

/// Returns the shape of a landmark.
pub(crate) fn landmark() -> Shape {
    Shape::Flat(Flat::disc(0.06, 0.406).unwrap())
}

/// Returns the colours of a landmark: `red` or `yellow`.
pub(crate) fn landmark_colors(name: &str) -> ColorModel {
    let path = data(&format!("colors/landmark-{name}.colors.toml"));
    ColorModel::from_text(&std::fs::read_to_string(path).unwrap()).unwrap()
}

/// Returns the robot with its landmarks, red in front and yellow behind, each with the region and difference
/// cues.
pub(crate) fn robot_target(particle_count: usize) -> TargetSettings {
    let body = |colors, x_m| {
        let start = Start::Gaussian(GaussianStart {
            position_m: [x_m, -0.35, 0.0],
            covariance_m2: diagonal_m2([0.05, 0.05, 0.0]),
            velocity_sigma_mps: [0.1, 0.1, 0.0],
            ..GaussianStart::default()
        });
        let colors = Some(landmark_colors(colors));
        let mut settings = InitializedSettings::new(landmark(), colors, start);
        settings.cues = vec![
            Cue::Region(PatchSettings::within(&landmark())).into(),
            Cue::Difference(PatchSettings::around()).into(),
        ];
        settings.filter.particle_count = particle_count;
        settings
    };
    let landmarks = vec![body("red", -1.3).into(), body("yellow", -1.6).into()];
    let mut target = TargetSettings::of_landmarks(landmarks);
    target.heading = Some([0, 1]);
    target
}
