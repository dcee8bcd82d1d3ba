//! Rows that say `tracking` and may be on something else.

use anyhow::Result;
use pardalis::TargetId;
use pardalis::tracker::{TrackState, Verdict};
use pardalis_scene::Scene;

use super::{Instant, Sink};

/// Below this confidence a row is more likely wrong than right.
const DOUBTFUL: f64 = 0.5;

/// A smaller share of the tracked rows needs no advice. Hand-set: on real clips with a single ball, a rival is in up to 8 % of them, and in 10 to 24 % where other things look like it.
const WORTH_MENTIONING: f64 = 0.1;

/// Counts, for each target that is no crowd, the rows in which it is tracked and that are in doubt.
pub(crate) struct Doubts {
    targets: Vec<Option<Counts>>,
}

#[derive(Debug, Clone, Copy, Default)]
struct Counts {
    tracked: usize,
    doubtful: usize,
    with_rival: usize,
}

impl Doubts {
    /// Counts those of the targets of a scene.
    pub(super) fn of(scene: &Scene) -> Self {
        let targets = scene.targets.iter();
        let counts = |crowd: Option<usize>| crowd.is_none().then(Counts::default);
        Self {
            targets: targets.map(|target| counts(target.crowd)).collect(),
        }
    }

    /// Says what is doubtful about the rows in which a target is tracked, and what to do, one per line.
    pub(crate) fn lines(&self, target: usize) -> Vec<String> {
        self.targets[target].map_or_else(Vec::new, |counts| counts.lines())
    }
}

impl Counts {
    fn lines(&self) -> Vec<String> {
        let of_them = |count: usize| match count {
            1 => "one of the tracked frames".to_owned(),
            count => format!("{count} of the tracked frames"),
        };
        let is_frequent =
            |count: usize| count as f64 >= WORTH_MENTIONING * (self.tracked.max(1)) as f64;
        let mut lines = Vec::new();
        if self.doubtful > 0 {
            let advice = if is_frequent(self.doubtful) {
                ": look at them with --annotate; if something else is tracked, see docs/troubleshooting.md"
            } else {
                ""
            };
            lines.push(format!(
                "in {} the confidence is below {DOUBTFUL}{advice}",
                of_them(self.doubtful)
            ));
        }
        if is_frequent(self.with_rival) {
            lines.push(format!(
                "in {} something else looked as much like it (rival): if there are several such objects, give the scene one target for each, or count = \"any\" (docs/crowds.md)",
                of_them(self.with_rival)
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
            counts.tracked += 1;
            counts.doubtful += usize::from(one.estimate.confidence < DOUBTFUL);
            counts.with_rival += usize::from(has_rival);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_rare_gets_no_advice() {
        let counts = |doubtful, with_rival| Counts {
            tracked: 100,
            doubtful,
            with_rival,
        };
        assert!(counts(0, 9).lines().is_empty());
        assert_eq!(
            counts(1, 0).lines(),
            ["in one of the tracked frames the confidence is below 0.5"]
        );
        let [doubtful, rival] = &counts(10, 10).lines()[..] else {
            panic!("both are mentioned");
        };
        assert!(
            doubtful.starts_with("in 10 of the tracked frames the confidence is below 0.5: look")
        );
        assert!(rival.contains("(rival): if there are several such objects"));
        assert!(Counts::default().lines().is_empty());
    }
}
