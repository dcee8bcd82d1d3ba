//! Whether a track's states are so: not tracking soon after its object is hidden, tracking soon after it is back, and never something else.

use serde::Serialize;

use super::finding::most_frames_until;
use super::{Sample, distance_m};
use pardalis::tracker::TrackState;

/// What the states of a track are worth.
///
/// Frames to a state count from 1, the first frame of a stretch; a stretch without it counts as a frame more than it has. An object is fully hidden where no camera sees
/// any of it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct States {
    /// The most frames from the beginning of a full occlusion until the state is `occluded` (or another that claims no view); none without one.
    pub frames_to_occluded: Option<usize>,
    /// The most frames from the end of a full occlusion until the state is `tracking` with a position within a diameter of the object's;
    /// none where no frame follows one.
    pub frames_to_tracking: Option<usize>,
    /// Frames, hidden ones too, whose state is `tracking` with a position farther than a diameter from the object's.
    pub elsewhere_frames: usize,
}

/// Judges the states of one track; `samples` holds every frame of its object's truth in time order, `diameter_m` is the object's in metres.
/// None where the track says no states.
pub fn states(samples: &[Sample], diameter_m: f64) -> Option<States> {
    samples.iter().find_map(|sample| sample.state)?;
    let is_hidden = |sample: &Sample| sample.truth.visible_fraction == Some(0.0);
    let is_tracking = |sample: &Sample| sample.state == Some(TrackState::Tracking);
    let is_near = |sample: &Sample| {
        let truth_m = sample.truth.position_m;
        (sample.estimate).is_some_and(|e| distance_m(e.position_m, truth_m) <= diameter_m)
    };
    let stretches = || samples.chunk_by(|a, b| is_hidden(a) == is_hidden(b));
    let hidden = stretches().filter(|stretch| is_hidden(&stretch[0]));
    // Only what is before the first occlusion follows none.
    let back = stretches()
        .skip(1)
        .filter(|stretch| !is_hidden(&stretch[0]));
    let elsewhere = samples.iter().filter(|s| is_tracking(s) && !is_near(s));
    Some(States {
        frames_to_occluded: most_frames_until(hidden, |s| !is_tracking(s)),
        frames_to_tracking: most_frames_until(back, |s| is_tracking(s) && is_near(s)),
        elsewhere_frames: elsewhere.count(),
    })
}

#[cfg(test)]
mod tests {
    use super::TrackState::{Lost, Occluded, Searching, Tracking};
    use super::*;
    use crate::{EstimatedState, TrueState};

    /// One frame of the object at the origin, with what the track says: its state and how far off it is, in metres.
    fn frame(share: f64, state: TrackState, off_m: Option<f64>) -> Sample {
        Sample {
            state: Some(state),
            estimate: off_m.map(|off_m| EstimatedState {
                position_m: [off_m, 0.0, 0.0],
                best_position_m: None,
                velocity_mps: None,
                heading_rad: None,
                covariance_m2: None,
            }),
            truth: TrueState {
                position_m: [0.0; 3],
                velocity_mps: None,
                heading_rad: None,
                visible_fraction: Some(share),
                seeing_cameras: None,
            },
        }
    }

    #[test]
    fn the_slowest_change_counts() {
        let (on, off) = (Some(0.1), Some(0.3));
        let seen = frame(1.0, Tracking, on);
        let sight = [frame(0.9, Searching, None), seen, seen];
        // Coasting elsewhere is no claim to see it there.
        let soon = [frame(0.0, Occluded, off), frame(0.0, Occluded, off)];
        let late = [seen, seen, frame(0.02, Occluded, on)];
        let hidden = [frame(0.0, Tracking, on), frame(0.0, Lost, None)];
        let back = [frame(0.01, Occluded, on), frame(0.2, Tracking, off), seen];
        let of = |parts: &[&[Sample]]| states(&parts.concat(), 0.22).unwrap();
        let counts = |s: States| {
            let (to_occluded, to_tracking) = (s.frames_to_occluded, s.frames_to_tracking);
            (to_occluded, to_tracking, s.elsewhere_frames)
        };
        assert_eq!(counts(of(&[&sight])), (None, None, 0));
        assert_eq!(counts(of(&[&sight, &soon])), (Some(1), None, 0));
        assert_eq!(counts(of(&[&soon, &late])), (Some(1), Some(1), 0));
        let all = [&sight[..], &soon, &late, &hidden, &back, &soon];
        assert_eq!(counts(of(&all)), (Some(2), Some(3), 1));
        // Where it never changes, a frame more than there are.
        let never = [&sight[..], &hidden[..1], &back[..2], &hidden[..1]];
        assert_eq!(counts(of(&never)), (Some(2), Some(3), 1));
    }

    #[test]
    fn frames_without_a_row_claim_nothing_and_tracks_without_states_are_not_judged() {
        let seen = frame(1.0, Tracking, Some(0.0));
        let silent = |share| Sample {
            state: None,
            ..frame(share, Lost, None)
        };
        let found = states(&[seen, silent(0.0), silent(0.5), seen], 0.22).unwrap();
        assert_eq!(found.frames_to_occluded, Some(1));
        assert_eq!(found.frames_to_tracking, Some(2));
        assert_eq!(states(&[silent(0.0), silent(1.0)], 0.22), None);
    }
}
