//! camera.json and cameras.json of sequence folders, as data/README.md describes them.

use std::path::Path;

use anyhow::Result;
use serde::Deserialize;

use crate::fault::fault;
use crate::scene::read_text;

/// The cameras of a sequence.
pub(super) struct Sequence {
    pub(super) cameras: Vec<SequenceCamera>,
    /// Frames a second, where the file says.
    pub(super) fps: Option<f64>,
    /// The ball's radius in metres, where the file says.
    pub(super) ball_radius_m: Option<f64>,
}

/// One camera, as its file gives it.
#[derive(Debug, Deserialize)]
pub(super) struct SequenceCamera {
    #[serde(default = "unnamed")]
    pub(super) name: String,
    pub(super) model: String,
    pub(super) width: usize,
    pub(super) height: usize,
    pub(super) cx: Option<f64>,
    pub(super) cy: Option<f64>,
    pub(super) fx: Option<f64>,
    pub(super) fy: Option<f64>,
    #[serde(default)]
    pub(super) distortion: Vec<f64>,
    pub(super) f_px_per_rad: Option<f64>,
    pub(super) fov_deg: Option<f64>,
    /// Four rows of four numbers; a text where the camera moves.
    #[serde(rename = "T_world_from_camera")]
    pub(super) world_from_camera: serde_json::Value,
    sequence: Option<Recording>,
}

fn unnamed() -> String {
    "camera".to_owned()
}

#[derive(Debug, Deserialize)]
struct Recording {
    fps: Option<f64>,
    ball_radius_m: Option<f64>,
}

#[derive(Deserialize)]
struct SeveralCameras {
    cameras: Vec<SequenceCamera>,
    sequence: Option<Recording>,
}

#[derive(Deserialize)]
#[serde(untagged)]
enum CameraFile {
    Several(SeveralCameras),
    One(Box<SequenceCamera>),
}

/// Reads either file.
pub(super) fn read(path: &Path) -> Result<Sequence> {
    let text = read_text(path)?;
    // The second parse is for its message: an untagged enum's says nothing.
    let file: CameraFile = serde_json::from_str(&text).map_err(|_| {
        let why = serde_json::from_str::<SequenceCamera>(&text)
            .err()
            .map(|e| e.to_string())
            .unwrap_or_default();
        fault!(
            "{}: is no camera.json as data/README.md describes it: {why}",
            path.display()
        )
    })?;
    let (cameras, recording) = match file {
        CameraFile::Several(several) => (several.cameras, several.sequence),
        CameraFile::One(mut camera) => {
            let recording = camera.sequence.take();
            (vec![*camera], recording)
        }
    };
    if cameras.is_empty() {
        return Err(fault!(
            "{}: cameras is empty; it must describe at least one",
            path.display()
        ));
    }
    Ok(Sequence {
        cameras,
        fps: recording.as_ref().and_then(|r| r.fps),
        ball_radius_m: recording.and_then(|r| r.ball_radius_m),
    })
}
