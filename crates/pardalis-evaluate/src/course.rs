//! Direction of travel over the ground.

use serde::Serialize;

use super::distribution::distribution;
use super::spherical::wrapped_rad;
use super::{EstimatedState, TrueState};

/// Speed over the ground in m/s below which an object has no direction of travel.
const MOVING_OVER_MPS: f64 = 0.2;

/// Errors of the direction of travel in the world's x-y plane, counter-clockwise from x, over the frames in
/// which the object moves at more than 0.2 m/s.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Course {
    /// Number of those frames.
    pub frames: usize,
    /// Median angle between the estimated and the true velocity, in radians.
    pub error_median_rad: f64,
    /// Circular mean of the directions of the estimated velocities, in radians.
    pub estimated_rad: f64,
    /// Circular mean of the directions of the true velocities, in radians.
    pub true_rad: f64,
}

impl Course {
    /// Computes the errors; `None` if the object does not move or no frame has both velocities.
    pub(super) fn of(pairs: &[(EstimatedState, TrueState)]) -> Option<Self> {
        let directions_rad: Vec<[f64; 2]> = pairs
            .iter()
            .filter_map(|(e, t)| {
                let (estimated, truth) = (e.velocity_mps?, t.velocity_mps?);
                let moving = libm::hypot(truth[0], truth[1]) > MOVING_OVER_MPS;
                moving.then(|| [estimated, truth].map(|v| libm::atan2(v[1], v[0])))
            })
            .collect();
        if directions_rad.is_empty() {
            return None;
        }
        let errors_rad = directions_rad
            .iter()
            .map(|[estimated, truth]| wrapped_rad(estimated - truth).abs());
        Some(Self {
            frames: directions_rad.len(),
            error_median_rad: distribution(errors_rad.collect()).median,
            estimated_rad: circular_mean_rad(directions_rad.iter().map(|d| d[0])),
            true_rad: circular_mean_rad(directions_rad.iter().map(|d| d[1])),
        })
    }
}

/// Returns the direction of the sum of unit vectors, in radians.
fn circular_mean_rad(angles_rad: impl Iterator<Item = f64>) -> f64 {
    let (sin, cos) = angles_rad.fold((0.0, 0.0), |(sin, cos), angle_rad| {
        (sin + libm::sin(angle_rad), cos + libm::cos(angle_rad))
    });
    libm::atan2(sin, cos)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pair(
        estimated_mps: Option<[f64; 3]>,
        true_mps: Option<[f64; 3]>,
    ) -> (EstimatedState, TrueState) {
        let estimate = EstimatedState {
            velocity_mps: estimated_mps,
            ..EstimatedState::at([0.0; 3])
        };
        let truth = TrueState {
            velocity_mps: true_mps,
            ..TrueState::at([0.0; 3])
        };
        (estimate, truth)
    }

    #[test]
    fn courses_cover_objects_that_move_over_the_ground() {
        let along = |degrees: f64| {
            let angle_rad = degrees.to_radians();
            Some([libm::cos(angle_rad), libm::sin(angle_rad), 7.0])
        };
        let pairs = [
            pair(along(170.0), along(180.0)),
            pair(along(-150.0), along(180.0)),
            pair(along(-140.0), along(-170.0)),
            pair(along(0.0), Some([0.1, 0.1, 5.0])), // moves only vertically
            pair(None, along(90.0)),
            pair(along(90.0), None),
        ];
        let course = Course::of(&pairs).unwrap();
        assert_eq!(course.frames, 3);
        let near = |found_rad: f64, degrees: f64| {
            assert!(
                (found_rad.to_degrees() - degrees).abs() < 1e-9,
                "{found_rad} is not {degrees} degrees"
            );
        };
        near(course.error_median_rad, 30.0);
        // Across ±180 degrees, where the arithmetic mean would be wrong.
        let mean = Course::of(&pairs[..2]).unwrap();
        near(mean.estimated_rad, -170.0);
        near(mean.true_rad.abs(), 180.0);
        assert_eq!(Course::of(&pairs[3..]), None);
    }
}
