//! The tracker of one body, either detected by the tracker itself or initialised and tracked by the published cues.

use super::Estimate;
use super::candidate::Candidate;
use super::detected::{DetectedTarget, LookAlikes};
use super::initialized::InitializedTarget;
use super::settings::BodySettings;
use super::statistics::ImageStatistics;
use super::track::{Instant, Track};
use crate::Frame;
use crate::start::Start;
use crate::view::View;
use pardalis_camera::Pose;
use pardalis_core::Error;
use pardalis_core::rng::Draws;
use pardalis_core::simd::Level;
use pardalis_filter::Particles;
use pardalis_filter::estimate::StateEstimate;
use pardalis_filter::gaussian::GaussianStart;

/// The tracker of a target of one body, or of a landmark.
pub(super) enum TargetTracker {
    /// Detects the target itself.
    Detected(Box<DetectedTarget>),
    /// Tracks the target with the published cues from a given start.
    Initialized(Box<InitializedTarget>),
}

impl TargetTracker {
    pub(super) fn new(
        settings: &BodySettings,
        draws: Draws,
        views: &[View],
        level: Level,
    ) -> Result<Self, Error> {
        Ok(match settings {
            BodySettings::Detected(settings) => Self::Detected(Box::new(DetectedTarget::new(
                settings, draws, views, level,
            )?)),
            BodySettings::Initialized(settings) => {
                let target = InitializedTarget::new(settings, draws, views, level)?;
                Self::Initialized(Box::new(target))
            }
        })
    }

    /// Prepares the look-up tables that the body needs for a frame of the view's size.
    pub(super) fn prepare(&self, view: &mut View, frame: &Frame) {
        match self {
            Self::Detected(target) => target.prepare(view, frame),
            Self::Initialized(target) => target.cues.prepare(view, frame),
        }
    }

    /// Predicts to the time of the next frames, `dt_s` seconds after the latest ones.
    pub(super) fn predict(&mut self, time_s: f64, dt_s: f64) {
        match self {
            Self::Detected(target) => target.predict(time_s, dt_s),
            Self::Initialized(target) => target.predict(time_s, dt_s),
        }
    }

    /// Updates the prediction with the frames of one instant.
    pub(super) fn observe(
        &mut self,
        instant: &Instant,
        statistics: &mut [ImageStatistics],
        look_alikes: &LookAlikes,
    ) {
        match self {
            Self::Detected(target) => target.observe(instant, statistics, look_alikes),
            Self::Initialized(target) => target.observe(instant),
        }
    }

    /// Predicts the body `ahead_s` seconds after the latest frames, without changing it.
    pub(super) fn estimate(&self, ahead_s: f64) -> Estimate {
        match self {
            Self::Detected(target) => target.estimate(ahead_s),
            Self::Initialized(target) => target.estimate(ahead_s),
        }
    }

    pub(super) fn track(&self) -> &Track {
        match self {
            Self::Detected(target) => &target.track,
            Self::Initialized(target) => &target.track,
        }
    }

    pub(super) fn track_mut(&mut self) -> &mut Track {
        match self {
            Self::Detected(target) => &mut target.track,
            Self::Initialized(target) => &mut target.track,
        }
    }

    /// Moves the body's estimate, which is of a time in seconds, to another world frame.
    pub(super) fn move_world(&mut self, now_from_before: &Pose, time_s: f64) {
        let estimate = self.estimate(0.0);
        if let Some(known) = &estimate.kinematics {
            let sigma_mps = GaussianStart::VELOCITY_SIGMA_MPS[0];
            let start = GaussianStart::from_estimate(known, sigma_mps).moved(now_from_before);
            self.track_mut().reinitialize(&start, time_s);
        }
    }

    /// Returns the given start, if any.
    pub(super) fn start(&self) -> Option<Start> {
        match self {
            Self::Detected(target) => target.start().copied().map(Start::Gaussian),
            Self::Initialized(target) => Some(*target.start()),
        }
    }

    pub(super) fn particles(&self) -> &Particles {
        match self {
            Self::Detected(target) => target.particles(),
            Self::Initialized(target) => target.particles(),
        }
    }

    /// Returns what was examined in the latest frames; nothing for an initialised target, which is not searched for.
    pub(super) fn candidates(&self) -> &[Candidate] {
        self.detected().map_or(&[], DetectedTarget::candidates)
    }

    /// Reports whether it compares a camera's frame with the previous one ([`View::keep`]).
    pub(super) fn compares_frames(&self) -> bool {
        match self {
            Self::Detected(_) => false,
            Self::Initialized(target) => target.cues.compare_frames(),
        }
    }

    /// Returns the position in metres, if it is known.
    pub(super) fn position_m(&self) -> Option<[f64; 3]> {
        let known = self.estimate(0.0).kinematics;
        known.map(|known| known.position_m)
    }

    /// Sets the positions of the other landmarks of the target, in metres. Initialised bodies ignore them.
    pub(super) fn set_other_landmarks(&mut self, others_m: impl Iterator<Item = [f64; 3]>) {
        if let Self::Detected(target) = self {
            target.set_other_landmarks(others_m);
        }
    }

    /// Returns the target if it is a detected one.
    pub(super) fn detected(&self) -> Option<&DetectedTarget> {
        match self {
            Self::Detected(target) => Some(target),
            Self::Initialized(_) => None,
        }
    }

    /// The same, to change it.
    pub(super) fn detected_mut(&mut self) -> Option<&mut DetectedTarget> {
        match self {
            Self::Detected(target) => Some(target),
            Self::Initialized(_) => None,
        }
    }

    /// Staggers its searches of whole images with those of other bodies, given its number among them. Only detected bodies search.
    pub(super) fn stagger_searches(&mut self, number: usize) {
        if let Self::Detected(target) = self {
            target.stagger_searches(number);
        }
    }

    /// Makes it the place of a member of a crowd. Only detected bodies can be.
    pub(super) fn join_crowd(&mut self) {
        if let Self::Detected(target) = self {
            target.join_crowd();
        }
    }

    /// Forgets what was examined in earlier frames.
    pub(super) fn forget_candidates(&mut self) {
        if let Self::Detected(target) = self {
            target.forget_candidates();
        }
    }

    /// Returns the number of the member of a crowd that it is.
    pub(super) fn number(&self) -> Option<u32> {
        self.detected()?.number()
    }

    /// Returns whether it is the place of a member of a crowd, and there is nobody.
    pub(super) fn is_free(&self) -> bool {
        self.detected().is_some_and(DetectedTarget::is_free)
    }

    /// Returns the confidence by which look-alikes are ordered.
    pub(super) fn rank(&self) -> f64 {
        self.detected().map_or(0.0, DetectedTarget::confidence)
    }

    /// Reports whether both are detected targets that cannot be distinguished in images.
    pub(super) fn looks_like(&self, other: &Self) -> bool {
        let both = self.detected().zip(other.detected());
        both.is_some_and(|(target, other)| target.looks_like(other))
    }

    /// Forgets all frames and the start of a detected target.
    pub(super) fn reset(&mut self) {
        if let Self::Detected(target) = self {
            target.reset();
        }
    }

    /// Returns an error if the body cannot be located in single images from this start.
    pub(super) fn check_start(&self, start: Option<&Start>, views: &[View]) -> Result<(), Error> {
        match start {
            Some(Start::Gaussian(start)) => start.check(),
            Some(Start::Pixel(start)) => super::check_pixel(start, views),
            None if self.detected().is_some() => Ok(()),
            None => {
                let allowed = "a position or a pixel for each initialised target";
                Err(Error::out_of_range("starts", "none", allowed))
            }
        }
    }

    /// Locates the body in these frames alone. A detected target needs neither start nor passes, and must have been
    /// reset before.
    pub(super) fn locate(
        &mut self,
        instant: &Instant,
        statistics: &mut [ImageStatistics],
        (start, passes_sigma_m): (Option<&Start>, &[f64]),
        look_alikes: &LookAlikes,
    ) -> Estimate {
        let located = match self {
            Self::Initialized(target) => {
                let start = start.expect("check_start accepted the start");
                target.locate(instant, start, passes_sigma_m)
            }
            Self::Detected(target) => target.locate(instant, statistics, look_alikes),
        };
        Estimate {
            kinematics: located.kinematics.map(|known| StateEstimate {
                velocity_mps: None,
                ..known
            }),
            ..located
        }
    }

    /// Returns the log-likelihood ratio of a camera's latest frame in nats, the mean over the posterior.
    pub(super) fn log_likelihood_ratio(&self, camera: usize) -> f64 {
        match self {
            Self::Detected(target) => target.log_likelihood_ratio(camera),
            Self::Initialized(target) => target.log_likelihood_ratio(camera),
        }
    }
}
