//! Crowds: any number of targets that look alike.

use super::target_tracker::TargetTracker;
use super::track::Instant;

/// What the members of a crowd share.
#[derive(Debug, Clone, Copy)]
pub(super) struct Crowd {
    /// The number of the member that is found next.
    next_number: u32,
    /// The index of the body that has the buffers with which whole images are searched, or the boxes of an instant. They are large, and one after another uses them.
    searcher: usize,
}

impl Crowd {
    /// A crowd without members, whose first body has this index.
    pub(super) fn of(first: usize) -> Self {
        Self {
            next_number: 1,
            searcher: first,
        }
    }

    /// Lets a body search.
    pub(super) fn lend_search(&mut self, bodies: &mut [TargetTracker], to: usize) {
        let from = std::mem::replace(&mut self.searcher, to);
        if let Ok([from, to]) = bodies.get_disjoint_mut([from, to]) {
            to.take_search(from);
        }
    }

    /// Updates who a body is after it has seen the frames of an instant.
    pub(super) fn update_member(&mut self, body: &mut TargetTracker, instant: &Instant) {
        body.update_member(&mut self.next_number, (instant.views, instant.time_s));
    }
}
