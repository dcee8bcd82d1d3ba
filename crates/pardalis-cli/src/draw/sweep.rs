//! Errors against a setting that was varied, and against the computing time.

use std::ops::Range;
use std::path::{Path, PathBuf};

use plotters::prelude::*;
use plotters::style::text_anchor::HPos;

use super::legend::{self, Key, group_mark};
use super::panel::{Axis, Panel, draw_path, extent, padded, panel, write_note};
use super::svg::{Area, drawing, line, text_style, units, write_svg_and_png};
use super::{PALETTE, Rgb, shortened};

/// Width of each panel, and height of the figure.
const PANEL_WIDTH_PX: f64 = 520.0;
const HEIGHT_PX: f64 = 420.0;

/// An axis is logarithmic if the ratio of its largest to its smallest value exceeds this.
const LOGARITHMIC_OVER: f64 = 20.0;

/// Approximate width of a character of a point's label.
const LABEL_CHAR_PX: f64 = 6.6;

/// Series are shifted by this share of the axis, so that their bars do not coincide.
const SHIFT_SHARE: f64 = 0.009;

/// The results for one value of the setting, over all its seeds.
#[derive(Debug, Clone)]
pub(crate) struct SweepPoint {
    /// The label of the value.
    pub(crate) label: String,
    /// The value itself, if it is a number.
    pub(crate) value: Option<f64>,
    /// Milliseconds of computation per frame, if they were measured.
    pub(crate) ms_a_frame: Option<f64>,
    /// The median error, in metres.
    pub(crate) median_m: f64,
    /// The lowest error, in metres.
    pub(crate) lowest_m: f64,
    /// The highest error, in metres.
    pub(crate) highest_m: f64,
}

impl SweepPoint {
    /// Lowest, median and highest error in millimetres.
    fn errors_mm(&self) -> [f64; 3] {
        [self.lowest_m, self.median_m, self.highest_m].map(|error_m| 1e3 * error_m)
    }

    fn is_drawable(&self) -> bool {
        self.errors_mm().iter().all(|error| error.abs() < 1e9)
    }
}

/// One run of the sweep, with everything else equal.
#[derive(Debug, Clone)]
pub(crate) struct SweepSeries {
    /// What the legend calls it.
    pub(crate) name: String,
    /// In the order of the setting.
    pub(crate) points: Vec<SweepPoint>,
}

/// Draws errors against a setting and, if times are known, against the time per frame into `STEM-sweep.svg` and `.png`
/// in a folder that must exist; `x_name` names the setting with its unit. Returns the paths of the files.
///
/// The axis of the setting has numbers if all values are numbers, otherwise labels. Axes are logarithmic if the largest
/// value is more than 20 times the smallest. Points with errors that are not finite are left out.
pub(crate) fn write_sweep_figures(
    folder: &Path,
    stem: &str,
    x_name: &str,
    series: &[SweepSeries],
) -> anyhow::Result<Vec<PathBuf>> {
    let sweep = Sweep::new(series);
    let has_times = sweep.points().any(|point| usable_time(point).is_some());
    let panels = if has_times { 2 } else { 1 };
    let width_px = PANEL_WIDTH_PX * panels as f64 + legend::WIDTH_PX;
    let drawing = drawing([width_px, HEIGHT_PX], |area| {
        let (plots, column) = area.split_horizontally(units(width_px - legend::WIDTH_PX));
        let names = sweep.series.iter().enumerate();
        let mut entries: Vec<_> = names
            .map(|(i, (name, _))| (Key::Mark(i), (*name).to_owned()))
            .collect();
        entries.push((Key::Bar, "lowest to highest, mark at the median".to_owned()));
        legend::draw(&column, &entries)?;
        let areas = plots.split_evenly((1, panels));
        sweep.draw_against_setting(&areas[0], x_name)?;
        match areas.get(1) {
            Some(area) => sweep.draw_against_time(area),
            None => Ok(()),
        }
    })?;
    Ok(write_svg_and_png(folder, &format!("{stem}-sweep"), &drawing)?.into())
}

fn usable_time(point: &SweepPoint) -> Option<f64> {
    point.ms_a_frame.filter(|ms| (0.0..1e9).contains(ms))
}

/// An axis of numbers, logarithmic or not.
struct Scale {
    range: Range<f64>,
    is_logarithmic: bool,
}

impl Scale {
    /// Creates the scale of some values; a linear one begins at 0 if `from_zero` is set.
    fn new(values: &[f64], from_zero: bool) -> Self {
        let range = extent(values.iter().copied());
        let is_logarithmic = range
            .as_ref()
            .is_some_and(|r| *r.start() > 0.0 && r.end() / r.start() > LOGARITHMIC_OVER);
        let range = if is_logarithmic {
            padded(
                range.map(|r| libm::log10(*r.start())..=libm::log10(*r.end())),
                0.1,
            )
        } else if from_zero {
            let (low, high) = range.map_or((0.0, 1.0), |r| (1.08 * r.start(), 1.08 * r.end()));
            low.min(0.0)..high.max(1e-6)
        } else {
            let size = range
                .as_ref()
                .map_or(1.0, |r| r.start().abs().max(r.end().abs()));
            padded(range, (0.1 * size).max(1e-6))
        };
        Self {
            range,
            is_logarithmic,
        }
    }

    /// Returns the position of a value on the axis.
    fn at(&self, value: f64) -> f64 {
        if self.is_logarithmic {
            libm::log10(value)
        } else {
            value
        }
    }

    fn axis<'a>(&self, name: &'a str) -> Axis<'a> {
        if self.is_logarithmic {
            Axis::logarithmic(self.range.clone(), name)
        } else {
            Axis::new(self.range.clone(), name)
        }
    }
}

struct Sweep<'a> {
    /// Names and points that can be drawn.
    series: Vec<(&'a str, Vec<&'a SweepPoint>)>,
    error_mm: Scale,
}

impl<'a> Sweep<'a> {
    fn new(series: &'a [SweepSeries]) -> Self {
        let drawable = series.iter().map(|one| {
            let points = one.points.iter().filter(|point| point.is_drawable());
            (&*one.name, points.collect::<Vec<_>>())
        });
        let series: Vec<_> = drawable.collect();
        let points = series.iter().flat_map(|(_, points)| points);
        let errors_mm: Vec<f64> = points.flat_map(|point| point.errors_mm()).collect();
        Self {
            error_mm: Scale::new(&errors_mm, true),
            series,
        }
    }

    fn points(&self) -> impl Iterator<Item = &'a SweepPoint> {
        self.series
            .iter()
            .flat_map(|(_, points)| points.iter().copied())
    }

    fn draw_against_setting(&self, area: &Area<'_>, x_name: &str) -> anyhow::Result<()> {
        let numbers: Option<Vec<f64>> = self
            .points()
            .map(|point| point.value.filter(|value| value.abs() < 1e15))
            .collect();
        if let Some(numbers) = numbers {
            let scale = Scale::new(&numbers, false);
            let place = |point: &SweepPoint| point.value.map(|value| scale.at(value));
            self.draw_points(area, &scale.axis(x_name), place, true)?;
        } else {
            let mut labels: Vec<String> = Vec::new();
            for point in self.points() {
                if !labels.contains(&point.label) {
                    labels.push(point.label.clone());
                }
            }
            let place = |point: &SweepPoint| {
                let index = labels.iter().position(|label| *label == point.label);
                index.map(|index| index as f64)
            };
            self.draw_points(area, &Axis::of_names(&labels, x_name), place, false)?;
        }
        Ok(())
    }

    /// Draws errors against time, each point with its label.
    fn draw_against_time(&self, area: &Area<'_>) -> anyhow::Result<()> {
        let times_ms: Vec<f64> = self.points().filter_map(usable_time).collect();
        let scale = Scale::new(&times_ms, true);
        let place = |point: &SweepPoint| usable_time(point).map(|ms| scale.at(ms));
        let axis = scale.axis("time per frame (ms)");
        let panel = self.draw_points(area, &axis, place, false)?;
        let right_end = area.get_pixel_range().0.end;
        let mut taken: Vec<[i32; 4]> = Vec::new();
        for (i, (_, points)) in self.series.iter().enumerate() {
            let [red, green, blue] = PALETTE[i % PALETTE.len()];
            let color = RGBColor(red, green, blue);
            for point in points {
                let Some(x) = place(point) else { continue };
                let at = (x, self.error_mm.at(point.errors_mm()[1]));
                let label = shortened(&point.label, 18);
                let width = units(LABEL_CHAR_PX * label.chars().count() as f64);
                let mark = panel.backend_coord(&at);
                // Right of the mark or left, above or below; a label without room is left out.
                let places = [(1, -1), (-1, 1), (1, 1), (-1, -1)];
                let boxes = places.map(|(side, down)| {
                    let near = mark.0 + side * units(7.0);
                    let far = near + side * width;
                    let middle = mark.1 + down * units(9.0);
                    let (top, bottom) = (middle - units(7.0), middle + units(7.0));
                    [near.min(far), top, near.max(far), bottom]
                });
                let is_free = |own: &[i32; 4]| {
                    own[2] <= right_end
                        && taken.iter().all(|other| {
                            own[0] > other[2]
                                || other[0] > own[2]
                                || own[1] > other[3]
                                || other[1] > own[3]
                        })
                };
                let Some(own) = boxes.into_iter().find(is_free) else {
                    continue;
                };
                taken.push(own);
                let offset = (own[0] - mark.0, i32::midpoint(own[1], own[3]) - mark.1);
                let style = text_style(11.0, HPos::Left).color(&color);
                let text = Text::new(label, offset, style);
                panel.plotting_area().draw(&(EmptyElement::at(at) + text))?;
            }
        }
        Ok(())
    }

    /// Draws the points at the positions that `place` returns, with bars from the lowest to the highest error, and
    /// lines between them if they are `joined`.
    fn draw_points<'b>(
        &self,
        area: &Area<'b>,
        axis: &Axis<'_>,
        place: impl Fn(&SweepPoint) -> Option<f64>,
        joined: bool,
    ) -> anyhow::Result<Panel<'b>> {
        let across = axis.range();
        let mut panel = panel(area, axis, &self.error_mm.axis("error (mm)"))?;
        let shift = SHIFT_SHARE * (across.end - across.start);
        let middle = 0.5 * (self.series.len() as f64 - 1.0);
        for (i, (_, points)) in self.series.iter().enumerate() {
            let color: Rgb = PALETTE[i % PALETTE.len()];
            let x_of = |point: &SweepPoint| Some(place(point)? + shift * (i as f64 - middle));
            let [low, median, high] = [0, 1, 2].map(|which| {
                points
                    .iter()
                    .filter_map(|point| {
                        Some((x_of(point)?, self.error_mm.at(point.errors_mm()[which])))
                    })
                    .collect::<Vec<_>>()
            });
            for (low, high) in low.iter().zip(&high) {
                draw_path(&mut panel, &[*low, *high], line(color, 0.55, 1.5))?;
            }
            if joined {
                draw_path(&mut panel, &median, line(color, 0.8, 1.2))?;
            }
            let marks = median
                .iter()
                .map(|at| EmptyElement::at(*at) + group_mark(i, 1.0));
            panel.draw_series(marks)?;
        }
        if self.points().next().is_none() {
            write_note(area, "nothing was measured")?;
        }
        Ok(panel)
    }
}

#[cfg(test)]
#[path = "sweep_tests.rs"]
mod tests;
