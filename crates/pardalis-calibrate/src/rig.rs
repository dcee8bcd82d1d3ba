//! Where several cameras stand to one another, from targets that two or more of them saw at the same time.

use nalgebra::{DVector, Point3, Unit, Vector3};

use super::least_squares::{Loss, Problem, Slopes, covariance, minimise};
use super::pose::{PoseFit, closest_pose, slopes_by_pose, stepped_pose};
use super::start::free_parameters;
use super::{CalibrationView, Refusal, check, rms};
use pardalis_camera::{CalibratedCamera, Pose};
use pardalis_camera::{Camera, ProjectionJacobian};

/// One camera of a rig and what it saw.
#[derive(Debug, Clone, PartialEq)]
pub struct RigCamera {
    /// Its name.
    pub name: String,
    /// Its calibration so far; it is refined together with the poses.
    pub camera: Camera,
    /// Width and height of its images in pixels.
    pub size_px: (usize, usize),
    /// One a shot, the same shots in the same order for all cameras; `None` where it saw no target.
    pub views: Vec<Option<CalibrationView>>,
}

/// A calibrated rig.
#[derive(Debug, Clone, PartialEq)]
pub struct RigCalibration {
    /// The cameras with their poses; the first camera is the world.
    pub cameras: Vec<CalibratedCamera>,
    /// Where the target stood in each shot that was used.
    pub world_from_target: Vec<Option<Pose>>,
    /// Root mean square distance of each camera's points, outliers left out.
    pub rms_px: Vec<f64>,
    /// Observed minus projected pixels by camera, shot and point; `None` where a point projects nowhere or its shot was left out.
    pub residuals_px: Vec<Vec<Vec<Option<[f64; 2]>>>>,
    /// The points left out, as (camera, shot, point); those of shots left out are not among them.
    pub outliers: Vec<(usize, usize, usize)>,
    /// The shots left out, because the cameras do not agree on where the target was: their images do not belong together.
    pub out_of_step: Vec<usize>,
    /// The standard deviation of each camera's distance from the first; zero for the first.
    pub baseline_sigma_m: Vec<f64>,
    /// The standard deviation of the angle by which each camera is turned from the first; zero for the first.
    pub turn_sigma_rad: Vec<f64>,
}

/// A view belongs to its shot where the median residual of its points is within this many times that of the camera's views on their own...
const STEP_RATIO: f64 = 10.0;

/// ... or within so many pixels.
const STEP_PX: f64 = 1.0;

/// Fits the poses of all cameras and targets, and refines the cameras. Cameras may be chained: each needs a shot in common with one of the others.
/// Points beyond `outlier_sigmas` robust standard deviations are left out, as by [`closest_pose`]; so are whole shots in which the cameras do not agree on
/// where the target was, if they are few.
pub fn calibrate_rig(
    cameras: &[RigCamera],
    outlier_sigmas: f64,
) -> Result<RigCalibration, Refusal> {
    let shots = cameras.first().map_or(0, |c| c.views.len());
    if cameras.len() < 2 || shots == 0 || cameras.iter().any(|c| c.views.len() != shots) {
        return Err(Refusal::new(
            "a rig needs two or more cameras with equally many shots",
            "give images of all cameras, taken at the same instants",
        ));
    }
    let alone: Vec<Vec<Option<PoseFit>>> = cameras
        .iter()
        .map(|c| {
            let fit = |view: &Option<CalibrationView>| {
                closest_pose(&c.camera, &view.as_ref()?.correspondences, outlier_sigmas).ok()
            };
            c.views.iter().map(fit).collect()
        })
        .collect();
    let (camera_from_world, world_from_target) = place(cameras, &alone)?;
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
    let out_of_step = rig.out_of_step(&alone);
    rig.check_step(&out_of_step)?;
    for &shot in &out_of_step {
        rig.world_from_target[shot] = None;
    }
    for (c, shots) in rig.residuals().into_iter().enumerate() {
        let in_step = |s: &usize| !out_of_step.contains(s);
        let residuals: Vec<_> = (0..shots.len())
            .filter(in_step)
            .flat_map(|s| shots[s].iter().copied())
            .collect();
        let inliers = check::inliers(&residuals, outlier_sigmas);
        check::mostly_inliers(&format!("camera {}", cameras[c].name), &inliers)?;
        let mut inliers = inliers.into_iter();
        for s in (0..shots.len()).filter(in_step) {
            rig.used[c][s]
                .iter_mut()
                .zip(inliers.by_ref())
                .for_each(|(u, i)| *u = i);
        }
    }
    let (rig, _) = minimise(rig, Loss::Squares, 100);
    rig.finish(out_of_step)
}

/// First poses: the first camera is the world, the others are chained to it by shots in common, those with most of them first. What one shot
/// says of two cameras is taken from the shot with which the others agree best.
fn place(
    cameras: &[RigCamera],
    alone: &[Vec<Option<PoseFit>>],
) -> Result<(Vec<Pose>, Vec<Option<Pose>>), Refusal> {
    let mut placed: Vec<Option<Pose>> = vec![None; cameras.len()];
    placed[0] = Some(Pose::identity());
    loop {
        let mut best: Option<(usize, usize, Pose)> = None;
        for (a, known) in placed.iter().enumerate() {
            let Some(a_from_world) = known else { continue };
            for b in (0..cameras.len()).filter(|&b| placed[b].is_none()) {
                let shots = alone[a].iter().zip(&alone[b]);
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
    if let Some(alone) = placed.iter().position(Option::is_none) {
        return Err(Refusal::new(
            format!(
                "camera {} never saw the target together with another camera",
                cameras[alone].name
            ),
            "take shots in which both it and another camera see the target",
        ));
    }
    let camera_from_world: Vec<Pose> = placed.into_iter().flatten().collect();
    let world_from_target = (0..cameras[0].views.len())
        .map(|shot| {
            let seen = (0..cameras.len()).filter_map(|c| Some((c, alone[c][shot].as_ref()?)));
            let best = seen.min_by(|a, b| a.1.rms_px.total_cmp(&b.1.rms_px));
            best.map(|(c, fit)| camera_from_world[c].inverse() * fit.camera_from_target)
        })
        .collect();
    Ok((camera_from_world, world_from_target))
}

/// The pose from which the others differ least, by the median of turn (in radians) and shift (by the distance of both).
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

/// The median length of residuals; those of points without a pixel count as long.
fn median_px(residuals_px: &[Option<[f64; 2]>]) -> Option<f64> {
    let mut lengths: Vec<f64> = residuals_px
        .iter()
        .map(|r| r.map_or(f64::INFINITY, |[u, v]| u.hypot(v)))
        .collect();
    let middle = lengths.len() / 2;
    (!lengths.is_empty()).then(|| *lengths.select_nth_unstable_by(middle, f64::total_cmp).1)
}

/// The unknowns: each camera's free parameters, then six for each camera but the first, then six for each shot.
#[derive(Clone)]
struct Rig<'a> {
    cameras: &'a [RigCamera],
    free: &'a [Vec<bool>],
    models: Vec<Camera>,
    camera_from_world: Vec<Pose>,
    world_from_target: Vec<Option<Pose>>,
    /// By camera, shot, point.
    used: Vec<Vec<Vec<bool>>>,
}

impl Rig<'_> {
    fn free_count(&self, camera: usize) -> usize {
        self.free[camera].iter().filter(|f| **f).count()
    }

    /// The first unknown of a camera's parameters.
    fn parameters_at(&self, camera: usize) -> usize {
        (0..camera).map(|c| self.free_count(c)).sum()
    }

    /// The first unknown of a camera's pose, for cameras but the first.
    fn camera_at(&self, camera: usize) -> usize {
        self.parameters_at(self.cameras.len()) + 6 * (camera - 1)
    }

    /// The first unknown of a shot's pose, for shots that have one.
    fn shot_at(&self, shot: usize) -> usize {
        let before = self.world_from_target[..shot].iter().flatten().count();
        self.parameters_at(self.cameras.len()) + 6 * (self.cameras.len() - 1 + before)
    }

    /// The shots in which a camera's view lies far off, measured by how well its views fit on their own.
    fn out_of_step(&self, alone: &[Vec<Option<PoseFit>>]) -> Vec<usize> {
        let residuals = self.residuals();
        let bounds_px = alone.iter().map(|views| {
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

    /// Few shots may be out of step: those that agree must be two in three.
    fn check_step(&self, out_of_step: &[usize]) -> Result<(), Refusal> {
        const MAX_NAMED: usize = 6;
        let shots = self.world_from_target.iter().flatten().count();
        if 3 * out_of_step.len() <= shots {
            return Ok(());
        }
        let mut named: Vec<String> = out_of_step
            .iter()
            .take(MAX_NAMED)
            .map(|&shot| self.shot_name(shot))
            .collect();
        if out_of_step.len() > MAX_NAMED {
            named.push("...".to_owned());
        }
        Err(Refusal::new(
            format!(
                "the cameras do not agree on where the target was in {} of {shots} shots: {}",
                out_of_step.len(),
                named.join(", ")
            ),
            "give images that were taken at the same instants: is one missing, so that the others are out of step?",
        ))
    }

    /// `left01.jpg with right01.jpg`.
    fn shot_name(&self, shot: usize) -> String {
        let views = self.cameras.iter().filter_map(|c| c.views[shot].as_ref());
        let names: Vec<&str> = views.map(|view| &*view.name).collect();
        names.join(" with ")
    }

    /// Observed minus projected pixels, by camera, shot, point.
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

    fn finish(self, out_of_step: Vec<usize>) -> Result<RigCalibration, Refusal> {
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
            out_of_step,
            baseline_sigma_m,
            turn_sigma_rad,
        })
    }

    /// Standard deviations of each camera's distance from the first and of its turn.
    fn pose_sigmas(&self) -> Result<(Vec<f64>, Vec<f64>), Refusal> {
        let covariance = covariance(self).ok_or_else(|| {
            Refusal::new(
                "the shots do not determine where the cameras stand",
                "take more shots in which several cameras see the target, near and far and turned",
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
            // The distance is the length of this shift: a turn of the frame does not change it.
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
                    // A shift in the world is the same shift turned into the camera.
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
