//! Smoothed tracks: once the recording is over, every row takes into account what came after it.

use std::fmt::Write as _;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::Result;
use pardalis::filter::estimate::StateEstimate;
use pardalis::filter::smoother::{Contact, Measured, SmootherSettings, contacts, smooth};
use pardalis::tracker::{BodyMeasurement, TrackState};
use pardalis::{Estimate, TargetId};
use pardalis_scene::Scene;

use super::rows::{HEADER, write_row};
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
    estimate: Estimate,
    measurement: Option<BodyMeasurement>,
}

/// Keeps all rows and measurements until the end.
pub(super) struct SmoothedTracks {
    names: Vec<String>,
    /// Number and time in seconds of each frame set.
    times: Vec<(usize, f64)>,
    /// One list per target.
    rows: Vec<Vec<Row>>,
    /// The contacts of each target, once it is smoothed.
    contacts: Vec<Vec<Contact>>,
}

impl SmoothedTracks {
    /// Keeps nothing yet of the targets of a scene.
    pub(super) fn new(scene: &Scene) -> Self {
        let names: Vec<String> = scene.targets.iter().map(|t| t.name.clone()).collect();
        Self {
            rows: names.iter().map(|_| Vec::new()).collect(),
            contacts: Vec::new(),
            times: Vec::new(),
            names,
        }
    }

    /// Replaces the estimates by smoothed ones; rows without an estimate stay as they are. Returns the targets that cannot be smoothed: those that have several landmarks, or
    /// are followed from a start by the published cues.
    pub(super) fn smooth(&mut self) -> Vec<&str> {
        for rows in &mut self.rows {
            let measured: Vec<Measured> = rows
                .iter()
                .zip(&self.times)
                .map(|(row, (_, time_s))| Measured {
                    time_s: *time_s,
                    position: row.measurement.map(|m| (m.position_m, m.covariance_m2)),
                })
                .collect();
            let is_planar = |m: &BodyMeasurement| m.covariance_m2[5] == 0.0;
            let mut of_rows = rows.iter().filter_map(|row| row.measurement.as_ref());
            let settings = if of_rows.next().is_some_and(is_planar) {
                SmootherSettings::planar()
            } else {
                SmootherSettings::default()
            };
            let states = smooth(&measured, &settings);
            self.contacts.push(contacts(&measured, &states, &settings));
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
                    covariance_m2,
                    best_position_m: state.position_m,
                    ..*known
                };
            }
        }
        let is_rough = |rows: &&Vec<Row>| {
            let has_estimates = rows.iter().any(|row| row.estimate.kinematics.is_some());
            has_estimates && rows.iter().all(|row| row.measurement.is_none())
        };
        let named = self.names.iter().zip(&self.rows);
        let rough = named.filter(|(_, rows)| is_rough(rows));
        rough.map(|(name, _)| &**name).collect()
    }

    /// Returns the text of events.csv.
    fn events(&self) -> String {
        let mut events: Vec<(&String, &Contact)> = Vec::new();
        for (name, contacts) in self.names.iter().zip(&self.contacts) {
            events.extend(contacts.iter().map(|contact| (name, contact)));
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
        for (number, (index, time_s)) in self.times.iter().enumerate() {
            for (name, rows) in self.names.iter().zip(&self.rows) {
                write_row(&mut text, (*index, *time_s), name, &rows[number].estimate);
            }
        }
        let (tracks, filtered) = (folder.join("tracks.csv"), folder.join(FILTERED));
        fs::rename(&tracks, &filtered).map_err(|error| unwritable(&filtered, error))?;
        write_file(&tracks, text.as_bytes())?;
        let events = folder.join(EVENTS);
        write_file(&events, self.events().as_bytes())?;
        Ok([filtered, events])
    }

    /// Returns the smoothed track of each target for plots.
    pub(super) fn samples(&self) -> impl Iterator<Item = Vec<Sample>> {
        self.rows.iter().map(|rows| {
            let times = self.times.iter();
            let sample =
                |(row, (_, time_s)): (&Row, &(usize, f64))| Sample::of(*time_s, &row.estimate);
            rows.iter().zip(times).map(sample).collect()
        })
    }
}

impl Sink for SmoothedTracks {
    fn take(&mut self, instant: &Instant) -> Result<()> {
        self.times.push((instant.index, instant.time_s));
        for (number, (rows, estimate)) in self.rows.iter_mut().zip(instant.estimates).enumerate() {
            let mut bodies = instant.tracker.measurements(TargetId::new(number))?;
            // Several landmarks are not one position.
            let measurement = match (bodies.next(), bodies.next()) {
                (Some(measurement), None) => measurement,
                _ => None,
            };
            rows.push(Row {
                estimate: *estimate,
                measurement: measurement.filter(|_| estimate.state == TrackState::Tracking),
            });
        }
        Ok(())
    }
}
