//! Where several cameras stand to one another, from targets that two or more of them saw at the same time.

use nalgebra::{DVector, Point3, Vector3};

use super::least_squares::{Loss, Problem, Slopes, minimise};
use super::pose::{fit_pose, slopes_by_pose, stepped_pose};
use super::start::free_parameters;
use super::{CalibrationView, Refusal, check, rms};
use crate::camera::{Camera, ProjectionJacobian};
use crate::rig::{CalibratedCamera, Pose};

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
    /// The points left out, as (camera, shot, point).
    pub outliers: Vec<(usize, usize, usize)>,
}

/// Fits the poses of all cameras and targets, and refines the cameras. Cameras may be chained: each needs a shot in common with one of the others.
/// Points beyond `outlier_sigmas` robust standard deviations are left out, as by [`fit_pose`].
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
    let (camera_from_world, world_from_target) = place(cameras, shots, outlier_sigmas)?;
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
    for (c, shots) in rig.residuals().into_iter().enumerate() {
        let residuals: Vec<_> = shots.iter().flatten().copied().collect();
        let inliers = check::inliers(&residuals, outlier_sigmas);
        check::mostly_inliers(&format!("camera {}", cameras[c].name), &inliers)?;
        let mut inliers = inliers.into_iter();
        for used in &mut rig.used[c] {
            used.iter_mut()
                .zip(inliers.by_ref())
                .for_each(|(u, i)| *u = i);
        }
    }
    let (rig, _) = minimise(rig, Loss::Squares, 100);
    Ok(rig.finish())
}

/// First poses: the first camera is the world, the others are chained to it by shots in common, the one with the best fit of a pair.
fn place(
    cameras: &[RigCamera],
    shots: usize,
    outlier_sigmas: f64,
) -> Result<(Vec<Pose>, Vec<Option<Pose>>), Refusal> {
    let mut fits: Vec<Vec<Option<(Pose, f64)>>> = Vec::new();
    for camera in cameras {
        let fit = |view: &Option<CalibrationView>| {
            let points = &view.as_ref()?.correspondences;
            let fit = fit_pose(&camera.camera, points, outlier_sigmas).ok()?;
            Some((fit.camera_from_target, fit.rms_px))
        };
        fits.push(camera.views.iter().map(fit).collect());
    }
    let mut placed: Vec<Option<Pose>> = vec![None; cameras.len()];
    placed[0] = Some(Pose::identity());
    loop {
        let mut best: Option<(f64, usize, Pose)> = None;
        for (a, known) in placed.iter().enumerate() {
            let Some(a_from_world) = known else { continue };
            for b in (0..cameras.len()).filter(|&b| placed[b].is_none()) {
                for shot in 0..shots {
                    if let (Some((a_from_t, ra)), Some((b_from_t, rb))) =
                        (&fits[a][shot], &fits[b][shot])
                        && best.as_ref().is_none_or(|(least, ..)| ra + rb < *least)
                    {
                        let b_from_world = b_from_t * a_from_t.inverse() * a_from_world;
                        best = Some((ra + rb, b, b_from_world));
                    }
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
    let world_from_target = (0..shots)
        .map(|shot| {
            let seen = (0..cameras.len()).filter_map(|c| Some((c, fits[c][shot]?)));
            let best = seen.min_by(|a, b| a.1.1.total_cmp(&b.1.1));
            best.map(|(c, (camera_from_target, _))| {
                camera_from_world[c].inverse() * camera_from_target
            })
        })
        .collect();
    Ok((camera_from_world, world_from_target))
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

    fn shot_at(&self, shot: usize) -> usize {
        self.parameters_at(self.cameras.len()) + 6 * (self.cameras.len() - 1 + shot)
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

    fn finish(self) -> RigCalibration {
        let residuals = self.residuals();
        let mut outliers = Vec::new();
        let mut rms_px = Vec::new();
        for (c, shots) in residuals.iter().enumerate() {
            let mut inliers = Vec::new();
            for (s, points) in shots.iter().enumerate() {
                for (i, residual) in points.iter().enumerate() {
                    match residual {
                        Some(residual) if self.used[c][s][i] => inliers.push(*residual),
                        _ => outliers.push((c, s, i)),
                    }
                }
            }
            rms_px.push(rms(inliers.into_iter()));
        }
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
        RigCalibration {
            cameras,
            world_from_target: self.world_from_target,
            rms_px,
            outliers,
        }
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
                    let shot_block = (self.shot_at(shot), &by_shot[..]);
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
