//! Evaluation of crowds: any number of tracks of any number of objects that look alike.

use serde::Serialize;

use super::assignment::best_assignment;
use super::distance_m;

/// An object of a crowd in one frame.
#[derive(Debug, Clone, Copy, PartialEq)]
#[allow(clippy::exhaustive_structs)] // a position and whether it is seen
pub struct CrowdObject {
    /// Position in metres.
    pub position_m: [f64; 3],
    /// Whether it is visible. One that is hidden may or may not be tracked.
    pub is_visible: bool,
}

/// How well tracks follow the objects of a crowd.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[non_exhaustive]
pub struct Crowd {
    /// Mean over all frames of the generalised optimal sub-pattern assignment metric, in metres, with the cutoff: √(Σ d² + c²/2·(missed + false)) (Rahmathullah,
    /// García-Fernández and Svensson 2017, with p = 2 and α = 2).
    pub gospa_m: f64,
    /// The cutoff c in metres: beyond this distance, a track does not follow an object.
    pub cutoff_m: f64,
    /// How often an object was followed by another track than before. An object that was hidden for longer than a second may get another.
    pub switches: usize,
    /// Number of visible objects that no track follows, over all frames.
    pub missed: usize,
    /// The most consecutive frames in which a visible object was missed.
    pub longest_missed_frames: usize,
    /// Number of tracks that follow no object, over all frames.
    pub false_tracks: usize,
    /// The most consecutive frames in which a track followed nothing.
    pub longest_false_frames: usize,
    /// For each object, the number of the track that follows it in each frame.
    #[serde(skip)]
    pub followed_by: Vec<Vec<Option<usize>>>,
}

/// Evaluates tracks of a crowd. `tracks[i][f]` is the position in frame `f` in metres, `None` if there is no estimate; `objects[j][f]` is `None` while there is no such
/// object. A track keeps its object while it is within `cutoff_m`; all others are assigned so that the total of squared distances is least. An object that was hidden for more than
/// `forgotten_frames` frames may be followed by another track afterwards.
pub fn crowd<T, O>(tracks: &[T], objects: &[O], cutoff_m: f64, forgotten_frames: usize) -> Crowd
where
    T: AsRef<[Option<[f64; 3]>]>,
    O: AsRef<[Option<CrowdObject>]>,
{
    let frames = tracks.iter().map(|t| t.as_ref().len());
    let frames = frames.chain(objects.iter().map(|o| o.as_ref().len())).min();
    let frames = frames.unwrap_or(0);
    let mut found = Crowd {
        gospa_m: 0.0,
        cutoff_m,
        switches: 0,
        missed: 0,
        longest_missed_frames: 0,
        false_tracks: 0,
        longest_false_frames: 0,
        followed_by: vec![vec![None; frames]; objects.len()],
    };
    let mut last: Vec<Option<usize>> = vec![None; objects.len()];
    let [mut missed, mut hidden] = [(); 2].map(|()| vec![0_usize; objects.len()]);
    let mut strayed = vec![0_usize; tracks.len()];
    for frame in 0..frames {
        let squared = |track: usize, object: usize| {
            let (track, object) = (
                tracks[track].as_ref()[frame]?,
                objects[object].as_ref()[frame]?,
            );
            let squared = distance_m(track, object.position_m).powi(2);
            (squared < cutoff_m * cutoff_m).then_some(squared)
        };
        let is_visible =
            |object: usize| objects[object].as_ref()[frame].is_some_and(|object| object.is_visible);
        let kept = |object: usize| last[object].filter(|&track| squared(track, object).is_some());
        let kept: Vec<_> = (0..objects.len()).map(kept).collect();
        let is_kept = |track: usize| kept.contains(&Some(track));
        let fit = |track: usize, object: usize| {
            let free = kept[object].is_none() && !is_kept(track);
            closeness(
                squared(track, object).filter(|_| free),
                cutoff_m,
                is_visible(object),
            )
        };
        let mut followed = kept.clone();
        for (track, object) in best_assignment(tracks.len(), objects.len(), fit)
            .into_iter()
            .enumerate()
        {
            if let Some(object) = object.filter(|&object| fit(track, object) > 0) {
                followed[object] = Some(track);
            }
        }

        for (object, track) in followed.iter().enumerate() {
            hidden[object] = if is_visible(object) {
                0
            } else {
                hidden[object] + 1
            };
            if hidden[object] > forgotten_frames {
                last[object] = None;
            }
            if let Some(track) = track {
                let was_another = last[object].is_some_and(|before| before != *track);
                found.switches += usize::from(was_another && is_visible(object));
                if is_visible(object) || last[object].is_none() {
                    last[object] = Some(*track);
                }
            }
            let is_missed = track.is_none() && is_visible(object);
            missed[object] = if is_missed { missed[object] + 1 } else { 0 };
            found.missed += usize::from(is_missed);
            found.longest_missed_frames = found.longest_missed_frames.max(missed[object]);
            found.followed_by[object][frame] = *track;
        }
        for (track, path) in tracks.iter().enumerate() {
            let is_false = path.as_ref()[frame].is_some() && !followed.contains(&Some(track));
            strayed[track] = if is_false { strayed[track] + 1 } else { 0 };
            found.false_tracks += usize::from(is_false);
            found.longest_false_frames = found.longest_false_frames.max(strayed[track]);
        }

        // The metric knows no identities. Tracks of hidden objects are left out.
        let of_hidden = |track: usize| {
            let follows = |object: &usize| followed[*object] == Some(track) && !is_visible(*object);
            (0..objects.len()).any(|object| follows(&object))
        };
        let shown: Vec<usize> = (0..objects.len()).filter(|&o| is_visible(o)).collect();
        let is_there = |track: &usize| tracks[*track].as_ref()[frame].is_some();
        let there = (0..tracks.len()).filter(is_there);
        let there: Vec<usize> = there.filter(|&track| !of_hidden(track)).collect();
        let fit = |i: usize, j: usize| closeness(squared(there[i], shown[j]), cutoff_m, true);
        let assigned = best_assignment(there.len(), shown.len(), fit);
        let assigned = assigned.into_iter().enumerate();
        let squares: Vec<f64> = assigned
            .filter_map(|(i, j)| squared(there[i], shown[j?]))
            .collect();
        let unassigned = there.len() + shown.len() - 2 * squares.len();
        let cost = squares.iter().sum::<f64>() + 0.5 * cutoff_m * cutoff_m * unassigned as f64;
        found.gospa_m += cost.sqrt() / frames as f64;
    }
    found
}

/// Returns how good it is that a track follows an object at this squared distance in m²: 0 beyond the cutoff. Objects that are visible come first.
fn closeness(squared_m2: Option<f64>, cutoff_m: f64, is_visible: bool) -> i64 {
    let share = squared_m2.map_or(0.0, |squared| 1.0 - squared / (cutoff_m * cutoff_m));
    let most = if is_visible { 2e9 } else { 1e9 };
    if share > 0.0 {
        (most * share).round().max(1.0) as i64
    } else {
        0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An object that rolls along x at this y, visible in the frames that satisfy `is_visible`.
    fn object(y_m: f64, is_visible: impl Fn(usize) -> bool) -> Vec<Option<CrowdObject>> {
        let at = |f: usize| CrowdObject {
            position_m: [f as f64, y_m, 0.0],
            is_visible: is_visible(f),
        };
        (0..10).map(|f| Some(at(f))).collect()
    }

    /// A track along x at this y in these frames.
    fn track(y_m: f64, frames: std::ops::Range<usize>) -> Vec<Option<[f64; 3]>> {
        let at = |f: usize| [f as f64, y_m, 0.0];
        (0..10)
            .map(|f| frames.contains(&f).then(|| at(f)))
            .collect()
    }

    #[test]
    fn perfect_tracks_cost_their_distances() {
        let objects = [object(0.0, |_| true), object(5.0, |_| true)];
        let found = crowd(&[track(5.03, 0..10), track(0.04, 0..10)], &objects, 0.5, 3);
        assert!((found.gospa_m - 0.05).abs() < 1e-12, "{found:?}");
        assert_eq!(
            (found.switches, found.missed, found.false_tracks),
            (0, 0, 0)
        );
        assert_eq!(found.followed_by[0][7], Some(1));
    }

    #[test]
    fn missed_objects_and_false_tracks_are_counted_and_cost_half_the_squared_cutoff_each() {
        let objects = [object(0.0, |_| true), object(5.0, |_| true)];
        let found = crowd(&[track(0.0, 0..10), track(9.0, 2..6)], &objects, 0.5, 3);
        assert_eq!((found.missed, found.longest_missed_frames), (10, 10));
        assert_eq!((found.false_tracks, found.longest_false_frames), (4, 4));
        let expected = (6.0 * (0.125_f64).sqrt() + 4.0 * 0.5) / 10.0;
        assert!((found.gospa_m - expected).abs() < 1e-12, "{found:?}");
    }

    #[test]
    fn another_track_of_the_same_object_is_a_switch_unless_the_object_was_hidden_for_long() {
        let tracks = [track(0.0, 0..3), track(0.1, 7..10)];
        let switches = |hidden: std::ops::Range<usize>, forgotten| {
            let objects = [object(0.0, |f| !hidden.contains(&f))];
            crowd(&tracks, &objects, 0.5, forgotten).switches
        };
        assert_eq!(switches(3..7, 9), 1);
        assert_eq!(switches(3..7, 3), 0);
        assert_eq!(switches(0..0, 3), 1);
    }

    #[test]
    fn a_track_keeps_its_object_while_another_passes() {
        let objects = [object(0.0, |_| true), object(0.2, |_| true)];
        // Each is nearer to the other's object.
        let found = crowd(&[track(0.12, 0..10), track(0.08, 0..10)], &objects, 0.5, 3);
        assert_eq!((found.switches, found.missed), (0, 0));
        let found = crowd(&[track(0.1, 0..10)], &[] as &[Vec<_>], 0.5, 3);
        assert_eq!((found.false_tracks, found.longest_false_frames), (10, 10));
        let found = crowd(&[] as &[Vec<_>], &objects, 0.5, 3);
        assert_eq!(found.missed, 20);
        assert!((found.gospa_m - 0.5).abs() < 1e-12);
    }

    #[test]
    fn a_hidden_object_is_neither_missed_nor_falsely_tracked() {
        let objects = [object(0.0, |f| f < 5)];
        for frames in [0..5, 0..10] {
            let found = crowd(&[track(0.0, frames)], &objects, 0.5, 3);
            assert_eq!((found.missed, found.false_tracks), (0, 0));
            assert_eq!(found.gospa_m, 0.0);
        }
    }
}
