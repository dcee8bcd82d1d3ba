//! Folders of MCAP recordings, by the names of their files.

use std::fs;
use std::path::{Path, PathBuf};

use crate::output::Shown;

/// Returns the names of the MCAP recordings in a folder, for messages; `None` if there are none. Bags of ROS 2 are such folders.
pub(crate) fn recordings_in(folder: &Path) -> Option<String> {
    let paths = fs::read_dir(folder)
        .ok()?
        .flatten()
        .map(|entry| entry.path());
    let is_recording = |path: &PathBuf| path.extension().is_some_and(|suffix| suffix == "mcap");
    let mut names: Vec<String> = paths
        .filter(is_recording)
        .map(|path| path.shown())
        .collect();
    names.sort();
    (!names.is_empty()).then(|| names.join(", "))
}
