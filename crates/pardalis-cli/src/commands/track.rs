//! `pardalis track`: tracks the targets of a scene.

use std::num::NonZeroUsize;
use std::path::PathBuf;

use anyhow::{Result, anyhow};
use pardalis::TargetId;

use crate::arguments::Threads;
use crate::commands::studio::{WatchOptions, Watching};
use crate::interrupt::Stop;
use crate::numbers::counted;
use crate::output::{Shown, note, print};
use crate::platforms;
use crate::shell_word::shell_word;
use crate::tracking::agreement;
use crate::tracking::radius::EstimatedRadius;
use crate::tracking::{
    self, Annotate, CameraRecord, CrowdCounts, Destination, Limit, Options, Output, Previous, Run,
};
use crate::user_error::user_error;

/// Fewer frames in which a camera does not see what others see say nothing. Hand-set: a second.
const BLIND_FRAMES: usize = 25;
/// A camera that sees a target in a smaller share of them is as good as blind to it. Hand-set.
const BLIND_SHARE: f64 = 0.1;

/// Tracks the targets of a scene
///
/// Reads a scene file (`pardalis init` writes one to start from), tracks every target through all frames and writes a
/// folder with tracks.csv (position, velocity, covariance and best particle, one row per frame and target),
/// summary.json, and plots (from above, from the side, in an oblique view, and over time).
///
/// Rows and summary of an earlier run in that folder are kept as tracks.previous.csv and summary.previous.json.
///
/// If a target is missing in some frames, the summary says in how many, and why the candidates were ruled out;
/// --explain reports this for each frame.
///
/// With several cameras, frames that arrive early wait up to timing.max_delay_s (a key of the scene; default 0.1 s,
/// with one camera 0) for earlier frames of other cameras. A camera that fails, ends or freezes does not stop the
/// others; a table at the end and summary.json list the frames of each camera that were used and dropped.
#[derive(Debug, clap::Args)]
#[command(after_help = "Examples:
  pardalis track ball.toml                       results into the folder ball-tracks
  pardalis track ball.toml -o run7 --annotate    also the frames with contours and particles
  pardalis track ball.toml --smooth              the best track of a recording
  pardalis track ball.toml --annotate --report   also a page with all of it, for the browser
  pardalis track ball.toml --annotate --explain  why candidates were ruled out
  pardalis track live.toml --send udp://10.0.0.2:7000   estimates for a robot
  pardalis track live.toml --watch               shows the run in a browser
  pardalis track live.toml --duration 60         a minute of a live camera
  pardalis track ball.toml -o - | head           rows to standard output while tracking")]
#[allow(clippy::struct_excessive_bools)] // flags of the command line
pub(crate) struct Arguments {
    /// The scene file
    #[arg(value_name = "SCENE.toml")]
    scene: PathBuf,
    /// The folder for the results, or - to print only the rows on standard output [default: the scene's name with
    /// -tracks]
    #[arg(short, long, value_name = "FOLDER|-")]
    output: Option<PathBuf>,
    /// Overrides the scene's seed
    #[arg(long)]
    seed: Option<u32>,
    #[command(flatten)]
    threads: Threads,
    /// Also writes every frame with contours and particles drawn on it
    #[arg(long)]
    annotate: bool,
    /// Also writes candidates.csv: the candidates in each frame, and why each was ruled out
    ///
    /// Needs an output folder. With --annotate, the candidates are drawn into the frames. The guide explains
    /// each verdict (docs/not-found.md).
    #[arg(long)]
    explain: bool,
    /// Stops after this many frames; with several cameras, after this many frame sets (the images of one time)
    #[arg(long, value_name = "N", value_parser = parse_frames, allow_negative_numbers = true)]
    frames: Option<NonZeroUsize>,
    /// Stops after this much time by the cameras' time stamps, counted from the first frame
    #[arg(long = "duration", value_name = "SECONDS", value_parser = parse_duration_s, allow_negative_numbers = true)]
    duration_s: Option<f64>,
    /// Smooths the tracks at the end: every row takes into account what came after it
    ///
    /// For recordings: tracks.csv then has the smoothed rows, filtered.csv those that were written while tracking, and
    /// events.csv the contacts: throws, bounces and the like. Needs an output folder.
    #[arg(long)]
    smooth: bool,
    /// Exits with code 1 if a target is tracked in no frame; results are written nevertheless
    #[arg(long)]
    require_found: bool,
    /// Also writes the particles of each estimate to a file with the columns
    /// frame,time_s,target,landmark,particle,x_m,…,vx_mps,…,weight
    ///
    /// One row per frame, target and particle, written while tracking. Particles are those of the last update before
    /// resampling; their weights sum to one. Targets without an estimate have no rows. Files are large: 500 particles
    /// take about 60 kB per frame.
    #[arg(long, value_name = "FILE.csv")]
    particles: Option<PathBuf>,
    /// Also writes images, outlines, cameras and estimates into an MCAP recording, which Foxglove and others show
    ///
    /// An earlier recording of that name is replaced. Needs a program that was built with the feature mcap.
    #[arg(long, value_name = "FILE.mcap")]
    mcap: Option<PathBuf>,
    /// Also writes report.html: a page that shows the tracks in 3D and over time, in any browser and without a network
    ///
    /// With --annotate, it contains reduced copies of the frames. `pardalis view` writes such a page of finished tracks. Needs an output folder.
    #[arg(long)]
    report: bool,
    /// Sends the estimates to another program while tracking, as lines of JSON: udp://HOST:PORT or tcp://HOST:PORT; may be repeated
    ///
    /// The latest wins: a receiver that is too slow, or not there yet, gets fewer, and does not hold up tracking. Over TCP the program connects to the
    /// receiver, again and again until it answers.
    #[arg(long, value_name = "ADDRESS", value_parser = Destination::parse)]
    send: Vec<Destination>,
    #[command(flatten)]
    watch: WatchOptions,
    /// Draws no plots
    #[arg(long)]
    no_plots: bool,
}

/// Parses a number of frames.
fn parse_frames(text: &str) -> Result<NonZeroUsize, String> {
    text.parse()
        .map_err(|_| "allowed: a whole number above 0".to_owned())
}

/// Parses a duration in seconds.
fn parse_duration_s(text: &str) -> Result<f64, String> {
    let duration_s = text.parse().ok();
    let is_valid = |&duration_s: &f64| duration_s > 0.0 && duration_s.is_finite();
    duration_s
        .filter(is_valid)
        .ok_or_else(|| "allowed: a number of seconds above 0".to_owned())
}

/// Runs the command.
pub(crate) fn run(arguments: &Arguments) -> Result<()> {
    let output = match &arguments.output {
        Some(path) if path.as_os_str() == "-" => Output::Stdout,
        Some(folder) => Output::Folder(folder.clone()),
        None => {
            let stem = arguments
                .scene
                .file_stem()
                .unwrap_or_default()
                .to_string_lossy();
            Output::Folder(PathBuf::from(format!("{stem}-tracks")))
        }
    };
    let to_stdout = output == Output::Stdout;
    if arguments.explain && to_stdout {
        return Err(user_error!(
            "--explain: writes candidates.csv into the output folder; give -o a folder instead of -"
        ));
    }
    if arguments.smooth && to_stdout {
        return Err(user_error!(
            "--smooth: replaces rows once the recording is over; give -o a folder instead of -"
        ));
    }
    if arguments.report && to_stdout {
        return Err(user_error!(
            "--report: writes report.html into the output folder; give -o a folder instead of -"
        ));
    }
    let watching = Watching::start(&arguments.watch, &arguments.scene)?;
    let options = Options {
        output,
        seed: arguments.seed,
        threads: arguments.threads,
        annotate: if arguments.annotate {
            Annotate::Trails
        } else {
            Annotate::No
        },
        explain: arguments.explain,
        particles: arguments.particles.clone(),
        mcap: arguments.mcap.clone(),
        send: arguments.send.clone(),
        smooth: arguments.smooth,
        plots: !arguments.no_plots,
        report: arguments.report,
        progress: true,
        previous: Previous::Keep,
        limit: Limit {
            frame_sets: arguments.frames.map(NonZeroUsize::get),
            duration_s: arguments.duration_s,
        },
        stop: Stop::default(),
        watch: watching.as_ref().map(|watching| watching.watch.clone()),
    };
    let run = tracking::run(&arguments.scene, &options);
    if let Some(watching) = watching {
        watching.finish();
    }
    let run = run?;
    let warnings = warnings(&run);
    if !warnings.is_empty() {
        note(warnings.trim_end());
    }
    if !to_stdout {
        print(summary(&run).trim_end());
    }
    let never_found: Vec<&str> = never_found(&run).map(|(_, name)| name).collect();
    if arguments.require_found && !never_found.is_empty() {
        return Err(anyhow!(
            "--require-found: not found in any frame: {}",
            never_found.join(", ")
        ));
    }
    Ok(())
}

/// Returns the targets that have rows but were tracked in none, each with its number and name.
fn never_found(run: &Run) -> impl Iterator<Item = (usize, &str)> {
    let targets = run.open.scene.targets.iter().zip(run.series.states());
    let never = targets
        .enumerate()
        .filter(|(_, (_, states))| states.tracking == 0 && states.rows() > 0);
    never.map(|(number, (target, _))| (number, &*target.name))
}

/// Returns the estimated radii of a target.
fn radii(run: &Run, number: usize) -> Vec<EstimatedRadius<'_>> {
    // The number is that of a target of this tracker.
    EstimatedRadius::of(&run.open.scene, &run.open.tracker, number).unwrap_or_default()
}

/// Returns what most often ruled out a target that was missing in some frames, and what to do next, one per line.
fn reasons(run: &Run, number: usize) -> Vec<String> {
    let name = &run.open.scene.targets[number].name;
    let states = &run.series.states()[number];
    let mut lines = (run.missed).lines(number, name, states.searching + states.lost);
    if !lines.is_empty() {
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
        if record.frames.dropped_late > 0 {
            let _ = writeln!(
                text,
                "warning: cameras.{name}: {} of its frames arrived too late and were dropped; timing.max_delay_s, the longest wait for late frames, is {} s",
                record.frames.dropped_late, run.open.scene.max_delay_s
            );
        }
        if 2 * record.frames.used < record.frames.delivered {
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
    for warning in blind_cameras(run) {
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

/// Returns a warning for each camera that hardly ever sees a target that other cameras show in its view.
fn blind_cameras(run: &Run) -> Vec<String> {
    let cameras = &run.open.scene.cameras;
    let targets = run.open.scene.targets.iter().enumerate();
    let of_target = |(number, target): (usize, &pardalis_scene::TargetConfig)| {
        let contributions = run.open.tracker.contributions(TargetId::new(number));
        let contributions = cameras.iter().zip(contributions.unwrap_or_default());
        let blind = contributions.filter(|(_, camera)| {
            let due = camera.visible_frames + camera.blind_frames;
            camera.blind_frames >= BLIND_FRAMES
                && (camera.visible_frames as f64) < BLIND_SHARE * due as f64
        });
        let warnings = blind.map(|(camera, contribution)| {
            let (seen, blind) = (contribution.visible_frames, contribution.blind_frames);
            format!(
                "warning: cameras.{}: saw {} in {seen} of {} frames in which it had its place in view, as the other cameras show; if nothing hides it there, \
                 learn its colours from images of this camera, too (the white balance of cameras differs), or check the camera's pose",
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
        "{:<16}{:>9}{:>9}{:>12}{:>9}{:>8}{:>10}{:>8}{:>16}",
        "camera",
        "frames",
        "used",
        "sorted in",
        "dropped",
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
            "\n{:<16}{:>9}{:>9}{:>12}{:>9}{:>8}{:>10}{:>8}{:>16.3}",
            camera.name,
            frames.delivered,
            frames.used,
            frames.sorted_in_late,
            frames.dropped_late,
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
    let mut text = format!("tracked {count} ({rate:.0} per second of tracking time)\n");
    if outcome.interrupted {
        text += "ended by Ctrl-C\n";
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
        // Warnings say why a target was never found.
        if states.tracking > 0 {
            for line in reasons(run, number) {
                let _ = writeln!(text, "  {line}");
            }
        }
    }
    text += &camera_table(run);
    for line in &run.sent {
        let _ = writeln!(text, "{line}");
    }
    for file in &run.files {
        let _ = writeln!(text, "  {}", file.shown());
    }
    text
}
