//! The surface of plots: every line, shape and text goes to an SVG document and to pixels at once.

use std::io;

use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, VPos};
use plotters_backend::{
    BackendColor, BackendCoord, BackendStyle, BackendTextStyle, DrawingErrorKind,
};
use tiny_skia::{
    FillRule, LineCap, LineJoin, Paint, Path, PathBuilder, Pixmap, Rect, Stroke, Transform,
};

use super::text::{outlines, width_em};

/// Draws into an SVG document and into pixels.
pub(super) struct Sheet<'a> {
    svg: SVGBackend<'a>,
    pixels: &'a mut Pixmap,
    /// Maps plotters' units to pixels.
    transform: Transform,
}

impl<'a> Sheet<'a> {
    /// Creates a sheet of this size in plotters' units; `pixels` shows all of it.
    pub(super) fn new(svg: &'a mut String, size: (u32, u32), pixels: &'a mut Pixmap) -> Self {
        let scale = pixels.width() as f32 / size.0 as f32;
        Self {
            svg: SVGBackend::with_string(svg, size),
            pixels,
            transform: Transform::from_scale(scale, scale),
        }
    }

    fn fill(&mut self, path: Option<Path>, color: BackendColor, transform: Transform) {
        if let Some(path) = path {
            let transform = transform.post_concat(self.transform);
            let paint = paint(color);
            self.pixels
                .fill_path(&path, &paint, FillRule::Winding, transform, None);
        }
    }

    fn stroke(&mut self, path: Option<Path>, color: BackendColor, width: u32) {
        // As in the document, round ends turn a line without length into a dot.
        let stroke = Stroke {
            width: width as f32,
            line_cap: LineCap::Round,
            line_join: LineJoin::Round,
            ..Stroke::default()
        };
        if let Some(path) = path {
            let paint = paint(color);
            self.pixels
                .stroke_path(&path, &paint, &stroke, self.transform, None);
        }
    }
}

type Outcome = Result<(), DrawingErrorKind<io::Error>>;

impl DrawingBackend for Sheet<'_> {
    type ErrorType = io::Error;

    fn get_size(&self) -> (u32, u32) {
        self.svg.get_size()
    }

    fn ensure_prepared(&mut self) -> Outcome {
        self.svg.ensure_prepared()
    }

    fn present(&mut self) -> Outcome {
        self.svg.present()
    }

    fn draw_pixel(&mut self, point: BackendCoord, color: BackendColor) -> Outcome {
        self.draw_rect(point, (point.0 + 1, point.1 + 1), &color, true)
    }

    fn draw_line<S: BackendStyle>(
        &mut self,
        from: BackendCoord,
        to: BackendCoord,
        style: &S,
    ) -> Outcome {
        self.svg.draw_line(from, to, style)?;
        let path = polyline(&[from, to]).finish();
        self.stroke(path, style.color(), style.stroke_width());
        Ok(())
    }

    fn draw_rect<S: BackendStyle>(
        &mut self,
        from: BackendCoord,
        to: BackendCoord,
        style: &S,
        fill: bool,
    ) -> Outcome {
        self.svg.draw_rect(from, to, style, fill)?;
        let [x0, y0, x1, y1] = [from.0, from.1, to.0, to.1].map(|c| c as f32);
        let path = Rect::from_ltrb(x0, y0, x1, y1).map(PathBuilder::from_rect);
        if fill {
            self.fill(path, style.color(), Transform::identity());
        } else {
            // The document gives no width, which means one unit.
            self.stroke(path, style.color(), 1);
        }
        Ok(())
    }

    fn draw_path<S: BackendStyle, I: IntoIterator<Item = BackendCoord>>(
        &mut self,
        path: I,
        style: &S,
    ) -> Outcome {
        let points: Vec<BackendCoord> = path.into_iter().collect();
        self.svg.draw_path(points.iter().copied(), style)?;
        let path = polyline(&points).finish();
        self.stroke(path, style.color(), style.stroke_width());
        Ok(())
    }

    fn draw_circle<S: BackendStyle>(
        &mut self,
        center: BackendCoord,
        radius: u32,
        style: &S,
        fill: bool,
    ) -> Outcome {
        self.svg.draw_circle(center, radius, style, fill)?;
        let path = PathBuilder::from_circle(center.0 as f32, center.1 as f32, radius as f32);
        if fill {
            self.fill(path, style.color(), Transform::identity());
        } else {
            self.stroke(path, style.color(), style.stroke_width());
        }
        Ok(())
    }

    fn fill_polygon<S: BackendStyle, I: IntoIterator<Item = BackendCoord>>(
        &mut self,
        corners: I,
        style: &S,
    ) -> Outcome {
        let corners: Vec<BackendCoord> = corners.into_iter().collect();
        self.svg.fill_polygon(corners.iter().copied(), style)?;
        let mut path = polyline(&corners);
        path.close();
        self.fill(path.finish(), style.color(), Transform::identity());
        Ok(())
    }

    fn draw_text<S: BackendTextStyle>(
        &mut self,
        text: &str,
        style: &S,
        (x, y): BackendCoord,
    ) -> Outcome {
        self.svg.draw_text(text, style, (x, y))?;
        // The same layout as plotters' SVG: the font size, and a base line below the point by
        // half the font size times the height of a small x. White space counts as one blank.
        let size = (style.size() / 1.24) as f32;
        let text = text.split_whitespace().collect::<Vec<_>>().join(" ");
        let left = match style.anchor().h_pos {
            HPos::Left => 0.0,
            HPos::Center => -0.5 * size * width_em(&text),
            HPos::Right => -size * width_em(&text),
        };
        let down = match style.anchor().v_pos {
            VPos::Top => 0.76 * size,
            VPos::Center => 0.25 * size,
            VPos::Bottom => -0.25 * size,
        };
        let turn_deg = match style.transform() {
            FontTransform::None => 0.0,
            FontTransform::Rotate90 => 90.0,
            FontTransform::Rotate180 => 180.0,
            FontTransform::Rotate270 => 270.0,
        };
        let transform = Transform::from_scale(size, size)
            .post_translate(left, down)
            .post_concat(Transform::from_rotate(turn_deg))
            .post_translate(x as f32, y as f32);
        self.fill(outlines(&text), style.color(), transform);
        Ok(())
    }
}

fn polyline(points: &[BackendCoord]) -> PathBuilder {
    let mut path = PathBuilder::new();
    let mut points = points.iter().map(|&(x, y)| (x as f32, y as f32));
    if let Some((x, y)) = points.next() {
        path.move_to(x, y);
    }
    for (x, y) in points {
        path.line_to(x, y);
    }
    path
}

fn paint(color: BackendColor) -> Paint<'static> {
    let (r, g, b) = color.rgb;
    let mut paint = Paint::default();
    paint.set_color_rgba8(r, g, b, (255.0 * color.alpha).round() as u8);
    paint
}
