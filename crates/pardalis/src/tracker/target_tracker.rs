//! The tracker of one body: detected by the tracker itself, initialised and tracked by the published cues, or detected by another program.

use super::boxed::BoxedTarget;
use super::candidate::Candidate;
use super::detected::{DetectedTarget, LookAlikes};
use super::initialized::InitializedTarget;
use super::measurements::Measurements;
use super::settings::BodySettings;
use super::statistics::ImageStatistics;
use super::track::{Instant, Track};
use super::{BodyMeasurement, Estimate};
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
    /// Tracks the target by boxes of another program.
    Boxed(Box<BoxedTarget>),
}

impl TargetTracker {
    /// The tracker of a body of the target with this number.
    pub(super) fn new(
        settings: &BodySettings,
        target: usize,
        draws: Draws,
        views: &[View],
        level: Level,
    ) -> Result<Self, Error> {
        Ok(match settings {
            BodySettings::Detected(settings) => Self::Detected(Box::new(DetectedTarget::new(
                settings, target, draws, views, level,
            )?)),
            BodySettings::Initialized(settings) => {
                let target = InitializedTarget::new(settings, draws, views, level)?;
                Self::Initialized(Box::new(target))
            }
            BodySettings::Boxed(settings) => {
                let target = BoxedTarget::new(settings, target, draws, views)?;
                Self::Boxed(Box::new(target))
            }
        })
    }

    /// Prepares the look-up tables that the body needs for a frame of the view's size.
    pub(super) fn prepare(&self, view: &mut View, frame: &Frame) {
        match self {
            Self::Detected(target) => target.prepare(view, frame),
            Self::Initialized(target) => target.cues.prepare(view, frame),
            Self::Boxed(_) => {}
        }
    }

    /// Predicts to the time of the next frames, `dt_s` seconds after the latest ones.
    pub(super) fn predict(&mut self, time_s: f64, dt_s: f64) {
        match self {
            Self::Detected(target) => target.predict(time_s, dt_s),
            Self::Initialized(target) => target.predict(time_s, dt_s),
            Self::Boxed(target) => target.predict(time_s, dt_s),
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
            Self::Boxed(target) => target.observe(instant, look_alikes),
        }
    }

    /// Predicts the body `ahead_s` seconds after the latest frames, without changing it.
    pub(super) fn estimate(&self, ahead_s: f64) -> Estimate {
        match self {
            Self::Detected(target) => target.estimate(ahead_s),
            Self::Initialized(target) => target.estimate(ahead_s),
            Self::Boxed(target) => target.estimate(ahead_s),
        }
    }

    pub(super) fn track(&self) -> &Track {
        match self {
            Self::Detected(target) => &target.track,
            Self::Initialized(target) => &target.track,
            Self::Boxed(target) => &target.track,
        }
    }

    pub(super) fn track_mut(&mut self) -> &mut Track {
        match self {
            Self::Detected(target) => &mut target.track,
            Self::Initialized(target) => &mut target.track,
            Self::Boxed(target) => &mut target.track,
        }
    }

    /// What other sensors measure of it. Nobody measures an initialised body.
    pub(super) fn measurements(&self) -> Option<&Measurements> {
        match self {
            Self::Detected(target) => Some(&target.others),
            Self::Boxed(target) => Some(&target.others),
            Self::Initialized(_) => None,
        }
    }

    pub(super) fn measurements_mut(&mut self) -> Option<&mut Measurements> {
        match self {
            Self::Detected(target) => Some(&mut target.others),
            Self::Boxed(target) => Some(&mut target.others),
            Self::Initialized(_) => None,
        }
    }

    /// Whether its motion model has a velocity that can be measured.
    pub(super) fn has_velocity(&self) -> bool {
        match self {
            Self::Detected(target) => target.has_velocity(),
            Self::Boxed(target) => target.has_velocity(),
            Self::Initialized(_) => false,
        }
    }

    /// Moves the body's estimate, which is of a time in seconds, to another world frame.
    pub(super) fn move_world(&mut self, now_from_before: &Pose, time_s: f64) {
        let estimate = self.estimate(0.0);
        if let Some(known) = &estimate.kinematics {
            let start = GaussianStart::from_estimate(known).moved(now_from_before);
            self.track_mut().reinitialize(&start, time_s);
        }
    }

    /// Returns the given start, if any.
    pub(super) fn start(&self) -> Option<Start> {
        match self {
            Self::Detected(target) => target.start().copied().map(Start::Gaussian),
            Self::Initialized(target) => Some(*target.start()),
            Self::Boxed(target) => target.start().copied().map(Start::Gaussian),
        }
    }

    pub(super) fn particles(&self) -> &Particles {
        match self {
            Self::Detected(target) => target.particles(),
            Self::Initialized(target) => target.particles(),
            Self::Boxed(target) => target.particles(),
        }
    }

    /// Returns what was examined in the latest frames; nothing for an initialised target, which is not searched for.
    pub(super) fn candidates(&self) -> &[Candidate] {
        match self {
            Self::Detected(target) => target.candidates(),
            Self::Boxed(target) => target.candidates(),
            Self::Initialized(_) => &[],
        }
    }

    /// Reports whether it compares a camera's frame with the previous one ([`View::keep`]).
    pub(super) fn compares_frames(&self) -> bool {
        match self {
            Self::Detected(_) | Self::Boxed(_) => false,
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
            Self::Initialized(_) | Self::Boxed(_) => None,
        }
    }

    /// Returns the number of the target whose boxes it takes.
    pub(super) fn boxed_target(&self) -> Option<usize> {
        match self {
            Self::Boxed(target) => Some(target.target()),
            Self::Detected(_) | Self::Initialized(_) => None,
        }
    }

    /// Returns what it claims of the box with this number, as a ratio to clutter.
    pub(super) fn claim(&self, number: usize) -> f64 {
        match self {
            Self::Boxed(target) => target.claim(number),
            Self::Detected(_) | Self::Initialized(_) => 0.0,
        }
    }

    /// Notes what it claims of an instant's boxes before any of those that look like it is updated.
    pub(super) fn claim_predicted(&mut self, instant: &Instant) {
        if let Self::Boxed(target) = self {
            target.claim_predicted(instant);
        }
    }

    /// Returns what the latest frames say of the body by themselves.
    pub(super) fn measurement(&self) -> Option<BodyMeasurement> {
        match self {
            Self::Detected(target) => target.measurement(),
            Self::Boxed(target) => target.measurement(),
            Self::Initialized(_) => None,
        }
    }

    /// Staggers its searches of whole images with those of other bodies, given its number among them. Only detected bodies search.
    pub(super) fn stagger_searches(&mut self, number: usize) {
        if let Self::Detected(target) = self {
            target.stagger_searches(number);
        }
    }

    /// Makes it the place of a member of a crowd. Initialised bodies cannot be.
    pub(super) fn join_crowd(&mut self) {
        match self {
            Self::Detected(target) => target.join_crowd(),
            Self::Boxed(target) => target.join_crowd(),
            Self::Initialized(_) => {}
        }
    }

    /// Takes what is searched for all members of a crowd from another place of the same crowd.
    pub(super) fn take_search(&mut self, from: &mut Self) {
        match (self, from) {
            (Self::Detected(to), Self::Detected(from)) => to.take_search(from),
            (Self::Boxed(to), Self::Boxed(from)) => to.take_boxes(from),
            _ => {}
        }
    }

    /// Updates who of a crowd it is after the frames of an instant, given the number of whoever is found next.
    pub(super) fn update_member(&mut self, next_number: &mut u32, instant: (&[View], f64)) {
        match self {
            Self::Detected(target) => target.update_member(next_number, instant),
            Self::Boxed(target) => target.update_member(next_number, instant),
            Self::Initialized(_) => {}
        }
    }

    /// Forgets what was examined in earlier frames.
    pub(super) fn forget_candidates(&mut self) {
        match self {
            Self::Detected(target) => target.forget_candidates(),
            Self::Boxed(target) => target.forget_candidates(),
            Self::Initialized(_) => {}
        }
    }

    /// Returns the number of the member of a crowd that it is.
    pub(super) fn number(&self) -> Option<u32> {
        match self {
            Self::Detected(target) => target.number(),
            Self::Boxed(target) => target.number(),
            Self::Initialized(_) => None,
        }
    }

    /// Returns whether it is the place of a member of a crowd, and there is nobody.
    pub(super) fn is_free(&self) -> bool {
        match self {
            Self::Detected(target) => target.is_free(),
            Self::Boxed(target) => target.is_free(),
            Self::Initialized(_) => false,
        }
    }

    /// Returns the confidence by which look-alikes are ordered.
    pub(super) fn rank(&self) -> f64 {
        match self {
            Self::Detected(target) => target.confidence(),
            Self::Boxed(target) => target.confidence(),
            Self::Initialized(_) => 0.0,
        }
    }

    /// Reports whether both are found by the tracker or by boxes, and cannot be distinguished.
    pub(super) fn looks_like(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::Detected(target), Self::Detected(other)) => target.looks_like(other),
            (Self::Boxed(target), Self::Boxed(other)) => target.looks_like(other),
            _ => false,
        }
    }

    /// Forgets all frames and the start of a target that needs none.
    pub(super) fn reset(&mut self) {
        match self {
            Self::Detected(target) => target.reset(),
            Self::Boxed(target) => target.reset(),
            Self::Initialized(_) => {}
        }
    }

    /// Returns an error if the body cannot be located in single images from this start.
    pub(super) fn check_start(&self, start: Option<&Start>, views: &[View]) -> Result<(), Error> {
        match start {
            Some(Start::Gaussian(start)) => start.check(),
            Some(Start::Pixel(start)) => super::check_pixel(start, views),
            None if !matches!(self, Self::Initialized(_)) => Ok(()),
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
            Self::Boxed(target) => target.locate(instant, look_alikes),
        };
        Estimate {
            kinematics: located.kinematics.map(|known| StateEstimate {
                velocity_mps: None,
                velocity_covariance_m2ps2: None,
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
            Self::Boxed(target) => target.log_likelihood_ratio(camera),
        }
    }
}
