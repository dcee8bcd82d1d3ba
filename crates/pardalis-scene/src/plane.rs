//! Cameras that are known by a plane: points of it or the homography, and where the camera stands.

use nalgebra::Matrix3;

use super::camera::CameraConfig;
use super::reader::Table;
use pardalis_calibrate::plane::{PointPair, Rectangle, camera_center_m, fit};
use pardalis_camera::Homography;
use pardalis_camera::{Camera, Plane};
use pardalis_core::Error;

/// A plane that is known by a rectangle on it, which is to be found in the camera's images.
#[derive(Debug, Clone, PartialEq)]
pub struct RectangleConfig {
    /// The rectangle.
    pub rectangle: Rectangle,
    /// Whether the inner edge of a tape was measured, not the outer one.
    pub inner_edge: bool,
    /// How many images are looked at, from the first on.
    pub frames: usize,
    center: Center,
}

impl RectangleConfig {
    /// The camera, from the rectangle's corners in pixels: counterclockwise to the eye, first the one nearest the image's bottom left.
    pub fn camera(&self, corners_px: [[f64; 2]; 4]) -> Result<Camera, Error> {
        let found = fit(&self.rectangle.pairs(corners_px))?;
        let center_m = self.center.of(&found.homography)?;
        Plane::new(&found.homography, center_m).map(Camera::Plane)
    }
}

/// What is known of where a camera stands.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Center {
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

/// What the table `model.plane` says.
pub(super) enum PlaneModel {
    /// The camera.
    Known(Plane<f64>),
    /// It is to be found.
    Rectangle(RectangleConfig),
}

/// The table `model.plane`.
pub(super) fn read_plane(table: &Table) -> Option<PlaneModel> {
    let ways = ["points", "homography", "rectangle"];
    let given: Vec<&str> = ways.into_iter().filter(|way| table.knows(way)).collect();
    let center = read_center(table);
    let homography = match given[..] {
        ["points"] => read_points(table),
        ["homography"] => {
            let rows = table.optional::<[[f64; 3]; 3]>("homography");
            let matrix = rows.map(|rows| Matrix3::from_row_slice(rows.as_flattened()));
            matrix.and_then(|matrix| table.checked(Homography::new(matrix)))
        }
        [_] => return read_rectangle(table, center?).map(PlaneModel::Rectangle),
        [] => {
            let message = "is missing; give four or more points of the plane, points = [[u, v, x, y], ...], in pixels and metres, or rectangle, or homography";
            table.problem("points", message);
            None
        }
        [first, second, ..] => {
            table.problem(second, format!("stands beside {first}; keep one of them"));
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

fn read_rectangle(plane: &Table, center: Center) -> Option<RectangleConfig> {
    let table = plane.table("rectangle")?;
    let size_m = table.optional::<[f64; 2]>("size_m");
    let corners_m = table.optional::<[[f64; 2]; 4]>("corners_m");
    let first = table.or("first", 1_usize);
    let inner_edge = table.word("edge", &[("outer", false), ("inner", true)], "outer");
    let frames = table.or("frames", 10_usize);
    if !(1..=4).contains(&first) {
        table.refuse(
            "first",
            "1 to 4: which of corners_m is nearest the image's bottom left",
        );
    }
    if !(1..=100).contains(&frames) {
        table.refuse("frames", "1 to 100");
    }
    if size_m.is_some_and(|size| size.iter().any(|side| *side <= 0.0)) {
        table.refuse("size_m", "two lengths in metres, above 0");
    }
    let rectangle = match (size_m, corners_m) {
        (Some(_), Some(_)) => {
            table.problem("corners_m", "stands beside size_m; keep one of them");
            None
        }
        (Some(size_m), None) => {
            if table.has("first") {
                table.problem("first", "is for corners_m; with size_m the corner nearest the image's bottom left is the origin");
            }
            Some(Rectangle::of_size(size_m))
        }
        (None, Some(corners_m)) => Some(Rectangle {
            corners_m,
            nearest: first.saturating_sub(1),
        }),
        (None, None) => {
            if !table.has("size_m") && !table.has("corners_m") {
                table.problem("size_m", "is missing; give size_m = [first side, the next one counterclockwise], or corners_m = [[x, y], ...]");
            }
            None
        }
    };
    table.finish();
    Some(RectangleConfig {
        rectangle: rectangle?,
        inner_edge: inner_edge?,
        frames,
        center,
    })
}

fn read_points(table: &Table) -> Option<Homography> {
    let rows = table.optional::<Vec<[f64; 4]>>("points")?;
    let pairs: Vec<PointPair> = rows
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
            |[du, dv]| format!("{:.1} px from there", libm::hypot(du, dv)),
        );
        let message = format!(
            "point {} does not agree with the others, which put it {distance}; it is left out",
            outlier + 1
        );
        table.warn("points", message);
    }
    Some(found.homography)
}

/// Where the camera stands: given, or by its intrinsics; `None` where that is faulty.
fn read_center(table: &Table) -> Option<Center> {
    let has_intrinsics = table.has("f_px") || table.has("center_px");
    if table.knows("camera_center_m") {
        for key in ["f_px", "center_px"] {
            if table.knows(key) {
                table.problem(key, "stands beside camera_center_m; keep one of them");
            }
        }
        return table.optional("camera_center_m").map(Center::At);
    }
    if !has_intrinsics {
        return Some(Center::Unknown);
    }
    let f_px = table.required("f_px");
    let center_px = table.required("center_px");
    Some(Center::Intrinsics {
        f_px: f_px?,
        center_px: center_px?,
    })
}

/// The camera of a plane that stands lowest over it, and its height in metres.
pub(super) fn lowest(cameras: &[CameraConfig]) -> Option<(String, f64)> {
    let height = |camera: &CameraConfig| {
        let center_m = match (&camera.rectangle, &camera.camera) {
            (Some(rectangle), _) => match rectangle.value.center {
                Center::At(center_m) => Some(center_m),
                _ => None,
            },
            (None, Camera::Plane(plane)) => plane.center_m(),
            _ => None,
        };
        center_m.map(|[_, _, height_m]| (camera.name.clone(), height_m))
    };
    let heights = cameras.iter().filter_map(height);
    heights.min_by(|a, b| a.1.total_cmp(&b.1))
}

/// The names of cameras that are known by a plane alone.
pub(super) fn without_height(cameras: &[CameraConfig]) -> Vec<String> {
    let is_one = |camera: &&CameraConfig| match (&camera.rectangle, &camera.camera) {
        (Some(rectangle), _) => rectangle.value.center == Center::Unknown,
        (None, Camera::Plane(plane)) => plane.center_m().is_none(),
        _ => false,
    };
    cameras
        .iter()
        .filter(is_one)
        .map(|camera| camera.name.clone())
        .collect()
}
