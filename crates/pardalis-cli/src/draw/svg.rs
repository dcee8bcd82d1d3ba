//! Drawing as SVG, and rendering SVG with the bundled font.

use std::path::{Path, PathBuf};
use std::sync::{Arc, LazyLock};

use plotters::coord::Shift;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};
use resvg::tiny_skia::{Color, Pixmap, Transform};
use resvg::usvg;

use super::{INK, Rgb, shortened};
use crate::files::write_file;

/// Latin-1, Greek and some mathematical signs. Its licence lies beside it.
static FONT: &[u8] = include_bytes!("../../assets/DejaVuSans-subset.ttf");

/// The font as SVG names it; readers without it take their own.
pub(super) const FONT_FAMILY: &str = "DejaVu Sans, sans-serif";

/// Plotters rounds to whole units: this many make a pixel, so that curves stay smooth.
const UNITS_PER_PX: f64 = 10.0;

/// Pixels of the PNG for each pixel of the SVG, for sharp text on dense screens.
const PNG_SCALE: f32 = 2.0;

/// A part of a drawing; its coordinates are units.
pub(super) type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;

/// Pixels in plotters' units.
pub(super) fn units(px: f64) -> i32 {
    (px * UNITS_PER_PX).round() as i32
}

/// Width and height of an area in pixels.
pub(super) fn size_px(area: &Area<'_>) -> [f64; 2] {
    let (width, height) = area.dim_in_pixel();
    [width, height].map(|side| f64::from(side) / UNITS_PER_PX)
}

/// A line of this colour, opacity and width.
pub(super) fn line(color: Rgb, opacity: f64, width_px: f64) -> ShapeStyle {
    ShapeStyle {
        color: RGBAColor(color[0], color[1], color[2], opacity),
        filled: false,
        stroke_width: units(width_px) as u32,
    }
}

/// A filled shape of this colour and opacity.
pub(super) fn fill(color: Rgb, opacity: f64) -> ShapeStyle {
    line(color, opacity, 0.0).filled()
}

/// Dark text of this height, set left or right of or centred at its point, and vertically centred on it.
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

/// An SVG document of this size in pixels, white where nothing is drawn.
pub(super) fn document(
    size_px: [f64; 2],
    draw: impl FnOnce(&Area<'_>) -> anyhow::Result<()>,
) -> anyhow::Result<String> {
    let [width, height] = size_px.map(units);
    let mut drawing = String::new();
    {
        let backend = SVGBackend::with_string(&mut drawing, (width as u32, height as u32));
        let area = backend.into_drawing_area();
        area.fill(&WHITE)?;
        draw(&area)?;
        area.present()?;
    }
    let [width_px, height_px] = size_px;
    // Round ends make a dot of a line without length: a target that stands still.
    Ok(format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width_px}\" height=\"{height_px}\" \
         viewBox=\"0 0 {width} {height}\" stroke-linecap=\"round\" stroke-linejoin=\"round\">\n\
         {drawing}</svg>\n"
    ))
}

/// Writes a document as `NAME.svg` and, rendered, as `NAME.png`.
pub(super) fn write_svg_and_png(
    folder: &Path,
    name: &str,
    document: &str,
) -> anyhow::Result<[PathBuf; 2]> {
    let svg_path = folder.join(format!("{name}.svg"));
    let png_path = folder.join(format!("{name}.png"));
    let png = rendered(document, PNG_SCALE)?.encode_png()?;
    write_file(&svg_path, document.as_bytes())?;
    write_file(&png_path, &png)?;
    Ok([svg_path, png_path])
}

/// Parses a document; its text can only be in the bundled font.
pub(super) fn parsed(document: &str) -> anyhow::Result<usvg::Tree> {
    static FONTS: LazyLock<Arc<usvg::fontdb::Database>> = LazyLock::new(|| {
        let mut fonts = usvg::fontdb::Database::new();
        fonts.load_font_data(FONT.to_vec());
        fonts.set_sans_serif_family("DejaVu Sans");
        Arc::new(fonts)
    });
    let options = usvg::Options {
        fontdb: Arc::clone(&FONTS),
        ..usvg::Options::default()
    };
    Ok(usvg::Tree::from_str(document, &options)?)
}

/// The brightness of a document at `scale` pixels for each of its own.
#[cfg(test)]
pub(crate) fn rendered_grey(document: &str, scale: f32) -> image::GrayImage {
    let pixmap = rendered(document, scale).expect("a document that can be drawn");
    let red = pixmap.pixels().iter().map(|pixel| pixel.red()).collect();
    image::GrayImage::from_raw(pixmap.width(), pixmap.height(), red).expect("as many pixels")
}

/// The pixels of a document at `scale` pixels for each of its own.
fn rendered(document: &str, scale: f32) -> anyhow::Result<Pixmap> {
    let tree = parsed(document)?;
    let [width, height] =
        [tree.size().width(), tree.size().height()].map(|side| (side * scale).ceil() as u32);
    let mut pixmap = Pixmap::new(width, height)
        .ok_or_else(|| anyhow::anyhow!("a picture of {width} x {height} pixels is too large"))?;
    pixmap.fill(Color::WHITE);
    resvg::render(
        &tree,
        Transform::from_scale(scale, scale),
        &mut pixmap.as_mut(),
    );
    Ok(pixmap)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_is_drawn_with_the_bundled_font_and_hostile_names_are_harmless() {
        let draw = |text: &str| {
            let document = document([80.0, 20.0], |area| {
                write_text(area, text, [2.0, 10.0], &text_style(12.0, HPos::Left))
            });
            rendered(&document.unwrap(), 1.0).unwrap()
        };
        let dark = |pixmap: &Pixmap| pixmap.pixels().iter().filter(|p| p.red() < 128).count();
        assert_eq!(dark(&draw("")), 0);
        assert!(dark(&draw("ball σ −")) > 50);
        assert!(dark(&draw("<&\"'>\u{1}\u{0}")) > 10);
    }

    #[test]
    fn a_folder_that_does_not_exist_is_named() {
        let error = write_svg_and_png(
            Path::new("/nowhere/at/all"),
            "above",
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"1\" height=\"1\"/>",
        )
        .unwrap_err();
        assert!(error.is::<crate::user_error::UserError>());
        assert!(error.to_string().contains("/nowhere/at/all"), "{error}");
    }
}
