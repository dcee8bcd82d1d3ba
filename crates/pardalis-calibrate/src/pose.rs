//! Camera pose from known points: a linear solution from the rays of the pixels, refined by least squares in
//! the image.

use nalgebra::{
    DMatrix, DVector, Matrix3, Point3, Rotation3, SymmetricEigen, Translation3, Vector3,
};

use super::least_squares::{Loss, Problem, Slopes, covariance, minimise};
use super::spread::Spread;
use super::{CalibrationError, Correspondence, check, rms};
use pardalis_camera::Pose;
use pardalis_camera::{Camera, ProjectionJacobian};
use pardalis_core::rng::{Draws, Stage};

/// Pose of a calibrated camera with its uncertainty.
#[derive(Debug, Clone, PartialEq)]
pub struct PoseFit {
    /// Transform from the target's frame to the camera's frame.
    pub camera_from_target: Pose,
    /// Standard deviations: rotation about the camera's axes in radians, then translation in metres.
    pub pose_sigma: [f64; 6],
    /// Observed minus projected pixel per correspondence; `None` if the point does not project into the image.
    pub residuals_px: Vec<Option<[f64; 2]>>,
    /// Indices of the rejected correspondences.
    pub outliers: Vec<usize>,
    /// Root mean square distance of the remaining correspondences, in pixels.
    pub rms_px: f64,
}

/// Computes the pose of a calibrated camera from at least four correspondences in a plane or six in general
/// position.
///
/// The fit is robust: points with residuals beyond `outlier_sigmas`
/// ([`OUTLIER_SIGMAS`](super::OUTLIER_SIGMAS)) robust standard deviations are rejected. Infinity keeps every
/// point that projects into the image.
///
/// # Errors
///
/// Fails in the same cases as [`closest_pose`], if pixels lie outside images of `size_px` (width, height), or
/// if points and pixels do not match.
pub fn fit_pose(
    camera: &Camera,
    size_px: (usize, usize),
    correspondences: &[Correspondence],
    outlier_sigmas: f64,
) -> Result<PoseFit, CalibrationError> {
    check::enough_points("the pose", correspondences, 4)?;
    check::pixels(correspondences.iter().map(|c| c.pixel), size_px)?;
    let max_rms_px = check::max_rms_px(size_px);
    let fit = closest_pose(camera, correspondences, outlier_sigmas);
    let rms_px = match &fit {
        Ok(found) if found.rms_px <= max_rms_px => return fit,
        Ok(found) => found.rms_px,
        Err(_) => f64::INFINITY,
    };
    let fits = |changed: &[Correspondence]| {
        closest_pose(camera, changed, outlier_sigmas)
            .is_ok_and(|fit| fit.rms_px < 0.2 * rms_px.min(max_rms_px))
    };
    if fits(&mirrored(correspondences)) {
        return Err(check::mirrored(rms_px));
    }
    if fits(&swapped(correspondences)) {
        return Err(CalibrationError::new(
            "points and pixels match only with u and v exchanged",
            "check the order of the columns: u points right, v points down",
        ));
    }
    // If no fit was possible at all, its own error says why.
    fit.and_then(|_| {
        Err(CalibrationError::new(
            format!(
                "the best pose of this camera leaves {rms_px:.1} px between the points and their pixels"
            ),
            "check that the camera file belongs to these images, that points and pixels are in the same order, and that all coordinates are in metres",
        ))
    })
}

/// Mirrors the points: negates x.
pub(super) fn mirrored(correspondences: &[Correspondence]) -> Vec<Correspondence> {
    let mirror = |c: &Correspondence| Correspondence {
        point_m: [-c.point_m[0], c.point_m[1], c.point_m[2]],
        ..*c
    };
    correspondences.iter().map(mirror).collect()
}

/// Exchanges u and v of the pixels.
fn swapped(correspondences: &[Correspondence]) -> Vec<Correspondence> {
    let swap = |c: &Correspondence| Correspondence {
        pixel: [c.pixel[1], c.pixel[0]],
        ..*c
    };
    correspondences.iter().map(swap).collect()
}

/// Computes the pose with the smallest reprojection error, however large that error is.
///
/// Use it instead of [`fit_pose`] if the points are known to be correct, or to evaluate the camera itself.
///
/// # Errors
///
/// Fails if there are too few points, if they are collinear, if most pixels have no ray in this camera, or if
/// the points contradict one another.
pub fn closest_pose(
    camera: &Camera,
    correspondences: &[Correspondence],
    outlier_sigmas: f64,
) -> Result<PoseFit, CalibrationError> {
    check::enough_points("the pose", correspondences, 4)?;
    if !check::spread("the pose", correspondences)?.flat() {
        // Four or five points allow several poses with small errors, and no linear solution selects one.
        check::enough_points("a pose from points not in one plane", correspondences, 6)?;
    }
    let start = pose_from_rays(camera, correspondences).ok_or_else(|| {
        CalibrationError::new(
            "most of the pixels have no rays in this camera",
            "check that the camera file belongs to these images",
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
        return Err(CalibrationError::new(
            "the points do not determine the pose",
            "use at least four points spread over the image",
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

/// Computes observed minus projected pixels.
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

/// Computes the derivatives of a projected point with respect to a small rotation about the camera's axes and
/// a translation.
pub(super) fn slopes_by_pose(
    rotated: Vector3<f64>,
    jacobian: &ProjectionJacobian,
) -> [[f64; 2]; 6] {
    let by_point = jacobian.by_point;
    // A rotation ω moves the point by ω × (R·X).
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

/// Applies a step of the six unknowns of [`slopes_by_pose`] to a pose.
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

/// Number of random samples tried for a pose if the points may contain outliers.
const SAMPLES: u32 = 40;

/// Estimates a pose from the rays of the pixels: the linear solution from all points or from the random
/// sample with the smallest median angle between rays and points. Returns `None` if there is no solution.
pub(super) fn pose_from_rays(camera: &Camera, correspondences: &[Correspondence]) -> Option<Pose> {
    let mut origin = Vector3::zeros();
    let mut observed: Vec<(Vector3<f64>, Vector3<f64>)> = Vec::with_capacity(correspondences.len());
    for c in correspondences {
        if let Some(ray) = camera.unproject(c.pixel) {
            origin += Vector3::from(ray.origin);
            observed.push((Vector3::from(c.point_m), Vector3::from(ray.direction)));
        }
    }
    if observed.len() < 4 || 2 * observed.len() < correspondences.len() {
        return None;
    }
    // The rays of some mirrors have no common origin; their mean origin replaces it.
    origin /= observed.len() as f64;
    let spread = Spread::of(observed.iter().map(|(p, _)| (*p).into()));
    let flat = spread.flat();
    if spread.widths_m[1] < 1e-6 * spread.widths_m[0] || spread.widths_m[0] <= 0.0 {
        return None;
    }
    let sample_size = if flat { 5 } else { 7 };
    let draws = Draws::new(0, 0);
    let everything: Vec<usize> = (0..observed.len()).collect();
    let samples = (0..SAMPLES)
        .filter(|_| observed.len() > sample_size)
        .map(|s| {
            (0..sample_size as u32)
                .map(|i| (draws.uniform(s, i, Stage::Ray) * observed.len() as f64) as usize)
                .collect()
        });
    let mut best: Option<(f64, Pose)> = None;
    for indices in std::iter::once(everything).chain(samples) {
        let Some(pose) = linear_pose(&spread, flat, indices.iter().map(|&i| observed[i])) else {
            continue;
        };
        let mut errors: Vec<f64> = observed
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

/// Solves for the pose by direct linear transformation with rays of any direction, including beyond 90
/// degrees: ray × (R·X + t) = 0.
fn linear_pose(
    spread: &Spread,
    flat: bool,
    observed: impl Iterator<Item = (Vector3<f64>, Vector3<f64>)>,
) -> Option<Pose> {
    let columns = if flat { 3 } else { 4 };
    let scale = spread.widths_m[0];
    let mut matrix = DMatrix::<f64>::zeros(3 * columns, 3 * columns);
    let mut pairs = Vec::new();
    for (point, ray) in observed {
        let local = spread.axes.transpose() * (point - spread.mean) / scale;
        let homogeneous = if flat {
            vec![local.x, local.y, 1.0]
        } else {
            vec![local.x, local.y, local.z, 1.0]
        };
        // Rows of ray × (P·X), with the columns of P concatenated.
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
        (matrix, libm::cbrt(matrix.determinant().abs()))
    };
    if !(size > 1e-12 && size.is_finite()) {
        return None;
    }
    let svd = (matrix / size).svd(true, true);
    let (u, v_t) = (svd.u?, svd.v_t?);
    // A mirrored solution also becomes the nearest rotation; least squares then reveals that it does not fit.
    let flip = Matrix3::from_diagonal(&Vector3::new(1.0, 1.0, (u * v_t).determinant()));
    let rotation = u * flip * v_t * spread.axes.transpose();
    let translation = t / size * scale - rotation * spread.mean;
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
