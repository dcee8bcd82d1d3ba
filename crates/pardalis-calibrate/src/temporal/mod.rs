//! Temporal calibration of free-running cameras: the constant offsets between their clocks, from a moving
//! target.
//!
//! The target's path is a cubic B-spline in time. It is fitted to the detections of all cameras together with
//! the offsets of their time stamps (continuous-time calibration, Furgale et al. 2013). Each camera detects on
//! its own and may see other objects of the target's colours. The steps are:
//!
//! 1. A search finds the offsets under which the cameras' rays meet best, so that no initial guess is needed.
//! 2. Where rays meet, a chain of points follows one object through space.
//! 3. A robust fit of its path selects the target among the detections of each image.
//! 4. Least squares on the selected detections gives the offsets and their standard deviations.

mod chain;
pub(crate) mod path;
pub(crate) mod search;
mod selection;

use nalgebra::Vector3;

use super::least_squares::{Loss, covariance, minimise};
use super::{CalibrationError, OUTLIER_SIGMAS, check, rms};
use chain::chain;
use pardalis::tracker::SizeTolerance;
use pardalis::view::View;
use path::{Observation, Path, PathFit};
use search::{RayTrack, meeting_points, meetings, pair_offset};
use selection::candidates;

/// Something in a camera's image that may be the target.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Detection {
    /// Pixel of the target's middle.
    pub pixel: [f64; 2],
    /// Radius of a circle with the area of the target's image, in pixels.
    pub radius_px: f64,
    /// Distance of the target's middle from the camera by its apparent size, in metres. It need not be exact: it
    /// tells the target from objects of other sizes.
    pub distance_m: f64,
}

/// What one camera detected in one frame, without the help of other frames.
#[derive(Debug, Clone, PartialEq)]
pub struct DetectionFrame {
    /// Time stamp of the camera, in seconds.
    pub time_s: f64,
    /// At most one of them is the target.
    pub detections: Vec<Detection>,
}

/// A camera and its detections.
#[derive(Debug, Clone)]
pub struct TimedCamera<'a> {
    /// Name for messages.
    pub name: &'a str,
    /// Pose and projection.
    pub view: &'a View,
    /// Frames in order of time.
    pub frames: Vec<DetectionFrame>,
}

/// A detection of the target with its residuals.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FittedDetection {
    /// Time of its exposure by the clock of the camera, in seconds: the time stamp unless the shutter rolls.
    pub time_s: f64,
    /// Pixel of the target's centre.
    pub pixel: [f64; 2],
    /// Observed minus fitted pixel with the original time stamps; `None` if the path is unknown or outside
    /// the image.
    pub before_px: Option<[f64; 2]>,
    /// Observed minus fitted pixel with the corrected time stamps.
    pub after_px: Option<[f64; 2]>,
    /// Whether the fit rejected the detection.
    pub outlier: bool,
}

/// Time offset of one camera.
#[derive(Debug, Clone, PartialEq)]
pub struct TemporalCalibration {
    /// Seconds to add to the camera's time stamps to obtain the first camera's time.
    pub offset_s: f64,
    /// Standard deviation of the offset in seconds, from the scatter of the residuals; 0 for the first camera.
    pub sigma_s: f64,
    /// Detections in order of time.
    pub detections: Vec<FittedDetection>,
    /// Root mean square residual in pixels with the original time stamps, without outliers; `None` if the
    /// cameras then have no common time.
    pub rms_before_px: Option<f64>,
    /// Root mean square residual in pixels with the corrected time stamps, without outliers.
    pub rms_after_px: f64,
}

/// Largest supported search range for offsets, in seconds.
pub const MAX_TIME_OFFSET_S: f64 = 10.0;

/// Number of frames in which each camera must detect the target.
pub(crate) const MIN_DETECTIONS: usize = 12;

/// Control points of the path per frame of the second fastest camera.
const CONTROLS_PER_FRAME: f64 = 0.5;

/// Cost of the path's curvature, as a share of its effect in the images.
const STIFFNESS: f64 = 1e-3;

/// Ratio by which the motion of the target's images per frame must exceed their noise.
const MIN_MOTION: f64 = 2.0;
/// Number of frames over which that motion is averaged.
const MOTION_FRAMES: usize = 5;

/// Number of times that the correlation of the residuals is measured and applied.
const CORRELATION_ROUNDS: usize = 4;

/// Estimates the time offset of each camera relative to the first.
///
/// Finds offsets of up to `max_offset_s` (positive, at most [`MAX_TIME_OFFSET_S`]) in either direction. If the
/// target's size is unknown, the distances of the detections may all be wrong by one factor.
///
/// # Errors
///
/// Fails if fewer than two cameras detect the target, if the target hardly moves, if no two cameras see it at
/// the same time, or if an offset lies at the border of the search range.
pub fn calibrate_time(
    cameras: &[TimedCamera],
    size: SizeTolerance,
    max_offset_s: f64,
) -> Result<Vec<TemporalCalibration>, CalibrationError> {
    Recording::new(cameras, size, max_offset_s)?.fit(max_offset_s)
}

/// Returns the median time between two frames of a camera, in seconds.
fn typical_interval_s(camera: &TimedCamera) -> f64 {
    let pairs = camera.frames.windows(2);
    let mut steps: Vec<f64> = pairs
        .map(|pair| pair[1].time_s - pair[0].time_s)
        .filter(|step_s| *step_s > 0.0)
        .collect();
    median(&mut steps).unwrap_or(1.0)
}

/// Returns the median; `None` if there are no values.
pub(crate) fn median(values: &mut [f64]) -> Option<f64> {
    if values.is_empty() {
        return None;
    }
    let middle = values.len() / 2;
    Some(*values.select_nth_unstable_by(middle, f64::total_cmp).1)
}

/// Requires that every camera detects something that may be the target.
fn check_candidates(
    cameras: &[TimedCamera],
    candidates: &[Vec<DetectionFrame>],
) -> Result<(), CalibrationError> {
    let sees =
        |frames: &[DetectionFrame]| frames.iter().filter(|f| !f.detections.is_empty()).count();
    let seeing = candidates.iter().filter(|c| sees(c) >= MIN_DETECTIONS);
    let only_one = if seeing.count() < 2 {
        ": at most one camera sees the target"
    } else {
        ""
    };
    for (camera, frames) in cameras.iter().zip(candidates) {
        let count = sees(frames);
        if count < MIN_DETECTIONS {
            return Err(CalibrationError::new(
                format!(
                    "{} detects a moving object that may be the target in {count} of its {} frames{only_one}",
                    camera.name,
                    frames.len()
                ),
                format!(
                    "move the target back and forth in view of all cameras (at least {MIN_DETECTIONS} frames each; objects at rest count as background), learn its colours again in this illumination, or leave the camera out"
                ),
            ));
        }
    }
    Ok(())
}

/// The data of a temporal calibration.
pub(crate) struct Recording<'a> {
    pub(crate) cameras: &'a [TimedCamera<'a>],
    views: Vec<&'a View>,
    /// Median time between two frames of each camera, in seconds.
    pub(crate) intervals_s: Vec<f64>,
    is_size_known: bool,
    /// Frames with the detections that may be the target, per camera, in order of time.
    pub(crate) candidates: Vec<Vec<DetectionFrame>>,
}

impl<'a> Recording<'a> {
    /// Prepares a calibration with offsets of up to `max_offset_s`.
    ///
    /// Fails if that is out of range, or if fewer than two cameras detect something that may be the target.
    pub(crate) fn new(
        cameras: &'a [TimedCamera<'a>],
        size: SizeTolerance,
        max_offset_s: f64,
    ) -> Result<Self, CalibrationError> {
        if !(max_offset_s > 0.0 && max_offset_s <= MAX_TIME_OFFSET_S) {
            return Err(CalibrationError::new(
                format!("the search range for offsets is {max_offset_s} s"),
                format!("choose more than 0 and at most {MAX_TIME_OFFSET_S} s"),
            ));
        }
        if cameras.len() < 2 {
            return Err(CalibrationError::new(
                "there is only one camera, and cameras are compared with each other",
                "give two or more cameras that see the target at the same times",
            ));
        }
        let candidates: Vec<Vec<DetectionFrame>> = cameras.iter().map(candidates).collect();
        check_candidates(cameras, &candidates)?;
        Ok(Self {
            cameras,
            views: cameras.iter().map(|camera| camera.view).collect(),
            intervals_s: cameras.iter().map(typical_interval_s).collect(),
            is_size_known: size != SizeTolerance::Unknown,
            candidates,
        })
    }
}

impl Recording<'_> {
    fn fit(&self, max_offset_s: f64) -> Result<Vec<TemporalCalibration>, CalibrationError> {
        let all = self.observations();
        let rough_s = self.rough_offsets(&all, max_offset_s)?;
        let chain = chain(&meetings(&self.tracks(&all), &rough_s));
        let observations = self.fastest_stretch(chain, &rough_s);
        let robust = self
            .path_fit(&observations, &rough_s, true)
            .ok_or_else(no_common_detections)?;
        let (robust, _) = minimise(robust, Loss::Cauchy(10.0), 30);
        let (robust, _) = minimise(robust, Loss::Cauchy(2.0), 60);
        let (path, offsets_s) = (robust.path.clone(), robust.offsets_s.clone());
        let observations = self.simultaneous(&self.matched(&path, &offsets_s), &offsets_s);
        let robust = self
            .path_fit(&observations, &offsets_s, true)
            .ok_or_else(no_common_detections)?;
        let (robust, _) = minimise(robust, Loss::Cauchy(2.0), 60);
        let residuals: Vec<_> = observations.iter().map(|s| robust.residual_px(s)).collect();
        let inlier = check::inliers(&residuals, OUTLIER_SIGMAS);
        self.check_agreement(&observations, &inlier)?;
        let pairs = observations.iter().zip(&inlier);
        let used: Vec<Observation> = pairs.filter(|(_, used)| **used).map(|(s, _)| *s).collect();
        let start = PathFit {
            observations: &used,
            ..robust
        };
        let fitted = refined(start);
        self.check_motion(&fitted)?;
        let sigmas_s = self.sigmas(&fitted)?;
        self.check_border(&fitted.offsets_s, max_offset_s)?;
        let zero = vec![0.0; self.cameras.len()];
        let before = self
            .path_fit(&used, &zero, false)
            .map(|start| minimise(start, Loss::Squares, 60).0);
        let calibration = |camera: usize| {
            let own = observations.iter().zip(&inlier);
            let detections: Vec<FittedDetection> = own
                .filter(|(observation, _)| observation.camera == camera)
                .map(|(observation, used)| FittedDetection {
                    time_s: observation.time_s,
                    pixel: observation.pixel,
                    before_px: before.as_ref().and_then(|fit| fit.residual_px(observation)),
                    after_px: fitted.residual_px(observation),
                    outlier: !used,
                })
                .collect();
            let kept = detections.iter().filter(|s| !s.outlier);
            TemporalCalibration {
                offset_s: fitted.offsets_s[camera],
                sigma_s: sigmas_s[camera],
                rms_before_px: before
                    .is_some()
                    .then(|| rms(kept.clone().filter_map(|s| s.before_px))),
                rms_after_px: rms(kept.filter_map(|s| s.after_px)),
                detections,
            }
        };
        Ok((0..self.cameras.len()).map(calibration).collect())
    }

    fn tracks(&self, observations: &[Observation]) -> Vec<RayTrack> {
        let track = |(camera, view): (usize, &&View)| {
            let own = observations
                .iter()
                .filter(|observation| observation.camera == camera);
            RayTrack::new(view, own, self.intervals_s[camera], self.is_size_known)
        };
        self.views.iter().enumerate().map(track).collect()
    }

    /// Estimates the offsets to within a fraction of a frame. Starting with the first camera, it extends the
    /// set of known offsets by the pair of cameras with the most evidence.
    fn rough_offsets(
        &self,
        observations: &[Observation],
        max_offset_s: f64,
    ) -> Result<Vec<f64>, CalibrationError> {
        let tracks = self.tracks(observations);
        let mut known: Vec<Option<f64>> = vec![None; tracks.len()];
        known[0] = Some(0.0);
        let mut pairs = Vec::new();
        let mut newest = 0;
        while known.contains(&None) {
            let newest_s = known[newest].unwrap_or_default();
            for (other, _) in known.iter().enumerate().filter(|(_, o)| o.is_none()) {
                // Slightly wider than the range, so that a minimum at the border can be distinguished from
                // one inside.
                let reach_s = max_offset_s + tracks[other].interval_s;
                let range_s = [-reach_s - newest_s, reach_s - newest_s];
                let pair = pair_offset(&tracks[newest], &tracks[other], range_s);
                pairs.extend(pair.map(|pair| (other, newest_s + pair.offset_s, pair)));
            }
            let open = pairs.iter().filter(|(other, ..)| known[*other].is_none());
            let Some(&(other, offset_s, pair)) = open.max_by(|a, b| a.2.gain.total_cmp(&b.2.gain))
            else {
                let unplaced = known.iter().position(Option::is_none).unwrap_or_default();
                return Err(CalibrationError::new(
                    format!(
                        "{} never sees the target at the same times as the other cameras, for any offset up to {max_offset_s} s",
                        self.cameras[unplaced].name
                    ),
                    "check that its frames belong to this recording and its time stamps are in seconds, allow larger offsets (max-offset-s), or leave the camera out",
                ));
            };
            if pair.at_border {
                return Err(self.border(other, max_offset_s));
            }
            known[other] = Some(offset_s);
            newest = other;
        }
        Ok(known.into_iter().flatten().collect())
    }

    fn border(&self, camera: usize, max_offset_s: f64) -> CalibrationError {
        CalibrationError::new(
            format!(
                "the best offset of {} lies at the border of the search range of {max_offset_s} s, or there is none",
                self.cameras[camera].name
            ),
            "allow larger offsets (max-offset-s); if that does not help, check the camera poses and move the target more",
        )
    }

    fn check_border(&self, offsets_s: &[f64], max_offset_s: f64) -> Result<(), CalibrationError> {
        match offsets_s.iter().position(|s| s.abs() > max_offset_s) {
            Some(camera) => Err(self.border(camera, max_offset_s)),
            None => Ok(()),
        }
    }

    /// Returns the time between two control points of the path, in seconds.
    fn control_interval_s(&self) -> f64 {
        // A position needs detections by two cameras.
        let mut intervals_s = self.intervals_s.clone();
        intervals_s.sort_by(f64::total_cmp);
        intervals_s[1] / CONTROLS_PER_FRAME
    }

    /// Builds a path near the detections, ready to be fitted; `None` if the rays of several cameras never meet.
    fn path_fit<'s>(
        &'s self,
        observations: &'s [Observation],
        offsets_s: &[f64],
        offsets_are_free: bool,
    ) -> Option<PathFit<'s>> {
        let points = meeting_points(&self.tracks(observations), offsets_s);
        if points.is_empty() {
            return None;
        }
        let times = observations.iter().map(|s| s.time_s + offsets_s[s.camera]);
        let (first_s, last_s) = times.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), t| {
            (a.min(t), b.max(t))
        });
        let interval_s = self.control_interval_s();
        // Leaves room for the offsets to move.
        let margin_s = 2.0 * interval_s;
        let path = Path::near(&points, first_s - margin_s, last_s + margin_s, interval_s);
        let mut scales: Vec<f64> = observations
            .iter()
            .filter_map(|observation| {
                let view = self.views[observation.camera];
                let point = path.position_m(observation.time_s + offsets_s[observation.camera])?;
                let point = view.camera_from_world() * point;
                let jacobian = view.camera().project_with_jacobian(point.into())?;
                Some(Vector3::from(jacobian.by_point[0]).norm())
            })
            .collect();
        Some(PathFit {
            views: &self.views,
            observations,
            path,
            offsets_s: offsets_s.to_vec(),
            offsets_are_free,
            intervals_s: &self.intervals_s,
            correlation: 0.0,
            stiffness: STIFFNESS * median(&mut scales)?,
        })
    }

    /// Requires that every camera agrees with the others in most of its detections.
    fn check_agreement(
        &self,
        observations: &[Observation],
        inlier: &[bool],
    ) -> Result<(), CalibrationError> {
        for (number, camera) in self.cameras.iter().enumerate() {
            let own = || {
                observations
                    .iter()
                    .zip(inlier)
                    .filter(|(s, _)| s.camera == number)
            };
            let agreeing = own().filter(|(_, used)| **used).count();
            let candidates = &self.candidates[number];
            let detections = candidates
                .iter()
                .filter(|f| !f.detections.is_empty())
                .count();
            if agreeing < MIN_DETECTIONS || 2 * agreeing < own().count() {
                return Err(CalibrationError::new(
                    format!(
                        "{} agrees with the other cameras in {agreeing} of the {detections} frames in which it sees an object of the target's colours",
                        camera.name
                    ),
                    "check its pose with a grid of the world drawn over its image, and check for other objects of these colours",
                ));
            }
        }
        Ok(())
    }

    /// Requires sufficient motion: otherwise the path would follow the noise of the detections, and the
    /// offsets would follow the path.
    fn check_motion(&self, fitted: &PathFit) -> Result<(), CalibrationError> {
        for (number, camera) in self.cameras.iter().enumerate() {
            let own: Vec<&Observation> = fitted
                .observations
                .iter()
                .filter(|s| s.camera == number)
                .collect();
            let residuals = own
                .iter()
                .filter_map(|observation| fitted.residual_px(observation));
            let rms_px = rms(residuals);
            let apart = own.iter().zip(own.iter().skip(MOTION_FRAMES));
            let moved_px = rms(apart.map(|(a, b)| {
                let frames = (b.time_s - a.time_s) / self.intervals_s[number];
                [0, 1].map(|i| (b.pixel[i] - a.pixel[i]) / frames)
            }));
            if moved_px < MIN_MOTION * rms_px {
                return Err(CalibrationError::new(
                    format!(
                        "the target moves too little in the images of {}: {moved_px:.2} px per frame, with a noise of {rms_px:.2} px",
                        camera.name
                    ),
                    "move the target faster, back and forth",
                ));
            }
        }
        Ok(())
    }

    /// Computes the standard deviation of each camera's offset, in seconds.
    fn sigmas(&self, fitted: &PathFit) -> Result<Vec<f64>, CalibrationError> {
        let path_unknowns = fitted.path_unknowns();
        let offsets = self.cameras.len() - 1;
        let mut squares = 0.0;
        fitted.visit_observations(&mut |residual, _| {
            squares += residual.map_or(0.0, |[u, v]| u * u + v * v);
        });
        let unknowns = 3 * fitted.constrained_controls() + offsets;
        let freedom = (2 * fitted.observations.len())
            .saturating_sub(unknowns)
            .max(1) as f64;
        let sigma_px = (squares / freedom).sqrt();
        let covariance = covariance(fitted);
        let mut sigmas_s = vec![0.0];
        for camera in 1..=offsets {
            let index = path_unknowns + camera - 1;
            let sigma_s = covariance
                .as_ref()
                .map_or(f64::INFINITY, |c| sigma_px * c[(index, index)].sqrt());
            if !(sigma_s <= 0.25 * self.intervals_s[camera]) {
                return Err(CalibrationError::new(
                    format!(
                        "the detections do not determine the time offset of {}: its standard deviation would be {:.1} ms",
                        self.cameras[camera].name,
                        1e3 * sigma_s
                    ),
                    "move the target faster, in all directions and for longer, in view of several cameras at once",
                ));
            }
            sigmas_s.push(sigma_s);
        }
        Ok(sigmas_s)
    }
}

/// Fits by least squares, alternating with an update of the residuals' correlation.
fn refined(fit: PathFit) -> PathFit {
    let (mut fitted, _) = minimise(fit, Loss::Squares, 60);
    for _ in 0..CORRELATION_ROUNDS {
        fitted.correlation = fitted.measured_correlation();
        (fitted, _) = minimise(fitted, Loss::Squares, 60);
    }
    fitted
}

fn no_common_detections() -> CalibrationError {
    CalibrationError::new(
        "the rays of the cameras do not meet",
        "check the camera poses, and that several cameras see the target move at the same times from different sides: objects at rest count as background",
    )
}
