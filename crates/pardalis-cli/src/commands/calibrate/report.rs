//! Calibration report for the terminal; [`super::page`] adds pictures.

use std::fmt;
use std::ops::RangeInclusive;

use pardalis_calibrate::{Calibration, FittedParameter, FittedView};
use pardalis_camera::Camera;

use super::fit::{
    Fit, Fits, all_observed_points, free_parameters, largest_residual_px, observed_points,
};
use super::images::SearchedImage;
use super::observations::Observations;
use super::trial::Trial;
use crate::commands::camera::optics::Optics;
use crate::draw::calibration::ObservedPoint;

/// Largest number of outliers that are listed.
const MAX_LISTED: usize = 20;

/// Plausible extents of known points and distances to them, in metres.
const USUAL_EXTENTS_M: RangeInclusive<f64> = 0.01..=100.0;

/// Report of a camera calibration.
pub(super) struct Report<'a> {
    /// Name of the camera.
    pub(super) camera: &'a str,
    /// Width and height of the images in pixels.
    pub(super) size_px: (usize, usize),
    /// Observations of the fit.
    pub(super) observations: &'a Observations,
    /// Fits, at least one.
    pub(super) fits: &'a Fits,
    /// Detection results, if the points come from images.
    pub(super) images: &'a [SearchedImage],
    /// Additional warning.
    pub(super) note: Option<String>,
}

impl Report<'_> {
    /// Returns the fit that is written to the files.
    pub(super) fn best(&self) -> &Calibration {
        &self.fits.fitted[0].calibration
    }

    /// Returns the points of a view of the best fit.
    pub(super) fn observed_points(&self, view: usize) -> Vec<ObservedPoint> {
        observed_points(self.best(), &self.observations.views, view)
    }

    /// Returns the points of all views of a fit.
    pub(super) fn all_observed_points(&self, fit: &Calibration) -> Vec<ObservedPoint> {
        all_observed_points(fit, &self.observations.views)
    }

    /// Returns a title such as `40 points in 1 view, images of 640 x 480 pixels`.
    pub(super) fn title(&self) -> String {
        let views = self.observations.views.len();
        format!(
            "{}: {} points in {views} view{}, images of {} x {} pixels",
            self.camera,
            self.observations.point_count(),
            if views == 1 { "" } else { "s" },
            self.size_px.0,
            self.size_px.1
        )
    }

    /// Returns one row per image: its name and the detection result.
    pub(super) fn image_rows(&self) -> Vec<[String; 2]> {
        let result_of = |image: &SearchedImage| match &image.found {
            Ok(corners) => format!("{} corners", corners.len()),
            Err(reason) => format!("not used: {reason}"),
        };
        self.images
            .iter()
            .map(|image| [image.name.clone(), result_of(image)])
            .collect()
    }

    /// Returns a table with one column per model, best first: its figures, then its parameters.
    pub(super) fn comparison(&self) -> Vec<Vec<String>> {
        let fits = &self.fits.fitted;
        let row = |name: &str, figure: &dyn Fn(&Calibration) -> String| {
            std::iter::once(name.to_owned())
                .chain(fits.iter().map(|fit| figure(&fit.calibration)))
                .collect()
        };
        let best = |fit: &Calibration| {
            let mark = if fits.len() > 1 && std::ptr::eq(fit, self.best()) {
                " (best)"
            } else {
                ""
            };
            format!("{}{mark}", fit.camera.kind())
        };
        let pixels = |px: f64| format!("{px:.3}");
        let mut rows = vec![
            row("", &best),
            row("RMS without outliers (px)", &|fit| pixels(fit.rms_px)),
            row("RMS with outliers (px)", &|fit| pixels(fit.rms_all_px)),
            row("RMS of held-out points (px)", &|fit| {
                fit.held_out_rms_px.map_or_else(|| "-".to_owned(), pixels)
            }),
            row("largest residual (px)", &|fit| {
                pixels(largest_residual_px(&self.all_observed_points(fit)))
            }),
            row("outliers", &|fit| outlier_count(fit).to_string()),
            row("farthest ray from the axis (deg)", &|fit| {
                format!("{:.1}", fit.max_angle_rad.to_degrees())
            }),
        ];
        if fits.iter().any(|fit| fit.trial.is_some()) {
            let tried = |name: &str, figure: &dyn Fn(&Trial) -> String| {
                let shown = |fit: &Fit| fit.trial.as_ref().map_or_else(String::new, figure);
                std::iter::once(name.to_owned())
                    .chain(fits.iter().map(shown))
                    .collect()
            };
            rows.push(tried("RMS of test points (px)", &|trial| {
                trial.rms_px.map_or_else(|| "-".to_owned(), pixels)
            }));
            rows.push(tried("test points not projected", &|trial| {
                format!("{} of {}", trial.unseen, trial.points)
            }));
        }
        let mut names: Vec<&str> = Vec::new();
        for parameter in fits.iter().flat_map(|fit| &fit.calibration.parameters) {
            if is_used(parameter) && !names.contains(&parameter.name) {
                names.push(parameter.name);
            }
        }
        for name in names {
            rows.push(row(name, &|fit| {
                let found = fit
                    .parameters
                    .iter()
                    .find(|parameter| parameter.name == name && is_used(parameter));
                found.map_or_else(String::new, |p| with_sigma(p.value, p.sigma))
            }));
        }
        rows
    }

    /// Returns `The points cover 41 % of the image`, with advice if the share is small.
    pub(super) fn coverage(&self) -> String {
        let share = self.best().coverage;
        let advice = if share < 0.4 {
            "; elsewhere the camera is extrapolated: add views that fill the rest"
        } else {
            ""
        };
        format!(
            "The points cover {:.0} % of the image{advice}.",
            100.0 * share
        )
    }

    /// States the limit of the fitted camera's domain, if it has one: it follows from the points, and the
    /// tracker ignores what lies beyond.
    pub(super) fn end(&self) -> Option<String> {
        let fit = self.best();
        if free_parameters(fit) == 0 {
            return None;
        }
        let (end_rad, key) = match &fit.camera {
            Camera::Equidistant(model) => (model.max_angle_rad(), "field_of_view_deg"),
            Camera::KannalaBrandt(model) => (model.max_angle_rad(), "field_of_view_deg"),
            Camera::Ocam(model) => {
                let optics = Optics::new(&fit.camera, self.size_px);
                let [u, v] = optics.center_px;
                // Slightly inside the limit, along the axis that the affine part does not change.
                let end_rad = optics.angle_rad([u, v + 0.999 * model.max_radius_px()])?;
                (end_rad, "max_radius_px")
            }
            _ => return None,
        };
        let beyond = 100.0 * (end_rad / fit.max_angle_rad - 1.0);
        Some(format!(
            "The camera ends at {:.0} degrees from its axis, {beyond:.0} % beyond the farthest point: nothing is tracked farther out. \
             Give points farther out, or edit {key} in its file.",
            end_rad.to_degrees()
        ))
    }

    /// Returns warnings on a successful fit.
    pub(super) fn warnings(&self) -> Vec<String> {
        let mut warnings: Vec<String> = self.note.iter().cloned().collect();
        if self.images.is_empty() {
            warnings.extend(self.unlikely_metres());
        }
        warnings.extend(self.unlikely_center());
        warnings.extend(self.exchangeable());
        let repeated = self.observations.repeated;
        if repeated > 0 {
            warnings.push(format!(
                "{repeated} rows repeat others exactly and were ignored"
            ));
        }
        warnings
    }

    /// Warns of parameters that compensate for one another.
    fn exchangeable(&self) -> Option<String> {
        let unsure = |p: &&FittedParameter| {
            let is_focal = p.name.starts_with('f') && p.name.contains("_px");
            is_focal && p.sigma.is_some_and(|sigma| sigma > 0.1 * p.value.abs())
        };
        let focal = self.best().parameters.iter().find(unsure)?;
        Some(format!(
            "{} is known to {:.0} % only, because other parameters compensate for it: the camera as a whole is known better, \
             but a model with fewer parameters would be equivalent",
            focal.name,
            100.0 * focal.sigma? / focal.value.abs()
        ))
    }

    /// Warns of points that are implausible in metres.
    fn unlikely_metres(&self) -> Option<String> {
        let extent_m = self.observations.extent_m();
        let distances_m = self.best().views.iter().map(|view| view.camera_from_target);
        let distance_m = distances_m.map(|pose| pose.translation.vector.norm());
        let distance_m = distance_m.fold(0.0, f64::max);
        if !USUAL_EXTENTS_M.contains(&extent_m) {
            Some(format!(
                "the points extend over {extent_m:.3} m: are their coordinates in metres?"
            ))
        } else if distance_m > *USUAL_EXTENTS_M.end() {
            Some(format!(
                "the camera is {distance_m:.0} m from the points' origin: are their coordinates in metres?"
            ))
        } else {
            None
        }
    }

    /// Warns of a principal point far from the image centre.
    fn unlikely_center(&self) -> Option<String> {
        let center_px = Optics::new(&self.best().camera, self.size_px).center_px;
        let sides = [self.size_px.0 as f64, self.size_px.1 as f64];
        let is_far = |i: usize| (center_px[i] - 0.5 * (sides[i] - 1.0)).abs() > 0.2 * sides[i];
        (is_far(0) || is_far(1)).then(|| {
            let size = if self.images.is_empty() {
                "is --size right, or were the images cropped?"
            } else {
                "were they cropped?"
            };
            format!(
                "the principal point ({:.0}, {:.0}) is far from the centre of images of {} x {} pixels: {size}",
                center_px[0], center_px[1], self.size_px.0, self.size_px.1
            )
        })
    }

    /// Returns one row per view: name, points, outliers, RMS, distance, standard deviations of its pose.
    pub(super) fn view_rows(&self) -> Vec<Vec<String>> {
        let head = [
            "view",
            "points",
            "outliers",
            "RMS (px)",
            "distance (m)",
            "s.d. of rotation (mrad)",
            "of translation (mm)",
        ];
        let mut rows = vec![head.map(str::to_owned).to_vec()];
        for view in &self.best().views {
            let largest = |sigmas: &[f64]| 1e3 * sigmas.iter().fold(0.0, |a: f64, b| a.max(*b));
            rows.push(vec![
                view.name.clone(),
                view.residuals_px.len().to_string(),
                view.outliers.len().to_string(),
                format!("{:.3}", view.rms_px),
                format!("{:.3}", view.camera_from_target.translation.vector.norm()),
                format!("{:.2}", largest(&view.pose_sigma[..3])),
                format!("{:.2}", largest(&view.pose_sigma[3..])),
            ]);
        }
        rows
    }

    /// States the camera's pose, for a single view.
    pub(super) fn pose(&self) -> Option<String> {
        let [view] = self.best().views.as_slice() else {
            return None;
        };
        let world_from_camera = view.camera_from_target.inverse();
        let position = world_from_camera.translation.vector;
        let axis = world_from_camera.rotation * nalgebra::Vector3::z();
        let into_mirror = self.best().camera.looks_into_mirror();
        Some(format!(
            "The camera is at {} m in the points' frame and looks along {}.",
            metres(position),
            metres(if into_mirror { -axis } else { axis })
        ))
    }

    /// Returns the rejected points by name, with their residuals.
    pub(super) fn outliers(&self) -> Vec<String> {
        let views = self.best().views.iter().zip(&self.observations.numbers);
        let outliers = views.flat_map(|(view, numbers)| {
            view.outliers
                .iter()
                .map(move |&i| self.outlier(view, i, numbers[i]))
        });
        listed(outliers.collect(), " (see residuals.csv)")
    }

    fn outlier(&self, view: &FittedView, index: usize, number: usize) -> String {
        let off = match view.residuals_px[index] {
            Some([du, dv]) => format!("off by {du:.2}, {dv:.2} px"),
            None => "the camera does not see this point".to_owned(),
        };
        format!(
            "{}, {} {number}: {off}",
            view.name, self.observations.numbered_by
        )
    }
}

impl fmt::Display for Report<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for [name, result] in self.image_rows() {
            writeln!(f, "{name}: {result}")?;
        }
        writeln!(f, "{}\n", self.title())?;
        write_table(f, &self.comparison())?;
        for (name, reason) in &self.fits.failed {
            writeln!(f, "{name}: {reason}")?;
        }
        writeln!(f)?;
        write_table(f, &self.view_rows())?;
        writeln!(f)?;
        if let Some(pose) = self.pose() {
            writeln!(f, "{pose}")?;
        }
        write!(f, "{}", self.coverage())?;
        if let Some(end) = self.end() {
            write!(f, "\n{end}")?;
        }
        for warning in self.warnings() {
            write!(f, "\nWarning: {warning}")?;
        }
        let outliers = self.outliers();
        if !outliers.is_empty() {
            write!(f, "\nOutliers:\n  {}", outliers.join("\n  "))?;
        }
        Ok(())
    }
}

/// Returns the first of many lines, with the number of the others and where to find them.
pub(super) fn listed(mut lines: Vec<String>, place: &str) -> Vec<String> {
    let more = lines.len().saturating_sub(MAX_LISTED);
    lines.truncate(MAX_LISTED);
    if more > 0 {
        lines.push(format!("and {more} more{place}"));
    }
    lines
}

/// Returns the number of rejected points in all views.
pub(super) fn outlier_count(fit: &Calibration) -> usize {
    fit.views.iter().map(|view| view.outliers.len()).sum()
}

/// Writes columns as wide as their widest cell; all but the first are right-aligned.
pub(super) fn write_table(f: &mut fmt::Formatter<'_>, rows: &[Vec<String>]) -> fmt::Result {
    let width = |column: usize| {
        let cells = rows.iter().filter_map(|row| row.get(column));
        cells.map(|cell| cell.chars().count()).max().unwrap_or(0)
    };
    for row in rows {
        for (column, cell) in row.iter().enumerate() {
            let width = width(column);
            if column == 0 {
                write!(f, "{cell:width$}")?;
            } else {
                write!(f, "  {cell:>width$}")?;
            }
        }
        writeln!(f)?;
    }
    Ok(())
}

/// Reports whether a parameter is part of the model; terms held at zero are not.
fn is_used(parameter: &FittedParameter) -> bool {
    parameter.sigma.is_some() || parameter.value != 0.0
}

/// Formats three coordinates to a tenth of a millimetre, without minus zero.
pub(super) fn metres(v: nalgebra::Vector3<f64>) -> String {
    let [x, y, z] = [v.x, v.y, v.z].map(|value| (1e4 * value).round() / 1e4 + 0.0);
    format!("{x:.4}, {y:.4}, {z:.4}")
}

/// Formats a value with as many digits as its standard deviation justifies.
pub(super) fn with_sigma(value: f64, sigma: Option<f64>) -> String {
    let Some(sigma) = sigma else {
        // Six digits identify it; the camera file has all digits.
        let short: f64 = format!("{value:.5e}").parse().unwrap_or(value);
        return format!("{short} (held)");
    };
    // Two significant digits of the standard deviation.
    let decimals = (1.0 - libm::log10(sigma).floor()).clamp(0.0, 9.0) as usize;
    if sigma > 0.0 && sigma < 1e-7 {
        return format!("{value:.4e} ± {sigma:.1e}");
    }
    format!("{value:.decimals$} ± {sigma:.decimals$}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_have_digits_that_match_their_precision() {
        assert_eq!(with_sigma(145.562_25, Some(0.0312)), "145.562 ± 0.031");
        assert_eq!(with_sigma(1234.5, Some(25.0)), "1234 ± 25");
        assert_eq!(with_sigma(1.5e-9, Some(2e-11)), "1.5000e-9 ± 2.0e-11");
        assert_eq!(with_sigma(0.5, None), "0.5 (held)");
        assert_eq!(with_sigma(239.580_349_687_12, None), "239.58 (held)");
    }

    #[test]
    fn coordinates_are_never_minus_zero() {
        let shown = metres(nalgebra::Vector3::new(-1e-9, -0.0, -0.5));
        assert_eq!(shown, "0.0000, 0.0000, -0.5000");
    }
}
