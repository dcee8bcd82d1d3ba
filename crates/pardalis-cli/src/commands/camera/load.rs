//! The cameras of a file of any format.

use std::path::{Path, PathBuf};

use anyhow::Result;
use pardalis::interchange::{self, Lens};
use pardalis::rig::CalibratedCamera;

use crate::fault::fault;
use crate::scene::{self, read_text};

/// Which cameras of which file are meant.
#[derive(Debug, clap::Args)]
pub(super) struct Selection {
    /// The calibration, of any format, or a scene
    #[arg(value_name = "FILE")]
    pub(super) file: PathBuf,
    /// Of a file of several cameras this one only
    #[arg(long, value_name = "NAME")]
    camera: Option<String>,
    /// What the file's coefficients mean where it does not say so itself
    #[arg(long = "as", value_name = "LENS", value_parser = lens)]
    lens: Option<Lens>,
}

fn lens(word: &str) -> Result<Lens, String> {
    Lens::ALL
        .into_iter()
        .find(|lens| lens.name() == word)
        .ok_or_else(|| format!("allowed: {}", Lens::ALL.map(Lens::name).join(", ")))
}

impl Selection {
    /// The cameras that are meant, at least one.
    ///
    /// Faults: the file cannot be read or understood, or has no camera of that name.
    pub(super) fn cameras(&self) -> Result<Vec<CalibratedCamera>> {
        let mut cameras = cameras_in(&self.file, self.lens)?;
        if let Some(name) = &self.camera {
            let names: Vec<_> = cameras.iter().map(|camera| &*camera.name).collect();
            let allowed = names.join(", ");
            cameras.retain(|camera| camera.name == *name);
            if cameras.is_empty() {
                return Err(fault!(
                    "--camera {name}: {} has no camera of this name; allowed: {allowed}",
                    self.file.display()
                ));
            }
        }
        Ok(cameras)
    }

    /// The one camera that is meant.
    ///
    /// Faults: as [`Selection::cameras`], and where there are several.
    pub(super) fn only_camera(
        cameras: &[CalibratedCamera],
        purpose: &str,
    ) -> Result<CalibratedCamera> {
        match cameras {
            [camera] => Ok(camera.clone()),
            _ => Err(fault!(
                "{purpose} is of one camera; choose one with --camera: {}",
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
    let text = read_text(path)?;
    // Calibrations have no targets; scenes cannot do without.
    let is_scene = text
        .lines()
        .any(|line| line.trim_start().starts_with("[targets."));
    if !is_scene {
        return interchange::read(&text, lens)
            .map_err(|error| fault!("{}: {error}", path.display()));
    }
    let scene = scene::read(path)?;
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
