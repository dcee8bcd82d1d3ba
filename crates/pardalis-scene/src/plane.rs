//! Cameras of a plane: points of it or the homography, and the position of the camera.

use nalgebra::Matrix3;

use super::description::above;
use super::reader::Table;
use super::setting::Word;
use pardalis_calibrate::plane::{PointPair, Rectangle, camera_center_m, fit};
use pardalis_camera::Homography;
use pardalis_camera::{Camera, Plane};
use pardalis_core::Error;

/// A plane with a rectangle that is to be detected in the camera's images.
#[derive(Debug, Clone, PartialEq)]
pub struct RectangleConfig {
    /// The rectangle.
    pub rectangle: Rectangle,
    /// Whether the inner edge of a tape was measured instead of the outer one.
    pub inner_edge: bool,
    /// Number of images to search, beginning with the first.
    pub frames: usize,
    pub(super) center: Center,
}

impl RectangleConfig {
    /// The default number, from 1, of the corner nearest to the image's bottom left.
    const NEAREST_CORNER: usize = 1;
    /// The default number of images to search.
    const FRAMES: usize = 10;

    /// Returns the camera from the rectangle's corners in pixels, counter-clockwise as seen in the image, beginning
    /// with the one nearest to the image's bottom left.
    pub fn camera(&self, corners_px: [[f64; 2]; 4]) -> Result<Camera, Error> {
        let found = fit(&self.rectangle.pairs(corners_px))?;
        let center_m = self.center.of(&found.homography)?;
        Plane::new(&found.homography, center_m).map(Camera::Plane)
    }
}

/// A camera's position, as far as a scene states it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Center {
    Unknown,
    At([f64; 3]),
    Intrinsics { f_px: [f64; 2], center_px: [f64; 2] },
}

impl Center {
    fn of(self, homography: &Homography) -> Result<Option<[f64; 3]>, Error> {
        match self {
            Self::Unknown => Ok(None),
            Self::At(center_m) => Ok(Some(center_m)),
            Self::Intrinsics { f_px, center_px } => {
                camera_center_m(homography, f_px, center_px).map(Some)
            }
        }
    }
}

/// The contents of the table `model.plane`.
pub(super) enum PlaneModel {
    /// The camera.
    Known(Plane<f64>),
    /// A camera that is to be determined from a rectangle.
    Rectangle(RectangleConfig),
}

/// Reads the table `model.plane`.
pub(super) fn read_plane(table: &Table) -> Option<PlaneModel> {
    let ways = ["points", "homography", "rectangle"];
    let given: Vec<&str> = ways.into_iter().filter(|way| table.knows(way)).collect();
    let center = read_center(table);
    let points = table
        .key(
            "points",
            "Four or more points of the plane, each [u, v, x, y]: the pixel and the world position in metres. With more than four, outliers are left out.",
        )
        .unit("px, m")
        .depends("unless `homography` or `rectangle` is given")
        .conditional::<Vec<[f64; 4]>>();
    let rows = table
        .key(
            "homography",
            "The homography that takes (x, y, 1) of the plane in metres to the pixel (u, v, 1) up to scale.",
        )
        .depends("unless `points` or `rectangle` is given")
        .conditional::<[[f64; 3]; 3]>();
    let rectangle = read_rectangle(table);
    let homography = match given[..] {
        ["points"] => points.and_then(|points| fit_points(table, &points)),
        ["homography"] => {
            let matrix = rows.map(|rows| Matrix3::from_row_slice(rows.as_flattened()));
            matrix.and_then(|matrix| table.checked(Homography::new(matrix)))
        }
        [_] => {
            let (center, rectangle) = (center?, rectangle?);
            return Some(PlaneModel::Rectangle(RectangleConfig {
                center,
                ..rectangle
            }));
        }
        [] => {
            let message = "is missing; give four or more points of the plane, points = [[u, v, x, y], ...], in pixels and metres, or rectangle, or homography";
            table.problem("points", message);
            None
        }
        [first, second, ..] => {
            table.conflict(second, first);
            None
        }
    };
    let homography = homography?;
    let center_m = center?.of(&homography);
    let center_m = center_m
        .map_err(|error| table.problem("f_px", error.to_string()))
        .ok()?;
    table
        .checked(Plane::new(&homography, center_m))
        .map(PlaneModel::Known)
}

/// The edge of a tape that was measured.
#[derive(Debug, Clone, Copy, PartialEq)]
enum TapeEdge {
    Outer,
    Inner,
}

impl Word for TapeEdge {
    const WORDS: &'static [(&'static str, Self)] =
        &[("outer", Self::Outer), ("inner", Self::Inner)];
}

/// Reads the table `rectangle`, for a camera that is not known yet.
fn read_rectangle(plane: &Table) -> Option<RectangleConfig> {
    let about = "A rectangle on the plane, such as tape on the floor, that the program finds in the camera's first images. Only in scenes.";
    plane.section("rectangle", about, |table| {
        let size_m = table
            .key(
                "size_m",
                "Lengths of the side that starts at the corner nearest the image's bottom left, which is the world's origin, and of the next side counterclockwise.",
            )
            .within(above(0.0, f64::INFINITY))
            .depends("unless `corners_m` is given")
            .conditional::<[f64; 2]>();
        let corners_m = table
            .key(
                "corners_m",
                "The corners (x, y) in the world, counterclockwise as seen from above.",
            )
            .depends("unless `size_m` is given")
            .conditional::<[[f64; 2]; 4]>();
        let nearest = table
            .key(
                "nearest_corner",
                "Which of `corners_m`, from 1, is nearest the image's bottom left.",
            )
            .within(1.0..=4.0)
            .or(RectangleConfig::NEAREST_CORNER);
        let edge = table
            .key("edge", "The edge of the tape that the lengths refer to.")
            .word(TapeEdge::Outer);
        let frames = table
            .key("frames", "Number of images to search, from the first on.")
            .within(1.0..=100.0)
            .or(RectangleConfig::FRAMES);
        let rectangle = match (size_m, corners_m) {
            (Some(_), Some(_)) => {
                table.conflict("corners_m", "size_m");
                None
            }
            (Some(size_m), None) => {
                if table.has("nearest_corner") {
                    table.problem("nearest_corner", "applies to corners_m only; with size_m the corner nearest the image's bottom left is the origin; remove it");
                }
                Some(Rectangle::of_size(size_m))
            }
            (None, Some(corners_m)) => Some(Rectangle {
                corners_m,
                nearest: nearest - 1,
            }),
            (None, None) => {
                if !table.has("size_m") && !table.has("corners_m") {
                    table.problem("size_m", "is missing; give size_m = [first side, the next one counterclockwise], or corners_m = [[x, y], ...]");
                }
                None
            }
        };
        Some(RectangleConfig {
            rectangle: rectangle?,
            inner_edge: edge? == TapeEdge::Inner,
            frames,
            center: Center::Unknown,
        })
    })
}

fn fit_points(table: &Table, points: &[[f64; 4]]) -> Option<Homography> {
    let pairs: Vec<PointPair> = points
        .iter()
        .map(|&[u, v, x, y]| PointPair {
            pixel: [u, v],
            plane_m: [x, y],
        })
        .collect();
    let found = fit(&pairs)
        .map_err(|error| table.problem("points", error.to_string()))
        .ok()?;
    for &outlier in &found.outliers {
        let distance = found.residuals_px[outlier].map_or_else(
            || "behind the camera".to_owned(),
            |[du, dv]| format!("{:.1} px away", libm::hypot(du, dv)),
        );
        let message = format!(
            "point {} disagrees with the others, which place it {distance}; it is ignored",
            outlier + 1
        );
        table.warn("points", message);
    }
    Some(found.homography)
}

/// Reads the camera's position: given directly, or from its intrinsics. Returns `None` after reporting a problem.
fn read_center(table: &Table) -> Option<Center> {
    let camera_center_m = table
        .key(
            "camera_center_m",
            "Position of the camera in the world, above the plane. Shapes that rise above the plane need it, or `f_px` and `center_px` instead.",
        )
        .depends("not known")
        .optional();
    let f_px = table
        .key(
            "f_px",
            "Focal lengths, from which the camera's position is computed. Together with `center_px`.",
        )
        .within(1e-3..=1e6)
        .depends("not known")
        .optional();
    let center_px = table
        .key("center_px", "Principal point. Together with `f_px`.")
        .within(-1e6..=1e6)
        .depends("not known")
        .optional();
    let intrinsics = ["f_px", "center_px"];
    let given: Vec<_> = intrinsics
        .into_iter()
        .filter(|key| table.has(key))
        .collect();
    if table.has("camera_center_m") {
        for key in given {
            table.conflict(key, "camera_center_m");
        }
        return camera_center_m.map(Center::At);
    }
    if given.is_empty() {
        return Some(Center::Unknown);
    }
    for key in intrinsics.into_iter().filter(|key| !table.has(key)) {
        table.problem(key, "is missing; f_px and center_px go together");
    }
    Some(Center::Intrinsics {
        f_px: f_px?,
        center_px: center_px?,
    })
}
