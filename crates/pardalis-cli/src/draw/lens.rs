//! Pictures of a camera's lens: its field of view and its resolution.

use std::path::{Path, PathBuf};

use plotters::prelude::*;
use plotters::style::text_anchor::HPos;

use super::legend::{self, Key};
use super::panel::{Axis, BOTTOM_PX, TOP_PX, draw_path, panel, runs};
use super::svg::{Area, drawing, fill, line, text_style, units, write_svg_and_png, write_text};
use super::{INK, PALETTE, Rgb};

/// Points of the image, pixel centres at integers; `None` interrupts the line.
pub(crate) type ImageCurve = Vec<Option<[f64; 2]>>;

/// The image plane of a camera.
pub(crate) struct FieldOfView {
    /// Width and height of the image in pixels.
    pub(crate) size_px: (usize, usize),
    /// Outline of the pixels that have a ray.
    pub(crate) rim_px: Vec<[f64; 2]>,
    /// Curves of equal angle from the axis, with their labels.
    pub(crate) circles: Vec<(String, ImageCurve)>,
    /// Curves of equal direction around the axis.
    pub(crate) spokes: Vec<ImageCurve>,
}

/// One curve of a plot over the angle.
pub(crate) struct LensCurve {
    /// Its name in the legend.
    pub(crate) name: &'static str,
    /// Angles from the axis in degrees, in ascending order, and values.
    pub(crate) points: Vec<(f64, f64)>,
}

/// Length of the picture's longer side.
const LONG_SIDE_PX: f64 = 900.0;
const MARGIN_PX: f64 = 12.0;
const HATCH_SPACING_PX: f64 = 9.0;
const DARK: Rgb = [96, 96, 96];

/// Draws the image plane with its angles into `NAME.svg` and `NAME.png` of a folder that must exist.
pub(crate) fn write_field_of_view(
    folder: &Path,
    name: &str,
    view: &FieldOfView,
) -> anyhow::Result<[PathBuf; 2]> {
    let (width, height) = (view.size_px.0 as f64, view.size_px.1 as f64);
    let scale = LONG_SIDE_PX / width.max(height);
    let image_px = [scale * width, scale * height];
    let place_px = |[u, v]: [f64; 2]| [u, v].map(|c| MARGIN_PX + scale * (c + 0.5));
    let place = |pixel: [f64; 2]| {
        let [x, y] = place_px(pixel);
        (units(x), units(y))
    };
    let size_px = image_px.map(|side| side + 2.0 * MARGIN_PX);
    let drawing = drawing(size_px, |area| {
        draw_hatched(area, image_px)?;
        let rim: Vec<_> = view.rim_px.iter().map(|&p| place(p)).collect();
        area.draw(&Polygon::new(rim, fill([255; 3], 1.0)))?;
        let draw_curve = |curve: &ImageCurve, style: ShapeStyle| -> anyhow::Result<()> {
            for run in runs(curve.iter().copied()) {
                let points: Vec<_> = run.into_iter().map(place).collect();
                area.draw(&PathElement::new(points, style))?;
            }
            Ok(())
        };
        for spoke in &view.spokes {
            draw_curve(spoke, line([150; 3], 1.0, 1.0))?;
        }
        for (_, circle) in &view.circles {
            draw_curve(circle, line(PALETTE[0], 1.0, 1.6))?;
        }
        let mut boxes = Vec::new();
        // From the outside in, because labels in the middle are crowded.
        for (label, circle) in view.circles.iter().rev() {
            // There is room halfway between two spokes; without a pixel there, take the first point of the circle.
            let at = circle.get(circle.len() / 8).copied().flatten();
            if let Some(at) = at.or_else(|| circle.iter().copied().flatten().next()) {
                write_boxed(area, label, place_px(at), &mut boxes)?;
            }
        }
        Ok(())
    })?;
    write_svg_and_png(folder, name, &drawing)
}

/// Fills the image with the pattern of pixels that have no ray.
fn draw_hatched(area: &Area<'_>, [width_px, height_px]: [f64; 2]) -> anyhow::Result<()> {
    let low = MARGIN_PX;
    let (right, bottom) = (low + width_px, low + height_px);
    let corners = [(units(low), units(low)), (units(right), units(bottom))];
    area.draw(&Rectangle::new(corners, fill(DARK, 1.0)))?;
    let count = ((width_px + height_px) / HATCH_SPACING_PX) as usize;
    for i in 1..=count {
        // The diagonal x + y = sum, cut off at the image's border.
        let sum = HATCH_SPACING_PX * i as f64;
        let from = [sum.min(width_px), sum - sum.min(width_px)];
        let to = [sum - sum.min(height_px), sum.min(height_px)];
        let ends = [from, to].map(|[x, y]| (units(low + x), units(low + y)));
        area.draw(&PathElement::new(ends, line([140; 3], 1.0, 1.0)))?;
    }
    Ok(())
}

/// Half of a label's height.
const HALF_LABEL_PX: f64 = 8.0;

/// Writes text on a white patch, unless it would touch an earlier label.
fn write_boxed(
    area: &Area<'_>,
    text: &str,
    at_px: [f64; 2],
    before: &mut Vec<LabelBox>,
) -> anyhow::Result<()> {
    let own = LabelBox {
        center_px: at_px,
        half_width_px: 4.0 * text.chars().count() as f64 + 2.0,
    };
    if before.iter().any(|other| own.touches(other)) {
        return Ok(());
    }
    let corners = [-1.0, 1.0].map(|side| {
        (
            units(at_px[0] + side * own.half_width_px),
            units(at_px[1] + side * HALF_LABEL_PX),
        )
    });
    before.push(own);
    area.draw(&Rectangle::new(corners, fill([255; 3], 0.85)))?;
    write_text(area, text, at_px, &text_style(12.0, HPos::Center))
}

/// The area of a label.
struct LabelBox {
    center_px: [f64; 2],
    half_width_px: f64,
}

impl LabelBox {
    fn touches(&self, other: &Self) -> bool {
        let apart = [0, 1].map(|i| (self.center_px[i] - other.center_px[i]).abs());
        apart[0] < self.half_width_px + other.half_width_px && apart[1] < 2.0 * HALF_LABEL_PX
    }
}

/// Draws the radius in pixels and the pixels per degree against the angle into `NAME.svg` and `NAME.png` in a folder
/// that must exist. The first curve of each is the camera's own.
pub(crate) fn write_distortion(
    folder: &Path,
    name: &str,
    radius_px: &[LensCurve],
    px_per_degree: &[LensCurve],
) -> anyhow::Result<[PathBuf; 2]> {
    const HEIGHT_PX: f64 = 320.0 + TOP_PX + BOTTOM_PX;
    let drawing = drawing([LONG_SIDE_PX, 2.0 * HEIGHT_PX], |area| {
        let (above, below) = area.split_vertically(units(HEIGHT_PX));
        draw_curves(&above, "radius (px)", radius_px)?;
        draw_curves(&below, "pixels per degree", px_per_degree)
    })?;
    write_svg_and_png(folder, name, &drawing)
}

fn draw_curves(area: &Area<'_>, name: &'static str, curves: &[LensCurve]) -> anyhow::Result<()> {
    /// Other curves are drawn up to this multiple of the maximum of the camera's own curve.
    const ROOM: f64 = 1.7;
    let (plot, column) = area.split_horizontally(units(LONG_SIDE_PX - legend::WIDTH_PX));
    let own = curves.first().map_or(&[][..], |curve| &curve.points);
    let highest = own.iter().map(|p| p.1).fold(0.0, f64::max).max(1e-6);
    let widest_deg = own.iter().map(|p| p.0).fold(0.0, f64::max).max(1e-6);
    let across = Axis::new(0.0..widest_deg, "angle from the axis (°)");
    let up = Axis::new(0.0..ROOM * highest, name);
    let mut panel = panel(&plot, &across, &up)?;
    let mut entries = Vec::new();
    // The camera's own curve lies on top.
    for (index, curve) in curves.iter().enumerate().rev() {
        // Thin, so that the curves below it show at both sides.
        let (color, width_px) = if index == 0 {
            (INK, 1.5)
        } else {
            (PALETTE[index - 1], 4.0)
        };
        let fits = |p: &(f64, f64)| (p.1 <= ROOM * highest).then_some(*p);
        for run in runs(curve.points.iter().map(fits)) {
            draw_path(&mut panel, &run, line(color, 1.0, width_px))?;
        }
        entries.push((Key::Track(color), curve.name.to_owned()));
    }
    entries.reverse();
    legend::draw(&column, &entries)
}
