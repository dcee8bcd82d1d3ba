//! `pardalis calibrate board --rig`: several cameras that saw the same board at the same time.

use std::path::{Path, PathBuf};

use anyhow::Result;
use pardalis_calibrate::board::Board;
use pardalis_calibrate::{RigCamera, calibrate_rig};
use pardalis_scene::calibration;

use super::board_checks::{check_found, side_note};
use super::board_rig_report::RigReport;
use super::fit::Fits;
use super::model::ModelOptions;
use super::report::Report;
use super::{images, output};
use crate::files::write_file;
use crate::output::print;
use crate::user_error::user_error;

/// Calibrates each camera on its own into a folder of its name, then all together into `rig.toml`.
pub(super) fn run(
    board: &Board,
    model: &ModelOptions,
    sources: &[(String, PathBuf)],
    folder: &Path,
) -> Result<()> {
    if !board.has_unique_origin() {
        return Err(user_error!(
            "--board: this checkerboard is symmetric under rotation by 180 degrees, so that its first corner is ambiguous; \
             use one whose columns and rows of inner corners add up to an odd number, a ChArUco board or an AprilGrid"
        ));
    }
    let cameras: Vec<(&str, Vec<PathBuf>)> = sources
        .iter()
        .map(|(name, path)| Ok((&**name, images::files(path)?)))
        .collect::<Result<_>>()?;
    check_cameras(&cameras)?;
    let mut seen = Vec::new();
    for (name, files) in &cameras {
        let (images, size_px) = images::search(board, files)?;
        let source = Path::new(name);
        check_found(source, &images)?;
        let observations = images::observations(&images);
        let fits = Fits::of(source, &observations.views, model.models()?, size_px, true)?;
        seen.push((*name, size_px, images, observations, fits));
    }
    let reports: Vec<Report> = seen
        .iter()
        .map(|(name, size_px, images, observations, fits)| Report {
            camera: name,
            size_px: *size_px,
            observations,
            fits,
            images,
            note: side_note(board),
        })
        .collect();
    let rig: Vec<RigCamera> = reports
        .iter()
        .map(|report| RigCamera {
            name: report.camera.to_owned(),
            camera: report.best().camera.clone(),
            size_px: report.size_px,
            views: report.images.iter().map(images::view).collect(),
        })
        .collect();
    // Writes nothing if the cameras disagree.
    let calibration =
        calibrate_rig(&rig, model.outliers).map_err(|refusal| user_error!("--rig: {refusal}"))?;
    for report in &reports {
        output::write(&folder.join(report.camera), report)?;
        print("");
    }
    let report = RigReport {
        calibration: &calibration,
        cameras: &reports,
    };
    let [path, page] = ["rig.toml", "report.html"].map(|name| folder.join(name));
    write_file(
        &path,
        calibration::write_toml(&calibration.cameras).as_bytes(),
    )?;
    write_file(&page, report.page()?.as_bytes())?;
    print(&report);
    output::print_written(&[path, page]);
    Ok(())
}

/// Fails if there are too few cameras, repeated names or different numbers of images.
fn check_cameras(cameras: &[(&str, Vec<PathBuf>)]) -> Result<()> {
    let [(first, files), others @ ..] = cameras else {
        return Ok(());
    };
    if others.is_empty() {
        return Err(user_error!(
            "--rig: {first} is the only camera; give --rig NAME=FOLDER for each camera"
        ));
    }
    for (place, (name, images)) in cameras.iter().enumerate() {
        if cameras[..place].iter().any(|(before, _)| before == name) {
            return Err(user_error!(
                "--rig {name}: the name occurs twice; give each camera its own name"
            ));
        }
        if images.len() != files.len() {
            return Err(user_error!(
                "--rig {name}: has {} images, but {first} has {}; sorted by name, the images of all cameras must correspond one to one",
                images.len(),
                files.len()
            ));
        }
    }
    Ok(())
}
