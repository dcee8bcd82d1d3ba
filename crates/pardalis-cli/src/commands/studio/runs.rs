//! Runs of the scene of a session.

use std::sync::{Arc, Weak};

use anyhow::Result;
use serde::Deserialize;
use serde_json::{Value, json};

use super::earlier;
use super::running::Running;
use super::session::Session;
use super::waved::Waved;
use crate::scene;
use crate::tracking::Watch;
use crate::user_error::user_error;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct OtherRun {
    /// The number of an earlier run; none to compare with none.
    run: Option<usize>,
}

impl Session {
    /// Starts to track the scene as it is, saved or not.
    pub(super) fn track(&self) -> Result<()> {
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
        // Live cameras can be open only once.
        inner.players.retain(|_, player| !player.is_live());
        let session = Weak::clone(&self.me);
        self.replayed.set(None);
        let ended = move || {
            if let Some(session) = session.upgrade() {
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
        let inner = self.inner();
        let running = inner.running.as_ref().filter(|running| !running.goes_on());
        let ended = running.map(|run| (run.folder().to_owned(), run.replay()));
        drop(inner);
        let Some((folder, replay)) = ended else {
            return Err(user_error!(
                "no run has ended here yet; press Track, or wait"
            ));
        };
        earlier::compare(&folder, replay.as_deref(), other.run)
    }

    /// Returns rows of the run.
    pub(super) fn rows(&self, from: usize) -> Value {
        match &self.inner().running {
            Some(running) => running.watch.rows_from(from),
            None => json!({ "first": from, "next": from, "targets": {} }),
        }
    }
}
