//! Calibration of cameras of any model: intrinsics, poses, rigs, planes and time offsets, each with its
//! uncertainty, and the detection of calibration boards and rectangles in images.
//!
//! | to find | from | use |
//! |---|---|---|
//! | the corners of a checkerboard, ChArUco board or AprilGrid | an image | [`board::detect`] |
//! | views of a board that is moved by hand which add something | its corners in frames | [`board::Collection`] |
//! | intrinsics and poses | points with known positions, or several views of a board | [`calibrate`] |
//! | the pose of a calibrated camera | four points in a plane, or six | [`fit_pose`] |
//! | the relative poses of several cameras | simultaneous views of a board | [`calibrate_rig`] |
//! | the relative poses and clocks of several cameras | a ball that is waved through the room | [`calibrate_ball_rig`] |
//! | where a camera is on a robot, an arm or a head | a target at rest that is seen while these move | [`calibrate_mount`] |
//! | a rectangle of tape on a floor | images | [`rectangle::detect`] |
//! | the plane that an uncalibrated camera sees | four or more points on it | [`plane::fit`] |
//! | the offsets between the cameras' clocks | a moving target | [`calibrate_time`] |
//!
//! # Example
//!
//! A pinhole camera from five views of a board of 7 x 5 corners:
//!
//! ```
//! use nalgebra::{Point3, Rotation3, Translation3, Vector3};
//! use pardalis_calibrate::{
//!     CalibrationSettings, CalibrationStart, CalibrationView, Correspondence, ModelKind, calibrate,
//! };
//! use pardalis_camera::{Camera, Pinhole, Pose};
//!
//! let truth = Camera::Pinhole(Pinhole::new([500.0, 510.0], [320.0, 240.0], &[])?);
//! let tilts = [[0.0, 0.0], [0.5, 0.0], [-0.5, 0.1], [0.1, 0.5], [0.0, -0.5]];
//! let views: Vec<CalibrationView> = tilts
//!     .iter()
//!     .enumerate()
//!     .map(|(number, &[x, y])| {
//!         let camera_from_board = Pose::from_parts(
//!             Translation3::new(-0.15, -0.1, 0.4),
//!             Rotation3::from_euler_angles(std::f64::consts::PI + x, y, 0.0),
//!         ) * Translation3::new(0.0, -0.2, 0.0);
//!         let corners = (0..35).map(|i| [0.05 * f64::from(i % 7), 0.05 * f64::from(i / 7), 0.0]);
//!         let correspondences = corners.map(|point_m| {
//!             let point = camera_from_board * Point3::from(point_m);
//!             let pixel = truth.project(point.into()).expect("the board is in view");
//!             Correspondence { point_m, pixel }
//!         });
//!         CalibrationView {
//!             name: format!("view {number}"),
//!             correspondences: correspondences.collect(),
//!         }
//!     })
//!     .collect();
//!
//! let start = CalibrationStart::Model(ModelKind::Pinhole);
//! let mut settings = CalibrationSettings::new(start, (640, 480));
//! settings.board = true;
//! let calibration = calibrate(&views, &settings)?;
//! assert!(calibration.rms_px < 1e-3);
//! let focal_length = calibration.parameters[0];
//! assert!((focal_length.value - 500.0).abs() < 0.1);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # Units and frames
//!
//! Points are in metres in the target's frame: the world's, or a board's with x to the right, y up and z
//! towards the viewer. Pixel centres have integer coordinates, with u to the right and v down. Camera frames
//! have x to the right, y down and z forwards. Poses are named output first: `camera_from_target` maps target
//! coordinates to camera coordinates. Angles are in radians, times in seconds. Every `sigma` is a standard
//! deviation in the unit of its value.
//!
//! # Method
//!
//! All camera models share one problem: minimise the squared pixel distances between observed and projected
//! points over the model's parameters and one pose per view (bundle adjustment; Triggs et al. 2000). It needs
//! no initial guess. Starting cameras with several fields of view are tried, each with poses from the rays of
//! its pixels, and the best one is refined with a robust loss. Points that then deviate strongly are reported
//! as outliers and excluded. Least squares on the remaining points gives the result and its covariance.

mod ball_rig;
pub mod board;
mod bundle;
mod check;
mod intrinsics;
mod least_squares;
mod mount;
pub mod plane;
mod pose;
pub mod rectangle;
mod rig;
mod spread;
mod start;
mod temporal;

pub use ball_rig::{
    BallRigCalibration, BallRigCamera, BallRigSettings, BallSighting, FocalFit, RigAlignment,
    RigSight, align_to_places, align_to_points, calibrate_ball_rig,
};
pub use intrinsics::{Calibration, FittedParameter, FittedView, calibrate, covered};
pub use mount::{MountCalibration, MountSettings, MountView, PlatformAt, calibrate_mount};
pub use pose::{PoseFit, closest_pose, fit_pose};
pub use rig::{RigCalibration, RigCamera, calibrate_rig};
pub use start::ModelKind;
pub use temporal::{
    Detection, DetectionFrame, FittedDetection, MAX_TIME_OFFSET_S, TemporalCalibration,
    TimedCamera, calibrate_time,
};

use pardalis_camera::Camera;

/// A point with a known position and its observed pixel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Correspondence {
    /// Position in the target's frame (the world's or a board's), in metres.
    pub point_m: [f64; 3],
    /// Observed pixel.
    pub pixel: [f64; 2],
}

/// Correspondences of one image, which share one pose.
#[derive(Debug, Clone, PartialEq)]
pub struct CalibrationView {
    /// Name for messages.
    pub name: String,
    /// Observed points.
    pub correspondences: Vec<Correspondence>,
}

/// Settings of [`calibrate`].
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub struct CalibrationSettings {
    /// Initial camera: its model alone, or an approximate camera.
    pub start: CalibrationStart,
    /// Width and height of the images in pixels.
    pub size_px: (usize, usize),
    /// Whether the target is a board. A board is visible only from the side to which the z axis of its frame points.
    pub board: bool,
    /// Number of robust standard deviations beyond which a point is an outlier (by default [`OUTLIER_SIGMAS`]);
    /// infinity keeps all points.
    pub outlier_sigmas: f64,
}

impl CalibrationSettings {
    /// Returns settings for images of this width and height in pixels: no board, and the default number of standard deviations for outliers.
    pub fn new(start: CalibrationStart, size_px: (usize, usize)) -> Self {
        Self {
            start,
            size_px,
            board: false,
            outlier_sigmas: OUTLIER_SIGMAS,
        }
    }
}

/// Default number of robust standard deviations beyond which a point is an outlier.
pub const OUTLIER_SIGMAS: f64 = 6.0;

/// Initial camera of a calibration.
#[derive(Debug, Clone, PartialEq)]
pub enum CalibrationStart {
    /// A camera of this model with unknown parameters.
    Model(ModelKind),
    /// An approximate camera. Its fixed parts, such as the profile of a mirror, are kept.
    Near(Camera),
}

/// The reason why a calibration failed, and a remedy.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{reason}; {remedy}")]
pub struct CalibrationError {
    /// Problem with the observations.
    pub reason: String,
    /// What to do about it.
    pub remedy: String,
    /// Whether a board appears from behind: its images are flipped, or the model is for lenses and the camera
    /// looks into a mirror, or vice versa.
    pub seen_from_behind: bool,
}

impl CalibrationError {
    fn new(reason: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self {
            reason: reason.into(),
            remedy: remedy.into(),
            seen_from_behind: false,
        }
    }
}

/// Returns the root mean square of the distances (of points, not of coordinates), in pixels.
pub(crate) fn rms(residuals_px: impl Iterator<Item = [f64; 2]>) -> f64 {
    let (mut sum, mut count) = (0.0, 0);
    for [du, dv] in residuals_px {
        sum += du * du + dv * dv;
        count += 1;
    }
    (sum / f64::from(count.max(1))).sqrt()
}
