//! Smoothed tracks: once the recording is over, every row takes into account what came after it.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::Result;
use pardalis::filter::estimate::StateEstimate;
use pardalis::filter::modes::{Measured, ModeSettings};
use pardalis::filter::smoother::{Contact, contacts, smooth};
use pardalis::tracker::BodyMeasurement;
use pardalis::{Estimate, TargetId};
use pardalis_scene::{Scene, TargetConfig, TrackingConfig};

use super::rows::{HEADER, write_row};
use super::series::Key;
use super::tracked::name;
use super::{Instant, Sink};
use crate::draw::plots::Sample;
use crate::files::{unwritable, write_file};

/// The file that keeps the rows of the filter.
pub(super) const FILTERED: &str = "filtered.csv";

/// The file of contacts.
pub(super) const EVENTS: &str = "events.csv";

const EVENTS_HEADER: &str = "time_s,target,event,x_m,y_m,z_m,vx_before_mps,vy_before_mps,vz_before_mps,\
                             vx_after_mps,vy_after_mps,vz_after_mps\n";

/// A row of the filter, and what it was made of.
struct Row {
    /// The number of the frame set, and its time in seconds.
    instant: (usize, f64),
    estimate: Estimate,
    measurement: Option<BodyMeasurement>,
}

/// Keeps all rows and measurements until the end.
pub(super) struct SmoothedTracks {
    targets: Vec<TargetConfig>,
    /// The rows of each target, and of each member of a crowd.
    rows: BTreeMap<Key, Vec<Row>>,
    /// Whose each row is, in the order in which they came.
    order: Vec<Key>,
    /// The contacts of each target, once it is smoothed.
    contacts: Vec<(Key, Vec<Contact>)>,
}

/// Returns how a target may move; targets that cannot be smoothed as by default.
fn mode_settings(target: &TargetConfig) -> ModeSettings {
    match target.bodies.first().map(|body| &body.tracking) {
        Some(
            TrackingConfig::Detected {
                existence, motion, ..
            }
            | TrackingConfig::Boxed {
                existence, motion, ..
            },
        ) => existence.mode_settings(motion.is_planar()),
        Some(TrackingConfig::Initialized { .. }) | None => ModeSettings::default(),
    }
}

impl SmoothedTracks {
    /// Keeps nothing yet of the targets of a scene.
    pub(super) fn new(scene: &Scene) -> Self {
        Self {
            targets: scene.targets.clone(),
            rows: BTreeMap::new(),
            order: Vec::new(),
            contacts: Vec::new(),
        }
    }

    fn name(&self, (target, member): Key) -> String {
        name(&self.targets[target].name, member)
    }

    /// Replaces the estimates by smoothed ones; rows without an estimate stay as they are. Returns the targets that cannot be smoothed: those that have several landmarks, or
    /// are followed from a start by the published cues.
    pub(super) fn smooth(&mut self) -> Vec<String> {
        for (key, rows) in &mut self.rows {
            let measured: Vec<Measured> = rows
                .iter()
                .map(|row| Measured {
                    time_s: row.instant.1,
                    position: row.measurement.map(|m| (m.position_m, m.covariance_m2)),
                })
                .collect();
            let settings = mode_settings(&self.targets[key.0]);
            let states = smooth(&measured, &settings);
            let contacts = contacts(&measured, &states, &settings);
            self.contacts.push((*key, contacts));
            let mut shared_m2 = [0.0; 6];
            for (row, state) in rows.iter_mut().zip(states) {
                if let Some(measurement) = &row.measurement {
                    shared_m2 = measurement.shared_m2;
                }
                let (Some(known), Some(state)) = (&mut row.estimate.kinematics, state) else {
                    continue;
                };
                let mut covariance_m2 = state.covariance_m2;
                for (sum, shared) in covariance_m2.iter_mut().zip(shared_m2) {
                    *sum += shared;
                }
                *known = StateEstimate {
                    position_m: state.position_m,
                    velocity_mps: Some(state.velocity_mps),
                    velocity_covariance_m2ps2: Some(state.velocity_covariance_m2ps2),
                    covariance_m2,
                    best_position_m: state.position_m,
                    ..*known
                };
            }
        }
        let is_rough = |rows: &Vec<Row>| {
            let has_estimates = rows.iter().any(|row| row.estimate.kinematics.is_some());
            has_estimates && rows.iter().all(|row| row.measurement.is_none())
        };
        let rough = self.rows.iter().filter(|(_, rows)| is_rough(rows));
        rough.map(|(key, _)| self.name(*key)).collect()
    }

    /// Warns of guesses that falsify gravity, of which flights and contacts are made, if a target was smoothed that may fly.
    pub(super) fn guesses_warning(&self, scene: &Scene) -> Option<String> {
        let matters = |key: &&String| {
            let parts: Vec<&str> = key.split('.').collect();
            matches!(
                parts[..],
                ["cameras", _, "world_from_camera" | "model", ..] | ["targets", _, "shape", ..]
            )
        };
        let guessed: Vec<&str> =
            (scene.guesses.iter().filter(matters).map(String::as_str)).collect();
        let may_fly = self.rows.iter().any(|((target, _), rows)| {
            let is_smoothed = rows.iter().any(|row| row.measurement.is_some());
            is_smoothed && !mode_settings(&self.targets[*target]).is_planar
        });
        (may_fly && !guessed.is_empty()).then(|| {
            format!(
                "--smooth: whether a target flies, bounces or is thrown depends on gravity, which acts along -z of the world, but {} {} guessed: contacts in {EVENTS} may be spurious, and others missing",
                guessed.join(", "),
                if guessed.len() == 1 { "is" } else { "are" }
            )
        })
    }

    /// Returns the text of events.csv.
    fn events(&self) -> String {
        let mut events: Vec<(String, &Contact)> = Vec::new();
        for (key, contacts) in &self.contacts {
            events.extend(contacts.iter().map(|contact| (self.name(*key), contact)));
        }
        events.sort_by(|a, b| a.1.time_s.total_cmp(&b.1.time_s));
        let mut text = EVENTS_HEADER.to_owned();
        for (name, contact) in events {
            let _ = write!(text, "{},{name},contact", contact.time_s);
            let numbers = [
                contact.position_m,
                contact.velocity_before_mps,
                contact.velocity_after_mps,
            ];
            for number in numbers.as_flattened() {
                let _ = write!(text, ",{number}");
            }
            text.push('\n');
        }
        text
    }

    /// Writes the rows into tracks.csv, and the contacts; the rows of the filter, which are there, move to another file. Returns the names of the other files.
    pub(super) fn write(&self, folder: &Path) -> Result<[PathBuf; 2]> {
        let mut text = HEADER.to_owned();
        let mut left: BTreeMap<Key, _> = (self.rows.iter())
            .map(|(key, rows)| (*key, rows.iter()))
            .collect();
        for key in &self.order {
            if let Some(row) = left.get_mut(key).and_then(Iterator::next) {
                write_row(&mut text, row.instant, &self.name(*key), &row.estimate);
            }
        }
        let (tracks, filtered) = (folder.join("tracks.csv"), folder.join(FILTERED));
        fs::rename(&tracks, &filtered).map_err(|error| unwritable(&filtered, error))?;
        write_file(&tracks, text.as_bytes())?;
        let events = folder.join(EVENTS);
        write_file(&events, self.events().as_bytes())?;
        Ok([filtered, events])
    }

    /// Returns the smoothed tracks for plots.
    pub(super) fn samples(&self) -> impl Iterator<Item = (Key, Vec<Sample>)> {
        self.rows.iter().map(|(key, rows)| {
            let sample = |row: &Row| Sample::of(row.instant.1, &row.estimate);
            (*key, rows.iter().map(sample).collect())
        })
    }
}

impl Sink for SmoothedTracks {
    fn take(&mut self, instant: &Instant) -> Result<()> {
        for tracked in instant.tracked {
            let id = TargetId::new(tracked.target);
            let mut bodies = instant.tracker.measurements(id)?;
            // Several landmarks are not one position.
            let is_one = self.targets[tracked.target].bodies.len() == 1;
            let measurement = bodies.nth(tracked.place).flatten().filter(|_| is_one);
            let estimate = tracked.estimate;
            self.order.push(tracked.key());
            self.rows.entry(tracked.key()).or_default().push(Row {
                instant: (instant.index, instant.time_s),
                estimate,
                measurement: measurement.filter(|_| estimate.kinematics.is_some()),
            });
        }
        Ok(())
    }
}
