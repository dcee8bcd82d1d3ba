//! Between NumPy arrays and the library's types.

use std::borrow::Cow;
use std::sync::Arc;

use numpy::ndarray::{Array2, s};
use numpy::{
    AllowTypeChange, IntoPyArray, PyArray1, PyArray2, PyArrayLike2, PyArrayLike3, TypeMustMatch,
};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use pardalis::camera::{Pose, pose_from_matrix};
use pardalis::platform::PoseCovariance;
use pardalis::tracker::ImageBox;
use pardalis::{Error, Frame};

/// An image: height x width x 3 bytes, red, green and blue.
pub(crate) type Image<'py> = PyArrayLike3<'py, u8, TypeMustMatch>;

/// Numbers in rows.
type Numbers<'py> = PyArrayLike2<'py, f64, AllowTypeChange>;

/// Whether each pixel is meant: height x width.
pub(crate) type Pixels<'py> = PyArrayLike2<'py, bool, TypeMustMatch>;

/// An array of another type or number of dimensions than is wanted.
fn is_no(what: &str, wanted: &str) -> PyErr {
    PyValueError::new_err(format!("{what} is no array of {wanted}"))
}

/// An argument as an image.
pub(crate) fn image<'py>(image: &Bound<'py, PyAny>, what: &str) -> PyResult<Image<'py>> {
    let wanted = "height x width x 3 bytes (numpy.uint8)";
    image.extract().map_err(|_| is_no(what, wanted))
}

/// An argument as a mask.
pub(crate) fn pixels<'py>(mask: &Bound<'py, PyAny>, what: &str) -> PyResult<Pixels<'py>> {
    let wanted = "height x width booleans; of other numbers: mask > 0";
    mask.extract().map_err(|_| is_no(what, wanted))
}

/// Copies an image into a frame: while it is tracked, Python may write into the array.
///
/// The bytes of the frame before are used again if they are as many and nobody has that any more: new memory takes longer than the copy.
pub(crate) fn frame(image: &Image, time_s: f64, before: &mut Arc<[u8]>) -> PyResult<Frame> {
    let image = image.as_array();
    let (height, width, channels) = image.dim();
    if channels != 3 {
        return Err(PyValueError::new_err(format!(
            "the image has {channels} channels; allowed: 3, red, green and blue"
        )));
    }
    if Arc::get_mut(before).is_none_or(|bytes| bytes.len() != image.len()) {
        *before = std::iter::repeat_n(0, image.len()).collect();
    }
    let bytes = Arc::get_mut(before).expect("nobody else has it");
    // Images of OpenCV are turned around with image[..., ::-1].
    let turned = image.slice(s![.., .., ..;-1]);
    if let Some(from) = image.to_slice() {
        bytes.copy_from_slice(from);
    } else if let Some(from) = turned.to_slice() {
        for (pixel, from) in bytes.as_chunks_mut().0.iter_mut().zip(from.as_chunks().0) {
            let [blue, green, red] = *from;
            *pixel = [red, green, blue];
        }
    } else {
        bytes
            .iter_mut()
            .zip(image)
            .for_each(|(byte, from)| *byte = *from);
    }
    Frame::from_rgb(width, height, Arc::clone(before), time_s).map_err(crate::value_error)
}

/// Points in rows of `N` coordinates.
pub(crate) struct Rows<'py, const N: usize>(Numbers<'py>);

impl<'py, const N: usize> Rows<'py, N> {
    /// An argument as points.
    pub(crate) fn of(points: &Bound<'py, PyAny>, what: &str) -> PyResult<Self> {
        let wanted = format!("N x {N} numbers");
        let points: Numbers = points.extract().map_err(|_| is_no(what, &wanted))?;
        let columns = points.as_array().ncols();
        if columns != N {
            return Err(PyValueError::new_err(format!(
                "{what} has {columns} columns; allowed: {N}"
            )));
        }
        Ok(Self(points))
    }

    /// The points: those of the array itself, or copies if they are elsewhere in memory one by one, as in views.
    pub(crate) fn get(&self) -> Cow<'_, [[f64; N]]> {
        let points = self.0.as_array();
        if let Some(numbers) = points.to_slice() {
            return Cow::Borrowed(numbers.as_chunks().0);
        }
        let rows = points.rows().into_iter();
        Cow::Owned(rows.map(|row| std::array::from_fn(|i| row[i])).collect())
    }
}

/// Boxes in rows of left, top, right and bottom side, and a score if there are five columns.
pub(crate) fn boxes(boxes: &Bound<'_, PyAny>, what: &str) -> PyResult<Vec<ImageBox>> {
    let wanted = "N x 4 numbers, or N x 5 with scores";
    // An empty list has no columns.
    if boxes.len().is_ok_and(|count| count == 0) {
        return Ok(Vec::new());
    }
    let boxes: Numbers = boxes.extract().map_err(|_| is_no(what, wanted))?;
    let boxes = boxes.as_array();
    if !matches!(boxes.ncols(), 4 | 5) {
        let columns = boxes.ncols();
        return Err(PyValueError::new_err(format!(
            "{what} has {columns} columns; allowed: 4, or 5 with scores"
        )));
    }
    let rows = boxes.rows();
    let found = rows.into_iter().enumerate().map(|(number, row)| {
        let found = ImageBox::new(std::array::from_fn(|side| row[side]));
        let found = found.and_then(|found| match row.get(4) {
            Some(&score) => found.with_score(score),
            None => Ok(found),
        });
        found.map_err(|error| PyValueError::new_err(format!("{what}[{number}]: {error}")))
    });
    found.collect()
}

/// Rows as an array, without a copy.
pub(crate) fn array<const N: usize>(
    py: Python<'_>,
    rows: Vec<[f64; N]>,
) -> Bound<'_, PyArray2<f64>> {
    let array = Array2::from_shape_vec((rows.len(), N), rows.into_flattened());
    array.expect("N numbers per row").into_pyarray(py)
}

/// A vector as an array.
pub(crate) fn vector<const N: usize>(py: Python<'_>, vector: [f64; N]) -> Bound<'_, PyArray1<f64>> {
    PyArray1::from_slice(py, &vector)
}

/// A pose from a 4 x 4 matrix.
pub(crate) fn pose(matrix: &Bound<'_, PyAny>) -> PyResult<Pose> {
    let rows = Rows::<4>::of(matrix, "the pose matrix")?.get().into_owned();
    let rows: [[f64; 4]; 4] = rows.try_into().map_err(|rows: Vec<_>| {
        let count = rows.len();
        let error = Error::out_of_range("the pose matrix", format!("{count} rows"), "4 rows");
        crate::value_error(error)
    })?;
    pose_from_matrix(rows).map_err(crate::value_error)
}

/// A 6 x 6 covariance of position and rotation; that of an exact pose without one.
pub(crate) fn pose_covariance(matrix: Option<&Bound<'_, PyAny>>) -> PyResult<PoseCovariance> {
    let Some(matrix) = matrix else {
        return Ok(PoseCovariance::zero());
    };
    let rows = Rows::<6>::of(matrix, "the covariance")?.get().into_owned();
    let rows: [[f64; 6]; 6] = rows.try_into().map_err(|rows: Vec<_>| {
        let count = rows.len();
        let error = Error::out_of_range("the covariance", format!("{count} rows"), "6 rows");
        crate::value_error(error)
    })?;
    PoseCovariance::from_matrix(rows).map_err(crate::value_error)
}

/// The 4 x 4 matrix of a pose.
pub(crate) fn matrix<'py>(py: Python<'py>, pose: &Pose) -> Bound<'py, PyArray2<f64>> {
    let matrix = pose.to_homogeneous();
    Array2::from_shape_fn((4, 4), |(i, j)| matrix[(i, j)]).into_pyarray(py)
}
