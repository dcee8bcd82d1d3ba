//! What a finished seed leaves behind, so that an interrupted experiment goes on where it stopped.

use std::hash::{DefaultHasher, Hash as _, Hasher as _};
use std::path::{Path, PathBuf};
use std::{fs, io};

use anyhow::Result;
use pardalis_scene::Scene;
use serde::{Deserialize, Serialize};
use toml::Value;

use super::definition::Method;
use crate::files::write_file;
use crate::user_error::user_error;

/// Larger files count by their size and time: they are videos.
const MAX_READ_BYTES: u64 = 4 << 20;

/// finished.json in a seed's folder: its tracks are complete. Figures are not in it: scores are cheap and made anew from the tracks.
#[derive(Debug, Serialize, Deserialize)]
pub(super) struct Finished {
    /// Of all that determines the tracks (see [`of_run`] and [`of_seed`]).
    pub(super) fingerprint: String,
    /// Time spent on tracking a frame, in milliseconds, where the seed ran alone.
    pub(super) ms_a_frame: Option<f64>,
}

impl Finished {
    fn path(folder: &Path) -> PathBuf {
        folder.join("finished.json")
    }

    /// What is in a seed's folder; none where it is not finished.
    pub(super) fn read(folder: &Path) -> Option<Self> {
        serde_json::from_slice(&fs::read(Self::path(folder)).ok()?).ok()
    }

    /// Says that the seed is finished.
    pub(super) fn write(&self, folder: &Path) -> Result<()> {
        let text = serde_json::to_string_pretty(self)? + "\n";
        write_file(&Self::path(folder), text.as_bytes())
    }

    /// Takes it back, before the tracks are written anew.
    pub(super) fn remove(folder: &Path) -> Result<()> {
        let path = Self::path(folder);
        match fs::remove_file(&path) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => Err(user_error!(
                "{}: cannot be removed ({error}); give another folder with -o",
                path.display()
            )),
            _ => Ok(()),
        }
    }
}

/// The fingerprint of a run: the program, the scene's settings and the files that they name, the method with its starts; `folder`
/// is the scene's.
pub(super) fn of_run(scene: &Scene, folder: &Path, method: Method, starts: Option<&Path>) -> u64 {
    let mut hasher = DefaultHasher::new();
    env!("CARGO_PKG_VERSION").hash(&mut hasher);
    if let Ok(program) = std::env::current_exe() {
        add_size_and_time(&program, &mut hasher);
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

/// The fingerprint of a simulated world: the program and the world's text, settings replaced.
pub(super) fn of_world(text: &str) -> String {
    let mut hasher = DefaultHasher::new();
    if let Ok(program) = std::env::current_exe() {
        add_size_and_time(&program, &mut hasher);
    }
    text.hash(&mut hasher);
    format!("{:016x}", hasher.finish())
}

/// The fingerprint of one seed of a run.
pub(super) fn of_seed(run: u64, seed: u32, timed: bool) -> String {
    let mut hasher = DefaultHasher::new();
    (run, seed, timed).hash(&mut hasher);
    format!("{:016x}", hasher.finish())
}

/// Every text among the settings that is a file's or a folder's name.
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

/// A small file's content; the names, sizes and times of a folder's files.
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
