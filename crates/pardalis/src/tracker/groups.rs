//! Groups of bodies that look alike, and access to one body together with all others.

use super::target_tracker::TargetTracker;

/// Returns the indices of all bodies, grouped by appearance, in ascending order within each group.
pub(super) fn groups(bodies: &[TargetTracker]) -> Vec<Vec<usize>> {
    let mut groups: Vec<Vec<usize>> = Vec::new();
    for (number, body) in bodies.iter().enumerate() {
        let is_alike = |group: &&mut Vec<usize>| body.looks_like(&bodies[group[0]]);
        match groups.iter_mut().find(is_alike) {
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

/// Splits the bodies into the one with this index and all others.
pub(super) fn split(
    bodies: &mut [TargetTracker],
    number: usize,
) -> (&mut TargetTracker, Others<'_>) {
    let (before, from) = bodies.split_at_mut(number);
    let (body, after) = from
        .split_first_mut()
        .expect("there is a body with this index");
    (body, Others { before, after })
}

impl<'a> Others<'a> {
    /// Returns the body with this index; `None` for the one left out.
    pub(super) fn get(&self, number: usize) -> Option<&'a TargetTracker> {
        match number.checked_sub(self.before.len()) {
            None => self.before.get(number),
            Some(0) => None,
            Some(after) => self.after.get(after - 1),
        }
    }

    /// Splits the group of the body left out into the members before it, in the order of updates, and the rest,
    /// which begins with it.
    pub(super) fn around<'g>(&self, group: &'g [usize]) -> (&'g [usize], &'g [usize]) {
        let left_out = group.iter().position(|&number| number == self.before.len());
        group.split_at(left_out.unwrap_or(0))
    }
}
