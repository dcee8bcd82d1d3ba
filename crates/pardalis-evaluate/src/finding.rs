//! Number of frames until an object that becomes visible is found.

use super::{Sample, Settings};

/// Returns the largest number of frames that any stretch of visible frames takes until an estimate is on
/// target. It is 1 if the first frame of each stretch is on target. A stretch without such a frame counts as
/// its length plus 1. `None` if the object is never visible.
pub(super) fn frames_to_find(samples: &[Sample], settings: &Settings) -> Option<usize> {
    let visible = samples
        .chunk_by(|a, b| settings.sees(&a.truth) == settings.sees(&b.truth))
        .filter(|stretch| settings.sees(&stretch[0].truth));
    most_frames_until(visible, |s| settings.is_on_target(s))
}

/// Returns the largest number of frames that any stretch takes until a frame satisfies the condition. A
/// stretch without such a frame counts as its length plus 1. `None` if there are no stretches.
pub(super) fn most_frames_until<'s>(
    stretches: impl Iterator<Item = &'s [Sample]>,
    is_wanted: impl Fn(&Sample) -> bool,
) -> Option<usize> {
    let frames = |stretch: &[Sample]| {
        let wanted = stretch.iter().position(&is_wanted);
        wanted.unwrap_or(stretch.len()) + 1
    };
    stretches.map(frames).max()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{EstimatedState, TrueState};

    /// Returns a frame of an object at the origin, with an estimate at the distance `off_m` in metres.
    fn frame(is_visible: bool, off_m: Option<f64>) -> Sample {
        Sample {
            state: None,
            estimate: off_m.map(|off_m| EstimatedState::at([off_m, 0.0, 0.0])),
            truth: TrueState {
                visible_fraction: Some(f64::from(u8::from(is_visible))),
                ..TrueState::at([0.0; 3])
            },
        }
    }

    #[test]
    fn slowest_stretch_counts() {
        let settings = Settings {
            lost_beyond_m: 0.5,
            ..Settings::default()
        };
        let found = |samples: &[Sample]| frames_to_find(samples, &settings);
        let (on, off, none) = (Some(0.1), Some(0.6), None);
        let at_once = [frame(true, on), frame(true, none), frame(true, off)];
        assert_eq!(found(&at_once), Some(1));
        // Estimates while the object is occluded do not count.
        let hidden = [frame(false, on), frame(false, none)];
        assert_eq!(found(&hidden), None);
        let again = [frame(true, none), frame(true, off), frame(true, on)];
        assert_eq!(found(&[&at_once[..], &hidden, &again].concat()), Some(3));
        assert_eq!(found(&[&again[..], &hidden, &at_once].concat()), Some(3));
        assert_eq!(found(&again[..2]), Some(3));
        assert_eq!(found(&[]), None);
    }
}
