//! Crowds among the tracks, and the objects that they are compared with.

use std::path::Path;

use anyhow::Result;
use pardalis_evaluate::{CrowdObject, TrueState, crowd};

use super::confidence::Confidence;
use super::pairing::{MatchedBy, OCCLUDER};
use super::report::{CrowdReport, TargetReport};
use super::{Options, Placed, Rules, RunSummary, names, samples};
use crate::output::Shown;
use crate::user_error::user_error;

/// A crowd, and the numbers of its tracks and of its objects.
pub(super) struct Members {
    pub(super) name: String,
    pub(super) tracks: Vec<usize>,
    pub(super) objects: Vec<usize>,
}

impl Members {
    /// Finds the members of the crowd of this name: its tracks are those with this name, a hyphen and a number, its objects those whose names begin with its own, or all but
    /// occluders if there are none. Objects with the name of another target are that target's.
    pub(super) fn of(name: &str, tracks: &[&str], objects: &[&str]) -> Self {
        let is_member = |track: &str| {
            let number = track
                .strip_prefix(name)
                .and_then(|rest| rest.strip_prefix('-'));
            number.is_some_and(|number| number.parse::<u32>().is_ok())
        };
        let named = |wanted: &dyn Fn(&str) -> bool, names: &[&str]| -> Vec<usize> {
            (0..names.len()).filter(|&i| wanted(names[i])).collect()
        };
        // A member's number says nothing of who it is.
        let is_free = |object: &str| {
            let mut others = tracks.iter().filter(|track| !is_member(track));
            !others.any(|track| *track == object)
        };
        let mut of_name = named(
            &|object| object.starts_with(name) && is_free(object),
            objects,
        );
        if of_name.is_empty() {
            of_name = named(
                &|object| !object.starts_with(OCCLUDER) && is_free(object),
                objects,
            );
        }
        Self {
            name: name.to_owned(),
            tracks: named(&is_member, tracks),
            objects: of_name,
        }
    }

    /// Evaluates the crowd as a whole.
    pub(super) fn evaluate(&self, placed: &Placed, rules: &Rules) -> CrowdReport {
        let window = &rules.window;
        let paths: Vec<_> = (self.tracks.iter())
            .map(|&track| &placed.track_paths[track][window.clone()])
            .collect();
        let object = |state: &TrueState| CrowdObject {
            position_m: state.position_m,
            is_visible: state
                .visible_fraction
                .is_none_or(|share| share > rules.options.visible_over),
        };
        let true_path = |&number: &usize| {
            let rows = placed.object_rows[number][window.clone()].iter();
            rows.map(|state| state.map(object)).collect::<Vec<_>>()
        };
        let true_paths: Vec<_> = self.objects.iter().map(true_path).collect();
        let (tracks, objects) = (placed.tracks, placed.objects);
        let has_rows = |track: &&usize| !tracks[**track].rows.is_empty();
        let cutoff_m = rules.settings.lost_beyond_m;
        CrowdReport {
            crowd: self.name.clone(),
            members: self.tracks.iter().filter(has_rows).count(),
            objects: (self.objects.iter())
                .map(|&o| objects[o].name.clone())
                .collect(),
            figures: crowd(&paths, &true_paths, cutoff_m, rules.frames_in_a_second),
        }
    }

    /// Evaluates each object of the crowd, against whichever member follows it.
    pub(super) fn object_reports(
        &self,
        report: &CrowdReport,
        placed: &Placed,
        rules: &Rules,
    ) -> Vec<TargetReport> {
        let diameter_m = rules.diameter_m(&self.name);
        let of_object = |(&object, followed_by): (&usize, &Vec<Option<usize>>)| {
            let rows = || {
                let followed_by = rules.window.clone().zip(followed_by);
                followed_by.map(|(frame, member)| {
                    let row =
                        member.and_then(|member| placed.track_rows[self.tracks[member]][frame]);
                    (row, placed.object_rows[object][frame])
                })
            };
            let samples = samples(rows(), rules.options);
            TargetReport {
                target: self.name.clone(),
                object: placed.objects[object].name.clone(),
                matched_by: MatchedBy::Crowd,
                rows: rows().filter(|(row, _)| row.is_some()).count(),
                rows_without_truth: 0,
                changed_target: None,
                scores: pardalis_evaluate::evaluate(&samples, &rules.settings),
                states: diameter_m
                    .and_then(|diameter_m| pardalis_evaluate::states(&samples, diameter_m)),
                samples,
                confidence: Confidence::of(rows(), rules.options, diameter_m),
            }
        };
        let objects = self.objects.iter().zip(&report.figures.followed_by);
        objects.map(of_object).collect()
    }
}

/// Finds the crowds that the summary of the run or the options name.
pub(super) fn find(
    summary: &RunSummary,
    options: &Options,
    placed: &Placed,
    tracks_path: &Path,
) -> Result<Vec<Members>> {
    let (tracks, objects) = (names(placed.tracks), names(placed.objects));
    let of_run = summary.targets.iter();
    let of_run = of_run.filter(|(_, target)| target.members.is_some());
    let mut crowds: Vec<Members> = Vec::new();
    for name in of_run.map(|(name, _)| name).chain(&options.crowd) {
        if crowds.iter().all(|crowd| crowd.name != *name) {
            crowds.push(Members::of(name, &tracks, &objects));
        }
    }
    for (target, object) in &options.map {
        let number = tracks.iter().position(|track| track == target);
        let is_its = |crowd: &&Members| number.is_some_and(|track| crowd.tracks.contains(&track));
        if let Some(crowd) = crowds.iter().find(is_its) {
            return Err(user_error!(
                "--map {target}={object}: {target} is a member of the crowd {}, which is evaluated as a whole; remove --map",
                crowd.name
            ));
        }
    }
    let is_empty =
        |crowd: &&Members| crowd.tracks.is_empty() && options.crowd.contains(&crowd.name);
    match crowds.iter().find(is_empty) {
        Some(Members { name, .. }) => Err(user_error!(
            "--crowd {name}: {} has no target {name}-1, {name}-2 or the like; its targets are {}",
            tracks_path.shown(),
            tracks.join(", ")
        )),
        None => Ok(crowds),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn objects_may_have_the_names_of_members() {
        let tracks = ["person-1", "car", "person-64"];
        let found = |objects: &[&str]| {
            let members = Members::of("person", &tracks, objects);
            (members.tracks, members.objects)
        };
        let both = vec![0, 2];
        assert_eq!(
            found(&["person-1", "person-2", "car"]),
            (both.clone(), vec![0, 1])
        );
        // Without any of its name, all but occluders and the other target's.
        assert_eq!(found(&["anna", "car", "occluder-1"]), (both, vec![0]));
    }
}
