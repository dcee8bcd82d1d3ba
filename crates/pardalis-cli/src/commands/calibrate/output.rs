//! Result files of a calibration.

use std::fs;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use anyhow::Result;
use pardalis_calibrate::{Calibration, ModelKind};
use pardalis_camera::CalibratedCamera;
use pardalis_scene::calibration;

use super::fit::{Fit, free_parameters};
use super::page;
use super::report::{Report, outlier_count};
use super::trial::Trial;
use crate::files::{refuse_links, write_file};
use crate::output::{Shown, print};
use crate::user_error::user_error;

/// Returns the requested folder, or one in the current directory named after the input and the task, such as
/// `points-calibration`.
pub(super) fn folder(asked: Option<&Path>, input: &Path, done: &str) -> PathBuf {
    let stem = input.file_stem().unwrap_or_default().to_string_lossy();
    // A pattern is named after its fixed part.
    let stem = stem.replace(['*', '?'], "");
    let parts = [&*stem, done].into_iter().filter(|part| !part.is_empty());
    let name = parts.collect::<Vec<_>>().join("-");
    asked.map_or_else(|| name.into(), Path::to_owned)
}

/// Writes camera files, residuals and report into a folder, and prints the report.
///
/// Fails if the folder cannot be created or written.
pub(super) fn write(folder: &Path, report: &Report) -> Result<()> {
    make_folder(folder)?;
    let mut written = Vec::new();
    let mut write = |name: String, text: String| {
        let path = folder.join(name);
        write_file(&path, text.as_bytes())?;
        written.push(path);
        anyhow::Ok(())
    };
    let text_of = |fit: &Calibration| calibration::write_toml(&[camera_of(report, fit)]);
    write("camera.toml".to_owned(), text_of(report.best()))?;
    remove_earlier(folder)?;
    if report.fits.fitted.len() > 1 {
        for Fit {
            calibration: fit, ..
        } in &report.fits.fitted
        {
            write(format!("camera-{}.toml", fit.camera.kind()), text_of(fit))?;
        }
    }
    write("models.csv".to_owned(), models(report)?)?;
    write("views.csv".to_owned(), views(report)?)?;
    write("residuals.csv".to_owned(), residuals(report)?)?;
    write("report.html".to_owned(), page::page(report)?)?;
    print(report);
    print_written(&written);
    Ok(())
}

/// Removes the models of an earlier run, so that they are not taken for results of this one.
fn remove_earlier(folder: &Path) -> Result<()> {
    for kind in ModelKind::ALL {
        let path = folder.join(format!("camera-{}.toml", kind.name()));
        match fs::remove_file(&path) {
            Err(error) if error.kind() != ErrorKind::NotFound => {
                return Err(user_error!("{}: cannot be replaced: {error}", path.shown()));
            }
            _ => {}
        }
    }
    Ok(())
}

/// Creates a folder for results and its parents.
pub(super) fn make_folder(folder: &Path) -> Result<()> {
    refuse_links(folder)?;
    fs::create_dir_all(folder).map_err(|error| {
        user_error!(
            "{}: cannot be created ({error}); choose another folder with --output",
            folder.shown()
        )
    })
}

/// Prints the names of the written files.
pub(super) fn print_written(written: &[PathBuf]) {
    print("\nWritten:");
    for path in written {
        print(format!("  {}", path.shown()));
    }
}

/// Returns the camera of a fit. With a single view, the target's frame is the world frame.
pub(super) fn camera_of(report: &Report, fit: &Calibration) -> CalibratedCamera {
    let world_from_camera = match fit.views.as_slice() {
        [view] => Some(view.camera_from_target.inverse()),
        _ => None,
    };
    CalibratedCamera {
        name: report.camera.to_owned(),
        camera: fit.camera.clone(),
        size_px: Some(report.size_px),
        world_from_camera,
    }
}

/// Tabulates the figures of all models, one row per model, best first; cells that do not apply are empty.
fn models(report: &Report) -> Result<String> {
    let mut table = csv::Writer::from_writer(Vec::new());
    table.write_record([
        "model",
        "free_parameters",
        "points",
        "outliers",
        "rms_px",
        "rms_all_px",
        "held_out_rms_px",
        "test_rms_px",
        "test_points",
        "test_points_not_projected",
        "max_angle_rad",
        "refusal",
    ])?;
    let points = report.observations.point_count().to_string();
    for Fit { calibration, trial } in &report.fits.fitted {
        let held_out = calibration.held_out_rms_px;
        let tried = |figure: fn(&Trial) -> String| trial.as_ref().map_or_else(String::new, figure);
        table.write_record([
            calibration.camera.kind().to_owned(),
            free_parameters(calibration).to_string(),
            points.clone(),
            outlier_count(calibration).to_string(),
            calibration.rms_px.to_string(),
            calibration.rms_all_px.to_string(),
            held_out.map_or_else(String::new, |px| px.to_string()),
            tried(|trial| trial.rms_px.map_or_else(String::new, |px| px.to_string())),
            tried(|trial| trial.points.to_string()),
            tried(|trial| trial.unseen.to_string()),
            calibration.max_angle_rad.to_string(),
            String::new(),
        ])?;
    }
    for (name, reason) in &report.fits.failed {
        let mut row = [""; 12];
        (row[0], row[11]) = (name, reason);
        table.write_record(row)?;
    }
    Ok(String::from_utf8(table.into_inner()?)?)
}

/// Tabulates the views of the best fit, one row per view. The pose `camera_from_target` is in OpenCV's form:
/// the rotation as a vector along its axis whose length is the angle.
fn views(report: &Report) -> Result<String> {
    let mut table = csv::Writer::from_writer(Vec::new());
    table.write_record([
        "view", "points", "outliers", "rms_px", "x_m", "y_m", "z_m", "rx_rad", "ry_rad", "rz_rad",
    ])?;
    for view in &report.best().views {
        let pose = view.camera_from_target;
        let mut row = vec![
            view.name.clone(),
            view.residuals_px.len().to_string(),
            view.outliers.len().to_string(),
            view.rms_px.to_string(),
        ];
        let turn = pose.rotation.scaled_axis();
        let numbers = pose.translation.vector.iter().chain(&turn);
        row.extend(numbers.map(f64::to_string));
        table.write_record(row)?;
    }
    Ok(String::from_utf8(table.into_inner()?)?)
}

/// Tabulates the residuals of the best fit, one row per point.
fn residuals(report: &Report) -> Result<String> {
    let mut table = csv::Writer::from_writer(Vec::new());
    let number = report.observations.numbered_by;
    table.write_record([
        "view",
        number,
        "x_m",
        "y_m",
        "z_m",
        "u_px",
        "v_px",
        "projected_u_px",
        "projected_v_px",
        "residual_u_px",
        "residual_v_px",
        "outlier",
    ])?;
    for (view, image) in report.observations.views.iter().enumerate() {
        let points = image
            .correspondences
            .iter()
            .zip(report.observed_points(view));
        for ((point, observed), number) in points.zip(&report.observations.numbers[view]) {
            let mut row = vec![image.name.clone(), number.to_string()];
            let known = point.point_m.iter().chain(&point.pixel);
            row.extend(known.map(f64::to_string));
            for pair in [observed.projected(), observed.residual_px] {
                match pair {
                    Some(pair) => row.extend(pair.map(|value| value.to_string())),
                    None => row.extend([String::new(), String::new()]),
                }
            }
            row.push(u8::from(observed.outlier).to_string());
            table.write_record(row)?;
        }
    }
    Ok(String::from_utf8(table.into_inner()?)?)
}
