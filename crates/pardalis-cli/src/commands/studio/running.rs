//! A run of the scene, on a thread of its own.

use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;

use anyhow::{Context as _, Result};
use pardalis_scene::Scene;
use serde_json::{Value, json};

use super::earlier;
use super::replay::Replay;
use crate::arguments::Threads;
use crate::commands::run_report;
use crate::interrupt::Stop;
use crate::output::Shown as _;
use crate::scene;
use crate::source::{OpenCameras, Source, SourceConfig};
use crate::tracking::{
    self, Annotate, Examined, Limit, Options, Output, Previous, ROWS, Recording, Run, Watch,
};

/// A run, or what came of it.
pub(super) struct Running {
    pub(super) watch: Watch,
    pub(super) stop: Stop,
    folder: PathBuf,
    recording: Option<Recording>,
    outcome: Arc<Mutex<Option<Outcome>>>,
    pub(super) thread: Option<JoinHandle<()>>,
}

/// What a run does beside tracking.
pub(super) struct Wanted {
    /// Where the images of live cameras are kept.
    pub(super) recording: Option<Recording>,
    /// Whether the track is smoothed at the end.
    pub(super) smooth: bool,
    /// Whether a page with pictures is written, as by `track --annotate --report`.
    pub(super) page: bool,
}

/// What came of a run.
#[derive(Debug, Clone)]
enum Outcome {
    Done(Done),
    /// Why it failed.
    Failed(String),
}

/// A run that has results.
#[derive(Debug, Clone, Default)]
struct Done {
    /// The results in words.
    text: String,
    /// The radii that the cameras estimated.
    radii: Value,
    /// The earlier runs.
    earlier: Value,
    /// The targets at the end of a smoothed run.
    smoothed: Option<Value>,
    replay: Option<Arc<Replay>>,
}

impl Running {
    /// Starts a run, with the live cameras that are open already. `ended` gets those that are open at its end.
    pub(super) fn start(
        path: &Path,
        scene: Scene,
        watch: Watch,
        wanted: Wanted,
        open: Vec<(SourceConfig, Source)>,
        ended: impl FnOnce(Vec<(SourceConfig, Source)>) + Send + 'static,
    ) -> Result<Self> {
        let Wanted {
            recording,
            smooth,
            page,
        } = wanted;
        let stem = path.file_stem().unwrap_or_default().to_string_lossy();
        let folder = path.with_file_name(format!("{stem}-tracks"));
        watch.begin(scene.cameras.iter().map(|camera| &*camera.name));
        let stop = Stop::default();
        let outcome = Arc::new(Mutex::new(None));
        let examined = Examined::default();
        let options = Options {
            output: Output::Folder(folder.clone()),
            seed: None,
            threads: Threads::default(),
            annotate: if page { Annotate::Trails } else { Annotate::No },
            // The pictures of the page are for others.
            explain: !page,
            particles: None,
            mcap: None,
            send: Vec::new(),
            smooth,
            plots: true,
            report: page,
            progress: false,
            previous: Previous::Number,
            limit: Limit::default(),
            stop: stop.clone(),
            watch: Some(
                watch
                    .clone()
                    .recorded(recording.clone())
                    .examined(examined.clone()),
            ),
        };
        let (path, stopped) = (path.to_owned(), stop.clone());
        let recorded = recording.clone();
        let (result, results) = (Arc::clone(&outcome), folder.clone());
        let shown = watch.clone();
        let thread = std::thread::Builder::new()
            .name("run".to_owned())
            .spawn(move || {
                let mut live = OpenCameras {
                    stop: stopped.clone(),
                    open,
                };
                let mut run = scene::open_with(&path, scene, None, &[], &mut live)
                    .and_then(|open| tracking::run_open(&path, open, &options));
                let open = run.as_mut().map(|run| run.open.take_live(&path));
                let open = open.unwrap_or_default();
                recorded.iter().for_each(Recording::finish);
                let outcome = match run {
                    Ok(run) => {
                        let rows = results.join(ROWS);
                        if let (true, Ok(text)) = (smooth, std::fs::read_to_string(&rows)) {
                            shown.replace_rows(&text);
                        }
                        let text = format!(
                            "{}\n{}",
                            run_report::warnings(&run),
                            run_report::summary(&run)
                        );
                        let radii = radii_of(&run);
                        // Without rows there is nothing to replay.
                        let replay = Replay::of(run, &rows, examined).ok().map(Arc::new);
                        Outcome::Done(Done {
                            text,
                            radii,
                            earlier: earlier::list(&results),
                            smoothed: replay.as_ref().filter(|_| smooth).map(|one| one.last()),
                            replay,
                        })
                    }
                    // It has results nevertheless.
                    Err(error) if stopped.is_requested() => Outcome::Done(Done {
                        text: format!("{error:#}"),
                        earlier: earlier::list(&results),
                        ..Done::default()
                    }),
                    Err(error) => Outcome::Failed(format!("{error:#}")),
                };
                *result.lock().unwrap_or_else(PoisonError::into_inner) = Some(outcome);
                ended(open);
            });
        Ok(Self {
            watch,
            stop,
            folder,
            recording,
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

    /// Returns what is replayed once it has ended.
    pub(super) fn replay(&self) -> Option<Arc<Replay>> {
        match self.outcome()? {
            Outcome::Done(done) => done.replay,
            Outcome::Failed(_) => None,
        }
    }

    /// The recording of its images.
    pub(super) fn recording(&self) -> Option<&Recording> {
        self.recording.as_ref()
    }

    /// The folder of its results.
    pub(super) fn folder(&self) -> &Path {
        &self.folder
    }

    /// Returns what the page shows of it.
    pub(super) fn about(&self) -> Value {
        let (done, failed) = match self.outcome() {
            Some(Outcome::Done(done)) => (Some(done), None),
            Some(Outcome::Failed(text)) => (None, Some(text)),
            None => (None, None),
        };
        let mut about = json!({
            "goes_on": done.is_none() && failed.is_none(),
            "folder": self.folder.shown(),
            "error": failed,
            "recording": self.recording.as_ref().map(Recording::about),
        });
        if let Some(done) = done {
            about["report"] = json!(done.text.trim());
            about["radii"] = done.radii;
            about["earlier"] = done.earlier;
            about["smoothed"] = json!(done.smoothed);
            about["can_replay"] = json!(done.replay.is_some());
        }
        about
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
