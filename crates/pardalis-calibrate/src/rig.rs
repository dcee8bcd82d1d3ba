//! Relative poses of several cameras, from targets that two or more of them saw at the same time.

use nalgebra::{DVector, Point3, Unit, Vector3};

use super::least_squares::{Loss, Problem, Slopes, covariance, minimise};
use super::pose::{PoseFit, closest_pose, slopes_by_pose, stepped_pose};
use super::start::free_parameters;
use super::{CalibrationError, CalibrationView, check, rms};
use pardalis_camera::{CalibratedCamera, Pose};
use pardalis_camera::{Camera, ProjectionJacobian};

/// A camera of a rig with its observations.
#[derive(Debug, Clone, PartialEq)]
pub struct RigCamera {
    /// Name.
    pub name: String,
    /// Initial calibration, refined together with the poses.
    pub camera: Camera,
    /// Width and height of the images in pixels.
    pub size_px: (usize, usize),
    /// One view per shot, with the same shots in the same order for all cameras; `None` if the camera did not
    /// see the target.
    pub views: Vec<Option<CalibrationView>>,
}

/// A calibrated rig.
#[derive(Debug, Clone, PartialEq)]
pub struct RigCalibration {
    /// Cameras with their poses; the first camera's frame is the world frame.
    pub cameras: Vec<CalibratedCamera>,
    /// Pose of the target in each shot that was used.
    pub world_from_target: Vec<Option<Pose>>,
    /// Root mean square distance of each camera's points in pixels, without outliers.
    pub rms_px: Vec<f64>,
    /// Observed minus projected pixels by camera, shot and point; `None` if the point does not project into
    /// the image or its shot was rejected.
    pub residuals_px: Vec<Vec<Vec<Option<[f64; 2]>>>>,
    /// Rejected points as (camera, shot, point), without those of rejected shots.
    pub outliers: Vec<(usize, usize, usize)>,
    /// Rejected shots: the cameras disagree on the target's position, so that their images are not
    /// simultaneous.
    pub rejected_shots: Vec<usize>,
    /// Standard deviation of each camera's distance from the first, in metres; zero for the first.
    pub baseline_sigma_m: Vec<f64>,
    /// Standard deviation of the angle between each camera and the first, in radians; zero for the first.
    pub turn_sigma_rad: Vec<f64>,
}

/// A view matches its shot if the median residual of its points is within this multiple of the median
/// residual of the camera's individually fitted views.
const STEP_RATIO: f64 = 10.0;

/// Lower bound of that limit, in pixels.
const STEP_PX: f64 = 1.0;

/// Fits the poses of all cameras and targets, and refines the cameras.
///
/// Every camera needs a shot in common with at least one other camera. As in [`closest_pose`], points beyond
/// `outlier_sigmas` robust standard deviations are rejected. A few shots in which the cameras disagree on the
/// target's position are rejected as well.
///
/// # Errors
///
/// Fails if there are fewer than two cameras, if the numbers of shots differ, if a camera shares no shot with
/// the others, or if the observations are contradictory or insufficient.
pub fn calibrate_rig(
    cameras: &[RigCamera],
    outlier_sigmas: f64,
) -> Result<RigCalibration, CalibrationError> {
    let shots = cameras.first().map_or(0, |c| c.views.len());
    if cameras.len() < 2 || shots == 0 || cameras.iter().any(|c| c.views.len() != shots) {
        return Err(CalibrationError::new(
            "a rig needs two or more cameras with the same number of shots",
            "give simultaneous images of all cameras",
        ));
    }
    let single: Vec<Vec<Option<PoseFit>>> = cameras
        .iter()
        .map(|c| {
            let fit = |view: &Option<CalibrationView>| {
                closest_pose(&c.camera, &view.as_ref()?.correspondences, outlier_sigmas).ok()
            };
            c.views.iter().map(fit).collect()
        })
        .collect();
    let (camera_from_world, world_from_target) = initial_poses(cameras, &single)?;
    let free: Vec<Vec<bool>> = cameras.iter().map(|c| free_parameters(&c.camera)).collect();
    let used = cameras
        .iter()
        .map(|c| {
            let counts = c
                .views
                .iter()
                .map(|v| v.as_ref().map_or(0, |v| v.correspondences.len()));
            counts.map(|count| vec![true; count]).collect()
        })
        .collect();
    let rig = Rig {
        cameras,
        free: &free,
        models: cameras.iter().map(|c| c.camera.clone()).collect(),
        camera_from_world,
        world_from_target,
        used,
    };
    let (mut rig, _) = minimise(rig, Loss::Cauchy(2.0), 100);
    let rejected_shots = rig.rejected_shots(&single);
    rig.check_rejected(&rejected_shots)?;
    for &shot in &rejected_shots {
        rig.world_from_target[shot] = None;
    }
    for (c, shots) in rig.residuals().into_iter().enumerate() {
        let is_kept = |s: &usize| !rejected_shots.contains(s);
        let residuals: Vec<_> = (0..shots.len())
            .filter(is_kept)
            .flat_map(|s| shots[s].iter().copied())
            .collect();
        let inliers = check::inliers(&residuals, outlier_sigmas);
        check::mostly_inliers(&format!("camera {}", cameras[c].name), &inliers)?;
        let mut inliers = inliers.into_iter();
        for s in (0..shots.len()).filter(is_kept) {
            rig.used[c][s]
                .iter_mut()
                .zip(inliers.by_ref())
                .for_each(|(u, i)| *u = i);
        }
    }
    let (rig, _) = minimise(rig, Loss::Squares, 100);
    rig.finish(rejected_shots)
}

/// Computes initial poses: the first camera is the world, and the others follow by common shots, most shots
/// first. The relative pose of two cameras comes from the shot that agrees best with the others.
fn initial_poses(
    cameras: &[RigCamera],
    single: &[Vec<Option<PoseFit>>],
) -> Result<(Vec<Pose>, Vec<Option<Pose>>), CalibrationError> {
    let mut placed: Vec<Option<Pose>> = vec![None; cameras.len()];
    placed[0] = Some(Pose::identity());
    loop {
        let mut best: Option<(usize, usize, Pose)> = None;
        for (a, known) in placed.iter().enumerate() {
            let Some(a_from_world) = known else { continue };
            for b in (0..cameras.len()).filter(|&b| placed[b].is_none()) {
                let shots = single[a].iter().zip(&single[b]);
                let b_from_a: Vec<Pose> = shots
                    .filter_map(|(a, b)| {
                        let (a, b) = (a.as_ref()?, b.as_ref()?);
                        Some(b.camera_from_target * a.camera_from_target.inverse())
                    })
                    .collect();
                if b_from_a.len() > best.as_ref().map_or(0, |(most, ..)| *most) {
                    best = Some((b_from_a.len(), b, most_agreed(&b_from_a) * a_from_world));
                }
            }
        }
        let Some((_, b, pose)) = best else { break };
        placed[b] = Some(pose);
    }
    if let Some(single) = placed.iter().position(Option::is_none) {
        return Err(CalibrationError::new(
            format!(
                "camera {} never saw the target together with another camera",
                cameras[single].name
            ),
            "take shots in which this camera and another one see the target",
        ));
    }
    let camera_from_world: Vec<Pose> = placed.into_iter().flatten().collect();
    let world_from_target = (0..cameras[0].views.len())
        .map(|shot| {
            let seen = (0..cameras.len()).filter_map(|c| Some((c, single[c][shot].as_ref()?)));
            let best = seen.min_by(|a, b| a.1.rms_px.total_cmp(&b.1.rms_px));
            best.map(|(c, fit)| camera_from_world[c].inverse() * fit.camera_from_target)
        })
        .collect();
    Ok((camera_from_world, world_from_target))
}

/// Returns the pose with the smallest median difference from the others: rotation in radians plus translation
/// relative to the distances.
fn most_agreed(poses: &[Pose]) -> Pose {
    let median_difference = |pose: &Pose| {
        let mut differences: Vec<f64> = poses
            .iter()
            .map(|other| {
                let turn = (other.rotation * pose.rotation.inverse()).angle();
                let (a, b) = (pose.translation.vector, other.translation.vector);
                turn + (a - b).norm() / (a.norm() + b.norm()).max(f64::MIN_POSITIVE)
            })
            .collect();
        let middle = differences.len() / 2;
        *differences.select_nth_unstable_by(middle, f64::total_cmp).1
    };
    poses
        .iter()
        .min_by(|a, b| median_difference(a).total_cmp(&median_difference(b)))
        .map_or_else(Pose::identity, |pose| *pose)
}

/// Returns the median length of residuals; points without a pixel count as infinitely long.
fn median_px(residuals_px: &[Option<[f64; 2]>]) -> Option<f64> {
    let mut lengths: Vec<f64> = residuals_px
        .iter()
        .map(|r| r.map_or(f64::INFINITY, |[u, v]| libm::hypot(u, v)))
        .collect();
    let middle = lengths.len() / 2;
    (!lengths.is_empty()).then(|| *lengths.select_nth_unstable_by(middle, f64::total_cmp).1)
}

/// The least-squares problem. Its unknowns are each camera's free parameters, then six per camera but the
/// first, then six per shot.
#[derive(Clone)]
struct Rig<'a> {
    cameras: &'a [RigCamera],
    free: &'a [Vec<bool>],
    models: Vec<Camera>,
    camera_from_world: Vec<Pose>,
    world_from_target: Vec<Option<Pose>>,
    /// By camera, shot and point.
    used: Vec<Vec<Vec<bool>>>,
}

impl Rig<'_> {
    fn free_count(&self, camera: usize) -> usize {
        self.free[camera].iter().filter(|f| **f).count()
    }

    /// Returns the index of the first unknown of a camera's parameters.
    fn parameters_at(&self, camera: usize) -> usize {
        (0..camera).map(|c| self.free_count(c)).sum()
    }

    /// Returns the index of the first unknown of a camera's pose (not for the first camera).
    fn camera_at(&self, camera: usize) -> usize {
        self.parameters_at(self.cameras.len()) + 6 * (camera - 1)
    }

    /// Returns the index of the first unknown of a shot's pose (for shots with a pose).
    fn shot_at(&self, shot: usize) -> usize {
        let before = self.world_from_target[..shot].iter().flatten().count();
        self.parameters_at(self.cameras.len()) + 6 * (self.cameras.len() - 1 + before)
    }

    /// Returns the shots in which a camera's view deviates strongly, compared with the fits of its individual
    /// views.
    fn rejected_shots(&self, single: &[Vec<Option<PoseFit>>]) -> Vec<usize> {
        let residuals = self.residuals();
        let bounds_px = single.iter().map(|views| {
            let fits = views.iter().flatten();
            let own: Vec<_> = fits
                .flat_map(|fit| fit.residuals_px.iter().copied())
                .collect();
            STEP_PX.max(STEP_RATIO * median_px(&own).unwrap_or(0.0))
        });
        let bounds_px: Vec<f64> = bounds_px.collect();
        (0..self.world_from_target.len())
            .filter(|&shot| {
                let views = residuals.iter().zip(&bounds_px);
                self.world_from_target[shot].is_some()
                    && views
                        .filter_map(|(shots, bound)| Some(median_px(&shots[shot])? > *bound))
                        .any(|off| off)
            })
            .collect()
    }

    /// Requires that at least two thirds of the shots are consistent.
    fn check_rejected(&self, rejected_shots: &[usize]) -> Result<(), CalibrationError> {
        const MAX_NAMED: usize = 6;
        let shots = self.world_from_target.iter().flatten().count();
        if 3 * rejected_shots.len() <= shots {
            return Ok(());
        }
        let mut named: Vec<String> = rejected_shots
            .iter()
            .take(MAX_NAMED)
            .map(|&shot| self.shot_name(shot))
            .collect();
        if rejected_shots.len() > MAX_NAMED {
            named.push("...".to_owned());
        }
        Err(CalibrationError::new(
            format!(
                "the cameras disagree on the target's position in {} of {shots} shots: {}",
                rejected_shots.len(),
                named.join(", ")
            ),
            "give simultaneous images, and check whether one is missing, which shifts the others",
        ))
    }

    /// Returns the images of a shot: `left01.jpg with right01.jpg`.
    fn shot_name(&self, shot: usize) -> String {
        let views = self.cameras.iter().filter_map(|c| c.views[shot].as_ref());
        let names: Vec<&str> = views.map(|view| &*view.name).collect();
        names.join(" with ")
    }

    /// Computes observed minus projected pixels by camera, shot and point.
    fn residuals(&self) -> Vec<Vec<Vec<Option<[f64; 2]>>>> {
        (0..self.cameras.len())
            .map(|c| {
                let views = self.cameras[c].views.iter().zip(&self.world_from_target);
                views
                    .map(|(view, pose)| {
                        let Some(view) = view else { return Vec::new() };
                        let points = view.correspondences.iter();
                        points
                            .map(|o| {
                                let world = pose.as_ref()? * Point3::from(o.point_m);
                                let point = self.camera_from_world[c] * world;
                                let [u, v] = self.models[c].project(point.into())?;
                                Some([o.pixel[0] - u, o.pixel[1] - v])
                            })
                            .collect()
                    })
                    .collect()
            })
            .collect()
    }

    fn finish(self, rejected_shots: Vec<usize>) -> Result<RigCalibration, CalibrationError> {
        let residuals = self.residuals();
        let mut outliers = Vec::new();
        let mut rms_px = Vec::new();
        for (c, shots) in residuals.iter().enumerate() {
            let mut inliers = Vec::new();
            for (s, points) in shots.iter().enumerate() {
                if self.world_from_target[s].is_none() {
                    continue;
                }
                for (i, residual) in points.iter().enumerate() {
                    match residual {
                        Some(residual) if self.used[c][s][i] => inliers.push(*residual),
                        _ => outliers.push((c, s, i)),
                    }
                }
            }
            rms_px.push(rms(inliers.into_iter()));
        }
        let (baseline_sigma_m, turn_sigma_rad) = self.pose_sigmas()?;
        let cameras = self
            .cameras
            .iter()
            .zip(self.models)
            .zip(&self.camera_from_world)
            .map(|((c, camera), pose)| CalibratedCamera {
                name: c.name.clone(),
                camera,
                size_px: Some(c.size_px),
                world_from_camera: Some(pose.inverse()),
            })
            .collect();
        Ok(RigCalibration {
            cameras,
            world_from_target: self.world_from_target,
            rms_px,
            residuals_px: residuals,
            outliers,
            rejected_shots,
            baseline_sigma_m,
            turn_sigma_rad,
        })
    }

    /// Computes the standard deviations of each camera's distance from the first (metres) and of its rotation
    /// (radians).
    fn pose_sigmas(&self) -> Result<(Vec<f64>, Vec<f64>), CalibrationError> {
        let covariance = covariance(self).ok_or_else(|| {
            CalibrationError::new(
                "the shots do not determine the poses of the cameras",
                "take more shots in which several cameras see the target, at different distances and orientations",
            )
        })?;
        let (mut squares, mut points) = (0.0, 0);
        self.visit(&mut |residual, _| {
            let [u, v] = residual.unwrap_or_default();
            squares += u * u + v * v;
            points += 1;
        });
        let freedom = (2 * points) as f64 - self.unknowns() as f64;
        let sigma_px = (squares / freedom.max(1.0)).sqrt();
        let along = |at: usize, direction: Option<Unit<Vector3<f64>>>| {
            let block = covariance.fixed_view::<3, 3>(at, at);
            direction.map_or(0.0, |d| sigma_px * d.dot(&(block * *d)).sqrt())
        };
        let mut sigmas = (vec![0.0], vec![0.0]);
        for (c, pose) in self.camera_from_world.iter().enumerate().skip(1) {
            let at = self.camera_at(c);
            // The distance is the length of this translation; a rotation of the frame does not change it.
            let towards = Unit::try_new(pose.translation.vector, 0.0);
            sigmas.0.push(along(at + 3, towards));
            sigmas.1.push(along(at, pose.rotation.axis()));
        }
        Ok(sigmas)
    }
}

impl Problem for Rig<'_> {
    fn unknowns(&self) -> usize {
        self.shot_at(self.world_from_target.len())
    }

    fn stepped(&self, step: &DVector<f64>) -> Option<Self> {
        let mut next = self.clone();
        let step = step.as_slice();
        for (c, model) in next.models.iter_mut().enumerate() {
            let mut values: Vec<f64> = model.parameters().iter().map(|p| p.1).collect();
            let free = (0..values.len()).filter(|&i| self.free[c][i]);
            for (i, step) in free.zip(&step[self.parameters_at(c)..]) {
                values[i] += step;
            }
            *model = model.with_parameters(&values).ok()?;
        }
        for (c, pose) in next.camera_from_world.iter_mut().enumerate().skip(1) {
            let at = self.camera_at(c);
            *pose = stepped_pose(pose, &step[at..at + 6]);
        }
        for (shot, pose) in next.world_from_target.iter_mut().enumerate() {
            let at = self.shot_at(shot);
            *pose = pose.map(|pose| stepped_pose(&pose, &step[at..at + 6]));
        }
        Some(next)
    }

    fn visit(&self, visit: &mut dyn FnMut(Option<[f64; 2]>, Slopes<'_>)) {
        for (c, camera) in self.cameras.iter().enumerate() {
            let camera_from_world = &self.camera_from_world[c];
            for (shot, view) in camera.views.iter().enumerate() {
                let (Some(view), Some(pose)) = (view, &self.world_from_target[shot]) else {
                    continue;
                };
                let shot_at = self.shot_at(shot);
                for (o, _) in view
                    .correspondences
                    .iter()
                    .zip(&self.used[c][shot])
                    .filter(|(_, used)| **used)
                {
                    let world = pose * Point3::from(o.point_m);
                    let point = camera_from_world * world;
                    let Some(jacobian) = self.models[c].project_with_jacobian(point.into()) else {
                        visit(None, Slopes { blocks: &[] });
                        continue;
                    };
                    let mut by_parameters = [[0.0; 2]; 20];
                    let free = jacobian.by_parameters.iter().zip(&self.free[c]);
                    for (i, (slopes, _)) in free.filter(|(_, free)| **free).enumerate() {
                        by_parameters[i] = *slopes;
                    }
                    let rotated = point.coords - camera_from_world.translation.vector;
                    let by_camera = slopes_by_pose(rotated, &jacobian);
                    // A translation in the world is the same translation rotated into the camera.
                    let by_world = ProjectionJacobian {
                        by_point: jacobian.by_point.map(|row| {
                            (camera_from_world.rotation.inverse() * Vector3::from(row)).into()
                        }),
                        ..jacobian
                    };
                    let by_shot = slopes_by_pose(world.coords - pose.translation.vector, &by_world);
                    let [u, v] = by_world.pixel;
                    let parameters = (self.parameters_at(c), &by_parameters[..self.free_count(c)]);
                    let shot_block = (shot_at, &by_shot[..]);
                    let residual = Some([u - o.pixel[0], v - o.pixel[1]]);
                    if c == 0 {
                        visit(
                            residual,
                            Slopes {
                                blocks: &[parameters, shot_block],
                            },
                        );
                    } else {
                        let camera_block = (self.camera_at(c), &by_camera[..]);
                        visit(
                            residual,
                            Slopes {
                                blocks: &[parameters, camera_block, shot_block],
                            },
                        );
                    }
                }
            }
        }
    }
}
