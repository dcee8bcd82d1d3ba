//! The frames of a scene's cameras as sets in order of time. A camera that fails stops alone.

use std::task::Poll;
use std::time::Duration;

use pardalis::Frame;
use serde::Serialize;

use super::merge::{FrameCounts, FrameSet, Merge};
use crate::interrupt;
use crate::source::{Delivery, Source};
use crate::timing::now_s;

/// How often live cameras are asked for frames.
const POLL: Duration = Duration::from_millis(1);

/// Broken images that are named for each camera; all are counted.
const NAMED_BROKEN: usize = 3;

/// A camera that ends this much before another has ended early, in seconds.
const EARLY_S: f64 = 1.0;

/// How it went with one camera.
#[derive(Debug, Clone, Serialize)]
pub(crate) struct CameraRecord {
    /// Its frames.
    pub(crate) frames: FrameCounts,
    /// That it failed, or ended before the others.
    pub(crate) stopped: Option<Stopped>,
}

/// Why a camera gave no more frames.
#[derive(Debug, Clone, Serialize)]
pub(crate) struct Stopped {
    /// Its last time stamp, in seconds; none where nothing came.
    pub(crate) time_s: Option<f64>,
    /// In words.
    pub(crate) reason: String,
}

/// A frame with its camera's number and arrival in seconds.
type Arrived = (usize, Frame, f64);

/// The sets of frames of all cameras; cameras need not run at one rate.
pub(crate) struct FrameSets<'a> {
    sources: &'a mut [Source],
    names: Vec<String>,
    is_live: bool,
    /// The next frame of each recorded source, once it is fetched.
    next: Vec<Option<Arrived>>,
    /// Why each source failed.
    failures: Vec<Option<String>>,
    merge: Merge,
    /// What is to be told to the user, and was not yet.
    warnings: Vec<String>,
}

impl<'a> FrameSets<'a> {
    /// Takes frames from these sources, which are all recorded or all live; the cameras' names are for messages.
    pub(crate) fn new(sources: &'a mut [Source], names: Vec<String>, max_delay_s: f64) -> Self {
        Self {
            is_live: sources.iter().any(Source::is_live),
            next: sources.iter().map(|_| None).collect(),
            failures: vec![None; sources.len()],
            merge: Merge::new(sources.len(), max_delay_s),
            warnings: Vec::new(),
            sources,
            names,
        }
    }

    /// What went wrong since this was asked before.
    pub(crate) fn warnings(&mut self) -> Vec<String> {
        std::mem::take(&mut self.warnings)
    }

    /// How it went with each camera, once no more sets are wanted.
    pub(crate) fn records(&mut self) -> Vec<CameraRecord> {
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
                        let at = time_s.map_or_else(String::new, |s| format!(" at {s} s"));
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

    /// Looks at what a source gave; a frame is given back.
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

    /// The next set of recorded cameras. Nothing is timed: however fast they are decoded, the sets are the same.
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
            let set = self.merge.hand_on(now_s);
            if set.is_some() {
                return set;
            }
            let (camera, frame, arrival_s) = self.next[first?.0].take()?;
            self.merge.take(camera, frame, arrival_s);
        }
    }

    /// The next set of live cameras: none waits for one that is silent. Nothing once all have ended, or the user wants to stop.
    fn next_live(&mut self) -> Option<FrameSet> {
        while !interrupt::requested() {
            let now_s = now_s();
            let mut arrived = Vec::new();
            let mut ended = 0;
            for camera in 0..self.sources.len() {
                loop {
                    match self.sources[camera].poll_next() {
                        Poll::Ready(Some(delivery)) => arrived.extend(self.sort(camera, delivery)),
                        Poll::Ready(None) => {
                            ended += 1;
                            break;
                        }
                        Poll::Pending => break,
                    }
                }
            }
            arrived.sort_by(|a, b| a.2.total_cmp(&b.2));
            for (camera, frame, arrival_s) in arrived {
                self.merge.take(camera, frame, arrival_s);
            }
            let all_ended = ended == self.sources.len();
            let set = self
                .merge
                .hand_on(if all_ended { f64::INFINITY } else { now_s });
            if set.is_some() || all_ended {
                return set;
            }
            std::thread::sleep(POLL);
        }
        None
    }
}

impl Iterator for FrameSets<'_> {
    type Item = FrameSet;

    fn next(&mut self) -> Option<Self::Item> {
        if self.is_live {
            self.next_live()
        } else {
            self.next_recorded()
        }
    }
}
