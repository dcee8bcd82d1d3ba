//! A camera's pose from known points: first linearly from the rays of the pixels, then by least squares on the pixels.

use nalgebra::{
    DMatrix, DVector, Matrix3, Point3, Rotation3, SymmetricEigen, Translation3, Vector3,
};

use super::least_squares::{Loss, Problem, Slopes, covariance, minimise};
use super::spread::Spread;
use super::{Correspondence, Refusal, check, rms};
use pardalis_camera::Pose;
use pardalis_camera::{Camera, ProjectionJacobian};
use pardalis_core::rng::{Draws, Stage};

/// A camera's pose with its uncertainty.
#[derive(Debug, Clone, PartialEq)]
pub struct PoseFit {
    /// The pose.
    pub camera_from_target: Pose,
    /// Standard deviations: rotation about the camera's axes, in radians, then translation in metres.
    pub pose_sigma: [f64; 6],
    /// Observed minus projected pixel, one a correspondence; `None` where a point projects nowhere.
    pub residuals_px: Vec<Option<[f64; 2]>>,
    /// The correspondences that were left out.
    pub outliers: Vec<usize>,
    /// Root mean square distance of the others.
    pub rms_px: f64,
}

/// The pose of a calibrated camera from at least four correspondences in a plane, or six. Robust: points with residuals beyond `outlier_sigmas`
/// ([`OUTLIER_SIGMAS`](super::OUTLIER_SIGMAS)) robust standard deviations are left out; infinity keeps all that project.
///
/// Refused: what [`closest_pose`] refuses, pixels outside of images of `size_px`, and points and pixels that do not belong together.
pub fn fit_pose(
    camera: &Camera,
    size_px: (usize, usize),
    correspondences: &[Correspondence],
    outlier_sigmas: f64,
) -> Result<PoseFit, Refusal> {
    check::enough_points("the pose", correspondences, 4)?;
    check::pixels(correspondences.iter().map(|c| c.pixel), size_px)?;
    let largest_rms_px = check::largest_rms_px(size_px);
    let fit = closest_pose(camera, correspondences, outlier_sigmas);
    let rms_px = match &fit {
        Ok(found) if found.rms_px <= largest_rms_px => return fit,
        Ok(found) => found.rms_px,
        Err(_) => f64::INFINITY,
    };
    let fits = |changed: &[Correspondence]| {
        closest_pose(camera, changed, outlier_sigmas)
            .is_ok_and(|fit| fit.rms_px < 0.2 * rms_px.min(largest_rms_px))
    };
    if fits(&mirrored(correspondences)) {
        return Err(check::mirrored(rms_px));
    }
    if fits(&swapped(correspondences)) {
        return Err(Refusal::new(
            "points and pixels agree only with u and v exchanged",
            "u runs to the right, v down: check which column is which",
        ));
    }
    // What could not be fitted at all has its reason.
    fit.and_then(|_| {
        Err(Refusal::new(
            format!(
                "no pose of this camera brings the points nearer than {rms_px:.1} px to their pixels"
            ),
            "check that the camera's file belongs to these images, the order of the points, and that all coordinates are in metres",
        ))
    })
}

/// The points as in a mirror: x turned round.
pub(super) fn mirrored(correspondences: &[Correspondence]) -> Vec<Correspondence> {
    let mirror = |c: &Correspondence| Correspondence {
        point_m: [-c.point_m[0], c.point_m[1], c.point_m[2]],
        ..*c
    };
    correspondences.iter().map(mirror).collect()
}

/// The pixels with u and v exchanged.
fn swapped(correspondences: &[Correspondence]) -> Vec<Correspondence> {
    let swap = |c: &Correspondence| Correspondence {
        pixel: [c.pixel[1], c.pixel[0]],
        ..*c
    };
    correspondences.iter().map(swap).collect()
}

/// The pose that brings the points nearest to their pixels, whether that is near or not: [`fit_pose`] for points that are known to be right, or
/// to judge the camera by.
///
/// Refused: too few points, points in a line, and those most of which the camera does not see or that do not agree with one another.
pub fn closest_pose(
    camera: &Camera,
    correspondences: &[Correspondence],
    outlier_sigmas: f64,
) -> Result<PoseFit, Refusal> {
    check::enough_points("the pose", correspondences, 4)?;
    if !check::spread("the pose", correspondences)?.flat() {
        // Four or five points have several poses that nearly fit, and no linear solution to tell which.
        check::enough_points("a pose from points not in one plane", correspondences, 6)?;
    }
    let start = pose_from_rays(camera, correspondences).ok_or_else(|| {
        Refusal::new(
            "most of the pixels have no rays in this camera",
            "check that the camera's file belongs to these images",
        )
    })?;
    let problem = |pose, used| PoseProblem {
        camera,
        pose,
        correspondences,
        used,
    };
    let all = vec![true; correspondences.len()];
    let (robust, _) = minimise(problem(start, all), Loss::Cauchy(2.0), 60);
    let residuals = residuals_px(camera, &robust.pose, correspondences);
    let used = check::inliers(&residuals, outlier_sigmas);
    check::mostly_inliers("the pose", &used)?;
    let (fitted, _) = minimise(problem(robust.pose, used), Loss::Squares, 60);
    let residuals_px = residuals_px(camera, &fitted.pose, correspondences);
    let inliers = residuals_px
        .iter()
        .zip(&fitted.used)
        .filter(|(_, used)| **used);
    let rms_px = rms(inliers.filter_map(|(r, _)| *r));
    let count = fitted.used.iter().filter(|used| **used).count();
    let Some(covariance) = covariance(&fitted) else {
        return Err(Refusal::new(
            "the points do not determine the pose",
            "use at least four points that are spread over the image",
        ));
    };
    let freedom = (2.0 * count as f64 - 6.0).max(1.0);
    let sigma_px = rms_px * (count as f64 / freedom).sqrt();
    Ok(PoseFit {
        camera_from_target: fitted.pose,
        pose_sigma: std::array::from_fn(|i| sigma_px * covariance[(i, i)].sqrt()),
        outliers: (0..correspondences.len())
            .filter(|&i| !fitted.used[i])
            .collect(),
        residuals_px,
        rms_px,
    })
}

/// Observed minus projected pixels.
pub(super) fn residuals_px(
    camera: &Camera,
    camera_from_target: &Pose,
    correspondences: &[Correspondence],
) -> Vec<Option<[f64; 2]>> {
    correspondences
        .iter()
        .map(|c| {
            let point = camera_from_target * Point3::from(c.point_m);
            let [u, v] = camera.project(point.into())?;
            Some([c.pixel[0] - u, c.pixel[1] - v])
        })
        .collect()
}

/// The derivatives of a projected point by a small turn about the camera's axes and a shift of its pose.
pub(super) fn slopes_by_pose(
    rotated: Vector3<f64>,
    jacobian: &ProjectionJacobian,
) -> [[f64; 2]; 6] {
    let by_point = jacobian.by_point;
    // A turn ω moves the point by ω × (R·X).
    let turned = [
        Vector3::x().cross(&rotated),
        Vector3::y().cross(&rotated),
        Vector3::z().cross(&rotated),
    ];
    std::array::from_fn(|i| {
        [0, 1].map(|c| {
            if i < 3 {
                (0..3).map(|k| by_point[c][k] * turned[i][k]).sum()
            } else {
                by_point[c][i - 3]
            }
        })
    })
}

/// A pose after the step of six unknowns of [`slopes_by_pose`].
pub(super) fn stepped_pose(pose: &Pose, step: &[f64]) -> Pose {
    let turn = Rotation3::new(Vector3::new(step[0], step[1], step[2]));
    let shift = Vector3::new(step[3], step[4], step[5]);
    let mut rotation = turn * pose.rotation;
    rotation.renormalize();
    Pose::from_parts(
        Translation3::from(pose.translation.vector + shift),
        rotation,
    )
}

struct PoseProblem<'a> {
    camera: &'a Camera,
    pose: Pose,
    correspondences: &'a [Correspondence],
    used: Vec<bool>,
}

impl Problem for PoseProblem<'_> {
    fn unknowns(&self) -> usize {
        6
    }

    fn stepped(&self, step: &DVector<f64>) -> Option<Self> {
        Some(Self {
            pose: stepped_pose(&self.pose, step.as_slice()),
            used: self.used.clone(),
            ..*self
        })
    }

    fn visit(&self, visit: &mut dyn FnMut(Option<[f64; 2]>, Slopes<'_>)) {
        for (c, _) in self
            .correspondences
            .iter()
            .zip(&self.used)
            .filter(|(_, u)| **u)
        {
            let point = self.pose * Point3::from(c.point_m);
            match self.camera.project_with_jacobian(point.into()) {
                None => visit(None, Slopes { blocks: &[] }),
                Some(jacobian) => {
                    let [u, v] = jacobian.pixel;
                    let rotated = point.coords - self.pose.translation.vector;
                    let slopes = slopes_by_pose(rotated, &jacobian);
                    let residual = [u - c.pixel[0], v - c.pixel[1]];
                    visit(
                        Some(residual),
                        Slopes {
                            blocks: &[(0, &slopes)],
                        },
                    );
                }
            }
        }
    }
}

/// Samples of a few points that are tried for a pose when the points may hold outliers.
const SAMPLES: u32 = 40;

/// A pose from the rays of the pixels: the linear solution from all points, or from the random sample of few that leaves the smallest
/// median angle between rays and points. `None` where there is none.
pub(super) fn pose_from_rays(camera: &Camera, correspondences: &[Correspondence]) -> Option<Pose> {
    let mut origin = Vector3::zeros();
    let mut seen: Vec<(Vector3<f64>, Vector3<f64>)> = Vec::with_capacity(correspondences.len());
    for c in correspondences {
        if let Some(ray) = camera.unproject(c.pixel) {
            origin += Vector3::from(ray.origin);
            seen.push((Vector3::from(c.point_m), Vector3::from(ray.direction)));
        }
    }
    if seen.len() < 4 || 2 * seen.len() < correspondences.len() {
        return None;
    }
    // Where the rays of a mirror have no common origin, the mean of them stands in.
    origin /= seen.len() as f64;
    let spread = Spread::of(seen.iter().map(|(p, _)| (*p).into()));
    let flat = spread.flat();
    if spread.widths_m[1] < 1e-6 * spread.widths_m[0] || spread.widths_m[0] <= 0.0 {
        return None;
    }
    let sample_size = if flat { 5 } else { 7 };
    let draws = Draws::new(0, 0);
    let everything: Vec<usize> = (0..seen.len()).collect();
    let samples = (0..SAMPLES).filter(|_| seen.len() > sample_size).map(|s| {
        (0..sample_size as u32)
            .map(|i| (draws.uniform(s, i, Stage::Ray) * seen.len() as f64) as usize)
            .collect()
    });
    let mut best: Option<(f64, Pose)> = None;
    for indices in std::iter::once(everything).chain(samples) {
        let Some(pose) = linear_pose(&spread, flat, indices.iter().map(|&i| seen[i])) else {
            continue;
        };
        let mut errors: Vec<f64> = seen
            .iter()
            .map(|(point, ray)| 1.0 - (pose * Point3::from(*point)).coords.normalize().dot(ray))
            .collect();
        let middle = errors.len() / 2;
        let (_, median, _) = errors.select_nth_unstable_by(middle, f64::total_cmp);
        if best.as_ref().is_none_or(|(least, _)| *median < *least) {
            best = Some((*median, pose));
        }
    }
    let (_, pose) = best?;
    let translation = Translation3::from(pose.translation.vector + origin);
    Some(Pose::from_parts(translation, pose.rotation))
}

/// The direct linear transformation for rays of any direction, also beyond 90 degrees: ray × (R·X + t) = 0.
fn linear_pose(
    spread: &Spread,
    flat: bool,
    seen: impl Iterator<Item = (Vector3<f64>, Vector3<f64>)>,
) -> Option<Pose> {
    let columns = if flat { 3 } else { 4 };
    let scale = spread.widths_m[0];
    let mut matrix = DMatrix::<f64>::zeros(3 * columns, 3 * columns);
    let mut pairs = Vec::new();
    for (point, ray) in seen {
        let local = spread.axes.transpose() * (point - spread.middle) / scale;
        let homogeneous = if flat {
            vec![local.x, local.y, 1.0]
        } else {
            vec![local.x, local.y, local.z, 1.0]
        };
        // Rows of ray × (P·X), P's columns one after the other.
        let cross = ray.cross_matrix();
        let square = cross.transpose() * cross;
        for (i, a) in homogeneous.iter().enumerate() {
            for (j, b) in homogeneous.iter().enumerate() {
                let mut block = matrix.fixed_view_mut::<3, 3>(3 * i, 3 * j);
                block += square * (a * b);
            }
        }
        pairs.push((homogeneous, ray));
    }
    let eigen = SymmetricEigen::new(matrix);
    let least = eigen.eigenvalues.imin();
    let solution = eigen.eigenvectors.column(least);
    let column = |i: usize| Vector3::new(solution[3 * i], solution[3 * i + 1], solution[3 * i + 2]);
    let ahead = pairs
        .iter()
        .filter(|(x, ray)| {
            let point: Vector3<f64> = (0..columns).map(|i| column(i) * x[i]).sum();
            point.dot(ray) > 0.0
        })
        .count();
    let sign = if 2 * ahead < pairs.len() { -1.0 } else { 1.0 };
    let (a, b) = (column(0) * sign, column(1) * sign);
    let t = column(columns - 1) * sign;
    let (matrix, size) = if flat {
        let size = (a.norm() * b.norm()).sqrt();
        let c = a.cross(&b) / size;
        (Matrix3::from_columns(&[a, b, c]), size)
    } else {
        let matrix = Matrix3::from_columns(&[a, b, column(2) * sign]);
        (matrix, matrix.determinant().abs().cbrt())
    };
    if !(size > 1e-12 && size.is_finite()) {
        return None;
    }
    let svd = (matrix / size).svd(true, true);
    let (u, v_t) = (svd.u?, svd.v_t?);
    // A mirrored solution is turned to the nearest rotation all the same: least squares then shows that it does not fit.
    let flip = Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, (u * v_t).determinant()));
    let rotation = u * flip * v_t * spread.axes.transpose();
    let translation = t / size * scale - rotation * spread.middle;
    let finite = rotation
        .iter()
        .chain(translation.iter())
        .all(|v| v.is_finite());
    finite.then(|| {
        Pose::from_parts(
            Translation3::from(translation),
            Rotation3::from_matrix_unchecked(rotation),
        )
    })
}
