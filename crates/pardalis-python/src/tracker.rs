//! The tracker.

use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::arrays;
use crate::camera::Camera;
use crate::estimate::Estimate;
use crate::target::Target;
use crate::value_error;
use pardalis::tracker::Observed;
use pardalis::{CameraId, FrameSet, TargetId};

/// Tracks targets in the images of cameras, both by name.
///
/// Pass each image, or all that were taken at the same instant, to `observe`; then ask for `estimate`. Trackers in several threads run at
/// the same time; a single one is for one thread at a time.
#[pyclass(module = "pardalis")]
pub(crate) struct Tracker {
    tracker: pardalis::Tracker,
    cameras: Vec<String>,
    targets: Vec<String>,
    /// Whether each target is a crowd.
    are_crowds: Vec<bool>,
    /// Whether each target is detected by another program.
    are_boxed: Vec<bool>,
}

/// The position of a name in a list; what is called such is named in the error.
fn position(names: &[String], what: &str, name: &str) -> PyResult<usize> {
    let found = names.iter().position(|known| known == name);
    found.ok_or_else(|| {
        let known = names.join(", ");
        PyValueError::new_err(format!("there is no {what} \"{name}\"; allowed: {known}"))
    })
}

/// The value of a dictionary has another type.
fn is_no(what: &str, name: &Bound<'_, PyAny>, wanted: &str) -> PyErr {
    PyTypeError::new_err(format!("{what}[\"{name}\"] is no {wanted}"))
}

impl Tracker {
    fn target_id(&self, target: &str) -> PyResult<TargetId> {
        position(&self.targets, "target", target).map(TargetId::new)
    }

    /// The time for which estimates are asked.
    fn time_or_latest(&self, time_s: Option<f64>) -> PyResult<f64> {
        let latest_s = self.tracker.time_s();
        match (time_s, latest_s) {
            (Some(time_s), Some(latest_s)) if time_s < latest_s => {
                Err(PyValueError::new_err(format!(
                    "time_s is {time_s}; allowed: {latest_s}, that of the latest images, or later"
                )))
            }
            _ => Ok(time_s.or(latest_s).unwrap_or(0.0)),
        }
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
        let (mut are_crowds, mut are_boxed) = (Vec::new(), Vec::new());
        for (name, camera) in cameras {
            camera_names.push(name.extract()?);
            let camera = camera
                .cast::<Camera>()
                .map_err(|_| is_no("cameras", &name, "Camera"))?;
            setup.camera(camera.get().view()?);
        }
        for (name, target) in targets {
            target_names.push(name.extract()?);
            let target = target
                .cast::<Target>()
                .map_err(|_| is_no("targets", &name, "Target"))?;
            setup.target(target.get().settings());
            are_crowds.push(target.get().is_crowd());
            are_boxed.push(target.get().is_boxed());
        }
        Ok(Self {
            tracker: setup.build().map_err(value_error)?,
            cameras: camera_names,
            targets: target_names,
            are_crowds,
            are_boxed,
        })
    }

    /// Observe the images (height x width x 3 bytes) of one camera or several, by name, that were taken at the same time in seconds.
    ///
    /// Each time must be later than the one before. Without images, targets are only predicted. `boxes` are what another program detected in the images of this time, by camera and
    /// then by target, of targets of `Target.of_boxes`: rows of left, top, right, bottom and, if there is one, score (N x 4 or N x 5). Pixel centres have integer coordinates.
    /// No rows say that nothing was found; cameras that are left out were not looked at. A camera with boxes needs no image.
    #[pyo3(signature = (images, time_s, boxes=None))]
    fn observe(
        &mut self,
        py: Python<'_>,
        images: &Bound<'_, PyDict>,
        time_s: f64,
        boxes: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<()> {
        let mut frames = Vec::with_capacity(images.len());
        for (name, image) in images {
            let name: String = name.extract()?;
            let camera = position(&self.cameras, "camera", &name)?;
            let image = arrays::image(&image, &format!("the image of \"{name}\""))?;
            let frame = arrays::frame(&image, time_s)?;
            frames.push((CameraId::new(camera), frame));
        }
        let set = if frames.is_empty() {
            FrameSet::without_frames(time_s)
        } else {
            FrameSet::new(frames)
        };
        let mut set = set.map_err(value_error)?;
        for (name, of_camera) in boxes.into_iter().flatten() {
            let of_camera = of_camera
                .cast::<PyDict>()
                .map_err(|_| is_no("boxes", &name, "dictionary of targets"))?;
            let name: String = name.extract()?;
            let camera = CameraId::new(position(&self.cameras, "camera", &name)?);
            for (target, found) in of_camera {
                let target_name: String = target.extract()?;
                let target = self.target_id(&target_name)?;
                if !self.are_boxed[target.index()] {
                    return Err(PyValueError::new_err(format!(
                        "\"{target_name}\" is found in the images; pass boxes of targets of Target.of_boxes"
                    )));
                }
                let what = format!("boxes[\"{name}\"][\"{target_name}\"]");
                let found = arrays::boxes(&found, &what)?;
                set = set.with_boxes(camera, target, found).map_err(value_error)?;
            }
        }
        match py.detach(|| self.tracker.observe(&set)) {
            Ok(Observed::Used) => Ok(()),
            Ok(Observed::Repeated) => Err(PyValueError::new_err(format!(
                "images of {time_s} s were observed before; pass images that were taken at the same time together"
            ))),
            Err(error) => Err(value_error(error)),
        }
    }

    /// Return the estimate of a target, at the time of the latest images or predicted for a later time.
    #[pyo3(signature = (target, time_s=None))]
    fn estimate(&self, target: &str, time_s: Option<f64>) -> PyResult<Estimate> {
        let time_s = self.time_or_latest(time_s)?;
        let known = self.tracker.estimate_at(self.target_id(target)?, time_s);
        Ok(Estimate {
            known: known.map_err(value_error)?,
            time_s,
            number: None,
        })
    }

    /// Return the members of a target with `max_count`, each with its number.
    ///
    /// A member that is lost keeps its number for up to three seconds.
    #[pyo3(signature = (target, time_s=None))]
    fn members(&self, target: &str, time_s: Option<f64>) -> PyResult<Vec<Estimate>> {
        let time_s = self.time_or_latest(time_s)?;
        let target = self.target_id(target)?;
        if !self.are_crowds[target.index()] {
            return Err(PyValueError::new_err(format!(
                "\"{}\" is a single target; give it max_count, or ask for estimate",
                self.targets[target.index()]
            )));
        }
        let members = self.tracker.members_at(target, time_s);
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
