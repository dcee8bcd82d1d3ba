//! The tracker.

use std::collections::BTreeMap;
use std::ffi::CString;
use std::fs::File;
use std::io;
use std::path::PathBuf;
use std::sync::Arc;

use pyo3::exceptions::{PyTypeError, PyUserWarning, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::arrays;
use crate::camera::Camera;
use crate::estimate::Estimate;
use crate::target::Target;
use crate::{program, value_error};
use pardalis::platform::{Increment, ObservedMotion, OdometryErrors, Platform, StampedPose};
use pardalis::tracker::{Measurement, Observed, ObservedMeasurement, PlatformId};
use pardalis::{CameraId, FrameSet, TargetId};
use pardalis_scene::TargetConfig;

/// Tracks targets in the images of cameras, both by name.
///
/// Pass each image, or all that were taken at the same instant, to `observe`; then ask for `estimate`. Trackers in several threads run at
/// the same time; a single one is for one thread at a time.
///
/// `platforms` names the moving platform that carries a camera, by the camera's name; its pose is then that on the platform, and `observe_pose` or
/// `observe_increment` tells where the platform is.
#[pyclass(module = "pardalis")]
pub(crate) struct Tracker {
    tracker: pardalis::Tracker,
    cameras: Vec<String>,
    /// The bytes of each camera's last image.
    last_images: Vec<Arc<[u8]>>,
    targets: Vec<String>,
    platforms: Vec<String>,
    /// Whether each target is a crowd.
    are_crowds: Vec<bool>,
    /// Whether each target is detected by another program.
    take_boxes: Vec<bool>,
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

fn warn(py: Python<'_>, message: &str) -> PyResult<()> {
    let category = py.get_type::<PyUserWarning>();
    PyErr::warn(py, &category, &CString::new(message)?, 1)
}

/// What became of a pose or an increment.
fn word(observed: ObservedMotion) -> &'static str {
    match observed {
        ObservedMotion::Used => "used",
        ObservedMotion::Late => "late",
        ObservedMotion::Jump => "jump",
    }
}

impl Tracker {
    fn target_id(&self, target: &str) -> PyResult<TargetId> {
        position(&self.targets, "target", target).map(TargetId::new)
    }

    fn platform_id(&self, platform: &str) -> PyResult<PlatformId> {
        if self.platforms.is_empty() {
            return Err(PyValueError::new_err(
                "the tracker has no platforms; give platforms={\"CAMERA\": \"PLATFORM\"}",
            ));
        }
        position(&self.platforms, "platform", platform).map(PlatformId::new)
    }

    /// How many images of each platform could not be used so far.
    fn frames_without_pose(&self) -> Vec<usize> {
        let ids = (0..self.platforms.len()).map(PlatformId::new);
        ids.filter_map(|id| self.tracker.frames_without_pose(id).ok())
            .collect()
    }

    /// Warns if more images than `before`, the number for each platform, could not be used.
    fn warn_of_frames_without_pose(
        &self,
        py: Python<'_>,
        before: &[usize],
        time_s: f64,
    ) -> PyResult<()> {
        for ((name, before), now) in self
            .platforms
            .iter()
            .zip(before)
            .zip(self.frames_without_pose())
        {
            if now > *before {
                let message = format!(
                    "images of {time_s} s were not used: the pose of the platform \"{name}\" is unknown at that time; call observe_pose first"
                );
                warn(py, &message)?;
            }
        }
        Ok(())
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
    #[pyo3(signature = (cameras, targets, *, platforms=None, seed=1))]
    fn new(
        cameras: &Bound<'_, PyDict>,
        targets: &Bound<'_, PyDict>,
        platforms: Option<&Bound<'_, PyDict>>,
        seed: u32,
    ) -> PyResult<Self> {
        let mut setup = pardalis::Tracker::builder();
        setup.seed(seed);
        let (mut camera_names, mut target_names) = (Vec::new(), Vec::new());
        let (mut are_crowds, mut take_boxes) = (Vec::new(), Vec::new());
        for name in cameras.keys() {
            camera_names.push(name.extract()?);
        }
        let mut platform_names: Vec<String> = Vec::new();
        for (camera, platform) in platforms.into_iter().flatten() {
            let camera: String = camera.extract()?;
            position(&camera_names, "camera", &camera)?;
            let platform = platform.extract()?;
            if !platform_names.contains(&platform) {
                platform_names.push(platform);
                setup.platform(Platform::new(OdometryErrors::default()).map_err(value_error)?);
            }
        }
        for (name, camera) in cameras {
            let camera = camera
                .cast::<Camera>()
                .map_err(|_| is_no("cameras", &name, "Camera"))?;
            let view = camera.get().view()?;
            let carrier = platforms.map(|platforms| platforms.get_item(&name));
            match carrier.transpose()?.flatten() {
                Some(carrier) => {
                    let number =
                        position(&platform_names, "platform", &carrier.extract::<String>()?)?;
                    let on_platform = setup.camera_on(PlatformId::new(number), view);
                    on_platform.map_err(value_error)?;
                }
                None => {
                    setup.camera(view);
                }
            }
        }
        for (name, target) in targets {
            target_names.push(name.extract()?);
            let target = target
                .cast::<Target>()
                .map_err(|_| is_no("targets", &name, "Target"))?;
            setup.target(target.get().settings());
            are_crowds.push(target.get().is_crowd());
            take_boxes.push(target.get().takes_boxes());
        }
        Ok(Self {
            tracker: setup.build().map_err(value_error)?,
            last_images: vec![Arc::default(); camera_names.len()],
            cameras: camera_names,
            targets: target_names,
            platforms: platform_names,
            are_crowds,
            take_boxes,
        })
    }

    /// Return the tracker of a scene for images that you have: a file, or a dictionary with the same tables and keys, whose paths start at the current folder.
    ///
    /// The scene's images and videos are not read and need not be given, nor the motion of its platforms. `size_px` are width and height of
    /// the images of each camera, by name, unless the scene or its calibration files state them. `seed` replaces that of the scene.
    #[staticmethod]
    #[pyo3(signature = (scene, *, size_px=None, seed=None))]
    fn of_scene(
        py: Python<'_>,
        scene: &Bound<'_, PyAny>,
        size_px: Option<std::collections::BTreeMap<String, [usize; 2]>>,
        seed: Option<u32>,
    ) -> PyResult<Self> {
        let (file, mut settings) = match scene.cast::<PyDict>() {
            Ok(table) => (None, program::in_table(table, "")?),
            Err(_) => (Some(scene.extract::<PathBuf>()?), toml::Table::new()),
        };
        if let Some(seed) = seed {
            settings.insert("seed".to_owned(), toml::Value::Integer(seed.into()));
        }
        let sizes_px = size_px.into_iter().flatten();
        let sizes_px: Vec<_> = sizes_px.map(|(name, size)| (name, size.into())).collect();
        let opened = pardalis_cli::tracker_of_scene(file.as_deref(), &settings, &sizes_px);
        let (scene, tracker) = opened.map_err(|error| {
            let words = format!("{error:#}");
            match file.as_deref().map(File::open) {
                Some(Err(why)) => io::Error::new(why.kind(), words).into(),
                _ => PyValueError::new_err(words),
            }
        })?;
        for warning in &scene.warnings {
            warn(py, &warning.to_string())?;
        }
        let takes_boxes = |target: &TargetConfig| target.bodies.iter().any(|b| b.class().is_some());
        Ok(Self {
            tracker,
            are_crowds: scene.targets.iter().map(|t| t.crowd.is_some()).collect(),
            take_boxes: scene.targets.iter().map(takes_boxes).collect(),
            last_images: vec![Arc::default(); scene.cameras.len()],
            cameras: scene.cameras.into_iter().map(|c| c.name).collect(),
            targets: scene.targets.into_iter().map(|t| t.name).collect(),
            platforms: scene.platforms.into_iter().map(|p| p.name).collect(),
        })
    }

    /// Observe the images (height x width x 3 bytes) of one camera or several, by name, that were taken at the same time in seconds.
    ///
    /// Each time must be later than the one before. Without images, targets are only predicted. `boxes` are what another program detected in the images of this time, by camera and
    /// then by target, of targets of `Target.of_boxes` or `with_boxes`: rows of left, top, right, bottom and, if there is one, score (N x 4 or N x 5). Pixel centres have integer coordinates.
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
            let frame = arrays::frame(&image, time_s, &mut self.last_images[camera])?;
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
                if !self.take_boxes[target.index()] {
                    return Err(PyValueError::new_err(format!(
                        "\"{target_name}\" is found in the images; pass boxes of targets of Target.of_boxes or with_boxes"
                    )));
                }
                let what = format!("boxes[\"{name}\"][\"{target_name}\"]");
                let found = arrays::boxes(&found, &what)?;
                set = set.with_boxes(camera, target, found).map_err(value_error)?;
            }
        }
        let unused = self.frames_without_pose();
        match py.detach(|| self.tracker.observe(&set)) {
            Ok(Observed::Used) => self.warn_of_frames_without_pose(py, &unused, time_s),
            Ok(Observed::Repeated) => Err(PyValueError::new_err(format!(
                "images of {time_s} s were observed before; pass images that were taken at the same time together"
            ))),
            Err(error) => Err(value_error(error)),
        }
    }

    /// Observe where a platform is at a time in seconds, which may be later than that of the next images: between poses it moves at constant rates.
    ///
    /// `world_from_platform` is a 4 x 4 matrix that takes coordinates on the platform to the world, and `covariance` (6 x 6) that of its position (m, m) and
    /// rotation (rad, rad); without one it is exact. Return "used", "late" (no later than one before, ignored) or "jump" (where no motion leads to).
    #[pyo3(signature = (platform, world_from_platform, time_s, covariance=None))]
    fn observe_pose(
        &mut self,
        platform: &str,
        world_from_platform: &Bound<'_, PyAny>,
        time_s: f64,
        covariance: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<&'static str> {
        let platform = self.platform_id(platform)?;
        let pose = StampedPose {
            time_s,
            world_from_platform: arrays::pose(world_from_platform)?,
            covariance: arrays::pose_covariance(covariance)?,
        };
        let observed = self.tracker.observe_pose(platform, &pose);
        observed.map(word).map_err(value_error)
    }

    /// Observe how a platform moved between two times in seconds, by odometry.
    ///
    /// `before_from_after` is the pose after in the platform's frame before (4 x 4). The world is the platform's frame at the first increment, unless a pose was
    /// observed before. `covariance` and what is returned are as in `observe_pose`.
    #[pyo3(signature = (platform, before_from_after, from_s, to_s, covariance=None))]
    fn observe_increment(
        &mut self,
        platform: &str,
        before_from_after: &Bound<'_, PyAny>,
        from_s: f64,
        to_s: f64,
        covariance: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<&'static str> {
        let platform = self.platform_id(platform)?;
        let increment = Increment {
            from_s,
            to_s,
            before_from_after: arrays::pose(before_from_after)?,
            covariance: arrays::pose_covariance(covariance)?,
        };
        let observed = self.tracker.observe_increment(platform, &increment);
        observed.map(word).map_err(value_error)
    }

    /// Observe what another sensor measures of a target at a time in seconds: a position, a velocity, a range or a direction, in the world.
    ///
    /// Give one of `position_m` and `velocity_mps`, with None for coordinates that are not measured; or `range_m` or `direction` (a vector of any length), as seen from `from_m`. `sigma` is
    /// its standard deviation on each axis: in metres, m/s, or radians for a direction. `covariance` (3 x 3) replaces it for positions and velocities.
    ///
    /// It is taken into account with the next images at its time or after it, in the order of time. Return "waiting", or "late" if it is too old.
    #[pyo3(signature = (target, time_s, *, position_m=None, velocity_mps=None, range_m=None, direction=None, from_m=None, sigma=None, covariance=None))]
    #[allow(clippy::too_many_arguments)] // keywords of Python
    fn observe_measurement(
        &mut self,
        target: &str,
        time_s: f64,
        position_m: Option<[Option<f64>; 3]>,
        velocity_mps: Option<[Option<f64>; 3]>,
        range_m: Option<f64>,
        direction: Option<[f64; 3]>,
        from_m: Option<[f64; 3]>,
        sigma: Option<f64>,
        covariance: Option<[[f64; 3]; 3]>,
    ) -> PyResult<&'static str> {
        let target = self.target_id(target)?;
        let needed = |what: &str| PyValueError::new_err(what.to_owned());
        let of_vector = || match (sigma, covariance) {
            (Some(sigma), None) => Ok([sigma * sigma, 0.0, 0.0, sigma * sigma, 0.0, sigma * sigma]),
            (None, Some([[xx, xy, xz], [yx, yy, yz], [zx, zy, zz]])) => {
                // What is not measured may be NaN.
                let differs = |a: f64, b: f64| a != b && !(a.is_nan() && b.is_nan());
                if differs(xy, yx) || differs(xz, zx) || differs(yz, zy) {
                    return Err(needed(
                        "covariance is not symmetric; give a symmetric matrix",
                    ));
                }
                Ok([xx, xy, xz, yy, yz, zz])
            }
            _ => Err(needed("give sigma or covariance, one of the two")),
        };
        let of_ray = || match (from_m, sigma, covariance) {
            (Some(from_m), Some(sigma), None) => Ok((from_m, sigma)),
            _ => Err(needed("give from_m and sigma with a range or a direction")),
        };
        let measurement = match (position_m, velocity_mps, range_m, direction) {
            (Some(position_m), None, None, None) => {
                Measurement::position(time_s, position_m, of_vector()?)
            }
            (None, Some(velocity_mps), None, None) => {
                Measurement::velocity(time_s, velocity_mps, of_vector()?)
            }
            (None, None, Some(range_m), None) => {
                let (from_m, sigma) = of_ray()?;
                Measurement::range(time_s, from_m, range_m, sigma)
            }
            (None, None, None, Some(direction)) => {
                let (from_m, sigma) = of_ray()?;
                Measurement::bearing(time_s, from_m, direction, sigma)
            }
            _ => {
                return Err(needed(
                    "give one of position_m, velocity_mps, range_m and direction; of several, call this once for each",
                ));
            }
        };
        let measurement = measurement.map_err(value_error)?;
        match self.tracker.observe_measurement(target, &measurement) {
            Ok(ObservedMeasurement::Waiting) => Ok("waiting"),
            Ok(ObservedMeasurement::Late) => Ok("late"),
            Err(error) => Err(value_error(error)),
        }
    }

    /// Return how many measurements of a target by other sensors were used, rejected as outliers, made while it was not known, and late.
    fn measurement_counts(&self, target: &str) -> PyResult<BTreeMap<&'static str, usize>> {
        let counts = self.tracker.measurement_counts(self.target_id(target)?);
        let counts = counts.map_err(value_error)?;
        Ok(BTreeMap::from([
            ("used", counts.used),
            ("rejected", counts.rejected),
            ("without_target", counts.without_target),
            ("late", counts.late),
        ]))
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

    /// The names of the platforms.
    #[getter]
    fn platforms(&self) -> Vec<String> {
        self.platforms.clone()
    }

    fn __repr__(&self) -> String {
        let (cameras, targets) = (self.cameras.join(", "), self.targets.join(", "));
        format!("<Tracker of {targets} by {cameras}>")
    }
}
