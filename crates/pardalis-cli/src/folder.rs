//! Result folders that are written completely or not at all.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::Result;

use crate::files::unwritable;
use crate::output::{Shown, in_line};
use crate::user_error::user_error;

/// The contents of a command's result folders, by which the command recognises the folders that it may
/// replace.
pub(crate) struct Content {
    /// The marker file that identifies such a folder.
    pub(crate) mark: &'static str,
    /// The text of the marker file.
    pub(crate) text: &'static str,
    /// A noun phrase for such a folder, such as "a simulated sequence".
    pub(crate) what: &'static str,
    /// Its other entries, besides colour models and the motion of platforms.
    pub(crate) entries: &'static [&'static str],
}

impl Content {
    /// Returns the first entry of a folder that does not belong to this content.
    fn foreign(&self, folder: &Path) -> Option<String> {
        let entries = fs::read_dir(folder).into_iter().flatten().flatten();
        let names = entries.map(|entry| entry.file_name().to_string_lossy().into_owned());
        let is_known = |name: &String| {
            let endings = [".colors.toml", ".odometry.csv", ".poses.csv"];
            name == self.mark
                || self.entries.contains(&&**name)
                || endings.iter().any(|ending| name.ends_with(ending))
        };
        let foreign = names.filter(|name| !is_known(name)).min();
        foreign.map(|name| in_line(&name))
    }
}

/// A result folder that is written to a temporary location until it is complete.
pub(crate) struct Folder {
    content: &'static Content,
    output: PathBuf,
    partial: PathBuf,
    is_finished: bool,
}

impl Folder {
    /// Creates the temporary folder.
    ///
    /// Errors: the output exists and is not empty, and `force` is not given or the folder has other contents;
    /// or the temporary folder cannot be created.
    pub(crate) fn begin(content: &'static Content, output: &Path, force: bool) -> Result<Self> {
        let Content { mark, what, .. } = content;
        let name = output.shown();
        if output.exists() && !output.is_dir() {
            return Err(user_error!("{name}: is a file; choose a folder with -o"));
        }
        let holds_something =
            fs::read_dir(output).is_ok_and(|mut entries| entries.next().is_some());
        if holds_something && !force {
            return Err(user_error!(
                "{name}: is not empty; choose another folder with -o, or replace {what} with --force"
            ));
        }
        if holds_something && !output.join(mark).is_file() {
            return Err(user_error!(
                "{name}: holds no {mark}, so it is not {what} and --force does not replace it; choose another folder with -o"
            ));
        }
        if holds_something && let Some(foreign) = content.foreign(output) {
            return Err(user_error!(
                "{name}: holds {foreign}, which does not belong to {what} and would be removed by --force; move it, or choose another folder with -o"
            ));
        }
        let Some(file_name) = output.file_name() else {
            return Err(user_error!(
                "{name}: is not a folder name; choose another with -o"
            ));
        };
        let partial = format!(
            ".{}.{}.partial",
            file_name.to_string_lossy(),
            std::process::id()
        );
        let folder = Self {
            content,
            output: output.to_owned(),
            partial: output.with_file_name(partial),
            is_finished: false,
        };
        folder.make(Path::new(""))?;
        Ok(folder)
    }

    /// Creates a subfolder.
    pub(crate) fn make(&self, name: &Path) -> Result<()> {
        let path = self.partial.join(name);
        fs::create_dir_all(&path).map_err(|error| self.failed(name, error))
    }

    /// Writes a file.
    pub(crate) fn write(&self, name: impl AsRef<Path>, bytes: &[u8]) -> Result<()> {
        let name = name.as_ref();
        fs::write(self.partial.join(name), bytes).map_err(|error| self.failed(name, error))
    }

    /// Returns the temporary path of a file.
    pub(crate) fn path_of(&self, name: &str) -> PathBuf {
        self.partial.join(name)
    }

    /// Moves the complete folder to its final place.
    pub(crate) fn finish(mut self) -> Result<()> {
        self.write(self.content.mark, self.content.text.as_bytes())?;
        let old = self.partial.with_extension("old");
        let replaced = if self.output.exists() {
            fs::rename(&self.output, &old)
        } else {
            Ok(())
        };
        replaced
            .and_then(|()| fs::rename(&self.partial, &self.output))
            .map_err(|error| self.failed(Path::new(""), error))?;
        self.is_finished = true;
        if old.exists() {
            fs::remove_dir_all(&old).map_err(|error| {
                user_error!(
                    "{}: cannot be removed ({error}); remove it manually",
                    old.shown()
                )
            })?;
        }
        Ok(())
    }

    fn failed(&self, name: &Path, error: std::io::Error) -> anyhow::Error {
        unwritable(&self.output.join(name), error)
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        if !self.is_finished {
            // A leftover temporary folder does no harm.
            let _ = fs::remove_dir_all(&self.partial);
        }
    }
}
