//! Text as outlines of the bundled font, for pixels.

use std::sync::LazyLock;

use tiny_skia::{FillRule, Paint, Path, PathBuilder, Pixmap, Transform};
use ttf_parser::{Face, GlyphId, OutlineBuilder};

use super::picture::opaque;
use super::{Rgb, shortened};

/// Latin-1, Greek and some mathematical signs. Its licence lies beside it.
static FONT: &[u8] = include_bytes!("../../assets/DejaVuSans-subset.ttf");

static FACE: LazyLock<Face<'static>> =
    LazyLock::new(|| Face::parse(FONT, 0).expect("the bundled font is complete"));

/// The font's name in SVG; viewers that lack it substitute their own.
pub(super) const FONT_FAMILY: &str = "DejaVu Sans, sans-serif";

/// Text to write on a canvas.
pub(super) struct Caption<'a> {
    pub(super) text: &'a str,
    /// Left end of its base line, in pixels of the canvas.
    pub(super) at_px: [f32; 2],
    pub(super) height_px: f32,
    /// Longer text is set in a smaller size.
    pub(super) max_width_px: f32,
    pub(super) color: Rgb,
}

/// Writes a caption on a canvas.
pub(super) fn write_caption(canvas: &mut Pixmap, caption: &Caption<'_>) {
    let text = shortened(caption.text, 300);
    let width_px = caption.height_px * width_em(&text);
    let height_px = caption.height_px * (caption.max_width_px / width_px.max(1.0)).min(1.0);
    let [x, y] = caption.at_px;
    let transform = Transform::from_scale(height_px, height_px).post_translate(x, y);
    let mut paint = Paint::default();
    paint.set_color(opaque(caption.color));
    if let Some(path) = outlines(&text) {
        canvas.fill_path(&path, &paint, FillRule::Winding, transform, None);
    }
}

/// Returns the width of a line of text in units of the font size.
pub(super) fn width_em(text: &str) -> f32 {
    glyphs(text).map(|(_, advance)| advance).sum()
}

/// Returns the outlines of a line of text of font size 1 whose base line begins at the origin, with y downwards;
/// `None` if nothing is visible.
pub(super) fn outlines(text: &str) -> Option<Path> {
    let mut pen = Pen {
        path: PathBuilder::new(),
        scale: 1.0 / f32::from(FACE.units_per_em()),
        left: 0.0,
    };
    for (glyph, advance) in glyphs(text) {
        // Blanks have no outline.
        let _ = FACE.outline_glyph(glyph, &mut pen);
        pen.left += advance;
    }
    pen.path.finish()
}

/// Returns the glyphs of a text and their advances in units of the font size. Question marks replace characters that
/// the font lacks.
fn glyphs(text: &str) -> impl Iterator<Item = (GlyphId, f32)> {
    text.chars().map(|c| {
        let glyph = FACE.glyph_index(c).or_else(|| FACE.glyph_index('?'));
        let glyph = glyph.unwrap_or_default();
        let advance = FACE.glyph_hor_advance(glyph).unwrap_or_default();
        (glyph, f32::from(advance) / f32::from(FACE.units_per_em()))
    })
}

/// Draws outlines in font units, y upwards, into a path.
struct Pen {
    path: PathBuilder,
    scale: f32,
    left: f32,
}

impl Pen {
    fn place(&self, x: f32, y: f32) -> (f32, f32) {
        (self.left + self.scale * x, -self.scale * y)
    }
}

impl OutlineBuilder for Pen {
    fn move_to(&mut self, x: f32, y: f32) {
        let (x, y) = self.place(x, y);
        self.path.move_to(x, y);
    }

    fn line_to(&mut self, x: f32, y: f32) {
        let (x, y) = self.place(x, y);
        self.path.line_to(x, y);
    }

    fn quad_to(&mut self, x1: f32, y1: f32, x: f32, y: f32) {
        let ((x1, y1), (x, y)) = (self.place(x1, y1), self.place(x, y));
        self.path.quad_to(x1, y1, x, y);
    }

    fn curve_to(&mut self, x1: f32, y1: f32, x2: f32, y2: f32, x: f32, y: f32) {
        let ((x1, y1), (x2, y2)) = (self.place(x1, y1), self.place(x2, y2));
        let (x, y) = self.place(x, y);
        self.path.cubic_to(x1, y1, x2, y2, x, y);
    }

    fn close(&mut self) {
        self.path.close();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_font_covers_the_characters_of_plots() {
        let missing: String = "abcxyzABCXYZäöüßéñ0123456789 .,:;()[]%°±²³×µσπ−…√≤≥"
            .chars()
            .filter(|&c| FACE.glyph_index(c).is_none())
            .collect();
        assert_eq!(missing, "");
    }

    #[test]
    fn text_is_as_wide_as_its_letters_and_rises_from_its_base_line() {
        assert_eq!(width_em(""), 0.0);
        assert!(outlines("  ").is_none());
        // DejaVu Sans: 1401 of 2048 units for the letter A, 1493 high.
        assert!((width_em("AA") - 2.0 * 1401.0 / 2048.0).abs() < 1e-6);
        let bounds = outlines("A").unwrap().bounds();
        assert!(bounds.bottom().abs() < 1e-6 && (bounds.top() + 1493.0 / 2048.0).abs() < 1e-6);
        assert_eq!(outlines("\u{10FFFF}"), outlines("?"));
    }

    #[test]
    fn long_captions_shrink_to_their_maximum_width() {
        let last_dark = |max_width_px| {
            let mut canvas = Pixmap::new(400, 20).unwrap();
            let caption = Caption {
                text: "a caption of some length",
                at_px: [2.0, 14.0],
                height_px: 12.0,
                max_width_px,
                color: [255; 3],
            };
            write_caption(&mut canvas, &caption);
            let is_drawn = |x: &u32| (0..20).any(|y| canvas.pixel(*x, y).unwrap().alpha() > 0);
            (0..400).filter(is_drawn).max().unwrap()
        };
        assert!((130..180).contains(&last_dark(390.0)));
        assert!((50..=62).contains(&last_dark(60.0)));
    }
}
