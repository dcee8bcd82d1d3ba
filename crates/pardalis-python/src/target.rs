//! Shapes and targets.

use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::color::ColorModel;
use crate::value_error;
use pardalis::filter::bernoulli::ParticleRange;
use pardalis::filter::motion::{ConstantVelocity, Motion, VelocityNoise};
use pardalis::shape::{Flat, Section, Sphere, SphereOutline, Upright, UprightOutline};
use pardalis::tracker::{
    BoxedSettings, DetectedSettings, DetectorSettings, SizeTolerance, TargetSettings,
};

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
/// for all shapes but balls. There are `particle_count` particles or, with `min_particle_count`, as many of them as an image needs: fewer are
/// faster, and velocities noisier. With `max_count`, the target is any number of bodies that look alike, of which as many are tracked at once
/// (`Tracker.members`).
#[pyclass(frozen, module = "pardalis")]
#[derive(Debug, Clone)]
pub(crate) struct Target {
    body: Body,
    most: Option<usize>,
}

#[derive(Debug, Clone)]
#[allow(clippy::large_enum_variant)] // settings are few, and made once
enum Body {
    Detected(DetectedSettings),
    Boxed(BoxedSettings),
}

impl Target {
    pub(crate) fn is_crowd(&self) -> bool {
        self.most.is_some()
    }

    /// Whether it takes boxes of another program.
    pub(crate) fn takes_boxes(&self) -> bool {
        match &self.body {
            Body::Detected(body) => body.detector.is_some(),
            Body::Boxed(_) => true,
        }
    }

    pub(crate) fn settings(&self) -> TargetSettings {
        match (self.body.clone(), self.most) {
            (Body::Detected(body), Some(most)) => TargetSettings::crowd(body, most),
            (Body::Detected(body), None) => body.into(),
            (Body::Boxed(body), Some(most)) => TargetSettings::boxed_crowd(body, most),
            (Body::Boxed(body), None) => body.into(),
        }
    }
}

/// Fails if a target cannot have this many members.
fn check_most(most: Option<usize>) -> PyResult<()> {
    if most.is_some_and(|most| !(1..=1000).contains(&most)) {
        return Err(PyValueError::new_err(
            "max_count is out of range; allowed: 1 to 1000, or None for one target",
        ));
    }
    Ok(())
}

/// Returns the range of the numbers of particles.
fn particles(max: usize, min: Option<usize>) -> ParticleRange {
    ParticleRange {
        min: min.unwrap_or(max),
        max,
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
        particle_count=DetectedSettings::PARTICLES.max,
        min_particle_count=None,
        max_count=None,
    ), text_signature = "(shape, colors, *, radius_tolerance=0.02, turns=True, ground_z_m=0.0, particle_count=500, min_particle_count=None, max_count=None)")]
    #[allow(clippy::too_many_arguments)] // by name
    fn new(
        shape: PyRef<Shape>,
        colors: PyRef<ColorModel>,
        radius_tolerance: Option<f64>,
        turns: bool,
        ground_z_m: f64,
        particle_count: usize,
        min_particle_count: Option<usize>,
        max_count: Option<usize>,
    ) -> PyResult<Self> {
        check_most(max_count)?;
        if radius_tolerance.is_some_and(|share| !(0.0..=1.0).contains(&share)) {
            return Err(PyValueError::new_err(
                "radius_tolerance is out of range; allowed: 0 to 1, or None for a radius that is a guess",
            ));
        }
        let mut settings = DetectedSettings::new(shape.0, colors.0.clone());
        settings.size = radius_tolerance.map_or(SizeTolerance::Unknown, SizeTolerance::Share);
        settings.turns = turns;
        settings.existence.ground_z_m = ground_z_m;
        settings.particles = particles(particle_count, min_particle_count);
        Ok(Self {
            body: Body::Detected(settings),
            most: max_count,
        })
    }

    /// Return a target that another program detects, such as a neural network: pass the boxes that it finds to `Tracker.observe`. Neither colours nor images are needed.
    ///
    /// `detection_probability` is how often the detector finds a target that nothing hides, and `false_per_image` the mean number of boxes in an image that are no target.
    /// `side_sigma` is the standard deviation of each side of a box as a share of the square root of its area, and `size_tolerance` that of errors of the size that all images
    /// share. Boxes with a score below `min_score` are left out. `acceleration_density_m2ps3` says how much the velocity changes, by its root in m/s in a second: by default 1 for what
    /// stands on the ground, and 20 with sudden changes for balls.
    #[staticmethod]
    #[pyo3(signature = (
        shape,
        *,
        detection_probability=0.9,
        false_per_image=0.5,
        side_sigma=0.05,
        size_tolerance=0.05,
        min_score=0.0,
        acceleration_density_m2ps3=None,
        ground_z_m=0.0,
        particle_count=DetectedSettings::PARTICLES.max,
        min_particle_count=None,
        max_count=None,
    ), text_signature = "(shape, *, detection_probability=0.9, false_per_image=0.5, side_sigma=0.05, size_tolerance=0.05, min_score=0.0, acceleration_density_m2ps3=None, ground_z_m=0.0, particle_count=500, min_particle_count=None, max_count=None)")]
    #[allow(clippy::too_many_arguments)] // by name
    fn of_boxes(
        shape: PyRef<Shape>,
        detection_probability: f64,
        false_per_image: f64,
        side_sigma: f64,
        size_tolerance: f64,
        min_score: f64,
        acceleration_density_m2ps3: Option<f64>,
        ground_z_m: f64,
        particle_count: usize,
        min_particle_count: Option<usize>,
        max_count: Option<usize>,
    ) -> PyResult<Self> {
        check_most(max_count)?;
        let mut settings = BoxedSettings::new(shape.0);
        settings.detector.detection_probability = detection_probability;
        settings.detector.false_per_image = false_per_image;
        settings.detector.side_sigma = side_sigma;
        settings.detector.size_tolerance = size_tolerance;
        settings.detector.min_score = min_score;
        settings.detector.check().map_err(value_error)?;
        if let Some(acceleration_density_m2ps3) = acceleration_density_m2ps3 {
            let noise = VelocityNoise::White {
                acceleration_density_m2ps3,
            };
            let motion: Motion = ConstantVelocity::new(noise).map_err(value_error)?.into();
            settings.motion = if settings.motion.is_planar() {
                motion.in_plane()
            } else {
                motion
            };
        }
        settings.existence.ground_z_m = ground_z_m;
        settings.particles = particles(particle_count, min_particle_count);
        Ok(Self {
            body: Body::Boxed(settings),
            most: max_count,
        })
    }

    /// Return the same target with boxes of another program, such as a neural network, beside its colours: pass them to `Tracker.observe`. They tell it from other things that
    /// look like it, and where to look for it; edges tell where it is. The arguments are those of `of_boxes`.
    #[pyo3(signature = (*, detection_probability=0.9, false_per_image=0.5, side_sigma=0.05, min_score=0.0))]
    fn with_boxes(
        &self,
        detection_probability: f64,
        false_per_image: f64,
        side_sigma: f64,
        min_score: f64,
    ) -> PyResult<Self> {
        let (Body::Detected(body), None) = (&self.body, self.most) else {
            return Err(PyValueError::new_err(
                "boxes beside colours are for a single target with colours; use Target.of_boxes for boxes alone",
            ));
        };
        let mut detector = DetectorSettings::default();
        detector.detection_probability = detection_probability;
        detector.false_per_image = false_per_image;
        detector.side_sigma = side_sigma;
        detector.min_score = min_score;
        detector.check().map_err(value_error)?;
        let mut body = body.clone();
        body.detector = Some(detector);
        Ok(Self {
            body: Body::Detected(body),
            most: None,
        })
    }

    fn __repr__(&self) -> String {
        let shape = match &self.body {
            Body::Detected(body) => &body.shape,
            Body::Boxed(body) => &body.shape,
        };
        format!("<Target {:.4} m across>", shape.diameter_m())
    }
}
