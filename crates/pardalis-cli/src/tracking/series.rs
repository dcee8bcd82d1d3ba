//! Collects the track of each target for plots and for the final report.

use std::path::{Path, PathBuf};

use anyhow::Result;
use pardalis::tracker::TrackState;
use pardalis_evaluate::TrueState;
use pardalis_scene::Scene;

use super::{Instant, Sink};
use crate::draw::camera_symbol::CameraSymbol;
use crate::draw::plots::{Sample, TrackSeries, TruthSeries, write_track_plots};
use crate::tables::Series;

/// Collects the tracks.
pub(crate) struct SeriesCollector {
    tracks: Vec<TrackSeries>,
    states: Vec<StateCounts>,
}

/// Number of rows of a target in each state.
#[derive(Debug, Clone, Copy, Default, serde::Serialize)]
pub(crate) struct StateCounts {
    pub(crate) searching: usize,
    pub(crate) tracking: usize,
    pub(crate) occluded: usize,
    pub(crate) lost: usize,
}

impl StateCounts {
    /// Returns the number of rows.
    pub(crate) fn rows(&self) -> usize {
        self.searching + self.tracking + self.occluded + self.lost
    }
}

impl SeriesCollector {
    /// Creates a collector for targets of these names.
    pub(crate) fn new(names: &[String]) -> Self {
        let tracks = names
            .iter()
            .map(|name| TrackSeries {
                name: name.clone(),
                rows: Vec::new(),
            })
            .collect();
        Self {
            tracks,
            states: vec![StateCounts::default(); names.len()],
        }
    }

    /// Returns the number of rows in each state for each target.
    pub(crate) fn states(&self) -> &[StateCounts] {
        &self.states
    }

    /// Draws the plots into a folder, with the truth if it is known.
    pub(crate) fn draw(
        &self,
        folder: &Path,
        scene: &Scene,
        truth: &[Series<TrueState>],
    ) -> Result<Vec<PathBuf>> {
        let truth = truth_series(truth);
        write_track_plots(folder, &self.tracks, &truth, &CameraSymbol::of_scene(scene))
    }
}

/// Returns the true paths for plots.
pub(crate) fn truth_series(truth: &[Series<TrueState>]) -> Vec<TruthSeries> {
    let series = truth.iter().map(|object| TruthSeries {
        rows: object
            .rows
            .iter()
            .map(|(time_s, state)| (*time_s, state.position_m))
            .collect(),
    });
    series.collect()
}

impl Sink for SeriesCollector {
    fn take(&mut self, instant: &Instant) -> Result<()> {
        for ((track, states), estimate) in self
            .tracks
            .iter_mut()
            .zip(&mut self.states)
            .zip(instant.estimates)
        {
            *match estimate.state {
                TrackState::Searching => &mut states.searching,
                TrackState::Tracking => &mut states.tracking,
                TrackState::Occluded => &mut states.occluded,
                TrackState::Lost => &mut states.lost,
            } += 1;
            track.rows.push(Sample {
                time_s: instant.time_s,
                position_m: estimate.kinematics.map(|k| k.position_m),
                covariance_m2: estimate.kinematics.map(|k| k.covariance_m2),
                is_seen: estimate.state == TrackState::Tracking,
            });
        }
        Ok(())
    }
}
