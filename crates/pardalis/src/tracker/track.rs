//! The state common to detected and initialised bodies: the track's state, each camera's latest observation, and a
//! pending re-initialisation.

use super::TrackState;
use super::image_box::CameraBoxes;
use crate::Frame;
use crate::view::View;
use pardalis_filter::gaussian::GaussianStart;

/// How long a camera's latest observation counts while only other cameras have frames, in seconds. Hand-set: twelve
/// frames at 25 frames per second.
const OBSERVATION_HOLDS_S: f64 = 0.5;

/// The frames of one instant, with all cameras.
pub(super) struct Instant<'a> {
    pub(super) views: &'a [View],
    /// Each frame with its camera's number.
    pub(super) frames: &'a [(usize, Frame)],
    /// What detectors found.
    pub(super) boxes: &'a [CameraBoxes],
    pub(super) time_s: f64,
}

/// A camera's latest observation of a body.
#[derive(Debug, Clone, Copy)]
struct Observation {
    time_s: f64,
    /// The probability that the body was visible.
    visible: f64,
    /// The same, if what was seen where it is tracked was the body.
    followed: f64,
}

/// The state common to detected and initialised bodies.
#[derive(Debug)]
pub(super) struct Track {
    state: TrackState,
    has_started: bool,
    /// The start for the next frames, and its time in seconds.
    reinitialization: Option<(GaussianStart, f64)>,
    /// One per camera.
    observations: Vec<Option<Observation>>,
}

impl Track {
    pub(super) fn new(camera_count: usize) -> Self {
        Self {
            state: TrackState::Searching,
            has_started: false,
            reinitialization: None,
            observations: vec![None; camera_count],
        }
    }

    pub(super) fn state(&self) -> TrackState {
        self.state
    }

    pub(super) fn set_state(&mut self, state: TrackState) {
        self.state = state;
    }

    /// Derives the state of a body that may not exist from the probability that it does and its confidence, given the confidences from which it is found and below which it
    /// is lost.
    pub(super) fn decide(
        &mut self,
        (existence, confidence): (f64, f64),
        [found, lost]: [f64; 2],
        time_s: f64,
    ) {
        let was_known = self.is_known();
        let least = if was_known { lost } else { found };
        self.state = if existence >= 0.5 && self.is_visible(time_s) && confidence >= least {
            TrackState::Tracking
        } else if existence >= 0.5 && was_known && confidence >= lost {
            TrackState::Occluded
        } else if was_known || self.state == TrackState::Lost {
            TrackState::Lost
        } else {
            TrackState::Searching
        };
    }

    /// Reports whether there is an estimate in this state.
    pub(super) fn is_known(&self) -> bool {
        matches!(self.state, TrackState::Tracking | TrackState::Occluded)
    }

    /// Reports whether any frames were used.
    pub(super) fn has_started(&self) -> bool {
        self.has_started
    }

    pub(super) fn set_started(&mut self) {
        self.has_started = true;
    }

    /// Starts again at the next frames, from a start that held at this time in seconds.
    pub(super) fn reinitialize(&mut self, start: &GaussianStart, time_s: f64) {
        self.reinitialization = Some((*start, time_s));
    }

    pub(super) fn take_reinitialization(&mut self) -> Option<(GaussianStart, f64)> {
        self.reinitialization.take()
    }

    /// Records the probability that the body was visible in a camera's frame.
    pub(super) fn note_observation(
        &mut self,
        camera: usize,
        time_s: f64,
        [visible, followed]: [f64; 2],
    ) {
        self.observations[camera] = Some(Observation {
            time_s,
            visible,
            followed,
        });
    }

    /// Reports whether the body is visible in a camera's recent observation.
    pub(super) fn is_visible(&self, time_s: f64) -> bool {
        let mut recent = self.recent(time_s);
        recent.any(|observation| observation.visible >= 0.5)
    }

    /// Reports whether the estimate follows what is seen in a camera's recent observation, though it may be something else.
    pub(super) fn is_followed(&self, time_s: f64) -> bool {
        let mut recent = self.recent(time_s);
        recent.any(|observation| observation.followed >= 0.5)
    }

    fn recent(&self, time_s: f64) -> impl Iterator<Item = &Observation> {
        let observations = self.observations.iter().flatten();
        observations.filter(move |observation| time_s - observation.time_s <= OBSERVATION_HOLDS_S)
    }

    /// Reports whether the body was visible in a camera's latest observation.
    pub(super) fn sees(&self, camera: usize) -> bool {
        self.observations[camera].is_some_and(|observation| observation.visible >= 0.5)
    }

    /// Returns the greatest probability that the body was visible among the cameras' latest observations.
    pub(super) fn greatest_visibility(&self) -> f64 {
        let observations = self.observations.iter().flatten();
        observations
            .map(|observation| observation.visible)
            .fold(0.0, f64::max)
    }

    /// Forgets all frames.
    pub(super) fn reset(&mut self) {
        *self = Self {
            observations: std::mem::take(&mut self.observations),
            ..Self::new(0)
        };
        self.observations.fill(None);
    }

    /// Forgets observations and state, but not that tracking has started.
    pub(super) fn forget_observations(&mut self) {
        self.observations.fill(None);
        self.state = TrackState::Searching;
    }
}

/// Returns the weighted mean of log-likelihoods relative to that of pure background, in nats. Impossible particles,
/// which have no weight, are left out.
pub(super) fn mean_log_ratio(log_likelihoods: &[f32], weights: &[f64], background: f64) -> f64 {
    log_likelihoods
        .iter()
        .zip(weights)
        .filter(|&(_, &weight)| weight > 0.0)
        .map(|(&log, weight)| weight * (f64::from(log) - background))
        .sum()
}
