//! The files that scenes name: text, calibrations, colours and masks.

use std::path::{Path, PathBuf};
use std::{fs, io};

use anyhow::Result;
use pardalis::color::ColorModel;
use pardalis_camera::formats::Lens;
use pardalis_camera::{CalibratedCamera, Mask};
use pardalis_filter::gaussian::GaussianStart;
use pardalis_scene::{Files, TrackStart, calibration};

use crate::mcap;
use crate::output::Shown;
use crate::source::decode::{decode_mask, media_kind};
use crate::track_start;
use crate::user_error::user_error;

/// Maximum size of a scene or colour model file in bytes; such files are small.
const MAX_TEXT_BYTES: u64 = 4 << 20;

/// Reads a small text file that the user named.
pub(crate) fn read_text(path: &Path) -> Result<String> {
    let name = path.shown();
    let unreadable = |error: io::Error| match error.kind() {
        io::ErrorKind::NotFound => user_error!("{name}: cannot be read: there is no such file"),
        _ => user_error!("{name}: cannot be read: {error}; give a text file"),
    };
    let metadata = fs::metadata(path).map_err(unreadable)?;
    if !metadata.is_file() {
        return Err(user_error!(
            "{name}: is a folder or a device; give a text file"
        ));
    }
    if metadata.len() > MAX_TEXT_BYTES {
        return Err(user_error!(
            "{name}: has {} bytes; allowed: at most {MAX_TEXT_BYTES}",
            metadata.len()
        ));
    }
    text_in(path, fs::read(path).map_err(unreadable)?)
}

/// Returns the text of a file with these bytes. Errors name `path` and the line.
pub(crate) fn text_in(path: &Path, bytes: Vec<u8>) -> Result<String> {
    let name = path.shown();
    String::from_utf8(bytes).map_err(|error| {
        let line = error.as_bytes()[..error.utf8_error().valid_up_to()]
            .split(|&byte| byte == b'\n')
            .count();
        user_error!("{name}: line {line}: is not UTF-8 text; save the file as UTF-8")
    })
}

/// Reads the cameras of a calibration file that a scene in this folder names. Errors name the file and its line.
pub(crate) fn read_calibration(
    folder: &Path,
    file: &str,
    lens: Option<Lens>,
) -> Result<Vec<CalibratedCamera>, String> {
    let path = resolve(folder, file);
    if media_kind(&path) == Some("recording") {
        return mcap::calibrations(&path, lens).map(|(cameras, _)| cameras);
    }
    let text = read_text(&path).map_err(|error| format!("{error:#}"))?;
    calibration::read(&text, lens).map_err(|error| format!("{}: {error}", path.shown()))
}

/// Resolves a path in a scene file: relative paths start at the scene's folder.
pub(crate) fn resolve(folder: &Path, path: &str) -> PathBuf {
    folder.join(path)
}

/// The files of a scene in a folder.
pub(crate) struct SceneFiles<'a> {
    /// The folder, where relative paths start.
    pub(crate) folder: &'a Path,
    /// The time of the first frame in seconds, before which tracks that targets continue have to begin.
    pub(crate) first_time_s: Option<f64>,
}

impl<'a> SceneFiles<'a> {
    /// The files in a folder, but no tracks.
    pub(crate) fn of(folder: &'a Path) -> Self {
        Self {
            folder,
            first_time_s: None,
        }
    }
}

impl Files for SceneFiles<'_> {
    fn colors(&self, name: &str) -> Result<ColorModel, String> {
        let path = resolve(self.folder, name);
        let text = read_text(&path).map_err(|error| format!("{error:#}"))?;
        ColorModel::from_text(&text).map_err(|error| format!("{}: {error}", path.shown()))
    }

    fn mask(&self, name: &str, (width, height): (usize, usize)) -> Result<Mask, String> {
        let path = resolve(self.folder, name);
        let grey = decode_mask(&path).map_err(|error| format!("{error:#}"))?;
        if grey.size_px() != (width, height) {
            return Err(format!(
                "{}: the mask is {} x {} pixels, the images are {width} x {height}; they must agree",
                path.shown(),
                grey.width(),
                grey.height()
            ));
        }
        Mask::from_grey(width, height, grey.as_raw())
            .map_err(|error| format!("{}: {error}", path.shown()))
    }

    fn start_of_track(&self, start: &TrackStart) -> Result<(GaussianStart, f64), String> {
        let path = resolve(self.folder, &start.file);
        track_start::read(start, &path, self.first_time_s).map_err(|error| format!("{error:#}"))
    }
}
