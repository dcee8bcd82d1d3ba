//! The report of a finished run: its summary and warnings.

use pardalis::TargetId;
use pardalis::tracker::Contribution;

use crate::measurements;
use crate::numbers::counted;
use crate::output::Shown;
use crate::platforms;
use crate::shell_word::shell_word;
use crate::tracking::agreement;
use crate::tracking::radius::EstimatedRadius;
use crate::tracking::{CameraRecord, CrowdCounts, Outcome, Run};

/// Fewer frames in which a camera does not see what others see say nothing. Hand-set: a second.
const BLIND_FRAMES: usize = 25;
/// A camera that sees a target in a smaller share of them is as good as blind to it. Hand-set.
const BLIND_SHARE: f64 = 0.1;
/// Fewer frames in which a camera shows what looks like the target elsewhere say nothing. Hand-set.
const ELSEWHERE_FRAMES: usize = 5;
/// A smaller share of them among those that were searched says nothing either. Hand-set: it is 0 if all are right and nothing else looks like the target.
const ELSEWHERE_SHARE: f64 = 0.2;

/// If a smaller share of the frames comes that a file announces, it is not whole. Hand-set: some containers count a few more.
const READ_SHARE: f64 = 0.95;

/// Returns the targets that have rows but were tracked in none, each with its number and name.
pub(crate) fn never_found(run: &Run) -> impl Iterator<Item = (usize, &str)> {
    let targets = run.open.scene.targets.iter().zip(run.series.states());
    let never = targets
        .enumerate()
        .filter(|(_, (_, states))| states.tracking == 0 && states.rows() > 0);
    never.map(|(number, (target, _))| (number, &*target.name))
}

/// Returns the estimated radii of a target.
pub(crate) fn radii(run: &Run, number: usize) -> Vec<EstimatedRadius<'_>> {
    // The number is that of a target of this tracker.
    EstimatedRadius::of(&run.open.scene, &run.open.tracker, number).unwrap_or_default()
}

/// Returns what most often ruled out a target that was missing in some frames, and what to do next, one per line.
fn reasons(run: &Run, number: usize) -> Vec<String> {
    let name = &run.open.scene.targets[number].name;
    let states = &run.series.states()[number];
    let mut lines = (run.missed).lines(number, name, states.searching + states.lost);
    if run.missed.has_unexplained(number) {
        let explained = run
            .files
            .iter()
            .any(|file| file.ends_with("candidates.csv"));
        lines.push(if explained {
            "candidates.csv has all candidates; docs/not-found.md explains the verdicts".to_owned()
        } else {
            format!(
                "next: run `pardalis track {} --explain --annotate`, look at the annotated frames, and read docs/not-found.md",
                shell_word(&run.scene_path)
            )
        });
    }
    lines
}

/// Returns warnings about problems that may have impaired the results, one per line.
pub(crate) fn warnings(run: &Run) -> String {
    use std::fmt::Write as _;
    let mut text = String::new();
    let records = run.open.sources.iter().zip(&run.outcome.cameras);
    for (camera, (source, record)) in run.open.scene.cameras.iter().zip(records) {
        let counters = source.counters();
        let name = &camera.name;
        if counters.ffmpeg_errors > 0 {
            let _ = writeln!(
                text,
                "warning: cameras.{name}: ffmpeg reported {} errors in {}; frames may be missing or damaged; play the video to check",
                counters.ffmpeg_errors,
                source.describe().input
            );
        }
        let (read, announced) = (record.frames.delivered, source.frame_count().unwrap_or(0));
        let goes_on = run.outcome.limit_reached || source.is_live();
        if run.outcome.is_at_end && !goes_on && (read as f64) < READ_SHARE * announced as f64 {
            let _ = writeln!(
                text,
                "warning: cameras.{name}: {announced} frames were announced, and {read} came: it is cut off or damaged, or ends early",
            );
        }
        if record.frames.dropped_late > 0 {
            let _ = writeln!(
                text,
                "warning: cameras.{name}: {} of its frames arrived too late and were dropped; timing.max_delay_s, the longest wait for late frames, is {} s",
                record.frames.dropped_late, run.open.scene.max_delay_s
            );
        }
        if 20 * record.frames.overtaken > record.frames.delivered && was_too_slow(&run.outcome) {
            let _ = writeln!(
                text,
                "warning: cameras.{name}: tracking was slower than the camera, so {} of its {} frames were left out; lower its frame rate, the size of its images or the number of particles (docs/videos.md)",
                record.frames.overtaken, record.frames.delivered
            );
        }
        // Those that were overtaken have been named.
        if 2 * (record.frames.used + record.frames.overtaken) < record.frames.delivered {
            let _ = writeln!(
                text,
                "warning: cameras.{name}: only {} of its {} frames were used; the table shows why the others were not",
                record.frames.used, record.frames.delivered
            );
        }
    }
    for number in 0..run.open.scene.targets.len() {
        for radius in radii(run, number) {
            if let Some(said_m) = radius.contradicted_m() {
                let _ = writeln!(
                    text,
                    "warning: {}.shape.sphere.radius_m: the scene says {} mm, the cameras say {radius}; set radius_m = {:.4}, unless the cameras' calibration is wrong",
                    radius.key,
                    // Without the digits that conversion adds.
                    (1e6 * said_m).round() / 1000.0,
                    radius.estimate.radius_m
                );
            }
        }
    }
    if let Some(warning) = agreement::warning(&run.open.scene, &run.open.tracker) {
        let _ = writeln!(text, "{warning}");
    }
    for warning in platforms::warnings(&run.open.platforms, &run.open.tracker) {
        let _ = writeln!(text, "{warning}");
    }
    for warning in measurements::warnings(&run.open.measurements, &run.open.tracker) {
        let _ = writeln!(text, "{warning}");
    }
    for warning in blind_cameras(run).into_iter().chain(misplaced_cameras(run)) {
        let _ = writeln!(text, "{warning}");
    }
    for (number, name) in never_found(run) {
        let frames = run.outcome.frame_sets;
        let _ = writeln!(
            text,
            "warning: targets.{name}: was not found in any of the {frames} frames"
        );
        let mut lines = reasons(run, number);
        if lines.is_empty() {
            lines.push("it is followed from its start and not searched for: check the start, or leave it out (docs/not-found.md)".to_owned());
        }
        for line in lines {
            let _ = writeln!(text, "  {line}");
        }
    }
    text
}

/// Reports whether frames were left out because tracking takes too long, and not because many came at once, such as when a stream is opened: then it hardly
/// waits for any.
fn was_too_slow(outcome: &Outcome) -> bool {
    outcome.waiting_s < 0.2 * (outcome.tracking_s + outcome.writing_s)
}

/// Returns a warning for each camera that hardly ever sees a target that other cameras show in its view.
fn blind_cameras(run: &Run) -> Vec<String> {
    let cameras = &run.open.scene.cameras;
    let targets = run.open.scene.targets.iter().enumerate();
    let of_target = |(number, target): (usize, &pardalis_scene::TargetConfig)| {
        let contributions = run.open.tracker.contributions(TargetId::new(number));
        let contributions = cameras.iter().zip(contributions.unwrap_or_default());
        let blind = contributions.filter(|(_, camera)| {
            let due = camera.visible_frames + camera.blind_frames;
            // Those that show it elsewhere are named for that.
            camera.blind_frames >= BLIND_FRAMES
                && !shows_it_elsewhere(camera)
                && (camera.visible_frames as f64) < BLIND_SHARE * due as f64
        });
        let warnings = blind.map(|(camera, contribution)| {
            let (seen, blind) = (contribution.visible_frames, contribution.blind_frames);
            format!(
                "warning: cameras.{}: saw {} in {seen} of {} frames in which it had its place in view, as the other cameras show; if nothing hides it there, \
                 learn its colours from images of this camera, too (the white balance of cameras differs), or check the camera's pose, and that the images are its own",
                camera.name,
                target.name,
                seen + blind,
            )
        });
        warnings.collect::<Vec<_>>()
    };
    if cameras.len() == 1 {
        return Vec::new();
    }
    targets.flat_map(of_target).collect()
}

/// Returns a warning for each target that some cameras show elsewhere than the others do.
fn misplaced_cameras(run: &Run) -> impl Iterator<Item = String> {
    let cameras = &run.open.scene.cameras;
    let targets = run.open.scene.targets.iter().enumerate();
    targets.filter_map(move |(number, target)| {
        let contributions = run.open.tracker.contributions(TargetId::new(number));
        let contributions = cameras.iter().zip(contributions.ok()?);
        let misplaced = contributions.filter(|(_, camera)| shows_it_elsewhere(camera));
        let first = misplaced.clone().next().map(|(camera, _)| &camera.name);
        let listed: Vec<_> = misplaced
            .map(|(camera, contribution)| {
                let [elsewhere, searched] =
                    [contribution.elsewhere_frames, contribution.searched_frames];
                format!("cameras.{} ({elsewhere} of {searched} frames)", camera.name)
            })
            .collect();
        first.filter(|_| cameras.len() > 1).map(|first| {
            format!(
                "warning: {}: what looks like {} there is not where other cameras show it: if there is only one such object, check which camera has which images and pose \
                 (`pardalis camera show {} --camera {first} --grid IMAGE -o FOLDER` draws the world over an image), and the clocks (`pardalis calibrate time`)",
                listed.join(", "),
                target.name,
                shell_word(&run.scene_path)
            )
        })
    })
}

/// Reports whether a camera shows what looks like the target where the other cameras do not show it.
fn shows_it_elsewhere(camera: &Contribution) -> bool {
    let [elsewhere, searched] = [camera.elsewhere_frames, camera.searched_frames];
    elsewhere >= ELSEWHERE_FRAMES && elsewhere as f64 >= ELSEWHERE_SHARE * searched as f64
}

/// Returns a table of the frames of each camera, and in how many of them it saw each target; empty for a single camera
/// without problems.
fn camera_table(run: &Run) -> String {
    use std::fmt::Write as _;
    let records = &run.outcome.cameras;
    let went_well = |record: &CameraRecord| record.frames.used == record.frames.delivered;
    if records.len() == 1 && records.iter().all(went_well) {
        return String::new();
    }
    let mut text = format!(
        "{:<16}{:>9}{:>9}{:>12}{:>11}{:>11}{:>8}{:>10}{:>8}{:>16}",
        "camera",
        "frames",
        "used",
        "sorted in",
        "too late",
        "overtaken",
        "frozen",
        "repeated",
        "broken",
        "longest gap (s)"
    );
    let targets = &run.open.scene.targets;
    let heads: Vec<String> = targets
        .iter()
        .map(|t| format!("  saw {}", t.name))
        .collect();
    for head in &heads {
        text += head;
    }
    for (number, camera) in run.open.scene.cameras.iter().enumerate() {
        let frames = &records[number].frames;
        let _ = write!(
            text,
            "\n{:<16}{:>9}{:>9}{:>12}{:>11}{:>11}{:>8}{:>10}{:>8}{:>16.3}",
            camera.name,
            frames.delivered,
            frames.used,
            frames.sorted_in_late,
            frames.dropped_late,
            frames.overtaken,
            frames.frozen,
            frames.repeated,
            frames.broken,
            frames.longest_gap_s
        );
        for (target, head) in heads.iter().enumerate() {
            let contributions = run.open.tracker.contributions(TargetId::new(target));
            let visible = contributions.map_or(0, |cameras| cameras[number].visible_frames);
            let _ = write!(text, "{visible:>width$}", width = head.len());
        }
    }
    text + "\n"
}

/// Returns a summary of the run as text.
pub(crate) fn summary(run: &Run) -> String {
    use std::fmt::Write as _;
    let outcome = &run.outcome;
    let frames = outcome.frame_sets;
    let rate = frames as f64 / outcome.tracking_s.max(1e-9);
    let count = counted(frames as u64, "frame");
    let mut text = format!("processed {count} ({rate:.0} per second of tracking time)\n");
    if outcome.interrupted {
        text += "ended on request\n";
    }
    let targets = run.open.scene.targets.iter().zip(run.series.states());
    for (number, (target, states)) in targets.enumerate() {
        let frames = counted(states.tracking as u64, "frame");
        let (name, others) = (
            &target.name,
            [states.occluded, states.lost, states.searching],
        );
        let [occluded, lost, searching] = others;
        let _ = if target.crowd.is_some() {
            let CrowdCounts {
                found,
                most_at_once,
            } = run.series.crowds()[number];
            let is_full = target.crowd.is_some_and(|most| most_at_once >= most);
            let limit = if is_full {
                " (max_count: there may be more)"
            } else {
                ""
            };
            writeln!(
                text,
                "{name}: found {found}, at most {most_at_once} at once{limit}; {frames} with any of them tracked, {occluded} with all occluded, {lost} with all lost, {searching} with none"
            )
        } else {
            writeln!(
                text,
                "{name}: {frames} tracked, {occluded} occluded, {lost} lost, {searching} searching"
            )
        };
        for radius in radii(run, number) {
            let _ = writeln!(text, "  {}: radius {radius}", radius.key);
        }
        for line in run.doubts.lines(number) {
            let _ = writeln!(text, "  {line}");
        }
        // Warnings say why a target was never found.
        if states.tracking > 0 {
            let hidden = run.missed.hidden_lines(number, &target.name);
            for line in reasons(run, number).into_iter().chain(hidden) {
                let _ = writeln!(text, "  {line}");
            }
        }
    }
    text += &camera_table(run);
    if let Some(latency) = outcome.latency {
        let [median, p99, max] =
            [latency.median_s, latency.p99_s, latency.max_s].map(|s| format!("{:.1} ms", 1e3 * s));
        let _ = writeln!(
            text,
            "latency: median {median}, 99 % below {p99}, at most {max}"
        );
    }
    for line in &run.sent {
        let _ = writeln!(text, "{line}");
    }
    for file in &run.files {
        let _ = writeln!(text, "  {}", file.shown());
    }
    text
}
