//! Earlier runs, and the comparison of one with the last.

use std::path::{Path, PathBuf};

use anyhow::Result;
use serde_json::{Value, json};

use super::replay::{Outlined, Replay};
use crate::report::{self, Compared};
use crate::tables::read_tracks;
use crate::tracking::{ROWS, SUMMARY, earlier_runs};
use crate::user_error::user_error;

/// Returns the earlier runs among the results in a folder that can be compared with the last, each with its number and the settings that differ, first its own.
/// Those of live cameras have no times in common.
pub(super) fn list(folder: &Path) -> Value {
    let Some(last) = read_summary(folder) else {
        return json!([]);
    };
    let runs = comparable(folder)
        .into_iter()
        .filter_map(|(number, place)| {
            let summary = read_summary(&place)?;
            let [[from_s, to_s], [last_from_s, last_to_s]] = [span_s(&summary)?, span_s(&last)?];
            let differ = report::settings([Some(&summary), Some(&last)]);
            let entry = json!({ "number": number, "settings": differ });
            (from_s <= last_to_s && last_from_s <= to_s).then_some(entry)
        });
    runs.collect()
}

/// Returns the earlier runs that have rows of their own: a link could lead to a file elsewhere, and the folder may have come from somebody else.
fn comparable(folder: &Path) -> Vec<(usize, PathBuf)> {
    let mut runs = earlier_runs(folder);
    runs.retain(|(_, place)| is_file(&place.join(ROWS)));
    runs
}

fn is_file(path: &Path) -> bool {
    path.symlink_metadata().is_ok_and(|found| found.is_file())
}

/// Returns the times of the first and the last frame of a run, in seconds.
fn span_s(summary: &Value) -> Option<[f64; 2]> {
    let cameras = summary["cameras"].as_object()?;
    let spans = cameras.values().filter_map(|camera| {
        let frames = &camera["frames"];
        Some([
            frames["first_time_s"].as_f64()?,
            frames["last_time_s"].as_f64()?,
        ])
    });
    spans.reduce(|[a, b], [c, d]| [a.min(c), b.max(d)])
}

/// Reads a summary; `None` if a run was killed before it wrote one.
fn read_summary(folder: &Path) -> Option<Value> {
    let path = folder.join(SUMMARY);
    let text = is_file(&path).then(|| std::fs::read(path).ok())??;
    serde_json::from_slice(&text).ok()
}

/// Returns the folder of an earlier run among the results in a folder.
///
/// Errors: it is not kept any more.
pub(super) fn place_of(folder: &Path, number: usize) -> Result<PathBuf> {
    let mut runs = comparable(folder).into_iter();
    let found = runs.find(|(other, _)| *other == number);
    let missing = || user_error!("run {number}: is not kept any more; choose another");
    found.map(|(_, place)| place).ok_or_else(missing)
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
    let place = place_of(folder, number)?;
    let last = comparable(folder).last().map_or(1, |(last, _)| last + 1);
    let names = [last, number].map(|number| format!("run {number}"));
    let folders = [folder, &*place];
    let summaries = folders.map(read_summary);
    let rows = folders.map(|folder| folder.join(ROWS));
    let [ours, theirs] = [0, 1].map(|run| Compared {
        name: &names[run],
        tracks: &rows[run],
        summary: summaries[run].as_ref(),
    });
    let mut comparison = report::compare(ours, theirs)?;
    comparison.other_is_earlier = true;
    let sizes = summaries[1].iter().flat_map(report::diameters_m);
    let has_other_cameras = optics(summaries[0].as_ref()) != optics(summaries[1].as_ref());
    // Outlines are drawn as the cameras of the last run show them.
    show(if has_other_cameras {
        Outlined::default()
    } else {
        Outlined {
            tracks: read_tracks(&rows[1])?,
            diameters_m: sizes.collect(),
        }
    });
    let mut comparison = json!(comparison);
    comparison["has_other_cameras"] = json!(has_other_cameras);
    Ok(comparison)
}

/// Returns what says how the cameras of a run map the world to their images.
fn optics(summary: Option<&Value>) -> Option<Value> {
    let mut cameras = summary?["settings"]["cameras"].clone();
    for (_, camera) in cameras.as_object_mut()? {
        if let Some(settings) = camera.as_object_mut() {
            let of_optics = |key: &str| {
                [
                    "calibration",
                    "model",
                    "plane",
                    "platform",
                    "size_px",
                    "world_from_camera",
                ]
                .iter()
                .any(|start| key.starts_with(start))
            };
            settings.retain(|key, _| of_optics(key));
        }
    }
    Some(cameras)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cameras_are_others_if_their_lens_or_pose_is() {
        let summary = |fps: f64, f_px: f64| json!({ "settings": { "cameras": { "left": { "images": "left", "fps": fps, "model": { "pinhole": { "f_px": [f_px, f_px] } } } } } });
        let of = |summary: &Value| optics(Some(summary));
        assert_eq!(of(&summary(25.0, 500.0)), of(&summary(30.0, 500.0)));
        assert_ne!(of(&summary(25.0, 500.0)), of(&summary(25.0, 510.0)));
        assert_eq!(optics(None), None);
    }
}
