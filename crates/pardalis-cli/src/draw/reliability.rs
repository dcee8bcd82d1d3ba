//! Stated confidences against the share of rows that are right.

use std::path::{Path, PathBuf};

use pardalis_evaluate::{Bin, Reliability};
use plotters::prelude::*;

use super::legend::{self, Key, group_mark};
use super::panel::{Axis, Panel, draw_path, panel, write_note};
use super::svg::{Area, drawing, line, units, write_svg_and_png};
use super::{INK, PALETTE};

/// Width of the panels, and their heights.
const PANEL_WIDTH_PX: f64 = 480.0;
const SHARES_HEIGHT_PX: f64 = 440.0;
const ROWS_HEIGHT_PX: f64 = 200.0;

/// Range of confidences and shares, with room for marks at the ends.
const SHARES: std::ops::Range<f64> = -0.03..1.03;

/// The rows of tracks that share a mark and an entry of the legend.
#[derive(Debug, Clone)]
pub(crate) struct ReliabilityGroup {
    /// What the legend calls them.
    pub(crate) name: String,
    /// The reliability of their confidences.
    pub(crate) reliability: Reliability,
}

/// Draws the share of right rows against their mean confidence, one mark per bin, with the line on which both are
/// equal, and below it the number of rows, into `STEM-reliability.svg` and `.png` in a folder that must exist.
/// Returns the paths of the files.
pub(crate) fn write_reliability_figures(
    folder: &Path,
    stem: &str,
    groups: &[ReliabilityGroup],
) -> anyhow::Result<Vec<PathBuf>> {
    let size_px = [
        PANEL_WIDTH_PX + legend::WIDTH_PX,
        SHARES_HEIGHT_PX + ROWS_HEIGHT_PX,
    ];
    let drawing = drawing(size_px, |area| {
        let (plots, column) = area.split_horizontally(units(PANEL_WIDTH_PX));
        let named = |(i, group): (usize, &ReliabilityGroup)| {
            let error = group.reliability.calibration_error;
            (Key::Mark(i), format!("{}: error {error:.3}", group.name))
        };
        let mut entries: Vec<_> = groups.iter().enumerate().map(named).collect();
        entries.push((Key::Truth, "perfectly calibrated".to_owned()));
        legend::draw(&column, &entries)?;
        let (upper, lower) = plots.split_vertically(units(SHARES_HEIGHT_PX));
        draw_shares(&upper, groups)?;
        draw_rows(&lower, groups)
    })?;
    Ok(write_svg_and_png(folder, &format!("{stem}-reliability"), &drawing)?.into())
}

fn draw_shares(area: &Area<'_>, groups: &[ReliabilityGroup]) -> anyhow::Result<()> {
    let across = Axis::new(SHARES, "confidence");
    let mut panel = panel(area, &across, &Axis::new(SHARES, "share that is right"))?;
    draw_path(&mut panel, &[(0.0, 0.0), (1.0, 1.0)], line(INK, 1.0, 1.0))?;
    draw_bins(&mut panel, groups, |bin| bin.share_right)?;
    if groups.is_empty() {
        write_note(area, "no confidence")?;
    }
    Ok(())
}

fn draw_rows(area: &Area<'_>, groups: &[ReliabilityGroup]) -> anyhow::Result<()> {
    let bins = groups.iter().flat_map(|group| &group.reliability.bins);
    let most = bins.map(|bin| bin.rows).max().unwrap_or(1) as f64;
    let rows = Axis::logarithmic(-0.1..libm::log10(most) + 0.2, "rows");
    let mut panel = panel(area, &Axis::new(SHARES, "confidence"), &rows)?;
    draw_bins(&mut panel, groups, |bin| libm::log10(bin.rows as f64))
}

/// Draws one mark per bin and a line through the marks of each group.
fn draw_bins(
    panel: &mut Panel<'_>,
    groups: &[ReliabilityGroup],
    of: impl Fn(&Bin) -> f64,
) -> anyhow::Result<()> {
    for (i, group) in groups.iter().enumerate() {
        let bins = &group.reliability.bins;
        let points: Vec<_> = bins.iter().map(|b| (b.mean_confidence, of(b))).collect();
        draw_path(panel, &points, line(PALETTE[i % PALETTE.len()], 0.8, 1.2))?;
        let marks = points
            .iter()
            .map(|at| EmptyElement::at(*at) + group_mark(i, 1.0));
        panel.draw_series(marks)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::draw::test_folder;
    use pardalis_evaluate::{CheckedConfidence, reliability};

    /// Left in `draw-tests` beside the test program.
    #[test]
    fn groups_are_named_with_their_errors() {
        let folder = test_folder("reliability");
        let checks = |every: usize| -> Vec<CheckedConfidence> {
            let check = |i: usize| CheckedConfidence {
                confidence: (i % 100) as f64 / 99.0,
                is_right: !i.is_multiple_of(every),
            };
            (0..900).map(check).collect()
        };
        let group = |name: &str, every| ReliabilityGroup {
            name: name.to_owned(),
            reliability: reliability(&checks(every)).unwrap(),
        };
        let groups = [group("clutter", 2), group("plain", 7)];
        let files = write_reliability_figures(&folder, "two", &groups).unwrap();
        assert!(crate::source::decode::decode_image(&files[1]).is_ok());
        let svg = std::fs::read_to_string(&files[0]).unwrap();
        assert!(!svg.contains("NaN") && !svg.contains("inf"));
        for text in ["share that is right", "rows", "plain: error"] {
            assert!(svg.lines().any(|line| line == text), "{text}");
        }
        let empty = write_reliability_figures(&folder, "empty", &[]).unwrap();
        let svg = std::fs::read_to_string(&empty[0]).unwrap();
        assert!(svg.contains("no confidence"));
    }
}
