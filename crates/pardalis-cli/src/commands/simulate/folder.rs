//! The folder of a sequence, which appears whole or not at all.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::Result;

use crate::fault::fault;

/// The file by which a simulated sequence is known, and what it says.
const MARK: (&str, &str) = (
    "simulated.txt",
    "Written by pardalis simulate. Its --force replaces this folder, unless there is something in it that is not a sequence's.\n",
);

/// What a sequence's folder holds, colour models and tracks aside.
const ENTRIES: [&str; 9] = [
    MARK.0,
    "frames",
    "training",
    "truth.csv",
    "cameras.toml",
    "cameras.json",
    "scene.toml",
    "world.toml",
    // Of experiments.
    "fingerprint.txt",
];

/// What lies in a folder that no simulated sequence holds.
fn foreign(folder: &Path) -> Option<String> {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    let names = entries.map(|entry| entry.file_name().to_string_lossy().into_owned());
    let is_known = |name: &String| ENTRIES.contains(&&**name) || name.ends_with(".colors.toml");
    names.filter(|name| !is_known(name)).min()
}

/// A folder beside the one that is wanted, until all is written.
pub(super) struct Folder {
    output: PathBuf,
    partial: PathBuf,
    is_finished: bool,
}

impl Folder {
    /// Begins a folder.
    ///
    /// Faults: the one that is wanted holds something already, which is replaced by force only where it is a simulated sequence; it cannot be made.
    pub(super) fn begin(output: &Path, force: bool) -> Result<Self> {
        let name = output.display();
        if output.exists() && !output.is_dir() {
            return Err(fault!(
                "{name}: is a file; give the name of a folder with -o"
            ));
        }
        let holds_something =
            fs::read_dir(output).is_ok_and(|mut entries| entries.next().is_some());
        if holds_something && !force {
            return Err(fault!(
                "{name}: is not empty; give another -o, or --force to replace a sequence that was simulated before"
            ));
        }
        if holds_something && !output.join(MARK.0).is_file() {
            return Err(fault!(
                "{name}: holds no {}, so that it is no simulated sequence and --force does not remove it; give another -o",
                MARK.0
            ));
        }
        if holds_something && let Some(foreign) = foreign(output) {
            return Err(fault!(
                "{name}: holds {foreign}, which is no part of a simulated sequence, and --force would remove it; move it elsewhere, or give another -o"
            ));
        }
        let Some(file_name) = output.file_name() else {
            return Err(fault!("{name}: is no name of a folder; give another -o"));
        };
        let partial = format!(
            ".{}.{}.partial",
            file_name.to_string_lossy(),
            std::process::id()
        );
        let folder = Self {
            output: output.to_owned(),
            partial: output.with_file_name(partial),
            is_finished: false,
        };
        folder.make(Path::new(""))?;
        Ok(folder)
    }

    /// Makes a folder in it.
    pub(super) fn make(&self, name: &Path) -> Result<()> {
        let path = self.partial.join(name);
        fs::create_dir_all(&path).map_err(|error| self.failed(name, &error))
    }

    /// Writes a file in it.
    pub(super) fn write(&self, name: impl AsRef<Path>, bytes: &[u8]) -> Result<()> {
        let name = name.as_ref();
        fs::write(self.partial.join(name), bytes).map_err(|error| self.failed(name, &error))
    }

    /// Where a file is until all is written.
    pub(super) fn path_of(&self, name: &str) -> PathBuf {
        self.partial.join(name)
    }

    /// Puts it in the place of the one that is wanted.
    pub(super) fn finish(mut self) -> Result<()> {
        self.write(MARK.0, MARK.1.as_bytes())?;
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
                fault!(
                    "{}: cannot be removed ({error}); remove it yourself",
                    old.display()
                )
            })?;
        }
        Ok(())
    }

    fn failed(&self, name: &Path, error: &std::io::Error) -> anyhow::Error {
        fault!(
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
