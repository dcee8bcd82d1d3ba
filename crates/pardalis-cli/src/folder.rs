//! Folders of results that appear whole or not at all.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::Result;

use crate::user_error::user_error;

/// What a command's folders hold, by which they are known and may be replaced.
pub(crate) struct Content {
    /// The file by which such a folder is known.
    pub(crate) mark: &'static str,
    /// What that file says.
    pub(crate) text: &'static str,
    /// What such a folder is, as "a simulated sequence".
    pub(crate) what: &'static str,
    /// What else it holds, colour models aside.
    pub(crate) entries: &'static [&'static str],
}

impl Content {
    /// What lies in a folder that this is not.
    fn foreign(&self, folder: &Path) -> Option<String> {
        let entries = fs::read_dir(folder).into_iter().flatten().flatten();
        let names = entries.map(|entry| entry.file_name().to_string_lossy().into_owned());
        let is_known = |name: &String| {
            name == self.mark || self.entries.contains(&&**name) || name.ends_with(".colors.toml")
        };
        names.filter(|name| !is_known(name)).min()
    }
}

/// A folder beside the one that is wanted, until all is written.
pub(crate) struct Folder {
    content: &'static Content,
    output: PathBuf,
    partial: PathBuf,
    is_finished: bool,
}

impl Folder {
    /// Begins a folder.
    ///
    /// Errors: the one that is wanted holds something already, which is replaced by force only where it has this content; it cannot be made.
    pub(crate) fn begin(content: &'static Content, output: &Path, force: bool) -> Result<Self> {
        let Content { mark, what, .. } = content;
        let name = output.display();
        if output.exists() && !output.is_dir() {
            return Err(user_error!(
                "{name}: is a file; give the name of a folder with -o"
            ));
        }
        let holds_something =
            fs::read_dir(output).is_ok_and(|mut entries| entries.next().is_some());
        if holds_something && !force {
            return Err(user_error!(
                "{name}: is not empty; give another -o, or --force to replace {what}"
            ));
        }
        if holds_something && !output.join(mark).is_file() {
            return Err(user_error!(
                "{name}: holds no {mark}, so that it is not {what} and --force does not remove it; give another -o"
            ));
        }
        if holds_something && let Some(foreign) = content.foreign(output) {
            return Err(user_error!(
                "{name}: holds {foreign}, which is no part of {what}, and --force would remove it; move it elsewhere, or give another -o"
            ));
        }
        let Some(file_name) = output.file_name() else {
            return Err(user_error!(
                "{name}: is no name of a folder; give another -o"
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

    /// Makes a folder in it.
    pub(crate) fn make(&self, name: &Path) -> Result<()> {
        let path = self.partial.join(name);
        fs::create_dir_all(&path).map_err(|error| self.failed(name, &error))
    }

    /// Writes a file in it.
    pub(crate) fn write(&self, name: impl AsRef<Path>, bytes: &[u8]) -> Result<()> {
        let name = name.as_ref();
        fs::write(self.partial.join(name), bytes).map_err(|error| self.failed(name, &error))
    }

    /// Where a file is until all is written.
    pub(crate) fn path_of(&self, name: &str) -> PathBuf {
        self.partial.join(name)
    }

    /// Puts it in the place of the one that is wanted.
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
            .map_err(|error| self.failed(Path::new(""), &error))?;
        self.is_finished = true;
        if old.exists() {
            fs::remove_dir_all(&old).map_err(|error| {
                user_error!(
                    "{}: cannot be removed ({error}); remove it yourself",
                    old.display()
                )
            })?;
        }
        Ok(())
    }

    fn failed(&self, name: &Path, error: &std::io::Error) -> anyhow::Error {
        user_error!(
            "{}: cannot be written ({error}); give a folder that may be written to with -o",
            self.output.join(name).display()
        )
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        if !self.is_finished {
            // What cannot be removed does no harm.
            let _ = fs::remove_dir_all(&self.partial);
        }
    }
}
