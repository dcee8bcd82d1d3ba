//! The tracker.

use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::arrays::{self, Image};
use crate::camera::Camera;
use crate::estimate::Estimate;
use crate::target::Target;
use crate::value_error;
use pardalis::{CameraId, FrameSet, TargetId};

/// Tracks targets in the images of cameras, both by name.
///
/// Pass each image, or all that were taken at the same instant, to `observe`; then ask for `estimate`. Work runs without
/// Python's global lock.
#[pyclass(module = "pardalis")]
pub(crate) struct Tracker {
    tracker: pardalis::Tracker,
    cameras: Vec<String>,
    targets: Vec<String>,
}

/// The position of a name in a list; what is called such is named in the error.
fn position(names: &[String], what: &str, name: &str) -> PyResult<usize> {
    let found = names.iter().position(|known| known == name);
    found.ok_or_else(|| {
        let known = names.join(", ");
        PyValueError::new_err(format!("there is no {what} \"{name}\"; allowed: {known}"))
    })
}

impl Tracker {
    fn target_id(&self, target: &str) -> PyResult<TargetId> {
        position(&self.targets, "target", target).map(TargetId::new)
    }

    /// The time for which estimates are asked.
    fn time_or_latest(&self, time_s: Option<f64>) -> f64 {
        time_s.or(self.tracker.time_s()).unwrap_or(0.0)
    }
}

#[pymethods]
impl Tracker {
    #[new]
    #[pyo3(signature = (cameras, targets, *, seed=1))]
    fn new(cameras: &Bound<'_, PyDict>, targets: &Bound<'_, PyDict>, seed: u32) -> PyResult<Self> {
        let mut setup = pardalis::Tracker::builder();
        setup.seed(seed);
        let (mut camera_names, mut target_names) = (Vec::new(), Vec::new());
        for (name, camera) in cameras {
            camera_names.push(name.extract()?);
            setup.camera(camera.cast::<Camera>()?.get().view()?);
        }
        for (name, target) in targets {
            target_names.push(name.extract()?);
            setup.target(target.cast::<Target>()?.get().settings());
        }
        Ok(Self {
            tracker: setup.build().map_err(value_error)?,
            cameras: camera_names,
            targets: target_names,
        })
    }

    /// Observe the images (height x width x 3 bytes) of one camera or several, by name, that were taken at the same time in seconds.
    ///
    /// Times must not decrease. Without images, targets are only predicted.
    fn observe(&mut self, py: Python<'_>, images: &Bound<'_, PyDict>, time_s: f64) -> PyResult<()> {
        let mut frames = Vec::with_capacity(images.len());
        for (name, image) in images {
            let name: String = name.extract()?;
            let camera = position(&self.cameras, "camera", &name)?;
            let image: Image = image.extract().map_err(|_| {
                PyValueError::new_err(format!(
                    "the image of \"{name}\" is no array of height x width x 3 bytes (numpy.uint8)"
                ))
            })?;
            let frame = arrays::frame(&image, time_s)?;
            frames.push((CameraId::new(camera), frame));
        }
        let set = if frames.is_empty() {
            FrameSet::without_frames(time_s)
        } else {
            FrameSet::new(frames)
        };
        let set = set.map_err(value_error)?;
        py.detach(|| self.tracker.observe(&set))
            .map_err(value_error)?;
        Ok(())
    }

    /// Return the estimate of a target, at the time of the latest images or predicted for a later time.
    #[pyo3(signature = (target, time_s=None))]
    fn estimate(&self, target: &str, time_s: Option<f64>) -> PyResult<Estimate> {
        let time_s = self.time_or_latest(time_s);
        let known = self.tracker.estimate_at(self.target_id(target)?, time_s);
        Ok(Estimate {
            known: known.map_err(value_error)?,
            time_s,
            number: None,
        })
    }

    /// Return the members of a target with `max_count`, each with its number.
    #[pyo3(signature = (target, time_s=None))]
    fn members(&self, target: &str, time_s: Option<f64>) -> PyResult<Vec<Estimate>> {
        let time_s = self.time_or_latest(time_s);
        let members = self.tracker.members_at(self.target_id(target)?, time_s);
        let estimate = |member: pardalis::tracker::Member| Estimate {
            known: member.estimate,
            time_s,
            number: Some(member.number),
        };
        Ok(members.map_err(value_error)?.map(estimate).collect())
    }

    /// The time of the latest images, seconds.
    #[getter]
    fn time_s(&self) -> Option<f64> {
        self.tracker.time_s()
    }

    /// The names of the cameras.
    #[getter]
    fn cameras(&self) -> Vec<String> {
        self.cameras.clone()
    }

    /// The names of the targets.
    #[getter]
    fn targets(&self) -> Vec<String> {
        self.targets.clone()
    }

    fn __repr__(&self) -> String {
        let (cameras, targets) = (self.cameras.join(", "), self.targets.join(", "));
        format!("<Tracker of {targets} by {cameras}>")
    }
}
