//! Members of a crowd: any number of targets that look alike, each of which has a number from when it is found until it is gone.
//!
//! A crowd is a labelled multi-Bernoulli filter (Reuter, Vo, Vo and Dietmayer 2014, "The labeled multi-Bernoulli filter"): one Bernoulli filter per member. Those that are certain see the frames
//! first, and what they explain is left out of what the others see. New members appear only where none that is known explains the frames.

use super::{DetectedTarget, TrackState};
use crate::view::View;
use pardalis_filter::estimate::StateEstimate;

/// A body with less than this probability of existence is nobody. Hand-set.
const LEAST_EXISTENCE: f64 = 0.01;

/// A lost member with less than this probability of existence is gone, ...
const GONE_EXISTENCE: f64 = 0.1;

/// ... and so is one that has been lost for longer than this, seconds. Hand-set: what comes back later is likelier somebody else.
const GONE_AFTER_S: f64 = 3.0;

/// The place of one member of a crowd.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Member {
    /// Its number, from 1; `None` while there is nobody.
    number: Option<u32>,
    /// When it was lost, seconds.
    lost_s: Option<f64>,
}

impl DetectedTarget {
    /// Makes it the place of a member of a crowd.
    pub(in crate::tracker) fn join_crowd(&mut self) {
        self.member = Some(Member::default());
        self.detector.candidates.leaves_found = true;
        self.detector.is_of_crowd = true;
    }

    /// The number of the member of the crowd.
    pub(in crate::tracker) fn number(&self) -> Option<u32> {
        self.member?.number
    }

    /// Whether there is nobody, nor probably anybody.
    pub(in crate::tracker) fn is_free(&self) -> bool {
        self.member.is_some()
            && self.number().is_none()
            && self.filter.existence() < LEAST_EXISTENCE
    }

    /// Takes the buffers with which whole images are searched from another place of the same crowd.
    pub(in crate::tracker) fn take_search(&mut self, other: &mut Self) {
        std::mem::swap(
            &mut self.detector.candidates,
            &mut other.detector.candidates,
        );
    }

    /// Gives a member that has been found its number, the next one of its crowd, and forgets one that is gone: lost for too long, or out of view
    /// of all cameras.
    pub(in crate::tracker) fn update_member(
        &mut self,
        next_number: &mut u32,
        (views, time_s): (&[View], f64),
    ) {
        let Some(mut member) = self.member else {
            return;
        };
        match (member.number, self.track.state()) {
            (None, TrackState::Tracking) => {
                member.number = Some(*next_number);
                *next_number = next_number.saturating_add(1);
                self.set_births(0.0, 0.0);
            }
            (Some(_), TrackState::Lost) => {
                let lost_s = *member.lost_s.get_or_insert(time_s);
                let is_in_view = |known: StateEstimate| {
                    let mut views = views.iter();
                    views.any(|view| view.holds(known.position_m))
                };
                let is_here = self.filter.estimate(0.0).is_some_and(is_in_view)
                    && self.filter.existence() >= GONE_EXISTENCE
                    && time_s - lost_s <= GONE_AFTER_S;
                if !is_here {
                    member = Member::default();
                    self.reset();
                    self.track.set_started();
                }
            }
            _ => member.lost_s = None,
        }
        self.member = Some(member);
    }

    /// Becomes nobody.
    pub(super) fn leave_crowd(&mut self) {
        if let Some(member) = &mut self.member {
            *member = Member::default();
            let rates = self.existence;
            self.set_births(rates.birth_rate_hz, rates.relocation_rate_hz);
        }
    }

    /// Somebody who is known does not appear anew elsewhere: that would be another member.
    fn set_births(&mut self, birth_rate_hz: f64, relocation_rate_hz: f64) {
        self.filter
            .set_births(birth_rate_hz, relocation_rate_hz)
            .expect("rates are checked before");
    }
}
