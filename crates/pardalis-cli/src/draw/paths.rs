//! Figures of an experiment: the paths of all its runs over one another, from above and in an oblique view.

use std::path::{Path, PathBuf};

use super::camera_symbol::CameraSymbol;
use super::plots::{Figures, Sample, TrackSeries, TruthSeries};
use super::svg::{Drawing, write_svg_and_png};

/// Tracks that share a colour and an entry of the legend, such as all runs of one method.
#[derive(Debug, Clone)]
pub(crate) struct PathGroup {
    /// What the legend calls them.
    pub(crate) name: String,
    /// The runs.
    pub(crate) tracks: Vec<TrackSeries>,
}

/// Draws the paths of groups of runs with truth and cameras into `STEM-top` and `STEM-3d`, each `.svg` and `.png`, in
/// a folder that must exist. Returns the paths of the files.
///
/// Positions are in the world frame, in metres; those that are not finite or beyond 100 km count as missing.
/// Estimates far from the truth are cut off (without truth or if `reaches_far` is set: those far from 98 % of the
/// estimates), and a note states their number.
pub(crate) fn write_path_figures(
    folder: &Path,
    stem: &str,
    groups: &[PathGroup],
    truth: &[TruthSeries],
    cameras: &[CameraSymbol],
    reaches_far: bool,
) -> anyhow::Result<Vec<PathBuf>> {
    let tracks = groups
        .iter()
        .flat_map(|group| group.tracks.iter().map(|track| (&*group.name, track)));
    let figures = Figures::new(tracks, truth, cameras, reaches_far);
    let mut paths = Vec::new();
    for (name, document) in [("top", figures.above()?), ("3d", figures.oblique()?)] {
        paths.extend(write_svg_and_png(
            folder,
            &format!("{stem}-{name}"),
            &document,
        )?);
    }
    Ok(paths)
}

/// Draws cameras and the path of a ball (world frame; seconds, metres) from above and from the side.
pub(crate) fn rig_figures(
    path_m: &[(f64, [f64; 3])],
    cameras: &[CameraSymbol],
) -> anyhow::Result<[Drawing; 2]> {
    let rows = path_m.iter().map(|&(time_s, position_m)| Sample {
        time_s,
        position_m: Some(position_m),
        covariance_m2: None,
        is_seen: true,
    });
    let ball = TrackSeries {
        name: "ball".to_owned(),
        rows: rows.collect(),
    };
    let figures = Figures::new([("ball", &ball)].into_iter(), &[], cameras, true);
    Ok([figures.above()?, figures.side()?])
}

#[cfg(test)]
#[path = "paths_tests.rs"]
mod tests;
