//! Shapes and targets.

use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::color::ColorModel;
use crate::value_error;
use pardalis::shape::{Flat, Section, Sphere, SphereOutline, Upright, UprightOutline};
use pardalis::tracker::{DetectedSettings, SizeTolerance, TargetSettings};

/// The shape and size of a body. All but balls stand on the ground, or lie at a height above it.
#[pyclass(frozen, module = "pardalis")]
#[derive(Debug, Clone, Copy)]
pub(crate) struct Shape(pardalis::shape::Shape);

impl Shape {
    fn upright(section: Result<Section, pardalis::Error>, height_m: f64) -> PyResult<Self> {
        let body =
            section.and_then(|section| Upright::new(section, height_m, UprightOutline::Exact));
        body.map(|body| Self(pardalis::shape::Shape::Upright(body)))
            .map_err(value_error)
    }
}

#[pymethods]
impl Shape {
    /// Return a ball.
    #[staticmethod]
    fn ball(radius_m: f64) -> PyResult<Self> {
        let ball = Sphere::new(radius_m, SphereOutline::Tangent).map_err(value_error)?;
        Ok(Self(pardalis::shape::Shape::Sphere(ball)))
    }

    /// Return an upright cylinder.
    #[staticmethod]
    fn cylinder(radius_m: f64, height_m: f64) -> PyResult<Self> {
        Self::upright(Section::circle(radius_m), height_m)
    }

    /// Return a box of this length, width and height.
    #[staticmethod]
    fn r#box(size_m: [f64; 3]) -> PyResult<Self> {
        let [length_m, width_m, height_m] = size_m;
        Self::upright(Section::rectangle([length_m, width_m]), height_m)
    }

    /// Return a horizontal disc at a height above the ground.
    #[staticmethod]
    #[pyo3(signature = (radius_m, height_m=0.0))]
    fn disc(radius_m: f64, height_m: f64) -> PyResult<Self> {
        let disc = Flat::disc(radius_m, height_m).map_err(value_error)?;
        Ok(Self(pardalis::shape::Shape::Flat(disc)))
    }

    /// Return a horizontal rectangle, length x width, at a height above the ground.
    #[staticmethod]
    #[pyo3(signature = (size_m, height_m=0.0))]
    fn rectangle(size_m: [f64; 2], height_m: f64) -> PyResult<Self> {
        let rectangle = Flat::rectangle(size_m, height_m).map_err(value_error)?;
        Ok(Self(pardalis::shape::Shape::Flat(rectangle)))
    }

    /// Its greatest extent, metres.
    #[getter]
    fn diameter_m(&self) -> f64 {
        self.0.diameter_m()
    }

    fn __repr__(&self) -> String {
        format!("<Shape {:.4} m across>", self.0.diameter_m())
    }
}

/// What is to be tracked: a body of some shape and colours, which the tracker finds by itself.
///
/// `radius_tolerance` is the standard deviation of a ball's radius as a share of it, or `None` if the radius is a guess that several
/// cameras are to improve. `turns` says whether a box or rectangle turns about the vertical; `ground_z_m` is the height of the ground
/// for all shapes but balls. With `max_count`, the target is any number of bodies that look alike, of which as many are tracked at once
/// (`Tracker.members`).
#[pyclass(frozen, module = "pardalis")]
#[derive(Debug, Clone)]
pub(crate) struct Target {
    settings: DetectedSettings,
    most: Option<usize>,
}

impl Target {
    pub(crate) fn is_crowd(&self) -> bool {
        self.most.is_some()
    }

    pub(crate) fn settings(&self) -> TargetSettings {
        let settings = self.settings.clone();
        match self.most {
            Some(most) => TargetSettings::crowd(settings, most),
            None => settings.into(),
        }
    }
}

#[pymethods]
impl Target {
    #[new]
    #[pyo3(signature = (
        shape,
        colors,
        *,
        radius_tolerance=Some(SizeTolerance::DEFAULT_SHARE),
        turns=true,
        ground_z_m=0.0,
        particle_count=DetectedSettings::PARTICLE_COUNT,
        max_count=None,
    ), text_signature = "(shape, colors, *, radius_tolerance=0.02, turns=True, ground_z_m=0.0, particle_count=500, max_count=None)")]
    fn new(
        shape: PyRef<Shape>,
        colors: PyRef<ColorModel>,
        radius_tolerance: Option<f64>,
        turns: bool,
        ground_z_m: f64,
        particle_count: usize,
        max_count: Option<usize>,
    ) -> PyResult<Self> {
        if max_count.is_some_and(|most| !(1..=1000).contains(&most)) {
            return Err(PyValueError::new_err(
                "max_count is out of range; allowed: 1 to 1000, or None for one target",
            ));
        }
        if radius_tolerance.is_some_and(|share| !(0.0..=1.0).contains(&share)) {
            return Err(PyValueError::new_err(
                "radius_tolerance is out of range; allowed: 0 to 1, or None for a radius that is a guess",
            ));
        }
        let mut settings = DetectedSettings::new(shape.0, colors.0.clone());
        settings.size = radius_tolerance.map_or(SizeTolerance::Unknown, SizeTolerance::Share);
        settings.turns = turns;
        settings.existence.ground_z_m = ground_z_m;
        settings.particle_count = particle_count;
        Ok(Self {
            settings,
            most: max_count,
        })
    }

    fn __repr__(&self) -> String {
        format!("<Target {:.4} m across>", self.settings.shape.diameter_m())
    }
}
