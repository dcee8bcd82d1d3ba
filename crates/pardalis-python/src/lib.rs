//! The Python package of Pardalis: cameras, colours and the tracker, with images and points as NumPy arrays, and the program.
//!
//! What Python sees is documented in `python/pardalis/__init__.pyi`.

mod arrays;
mod camera;
mod color;
mod estimate;
mod image;
mod program;
mod target;
mod tracker;

use std::io;

use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use pardalis::Error;

/// Errors of the library are `ValueError`s with the same words.
fn value_error(error: Error) -> PyErr {
    PyValueError::new_err(error.to_string())
}

/// What went wrong in a file.
fn in_file(path: &std::path::Path, error: impl std::fmt::Display) -> PyErr {
    PyValueError::new_err(format!("{}: {error}", path.display()))
}

/// A file that cannot be read or written: an `OSError`, a `FileNotFoundError` where there is none.
fn os_error(path: &std::path::Path, error: &io::Error) -> PyErr {
    io::Error::new(error.kind(), format!("{}: {error}", path.display())).into()
}

/// Reads a text file.
fn read_text(path: &std::path::Path) -> PyResult<String> {
    std::fs::read_to_string(path).map_err(|error| os_error(path, &error))
}

#[pymodule]
mod _pardalis {
    #[pymodule_export]
    #[expect(non_upper_case_globals, reason = "its name in Python")]
    const __version__: &str = env!("CARGO_PKG_VERSION");
    #[pymodule_export]
    use super::camera::Camera;
    #[pymodule_export]
    use super::color::ColorModel;
    #[pymodule_export]
    use super::estimate::Estimate;
    #[pymodule_export]
    use super::image::read_image;
    #[pymodule_export]
    use super::program::{run_program, toml_text};
    #[pymodule_export]
    use super::target::{Shape, Target};
    #[pymodule_export]
    use super::tracker::Tracker;
}
