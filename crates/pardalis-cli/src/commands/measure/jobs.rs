//! Parallel tracking of seeds, one thread each; timed seeds run alone.

use std::path::{Path, PathBuf};
use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};

use anyhow::{Context as _, Result, anyhow};
use indicatif::{ProgressBar, ProgressStyle};
use pardalis_scene::Scene;
use pardalis_scene::experiment::{Method, Run};

use super::finished::Finished;
use crate::arguments::Threads;
use crate::commands::locate;
use crate::interrupt::{self, Stop};
use crate::tracking::{self, Annotate, Limit, Options, Output, Previous};

/// One seed of a run to be tracked.
pub(super) struct Job<'a> {
    pub(super) run: &'a Run,
    /// The file from which the scene was read.
    pub(super) scene_path: &'a Path,
    pub(super) scene: &'a Scene,
    /// Settings for single images; `None` for tracking.
    pub(super) located_from: Option<&'a locate::Settings>,
    pub(super) seed: u32,
    /// The folder for the results.
    pub(super) folder: PathBuf,
    pub(super) fingerprint: String,
}

impl Job<'_> {
    fn track(&self) -> Result<()> {
        Finished::remove(&self.folder)?;
        let options = Options {
            output: Output::Folder(self.folder.clone()),
            seed: Some(self.seed),
            threads: Threads::ONE,
            annotate: Annotate::No,
            explain: false,
            particles: None,
            mcap: None,
            send: Vec::new(),
            smooth: self.run.method == Method::Smooth,
            plots: false,
            report: false,
            progress: false,
            previous: Previous::Replace,
            limit: Limit::default(),
            stop: Stop::default(),
            watch: None,
        };
        let scene = self.scene.clone();
        let outcome = match self.located_from {
            None => tracking::run_scene(self.scene_path, scene, &options)?.outcome,
            Some(settings) => {
                let (run, _) = locate::locate(self.scene_path, scene, &options, settings)?;
                run.outcome
            }
        };
        let finished = Finished {
            fingerprint: self.fingerprint.clone(),
            ms_a_frame: (self.run.timed)
                .then(|| 1e3 * outcome.tracking_s / outcome.frame_sets as f64),
        };
        finished.write(&self.folder)
    }
}

/// Tracks all seeds with this number of threads, in the order of the list, except that timed seeds run last and one
/// at a time.
///
/// Stops on Ctrl-C and after the first failure; finished seeds are kept.
pub(super) fn track_all(jobs: &[Job], threads: usize) -> Result<()> {
    interrupt::listen();
    let bar = progress_bar(jobs.len());
    let done_count = AtomicUsize::new(0);
    let (timed, others): (Vec<&Job>, Vec<&Job>) = jobs.iter().partition(|job| job.run.timed);
    let done = track_with(&others, threads, &bar, &done_count)
        .and_then(|()| track_with(&timed, 1, &bar, &done_count));
    bar.finish_and_clear();
    if done.is_err() && interrupt::requested() {
        return Err(anyhow!(
            "interrupted: {} of {} seeds are tracked and kept; the same command resumes the experiment",
            done_count.load(Ordering::Relaxed),
            jobs.len()
        ));
    }
    done
}

/// Adds the number of tracked seeds to `done_count`.
fn track_with(
    jobs: &[&Job],
    threads: usize,
    bar: &ProgressBar,
    done_count: &AtomicUsize,
) -> Result<()> {
    let next = AtomicUsize::new(0);
    let failures = Mutex::new(Vec::new());
    let work = || {
        while let Some((number, job)) = {
            let number = next.fetch_add(1, Ordering::Relaxed);
            jobs.get(number).map(|job| (number, job))
        } {
            bar.set_message(format!("{}, seed {}", job.run.name, job.seed));
            match job.track() {
                Ok(()) => {
                    done_count.fetch_add(1, Ordering::Relaxed);
                    bar.inc(1);
                }
                Err(error) => {
                    let error = error.context(format!("run \"{}\"", job.run.name));
                    if let Ok(mut failures) = failures.lock() {
                        failures.push((number, error));
                    }
                    next.store(jobs.len(), Ordering::Relaxed);
                }
            }
        }
    };
    std::thread::scope(|scope| {
        for _ in 0..threads.min(jobs.len()) {
            scope.spawn(work);
        }
    });
    let mut failures = failures.into_inner().context("a thread has failed")?;
    // Report the first of the list, whichever thread was faster.
    failures.sort_by_key(|(number, _)| *number);
    match failures.into_iter().next() {
        Some((_, error)) => Err(error),
        None => Ok(()),
    }
}

/// Returns a progress bar on a terminal and a hidden one elsewhere.
fn progress_bar(seeds: usize) -> ProgressBar {
    let bar = ProgressBar::new(seeds as u64);
    match ProgressStyle::with_template("{bar:32} {pos}/{len} seeds, {eta} left: {msg}") {
        Ok(style) => bar.with_style(style),
        Err(_) => bar,
    }
}
