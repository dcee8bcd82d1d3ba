//! The recording data in camera.json and cameras.json of sequence folders, as described in data/README.md.

use serde::Deserialize;

/// How a sequence was recorded. Empty if the calibration was written by another program.
#[derive(Debug, Default, Deserialize)]
pub(crate) struct Recording {
    /// Frames per second, if given.
    pub(crate) fps: Option<f64>,
    /// Radius of the ball in metres, if given.
    pub(crate) ball_radius_m: Option<f64>,
}

#[derive(Deserialize)]
struct CameraFile {
    sequence: Recording,
}

impl Recording {
    /// Reads the recording data from the text of a calibration in any format.
    pub(crate) fn of(text: &str) -> Self {
        serde_json::from_str(text)
            .map_or_else(|_| Self::default(), |file: CameraFile| file.sequence)
    }
}
