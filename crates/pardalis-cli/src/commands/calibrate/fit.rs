//! Fitting one or several models to the same observations.

use std::path::Path;
use std::time::Duration;

use anyhow::Result;
use indicatif::{ProgressBar, ProgressStyle};
use pardalis::calibrate::{Calibration, CalibrationSettings, CalibrationView, calibrate};
use rayon::prelude::*;

use super::model::Model;
use super::trial::Trial;
use crate::draw::calibration::Sighting;
use crate::fault::fault;

/// A model that was fitted.
pub(super) struct Fit {
    /// Its camera, poses and residuals.
    pub(super) calibration: Calibration,
    /// What it makes of test views, where there are some.
    pub(super) trial: Option<Trial>,
}

/// What became of the models.
pub(super) struct Fits {
    /// Those that could be fitted, the best first: by what the held-out points say, else by the fitted ones.
    pub(super) fitted: Vec<Fit>,
    /// Names of the others, and why.
    pub(super) refused: Vec<(&'static str, String)>,
}

impl Fits {
    /// Fits all models. `board`: whether the views are of a board, seen from its printed side.
    ///
    /// Faults: none can be fitted; `source` is what the observations came from.
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
                let settings = CalibrationSettings {
                    start: model.start,
                    size_px,
                    board,
                    outlier_sigmas: model.outlier_sigmas,
                };
                let outcome = calibrate(views, &settings);
                bar.inc(1);
                outcome.map_err(|refusal| (model.name, refusal.to_string()))
            })
            .collect();
        bar.finish_and_clear();
        let mut fits = Self {
            fitted: Vec::new(),
            refused: Vec::new(),
        };
        for outcome in outcomes {
            match outcome {
                Ok(calibration) => fits.fitted.push(Fit {
                    calibration,
                    trial: None,
                }),
                Err(refused) => fits.refused.push(refused),
            }
        }
        let figure = |fit: &Calibration| fit.held_out_rms_px.unwrap_or(f64::INFINITY);
        fits.fitted.sort_by(|a, b| {
            let (a, b) = (&a.calibration, &b.calibration);
            let by_held_out = figure(a).total_cmp(&figure(b));
            by_held_out.then(a.rms_px.total_cmp(&b.rms_px))
        });
        if fits.fitted.is_empty() {
            let reasons: Vec<String> = fits
                .refused
                .iter()
                .map(|(name, reason)| format!("{}: {name}: {reason}", source.display()))
                .collect();
            return Err(fault!("{}", reasons.join("\n")));
        }
        Ok(fits)
    }

    /// Tries all fitted models on test views.
    pub(super) fn try_on(&mut self, views: &[CalibrationView]) {
        for fit in &mut self.fitted {
            fit.trial = Some(Trial::of(&fit.calibration.camera, views));
        }
    }
}

/// A moving sign of life on a terminal, as how long a fit takes is not known; nothing elsewhere.
fn progress_bar(models: usize) -> ProgressBar {
    let bar = ProgressBar::new(models as u64);
    bar.enable_steady_tick(Duration::from_millis(100));
    match ProgressStyle::with_template("{spinner} fitting: {pos} of {len} models done, {elapsed}") {
        Ok(style) => bar.with_style(style),
        Err(_) => bar,
    }
}

/// The points of a view as they were seen and fitted.
pub(super) fn sightings(
    calibration: &Calibration,
    views: &[CalibrationView],
    view: usize,
) -> Vec<Sighting> {
    let fitted = &calibration.views[view];
    let points = views[view].correspondences.iter().zip(&fitted.residuals_px);
    points
        .enumerate()
        .map(|(i, (point, residual))| Sighting {
            observed: point.pixel,
            residual_px: *residual,
            outlier: fitted.outliers.contains(&i),
        })
        .collect()
}

/// The points of all views.
pub(super) fn all_sightings(calibration: &Calibration, views: &[CalibrationView]) -> Vec<Sighting> {
    (0..views.len())
        .flat_map(|view| sightings(calibration, views, view))
        .collect()
}

/// The greatest distance between an observed and a projected point that was fitted.
pub(super) fn largest_residual_px(sightings: &[Sighting]) -> f64 {
    sightings
        .iter()
        .filter(|sighting| !sighting.outlier)
        .filter_map(|sighting| sighting.residual_px)
        .map(|[du, dv]| du.hypot(dv))
        .fold(0.0, f64::max)
}
