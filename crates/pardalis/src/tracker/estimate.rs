//! What the tracker says of a target at one instant.

use pardalis_filter::estimate::StateEstimate;

/// The state of a target's track.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TrackState {
    /// Not started yet.
    Searching,
    /// Visible in at least one camera.
    Tracking,
    /// Not visible in the latest frame of any camera (occluded, out of view or masked): the estimate is predicted by
    /// the motion model and what other sensors measure. Or what is seen there is as likely something else: the
    /// estimate may follow that.
    Occluded,
    /// No longer tracked, because its position has become too uncertain or impossible: there is no estimate.
    Lost,
}

impl TrackState {
    /// All states.
    pub const ALL: [Self; 4] = [Self::Searching, Self::Tracking, Self::Occluded, Self::Lost];

    /// Returns its name in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Searching => "searching",
            Self::Tracking => "tracking",
            Self::Occluded => "occluded",
            Self::Lost => "lost",
        }
    }
}

/// The estimate of one target at one instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Estimate {
    /// The track's state.
    pub state: TrackState,
    /// Position, velocity and covariance; `None` unless tracking or occluded.
    pub kinematics: Option<StateEstimate>,
    /// The direction in which the target faces, counter-clockwise from x, in radians within ±π: from the rear landmark to the front one, or along the x axis of
    /// a detected body that turns. Which of its equal sides is the front follows from the way it moves first. `None` for targets with neither.
    pub heading_rad: Option<f64>,
    /// Its standard deviation, radians; large while it is not known which side is the front.
    pub heading_sigma_rad: Option<f64>,
    /// The radius of a detected ball, once several cameras have seen it, or one if it stays on the ground. `None` if it is not estimated.
    pub radius: Option<RadiusEstimate>,
    /// The filter's own probability that the target is within one diameter of the position (of a boxed target, or within twice the standard deviation of what a box tells, if
    /// that is more); for an initialised target,
    /// given that it is there, unless it was located in a single image. Without a position: the probability that a
    /// detected target exists and is visible; 0 for an initialised one.
    pub confidence: f64,
}

/// The estimated radius of a ball.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RadiusEstimate {
    /// Radius, metres.
    pub radius_m: f64,
    /// Its standard deviation, metres. Includes errors that all frames share, so that it does not vanish with time.
    pub sigma_m: f64,
}

/// What the latest frames say of a detected body by themselves, without those before ([`Tracker::measurements`](super::Tracker::measurements)).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BodyMeasurement {
    /// Position in the world, metres.
    pub position_m: [f64; 3],
    /// Its covariance (xx, xy, xz, yy, yz, zz in m²) from the noise of these frames.
    pub covariance_m2: [f64; 6],
    /// Covariance of errors that neighbouring frames share, in the same order: of part of the noise, of the target's size, of the cameras and of their platforms.
    pub shared_m2: [f64; 6],
}

/// A member of a crowd ([`Tracker::members_at`](super::Tracker::members_at)).
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct Member {
    /// Its number, from 1.
    pub number: u32,
    /// Which of the target's bodies it is, as in [`Tracker::measurements`](super::Tracker::measurements) and others, until it is gone.
    pub body: usize,
    /// Its estimate.
    pub estimate: Estimate,
}
