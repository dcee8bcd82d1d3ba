//! Which of several tracks follows which of several objects, and whether they swap.

use serde::Serialize;

use super::assignment::best_assignment;
use super::distance_m;

/// How often the tracks of several objects change places.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct Identities {
    /// How often the assignment that fits best changes from one frame to the next.
    pub switches: usize,
    /// Frames in which another assignment than the one for the whole sequence fits best.
    pub swapped_frames: usize,
}

/// The object of each track: the assignment with the least total error over all frames.
///
/// `tracks[i][f]` and `objects[j][f]` are positions in frame `f`, world frame, in metres, none where unknown.
/// An error counts up to `cap_m`, an unknown position counts as `cap_m`, so that one lost stretch does not
/// outweigh the rest. Tracks in excess of the objects get none.
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

/// Counts switches where track `i` belongs to object `i`; positions are as for [`assign`].
///
/// In each frame with an estimate the assignment changes only if another one fits better: frames
/// that cannot tell, because estimates are missing or far from everything, change nothing.
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

/// Whether a track has gone over to another object at the end: over more than half of the last tenth of the frames it is nearer to
/// one of `others` than to `object`; none without others or without an estimate then. Positions are as for [`assign`].
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

/// How much nearer than `cap_m` two positions are: 10⁹ at the same place, 0 at the cap or where one is unknown.
///
/// Whole numbers, because the assignment needs exact sums; the largest total closeness is the least total capped error.
fn closeness(track_m: Option<[f64; 3]>, object_m: Option<[f64; 3]>, cap_m: f64) -> i64 {
    let (Some(track_m), Some(object_m)) = (track_m, object_m) else {
        return 0;
    };
    let ratio = distance_m(track_m, object_m) / cap_m;
    // Also false where a cap that is no length makes the ratio undefined.
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

    /// Five frames along x at the given y.
    fn line(y_m: f64) -> Path {
        (0..5).map(|f| Some([f as f64, y_m, 0.0])).collect()
    }

    /// `a` in the frames where `first` holds, else `b`.
    fn spliced(a: &Path, b: &Path, first: impl Fn(usize) -> bool) -> Path {
        let pick = |f| if first(f) { a[f] } else { b[f] };
        (0..a.len()).map(pick).collect()
    }

    #[test]
    fn tracks_find_their_objects_whatever_their_order() {
        let objects = [line(0.0), line(1.0), line(5.0)];
        let tracks = [line(4.9), line(0.1), line(0.9)];
        assert_eq!(assign(&tracks, &objects, 0.66), [Some(2), Some(0), Some(1)]);
    }

    #[test]
    fn tracks_in_excess_get_no_object() {
        let tracks = [line(7.0), line(0.2), line(1.1)];
        let objects = [line(1.0), line(0.0)];
        assert_eq!(assign(&tracks, &objects, 0.66), [None, Some(1), Some(0)]);
        assert_eq!(assign(&tracks, &[] as &[Path], 0.66), [None; 3]);
        assert!(assign(&[] as &[Path], &objects, 0.66).is_empty());
    }

    #[test]
    fn one_far_excursion_does_not_decide() {
        let mut follows_first = line(0.1);
        follows_first[2] = Some([1000.0, 1.0, 0.0]);
        let assignment = assign(&[follows_first], &[line(0.0), line(1.0)], 0.66);
        assert_eq!(assignment, [Some(0)]);
    }

    #[test]
    fn a_cap_that_means_nothing_is_survived() {
        let objects = [line(0.0), line(1.0)];
        for cap_m in [0.0, f64::NAN, -1.0, f64::INFINITY] {
            assert_eq!(assign(&objects, &objects, cap_m).len(), 2, "{cap_m}");
        }
    }

    #[test]
    fn steady_tracks_never_switch() {
        let objects = [line(0.0), line(1.0)];
        let tracks = [line(0.2), line(0.8)];
        let none = Identities {
            switches: 0,
            swapped_frames: 0,
        };
        assert_eq!(identities(&tracks, &objects, 0.66), none);
        // Estimates that are missing, or far from everything, cannot tell.
        let gaps = [spliced(&tracks[0], &vec![None; 5], |f| f != 2), line(30.0)];
        assert_eq!(identities(&gaps, &objects, 0.66), none);
    }

    #[test]
    fn a_swap_half_way_is_one_switch() {
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
    fn a_swap_forth_and_back_is_two_switches() {
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
    fn a_track_that_ends_on_another_object_is_told_by_its_last_tenth() {
        let far = |y_m: f64| -> Path { (0..40).map(|f| Some([f as f64, y_m, 0.0])).collect() };
        let (own, other) = (far(0.0), far(1.0));
        let others = [other.clone(), far(9.0)];
        // Frames 36 to 39 decide: all but one, then two of four.
        let late = |first: usize| spliced(&own, &other, move |f| f < first);
        assert_eq!(ends_on_another(&late(37), &own, &others), Some(true));
        assert_eq!(ends_on_another(&late(38), &own, &others), Some(false));
        assert_eq!(ends_on_another(&own, &own, &[] as &[Path]), None);
        let lost = spliced(&own, &vec![None; 40], |f| f < 36);
        assert_eq!(ends_on_another(&lost, &own, &others), None);
        assert_eq!(ends_on_another(&[], &own, &others), None);
    }

    #[test]
    fn tracks_that_start_swapped_do_not_switch() {
        let objects = [line(0.0), line(1.0)];
        let expected = Identities {
            switches: 0,
            swapped_frames: 5,
        };
        let tracks = [line(1.0), line(0.0)];
        assert_eq!(identities(&tracks, &objects, 0.66), expected);
    }
}
