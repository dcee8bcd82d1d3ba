//! Members of a crowd: any number of targets that look alike, each of which has a number from when it is found until it is gone.
//!
//! A crowd is a labelled multi-Bernoulli filter (Reuter, Vo, Vo and Dietmayer 2014, "The labeled multi-Bernoulli filter"): one Bernoulli filter per member. Those that are certain see the frames
//! first, and what they explain is left out of what the others see. New members appear only where none that is known explains the frames.

use super::TrackState;
use super::track::Track;
use crate::view::View;
use pardalis_filter::bernoulli::BernoulliFilter;

/// A body with less than this probability of existence is nobody. Hand-set.
pub(super) const LEAST_EXISTENCE: f64 = 0.01;

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

/// State, position and existence of a body after an update.
pub(super) struct Known {
    state: TrackState,
    /// Metres.
    position_m: Option<[f64; 3]>,
    pub(super) existence: f64,
}

impl Known {
    pub(super) fn of(track: &Track, filter: &BernoulliFilter) -> Self {
        Self {
            state: track.state(),
            position_m: filter.estimate(0.0).map(|known| known.position_m),
            existence: filter.existence(),
        }
    }
}

/// What became of the place of a member.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Change {
    None,
    /// Somebody was found.
    Found,
    /// Who was there is gone.
    Gone,
}

impl Member {
    /// Its number, from 1; `None` while there is nobody.
    pub(super) fn number(&self) -> Option<u32> {
        self.number
    }

    /// Gives a member that has been found its number, the next one of its crowd, and forgets one that is gone: lost for too long, or out of view
    /// of all cameras.
    pub(super) fn update(
        &mut self,
        known: &Known,
        next_number: &mut u32,
        (views, time_s): (&[View], f64),
    ) -> Change {
        match (self.number, known.state) {
            (None, TrackState::Tracking) => {
                self.number = Some(*next_number);
                *next_number = next_number.saturating_add(1);
                Change::Found
            }
            (Some(_), TrackState::Lost) => {
                let lost_s = *self.lost_s.get_or_insert(time_s);
                let is_in_view =
                    |position_m: [f64; 3]| views.iter().any(|view| view.holds(position_m));
                let is_here = known.position_m.is_some_and(is_in_view)
                    && known.existence >= GONE_EXISTENCE
                    && time_s - lost_s <= GONE_AFTER_S;
                if is_here {
                    return Change::None;
                }
                *self = Self::default();
                Change::Gone
            }
            _ => {
                self.lost_s = None;
                Change::None
            }
        }
    }
}
