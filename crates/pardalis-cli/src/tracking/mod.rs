//! The main job: frames of all cameras in time order, through the tracker, to the sinks.

mod annotate;
mod frame_sets;
mod merge;
mod particle_rows;
mod rows;
mod series;
mod summary;

use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use indicatif::{ProgressBar, ProgressState, ProgressStyle};
use pardalis::{Estimate, Frame, Tracker};
use pardalis_scene::Scene;
use serde::Serialize;

use crate::interrupt;
use crate::output::warn;
use crate::scene::{self, OpenScene};
use crate::source::Source;
use crate::timing::Stopwatch;
use crate::user_error::user_error;
use annotate::Annotator;
pub(crate) use frame_sets::CameraRecord;
use frame_sets::FrameSets;
pub(crate) use merge::FrameSet;
use particle_rows::ParticleRows;
use rows::Rows;
pub(crate) use series::{SeriesCollector, truth_series};

/// Where results go and what else is wanted.
#[derive(Debug, Clone)]
pub(crate) struct Options {
    /// A folder, or standard output, which takes the rows alone.
    pub(crate) output: Output,
    /// Takes the place of the scene's seed.
    pub(crate) seed: Option<u32>,
    /// Threads to track with; the CPU's number of cores where there is none.
    pub(crate) threads: Option<usize>,
    /// Whether to write annotated frames.
    pub(crate) annotate: Annotate,
    /// A file for the particles behind each estimate.
    pub(crate) particles: Option<PathBuf>,
    /// Whether to draw plots.
    pub(crate) plots: bool,
    /// Whether to show how far it is, on a terminal.
    pub(crate) progress: bool,
}

/// Whether annotated frames are written, and what they show beside estimates.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Annotate {
    /// None are written.
    No,
    /// The frame alone.
    Frame,
    /// Where the targets were in the frames before, too.
    Trails,
}

/// Where results go.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Output {
    /// All results, each in its file.
    Folder(PathBuf),
    /// The rows alone.
    Stdout,
}

/// One instant: its frames and what is known after them.
pub(crate) struct Instant<'a> {
    /// As [`FrameSet::index`].
    pub(crate) index: usize,
    /// The latest time stamp of the set, in seconds.
    pub(crate) time_s: f64,
    /// The frames, each with its camera's number.
    pub(crate) frames: &'a [(usize, Frame)],
    /// The tracker after the frames.
    pub(crate) tracker: &'a Tracker,
    /// One estimate a target.
    pub(crate) estimates: &'a [Estimate],
}

/// What takes results, instant by instant.
pub(crate) trait Sink: Send {
    /// Takes one instant; what it writes is complete when it returns.
    fn take(&mut self, instant: &Instant) -> Result<()>;
}

/// What a run came to.
#[derive(Debug, Default, Serialize)]
pub(crate) struct Outcome {
    /// Frame sets that were tracked.
    pub(crate) frame_sets: usize,
    /// How it went with each camera, in the scene's order.
    pub(crate) cameras: Vec<CameraRecord>,
    /// Whether the user stopped it.
    pub(crate) interrupted: bool,
    /// What ended it early.
    pub(crate) error: Option<String>,
    /// Seconds spent waiting for frames; they are decoded beside tracking.
    pub(crate) waiting_s: f64,
    /// Seconds spent tracking.
    pub(crate) tracking_s: f64,
    /// Seconds spent writing rows and annotated frames.
    pub(crate) writing_s: f64,
}

/// A finished run, for those who show it.
pub(crate) struct Run {
    /// The scene, as run.
    pub(crate) open: OpenScene,
    /// What it came to.
    pub(crate) outcome: Outcome,
    /// The track of each target.
    pub(crate) series: SeriesCollector,
    /// The files that were written, in the order a reader wants them.
    pub(crate) files: Vec<PathBuf>,
}

/// Makes estimates, one a target, of the frames of one instant.
pub(crate) type Step<'a> =
    &'a mut (dyn FnMut(&mut Tracker, &FrameSet) -> Result<Vec<Estimate>> + Send);

/// Tracks a scene. What was written stays, whatever ends the run; an error that ended it is given back after all files are complete.
pub(crate) fn run(scene_path: &Path, options: &Options) -> Result<Run> {
    run_scene(scene_path, scene::read(scene_path)?, options)
}

/// Tracks a scene as [`run`] does, read before from the file of that name.
pub(crate) fn run_scene(scene_path: &Path, scene: Scene, options: &Options) -> Result<Run> {
    run_steps(scene_path, scene, &[], options, &mut observe)
}

/// One step of tracking. Where every image is one that was weighed before, the state is only predicted.
fn observe(tracker: &mut Tracker, set: &FrameSet) -> Result<Vec<Estimate>> {
    let mut observe = || -> Result<Vec<Estimate>, pardalis_core::Error> {
        tracker.observe(&set.fresh()?)?;
        let estimate = |target| tracker.estimate_at(target, set.time_s);
        tracker.targets().map(estimate).collect()
    };
    observe().map_err(|error| user_error!("frame {}: {error}", set.index))
}

/// Takes a scene, read from the file of that name, through all its frames, or through `stills` in their place, by these steps. Results
/// and errors as [`run`].
pub(crate) fn run_steps(
    scene_path: &Path,
    scene: Scene,
    stills: &[PathBuf],
    options: &Options,
    step: Step,
) -> Result<Run> {
    let mut open = scene::open(scene_path, scene, options.seed, stills)?;
    interrupt::listen();
    let names: Vec<String> = open.scene.targets.iter().map(|t| t.name.clone()).collect();
    let mut rows = Rows::create(&options.output, names.clone())?;
    let mut annotator = match &options.output {
        Output::Folder(folder) if options.annotate != Annotate::No => {
            Some(Annotator::create(folder, &open.scene, options.annotate)?)
        }
        _ => None,
    };
    let mut particle_rows = match &options.particles {
        Some(path) => Some(ParticleRows::create(path, &open.scene)?),
        None => None,
    };
    let mut series = SeriesCollector::new(&names);
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(options.threads.unwrap_or(0))
        .build()
        .context("the threads cannot be started")?;
    let mut sinks: Vec<&mut dyn Sink> = vec![&mut rows, &mut series];
    if let Some(annotator) = &mut annotator {
        sinks.push(annotator);
    }
    if let Some(particle_rows) = &mut particle_rows {
        sinks.push(particle_rows);
    }
    let (outcome, ended_by) = pool.install(|| track(&mut open, step, &mut sinks, options.progress));
    let mut files = Vec::new();
    if let Output::Folder(folder) = &options.output {
        files.push(folder.join("tracks.csv"));
        files.push(summary::write(
            folder,
            scene_path,
            &open,
            &outcome,
            &series,
            pool.current_num_threads(),
        )?);
        if options.plots {
            files.extend(series.draw(folder, &open.scene, &[])?);
        }
        files.extend(annotator.map(|annotator| annotator.folder().to_owned()));
        files.extend(options.particles.clone());
    }
    match ended_by {
        Some(error) => Err(error),
        None => Ok(Run {
            open,
            outcome,
            series,
            files,
        }),
    }
}

/// The loop. Never fails: what ended it early comes back beside the outcome.
fn track(
    open: &mut OpenScene,
    step: Step,
    sinks: &mut [&mut dyn Sink],
    progress: bool,
) -> (Outcome, Option<anyhow::Error>) {
    let mut outcome = Outcome::default();
    let progress = if progress {
        progress_bar(open.sources.iter().map(Source::frame_count).max().flatten())
    } else {
        ProgressBar::hidden()
    };
    let names = open.scene.cameras.iter().map(|c| c.name.clone()).collect();
    let mut frame_sets = FrameSets::new(&mut open.sources, names, open.scene.max_delay_s);
    let ended_by = loop {
        if interrupt::requested() {
            outcome.interrupted = true;
            break Some(anyhow::anyhow!(
                "interrupted after {} frames; the rows written so far are complete",
                outcome.frame_sets
            ));
        }
        let watch = Stopwatch::start();
        let Some(set) = frame_sets.next() else {
            // Waiting for live cameras ends on request, too.
            if interrupt::requested() {
                continue;
            }
            break None;
        };
        outcome.waiting_s += watch.elapsed_s();
        progress.suspend(|| frame_sets.warnings().into_iter().for_each(warn));

        let watch = Stopwatch::start();
        let estimates = match step(&mut open.tracker, &set) {
            Ok(estimates) => estimates,
            Err(error) => break Some(error),
        };
        outcome.frame_sets += 1;
        outcome.tracking_s += watch.elapsed_s();

        let watch = Stopwatch::start();
        let instant = Instant {
            index: set.index,
            time_s: set.time_s,
            frames: &set.frames,
            tracker: &open.tracker,
            estimates: &estimates,
        };
        if let Err(error) = sinks.iter_mut().try_for_each(|sink| sink.take(&instant)) {
            break Some(error);
        }
        outcome.writing_s += watch.elapsed_s();
        progress.inc(1);
    };
    progress.finish_and_clear();
    outcome.cameras = frame_sets.records();
    let warnings = frame_sets.warnings();
    let ended_by = match ended_by {
        // Whoever read our rows has seen enough.
        Some(error) if is_broken_pipe(&error) => None,
        None if outcome.frame_sets == 0 => Some(user_error!(
            "no frame came from any camera; nothing was tracked\n  {}",
            warnings.join("\n  ")
        )),
        other => {
            warnings.into_iter().for_each(warn);
            other
        }
    };
    outcome.error = ended_by.as_ref().map(|error| format!("{error:#}"));
    (outcome, ended_by)
}

fn is_broken_pipe(error: &anyhow::Error) -> bool {
    error
        .chain()
        .filter_map(|e| e.downcast_ref::<std::io::Error>())
        .any(|e| e.kind() == std::io::ErrorKind::BrokenPipe)
}

/// A bar on a terminal; nothing elsewhere.
fn progress_bar(frames: Option<usize>) -> ProgressBar {
    let bar = match frames {
        Some(frames) => ProgressBar::new(frames as u64),
        None => ProgressBar::no_length(),
    };
    let template = if frames.is_some() {
        "tracking {bar:32} {pos}/{len} frames, {rate}, {eta} left"
    } else {
        "tracking {spinner} {pos} frames, {rate}"
    };
    let rate = |state: &ProgressState, text: &mut dyn std::fmt::Write| {
        // A bar that cannot be drawn harms nothing.
        let _ = write!(text, "{:.0} a second", state.per_sec());
    };
    match ProgressStyle::with_template(template) {
        Ok(style) => bar.with_style(style.with_key("rate", rate)),
        Err(_) => bar,
    }
}
