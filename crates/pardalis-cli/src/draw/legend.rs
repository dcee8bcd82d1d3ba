//! The column beside a plot that says what its lines and marks mean.

use plotters::prelude::*;
use plotters::style::text_anchor::HPos;

use super::svg::{Area, fill, line, size_px, text_style, units, write_text};
use super::{INK, Rgb, shortened};

/// Width of the column.
pub(super) const WIDTH_PX: f64 = 180.0;

const ROW_PX: f64 = 20.0;
const TOP_PX: f64 = 22.0;

/// What stands before an entry's text.
#[derive(Clone, Copy)]
pub(super) enum Key {
    /// A thick coloured line: a target's track.
    Track(Rgb),
    /// A thin dark line.
    Truth,
    /// A pale stripe with a line in it.
    Band,
    /// Where a path begins.
    Start,
    /// Where a path ends.
    End,
    /// A camera.
    Camera,
}

/// Writes the entries one below the other, as many as there is room for.
pub(super) fn draw(area: &Area<'_>, entries: &[(Key, String)]) -> anyhow::Result<()> {
    let room = ((size_px(area)[1] - TOP_PX) / ROW_PX).floor().max(1.0) as usize;
    let style = text_style(13.0, HPos::Left);
    for (row, (key, name)) in entries.iter().take(room).enumerate() {
        let y_px = TOP_PX + ROW_PX * row as f64;
        if row + 1 == room && entries.len() > room {
            let more = format!("… and {} more", entries.len() - row);
            return write_text(area, &more, [44.0, y_px], &style);
        }
        draw_key(area, *key, y_px)?;
        write_text(area, &shortened(name, 16), [44.0, y_px], &style)?;
    }
    Ok(())
}

fn draw_key(area: &Area<'_>, key: Key, y_px: f64) -> anyhow::Result<()> {
    let (left, middle, right) = (units(10.0), units(23.0), units(36.0));
    let y = units(y_px);
    let stroke = |style| PathElement::new(vec![(left, y), (right, y)], style);
    match key {
        Key::Track(color) => area.draw(&stroke(line(color, 1.0, 2.5)))?,
        Key::Truth => area.draw(&stroke(line(INK, 1.0, 1.0)))?,
        Key::Band => {
            let corners = [(left, y - units(6.0)), (right, y + units(6.0))];
            area.draw(&Rectangle::new(corners, fill([128; 3], 0.3)))?;
        }
        Key::Start => area.draw(&start_mark((middle, y), [128; 3]))?,
        Key::End => area.draw(&end_mark((middle, y), [128; 3]))?,
        Key::Camera => area.draw(&camera_mark((middle, y)))?,
    }
    Ok(())
}

/// An open circle.
pub(super) fn start_mark<C>(at: C, color: Rgb) -> Circle<C, i32> {
    Circle::new(at, units(4.5), line(color, 1.0, 2.0))
}

/// A filled circle.
pub(super) fn end_mark<C>(at: C, color: Rgb) -> Circle<C, i32> {
    Circle::new(at, units(4.5), fill(color, 1.0))
}

/// A dark triangle.
pub(super) fn camera_mark<C>(at: C) -> TriangleMarker<C, i32> {
    TriangleMarker::new(at, units(6.0), fill(INK, 1.0))
}
