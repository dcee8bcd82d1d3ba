//! Pictures of a calibration: observed points and their projections.

use std::collections::BTreeMap;

use plotters::prelude::*;
use plotters::style::text_anchor::HPos;

use super::panel::{Axis, BOTTOM_PX, LEFT_PX, RIGHT_PX, TOP_PX, equal_scales, padded, panel};
use super::svg::{Area, Drawing, drawing, fill, line, text_style, units, write_text};
use super::{INK, PALETTE, Rgb, shortened};

/// Cells along one side of the coverage grid.
pub(crate) const GRID_CELLS: usize = 10;

/// Width of every picture.
const WIDTH_PX: f64 = 720.0;

/// Space around the image plane, for its pixel coordinates.
const MARGIN_PX: f64 = 44.0;

/// Height of the line of text under a picture.
const CAPTION_PX: f64 = 26.0;

/// Arrows are magnified so that a typical one has this length in the picture.
const ARROW_PX: f64 = 24.0;

/// Maximum length of an arrow in the picture.
const MAX_ARROW_PX: f64 = 80.0;

/// With more arrows or marks than this, they would cover one another.
const MAX_MARKS: usize = 600;

/// Number of cells along the longer side of the image in which residuals are averaged.
const MEAN_CELLS: f64 = 28.0;

const OBSERVED: Rgb = PALETTE[0];
const PROJECTED: Rgb = PALETTE[1];
const OUTLIER: Rgb = PALETTE[3];

/// An observed point in an image, with its residual.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ObservedPoint {
    /// Its observed position, in pixels.
    pub(crate) observed: [f64; 2],
    /// Observed minus projected, in pixels; `None` if the point does not project into the camera.
    pub(crate) residual_px: Option<[f64; 2]>,
    /// Whether the fit left it out.
    pub(crate) outlier: bool,
}

impl ObservedPoint {
    /// Returns the position at which the camera model projects the point, in pixels.
    pub(crate) fn projected(&self) -> Option<[f64; 2]> {
        let [du, dv] = self.residual_px?;
        Some([self.observed[0] - du, self.observed[1] - dv])
    }
}

/// Draws observed points as circles and projected ones as crosses, over the image's area.
pub(crate) fn observed_and_projected(
    size_px: (usize, usize),
    points: &[ObservedPoint],
) -> anyhow::Result<Drawing> {
    let caption = "circle: observed; cross: projected; violet: left out of the fit";
    // Marks shrink if there are many points, but points left out of the fit stay large and are drawn last.
    let small = (MAX_MARKS as f64 / points.len().max(1) as f64)
        .sqrt()
        .min(1.0);
    let (left_out, fitted): (Vec<&ObservedPoint>, Vec<&ObservedPoint>) =
        points.iter().partition(|s| s.outlier);
    image_picture(size_px, caption, |plane, area| {
        for point in fitted.into_iter().chain(left_out) {
            let (color, size) = if point.outlier {
                (OUTLIER, 1.0)
            } else {
                (OBSERVED, small)
            };
            let style = |color| line(color, 0.9, 1.2 * size.max(0.5));
            let at = plane.at(point.observed);
            area.draw(&Circle::new(at, units(4.5 * size), style(color)))?;
            if let Some(projected) = point.projected().filter(|p| plane.is_near(*p)) {
                let (x, y) = plane.at(projected);
                let arm = units(3.5 * size);
                for sign in [-1, 1] {
                    let ends = [(x - arm, y - sign * arm), (x + arm, y + sign * arm)];
                    area.draw(&PathElement::new(ends, style(PROJECTED)))?;
                }
            }
        }
        Ok(())
    })
}

/// Draws residuals as magnified arrows from the projected to the observed points. Many points are averaged in cells.
pub(crate) fn residual_arrows(
    size_px: (usize, usize),
    points: &[ObservedPoint],
) -> anyhow::Result<Drawing> {
    let (shown, [what, note]) = if points.len() > MAX_MARKS {
        let means = mean_residuals(size_px, points);
        (means, ["mean residuals of small areas", ""])
    } else {
        let note = "; violet: left out of the fit";
        (points.to_vec(), ["residuals", note])
    };
    let squares = shown
        .iter()
        .filter(|point| !point.outlier)
        .filter_map(|point| point.residual_px)
        .map(|[du, dv]| du * du + dv * dv);
    let typical_px = (squares.clone().sum::<f64>() / squares.count().max(1) as f64).sqrt();
    let picture_px = WIDTH_PX - 2.0 * MARGIN_PX;
    let factor = round_factor(ARROW_PX / typical_px.max(1e-6) * size_px.0 as f64 / picture_px);
    let caption = format!("{what}, {factor} times as long as they are{note}");
    image_picture(size_px, &caption, |plane, area| {
        for point in &shown {
            let Some([du, dv]) = point.residual_px else {
                continue;
            };
            let color = if point.outlier { OUTLIER } else { OBSERVED };
            let [u, v] = [point.observed[0] - du, point.observed[1] - dv];
            if !plane.is_near([u, v]) {
                continue;
            }
            // The arrow of an outlier is cut before it leaves the picture.
            let length = factor * libm::hypot(du, dv).clamp(1e-9, 1e9);
            let cut = (MAX_ARROW_PX / plane.scale / length).min(1.0) * factor;
            let shaft = [du, dv].map(|d| cut * d.clamp(-1e9, 1e9));
            let tip = [u + shaft[0], v + shaft[1]];
            let ends = [plane.at([u, v]), plane.at(tip)];
            area.draw(&PathElement::new(ends, line(color, 0.9, 1.2)))?;
            for side in [-0.45_f64, 0.45] {
                let (sin, cos) = libm::sincos(side);
                let length = libm::hypot(shaft[0], shaft[1]);
                let barb = (6.0 / plane.scale).min(0.4 * length) / length.max(1e-9);
                let back = [
                    tip[0] - barb * (cos * shaft[0] - sin * shaft[1]),
                    tip[1] - barb * (sin * shaft[0] + cos * shaft[1]),
                ];
                let ends = [plane.at(tip), plane.at(back)];
                area.draw(&PathElement::new(ends, line(color, 0.9, 1.2)))?;
            }
        }
        Ok(())
    })
}

/// Returns the mean residual of the fitted points in each cell of a grid over the image, at their mean position.
fn mean_residuals((width, height): (usize, usize), points: &[ObservedPoint]) -> Vec<ObservedPoint> {
    let cell_px = width.max(height) as f64 / MEAN_CELLS;
    let mut sums: BTreeMap<[i64; 2], (f64, [f64; 4])> = BTreeMap::new();
    for point in points.iter().filter(|point| !point.outlier) {
        if let Some([du, dv]) = point.residual_px {
            let [u, v] = point.observed;
            let cell = [u, v].map(|at| (at / cell_px).floor() as i64);
            let (count, sum) = sums.entry(cell).or_default();
            *count += 1.0;
            for (sum, value) in sum.iter_mut().zip([u, v, du, dv]) {
                *sum += value;
            }
        }
    }
    let mean = |(count, sum): (f64, [f64; 4])| {
        let [u, v, du, dv] = sum.map(|sum| sum / count);
        ObservedPoint {
            observed: [u, v],
            residual_px: Some([du, dv]),
            outlier: false,
        }
    };
    sums.into_values().map(mean).collect()
}

/// Draws the number of observed points in each cell of a grid over the image.
pub(crate) fn coverage(
    size_px: (usize, usize),
    points: &[ObservedPoint],
) -> anyhow::Result<Drawing> {
    let counts = cell_counts(size_px, points);
    let most = counts.iter().flatten().copied().max().unwrap_or(0).max(1) as f64;
    let seen = counts.iter().flatten().filter(|&&count| count > 0).count();
    let cells = GRID_CELLS * GRID_CELLS;
    let caption = format!("points seen in each cell; {seen} of {cells} cells have some");
    let side = |length: usize, cell: usize| length as f64 * cell as f64 / GRID_CELLS as f64 - 0.5;
    image_picture(size_px, &caption, |plane, area| {
        for (row, counts) in counts.iter().enumerate() {
            for (column, &count) in counts.iter().enumerate() {
                let corner = |i: usize, j: usize| {
                    plane.at([side(size_px.0, column + i), side(size_px.1, row + j)])
                };
                let corners = [corner(0, 0), corner(1, 1)];
                if count > 0 {
                    // A cell with a single point must differ visibly from an empty one.
                    let shade = 0.15 + 0.55 * count as f64 / most;
                    area.draw(&Rectangle::new(corners, fill(OBSERVED, shade)))?;
                }
                area.draw(&Rectangle::new(corners, line(INK, 0.25, 0.8)))?;
                let (left, top) = corners[0];
                let (right, bottom) = corners[1];
                let style = text_style(12.0, HPos::Center);
                let middle = (i32::midpoint(left, right), i32::midpoint(top, bottom));
                area.draw_text(&count.to_string(), &style, middle)?;
            }
        }
        Ok(())
    })
}

/// Draws residuals in u against those in v, with a circle of one standard deviation of a coordinate.
pub(crate) fn residual_scatter(points: &[ObservedPoint], rms_px: f64) -> anyhow::Result<Drawing> {
    let sigma_px = rms_px / 2.0_f64.sqrt();
    let largest = points
        .iter()
        .filter(|point| !point.outlier)
        .filter_map(|point| point.residual_px)
        .flatten()
        .fold(2.0 * sigma_px.max(1e-9), |largest, r| largest.max(r.abs()));
    let size = [560.0, 420.0];
    let plot_px = [
        size[0] - LEFT_PX - RIGHT_PX,
        size[1] - TOP_PX - BOTTOM_PX - CAPTION_PX,
    ];
    let around = padded(Some(-largest..=largest), 1e-9);
    let (x, y) = equal_scales(&around, &around, plot_px);
    let outside = points
        .iter()
        .filter(|s| s.outlier || s.residual_px.is_none())
        .count();
    drawing(size, |area| {
        let (above, below) = area.split_vertically(units(size[1] - CAPTION_PX));
        let mut panel = panel(
            &above,
            &Axis::new(x, "observed − projected, u (px)"),
            &Axis::new(y, "observed − projected, v (px)"),
        )?;
        let residuals = points
            .iter()
            .filter(|point| !point.outlier)
            .filter_map(|point| point.residual_px);
        panel.draw_series(
            residuals.map(|[du, dv]| Circle::new((du, dv), units(2.5), fill(OBSERVED, 0.6))),
        )?;
        let circle = (0..=90).map(|i| {
            let (sin, cos) = libm::sincos(f64::from(4 * i).to_radians());
            (sigma_px * cos, sigma_px * sin)
        });
        panel.draw_series([PathElement::new(
            circle.collect::<Vec<_>>(),
            line(PROJECTED, 1.0, 1.6),
        )])?;
        let left_out = match outside {
            0 => String::new(),
            count => format!("; {count} left out of the fit are not shown"),
        };
        let caption = format!("circle: 1 σ of a coordinate, {sigma_px:.3} px{left_out}");
        write_text(
            &below,
            &caption,
            [LEFT_PX, 10.0],
            &text_style(13.0, HPos::Left),
        )
    })
}

/// Draws the root mean square residual of each view as a bar.
pub(crate) fn rms_bars(views: &[(&str, f64)], overall_px: f64) -> anyhow::Result<Drawing> {
    const ROW_PX: f64 = 20.0;
    const NAME_PX: f64 = 180.0;
    let longest = views
        .iter()
        .fold(overall_px, |longest, v| longest.max(v.1))
        .max(1e-9);
    let room_px = WIDTH_PX - NAME_PX - 90.0;
    let height_px = ROW_PX * views.len() as f64 + CAPTION_PX + 12.0;
    drawing([WIDTH_PX, height_px], |area| {
        let end = |rms: f64| NAME_PX + room_px * (rms / longest).clamp(0.0, 1.0);
        for (row, (name, rms)) in views.iter().enumerate() {
            let y = 16.0 + ROW_PX * row as f64;
            let name = shortened(name, 24);
            write_text(
                area,
                &name,
                [NAME_PX - 8.0, y],
                &text_style(12.0, HPos::Right),
            )?;
            let corners = [
                (units(NAME_PX), units(y - 7.0)),
                (units(end(*rms)), units(y + 7.0)),
            ];
            area.draw(&Rectangle::new(corners, fill(OBSERVED, 0.8)))?;
            let value = format!("{rms:.3} px");
            write_text(
                area,
                &value,
                [WIDTH_PX - 14.0, y],
                &text_style(12.0, HPos::Right),
            )?;
        }
        let x = units(end(overall_px));
        let ends = [(x, units(4.0)), (x, units(height_px - CAPTION_PX))];
        area.draw(&PathElement::new(ends, line(PROJECTED, 1.0, 1.6)))?;
        let caption = format!("line: over all views, {overall_px:.3} px");
        let at = [NAME_PX, height_px - 12.0];
        write_text(area, &caption, at, &text_style(13.0, HPos::Left))
    })
}

/// Counts the points in each cell, row by row; points outside the image are not counted.
pub(crate) fn cell_counts(
    (width, height): (usize, usize),
    points: &[ObservedPoint],
) -> [[usize; GRID_CELLS]; GRID_CELLS] {
    let mut counts = [[0; GRID_CELLS]; GRID_CELLS];
    for point in points {
        let cell = |at: f64, side: usize| {
            let share = (at + 0.5) / side as f64;
            (0.0..=1.0)
                .contains(&share)
                .then(|| ((share * GRID_CELLS as f64) as usize).min(GRID_CELLS - 1))
        };
        let [u, v] = point.observed;
        if let (Some(column), Some(row)) = (cell(u, width), cell(v, height)) {
            counts[row][column] += 1;
        }
    }
    counts
}

/// Returns the largest 1, 2 or 5 times a power of ten that is at most `most`.
fn round_factor(most: f64) -> f64 {
    let power = libm::pow(10_f64, libm::log10(most.max(1.0)).floor());
    [5.0, 2.0, 1.0]
        .into_iter()
        .map(|digit| digit * power)
        .find(|factor| *factor <= most)
        .unwrap_or(1.0)
}

/// The area of the image in a picture.
struct ImagePlane {
    size_px: [f64; 2],
    /// Pixels of the picture per pixel of the image.
    scale: f64,
}

impl ImagePlane {
    /// Returns the position of an image pixel in the picture, in units.
    fn at(&self, [u, v]: [f64; 2]) -> (i32, i32) {
        let on_picture = |at: f64| units(MARGIN_PX + self.scale * (at + 0.5));
        (on_picture(u), on_picture(v))
    }

    /// Reports whether a pixel is in the image or close to it.
    fn is_near(&self, pixel: [f64; 2]) -> bool {
        let near = |at: f64, side: f64| at > -0.1 * side && at < 1.1 * side;
        near(pixel[0], self.size_px[0]) && near(pixel[1], self.size_px[1])
    }
}

/// Draws a picture of the image's area with its pixel coordinates and a caption.
fn image_picture(
    (width, height): (usize, usize),
    caption: &str,
    draw: impl FnOnce(&ImagePlane, &Area<'_>) -> anyhow::Result<()>,
) -> anyhow::Result<Drawing> {
    let size_px = [width as f64, height as f64];
    let plane = ImagePlane {
        size_px,
        scale: (WIDTH_PX - 2.0 * MARGIN_PX) / size_px[0].max(size_px[1]),
    };
    let shown = size_px.map(|side| plane.scale * side);
    let document_px = [
        shown[0] + 2.0 * MARGIN_PX,
        shown[1] + 1.4 * MARGIN_PX + CAPTION_PX,
    ];
    drawing(document_px, |area| {
        let corners = [
            plane.at([-0.5, -0.5]),
            plane.at(size_px.map(|side| side - 0.5)),
        ];
        area.draw(&Rectangle::new(corners, fill([247; 3], 1.0)))?;
        for (axis, side) in size_px.into_iter().enumerate() {
            for at in [0.0, (0.5 * side).floor(), side - 1.0] {
                let place = MARGIN_PX + plane.scale * (at + 0.5);
                let (point, style) = if axis == 0 {
                    ([place, MARGIN_PX - 10.0], text_style(12.0, HPos::Center))
                } else {
                    ([MARGIN_PX - 8.0, place], text_style(12.0, HPos::Right))
                };
                write_text(area, &at.to_string(), point, &style)?;
            }
        }
        draw(&plane, area)?;
        area.draw(&Rectangle::new(corners, line(INK, 1.0, 1.0)))?;
        let at = [MARGIN_PX, document_px[1] - 14.0];
        write_text(area, caption, at, &text_style(13.0, HPos::Left))
    })
}

#[cfg(test)]
#[path = "calibration_tests.rs"]
mod tests;
