//! Cameras.

use std::path::PathBuf;

use nalgebra::{Point3, Vector3};
use numpy::PyArray2;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::arrays;
use crate::{in_file, read_text, value_error};
use pardalis::View;
use pardalis::camera::{
    Camera as Lens, Equidistant, KannalaBrandt, Level, Mask, Pinhole, Pose, looking_at,
};
use pardalis_scene::calibration;

/// A camera: its lens, the size of its images (width, height), its pose and the pixels that count.
///
/// Without a pose the camera's frame is the world's: x right, y down, z ahead. `at` and `looking` place it.
#[pyclass(frozen, module = "pardalis")]
#[derive(Debug, Clone)]
pub(crate) struct Camera {
    lens: Lens,
    size_px: (usize, usize),
    world_from_camera: Pose,
    mask: Option<Mask>,
}

impl Camera {
    fn of(lens: impl Into<Lens>, size_px: (usize, usize)) -> PyResult<Self> {
        let camera = Self {
            lens: lens.into(),
            size_px,
            world_from_camera: Pose::identity(),
            mask: None,
        };
        camera.view()?;
        Ok(camera)
    }

    /// The camera as the tracker takes it.
    pub(crate) fn view(&self) -> PyResult<View> {
        let view = View::new(
            self.lens.clone(),
            self.world_from_camera,
            self.size_px,
            self.mask.clone(),
        );
        view.map_err(value_error)
    }
}

#[pymethods]
impl Camera {
    /// Return a camera with a usual lens.
    ///
    /// `f_px` are the focal lengths and `center_px` the principal point, each along x and y. `distortion` are 0, 4,
    /// 5, 8 or 12 coefficients in OpenCV's order (k1 k2 p1 p2 k3 ...).
    #[staticmethod]
    #[pyo3(signature = (size_px, f_px, center_px, distortion=Vec::new()))]
    fn pinhole(
        size_px: [usize; 2],
        f_px: [f64; 2],
        center_px: [f64; 2],
        distortion: Vec<f64>,
    ) -> PyResult<Self> {
        let lens = Pinhole::new(f_px, center_px, &distortion).map_err(value_error)?;
        Self::of(lens, size_px.into())
    }

    /// Return a fisheye in which the distance from the principal point is proportional to the angle from the axis.
    ///
    /// Rays beyond `max_angle_rad` from the axis have no pixel.
    #[staticmethod]
    fn equidistant(
        size_px: [usize; 2],
        f_px_per_rad: f64,
        center_px: [f64; 2],
        max_angle_rad: f64,
    ) -> PyResult<Self> {
        let lens = Equidistant::new(f_px_per_rad, center_px, max_angle_rad);
        Self::of(lens.map_err(value_error)?, size_px.into())
    }

    /// Return a fisheye with the four coefficients `k` of OpenCV's fisheye module (Kannala-Brandt).
    ///
    /// Rays beyond `max_angle_rad` from the axis have no pixel.
    #[staticmethod]
    #[pyo3(signature = (size_px, f_px, center_px, k, max_angle_rad=std::f64::consts::PI))]
    fn fisheye(
        size_px: [usize; 2],
        f_px: [f64; 2],
        center_px: [f64; 2],
        k: [f64; 4],
        max_angle_rad: f64,
    ) -> PyResult<Self> {
        let lens = KannalaBrandt::new(f_px, center_px, k, max_angle_rad);
        Self::of(lens.map_err(value_error)?, size_px.into())
    }

    /// Read all cameras of a calibration file, by name: of OpenCV, ROS, Kalibr, OCamCalib, Basalt or Pardalis.
    ///
    /// `size_px` is needed if the file does not say how large the images are.
    #[staticmethod]
    #[pyo3(signature = (path, size_px=None))]
    fn read_all(
        py: Python<'_>,
        path: PathBuf,
        size_px: Option<[usize; 2]>,
    ) -> PyResult<Bound<'_, PyDict>> {
        let text = read_text(&path)?;
        let cameras = PyDict::new(py);
        for found in calibration::read(&text, None).map_err(|error| in_file(&path, error))? {
            let Some(size_px) = size_px.map(Into::into).or(found.size_px) else {
                let name = &found.name;
                let error =
                    format!("does not say how large the images of \"{name}\" are; give size_px");
                return Err(in_file(&path, error));
            };
            if let Some(in_file_px) = found.size_px.filter(|in_file_px| *in_file_px != size_px) {
                let error =
                    format!("says that images are {in_file_px:?}, and size_px is {size_px:?}");
                return Err(in_file(&path, error));
            }
            let mut camera = Self::of(found.camera, size_px)?;
            camera.world_from_camera = found.world_from_camera.unwrap_or(camera.world_from_camera);
            cameras.set_item(found.name, camera)?;
        }
        Ok(cameras)
    }

    /// Read the camera of a calibration file that has a single one; see `read_all`.
    #[staticmethod]
    #[pyo3(signature = (path, size_px=None))]
    fn read(
        py: Python<'_>,
        path: PathBuf,
        size_px: Option<[usize; 2]>,
    ) -> PyResult<Bound<'_, PyAny>> {
        let cameras = Self::read_all(py, path.clone(), size_px)?;
        if cameras.len() != 1 {
            let names: Vec<String> = cameras.keys().extract()?;
            let error = format!(
                "has {} cameras ({}); use read_all",
                names.len(),
                names.join(", ")
            );
            return Err(in_file(&path, error));
        }
        cameras.values().get_item(0)
    }

    /// Return the camera at this pose: a 4 x 4 matrix from camera to world coordinates, metres.
    fn at(&self, world_from_camera: &Bound<'_, PyAny>) -> PyResult<Self> {
        Ok(Self {
            world_from_camera: arrays::pose(world_from_camera)?,
            ..self.clone()
        })
    }

    /// Return the camera at a point, looking at another, upright or turned counter-clockwise by `roll_rad`.
    #[pyo3(signature = (from_m, at_m, roll_rad=0.0))]
    fn looking(&self, from_m: [f64; 3], at_m: [f64; 3], roll_rad: f64) -> PyResult<Self> {
        let pose = looking_at(Vector3::from(from_m), Vector3::from(at_m), roll_rad);
        let world_from_camera = pose
            .filter(|pose| pose.to_homogeneous().iter().all(|value| value.is_finite()))
            .ok_or_else(|| {
                PyValueError::new_err(
                    "from_m and at_m determine no direction; allowed: two different points of finite numbers",
                )
            })?;
        Ok(Self {
            world_from_camera,
            ..self.clone()
        })
    }

    /// Return the camera with a mask: height x width booleans, true where pixels count.
    fn masked(&self, open: &Bound<'_, PyAny>) -> PyResult<Self> {
        let open = arrays::pixels(open, "open")?;
        let open = open.as_array();
        let (height, width) = open.dim();
        let grey: Vec<u8> = open
            .iter()
            .map(|&open| if open { 255 } else { 0 })
            .collect();
        let camera = Self {
            mask: Some(Mask::from_grey(width, height, &grey).map_err(value_error)?),
            ..self.clone()
        };
        camera.view()?;
        Ok(camera)
    }

    /// The name of the lens model, as in scene files.
    #[getter]
    fn model(&self) -> &'static str {
        self.lens.kind()
    }

    /// Width and height of the images.
    #[getter]
    fn size_px(&self) -> (usize, usize) {
        self.size_px
    }

    /// The parameters of the lens model, by name.
    #[getter]
    fn parameters<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let parameters = PyDict::new(py);
        for (name, value) in self.lens.parameters() {
            parameters.set_item(name, value)?;
        }
        Ok(parameters)
    }

    /// The pose: a 4 x 4 matrix from camera to world coordinates, metres.
    #[getter]
    fn world_from_camera<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        arrays::matrix(py, &self.world_from_camera)
    }

    /// Return the pixels (N x 2) of points in the world (N x 3, metres). Points that the lens does not see have NaN.
    ///
    /// A pixel may lie outside the image.
    fn project<'py>(
        &self,
        py: Python<'py>,
        points_m: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let points = arrays::Rows::of(points_m, "points_m")?;
        let points_m = points.get();
        let mut pixels = vec![[0.0; 2]; points_m.len()];
        py.detach(|| {
            let camera_from_world = self.world_from_camera.inverse();
            let level = Level::best();
            self.lens
                .project_rows(level, &camera_from_world, &points_m, &mut pixels);
        });
        Ok(arrays::array(py, pixels))
    }

    /// Return the rays of pixels (N x 2): their origins (N x 3, metres) and unit directions (N x 3) in the world. Pixels without a
    /// ray have NaN.
    fn rays<'py>(
        &self,
        py: Python<'py>,
        pixels: &Bound<'py, PyAny>,
    ) -> PyResult<[Bound<'py, PyArray2<f64>>; 2]> {
        let pixels = arrays::Rows::of(pixels, "pixels")?;
        let pixels = pixels.get();
        let (origins, directions): (Vec<_>, Vec<_>) = py.detach(|| {
            let ray = |pixel: &[f64; 2]| {
                let Some(ray) = self.lens.unproject(*pixel) else {
                    return ([f64::NAN; 3], [f64::NAN; 3]);
                };
                let origin = self.world_from_camera * Point3::from(ray.origin);
                let direction = self.world_from_camera.rotation * Vector3::from(ray.direction);
                (origin.into(), direction.into())
            };
            pixels.iter().map(ray).unzip()
        });
        Ok([arrays::array(py, origins), arrays::array(py, directions)])
    }

    fn __repr__(&self) -> String {
        let (width, height) = self.size_px;
        format!("<Camera {} {width}x{height}>", self.lens.kind())
    }
}
