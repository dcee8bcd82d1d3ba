//! Rows that say `tracking` and may be on something else.

use anyhow::Result;
use pardalis::TargetId;
use pardalis::tracker::{TrackState, Verdict};
use pardalis_scene::{BodyConfig, Scene, TargetConfig, TrackingConfig};

use super::missed::Ranges;
use super::{Instant, Sink};

/// Below this confidence a row is more likely wrong than right.
const DOUBTFUL: f64 = 0.5;

/// A smaller share of the tracked rows needs no advice. Hand-set: on 28 real clips, a rival is in up to 5 % of them, and in 14 % of one where something else moves beside the ball.
const WORTH_MENTIONING: f64 = 0.1;

/// Counts, for each target, the rows in which it is tracked and that are in doubt. `None` for crowds, and for targets that are followed from a start, whose confidence does not say whether they are
/// there.
pub(crate) struct Doubts {
    targets: Vec<Option<Counts>>,
    /// The number of frame sets so far.
    count: usize,
}

#[derive(Debug, Clone, Default)]
struct Counts {
    tracked: usize,
    doubtful: Doubted,
    with_rival: Doubted,
}

/// The frames of one kind of doubt.
#[derive(Debug, Clone, Default)]
struct Doubted {
    count: usize,
    frames: Ranges,
}

impl Doubts {
    /// Counts those of the targets of a scene.
    pub(super) fn of(scene: &Scene) -> Self {
        let is_started =
            |body: &BodyConfig| matches!(body.tracking, TrackingConfig::Initialized { .. });
        let counts = |target: &TargetConfig| {
            let is_found = target.crowd.is_none() && !target.bodies.iter().any(is_started);
            is_found.then(Counts::default)
        };
        Self {
            targets: scene.targets.iter().map(counts).collect(),
            count: 0,
        }
    }

    /// Says what is doubtful about the rows in which a target is tracked, and what to do, one per line.
    pub(crate) fn lines(&self, target: usize) -> Vec<String> {
        let counts = self.targets[target].as_ref();
        counts.map_or_else(Vec::new, Counts::lines)
    }
}

impl Doubted {
    /// Adds a frame, with its number among those that were processed.
    fn add(&mut self, frame: (usize, usize)) {
        self.count += 1;
        self.frames.add(frame, None);
    }

    /// Names the frames.
    fn shown(&self) -> String {
        let frames = match self.count {
            1 => "tracked frame",
            _ => "tracked frames",
        };
        format!("in {} {frames} ({})", self.count, self.frames)
    }
}

impl Counts {
    fn lines(&self) -> Vec<String> {
        let is_frequent =
            |of: &Doubted| of.count as f64 >= WORTH_MENTIONING * self.tracked.max(1) as f64;
        let mut lines = Vec::new();
        if self.doubtful.count > 0 {
            let advice = if is_frequent(&self.doubtful) {
                ": look at them with --annotate; if something else is tracked, see docs/troubleshooting.md"
            } else {
                ""
            };
            let frames = self.doubtful.shown();
            lines.push(format!(
                "{frames} the confidence is below {DOUBTFUL}{advice}"
            ));
        }
        if is_frequent(&self.with_rival) {
            let frames = self.with_rival.shown();
            lines.push(format!(
                "{frames} something else looked as much like it (rival): if there are several such objects, give the scene one target for each, or count = \"any\" (docs/crowds.md)"
            ));
        }
        lines
    }
}

impl Sink for Doubts {
    fn take(&mut self, instant: &Instant) -> Result<()> {
        for one in instant.tracked {
            let Some(counts) = &mut self.targets[one.target] else {
                continue;
            };
            if one.estimate.state != TrackState::Tracking {
                continue;
            }
            // The landmarks of one target may look alike.
            let bodies: Vec<_> = instant
                .tracker
                .candidates(TargetId::new(one.target))?
                .collect();
            let has_rival = match &bodies[..] {
                [candidates] => candidates.iter().any(|one| one.verdict == Verdict::Rival),
                _ => false,
            };
            let frame = (instant.index, self.count);
            counts.tracked += 1;
            if one.estimate.confidence < DOUBTFUL {
                counts.doubtful.add(frame);
            }
            if has_rival {
                counts.with_rival.add(frame);
            }
        }
        self.count += 1;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_rare_gets_no_advice() {
        let counts = |doubtful: std::ops::Range<usize>, with_rival: std::ops::Range<usize>| {
            let mut counts = Counts {
                tracked: 100,
                ..Counts::default()
            };
            doubtful.for_each(|frame| counts.doubtful.add((frame, frame)));
            with_rival.for_each(|frame| counts.with_rival.add((frame, frame)));
            counts
        };
        assert!(counts(0..0, 0..9).lines().is_empty());
        assert_eq!(
            counts(7..8, 0..0).lines(),
            ["in 1 tracked frame (7) the confidence is below 0.5"]
        );
        let [doubtful, rival] = &counts(10..20, 30..40).lines()[..] else {
            panic!("both are mentioned");
        };
        let wanted = "in 10 tracked frames (10 to 19) the confidence is below 0.5: look";
        assert!(doubtful.starts_with(wanted), "{doubtful}");
        let wanted =
            "in 10 tracked frames (30 to 39) something else looked as much like it (rival): if";
        assert!(rival.starts_with(wanted), "{rival}");
        assert!(Counts::default().lines().is_empty());
    }
}
