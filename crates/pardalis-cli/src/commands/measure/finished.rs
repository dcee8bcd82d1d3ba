//! Records of finished seeds, with which an interrupted experiment resumes.

use std::hash::{DefaultHasher, Hash as _, Hasher as _};
use std::path::{Path, PathBuf};
use std::{fs, io};

use anyhow::Result;
use pardalis_scene::Scene;
use pardalis_scene::experiment::Method;
use serde::{Deserialize, Serialize};
use toml::Value;

use crate::files::write_file;
use crate::output::Shown;
use crate::program_file;
use crate::user_error::user_error;

/// Larger files, which are videos, are identified by size and modification time.
const MAX_READ_BYTES: u64 = 4 << 20;

/// finished.json in a seed's folder, written when its tracks are complete. It has no figures: they are recomputed
/// cheaply from the tracks.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct Finished {
    /// Fingerprint of everything that determines the tracks (see [`of_run`] and [`of_seed`]).
    pub(super) fingerprint: String,
    /// Tracking time per frame in milliseconds, if the seed ran alone.
    pub(super) ms_a_frame: Option<f64>,
}

impl Finished {
    fn path(folder: &Path) -> PathBuf {
        folder.join("finished.json")
    }

    /// Reads the record in a seed's folder; `None` if the seed is not finished.
    pub(super) fn read(folder: &Path) -> Option<Self> {
        serde_json::from_slice(&fs::read(Self::path(folder)).ok()?).ok()
    }

    /// Writes the record.
    pub(super) fn write(&self, folder: &Path) -> Result<()> {
        let text = serde_json::to_string_pretty(self)? + "\n";
        write_file(&Self::path(folder), text.as_bytes())
    }

    /// Removes the record, before the tracks are rewritten.
    pub(super) fn remove(folder: &Path) -> Result<()> {
        let path = Self::path(folder);
        match fs::remove_file(&path) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => Err(user_error!(
                "{}: cannot be removed ({error}); give another folder with -o",
                path.shown()
            )),
            _ => Ok(()),
        }
    }
}

/// Returns the fingerprint of a run: the program, the scene's settings and the files that they name, the method and its
/// starts; `folder` is the scene's.
pub(super) fn of_run(scene: &Scene, folder: &Path, method: Method, starts: Option<&Path>) -> u64 {
    let mut hasher = DefaultHasher::new();
    env!("CARGO_PKG_VERSION").hash(&mut hasher);
    if let Some(program) = program_file::get() {
        add_size_and_time(program, &mut hasher);
    }
    let settings = Value::Table(scene.resolved.clone());
    settings.to_string().hash(&mut hasher);
    add_named_files(&settings, folder, &mut hasher);
    method.hash(&mut hasher);
    if let Some(starts) = starts {
        add_file(starts, &mut hasher);
    }
    hasher.finish()
}

/// Returns the fingerprint of a simulated world: the program and the world's text with replaced settings.
pub(super) fn of_world(text: &str) -> String {
    let mut hasher = DefaultHasher::new();
    if let Some(program) = program_file::get() {
        add_size_and_time(program, &mut hasher);
    }
    text.hash(&mut hasher);
    format!("{:016x}", hasher.finish())
}

/// Returns the fingerprint of one seed of a run.
pub(super) fn of_seed(run: u64, seed: u32, timed: bool) -> String {
    let mut hasher = DefaultHasher::new();
    (run, seed, timed).hash(&mut hasher);
    format!("{:016x}", hasher.finish())
}

/// Adds every text among the settings that names a file or a folder.
fn add_named_files(setting: &Value, folder: &Path, hasher: &mut DefaultHasher) {
    match setting {
        Value::Table(table) => table
            .values()
            .for_each(|value| add_named_files(value, folder, hasher)),
        Value::Array(values) => values
            .iter()
            .for_each(|value| add_named_files(value, folder, hasher)),
        Value::String(name) if !name.is_empty() => add_file(&folder.join(name), hasher),
        _ => {}
    }
}

/// Adds a small file's content, or the names, sizes and times of a folder's files.
fn add_file(path: &Path, hasher: &mut DefaultHasher) {
    let Ok(metadata) = fs::metadata(path) else {
        return;
    };
    if metadata.is_dir() {
        let entries = fs::read_dir(path).into_iter().flatten().flatten();
        let mut files: Vec<PathBuf> = entries.map(|entry| entry.path()).collect();
        files.sort();
        for file in files {
            add_size_and_time(&file, hasher);
        }
    } else if metadata.is_file() && metadata.len() <= MAX_READ_BYTES {
        fs::read(path).ok().hash(hasher);
    } else {
        add_size_and_time(path, hasher);
    }
}

fn add_size_and_time(path: &Path, hasher: &mut DefaultHasher) {
    path.hash(hasher);
    if let Ok(metadata) = fs::metadata(path) {
        (metadata.len(), metadata.modified().ok()).hash(hasher);
    }
}
