//! The choice of one object among those that all cameras see: a chain of points where rays meet.

use super::path::Observation;
use super::search::Meeting;

/// What it costs to go on at a place that is a diameter of the target away, in points where rays meet well. Jumps
/// between objects are longer than those of a fast target.
const STEP_COST: f64 = 0.1;

/// The same per unit of the logarithm of sizes. Objects do not change theirs.
const SIZE_COST: f64 = 2.0;

/// What it costs to begin anew. Beyond that distance, and after long gaps, nothing tells whether it is the same
/// object.
const BREAK_COST: f64 = 3.0;

/// Number of detections before each that may precede it.
const LOOK_BACK: usize = 64;

/// The best chain that ends at a detection.
#[derive(Clone, Copy)]
struct End {
    value: f64,
    before: Option<usize>,
}

/// Returns the detections that follow one object, camera by camera in order of frames: at most one of each frame,
/// where rays meet well, without unnecessary jumps. The meetings are in order of time.
pub(super) fn chain(meetings: &[Meeting]) -> Vec<Observation> {
    let mut ends: Vec<End> = Vec::with_capacity(meetings.len());
    // The best chain so far that ends anywhere.
    let mut best: Option<usize> = None;
    let frame = |meeting: &Meeting| (meeting.observation.camera, meeting.observation.frame);
    for (at, meeting) in meetings.iter().enumerate() {
        let anew = best.map_or(0.0, |best| ends[best].value - BREAK_COST);
        let mut end = End {
            value: anew.max(0.0),
            before: best.filter(|_| anew > 0.0),
        };
        let first = at.saturating_sub(LOOK_BACK);
        for (before, from) in meetings.iter().enumerate().take(at).skip(first) {
            let step = (meeting.point_m - from.point_m).norm() / meeting.diameter_m;
            let growth = libm::log(meeting.diameter_m / from.diameter_m).abs();
            let value = ends[before].value - STEP_COST * step - SIZE_COST * growth;
            if frame(from) != frame(meeting) && value > end.value {
                let before = Some(before);
                end = End { value, before };
            }
        }
        end.value += meeting.quality;
        ends.push(end);
        if best.is_none_or(|best| ends[best].value < end.value) {
            best = Some(at);
        }
    }
    let back = std::iter::successors(best, |&at| ends[at].before);
    let mut chosen: Vec<Observation> = back.map(|at| meetings[at].observation).collect();
    chosen.sort_by_key(|observation| (observation.camera, observation.frame));
    chosen
}
