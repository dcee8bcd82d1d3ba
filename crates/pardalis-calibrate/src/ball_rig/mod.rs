//! Relative poses and time offsets of several cameras from a ball that is waved through the room.
//!
//! The ball's path is a cubic B-spline in time, with about as many control points as frames, so that cameras need no
//! common trigger and rough motion is followed. It is fitted to the detections of all cameras together with poses and
//! offsets (bundle adjustment with a continuous-time path). The size of the ball gives the scale. The steps are:
//!
//! 1. Each camera alone knows the path roughly, because the ball's size tells its distance. For each pair of cameras and many
//!    offsets, random samples of three points bring two paths into line, and the one on which most points agree is kept.
//! 2. A tree of the best pairs places all cameras.
//! 3. A robust fit selects the ball among the detections of each image.
//! 4. Least squares on the selected detections gives the result and its covariance.

mod align;
mod checks;
mod fit;
mod result;
mod start;

use nalgebra::{Point3, Vector3};

pub use align::{RigAlignment, RigSight, align_to_places, align_to_points};

use super::CalibrationError;
use super::least_squares::{Loss, minimise};
use super::temporal::path::{Observation, Path};
use super::temporal::search::RayTrack;
use super::temporal::{DetectionFrame, Recording, TimedCamera, median};
use fit::{FittedCamera, Noise, RigFit, weights};
use pardalis::tracker::SizeTolerance;
use pardalis::view::View;
use pardalis_camera::{Camera, Pose};
use result::{result, with_focal, with_one_clock};
use start::{distance_sigma_m, link, place_m};

/// Control points of the path per frame of the second fastest camera. Fewer would smooth rough motion; as many as frames
/// could alternate between them unseen.
const CONTROLS_PER_FRAME: f64 = 0.5;

/// Cost of the path's curvature, as a share of its effect in the images.
const STIFFNESS: f64 = 1e-3;

/// Standard deviations of detections at first, in pixels.
const FIRST_NOISE: Noise = Noise {
    pixel_px: 0.5,
    radius_px: 0.5,
};

/// Least standard deviation of detections, in pixels: errors that an outline has in consecutive frames leave smaller
/// residuals, because the path follows them.
const LEAST_NOISE_PX: f64 = 0.2;

/// Number of standard deviations beyond which a detection is not of the ball.
const OUTLIER_SIGMAS: f64 = 5.0;

/// Distance from the fitted position, in pixels, beyond which a detection is another object (if it also exceeds
/// the diameter of the ball's image).
const MATCH_PX: f64 = 5.0;

/// The same for the radius, as a share of it.
const MATCH_SIZE: f64 = 0.2;

/// Number of times that the ball is selected among the detections.
const SELECTIONS: usize = 2;

/// Settings of [`calibrate_ball_rig`].
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct BallRigSettings {
    /// Largest offset between two clocks to search for in either direction, in seconds; positive, at most
    /// [`MAX_TIME_OFFSET_S`](super::MAX_TIME_OFFSET_S).
    pub max_offset_s: f64,
    /// Whether the focal lengths that the data determine are refined.
    pub refine_focal: bool,
}

impl Default for BallRigSettings {
    fn default() -> Self {
        Self {
            max_offset_s: 0.5,
            refine_focal: false,
        }
    }
}

/// A rig that was calibrated with a ball. The frame of the first camera is the world.
#[derive(Debug, Clone, PartialEq)]
pub struct BallRigCalibration {
    /// The cameras, in the order in which they were given.
    pub cameras: Vec<BallRigCamera>,
    /// Where the ball was in frames of any camera: time of the first camera in seconds, position in metres.
    pub path_m: Vec<(f64, [f64; 3])>,
    /// Standard deviations of the ball's position along the principal axes of its path in metres, largest first.
    pub widths_m: [f64; 3],
}

/// One camera of a rig that was calibrated with a ball.
#[derive(Debug, Clone, PartialEq)]
pub struct BallRigCamera {
    /// The camera; its focal length is refined if [`FocalFit::is_refined`] says so.
    pub camera: Camera,
    /// Pose in the frame of the first camera.
    pub world_from_camera: Pose,
    /// Standard deviation of its position along the axis along which it is largest, in metres; 0 for the first camera.
    pub position_sigma_m: f64,
    /// Standard deviation of its rotation about the axis about which it is largest, in radians; 0 for the first camera.
    pub turn_sigma_rad: f64,
    /// Seconds to add to its time stamps to obtain the first camera's time. It is 0 if it is not significantly different from that
    /// (3 standard deviations): cameras with a common trigger keep their common times.
    pub offset_s: f64,
    /// Standard deviation of the offset in seconds before it was compared with 0; 0 for the first camera.
    pub offset_sigma_s: f64,
    /// What the data say of its focal length; `None` for models without one.
    pub focal: Option<FocalFit>,
    /// What it detects near the path, in order of time.
    pub detections: Vec<BallSighting>,
    /// Root mean square distance of the detections from the path in pixels, without outliers.
    pub rms_px: f64,
}

/// What the data say of a focal length.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FocalFit {
    /// Focal length relative to the given one.
    pub factor: f64,
    /// Standard deviation of the factor. Before the fit, it is 0.05.
    pub sigma: f64,
    /// Whether the data determine it to a fifth of that or better.
    pub is_determined: bool,
    /// Whether the camera has the refined focal length.
    pub is_refined: bool,
}

/// A detection near the path of the ball.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BallSighting {
    /// Time of its exposure by the clock of the camera, in seconds: the time stamp unless the shutter rolls.
    pub time_s: f64,
    /// Pixel of the ball's centre.
    pub pixel: [f64; 2],
    /// Observed minus fitted pixel; `None` if the fitted position has none.
    pub residual_px: Option<[f64; 2]>,
    /// Observed minus fitted radius in pixels.
    pub radius_residual_px: Option<f64>,
    /// Whether the fit rejected the detection.
    pub outlier: bool,
}

/// Computes poses and time offsets of cameras of any model from what each of them detects of a ball of known radius that
/// is waved through the room. The poses of the views are not used.
///
/// The distances of the detections give the scale: an error of the radius is the same share of all lengths.
///
/// # Errors
///
/// Fails if fewer than two cameras detect the ball, if a camera does not see it at the same times as the others, if an
/// offset lies at the border of the search range, if cameras contradict one another, or if the data do not determine a pose
/// to 1 degree and 3 % of the distance to the ball, or an offset to a quarter of a frame. The error says which, and what
/// to do.
pub fn calibrate_ball_rig(
    cameras: &[TimedCamera],
    settings: &BallRigSettings,
) -> Result<BallRigCalibration, CalibrationError> {
    let recording = Recording::new(cameras, SizeTolerance::default(), settings.max_offset_s)?;
    let rig = Rig { recording };
    let detections = rig.recording.observations();
    let tracks = rig.tracks(&detections)?;
    let start = rig.linked(&tracks, settings.max_offset_s)?;
    let agreeing = agreeing(&tracks, &start);
    let observations: Vec<Observation> = agreeing.iter().map(|(_, _, seen)| *seen).collect();
    let mut points: Vec<(f64, Point3<f64>)> = agreeing.iter().map(|a| (a.0, a.1)).collect();
    points.sort_by(|a, b| a.0.total_cmp(&b.0));
    let fit = rig.fit(start, &observations, &points)?;
    let (fit, _) = minimise(fit, Loss::Cauchy(20.0), 40);
    let (fit, _) = minimise(fit, Loss::Cauchy(4.0), 60);
    let mut matched = rig.matched(&fit);
    let mut found = Found::from(fit);
    for _ in 0..SELECTIONS {
        let (mut fit, _) = minimise(found.fit(&matched)?, Loss::Cauchy(4.0), 60);
        fit.update_noise();
        let (fit, _) = minimise(fit, Loss::Cauchy(4.0), 60);
        let nearer = rig.matched(&fit);
        found = Found::from(fit);
        matched = nearer;
    }
    let robust = found.fit(&matched)?;
    let inlier: Vec<bool> = matched.iter().map(|seen| robust.is_inlier(seen)).collect();
    rig.check_agreement(&matched, &inlier)?;
    let pairs = matched.iter().zip(&inlier);
    let used: Vec<Observation> = pairs.filter(|(_, used)| **used).map(|(s, _)| *s).collect();
    let (mut fit, _) = minimise(found.fit(&used)?, Loss::Squares, 60);
    fit.update_noise();
    let (fit, _) = minimise(fit, Loss::Squares, 60);
    let (fit, offset_sigmas_s) = with_one_clock(fit)?;
    let (fit, focal) = with_focal(fit, settings.refine_focal);
    let calibration = result(&fit, &matched, &inlier, &offset_sigmas_s, focal)?;
    rig.check_border(&calibration, settings.max_offset_s)?;
    rig.check_determined(&calibration)?;
    Ok(calibration)
}

/// A rig that is being calibrated.
struct Rig<'a> {
    recording: Recording<'a>,
}

/// What has been found so far.
struct Found {
    cameras: Vec<FittedCamera>,
    path: Path,
    noise: Noise,
}

impl Found {
    /// Builds the problem for other observations near the path.
    fn fit<'s>(&self, observations: &'s [Observation]) -> Result<RigFit<'s>, CalibrationError> {
        let mut fit = RigFit {
            cameras: self.cameras.clone(),
            observations,
            weights: weights(observations),
            path: self.path.clone(),
            noise: self.noise,
            stiffness: 0.0,
        };
        let scales = observations.iter().filter_map(|seen| fit.px_per_m(seen));
        let mut scales: Vec<f64> = scales.collect();
        fit.stiffness = STIFFNESS * median(&mut scales).ok_or_else(checks::no_common_path)?;
        Ok(fit)
    }
}

impl From<RigFit<'_>> for Found {
    fn from(fit: RigFit) -> Self {
        Self {
            cameras: fit.cameras,
            path: fit.path,
            noise: fit.noise,
        }
    }
}

/// Pose and offset of a camera at first.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Place {
    world_from_camera: Pose,
    offset_s: f64,
}

impl Rig<'_> {
    /// Returns the rays of all detections in the frames of their cameras.
    fn tracks(&self, detections: &[Observation]) -> Result<Vec<RayTrack>, CalibrationError> {
        let cameras = self.recording.cameras.iter().enumerate();
        let track = |(number, camera): (usize, &TimedCamera)| {
            let view = camera.view;
            let here = View::new(view.camera().clone(), Pose::identity(), view.size(), None);
            let here = here.map_err(|error| {
                CalibrationError::new(format!("{}: {error}", camera.name), "correct the camera")
            })?;
            let own = detections.iter().filter(|seen| seen.camera == number);
            let interval_s = self.recording.intervals_s[number];
            Ok(RayTrack::new(&here, own, interval_s, true))
        };
        cameras.map(track).collect()
    }

    /// Places all cameras along a tree of the pairs whose paths match best, from the first camera on.
    fn linked(
        &self,
        tracks: &[RayTrack],
        max_offset_s: f64,
    ) -> Result<Vec<Place>, CalibrationError> {
        let mut places: Vec<Option<Place>> = vec![None; tracks.len()];
        places[0] = Some(Place {
            world_from_camera: Pose::identity(),
            offset_s: 0.0,
        });
        let mut links = Vec::new();
        let mut newest = 0;
        while let Some(at) = places[newest].filter(|_| places.contains(&None)) {
            for (other, _) in places.iter().enumerate().filter(|(_, p)| p.is_none()) {
                // Slightly wider than the range, so that a maximum at the border can be distinguished from one inside.
                let reach_s = max_offset_s + tracks[other].interval_s;
                let range_s = [-reach_s - at.offset_s, reach_s - at.offset_s];
                let found = link(&tracks[newest], &tracks[other], range_s);
                links.extend(found.map(|link| (other, at, link)));
            }
            let open = links.iter().filter(|(other, ..)| places[*other].is_none());
            let best = open.max_by(|a, b| a.2.support.total_cmp(&b.2.support));
            let Some((other, at, link)) = best.filter(|(.., link)| checks::is_linked(link)) else {
                return Err(self.unlinked(&places, best.map(|(other, _, link)| (*other, *link))));
            };
            if link.at_border {
                return Err(self.border(*other, max_offset_s));
            }
            newest = *other;
            places[newest] = Some(Place {
                world_from_camera: at.world_from_camera * link.first_from_second,
                offset_s: at.offset_s + link.offset_s,
            });
        }
        Ok(places.into_iter().flatten().collect())
    }

    /// Returns the time between two control points of the path, in seconds.
    fn control_interval_s(&self) -> f64 {
        // A position needs detections by two cameras.
        let mut intervals_s = self.recording.intervals_s.clone();
        intervals_s.sort_by(f64::total_cmp);
        intervals_s[1] / CONTROLS_PER_FRAME
    }

    /// Builds the problem from a start, with a path near points in order of time.
    fn fit<'s>(
        &self,
        places: Vec<Place>,
        observations: &'s [Observation],
        points: &[(f64, Point3<f64>)],
    ) -> Result<RigFit<'s>, CalibrationError> {
        let cameras = places.into_iter().zip(self.recording.cameras);
        let cameras = cameras.map(|(place, camera)| FittedCamera {
            camera: camera.view.camera().clone(),
            camera_from_world: place.world_from_camera.inverse(),
            offset_s: place.offset_s,
            has_first_clock: false,
            size_bias_px: 0.0,
            log_focal: 0.0,
            is_focal_free: false,
        });
        let (Some((first_s, _)), Some((last_s, _))) = (points.first(), points.last()) else {
            return Err(checks::no_common_path());
        };
        let interval_s = self.control_interval_s();
        // Leaves room for the offsets to move.
        let margin_s = 4.0 * interval_s;
        let start = Found {
            cameras: cameras.collect(),
            path: Path::near(points, first_s - margin_s, last_s + margin_s, interval_s),
            noise: FIRST_NOISE,
        };
        start.fit(observations)
    }

    /// Returns the detection of every frame that is most likely the ball on this path, while another camera also sees it.
    fn matched(&self, fit: &RigFit) -> Vec<Observation> {
        let mut all = Vec::new();
        for (camera, frames) in self.recording.candidates.iter().enumerate() {
            let nearest = |(number, frame): (usize, &DetectionFrame)| {
                let rated = frame.detections.iter().filter_map(|found| {
                    let seen = self.recording.observation((camera, number), found);
                    let residual = fit.residual(&seen)?;
                    let off_px = libm::hypot(residual.pixel_px[0], residual.pixel_px[1]);
                    let is_near = off_px <= (2.0 * seen.radius_px).max(MATCH_PX)
                        && residual.radius_px.abs() <= MATCH_SIZE * seen.radius_px;
                    is_near.then_some((off_px, seen))
                });
                rated.min_by(|a, b| a.0.total_cmp(&b.0))
            };
            let found = frames.iter().enumerate().filter_map(nearest);
            all.extend(found.map(|(_, seen)| seen));
        }
        let offsets_s: Vec<f64> = fit.cameras.iter().map(|camera| camera.offset_s).collect();
        self.recording.simultaneous(&all, &offsets_s)
    }
}

/// Returns the detections that another camera confirms: time of the first camera in seconds, position in the world in
/// metres, and the detection; at most one of each frame.
fn agreeing(tracks: &[RayTrack], places: &[Place]) -> Vec<(f64, Point3<f64>, Observation)> {
    let mut found = Vec::new();
    let in_world = |camera: usize, place_m: Vector3<f64>| {
        places[camera].world_from_camera * Point3::from(place_m)
    };
    for (camera, track) in tracks.iter().enumerate() {
        for rays in &track.frames {
            let rated = rays.iter().filter_map(|ray| {
                let time_s = ray.time_s + places[camera].offset_s;
                let own = in_world(camera, place_m(ray));
                let others = tracks
                    .iter()
                    .enumerate()
                    .filter(|(other, _)| *other != camera);
                let near = others.flat_map(|(other, across)| {
                    let seen = across.at(time_s - places[other].offset_s);
                    seen.into_iter().map(move |seen| {
                        let place = in_world(other, place_m(&seen));
                        let sigma_m = libm::hypot(
                            distance_sigma_m(track, ray),
                            distance_sigma_m(across, &seen),
                        );
                        ((place - own).norm() / sigma_m, place)
                    })
                });
                let (off, place) = near.min_by(|a, b| a.0.total_cmp(&b.0))?;
                let middle = nalgebra::center(&own, &place);
                (off <= checks::AGREEING_SIGMAS).then_some((off, time_s, middle, ray.observation))
            });
            let best = rated.min_by(|a, b| a.0.total_cmp(&b.0));
            found.extend(best.map(|(_, time_s, place, seen)| (time_s, place, seen)));
        }
    }
    found
}
