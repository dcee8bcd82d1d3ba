//! A body as a member of a crowd.

use super::DetectedTarget;
use crate::tracker::member::{Change, Known, LEAST_EXISTENCE, Member};
use crate::view::View;

impl DetectedTarget {
    /// Makes it the place of a member of a crowd.
    pub(in crate::tracker) fn join_crowd(&mut self) {
        self.member = Some(Member::default());
        self.detector.candidates.leaves_found = true;
        self.detector.is_of_crowd = true;
    }

    /// The number of the member of the crowd.
    pub(in crate::tracker) fn number(&self) -> Option<u32> {
        self.member?.number()
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

    /// Updates who it is after it has seen the frames of an instant.
    pub(in crate::tracker) fn update_member(
        &mut self,
        next_number: &mut u32,
        (views, time_s): (&[View], f64),
    ) {
        let known = Known::of(&self.track, &self.filter);
        let Some(member) = &mut self.member else {
            return;
        };
        match member.update(&known, next_number, (views, time_s)) {
            Change::None => {}
            Change::Found => self.set_births(0.0, 0.0),
            Change::Gone => {
                self.reset();
                self.track.set_started();
            }
        }
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
