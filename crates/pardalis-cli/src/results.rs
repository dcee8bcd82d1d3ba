//! Finished results of a run: what is beside its rows, and the scene that they were made with.

use std::path::{Path, PathBuf};

use anyhow::Result;
use pardalis_scene::Scene;
use serde_json::Value;

use crate::output::Shown;
use crate::scene::problems_in;
use crate::scene_files::{read_calibration, read_text};
use crate::tracking::{SUMMARY, is_previous, previous_of};
use crate::user_error::user_error;

/// Returns the folder in which some rows are.
pub(crate) fn folder_of(tracks: &Path) -> PathBuf {
    match tracks.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => folder.to_owned(),
        _ => PathBuf::from("."),
    }
}

/// Returns the file of this name beside some rows: an earlier run has its own.
pub(crate) fn beside(tracks: &Path, name: &str) -> PathBuf {
    let file = folder_of(tracks).join(name);
    if is_previous(tracks) {
        previous_of(&file)
    } else {
        file
    }
}

/// Reads the summary beside some rows; `None` if there is none.
pub(crate) fn read_summary(tracks: &Path) -> Result<Option<Value>> {
    let path = beside(tracks, SUMMARY);
    if !path.exists() {
        return Ok(None);
    }
    let summary: Value = serde_json::from_str(&read_text(&path)?).map_err(|error| {
        user_error!(
            "{}: is no summary of pardalis track: {error}; remove it, or track again",
            path.shown()
        )
    })?;
    Ok(Some(summary))
}

/// Returns the scene that the summary of results in a folder names, and its file, if it can still be read. Models that were found in images are those in the summary.
pub(crate) fn scene_of(summary: &Value, folder: &Path) -> Result<(Scene, PathBuf), String> {
    let named = Path::new(summary["scene"].as_str().unwrap_or_default());
    // Where the run was started is not recorded: most likely here, or in a folder above the results.
    let places = [Path::new("")].into_iter().chain(folder.ancestors());
    let mut paths = places.map(|place| place.join(named));
    let path = paths.find(|path| path.is_file()).ok_or_else(|| {
        format!(
            "the scene {} is not found, neither here nor in a folder above the tracks",
            named.shown()
        )
    })?;
    let text = read_text(&path).map_err(|error| format!("{error:#}"))?;
    let scene_folder = path.parent().unwrap_or(Path::new(""));
    let parse = |replaced: &toml::Table| {
        let scene = Scene::parse_without_inputs(&text, replaced, &|file, lens| {
            read_calibration(scene_folder, file, lens)
        });
        scene.map_err(|problems| format!("{:#}", problems_in("scene", &path, &problems)))
    };
    let mut scene = parse(&toml::Table::new())?;
    let by_rectangle = scene.cameras.iter().filter(|c| c.rectangle.is_some());
    let found: toml::Table = by_rectangle
        .filter_map(|camera| {
            let model = &summary["settings"]["cameras"][&camera.name]["model"];
            let key = format!("cameras.{}.model", camera.name);
            Some((key, toml::Value::try_from(model).ok()?))
        })
        .collect();
    if !found.is_empty() {
        scene = parse(&found)?;
    }
    Ok((scene, path))
}
