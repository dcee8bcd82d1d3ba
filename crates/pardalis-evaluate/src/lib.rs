//! Evaluation of tracks against ground truth.
//!
//! | question | function |
//! |---|---|
//! | How large are the errors, how often is the object lost, and are the covariances consistent? | [`evaluate`] |
//! | Do confidences equal the observed frequencies? | [`reliability`] |
//! | Do the track's states follow occlusions? | [`states`] |
//! | Which track follows which object, and do they swap? | [`assign`], [`identities`], [`ends_on_another`] |
//! | Where is the world of the tracks in that of the truth, if they differ? | [`alignment`], [`EstimatedState::moved`] |
//! | How well do any number of tracks follow any number of objects? | [`crowd`] |
//! | Is a track on the object, where only circles in images are known? | [`evaluate_circles`] |
//!
//! # Example
//!
//! Two frames of a visible object; the estimate is 10 cm off in the first and missing in the second:
//!
//! ```
//! use pardalis_evaluate::{EstimatedState, Sample, Settings, TrueState, evaluate};
//!
//! let truth = TrueState {
//!     visible_fraction: Some(1.0),
//!     ..TrueState::at([0.0, 0.0, 1.0])
//! };
//! let estimate = EstimatedState::at([0.1, 0.0, 1.0]);
//! let samples = [
//!     Sample { state: None, estimate: Some(estimate), truth },
//!     Sample { state: None, estimate: None, truth },
//! ];
//!
//! let evaluation = evaluate(&samples, &Settings::default());
//! assert_eq!(evaluation.coverage, Some(0.5));
//! assert_eq!(evaluation.lost_frames, 1);
//! let errors = evaluation.visible.errors.expect("one estimate");
//! assert!((errors.position_m.mean - 0.1).abs() < 1e-12);
//! ```
//!
//! # Units and frames
//!
//! Positions are in metres in the world frame, whose z axis points up. Velocities are in m/s, angles in
//! radians (headings and directions counter-clockwise from the x axis), probabilities and shares from 0 to 1.
//! Errors are estimate minus truth.

mod alignment;
mod assignment;
mod bootstrap;
mod circles;
mod course;
mod crowd;
mod distribution;
mod finding;
mod heading;
mod identity;
mod reliability;
mod spherical;
mod states;
mod summary;

pub use alignment::alignment;
pub use circles::{
    Circle, CircleEvaluation, CircleSample, ProjectedOutline, Sighting, evaluate_circles,
};
pub use course::Course;
pub use crowd::{Crowd, CrowdObject, crowd};
pub use distribution::{Distribution, MeanSd};
pub use heading::Heading;
pub use identity::{Identities, assign, ends_on_another, identities};
pub use reliability::{Bin, CheckedConfidence, Reliability, reliability};
pub use spherical::{SphericalError, spherical_error, wrapped_rad};
pub use states::{States, states};
pub use summary::{Consistency, Errors, Evaluation, Summary, evaluate};

use pardalis::tracker::TrackState;

/// Estimate of a track for one frame, in the world frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EstimatedState {
    /// Position in metres.
    pub position_m: [f64; 3],
    /// Position of the best particle in metres, if the track has one.
    pub best_position_m: Option<[f64; 3]>,
    /// Velocity in m/s, if the track has one.
    pub velocity_mps: Option<[f64; 3]>,
    /// Covariance of the velocity in m²/s² (xx, xy, xz, yy, yz, zz), if the track has one.
    pub velocity_covariance_m2ps2: Option<[f64; 6]>,
    /// Heading in radians, counter-clockwise from the world's x axis, if the track has one.
    pub heading_rad: Option<f64>,
    /// Covariance of the position in m² (xx, xy, xz, yy, yz, zz), if the track has one.
    pub covariance_m2: Option<[f64; 6]>,
}

impl EstimatedState {
    /// Returns an estimate of the position, in metres, alone.
    pub fn at(position_m: [f64; 3]) -> Self {
        Self {
            position_m,
            best_position_m: None,
            velocity_mps: None,
            velocity_covariance_m2ps2: None,
            heading_rad: None,
            covariance_m2: None,
        }
    }
}

/// True state of an object in one frame, in the world frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrueState {
    /// Position in metres.
    pub position_m: [f64; 3],
    /// Velocity in m/s, if known.
    pub velocity_mps: Option<[f64; 3]>,
    /// Heading in radians, counter-clockwise from the world's x axis, if known.
    pub heading_rad: Option<f64>,
    /// Visible share of the object in the camera with the best view, 0 to 1, if known.
    pub visible_fraction: Option<f64>,
    /// Number of cameras that see more than half of the object, if known.
    pub seeing_cameras: Option<usize>,
}

impl TrueState {
    /// Returns the state of an object of which only the position, in metres, is known.
    pub fn at(position_m: [f64; 3]) -> Self {
        Self {
            position_m,
            velocity_mps: None,
            heading_rad: None,
            visible_fraction: None,
            seeing_cameras: None,
        }
    }
}

/// One frame of the ground truth with the corresponding output of the track.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sample {
    /// State of the track; `None` if the track has no states.
    pub state: Option<TrackState>,
    /// Estimate; `None` if the track has none for this frame.
    pub estimate: Option<EstimatedState>,
    /// Ground truth.
    pub truth: TrueState,
}

/// Thresholds for visible and lost, and the reference point of spherical errors.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct Settings {
    /// Reference point of distance, elevation and azimuth: world frame, metres.
    pub around_m: [f64; 3],
    /// Share of the object above which it counts as visible. An unknown share counts as visible.
    pub visible_over: f64,
    /// Error in metres beyond which an estimate has lost its object.
    pub lost_beyond_m: f64,
}

impl Settings {
    /// Default of [`Settings::visible_over`].
    pub const VISIBLE_OVER: f64 = 0.6;
    /// Default of [`Settings::lost_beyond_m`]: three diameters of a football.
    pub const LOST_BEYOND_M: f64 = 0.66;

    /// Reports whether the object is visible.
    fn sees(&self, truth: &TrueState) -> bool {
        let share = truth.visible_fraction;
        share.is_none_or(|share| share > self.visible_over)
    }

    /// Reports whether there is an estimate that has not lost the object.
    fn is_on_target(&self, sample: &Sample) -> bool {
        let truth_m = sample.truth.position_m;
        let near = |e: EstimatedState| distance_m(e.position_m, truth_m) <= self.lost_beyond_m;
        sample.estimate.is_some_and(near)
    }
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            around_m: [0.0; 3],
            visible_over: Self::VISIBLE_OVER,
            lost_beyond_m: Self::LOST_BEYOND_M,
        }
    }
}

/// Returns the distance between two points, in metres.
fn distance_m(a_m: [f64; 3], b_m: [f64; 3]) -> f64 {
    norm(difference(a_m, b_m))
}

/// Returns `a - b`.
fn difference(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

/// Returns the Euclidean norm.
fn norm(v: [f64; 3]) -> f64 {
    v.iter().map(|c| c * c).sum::<f64>().sqrt()
}
