//! A run of the scene, on a thread of its own.

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;

use anyhow::{Context as _, Result};
use pardalis_scene::Scene;
use serde_json::{Value, json};

use crate::arguments::Threads;
use crate::commands::run_report;
use crate::interrupt::Stop;
use crate::output::Shown as _;
use crate::tracking::{self, Annotate, Limit, Options, Output, Previous, Run, Watch};

/// A run, or what came of it.
pub(super) struct Running {
    pub(super) watch: Watch,
    pub(super) stop: Stop,
    /// The folder of its results.
    folder: PathBuf,
    outcome: Arc<Mutex<Option<Outcome>>>,
    pub(super) thread: Option<JoinHandle<()>>,
}

/// What came of a run.
#[derive(Debug, Clone)]
enum Outcome {
    /// The results, in words, and the radii that the cameras estimated.
    Done(String, Value),
    /// Why it failed.
    Failed(String),
}

impl Running {
    pub(super) fn start(
        path: &Path,
        scene: Scene,
        watch: Watch,
        ended: impl FnOnce() + Send + 'static,
    ) -> Result<Self> {
        let stem = path.file_stem().unwrap_or_default().to_string_lossy();
        let folder = path.with_file_name(format!("{stem}-tracks"));
        let stop = Stop::default();
        let outcome = Arc::new(Mutex::new(None));
        let options = Options {
            output: Output::Folder(folder.clone()),
            seed: None,
            threads: Threads::default(),
            annotate: Annotate::No,
            explain: true,
            particles: None,
            mcap: None,
            send: Vec::new(),
            smooth: false,
            plots: true,
            report: false,
            progress: false,
            previous: Previous::Keep,
            limit: Limit::default(),
            stop: stop.clone(),
            watch: Some(watch.clone()),
        };
        let (path, stopped) = (path.to_owned(), stop.clone());
        let result = Arc::clone(&outcome);
        let thread = std::thread::Builder::new()
            .name("run".to_owned())
            .spawn(move || {
                let run = tracking::run_scene(&path, scene, &options);
                let outcome = match run {
                    Ok(run) => Outcome::Done(
                        format!(
                            "{}\n{}",
                            run_report::warnings(&run),
                            run_report::summary(&run)
                        ),
                        radii_of(&run),
                    ),
                    // It has results nevertheless.
                    Err(error) if stopped.is_requested() => {
                        Outcome::Done(format!("{error:#}"), json!([]))
                    }
                    Err(error) => Outcome::Failed(format!("{error:#}")),
                };
                *result.lock().unwrap_or_else(PoisonError::into_inner) = Some(outcome);
                ended();
            });
        Ok(Self {
            watch,
            stop,
            folder,
            outcome,
            thread: Some(thread.context("no further thread can be started")?),
        })
    }

    fn outcome(&self) -> Option<Outcome> {
        let outcome = self.outcome.lock().unwrap_or_else(PoisonError::into_inner);
        outcome.clone()
    }

    /// Reports whether it has not ended yet.
    pub(super) fn goes_on(&self) -> bool {
        self.outcome().is_none()
    }

    /// Returns what the page shows of it.
    pub(super) fn about(&self) -> Value {
        let (done, radii, failed) = match self.outcome() {
            Some(Outcome::Done(text, radii)) => (Some(text), radii, None),
            Some(Outcome::Failed(text)) => (None, json!([]), Some(text)),
            None => (None, json!([]), None),
        };
        json!({
            "goes_on": self.goes_on(),
            "folder": self.folder.shown(),
            "report": done.map(|text| text.trim().to_owned()),
            "radii": radii,
            "error": failed,
        })
    }
}

/// Returns the radii that the cameras estimated, and whether they contradict the scene.
fn radii_of(run: &Run) -> Value {
    let numbers = 0..run.open.scene.targets.len();
    let radii = numbers.flat_map(|number| run_report::radii(run, number));
    let radii = radii.map(|radius| {
        json!({
            "key": radius.key,
            "radius_m": radius.estimate.radius_m,
            "sigma_m": radius.estimate.sigma_m,
            "is_contradicted": radius.contradicted_m().is_some(),
        })
    });
    radii.collect()
}
