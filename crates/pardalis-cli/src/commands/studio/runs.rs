//! Runs of the scene of a session.

use std::path::{Path, PathBuf};
use std::sync::{Arc, Weak};

use anyhow::Result;
use pardalis_scene::Scene;
use serde::Deserialize;
use serde_json::{Value, json};

use super::earlier;
use super::edits::with_images;
use super::replay::Replay;
use super::running::{Running, Wanted};
use super::session::Session;
use super::waved::Waved;
use crate::commands::view;
use crate::output::Shown as _;
use crate::scene;
use crate::tracking::{RecordedCamera, Recording, Watch};
use crate::user_error::user_error;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct OtherRun {
    /// The number of an earlier run; none to compare with none.
    run: Option<usize>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Tracked {
    /// Whether the images of live cameras are kept.
    #[serde(default)]
    record: bool,
    /// Whether the track is smoothed at the end.
    #[serde(default)]
    smooth: bool,
    /// Whether a page with pictures is written.
    #[serde(default)]
    page: bool,
}

/// Begins the recording of the live cameras of a scene, beside its file.
fn recording(scene: &Scene, path: &Path) -> Result<Recording> {
    let folder = path.parent().unwrap_or(Path::new(""));
    let cameras = scene.cameras.iter().enumerate();
    let live = cameras.filter(|(_, camera)| {
        scene::source_config(camera, folder).is_ok_and(|config| config.is_live())
    });
    let live = live.map(|(index, camera)| RecordedCamera {
        index,
        name: camera.name.clone(),
        time_offset_s: camera.time_offset_s,
    });
    let live: Vec<_> = live.collect();
    if live.is_empty() {
        return Err(user_error!(
            "no camera is live: what there is to be tracked is recorded already"
        ));
    }
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let place = path.with_file_name(format!("{stem}-recording"));
    // The folder may have come from somebody else.
    if place.is_symlink() {
        return Err(user_error!(
            "{}: is a link, through which images could be written elsewhere; remove it",
            place.shown()
        ));
    }
    Recording::start(&place, live)
}

impl Session {
    /// Gives cameras that were recorded in the last run their recordings in place of what they are.
    pub(super) fn use_recording(&self) -> Result<()> {
        let inner = self.inner();
        let running = inner.running.as_ref().filter(|running| !running.goes_on());
        let folders = running.and_then(Running::recording).map(Recording::folders);
        let scene_folder = inner.project.folder().to_owned();
        drop(inner);
        let folders = folders.unwrap_or_default();
        if folders.is_empty() {
            return Err(user_error!(
                "there is no recording yet; track live cameras with Record the images"
            ));
        }
        let names: Vec<&str> = folders.iter().map(|(name, _)| &**name).collect();
        let what = format!("the recording of {}", names.join(", "));
        self.edit("cameras", what, |state| {
            for (name, folder) in &folders {
                let path = folder.strip_prefix(&scene_folder).unwrap_or(folder);
                state.text = with_images(&state.text, name, &path.to_string_lossy())?.into();
            }
            Ok(())
        })
    }

    /// Starts to track the scene as it is, saved or not.
    pub(super) fn track(&self, tracked: &Tracked) -> Result<()> {
        let mut inner = self.inner();
        if inner.running.as_ref().is_some_and(Running::goes_on) {
            return Err(user_error!("a run goes on; stop it first"));
        }
        if inner.waved.as_ref().is_some_and(Waved::goes_on) {
            return Err(user_error!(
                "the cameras are being calibrated; wait, or stop that in the step Pose"
            ));
        }
        let path = inner.project.path().to_owned();
        let text = Arc::clone(&inner.project.now().text);
        let scene = scene::parse(&text, &path, &toml::Table::new())?;
        let recording = if tracked.record {
            Some(recording(&scene, &path)?)
        } else {
            None
        };
        // Live cameras can be open only once, and some senders serve one connection.
        let live = inner.players.extract_if(.., |_, player| player.is_live());
        let open = live.filter_map(|(_, player)| player.into_source());
        let open = open.collect();
        let session = Weak::clone(&self.me);
        self.replayed.set(None);
        let ended = move |open| {
            if let Some(session) = session.upgrade() {
                session.inner().open = open;
                let replay = session.inner().running.as_ref().and_then(Running::replay);
                session.replayed.set(replay);
                session.follow();
                session.tell();
            }
        };
        inner.running = Some(Running::start(
            &path,
            scene,
            Watch::of(&self.feed, &self.lines),
            Wanted {
                recording,
                smooth: tracked.smooth,
                page: tracked.page,
            },
            open,
            ended,
        )?);
        Ok(())
    }

    /// Waits for the end of the run.
    pub(super) fn wait(&self) {
        let running = self.inner().running.take();
        if let Some(thread) = running.and_then(|running| running.thread) {
            // A panic has been reported.
            let _ = thread.join();
        }
    }

    /// Ends the run; its results are complete.
    pub(super) fn stop(&self) {
        if let Some(running) = &self.inner().running {
            running.stop.request();
        }
    }

    /// Compares the last run with an earlier one.
    pub(super) fn compare(&self, other: &OtherRun) -> Result<Value> {
        let (folder, replay) = self.ended()?;
        earlier::compare(&folder, replay.as_deref(), other.run)
    }

    /// Writes the page of such a comparison.
    pub(super) fn write_comparison(&self, other: &OtherRun) -> Result<Value> {
        let (folder, _) = self.ended()?;
        let number = other
            .run
            .ok_or_else(|| user_error!("choose a run to compare with first"))?;
        let page = view::write_comparison(&folder, &earlier::place_of(&folder, number)?)?;
        Ok(json!({ "page": page.shown() }))
    }

    /// Returns the folder of the last run, and what is replayed of it.
    ///
    /// Errors: none has ended.
    fn ended(&self) -> Result<(PathBuf, Option<Arc<Replay>>)> {
        let inner = self.inner();
        let running = inner.running.as_ref().filter(|running| !running.goes_on());
        let ended = running.map(|run| (run.folder().to_owned(), run.replay()));
        ended.ok_or_else(|| user_error!("no run has ended here yet; press Track, or wait"))
    }

    /// Returns rows of the run.
    pub(super) fn rows(&self, from: usize) -> Value {
        match &self.inner().running {
            Some(running) => running.watch.rows_from(from),
            None => json!({ "first": from, "next": from, "targets": {} }),
        }
    }
}
