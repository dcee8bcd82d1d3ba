//! A plot of a colour model: its most frequent bins, and how well its score separates object and background.

use std::path::{Path, PathBuf};

use plotters::prelude::*;
use plotters::style::text_anchor::HPos;

use super::panel::{Axis, LEFT_PX, TOP_PX, draw_path, extent, padded, panel};
use super::svg::{Area, drawing, fill, line, text_style, units, write_svg_and_png, write_text};
use super::{INK, PALETTE, Rgb, shortened};

/// One bin of a colour histogram.
#[derive(Debug, Clone)]
pub(crate) struct ColorBin {
    /// The mean colour of the bin.
    pub(crate) color: Rgb,
    /// Its label.
    pub(crate) label: String,
    /// The share of the object's pixels in the bin, from 0 to 1.
    pub(crate) share: f64,
}

/// The contents of the plot of a colour model.
#[derive(Debug, Clone)]
pub(crate) struct ColorModelPlot {
    /// In any order; only the most frequent bins are drawn.
    pub(crate) bins: Vec<ColorBin>,
    /// Scores of the object's labelled pixels, each with its number of pixels; infinite scores count at the ends of
    /// the axis.
    pub(crate) object_log_odds: Vec<(f64, u64)>,
    /// Scores of the background's pixels, likewise.
    pub(crate) background_log_odds: Vec<(f64, u64)>,
    /// Pixels with higher scores are classified as the object's.
    pub(crate) threshold: f64,
}

const MAX_BARS: usize = 24;
const CLASSES: usize = 60;

const SIZE_PX: [f64; 2] = [960.0, 460.0];
const BARS_WIDTH_PX: f64 = 430.0;
const TITLE_PX: f64 = 40.0;
const OBJECT: Rgb = PALETTE[1];
const BACKGROUND: Rgb = PALETTE[0];

/// Draws a colour model into `NAME.svg` and `NAME.png` in a folder that must exist.
pub(crate) fn write_color_model_plot(
    folder: &Path,
    name: &str,
    plot: &ColorModelPlot,
) -> anyhow::Result<[PathBuf; 2]> {
    let document = drawing(SIZE_PX, |area| {
        let (bars, scores) = area.split_horizontally(units(BARS_WIDTH_PX));
        draw_bars(&bars, &plot.bins)?;
        draw_scores(&scores, plot)
    })?;
    write_svg_and_png(folder, name, &document)
}

fn draw_bars(area: &Area<'_>, bins: &[ColorBin]) -> anyhow::Result<()> {
    const LABEL_END_PX: f64 = 130.0;
    const LONGEST_PX: f64 = BARS_WIDTH_PX - LABEL_END_PX - 66.0;
    let mut bins: Vec<_> = bins
        .iter()
        .filter(|b| b.share.is_finite() && b.share > 0.0)
        .collect();
    bins.sort_by(|a, b| b.share.total_cmp(&a.share));
    let in_use = bins.len();
    bins.truncate(MAX_BARS);
    let title = text_style(14.0, HPos::Left);
    let Some(largest) = bins.first().map(|bin| bin.share) else {
        return write_text(area, "The histogram is empty", [12.0, 20.0], &title);
    };
    let title_text = match bins.len() {
        all if all == in_use => format!("Colours, the most frequent first ({all})"),
        shown => format!("The {shown} most frequent of {in_use} colours"),
    };
    write_text(area, &title_text, [12.0, 20.0], &title)?;
    let row_px = (SIZE_PX[1] - TITLE_PX - TOP_PX) / MAX_BARS as f64;
    for (row, bin) in bins.iter().enumerate() {
        let middle_px = TITLE_PX + row_px * (row as f64 + 0.5);
        let length_px = LONGEST_PX * bin.share / largest;
        let corners = [
            (units(LABEL_END_PX), units(middle_px - 0.42 * row_px)),
            (
                units(LABEL_END_PX + length_px),
                units(middle_px + 0.42 * row_px),
            ),
        ];
        area.draw(&Rectangle::new(corners, fill(bin.color, 1.0)))?;
        // A rim, for colours as pale as the paper.
        area.draw(&Rectangle::new(corners, line([128; 3], 1.0, 0.6)))?;
        let label = shortened(&bin.label, 17);
        let label_px = [LABEL_END_PX - 6.0, middle_px];
        write_text(area, &label, label_px, &text_style(11.5, HPos::Right))?;
        let share = format!("{:.1} %", 100.0 * bin.share);
        let share_px = [LABEL_END_PX + length_px + 6.0, middle_px];
        write_text(area, &share, share_px, &text_style(11.5, HPos::Left))?;
    }
    Ok(())
}

fn draw_scores(area: &Area<'_>, plot: &ColorModelPlot) -> anyhow::Result<()> {
    let (title, area) = area.split_vertically(units(TITLE_PX));
    let keys = [
        (
            format!("object: {} pixels", pixels(&plot.object_log_odds)),
            OBJECT,
        ),
        (
            format!("background: {} pixels", pixels(&plot.background_log_odds)),
            BACKGROUND,
        ),
    ];
    let mut left_px = LEFT_PX;
    for (text, color) in keys {
        let ends = [
            (units(left_px), units(20.0)),
            (units(left_px + 22.0), units(20.0)),
        ];
        title.draw(&PathElement::new(ends, line(color, 1.0, 2.5)))?;
        write_text(
            &title,
            &text,
            [left_px + 28.0, 20.0],
            &text_style(13.0, HPos::Left),
        )?;
        left_px += 200.0;
    }

    let scores = plot.object_log_odds.iter().chain(&plot.background_log_odds);
    let shown = scores
        .filter(|(_, pixels)| *pixels > 0)
        .map(|(score, _)| *score)
        .chain([plot.threshold])
        .filter(|score| score.abs() < 1e6);
    let range = padded(extent(shown), 1.0);
    let outlines = [
        outline(&plot.background_log_odds, &range),
        outline(&plot.object_log_odds, &range),
    ];
    let largest = outlines
        .iter()
        .flatten()
        .map(|(_, percent)| *percent)
        .fold(0.0, f64::max);
    let x = Axis::new(range.clone(), "log odds of object against background");
    let top = (1.1 * largest).max(1.0);
    let y = Axis::new(0.0..top, "share of the pixels (%)");
    let mut panel = panel(&area, &x, &y)?;
    for (outline, color) in outlines.iter().zip([BACKGROUND, OBJECT]) {
        if !outline.is_empty() {
            panel.draw_series([Polygon::new(outline.clone(), fill(color, 0.15))])?;
            draw_path(&mut panel, outline, line(color, 1.0, 2.0))?;
        }
    }
    if !range.contains(&plot.threshold) {
        return Ok(());
    }
    let ends = [(plot.threshold, 0.0), (plot.threshold, top)];
    draw_path(&mut panel, &ends, line(INK, 1.0, 1.5))?;
    let right_half = plot.threshold > 0.5 * (range.start + range.end);
    let (side, aside_px) = if right_half {
        (HPos::Right, -6.0)
    } else {
        (HPos::Left, 6.0)
    };
    let text = Text::new(
        format!("threshold {:.2}", plot.threshold).replace('-', "−"),
        (units(aside_px), units(10.0)),
        text_style(12.0, side),
    );
    panel.draw_series([EmptyElement::at((plot.threshold, top)) + text])?;
    Ok(())
}

fn pixels(scores: &[(f64, u64)]) -> u64 {
    scores.iter().map(|(_, pixels)| pixels).sum()
}

/// Returns the outline of the distribution of scores over the range, in percent per class; empty without scores.
fn outline(scores: &[(f64, u64)], range: &std::ops::Range<f64>) -> Vec<(f64, f64)> {
    let width = (range.end - range.start) / CLASSES as f64;
    let mut counts = [0; CLASSES];
    for (score, pixels) in scores.iter().filter(|(score, _)| !score.is_nan()) {
        let class = ((score - range.start) / width).clamp(0.0, CLASSES as f64 - 1.0);
        counts[class as usize] += pixels;
    }
    let total: u64 = counts.iter().sum();
    if total == 0 {
        return Vec::new();
    }
    let mut outline = vec![(range.start, 0.0)];
    for (class, count) in counts.iter().enumerate() {
        let percent = 100.0 * *count as f64 / total as f64;
        let left = range.start + width * class as f64;
        outline.extend([(left, percent), (left + width, percent)]);
    }
    outline.push((range.end, 0.0));
    outline
}

#[cfg(test)]
#[path = "histogram_tests.rs"]
mod tests;
