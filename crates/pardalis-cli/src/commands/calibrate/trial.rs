//! Evaluation of a camera on test views.

use pardalis_calibrate::{CalibrationView, closest_pose};
use pardalis_camera::Camera;
use rayon::prelude::*;

/// Results on test views with fixed intrinsics: the pose of each view is fitted to all of its points.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Trial {
    /// Root mean square distance between observed and projected points in pixels, including outliers; `None`
    /// if no point projects into the image.
    pub(super) rms_px: Option<f64>,
    /// Number of points.
    pub(super) points: usize,
    /// Number of points that do not project into the image or belong to a view without a pose.
    pub(super) unseen: usize,
}

impl Trial {
    /// Evaluates a camera.
    pub(super) fn of(camera: &Camera, views: &[CalibrationView]) -> Self {
        let squares_px2: Vec<Option<f64>> = views
            .par_iter()
            .flat_map_iter(|view| {
                let points = &view.correspondences;
                let fit = closest_pose(camera, points, f64::INFINITY);
                let residuals_px = fit.map_or(vec![None; points.len()], |fit| fit.residuals_px);
                residuals_px
                    .into_iter()
                    .map(|residual| residual.map(|[du, dv]| du * du + dv * dv))
            })
            .collect();
        let points = squares_px2.len();
        let unseen = squares_px2.iter().filter(|square| square.is_none()).count();
        let sum: f64 = squares_px2.into_iter().flatten().sum();
        Self {
            rms_px: (points > unseen).then(|| (sum / (points - unseen) as f64).sqrt()),
            points,
            unseen,
        }
    }
}
