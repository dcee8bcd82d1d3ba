//! Heading: the direction in which an object faces.

use serde::Serialize;

use super::distribution::distribution;
use super::spherical::wrapped_rad;
use super::{EstimatedState, TrueState};

/// Heading errors, estimate minus truth, wrapped to ±π, over the frames in which both are known.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Heading {
    /// Number of those frames.
    pub frames: usize,
    /// Median magnitude in radians.
    pub error_median_rad: f64,
    /// 95 % quantile of the magnitude in radians.
    pub error_p95_rad: f64,
    /// Mean in radians; positive if the estimates are rotated counter-clockwise.
    pub bias_rad: f64,
}

impl Heading {
    /// Computes the errors; `None` if no frame has both headings.
    pub(super) fn of(pairs: &[(EstimatedState, TrueState)]) -> Option<Self> {
        let errors_rad: Vec<f64> = pairs
            .iter()
            .filter_map(|(e, t)| Some(wrapped_rad(e.heading_rad? - t.heading_rad?)))
            .collect();
        if errors_rad.is_empty() {
            return None;
        }
        let frames = errors_rad.len();
        let bias_rad = errors_rad.iter().sum::<f64>() / frames as f64;
        let magnitudes_rad = distribution(errors_rad.into_iter().map(f64::abs).collect());
        Some(Self {
            frames,
            error_median_rad: magnitudes_rad.median,
            error_p95_rad: magnitudes_rad.p95,
            bias_rad,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pair(estimated_deg: Option<f64>, true_deg: Option<f64>) -> (EstimatedState, TrueState) {
        let estimate = EstimatedState {
            heading_rad: estimated_deg.map(f64::to_radians),
            ..EstimatedState::at([0.0; 3])
        };
        let truth = TrueState {
            heading_rad: true_deg.map(f64::to_radians),
            ..TrueState::at([0.0; 3])
        };
        (estimate, truth)
    }

    #[test]
    fn errors_are_wrapped_and_need_both_headings() {
        let pairs = [
            (Some(91.0), Some(90.0)),    // 1
            (Some(-179.0), Some(179.0)), // 2
            (Some(170.0), Some(-180.0)), // -10
            (Some(725.0), Some(0.0)),    // 5, after two full turns
            (None, Some(0.0)),
            (Some(90.0), None),
        ]
        .map(|(estimated, truth)| pair(estimated, truth));
        let heading = Heading::of(&pairs).unwrap();
        assert_eq!(heading.frames, 4);
        let near = |found_rad: f64, degrees: f64| {
            assert!(
                (found_rad.to_degrees() - degrees).abs() < 1e-9,
                "{found_rad} is not {degrees} degrees"
            );
        };
        near(heading.error_median_rad, 3.5);
        near(heading.error_p95_rad, 9.25);
        near(heading.bias_rad, -0.5);
        assert_eq!(Heading::of(&pairs[4..]), None);
    }
}
