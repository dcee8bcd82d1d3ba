//! The figures of merit of an experiment.

use pardalis_evaluate::{Course, Errors, Heading};
use pardalis_scene::experiment::FIGURES_OF_MERIT;

use crate::commands::evaluate::{CrowdReport, TargetReport};

/// The results of one seed and target.
pub(super) struct Measured<'a> {
    pub(super) report: &'a TargetReport,
    /// The crowd of which the target is a member.
    pub(super) crowd: Option<&'a CrowdReport>,
    pub(super) ms_a_frame: Option<f64>,
}

/// A figure's name and its computation, which returns `None` without estimates or if the figure is meaningless.
pub(super) type Metric = (&'static str, fn(&Measured) -> Option<f64>);

/// The figures, in the order of the columns; their meanings are in [`FIGURES_OF_MERIT`].
pub(super) const METRICS: [Metric; FIGURES_OF_MERIT.len()] = [
    ("coverage", |m| m.report.scores.coverage),
    ("on_target_share", |m| {
        let (frames, lost) = (m.report.scores.visible.frames, m.report.scores.lost_frames);
        (frames > 0).then(|| 1.0 - lost as f64 / frames as f64)
    }),
    ("lost_frames", |m| Some(m.report.scores.lost_frames as f64)),
    ("ends_on_target", |m| {
        m.report.scores.ends_on_target.map(one_or_zero)
    }),
    ("frames_to_find", |m| {
        m.report.scores.frames_to_find.map(|n| n as f64)
    }),
    ("frames_to_occluded", |m| {
        m.report.states?.frames_to_occluded.map(|n| n as f64)
    }),
    ("frames_to_tracking", |m| {
        m.report.states?.frames_to_tracking.map(|n| n as f64)
    }),
    ("elsewhere_frames", |m| {
        Some(m.report.states?.elsewhere_frames as f64)
    }),
    ("overconfident_frames", |m| {
        let confidence = &m.report.confidence;
        let wrong = confidence.checks.iter().filter(|c| !c.is_right);
        let sure = wrong.filter(|c| c.confidence > 0.5).count();
        confidence.reliability.is_some().then_some(sure as f64)
    }),
    ("mean_m", |m| errors(m).map(|e| e.position_m.mean)),
    ("sd_m", |m| errors(m).map(|e| e.position_m.sd)),
    ("rmse_m", |m| errors(m).map(|e| e.position_m.rmse)),
    ("max_m", |m| errors(m).map(|e| e.position_m.max)),
    ("best_rmse_m", |m| {
        errors(m)?.best_position_m.map(|best| best.rmse)
    }),
    ("distance_mean_m", |m| errors(m).map(|e| e.distance_m.mean)),
    ("distance_sd_m", |m| errors(m).map(|e| e.distance_m.sd)),
    ("elevation_mean_rad", |m| {
        errors(m).map(|e| e.elevation_rad.mean)
    }),
    ("elevation_sd_rad", |m| {
        errors(m).map(|e| e.elevation_rad.sd)
    }),
    ("azimuth_mean_rad", |m| {
        errors(m).map(|e| e.azimuth_rad.mean)
    }),
    ("azimuth_sd_rad", |m| errors(m).map(|e| e.azimuth_rad.sd)),
    ("direction_max_rad", |m| {
        errors(m).map(|e| e.direction_max_rad)
    }),
    ("mean_nees", |m| errors(m)?.consistency.mean_nees),
    ("nees_99_low", |m| {
        errors(m)?.consistency.mean_nees_band_99.map(|band| band[0])
    }),
    ("nees_99_high", |m| {
        errors(m)?.consistency.mean_nees_band_99.map(|band| band[1])
    }),
    ("planar_mean_m", |m| errors(m).map(|e| e.planar_m.mean)),
    ("planar_sd_m", |m| errors(m).map(|e| e.planar_m.sd)),
    ("planar_rmse_m", |m| errors(m).map(|e| e.planar_m.rmse)),
    ("bias_x_m", |m| errors(m).map(|e| e.bias_m[0])),
    ("bias_y_m", |m| errors(m).map(|e| e.bias_m[1])),
    ("bias_z_m", |m| errors(m).map(|e| e.bias_m[2])),
    ("velocity_rmse_mps", |m| errors(m)?.velocity_rmse_mps),
    ("velocity_nees", |m| {
        errors(m)?.velocity_consistency?.mean_nees
    }),
    ("course_error_median_rad", |m| {
        course(m).map(|c| c.error_median_rad)
    }),
    ("course_rad", |m| course(m).map(|c| c.estimated_rad)),
    ("true_course_rad", |m| course(m).map(|c| c.true_rad)),
    ("heading_error_median_rad", |m| {
        heading(m).map(|h| h.error_median_rad)
    }),
    ("heading_error_p95_rad", |m| {
        heading(m).map(|h| h.error_p95_rad)
    }),
    ("heading_bias_rad", |m| heading(m).map(|h| h.bias_rad)),
    ("changed_target", |m| {
        m.report.changed_target.map(one_or_zero)
    }),
    ("calibration_error", |m| {
        let reliability = m.report.confidence.reliability.as_ref();
        reliability.map(|r| r.calibration_error)
    }),
    ("confidence_max", |m| m.report.confidence.confidence_max),
    ("gospa_m", |m| Some(m.crowd?.figures.gospa_m)),
    ("switches", |m| Some(m.crowd?.figures.switches as f64)),
    ("longest_missed_frames", |m| {
        Some(m.crowd?.figures.longest_missed_frames as f64)
    }),
    ("longest_false_frames", |m| {
        Some(m.crowd?.figures.longest_false_frames as f64)
    }),
    ("estimates", |m| Some(m.report.scores.all.estimates as f64)),
    ("ms_a_frame", |m| m.ms_a_frame),
];

fn errors<'a>(measured: &Measured<'a>) -> Option<&'a Errors> {
    measured.report.scores.all.errors.as_ref()
}

fn course(measured: &Measured) -> Option<Course> {
    errors(measured)?.course
}

fn heading(measured: &Measured) -> Option<Heading> {
    errors(measured)?.heading
}

fn one_or_zero(yes: bool) -> f64 {
    f64::from(u8::from(yes))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_figure_of_the_reference_is_computed() {
        assert_eq!(
            METRICS.map(|(name, _)| name),
            FIGURES_OF_MERIT.map(|(name, _)| name)
        );
    }
}
