//! The project: the text of a scene, which is all of its state, with the texts before and after it.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::Result;

use crate::commands::init::text::HEAD;
use crate::commands::learn::samples::Sample;
use crate::files::{unwritable, write_file};
use crate::output::Shown;
use crate::scene::read_scene_text;
use crate::user_error::user_error;

/// The most states that can be undone.
const MAX_STATES: usize = 200;

/// What an edit changes and undoing it restores.
#[derive(Debug, Clone, Default)]
pub(super) struct State {
    /// The text of the scene.
    pub(super) text: Arc<str>,
    /// The frames in which each target is labelled, by its name.
    pub(super) samples: BTreeMap<String, Vec<Sample>>,
    /// The texts of files that were made here: colour models and calibrations.
    pub(super) files: BTreeMap<PathBuf, Arc<str>>,
    /// What the edit that led here did.
    pub(super) what: String,
}

impl State {
    /// Reports whether another state differs from this one in nothing but its name.
    fn is_same(&self, other: &Self) -> bool {
        let labels = |state: &Self| -> Vec<_> {
            let samples = state.samples.iter();
            let samples =
                samples.flat_map(|(target, samples)| samples.iter().map(move |one| (target, one)));
            samples
                .map(|(target, one)| {
                    (
                        target.clone(),
                        one.camera.clone(),
                        one.number,
                        one.outline_px.clone(),
                    )
                })
                .collect()
        };
        self.text == other.text && self.files == other.files && labels(self) == labels(other)
    }
}

/// A scene that is edited.
#[derive(Debug)]
pub(super) struct Project {
    /// The file of the scene, which need not exist.
    path: PathBuf,
    now: State,
    before: Vec<State>,
    after: Vec<State>,
    /// The text in the file; `None` if there is none.
    saved: Option<Arc<str>>,
    /// The files that were made here which that text may need.
    saved_files: BTreeSet<PathBuf>,
}

impl Project {
    /// Opens the scene in a file, or begins one.
    pub(super) fn open(path: &Path) -> Result<Self> {
        let saved: Option<Arc<str>> = if path.exists() {
            Some(read_scene_text(path)?.into())
        } else {
            None
        };
        Ok(Self {
            path: path.to_owned(),
            now: State {
                text: saved.clone().unwrap_or_else(|| HEAD.into()),
                ..State::default()
            },
            before: Vec::new(),
            after: Vec::new(),
            saved,
            saved_files: BTreeSet::new(),
        })
    }

    /// Gives the scene the name of another file, in which it is saved. Paths in it start at the folder of the file, so that it must be in the same folder
    /// unless it is new.
    pub(super) fn rename(&mut self, path: &Path) -> Result<()> {
        if self.path == path {
            return Ok(());
        }
        if self.saved.is_some() && self.path.parent() != path.parent() {
            return Err(user_error!(
                "-o {}: the paths in {} start at its folder; choose a file in the same folder",
                path.shown(),
                self.path.shown()
            ));
        }
        if path.exists() {
            return Err(user_error!(
                "-o {}: already exists; choose another file, or give it as the scene",
                path.shown()
            ));
        }
        path.clone_into(&mut self.path);
        self.saved = None;
        Ok(())
    }

    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    /// Returns the folder at which the paths in the scene start.
    pub(super) fn folder(&self) -> &Path {
        self.path.parent().unwrap_or(Path::new(""))
    }

    pub(super) fn now(&self) -> &State {
        &self.now
    }

    pub(super) fn is_saved(&self) -> bool {
        self.saved.as_deref() == Some(&*self.now.text)
    }

    /// Returns what can be undone, and what can be done again.
    pub(super) fn steps(&self) -> (Option<&str>, Option<&str>) {
        let undone = (!self.before.is_empty()).then_some(&*self.now.what);
        (undone, self.after.last().map(|state| &*state.what))
    }

    /// Goes to another state, unless it is the same. What was undone before is lost.
    pub(super) fn edit(&mut self, state: State) -> Result<()> {
        if state.is_same(&self.now) {
            return Ok(());
        }
        self.write_files(&state)?;
        self.before.push(std::mem::replace(&mut self.now, state));
        if self.before.len() > MAX_STATES {
            self.before.remove(0);
        }
        self.after.clear();
        Ok(())
    }

    /// Goes back to the state before the last edit.
    pub(super) fn undo(&mut self) -> Result<()> {
        let Some(state) = self.before.pop() else {
            return Err(user_error!("there is nothing to undo"));
        };
        self.write_files(&state)?;
        self.after.push(std::mem::replace(&mut self.now, state));
        Ok(())
    }

    /// Goes to the state that was undone last.
    pub(super) fn redo(&mut self) -> Result<()> {
        let Some(state) = self.after.pop() else {
            return Err(user_error!("there is nothing to do again"));
        };
        self.write_files(&state)?;
        self.before.push(std::mem::replace(&mut self.now, state));
        Ok(())
    }

    /// Writes the scene.
    ///
    /// Errors: the file was changed by something else since it was read.
    pub(super) fn save(&mut self) -> Result<()> {
        let text = &self.now.text;
        let in_file = self.path.exists().then(|| read_scene_text(&self.path));
        let in_file = in_file.transpose()?;
        if in_file.is_some() && in_file.as_deref() != self.saved.as_deref() {
            return Err(user_error!(
                "{}: another program changed or wrote it; rename it to keep it, and save again",
                self.path.shown()
            ));
        }
        write_file(&self.path, text.as_bytes())?;
        self.saved = Some(Arc::clone(text));
        self.saved_files = self.now.files.keys().cloned().collect();
        Ok(())
    }

    /// Writes the files of a state that differ from those of the present one, and removes those that it does not have, unless something else has changed
    /// them or the scene that was saved needs them.
    fn write_files(&self, state: &State) -> Result<()> {
        for (path, text) in &state.files {
            if self.now.files.get(path) != Some(text) {
                write_file(path, text.as_bytes())?;
            }
        }
        let gone = |(path, _): &(&PathBuf, &Arc<str>)| {
            !state.files.contains_key(*path) && !self.saved_files.contains(*path)
        };
        for (path, text) in self.now.files.iter().filter(gone) {
            if fs::read(path).is_ok_and(|bytes| bytes == text.as_bytes()) {
                fs::remove_file(path).map_err(|error| unwritable(path, error))?;
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn edit(project: &mut Project, text: &str, colors: &str) {
        let mut state = project.now().clone();
        state.text = text.into();
        state.what = format!("to {text}");
        let file = project.folder().join("ball.colors.toml");
        state.files.insert(file, colors.into());
        project.edit(state).unwrap();
    }

    #[test]
    fn what_a_saved_scene_needs_is_not_undone() {
        let folder = tempfile::tempdir().unwrap();
        let mut project = Project::open(&folder.path().join("scene.toml")).unwrap();
        edit(&mut project, "a", "red");
        project.save().unwrap();
        project.undo().unwrap();
        let colors = std::fs::read_to_string(folder.path().join("ball.colors.toml"));
        assert_eq!(colors.unwrap(), "red");
    }

    #[test]
    fn undo_and_redo_restore_the_text_and_the_colours() {
        let folder = tempfile::tempdir().unwrap();
        let mut project = Project::open(&folder.path().join("scene.toml")).unwrap();
        let colors = || std::fs::read_to_string(folder.path().join("ball.colors.toml")).unwrap();
        assert_eq!(project.steps(), (None, None));
        assert!(project.undo().is_err());
        edit(&mut project, "a", "red");
        edit(&mut project, "b", "blue");
        assert_eq!(project.steps(), (Some("to b"), None));
        // Nothing to undo.
        edit(&mut project, "b", "blue");
        project.undo().unwrap();
        assert_eq!((&*project.now().text, &*colors()), ("a", "red"));
        assert_eq!(project.steps(), (Some("to a"), Some("to b")));
        project.redo().unwrap();
        assert_eq!((&*project.now().text, &*colors()), ("b", "blue"));
        project.undo().unwrap();
        edit(&mut project, "c", "green");
        assert!(project.redo().is_err());
        assert_eq!((&*project.now().text, &*colors()), ("c", "green"));
        project.undo().unwrap();
        project.undo().unwrap();
        assert_eq!(&*project.now().text, HEAD);
        assert!(!folder.path().join("ball.colors.toml").exists());
        // What something else has changed is kept.
        project.redo().unwrap();
        std::fs::write(folder.path().join("ball.colors.toml"), "mine").unwrap();
        project.undo().unwrap();
        assert_eq!(&*colors(), "mine");
    }

    #[test]
    fn a_file_that_something_else_changed_is_not_overwritten() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("scene.toml");
        let mut project = Project::open(&path).unwrap();
        assert!(!project.is_saved());
        edit(&mut project, "seed = 2\n", "red");
        project.save().unwrap();
        assert!(project.is_saved());
        std::fs::write(&path, "seed = 3\n").unwrap();
        edit(&mut project, "seed = 4\n", "red");
        let error = project.save().unwrap_err().to_string();
        assert!(error.contains("another program changed"), "{error}");
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "seed = 3\n");
        // A new project does not replace a file that has appeared.
        let other = folder.path().join("other.toml");
        let mut project = Project::open(&other).unwrap();
        std::fs::write(&other, "seed = 5\n").unwrap();
        assert!(project.save().is_err());
    }
}
