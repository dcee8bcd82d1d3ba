//! Earlier runs, and the comparison of one with the last.

use std::path::Path;

use anyhow::Result;
use serde_json::{Value, json};

use super::replay::{Outlined, Replay};
use crate::report::{self, Compared};
use crate::tables::read_tracks;
use crate::tracking::{ROWS, SUMMARY, earlier_runs};
use crate::user_error::user_error;

/// Returns the earlier runs among the results in a folder, each with its number and the settings that it had and the last run has not.
pub(super) fn list(folder: &Path) -> Value {
    let last = read_summary(folder);
    let runs = earlier_runs(folder).into_iter().map(|(number, place)| {
        let summary = read_summary(&place);
        let differ = report::settings([summary.as_ref(), last.as_ref()]);
        json!({ "number": number, "settings": differ })
    });
    runs.collect()
}

/// Reads a summary; `None` if a run was killed before it wrote one.
fn read_summary(folder: &Path) -> Option<Value> {
    serde_json::from_slice(&std::fs::read(folder.join(SUMMARY)).ok()?).ok()
}

/// Compares the last run, whose results are in a folder, with an earlier one, and draws the outlines of that over the images as well; none for no number.
pub(super) fn compare(
    folder: &Path,
    replay: Option<&Replay>,
    number: Option<usize>,
) -> Result<Value> {
    let show = |other| {
        if let Some(replay) = replay {
            replay.set_other(other);
        }
    };
    let Some(number) = number else {
        show(Outlined::default());
        return Ok(json!({}));
    };
    let runs = earlier_runs(folder);
    let Some((_, place)) = runs.iter().find(|(other, _)| *other == number) else {
        return Err(user_error!(
            "run {number}: is not kept any more; choose another"
        ));
    };
    let last = runs.last().map_or(1, |(last, _)| last + 1);
    let names = [last, number].map(|number| format!("run {number}"));
    let folders = [folder, place];
    let summaries = folders.map(read_summary);
    let rows = folders.map(|folder| folder.join(ROWS));
    let [ours, theirs] = [0, 1].map(|run| Compared {
        name: &names[run],
        tracks: &rows[run],
        summary: summaries[run].as_ref(),
    });
    let comparison = report::compare(ours, theirs)?;
    let sizes = summaries[1].iter().flat_map(report::diameters_m);
    show(Outlined {
        tracks: read_tracks(&rows[1])?,
        diameters_m: sizes.collect(),
    });
    Ok(json!(comparison))
}
