//! Groups of bodies that look alike, and one body beside all others.

use super::detected::LookAlikes;
use super::target_tracker::TargetTracker;

/// Returns the numbers of all bodies, those that look alike together and in ascending order.
pub(super) fn groups(bodies: &[TargetTracker]) -> Vec<Vec<usize>> {
    let mut groups: Vec<Vec<usize>> = Vec::new();
    for (number, body) in bodies.iter().enumerate() {
        let is_its = |group: &&mut Vec<usize>| body.looks_like(&bodies[group[0]]);
        match groups.iter_mut().find(is_its) {
            Some(group) => group.push(number),
            None => groups.push(vec![number]),
        }
    }
    groups
}

/// All bodies but one.
#[derive(Clone, Copy)]
pub(super) struct Others<'a> {
    before: &'a [TargetTracker],
    after: &'a [TargetTracker],
}

/// Splits the bodies into the one of this number and all others.
pub(super) fn split(
    bodies: &mut [TargetTracker],
    number: usize,
) -> (&mut TargetTracker, Others<'_>) {
    let (before, from) = bodies.split_at_mut(number);
    let (body, after) = from
        .split_first_mut()
        .expect("there is a body of that number");
    (body, Others { before, after })
}

impl<'a> Others<'a> {
    /// The body of this number; `None` if that is the one which is left out.
    pub(super) fn get(&self, number: usize) -> Option<&'a TargetTracker> {
        match number.checked_sub(self.before.len()) {
            None => self.before.get(number),
            Some(0) => None,
            Some(after) => self.after.get(after - 1),
        }
    }

    /// Those that look like the one which is left out: its group, in the order in which it looks at frames.
    pub(super) fn look_alikes(self, group: &'a [usize]) -> LookAlikes<'a> {
        let left_out = group.iter().position(|&number| number == self.before.len());
        let (updated, predicted) = group.split_at(left_out.unwrap_or(0));
        LookAlikes {
            others: self,
            updated,
            predicted,
        }
    }
}
