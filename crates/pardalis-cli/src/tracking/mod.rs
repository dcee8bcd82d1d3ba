//! Tracking: frames of all cameras in time order, through the tracker, to the sinks.

pub(crate) mod agreement;
mod annotate;
mod camera_rows;
mod candidate_rows;
mod crossing_rows;
mod doubts;
#[cfg(feature = "studio")]
mod earlier;
#[cfg(feature = "studio")]
mod examined;
mod extras;
mod frame_sets;
mod latency;
mod marks;
mod merge;
pub(crate) mod missed;
mod particle_rows;
#[cfg(feature = "studio")]
mod pictures;
mod previous;
pub(crate) mod radius;
#[cfg_attr(not(feature = "mcap"), path = "without_recorder.rs")]
mod recorder;
#[cfg(feature = "studio")]
mod recording;
mod rows;
mod sender;
mod series;
mod smoothed;
mod summary;
mod tracked;
#[cfg_attr(not(feature = "studio"), path = "without_watch.rs")]
mod watch;

use std::fs::{File, TryLockError};
use std::path::{Path, PathBuf};

use anyhow::Result;
use indicatif::{ProgressBar, ProgressState, ProgressStyle};
use pardalis::{Frame, Tracker};
use pardalis_scene::{BodyConfig, Scene, TargetConfig};
use serde::Serialize;

use crate::arguments::Threads;
use crate::detections::Detections;
use crate::draw::plots::TRACK_PLOTS;
use crate::files::{refuse_links, unwritable};
use crate::interrupt::{self, Stop};
use crate::measurements;
use crate::output::{Shown, warn};
use crate::platforms;
use crate::report::{self, PageCamera, PageScene};
use crate::scene::{self, OpenScene};
use crate::source::Source;
use crate::timing::Stopwatch;
use crate::user_error::user_error;
use camera_rows::CameraRows;
use candidate_rows::CandidateRows;
use crossing_rows::CrossingRows;
use doubts::Doubts;
#[cfg(feature = "studio")]
pub(crate) use earlier::earlier_runs;
use extras::Extras;
pub(crate) use frame_sets::CameraRecord;
use frame_sets::FrameSets;
use latency::{Latencies, Latency};
pub(crate) use merge::{FrameSet, Limit, Merge};
use missed::MissedFrames;
pub(crate) use previous::{is_previous, previous_of};
#[cfg(feature = "studio")]
pub(crate) use recording::{RecordedCamera, Recording};
use rows::Rows;
pub(crate) use sender::Destination;
pub(crate) use series::{CrowdCounts, SeriesCollector, truth_series};
use smoothed::SmoothedTracks;
pub(crate) use summary::FILE as SUMMARY;
pub(crate) use tracked::Tracked;
pub(crate) use watch::Watch;
#[cfg(feature = "studio")]
pub(crate) use {
    examined::Examined, marks::CONTOUR_POINTS, watch::noted as note_written,
    watch::written as mark_written,
};

/// Where results go, and optional outputs.
#[derive(Debug, Clone)]
#[allow(clippy::struct_excessive_bools)] // flags of the command line
pub(crate) struct Options {
    /// A folder, or standard output, which receives only the rows.
    pub(crate) output: Output,
    /// Overrides the scene's seed.
    pub(crate) seed: Option<u32>,
    pub(crate) threads: Threads,
    /// Whether to write annotated frames.
    pub(crate) annotate: Annotate,
    /// Whether to write what was examined, and to draw it into annotated frames; needs a folder.
    pub(crate) explain: bool,
    /// A file for the particles of each estimate.
    pub(crate) particles: Option<PathBuf>,
    /// An MCAP recording of images and estimates.
    pub(crate) mcap: Option<PathBuf>,
    /// Where estimates are sent while tracking.
    pub(crate) send: Vec<Destination>,
    /// Whether to smooth the tracks at the end; needs a folder.
    pub(crate) smooth: bool,
    /// Whether to draw plots.
    pub(crate) plots: bool,
    /// Whether to write a page that shows the tracks; needs a folder.
    pub(crate) report: bool,
    /// Whether to show a progress bar on a terminal.
    pub(crate) progress: bool,
    /// What becomes of the rows of an earlier run in the same place, and of their summary.
    pub(crate) previous: Previous,
    /// When to end before the frames do.
    pub(crate) limit: Limit,
    /// Ends the run as an interrupt does.
    pub(crate) stop: Stop,
    /// What shows the run while it goes on.
    pub(crate) watch: Option<Watch>,
}

/// Whether to write annotated frames, and what they show beside estimates.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Annotate {
    /// No annotated frames.
    No,
    /// Only the present estimates.
    Frame,
    /// Also the targets' past positions.
    Trails,
}

/// What becomes of results of an earlier run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Previous {
    /// They are kept under another name.
    Keep,
    /// They are kept in a numbered folder, with those of runs before it.
    #[cfg(feature = "studio")]
    Number,
    /// They are replaced, because they can be computed again.
    Replace,
}

/// Destination of results.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Output {
    /// All results, each in its file.
    Folder(PathBuf),
    /// Only the rows.
    Stdout,
}

/// One time: its frames and the state after them.
pub(crate) struct Instant<'a> {
    /// See [`FrameSet::index`].
    pub(crate) index: usize,
    /// The latest time stamp of the set, in seconds.
    pub(crate) time_s: f64,
    /// See [`FrameSet::captured_s`].
    captured_s: Option<f64>,
    /// The frames, each with its camera's index.
    pub(crate) frames: &'a [(usize, Frame)],
    /// The tracker after the frames.
    pub(crate) tracker: &'a Tracker,
    /// Each target, and each member of a crowd that is there.
    pub(crate) tracked: &'a [Tracked],
    /// How long tracking took, in seconds.
    #[cfg(feature = "studio")]
    pub(crate) tracking_s: f64,
}

impl Instant<'_> {
    /// Returns the first cells of a row about one body of a target, or about a member of it: frame, time, target and, if there are several, the landmark.
    fn row_labels(&self, target: &TargetConfig, body: &BodyConfig, member: Option<u32>) -> String {
        let landmark = if target.bodies.len() > 1 {
            body.name.as_str()
        } else {
            ""
        };
        let name = tracked::name(&target.name, member);
        format!("{},{},{name},{landmark}", self.index, self.time_s)
    }

    /// Returns the bodies of a target of this number, each with its number among them and, if it is one, that of the member of a crowd.
    fn bodies<'t>(
        &self,
        number: usize,
        target: &'t TargetConfig,
    ) -> impl Iterator<Item = (usize, &'t BodyConfig, Option<u32>)> {
        let members = self.tracked.iter().filter(move |one| one.target == number);
        let is_crowd = target.crowd.is_some();
        let members = members.filter(move |_| is_crowd);
        let members = members.map(|one| (one.place, &target.bodies[0], one.member));
        let bodies = target.bodies.iter().enumerate();
        let bodies = bodies.filter(move |_| !is_crowd);
        members.chain(bodies.map(|(place, body)| (place, body, None)))
    }
}

/// Receives the results, one time after another.
pub(crate) trait Sink: Send {
    /// Takes one time; its output is complete on return.
    fn take(&mut self, instant: &Instant) -> Result<()>;
}

/// Outcome of a run.
#[derive(Debug, Default, Serialize)]
pub(crate) struct Outcome {
    /// Number of frame sets that were tracked.
    pub(crate) frame_sets: usize,
    /// Statistics of each camera, in the scene's order.
    pub(crate) cameras: Vec<CameraRecord>,
    /// Whether the user interrupted it.
    pub(crate) interrupted: bool,
    /// Whether it ended because its limit was reached.
    pub(crate) limit_reached: bool,
    /// Whether no camera has further frames, or the limit is reached.
    pub(crate) is_at_end: bool,
    /// The error that ended it early.
    pub(crate) error: Option<String>,
    /// Seconds spent waiting for frames, which are decoded in parallel.
    pub(crate) waiting_s: f64,
    /// Seconds spent tracking.
    pub(crate) tracking_s: f64,
    /// Seconds spent writing rows and annotated frames.
    pub(crate) writing_s: f64,
    /// Of live cameras: the time from the capture of images until all results of them were written, shown or handed over for sending.
    pub(crate) latency: Option<Latency>,
}

/// A finished run.
pub(crate) struct Run {
    /// The file of the scene.
    pub(crate) scene_path: PathBuf,
    /// The scene as it was run.
    pub(crate) open: OpenScene,
    /// Its outcome.
    pub(crate) outcome: Outcome,
    /// The track of each target.
    pub(crate) series: SeriesCollector,
    /// Why targets were not found.
    pub(crate) missed: MissedFrames,
    /// What is doubtful where they were.
    pub(crate) doubts: Doubts,
    /// How many estimates were sent where, in words.
    pub(crate) sent: Vec<String>,
    /// The files that were written, the most important first.
    pub(crate) files: Vec<PathBuf>,
}

/// Computes the estimates of all targets from the frames of one time.
pub(crate) type Step<'a> =
    &'a mut (dyn FnMut(&mut Tracker, &FrameSet) -> Result<Vec<Tracked>> + Send);

/// Tracks a scene. Output that was written stays, whatever ends the run; an error that ended it is returned after all
/// files are complete.
pub(crate) fn run(scene_path: &Path, options: &Options) -> Result<Run> {
    run_scene(scene_path, scene::read(scene_path)?, options)
}

/// Tracks like [`run`] a scene that has been read from the file of that name.
pub(crate) fn run_scene(scene_path: &Path, scene: Scene, options: &Options) -> Result<Run> {
    run_open(
        scene_path,
        scene::open(scene_path, scene, options.seed, &[])?,
        options,
    )
}

/// Tracks like [`run`] a scene that has been read from the file of that name and opened.
pub(crate) fn run_open(scene_path: &Path, mut open: OpenScene, options: &Options) -> Result<Run> {
    let targets = open.scene.targets.clone();
    let detections = std::mem::take(&mut open.detections);
    let mut step =
        |tracker: &mut Tracker, set: &FrameSet| observe(tracker, &targets, set, &detections);
    run_steps(scene_path, open, options, &mut step)
}

/// Runs one step of tracking. If every image is frozen, the state is only predicted.
fn observe(
    tracker: &mut Tracker,
    targets: &[TargetConfig],
    set: &FrameSet,
    detections: &Detections,
) -> Result<Vec<Tracked>> {
    let mut observe = || -> Result<Vec<Tracked>, pardalis_core::Error> {
        tracker.observe(&set.without_frozen(detections)?)?;
        Tracked::all(tracker, targets, set.time_s)
    };
    observe().map_err(|error| user_error!("frame {}: {error}", set.index))
}

/// Runs these steps over all frames of a scene that has been read from the file of that name and opened. Results and errors
/// are those of [`run`].
pub(crate) fn run_steps(
    scene_path: &Path,
    mut open: OpenScene,
    options: &Options,
    step: Step,
) -> Result<Run> {
    interrupt::listen();
    // Until the end.
    let _lock = make_way(options, &open.scene, scene_path)?;
    let mut rows = Rows::create(&options.output, open.scene.targets.clone())?;
    if let Output::Folder(folder) = &options.output {
        remove_old(folder);
    }
    let mut crossing_rows = CrossingRows::create(&options.output, &open.scene)?;
    let mut camera_rows = CameraRows::create(&options.output, &open.scene)?;
    let mut extras = Extras::create(scene_path, &open, options)?;
    let mut series = SeriesCollector::new(&open.scene);
    let mut smoothed = options.smooth.then(|| SmoothedTracks::new(&open.scene));
    let mut missed = MissedFrames::of(&open.scene);
    let mut doubts = Doubts::of(&open.scene);
    let pool = options.threads.start()?;
    let mut sinks = Sinks {
        needed: vec![&mut rows, &mut series, &mut missed, &mut doubts],
        others: extras.sinks(),
    };
    if let Some(smoothed) = &mut smoothed {
        sinks.needed.push(smoothed);
    }
    if let Some(crossing_rows) = &mut crossing_rows {
        sinks.needed.push(crossing_rows);
    }
    if let Some(camera_rows) = &mut camera_rows {
        sinks.needed.push(camera_rows);
    }
    let (outcome, ended_by) = pool.install(|| track(&mut open, step, sinks, options));
    let (sent, extra_files, recorded) = extras.finish(options);
    let mut files = Vec::new();
    let finish = || -> Result<()> {
        let Output::Folder(folder) = &options.output else {
            return Ok(());
        };
        files.push(folder.join("tracks.csv"));
        if let Some(smoothed) = &mut smoothed {
            for name in smoothed.smooth() {
                warn(format!(
                    "targets.{name}: cannot be smoothed, and its rows are those of the filter: only targets of one body that are detected can"
                ));
            }
            if let Some(warning) = smoothed.guesses_warning(&open.scene) {
                warn(warning);
            }
            files.extend(smoothed.write(folder)?);
            series.replace(smoothed.samples());
        }
        files.push(summary::write(
            folder,
            scene_path,
            &open,
            &outcome,
            (&series, &missed, &doubts),
            (pool.current_num_threads(), smoothed.is_some()),
        )?);
        if options.plots {
            files.extend(series.draw(folder, &open.scene, &[])?);
        }
        files.extend(crossing_rows.map(|rows| rows.path().to_owned()));
        files.extend(camera_rows.map(|rows| rows.path().to_owned()));
        files.extend(extra_files);
        if options.report {
            files.push(write_report(folder, scene_path, &open, &series)?);
        }
        Ok(())
    };
    let finished = finish();
    // What ended the run is the cause of what follows, such as of a summary that a full disk does not take either.
    ended_by.map_or(finished.and(recorded), Err)?;
    Ok(Run {
        scene_path: scene_path.to_owned(),
        open,
        outcome,
        series,
        missed,
        doubts,
        sent,
        files,
    })
}

/// Writes the page of the results in a folder, and returns its name.
fn write_report(
    folder: &Path,
    scene_path: &Path,
    open: &OpenScene,
    series: &SeriesCollector,
) -> Result<PathBuf> {
    let views = open.tracker.views().iter().enumerate();
    let cameras = views.map(|(number, view)| PageCamera {
        size_px: Some(view.size()),
        path: series.poses(number).to_vec(),
    });
    let cameras: Vec<_> = cameras.collect();
    let scene = PageScene::new(report::title(scene_path), &open.scene, &cameras);
    let summary = serde_json::from_slice(&std::fs::read(folder.join(summary::FILE))?)?;
    let (path, rows) = (folder.join(report::REPORT), folder.join(ROWS));
    // A crowd without members has none.
    let rows = previous::has_rows(&rows).then_some(&*rows);
    report::write(
        &path,
        (rows, folder),
        scene,
        Some(&summary),
        None,
        Vec::new(),
    )?;
    Ok(path)
}

/// Makes sure that results replace nothing but those of an earlier run, and keeps its rows if that is asked for. Returns the lock of their folder.
fn make_way(options: &Options, scene: &Scene, scene_path: &Path) -> Result<Option<File>> {
    if let Some(mcap) = &options.mcap {
        recorder::check_path(mcap, scene, scene_path)?;
    }
    let folder = match &options.output {
        Output::Folder(folder) => Some(&**folder),
        Output::Stdout => None,
    };
    if let Some(folder) = folder {
        refuse_links(folder)?;
    }
    if let Some(particles) = &options.particles {
        particle_rows::check_path(particles, folder, &RESULTS)?;
    }
    let lock = folder.map(occupy).transpose()?.flatten();
    #[cfg(feature = "studio")]
    if let (Previous::Number, Some(folder)) = (options.previous, folder) {
        earlier::number_results(folder)?;
    }
    if options.previous == Previous::Keep {
        if let Some(folder) = folder {
            previous::keep_results(folder)?;
        }
        if let Some(particles) = &options.particles {
            previous::keep_rows(particles)?;
        }
    }
    Ok(lock)
}

/// Creates the folder of the results, and locks it while what is returned lives; `None` where folders cannot be locked.
///
/// Errors: another run has locked it; it is a file; it cannot be created.
fn occupy(folder: &Path) -> Result<Option<File>> {
    if folder.is_file() {
        return Err(user_error!(
            "-o {}: this is a file; give a folder",
            folder.shown()
        ));
    }
    std::fs::create_dir_all(folder).map_err(|error| unwritable(folder, error))?;
    let Ok(opened) = File::open(folder) else {
        return Ok(None);
    };
    match opened.try_lock() {
        Ok(()) => Ok(Some(opened)),
        Err(TryLockError::WouldBlock) => Err(user_error!(
            "{}: another run is writing its results there; give another folder with -o, or wait until it has ended",
            folder.shown()
        )),
        Err(TryLockError::Error(_)) => Ok(None),
    }
}

/// The file of the rows.
pub(crate) const ROWS: &str = "tracks.csv";

/// The folder of numbered earlier runs among the results, which the studio moves there.
pub(crate) const EARLIER: &str = "earlier";

/// The file of the poses of cameras that move.
pub(crate) const CAMERAS: &str = CameraRows::FILE;

/// The files of results in a folder, besides pictures and particles.
const RESULTS: [&str; 10] = [
    ROWS,
    CAMERAS,
    summary::FILE,
    CandidateRows::FILE,
    CrossingRows::FILE,
    smoothed::FILTERED,
    smoothed::EVENTS,
    report::REPORT,
    report::VIEW,
    report::COMPARISON,
];

/// Removes the summary, the pictures, the pages, the candidates, the unsmoothed rows, the events and the particles of an earlier run, which would not be of
/// the new rows.
fn remove_old(folder: &Path) {
    let plots = TRACK_PLOTS
        .iter()
        .flat_map(|name| ["svg", "png"].map(|ending| format!("{name}.{ending}")));
    let particles = particle_rows::files_in(folder).into_iter();
    let particles = particles.filter(|file| !previous::is_previous(file));
    // The rows of this run are there already.
    let others = RESULTS.iter().filter(|name| **name != ROWS);
    let names = plots.chain(others.map(|&name| name.to_owned()));
    for file in names.map(|name| folder.join(name)).chain(particles) {
        // Usually there is none.
        let _ = std::fs::remove_file(file);
    }
    annotate::remove_old(folder);
}

/// Everything that takes the results of a run.
struct Sinks<'a> {
    /// A failure of one of these ends the run.
    needed: Vec<&'a mut dyn Sink>,
    /// Those that have not failed yet.
    others: Vec<&'a mut dyn Sink>,
}

impl Sinks<'_> {
    /// Passes one time on. Fails if a sink that is needed does, or if a reader has closed its pipe. Another sink that fails
    /// gets no further time and must not cost rows; its error is added to `failures`.
    fn take(&mut self, instant: &Instant, failures: &mut Vec<anyhow::Error>) -> Result<()> {
        for sink in &mut self.needed {
            sink.take(instant)?;
        }
        let mut closed = None;
        self.others.retain_mut(|sink| match sink.take(instant) {
            Ok(()) => true,
            Err(error) if is_broken_pipe(&error) => {
                closed = Some(error);
                false
            }
            Err(error) => {
                failures.push(error);
                false
            }
        });
        closed.map_or(Ok(()), Err)
    }
}

/// The main loop. Never fails: an error that ended it early is part of the outcome.
fn track(
    open: &mut OpenScene,
    step: Step,
    mut sinks: Sinks,
    options: &Options,
) -> (Outcome, Option<anyhow::Error>) {
    let mut outcome = Outcome::default();
    let progress = if options.progress {
        let frames = open.sources.iter().map(Source::frame_count).max().flatten();
        let limit = options.limit.frame_sets;
        progress_bar(frames.into_iter().chain(limit).min())
    } else {
        ProgressBar::hidden()
    };
    let names = open.scene.cameras.iter().map(|c| c.name.clone()).collect();
    let is_live = open.sources.iter().any(Source::is_live);
    let mut failures = Vec::new();
    let mut latencies = Latencies::new();
    let delay_s = open.scene.max_delay_s;
    let mut frame_sets = FrameSets::new(
        &mut open.sources,
        names,
        delay_s,
        options.limit,
        options.stop.clone(),
    );
    let ended_by = loop {
        if options.stop.is_requested() {
            outcome.interrupted = true;
            // Nothing else ends most live sessions.
            if is_live && outcome.frame_sets > 0 {
                break None;
            }
            break Some(anyhow::anyhow!(
                "interrupted after {} frames; the rows written so far are complete",
                outcome.frame_sets
            ));
        }
        let watch = Stopwatch::start();
        let Some(set) = frame_sets.next() else {
            // An interrupt also ends the wait for live cameras.
            if options.stop.is_requested() {
                continue;
            }
            outcome.is_at_end = true;
            break None;
        };
        outcome.waiting_s += watch.elapsed_s();
        let news = platforms::news(&mut open.platforms);
        let warnings = frame_sets.warnings().into_iter().chain(news);
        progress.suspend(|| warnings.for_each(warn));

        let watch = Stopwatch::start();
        let (platforms, tracker) = (&mut open.platforms, &mut open.tracker);
        let told = platforms::tell(platforms, tracker, set.time_s, set.least_delay_s)
            .and_then(|()| measurements::tell(&mut open.measurements, tracker, set.time_s));
        if let Err(error) = told {
            break Some(error);
        }
        let tracked = match step(&mut open.tracker, &set) {
            Ok(tracked) => tracked,
            Err(error) => break Some(error),
        };
        outcome.frame_sets += 1;
        let tracking_s = watch.elapsed_s();
        outcome.tracking_s += tracking_s;

        let watch = Stopwatch::start();
        let instant = Instant {
            index: set.index,
            time_s: set.time_s,
            captured_s: set.captured_s,
            frames: &set.frames,
            tracker: &open.tracker,
            tracked: &tracked,
            #[cfg(feature = "studio")]
            tracking_s,
        };
        let failed_before = failures.len();
        if let Err(error) = sinks.take(&instant, &mut failures) {
            break Some(error);
        }
        for failure in &failures[failed_before..] {
            progress.suspend(|| warn(format!("{failure:#}; the rows go on without it")));
        }
        outcome.writing_s += watch.elapsed_s();
        if let Some(captured_s) = set.captured_s {
            latencies.take(captured_s);
        }
        progress.inc(1);
    };
    progress.finish_and_clear();
    outcome.latency = latencies.summary();
    outcome.limit_reached = frame_sets.is_over();
    outcome.cameras = frame_sets.records();
    let warnings = frame_sets.warnings();
    let ended_by = match ended_by {
        // The reader of the rows has closed the pipe deliberately.
        Some(error) if is_broken_pipe(&error) => None,
        None if outcome.frame_sets == 0 => Some(user_error!(
            "no frame came from any camera; nothing was tracked\n  {}",
            warnings.join("\n  ")
        )),
        other => {
            warnings.into_iter().for_each(warn);
            other.or_else(|| failures.into_iter().next())
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

/// Returns a progress bar on a terminal and a hidden one elsewhere.
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
        // A failure to format the rate is harmless.
        let _ = write!(text, "{:.0} per second", state.per_sec());
    };
    match ProgressStyle::with_template(template) {
        Ok(style) => bar.with_style(style.with_key("rate", rate)),
        Err(_) => bar,
    }
}
