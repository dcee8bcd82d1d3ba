//! Colour models.

use std::path::PathBuf;
use std::sync::Arc;

use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::arrays;
use crate::{in_file, os_error, read_text, value_error};
use pardalis::color::{ColorLearner, Palette};

/// The colours of a target, and how they change across its outline.
#[pyclass(frozen, eq, module = "pardalis")]
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct ColorModel(pub(crate) pardalis::color::ColorModel);

#[pymethods]
impl ColorModel {
    /// Learn the colours from images (height x width x 3 bytes) and masks (height x width booleans), true where an image shows the
    /// target.
    ///
    /// The masks should follow the target's outline: how sharp its edge is, is learnt as well. Two to five images from
    /// where the target will be are enough.
    #[staticmethod]
    fn learn(images: Vec<Bound<'_, PyAny>>, masks: Vec<Bound<'_, PyAny>>) -> PyResult<Self> {
        if images.len() != masks.len() {
            return Err(PyValueError::new_err(format!(
                "there are {} images and {} masks; allowed: as many of each",
                images.len(),
                masks.len()
            )));
        }
        let mut learner = ColorLearner::new(Palette::HSI).map_err(value_error)?;
        for (number, (image, mask)) in images.iter().zip(&masks).enumerate() {
            let image = arrays::image(image, &format!("images[{number}]"))?;
            let mask = arrays::pixels(mask, &format!("masks[{number}]"))?;
            let (frame, mask) = (
                arrays::frame(&image, 0.0, &mut Arc::default())?,
                mask.as_array(),
            );
            let size = (frame.height(), frame.width());
            if mask.dim() != size {
                return Err(PyValueError::new_err(format!(
                    "masks[{number}] has the shape {:?}, and its image {size:?}; allowed: the same",
                    mask.dim()
                )));
            }
            let is_target: Vec<bool> = mask.iter().copied().collect();
            learner.add(&frame, &is_target).map_err(value_error)?;
        }
        learner.learn().map(Self).map_err(value_error)
    }

    /// Read a file of `pardalis learn` or `write`.
    #[staticmethod]
    fn read(path: PathBuf) -> PyResult<Self> {
        let text = read_text(&path)?;
        let model = pardalis::color::ColorModel::from_text(&text);
        model.map(Self).map_err(|error| in_file(&path, error))
    }

    /// Write a file that scenes can name, too.
    fn write(&self, path: PathBuf) -> PyResult<()> {
        std::fs::write(&path, self.0.to_text()).map_err(|error| os_error(&path, &error))
    }

    /// The number of the target's pixels from which it was learnt.
    #[getter]
    fn pixel_count(&self) -> u64 {
        self.0.pixel_count()
    }

    /// The number of images from which it was learnt.
    #[getter]
    fn image_count(&self) -> u64 {
        self.0.image_count()
    }

    fn __repr__(&self) -> String {
        format!(
            "<ColorModel of {} pixels in {} images>",
            self.0.pixel_count(),
            self.0.image_count()
        )
    }
}
