//! Assignment of tracks to objects, and identity switches.

use serde::Serialize;

use super::assignment::best_assignment;
use super::distance_m;

/// Identity switches between the tracks of several objects.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct Identities {
    /// Number of changes of the best assignment from one frame to the next.
    pub switches: usize,
    /// Number of frames whose best assignment differs from the one for the whole sequence.
    pub swapped_frames: usize,
}

/// Assigns each track the object that minimises the total error of all tracks over all frames.
///
/// `tracks[i][f]` and `objects[j][f]` are positions in frame `f`, in metres in the world frame; `None` if
/// unknown. Errors are capped at `cap_m`, and an unknown position counts as `cap_m`, so that a lost stretch
/// does not outweigh the rest. Tracks in excess of the objects get `None`.
pub fn assign<T, O>(tracks: &[T], objects: &[O], cap_m: f64) -> Vec<Option<usize>>
where
    T: AsRef<[Option<[f64; 3]>]>,
    O: AsRef<[Option<[f64; 3]>]>,
{
    best_assignment(tracks.len(), objects.len(), |i, j| {
        let frames = tracks[i].as_ref().iter().zip(objects[j].as_ref());
        frames.map(|(&t, &o)| closeness(t, o, cap_m)).sum()
    })
}

/// Counts identity switches, if track `i` belongs to object `i`. Positions are as for [`assign`].
///
/// In each frame with an estimate, the assignment changes only if another one fits better. Frames with
/// estimates that are missing or far from all objects leave it unchanged.
pub fn identities<T, O>(tracks: &[T], objects: &[O], cap_m: f64) -> Identities
where
    T: AsRef<[Option<[f64; 3]>]>,
    O: AsRef<[Option<[f64; 3]>]>,
{
    let count = tracks.len().min(objects.len());
    let (tracks, objects) = (&tracks[..count], &objects[..count]);
    let frames = tracks.iter().map(|t| t.as_ref().len());
    let frames = frames.chain(objects.iter().map(|o| o.as_ref().len()));
    let whole: Vec<Option<usize>> = (0..count).map(Some).collect();
    let mut current: Option<Vec<Option<usize>>> = None;
    let mut found = Identities {
        switches: 0,
        swapped_frames: 0,
    };
    for f in 0..frames.min().unwrap_or(0) {
        if tracks.iter().all(|t| t.as_ref()[f].is_none()) {
            continue;
        }
        let fit =
            |i: usize, j: usize| closeness(tracks[i].as_ref()[f], objects[j].as_ref()[f], cap_m);
        let total = |assignment: &[Option<usize>]| -> i64 {
            let pairs = assignment.iter().enumerate();
            pairs.filter_map(|(i, j)| j.map(|j| fit(i, j))).sum()
        };
        let before = current.as_ref().unwrap_or(&whole);
        let best = best_assignment(count, count, fit);
        let now = if total(&best) > total(before) {
            best
        } else {
            before.clone()
        };
        found.switches += usize::from(current.is_some_and(|c| c != now));
        found.swapped_frames += usize::from(now != whole);
        current = Some(now);
    }
    found
}

/// Reports whether a track ends on another object: in more than half of the last tenth of the frames it is
/// nearer to one of `others` than to `object`. `None` if there are no others or no estimates in these frames.
/// Positions are as for [`assign`].
pub fn ends_on_another<O>(
    track: &[Option<[f64; 3]>],
    object: &[Option<[f64; 3]>],
    others: &[O],
) -> Option<bool>
where
    O: AsRef<[Option<[f64; 3]>]>,
{
    let count = track.len().min(object.len());
    let (mut frames, mut nearer_to_another) = (0, 0);
    for f in count - count.div_ceil(10)..count {
        let (Some(track_m), Some(object_m)) = (track[f], object[f]) else {
            continue;
        };
        let own_m = distance_m(track_m, object_m);
        let mut others_m = others.iter().filter_map(|o| *o.as_ref().get(f)?);
        frames += 1;
        nearer_to_another += usize::from(others_m.any(|o| distance_m(track_m, o) < own_m));
    }
    (frames > 0 && !others.is_empty()).then_some(2 * nearer_to_another > frames)
}

/// Returns how much nearer than `cap_m` two positions are: 10⁹ at distance zero, 0 at the cap or if a
/// position is unknown.
///
/// The values are integers because the assignment needs exact sums. The largest total closeness corresponds
/// to the smallest total capped error.
fn closeness(track_m: Option<[f64; 3]>, object_m: Option<[f64; 3]>, cap_m: f64) -> i64 {
    let (Some(track_m), Some(object_m)) = (track_m, object_m) else {
        return 0;
    };
    let ratio = distance_m(track_m, object_m) / cap_m;
    // Also false if an invalid cap makes the ratio undefined.
    if (0.0..1.0).contains(&ratio) {
        (1e9 * (1.0 - ratio)).round() as i64
    } else {
        0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    type Path = Vec<Option<[f64; 3]>>;

    /// Returns five frames along x at the given y.
    fn line(y_m: f64) -> Path {
        (0..5).map(|f| Some([f as f64, y_m, 0.0])).collect()
    }

    /// Returns `a` in the frames that satisfy `first`, else `b`.
    fn spliced(a: &Path, b: &Path, first: impl Fn(usize) -> bool) -> Path {
        let pick = |f| if first(f) { a[f] } else { b[f] };
        (0..a.len()).map(pick).collect()
    }

    #[test]
    fn assigns_tracks_in_any_order() {
        let objects = [line(0.0), line(1.0), line(5.0)];
        let tracks = [line(4.9), line(0.1), line(0.9)];
        assert_eq!(assign(&tracks, &objects, 0.66), [Some(2), Some(0), Some(1)]);
    }

    #[test]
    fn leaves_excess_tracks_unassigned() {
        let tracks = [line(7.0), line(0.2), line(1.1)];
        let objects = [line(1.0), line(0.0)];
        assert_eq!(assign(&tracks, &objects, 0.66), [None, Some(1), Some(0)]);
        assert_eq!(assign(&tracks, &[] as &[Path], 0.66), [None; 3]);
        assert!(assign(&[] as &[Path], &objects, 0.66).is_empty());
    }

    #[test]
    fn single_excursion_does_not_change_the_assignment() {
        let mut follows_first = line(0.1);
        follows_first[2] = Some([1000.0, 1.0, 0.0]);
        let assignment = assign(&[follows_first], &[line(0.0), line(1.0)], 0.66);
        assert_eq!(assignment, [Some(0)]);
    }

    #[test]
    fn accepts_invalid_caps() {
        let objects = [line(0.0), line(1.0)];
        for cap_m in [0.0, f64::NAN, -1.0, f64::INFINITY] {
            assert_eq!(assign(&objects, &objects, cap_m).len(), 2, "{cap_m}");
        }
    }

    #[test]
    fn steady_tracks_have_no_switches() {
        let objects = [line(0.0), line(1.0)];
        let tracks = [line(0.2), line(0.8)];
        let none = Identities {
            switches: 0,
            swapped_frames: 0,
        };
        assert_eq!(identities(&tracks, &objects, 0.66), none);
        // Missing estimates and estimates far from all objects carry no information.
        let gaps = [spliced(&tracks[0], &vec![None; 5], |f| f != 2), line(30.0)];
        assert_eq!(identities(&gaps, &objects, 0.66), none);
    }

    #[test]
    fn swap_half_way_is_one_switch() {
        let objects = [line(0.0), line(1.0)];
        let late = |f| f < 3;
        let tracks = [
            spliced(&objects[0], &objects[1], late),
            spliced(&objects[1], &objects[0], late),
        ];
        let expected = Identities {
            switches: 1,
            swapped_frames: 2,
        };
        assert_eq!(identities(&tracks, &objects, 0.66), expected);
    }

    #[test]
    fn swap_and_return_are_two_switches() {
        let objects = [line(0.0), line(1.0)];
        let outside = |f| f != 2;
        let tracks = [
            spliced(&objects[0], &objects[1], outside),
            spliced(&objects[1], &objects[0], outside),
        ];
        let expected = Identities {
            switches: 2,
            swapped_frames: 1,
        };
        assert_eq!(identities(&tracks, &objects, 0.66), expected);
    }

    #[test]
    fn last_tenth_decides_whether_a_track_ends_on_another_object() {
        let far = |y_m: f64| -> Path { (0..40).map(|f| Some([f as f64, y_m, 0.0])).collect() };
        let (own, other) = (far(0.0), far(1.0));
        let others = [other.clone(), far(9.0)];
        // Frames 36 to 39 decide: first three of four, then two of four.
        let late = |first: usize| spliced(&own, &other, move |f| f < first);
        assert_eq!(ends_on_another(&late(37), &own, &others), Some(true));
        assert_eq!(ends_on_another(&late(38), &own, &others), Some(false));
        assert_eq!(ends_on_another(&own, &own, &[] as &[Path]), None);
        let lost = spliced(&own, &vec![None; 40], |f| f < 36);
        assert_eq!(ends_on_another(&lost, &own, &others), None);
        assert_eq!(ends_on_another(&[], &own, &others), None);
    }

    #[test]
    fn tracks_that_start_swapped_have_no_switches() {
        let objects = [line(0.0), line(1.0)];
        let expected = Identities {
            switches: 0,
            swapped_frames: 5,
        };
        let tracks = [line(1.0), line(0.0)];
        assert_eq!(identities(&tracks, &objects, 0.66), expected);
    }
}
