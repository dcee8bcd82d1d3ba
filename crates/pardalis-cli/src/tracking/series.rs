//! Collects the track of each target for plots and for the final report.

use std::collections::BTreeMap;
use std::collections::btree_map::Entry;
use std::path::{Path, PathBuf};

use anyhow::Result;
use pardalis::camera::Pose;
use pardalis::tracker::TrackState;
use pardalis_evaluate::TrueState;
use pardalis_scene::{Scene, TargetConfig};

use super::tracked::name;
use super::{Instant, Sink};
use crate::draw::camera_symbol::CameraSymbol;
use crate::draw::plots::{Sample, TrackSeries, TruthSeries, write_track_plots};
use crate::tables::Series;

/// The most samples of a track that are kept: several a pixel of the plots. Runs may last for weeks.
const MAX_SAMPLES: usize = 1 << 15;

/// The most members of crowds whose tracks are kept. Runs may last for weeks.
const MAX_MEMBERS: usize = 500;

/// With more members, those of a crowd have one entry in the legend. Hand-set: the number of colours.
const MAX_NAMED: u32 = 8;

/// Collects the tracks.
pub(crate) struct SeriesCollector {
    targets: Vec<TargetConfig>,
    /// The track of each target and each member of a crowd.
    tracks: BTreeMap<Key, Thinned<Sample>>,
    states: Vec<StateCounts>,
    /// One per target.
    crowds: Vec<CrowdCounts>,
    /// The poses of each camera in the world, by times in seconds; none for cameras at rest.
    poses: Vec<Option<Thinned<(f64, Pose)>>>,
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

/// The number of a target and, for a member of a crowd, its own.
pub(super) type Key = (usize, Option<u32>);

/// How many members a crowd had.
#[derive(Debug, Clone, Copy, Default, serde::Serialize)]
pub(crate) struct CrowdCounts {
    /// The members that were found.
    pub(crate) found: u32,
    /// The most that were tracked or occluded at once.
    pub(crate) most_at_once: usize,
}

/// Number of rows of a target in each state; for a crowd the number of frames by the best state of any member.
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
        let count = scene.targets.len();
        let poses = scene.cameras.iter();
        let poses = poses.map(|camera| camera.platform.as_ref().map(|_| Thinned::new(MAX_SAMPLES)));
        Self {
            targets: scene.targets.clone(),
            tracks: BTreeMap::new(),
            states: vec![StateCounts::default(); count],
            crowds: vec![CrowdCounts::default(); count],
            poses: poses.collect(),
        }
    }

    /// Returns how many members each target had that is a crowd.
    pub(crate) fn crowds(&self) -> &[CrowdCounts] {
        &self.crowds
    }

    /// Returns the number of rows in each state for each target.
    pub(crate) fn states(&self) -> &[StateCounts] {
        &self.states
    }

    /// Replaces tracks.
    pub(super) fn replace(&mut self, tracks: impl Iterator<Item = (Key, Vec<Sample>)>) {
        for (key, samples) in tracks {
            let Some(track) = self.tracks.get_mut(&key) else {
                continue;
            };
            *track = Thinned::new(MAX_SAMPLES);
            for sample in samples {
                track.push(sample);
            }
        }
    }

    /// Returns the poses of a camera in the world, by times in seconds; none if it is at rest.
    pub(crate) fn poses(&self, camera: usize) -> &[(f64, Pose)] {
        let poses = self.poses[camera].as_ref();
        poses.map_or(&[], |poses| &poses.samples)
    }

    /// Draws the plots into a folder, with the truth if it is known.
    pub(crate) fn draw(
        &self,
        folder: &Path,
        scene: &Scene,
        truth: &[Series<TrueState>],
    ) -> Result<Vec<PathBuf>> {
        let truth = truth_series(truth);
        let tracks = self.tracks.iter().map(|((target, member), track)| {
            let is_named = self.crowds[*target].found <= MAX_NAMED;
            TrackSeries {
                name: name(&self.targets[*target].name, member.filter(|_| is_named)),
                rows: track.samples.clone(),
            }
        });
        let tracks: Vec<_> = tracks.collect();
        let moved = |symbol: CameraSymbol| {
            let number = scene.cameras.iter().position(|c| c.name == symbol.name);
            let poses = number.map_or(&[][..], |number| self.poses(number));
            symbol.moved(poses.iter().map(|(_, pose)| pose))
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
                poses.push((instant.time_s, *view.world_from_camera()));
            }
        }
        for tracked in instant.tracked {
            let is_full = self.tracks.len() >= self.targets.len() + MAX_MEMBERS;
            let track = match self.tracks.entry(tracked.key()) {
                Entry::Vacant(_) if is_full => continue,
                entry => entry.or_insert_with(|| Thinned::new(MAX_SAMPLES)),
            };
            track.push(Sample::of(instant.time_s, &tracked.estimate));
        }
        for (number, (states, crowd)) in self.states.iter_mut().zip(&mut self.crowds).enumerate() {
            let of_target = || instant.tracked.iter().filter(|one| one.target == number);
            let count = |state| {
                of_target()
                    .filter(|one| one.estimate.state == state)
                    .count()
            };
            let [tracking, occluded, lost] =
                [TrackState::Tracking, TrackState::Occluded, TrackState::Lost].map(count);
            *if tracking > 0 {
                &mut states.tracking
            } else if occluded > 0 {
                &mut states.occluded
            } else if lost > 0 {
                &mut states.lost
            } else {
                &mut states.searching
            } += 1;
            let newest = of_target().filter_map(|one| one.member).max();
            crowd.found = crowd.found.max(newest.unwrap_or(0));
            crowd.most_at_once = crowd.most_at_once.max(tracking + occluded);
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
