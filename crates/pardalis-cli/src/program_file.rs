//! The file that the program is in: its own, or the library of the Python package.

use std::path::{Path, PathBuf};
use std::sync::OnceLock;

static FILE: OnceLock<PathBuf> = OnceLock::new();

/// Sets the file that the program is in.
pub(crate) fn set(file: PathBuf) {
    // The first stays if the program runs again in one process.
    let _ = FILE.set(file);
}

/// Returns the file that the program is in, if that is known.
pub(crate) fn get() -> Option<&'static Path> {
    FILE.get().map(PathBuf::as_path)
}
