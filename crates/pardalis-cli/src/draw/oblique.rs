//! The oblique view of paths: an orthographic picture of the floor, the rear wall, and everything between them.

use std::ops::Range;

use plotters::prelude::*;
use plotters::style::text_anchor::HPos;

use super::camera_symbol::CameraSymbol;
use super::legend::{self, end_mark, start_mark};
use super::limits::{clipped, is_inside};
use super::panel::{tick_label, ticks, write_note};
use super::plots::{Figures, Point, Trace, WAY_OPACITY, WIDTH_PX, free_row};
use super::svg::{Area, Drawing, drawing, fill, line, text_style, units, write_text};
use super::{INK, Rgb, shortened};

/// Elevation of the viewer above the horizon.
const ELEVATION_DEG: f64 = 24.0;

/// Candidate azimuths of the viewer, about the vertical, from x. Never along an axis, so that floor and wall are both
/// visible.
const AZIMUTHS_DEG: [f64; 8] = [-60.0, -30.0, 30.0, 60.0, 120.0, 150.0, -150.0, -120.0];

/// Space around the drawing for tick labels and the axes' names, and above it for notes.
const SIDE_PX: f64 = 84.0;
const TOP_PX: f64 = 46.0;
const BOTTOM_PX: f64 = 62.0;
const MAX_HEIGHT_PX: f64 = 560.0;

/// Distances from an edge to its tick labels and to its name.
const LABEL_PX: f64 = 17.0;
const NAME_PX: f64 = 40.0;

/// Labels are wider than high: beside an edge, the name is this much farther away.
const NAME_ASIDE_PX: f64 = 20.0;

/// Length of a camera's pyramid as a share of the longest side of the shown volume.
const CAMERA_SHARE: f64 = 0.05;

const FLOOR: Rgb = [246, 246, 246];
const GRID: Rgb = [214, 214, 214];

/// Unit vectors in the world: to the right and up in the picture, and towards the viewer.
#[derive(Clone, Copy)]
struct View {
    right: [f64; 3],
    up: [f64; 3],
    to_viewer: [f64; 3],
}

impl View {
    fn from_azimuth(azimuth_deg: f64) -> Self {
        let (sin_a, cos_a) = libm::sincos(azimuth_deg.to_radians());
        let (sin_e, cos_e) = libm::sincos(ELEVATION_DEG.to_radians());
        Self {
            right: [-sin_a, cos_a, 0.0],
            up: [-sin_e * cos_a, -sin_e * sin_a, cos_e],
            to_viewer: [cos_e * cos_a, cos_e * sin_a, sin_e],
        }
    }

    /// Returns the view in which these positions are spread out most.
    fn of_most_spread(places_m: &[[f64; 3]]) -> Self {
        let spread = |view: &Self| {
            let count = places_m.len().max(1) as f64;
            let flat = || places_m.iter().map(|place_m| view.flat(*place_m));
            let [mean_x, mean_y] = [0, 1].map(|i| flat().map(|p| p[i]).sum::<f64>() / count);
            let [xx, xy, yy] = flat().fold([0.0; 3], |[xx, xy, yy], [x, y]| {
                let (x, y) = (x - mean_x, y - mean_y);
                [xx + x * x, xy + x * y, yy + y * y]
            });
            xx * yy - xy * xy
        };
        // The first of equally good views wins.
        let mut best = Self::from_azimuth(AZIMUTHS_DEG[0]);
        for view in AZIMUTHS_DEG[1..].iter().map(|a| Self::from_azimuth(*a)) {
            if spread(&view) > 1.01 * spread(&best) {
                best = view;
            }
        }
        best
    }

    /// Projects a position to the picture: right and up, in metres.
    fn flat(&self, place_m: [f64; 3]) -> [f64; 2] {
        [self.right, self.up].map(|axis| (0..3).map(|i| axis[i] * place_m[i]).sum())
    }
}

/// The shown part of the world and its projection to the picture.
struct Stage {
    view: View,
    /// Of x, y and z, in metres. The ends are multiples of the step, except for one below the floor.
    ranges_m: [Range<f64>; 3],
    step_m: f64,
    decimals: usize,
    px_per_m: f64,
    /// The world's origin in the picture.
    origin_px: [f64; 2],
    height_px: f64,
}

impl Stage {
    fn new(shown_m: [Range<f64>; 3], view: View) -> Self {
        let longest_m = shown_m.iter().map(|r| r.end - r.start).fold(0.0, f64::max);
        let (marks, decimals) = ticks(&(0.0..longest_m), 8.0);
        let step_m = marks.get(1).map_or(longest_m, |mark| mark - marks[0]);
        let mut ranges_m = shown_m.clone().map(|range| {
            let first = (range.start / step_m + 1e-9).floor();
            let last = (range.end / step_m - 1e-9).ceil().max(first + 1.0);
            first * step_m..last * step_m
        });
        // Only outliers lie below the floor.
        if shown_m[2].contains(&0.0) {
            ranges_m[2].start = shown_m[2].start;
        }
        let corners = (0..8).map(|i| {
            let end = |axis: usize| {
                let range: &Range<f64> = &ranges_m[axis];
                if i >> axis & 1 == 0 {
                    range.start
                } else {
                    range.end
                }
            };
            view.flat([end(0), end(1), end(2)])
        });
        let [mut low, mut high] = [[f64::INFINITY; 2], [f64::NEG_INFINITY; 2]];
        for corner in corners {
            for i in 0..2 {
                low[i] = low[i].min(corner[i]);
                high[i] = high[i].max(corner[i]);
            }
        }
        let room_px = WIDTH_PX - legend::WIDTH_PX - 2.0 * SIDE_PX;
        let px_per_m = (room_px / (high[0] - low[0])).min(MAX_HEIGHT_PX / (high[1] - low[1]));
        let middle_px = 0.5 * (room_px + 2.0 * SIDE_PX);
        Self {
            origin_px: [
                middle_px - 0.5 * px_per_m * (low[0] + high[0]),
                TOP_PX + px_per_m * high[1],
            ],
            height_px: TOP_PX + px_per_m * (high[1] - low[1]) + BOTTOM_PX,
            view,
            ranges_m,
            step_m,
            decimals,
            px_per_m,
        }
    }

    /// Returns a position in the picture, in pixels.
    fn at_px(&self, place_m: [f64; 3]) -> [f64; 2] {
        let [right_m, up_m] = self.view.flat(place_m);
        [
            self.origin_px[0] + self.px_per_m * right_m,
            self.origin_px[1] - self.px_per_m * up_m,
        ]
    }

    /// Returns a position in the picture, in units.
    fn at(&self, place_m: [f64; 3]) -> (i32, i32) {
        let [x, y] = self.at_px(place_m);
        (units(x), units(y))
    }

    /// Returns the multiples of the step in the range of an axis.
    fn marks(&self, axis: usize) -> impl Iterator<Item = f64> + use<> {
        let range = &self.ranges_m[axis];
        let first = (range.start / self.step_m - 1e-6).ceil() as i64;
        let last = (range.end / self.step_m).round() as i64;
        let step_m = self.step_m;
        (first..=last).map(move |i| i as f64 * step_m)
    }

    /// Returns the height of the floor, or of the picture's lower end if the picture does not include the floor.
    fn floor_m(&self) -> f64 {
        let Range { start, end } = self.ranges_m[2];
        if end > 0.0 { start.max(0.0) } else { start }
    }

    /// Returns the end of a horizontal axis that is nearer to the viewer (`front`) or farther away.
    fn end_m(&self, axis: usize, front: bool) -> f64 {
        if (self.view.to_viewer[axis] > 0.0) == front {
            self.ranges_m[axis].end
        } else {
            self.ranges_m[axis].start
        }
    }

    /// Returns the mark at the rear end of a horizontal axis.
    fn rear_mark_m(&self, axis: usize) -> f64 {
        (self.end_m(axis, false) / self.step_m).round() * self.step_m
    }

    /// Returns the horizontal axis perpendicular to the wall, which is the one of the two rear walls that faces the
    /// viewer more.
    fn wall_axis(&self) -> usize {
        usize::from(self.view.to_viewer[1].abs() > self.view.to_viewer[0].abs())
    }

    /// Returns a position with one coordinate replaced.
    fn with(place_m: [f64; 3], axis: usize, at_m: f64) -> [f64; 3] {
        let mut moved = place_m;
        moved[axis] = at_m;
        moved
    }

    fn on_floor(&self, place_m: [f64; 3]) -> [f64; 3] {
        Self::with(place_m, 2, self.floor_m())
    }

    fn on_wall(&self, place_m: [f64; 3]) -> [f64; 3] {
        let axis = self.wall_axis();
        Self::with(place_m, axis, self.end_m(axis, false))
    }

    /// Draws a line through world positions; a single position becomes a dot.
    fn draw_line(
        &self,
        area: &Area<'_>,
        places_m: impl Iterator<Item = [f64; 3]>,
        style: ShapeStyle,
    ) -> anyhow::Result<()> {
        let points: Vec<_> = places_m.map(|place_m| self.at(place_m)).collect();
        if let [point] = points[..] {
            area.draw(&Circle::new(point, units(2.0), style.filled()))?;
        } else {
            area.draw(&PathElement::new(points, style))?;
        }
        Ok(())
    }

    /// Draws floor and wall with their grids, and the coordinates at their edges.
    fn draw_room(&self, area: &Area<'_>) -> anyhow::Result<()> {
        let wall = self.wall_axis();
        let along = 1 - wall;
        let wall_m = self.end_m(wall, false);
        let front_m = [0, 1].map(|axis| self.end_m(axis, true));
        let [low_m, high_m] = [self.floor_m(), self.ranges_m[2].end];
        // A position from its coordinates perpendicular to the wall, along it, and upwards.
        let place = |across: f64, along_m: f64, up: f64| {
            let mut place_m = [0.0, 0.0, up];
            place_m[wall] = across;
            place_m[along] = along_m;
            place_m
        };
        let [near_m, left_m, right_m] = [
            front_m[wall],
            self.ranges_m[along].start,
            self.ranges_m[along].end,
        ];
        let floor = [
            (near_m, left_m),
            (near_m, right_m),
            (wall_m, right_m),
            (wall_m, left_m),
        ];
        let floor = floor.map(|(across, along)| self.at(place(across, along, low_m)));
        area.draw(&Polygon::new(floor.to_vec(), fill(FLOOR, 1.0)))?;

        let stroke = |ends: [[f64; 3]; 2], color, width_px| {
            self.draw_line(area, ends.into_iter(), line(color, 1.0, width_px))
        };
        for at in self.marks(wall) {
            stroke(
                [place(at, left_m, low_m), place(at, right_m, low_m)],
                GRID,
                1.0,
            )?;
        }
        for at in self.marks(along) {
            stroke(
                [place(near_m, at, low_m), place(wall_m, at, low_m)],
                GRID,
                1.0,
            )?;
            stroke(
                [place(wall_m, at, low_m), place(wall_m, at, high_m)],
                GRID,
                1.0,
            )?;
        }
        for at in self.marks(2).filter(|&at| at >= low_m) {
            stroke(
                [place(wall_m, left_m, at), place(wall_m, right_m, at)],
                GRID,
                1.0,
            )?;
        }

        // The heights stand at that edge of the wall which is nearer to the viewer, outside the room.
        let (edge_m, other_m) = (front_m[along], self.end_m(along, false));
        let edges = [
            (wall, place(0.0, edge_m, low_m), along, edge_m - other_m),
            (along, place(near_m, 0.0, low_m), wall, near_m - wall_m),
            (2, place(wall_m, edge_m, 0.0), along, edge_m - other_m),
        ];
        for (axis, edge_m, outward_axis, outward_m) in edges {
            self.draw_edge(area, axis, edge_m, (outward_axis, outward_m))?;
        }
        Ok(())
    }

    /// Draws the edge along an axis through a position, with its tick labels and its name on the outward side.
    fn draw_edge(
        &self,
        area: &Area<'_>,
        axis: usize,
        edge_m: [f64; 3],
        (outward_axis, outward_m): (usize, f64),
    ) -> anyhow::Result<()> {
        let at_px = |at_m: f64| self.at_px(Self::with(edge_m, axis, at_m));
        let outward = {
            let mut moved = edge_m;
            moved[outward_axis] += outward_m;
            let ([x0, y0], [x1, y1]) = (self.at_px(edge_m), self.at_px(moved));
            let length = libm::hypot(x1 - x0, y1 - y0).max(1e-9);
            [(x1 - x0) / length, (y1 - y0) / length]
        };
        let beside =
            |[x, y]: [f64; 2], by_px: f64| [x + by_px * outward[0], y + by_px * outward[1]];
        let range = &self.ranges_m[axis];
        let ends = [range.start, range.end].map(|at_m| Self::with(edge_m, axis, at_m));
        self.draw_line(area, ends.into_iter(), line(INK, 1.0, 1.0))?;
        for at_m in self.marks(axis) {
            let at = at_px(at_m);
            let tick = [at, beside(at, 4.0)].map(|[x, y]| (units(x), units(y)));
            area.draw(&PathElement::new(tick, line(INK, 1.0, 1.0)))?;
            // At the wall, the lowest height already has its label here.
            if axis == self.wall_axis() && at_m == self.rear_mark_m(axis) {
                continue;
            }
            let style = text_style(12.0, HPos::Center);
            write_text(
                area,
                &tick_label(at_m, self.decimals),
                beside(at, LABEL_PX),
                &style,
            )?;
        }
        let name = ["x (m)", "y (m)", "z (m)"][axis];
        let name_px = NAME_PX + NAME_ASIDE_PX * outward[0].abs();
        let middle = beside(at_px(0.5 * (range.start + range.end)), name_px);
        write_text(area, name, middle, &text_style(13.0, HPos::Center))
    }

    /// Draws a camera on its pole.
    fn draw_camera(&self, area: &Area<'_>, camera: &CameraSymbol) -> anyhow::Result<()> {
        let position_m = camera.position_m();
        let way_m = camera.way_m.iter().copied();
        self.draw_line(area, way_m, line(INK, WAY_OPACITY, 1.2))?;
        let foot_m = self.on_floor(position_m);
        self.draw_line(area, [position_m, foot_m].into_iter(), line(INK, 0.6, 2.5))?;
        area.draw(&Circle::new(self.at(foot_m), units(3.0), fill(INK, 0.6)))?;
        let longest_m = self
            .ranges_m
            .iter()
            .map(|r| r.end - r.start)
            .fold(0.0, f64::max);
        for outline in camera.outline_m(CAMERA_SHARE * longest_m) {
            let points: Vec<_> = outline.iter().map(|place_m| self.at(*place_m)).collect();
            area.draw(&Polygon::new(points.clone(), fill(INK, 0.18)))?;
            area.draw(&PathElement::new(points, line(INK, 1.0, 1.2)))?;
        }
        Ok(())
    }

    /// Returns the pieces of a path that are inside the room, each with whether the target was seen there.
    fn pieces_m(&self, path: &Trace) -> Vec<(Vec<[f64; 3]>, bool)> {
        let stretches = path.runs.iter().flat_map(|run| Trace::stretches(run));
        let pieces = stretches.flat_map(|(stretch, is_seen)| {
            let places_m: Vec<_> = stretch.iter().map(|point| point.position_m).collect();
            let pieces = clipped(&places_m, &self.ranges_m);
            pieces.into_iter().map(move |piece| (piece, is_seen))
        });
        pieces.collect()
    }
}

impl Figures<'_> {
    /// Draws the oblique view of all paths with their shadows on floor and rear wall, and of the cameras.
    pub(super) fn oblique(&self) -> anyhow::Result<Drawing> {
        let mut shown_m = [0, 1, 2].map(|axis| self.range_m(axis));
        // The floor is part of the picture unless everything is far above it.
        let [x_m, y_m] = [&shown_m[0], &shown_m[1]].map(|r| r.end - r.start);
        let lowest_m = self.lowest_m();
        if (0.0..=2.0 * x_m.max(y_m)).contains(&lowest_m) {
            shown_m[2].start = 0.0;
        }
        let stage = Stage::new(shown_m, View::of_most_spread(&self.main_path_m()));
        let inside = |point: &Point| is_inside(&point.position_m, &stage.ranges_m);
        let outside = self.estimates().filter(|point| !inside(point)).count();
        drawing([WIDTH_PX, stage.height_px], |area| {
            let picture = self.draw_legend(area, false)?;
            stage.draw_room(&picture)?;
            self.draw_shadows(&picture, &stage)?;
            for camera in &self.cameras {
                stage.draw_camera(&picture, camera)?;
            }
            for (paths, stroke) in [(&self.tracks, self.stroke), (&self.truth, (1.0, 1.2))] {
                for path in paths {
                    for (piece, is_seen) in stage.pieces_m(path) {
                        let opacity = stroke.0 * self.opacity(is_seen);
                        let style = line(path.color, opacity, stroke.1);
                        stage.draw_line(&picture, piece.into_iter(), style)?;
                    }
                }
            }
            self.draw_ends(&picture, &stage)?;
            self.draw_names(&picture, &stage)?;
            if let Some(note) = self.map_note(outside) {
                write_note(&picture, &note)?;
            }
            Ok(())
        })
    }

    fn draw_shadows(&self, area: &Area<'_>, stage: &Stage) -> anyhow::Result<()> {
        for path in self.tracks.iter().chain(&self.truth) {
            let style = line(path.color, 0.3 * self.stroke.0, 1.2);
            for (piece, _) in stage.pieces_m(path) {
                let floor = piece.iter().map(|place_m| stage.on_floor(*place_m));
                stage.draw_line(area, floor, style)?;
                let wall = piece.iter().map(|place_m| stage.on_wall(*place_m));
                stage.draw_line(area, wall, style)?;
            }
        }
        Ok(())
    }

    /// Marks the first and the last points of the tracks.
    fn draw_ends(&self, area: &Area<'_>, stage: &Stage) -> anyhow::Result<()> {
        for track in &self.tracks {
            let seen = |point: &&Point| is_inside(&point.position_m, &stage.ranges_m);
            let (first, last) = track.ends();
            if let Some(point) = first.filter(seen) {
                area.draw(&start_mark(
                    stage.at(point.position_m),
                    track.color,
                    self.mark_size,
                ))?;
            }
            if let Some(point) = last.filter(seen) {
                area.draw(&end_mark(
                    stage.at(point.position_m),
                    track.color,
                    self.mark_size,
                ))?;
            }
        }
        Ok(())
    }

    /// Writes the cameras' names beside their tips.
    fn draw_names(&self, area: &Area<'_>, stage: &Stage) -> anyhow::Result<()> {
        let mut rows = Vec::new();
        for camera in &self.cameras {
            let mark = stage.at(camera.position_m());
            let row = free_row(&mut rows, mark);
            let style = text_style(12.0, HPos::Left);
            area.draw_text(
                &shortened(&camera.name, 16),
                &style,
                (mark.0 + units(16.0), row),
            )?;
        }
        Ok(())
    }
}
