//! The tracker of one body, in one of two ways: detected by the tracker itself, or initialised and then tracked by the published cues.

use super::Estimate;
use super::detected::{DetectedTarget, LookAlikes};
use super::initialized::InitializedTarget;
use super::settings::BodySettings;
use super::statistics::ImageStatistics;
use super::track::{Instant, Track};
use crate::Frame;
use crate::start::Start;
use crate::view::View;
use pardalis_core::Error;
use pardalis_core::rng::Draws;
use pardalis_core::simd::Level;
use pardalis_filter::Particles;
use pardalis_filter::estimate::StateEstimate;

/// The tracker of a target of one body, or of a landmark.
pub(super) enum TargetTracker {
    /// It detects the target itself.
    Detected(Box<DetectedTarget>),
    /// The published cues track it from a given start.
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

    /// Makes sure that a frame of the view, of its size, can be looked up.
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

    /// Updates what was predicted with the frames of one instant.
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

    /// Estimates the body `ahead_s` seconds after the latest frames; nothing changes.
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

    /// Where it starts, if that is known.
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

    /// Whether it compares a camera's frame with the one before ([`View::keep`]).
    pub(super) fn compares_frames(&self) -> bool {
        match self {
            Self::Detected(_) => false,
            Self::Initialized(target) => target.cues.compare_frames(),
        }
    }

    /// Its position in metres, if that is known.
    pub(super) fn position_m(&self) -> Option<[f64; 3]> {
        let known = self.estimate(0.0).kinematics;
        known.map(|known| known.position_m)
    }

    /// Sets where the other landmarks of its target are. Initialised targets need no hint.
    pub(super) fn set_other_landmarks(&mut self, others_m: impl Iterator<Item = [f64; 3]>) {
        if let Self::Detected(target) = self {
            target.set_other_landmarks(others_m);
        }
    }

    /// The target, if it is detected.
    pub(super) fn detected(&self) -> Option<&DetectedTarget> {
        match self {
            Self::Detected(target) => Some(target),
            Self::Initialized(_) => None,
        }
    }

    /// The confidence by which look-alikes are ordered.
    pub(super) fn rank(&self) -> f64 {
        self.detected().map_or(0.0, DetectedTarget::confidence)
    }

    /// Whether both are detected and no image tells them apart.
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

    /// Returns an error if single images cannot be located from this start.
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

    /// Locates the body in these frames alone. A detected target was reset before and needs neither start nor passes.
    pub(super) fn locate(
        &mut self,
        instant: &Instant,
        statistics: &mut [ImageStatistics],
        (start, passes_sigma_m): (Option<&Start>, &[f64]),
        look_alikes: &LookAlikes,
    ) -> Estimate {
        let located = match self {
            Self::Initialized(target) => {
                let start = start.expect("starts are checked before");
                target.locate(instant, start, passes_sigma_m)
            }
            Self::Detected(target) => {
                target.predict(instant.time_s, 0.0);
                target.observe(instant, statistics, look_alikes);
                target.estimate(0.0)
            }
        };
        Estimate {
            kinematics: located.kinematics.map(|known| StateEstimate {
                velocity_mps: None,
                ..known
            }),
            ..located
        }
    }

    /// The mean log-likelihood ratio of a camera's latest frame over the posterior, in nats.
    pub(super) fn log_likelihood_ratio(&self, camera: usize) -> f64 {
        match self {
            Self::Detected(target) => target.log_likelihood_ratio(camera),
            Self::Initialized(target) => target.log_likelihood_ratio(camera),
        }
    }
}
