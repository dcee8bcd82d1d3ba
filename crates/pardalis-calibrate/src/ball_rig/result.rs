//! What follows from a fit: clocks that are one, focal lengths that the data determine, and standard deviations.

use nalgebra::{Matrix3, Matrix3x6};

use super::super::least_squares::{Loss, covariance, minimise};
use super::super::spread::Spread;
use super::super::temporal::path::Observation;
use super::super::{CalibrationError, rms};
use super::fit::{FOCAL_SIGMA, FittedCamera, RigFit, focal_places};
use super::{BallRigCalibration, BallRigCamera, BallSighting, FocalFit, checks};

/// Number of standard deviations below which an offset is taken for 0.
const CLOCK_SIGMAS: f64 = 3.0;

/// Standard deviation of the logarithm of a focal length below which the data determine it.
const FOCAL_DETERMINED: f64 = 0.2 * FOCAL_SIGMA;

/// Holds the offsets that do not differ significantly from 0 there: most likely the cameras have one clock, or a common trigger, and
/// their frames belong together. Returns the fit with the standard deviations of all offsets before, in seconds.
pub(super) fn with_one_clock(mut fit: RigFit) -> Result<(RigFit, Vec<f64>), CalibrationError> {
    let covariance = covariance(&fit).ok_or_else(checks::no_common_path)?;
    let inflation = fit.inflation();
    let mut sigmas_s = vec![0.0];
    for (number, camera) in fit.cameras.iter_mut().enumerate().skip(1) {
        let at = RigFit::offset_at(number);
        let sigma_s = (inflation * covariance[(at, at)]).sqrt();
        camera.has_first_clock = camera.offset_s.abs() < CLOCK_SIGMAS * sigma_s;
        if camera.has_first_clock {
            camera.offset_s = 0.0;
        }
        sigmas_s.push(sigma_s);
    }
    Ok((minimise(fit, Loss::Squares, 60).0, sigmas_s))
}

/// Fits the focal lengths, too. Returns the fit without them, or, if wanted, with those that the data determine, and
/// what the data say.
pub(super) fn with_focal(fit: RigFit<'_>, is_wanted: bool) -> (RigFit<'_>, Vec<Option<FocalFit>>) {
    let mut free = fit.clone();
    for camera in &mut free.cameras {
        camera.is_focal_free = !focal_places(&camera.camera).is_empty();
    }
    let (free, _) = minimise(free, Loss::Squares, 60);
    let covariance = covariance(&free);
    let inflation = free.inflation();
    let say = |(number, camera): (usize, &FittedCamera)| {
        camera.is_focal_free.then(|| {
            let at = free.focal_at(number);
            let sigma = covariance
                .as_ref()
                .map_or(FOCAL_SIGMA, |c| (c[(at, at)] * inflation).sqrt());
            let is_determined = sigma <= FOCAL_DETERMINED;
            FocalFit {
                factor: libm::exp(camera.log_focal),
                sigma,
                is_determined,
                is_refined: is_wanted && is_determined,
            }
        })
    };
    let mut focal: Vec<Option<FocalFit>> = free.cameras.iter().enumerate().map(say).collect();
    let is_refined = |focal: &Option<FocalFit>| focal.is_some_and(|focal| focal.is_refined);
    if !focal.iter().any(is_refined) {
        return (fit, focal);
    }
    let mut refined = free;
    for ((camera, given), focal) in refined.cameras.iter_mut().zip(&fit.cameras).zip(&focal) {
        camera.is_focal_free = is_refined(focal);
        if !camera.is_focal_free {
            camera.camera = given.camera.clone();
            camera.log_focal = 0.0;
        }
    }
    let (refined, _) = minimise(refined, Loss::Squares, 60);
    for (camera, focal) in refined.cameras.iter().zip(&mut focal) {
        if let Some(focal) = focal.as_mut().filter(|focal| focal.is_refined) {
            focal.factor = libm::exp(camera.log_focal);
        }
    }
    (refined, focal)
}

/// Returns the result of a fit, with the residuals of all detections near the path.
pub(super) fn result(
    fit: &RigFit,
    matched: &[Observation],
    inlier: &[bool],
    offset_sigmas_s: &[f64],
    focal: Vec<Option<FocalFit>>,
) -> Result<BallRigCalibration, CalibrationError> {
    let covariance = covariance(fit).ok_or_else(checks::no_common_path)?;
    let inflation = fit.inflation();
    let cameras = fit.cameras.iter().zip(focal).enumerate();
    let cameras: Vec<BallRigCamera> = cameras
        .map(|(number, (of, focal))| {
            let (mut turn, mut position) = (0.0, 0.0);
            if number > 0 {
                let at = RigFit::place_at(number);
                // The position in the world is -R'·t, which a rotation of the camera's frame changes, too.
                let position_by = {
                    let shift = of.camera_from_world.translation.vector;
                    let mut by = Matrix3x6::zeros();
                    by.fixed_columns_mut::<3>(0)
                        .copy_from(&shift.cross_matrix());
                    by.fixed_columns_mut::<3>(3).fill_with_identity();
                    by
                };
                let block = covariance.fixed_view::<6, 6>(at, at);
                let largest =
                    |c: Matrix3<f64>| (inflation * c.symmetric_eigenvalues().max().max(0.0)).sqrt();
                turn = largest(block.fixed_view::<3, 3>(0, 0).into_owned());
                position = largest(position_by * block * position_by.transpose());
            }
            let own = matched.iter().zip(inlier);
            let detections = own.filter(|(seen, _)| seen.camera == number);
            let detections: Vec<BallSighting> = detections
                .map(|(seen, used)| {
                    let residual = fit.residual(seen);
                    BallSighting {
                        time_s: seen.time_s,
                        pixel: seen.pixel,
                        residual_px: residual.map(|r| r.pixel_px),
                        radius_residual_px: residual.map(|r| r.radius_px),
                        outlier: !used,
                    }
                })
                .collect();
            let kept = detections.iter().filter(|s| !s.outlier);
            BallRigCamera {
                camera: of.camera.clone(),
                world_from_camera: of.camera_from_world.inverse(),
                position_sigma_m: position,
                turn_sigma_rad: turn,
                offset_s: if of.has_first_clock { 0.0 } else { of.offset_s },
                offset_sigma_s: offset_sigmas_s[number],
                focal,
                rms_px: rms(kept.filter_map(|s| s.residual_px)),
                detections,
            }
        })
        .collect();
    let path_m = fit.places();
    let widths_m = Spread::of(path_m.iter().map(|(_, place)| *place)).widths_m;
    Ok(BallRigCalibration {
        cameras,
        path_m,
        widths_m,
    })
}
