//! Figures of an experiment: the paths of all its runs over one another, from above and in an oblique view.

use std::path::{Path, PathBuf};

use super::camera_symbol::CameraSymbol;
use super::plots::{Figures, TrackSeries, TruthSeries};
use super::svg::write_svg_and_png;

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

#[cfg(test)]
#[path = "paths_tests.rs"]
mod tests;
