//! Evaluation of track states: how quickly they follow occlusions, and how often they are wrong.

use serde::Serialize;

use super::finding::most_frames_until;
use super::{Sample, distance_m};
use pardalis::tracker::TrackState;

/// Quality of a track's states.
///
/// Frames are counted from 1, the first frame of a stretch. A stretch without the expected state counts as
/// its length plus 1. An object is fully occluded if no camera sees any part of it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct States {
    /// Largest number of frames from the beginning of a full occlusion until the state is `occluded` (or
    /// another state without visibility); `None` without an occlusion.
    pub frames_to_occluded: Option<usize>,
    /// Largest number of frames from the end of a full occlusion until the state is `tracking` with a
    /// position within a diameter of the object's; `None` if no frame follows an occlusion.
    pub frames_to_tracking: Option<usize>,
    /// Number of frames (including occluded ones) with state `tracking` and a position more than a diameter
    /// from the object's.
    pub elsewhere_frames: usize,
}

/// Evaluates the states of one track. `samples` holds every frame of the object's ground truth in order of
/// time; `diameter_m` is the object's diameter in metres. Returns `None` if the track has no states.
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
    // Frames before the first occlusion follow none.
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

    /// Returns a frame of an object at the origin, with the state of the track and the error of its position
    /// in metres.
    fn frame(share: f64, state: TrackState, off_m: Option<f64>) -> Sample {
        Sample {
            state: Some(state),
            estimate: off_m.map(|off_m| EstimatedState::at([off_m, 0.0, 0.0])),
            truth: TrueState {
                visible_fraction: Some(share),
                ..TrueState::at([0.0; 3])
            },
        }
    }

    #[test]
    fn slowest_reaction_counts() {
        let (on, off) = (Some(0.1), Some(0.3));
        let seen = frame(1.0, Tracking, on);
        let sight = [frame(0.9, Searching, None), seen, seen];
        // Coasting at a wrong position does not state that the object is visible there.
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
        // Without any reaction, the length of the stretch plus 1.
        let never = [&sight[..], &hidden[..1], &back[..2], &hidden[..1]];
        assert_eq!(counts(of(&never)), (Some(2), Some(3), 1));
    }

    #[test]
    fn missing_rows_state_nothing_and_tracks_without_states_are_skipped() {
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
