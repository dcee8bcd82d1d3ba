//! The bundle adjustment problem: a camera and the poses of all its views.

use nalgebra::{DVector, Point3};

use super::least_squares::{Loss, Problem, Slopes, minimise};
use super::pose::{mirrored, pose_from_rays, residuals_px, slopes_by_pose, stepped_pose};
use super::{CalibrationView, rms};
use pardalis_camera::Camera;
use pardalis_camera::Pose;

/// A camera with the poses of all its views. The unknowns are the free parameters, then six per view.
#[derive(Clone)]
pub(super) struct Bundle<'a> {
    pub(super) views: &'a [CalibrationView],
    pub(super) free: &'a [bool],
    pub(super) camera: Camera,
    pub(super) poses: Vec<Pose>,
    pub(super) used: Vec<Vec<bool>>,
}

impl Bundle<'_> {
    pub(super) fn free_count(&self) -> usize {
        self.free.iter().filter(|f| **f).count()
    }

    pub(super) fn residuals(&self) -> Vec<Vec<Option<[f64; 2]>>> {
        self.views
            .iter()
            .zip(&self.poses)
            .map(|(v, pose)| residuals_px(&self.camera, pose, &v.correspondences))
            .collect()
    }

    pub(super) fn inlier_residuals(&self) -> impl Iterator<Item = [f64; 2]> {
        let used = self.used.clone().into_iter().flatten();
        let residuals = self.residuals().into_iter().flatten();
        residuals
            .zip(used)
            .filter_map(|(r, used)| r.filter(|_| used))
    }

    /// Returns the largest angle between the optical axis and the ray of a used point, in radians.
    pub(super) fn max_angle_rad(&self) -> f64 {
        let mut max = 0.0_f64;
        for ((view, pose), used) in self.views.iter().zip(&self.poses).zip(&self.used) {
            for (c, _) in view.correspondences.iter().zip(used).filter(|(_, u)| **u) {
                let p: [f64; 3] = (pose * Point3::from(c.point_m)).into();
                // Without a single viewpoint, the direction of the ray differs from the direction of the point.
                let ray = matches!(self.camera, Camera::ExactMirror(_))
                    .then(|| self.camera.unproject(self.camera.project(p)?))
                    .flatten();
                let [x, y, z] = ray.map_or(p, |ray| ray.direction);
                let z = if self.camera.looks_into_mirror() {
                    -z
                } else {
                    z
                };
                max = max.max(libm::atan2(libm::hypot(x, y), z));
            }
        }
        max
    }

    /// Returns the largest distance of an observed pixel from the model's centre (the first two parameters of
    /// the polynomial model).
    pub(super) fn max_radius_px(&self) -> f64 {
        let parameters = self.camera.parameters();
        let (cx, cy) = (parameters[0].1, parameters[1].1);
        let pixels = self.views.iter().flat_map(|v| &v.correspondences);
        pixels
            .map(|c| libm::hypot(c.pixel[0] - cx, c.pixel[1] - cy))
            .fold(1.0, f64::max)
    }

    /// Reports whether the same points with x negated fit much better.
    pub(super) fn mirrored_fits_better(&self, rms_px: f64) -> bool {
        let views: Vec<CalibrationView> = self
            .views
            .iter()
            .map(|view| CalibrationView {
                name: view.name.clone(),
                correspondences: mirrored(&view.correspondences),
            })
            .collect();
        let poses: Option<Vec<Pose>> = views
            .iter()
            .map(|v| pose_from_rays(&self.camera, &v.correspondences))
            .collect();
        let Some(poses) = poses else { return false };
        let bundle = Bundle {
            views: &views,
            free: self.free,
            camera: self.camera.clone(),
            poses,
            used: self.used.clone(),
        };
        let (bundle, _) = minimise(bundle, Loss::Cauchy(30.0), 100);
        rms(bundle.inlier_residuals()) < 0.2 * rms_px
    }
}

impl Problem for Bundle<'_> {
    fn unknowns(&self) -> usize {
        self.free_count() + 6 * self.poses.len()
    }

    fn stepped(&self, step: &DVector<f64>) -> Option<Self> {
        let mut next = 0;
        let values: Vec<f64> = self
            .camera
            .parameters()
            .into_iter()
            .zip(self.free)
            .map(|((_, value), free)| {
                if !free {
                    return value;
                }
                next += 1;
                value + step[next - 1]
            })
            .collect();
        let camera = self.camera.with_parameters(&values).ok()?;
        let poses = self
            .poses
            .iter()
            .enumerate()
            .map(|(v, pose)| stepped_pose(pose, &step.as_slice()[next + 6 * v..next + 6 * v + 6]))
            .collect();
        Some(Self {
            camera,
            poses,
            used: self.used.clone(),
            ..*self
        })
    }

    fn visit(&self, visit: &mut dyn FnMut(Option<[f64; 2]>, Slopes<'_>)) {
        let free_count = self.free_count();
        for (v, (view, pose)) in self.views.iter().zip(&self.poses).enumerate() {
            let used = view.correspondences.iter().zip(&self.used[v]);
            for (c, _) in used.filter(|(_, used)| **used) {
                let point = pose * Point3::from(c.point_m);
                let Some(jacobian) = self.camera.project_with_jacobian(point.into()) else {
                    visit(None, Slopes { blocks: &[] });
                    continue;
                };
                let by_pose = slopes_by_pose(point.coords - pose.translation.vector, &jacobian);
                let mut by_parameters = [[0.0; 2]; 20];
                let free = jacobian.by_parameters.iter().zip(self.free);
                for (i, (slopes, _)) in free.filter(|(_, free)| **free).enumerate() {
                    by_parameters[i] = *slopes;
                }
                let [u, v_px] = jacobian.pixel;
                visit(
                    Some([u - c.pixel[0], v_px - c.pixel[1]]),
                    Slopes {
                        blocks: &[
                            (0, &by_parameters[..free_count]),
                            (free_count + 6 * v, &by_pose),
                        ],
                    },
                );
            }
        }
    }
}
