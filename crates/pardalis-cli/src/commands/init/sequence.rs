//! What camera.json and cameras.json of sequence folders say beside the cameras, as data/README.md describes them.

use serde::Deserialize;

/// How a sequence was recorded; nothing is known where the calibration is another program's.
#[derive(Debug, Default, Deserialize)]
pub(super) struct Recording {
    /// Frames a second, where the file says.
    pub(super) fps: Option<f64>,
    /// The ball's radius in metres, where the file says.
    pub(super) ball_radius_m: Option<f64>,
}

#[derive(Deserialize)]
struct CameraFile {
    sequence: Recording,
}

impl Recording {
    /// From the text of a calibration of any format.
    pub(super) fn of(text: &str) -> Self {
        serde_json::from_str(text)
            .map_or_else(|_| Self::default(), |file: CameraFile| file.sequence)
    }
}
