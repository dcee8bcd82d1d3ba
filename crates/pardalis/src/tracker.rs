//! Tracking: frames in, estimates out, for any number of cameras and targets.

use crate::color::ColorModel;
use crate::filter::{Filter, FilterSettings, GaussianStart, StateEstimate, Update};
use crate::likelihood::{ContourCue, ContourSettings};
use crate::rng::Draws;
use crate::shape::Shape;
use crate::simd::Level;
use crate::start::Start;
use crate::view::View;
use crate::{Error, Frame};

/// What a target is and how it is tracked.
#[derive(Debug, Clone)]
pub struct TargetSettings {
    /// Its shape.
    pub shape: Shape,
    /// Its colours.
    pub colors: ColorModel,
    /// How its contour is compared with the image.
    pub contour: ContourSettings,
    /// Its filter.
    pub filter: FilterSettings,
    /// Where its particles start.
    pub start: Start,
}

/// What the tracker knows of a target's whereabouts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TrackState {
    /// Not started yet.
    Searching,
    /// Seen.
    Tracking,
    /// No particle is more likely than pure background (out of view or masked, say): the motion model alone carries the estimate.
    Occluded,
    /// Every particle is impossible: there is no estimate.
    Lost,
}

impl TrackState {
    /// The word for it in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Searching => "searching",
            Self::Tracking => "tracking",
            Self::Occluded => "occluded",
            Self::Lost => "lost",
        }
    }
}

/// What is known of one target at one instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Estimate {
    /// Whether there is a state.
    pub state: TrackState,
    /// Position, velocity, covariance; only while tracking or occluded.
    pub kinematics: Option<StateEstimate>,
    /// While there is a state: the share of the particles' weight within one diameter of the position, the filter's own belief
    /// that the target is there.
    pub confidence: f64,
}

/// What became of the frames of one instant.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Observed {
    /// They were used.
    Used,
    /// They have the time stamp of the frames before and tell nothing new: they were not weighed a second time.
    Repeated,
    /// They are older than the frames before and were left out.
    Late,
}

struct Target {
    shape: Shape,
    cue: ContourCue,
    start: Start,
    draws: Draws,
    filter: Filter,
    /// Whether it has seen its first frames.
    started: bool,
    state: TrackState,
}

/// Tracks targets through cameras.
pub struct Tracker {
    views: Vec<View>,
    targets: Vec<Target>,
    time_s: Option<f64>,
}

impl Tracker {
    /// A tracker of these targets through these cameras. The same seed and frames give the same estimates, whatever the number of threads.
    pub fn new(
        views: Vec<View>,
        targets: Vec<TargetSettings>,
        seed: u32,
        level: Level,
    ) -> Result<Self, Error> {
        let targets = targets
            .into_iter()
            .enumerate()
            .map(|(number, settings)| {
                let draws = Draws::new(seed, number as u32);
                let start = match &settings.start {
                    Start::Gaussian(start) => *start,
                    Start::Pixel(start) => {
                        start.check()?;
                        let view = views.get(start.camera).ok_or_else(|| {
                            Error::out_of_range("camera", start.camera, "a camera of the tracker")
                        })?;
                        start.check_in(view)?;
                        // Known with the first frame; until then the particles lie at the origin.
                        GaussianStart::default()
                    }
                };
                Ok(Target {
                    shape: settings.shape,
                    cue: ContourCue::new(
                        settings.contour,
                        settings.shape,
                        &settings.colors,
                        level,
                    )?,
                    filter: Filter::new(settings.filter, &start, draws, level)?,
                    start: settings.start,
                    draws,
                    started: false,
                    state: TrackState::Searching,
                })
            })
            .collect::<Result<_, Error>>()?;
        Ok(Self {
            views,
            targets,
            time_s: None,
        })
    }

    /// The cameras.
    pub fn views(&self) -> &[View] {
        &self.views
    }

    /// The time of the last frames, in seconds.
    pub fn time_s(&self) -> Option<f64> {
        self.time_s
    }

    /// The filter of a target, once it has started.
    pub fn filter(&self, target: usize) -> Option<&Filter> {
        let target = &self.targets[target];
        target.started.then_some(&target.filter)
    }

    /// Takes the frames of one instant, each with its camera's number. Fails only on an image whose size is not its camera's; nothing
    /// has changed then.
    pub fn observe(&mut self, frames: &[(usize, Frame)], time_s: f64) -> Result<Observed, Error> {
        let dt_s = self.time_s.map_or(0.0, |before| time_s - before);
        if dt_s < 0.0 {
            return Ok(Observed::Late);
        }
        if self.time_s.is_some() && dt_s == 0.0 {
            return Ok(Observed::Repeated);
        }
        for (camera, frame) in frames {
            for target in &self.targets {
                self.views[*camera].prepare(frame, target.cue.palette())?;
            }
        }
        for target in &mut self.targets {
            target.observe(&self.views, frames, dt_s);
        }
        self.time_s = Some(time_s);
        Ok(Observed::Used)
    }

    /// What is known of a target at this time, at or after the last frames; nothing changes.
    pub fn estimate_at(&self, target: usize, time_s: f64) -> Estimate {
        let Target {
            filter,
            state,
            shape,
            ..
        } = &self.targets[target];
        let ahead_s = self.time_s.map_or(0.0, |before| time_s - before);
        match state {
            TrackState::Tracking | TrackState::Occluded => {
                let kinematics = filter.estimate(ahead_s);
                let confidence = filter.weight_within(kinematics.position_m, shape.diameter_m());
                Estimate {
                    state: *state,
                    kinematics: Some(kinematics),
                    confidence,
                }
            }
            TrackState::Searching | TrackState::Lost => Estimate {
                state: *state,
                kinematics: None,
                confidence: 0.0,
            },
        }
    }
}

impl Target {
    /// One step: predict, or start with the first frames, then weigh.
    fn observe(&mut self, views: &[View], frames: &[(usize, Frame)], dt_s: f64) {
        let Self { filter, cue, .. } = self;
        if self.started {
            filter.predict(dt_s);
        } else if let Start::Pixel(start) = &self.start {
            if frames.iter().all(|(camera, _)| *camera != start.camera) {
                // The clicked camera has no frame yet.
                return;
            }
            filter.restart(&start.search(
                &views[start.camera],
                &mut cue.of(views, frames),
                filter.motion().is_planar(),
                self.draws,
            ));
        }
        self.started = true;
        let update = filter.update(&mut cue.of(views, frames));
        let background = frames.len() as f64 * cue.settings().background_log_likelihood();
        self.state = match update {
            Update::AllImpossible => TrackState::Lost,
            Update::Weighted if f64::from(filter.best_log_likelihood()) <= background + 1e-3 => {
                TrackState::Occluded
            }
            Update::Weighted => TrackState::Tracking,
        };
    }
}
