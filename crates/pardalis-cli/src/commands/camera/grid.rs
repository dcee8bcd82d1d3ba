//! Draws a grid of the world over a camera's image.

use std::path::{Path, PathBuf};

use anyhow::Result;
use nalgebra::Point3;
use pardalis_camera::Camera;
use pardalis_camera::{CalibratedCamera, Pose};
use pardalis_images::RgbImage;

use crate::draw::Rgb;
use crate::draw::grid::{Label, drawn_over};
use crate::draw::overlay::{Mark, Shape};
use crate::draw::picture::write_picture;
use crate::output::Shown;
use crate::source::decode::decode_image;
use crate::user_error::user_error;

/// Steps of a line between two grid lines, because lenses bend straight lines.
const STEPS_PER_CELL: usize = 40;

/// Maximum number of lines in one direction; more would cover the image.
const MAX_LINES: f64 = 400.0;

/// Lines on each side of the origin if no extent is given.
const DEFAULT_LINES: f64 = 10.0;

/// One colour per plane, legible on dark and on bright floors.
const PLANE_COLORS: [Rgb; 4] = [
    [255, 225, 60],
    [90, 220, 255],
    [255, 140, 230],
    [140, 255, 140],
];

/// Colours of the x, y and z axes.
const AXIS_COLORS: [Rgb; 3] = [[255, 40, 40], [30, 200, 30], [60, 90, 255]];

/// Options of the grid.
#[derive(Debug, clap::Args)]
pub(super) struct GridOptions {
    /// Draws a grid of the world, in metres, over this image of the camera; requires the camera's pose
    #[arg(long, value_name = "IMAGE", requires = "output")]
    pub(super) grid: Option<PathBuf>,
    /// Distance between the grid's lines in metres
    #[arg(long, value_name = "METRES", default_value_t = 0.5, requires = "grid")]
    spacing: f64,
    /// The grid's range in metres [default: ten lines on each side of the origin]
    #[arg(
        long,
        value_name = "X0,X1,Y0,Y1",
        value_delimiter = ',',
        num_args = 1,
        allow_hyphen_values = true,
        requires = "grid"
    )]
    extent: Vec<f64>,
    /// Heights z of the grid's planes in metres
    #[arg(
        long,
        visible_alias = "plane-z",
        value_name = "Z,Z",
        value_delimiter = ',',
        num_args = 1,
        allow_hyphen_values = true,
        default_value = "0",
        requires = "grid"
    )]
    heights: Vec<f64>,
}

/// The grid to draw, in world coordinates in metres.
struct Grid<'a> {
    camera: &'a Camera,
    world_from_camera: &'a Pose,
    spacing_m: f64,
    x_m: [f64; 2],
    y_m: [f64; 2],
    heights_m: &'a [f64],
}

/// Points of a line in the world, and their pixels.
type Line = Vec<([f64; 3], Option<[f64; 2]>)>;

impl GridOptions {
    /// Draws the grid over an image read by [`read_image`], and writes it to a file.
    ///
    /// Errors: the camera has no pose, the numbers do not form a grid, or none of it is in view.
    pub(super) fn draw(
        &self,
        file: &Path,
        camera: &CalibratedCamera,
        image: &RgbImage,
        to: &Path,
    ) -> Result<()> {
        let Some(world_from_camera) = &camera.world_from_camera else {
            return Err(user_error!(
                "{}: camera {} has no pose, which the grid of the world requires; compute it with \
                 `pardalis calibrate pose`, or add world_from_camera to a Pardalis calibration (see `pardalis camera convert --to pardalis`)",
                file.shown(),
                camera.name
            ));
        };
        let (x_m, y_m) = self.ranges_m()?;
        let grid = Grid {
            camera: &camera.camera,
            world_from_camera,
            spacing_m: self.spacing,
            x_m,
            y_m,
            heights_m: &self.heights,
        };
        let (width, height) = (f64::from(image.width()), f64::from(image.height()));
        let in_image = |[u, v]: [f64; 2]| {
            (-0.5..width - 0.5).contains(&u) && (-0.5..height - 0.5).contains(&v)
        };
        let (marks, labels) = grid.marks(&in_image);
        // The axes, which come last, do not count as the grid being in view.
        let lines = &marks[..marks.len() - AXIS_COLORS.len()];
        let seen = lines.iter().flat_map(|mark| &mark.points_px).flatten();
        if !seen.copied().any(in_image) {
            return Err(user_error!(
                "--extent: no line of the grid is in view of camera {}; give the range of x and y that it sees, such as --extent 2,6,-2,2",
                camera.name
            ));
        }
        write_picture(to, &drawn_over(image, marks, &labels))
    }

    /// Returns the ranges of x and y in metres, checked.
    fn ranges_m(&self) -> Result<([f64; 2], [f64; 2])> {
        let spacing_m = self.spacing;
        if !(1e-3..=1e4).contains(&spacing_m) {
            return Err(user_error!(
                "--spacing {spacing_m}: allowed: 0.001 to 10000 metres"
            ));
        }
        if let Some(z) = self.heights.iter().find(|z| !(z.abs() <= 1e5)) {
            return Err(user_error!(
                "--heights {z}: allowed: -100000 to 100000 metres"
            ));
        }
        if self.heights.len() > PLANE_COLORS.len() {
            return Err(user_error!(
                "--heights: {} planes; allowed: at most {}, the number of distinct colours",
                self.heights.len(),
                PLANE_COLORS.len()
            ));
        }
        let reach_m = DEFAULT_LINES * spacing_m;
        let [x0, x1, y0, y1] = match *self.extent {
            [] => [-reach_m, reach_m, -reach_m, reach_m],
            [x0, x1, y0, y1] => [x0, x1, y0, y1],
            _ => {
                return Err(user_error!(
                    "--extent: {} numbers; allowed: four, x0,x1,y0,y1",
                    self.extent.len()
                ));
            }
        };
        for (low, high) in [(x0, x1), (y0, y1)] {
            let lines = (high - low) / spacing_m;
            if !(low.abs() <= 1e5 && high.abs() <= 1e5 && (1.0..=MAX_LINES).contains(&lines)) {
                return Err(user_error!(
                    "--extent: {low} to {high} at a spacing of {spacing_m}; allowed: ascending, 1 to {MAX_LINES} spacings wide, within 100 km"
                ));
            }
        }
        Ok(([x0, x1], [y0, y1]))
    }
}

/// Reads an image and checks that it has the camera's size.
pub(super) fn read_image(path: &Path, camera: &CalibratedCamera) -> Result<RgbImage> {
    let decoded = decode_image(path)?;
    let size = decoded.size_px();
    if let Some((width, height)) = camera.size_px.filter(|stated| *stated != size) {
        return Err(user_error!(
            "--grid {}: the image is {} x {} pixels, but camera {} is calibrated for {width} x {height}; give an image of that size",
            path.shown(),
            size.0,
            size.1,
            camera.name
        ));
    }
    Ok(decoded)
}

impl Grid<'_> {
    fn pixel(&self, point_m: [f64; 3]) -> Option<[f64; 2]> {
        let in_camera = self
            .world_from_camera
            .inverse_transform_point(&Point3::from(point_m));
        self.camera.project(in_camera.coords.into())
    }

    /// Returns the multiples of the spacing in a range.
    fn values_m(&self, [low, high]: [f64; 2]) -> Vec<f64> {
        // The tolerance includes a line at the end of the range in spite of rounding.
        let slack = 1e-9;
        let first = (low / self.spacing_m - slack).ceil() as i64;
        let last = (high / self.spacing_m + slack).floor() as i64;
        (first..=last).map(|i| i as f64 * self.spacing_m).collect()
    }

    /// Returns the length of an axis: two cells, but upwards at most a quarter of the camera's height, because
    /// lines that come close to the camera project anywhere.
    fn axis_length_m(&self, axis: usize) -> f64 {
        let length_m = 2.0 * self.spacing_m;
        let camera_height_m = self.world_from_camera.translation.vector.z.abs();
        if axis == 2 {
            length_m.min(0.25 * camera_height_m)
        } else {
            length_m
        }
    }

    fn line(&self, from: [f64; 3], to: [f64; 3]) -> Line {
        let length_m = [0, 1, 2].map(|i| (to[i] - from[i]).abs());
        let cells = length_m.iter().fold(0.0_f64, |a, b| a.max(*b)) / self.spacing_m;
        let count = (cells * STEPS_PER_CELL as f64).ceil().max(1.0) as usize;
        let point = |i: usize| {
            let share = i as f64 / count as f64;
            [0, 1, 2].map(|axis| from[axis] + share * (to[axis] - from[axis]))
        };
        (0..=count)
            .map(|i| (point(i), self.pixel(point(i))))
            .collect()
    }

    /// Returns all lines and labels; the most important labels come first.
    fn marks(&self, in_image: &impl Fn([f64; 2]) -> bool) -> (Vec<Mark>, Vec<Label>) {
        let (mut marks, mut labels, mut line_labels) = (Vec::new(), Vec::new(), Vec::new());
        let ([x0, x1], [y0, y1]) = (self.x_m, self.y_m);
        for (index, (&z, color)) in self.heights_m.iter().zip(PLANE_COLORS).enumerate() {
            let xs = self.values_m(self.x_m).into_iter();
            let ys = self.values_m(self.y_m).into_iter();
            let across = xs.map(|x| ("x", x, 1, self.line([x, y0, z], [x, y1, z])));
            let along = ys.map(|y| ("y", y, 0, self.line([x0, y, z], [x1, y, z])));
            for (name, value_m, running, line) in across.chain(along) {
                // The lines of the first plane carry their values, near the other axis as in a plot.
                let near_axis = |point: &[f64; 3]| point[running].abs();
                if index == 0
                    && let Some(at_px) = nearest(&line, in_image, near_axis)
                {
                    let text = format!("{name} {}", tidy(value_m));
                    line_labels.push((value_m.abs(), Label { text, at_px, color }));
                }
                marks.push(mark(line, color));
            }
            let edge = self.line([x0, y1, z], [x1, y1, z]);
            if self.heights_m.len() > 1
                && let Some(at_px) = nearest(&edge, in_image, |point| point[0].abs())
            {
                let text = format!("z {}", tidy(z));
                labels.push(Label { text, at_px, color });
            }
        }
        for (axis, color) in AXIS_COLORS.into_iter().enumerate() {
            let mut tip = [0.0; 3];
            tip[axis] = self.axis_length_m(axis);
            let line = self.line([0.0; 3], tip);
            if let Some((_, Some(at_px))) = line.last()
                && in_image(*at_px)
            {
                let text = ["X", "Y", "Z"][axis].to_owned();
                labels.push(Label {
                    text,
                    at_px: *at_px,
                    color,
                });
            }
            marks.push(mark(line, color));
        }
        // When labels crowd, near values take precedence over far ones.
        line_labels.sort_by(|a, b| a.0.total_cmp(&b.0));
        labels.extend(line_labels.into_iter().map(|(_, label)| label));
        (marks, labels)
    }
}

fn mark(line: Line, color: Rgb) -> Mark {
    Mark {
        shape: Shape::Line,
        points_px: line.into_iter().map(|(_, pixel)| pixel).collect(),
        color,
    }
}

/// Finds the pixel of the visible point of a line with the smallest measure.
fn nearest(
    line: &Line,
    in_image: &impl Fn([f64; 2]) -> bool,
    measure: impl Fn(&[f64; 3]) -> f64,
) -> Option<[f64; 2]> {
    line.iter()
        .filter_map(|(point, pixel)| Some((measure(point), pixel.filter(|p| in_image(*p))?)))
        .min_by(|a, b| a.0.total_cmp(&b.0))
        .map(|(_, pixel)| pixel)
}

/// Formats a coordinate in metres without trailing zeros.
fn tidy(value_m: f64) -> String {
    let rounded = (value_m * 1e4).round() / 1e4;
    // Avoids -0.
    format!("{}", rounded + 0.0)
}
