//! The column beside a plot that explains its lines and marks.

use plotters::prelude::*;
use plotters::style::text_anchor::HPos;

use super::svg::{Area, fill, line, size_px, text_style, units, write_text};
use super::{INK, PALETTE, Rgb, shortened};

/// Width of the column.
pub(super) const WIDTH_PX: f64 = 180.0;

const ROW_PX: f64 = 20.0;
/// Distance between the lines of one entry.
const LINE_PX: f64 = 15.0;
const LINE_CHARS: usize = 17;
const MAX_LINES: usize = 3;
const TOP_PX: f64 = 22.0;

/// The symbol before an entry's text.
#[derive(Clone, Copy)]
pub(super) enum Key {
    /// A thick coloured line: a target's track.
    Track(Rgb),
    /// A thick grey line of this opacity: tracks where the target was not seen.
    Unseen(f64),
    /// A thin dark line.
    Truth,
    /// A pale stripe with a line in it.
    Band,
    /// The start of a path.
    Start,
    /// The end of a path.
    End,
    /// A camera.
    Camera,
    /// The mark of a group, by its index.
    Mark(usize),
    /// A bar from the lowest to the highest value.
    Bar,
}

/// Writes the entries one below the other, as many as fit.
pub(super) fn draw(area: &Area<'_>, entries: &[(Key, String)]) -> anyhow::Result<()> {
    let height_px = size_px(area)[1];
    let style = text_style(13.0, HPos::Left);
    let mut y_px = TOP_PX;
    for (row, (key, name)) in entries.iter().enumerate() {
        let lines = wrapped(name);
        let next_px = y_px + LINE_PX * (lines.len() - 1) as f64 + ROW_PX;
        let is_last = row + 1 == entries.len();
        let needed_px = if is_last { next_px - ROW_PX } else { next_px };
        if row > 0 && needed_px > height_px {
            let more = format!("… and {} more", entries.len() - row);
            return write_text(area, &more, [44.0, y_px], &style);
        }
        draw_key(area, *key, y_px)?;
        for (i, text) in lines.iter().enumerate() {
            write_text(area, text, [44.0, y_px + LINE_PX * i as f64], &style)?;
        }
        y_px = next_px;
    }
    Ok(())
}

/// Splits a name into lines between words; the end of a long name is left out.
fn wrapped(name: &str) -> Vec<String> {
    let mut lines = vec![String::new()];
    for word in name.split_whitespace() {
        let line = lines.len() - 1;
        let chars = lines[line].chars().count();
        if chars == 0 {
            lines[line].push_str(word);
        } else if chars + 1 + word.chars().count() <= LINE_CHARS || lines.len() == MAX_LINES {
            lines[line].push(' ');
            lines[line].push_str(word);
        } else {
            lines.push(word.to_owned());
        }
    }
    let lines = lines.iter().map(|line| shortened(line, LINE_CHARS));
    lines.collect()
}

fn draw_key(area: &Area<'_>, key: Key, y_px: f64) -> anyhow::Result<()> {
    let (left, middle, right) = (units(10.0), units(23.0), units(36.0));
    let y = units(y_px);
    let stroke = |style| PathElement::new(vec![(left, y), (right, y)], style);
    match key {
        Key::Track(color) => area.draw(&stroke(line(color, 1.0, 2.5)))?,
        Key::Unseen(opacity) => area.draw(&stroke(line([0; 3], opacity, 2.5)))?,
        Key::Truth => area.draw(&stroke(line(INK, 1.0, 1.0)))?,
        Key::Band => {
            let corners = [(left, y - units(6.0)), (right, y + units(6.0))];
            area.draw(&Rectangle::new(corners, fill([128; 3], 0.3)))?;
        }
        Key::Start => area.draw(&start_mark((middle, y), [128; 3], 1.0))?,
        Key::End => area.draw(&end_mark((middle, y), [128; 3], 1.0))?,
        Key::Camera => area.draw(&camera_mark((middle, y)))?,
        Key::Mark(group) => {
            let mark = EmptyElement::at((middle, y)) + group_mark(group, 1.0);
            area.draw(&mark)?;
        }
        Key::Bar => {
            let ends = [(middle, y - units(7.0)), (middle, y + units(7.0))];
            area.draw(&PathElement::new(ends, line([128; 3], 1.0, 1.5)))?;
        }
    }
    Ok(())
}

/// Returns an open circle of this relative size.
pub(super) fn start_mark<C>(at: C, color: Rgb, size: f64) -> Circle<C, i32> {
    Circle::new(at, units(4.5 * size), line(color, 1.0, 2.0 * size))
}

/// Returns a filled circle of this relative size.
pub(super) fn end_mark<C>(at: C, color: Rgb, size: f64) -> Circle<C, i32> {
    Circle::new(at, units(4.5 * size), fill(color, 1.0))
}

/// Returns a dark triangle.
pub(super) fn camera_mark<C>(at: C) -> TriangleMarker<C, i32> {
    TriangleMarker::new(at, units(6.0), fill(INK, 1.0))
}

/// Returns the mark of a group: a different shape and colour for each of the first six groups.
pub(super) fn group_mark(group: usize, opacity: f64) -> PathElement<(i32, i32)> {
    let shapes: [&[(f64, f64)]; 6] = [
        &[(-1.0, 0.0), (1.0, 0.0), (0.0, 0.0), (0.0, -1.0), (0.0, 1.0)],
        &[
            (-0.8, -0.8),
            (0.8, 0.8),
            (0.0, 0.0),
            (-0.8, 0.8),
            (0.8, -0.8),
        ],
        &[
            (0.0, -1.0),
            (1.0, 0.8),
            (-1.0, 0.8),
            (0.0, -1.0),
            (1.0, 0.8),
        ],
        &[
            (-0.8, -0.8),
            (0.8, -0.8),
            (0.8, 0.8),
            (-0.8, 0.8),
            (-0.8, -0.8),
        ],
        &[
            (0.0, -1.1),
            (1.1, 0.0),
            (0.0, 1.1),
            (-1.1, 0.0),
            (0.0, -1.1),
        ],
        &[
            (-1.0, -0.8),
            (1.0, -0.8),
            (0.0, 1.0),
            (-1.0, -0.8),
            (1.0, -0.8),
        ],
    ];
    let shape = shapes[group % shapes.len()].iter();
    let outline: Vec<_> = shape
        .map(|(x, y)| (units(3.6 * x), units(3.6 * y)))
        .collect();
    PathElement::new(outline, line(PALETTE[group % PALETTE.len()], opacity, 1.6))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_split_between_words() {
        assert_eq!(wrapped("ball"), ["ball"]);
        assert_eq!(wrapped(""), [""]);
        assert_eq!(
            wrapped("occlusion by a robot, real time"),
            ["occlusion by a", "robot, real time"]
        );
        let long = wrapped(&"word ".repeat(40));
        assert_eq!(long.len(), MAX_LINES);
        assert!(long.iter().all(|line| line.chars().count() <= LINE_CHARS));
        assert!(long[2].ends_with('…'));
    }
}
