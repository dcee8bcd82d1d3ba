//! Errors of positions in the camera's spherical coordinates, each against distance.

use std::path::{Path, PathBuf};

use plotters::prelude::*;

use super::legend::{self, Key, group_mark};
use super::limits::{clipped, is_inside, outside_note, shown_range_with_zero};
use super::panel::{Axis, draw_path, extent, padded, panel, write_note};
use super::plots::WIDTH_PX;
use super::svg::{Area, drawing, line, units, write_svg_and_png};
use super::{INK, PALETTE};

/// Height of each of the three panels.
const PANEL_HEIGHT_PX: f64 = 250.0;

/// The mean is drawn over at most `MAX_BINS` parts of the distance, with at least `MIN_BIN_VALUES` values each on
/// average.
const MAX_BINS: usize = 8;
const MIN_BIN_VALUES: usize = 4;

/// Smaller differences are rounding errors.
const MIN_SPAN: f64 = 0.1;

/// Distance in metres; errors of distance, elevation and azimuth in millimetres and milliradians.
type InPlotUnits = (f64, [f64; 3]);

/// The error of one estimated position as a camera sees it: estimate minus truth.
#[derive(Debug, Clone, Copy)]
pub(crate) struct SphericalError {
    /// From the camera to the true position, in metres.
    pub(crate) distance_m: f64,
    /// In metres; positive if the estimate is too far away.
    pub(crate) distance_error_m: f64,
    /// In radians.
    pub(crate) elevation_error_rad: f64,
    /// In radians.
    pub(crate) azimuth_error_rad: f64,
}

impl SphericalError {
    fn in_plot_units(&self) -> InPlotUnits {
        let errors = [
            self.distance_error_m,
            self.elevation_error_rad,
            self.azimuth_error_rad,
        ];
        (self.distance_m, errors.map(|error| 1e3 * error))
    }
}

/// Errors that share a mark and an entry of the legend.
#[derive(Debug, Clone)]
pub(crate) struct ErrorGroup {
    /// What the legend calls them.
    pub(crate) name: String,
    /// The errors, in any order.
    pub(crate) errors: Vec<SphericalError>,
}

/// Draws errors of distance, elevation and azimuth against distance, and their means over parts of the distance, into
/// `STEM-errors.svg` and `.png` in a folder that must exist. Returns the paths of the files.
///
/// Leaves out errors that are not finite and errors far outside the range of 98 % of them; a note states their number.
pub(crate) fn write_error_figures(
    folder: &Path,
    stem: &str,
    groups: &[ErrorGroup],
) -> anyhow::Result<Vec<PathBuf>> {
    let groups: Vec<(&str, Vec<InPlotUnits>)> = groups
        .iter()
        .map(|group| {
            let errors = group.errors.iter().map(SphericalError::in_plot_units);
            let drawable = |(distance, errors): &InPlotUnits| {
                distance.abs() < 1e5 && errors.iter().all(|e| e.abs() < 1e9)
            };
            (&*group.name, errors.filter(drawable).collect())
        })
        .collect();
    let distances = groups
        .iter()
        .flat_map(|(_, errors)| errors.iter().map(|e| e.0));
    let distance_m = padded(extent(distances), MIN_SPAN);
    let drawing = drawing([WIDTH_PX, 3.0 * PANEL_HEIGHT_PX], |area| {
        let (plots, column) = area.split_horizontally(units(WIDTH_PX - legend::WIDTH_PX));
        let names = groups.iter().enumerate();
        let mut entries: Vec<_> = names
            .map(|(i, (name, _))| (Key::Mark(i), (*name).to_owned()))
            .collect();
        entries.push((Key::Track([128; 3]), "mean".to_owned()));
        legend::draw(&column, &entries)?;
        let names = [
            "distance error (mm)",
            "elevation error (mrad)",
            "azimuth error (mrad)",
        ];
        for (i, area) in plots.split_evenly((3, 1)).iter().enumerate() {
            let across = Axis::new(distance_m.clone(), "distance from the camera (m)");
            let points = groups
                .iter()
                .map(|(_, errors)| errors.iter().map(|(at_m, e)| [*at_m, e[i]]).collect());
            draw_panel(area, across, names[i], points.collect())?;
        }
        Ok(())
    })?;
    let name = format!("{stem}-errors");
    Ok(write_svg_and_png(folder, &name, &drawing)?.into())
}

/// Draws the points (distance, error) of each group.
fn draw_panel(
    area: &Area<'_>,
    across: Axis<'_>,
    name: &str,
    groups: Vec<Vec<[f64; 2]>>,
) -> anyhow::Result<()> {
    let all: Vec<f64> = groups.iter().flatten().map(|point| point[1]).collect();
    let shown = padded(Some(shown_range_with_zero(&all)), MIN_SPAN);
    let ranges = [across.range(), shown.clone()];
    let mut panel = panel(area, &across, &Axis::new(shown, name))?;
    let zero = [(ranges[0].start, 0.0), (ranges[0].end, 0.0)];
    draw_path(&mut panel, &zero, line(INK, 1.0, 1.0))?;
    // Translucent where many marks overlap.
    let opacity = (200.0 / all.len().max(1) as f64).clamp(0.25, 0.9);
    for (i, points) in groups.iter().enumerate() {
        let inside = points.iter().filter(|point| is_inside(point, &ranges));
        panel.draw_series(
            inside.map(|[x, y]| EmptyElement::at((*x, *y)) + group_mark(i, opacity)),
        )?;
    }
    for (i, points) in groups.iter().enumerate() {
        for piece in clipped(&means(points), &ranges) {
            let piece: Vec<_> = piece.into_iter().map(|[x, y]| (x, y)).collect();
            draw_path(
                &mut panel,
                &piece,
                line(PALETTE[i % PALETTE.len()], 1.0, 2.5),
            )?;
        }
    }
    let outside = groups.iter().flatten().filter(|p| !is_inside(p, &ranges));
    match outside_note(outside.count(), all.len()) {
        Some(note) => write_note(area, &note),
        None if all.is_empty() => write_note(area, "no estimate"),
        None => Ok(()),
    }
}

/// Returns the mean points of equal parts of the distance; parts without points are left out.
fn means(points: &[[f64; 2]]) -> Vec<[f64; 2]> {
    let Some(distances) = extent(points.iter().map(|point| point[0])) else {
        return Vec::new();
    };
    let count = (points.len() / MIN_BIN_VALUES).clamp(1, MAX_BINS);
    let width = ((distances.end() - distances.start()) / count as f64).max(1e-12);
    let mut sums = vec![(0.0, [0.0; 2]); count];
    for point in points {
        let bin = ((point[0] - distances.start()) / width) as usize;
        let (number, sum) = &mut sums[bin.min(count - 1)];
        *number += 1.0;
        for (sum, value) in sum.iter_mut().zip(point) {
            *sum += value;
        }
    }
    let filled = sums.into_iter().filter(|(number, _)| *number > 0.0);
    filled
        .map(|(number, sum)| sum.map(|s| s / number))
        .collect()
}

#[cfg(test)]
#[path = "errors_tests.rs"]
mod tests;
