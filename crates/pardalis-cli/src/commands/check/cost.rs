//! The first steps of tracking: what they find, and how long they take.

use std::path::Path;

use anyhow::Result;
use pardalis::tracker::{TrackState, Verdict};
use pardalis::{CameraId, Estimate, Frame, FrameSet, TargetId, Tracker};

use crate::arguments::Threads;
use crate::numbers::fixed;
use crate::timing::Stopwatch;
use crate::tracking::missed;

/// Greatest number of steps that are measured after the first.
const STEPS: usize = 5;

/// The interval between frames that are measured if it is not known, in seconds.
const TYPICAL_INTERVAL_S: f64 = 0.04;

/// What the first step found of a target.
pub(super) struct Found {
    /// The estimate; of a crowd, the most certain.
    pub(super) estimate: Estimate,
    /// The number of members of a crowd that were found.
    pub(super) members: usize,
    /// What ruled out the candidate that came nearest to it.
    pub(super) reason: Option<Verdict>,
}

/// The measured time of a step, and what the first step found.
pub(super) struct Cost {
    /// What the first step found of each target.
    pub(super) found: Vec<Found>,
    first_s: f64,
    /// The median of the further steps; the first one if there are none.
    later_s: f64,
    /// The interval between frames, if it is known.
    interval_s: Option<f64>,
    threads: usize,
}

/// Tracks the first frames of all cameras repeatedly, as if nothing moved.
pub(super) fn measure(
    tracker: &mut Tracker,
    firsts: &[Frame],
    interval_s: Option<f64>,
    threads: Threads,
) -> Result<Cost> {
    let pool = threads.start()?;
    let begin_s = firsts
        .iter()
        .map(Frame::time_s)
        .fold(f64::NEG_INFINITY, f64::max);
    let step_s = interval_s.unwrap_or(TYPICAL_INTERVAL_S);
    let mut times_s = Vec::new();
    let mut found = Vec::new();
    for step in 0..=STEPS {
        // Lost targets cost nothing, unless they are searched for.
        let mut estimates = tracker.targets().map(|target| tracker.estimate(target));
        let mut is_lost =
            || estimates.any(|estimate| estimate.is_ok_and(|e| e.state == TrackState::Lost));
        if step > 0 && is_lost() {
            break;
        }
        let time_s = begin_s + step_s * step as f64;
        let frames = firsts.iter().enumerate();
        let frames =
            frames.map(|(camera, first)| Ok((CameraId::new(camera), first.with_time_s(time_s)?)));
        let set = FrameSet::new(frames.collect::<Result<Vec<_>, pardalis::Error>>()?)?;
        let watch = Stopwatch::start();
        pool.install(|| tracker.observe(&set))?;
        times_s.push(watch.elapsed_s());
        if step == 0 {
            let find = |target: TargetId| {
                let reasons = missed::reasons(tracker, target)?;
                Ok(Found {
                    estimate: tracker.estimate(target)?,
                    members: tracker.members_at(target, time_s)?.count(),
                    reason: reasons.first().copied(),
                })
            };
            found = tracker.targets().map(find).collect::<Result<_>>()?;
        }
    }
    let first_s = times_s[0];
    let later_s = &mut times_s[1..];
    later_s.sort_by(f64::total_cmp);
    Ok(Cost {
        found,
        first_s,
        later_s: later_s.get(later_s.len() / 2).copied().unwrap_or(first_s),
        interval_s,
        threads: pool.current_num_threads(),
    })
}

impl Cost {
    /// Says how long a step takes and, of a recording with this number of frames, all of them.
    pub(super) fn text(&self, frames: Option<usize>) -> String {
        let share = self.interval_s.map_or(String::new(), |interval_s| {
            let percent = rounded(100.0 * self.later_s / interval_s);
            let interval_ms = rounded(1e3 * interval_s);
            format!(", {percent} % of the {interval_ms} ms between frames")
        });
        let all = frames.map_or(String::new(), |frames| {
            let all_s = rounded(self.first_s + self.later_s * frames.saturating_sub(1) as f64);
            format!("; {all_s} s for all frames")
        });
        format!(
            "cost, estimated on this computer with the first frame of each camera, without reading and writing files:\n  \
             {} ms per step on {} threads ({} ms for the first){share}{all}",
            rounded(1e3 * self.later_s),
            self.threads,
            rounded(1e3 * self.first_s)
        )
    }

    /// Returns a warning if live cameras are faster than the tracker.
    pub(super) fn warning(&self, path: &Path) -> Option<String> {
        let interval_s = self.interval_s.filter(|&s| self.later_s > s)?;
        Some(format!(
            "{}: a step takes about {} ms, and frames come every {} ms: results will lag behind; use smaller images, a lower frame rate, \
             fewer cameras or fewer particles",
            path.display(),
            rounded(1e3 * self.later_s),
            rounded(1e3 * interval_s)
        ))
    }
}

/// Returns a positive number with two significant digits.
fn rounded(value: f64) -> String {
    if value >= 10.0 {
        fixed(value, 0)
    } else if value >= 1.0 {
        fixed(value, 1)
    } else {
        fixed(value, 2)
    }
}
