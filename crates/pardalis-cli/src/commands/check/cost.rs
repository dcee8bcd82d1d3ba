//! The first steps of tracking: what they find, and how long they take.

use std::path::Path;

use anyhow::Result;
use pardalis::tracker::Verdict;
use pardalis::{Estimate, Frame, TargetId, Tracker};

use crate::arguments::Threads;
use crate::numbers::{counted, significant};
use crate::output::Shown;
use crate::platforms;
use crate::scene::OpenScene;
use crate::timing::{Stopwatch, now_s};
use crate::tracking::{FrameSet, Limit, Merge, missed};

/// What the first frames showed of a target.
pub(super) struct Found {
    /// The estimate; of a crowd, the most certain.
    pub(super) estimate: Estimate,
    /// The number of members of a crowd that were found.
    pub(super) members: usize,
    /// What ruled out the candidate that came nearest to it.
    pub(super) reason: Option<Verdict>,
}

/// The measured time of a step, and what the first frames showed.
pub(super) struct Cost {
    /// What the frames showed of each target: the first that did, or else the last.
    pub(super) found: Vec<Found>,
    /// The most frames that were taken from a camera.
    frames: usize,
    /// The number of steps, which is that of the frames if all cameras are triggered together.
    steps: usize,
    first_s: f64,
    /// The mean of the further steps; the first one if there are none.
    later_s: f64,
    /// The interval between frames, if it is known.
    interval_s: Option<f64>,
    threads: usize,
}

/// Tracks these first frames of each camera as `track` does.
pub(super) fn measure(
    open: &mut OpenScene,
    firsts: &[&[Frame]],
    interval_s: Option<f64>,
    threads: Threads,
) -> Result<Cost> {
    let pool = threads.start()?;
    let mut times_s = Vec::new();
    let mut found: Vec<Found> = Vec::new();
    for set in sets_of(firsts) {
        let watch = Stopwatch::start();
        // Those that are live are where they are now.
        let delay_s = Some(now_s() - set.time_s);
        platforms::tell(&mut open.platforms, &mut open.tracker, set.time_s, delay_s)?;
        let frames = set.without_frozen(&open.detections)?;
        pool.install(|| open.tracker.observe(&frames))?;
        times_s.push(watch.elapsed_s());
        let now = all_found(&open.tracker, set.time_s)?;
        if found.is_empty() {
            found = now;
            continue;
        }
        // Some targets are found in a later frame only, such as those that one camera does not show.
        for (known, now) in found.iter_mut().zip(now) {
            if known.estimate.kinematics.is_none() || now.members > known.members {
                *known = now;
            }
        }
    }
    let (first_s, later_s) = match &times_s[..] {
        [first_s] => (*first_s, *first_s),
        [first_s, later_s @ ..] => {
            let all_s: f64 = later_s.iter().sum();
            (*first_s, all_s / later_s.len() as f64)
        }
        [] => (0.0, 0.0),
    };
    Ok(Cost {
        found,
        frames: firsts.iter().map(|frames| frames.len()).max().unwrap_or(0),
        steps: times_s.len(),
        first_s,
        later_s,
        interval_s,
        threads: pool.current_num_threads(),
    })
}

/// Returns frames of each camera as sets in order of time.
fn sets_of(frames: &[&[Frame]]) -> impl Iterator<Item = FrameSet> {
    let mut in_order: Vec<(usize, &Frame)> = frames
        .iter()
        .enumerate()
        .flat_map(|(camera, frames)| frames.iter().map(move |frame| (camera, frame)))
        .collect();
    in_order.sort_by(|(_, a), (_, b)| a.time_s().total_cmp(&b.time_s()));
    let mut merge = Merge::new(frames.len(), 0.0, Limit::default());
    for (camera, frame) in in_order {
        merge.take(camera, frame.clone(), frame.time_s());
    }
    std::iter::from_fn(move || merge.next_set(f64::INFINITY))
}

fn all_found(tracker: &Tracker, time_s: f64) -> Result<Vec<Found>> {
    let find = |target: TargetId| {
        let reasons = missed::reasons(tracker, target)?;
        Ok(Found {
            estimate: tracker.estimate(target)?,
            members: tracker.members_at(target, time_s)?.count(),
            reason: reasons.first().copied(),
        })
    };
    tracker.targets().map(find).collect()
}

impl Cost {
    /// Returns the number of steps for each frame of the camera with the most.
    fn steps_per_frame(&self) -> f64 {
        self.steps as f64 / self.frames.max(1) as f64
    }

    /// Says how long a step takes and, of a recording with this number of frames, all of them.
    pub(super) fn text(&self, frames: Option<usize>) -> String {
        let share = self.interval_s.map_or(String::new(), |interval_s| {
            let in_interval_s = self.later_s * self.steps_per_frame();
            let percent = significant(100.0 * in_interval_s / interval_s);
            let interval_ms = significant(1e3 * interval_s);
            format!(", {percent} % of the {interval_ms} ms between frames")
        });
        let all = frames.map_or(String::new(), |frames| {
            let steps = frames as f64 * self.steps_per_frame();
            let all_s = significant(self.first_s + self.later_s * (steps - 1.0).max(0.0));
            format!("; {all_s} s for all frames")
        });
        let read = match self.frames {
            1 => "first frame".to_owned(),
            frames => format!("first {frames} frames"),
        };
        format!(
            "cost, measured on this computer by tracking the {read} of each camera, without reading and writing files:\n  \
             {} ms per step on {} ({} ms for the first){share}{all}",
            significant(1e3 * self.later_s),
            counted(self.threads as u64, "thread"),
            significant(1e3 * self.first_s)
        )
    }

    /// Returns a warning if live cameras are faster than the tracker.
    pub(super) fn warning(&self, path: &Path) -> Option<String> {
        let in_interval_s = self.later_s * self.steps_per_frame();
        let interval_s = self.interval_s.filter(|&s| in_interval_s > s)?;
        Some(format!(
            "{}: tracking takes about {} ms for each frame, and frames come every {} ms: results will lag behind; use smaller images, \
             a lower frame rate, fewer cameras or fewer particles",
            path.shown(),
            significant(1e3 * in_interval_s),
            significant(1e3 * interval_s)
        ))
    }
}
