//! Collects frames of several cameras as they arrive and emits them in order of time. Independent of sources and
//! clocks.

use std::collections::VecDeque;

use pardalis::{CameraId, Error, Frame};
use serde::Serialize;

use crate::detections::Detections;

/// Times that differ by less than this, in seconds, are the same: time stamps were rounded.
const SAME_INSTANT_S: f64 = 1e-6;

/// Frames of different cameras that are no farther apart than this, in seconds, form one set. Shorter than what the library allows, because of rounding.
const SPREAD_S: f64 = pardalis::FrameSet::MAX_SPREAD_S - SAME_INSTANT_S;

/// Number of frames of a live camera that may wait for tracking where all are to be used. Further ones stay in ffmpeg and with the sender.
const MAX_BACKLOG: usize = 8;

/// Number of frames of a live camera that may wait for tracking where estimates are to stay current: after a short delay, none are lost.
const MAX_BEHIND: usize = 2;

/// The most memory of frames that wait for earlier ones, in bytes. A recording in which a single time stamp is far too late
/// would otherwise be held in memory from there to its end.
const MAX_HELD_BYTES: usize = 1 << 30;

/// Number of past intervals from which the next frame of a live camera is predicted. Hand-set: half a second at 30 frames per second.
const INTERVALS: usize = 16;

/// The next frame is expected no sooner than after this share of the shortest of them. Hand-set: time stamps vary by a tenth.
const EARLIEST_SHARE: f64 = 0.9;

/// When a run ends although there may be further frames.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Limit {
    /// After this many sets.
    pub(crate) frame_sets: Option<usize>,
    /// Before the first set this long after the first one, in seconds of the time stamps.
    pub(crate) duration_s: Option<f64>,
}

/// The frames of one time.
pub(crate) struct FrameSet {
    /// With one camera the index of its image, otherwise that of the set, from 0.
    pub(crate) index: usize,
    /// The latest time stamp, in seconds; it increases from set to set.
    pub(crate) time_s: f64,
    /// Of live cameras: when the first of the frames was captured, on the program's clock, in seconds.
    pub(super) captured_s: Option<f64>,
    /// Of live cameras: what to add to time stamps for the time on the program's clock, in seconds, if the fastest image takes no time.
    pub(super) least_delay_s: Option<f64>,
    /// Each frame with its camera's index, in ascending order.
    pub(crate) frames: Vec<(usize, Frame)>,
    /// The number of each among all frames of its camera.
    numbers: Vec<usize>,
    /// The cameras among them whose image is, byte for byte, the previous one.
    frozen: Vec<usize>,
}

impl FrameSet {
    /// Returns all frames, for the tracker, with what was detected in them.
    pub(crate) fn whole(&self, detections: &Detections) -> Result<pardalis::FrameSet, Error> {
        let frames = self.frames.iter().cloned();
        let frames = frames.map(|(camera, frame)| (CameraId::new(camera), frame));
        let cameras = self.frames.iter().map(|(camera, _)| *camera);
        let images = cameras.zip(self.numbers.iter().copied());
        detections.add(pardalis::FrameSet::new(frames)?, images)
    }

    /// Returns the frames, with what was detected in them, without frozen images, which carry no new information; the time is unchanged.
    pub(crate) fn without_frozen(
        &self,
        detections: &Detections,
    ) -> Result<pardalis::FrameSet, Error> {
        let mut set = self.whole(detections)?;
        set.retain(|camera, _| !self.frozen.contains(&camera.index()));
        Ok(set)
    }
}

/// Statistics of the frames of one camera. Once all are emitted, `delivered` is the sum of `used`, `frozen`,
/// `dropped_late`, `overtaken`, `repeated` and `broken`.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub(crate) struct FrameCounts {
    /// Number of frames received.
    pub(crate) delivered: usize,
    /// Frames that updated the tracker.
    pub(crate) used: usize,
    /// Emitted frames that would have been dropped as late without waiting for them.
    pub(crate) sorted_in_late: usize,
    /// Frames dropped because later ones had already been emitted.
    pub(crate) dropped_late: usize,
    /// Frames dropped because tracking was slower than the camera and later ones were waiting.
    pub(crate) overtaken: usize,
    /// Frames whose image repeats the previous one byte for byte, and which therefore did not update the tracker.
    pub(crate) frozen: usize,
    /// Frames dropped because the camera had already delivered a frame with the same time.
    pub(crate) repeated: usize,
    /// Files that are not images or have another size.
    pub(crate) broken: usize,
    /// The earliest time stamp, in seconds.
    pub(crate) first_time_s: Option<f64>,
    /// The latest time stamp, in seconds.
    pub(crate) last_time_s: Option<f64>,
    /// The longest interval between emitted frames, in seconds.
    pub(crate) longest_gap_s: f64,
}

/// A frame that waits for earlier ones.
struct Held {
    camera: usize,
    /// Its index among all frames of its camera.
    number: usize,
    frame: Frame,
    arrival_s: f64,
    frozen: bool,
    late: bool,
}

/// State of one camera.
#[derive(Default)]
struct Seen {
    counts: FrameCounts,
    /// The most recent image.
    last: Option<Frame>,
    /// The time stamp of the frame that was emitted last, in seconds.
    emitted_s: Option<f64>,
    /// The latest intervals between time stamps, in seconds.
    intervals_s: VecDeque<f64>,
    /// Whether nothing can come from it at present.
    is_away: bool,
}

impl Seen {
    /// Returns the time before which no further frame is expected, in seconds.
    fn next_s(&self) -> f64 {
        if self.is_away {
            return f64::INFINITY;
        }
        let last_s = self.counts.last_time_s.unwrap_or(f64::NEG_INFINITY);
        if self.intervals_s.len() < INTERVALS {
            return last_s;
        }
        let shortest_s = self
            .intervals_s
            .iter()
            .copied()
            .fold(f64::INFINITY, f64::min);
        last_s + EARLIEST_SHARE * shortest_s
    }
}

/// The set that was emitted last.
struct LastSet {
    first_s: f64,
    time_s: f64,
    cameras: Vec<usize>,
}

/// The frames that arrived at one time, within [`SAME_INSTANT_S`].
struct Arrivals {
    arrival_s: f64,
    latest_s: f64,
}

/// Sorts frames by time.
pub(crate) struct Merge {
    /// How long frames are held after their arrival, in seconds.
    hold_s: f64,
    /// Whether frames are emitted as soon as no earlier one is expected from any camera. What arrives out of order from one camera is then dropped sooner,
    /// at times that depend on how quickly frames are taken: for live cameras only.
    is_prompt: bool,
    held: Vec<Held>,
    /// The most bytes of frames that are held.
    held_bytes_limit: usize,
    cameras: Vec<Seen>,
    last_set: Option<LastSet>,
    /// Number of emitted sets.
    set_count: usize,
    limit: Limit,
    /// The time of the first set in seconds.
    begin_s: Option<f64>,
    /// Whether nothing more is taken and emitted.
    is_over: bool,
    arriving: Arrivals,
    /// The latest time stamp of earlier arrivals, in seconds: everything up to it would already be emitted if nothing
    /// waited.
    passed_s: f64,
}

impl Merge {
    /// Creates a merge for this number of cameras; `max_delay_s` is how long frames wait for earlier ones.
    pub(crate) fn new(camera_count: usize, max_delay_s: f64, limit: Limit) -> Self {
        Self {
            hold_s: max_delay_s.max(SAME_INSTANT_S),
            is_prompt: false,
            held: Vec::new(),
            held_bytes_limit: MAX_HELD_BYTES,
            cameras: (0..camera_count).map(|_| Seen::default()).collect(),
            last_set: None,
            set_count: 0,
            limit,
            begin_s: None,
            is_over: false,
            arriving: Arrivals {
                arrival_s: f64::NEG_INFINITY,
                latest_s: f64::NEG_INFINITY,
            },
            passed_s: f64::NEG_INFINITY,
        }
    }

    /// Emits frames as soon as no earlier one is expected from any camera.
    pub(crate) fn prompt(self) -> Self {
        Self {
            is_prompt: true,
            ..self
        }
    }

    /// Notes whether nothing can come from a camera at present, so that no frame waits for it.
    pub(crate) fn set_away(&mut self, camera: usize, is_away: bool) {
        self.cameras[camera].is_away = is_away;
    }

    /// Reports whether the limit has been reached, or [`Merge::end`] was called.
    pub(crate) fn is_over(&self) -> bool {
        self.is_over
    }

    /// Leaves out the frames that have not been emitted, and all further ones.
    pub(crate) fn end(&mut self) {
        self.is_over = true;
        for held in self.held.drain(..) {
            let seen = &mut self.cameras[held.camera];
            seen.counts.delivered -= 1;
            seen.counts.last_time_s = seen.emitted_s;
            if seen.emitted_s.is_none() {
                seen.counts.first_time_s = None;
            }
        }
    }

    /// Takes a frame. Frames must be given in order of arrival (seconds) over all cameras.
    pub(crate) fn take(&mut self, camera: usize, frame: Frame, arrival_s: f64) {
        if self.is_over {
            return;
        }
        let time_s = frame.time_s();
        if arrival_s > self.arriving.arrival_s + SAME_INSTANT_S {
            self.passed_s = self.passed_s.max(self.arriving.latest_s);
            self.arriving = Arrivals {
                arrival_s,
                latest_s: f64::NEG_INFINITY,
            };
        }
        self.arriving.latest_s = self.arriving.latest_s.max(time_s);

        let seen = &mut self.cameras[camera];
        let counts = &mut seen.counts;
        let number = counts.delivered;
        counts.delivered += 1;
        let known = |known: Option<f64>| known.unwrap_or(time_s);
        let since_s = time_s - known(counts.last_time_s);
        if since_s > 0.0 {
            seen.intervals_s.truncate(INTERVALS - 1);
            seen.intervals_s.push_front(since_s);
        }
        counts.first_time_s = Some(known(counts.first_time_s).min(time_s));
        counts.last_time_s = Some(known(counts.last_time_s).max(time_s));
        let frozen = seen
            .last
            .as_ref()
            .is_some_and(|last| last.bytes() == frame.bytes());
        seen.last = Some(frame.clone());
        if let Some(last) = self.last_set.as_ref().filter(|set| time_s <= set.time_s) {
            if time_s >= last.first_s && last.cameras.contains(&camera) {
                seen.counts.repeated += 1;
            } else {
                seen.counts.dropped_late += 1;
            }
            return;
        }
        self.held.push(Held {
            camera,
            number,
            frame,
            arrival_s,
            frozen,
            late: time_s <= self.passed_s,
        });
    }

    /// Returns whether tracking is too slow for a camera: at `now_s`, on the clock of arrivals, [`MAX_BACKLOG`] of its frames
    /// are due. Until some are tracked, no more should be read.
    pub(crate) fn has_backlog(&self, camera: usize, now_s: f64) -> bool {
        let waits = |held: &&Held| held.camera == camera && held.arrival_s + self.hold_s < now_s;
        self.held.iter().filter(waits).count() >= MAX_BACKLOG
    }

    /// Returns the time before which no further frame is expected from any camera, in seconds, where frames wait for nothing else.
    fn complete_s(&self) -> f64 {
        let first_s = self
            .cameras
            .iter()
            .map(Seen::next_s)
            .fold(f64::INFINITY, f64::min);
        if self.is_prompt {
            first_s
        } else {
            f64::NEG_INFINITY
        }
    }

    /// Drops the oldest frames of a camera that wait for nothing but tracking at `now_s`, on the clock of arrivals, if more than [`MAX_BEHIND`] do.
    pub(crate) fn overtake(&mut self, camera: usize, now_s: f64) {
        let (hold_s, complete_s) = (self.hold_s, self.complete_s());
        let is_due =
            |held: &Held| held.arrival_s + hold_s < now_s || held.frame.time_s() <= complete_s;
        let waits = |held: &Held| held.camera == camera && is_due(held);
        let count = self.held.iter().filter(|held| waits(held)).count();
        let excess = count.saturating_sub(MAX_BEHIND);
        // Held in order of arrival.
        let oldest = self.held.extract_if(.., |held| waits(held)).take(excess);
        self.cameras[camera].counts.overtaken += oldest.count();
    }

    /// Counts frames that were dropped before they could be given, because later ones were waiting.
    pub(crate) fn count_overtaken(&mut self, camera: usize, frames: usize) {
        let counts = &mut self.cameras[camera].counts;
        counts.delivered += frames;
        counts.overtaken += frames;
    }

    /// Counts an image that could not be used.
    pub(crate) fn count_broken(&mut self, camera: usize) {
        let counts = &mut self.cameras[camera].counts;
        counts.delivered += 1;
        counts.broken += 1;
    }

    /// Reports whether no frame before this time, in seconds, is missing of any camera that has none in the set that ends then.
    fn has_all_until(&self, end_s: f64) -> bool {
        self.cameras.iter().enumerate().all(|(camera, seen)| {
            let is_here = |held: &Held| held.camera == camera && held.frame.time_s() <= end_s;
            seen.next_s() > end_s || self.held.iter().any(is_here)
        })
    }

    /// Returns the time before which frames belong to the set that begins at `first_s`, in seconds: a camera has one frame in a set.
    fn end_of_set_s(&self, first_s: f64) -> f64 {
        let mut end_s = (first_s + SPREAD_S).next_up();
        let near = |held: &Held| held.frame.time_s() <= first_s + SPREAD_S;
        for (number, held) in self.held.iter().enumerate().filter(|(_, one)| near(one)) {
            let time_s = held.frame.time_s();
            let is_before = |other: &Held| {
                let before_s = time_s - other.frame.time_s();
                other.camera == held.camera && before_s > SAME_INSTANT_S
            };
            let mut others = self.held.iter().enumerate();
            if others.any(|(other, one)| other != number && is_before(one)) {
                end_s = end_s.min(time_s);
            }
        }
        end_s
    }

    /// Returns the earliest set if one of its frames or of a later set has waited long enough at `now_s`, on the
    /// clock of arrivals, or if too much waits.
    pub(crate) fn next_set(&mut self, now_s: f64) -> Option<FrameSet> {
        let is_due = |held: &Held| held.arrival_s + self.hold_s < now_s;
        let held_bytes: usize = self.held.iter().map(|held| held.frame.bytes().len()).sum();
        let times_s = self.held.iter().map(|held| held.frame.time_s());
        let first_s = times_s.reduce(f64::min)?;
        let is_complete = first_s <= self.complete_s() && self.has_all_until(first_s + SPREAD_S);
        let is_full = held_bytes > self.held_bytes_limit;
        if !is_full && !is_complete && !self.held.iter().any(is_due) {
            return None;
        }
        let begin_s = *self.begin_s.get_or_insert(first_s);
        let duration_s = self.limit.duration_s;
        if duration_s.is_some_and(|duration_s| first_s - begin_s >= duration_s) {
            self.end();
            return None;
        }
        let end_s = self.end_of_set_s(first_s);
        let mut members: Vec<Held> = self
            .held
            .extract_if(.., |held| held.frame.time_s() < end_s)
            .collect();
        members.sort_by_key(|held| held.camera);
        let mut set = FrameSet {
            index: if self.cameras.len() == 1 {
                members[0].number
            } else {
                self.set_count
            },
            time_s: first_s,
            captured_s: None,
            least_delay_s: None,
            frames: Vec::new(),
            numbers: Vec::new(),
            frozen: Vec::new(),
        };
        for held in members {
            let seen = &mut self.cameras[held.camera];
            let counts = &mut seen.counts;
            let time_s = held.frame.time_s();
            // Sorting kept the order of delivery.
            if set
                .frames
                .last()
                .is_some_and(|(last, _)| *last == held.camera)
            {
                counts.repeated += 1;
                continue;
            }
            if held.frozen {
                counts.frozen += 1;
                set.frozen.push(held.camera);
            } else {
                counts.used += 1;
            }
            counts.sorted_in_late += usize::from(held.late);
            if let Some(last_s) = seen.emitted_s.replace(time_s) {
                counts.longest_gap_s = counts.longest_gap_s.max(time_s - last_s);
            }
            set.time_s = set.time_s.max(time_s);
            set.frames.push((held.camera, held.frame));
            set.numbers.push(held.number);
        }
        self.set_count += 1;
        self.last_set = Some(LastSet {
            first_s,
            time_s: set.time_s,
            cameras: set.frames.iter().map(|(camera, _)| *camera).collect(),
        });
        if self.limit.frame_sets == Some(self.set_count) {
            self.end();
        }
        Some(set)
    }

    /// Returns the statistics of each camera so far.
    pub(crate) fn counts(&self) -> impl Iterator<Item = FrameCounts> {
        self.cameras.iter().map(|seen| seen.counts)
    }
}

#[cfg(test)]
#[path = "merge_tests.rs"]
mod tests;
