//! Annotated frames: estimates drawn over the image that they were computed from.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::Result;
use libm::hypot;
use pardalis::view::View;
use pardalis::{CameraId, Estimate, TargetId};
use pardalis_scene::{BodyConfig, Scene};

use super::marks::{CONTOUR_POINTS, Marker, in_rows_m, pixel_of, shown_m, stance_of};
use super::{Annotate, Instant, Options, Sink};
use crate::draw::overlay::{Overlay, Zoomed, annotated};
use crate::draw::picture::{picture_of, write_picture};
use crate::files::refuse_links;
use crate::output::Shown;
use crate::report::ANNOTATED;
use crate::user_error::user_error;

/// Removes the frames of an earlier run from its results, which would be of other rows, and folders that are empty then.
pub(super) fn remove_old(output: &Path) {
    let folder = output.join(ANNOTATED);
    // Through a link, frames elsewhere would be removed.
    let is_folder =
        |path: &PathBuf| fs::symlink_metadata(path).is_ok_and(|metadata| metadata.is_dir());
    if !is_folder(&folder) {
        return;
    }
    let entries = fs::read_dir(&folder).into_iter().flatten().flatten();
    let cameras: Vec<PathBuf> = entries
        .map(|entry| entry.path())
        .filter(is_folder)
        .collect();
    for folder in cameras.into_iter().chain([folder]) {
        // What cannot be removed does no harm to the new results, and other files stay.
        let _ = remove_frames(&folder);
        let _ = fs::remove_dir(&folder);
    }
}

fn remove_frames(folder: &Path) -> std::io::Result<()> {
    for entry in fs::read_dir(folder)? {
        let entry = entry?;
        let path = entry.path();
        let stem = path.file_stem().unwrap_or_default().as_encoded_bytes();
        let is_frame =
            entry.file_type()?.is_file() && stem.len() >= 6 && stem.iter().all(u8::is_ascii_digit);
        if is_frame && path.extension().is_some_and(|ending| ending == "jpg") {
            fs::remove_file(path)?;
        }
    }
    Ok(())
}

/// Writes one JPEG per frame.
pub(crate) struct Annotator {
    folder: PathBuf,
    /// The folder of each camera.
    camera_folders: Vec<PathBuf>,
    marker: Marker,
}

impl Annotator {
    /// Creates the folder `annotated`, with one subfolder per camera if there are several.
    pub(crate) fn create(output: &Path, scene: &Scene, options: &Options) -> Result<Self> {
        let folder = output.join(ANNOTATED);
        let camera_folders: Vec<PathBuf> = match &scene.cameras[..] {
            [_] => vec![folder.clone()],
            cameras => cameras
                .iter()
                .map(|camera| folder.join(&camera.name))
                .collect(),
        };
        refuse_links(&folder)?;
        for folder in &camera_folders {
            fs::create_dir_all(folder).map_err(|error| {
                user_error!(
                    "{}: {error}; give a folder that can be written",
                    folder.shown()
                )
            })?;
        }
        Ok(Self {
            folder,
            camera_folders,
            marker: Marker::new(
                &scene.targets,
                options.annotate == Annotate::Trails,
                options.explain,
            ),
        })
    }

    /// Returns the folder of the frames.
    pub(crate) fn folder(&self) -> &Path {
        &self.folder
    }
}

/// Returns the part of the image that shows a body; `None` if it is out of view.
fn zoomed(body: &BodyConfig, now: &Estimate, position_m: [f64; 3], view: &View) -> Option<Zoomed> {
    let center_px = pixel_of(view, shown_m(body, position_m))?;
    let outline_px = body.shape.outline_px(
        view.camera(),
        view.camera_from_world(),
        position_m,
        stance_of(body, now),
        CONTOUR_POINTS,
    );
    let [u, v] = center_px;
    let distances_px = outline_px
        .iter()
        .flatten()
        .map(|[x, y]| hypot(x - u, y - v));
    Some(Zoomed {
        center_px,
        radius_px: distances_px.fold(0.0, f64::max),
    })
}

impl Sink for Annotator {
    fn take(&mut self, instant: &Instant) -> Result<()> {
        self.marker.follow(instant);
        for (camera, frame) in instant.frames {
            let view = &instant.tracker.views()[*camera];
            let targets = &self.marker.targets;
            let zoom = targets.iter().enumerate().find_map(|(number, target)| {
                let bodies = instant
                    .tracker
                    .bodies_at(TargetId::new(number), instant.time_s);
                let bodies = bodies.ok()?;
                let now = bodies.first().filter(|_| target.crowd.is_none())?;
                let known = now.kinematics.as_ref()?;
                let body = &target.bodies[0];
                let position_m = in_rows_m(known, known.position_m, body, view);
                Some(zoomed(body, now, position_m, view))
            });
            let overlay = Overlay {
                marks: self.marker.marks(instant, CameraId::new(*camera))?,
                notes: self.marker.notes(instant, CameraId::new(*camera))?,
                label: self.marker.label(instant),
                zoom: zoom.flatten(),
            };
            let picture = annotated(&picture_of(frame), &overlay);
            write_picture(
                &self.camera_folders[*camera].join(format!("{:06}.jpg", instant.index)),
                &picture,
            )?;
        }
        Ok(())
    }
}
