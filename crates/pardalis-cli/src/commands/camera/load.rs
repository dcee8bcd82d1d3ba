//! Loads the cameras of a file in any format.

use std::path::{Path, PathBuf};

use anyhow::Result;
use clap::builder::{PossibleValuesParser, TypedValueParser};
use pardalis_camera::CalibratedCamera;
use pardalis_camera::formats::Lens;
use pardalis_scene::calibration;

use crate::arguments::parse_size;
use crate::output::Shown;
use crate::scene;
use crate::scene_files::{read_calibration, read_text};
use crate::source::decode::media_kind;
use crate::user_error::user_error;

/// A selection of cameras in a file.
#[derive(Debug, clap::Args)]
pub(super) struct Selection {
    /// The calibration, in any format, a recording with calibrations, or a scene
    #[arg(value_name = "FILE")]
    pub(super) file: PathBuf,
    /// Selects one camera of a file with several
    #[arg(long, visible_alias = "camera-name", value_name = "NAME")]
    camera: Option<String>,
    /// The lens model of the file's coefficients, if the file does not state it
    #[arg(long = "as", value_name = "LENS", value_parser = lens())]
    lens: Option<Lens>,
    /// Size of the images in pixels, if the file does not state it
    #[arg(long, value_name = "WIDTHxHEIGHT", value_parser = parse_size)]
    size: Option<(usize, usize)>,
}

/// Parses the name of a lens; the help lists the names.
pub(crate) fn lens() -> impl TypedValueParser<Value = Lens> {
    PossibleValuesParser::new(Lens::ALL.map(Lens::name)).try_map(|word| {
        let found = Lens::ALL.into_iter().find(|lens| lens.name() == word);
        found.ok_or("is not one of the possible values")
    })
}

impl Selection {
    /// Returns the selected cameras, at least one.
    ///
    /// Errors: the file cannot be read or parsed, has no camera of that name, or states another size.
    pub(super) fn cameras(&self) -> Result<Vec<CalibratedCamera>> {
        let mut cameras = cameras_in(&self.file, self.lens)?;
        if let Some(name) = &self.camera {
            let names: Vec<_> = cameras.iter().map(|camera| &*camera.name).collect();
            let allowed = names.join(", ");
            cameras.retain(|camera| camera.name == *name);
            if cameras.is_empty() {
                return Err(user_error!(
                    "--camera {name}: {} has no camera of this name; allowed: {allowed}",
                    self.file.shown()
                ));
            }
        }
        for camera in &mut cameras {
            self.apply_size(camera)?;
        }
        Ok(cameras)
    }

    /// Sets the given size of a camera if its file does not state it.
    fn apply_size(&self, camera: &mut CalibratedCamera) -> Result<()> {
        match (self.size, camera.size_px) {
            (Some((width, height)), Some(stated)) if stated != (width, height) => Err(user_error!(
                "--size {width}x{height}: according to {}, the images of camera {} are {}x{}; remove --size",
                self.file.shown(),
                camera.name,
                stated.0,
                stated.1
            )),
            (Some(size), _) => {
                camera.size_px = Some(size);
                Ok(())
            }
            (None, _) => Ok(()),
        }
    }

    /// Returns the only selected camera.
    ///
    /// Errors: those of [`Selection::cameras`], or there are several cameras.
    pub(super) fn only_camera(
        cameras: &[CalibratedCamera],
        purpose: &str,
    ) -> Result<CalibratedCamera> {
        match cameras {
            [camera] => Ok(camera.clone()),
            _ => Err(user_error!(
                "{purpose} requires a single camera; select one with --camera: {}",
                cameras
                    .iter()
                    .map(|camera| &*camera.name)
                    .collect::<Vec<_>>()
                    .join(", ")
            )),
        }
    }
}

fn cameras_in(path: &Path, lens: Option<Lens>) -> Result<Vec<CalibratedCamera>> {
    if media_kind(path) == Some("recording") {
        return read_calibration(Path::new(""), &path.to_string_lossy(), lens)
            .map_err(|message| user_error!("{message}"));
    }
    let text = read_text(path)?;
    // Calibrations have no targets, whereas scenes require them.
    let is_scene = text
        .lines()
        .any(|line| line.trim_start().starts_with("[targets."));
    if !is_scene {
        return calibration::read(&text, lens)
            .map_err(|error| user_error!("{}: {error}", path.shown()));
    }
    if let Some(lens) = lens {
        return Err(user_error!(
            "--as {}: {} is a scene, which states the lens models of its calibrations itself (calibration_lens); remove --as",
            lens.name(),
            path.shown()
        ));
    }
    let mut scene = scene::read(path)?;
    scene::find_live_rectangles(path, &mut scene)?;
    let calibrated = scene.cameras.into_iter().map(|camera| CalibratedCamera {
        name: camera.name,
        camera: camera.camera,
        size_px: camera
            .size_px
            .map(|size| (size.value[0] as usize, size.value[1] as usize)),
        world_from_camera: Some(camera.world_from_camera),
    });
    Ok(calibrated.collect())
}
