//! Reliability of confidences: of the rows with confidence 0.9, 90 % should be right.

use serde::Serialize;

use super::{EstimatedState, TrueState, distance_m};

/// Number of equal intervals of the confidence.
const BINS: usize = 10;

/// Share of an object above which it counts as in view of a camera.
const IN_VIEW_OVER: f64 = 0.1;

/// The confidence of one row of a track, and whether the row is right.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CheckedConfidence {
    /// Confidence of the row: a probability, 0 to 1.
    pub confidence: f64,
    /// Whether the row is right.
    pub is_right: bool,
}

impl CheckedConfidence {
    /// Checks one row. A row with an estimate states that the object is within `diameter_m` (metres) of it. A
    /// row without one states that the object is in view: more than 0.1 of it is visible, or the share is
    /// unknown. Without ground truth the object does not exist, and both statements are wrong.
    pub fn of(
        confidence: f64,
        estimate: Option<&EstimatedState>,
        truth: Option<&TrueState>,
        diameter_m: f64,
    ) -> Self {
        let is_right = truth.is_some_and(|truth| match estimate {
            Some(estimate) => distance_m(estimate.position_m, truth.position_m) <= diameter_m,
            None => truth
                .visible_fraction
                .is_none_or(|share| share > IN_VIEW_OVER),
        });
        Self {
            confidence,
            is_right,
        }
    }
}

/// Confidences compared with observed frequencies.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Reliability {
    /// Number of rows.
    pub rows: usize,
    /// Expected calibration error: mean over rows of |mean confidence − share right| of their bin (Naeini et al. 2015).
    pub calibration_error: f64,
    /// Ten equal intervals of the confidence in ascending order, without empty ones.
    pub bins: Vec<Bin>,
}

/// Rows with a confidence in one interval.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Bin {
    /// Number of rows.
    pub rows: usize,
    /// Mean confidence.
    pub mean_confidence: f64,
    /// Share of rows that are right.
    pub share_right: f64,
}

/// Bins the checked confidences of one or more tracks; `None` without any.
pub fn reliability(checks: &[CheckedConfidence]) -> Option<Reliability> {
    let bin_of =
        |check: &CheckedConfidence| ((check.confidence * BINS as f64) as usize).min(BINS - 1);
    let bins: Vec<Bin> = (0..BINS)
        .filter_map(|bin| {
            let inside: Vec<&CheckedConfidence> =
                checks.iter().filter(|c| bin_of(c) == bin).collect();
            let rows = inside.len() as f64;
            let right = inside.iter().filter(|check| check.is_right).count();
            (!inside.is_empty()).then(|| Bin {
                rows: inside.len(),
                mean_confidence: inside.iter().map(|check| check.confidence).sum::<f64>() / rows,
                share_right: right as f64 / rows,
            })
        })
        .collect();
    let errors = bins
        .iter()
        .map(|bin| bin.rows as f64 * (bin.mean_confidence - bin.share_right).abs());
    let calibration_error = errors.sum::<f64>() / checks.len() as f64;
    (!checks.is_empty()).then_some(Reliability {
        rows: checks.len(),
        calibration_error,
        bins,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn checks(confidence: f64, right: usize, wrong: usize) -> Vec<CheckedConfidence> {
        let check = |is_right| CheckedConfidence {
            confidence,
            is_right,
        };
        [vec![check(true); right], vec![check(false); wrong]].concat()
    }

    #[test]
    fn correct_confidences_have_no_error() {
        let all = [checks(0.75, 3, 1), checks(1.0, 5, 0), checks(0.0, 0, 7)].concat();
        let found = reliability(&all).unwrap();
        assert_eq!((found.rows, found.bins.len()), (16, 3));
        assert!(found.calibration_error < 1e-12);
        assert_eq!(reliability(&[]), None);
    }

    #[test]
    fn bins_are_weighted_by_their_rows() {
        // Overconfident by 0.4 in a bin of ten, underconfident by 0.75 in a bin of five; confidences are
        // averaged within a bin.
        let all = [checks(0.93, 2, 3), checks(0.97, 3, 2)].concat();
        let all = [all, checks(0.25, 5, 0)].concat();
        let found = reliability(&all).unwrap();
        let error = (10.0 * (0.95 - 0.5) + 5.0 * 0.75) / 15.0;
        assert!((found.calibration_error - error).abs() < 1e-12);
        let [low, high] = found.bins[..] else {
            panic!("expected two bins, found {}", found.bins.len())
        };
        assert_eq!((low.rows, low.share_right), (5, 1.0));
        assert_eq!((high.rows, high.share_right), (10, 0.5));
        assert!((high.mean_confidence - 0.95).abs() < 1e-12);
    }

    #[test]
    fn interval_bounds_belong_to_the_upper_bin_and_one_to_the_last() {
        let all = [checks(0.5, 1, 0), checks(0.49, 1, 0), checks(1.0, 1, 0)].concat();
        let found = reliability(&all).unwrap();
        let means: Vec<f64> = found.bins.iter().map(|bin| bin.mean_confidence).collect();
        assert_eq!(means, [0.49, 0.5, 1.0]);
    }

    #[test]
    fn rows_state_a_position_or_visibility() {
        let estimate = EstimatedState::at([1.0, 2.0, 3.0]);
        let truth = |x_m: f64, share: Option<f64>| TrueState {
            visible_fraction: share,
            ..TrueState::at([x_m, 2.0, 3.0])
        };
        let is_right = |estimate, truth: Option<&TrueState>| {
            CheckedConfidence::of(0.5, estimate, truth, 0.25).is_right
        };
        let here = Some(&estimate);
        // Within a diameter, even while occluded; too far away; without an object.
        assert!(is_right(here, Some(&truth(1.25, Some(0.0)))));
        assert!(!is_right(here, Some(&truth(1.26, Some(1.0)))));
        assert!(!is_right(here, None));
        assert!(is_right(None, Some(&truth(9.0, Some(0.11)))));
        assert!(is_right(None, Some(&truth(9.0, None))));
        assert!(!is_right(None, Some(&truth(1.0, Some(0.1)))));
        assert!(!is_right(None, None));
    }
}
