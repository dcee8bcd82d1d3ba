//! Fits of one or several models to the same observations.

use std::path::Path;
use std::time::Duration;

use anyhow::Result;
use indicatif::{ProgressBar, ProgressStyle};
use pardalis_calibrate::{Calibration, CalibrationSettings, CalibrationView, calibrate};
use rayon::prelude::*;

use super::model::Model;
use super::trial::Trial;
use crate::draw::calibration::ObservedPoint;
use crate::output::Shown;
use crate::user_error::user_error;

/// Ratio within which errors count as equal. Among equal models, the one with fewer parameters extrapolates
/// better to regions without points.
const EQUAL_RATIO: f64 = 1.03;

/// A fitted model.
pub(super) struct Fit {
    /// Camera, poses and residuals.
    pub(super) calibration: Calibration,
    /// Result on test views, if there are any.
    pub(super) trial: Option<Trial>,
}

/// Results of all models.
pub(super) struct Fits {
    /// Successful fits, best first: the one with the fewest free parameters among those within
    /// [`EQUAL_RATIO`] of the smallest error, then the others by their errors. The error is that of held-out
    /// points if all models have it, else that of the fitted points.
    pub(super) fitted: Vec<Fit>,
    /// Names of the other models, with the reasons of their failure.
    pub(super) failed: Vec<(&'static str, String)>,
}

impl Fits {
    /// Fits all models. `board` states whether the views show a board from its printed side.
    ///
    /// Fails if no model can be fitted. `source` names the origin of the observations in messages.
    pub(super) fn of(
        source: &Path,
        views: &[CalibrationView],
        models: Vec<Model>,
        size_px: (usize, usize),
        board: bool,
    ) -> Result<Self> {
        let bar = progress_bar(models.len());
        let outcomes: Vec<_> = models
            .into_par_iter()
            .map(|model| {
                let mut settings = CalibrationSettings::new(model.start, size_px);
                settings.board = board;
                settings.outlier_sigmas = model.outlier_sigmas;
                let outcome = calibrate(views, &settings);
                bar.inc(1);
                outcome.map_err(|refusal| (model.name, refusal))
            })
            .collect();
        bar.finish_and_clear();
        let (mut fitted, mut refusals) = (Vec::new(), Vec::new());
        for outcome in outcomes {
            match outcome {
                Ok(calibration) => fitted.push(calibration),
                Err(failed) => refusals.push(failed),
            }
        }
        sort(&mut fitted);
        let failed = refusals.into_iter().map(|(name, refusal)| {
            // If another model fits, the images are not flipped; the model is of the wrong kind.
            let other = fitted.first().filter(|_| refusal.seen_from_behind);
            let reason = other.map_or(refusal.to_string(), |other| {
                let kinds = if other.camera.looks_into_mirror() {
                    "mirror: it is a model for lenses"
                } else {
                    "lens: it is a model for mirrors"
                };
                format!("does not fit this {kinds}")
            });
            (name, reason)
        });
        let fits = Self {
            failed: failed.collect(),
            fitted: fitted
                .into_iter()
                .map(|calibration| Fit {
                    calibration,
                    trial: None,
                })
                .collect(),
        };
        if fits.fitted.is_empty() {
            let reasons: Vec<String> = fits
                .failed
                .iter()
                .map(|(name, reason)| format!("{}: {name}: {reason}", source.shown()))
                .collect();
            return Err(user_error!("{}", reasons.join("\n")));
        }
        Ok(fits)
    }

    /// Evaluates all fitted models on test views.
    pub(super) fn test_on(&mut self, views: &[CalibrationView]) {
        for fit in &mut self.fitted {
            fit.trial = Some(Trial::of(&fit.calibration.camera, views));
        }
    }
}

/// Sorts fits, best first.
fn sort(fits: &mut [Calibration]) {
    let held_out = fits.iter().all(|fit| fit.held_out_rms_px.is_some());
    let error_px = |fit: &Calibration| match fit.held_out_rms_px {
        Some(rms_px) if held_out => rms_px,
        _ => fit.rms_px,
    };
    fits.sort_by(|a, b| error_px(a).total_cmp(&error_px(b)));
    let Some(least_px) = fits.first().map(error_px) else {
        return;
    };
    let alike = fits.partition_point(|fit| error_px(fit) <= EQUAL_RATIO * least_px);
    // Among equal ones this takes the first, which has the smaller error.
    if let Some(best) = (0..alike).min_by_key(|&i| free_parameters(&fits[i])) {
        fits[..=best].rotate_right(1);
    }
}

/// Returns the number of free parameters.
pub(super) fn free_parameters(fit: &Calibration) -> usize {
    fit.parameters.iter().filter(|p| p.sigma.is_some()).count()
}

/// Creates a spinner on a terminal, because the duration of a fit is unknown; hidden elsewhere.
fn progress_bar(models: usize) -> ProgressBar {
    let bar = ProgressBar::new(models as u64);
    bar.enable_steady_tick(Duration::from_millis(100));
    match ProgressStyle::with_template("{spinner} fitting: {pos} of {len} models done, {elapsed}") {
        Ok(style) => bar.with_style(style),
        Err(_) => bar,
    }
}

/// Returns the points of a view as observed and fitted.
pub(super) fn observed_points(
    calibration: &Calibration,
    views: &[CalibrationView],
    view: usize,
) -> Vec<ObservedPoint> {
    let fitted = &calibration.views[view];
    let points = views[view].correspondences.iter().zip(&fitted.residuals_px);
    points
        .enumerate()
        .map(|(i, (point, residual))| ObservedPoint {
            observed: point.pixel,
            residual_px: *residual,
            outlier: fitted.outliers.contains(&i),
        })
        .collect()
}

/// Returns the points of all views.
pub(super) fn all_observed_points(
    calibration: &Calibration,
    views: &[CalibrationView],
) -> Vec<ObservedPoint> {
    (0..views.len())
        .flat_map(|view| observed_points(calibration, views, view))
        .collect()
}

/// Returns the largest distance between an observed and a projected point that was fitted, in pixels.
pub(super) fn largest_residual_px(observed_points: &[ObservedPoint]) -> f64 {
    observed_points
        .iter()
        .filter(|observed| !observed.outlier)
        .filter_map(|observed| observed.residual_px)
        .map(|[du, dv]| libm::hypot(du, dv))
        .fold(0.0, f64::max)
}
