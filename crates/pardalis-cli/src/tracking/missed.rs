//! Why targets were not found: what ruled out the candidates in the frames without a target.

use anyhow::Result;
use pardalis::tracker::{Candidate, Origin, TrackState, Verdict};
use pardalis::view::View;
use pardalis::{TargetId, Tracker};
use pardalis_scene::{BodyConfig, Scene, TargetConfig, TrackingConfig};

use super::marks::pixel_of;
use super::{Instant, Sink};

/// Number of reasons reported for each target.
const REPORTED_REASONS: usize = 3;
/// An outline that is the target's by so much hides what ruled out others. Real balls have 5 to 25 nats (docs/not-found.md).
const LIKELY_NATS: f64 = 5.0;
/// Number of ranges of frames reported for each target.
const REPORTED_RANGES: usize = 6;

/// Counts, for each target, the frames in which it was searching or lost, by what ruled out a candidate in them.
pub(crate) struct MissedFrames {
    kinds: Vec<Kind>,
    /// One count per verdict, in the order of [`Verdict::ALL`].
    targets: Vec<[usize; Verdict::ALL.len()]>,
    /// The same, but only of a candidate that looks like the target where there is one, for the frames that follow others in which the target was in an image, and the number of these.
    unexplained: Vec<([usize; Verdict::ALL.len()], usize)>,
    ranges: Vec<Ranges>,
    /// The frames in which each target, if it is no crowd, was known and not seen, and what spoke against what was there, as in `targets`.
    hidden: Vec<(Ranges, [usize; Verdict::ALL.len()])>,
    /// Where the latest position of each target was out of all images; that of a crowd's members says nothing.
    exits: Vec<Option<Exit>>,
    /// The latest frame in which each target was seen.
    seen: Vec<Option<usize>>,
    /// The names of the cameras.
    cameras: Vec<String>,
    /// How many frames have been tracked.
    count: usize,
}

/// How a target is searched for.
#[derive(Debug, Clone, Copy)]
struct Kind {
    /// Whether another program detects it.
    is_boxed: bool,
    is_crowd: bool,
}

impl Kind {
    fn of(target: &TargetConfig) -> Self {
        Self {
            is_boxed: is_boxed(target),
            is_crowd: target.crowd.is_some(),
        }
    }
}

/// Where a target has left the images.
#[derive(Debug, Clone, Copy)]
pub(super) struct Exit {
    /// The camera whose image it is nearest to.
    camera: usize,
    /// The side of this image; `None` if it left the domain of the camera's model.
    side: Option<&'static str>,
    /// The frame in which it was seen last.
    seen: Option<usize>,
}

/// The first ranges of frames, such as those without a target, each with where the target was out of the images before, and the number of further ones.
#[derive(Debug, Clone, Default)]
pub(super) struct Ranges {
    first: Vec<([usize; 2], Option<Exit>)>,
    more: usize,
    /// The number, among those that were processed, of the last frame of the last range: live cameras leave out some.
    last: Option<usize>,
}

impl Ranges {
    /// Adds a frame, with its number among those that were processed.
    pub(super) fn add(&mut self, (frame, number): (usize, usize), exit: Option<Exit>) {
        let continues = self.last.is_some_and(|last| last + 1 == number);
        self.last = Some(number);
        if !continues && self.first.len() == REPORTED_RANGES {
            self.more += 1;
        } else if !continues {
            self.first.push(([frame; 2], exit));
        } else if self.more == 0
            && let Some((range, _)) = self.first.last_mut()
        {
            range[1] = frame;
        }
    }
}

impl std::fmt::Display for Ranges {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let range = |&([first, last], _): &([usize; 2], Option<Exit>)| {
            if first == last {
                first.to_string()
            } else {
                format!("{first} to {last}")
            }
        };
        let ranges: Vec<String> = self.first.iter().map(range).collect();
        f.write_str(&ranges.join(", "))?;
        match self.more {
            0 => Ok(()),
            1 => f.write_str(" and 1 more range"),
            more => write!(f, " and {more} more ranges"),
        }
    }
}

impl MissedFrames {
    /// Counts those of the targets of a scene; of a crowd, the frames without any member.
    pub(crate) fn of(scene: &Scene) -> Self {
        let targets = &scene.targets;
        Self {
            kinds: targets.iter().map(Kind::of).collect(),
            targets: vec![[0; Verdict::ALL.len()]; targets.len()],
            unexplained: vec![([0; Verdict::ALL.len()], 0); targets.len()],
            ranges: vec![Ranges::default(); targets.len()],
            hidden: vec![(Ranges::default(), [0; Verdict::ALL.len()]); targets.len()],
            exits: vec![None; targets.len()],
            seen: vec![None; targets.len()],
            cameras: scene
                .cameras
                .iter()
                .map(|camera| camera.name.clone())
                .collect(),
            count: 0,
        }
    }

    /// Returns for each reason the number of frames in which a target was missed and a candidate ruled out for it.
    pub(crate) fn by_reason(&self, target: usize) -> impl Iterator<Item = (Verdict, usize)> {
        let counted = Verdict::ALL.into_iter().zip(self.targets[target]);
        counted.filter(|&(_, frames)| frames > 0)
    }

    /// Whether a target was missing in a frame that does not follow its leaving the images.
    pub(crate) fn has_unexplained(&self, target: usize) -> bool {
        self.unexplained[target].1 > 0
    }

    /// Lists the frames without a target of this name, where it had left the images, and the most frequent reasons in the other frames, one per line. `missed` is the number of these frames.
    pub(crate) fn lines(&self, target: usize, name: &str, missed: usize) -> Vec<String> {
        if missed == 0 {
            return Vec::new();
        }
        let ranges = &self.ranges[target];
        let frames = format!(
            "{name} was not found in {} {ranges}; where it is out of view or hidden, nothing needs mending",
            if missed == 1 { "frame" } else { "frames" }
        );
        let exits = ranges.first.iter().filter_map(|&(_, exit)| {
            let Exit { camera, side, seen } = exit?;
            let image = match &*self.cameras {
                [_] => "the image".to_owned(),
                cameras => format!("all images, also that of {}", cameras[camera]),
            };
            let side = side.map_or(String::new(), |side| format!(" ({side})"));
            Some(format!(
                "after frame {} its predicted path left {image}{side}",
                seen?
            ))
        });
        let (counts, unexplained) = self.unexplained[target];
        let reasons = Verdict::ALL.into_iter().zip(counts);
        let mut reasons: Vec<_> = reasons.filter(|&(_, frames)| frames > 0).collect();
        // Of two equally frequent ones that which came nearer.
        reasons.sort_by_key(|&reason| std::cmp::Reverse((reason.1, reason.0)));
        let kind = self.kinds[target];
        let line = |&(reason, frames): &(Verdict, usize)| {
            let of_these = if missed == 1 {
                "in this frame".to_owned()
            } else if unexplained == missed {
                format!("in {frames} of these {missed} frames")
            } else {
                format!("in {frames} of the {unexplained} frames in which it had not left")
            };
            format!(
                "{of_these}, {} ({}): {}",
                what(reason, kind.is_boxed),
                reason.name(),
                remedy(reason, kind)
            )
        };
        let reasons = reasons.iter().take(REPORTED_REASONS).map(line);
        [frames].into_iter().chain(exits).chain(reasons).collect()
    }
}

impl MissedFrames {
    /// Lists the frames in which a target of this name was known, in view and not seen, and what most often spoke against what was there; nothing without any.
    pub(crate) fn hidden_lines(&self, target: usize, name: &str) -> Vec<String> {
        let (ranges, counts) = &self.hidden[target];
        if ranges.first.is_empty() {
            return Vec::new();
        }
        let is_one = matches!(ranges.first[..], [([first, last], _)] if first == last);
        let frames = format!(
            "{name} is in view and counts as occluded in {} {ranges}; where something hides it, nothing needs mending",
            if is_one { "frame" } else { "frames" }
        );
        let most = Verdict::ALL.into_iter().zip(*counts);
        let most = most.max_by_key(|&(verdict, frames)| (frames, verdict));
        let kind = self.kinds[target];
        let reason = most.filter(|&(_, frames)| frames > 0).map(|(verdict, frames)| {
            let remedy = match verdict {
                Verdict::Covered => "if nothing does, label images that show it from this side, in this light and as blurred",
                other => remedy(other, kind),
            };
            format!(
                "in {frames} of these frames, {} ({}): {remedy}",

                what(verdict, kind.is_boxed),
                verdict.name()
            )
        });
        [frames].into_iter().chain(reason).collect()
    }
}

/// Returns what speaks against the thing in the latest frames that looks most like a known target, or else against what is seen where it was predicted.
fn against(tracker: &Tracker, target: TargetId) -> Result<Option<Verdict>> {
    let mut of_bodies = tracker.candidates(target)?;
    let candidates = of_bodies.next().unwrap_or_default();
    let says_why = |one: &&Candidate| !matches!(one.verdict, Verdict::SamePlace | Verdict::Target);
    let open: Vec<&Candidate> = candidates.iter().filter(says_why).collect();
    let predicted = open.iter().find(|one| one.origin == Origin::Prediction);
    Ok(likely(&open).or(predicted.map(|one| one.verdict)))
}

/// Returns where a position in the world, in metres, is out of the images of all cameras.
fn exit(views: &[View], position_m: [f64; 3], seen: Option<usize>) -> Option<Exit> {
    let mut nearest: Option<(f64, Exit)> = None;
    for (camera, view) in views.iter().enumerate() {
        let (width, height) = view.size();
        let (by_px, side) = match pixel_of(view, position_m) {
            None => (f64::INFINITY, None),
            Some([u_px, v_px]) => {
                let sides = [
                    (-0.5 - u_px, "left"),
                    (u_px - (width as f64 - 0.5), "right"),
                    (-0.5 - v_px, "top"),
                    (v_px - (height as f64 - 0.5), "bottom"),
                ];
                let farthest = sides
                    .into_iter()
                    .reduce(|a, b| if b.0 > a.0 { b } else { a });
                let (by_px, side) = farthest?;
                if by_px <= 0.0 {
                    return None;
                }
                (by_px, Some(side))
            }
        };
        if nearest.is_none_or(|(least_px, _)| by_px < least_px) {
            nearest = Some((by_px, Exit { camera, side, seen }));
        }
    }
    nearest.map(|(_, exit)| exit)
}

/// Returns whether another program detects a target.
pub(crate) fn is_boxed(target: &TargetConfig) -> bool {
    let is_boxed = |body: &BodyConfig| matches!(body.tracking, TrackingConfig::Boxed { .. });
    target.bodies.iter().any(is_boxed)
}

/// Returns whether there is an estimate in a state.
fn is_known(state: TrackState) -> bool {
    matches!(state, TrackState::Tracking | TrackState::Occluded)
}

impl Sink for MissedFrames {
    fn take(&mut self, instant: &Instant) -> Result<()> {
        for number in 0..self.targets.len() {
            let mut of_target = instant.tracked.iter().filter(|one| one.target == number);
            if let Some(known) = of_target.find(|one| is_known(one.estimate.state)) {
                let position_m = known.estimate.kinematics.map(|k| k.position_m);
                let views = instant.tracker.views();
                let is_alone = known.member.is_none();
                if known.estimate.state == TrackState::Tracking {
                    self.seen[number] = Some(instant.index);
                }
                let seen = self.seen[number];
                let left = position_m
                    .filter(|_| is_alone)
                    .and_then(|at_m| exit(views, at_m, seen));
                // The side at which it left, and not where predictions lead from there.
                let before = self.exits[number].filter(|before| before.seen == seen);
                self.exits[number] = left.map(|left| before.unwrap_or(left));
                if known.estimate.state == TrackState::Occluded && is_alone && left.is_none() {
                    let (ranges, counts) = &mut self.hidden[number];
                    ranges.add((instant.index, self.count), None);
                    if let Some(verdict) = against(instant.tracker, TargetId::new(number))? {
                        let of_verdict = Verdict::ALL.into_iter().zip(counts);
                        for (_, count) in of_verdict.filter(|(one, _)| *one == verdict) {
                            *count += 1;
                        }
                    }
                }
            } else {
                let exit = self.exits[number];
                self.ranges[number].add((instant.index, self.count), exit);
                let candidates = ruled_out(instant.tracker, TargetId::new(number))?;
                let (unexplained, frames) = &mut self.unexplained[number];
                let counts = self.targets[number].iter_mut().zip(unexplained);
                let likely = likely(&candidates);
                *frames += usize::from(exit.is_none());
                for ((all, unexplained), verdict) in counts.zip(Verdict::ALL) {
                    let has = candidates.iter().any(|one| one.verdict == verdict);
                    *all += usize::from(has);
                    let is_reason = likely.map_or(has, |likely| likely == verdict);
                    *unexplained += usize::from(is_reason && exit.is_none());
                }
            }
        }
        self.count += 1;
        Ok(())
    }
}

/// Returns the candidates of a target (of its first missing landmark) that were ruled out in the latest frames; none for targets that the tracker does not
/// search for. Predictions count only if there are no other candidates.
fn ruled_out(tracker: &Tracker, target: TargetId) -> Result<Vec<&Candidate>> {
    let bodies = tracker.bodies_at(target, tracker.time_s().unwrap_or(0.0))?;
    let of_bodies = tracker.candidates(target)?.zip(bodies);
    let mut missing = of_bodies.filter(|(candidates, body)| {
        // Of a crowd, one place at a time is searched for.
        body.kinematics.is_none() && !candidates.is_empty()
    });
    let candidates = missing.next().map_or(&[][..], |(candidates, _)| candidates);
    let is_seen = |candidate: &Candidate| candidate.origin != Origin::Prediction;
    let has_seen = candidates.iter().any(is_seen);
    let says_why = |verdict| !matches!(verdict, Verdict::SamePlace | Verdict::Target);
    let counts = |one: &&Candidate| is_seen(one) == has_seen && says_why(one.verdict);
    Ok(candidates.iter().filter(counts).collect())
}

/// Returns the verdicts that ruled out candidates of a target in the latest frames, the last test first.
pub(crate) fn reasons(tracker: &Tracker, target: TargetId) -> Result<Vec<Verdict>> {
    let candidates = ruled_out(tracker, target)?;
    let is_reason = |verdict: &Verdict| candidates.iter().any(|one| one.verdict == *verdict);
    Ok(Verdict::ALL.into_iter().rev().filter(is_reason).collect())
}

/// Returns what ruled out the candidate of a target that is nearest to a pixel of a camera's latest image, among those around which it lies. If there is none, nothing there has its
/// colours, or, of a target that `is_boxed`, there is no box. `None` without any candidate.
pub(crate) fn reason_at(
    tracker: &Tracker,
    (target, is_boxed): (TargetId, bool),
    (camera, pixel): (usize, [f64; 2]),
) -> Result<Option<Verdict>> {
    let candidates = ruled_out(tracker, target)?;
    let nearest = candidates.iter().filter_map(|one| {
        let of_camera = one.origin.camera().filter(|id| id.index() == camera);
        let blob = one.origin.blob().filter(|_| of_camera.is_some())?;
        let is_around = (0..2).all(|axis| {
            let (low, high) = (blob.min_px[axis] as f64, blob.max_px[axis] as f64);
            // What is covered or in the shade at the rim has other colours.
            let margin_px = 0.5 * (high - low + 1.0);
            (low - margin_px..=high + margin_px).contains(&pixel[axis])
        });
        let [du, dv] = [0, 1].map(|axis| blob.centroid_px[axis] - pixel[axis]);
        is_around.then(|| (libm::hypot(du, dv), one.verdict))
    });
    // Of several at one place that which came nearest to being the target.
    let nearest = nearest.min_by(|a, b| a.0.total_cmp(&b.0).then(b.1.cmp(&a.1)));
    let nothing = if is_boxed {
        Verdict::NoBox
    } else {
        Verdict::NoColors
    };
    let nothing = (!candidates.is_empty()).then_some(nothing);
    Ok(nearest.map(|(_, verdict)| verdict).or(nothing))
}

/// Returns what ruled out the candidate whose outline looks most like the target's, if it does: only that matters then.
fn likely(candidates: &[&Candidate]) -> Option<Verdict> {
    let outlines = candidates
        .iter()
        .filter_map(|one| Some((one.outline_nats?, one.verdict)));
    let likeliest = outlines.max_by(|(a, _), (b, _)| a.total_cmp(b));
    let (_, verdict) = likeliest.filter(|(outline_nats, _)| *outline_nats >= LIKELY_NATS)?;
    Some(verdict)
}

/// Says what ruled out a candidate, as a clause; of a target that another program detects if it `is_boxed`.
pub(crate) fn what(verdict: Verdict, is_boxed: bool) -> String {
    let area = if is_boxed {
        "the box"
    } else {
        "the area in its colours"
    };
    match verdict {
        Verdict::NoColors => "nothing in the image has its colours".to_owned(),
        Verdict::Surplus => "too many things have its colours".to_owned(),
        Verdict::OutOfView => format!(
            "{area} is cut off by the image border, the mask or the domain of the camera model"
        ),
        Verdict::OffGround => format!("{area} is not on the ground"),
        Verdict::TooNear => {
            format!("{area} is so large that the target would touch the camera")
        }
        Verdict::TooFar => {
            format!("{area} is so small that the target would be too far away")
        }
        Verdict::NoEdges => {
            format!("{area} has no edges to which its outline could be fitted")
        }
        Verdict::Covered => "too little of the outline shows its colours".to_owned(),
        Verdict::OtherOutline => format!("{area} has another outline"),
        Verdict::OtherColor => "the area with its outline has another mean colour".to_owned(),
        Verdict::NoBox => "the detector has no box there".to_owned(),
        Verdict::OutsideRegion => "the likeliest candidate is outside existence.region".to_owned(),
        Verdict::Stray => {
            "the likeliest candidate for a landmark is too far from the other landmarks".to_owned()
        }
        Verdict::LookAlike => "the likeliest candidate is another target".to_owned(),
        Verdict::Rival => "several candidates look like it".to_owned(),
        _ => "the likeliest candidate is not certain enough".to_owned(),
    }
}

/// Says what to do if a verdict is wrong.
fn remedy(verdict: Verdict, kind: Kind) -> &'static str {
    match verdict {
        Verdict::OtherOutline if kind.is_boxed => {
            "check the shape, and whether the boxes are in pixels of these images"
        }
        Verdict::NoColors => "learn the colours from images of this camera in this light",
        Verdict::OtherColor => {
            "if it is the target, learn the colours from images of this camera in this light"
        }
        Verdict::Surplus => "mask the other objects, or learn finer colours (learn --bins)",
        Verdict::OutOfView => "check size_px, the mask and the camera's model",
        Verdict::OffGround => "check the camera's pose and existence.ground_z_m",
        Verdict::TooNear | Verdict::TooFar => {
            "check the target's size in metres and the focal length"
        }
        Verdict::NoEdges => "look for blur and for surroundings in its colours",
        Verdict::Covered => {
            "check whether something covers it or touches it in its colours, or whether it is something else"
        }
        Verdict::OtherOutline => "check its shape, and learn from labels along its outline",
        Verdict::NoBox => {
            "check detector.class and detector.detection_probability, and whether the boxes are in pixels of these images"
        }
        Verdict::OutsideRegion => "check existence.region, the camera's pose and the target's size",
        Verdict::Stray => "look for other things in the landmark's colours",
        Verdict::LookAlike | Verdict::Rival if kind.is_crowd => {
            "check with --annotate whether one outline holds two of them"
        }
        Verdict::LookAlike => {
            "if it is a further object, give the scene a target for it, too, or count = \"any\""
        }
        Verdict::Rival => "give the scene one target for each object, or count = \"any\"",
        _ if kind.is_boxed => {
            "check detector.false_per_image, detector.side_sigma and the scores: one box is not enough"
        }
        _ => "give more frames, or learn from more images",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_of_frames_are_listed_and_counted() {
        let mut ranges = Ranges::default();
        for frame in [3, 4, 5, 9, 11, 12, 20, 30, 40, 41] {
            ranges.add((frame, frame), None);
        }
        assert_eq!(ranges.to_string(), "3 to 5, 9, 11 to 12, 20, 30, 40 to 41");
        for frame in [50, 51] {
            ranges.add((frame, frame), None);
        }
        assert_eq!(
            ranges.to_string(),
            "3 to 5, 9, 11 to 12, 20, 30, 40 to 41 and 1 more range"
        );
        ranges.add((60, 60), None);
        assert!(
            ranges.to_string().ends_with(" and 2 more ranges"),
            "{ranges}"
        );
        // A live camera left out what is in between.
        let mut ranges = Ranges::default();
        for (number, frame) in [57, 58, 60, 64].into_iter().enumerate() {
            ranges.add((frame, number), None);
        }
        assert_eq!(ranges.to_string(), "57 to 64");
    }
}
