//! One plot with its two axes: ranges, ticks, grid.

use std::ops::{Range, RangeInclusive};

use plotters::coord::cartesian::Cartesian2d;
use plotters::coord::types::RangedCoordf64;
use plotters::prelude::*;
use plotters::style::text_anchor::HPos;

use super::sheet::Sheet;
use super::svg::{Area, fill, line, size_px, text_style, units, write_text};
use super::{INK, Rgb, shortened};

/// A panel to draw into, in the coordinates of its axes.
pub(super) type Panel<'a> =
    ChartContext<'a, Sheet<'a>, Cartesian2d<RangedCoordf64, RangedCoordf64>>;

/// Space around the plot itself, for tick labels and the axes' names.
pub(super) const LEFT_PX: f64 = 78.0;
pub(super) const BOTTOM_PX: f64 = 44.0;
pub(super) const TOP_PX: f64 = 12.0;
pub(super) const RIGHT_PX: f64 = 14.0;

/// Height of tick labels, and about the width of one of their characters.
const TICK_TEXT_PX: f64 = 12.0;
const TICK_CHAR_PX: f64 = 7.8;
const TICK_PX: f64 = 4.0;

const GRID: Rgb = [224, 224, 224];

/// The contents of one axis.
pub(super) struct Axis<'a> {
    /// Lowest and highest value; must not be empty.
    range: Range<f64>,
    /// The shown quantity, with its unit.
    name: &'a str,
    marks: Marks<'a>,
}

/// The positions and labels of the ticks of an axis.
enum Marks<'a> {
    /// At round numbers.
    Round,
    /// At 1, 2 and 5 times powers of ten; the axis holds decadic logarithms.
    Decades,
    /// These names, at 0, 1, 2 and so on.
    Names(&'a [String]),
}

impl<'a> Axis<'a> {
    /// Creates a linear axis.
    pub(super) fn new(range: Range<f64>, name: &'a str) -> Self {
        let marks = Marks::Round;
        Self { range, name, marks }
    }

    /// Creates a logarithmic axis; the range and the points are decadic logarithms.
    pub(super) fn logarithmic(range: Range<f64>, name: &'a str) -> Self {
        let marks = Marks::Decades;
        Self { range, name, marks }
    }

    /// Creates an axis of names, the first at 0, the next at 1.
    pub(super) fn of_names(names: &'a [String], name: &'a str) -> Self {
        Self {
            range: -0.5..names.len().max(1) as f64 - 0.5,
            name,
            marks: Marks::Names(names),
        }
    }

    /// Returns the lowest and highest value.
    pub(super) fn range(&self) -> Range<f64> {
        self.range.clone()
    }

    /// Returns ticks with their labels, about `max_count` at most.
    fn ticks(&self, max_count: f64) -> Vec<(f64, String)> {
        match self.marks {
            Marks::Round => {
                let (values, decimals) = ticks(&self.range, max_count);
                let labelled = values.into_iter().map(|v| (v, tick_label(v, decimals)));
                labelled.collect()
            }
            Marks::Decades => decade_ticks(&self.range, max_count),
            Marks::Names(names) => names
                .iter()
                .enumerate()
                .map(|(i, name)| (i as f64, name.clone()))
                .collect(),
        }
    }
}

/// Returns the range of all values; `None` without values.
pub(super) fn extent(values: impl Iterator<Item = f64>) -> Option<RangeInclusive<f64>> {
    values.fold(None, |extent, value| match extent {
        None => Some(value..=value),
        Some(e) => Some(e.start().min(value)..=e.end().max(value)),
    })
}

/// Returns the extent with a margin, at least `min_span` wide; a range around 0 without an extent.
pub(super) fn padded(extent: Option<RangeInclusive<f64>>, min_span: f64) -> Range<f64> {
    let extent = extent.unwrap_or(0.0..=0.0);
    let middle = 0.5 * (extent.start() + extent.end());
    let span = (1.1 * (extent.end() - extent.start())).max(min_span);
    middle - 0.5 * span..middle + 0.5 * span
}

/// Widens one of two ranges so that both axes of a plot of this size have the same scale.
pub(super) fn equal_scales(
    x: &Range<f64>,
    y: &Range<f64>,
    plot_px: [f64; 2],
) -> (Range<f64>, Range<f64>) {
    let span = |r: &Range<f64>| r.end - r.start;
    let per_px = (span(x) / plot_px[0]).max(span(y) / plot_px[1]);
    let widened = |r: &Range<f64>, side_px: f64| {
        let middle = 0.5 * (r.start + r.end);
        let half = 0.5 * per_px * side_px;
        middle - half..middle + half
    };
    (widened(x, plot_px[0]), widened(y, plot_px[1]))
}

/// Returns the logarithms of 1, 2 and 5 times powers of ten with their labels, or only of powers of ten if those were
/// too many.
fn decade_ticks(range: &Range<f64>, max_count: f64) -> Vec<(f64, String)> {
    let decades = range.start.floor() as i32..=range.end.ceil() as i32;
    let digits: &[u32] = if 3.0 * (range.end - range.start) <= max_count {
        &[1, 2, 5]
    } else {
        &[1]
    };
    decades
        .flat_map(|decade| digits.iter().map(move |digit| (decade, *digit)))
        .map(|(decade, digit)| {
            let value = f64::from(digit) * 10_f64.powi(decade);
            (
                libm::log10(value),
                tick_label(value, (-decade).max(0) as usize),
            )
        })
        .filter(|(at, _)| (range.start..=range.end).contains(at))
        .collect()
}

/// Returns multiples of 1, 2 or 5 times a power of ten, about `max_count` at most but at least two, because a single one is no scale, and the number
/// of decimals they need.
pub(super) fn ticks(range: &Range<f64>, max_count: f64) -> (Vec<f64>, usize) {
    let (values, decimals) = multiples(range, max_count.max(1.0));
    if values.len() < 2 {
        // Steps of at most half the range, to whatever they are rounded.
        return multiples(range, 5.0);
    }
    (values, decimals)
}

/// The same, but there may be fewer than two.
fn multiples(range: &Range<f64>, max_count: f64) -> (Vec<f64>, usize) {
    let spacing = (range.end - range.start) / max_count;
    let exponent = libm::log10(spacing).floor();
    let power = libm::pow(10_f64, exponent);
    let (step, step_exponent) = if spacing <= power {
        (power, exponent)
    } else if spacing <= 2.0 * power {
        (2.0 * power, exponent)
    } else if spacing <= 5.0 * power {
        (5.0 * power, exponent)
    } else {
        (10.0 * power, exponent + 1.0)
    };
    let first = (range.start / step).ceil();
    let count = ((range.end / step).floor() - first).max(-1.0) as usize + 1;
    let values = (0..count).map(|i| (first + i as f64) * step).collect();
    (values, (-step_exponent).max(0.0) as usize)
}

/// Returns a tick's label, with a true minus sign.
pub(super) fn tick_label(value: f64, decimals: usize) -> String {
    format!("{value:.decimals$}").replace('-', "−")
}

/// Draws grid, ticks and axis names of a panel that fills the area.
pub(super) fn panel<'a>(area: &Area<'a>, x: &Axis<'_>, y: &Axis<'_>) -> anyhow::Result<Panel<'a>> {
    let [width_px, height_px] = size_px(area);
    let plot_px = [
        width_px - LEFT_PX - RIGHT_PX,
        height_px - TOP_PX - BOTTOM_PX,
    ];
    // Labels of large times are long, so that fewer of them fit.
    let label_chars = x
        .ticks(8.0)
        .last()
        .map_or(1, |(_, label)| label.chars().count());
    let x_room = plot_px[0] / (TICK_CHAR_PX * label_chars as f64 + 30.0);
    let x_ticks = x.ticks(x_room);
    let y_ticks = y.ticks((plot_px[1] / 30.0).min(10.0));
    // Names are shortened if they would overlap.
    let most_chars = (plot_px[0] / x_ticks.len().max(1) as f64 / TICK_CHAR_PX * 1.2).max(4.0);

    let [left, top] = [LEFT_PX, TOP_PX];
    let [right, bottom] = [left + plot_px[0], top + plot_px[1]];
    let share = |range: &Range<f64>, value: f64| (value - range.start) / (range.end - range.start);
    for (value, label) in x_ticks {
        let at = left + plot_px[0] * share(&x.range, value);
        draw_stroke(area, [[at, top], [at, bottom]], GRID)?;
        draw_stroke(area, [[at, bottom], [at, bottom + TICK_PX]], INK)?;
        let label = shortened(&label, most_chars as usize);
        let style = text_style(TICK_TEXT_PX, HPos::Center);
        write_text(area, &label, [at, bottom + 13.0], &style)?;
    }
    for (value, label) in y_ticks {
        let at = bottom - plot_px[1] * share(&y.range, value);
        draw_stroke(area, [[left, at], [right, at]], GRID)?;
        draw_stroke(area, [[left - TICK_PX, at], [left, at]], INK)?;
        let style = text_style(TICK_TEXT_PX, HPos::Right);
        write_text(area, &label, [left - 8.0, at], &style)?;
    }
    draw_stroke(area, [[left, top], [left, bottom]], INK)?;
    draw_stroke(area, [[left, bottom], [right, bottom]], INK)?;

    let name_style = text_style(13.0, HPos::Center);
    let middle = [0.5 * (left + right), 0.5 * (top + bottom)];
    write_text(area, x.name, [middle[0], height_px - 8.0], &name_style)?;
    let upwards = name_style.transform(FontTransform::Rotate270);
    write_text(area, y.name, [12.0, middle[1]], &upwards)?;

    let panel = ChartBuilder::on(area)
        .margin_top(units(TOP_PX))
        .margin_right(units(RIGHT_PX))
        .set_label_area_size(LabelAreaPosition::Left, units(LEFT_PX))
        .set_label_area_size(LabelAreaPosition::Bottom, units(BOTTOM_PX))
        .build_cartesian_2d(x.range.clone(), y.range.clone())?;
    Ok(panel)
}

fn draw_stroke(area: &Area<'_>, ends_px: [[f64; 2]; 2], color: Rgb) -> anyhow::Result<()> {
    let ends = ends_px.map(|[x, y]| (units(x), units(y)));
    area.draw(&PathElement::new(ends, line(color, 1.0, 1.0)))?;
    Ok(())
}

/// Writes a note at the top of an area's panel: why it is empty, or what it leaves out.
pub(super) fn write_note(area: &Area<'_>, note: &str) -> anyhow::Result<()> {
    let middle_px = 0.5 * (LEFT_PX + size_px(area)[0] - RIGHT_PX);
    let half_width_px = 4.0 * note.chars().count() as f64;
    let paper = [
        (units(middle_px - half_width_px), units(TOP_PX)),
        (units(middle_px + half_width_px), units(TOP_PX + 17.0)),
    ];
    area.draw(&Rectangle::new(paper, fill([255; 3], 0.9)))?;
    let style = text_style(13.0, HPos::Center);
    write_text(area, note, [middle_px, TOP_PX + 8.0], &style)
}

/// Draws a line through points in the coordinates of the axes; a single point becomes a dot.
pub(super) fn draw_path(
    panel: &mut Panel<'_>,
    points: &[(f64, f64)],
    style: ShapeStyle,
) -> anyhow::Result<()> {
    if let [point] = points {
        let dot = Circle::new(*point, units(2.0), style.filled());
        panel.draw_series([dot])?;
    } else {
        panel.draw_series([PathElement::new(points.to_vec(), style)])?;
    }
    Ok(())
}

/// Splits values into runs without gaps.
pub(super) fn runs<T>(values: impl Iterator<Item = Option<T>>) -> Vec<Vec<T>> {
    let mut runs = vec![Vec::new()];
    for value in values {
        match (value, runs.last_mut()) {
            (Some(value), Some(run)) => run.push(value),
            _ => runs.push(Vec::new()),
        }
    }
    runs.retain(|run| !run.is_empty());
    runs
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_numbers_inside_the_range() {
        assert_eq!(ticks(&(-0.9..1.1), 5.0), (vec![-0.5, 0.0, 0.5, 1.0], 1));
        assert_eq!(
            ticks(&(0.0..100.0), 5.0),
            (vec![0.0, 20.0, 40.0, 60.0, 80.0, 100.0], 0)
        );
        assert_eq!(ticks(&(1.0..9.0), 1.5), (vec![2.0, 4.0, 6.0, 8.0], 0));
        for range in [0.0..2e-3, 1.7e9..1.7e9 + 2.0, -1e5..1e5, 5.0..5.1] {
            let (values, _) = ticks(&range, 6.0);
            assert!((2..=7).contains(&values.len()), "{range:?}: {values:?}");
            assert!(
                values.iter().all(|v| range.start <= *v && *v <= range.end),
                "{range:?}: {values:?}"
            );
        }
    }

    #[test]
    fn logarithmic_ticks_are_labelled_with_the_numbers_themselves() {
        let labels = |range| -> Vec<String> {
            let ticks = decade_ticks(&range, 8.0);
            ticks.into_iter().map(|(_, label)| label).collect()
        };
        assert_eq!(labels(-1.1..0.4), ["0.1", "0.2", "0.5", "1", "2"]);
        assert_eq!(labels(0.0..4.0), ["1", "10", "100", "1000", "10000"]);
    }

    #[test]
    fn equal_scales_only_widen() {
        let (x, y) = equal_scales(&(0.0..4.0), &(0.0..1.0), [400.0, 200.0]);
        assert_eq!((x, y), (0.0..4.0, -0.5..1.5));
    }

    #[test]
    fn gaps_separate_the_runs() {
        let values = [None, Some(1), Some(2), None, None, Some(3)];
        assert_eq!(runs(values.into_iter()), [vec![1, 2], vec![3]]);
    }
}
