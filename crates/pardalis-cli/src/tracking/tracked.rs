//! What is tracked at one time: targets, and the members of crowds.

use anyhow::Result;
use pardalis::tracker::Member;
use pardalis::{Estimate, TargetId, Tracker};
use pardalis_scene::TargetConfig;

/// A target, or a member of a crowd, with its estimate.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Tracked {
    /// The number of the target.
    pub(crate) target: usize,
    /// For the member of a crowd: its number.
    pub(crate) member: Option<u32>,
    /// For the member of a crowd: which of the target's bodies it is.
    pub(crate) place: usize,
    pub(crate) estimate: Estimate,
}

impl Tracked {
    /// Returns a target of this number.
    pub(crate) fn target(target: usize, estimate: &Estimate) -> Self {
        Self {
            target,
            member: None,
            place: 0,
            estimate: *estimate,
        }
    }

    /// Returns a member of the crowd of this number.
    pub(crate) fn member(target: usize, member: &Member) -> Self {
        Self {
            target,
            member: Some(member.number),
            place: member.body,
            estimate: member.estimate,
        }
    }

    /// Returns all targets of a tracker at a time in seconds; of crowds, the members.
    pub(crate) fn all(
        tracker: &Tracker,
        targets: &[TargetConfig],
        time_s: f64,
    ) -> Result<Vec<Self>, pardalis::Error> {
        let mut all = Vec::new();
        for (number, target) in targets.iter().enumerate() {
            let id = TargetId::new(number);
            if target.crowd.is_some() {
                let first = all.len();
                let members = tracker.members_at(id, time_s)?;
                all.extend(members.map(|member| Self::member(number, &member)));
                all[first..].sort_by_key(|tracked| tracked.member);
            } else {
                all.push(Self::target(number, &tracker.estimate_at(id, time_s)?));
            }
        }
        Ok(all)
    }

    /// Returns who it is: the same at every time, and of nobody else.
    pub(crate) fn key(&self) -> (usize, Option<u32>) {
        (self.target, self.member)
    }

    /// Returns its name: that of the target, and of a member also its number.
    pub(crate) fn name(&self, targets: &[TargetConfig]) -> String {
        name(&targets[self.target].name, self.member)
    }
}

/// Returns the name of a target, or of a member of a crowd.
pub(crate) fn name(target: &str, member: Option<u32>) -> String {
    match member {
        Some(number) => format!("{target}-{number}"),
        None => target.to_owned(),
    }
}
