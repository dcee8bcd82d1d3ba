//! The frames of a scene's cameras as sets in order of time. A camera that fails does not stop the others.

use std::task::Poll;
use std::time::Duration;

use pardalis::Frame;
use serde::Serialize;

use super::merge::{FrameCounts, FrameSet, Limit, Merge};
use crate::capture_clock::CaptureClock;
use crate::interrupt::Stop;
use crate::numbers::fixed;
use crate::source::{Delivery, Source};
use crate::timing::now_s;

/// Polling interval of live cameras.
const POLL: Duration = Duration::from_millis(1);

/// Number of frames that are taken from a live camera before others get their turn: where all are used, and where the oldest are dropped.
const TAKEN_AT_ONCE: [usize; 2] = [4, 64];

/// Number of broken images per camera that are reported by name; all are counted.
const NAMED_BROKEN: usize = 3;

/// A camera that ends this long before another has ended early, in seconds.
const EARLY_S: f64 = 1.0;

/// Statistics of one camera.
#[derive(Debug, Clone, Serialize)]
pub(crate) struct CameraRecord {
    /// Its frames.
    pub(crate) frames: FrameCounts,
    /// Set if the camera failed or ended before the others.
    pub(crate) stopped: Option<Stopped>,
}

/// Why a camera delivered no more frames.
#[derive(Debug, Clone, Serialize)]
pub(crate) struct Stopped {
    /// Its last time stamp, in seconds; `None` if it delivered no frame.
    pub(crate) time_s: Option<f64>,
    /// The reason as text.
    pub(crate) reason: String,
}

/// A frame with its camera's index and its arrival in seconds.
type Arrived = (usize, Frame, f64);

/// The sets of frames of all cameras, which may have different rates.
pub(crate) struct FrameSets<'a> {
    sources: &'a mut [Source],
    names: Vec<String>,
    is_live: bool,
    /// The next frame of each recorded source, if it has been fetched.
    next: Vec<Option<Arrived>>,
    /// Why each source failed.
    failures: Vec<Option<String>>,
    merge: Merge,
    /// The clocks of live cameras.
    clocks: Vec<CaptureClock>,
    /// Warnings that have not been printed yet.
    warnings: Vec<String>,
    stop: Stop,
}

impl<'a> FrameSets<'a> {
    /// Takes frames from these sources, which are all recorded or all live, up to this limit or until it is stopped. The cameras' names are for
    /// messages.
    pub(crate) fn new(
        sources: &'a mut [Source],
        names: Vec<String>,
        max_delay_s: f64,
        limit: Limit,
        stop: Stop,
    ) -> Self {
        let is_live = sources.iter().any(Source::is_live);
        let merge = Merge::new(sources.len(), max_delay_s, limit);
        Self {
            stop,
            is_live,
            next: sources.iter().map(|_| None).collect(),
            failures: vec![None; sources.len()],
            // One camera has no others to wait for, but perhaps frames in another order.
            merge: if is_live && sources.len() > 1 {
                merge.prompt()
            } else {
                merge
            },
            clocks: vec![CaptureClock::default(); sources.len()],
            warnings: Vec::new(),
            sources,
            names,
        }
    }

    /// Returns the warnings since the last call.
    pub(crate) fn warnings(&mut self) -> Vec<String> {
        std::mem::take(&mut self.warnings)
    }

    /// Reports whether the limit has been reached.
    pub(crate) fn is_over(&self) -> bool {
        self.merge.is_over()
    }

    /// Returns the statistics of each camera, after the last set.
    pub(crate) fn records(&mut self) -> Vec<CameraRecord> {
        self.merge.end();
        let counts: Vec<FrameCounts> = self.merge.counts().collect();
        let ends_s = counts.iter().filter_map(|counts| counts.last_time_s);
        let end_s = ends_s.reduce(f64::max);
        let failures = std::mem::take(&mut self.failures);
        let records = counts.into_iter().zip(failures).zip(&self.names);
        records
            .map(|((frames, failure), name)| {
                let time_s = frames.last_time_s;
                let reason = failure.or_else(|| {
                    let early =
                        end_s.is_some_and(|end_s| time_s.is_none_or(|s| s < end_s - EARLY_S));
                    let reason = early.then_some(match time_s {
                        Some(_) => "its frames end before those of others",
                        None => "it gave no frame",
                    });
                    self.warnings.extend(reason.map(|reason| {
                        let at =
                            time_s.map_or_else(String::new, |s| format!(" at {} s", fixed(s, 3)));
                        format!("cameras.{name}: stopped{at}: {reason}")
                    }));
                    reason.map(str::to_owned)
                });
                CameraRecord {
                    frames,
                    stopped: reason.map(|reason| Stopped { time_s, reason }),
                }
            })
            .collect()
    }

    /// Handles a delivery of a source; returns it if it is a frame.
    fn sort(&mut self, camera: usize, delivery: anyhow::Result<Delivery>) -> Option<Arrived> {
        let name = &self.names[camera];
        match delivery {
            Ok(Delivery::Frame { frame, arrival_s }) => return Some((camera, frame, arrival_s)),
            Ok(Delivery::Broken(error)) => {
                self.merge.count_broken(camera);
                let broken = self.merge.counts().nth(camera).map_or(0, |c| c.broken);
                if broken <= NAMED_BROKEN {
                    self.warnings.push(format!(
                        "cameras.{name}: left out a broken image: {error:#}"
                    ));
                }
                if broken == NAMED_BROKEN + 1 {
                    self.warnings.push(format!(
                        "cameras.{name}: further broken images are counted, but not named"
                    ));
                }
            }
            Err(error) => {
                let reason = format!("{error:#}");
                self.warnings
                    .push(format!("cameras.{name}: stopped: {reason}"));
                self.failures[camera] = Some(reason);
            }
        }
        None
    }

    /// Returns the next set of recorded cameras. The sets do not depend on the speed of decoding.
    fn next_recorded(&mut self) -> Option<FrameSet> {
        loop {
            for camera in 0..self.sources.len() {
                while self.next[camera].is_none()
                    && let Some(delivery) = self.sources[camera].next()
                {
                    self.next[camera] = self.sort(camera, delivery);
                }
            }
            let waiting = self.next.iter().flatten();
            let first = waiting.min_by(|a, b| a.2.total_cmp(&b.2));
            let first = first.map(|&(camera, _, arrival_s)| (camera, arrival_s));
            let now_s = first.map_or(f64::INFINITY, |(_, arrival_s)| arrival_s);
            let set = self.merge.next_set(now_s);
            if set.is_some() || self.is_over() {
                return set;
            }
            let (camera, frame, arrival_s) = self.next[first?.0].take()?;
            self.merge.take(camera, frame, arrival_s);
        }
    }

    /// Adds to a set of live cameras when it was captured.
    fn with_capture(&self, mut set: FrameSet) -> FrameSet {
        let frames = set.frames.iter();
        let captured_s =
            frames.filter_map(|(camera, frame)| self.clocks[*camera].captured_s(frame.time_s()));
        set.captured_s = captured_s.reduce(f64::min);
        let delays_s = self.clocks.iter().filter_map(CaptureClock::least_delay_s);
        set.least_delay_s = delays_s.reduce(f64::min);
        set
    }

    /// Returns the next set of live cameras without waiting for silent ones; `None` once all have ended or it is
    /// stopped.
    fn next_live(&mut self) -> Option<FrameSet> {
        while !self.stop.is_requested() {
            let now_s = now_s();
            let mut arrived = Vec::new();
            let mut ended = 0;
            for camera in 0..self.sources.len() {
                let overtaken = self.sources[camera].take_overtaken();
                self.merge.count_overtaken(camera, overtaken);
                let keeps_up = self.sources[camera].keeps_up();
                // Frames may wait in a source that has failed since.
                let is_failed = self.sources[camera].is_away();
                self.merge.set_away(camera, false);
                if !keeps_up && self.merge.has_backlog(camera, now_s) {
                    continue;
                }
                for _ in 0..TAKEN_AT_ONCE[usize::from(keeps_up)] {
                    match self.sources[camera].poll_next() {
                        Poll::Ready(Some(delivery)) => arrived.extend(self.sort(camera, delivery)),
                        Poll::Ready(None) => {
                            ended += 1;
                            self.merge.set_away(camera, true);
                            break;
                        }
                        Poll::Pending => {
                            self.merge.set_away(camera, is_failed);
                            break;
                        }
                    }
                }
            }
            arrived.sort_by(|a, b| a.2.total_cmp(&b.2));
            for (camera, frame, arrival_s) in arrived {
                let counts = self.merge.counts().nth(camera);
                let last_s = counts.and_then(|counts| counts.last_time_s);
                if last_s.is_some_and(|last_s| frame.time_s() < last_s) {
                    // The camera's clock was set: its fastest frame is unknown.
                    self.clocks[camera] = CaptureClock::default();
                }
                self.clocks[camera].take(frame.time_s(), arrival_s);
                self.merge.take(camera, frame, arrival_s);
            }
            for (camera, source) in self.sources.iter().enumerate() {
                if source.keeps_up() {
                    self.merge.overtake(camera, now_s);
                }
            }
            let all_ended = ended == self.sources.len();
            let set = self
                .merge
                .next_set(if all_ended { f64::INFINITY } else { now_s });
            if set.is_some() || all_ended || self.is_over() {
                return set.map(|set| self.with_capture(set));
            }
            std::thread::sleep(POLL);
        }
        None
    }
}

impl Iterator for FrameSets<'_> {
    type Item = FrameSet;

    fn next(&mut self) -> Option<Self::Item> {
        if self.is_over() {
            None
        } else if self.is_live {
            self.next_live()
        } else {
            self.next_recorded()
        }
    }
}
