//! A target: which bodies it has, and what the cameras contribute to it.

use std::ops::Range;

use super::candidate::{Candidate, Verdict};
use super::crowd::Crowd;
use super::target_tracker::TargetTracker;
use super::{CameraId, Estimate, FrameSet, TrackState, landmarks};
use crate::view::View;

/// The contribution of one camera to one target so far.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Contribution {
    /// Number of frames used.
    pub frames: usize,
    /// Number of frames in which the target is visible: their log-likelihood ratio exceeds [`VISIBLE_NATS`].
    pub visible_frames: usize,
    /// Number of frames in which the target is not visible although it is tracked and its place is on an unmasked pixel.
    pub blind_frames: usize,
    /// Number of frames that were searched as a whole while the target was tracked. Zero for crowds, and for targets with several landmarks, with a start that are not searched for, and that boxes detect.
    pub searched_frames: usize,
    /// Number of these that show something that looks as much like the target ([`Verdict::Rival`]), and not the target where it is tracked.
    pub elsewhere_frames: usize,
    /// Sum over all frames of the log-likelihood ratio against background, in nats. That of a frame is the mean over
    /// the posterior.
    pub log_likelihood_ratio: f64,
}

/// The log-likelihood ratio, in nats, above which the target is visible in a camera's frame. Hand-set.
pub const VISIBLE_NATS: f64 = 1.0;

/// A target of the tracker.
pub(super) struct Target {
    /// The indices of its body or landmarks.
    pub(super) bodies: Range<usize>,
    /// The front and the rear landmark, counted from the first of the target.
    pub(super) heading: Option<[usize; 2]>,
    /// If its bodies are members of a crowd.
    pub(super) crowd: Option<Crowd>,
    /// One per camera.
    pub(super) contributions: Vec<Contribution>,
}

impl Target {
    /// The estimate of the target, given those of its bodies.
    pub(super) fn combined(&self, bodies: impl ExactSizeIterator<Item = Estimate>) -> Estimate {
        if self.crowd.is_none() {
            return landmarks::combined(bodies, self.heading);
        }
        let rank = |estimate: &Estimate| (estimate.kinematics.is_some(), estimate.confidence);
        let likelier = |best: Estimate, next: Estimate| {
            if rank(&next) > rank(&best) {
                next
            } else {
                best
            }
        };
        let best = bodies.reduce(likelier);
        best.expect("a target has at least one body")
    }

    /// Adds the contributions of the cameras with these frames, once all bodies have started.
    pub(super) fn add_contributions(
        &mut self,
        bodies: &[TargetTracker],
        views: &[View],
        set: &FrameSet,
    ) {
        let is_crowd = self.crowd.is_some();
        let counts = |body: &&TargetTracker| !is_crowd || body.number().is_some();
        let all = || bodies.iter().filter(counts);
        if all().any(|body| !body.track().has_started()) {
            return;
        }
        for camera in cameras(bodies, set) {
            let of_bodies = || all().map(|body| body.log_likelihood_ratio(camera));
            let contribution = &mut self.contributions[camera];
            contribution.frames += 1;
            let mut visible = of_bodies().map(|nats| nats > VISIBLE_NATS);
            let is_visible = if is_crowd {
                visible.any(|is_visible| is_visible)
            } else {
                visible.all(|is_visible| is_visible)
            };
            let is_due = |body: &TargetTracker| {
                let estimate = body.estimate(0.0);
                let known = estimate
                    .kinematics
                    .filter(|_| estimate.state == TrackState::Tracking);
                known.is_some_and(|known| views[camera].holds(known.position_m))
            };
            contribution.visible_frames += usize::from(is_visible);
            let is_due = if is_crowd {
                all().any(is_due)
            } else {
                all().all(is_due)
            };
            contribution.blind_frames += usize::from(!is_visible && is_due);
            if let ([body], false) = (bodies, is_crowd)
                && body.track().state() == TrackState::Tracking
                && body.boxed_target().is_none()
            {
                let has_searched = searched(body, camera).next().is_some();
                let has_rival = searched(body, camera).any(|one| one.verdict == Verdict::Rival);
                contribution.searched_frames += usize::from(has_searched);
                contribution.elsewhere_frames += usize::from(has_rival && !is_visible);
            }
            contribution.log_likelihood_ratio += of_bodies().sum::<f64>();
        }
    }
}

/// What was examined in the whole image of a camera; nothing if it was not searched.
fn searched(body: &TargetTracker, camera: usize) -> impl Iterator<Item = &Candidate> {
    let candidates = body.candidates().iter();
    candidates.filter(move |one| one.origin.camera().map(CameraId::index) == Some(camera))
}

/// The cameras of a set in which a target with these bodies was searched for.
fn cameras<'s>(
    bodies: &[TargetTracker],
    set: &'s FrameSet,
) -> impl Iterator<Item = usize> + use<'s> {
    let number = bodies.first().and_then(TargetTracker::boxed_target);
    let frames = set.numbered().iter().map(|(camera, _)| *camera);
    let own = set
        .boxes()
        .iter()
        .filter(move |boxes| number == Some(boxes.target));
    let frames = frames.filter(move |_| number.is_none());
    frames.chain(own.map(|boxes| boxes.camera))
}
