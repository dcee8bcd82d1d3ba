//! The pose of a camera: from known points, from a rectangle or a board on the floor, and the floor as the camera shows it.

use anyhow::Result;
use pardalis::View;
use pardalis_calibrate::board;
use pardalis_calibrate::rectangle::{self, Edge};
use pardalis_calibrate::{Correspondence, OUTLIER_SIGMAS, fit_pose};
use pardalis_camera::{Camera, Pose};
use serde::Deserialize;
use serde_json::{Value, json};
use toml_edit::Array;

use super::edits::with_value;
use super::session::{Inner, Session};
use crate::board::parse_words;
use crate::commands::calibrate::pose::below_points;
use crate::draw::picture::picture_of;
use crate::user_error::user_error;

/// Lines of the floor in each direction from the middle.
const GRID_LINES: i32 = 10;
/// Points of a line of the floor between two crossings.
const GRID_POINTS: i32 = 4;
/// Distances between lines of the floor, in metres.
const GRID_STEPS_M: [f64; 6] = [0.02, 0.05, 0.1, 0.2, 0.5, 1.0];

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct KnownPoints {
    camera: String,
    points: Vec<KnownPoint>,
}

/// A place in the room, and where the image shows it.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct KnownPoint {
    at_px: [f64; 2],
    world_m: [f64; 3],
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct OfCamera {
    pub(super) camera: String,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct OnFloor {
    camera: String,
    /// As on the command line, such as `checkerboard:9x6:0.025`.
    board: String,
}

impl KnownPoints {
    pub(super) fn camera(&self) -> &str {
        &self.camera
    }

    pub(super) fn correspondences(&self) -> Vec<Correspondence> {
        let points = self.points.iter().map(|point| Correspondence {
            point_m: point.world_m,
            pixel: point.at_px,
        });
        points.collect()
    }
}

impl Session {
    /// Sets the pose of a camera from points in the room. Returns how far they are from where the camera shows them then.
    pub(super) fn set_pose(&self, known: &KnownPoints) -> Result<Value> {
        let points = known.correspondences();
        let (lens, size_px) = self.inner().lens_of(&known.camera)?;
        let fit = fit_pose(&lens, size_px, &points, OUTLIER_SIGMAS)
            .map_err(|refusal| user_error!("cameras.{}: {refusal}", known.camera))?;
        let pose = fit.camera_from_target.inverse();
        self.write_pose(&known.camera, &pose, "points")?;
        let note = below_points(&points, &fit);
        Ok(json!({ "rms_px": fit.rms_px, "outliers": fit.outliers, "note": note }))
    }

    /// Sets the pose of a camera from a board that lies on the floor, whose corner is the origin of the room.
    pub(super) fn set_pose_of_board(&self, on_floor: &OnFloor) -> Result<Value> {
        let board = parse_words(&on_floor.board)?;
        let name = &on_floor.camera;
        let (lens, size_px) = self.inner().lens_of(name)?;
        let (_, frame) = self.inner().shown(name)?;
        let corners = board::detect(&board, &picture_of(&frame).to_grey())
            .map_err(|error| user_error!("cameras.{name}: {error}"))?;
        // Whichever way the board is turned, it lies face up: the camera is above it.
        let fits = [1.0, -1.0].map(|side| {
            let point = |corner: &board::Corner| Correspondence {
                point_m: [corner.board_m[0], side * corner.board_m[1], 0.0],
                pixel: corner.pixel,
            };
            let points: Vec<_> = corners.iter().map(point).collect();
            fit_pose(&lens, size_px, &points, OUTLIER_SIGMAS)
        });
        let mut refusal = None;
        for fit in fits {
            match fit {
                Ok(fit) => {
                    let pose = fit.camera_from_target.inverse();
                    if pose.translation.z > 0.0 {
                        self.write_pose(name, &pose, "board")?;
                        return Ok(json!({ "rms_px": fit.rms_px, "corners": corners.len() }));
                    }
                }
                Err(error) => refusal = Some(error),
            }
        }
        Err(match refusal {
            Some(refusal) => user_error!("cameras.{name}: {refusal}"),
            None => user_error!(
                "cameras.{name}: the board does not lie face up below the camera; lay it on the floor"
            ),
        })
    }

    /// Returns the corners of the rectangle that stands out in the picture of a camera, counter-clockwise.
    pub(super) fn find_rectangle(&self, of: &OfCamera) -> Result<Value> {
        let (_, frame) = self.inner().shown(&of.camera)?;
        let found = rectangle::detect(&[picture_of(&frame)], Edge::Outer)
            .map_err(|error| user_error!("cameras.{}: {error}", of.camera))?;
        Ok(json!({ "corners_px": found.corners_px, "is_tape": found.is_tape }))
    }

    fn write_pose(&self, name: &str, world_from_camera: &Pose, from: &str) -> Result<()> {
        let matrix = world_from_camera.to_homogeneous();
        let rows: Array = (0..4)
            .map(|row| {
                // More digits than the pose has would only be hard to read.
                let cells = (0..4).map(|column| (1e9 * matrix[(row, column)]).round() / 1e9 + 0.0);
                let mut cells: toml_edit::Value = cells.collect::<Array>().into();
                cells.decor_mut().set_prefix("\n    ");
                cells
            })
            .collect();
        let mut rows = rows;
        rows.set_trailing("\n");
        rows.set_trailing_comma(true);
        self.edit(
            &format!("cameras.{name}"),
            format!("pose of {name} from {from}"),
            |state| {
                let path = ["cameras", name, "world_from_camera"];
                state.text = with_value(&state.text, &path, rows)?.into();
                Ok(())
            },
        )
    }

    /// Returns the lines of the floor as a camera shows them, and how far apart they are.
    pub(super) fn grid(&self, of: &OfCamera) -> Result<Value> {
        let inner = self.inner();
        let parts = inner.parts();
        let cameras = parts.scene.cameras.iter().zip(&parts.assembly.views);
        let view = cameras
            .into_iter()
            .find(|(camera, _)| camera.name == of.camera);
        let view = view.and_then(|(_, view)| view.as_ref()).ok_or_else(|| {
            user_error!(
                "cameras.{}: cannot show the floor; see the problems of the steps before",
                of.camera
            )
        })?;
        Ok(floor(view))
    }
}

impl Inner {
    /// Returns the lens of a camera and the size of its images.
    fn lens_of(&self, name: &str) -> Result<(Camera, (usize, usize))> {
        let size_px = self.player(name)?.size_px().ok_or_else(|| {
            user_error!("cameras.{name}: has no picture yet; wait for it, or see the problems of the step Sources")
        })?;
        let lens = self.lens(name).ok_or_else(|| {
            user_error!("cameras.{name}: has no lens yet; set it in the step Camera")
        })?;
        Ok((lens, size_px))
    }
}

/// Returns the floor around the place at which a camera looks, or that below it.
fn floor(view: &View) -> Value {
    let height_m = view.world_from_camera().translation.z;
    let half = (GRID_LINES / 2) as f64;
    let is_wide = |step_m: &f64| step_m * half > 0.7 * height_m.abs();
    let step_m = GRID_STEPS_M.into_iter().find(is_wide).unwrap_or(1.0);
    let below = view.world_from_camera().translation.vector;
    let ahead = view.world_from_camera() * nalgebra::Vector3::z();
    // No farther than three heights: the horizon is of no use.
    let reach_m = if ahead.z < -1e-3 {
        (-height_m / ahead.z).clamp(0.0, 3.0 * height_m.abs())
    } else {
        2.0 * height_m.abs()
    };
    let middle = [0, 1].map(|axis| ((below[axis] + reach_m * ahead[axis]) / step_m).round() as i32);
    let pixel = |x_m: f64, y_m: f64, z_m: f64| -> Option<[f64; 2]> {
        let point = view.camera_from_world() * nalgebra::Point3::new(x_m, y_m, z_m);
        view.camera().project(point.into())
    };
    let mut lines = Vec::new();
    for axis in 0..2 {
        for line in -GRID_LINES..=GRID_LINES {
            let across_m = f64::from(middle[1 - axis] + line) * step_m;
            let points = (-GRID_LINES * GRID_POINTS..=GRID_LINES * GRID_POINTS).map(|part| {
                let along_m =
                    (f64::from(middle[axis]) + f64::from(part) / f64::from(GRID_POINTS)) * step_m;
                let [x_m, y_m] = if axis == 0 {
                    [along_m, across_m]
                } else {
                    [across_m, along_m]
                };
                pixel(x_m, y_m, 0.0)
            });
            lines.push(points.collect::<Vec<_>>());
        }
    }
    let axes = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]].map(|[x, y, z]| {
        let along = (0..=8).map(|part| f64::from(part) * 0.25 * step_m);
        along
            .map(|m| pixel(x * m, y * m, z * m))
            .collect::<Vec<_>>()
    });
    json!({ "step_m": step_m, "lines": lines, "axes": axes })
}
