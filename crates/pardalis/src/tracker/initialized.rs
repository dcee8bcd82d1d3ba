//! A body that the published cues track from a given start: a particle filter with the cues' likelihoods.

use super::settings::InitializedSettings;
use super::shown_colors::is_shown;
use super::track::{Instant, Track, mean_log_ratio};
use super::{Estimate, TrackState};
use crate::color::ColorModel;
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

/// A body is visible in a camera if the log-likelihood ratio of any particle against background exceeds this, in
/// nats. Hand-set: above the rounding of single precision.
const MIN_VISIBLE_NATS: f64 = 1e-3;

/// The probability that an image shows the body near a start at which it is to be located, before looking at the image. Hand-set: published cues have log-likelihood
/// ratios of 0 to 3 nats where nothing is, and of 3 to 25 at a ball.
const LOCATED_PRIOR: f64 = 0.1;

/// A body that the published cues track.
pub(super) struct InitializedTarget {
    pub(super) track: Track,
    shape: Shape,
    pub(super) cues: Cues,
    /// Its colours, if the cues know any.
    colors: Option<ColorModel>,
    start: Start,
    draws: Draws,
    filter: ParticleFilter,
}

impl InitializedTarget {
    /// Creates a body that is tracked through these cameras.
    pub(super) fn new(
        settings: &InitializedSettings,
        draws: Draws,
        views: &[View],
        level: Level,
    ) -> Result<Self, Error> {
        let start = match &settings.start {
            Start::Gaussian(start) => *start,
            Start::Pixel(start) => {
                super::check_pixel(start, views)?;
                // Determined in the first frame; until then the particles are at the origin.
                GaussianStart::default()
            }
        };
        Ok(Self {
            track: Track::new(views.len()),
            shape: settings.shape,
            cues: Cues::new(
                &settings.cues,
                settings.shape,
                settings.colors.as_ref(),
                level,
            )?,
            filter: ParticleFilter::new(settings.filter, &start, draws, level)?,
            colors: settings.colors.clone(),
            start: settings.start,
            draws,
        })
    }

    pub(super) fn start(&self) -> &Start {
        &self.start
    }

    pub(super) fn particles(&self) -> &pardalis_filter::Particles {
        self.filter.particles()
    }

    /// Predicts to the time of the next frames.
    pub(super) fn predict(&mut self, time_s: f64, dt_s: f64) {
        if let Some((start, since_s)) = self.track.take_reinitialization() {
            self.filter.start_over(&start);
            if time_s > since_s {
                self.filter.predict(time_s - since_s);
            }
            self.track.set_started();
        } else if self.track.has_started() {
            self.filter.predict(dt_s);
        }
    }

    /// Updates the prediction with the frames of one instant. A start in a pixel waits for a frame of its camera.
    pub(super) fn observe(&mut self, instant: &Instant) {
        if let (Start::Pixel(start), false) = (self.start, self.track.has_started()) {
            let Some(found) = self.search(instant, &start) else {
                return;
            };
            self.filter.restart(&found);
        }
        self.update(instant);
    }

    /// Searches along the ray of a pixel; `None` if its camera has no frame yet.
    fn search(&mut self, instant: &Instant, start: &PixelStart) -> Option<GaussianStart> {
        let mut frames = instant.frames.iter();
        frames.find(|(camera, _)| *camera == start.camera)?;
        Some(start.search(
            &instant.views[start.camera],
            &mut self.cues.of(instant.views, instant.frames),
            self.filter.motion().is_planar(),
            match self.shape {
                Shape::Flat(flat) => Some(flat.height_m),
                _ => None,
            },
            self.draws,
            self.filter.observation(),
        ))
    }

    /// Weights the particles by the frames and derives the track's state.
    fn update(&mut self, instant: &Instant) {
        self.track.set_started();
        let mut likelihood = self.cues.of(instant.views, instant.frames);
        let update = self.filter.update(&mut likelihood);
        for &(camera, _) in instant.frames {
            let of_camera = self.cues.log_likelihoods_of(camera);
            let best = of_camera.iter().copied().fold(f32::NEG_INFINITY, f32::max);
            let background = self.cues.background_log_likelihood(camera);
            let is_visible = f64::from(best) > background + MIN_VISIBLE_NATS;
            let visible = if is_visible { 1.0 } else { 0.0 };
            self.track
                .note_observation(camera, instant.time_s, [visible; 2]);
        }
        self.track.set_state(match update {
            Update::AllImpossible => TrackState::Lost,
            Update::Weighted if self.track.is_visible(instant.time_s) => TrackState::Tracking,
            Update::Weighted => TrackState::Occluded,
        });
    }

    /// Returns the log-likelihood ratio of a camera's latest frame against pure background in nats, the mean over the
    /// posterior.
    pub(super) fn log_likelihood_ratio(&self, camera: usize) -> f64 {
        let of_camera = self.cues.log_likelihoods_of(camera);
        let background = self.cues.background_log_likelihood(camera);
        mean_log_ratio(of_camera, self.filter.weights(), background)
    }

    /// Locates the body in these frames alone, in passes with these standard deviations in metres, the first around
    /// the start. Confidence includes the probability that the body is there at all. A body is lost where its colours, if they are
    /// known, are not, and where there is no outline, because its surroundings look the same.
    pub(super) fn locate(
        &mut self,
        instant: &Instant,
        start: &Start,
        passes_sigma_m: &[f64],
    ) -> Estimate {
        let mut found = self.locate_in_passes(instant, start, passes_sigma_m);
        if let Some(kinematics) = found
            && !is_shown(
                (&self.shape, self.colors.as_ref()),
                instant.views,
                instant.frames,
                kinematics.position_m,
            )
        {
            self.track.set_state(TrackState::Lost);
            found = None;
        }
        let located = self.estimate_of(found);
        let cameras = instant.frames.iter().map(|(camera, _)| *camera);
        let log_ratio: f64 = cameras
            .map(|camera| self.log_likelihood_ratio(camera))
            .sum();
        let odds_against = (1.0 - LOCATED_PRIOR) / LOCATED_PRIOR * libm::exp(-log_ratio);
        Estimate {
            confidence: located.confidence / (1.0 + odds_against),
            ..located
        }
    }

    fn locate_in_passes(
        &mut self,
        instant: &Instant,
        start: &Start,
        passes_sigma_m: &[f64],
    ) -> Option<StateEstimate> {
        self.track.forget_observations();
        let mut around_m = match start {
            Start::Gaussian(start) => start.position_m,
            Start::Pixel(start) => self.search(instant, start)?.position_m,
        };
        let mut found = None;
        for &sigma_m in passes_sigma_m {
            self.filter.start_over(&GaussianStart {
                position_m: around_m,
                covariance_m2: diagonal_m2([sigma_m; 3]),
                ..GaussianStart::default()
            });
            self.update(instant);
            if self.track.state() != TrackState::Tracking {
                return None;
            }
            let estimate = self.filter.estimate(0.0);
            around_m = estimate.position_m;
            found = Some(estimate);
        }
        found
    }

    /// Predicts the body `ahead_s` seconds after the latest frames, without changing it.
    pub(super) fn estimate(&self, ahead_s: f64) -> Estimate {
        let is_known = self.track.is_known();
        self.estimate_of(is_known.then(|| self.filter.estimate(ahead_s)))
    }

    fn estimate_of(&self, kinematics: Option<StateEstimate>) -> Estimate {
        let diameter_m = self.shape.diameter_m();
        let confidence = |k: StateEstimate| self.filter.weight_within(k.position_m, diameter_m);
        Estimate {
            state: self.track.state(),
            kinematics,
            heading_rad: None,
            heading_sigma_rad: None,
            radius: None,
            confidence: kinematics.map_or(0.0, confidence),
        }
    }
}
