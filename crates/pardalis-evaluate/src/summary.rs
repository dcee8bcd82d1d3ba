//! Error statistics of one track.

use nalgebra::{Cholesky, Matrix2, SMatrix, SVector, Vector2, Vector3};
use pardalis::filter::estimate::covariance_matrix;
use serde::Serialize;

use super::bootstrap::mean_band_99;
use super::course::Course;
use super::distribution::{Distribution, MeanSd, distribution, mean, mean_sd};
use super::finding::frames_to_find;
use super::heading::Heading;
use super::spherical::{SphericalError, angle_between, spherical_error};
use super::{EstimatedState, Sample, Settings, TrueState, difference, norm};

/// 95 % quantile of the chi-square distribution with three degrees of freedom.
const CHI_SQUARE_95_3_DOF: f64 = 7.814_727_903;
/// 95 % quantile of the chi-square distribution with two degrees of freedom.
const CHI_SQUARE_95_2_DOF: f64 = 5.991_464_547;

/// Evaluation of one track.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Evaluation {
    /// Share of the visible frames with an estimate; `None` if the object is never visible.
    pub coverage: Option<f64>,
    /// Number of visible frames without an estimate or with one too far from the truth.
    pub lost_frames: usize,
    /// Whether the estimate is on target in the last visible frame; `None` if the object is never visible.
    pub ends_on_target: Option<bool>,
    /// Largest number of frames, over all stretches of visible frames, until an estimate is on target (1 for
    /// the first frame of a stretch). A stretch without such a frame counts as its length plus 1. `None` if
    /// the object is never visible.
    pub frames_to_find: Option<usize>,
    /// Statistics over all frames of the ground truth.
    pub all: Summary,
    /// Statistics over the frames in which the object is visible.
    pub visible: Summary,
}

/// Statistics over a set of frames.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Summary {
    /// Number of frames of the ground truth.
    pub frames: usize,
    /// Number of those with an estimate.
    pub estimates: usize,
    /// Errors of the estimates; `None` if there are none.
    pub errors: Option<Errors>,
}

/// Errors (estimate minus truth) over the frames with an estimate.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Errors {
    /// Length of the position error in metres.
    pub position_m: Distribution,
    /// Length of the position error of the best particle in metres, over the frames that have one; `None` if there are none.
    pub best_position_m: Option<Distribution>,
    /// Length of the position error in the world's x-y plane, in metres.
    pub planar_m: Distribution,
    /// Mean position error along the world's x, y and z axes, in metres.
    pub bias_m: [f64; 3],
    /// Error of the distance from [`Settings::around_m`], in metres.
    pub distance_m: MeanSd,
    /// Error of the elevation above the horizontal as seen from that point, in radians.
    pub elevation_rad: MeanSd,
    /// Error of the azimuth about the world's z axis as seen from that point, in radians, wrapped to ±π.
    pub azimuth_rad: MeanSd,
    /// Mean angle between the directions to estimate and truth as seen from that point, in radians.
    pub direction_mean_rad: f64,
    /// Maximum of that angle, in radians.
    pub direction_max_rad: f64,
    /// Root mean square length of the velocity error in m/s, over frames with both velocities.
    pub velocity_rmse_mps: Option<f64>,
    /// Directions of travel; `None` if the object does not travel or velocities are missing.
    pub course: Option<Course>,
    /// Errors of the heading; `None` if no frame has both headings.
    pub heading: Option<Heading>,
    /// Consistency of the covariances of the position with its errors.
    pub consistency: Consistency,
    /// The same of the velocity, over frames with both velocities; `None` if none of them has a covariance.
    pub velocity_consistency: Option<Consistency>,
}

/// Normalised estimation error squared (NEES) of the position or the velocity, e′ C⁻¹ e.
///
/// With correct covariances its mean is the number of dimensions, and 95 % of the values lie within the
/// chi-square bound.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Consistency {
    /// Number of estimates with a usable covariance. Only these are counted here.
    pub estimates: usize,
    /// Number of estimates whose covariance is missing or not positive definite.
    pub left_out: usize,
    /// Mean NEES; `None` without a usable covariance.
    pub mean_nees: Option<f64>,
    /// 99 % confidence interval (lowest, highest) of the mean NEES. It allows for the correlation of
    /// neighbouring frames by a bootstrap with blocks of matching length (Carlstein 1986). `None` if the
    /// series is shorter than two blocks.
    pub mean_nees_band_99: Option<[f64; 2]>,
    /// Expected mean NEES: 3, or 2 if the z variance is zero, as for targets on a plane.
    pub expected_nees: Option<f64>,
    /// Share of the estimates within the 95 % chi-square bound.
    pub share_within_95: Option<f64>,
}

/// Evaluates one track. `samples` holds every frame of its object's ground truth in order of time.
pub fn evaluate(samples: &[Sample], settings: &Settings) -> Evaluation {
    let visible: Vec<Sample> = samples
        .iter()
        .filter(|s| settings.sees(&s.truth))
        .copied()
        .collect();
    let on_target = |s: &Sample| settings.is_on_target(s);
    let seen = summarize(&visible, settings.around_m);
    Evaluation {
        coverage: (seen.frames > 0).then(|| seen.estimates as f64 / seen.frames as f64),
        lost_frames: visible.iter().filter(|s| !on_target(s)).count(),
        ends_on_target: visible.last().map(on_target),
        frames_to_find: frames_to_find(samples, settings),
        all: summarize(samples, settings.around_m),
        visible: seen,
    }
}

/// Computes the statistics over the given frames.
fn summarize(samples: &[Sample], around_m: [f64; 3]) -> Summary {
    let pairs: Vec<(EstimatedState, TrueState)> = samples
        .iter()
        .filter_map(|s| s.estimate.map(|e| (e, s.truth)))
        .collect();
    Summary {
        frames: samples.len(),
        estimates: pairs.len(),
        errors: (!pairs.is_empty()).then(|| errors(&pairs, around_m)),
    }
}

/// Computes the errors of at least one estimate.
fn errors(pairs: &[(EstimatedState, TrueState)], around_m: [f64; 3]) -> Errors {
    let position_errors_m: Vec<[f64; 3]> = pairs
        .iter()
        .map(|(e, t)| difference(e.position_m, t.position_m))
        .collect();
    let spherical_errors: Vec<SphericalError> = pairs
        .iter()
        .map(|(e, t)| spherical_error(e, t, around_m))
        .collect();
    let direction_errors_rad: Vec<f64> = pairs
        .iter()
        .map(|(e, t)| {
            let estimated = difference(e.position_m, around_m);
            angle_between(estimated, difference(t.position_m, around_m))
        })
        .collect();
    let best_errors_m: Vec<f64> = pairs
        .iter()
        .filter_map(|(e, t)| Some(norm(difference(e.best_position_m?, t.position_m))))
        .collect();
    let planar_errors_m = position_errors_m
        .iter()
        .map(|[x, y, _]| libm::hypot(*x, *y));
    let squared_velocity_errors: Vec<f64> = pairs
        .iter()
        .filter_map(|(e, t)| Some(norm(difference(e.velocity_mps?, t.velocity_mps?)).powi(2)))
        .collect();
    let spherical = |of: fn(&SphericalError) -> f64| mean_sd(spherical_errors.iter().map(of));
    Errors {
        position_m: distribution(position_errors_m.iter().map(|&e| norm(e)).collect()),
        best_position_m: (!best_errors_m.is_empty()).then(|| distribution(best_errors_m)),
        planar_m: distribution(planar_errors_m.collect()),
        bias_m: [0, 1, 2].map(|i| mean_sd(position_errors_m.iter().map(|e| e[i])).mean),
        distance_m: spherical(|e| e.distance_m),
        elevation_rad: spherical(|e| e.elevation_rad),
        azimuth_rad: spherical(|e| e.azimuth_rad),
        direction_mean_rad: mean(&direction_errors_rad).unwrap_or(0.0),
        direction_max_rad: direction_errors_rad.iter().copied().fold(0.0, f64::max),
        velocity_rmse_mps: mean(&squared_velocity_errors).map(f64::sqrt),
        course: Course::of(pairs),
        heading: Heading::of(pairs),
        consistency: consistency(pairs.iter().map(|(e, t)| {
            let error_m = difference(e.position_m, t.position_m);
            (error_m, e.covariance_m2)
        })),
        velocity_consistency: Some(consistency(pairs.iter().filter_map(|(e, t)| {
            let error_mps = difference(e.velocity_mps?, t.velocity_mps?);
            Some((error_mps, e.velocity_covariance_m2ps2))
        })))
        .filter(|found| found.estimates > 0),
    }
}

/// Compares errors with their covariances, if there are any.
fn consistency(errors: impl Iterator<Item = ([f64; 3], Option<[f64; 6]>)>) -> Consistency {
    let all: Vec<Option<Nees>> = errors
        .map(|(error, covariance)| Nees::of(error, covariance?))
        .collect();
    let nees: Vec<&Nees> = all.iter().flatten().collect();
    let mean_of = |value: fn(&&Nees) -> f64| mean(&nees.iter().map(value).collect::<Vec<_>>());
    Consistency {
        estimates: nees.len(),
        left_out: all.len() - nees.len(),
        mean_nees: mean_of(|n| n.value),
        mean_nees_band_99: mean_band_99(&nees.iter().map(|n| n.value).collect::<Vec<_>>()),
        expected_nees: mean_of(|n| n.dimensions),
        share_within_95: mean_of(|n| f64::from(n.value <= n.bound_95)),
    }
}

/// Normalised squared error of one estimate.
struct Nees {
    /// e′ C⁻¹ e.
    value: f64,
    /// Number of dimensions of e.
    dimensions: f64,
    /// 95 % bound for this number of dimensions.
    bound_95: f64,
}

impl Nees {
    /// Computes the error; `None` if the covariance is not positive definite.
    fn of([x, y, z]: [f64; 3], entries: [f64; 6]) -> Option<Self> {
        let covariance = covariance_matrix(entries);
        if covariance[(2, 2)] == 0.0 {
            let on_plane: Matrix2<f64> = covariance.fixed_view::<2, 2>(0, 0).into();
            Some(Self {
                value: nees(Vector2::new(x, y), on_plane)?,
                dimensions: 2.0,
                bound_95: CHI_SQUARE_95_2_DOF,
            })
        } else {
            Some(Self {
                value: nees(Vector3::new(x, y, z), covariance)?,
                dimensions: 3.0,
                bound_95: CHI_SQUARE_95_3_DOF,
            })
        }
    }
}

/// Computes e′ C⁻¹ e; `None` if C is not positive definite, or so nearly singular that rounding decides.
fn nees<const D: usize>(error: SVector<f64, D>, covariance: SMatrix<f64, D, D>) -> Option<f64> {
    let factor = Cholesky::new(covariance)?;
    let l = factor.l_dirty();
    let sound = |i| l[(i, i)] * l[(i, i)] > 1e-12 * covariance[(i, i)];
    let value = error.dot(&factor.solve(&error));
    ((0..D).all(sound) && value.is_finite()).then_some(value)
}

#[cfg(test)]
mod tests {
    use std::f64::consts::PI;

    use super::*;

    /// Returns a visible object at `true_m` with an estimate at `estimated_m`.
    fn sample(estimated_m: [f64; 3], true_m: [f64; 3]) -> Sample {
        Sample {
            state: None,
            estimate: Some(EstimatedState::at(estimated_m)),
            truth: TrueState {
                visible_fraction: Some(1.0),
                ..TrueState::at(true_m)
            },
        }
    }

    /// Returns an object at the origin with an estimate at the distance `error_m` along x.
    fn off_by(error_m: f64) -> Sample {
        sample([error_m, 0.0, 0.0], [0.0; 3])
    }

    fn errors_of(samples: &[Sample], settings: &Settings) -> Errors {
        evaluate(samples, settings).all.errors.unwrap()
    }

    fn assert_near(found: f64, expected: f64) {
        assert!(
            (found - expected).abs() < 1e-12,
            "found {found}, expected {expected}"
        );
    }

    #[test]
    fn position_statistics_match_manual_computation() {
        let samples = [3.0, 4.0, 0.0, 1.0].map(off_by);
        let p = errors_of(&samples, &Settings::default()).position_m;
        assert_near(p.mean, 2.0);
        assert_near(p.sd, 2.5_f64.sqrt());
        assert_near(p.rmse, 6.5_f64.sqrt());
        assert_near(p.median, 2.0);
        assert_near(p.p95, 3.85);
        assert_near(p.max, 4.0);
    }

    #[test]
    fn evaluates_best_particle_if_the_track_has_one() {
        let mut samples = [1.0, 2.0, 4.0].map(off_by);
        assert_eq!(
            errors_of(&samples, &Settings::default()).best_position_m,
            None
        );
        for (sample, best_m) in samples.iter_mut().zip([3.0, 4.0]) {
            sample.estimate.as_mut().unwrap().best_position_m = Some([0.0, best_m, 0.0]);
        }
        let errors = errors_of(&samples, &Settings::default());
        let best = errors.best_position_m.unwrap();
        assert_near(best.mean, 3.5);
        assert_near(best.rmse, 12.5_f64.sqrt());
        assert_near(errors.position_m.rmse, 7_f64.sqrt());
    }

    #[test]
    fn planar_errors_ignore_the_height() {
        let samples = [
            sample([3.0, 4.0, 9.0], [0.0; 3]),
            sample([1.0, 1.0, 5.0], [1.0, 0.0, 1.0]),
        ];
        let planar_m = errors_of(&samples, &Settings::default()).planar_m;
        assert_eq!((planar_m.mean, planar_m.sd, planar_m.max), (3.0, 2.0, 5.0));
        assert_near(planar_m.rmse, 13_f64.sqrt());
    }

    #[test]
    fn bias_keeps_the_sign_of_each_axis() {
        let samples = [
            sample([1.0, 2.0, 3.0], [0.5, 2.0, 4.0]),
            sample([1.0, 2.0, 3.0], [1.0, 1.0, 4.0]),
        ];
        let bias_m = errors_of(&samples, &Settings::default()).bias_m;
        assert_eq!(bias_m, [0.25, 0.5, -1.0]);
    }

    #[test]
    fn spherical_errors_refer_to_the_point_in_the_world_frame() {
        let settings = Settings {
            around_m: [1.0, 1.0, 1.0],
            ..Settings::default()
        };
        // From 2 m along x to 3 m straight down.
        let e = errors_of(&[sample([1.0, 1.0, -2.0], [3.0, 1.0, 1.0])], &settings);
        assert_near(e.distance_m.mean, 1.0);
        assert_near(e.elevation_rad.mean, -PI / 2.0);
        // 45° to the left at the same height.
        let e = errors_of(&[sample([3.0, 3.0, 1.0], [3.0, 1.0, 1.0])], &settings);
        assert_near(e.distance_m.mean, 8_f64.sqrt() - 2.0);
        assert_near(e.elevation_rad.mean, 0.0);
        assert_near(e.azimuth_rad.mean, PI / 4.0);
        assert_near(e.direction_mean_rad, PI / 4.0);
        assert_near(e.direction_max_rad, PI / 4.0);
    }

    #[test]
    fn azimuth_errors_are_wrapped() {
        // Just left and just right of the negative x axis: 2·0.1 rad apart, not 2π - 0.2.
        let behind = |a: f64| [-libm::cos(a), libm::sin(a), 0.0];
        let samples = [
            sample(behind(-0.1), behind(0.1)),
            sample(behind(0.1), behind(-0.1)),
        ];
        let azimuth_rad = errors_of(&samples, &Settings::default()).azimuth_rad;
        assert_near(azimuth_rad.mean, 0.0);
        assert_near(azimuth_rad.sd, 0.2);
    }

    #[test]
    fn coverage_and_loss_count_visible_frames_only() {
        let without = |fraction| {
            let mut s = off_by(0.0);
            s.estimate = None;
            s.truth.visible_fraction = fraction;
            s
        };
        let samples = [
            off_by(0.1),
            off_by(0.7),         // too far
            without(Some(0.61)), // missed
            without(None),       // missed: unknown counts as visible
            without(Some(0.6)),  // not over the threshold
            off_by(0.66),        // exactly on the bound
            without(Some(0.0)),  // occluded
        ];
        let s = evaluate(&samples, &Settings::default());
        assert_eq!((s.all.frames, s.all.estimates), (7, 3));
        assert_eq!((s.visible.frames, s.visible.estimates), (5, 3));
        assert_eq!(s.coverage, Some(0.6));
        assert_eq!(s.lost_frames, 3);
        assert_eq!(s.ends_on_target, Some(true));
        let lost_at_the_end = evaluate(&samples[..4], &Settings::default());
        assert_eq!(lost_at_the_end.ends_on_target, Some(false));
    }

    #[test]
    fn occluded_frames_count_only_in_statistics_over_all_frames() {
        let mut hidden = off_by(0.5);
        hidden.truth.visible_fraction = Some(0.3);
        let s = evaluate(&[off_by(0.1), hidden], &Settings::default());
        assert_near(s.all.errors.unwrap().position_m.max, 0.5);
        assert_near(s.visible.errors.unwrap().position_m.max, 0.1);
    }

    #[test]
    fn velocity_errors_need_both_velocities() {
        let mut both = off_by(0.0);
        let mut one_sided = off_by(0.0);
        for s in [&mut both, &mut one_sided] {
            s.estimate.as_mut().unwrap().velocity_mps = Some([3.0, 0.0, 5.0]);
        }
        both.truth.velocity_mps = Some([0.0, 4.0, 5.0]);
        let rmse_mps =
            |samples: &[Sample]| errors_of(samples, &Settings::default()).velocity_rmse_mps;
        assert_eq!(rmse_mps(&[both, one_sided]), Some(5.0));
        assert_eq!(rmse_mps(&[one_sided]), None);
    }

    fn with_covariance(error_m: [f64; 3], covariance_m2: [f64; 6]) -> Sample {
        let mut s = sample(error_m, [0.0; 3]);
        s.estimate.as_mut().unwrap().covariance_m2 = Some(covariance_m2);
        s
    }

    #[test]
    fn consistency_weights_errors_by_their_covariance() {
        let diagonal = [0.01, 0.0, 0.0, 0.04, 0.0, 0.09];
        // C = [[2, 1, 0], [1, 2, 0], [0, 0, 1]] has C⁻¹ = [[2, -1, 0], [-1, 2, 0], [0, 0, 3]] / 3.
        let correlated = [2.0, 1.0, 0.0, 2.0, 0.0, 1.0];
        let samples = [
            with_covariance([0.1, 0.2, 0.3], diagonal),    // 3
            with_covariance([0.3, 0.0, 0.0], diagonal),    // 9: beyond the bound
            with_covariance([1.0, -1.0, 2.0], correlated), // 2 + 4
            with_covariance([0.1, 0.0, 0.0], [0.0; 6]),    // singular
            with_covariance([0.1, 0.0, 0.0], [0.3, 0.3, 0.0, 0.3, 0.0, 1.0]), // singular except for rounding
            with_covariance([0.1, 0.0, 0.0], [-1.0, 0.0, 0.0, 1.0, 0.0, 1.0]), // not a covariance
            off_by(0.1),                                                      // missing
        ];
        let c = errors_of(&samples, &Settings::default()).consistency;
        assert_eq!((c.estimates, c.left_out), (3, 4));
        assert_near(c.mean_nees.unwrap(), 6.0);
        assert_eq!(c.expected_nees, Some(3.0));
        assert_near(c.share_within_95.unwrap(), 2.0 / 3.0);
    }

    #[test]
    fn consistency_of_velocities_needs_both_and_a_covariance() {
        let moving = |velocity_mps: Option<[f64; 3]>, covariance: Option<[f64; 6]>| {
            let mut s = with_covariance([0.1, 0.0, 0.0], [0.01, 0.0, 0.0, 0.01, 0.0, 0.01]);
            let estimate = s.estimate.as_mut().unwrap();
            estimate.velocity_mps = Some([1.0, 2.0, 3.0]);
            estimate.velocity_covariance_m2ps2 = covariance;
            s.truth.velocity_mps = velocity_mps;
            s
        };
        let truth_mps = Some([1.0, 2.5, 3.0]);
        let diagonal = Some([1.0, 0.0, 0.0, 0.25, 0.0, 4.0]);
        let samples = [
            moving(truth_mps, diagonal), // 1
            moving(truth_mps, None),     // left out
            moving(None, diagonal),      // nothing to compare with
        ];
        let errors = errors_of(&samples, &Settings::default());
        let found = errors.velocity_consistency.unwrap();
        assert_eq!((found.estimates, found.left_out), (1, 1));
        assert_near(found.mean_nees.unwrap(), 1.0);
        assert_eq!(found.expected_nees, Some(3.0));
        assert_eq!(errors.consistency.estimates, 3);
        let errors = errors_of(&samples[1..], &Settings::default());
        assert_eq!(errors.velocity_consistency, None);
    }

    #[test]
    fn planar_covariances_have_two_dimensions() {
        let planar = [0.01, 0.0, 0.0, 0.01, 0.0, 0.0];
        // 6.25 exceeds the bound for two dimensions but not the one for three.
        let samples = [with_covariance([0.25, 0.0, 0.0], planar)];
        let c = errors_of(&samples, &Settings::default()).consistency;
        assert_near(c.mean_nees.unwrap(), 6.25);
        assert_eq!(c.expected_nees, Some(2.0));
        assert_eq!(c.share_within_95, Some(0.0));
    }

    #[test]
    fn empty_input_has_no_statistics() {
        let s = evaluate(&[], &Settings::default());
        assert_eq!(
            (s.coverage, s.lost_frames, s.ends_on_target),
            (None, 0, None)
        );
        assert_eq!(s.all.errors, None);
        let mut missed = off_by(0.0);
        missed.estimate = None;
        let s = evaluate(&[missed], &Settings::default());
        assert_eq!((s.coverage, s.lost_frames), (Some(0.0), 1));
        assert_eq!(s.visible.errors, None);
    }
}
