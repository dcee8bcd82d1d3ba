//! One body: a filter of its own, its cues, and what the cameras say of it.

use super::{BodySettings, Estimate, TrackState};
use crate::Frame;
use crate::likelihood::Cues;
use crate::shape::Shape;
use crate::start::{PixelStart, Start};
use crate::view::View;
use pardalis_core::Error;
use pardalis_core::rng::Draws;
use pardalis_core::simd::Level;
use pardalis_filter::estimate::StateEstimate;
use pardalis_filter::gaussian::{GaussianStart, diagonal_m2};
use pardalis_filter::particle_filter::{ParticleFilter, Update};

/// How long a camera's last word on whether a particle is seen holds, in seconds, while other cameras go on without it.
const WORD_HOLDS_S: f64 = 0.5;

/// A camera's last word on a body.
#[derive(Debug, Clone, Copy)]
struct Word {
    time_s: f64,
    /// Whether any particle was more likely than pure background.
    sees: bool,
}

/// A target of one body, or a landmark of one of several.
pub(super) struct Body {
    shape: Shape,
    pub(super) cues: Cues,
    pub(super) start: Start,
    draws: Draws,
    pub(super) filter: ParticleFilter,
    /// Whether it has seen its first frames.
    pub(super) started: bool,
    /// Where it starts anew with its next frames, and the time in seconds for which that holds.
    pub(super) handed_over: Option<(GaussianStart, f64)>,
    pub(super) state: TrackState,
    /// One a camera.
    words: Vec<Option<Word>>,
}

impl Body {
    /// A body that is tracked through these cameras.
    pub(super) fn new(
        settings: &BodySettings,
        draws: Draws,
        views: &[View],
        level: Level,
    ) -> Result<Self, Error> {
        let start = match &settings.start {
            Start::Gaussian(start) => *start,
            Start::Pixel(start) => {
                super::check_pixel(start, views)?;
                // Known with the first frame; until then the particles lie at the origin.
                GaussianStart::default()
            }
            Start::Anywhere => {
                let allowed = "a position or a pixel; only the edge cue finds its target by itself";
                return Err(Error::out_of_range("start", "anywhere", allowed));
            }
        };
        Ok(Self {
            shape: settings.shape,
            cues: Cues::new(
                &settings.cues,
                settings.shape,
                settings.colors.as_ref(),
                level,
            )?,
            filter: ParticleFilter::new(settings.filter, &start, draws, level)?,
            start: settings.start,
            draws,
            started: false,
            handed_over: None,
            state: TrackState::Searching,
            words: vec![None; views.len()],
        })
    }

    /// One step: predict, or start with the first frames, then weigh.
    pub(super) fn observe(
        &mut self,
        views: &[View],
        frames: &[(usize, Frame)],
        time_s: f64,
        dt_s: f64,
    ) {
        if let Some((start, since_s)) = self.handed_over.take() {
            self.filter.start_over(&start);
            if time_s > since_s {
                self.filter.predict(time_s - since_s);
            }
        } else if self.started {
            self.filter.predict(dt_s);
        } else if let Start::Pixel(start) = self.start {
            let Some(found) = self.search(views, frames, &start) else {
                return;
            };
            self.filter.restart(&found);
        }
        self.weigh(views, frames, time_s);
    }

    /// Looks along the ray of a pixel; nothing where its camera has no frame yet.
    fn search(
        &mut self,
        views: &[View],
        frames: &[(usize, Frame)],
        start: &PixelStart,
    ) -> Option<GaussianStart> {
        frames.iter().find(|(camera, _)| *camera == start.camera)?;
        Some(start.search(
            &views[start.camera],
            &mut self.cues.of(views, frames),
            self.filter.motion().is_planar(),
            match self.shape {
                Shape::Flat(flat) => Some(flat.height_m),
                _ => None,
            },
            self.draws,
            self.filter.observation(),
        ))
    }

    /// Weighs the particles by the frames and says what that tells.
    fn weigh(&mut self, views: &[View], frames: &[(usize, Frame)], time_s: f64) {
        self.started = true;
        let update = self.filter.update(&mut self.cues.of(views, frames));
        for &(camera, _) in frames {
            let of_camera = self.cues.log_likelihoods_of(camera);
            let best = of_camera.iter().copied().fold(f32::NEG_INFINITY, f32::max);
            let background = self.cues.background_log_likelihood(camera);
            self.words[camera] = Some(Word {
                time_s,
                sees: f64::from(best) > background + 1e-3,
            });
        }
        let sees = |word: &Word| word.sees && time_s - word.time_s <= WORD_HOLDS_S;
        self.state = match update {
            Update::AllImpossible => TrackState::Lost,
            Update::Weighted if self.words.iter().flatten().any(sees) => TrackState::Tracking,
            Update::Weighted => TrackState::Occluded,
        };
    }

    /// How many nats more likely than pure background a camera's frame, which was weighed last, is in the mean over the posterior.
    pub(super) fn evidence_nats(&self, camera: usize) -> f64 {
        let of_camera = self.cues.log_likelihoods_of(camera);
        let background = self.cues.background_log_likelihood(camera);
        of_camera
            .iter()
            .zip(self.filter.weights())
            // Impossible particles have no weight.
            .filter(|&(_, &weight)| weight > 0.0)
            .map(|(&log, weight)| weight * (f64::from(log) - background))
            .sum()
    }

    /// Where these frames alone say that it is; nothing where they do not show it.
    pub(super) fn locate(
        &mut self,
        views: &[View],
        frames: &[(usize, Frame)],
        time_s: f64,
        start: &Start,
        passes_sigma_m: &[f64],
    ) -> Option<StateEstimate> {
        self.words.fill(None);
        self.state = TrackState::Searching;
        let mut around_m = match start {
            Start::Gaussian(start) => start.position_m,
            Start::Pixel(start) => self.search(views, frames, start)?.position_m,
            Start::Anywhere => return None,
        };
        let mut found = None;
        for &sigma_m in passes_sigma_m {
            self.filter.start_over(&GaussianStart {
                position_m: around_m,
                covariance_m2: diagonal_m2([sigma_m; 3]),
                ..GaussianStart::default()
            });
            self.weigh(views, frames, time_s);
            if self.state != TrackState::Tracking {
                return None;
            }
            let estimate = self.filter.estimate(0.0);
            around_m = estimate.position_m;
            found = Some(estimate);
        }
        found.map(|estimate| StateEstimate {
            velocity_mps: None,
            ..estimate
        })
    }

    /// What is known of it so many seconds after the last frames; nothing changes.
    pub(super) fn estimate(&self, ahead_s: f64) -> Estimate {
        let is_known = matches!(self.state, TrackState::Tracking | TrackState::Occluded);
        self.estimate_of(is_known.then(|| self.filter.estimate(ahead_s)))
    }

    /// What is known of it where this is its state.
    pub(super) fn estimate_of(&self, kinematics: Option<StateEstimate>) -> Estimate {
        let diameter_m = self.shape.diameter_m();
        let confidence = |k: StateEstimate| self.filter.weight_within(k.position_m, diameter_m);
        Estimate {
            state: self.state,
            kinematics,
            heading_rad: None,
            confidence: kinematics.map_or(0.0, confidence),
        }
    }
}
