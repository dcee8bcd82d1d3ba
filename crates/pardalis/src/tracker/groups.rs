//! Bodies that look the same, and one body apart from all others.

use super::follower::Follower;
use super::seeker::Alike;

/// The numbers of all bodies, those together that look the same, in their order.
pub(super) fn groups(bodies: &[Follower]) -> Vec<Vec<usize>> {
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
pub(super) struct Others<'a> {
    before: &'a [Follower],
    after: &'a [Follower],
}

/// A body, and all others.
pub(super) fn apart(bodies: &mut [Follower], number: usize) -> (&mut Follower, Others<'_>) {
    let (before, from) = bodies.split_at_mut(number);
    let (body, after) = from
        .split_first_mut()
        .expect("there is a body of that number");
    (body, Others { before, after })
}

impl<'a> Others<'a> {
    /// The body of this number; none where that is the one which is apart.
    pub(super) fn get(&self, number: usize) -> Option<&'a Follower> {
        match number.checked_sub(self.before.len()) {
            None => self.before.get(number),
            Some(0) => None,
            Some(after) => self.after.get(after - 1),
        }
    }

    /// Those that look like the one which is apart: a group, in the order in which it looks at frames.
    pub(super) fn alike(&self, group: &[usize]) -> Alike<'a> {
        let apart = group.iter().position(|&number| number == self.before.len());
        let (before, after) = group.split_at(apart.unwrap_or(0));
        let seekers = |numbers: &[usize]| {
            let others = numbers.iter().filter_map(|&number| self.get(number));
            others.filter_map(Follower::seeker).collect()
        };
        Alike {
            before: seekers(before),
            after: seekers(after),
        }
    }
}
