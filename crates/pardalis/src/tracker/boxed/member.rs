//! A body as a member of a crowd.

use super::BoxedTarget;
use crate::tracker::member::{Change, Known, LEAST_EXISTENCE, Member};
use crate::view::View;

/// Who may be new to a crowd, but less likely than this, is nobody in a frame without a box. Hand-set: one box among clutter is less, two in a row are more.
const DOUBTFUL_EXISTENCE: f64 = 0.9;

impl BoxedTarget {
    /// Makes it the place of a member of a crowd.
    pub(in crate::tracker) fn join_crowd(&mut self) {
        self.member = Some(Member::default());
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

    /// Takes the boxes, and what they measure, from another place of the same crowd.
    pub(in crate::tracker) fn take_boxes(&mut self, other: &mut Self) {
        std::mem::swap(&mut self.buffers, &mut other.buffers);
    }

    /// Updates who it is after it has seen the boxes of an instant.
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
            Change::None => {
                let is_new = member.number().is_none() && known.existence > 0.0;
                if is_new && self.found.is_none() && known.existence < DOUBTFUL_EXISTENCE {
                    self.forget();
                }
            }
            Change::Found => self.set_births(0.0, 0.0),
            Change::Gone => self.forget(),
        }
    }

    /// Becomes nobody; the boxes of the instant are as before.
    fn forget(&mut self) {
        let time_s = self.buffers.time_s;
        self.reset();
        self.buffers.time_s = time_s;
        self.track.set_started();
    }

    /// Somebody who is known does not appear anew elsewhere: that would be another member.
    pub(super) fn set_births(&mut self, birth_rate_hz: f64, relocation_rate_hz: f64) {
        self.filter
            .set_births(birth_rate_hz, relocation_rate_hz)
            .expect("rates are checked before");
    }
}
