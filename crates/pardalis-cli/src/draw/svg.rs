//! Drawings of plots, as an SVG document and as pixels.

use std::path::{Path, PathBuf};

use pardalis_images::encode_png;
use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};
use tiny_skia::Pixmap;

use super::picture::picture_from;
use super::sheet::Sheet;
use super::text::FONT_FAMILY;
use super::{INK, Rgb, shortened};
use crate::files::write_file;

/// Plotters rounds to whole units; with this many units per pixel, curves stay smooth.
const UNITS_PER_PX: f64 = 10.0;

/// Pixels of the PNG for each pixel of the SVG, for sharp text on dense screens.
const PNG_SCALE: f64 = 2.0;

/// A part of a drawing; its coordinates are units.
pub(super) type Area<'a> = DrawingArea<Sheet<'a>, Shift>;

/// Converts pixels to plotters' units.
pub(super) fn units(px: f64) -> i32 {
    (px * UNITS_PER_PX).round() as i32
}

/// Returns the width and height of an area in pixels.
pub(super) fn size_px(area: &Area<'_>) -> [f64; 2] {
    let (width, height) = area.dim_in_pixel();
    [width, height].map(|side| f64::from(side) / UNITS_PER_PX)
}

/// Returns the style of a line of this colour, opacity and width.
pub(super) fn line(color: Rgb, opacity: f64, width_px: f64) -> ShapeStyle {
    ShapeStyle {
        color: RGBAColor(color[0], color[1], color[2], opacity),
        filled: false,
        stroke_width: units(width_px) as u32,
    }
}

/// Returns the style of a filled shape of this colour and opacity.
pub(super) fn fill(color: Rgb, opacity: f64) -> ShapeStyle {
    line(color, opacity, 0.0).filled()
}

/// Returns the style of dark text of this height, set to the left or right of its point or centred on it, and
/// vertically centred.
pub(super) fn text_style(height_px: f64, side: HPos) -> TextStyle<'static> {
    // Plotters divides the size by 1.24 when it writes SVG.
    (FONT_FAMILY, 1.24 * height_px * UNITS_PER_PX)
        .into_font()
        .color(&RGBColor(INK[0], INK[1], INK[2]))
        .pos(Pos::new(side, VPos::Center))
}

/// Writes text into an area, at pixels from its top left corner.
pub(super) fn write_text(
    area: &Area<'_>,
    text: &str,
    at_px: [f64; 2],
    style: &TextStyle<'_>,
) -> anyhow::Result<()> {
    let text = shortened(text, 200);
    area.draw_text(&text, style, (units(at_px[0]), units(at_px[1])))?;
    Ok(())
}

/// A finished drawing.
pub(crate) struct Drawing {
    /// An SVG document.
    pub(crate) svg: String,
    /// The same drawing with twice as many pixels per side.
    pixels: Pixmap,
}

/// Creates a drawing on a white sheet of this size in pixels.
pub(super) fn drawing(
    size_px: [f64; 2],
    draw: impl FnOnce(&Area<'_>) -> anyhow::Result<()>,
) -> anyhow::Result<Drawing> {
    let [width, height] = size_px.map(units);
    let [columns, rows] = size_px.map(|side| (PNG_SCALE * side).ceil() as u32);
    let mut pixels = Pixmap::new(columns, rows)
        .ok_or_else(|| anyhow::anyhow!("a picture of {columns} x {rows} pixels is too large"))?;
    pixels.fill(tiny_skia::Color::WHITE);
    let mut svg = String::new();
    {
        let sheet = Sheet::new(&mut svg, (width as u32, height as u32), &mut pixels);
        let area = sheet.into_drawing_area();
        area.fill(&WHITE)?;
        draw(&area)?;
        area.present()?;
    }
    let [width_px, height_px] = size_px;
    // Round ends turn a line without length into a dot: a target that stands still.
    let svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width_px}\" height=\"{height_px}\" \
         viewBox=\"0 0 {width} {height}\" stroke-linecap=\"round\" stroke-linejoin=\"round\">\n\
         {svg}</svg>\n"
    );
    Ok(Drawing { svg, pixels })
}

/// Writes a drawing as `NAME.svg` and as `NAME.png`.
pub(super) fn write_svg_and_png(
    folder: &Path,
    name: &str,
    drawing: &Drawing,
) -> anyhow::Result<[PathBuf; 2]> {
    let svg_path = folder.join(format!("{name}.svg"));
    let png_path = folder.join(format!("{name}.png"));
    write_file(&svg_path, drawing.svg.as_bytes())?;
    write_file(&png_path, &encode_png(&picture_from(&drawing.pixels))?)?;
    Ok([svg_path, png_path])
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE_PX: [f64; 2] = [80.0, 20.0];

    /// Counts the pixels that are darker than half.
    fn dark(draw: impl FnOnce(&Area<'_>) -> anyhow::Result<()>) -> usize {
        let pixels = drawing(SIZE_PX, draw).unwrap().pixels;
        pixels.pixels().iter().filter(|p| p.red() < 128).count()
    }

    #[test]
    fn text_is_drawn_with_the_bundled_font_and_hostile_names_are_harmless() {
        let count = |text: &str| {
            dark(|area| write_text(area, text, [2.0, 10.0], &text_style(12.0, HPos::Left)))
        };
        assert_eq!(count(""), 0);
        assert!(count("ball σ −") > 200);
        assert!(count("<&\"'>\u{1}\u{0}") > 40);
    }

    #[test]
    fn shapes_have_their_size_in_pixels() {
        let rectangle = |area: &Area<'_>| {
            let corners = [(units(10.0), units(5.0)), (units(30.0), units(15.0))];
            area.draw(&Rectangle::new(corners, fill([0; 3], 1.0)))?;
            Ok(())
        };
        assert_eq!(dark(rectangle), 4 * 20 * 10);
        let row = |area: &Area<'_>| {
            let points = [10.0, 20.0, 30.0].map(|x| (units(x), units(10.0)));
            area.draw(&PathElement::new(points, line([0; 3], 1.0, 4.0)))?;
            Ok(())
        };
        // 20 pixels long and 4 wide; its two round ends add up to a disc of diameter 4.
        let expected = 4.0 * (20.0 * 4.0 + std::f64::consts::PI * 4.0);
        assert!((dark(row) as f64 - expected).abs() < 0.03 * expected);
        let point = |area: &Area<'_>| {
            let points = [(units(10.0), units(10.0)); 2];
            area.draw(&PathElement::new(points, line([0; 3], 1.0, 4.0)))?;
            Ok(())
        };
        assert!(dark(point) > 40, "a line without length is a dot");
    }

    #[test]
    fn text_is_aligned_and_rotated_as_its_style_requires() {
        let bounds = |style: TextStyle<'_>| {
            let text = |area: &Area<'_>| {
                area.draw_text("HHHH", &style, (units(40.0), units(10.0)))?;
                Ok(())
            };
            let pixels = drawing(SIZE_PX, text).unwrap().pixels;
            let (mut low, mut high) = ([f64::MAX; 2], [f64::MIN; 2]);
            for (i, _) in pixels
                .pixels()
                .iter()
                .enumerate()
                .filter(|p| p.1.red() < 128)
            {
                let at = [i % 160, i / 160].map(|c| 0.5 * (c as f64 + 0.5));
                low = [0, 1].map(|c| low[c].min(at[c]));
                high = [0, 1].map(|c| high[c].max(at[c]));
            }
            [low[0], low[1], high[0], high[1]]
        };
        let [left, top, right, bottom] = bounds(text_style(8.0, HPos::Center));
        assert!((0.5 * (left + right) - 40.0).abs() < 0.5 && right - left > 20.0);
        assert!((0.5 * (top + bottom) - 10.0).abs() < 1.5 && bottom - top < 8.0);
        assert!(bounds(text_style(8.0, HPos::Right))[2] <= 40.0);
        assert!(bounds(text_style(8.0, HPos::Left))[0] >= 40.0);
        let turned = text_style(4.0, HPos::Center).transform(FontTransform::Rotate270);
        let [left, top, right, bottom] = bounds(turned);
        assert!(bottom - top > 10.0 && right - left < 4.0);
    }

    #[test]
    fn the_error_names_a_folder_that_does_not_exist() {
        let empty = drawing([1.0, 1.0], |_| Ok(())).unwrap();
        let error = write_svg_and_png(Path::new("/nowhere/at/all"), "above", &empty).unwrap_err();
        assert!(error.is::<crate::user_error::UserError>());
        assert!(error.to_string().contains("/nowhere/at/all"), "{error}");
    }
}
