//! `pardalis calibrate board --rig`: several cameras that saw the same board at the same times.

use std::path::{Path, PathBuf};

use anyhow::Result;
use pardalis::calibrate::{RigCalibration, RigCamera, calibrate_rig};
use pardalis::config::calibration;

use super::board::check_found;
use super::fit::Fits;
use super::model::ModelOptions;
use super::report::Report;
use super::{images, output};
use crate::board::Board;
use crate::fault::fault;
use crate::files::write_file;
use crate::say::say;

/// Calibrates each camera by itself into a folder of its name, then all together into `rig.toml`.
pub(super) fn run(
    board: &Board,
    model: &ModelOptions,
    sources: &[(String, PathBuf)],
    folder: &Path,
) -> Result<()> {
    if !board.has_unique_origin() {
        return Err(fault!(
            "--board: this checkerboard looks the same upside down, so that cameras cannot agree on its first corner; \
             take one whose columns and rows of inner corners add up to an odd number, a ChArUco board or an AprilGrid"
        ));
    }
    let cameras: Vec<(&str, Vec<PathBuf>)> = sources
        .iter()
        .map(|(name, path)| Ok((&**name, images::files(path)?)))
        .collect::<Result<_>>()?;
    check_cameras(&cameras)?;
    let mut rig = Vec::new();
    for (name, files) in &cameras {
        let (images, size_px) = images::search(board, files)?;
        let source = Path::new(name);
        check_found(source, &images)?;
        let observations = images::observations(&images);
        let fits = Fits::of(source, &observations.views, model.models()?, size_px, true)?;
        let report = Report {
            camera: name,
            size_px,
            observations: &observations,
            fits: &fits,
            images: &images,
        };
        output::write(&folder.join(name), &report)?;
        say("");
        rig.push(RigCamera {
            name: (*name).to_owned(),
            camera: report.best().camera.clone(),
            size_px,
            views: images.iter().map(images::view).collect(),
        });
    }
    let calibration =
        calibrate_rig(&rig, model.outliers).map_err(|refusal| fault!("--rig: {refusal}"))?;
    let path = folder.join("rig.toml");
    write_file(&path, calibration::write(&calibration.cameras).as_bytes())?;
    tell(&calibration, &rig);
    output::say_written(&[path]);
    Ok(())
}

/// Faults: there are too few cameras, a name is given twice, or they have not equally many images.
fn check_cameras(cameras: &[(&str, Vec<PathBuf>)]) -> Result<()> {
    let [(first, files), others @ ..] = cameras else {
        return Ok(());
    };
    if others.is_empty() {
        return Err(fault!(
            "--rig: {first} is the only camera; give --rig NAME=FOLDER once for each camera"
        ));
    }
    for (place, (name, images)) in cameras.iter().enumerate() {
        if cameras[..place].iter().any(|(before, _)| before == name) {
            return Err(fault!(
                "--rig {name}: this name is given twice; give each camera its own"
            ));
        }
        if images.len() != files.len() {
            return Err(fault!(
                "--rig {name}: has {} images, {first} has {}; the cameras' images, sorted by name, must belong together one by one",
                images.len(),
                files.len()
            ));
        }
    }
    Ok(())
}

/// Prints what the cameras' common fit says; the first camera is the world.
fn tell(calibration: &RigCalibration, rig: &[RigCamera]) {
    say("Rig, in the first camera's frame:");
    for (camera, rms_px) in calibration.cameras.iter().zip(&calibration.rms_px) {
        let pose = camera.world_from_camera.unwrap_or_default();
        let [x, y, z]: [f64; 3] = pose.translation.vector.into();
        say(format!(
            "  {}: RMS {rms_px:.3} px; at {x:.4}, {y:.4}, {z:.4} m, {:.4} m from the first, turned by {:.3} degrees",
            camera.name,
            pose.translation.vector.norm(),
            pose.rotation.angle().to_degrees()
        ));
    }
    for &(camera, shot, point) in &calibration.outliers {
        let view = rig[camera].views[shot].as_ref();
        let image = view.map_or("", |view| &view.name);
        say(format!(
            "  left out: {}, {image}, point {point}",
            rig[camera].name
        ));
    }
}
