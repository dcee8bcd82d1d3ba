//! A body, followed by cues that are compared with it at every particle, or sought by the edge cue.

use super::body::Body;
use super::seeker::{Alike, Seeker};
use super::{BodySettings, Estimate};
use crate::Frame;
use crate::likelihood::Cue;
use crate::start::Start;
use crate::view::View;
use pardalis_core::Error;
use pardalis_core::rng::Draws;
use pardalis_core::simd::Level;
use pardalis_filter::Particles;
use pardalis_filter::estimate::StateEstimate;
use pardalis_filter::gaussian::GaussianStart;

/// A target of one body, or a landmark of one of several.
pub(super) enum Follower {
    /// By the published cues, from a given start.
    Given(Box<Body>),
    /// By the edge cue, from anywhere.
    Sought(Box<Seeker>),
}

impl Follower {
    pub(super) fn new(
        settings: &BodySettings,
        draws: Draws,
        views: &[View],
        level: Level,
    ) -> Result<Self, Error> {
        let edge = settings.cues.iter().find_map(|cue| match cue.cue {
            Cue::Edge(edge) => Some(edge),
            _ => None,
        });
        Ok(match edge {
            None => Self::Given(Box::new(Body::new(settings, draws, views, level)?)),
            Some(_) if settings.cues.len() > 1 => {
                let allowed = "the edge cue alone, or others without it";
                return Err(Error::out_of_range("cues", settings.cues.len(), allowed));
            }
            Some(edge) => Self::Sought(Box::new(Seeker::new(settings, edge, draws, views, level)?)),
        })
    }

    pub(super) fn start(&self) -> &Start {
        match self {
            Self::Given(body) => &body.start,
            Self::Sought(seeker) => &seeker.start,
        }
    }

    /// Whether it has seen its first frames.
    pub(super) fn started(&self) -> bool {
        match self {
            Self::Given(body) => body.started,
            Self::Sought(seeker) => seeker.started,
        }
    }

    pub(super) fn particles(&self) -> &Particles {
        match self {
            Self::Given(body) => body.filter.particles(),
            Self::Sought(seeker) => seeker.particles(),
        }
    }

    /// Starts it anew with its next frames, from what held at this time.
    pub(super) fn hand_over(&mut self, start: &GaussianStart, time_s: f64) {
        let handed_over = match self {
            Self::Given(body) => &mut body.handed_over,
            Self::Sought(seeker) => &mut seeker.handed_over,
        };
        *handed_over = Some((*start, time_s));
    }

    /// Whether it compares a camera's frame with the one before ([`View::keep`]).
    pub(super) fn compares_frames(&self) -> bool {
        match self {
            Self::Given(body) => body.cues.compare_frames(),
            Self::Sought(_) => false,
        }
    }

    /// Makes sure that a frame of the view, of its size, can be looked up.
    pub(super) fn prepare(&self, view: &mut View, frame: &Frame) {
        match self {
            Self::Given(body) => body.cues.prepare(view, frame),
            Self::Sought(seeker) => seeker.prepare(view, frame),
        }
    }

    /// Where it is, if that is known.
    pub(super) fn place_m(&self) -> Option<[f64; 3]> {
        let known = self.estimate(0.0).kinematics;
        known.map(|known| known.position_m)
    }

    /// Tells it where the other landmarks of its target are. What is given a start needs no hint.
    pub(super) fn know_others(&mut self, others_m: impl Iterator<Item = [f64; 3]>) {
        if let Self::Sought(seeker) = self {
            seeker.others_m.clear();
            seeker.others_m.extend(others_m);
        }
    }

    /// What is sought, among others alike perhaps.
    pub(super) fn seeker(&self) -> Option<&Seeker> {
        match self {
            Self::Given(_) => None,
            Self::Sought(seeker) => Some(seeker),
        }
    }

    /// Whether both are sought, and no image tells them apart.
    pub(super) fn looks_like(&self, other: &Self) -> bool {
        let both = self.seeker().zip(other.seeker());
        both.is_some_and(|(seeker, other)| seeker.looks_like(other))
    }

    /// The first half of a step of what is sought, so that others alike know where it is expected.
    pub(super) fn predict(&mut self, time_s: f64, dt_s: f64) {
        if let Self::Sought(seeker) = self {
            seeker.predict(time_s, dt_s);
        }
    }

    /// One step, or the second half of it.
    pub(super) fn observe(
        &mut self,
        views: &[View],
        frames: &[(usize, Frame)],
        (time_s, dt_s): (f64, f64),
        alike: &Alike,
    ) {
        match self {
            Self::Given(body) => body.observe(views, frames, time_s, dt_s),
            Self::Sought(seeker) => seeker.observe(views, frames, time_s, alike),
        }
    }

    /// Forgets what frames said of what is sought; where it starts, too.
    pub(super) fn forget(&mut self) {
        if let Self::Sought(seeker) = self {
            seeker.forget();
        }
    }

    /// Where these frames alone say that it is. What is sought, and was forgotten before, needs neither start nor passes.
    pub(super) fn locate(
        &mut self,
        views: &[View],
        frames: &[(usize, Frame)],
        time_s: f64,
        (start, passes_sigma_m): (&Start, &[f64]),
        alike: &Alike,
    ) -> Estimate {
        match self {
            Self::Given(body) => {
                let found = body.locate(views, frames, time_s, start, passes_sigma_m);
                body.estimate_of(found)
            }
            Self::Sought(seeker) => {
                seeker.predict(time_s, 0.0);
                seeker.observe(views, frames, time_s, alike);
                let found = seeker.estimate(0.0);
                Estimate {
                    kinematics: found.kinematics.map(|known| StateEstimate {
                        velocity_mps: None,
                        ..known
                    }),
                    ..found
                }
            }
        }
    }

    /// How many nats more likely than background a camera's last frame is, in the mean over the posterior.
    pub(super) fn evidence_nats(&self, camera: usize) -> f64 {
        match self {
            Self::Given(body) => body.evidence_nats(camera),
            Self::Sought(seeker) => seeker.evidence_nats(camera),
        }
    }

    /// What is known of it so many seconds after the last frames; nothing changes.
    pub(super) fn estimate(&self, ahead_s: f64) -> Estimate {
        match self {
            Self::Given(body) => body.estimate(ahead_s),
            Self::Sought(seeker) => seeker.estimate(ahead_s),
        }
    }
}
