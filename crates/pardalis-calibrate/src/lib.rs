//! Cameras from known points and where they were seen: intrinsics, poses, and how sure they are; and their clocks from a moving target.
//!
//! One problem for all models: the squared pixel distances between observed points and the same points projected are minimised over
//! the model's parameters and one pose for each view (mathematics of bundle adjustment; Triggs et al. 2000). No guess is asked for: starting
//! cameras of several fields of view are tried, each with poses from the rays of its pixels, and the best is refined. A robust loss comes first;
//! points that then stand far out are named and left out; plain least squares on the rest gives the result and its covariance.

mod bundle;
mod check;
mod clocks;
mod intrinsics;
mod least_squares;
pub mod plane;
mod pose;
mod rig;
mod spread;
mod start;

pub use clocks::{
    ClockCamera, ClockFit, ClockSighting, MAX_CLOCK_OFFSET_S, SightedFrame, estimate_clocks,
};
pub use intrinsics::{Calibration, FittedParameter, FittedView, calibrate};
pub use pose::{PoseFit, closest_pose, fit_pose};
pub use rig::{RigCalibration, RigCamera, calibrate_rig};
pub use start::ModelKind;

use pardalis_camera::Camera;

/// A known point and the pixel where it was seen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Correspondence {
    /// The point in the target's frame (the world's, or a board's), in metres.
    pub point_m: [f64; 3],
    /// The pixel.
    pub pixel: [f64; 2],
}

/// What one image shows: points that share one pose.
#[derive(Debug, Clone, PartialEq)]
pub struct CalibrationView {
    /// Its name, for people.
    pub name: String,
    /// What it shows.
    pub correspondences: Vec<Correspondence>,
}

/// What to fit.
#[derive(Debug, Clone, PartialEq)]
pub struct CalibrationSettings {
    /// Where the camera starts from: nothing known but its model, or a camera that is nearly right.
    pub start: CalibrationStart,
    /// Width and height of the images in pixels.
    pub size_px: (usize, usize),
    /// Whether the target is a board whose frame's z axis points out of its printed side, so that it can only be seen from there.
    pub board: bool,
    /// Points whose residual is more robust standard deviations than this are left out ([`OUTLIER_SIGMAS`]); infinity keeps all.
    pub outlier_sigmas: f64,
}

/// How many robust standard deviations make an outlier, where nothing else is asked for.
pub const OUTLIER_SIGMAS: f64 = 6.0;

/// Where a calibration starts.
#[derive(Debug, Clone, PartialEq)]
pub enum CalibrationStart {
    /// Only the model is known.
    Model(ModelKind),
    /// A camera that is nearly right; its fixed parts (a mirror's profile, say) stay.
    Near(Camera),
}

/// Why there is no calibration, and what to do about it.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{reason}; {remedy}")]
pub struct Refusal {
    /// What is wrong with the observations.
    pub reason: String,
    /// What to do.
    pub remedy: String,
    /// Whether a board is seen from behind: its images are flipped, or the model is a lens' and the camera looks into a mirror, or the other
    /// way round.
    pub seen_from_behind: bool,
}

impl Refusal {
    fn new(reason: impl Into<String>, remedy: impl Into<String>) -> Self {
        Self {
            reason: reason.into(),
            remedy: remedy.into(),
            seen_from_behind: false,
        }
    }
}

/// Root mean square distance in pixels (of points, not of coordinates).
pub(crate) fn rms(residuals_px: impl Iterator<Item = [f64; 2]>) -> f64 {
    let (mut sum, mut count) = (0.0, 0);
    for [du, dv] in residuals_px {
        sum += du * du + dv * dv;
        count += 1;
    }
    (sum / f64::from(count.max(1))).sqrt()
}
