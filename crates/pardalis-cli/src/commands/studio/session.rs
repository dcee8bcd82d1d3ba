//! The session: a project, the pictures of its cameras and a run.

use std::collections::BTreeMap;
use std::fs;
use std::path::PathBuf;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};

use anyhow::Result;
use pardalis_studio::{Feed, Lines};
use serde_json::{Value, json};

use super::collected::Held;
use super::places::Places;
use super::player::Player;
use super::project::{Project, State};
use super::replay::Replayed;
use super::running::Running;
use super::waved::Waved;
use crate::commands::learn::samples::Learnt;
use crate::files::{unwritable, write_file};
use crate::output::warn;
use crate::scene::{self, Parts};
use crate::source::{Source, SourceConfig};
use crate::user_error::user_error;

/// What is set up, and its run.
pub(super) struct Session {
    pub(super) feed: Feed,
    /// The estimates of runs, for other programs.
    pub(super) lines: Lines,
    pub(super) places: Places,
    /// The last run, whose outlines are drawn over its recordings.
    pub(super) replayed: Replayed,
    inner: Mutex<Inner>,
    /// For threads that outlive a request.
    pub(super) me: Weak<Self>,
}

/// What requests change.
pub(super) struct Inner {
    pub(super) project: Project,
    /// The pictures of cameras, by their names.
    pub(super) players: BTreeMap<String, Player>,
    /// The sources of live cameras that were just added or tracked. Opening them again would take seconds, or fail.
    pub(super) open: Vec<(SourceConfig, Source)>,
    /// The colours that were learnt from the present samples of targets, by their names.
    pub(super) learnt: BTreeMap<String, Learnt>,
    pub(super) running: Option<Running>,
    /// A board that is held up to a camera.
    pub(super) held: Option<Held>,
    /// Cameras that are calibrated with a ball.
    pub(super) waved: Option<Waved>,
    /// How many states have been told: pages get them by several ways, and keep the latest.
    told: u64,
}

impl Session {
    pub(super) fn new(project: Project, places: Places, feed: Feed) -> Arc<Self> {
        Arc::new_cyclic(|me| Self {
            feed,
            lines: Lines::default(),
            places,
            replayed: Replayed::default(),
            me: Weak::clone(me),
            inner: Mutex::new(Inner {
                project,
                players: BTreeMap::new(),
                open: Vec::new(),
                learnt: BTreeMap::new(),
                running: None,
                held: None,
                waved: None,
                told: 0,
            }),
        })
    }

    pub(super) fn inner(&self) -> MutexGuard<'_, Inner> {
        // Edits replace whole states.
        self.inner.lock().unwrap_or_else(PoisonError::into_inner)
    }

    pub(super) fn is_saved(&self) -> bool {
        self.inner().project.is_saved()
    }

    /// Returns the text of the scene.
    pub(super) fn text(&self) -> Arc<str> {
        Arc::clone(&self.inner().project.now().text)
    }

    /// Says on the terminal what is wrong with the scene.
    pub(super) fn warn_of_problems(&self) {
        let inner = self.inner();
        let problems = inner.parts().assembly.problems;
        if !problems.is_empty() {
            let error = scene::problems_in("scene", inner.project.path(), &problems);
            warn(format!(
                "{error:#}\nThe page shows each in the step that solves it."
            ));
        }
    }

    /// Goes to another state of the project, unless what was edited, by its key, has a problem then that it did not have.
    pub(super) fn edit(
        &self,
        key: &str,
        what: String,
        change: impl FnOnce(&mut State) -> Result<()>,
    ) -> Result<()> {
        let mut inner = self.inner();
        let mut state = inner.project.now().clone();
        change(&mut state)?;
        state.what = what;
        let before = inner.parts();
        let after = inner.parts_of(&state.text);
        let is_new = |problem: &&pardalis_scene::Problem| {
            let is_old = |old: &pardalis_scene::Problem| old.message == problem.message;
            problem.key.starts_with(key) && !before.assembly.problems.iter().any(is_old)
        };
        if let Some(problem) = after.assembly.problems.iter().find(is_new) {
            return Err(user_error!("{}: {}", problem.key, problem.message));
        }
        inner.project.edit(state)?;
        drop(inner);
        self.changed();
        Ok(())
    }

    /// Writes a file that is new or was written here, without which the edited scene cannot be read, and edits. If that fails, the file is as before.
    pub(super) fn edit_with_file(
        &self,
        key: &str,
        what: String,
        (file, text): (PathBuf, String),
        change: impl FnOnce(&mut State) -> Result<()>,
    ) -> Result<()> {
        let before = self.inner().project.now().files.get(&file).cloned();
        write_file(&file, text.as_bytes())?;
        let done = self.edit(key, what, |state| {
            change(state)?;
            state.files.insert(file.clone(), text.into());
            Ok(())
        });
        if done.is_err() {
            match before {
                Some(text) => write_file(&file, text.as_bytes())?,
                None => fs::remove_file(&file).map_err(|error| unwritable(&file, error))?,
            }
        }
        done
    }

    /// Goes to the text of a scene that a page has kept while the program was started anew, whatever its problems.
    ///
    /// Errors: it names files outside of the places that the page reaches.
    pub(super) fn restore(&self, text: &str) -> Result<()> {
        let mut inner = self.inner();
        let (now, folder) = (&inner.project.now().text, inner.project.folder());
        self.places.check_scene(text, now, folder)?;
        let mut state = inner.project.now().clone();
        state.text = text.into();
        "the scene of the page".clone_into(&mut state.what);
        inner.project.edit(state)?;
        drop(inner);
        self.changed();
        Ok(())
    }

    /// Follows the project with the pictures and the colours.
    pub(super) fn changed(&self) {
        let mut inner = self.inner();
        inner.learnt.clear();
        drop(inner);
        self.follow();
    }

    /// Shows the pictures of the cameras that the scene has.
    pub(super) fn follow(&self) {
        let mut inner = self.inner();
        let is_running = inner.running.as_ref().is_some_and(Running::goes_on)
            || inner.waved.as_ref().is_some_and(Waved::goes_on);
        let parts = inner.parts();
        let folder = inner.project.folder().to_owned();
        let mut wanted = BTreeMap::new();
        for camera in &parts.scene.cameras {
            if let Ok(config) = scene::source_config(camera, &folder) {
                // Most cameras can be open only once.
                if !(is_running && config.is_live()) {
                    wanted.insert(camera.name.clone(), config);
                }
            }
        }
        let is_unwanted = |name: &String, player: &mut Player| {
            !wanted.get(name).is_some_and(|config| player.shows(config))
        };
        let unwanted: Vec<_> = inner.players.extract_if(.., is_unwanted).collect();
        let mut open = std::mem::take(&mut inner.open);
        for (_, player) in unwanted {
            // A camera that has got another name.
            let is_renamed = wanted.values().any(|config| player.shows(config));
            if is_renamed && player.is_live() {
                open.extend(player.into_source());
            }
        }
        for (name, config) in wanted {
            if inner.players.contains_key(&name) {
                continue;
            }
            let number = open.iter().position(|(other, _)| other.is_same(&config));
            let source = number.map(|number| open.swap_remove(number).1);
            if let Ok(player) = Player::start(&name, config, source, (&self.feed, &self.replayed)) {
                inner.players.insert(name, player);
            }
        }
    }

    /// Returns the state of the session, and tells it to all pages.
    pub(super) fn tell(&self) -> Value {
        let mut inner = self.inner();
        inner.told += 1;
        let mut state = inner.state();
        state["number"] = json!(inner.told);
        // Before anyone else can tell a later one.
        self.feed.show("state", &state);
        state
    }
}

impl Inner {
    /// Returns the picture of a camera.
    pub(super) fn player(&self, camera: &str) -> Result<&Player> {
        self.players.get(camera).ok_or_else(|| {
            user_error!("cameras.{camera}: has no picture; see the problems of the step Sources")
        })
    }

    /// Reads the present scene.
    pub(super) fn parts(&self) -> Parts {
        self.parts_of(&self.project.now().text)
    }

    fn parts_of(&self, text: &str) -> Parts {
        let sizes = self.players.iter();
        let sizes = sizes.filter_map(|(name, player)| Some((name.clone(), player.size_px()?)));
        scene::parts_of_text(text, self.project.folder(), &sizes.collect())
    }
}
