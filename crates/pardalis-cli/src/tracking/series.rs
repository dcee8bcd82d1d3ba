//! Collects the track of each target for plots and for the final report.

use std::path::{Path, PathBuf};

use anyhow::Result;
use pardalis::camera::Pose;
use pardalis::tracker::TrackState;
use pardalis_evaluate::TrueState;
use pardalis_scene::Scene;

use super::{Instant, Sink};
use crate::draw::camera_symbol::CameraSymbol;
use crate::draw::plots::{Sample, TrackSeries, TruthSeries, write_track_plots};
use crate::tables::Series;

/// The most samples of a track that are kept: several a pixel of the plots. Runs may last for weeks.
const MAX_SAMPLES: usize = 1 << 15;

/// Collects the tracks.
pub(crate) struct SeriesCollector {
    names: Vec<String>,
    tracks: Vec<Thinned<Sample>>,
    states: Vec<StateCounts>,
    /// The poses of each camera in the world; none for cameras at rest.
    poses: Vec<Option<Thinned<Pose>>>,
}

/// The first of all samples, and every second, fourth and so on if there are many.
#[derive(Debug, Clone)]
struct Thinned<T> {
    samples: Vec<T>,
    /// The most samples, an even number.
    limit: usize,
    /// Number of samples that were given.
    given: usize,
    /// Samples are kept whose number is a multiple of this.
    step: usize,
}

impl<T> Thinned<T> {
    fn new(limit: usize) -> Self {
        Self {
            samples: Vec::new(),
            limit,
            given: 0,
            step: 1,
        }
    }

    fn push(&mut self, sample: T) {
        if self.given.is_multiple_of(self.step) {
            if self.samples.len() == self.limit {
                let mut number = 0;
                self.samples.retain(|_| {
                    number += 1;
                    number % 2 == 1
                });
                self.step *= 2;
            }
            self.samples.push(sample);
        }
        self.given += 1;
    }
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
    /// Creates a collector for the targets and the moving cameras of a scene.
    pub(crate) fn new(scene: &Scene) -> Self {
        let names: Vec<String> = scene.targets.iter().map(|t| t.name.clone()).collect();
        let poses = scene.cameras.iter();
        let poses = poses.map(|camera| camera.platform.as_ref().map(|_| Thinned::new(MAX_SAMPLES)));
        Self {
            tracks: vec![Thinned::new(MAX_SAMPLES); names.len()],
            states: vec![StateCounts::default(); names.len()],
            poses: poses.collect(),
            names,
        }
    }

    /// Returns the number of rows in each state for each target.
    pub(crate) fn states(&self) -> &[StateCounts] {
        &self.states
    }

    /// Replaces the track of each target.
    pub(super) fn replace(&mut self, tracks: impl Iterator<Item = Vec<Sample>>) {
        for (track, samples) in self.tracks.iter_mut().zip(tracks) {
            *track = Thinned::new(MAX_SAMPLES);
            for sample in samples {
                track.push(sample);
            }
        }
    }

    /// Draws the plots into a folder, with the truth if it is known.
    pub(crate) fn draw(
        &self,
        folder: &Path,
        scene: &Scene,
        truth: &[Series<TrueState>],
    ) -> Result<Vec<PathBuf>> {
        let truth = truth_series(truth);
        let tracks: Vec<_> = self
            .names
            .iter()
            .zip(&self.tracks)
            .map(|(name, track)| TrackSeries {
                name: name.clone(),
                rows: track.samples.clone(),
            })
            .collect();
        let moved = |symbol: CameraSymbol| {
            let number = scene.cameras.iter().position(|c| c.name == symbol.name);
            match number.and_then(|number| self.poses[number].as_ref()) {
                Some(poses) => symbol.moved(&poses.samples),
                None => symbol,
            }
        };
        let cameras = CameraSymbol::of_scene(scene).into_iter().map(moved);
        write_track_plots(folder, &tracks, &truth, &cameras.collect::<Vec<_>>())
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
        let views = instant.tracker.views().iter();
        for (poses, view) in self.poses.iter_mut().zip(views) {
            if let Some(poses) = poses {
                poses.push(*view.world_from_camera());
            }
        }
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
            track.push(Sample::of(instant.time_s, estimate));
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_tracks_are_thinned_evenly() {
        let mut thinned = Thinned::new(4);
        let mut kept = Vec::new();
        for number in 0..18 {
            thinned.push(number);
            kept.push(thinned.samples.clone());
        }
        assert_eq!(kept[3], [0, 1, 2, 3]);
        assert_eq!(kept[4], [0, 2, 4]);
        assert_eq!(kept[8], [0, 4, 8]);
        assert_eq!(kept[17], [0, 8, 16]);
    }
}
