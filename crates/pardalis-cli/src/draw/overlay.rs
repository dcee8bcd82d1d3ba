//! Estimates drawn over the image that they were computed from.

use std::borrow::Cow;

use pardalis_images::RgbImage;
use tiny_skia::{
    FillRule, LineCap, LineJoin, Paint, PathBuilder, Pixmap, PixmapPaint, Rect, Stroke, StrokeDash,
    Transform,
};

use super::Rgb;
use super::picture::{canvas_of, opaque, picture_from};
use super::text::{Caption, width_em, write_caption};

/// The way in which the points of a mark are drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Shape {
    /// A small translucent dot at each point: a cloud of particles.
    Dots,
    /// A line through the points.
    Line,
    /// A dashed line through the points.
    Dashes,
    /// A closed line through the points.
    Contour,
    /// A closed line so wide that it shows on both sides of a [`Shape::Contour`] on top of it.
    WideContour,
}

/// Points that are drawn in one colour.
#[derive(Debug, Clone)]
pub(crate) struct Mark {
    /// The way in which they are drawn.
    pub(crate) shape: Shape,
    /// Image points, pixel centres at integers. They may lie outside the image. `None` and points that are not finite
    /// interrupt the line.
    pub(crate) points_px: Vec<Option<[f64; 2]>>,
    /// Their colour.
    pub(crate) color: Rgb,
}

/// A cross with a short text beside it.
#[derive(Debug, Clone)]
pub(crate) struct Note {
    /// The middle of the cross, as for [`Mark`].
    pub(crate) at_px: [f64; 2],
    /// The text.
    pub(crate) text: Cow<'static, str>,
    /// The colour of the cross.
    pub(crate) color: Rgb,
}

/// Everything that is drawn over one image.
#[derive(Debug, Clone)]
pub(crate) struct Overlay {
    /// Drawn in this order.
    pub(crate) marks: Vec<Mark>,
    /// Drawn over the marks, the most important last. The text of a note that a later one would cover is left out.
    pub(crate) notes: Vec<Note>,
    /// A line of text at the top; not drawn if it is empty.
    pub(crate) label: String,
    /// What is shown enlarged in a lower corner, with the marks around it.
    pub(crate) zoom: Option<Zoomed>,
}

/// A round part of an image, as for [`Mark`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Zoomed {
    pub(crate) center_px: [f64; 2],
    pub(crate) radius_px: f64,
}

/// Side of the smallest square that is enlarged, in pixels of the image.
const MIN_ZOOMED_SIDE_PX: f64 = 40.0;
/// Side of the square that is enlarged, as a multiple of the diameter of what is shown.
const ZOOMED_DIAMETERS: f64 = 1.3;
/// The least such multiple, if otherwise it would not be enlarged at all.
const LEAST_ZOOMED_DIAMETERS: f64 = 1.1;
const MIN_ZOOM: u32 = 2;
const MAX_ZOOM: u32 = 8;
/// Side of the enlarged square, as a share of the image's shorter side.
const MAX_INSET_SHARE: f64 = 0.45;

const DOT_RADIUS_PX: f64 = 0.8;
const DOT_OPACITY: f32 = 0.4;
const LINE_WIDTH_PX: f32 = 1.2;
const FRAME_COLOR: Rgb = [255, 255, 255];

/// Draws an overlay over an image.
pub(crate) fn annotated(image: &RgbImage, overlay: &Overlay) -> RgbImage {
    let Some(mut canvas) = canvas_of(image) else {
        return image.clone();
    };
    View::WHOLE.draw_marks(&mut canvas, &overlay.marks);
    if let Some(inset) = Inset::at(image, overlay.zoom) {
        inset.draw(&mut canvas, image, &overlay.marks);
    }
    draw_notes(&mut canvas, &overlay.notes);
    if !overlay.label.is_empty() {
        draw_label(&mut canvas, &overlay.label);
    }
    picture_from(&canvas)
}

/// The part of the image that a canvas shows, and its magnification.
struct View {
    /// Column and row of the image pixel in the top left corner of the canvas.
    origin_px: [u32; 2],
    /// Side of an image pixel on the canvas.
    zoom: u32,
}

impl View {
    const WHOLE: Self = Self {
        origin_px: [0, 0],
        zoom: 1,
    };

    /// Returns the position of an image point on the canvas.
    fn canvas_from_image(&self, [u, v]: [f64; 2]) -> [f64; 2] {
        // The canvas counts from the corners of its pixels, not from their centres.
        [
            (u + 0.5 - f64::from(self.origin_px[0])) * f64::from(self.zoom),
            (v + 0.5 - f64::from(self.origin_px[1])) * f64::from(self.zoom),
        ]
    }

    fn draw_marks(&self, canvas: &mut Pixmap, marks: &[Mark]) {
        for mark in marks {
            let points: Vec<_> = mark
                .points_px
                .iter()
                .map(|p| p.map(|p| self.canvas_from_image(p)))
                .collect();
            match mark.shape {
                Shape::Dots => self.draw_dots(canvas, &points, mark.color),
                Shape::Line | Shape::Dashes => {
                    self.draw_line(canvas, &points, mark.color, mark.shape);
                }
                Shape::Contour | Shape::WideContour => {
                    let closed: Vec<_> = points.iter().chain(points.first()).copied().collect();
                    self.draw_line(canvas, &closed, mark.color, mark.shape);
                }
            }
        }
    }

    fn draw_dots(&self, canvas: &mut Pixmap, points: &[Option<[f64; 2]>], color: Rgb) {
        let mut paint = paint(color);
        let mut translucent = opaque(color);
        translucent.set_alpha(DOT_OPACITY);
        paint.set_color(translucent);
        // Enlarged dots grow less than the image, so that the image below them stays visible.
        let radius = DOT_RADIUS_PX * f64::from(self.zoom).sqrt();
        let (width, height) = (f64::from(canvas.width()), f64::from(canvas.height()));
        for [x, y] in points.iter().flatten() {
            let seen =
                (-radius..width + radius).contains(x) && (-radius..height + radius).contains(y);
            if !seen {
                continue;
            }
            if let Some(dot) = PathBuilder::from_circle(*x as f32, *y as f32, radius as f32) {
                canvas.fill_path(&dot, &paint, FillRule::Winding, Transform::identity(), None);
            }
        }
    }

    fn draw_line(
        &self,
        canvas: &mut Pixmap,
        points: &[Option<[f64; 2]>],
        color: Rgb,
        shape: Shape,
    ) {
        let size = [f64::from(canvas.width()), f64::from(canvas.height())];
        let mut path = PathBuilder::new();
        let mut drawn_to = None;
        for pair in points.windows(2) {
            let clipped = match pair {
                [Some(from), Some(to)] => clipped(*from, *to, size),
                _ => None,
            };
            let Some([from, to]) = clipped else {
                drawn_to = None;
                continue;
            };
            if drawn_to != Some(from) {
                path.move_to(from[0] as f32, from[1] as f32);
            }
            path.line_to(to[0] as f32, to[1] as f32);
            drawn_to = Some(to);
        }
        let mut width = if self.zoom == 1 {
            LINE_WIDTH_PX
        } else {
            1.5 * LINE_WIDTH_PX
        };
        if shape == Shape::WideContour {
            width *= 3.0;
        }
        let dash = match shape {
            Shape::Dashes => StrokeDash::new(vec![4.0, 6.0], 0.0),
            _ => None,
        };
        let stroke = Stroke {
            width,
            dash,
            line_cap: LineCap::Round,
            line_join: LineJoin::Round,
            ..Stroke::default()
        };
        if let Some(path) = path.finish() {
            canvas.stroke_path(&path, &paint(color), &stroke, Transform::identity(), None);
        }
    }
}

fn paint(color: Rgb) -> Paint<'static> {
    let mut paint = Paint::default();
    paint.set_color(opaque(color));
    paint
}

/// Returns the part of a line that lies on a canvas of this size or just beside it (Liang and Barsky).
fn clipped(from: [f64; 2], to: [f64; 2], size: [f64; 2]) -> Option<[[f64; 2]; 2]> {
    const MARGIN: f64 = 4.0;
    if !from.iter().chain(&to).all(|c| c.is_finite()) {
        return None;
    }
    let (mut start, mut end) = (0.0_f64, 1.0_f64);
    for axis in 0..2 {
        let step = to[axis] - from[axis];
        let bounds = [-MARGIN - from[axis], size[axis] + MARGIN - from[axis]];
        if step == 0.0 {
            if bounds[0] > 0.0 || bounds[1] < 0.0 {
                return None;
            }
        } else {
            let crossings = bounds.map(|bound| bound / step);
            start = start.max(crossings[0].min(crossings[1]));
            end = end.min(crossings[0].max(crossings[1]));
        }
    }
    // An end that is not clipped keeps its exact bits, so that joined lines stay joined.
    let at = |share: f64| {
        [0, 1].map(|axis| match share {
            0.0 => from[axis],
            1.0 => to[axis],
            _ => from[axis] + share * (to[axis] - from[axis]),
        })
    };
    let ends = [at(start), at(end)];
    (start <= end && ends.iter().flatten().all(|c| c.is_finite())).then_some(ends)
}

/// The enlarged neighbourhood of a point, in a lower corner of the image.
struct Inset {
    view: View,
    /// Side of the square that is enlarged, in pixels of the image.
    zoomed_side_px: u32,
    corner_px: [u32; 2],
    side_px: u32,
}

impl Inset {
    /// Gap between the inset and the image's border.
    const GAP_PX: u32 = 6;

    /// Places the inset; `None` without a point inside the image, in images that are too small for it, and if what it would
    /// show is too large to be enlarged.
    fn at(image: &RgbImage, zoomed: Option<Zoomed>) -> Option<Self> {
        let Zoomed {
            center_px: [u, v],
            radius_px,
        } = zoomed?;
        let (width, height) = image.dimensions();
        let inside = (-0.5..f64::from(width) - 0.5).contains(&u)
            && (-0.5..f64::from(height) - 0.5).contains(&v);
        let largest_px = MAX_INSET_SHARE * f64::from(width.min(height));
        let least_px = (2.0 * LEAST_ZOOMED_DIAMETERS * radius_px).max(MIN_ZOOMED_SIDE_PX);
        let zoomed_side_px = (2.0 * ZOOMED_DIAMETERS * radius_px)
            .max(MIN_ZOOMED_SIDE_PX)
            .ceil()
            .min((largest_px / f64::from(MIN_ZOOM)).floor());
        if !inside || zoomed_side_px < least_px {
            return None;
        }
        let zoom = ((largest_px / zoomed_side_px) as u32).min(MAX_ZOOM);
        let zoomed_side_px = zoomed_side_px as u32;
        let side_px = zoom * zoomed_side_px;
        let first = |centre: f64, size: u32| {
            let half = f64::from(zoomed_side_px / 2);
            ((centre - half).round().max(0.0) as u32).min(size - zoomed_side_px)
        };
        let left = if u > 0.5 * f64::from(width) {
            Self::GAP_PX
        } else {
            width - side_px - Self::GAP_PX
        };
        Some(Self {
            view: View {
                origin_px: [first(u, width), first(v, height)],
                zoom,
            },
            zoomed_side_px,
            corner_px: [left, height - side_px - Self::GAP_PX],
            side_px,
        })
    }

    fn draw(&self, canvas: &mut Pixmap, image: &RgbImage, marks: &[Mark]) {
        let [u, v] = self.view.origin_px;
        let side = self.side_px;
        let part = image.crop(u, v, self.zoomed_side_px, self.zoomed_side_px);
        let enlarged = part.repeat(self.view.zoom);
        let Some(mut inset) = canvas_of(&enlarged) else {
            return;
        };
        self.view.draw_marks(&mut inset, marks);
        draw_frame(canvas, self.view.origin_px, self.zoomed_side_px, 1.0);
        let [x, y] = self.corner_px;
        canvas.draw_pixmap(
            x as i32,
            y as i32,
            inset.as_ref(),
            &PixmapPaint::default(),
            Transform::identity(),
            None,
        );
        draw_frame(canvas, self.corner_px, side, 2.0);
    }
}

/// Draws a square's outline around its pixels.
fn draw_frame(canvas: &mut Pixmap, corner_px: [u32; 2], side_px: u32, width_px: f32) {
    let [x, y] = corner_px.map(|c| c as f32 - 0.5 * width_px);
    let side = side_px as f32 + width_px;
    let stroke = Stroke {
        width: width_px,
        ..Stroke::default()
    };
    if let Some(rect) = Rect::from_xywh(x, y, side, side) {
        let path = PathBuilder::from_rect(rect);
        canvas.stroke_path(
            &path,
            &paint(FRAME_COLOR),
            &stroke,
            Transform::identity(),
            None,
        );
    }
}

/// Draws a cross at each note, and its text in white on a dark strip beside it unless a later note's text is there.
fn draw_notes(canvas: &mut Pixmap, notes: &[Note]) {
    let strips: Vec<_> = notes
        .iter()
        .map(|note| NoteStrip::of(canvas, note))
        .collect();
    for (number, (note, strip)) in notes.iter().zip(&strips).enumerate() {
        let [x, y] = View::WHOLE.canvas_from_image(note.at_px);
        let arm = f64::from(0.5 * strip.text_px);
        for [dx, dy] in [[arm, 0.0], [0.0, arm]] {
            let ends = [Some([x - dx, y - dy]), Some([x + dx, y + dy])];
            View::WHOLE.draw_line(canvas, &ends, note.color, Shape::Line);
        }
        let later = &strips[number + 1..];
        if !later.iter().any(|other| other.covers(strip)) {
            strip.draw(canvas, &note.text);
        }
    }
}

/// The place of a note's text.
struct NoteStrip {
    text_px: f32,
    corner_px: [f32; 2],
    size_px: [f32; 2],
}

impl NoteStrip {
    /// Places it to the right of the cross; to the left if there is room only there.
    fn of(canvas: &Pixmap, note: &Note) -> Self {
        let text_px = (canvas.width() as f32 / 60.0).clamp(9.0, 18.0);
        let [x, y] = View::WHOLE.canvas_from_image(note.at_px).map(|c| c as f32);
        let width = text_px * (width_em(&note.text) + 0.4);
        let right = x + 0.6 * text_px;
        let left = x - 0.6 * text_px - width;
        let fits = right + width < canvas.width() as f32 || left < 0.0;
        Self {
            text_px,
            corner_px: [if fits { right } else { left }, y - 0.65 * text_px],
            size_px: [width, 1.3 * text_px],
        }
    }

    fn covers(&self, other: &Self) -> bool {
        (0..2).all(|axis| {
            self.corner_px[axis] < other.corner_px[axis] + other.size_px[axis]
                && other.corner_px[axis] < self.corner_px[axis] + self.size_px[axis]
        })
    }

    fn draw(&self, canvas: &mut Pixmap, text: &str) {
        let ([left, top], [width, height]) = (self.corner_px, self.size_px);
        let mut strip = paint([0; 3]);
        strip.set_color_rgba8(0, 0, 0, 150);
        if let Some(rect) = Rect::from_xywh(left, top, width, height) {
            canvas.fill_rect(rect, &strip, Transform::identity(), None);
        }
        let caption = Caption {
            text,
            at_px: [left + 0.2 * self.text_px, top + self.text_px],
            height_px: self.text_px,
            max_width_px: width - 0.4 * self.text_px,
            color: [255; 3],
        };
        write_caption(canvas, &caption);
    }
}

/// Writes the label in white on a dark strip along the top.
fn draw_label(canvas: &mut Pixmap, label: &str) {
    let width_px = canvas.width() as f32;
    let height_px = (width_px / 45.0).clamp(9.0, 24.0);
    let mut strip = paint([0; 3]);
    strip.set_color_rgba8(0, 0, 0, 150);
    if let Some(rect) = Rect::from_xywh(0.0, 0.0, width_px, 1.6 * height_px) {
        canvas.fill_rect(rect, &strip, Transform::identity(), None);
    }
    let caption = Caption {
        text: label,
        at_px: [0.5 * height_px, 1.15 * height_px],
        height_px,
        max_width_px: width_px - height_px,
        color: [255; 3],
    };
    write_caption(canvas, &caption);
}

#[cfg(test)]
#[path = "overlay_tests.rs"]
mod tests;
