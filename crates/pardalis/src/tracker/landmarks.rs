//! One target from several landmarks, each tracked on its own (Campos 2009, section 4).

use super::{Estimate, TrackState};
use crate::filter::StateEstimate;

/// What the estimates of its landmarks, one at least, say of a target: their middle, and the heading from the rear landmark to the front one, `[front, rear]`.
/// It is tracked as well as the landmark that is tracked worst. Of a single body, its own estimate.
pub(super) fn combined(landmarks: &[Estimate], heading: Option<[usize; 2]>) -> Estimate {
    if let [body] = landmarks {
        return *body;
    }
    let state = [
        TrackState::Lost,
        TrackState::Searching,
        TrackState::Occluded,
    ]
    .into_iter()
    .find(|&worse| landmarks.iter().any(|landmark| landmark.state == worse))
    .unwrap_or(TrackState::Tracking);
    let known: Option<Vec<&StateEstimate>> = landmarks
        .iter()
        .map(|landmark| landmark.kinematics.as_ref())
        .collect();
    let Some(known) = known else {
        return Estimate {
            state,
            kinematics: None,
            heading_rad: None,
            confidence: 0.0,
        };
    };
    let heading_rad = heading.map(|[front, rear]| {
        let [front, rear] = [front, rear].map(|i| known[i].position_m);
        libm::atan2(front[1] - rear[1], front[0] - rear[0])
    });
    Estimate {
        state,
        kinematics: Some(middle(&known)),
        heading_rad,
        confidence: landmarks
            .iter()
            .map(|landmark| landmark.confidence)
            .product(),
    }
}

/// The middle of landmarks whose errors have nothing to do with one another.
fn middle(landmarks: &[&StateEstimate]) -> StateEstimate {
    let share = 1.0 / landmarks.len() as f64;
    let mean = |of: &dyn Fn(&StateEstimate) -> [f64; 3]| {
        [0, 1, 2].map(|axis| {
            share
                * landmarks
                    .iter()
                    .map(|landmark| of(landmark)[axis])
                    .sum::<f64>()
        })
    };
    let has_velocity = landmarks
        .iter()
        .all(|landmark| landmark.velocity_mps.is_some());
    let covariance_m2 = std::array::from_fn(|entry| {
        let sum: f64 = landmarks
            .iter()
            .map(|landmark| landmark.covariance_m2[entry])
            .sum();
        share * share * sum
    });
    let sizes = landmarks
        .iter()
        .map(|landmark| landmark.effective_sample_size);
    StateEstimate {
        position_m: mean(&|landmark| landmark.position_m),
        velocity_mps: has_velocity
            .then(|| mean(&|landmark| landmark.velocity_mps.unwrap_or_default())),
        covariance_m2,
        best_position_m: mean(&|landmark| landmark.best_position_m),
        effective_sample_size: sizes.fold(f64::INFINITY, f64::min),
    }
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
                covariance_m2: [4.0, 1.0, 0.0, 2.0, 0.0, 0.0],
                best_position_m: position_m,
                effective_sample_size: 100.0 + position_m[0],
            }),
            heading_rad: None,
            confidence: 0.5,
        }
    }

    #[test]
    fn two_landmarks_are_one_target_between_them_that_faces_from_rear_to_front() {
        let (rear, front) = (
            at([1.0, 2.0, 0.0], TrackState::Tracking),
            at([1.0, 4.0, 0.0], TrackState::Occluded),
        );
        let both = combined(&[rear, front], Some([1, 0]));
        assert_eq!(both.state, TrackState::Occluded);
        assert_eq!(both.heading_rad, Some(std::f64::consts::FRAC_PI_2));
        assert_eq!(both.confidence, 0.25);
        let known = both.kinematics.unwrap();
        assert_eq!(known.position_m, [1.0, 3.0, 0.0]);
        assert_eq!(known.velocity_mps, Some([1.0, 1.0, 0.0]));
        assert_eq!(known.covariance_m2, [2.0, 0.5, 0.0, 1.0, 0.0, 0.0]);
        assert_eq!(known.effective_sample_size, 101.0);
    }

    #[test]
    fn without_one_of_its_landmarks_a_target_has_no_position() {
        let lost = Estimate {
            state: TrackState::Lost,
            kinematics: None,
            heading_rad: None,
            confidence: 0.0,
        };
        let both = combined(&[at([0.0; 3], TrackState::Tracking), lost], Some([0, 1]));
        assert_eq!(
            (both.state, both.heading_rad, both.confidence),
            (TrackState::Lost, None, 0.0)
        );
        assert!(both.kinematics.is_none());
    }
}
