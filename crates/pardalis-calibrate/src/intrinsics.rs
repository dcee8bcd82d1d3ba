//! Intrinsic calibration: camera parameters together with the poses of the views.

use nalgebra::DVector;

use super::bundle::Bundle;
use super::least_squares::{Loss, Problem, covariance, minimise};
use super::pose::{closest_pose, pose_from_rays, residuals_px};
use super::start::free_parameters;
use super::{
    CalibrationError, CalibrationSettings, CalibrationStart, CalibrationView, Correspondence,
    OUTLIER_SIGMAS, check, rms,
};
use pardalis_camera::Pose;
use pardalis_camera::{Camera, Equidistant, KannalaBrandt, Ocam};

/// A calibrated camera.
#[derive(Debug, Clone, PartialEq)]
pub struct Calibration {
    /// The fitted camera.
    pub camera: Camera,
    /// Its parameters with standard deviations.
    pub parameters: Vec<FittedParameter>,
    /// One result per view, in the order of the input.
    pub views: Vec<FittedView>,
    /// Root mean square distance between observed and projected points in pixels, without outliers.
    pub rms_px: f64,
    /// The same including outliers that project into the image.
    pub rms_all_px: f64,
    /// The same for held-out points: every fifth view (or every fifth point of a single view) is excluded
    /// from the fit in turn. `None` if the rest cannot determine the camera.
    pub held_out_rms_px: Option<f64>,
    /// Share of the cells of a 10 x 10 grid over the image that contain points.
    pub coverage: f64,
    /// Largest angle between an observed ray and the optical axis (−z for cameras that look into a mirror),
    /// in radians.
    pub max_angle_rad: f64,
}

/// One parameter of a fitted camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FittedParameter {
    /// Name.
    pub name: &'static str,
    /// Value; the unit follows from the name.
    pub value: f64,
    /// Standard deviation; `None` if the parameter was fixed.
    pub sigma: Option<f64>,
}

/// One view of a calibration.
#[derive(Debug, Clone, PartialEq)]
pub struct FittedView {
    /// Name.
    pub name: String,
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

/// Factor on the held-out residual that a polynomial of higher degree must reach.
const HIGHER_DEGREE_GAIN: f64 = 0.97;

/// Fits a camera and the pose of each view.
///
/// For OCamCalib's model, fits the usual polynomial of degree 4 and one of degree 6, which very wide lenses
/// need but few points do not determine. The held-out residual selects between them.
///
/// # Errors
///
/// Fails if the observations are invalid, contradictory or insufficient for the model. The [`CalibrationError`] names
/// the cause and a remedy.
pub fn calibrate(
    views: &[CalibrationView],
    settings: &CalibrationSettings,
) -> Result<Calibration, CalibrationError> {
    let found = calibrate_once(views, settings)?;
    let (CalibrationStart::Model(_), Camera::Ocam(model)) = (&settings.start, &found.camera) else {
        return Ok(found);
    };
    let wider = model.of_degree(6).map(Camera::Ocam).ok().and_then(|start| {
        let settings = CalibrationSettings {
            start: CalibrationStart::Near(start),
            ..settings.clone()
        };
        calibrate_once(views, &settings).ok()
    });
    let better = |wider: &Calibration| {
        let (wider, found) = (wider.held_out_rms_px?, found.held_out_rms_px?);
        Some(wider < HIGHER_DEGREE_GAIN * found)
    };
    Ok(wider
        .filter(|wider| better(wider) == Some(true))
        .unwrap_or(found))
}

/// Calibrates from the given start alone.
fn calibrate_once(
    views: &[CalibrationView],
    settings: &CalibrationSettings,
) -> Result<Calibration, CalibrationError> {
    check::points(views, settings.size_px)?;
    let starts = starts(views, settings);
    let Some(first) = starts.first() else {
        return Err(CalibrationError::new(
            "no camera of this model has rays for these pixels",
            "try another model",
        ));
    };
    let free = free_parameters(first);
    let free_count = free.iter().filter(|f| **f).count();
    check::views(views, free_count, settings.size_px)?;
    let robust = robust_fit(views, &starts, &free)?;
    let used: Vec<Vec<bool>> = {
        let residuals: Vec<_> = robust.residuals().into_iter().flatten().collect();
        let mut flat = check::inliers(&residuals, settings.outlier_sigmas).into_iter();
        check::mostly_inliers("the camera", &flat.clone().collect::<Vec<_>>())?;
        views
            .iter()
            .map(|v| flat.by_ref().take(v.correspondences.len()).collect())
            .collect()
    };
    if let Some(view) = views
        .iter()
        .zip(&used)
        .find_map(|(v, used)| (used.iter().filter(|u| **u).count() < 4).then_some(v))
    {
        return Err(CalibrationError::new(
            format!("{} contradicts the other views", view.name),
            "leave it out or check its points",
        ));
    }
    let (fitted, _) = minimise(Bundle { used, ..robust }, Loss::Squares, 200);
    check_fit(&fitted, settings)?;
    let held_out_rms_px = held_out_rms_px(&fitted);
    finish(fitted, settings, held_out_rms_px)
}

fn starts(views: &[CalibrationView], settings: &CalibrationSettings) -> Vec<Camera> {
    let kind = match &settings.start {
        CalibrationStart::Near(camera) => return vec![camera.clone()],
        CalibrationStart::Model(kind) => kind,
    };
    let (width, height) = settings.size_px;
    let (cx, cy) = ((width as f64 - 1.0) / 2.0, (height as f64 - 1.0) / 2.0);
    let radius_px = views
        .iter()
        .flat_map(|v| &v.correspondences)
        .map(|c| libm::hypot(c.pixel[0] - cx, c.pixel[1] - cy))
        .fold(1.0, f64::max);
    kind.starts(settings.size_px, radius_px)
}

/// Number of starts that are refined after a few steps.
const FOLLOWED: usize = 4;

/// Returns the best robust fit from all starts.
fn robust_fit<'a>(
    views: &'a [CalibrationView],
    starts: &[Camera],
    free: &'a [bool],
) -> Result<Bundle<'a>, CalibrationError> {
    let used: Vec<Vec<bool>> = views
        .iter()
        .map(|v| vec![true; v.correspondences.len()])
        .collect();
    // A wide loss first attracts distant starts; a narrow one then refines them.
    let mut candidates: Vec<(Bundle, f64)> = starts
        .iter()
        .filter_map(|camera| {
            let poses = views
                .iter()
                .map(|v| pose_from_rays(camera, &v.correspondences))
                .collect::<Option<Vec<_>>>()?;
            let bundle = Bundle {
                views,
                free,
                camera: camera.clone(),
                poses,
                used: used.clone(),
            };
            let (bundle, _) = minimise(bundle, Loss::Cauchy(30.0), 6);
            Some(minimise(bundle, Loss::Cauchy(5.0), 6))
        })
        .collect();
    candidates.sort_by(|a, b| a.1.total_cmp(&b.1));
    candidates
        .into_iter()
        .take(FOLLOWED)
        .map(|(bundle, _)| minimise(bundle, Loss::Cauchy(2.0), 100))
        .min_by(|a, b| a.1.total_cmp(&b.1))
        .map(|(bundle, _)| bundle)
        .ok_or_else(|| {
            CalibrationError::new(
                "the pixels have no rays in any camera of this model",
                "check the image size and the model",
            )
        })
}

/// Rejects fits with large residuals and boards seen from behind.
fn check_fit(fitted: &Bundle, settings: &CalibrationSettings) -> Result<(), CalibrationError> {
    let residuals: Vec<[f64; 2]> = fitted.inlier_residuals().collect();
    let rms_px = rms(residuals.into_iter());
    if rms_px > check::max_rms_px(settings.size_px) {
        let mirrored = fitted.mirrored_fits_better(rms_px);
        return Err(if mirrored {
            check::mirrored(rms_px)
        } else {
            CalibrationError::new(
                format!(
                    "the best camera of this model leaves {rms_px:.1} px between the points and their pixels"
                ),
                "check the order of the points, their units (metres) and the model",
            )
        });
    }
    if settings.board {
        let from_behind = fitted.poses.iter().filter(|pose| {
            // The camera's position in the board's frame.
            pose.inverse().translation.vector.z < 0.0
        });
        let behind = from_behind.count();
        if 2 * behind > fitted.poses.len() {
            return Err(check::from_behind(&fitted.camera));
        }
    }
    Ok(())
}

/// Excludes every fifth view (or every fifth point of a single view) in turn and returns the RMS residual of
/// the excluded points, in pixels.
fn held_out_rms_px(fitted: &Bundle) -> Option<f64> {
    const FOLDS: usize = 5;
    let views = fitted.views;
    let single = views.len() == 1;
    let count = if single {
        views[0].correspondences.len()
    } else {
        views.len()
    };
    let folds = FOLDS.min(count);
    let mut residuals = Vec::new();
    for fold in 0..folds {
        let mut rest = fitted.clone();
        for (v, used) in rest.used.iter_mut().enumerate() {
            for (i, used) in used.iter_mut().enumerate() {
                *used &= if single { i } else { v } % folds != fold;
            }
        }
        let kept = rest.used.iter().flatten().filter(|u| **u).count();
        let kept_views = rest.used.iter().filter(|u| u.contains(&true)).count();
        if 2 * kept <= rest.free_count() + 6 * kept_views || (!single && kept_views < 2) {
            return None;
        }
        let (rest, _) = minimise(rest, Loss::Squares, 30);
        for (v, view) in views.iter().enumerate() {
            let held: Vec<Correspondence> = (0..view.correspondences.len())
                .filter(|&i| fitted.used[v][i] && !rest.used[v][i])
                .map(|i| view.correspondences[i])
                .collect();
            if held.is_empty() {
                continue;
            }
            // A view that was excluded entirely still needs a pose; a single view has one from its other
            // points.
            let pose = if single {
                rest.poses[v]
            } else {
                closest_pose(&rest.camera, &held, OUTLIER_SIGMAS)
                    .ok()?
                    .camera_from_target
            };
            residuals.extend(
                residuals_px(&rest.camera, &pose, &held)
                    .into_iter()
                    .flatten(),
            );
        }
    }
    Some(rms(residuals.into_iter()))
}

/// Largest accepted relative standard deviation of the focal length at the axis.
const MAX_FOCAL_SIGMA: f64 = 0.05;

/// Returns the pixels per radian at the optical axis (forwards, or backwards for mirrors).
fn axial_focal_px(camera: &Camera) -> Option<f64> {
    const ANGLE_RAD: f64 = 1e-4;
    [1.0, -1.0].into_iter().find_map(|z| {
        let [u0, v0] = camera.project([0.0, 0.0, z])?;
        let [u, v] = camera.project([ANGLE_RAD, 0.0, z])?;
        Some(libm::hypot(u - u0, v - v0) / ANGLE_RAD)
    })
}

/// Computes the derivatives of [`axial_focal_px`] with respect to the free parameters.
fn axial_focal_slopes(fitted: &Bundle) -> Option<Vec<f64>> {
    let values: Vec<f64> = fitted.camera.parameters().iter().map(|p| p.1).collect();
    let free = (0..values.len()).filter(|&i| fitted.free[i]);
    free.map(|i| {
        let step = 1e-6 * values[i].abs().max(1e-3);
        let at = |sign: f64| {
            let mut values = values.clone();
            values[i] += sign * step;
            axial_focal_px(&fitted.camera.with_parameters(&values).ok()?)
        };
        // A parameter at the end of its range can only move to one side.
        let middle = axial_focal_px(&fitted.camera)?;
        match (at(1.0), at(-1.0)) {
            (Some(after), Some(before)) => Some((after - before) / (2.0 * step)),
            (Some(after), None) => Some((after - middle) / step),
            (None, Some(before)) => Some((middle - before) / step),
            (None, None) => None,
        }
    })
    .collect()
}

/// Limits the camera's domain to the observed region plus a margin, because a polynomial is arbitrary beyond
/// it.
fn limited(camera: &Camera, max_angle_rad: f64, max_radius_px: f64) -> Camera {
    const MARGIN: f64 = 1.1;
    let angle = (MARGIN * max_angle_rad).min(std::f64::consts::PI);
    let p: Vec<f64> = camera.parameters().iter().map(|p| p.1).collect();
    let cut = match camera {
        Camera::Equidistant(_) => {
            Equidistant::new(p[0], [p[1], p[2]], angle).map(Camera::Equidistant)
        }
        Camera::KannalaBrandt(_) => {
            KannalaBrandt::new([p[0], p[1]], [p[2], p[3]], [p[4], p[5], p[6], p[7]], angle)
                .map(Camera::KannalaBrandt)
        }
        Camera::Ocam(model) => Ocam::new(
            model.polynomial(),
            [p[0], p[1]],
            [p[2], p[3], p[4]],
            MARGIN * max_radius_px,
        )
        .map(Camera::Ocam),
        _ => return camera.clone(),
    };
    cut.expect("parameters that were valid with a larger domain")
}

fn finish(
    fitted: Bundle,
    settings: &CalibrationSettings,
    held_out_rms_px: Option<f64>,
) -> Result<Calibration, CalibrationError> {
    let undetermined = |what: String| {
        CalibrationError::new(
            format!("the observations do not determine {what}"),
            "tilt the board more (by 30 degrees or more, about both axes), fill the image, add points at other distances, or use a model with fewer parameters",
        )
    };
    let count = fitted.inlier_residuals().count();
    let rms_px = rms(fitted.inlier_residuals());
    let covariance =
        covariance(&fitted).ok_or_else(|| undetermined("all parameters".to_owned()))?;
    let freedom = (2 * count) as f64 - fitted.unknowns() as f64;
    let sigma_px = rms_px * (count as f64 / freedom).sqrt();
    let mut next = 0;
    let parameters: Vec<FittedParameter> = fitted
        .camera
        .parameters()
        .into_iter()
        .zip(fitted.free)
        .map(|((name, value), free)| {
            let sigma = free.then(|| {
                next += 1;
                sigma_px * covariance[(next - 1, next - 1)].sqrt()
            });
            FittedParameter { name, value, sigma }
        })
        .collect();
    // Individual parameters may compensate for one another (such as a mirror's ξ), but the image scale must
    // be determined.
    let focal = axial_focal_px(&fitted.camera).zip(axial_focal_slopes(&fitted));
    if let Some((focal_px, slopes)) = focal {
        let slopes = DVector::from_vec(slopes);
        let block = covariance.view((0, 0), (slopes.len(), slopes.len()));
        let sigma = sigma_px * slopes.dot(&(block * &slopes)).sqrt();
        if !(sigma < MAX_FOCAL_SIGMA * focal_px) {
            return Err(undetermined(format!(
                "the focal length ({focal_px:.1} px at the axis with a standard deviation of {sigma:.1} px, more than {:.0} %)",
                100.0 * MAX_FOCAL_SIGMA
            )));
        }
    }
    let residuals = fitted.residuals();
    let views = (0..fitted.views.len())
        .map(|v| {
            let used = &fitted.used[v];
            let start = fitted.free_count() + 6 * v;
            let inliers = residuals[v].iter().zip(used).filter(|(_, u)| **u);
            FittedView {
                name: fitted.views[v].name.clone(),
                camera_from_target: fitted.poses[v],
                pose_sigma: std::array::from_fn(|i| {
                    sigma_px * covariance[(start + i, start + i)].sqrt()
                }),
                outliers: (0..used.len()).filter(|&i| !used[i]).collect(),
                rms_px: rms(inliers.filter_map(|(r, _)| *r)),
                residuals_px: residuals[v].clone(),
            }
        })
        .collect();
    let rms_all_px = rms(residuals.iter().flatten().filter_map(|r| *r));
    let max_angle_rad = fitted.max_angle_rad();
    let camera = match settings.start {
        CalibrationStart::Model(_) => {
            limited(&fitted.camera, max_angle_rad, fitted.max_radius_px())
        }
        CalibrationStart::Near(_) => fitted.camera.clone(),
    };
    Ok(Calibration {
        camera,
        parameters,
        views,
        rms_px,
        rms_all_px,
        held_out_rms_px,
        coverage: coverage(fitted.views, settings.size_px),
        max_angle_rad,
    })
}

/// Cells of an image in each direction, for [`covered`].
const CELLS: usize = 10;

/// Reports for each cell of a 10 x 10 grid over an image of this width and height, row by row from the top, whether one of the pixels is in it.
pub fn covered(
    pixels: impl Iterator<Item = [f64; 2]>,
    (width, height): (usize, usize),
) -> [[bool; CELLS]; CELLS] {
    let cell = |x: f64, size: usize| {
        (((x + 0.5) / size as f64 * CELLS as f64).max(0.0) as usize).min(CELLS - 1)
    };
    let mut cells = [[false; CELLS]; CELLS];
    for [u, v] in pixels {
        cells[cell(v, height)][cell(u, width)] = true;
    }
    cells
}

fn coverage(views: &[CalibrationView], size_px: (usize, usize)) -> f64 {
    let points = views.iter().flat_map(|view| &view.correspondences);
    let cells = covered(points.map(|point| point.pixel), size_px);
    let count = cells.as_flattened().iter().filter(|cell| **cell).count();
    count as f64 / (CELLS * CELLS) as f64
}
