//! Plots of tracks: from above, from the side, in an oblique view, and each coordinate against time.

use std::ops::{Range, RangeInclusive};
use std::path::{Path, PathBuf};

use pardalis::Estimate;
use pardalis::tracker::TrackState;
use plotters::prelude::*;
use plotters::style::text_anchor::HPos;

use super::camera_symbol::CameraSymbol;
use super::legend::{self, Key, camera_mark, end_mark, start_mark};
use super::limits::{clipped, is_inside, is_near, outside_note, shown_ranges_m};
use super::panel::{
    Axis, BOTTOM_PX, LEFT_PX, Panel, RIGHT_PX, TOP_PX, draw_path, equal_scales, extent, padded,
    panel, runs, write_note,
};
use super::svg::{Area, Drawing, drawing, fill, line, text_style, units, write_svg_and_png};
use super::{INK, PALETTE, Rgb, shortened};

/// One row of a track.
#[derive(Debug, Clone)]
pub(crate) struct Sample {
    /// The instant, in seconds.
    pub(crate) time_s: f64,
    /// The estimate in the world frame, if there is one.
    pub(crate) position_m: Option<[f64; 3]>,
    /// Its covariance in m²: xx, xy, xz, yy, yz, zz.
    pub(crate) covariance_m2: Option<[f64; 6]>,
    /// Whether the target was seen, and its position not only predicted.
    pub(crate) is_seen: bool,
}

impl Sample {
    /// Returns the sample of an estimate at a time in seconds.
    pub(crate) fn of(time_s: f64, estimate: &Estimate) -> Self {
        Self {
            time_s,
            position_m: estimate.kinematics.map(|k| k.position_m),
            covariance_m2: estimate.kinematics.map(|k| k.covariance_m2),
            is_seen: estimate.state == TrackState::Tracking,
        }
    }
}

/// One target's estimates from one run. Series of the same name share their colour and legend entry.
#[derive(Debug, Clone)]
pub(crate) struct TrackSeries {
    /// The target's name.
    pub(crate) name: String,
    /// In ascending order of time.
    pub(crate) rows: Vec<Sample>,
}

/// The true path of one target.
#[derive(Debug, Clone)]
pub(crate) struct TruthSeries {
    /// Times in seconds and positions in the world frame in metres, in ascending order of time.
    pub(crate) rows: Vec<(f64, [f64; 3])>,
}

/// Width of every figure.
pub(super) const WIDTH_PX: f64 = 960.0;
const PLOT_WIDTH_PX: f64 = WIDTH_PX - legend::WIDTH_PX - LEFT_PX - RIGHT_PX;

/// Positions farther away are numerical failures and would shrink everything else to a dot.
const MAX_DISTANCE_M: f64 = 1e5;
const MAX_TIME_S: f64 = 1e11;

/// Minimum span of an axis, so that the noise of a still target does not fill the plot.
const MIN_SPAN_M: f64 = 0.02;

const COORDINATES: [&str; 3] = ["x (m)", "y (m)", "z (m)"];

/// The names of the plots of tracks, without their endings.
pub(crate) const TRACK_PLOTS: [&str; 4] = ["above", "side", "3d", "coordinates"];

/// The opacity of the ways of moving cameras.
pub(super) const WAY_OPACITY: f64 = 0.35;

/// Draws tracks, truth and cameras (world frame, metres) into files of the names [`TRACK_PLOTS`], each `.svg` and `.png`, in
/// a folder that must exist. Returns the paths of the files.
///
/// Positions that are not finite or beyond 100 km count as missing. Estimates far from the truth (without truth, far
/// from 98 % of the estimates) are cut off, and a note states their number. Cameras that would shrink the paths to a
/// fifth of a plot are left out, and a note states their distance.
pub(crate) fn write_track_plots(
    folder: &Path,
    series: &[TrackSeries],
    truth: &[TruthSeries],
    cameras: &[CameraSymbol],
) -> anyhow::Result<Vec<PathBuf>> {
    let tracks = series.iter().map(|track| (&*track.name, track));
    let figures = Figures::new(tracks, truth, cameras, false);
    let mut paths = Vec::new();
    let drawings = [
        figures.above()?,
        figures.side()?,
        figures.oblique()?,
        figures.coordinates()?,
    ];
    for (name, document) in TRACK_PLOTS.into_iter().zip(drawings) {
        paths.extend(write_svg_and_png(folder, name, &document)?);
    }
    Ok(paths)
}

/// One time of a series, with numbers that can be drawn.
pub(super) struct Point {
    time_s: f64,
    pub(super) position_m: [f64; 3],
    /// Twice the standard deviation of each coordinate.
    two_sigma_m: Option<[f64; 3]>,
    is_seen: bool,
}

/// The runs without gaps of one track or of one target's truth.
pub(super) struct Trace {
    /// For a track, the colour of its target or group.
    pub(super) color: Rgb,
    pub(super) runs: Vec<Vec<Point>>,
}

impl Trace {
    /// Returns the first point and the last one at which the target was seen: where it has left the images, predictions lead on.
    pub(super) fn ends(&self) -> (Option<&Point>, Option<&Point>) {
        let mut points = self.runs.iter().flatten();
        let seen = points.clone().rfind(|point| point.is_seen);
        let last = seen.or(points.clone().next_back());
        (points.next(), last)
    }

    /// Returns the stretches of a run in which the target was seen at every point, and those between them, each with
    /// whether it was seen. Neighbours share a point.
    pub(super) fn stretches(run: &[Point]) -> Vec<(&[Point], bool)> {
        let is_seen = |last: usize| run[last - 1].is_seen && run[last].is_seen;
        let mut stretches = Vec::new();
        let mut first = 0;
        for last in 1..run.len() {
            if last + 1 == run.len() || is_seen(last + 1) != is_seen(last) {
                stretches.push((&run[first..=last], is_seen(last)));
                first = last;
            }
        }
        if let [point] = run {
            stretches.push((run, point.is_seen));
        }
        stretches
    }
}

/// The contents of figures of paths.
pub(super) struct Figures<'a> {
    pub(super) tracks: Vec<Trace>,
    pub(super) truth: Vec<Trace>,
    /// The cameras near the paths.
    pub(super) cameras: Vec<&'a CameraSymbol>,
    /// The note about the cameras that are too far away to be drawn.
    far_cameras: Option<String>,
    /// The names of targets or groups, each once.
    names: Vec<&'a str>,
    /// Opacity and width in pixels of tracks; translucent and thin if there are many.
    pub(super) stroke: (f64, f64),
    /// Opacity of tracks where the target was not seen, relative to that elsewhere.
    unseen_opacity: f64,
    /// Size of the marks at the ends of tracks, relative to that in the legend.
    pub(super) mark_size: f64,
    /// The shown extents of x, y and z.
    shown_m: [Option<RangeInclusive<f64>>; 3],
    /// The same without cameras.
    path_m: [Option<RangeInclusive<f64>>; 3],
}

fn drawable_position(position_m: &[f64; 3]) -> bool {
    position_m.iter().all(|c| c.abs() <= MAX_DISTANCE_M)
}

fn point(sample: &Sample) -> Option<Point> {
    let position_m = sample.position_m.filter(drawable_position)?;
    let two_sigma_m = sample
        .covariance_m2
        .map(|c| {
            [c[0], c[3], c[5]].map(|variance_m2| 2.0 * variance_m2.clamp(0.0, f64::INFINITY).sqrt())
        })
        .filter(|two_sigma_m| two_sigma_m.iter().all(|s| s.is_finite()));
    (sample.time_s.abs() <= MAX_TIME_S).then_some(Point {
        time_s: sample.time_s,
        position_m,
        two_sigma_m,
        is_seen: sample.is_seen,
    })
}

/// Returns all positions of some paths.
fn places_m(paths: &[Trace]) -> Vec<[f64; 3]> {
    let points = paths.iter().flat_map(|path| path.runs.iter().flatten());
    points.map(|point| point.position_m).collect()
}

/// Returns the height of a name beside a mark, in units; names that would overlap are moved down.
pub(super) fn free_row(taken: &mut Vec<(i32, i32)>, mark: (i32, i32)) -> i32 {
    let same_place = |a: (i32, i32), b: (i32, i32)| {
        (a.0 - b.0).abs() < units(130.0) && (a.1 - b.1).abs() < units(14.0)
    };
    let mut row = mark;
    while taken.iter().any(|&other| same_place(row, other)) {
        row.1 += units(14.0);
    }
    taken.push(row);
    row.1
}

/// Returns the note about cameras that are left out, with their distances from the middle of the path.
fn far_note(
    cameras: &[&CameraSymbol],
    path_m: &[Option<RangeInclusive<f64>>; 3],
) -> Option<String> {
    let distance_m = |camera: &CameraSymbol| {
        let [x, y, z] = [0, 1, 2].map(|axis| {
            let middle_m = path_m[axis].as_ref().map(|m| 0.5 * (m.start() + m.end()));
            camera.position_m()[axis] - middle_m.unwrap_or(0.0)
        });
        libm::sqrt(x * x + y * y + z * z)
    };
    let distances_m = cameras.iter().map(|camera| distance_m(camera));
    let nearest_m = distances_m.fold(f64::INFINITY, f64::min);
    match cameras {
        [] => None,
        [camera] => {
            let name = shortened(&camera.name, 16);
            Some(format!("{name} is {nearest_m:.1} m away"))
        }
        _ => Some(format!(
            "{} cameras are {nearest_m:.1} m away or farther",
            cameras.len()
        )),
    }
}

impl<'a> Figures<'a> {
    /// Creates the figures of tracks with the names of their targets or groups. They show the estimates that are not far
    /// from the truth; without truth, or if `reaches_far` is set, those not far from 98 % of the estimates.
    pub(super) fn new(
        series: impl Iterator<Item = (&'a str, &'a TrackSeries)>,
        truth: &[TruthSeries],
        cameras: &'a [CameraSymbol],
        reaches_far: bool,
    ) -> Self {
        let mut names: Vec<&str> = Vec::new();
        let mut tracks = Vec::new();
        for (name, one) in series {
            let known = names.iter().position(|known| *known == name);
            let index = known.unwrap_or(names.len());
            if known.is_none() {
                names.push(name);
            }
            tracks.push(Trace {
                color: PALETTE[index % PALETTE.len()],
                runs: runs(one.rows.iter().map(point)),
            });
        }
        let truth_point = |&(time_s, position_m): &(f64, [f64; 3])| {
            point(&Sample {
                time_s,
                position_m: Some(position_m),
                covariance_m2: None,
                is_seen: true,
            })
        };
        let truth = truth.iter().map(|one| Trace {
            color: INK,
            runs: runs(one.rows.iter().map(truth_point)),
        });
        let cameras = cameras
            .iter()
            .filter(|camera| drawable_position(&camera.position_m()));
        let are_many = tracks.len() > 2 * names.len();
        let mut figures = Self {
            stroke: if are_many { (0.5, 1.5) } else { (1.0, 2.5) },
            unseen_opacity: if are_many { 1.0 } else { 0.35 },
            mark_size: if are_many { 0.6 } else { 1.0 },
            truth: truth.collect(),
            cameras: Vec::new(),
            far_cameras: None,
            tracks,
            names,
            shown_m: [None, None, None],
            path_m: [None, None, None],
        };
        let estimates_m = places_m(&figures.tracks);
        let truth_m = if reaches_far {
            Vec::new()
        } else {
            places_m(&figures.truth)
        };
        figures.path_m = shown_ranges_m(&estimates_m, &truth_m, &[]);
        let (near, far): (Vec<_>, Vec<_>) =
            cameras.partition(|camera| is_near(&camera.position_m(), &figures.path_m));
        let places_m = |camera: &&CameraSymbol| {
            let way_m = camera.way_m.iter().copied();
            way_m.chain([camera.position_m()]).collect::<Vec<_>>()
        };
        let cameras_m: Vec<_> = near.iter().flat_map(places_m).collect();
        figures.shown_m = shown_ranges_m(&estimates_m, &truth_m, &cameras_m);
        figures.far_cameras = far_note(&far, &figures.path_m);
        figures.cameras = near;
        figures
    }

    /// Returns all estimates of all tracks.
    pub(super) fn estimates(&self) -> impl Iterator<Item = &Point> {
        self.tracks.iter().flat_map(|t| t.runs.iter().flatten())
    }

    fn points(&self) -> impl Iterator<Item = &Point> {
        let truth = self.truth.iter().flat_map(|t| t.runs.iter().flatten());
        self.estimates().chain(truth)
    }

    /// Returns the path for which the oblique view is chosen: the truth if it is known, otherwise the tracks.
    pub(super) fn main_path_m(&self) -> Vec<[f64; 3]> {
        if self.truth.is_empty() {
            places_m(&self.tracks)
        } else {
            places_m(&self.truth)
        }
    }

    /// Returns the note for a map that leaves out estimates or cameras, or has none.
    pub(super) fn map_note(&self, outside: usize) -> Option<String> {
        let notes: Vec<String> = self
            .note(outside)
            .into_iter()
            .chain(self.far_cameras.clone())
            .collect();
        (!notes.is_empty()).then(|| notes.join("; "))
    }

    /// Returns the note for a plot that leaves out estimates or has none.
    fn note(&self, outside: usize) -> Option<String> {
        let all = self.estimates().count();
        if all == 0 {
            return Some("no estimate".to_owned());
        }
        outside_note(outside, all)
    }

    /// Returns the opacity of a stretch of a track, relative to that of the track.
    pub(super) fn opacity(&self, is_seen: bool) -> f64 {
        if is_seen { 1.0 } else { self.unseen_opacity }
    }

    fn has_estimate(&self) -> bool {
        self.estimates().next().is_some()
    }

    /// Returns the range of one coordinate over truth, cameras, and the estimates that are not far from them.
    pub(super) fn range_m(&self, axis: usize) -> Range<f64> {
        padded(self.shown_m[axis].clone(), MIN_SPAN_M)
    }

    /// Returns the lowest height shown, or 0 if nothing is shown.
    pub(super) fn lowest_m(&self) -> f64 {
        self.shown_m[2].as_ref().map_or(0.0, |range| *range.start())
    }

    /// Draws everything from above.
    pub(super) fn above(&self) -> anyhow::Result<Drawing> {
        let ranges = [self.range_m(0), self.range_m(1)];
        let [x_span, y_span] = [&ranges[0], &ranges[1]].map(|r| r.end - r.start);
        let plot_px = [
            PLOT_WIDTH_PX,
            PLOT_WIDTH_PX * (y_span / x_span).clamp(0.4, 1.0),
        ];
        let size_px = [WIDTH_PX, plot_px[1] + TOP_PX + BOTTOM_PX];
        drawing(size_px, |area| {
            let plots = self.draw_legend(area, false)?;
            let (x, y) = equal_scales(&ranges[0], &ranges[1], plot_px);
            self.draw_map(&plots, [0, 1], [x, y])
        })
    }

    pub(super) fn side(&self) -> anyhow::Result<Drawing> {
        let ranges = [0, 1, 2].map(|axis| self.range_m(axis));
        let [x_span, y_span, z_span] = ranges.each_ref().map(|r| r.end - r.start);
        // Both panels have the same scale and are as wide as the longer of x and y requires.
        let span = x_span.max(y_span);
        let plot_px = [
            PLOT_WIDTH_PX,
            PLOT_WIDTH_PX * (z_span / span).clamp(0.25, 0.6),
        ];
        let panel_px = plot_px[1] + TOP_PX + BOTTOM_PX;
        drawing([WIDTH_PX, 2.0 * panel_px], |area| {
            let plots = self.draw_legend(area, false)?;
            for (panel, axis) in plots.split_evenly((2, 1)).iter().zip([0, 1]) {
                let middle = 0.5 * (ranges[axis].start + ranges[axis].end);
                let horizontal = middle - 0.5 * span..middle + 0.5 * span;
                let (horizontal, z) = equal_scales(&horizontal, &ranges[2], plot_px);
                self.draw_map(panel, [axis, 2], [horizontal, z])?;
            }
            Ok(())
        })
    }

    fn coordinates(&self) -> anyhow::Result<Drawing> {
        let times = extent(self.points().map(|point| point.time_s));
        let largest_s = times
            .as_ref()
            .map_or(0.0, |t| t.start().abs().max(t.end().abs()));
        let time_s = padded(times, (1e-9 * largest_s).max(0.1));
        drawing([WIDTH_PX, 3.0 * 230.0], |area| {
            let plots = self.draw_legend(area, true)?;
            for (axis, area) in plots.split_evenly((3, 1)).iter().enumerate() {
                let range_m = self.range_with_bands_m(axis);
                let time = Axis::new(time_s.clone(), "time (s)");
                let coordinate = Axis::new(range_m.clone(), COORDINATES[axis]);
                let mut panel = panel(area, &time, &coordinate)?;
                for track in &self.tracks {
                    self.draw_band(&mut panel, track, axis, &range_m)?;
                }
                let ranges = [time_s.clone(), range_m];
                let outside =
                    self.draw_paths(&mut panel, &ranges, |p| [p.time_s, p.position_m[axis]])?;
                if let Some(note) = self.note(outside) {
                    write_note(area, &note)?;
                }
            }
            Ok(())
        })
    }

    /// Returns the range of one coordinate over tracks and truth, extended to the bands as long as the paths
    /// remain legible.
    fn range_with_bands_m(&self, axis: usize) -> Range<f64> {
        // Cameras are not drawn over time, and those far away would flatten the paths.
        let paths = padded(self.path_m[axis].clone(), MIN_SPAN_M);
        let room_m = (paths.end - paths.start).max(0.2);
        let (low_m, high_m) = (paths.start - room_m, paths.end + room_m);
        let bands = self.points().filter_map(|p| {
            let two_sigma_m = p.two_sigma_m?[axis];
            Some([
                p.position_m[axis] - two_sigma_m,
                p.position_m[axis] + two_sigma_m,
            ])
        });
        let ends = bands.flatten().map(|end_m| end_m.clamp(low_m, high_m));
        let all = extent(ends.chain([paths.start, paths.end]));
        all.map_or(paths, |all| *all.start()..*all.end())
    }

    /// Fills the band of two standard deviations around a track, cut off at the plot's edge.
    fn draw_band(
        &self,
        panel: &mut Panel<'_>,
        track: &Trace,
        axis: usize,
        range_m: &Range<f64>,
    ) -> anyhow::Result<()> {
        let style = fill(track.color, 0.22 * self.stroke.0);
        for run in &track.runs {
            for stretch in runs(run.iter().map(|p| Some((p, p.two_sigma_m?[axis])))) {
                let edge = |sign: f64| {
                    stretch.iter().map(move |(p, two_sigma_m)| {
                        let end_m = p.position_m[axis] + sign * two_sigma_m;
                        (p.time_s, end_m.clamp(range_m.start, range_m.end))
                    })
                };
                let outline: Vec<_> = edge(1.0).chain(edge(-1.0).rev()).collect();
                if stretch.len() == 1 {
                    // A band at a single time has no width; a bar shows it.
                    draw_path(panel, &outline, line(track.color, 0.4, 2.0))?;
                } else {
                    panel.draw_series([Polygon::new(outline, style)])?;
                }
            }
        }
        Ok(())
    }

    /// Draws tracks, pale where the target was not seen, and the truth as a thin line on top so that both are visible. Parts outside the panel are cut
    /// off; returns how many estimates they contain.
    fn draw_paths(
        &self,
        panel: &mut Panel<'_>,
        ranges: &[Range<f64>; 2],
        place: impl Fn(&Point) -> [f64; 2],
    ) -> anyhow::Result<usize> {
        for (paths, (opacity, width_px)) in [(&self.tracks, self.stroke), (&self.truth, (1.0, 1.0))]
        {
            for path in paths {
                let stretches = path.runs.iter().flat_map(|run| Trace::stretches(run));
                for (stretch, is_seen) in stretches {
                    let points: Vec<_> = stretch.iter().map(&place).collect();
                    let style = line(path.color, opacity * self.opacity(is_seen), width_px);
                    for piece in clipped(&points, ranges) {
                        let piece: Vec<_> = piece.into_iter().map(|[x, y]| (x, y)).collect();
                        draw_path(panel, &piece, style)?;
                    }
                }
            }
        }
        let outside = self.estimates().filter(|p| !is_inside(&place(p), ranges));
        Ok(outside.count())
    }

    /// Draws the projection to the plane of two of the coordinates x, y, z.
    fn draw_map(
        &self,
        area: &Area<'_>,
        axes: [usize; 2],
        ranges_m: [Range<f64>; 2],
    ) -> anyhow::Result<()> {
        let [horizontal, vertical] =
            [0, 1].map(|i| Axis::new(ranges_m[i].clone(), COORDINATES[axes[i]]));
        let mut panel = panel(area, &horizontal, &vertical)?;
        let flat = |position_m: [f64; 3]| axes.map(|axis| position_m[axis]);
        let outside = self.draw_paths(&mut panel, &ranges_m, |p| flat(p.position_m))?;
        let seen = |point: &Point| {
            let place_m = flat(point.position_m);
            is_inside(&place_m, &ranges_m).then_some((place_m[0], place_m[1]))
        };
        for track in &self.tracks {
            let (first, last) = track.ends();
            if let Some(place) = first.and_then(seen) {
                panel.draw_series([start_mark(place, track.color, self.mark_size)])?;
            }
            if let Some(place) = last.and_then(seen) {
                panel.draw_series([end_mark(place, track.color, self.mark_size)])?;
            }
        }
        let middle_m = 0.5 * (ranges_m[0].start + ranges_m[0].end);
        self.draw_cameras(&mut panel, flat, middle_m)?;
        if let Some(note) = self.map_note(outside) {
            write_note(area, &note)?;
        }
        Ok(())
    }

    /// Marks the cameras and writes their names on the side with more room.
    fn draw_cameras(
        &self,
        panel: &mut Panel<'_>,
        flat: impl Fn([f64; 3]) -> [f64; 2],
        middle_m: f64,
    ) -> anyhow::Result<()> {
        let mut rows = Vec::new();
        for camera in &self.cameras {
            let way_m = camera.way_m.iter().map(|place_m| flat(*place_m));
            let way_m = way_m.map(|[x_m, y_m]| (x_m, y_m));
            panel.draw_series([PathElement::new(
                way_m.collect::<Vec<_>>(),
                line(INK, WAY_OPACITY, 1.2),
            )])?;
            let [x_m, y_m] = flat(camera.position_m());
            let place = (x_m, y_m);
            let mark = panel.backend_coord(&place);
            let row = free_row(&mut rows, mark);
            let (side, aside_px) = if place.0 > middle_m {
                (HPos::Right, -9.0)
            } else {
                (HPos::Left, 9.0)
            };
            let text = Text::new(
                shortened(&camera.name, 16),
                (units(aside_px), row - mark.1),
                text_style(12.0, side),
            );
            let marked = EmptyElement::at(place) + camera_mark((0, 0)) + text;
            panel.draw_series([marked])?;
        }
        Ok(())
    }

    /// Draws the legend of a plot over time or of a map; returns the area left of it.
    pub(super) fn draw_legend<'b>(
        &self,
        area: &Area<'b>,
        against_time: bool,
    ) -> anyhow::Result<Area<'b>> {
        let (plots, column) = area.split_horizontally(units(WIDTH_PX - legend::WIDTH_PX));
        let mut entries: Vec<(Key, String)> = self
            .names
            .iter()
            .enumerate()
            .map(|(i, name)| (Key::Track(PALETTE[i % PALETTE.len()]), (*name).to_owned()))
            .collect();
        if self.unseen_opacity < 1.0 && self.estimates().any(|p| !p.is_seen) {
            entries.push((Key::Unseen(self.unseen_opacity), "occluded".to_owned()));
        }
        if against_time && self.points().any(|p| p.two_sigma_m.is_some()) {
            entries.push((Key::Band, "± 2 σ".to_owned()));
        }
        if !self.truth.is_empty() {
            entries.push((Key::Truth, "truth".to_owned()));
        }
        if !against_time && self.has_estimate() {
            entries.push((Key::Start, "start".to_owned()));
            entries.push((Key::End, "end".to_owned()));
        }
        if !against_time && !self.cameras.is_empty() {
            entries.push((Key::Camera, "camera".to_owned()));
        }
        legend::draw(&column, &entries)?;
        Ok(plots)
    }
}

#[cfg(test)]
#[path = "plots_tests.rs"]
mod tests;
