//! One target from several landmarks, each tracked on its own (Campos 2009, section 4).

use std::f64::consts::PI;

use super::{Estimate, TrackState};
use pardalis_filter::estimate::StateEstimate;

/// Combines the estimates of one or more landmarks into that of the target: their mean position, the heading from the
/// rear landmark to the front one, if these are given as `[front, rear]`, and the worst of their states.
pub(super) fn combined(
    landmarks: impl ExactSizeIterator<Item = Estimate>,
    heading: Option<[usize; 2]>,
) -> Estimate {
    let share = 1.0 / landmarks.len() as f64;
    let mut ends = heading.map(|numbers| numbers.map(|number| (number, None::<StateEstimate>)));
    let noted = |(number, landmark): (usize, Estimate)| {
        for (_, end) in ends.iter_mut().flatten().filter(|end| end.0 == number) {
            *end = landmark.kinematics;
        }
        landmark
    };
    let sum = landmarks.enumerate().map(noted).reduce(|a, b| sum(&a, &b));
    let sum = sum.expect("a target has at least one body");
    let heading = ends.and_then(|[(_, front), (_, rear)]| {
        sum.kinematics?;
        Some(heading_of(&front?, &rear?))
    });
    Estimate {
        kinematics: sum.kinematics.map(|sum| StateEstimate {
            position_m: sum.position_m.map(|v| share * v),
            velocity_mps: sum.velocity_mps.map(|velocity| velocity.map(|v| share * v)),
            velocity_covariance_m2ps2: sum
                .velocity_covariance_m2ps2
                .map(|covariance| covariance.map(|v| share * share * v)),
            covariance_m2: sum.covariance_m2.map(|v| share * share * v),
            best_position_m: sum.best_position_m.map(|v| share * v),
            effective_sample_size: sum.effective_sample_size,
        }),
        // A body alone has its own.
        heading_rad: heading.map_or(sum.heading_rad, |[heading_rad, _]| Some(heading_rad)),
        heading_sigma_rad: heading.map_or(sum.heading_sigma_rad, |[_, sigma_rad]| Some(sigma_rad)),
        ..sum
    }
}

/// The direction from the rear landmark to the front one, and its standard deviation, radians, if their errors are independent.
fn heading_of(front: &StateEstimate, rear: &StateEstimate) -> [f64; 2] {
    let [x, y, _] = [0, 1, 2].map(|axis| front.position_m[axis] - rear.position_m[axis]);
    let squared_m2 = (x * x + y * y).max(f64::MIN_POSITIVE);
    let [xx, xy, _, yy, ..] = added(front.covariance_m2, rear.covariance_m2);
    let across_m2 = (xx * y * y - 2.0 * xy * x * y + yy * x * x) / squared_m2;
    [libm::atan2(y, x), (across_m2 / squared_m2).sqrt().min(PI)]
}

/// Adds the estimates of two landmarks with independent errors. Without both positions, the sum has none.
fn sum(a: &Estimate, b: &Estimate) -> Estimate {
    let both = a.kinematics.zip(b.kinematics);
    Estimate {
        state: worse(a.state, b.state),
        kinematics: both.map(|(a, b)| StateEstimate {
            position_m: added(a.position_m, b.position_m),
            velocity_mps: a.velocity_mps.zip(b.velocity_mps).map(|(a, b)| added(a, b)),
            velocity_covariance_m2ps2: a
                .velocity_covariance_m2ps2
                .zip(b.velocity_covariance_m2ps2)
                .map(|(a, b)| added(a, b)),
            covariance_m2: added(a.covariance_m2, b.covariance_m2),
            best_position_m: added(a.best_position_m, b.best_position_m),
            effective_sample_size: a.effective_sample_size.min(b.effective_sample_size),
        }),
        heading_rad: None,
        heading_sigma_rad: None,
        radius: None,
        confidence: a.confidence * b.confidence,
    }
}

fn added<const N: usize>(a: [f64; N], b: [f64; N]) -> [f64; N] {
    std::array::from_fn(|i| a[i] + b[i])
}

fn worse(a: TrackState, b: TrackState) -> TrackState {
    [
        TrackState::Lost,
        TrackState::Searching,
        TrackState::Occluded,
    ]
    .into_iter()
    .find(|&worse| a == worse || b == worse)
    .unwrap_or(TrackState::Tracking)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(position_m: [f64; 3], state: TrackState) -> Estimate {
        Estimate {
            state,
            kinematics: Some(StateEstimate {
                position_m,
                velocity_mps: Some([1.0, position_m[0], 0.0]),
                velocity_covariance_m2ps2: Some([0.4, -0.2, 0.0, 0.6, 0.0, 0.0]),
                covariance_m2: [4.0, 1.0, 0.0, 2.0, 0.0, 0.0],
                best_position_m: position_m,
                effective_sample_size: 100.0 + position_m[0],
            }),
            heading_rad: None,
            heading_sigma_rad: None,
            radius: None,
            confidence: 0.5,
        }
    }

    #[test]
    fn a_target_is_midway_between_its_landmarks_and_faces_from_rear_to_front() {
        let (rear, front) = (
            at([1.0, 2.0, 0.0], TrackState::Tracking),
            at([1.0, 4.0, 0.0], TrackState::Occluded),
        );
        let both = combined([rear, front].into_iter(), Some([1, 0]));
        assert_eq!(both.state, TrackState::Occluded);
        assert_eq!(both.heading_rad, Some(std::f64::consts::FRAC_PI_2));
        // Across the 2 m between them, each is uncertain by 2 m.
        let sigma_rad = both.heading_sigma_rad.unwrap();
        assert!((sigma_rad - 2.0_f64.sqrt()).abs() < 1e-12, "{sigma_rad}");
        assert_eq!(both.confidence, 0.25);
        let known = both.kinematics.unwrap();
        assert_eq!(known.position_m, [1.0, 3.0, 0.0]);
        assert_eq!(known.velocity_mps, Some([1.0, 1.0, 0.0]));
        assert_eq!(known.covariance_m2, [2.0, 0.5, 0.0, 1.0, 0.0, 0.0]);
        let of_velocity_m2ps2 = [0.2, -0.1, 0.0, 0.3, 0.0, 0.0];
        assert_eq!(known.velocity_covariance_m2ps2, Some(of_velocity_m2ps2));
        assert_eq!(known.effective_sample_size, 101.0);
    }

    #[test]
    fn a_target_without_one_of_its_landmarks_has_no_position() {
        let lost = Estimate {
            state: TrackState::Lost,
            kinematics: None,
            heading_rad: None,
            heading_sigma_rad: None,
            radius: None,
            confidence: 0.0,
        };
        let both = combined(
            [at([0.0; 3], TrackState::Tracking), lost].into_iter(),
            Some([0, 1]),
        );
        assert_eq!(
            (both.state, both.heading_rad, both.confidence),
            (TrackState::Lost, None, 0.0)
        );
        assert!(both.kinematics.is_none());
    }
}
