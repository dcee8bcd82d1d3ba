//! `cameras.csv`: where cameras on platforms were, one row per time and camera, flushed after each time.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use anyhow::Result;
use pardalis_camera::Pose;
use pardalis_scene::Scene;

use super::{Instant, Output, Sink};
use crate::files::RowFile;

/// The header line. Later versions may append columns.
const HEADER: &str = "frame,time_s,camera,x_m,y_m,z_m,qx,qy,qz,qw\n";

/// Writes the poses of moving cameras in the world.
pub(super) struct CameraRows {
    out: RowFile,
    path: PathBuf,
    cameras: Vec<(usize, String)>,
    text: String,
}

impl CameraRows {
    /// The name of the file in the output folder.
    pub(crate) const FILE: &str = "cameras.csv";

    /// Creates the file in the output folder and writes the header; `None` if there is no folder, or no camera that moves.
    pub(super) fn create(output: &Output, scene: &Scene) -> Result<Option<Self>> {
        let cameras = moving(scene);
        let Output::Folder(folder) = output else {
            return Ok(None);
        };
        if cameras.is_empty() {
            return Ok(None);
        }
        let path = folder.join(Self::FILE);
        let mut out = RowFile::create(&path)?;
        out.write(HEADER)?;
        Ok(Some(Self {
            out,
            path,
            cameras,
            text: String::new(),
        }))
    }

    /// Returns the path of the file.
    pub(super) fn path(&self) -> &Path {
        &self.path
    }
}

/// Returns the indices and names of the cameras that move.
pub(super) fn moving(scene: &Scene) -> Vec<(usize, String)> {
    let cameras = scene.cameras.iter().enumerate();
    let moving = cameras.filter(|(_, camera)| camera.platform.is_some());
    moving
        .map(|(index, camera)| (index, camera.name.clone()))
        .collect()
}

/// Returns a pose as position and quaternion, w last.
pub(super) fn numbers_of(pose: &Pose) -> [f64; 7] {
    let [x, y, z] = pose.translation.vector.into();
    let turn = nalgebra::UnitQuaternion::from_rotation_matrix(&pose.rotation);
    [x, y, z, turn.i, turn.j, turn.k, turn.w]
}

impl Sink for CameraRows {
    fn take(&mut self, instant: &Instant) -> Result<()> {
        self.text.clear();
        for (index, name) in &self.cameras {
            let pose = instant.tracker.views()[*index].world_from_camera();
            // Writing to a String cannot fail.
            let _ = write!(self.text, "{},{},{name}", instant.index, instant.time_s);
            for number in numbers_of(pose) {
                let _ = write!(self.text, ",{number}");
            }
            self.text.push('\n');
        }
        self.out.write(&self.text)
    }
}
