//! Whether the files exist that a scene names in tables with other problems. Such tables are not opened.

use std::path::Path;

use pardalis_scene::{Problem, Scene};
use toml::Spanned;
use toml::de::{DeTable, DeValue};

use crate::output::Shown;

/// Returns a problem for each missing file or folder that a scene's text names in a camera or target with other problems: one that
/// `sound`, the scene without these, does not contain. Paths are relative to `folder`. Of a text with syntax errors nothing is checked.
pub(crate) fn missing(text: &str, folder: &Path, sound: &Scene) -> Vec<Problem> {
    let (root, errors) = DeTable::parse_recoverable(text);
    if !errors.is_empty() {
        return Vec::new();
    }
    let mut missing = Missing {
        text,
        folder,
        problems: Vec::new(),
    };
    let root = root.get_ref();
    for (name, camera) in tables(root, "cameras") {
        if sound.cameras.iter().any(|camera| camera.name == name) {
            continue;
        }
        let of_camera = format!("cameras.{name}");
        missing.check(&of_camera, camera, "images", "");
        missing.check(&of_camera, camera, "mcap", "");
        missing.check(&of_camera, camera, "mask", "");
        missing.check(&of_camera, camera, "detections", "");
        // With `input`, it may be a device or an address.
        if !camera.contains_key("input") {
            missing.check(&of_camera, camera, "video", "");
        }
    }
    for (name, target) in tables(root, "targets") {
        if sound.targets.iter().any(|target| target.name == name) {
            continue;
        }
        let remedy = "; `pardalis learn` writes such files";
        let of_target = format!("targets.{name}");
        missing.check(&of_target, target, "colors", remedy);
        missing.check(&of_target, target, "measurements", "");
        for (landmark, table) in tables(target, "landmarks") {
            let of_landmark = format!("{of_target}.landmarks.{landmark}");
            missing.check(&of_landmark, table, "colors", remedy);
        }
    }
    missing.problems
}

/// Returns the tables in the table under a key, with their names.
fn tables<'a, 't>(
    table: &'a DeTable<'t>,
    key: &str,
) -> impl Iterator<Item = (&'a str, &'a DeTable<'t>)> + use<'a, 't> {
    let named = table.get(key).and_then(|value| value.get_ref().as_table());
    let entries = named.into_iter().flat_map(|named| named.iter());
    entries.filter_map(|(name, value)| Some((&**name.get_ref(), value.get_ref().as_table()?)))
}

struct Missing<'a> {
    text: &'a str,
    folder: &'a Path,
    problems: Vec<Problem>,
}

impl Missing<'_> {
    /// Adds a problem if a table names a file that does not exist under this key.
    fn check(&mut self, of: &str, table: &DeTable<'_>, key: &str, remedy: &str) {
        let Some(value) = table.get(key) else {
            return;
        };
        let DeValue::String(name) = value.get_ref() else {
            return;
        };
        let is_address = name.contains("://") || name == "-";
        let path = self.folder.join(&**name);
        if is_address || path.exists() {
            return;
        }
        self.problems.push(Problem {
            line: self.line_of(value),
            key: format!("{of}.{key}"),
            message: format!(
                "{}: cannot be read: there is no such file or folder{remedy}",
                path.shown()
            ),
        });
    }

    fn line_of<T>(&self, value: &Spanned<T>) -> usize {
        self.text[..value.span().start].matches('\n').count() + 1
    }
}
