//! Pages that show tracks in a browser: the data of `pardalis-viewer`, whose `web/viewer.js` describes them.

mod comparison;
mod frames;
mod poses;
mod scene;
mod secrets;
mod tracks;

use std::path::Path;

use anyhow::Result;
use serde::Serialize;
use serde_json::Value;

use crate::files::write_file;
#[cfg(feature = "studio")]
pub(crate) use comparison::settings;
pub(crate) use comparison::{Compared, Comparison, compare};
pub(crate) use poses::{CameraPoses, poses_of, read_poses};
pub(crate) use scene::{PageCamera, PageScene};

/// The pages that `track --report` and `view` write among the results.
pub(crate) const REPORT: &str = "report.html";
pub(crate) const VIEW: &str = "view.html";

/// The page of two runs that `view` writes among the results of the first.
pub(crate) const COMPARISON: &str = "comparison.html";

/// What every page begins with.
const GENERATOR: &str = "<meta name=\"generator\" content=\"pardalis-viewer\">";

/// The folder of annotated frames among the results.
pub(crate) const ANNOTATED: &str = "annotated";

#[derive(Serialize)]
struct Data<'a> {
    scene: &'a PageScene,
    tracks: tracks::TrackColumns,
    #[serde(skip_serializing_if = "Option::is_none")]
    comparison: Option<Comparison>,
    summary: Option<Value>,
    notes: Vec<String>,
}

/// Writes a page into the file at `path`. It shows the rows in `tracks`, if there are any, and the frames in the folder [`ANNOTATED`] beside them, in which the outlines
/// are drawn, and another run over them; `notes` are shown with it. Addresses in the summary lose names and passwords.
///
/// Errors: the rows are no tracks, or the page cannot be written.
pub(crate) fn write(
    path: &Path,
    (tracks, folder): (Option<&Path>, &Path),
    mut scene: PageScene,
    summary: Option<&Value>,
    comparison: Option<Comparison>,
    mut notes: Vec<String>,
) -> Result<()> {
    let read = tracks.map(tracks::read).transpose()?.unwrap_or_default();
    notes.extend(read.note);
    if let Some(comparison) = &comparison {
        notes.extend(comparison.note.clone());
        notes.extend(comparison.doubt.as_ref().map(|doubt| format!("{doubt}.")));
    }
    let (frames, note) =
        frames::read(&folder.join(ANNOTATED), &read.times_s, scene.first_camera())?;
    scene.frames = frames;
    notes.extend(note);
    let mut summary = summary.cloned();
    summary.iter_mut().for_each(secrets::remove);
    let title = scene.title.clone();
    let data = Data {
        scene: &scene,
        tracks: read.columns,
        comparison,
        summary,
        notes,
    };
    let page = pardalis_viewer::page(&serde_json::to_string(&data)?, &title);
    write_file(path, page.as_bytes())
}

/// Returns the rows of a table as those of a page, as JSON.
#[cfg(any(test, feature = "fuzz"))]
pub(crate) fn json_of_tracks(table: &crate::tables::Table) -> Result<String> {
    Ok(serde_json::to_string(&tracks::columns_of(table)?.columns)?)
}

/// Returns the title of the page of a scene: the name of its file, or of its folder if that is only `scene.toml`.
pub(crate) fn title(scene_path: &Path) -> String {
    let path = scene_path.canonicalize();
    let path = path.as_deref().unwrap_or(scene_path);
    let stem = path.file_stem().unwrap_or_default();
    let folder = path.parent().and_then(Path::file_name);
    let name = folder.filter(|_| stem == "scene").unwrap_or(stem);
    name.to_string_lossy().into_owned()
}

/// Returns the targets of a summary with their diameters in metres.
pub(crate) fn diameters_m(summary: &Value) -> Vec<(String, f64)> {
    let targets = summary["targets"].as_object().into_iter().flatten();
    let known =
        targets.filter_map(|(name, target)| Some((name.clone(), target["diameter_m"].as_f64()?)));
    known.collect()
}

/// Reports whether a file is a page of the viewer, which another may replace.
pub(crate) fn is_page(path: &Path) -> bool {
    use std::io::Read as _;
    let mut start = Vec::new();
    let read = std::fs::File::open(path).and_then(|file| file.take(1024).read_to_end(&mut start));
    read.is_ok() && String::from_utf8_lossy(&start).contains(GENERATOR)
}
