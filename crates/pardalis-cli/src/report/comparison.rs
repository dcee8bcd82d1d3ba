//! Two runs of the same recording: what differs.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use anyhow::Result;
use nalgebra::{Point3, distance};
use pardalis::tracker::TrackState;
use serde::Serialize;
use serde_json::Value;

use super::secrets;
use super::tracks::{TrackColumns, columns_of};
use crate::output::Shown;
use crate::tables::{Series, Table, TrackRow, tracks_of};
use crate::user_error::user_error;

/// Gaps of a run longer than this many of its usual intervals are not interpolated.
const LONGEST_GAP: f64 = 3.0;

/// The most settings that are listed.
const MAX_SETTINGS: usize = 30;

/// One of the runs.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Compared<'a> {
    /// What it is called on the page.
    pub(crate) name: &'a str,
    /// Its rows, as in `tracks.csv`.
    pub(crate) tracks: &'a Path,
    /// Its `summary.json`, if there is one.
    pub(crate) summary: Option<&'a Value>,
}

/// The second run, and how it differs from the first: see `web/viewer.js` of `pardalis-viewer`.
#[derive(Serialize)]
pub(crate) struct Comparison {
    names: [String; 2],
    tracks: TrackColumns,
    targets: BTreeMap<String, Target>,
    settings: Vec<Setting>,
    /// Whether changes are those from the second run to the first.
    pub(crate) other_is_earlier: bool,
    /// What is left out.
    #[serde(skip)]
    pub(super) note: Option<String>,
    /// A reason to doubt that the runs are of the same images.
    #[serde(skip)]
    pub(crate) doubt: Option<String>,
}

/// A target of either run.
#[derive(Debug, PartialEq, Serialize)]
struct Target {
    /// Those of each run that has it.
    figures: [Option<Figures>; 2],
    /// How far apart both runs see it; `None` without times at which both see it.
    distance: Option<Distance>,
}

/// The main figures of a target in a run, over all of its rows.
#[derive(Debug, PartialEq, Serialize)]
struct Figures {
    /// Number of rows in each state that occurs.
    rows: BTreeMap<&'static str, usize>,
    mean_confidence: Option<f64>,
    /// The median of the square root of the covariance's trace: the standard deviation of the position in space.
    median_sigma_m: Option<f64>,
}

#[derive(Debug, PartialEq, Serialize)]
struct Distance {
    /// Number of times at which both runs have a position.
    times: usize,
    median_m: f64,
    largest_m: f64,
    largest_at_s: f64,
}

/// A setting that differs between the runs, with its value in each as JSON; `None` in a run that does not set it.
#[derive(Debug, PartialEq, Serialize)]
pub(crate) struct Setting {
    key: String,
    values: [Option<String>; 2],
}

impl Setting {
    /// Reports whether it states where the images of a camera come from.
    fn is_of_input(&self) -> bool {
        let mut parts = self.key.split('.');
        let (table, last) = (parts.next(), parts.nth(1));
        table == Some("cameras")
            && parts.next().is_none()
            && last.is_some_and(|key| ["images", "video", "mcap", "topic"].contains(&key))
    }
}

/// Compares two runs. Rows are matched by their times, targets by their names.
///
/// Errors: the rows of a run cannot be read, or the runs have no target at a common time.
pub(crate) fn compare(first: Compared, second: Compared) -> Result<Comparison> {
    let tables = [Table::read(first.tracks)?, Table::read(second.tracks)?];
    let runs = [tracks_of(&tables[0])?, tracks_of(&tables[1])?];
    let mut targets = BTreeMap::new();
    let mut has_common = false;
    for name in runs.iter().flatten().map(|track| &track.name) {
        if targets.contains_key(name) {
            continue;
        }
        let [ours, theirs] = [0, 1].map(|run| runs[run].iter().find(|track| track.name == *name));
        let mut distance = None;
        if let (Some(ours), Some(theirs)) = (ours, theirs) {
            let pairs = pairs(&ours.rows, &theirs.rows);
            has_common |= !pairs.is_empty();
            distance = Distance::of(&pairs);
        }
        let figures = [ours, theirs].map(|track| Some(Figures::of(&track?.rows)));
        targets.insert(name.clone(), Target { figures, distance });
    }
    if !has_common {
        let [ours, theirs] = [(&first, &runs[0]), (&second, &runs[1])]
            .map(|(run, tracks)| format!("{} has {}", run.tracks.shown(), contents(tracks)));
        return Err(user_error!(
            "{ours}, {theirs}: no target has rows at common times; give two runs of the same recording, whose targets have the same names"
        ));
    }
    let read = columns_of(&tables[1])?;
    let settings = settings([first.summary, second.summary]);
    let doubt = settings.iter().find(|setting| setting.is_of_input());
    let doubt = doubt.map(|Setting { key, values }| {
        let [ours, theirs] = values
            .each_ref()
            .map(|value| value.as_deref().unwrap_or("not set"));
        format!(
            "The runs may be of different images: {key} is {ours} in {} and {theirs} in {}",
            first.name, second.name
        )
    });
    Ok(Comparison {
        names: [first.name.to_owned(), second.name.to_owned()],
        tracks: read.columns,
        targets,
        settings,
        other_is_earlier: false,
        note: read.note,
        doubt,
    })
}

/// Returns the targets and times of a run, in words.
fn contents(tracks: &[Series<TrackRow>]) -> String {
    let names: Vec<&str> = tracks.iter().map(|track| &*track.name).take(5).collect();
    let more = if tracks.len() > names.len() {
        ", …"
    } else {
        ""
    };
    let firsts = tracks.iter().map(|track| track.rows[0].0);
    let lasts = tracks
        .iter()
        .map(|track| track.rows[track.rows.len() - 1].0);
    let (first_s, last_s) = (
        firsts.fold(f64::INFINITY, f64::min),
        lasts.fold(f64::NEG_INFINITY, f64::max),
    );
    format!("{}{more} from {first_s} to {last_s} s", names.join(", "))
}

type Position = Option<[f64; 3]>;

/// Returns the times of the first run's rows at which the second has rows, too, with the positions of both.
fn pairs(ours: &[(f64, TrackRow)], theirs: &[(f64, TrackRow)]) -> Vec<(f64, [Position; 2])> {
    let mut intervals_s: Vec<f64> = theirs.windows(2).map(|w| w[1].0 - w[0].0).collect();
    let longest_s = LONGEST_GAP * median(&mut intervals_s).unwrap_or(0.0);
    let pairs = ours.iter().filter_map(|(time_s, row)| {
        let other = position_at(theirs, *time_s, longest_s)?;
        Some((*time_s, [position(row), other]))
    });
    pairs.collect()
}

fn position(row: &TrackRow) -> Position {
    row.estimate.map(|estimate| estimate.position_m)
}

/// Returns the position at a time: that of the row, or on the line between two rows that are at most `longest_s` apart. `None` where there are no rows.
fn position_at(rows: &[(f64, TrackRow)], time_s: f64, longest_s: f64) -> Option<Position> {
    let after = rows.partition_point(|row| row.0 < time_s);
    let (after_s, end) = rows.get(after)?;
    if *after_s == time_s {
        return Some(position(end));
    }
    let (before_s, start) = rows.get(after.checked_sub(1)?)?;
    let interval_s = after_s - before_s;
    if interval_s > longest_s {
        return None;
    }
    let share = (time_s - before_s) / interval_s;
    let between = position(start)
        .zip(position(end))
        .map(|(from, to)| [0, 1, 2].map(|axis| from[axis] + share * (to[axis] - from[axis])));
    Some(between)
}

impl Distance {
    /// Returns the distance at the times at which both runs have a position.
    fn of(pairs: &[(f64, [Position; 2])]) -> Option<Self> {
        let apart = pairs.iter().filter_map(|(time_s, [ours, theirs])| {
            let (ours, theirs) = ours.zip(*theirs)?;
            let apart_m = distance(&Point3::from(ours), &Point3::from(theirs));
            Some((*time_s, apart_m))
        });
        let apart: Vec<(f64, f64)> = apart.collect();
        // The first of several.
        let largest = apart.iter().rev().max_by(|a, b| a.1.total_cmp(&b.1))?;
        let mut distances_m: Vec<f64> = apart.iter().map(|(_, apart_m)| *apart_m).collect();
        Some(Self {
            times: apart.len(),
            median_m: median(&mut distances_m)?,
            largest_m: largest.1,
            largest_at_s: largest.0,
        })
    }
}

impl Figures {
    fn of(rows: &[(f64, TrackRow)]) -> Self {
        let mut counts = BTreeMap::new();
        for (_, row) in rows {
            // Tracks of others may not state it.
            let stated = row.state.unwrap_or(if row.estimate.is_some() {
                TrackState::Tracking
            } else {
                TrackState::Lost
            });
            *counts.entry(stated.name()).or_default() += 1;
        }
        let confidences = rows.iter().filter_map(|(_, row)| row.confidence);
        let (sum, count) = confidences.fold((0.0, 0_usize), |(sum, count), confidence| {
            (sum + confidence, count + 1)
        });
        let sigmas_m = rows.iter().filter_map(|(_, row)| {
            let [xx, _, _, yy, _, zz] = row.estimate?.covariance_m2?;
            Some((xx + yy + zz).max(0.0).sqrt())
        });
        Self {
            rows: counts,
            mean_confidence: (count > 0).then(|| sum / count as f64),
            median_sigma_m: median(&mut sigmas_m.collect::<Vec<_>>()),
        }
    }
}

/// Returns the median of some values, which it sorts; `None` without any.
fn median(values: &mut [f64]) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    let middle = values.len() / 2;
    let upper = *values.get(middle)?;
    Some(if values.len().is_multiple_of(2) {
        0.5 * (values[middle - 1] + upper)
    } else {
        upper
    })
}

/// Returns the settings that differ between two runs, by their keys.
pub(crate) fn settings(summaries: [Option<&Value>; 2]) -> Vec<Setting> {
    let [Some(first), Some(second)] = summaries else {
        return Vec::new();
    };
    let [ours, theirs] = [first, second].map(|summary| {
        let mut values = BTreeMap::new();
        flatten(String::new(), &summary["settings"], &mut values);
        // `--seed` overrides the scene's.
        flatten("seed".to_owned(), &summary["seed"], &mut values);
        if summary["smoothed"] == true {
            values.insert("smoothed".to_owned(), "true".to_owned());
        }
        values
    });
    let keys: BTreeSet<&String> = ours.keys().chain(theirs.keys()).collect();
    let differ = keys.into_iter().filter_map(|key| {
        let values = [&ours, &theirs].map(|values| values.get(key).cloned());
        let key = key.clone();
        (values[0] != values[1]).then_some(Setting { key, values })
    });
    differ.take(MAX_SETTINGS).collect()
}

/// Adds all settings in a table and the tables in it, each with its key, without names and passwords in addresses.
fn flatten(key: String, value: &Value, settings: &mut BTreeMap<String, String>) {
    match value {
        Value::Object(table) => {
            for (name, value) in table {
                let dot = if key.is_empty() { "" } else { "." };
                flatten(format!("{key}{dot}{name}"), value, settings);
            }
        }
        Value::Null => {}
        _ => {
            let mut value = value.clone();
            secrets::remove(&mut value);
            settings.insert(key, value.to_string());
        }
    }
}

#[cfg(test)]
mod tests {
    use pardalis_evaluate::EstimatedState;
    use serde_json::json;

    use super::*;

    fn rows(states: &[(f64, Option<f64>)]) -> Vec<(f64, TrackRow)> {
        let row = |&(time_s, x_m): &(f64, Option<f64>)| {
            let estimate = x_m.map(|x_m| EstimatedState {
                covariance_m2: Some([4e-4, 0.0, 0.0, 4e-4, 0.0, 1e-4]),
                ..EstimatedState::at([x_m, 0.0, 0.0])
            });
            let row = TrackRow {
                state: None,
                estimate,
                radius_m: None,
                confidence: Some(if x_m.is_some() { 0.9 } else { 0.3 }),
            };
            (time_s, row)
        };
        states.iter().map(row).collect()
    }

    #[test]
    fn rows_are_matched_by_their_times() {
        let ours = rows(&[
            (0.0, Some(1.0)),
            (0.1, Some(2.0)),
            (0.2, None),
            (0.9, Some(5.0)),
        ]);
        // Another clock of frames, and a gap.
        let theirs = rows(&[
            (0.0, Some(1.5)),
            (0.05, Some(2.0)),
            (0.15, Some(4.0)),
            (0.25, Some(4.0)),
            (2.0, Some(5.0)),
        ]);
        let found = pairs(&ours, &theirs);
        let x = |position: Position| position.map(|position| position[0]);
        let found_m: Vec<_> = found.iter().map(|(t, [a, b])| (*t, x(*a), x(*b))).collect();
        assert_eq!(found_m.len(), 3);
        assert_eq!(found_m[0], (0.0, Some(1.0), Some(1.5)));
        assert!((found_m[1].2.unwrap() - 3.0).abs() < 1e-12);
        assert_eq!((found_m[2].0, found_m[2].1), (0.2, None));
        let distance = Distance::of(&found).unwrap();
        assert_eq!((distance.times, distance.largest_at_s), (2, 0.1));
        assert!((distance.median_m - 0.75).abs() < 1e-12);
        assert!((distance.largest_m - 1.0).abs() < 1e-12);
        // Where the second run has lost it, it has no position, not even between rows.
        let lost = pairs(&ours, &rows(&[(0.05, Some(1.0)), (0.15, None)]));
        assert_eq!(lost, [(0.1, [Some([2.0, 0.0, 0.0]), None])]);
        assert_eq!(Distance::of(&lost), None);
        assert_eq!(pairs(&ours, &[]), []);
    }

    #[test]
    fn figures_are_those_of_all_rows() {
        let figures = Figures::of(&rows(&[(0.0, Some(1.0)), (0.1, None), (0.2, Some(1.0))]));
        assert_eq!(figures.rows, BTreeMap::from([("lost", 1), ("tracking", 2)]));
        assert!((figures.mean_confidence.unwrap() - 0.7).abs() < 1e-12);
        assert!((figures.median_sigma_m.unwrap() - 0.03).abs() < 1e-12);
    }

    #[test]
    fn settings_that_differ_are_listed_without_passwords() {
        let summary = |seed: u32, count: Option<u32>, video: &str| {
            let ball = count.map_or(json!({}), |count| json!({ "particles": count }));
            json!({ "seed": seed, "settings": { "seed": 1, "targets": { "ball": ball }, "cameras": { "a": { "video": video } } } })
        };
        let first = summary(1, Some(500), "rtsp://me:secret@host/1");
        let second = summary(2, None, "rtsp://me:other@host/1");
        let found = settings([Some(&first), Some(&second)]);
        let found: Vec<_> = found.iter().map(|s| (&*s.key, s.values.clone())).collect();
        let text = |value: &str| Some(value.to_owned());
        let expected = [
            ("seed", [text("1"), text("2")]),
            ("targets.ball.particles", [text("500"), None]),
        ];
        assert_eq!(found, expected);
        assert_eq!(settings([Some(&first), None]).len(), 0);
    }
}
