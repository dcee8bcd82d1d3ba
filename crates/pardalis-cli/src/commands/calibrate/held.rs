//! A lens from views of a board that somebody holds up to the camera, as `calibrate board` finds it from images.

use std::path::Path;

use anyhow::Result;
use pardalis_calibrate::OUTLIER_SIGMAS;
use pardalis_calibrate::board::{Board, Corner};
use pardalis_camera::CalibratedCamera;
use pardalis_scene::calibration;

use super::board_checks::side_note;
use super::fit::Fits;
use super::images::{SearchedImage, observations};
use super::model::named;
use super::output::camera_of;
use super::report::Report;

/// A calibrated lens.
pub(in crate::commands) struct HeldLens {
    pub(in crate::commands) camera: CalibratedCamera,
    /// The text of its calibration file.
    pub(in crate::commands) text: String,
    /// Root mean square of the residuals in pixels, and that of held-out points if there are enough views.
    pub(in crate::commands) rms_px: f64,
    pub(in crate::commands) held_out_rms_px: Option<f64>,
    /// What the points cover, and where the camera ends.
    pub(in crate::commands) notes: Vec<String>,
    pub(in crate::commands) warnings: Vec<String>,
    /// The report of `calibrate board`.
    pub(in crate::commands) report: String,
}

/// Calibrates a camera of this name from the corners in views, with their names. `model` is the name of a model or `all`.
///
/// Errors: the views do not determine the camera, with the remedy.
pub(in crate::commands) fn calibrate(
    name: &str,
    board: &Board,
    views: Vec<(String, Vec<Corner>)>,
    size_px: (usize, usize),
    model: &str,
) -> Result<HeldLens> {
    let images: Vec<SearchedImage> = views
        .into_iter()
        .map(|(name, corners)| SearchedImage {
            name,
            found: Ok(corners),
        })
        .collect();
    let observations = observations(&images);
    let models = named(&[model.to_owned()], OUTLIER_SIGMAS)?;
    let fits = Fits::of(Path::new(name), &observations.views, models, size_px, true)?;
    let report = Report {
        camera: name,
        size_px,
        observations: &observations,
        fits: &fits,
        images: &images,
        note: side_note(board),
    };
    let best = report.best();
    let camera = camera_of(&report, best);
    Ok(HeldLens {
        text: calibration::write_toml(std::slice::from_ref(&camera)),
        camera,
        rms_px: best.rms_px,
        held_out_rms_px: best.held_out_rms_px,
        notes: std::iter::once(report.coverage())
            .chain(report.end())
            .collect(),
        warnings: report.warnings(),
        report: report.to_string(),
    })
}
