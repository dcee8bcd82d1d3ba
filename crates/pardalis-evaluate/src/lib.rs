//! Estimates against truth: errors, coverage, consistency, what confidences and states are worth, and which track follows which object.

mod assignment;
mod bootstrap;
mod course;
mod distribution;
mod finding;
mod heading;
mod identity;
mod reliability;
mod spherical;
mod states;
mod summary;

pub use course::Course;
pub use distribution::{Distribution, MeanSd};
pub use heading::Heading;
pub use identity::{Identities, assign, ends_on_another, identities};
pub use reliability::{Bin, Claim, Reliability, reliability};
pub use spherical::{SphericalError, spherical_error, wrapped_rad};
pub use states::{States, states};
pub use summary::{Consistency, Errors, Scores, Summary, score};

use pardalis::tracker::TrackState;

/// What a track says of one frame, in the world frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EstimatedState {
    /// Position in metres.
    pub position_m: [f64; 3],
    /// Position of the best particle in metres, where the track gives it.
    pub best_position_m: Option<[f64; 3]>,
    /// Velocity in metres a second, where the track gives one.
    pub velocity_mps: Option<[f64; 3]>,
    /// Where the object faces, in radians counter-clockwise from the world's x, where the track gives it.
    pub heading_rad: Option<f64>,
    /// Covariance of the position in square metres, where the track gives one: xx, xy, xz, yy, yz, zz.
    pub covariance_m2: Option<[f64; 6]>,
}

/// What is true of an object in one frame, in the world frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrueState {
    /// Position in metres.
    pub position_m: [f64; 3],
    /// Velocity in metres a second, where it is known.
    pub velocity_mps: Option<[f64; 3]>,
    /// Where the object faces, in radians counter-clockwise from the world's x, where it is known.
    pub heading_rad: Option<f64>,
    /// The share of the object that the camera with the best view sees, 0 to 1, where it is known.
    pub visible_fraction: Option<f64>,
    /// How many cameras see more than half of the object, where it is known.
    pub seeing_cameras: Option<usize>,
}

/// One frame of the truth, with what the track says of it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sample {
    /// The track's state; none where it says none.
    pub state: Option<TrackState>,
    /// Where the track has the object; none where it has no estimate.
    pub estimate: Option<EstimatedState>,
    /// What is true.
    pub truth: TrueState,
}

/// What counts as visible and as lost, and where spherical errors are taken from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Settings {
    /// The point, in the world frame and metres, around which distance, elevation and azimuth are taken.
    pub around_m: [f64; 3],
    /// An object is visible where more than this share of it is seen, or where the share is unknown.
    pub visible_over: f64,
    /// An estimate farther than this from the truth, in metres, has lost its object.
    pub lost_beyond_m: f64,
}

impl Settings {
    /// The default of [`Settings::visible_over`].
    pub const VISIBLE_OVER: f64 = 0.6;
    /// The default of [`Settings::lost_beyond_m`]: three diameters of a football.
    pub const LOST_BEYOND_M: f64 = 0.66;

    /// Whether the object is visible.
    fn sees(&self, truth: &TrueState) -> bool {
        let share = truth.visible_fraction;
        share.is_none_or(|share| share > self.visible_over)
    }

    /// Whether there is an estimate that has not lost the object.
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

/// The distance of two points, in metres.
fn distance_m(a_m: [f64; 3], b_m: [f64; 3]) -> f64 {
    norm(difference(a_m, b_m))
}

/// `a - b`.
fn difference(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

/// Euclidean length.
fn norm(v: [f64; 3]) -> f64 {
    v.iter().map(|c| c * c).sum::<f64>().sqrt()
}
