//! Images as the program reads them.

use std::path::PathBuf;

use numpy::ndarray::Array3;
use numpy::{IntoPyArray, PyArray3};
use pyo3::prelude::*;

use crate::{in_file, os_error};

/// Read a JPEG or PNG image as the program does: height x width x 3 bytes, red, green and blue, upright according to its EXIF data.
///
/// Other libraries decode JPEG a little differently, so that colours learnt from their images differ from those of `pardalis learn`.
#[pyfunction]
pub(crate) fn read_image(py: Python<'_>, path: PathBuf) -> PyResult<Bound<'_, PyArray3<u8>>> {
    let bytes = std::fs::read(&path).map_err(|error| os_error(&path, &error))?;
    let image = py
        .detach(|| pardalis_images::decode(&bytes))
        .map_err(|error| in_file(&path, error))?;
    let (width, height) = image.size_px();
    let pixels = Array3::from_shape_vec((height, width, 3), image.into_raw());
    let pixels = pixels.expect("three bytes per pixel");
    Ok(pixels.into_pyarray(py))
}
