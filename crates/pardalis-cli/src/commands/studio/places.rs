//! Files that the page may name: only those below the folders of the command line.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::Result;
use serde_json::{Value, json};

use crate::output::Shown;
use crate::source::decode::media_kind;
use crate::user_error::user_error;

/// The most entries of a folder that are listed.
const MAX_LISTED: usize = 500;

/// The folders and files of the command line, without links.
#[derive(Debug)]
pub(super) struct Places(Vec<PathBuf>);

impl Places {
    /// Allows these folders, with all below them, and files.
    ///
    /// Errors: one does not exist.
    pub(super) fn of(paths: &[PathBuf]) -> Result<Self> {
        let places = paths.iter().map(|path| {
            fs::canonicalize(path).map_err(|error| {
                user_error!(
                    "{}: cannot be opened: {error}; check the name",
                    path.shown()
                )
            })
        });
        let mut places: Vec<PathBuf> = places.collect::<Result<_>>()?;
        places.sort();
        // Folders come before what is below them, which they hold already.
        places.dedup_by(|path, before| path.starts_with(before));
        Ok(Self(places))
    }

    /// Returns a file or folder of this name, without links.
    ///
    /// Errors: there is none, or it is elsewhere; from the page, these are the same.
    pub(super) fn allowed(&self, name: &str) -> Result<PathBuf> {
        let found = fs::canonicalize(name).ok();
        let is_below = |path: &PathBuf| self.0.iter().any(|place| path.starts_with(place));
        // Such as that of a camera, typed as in a browser.
        let hint = if name.contains([':', '@']) || name.starts_with("www.") {
            "; an address begins with its protocol, such as http:// or rtsp://"
        } else {
            ""
        };
        found.filter(is_below).ok_or_else(|| {
            user_error!(
                "{}: is no file or folder below those that `pardalis studio` was given; start it with the folder that holds it{hint}",
                Path::new(name).shown()
            )
        })
    }

    /// Requires that a text of the scene in this folder names no file or folder elsewhere, unless `known`, another text of the scene, names it, too.
    pub(super) fn check_scene(&self, text: &str, known: &str, folder: &Path) -> Result<()> {
        let table = |text: &str| text.parse::<toml::Table>();
        let scene = table(text).map_err(|error| {
            user_error!("what is put back is no scene: {error}; open the scene again")
        })?;
        let known = toml::Value::Table(table(known).unwrap_or_default());
        let known: BTreeSet<&str> = texts_in(&known).into_iter().collect();
        for text in texts_in(&toml::Value::Table(scene)) {
            let path = folder.join(text);
            if !known.contains(text) && !is_device(text) && path.symlink_metadata().is_ok() {
                self.allowed(&path.to_string_lossy())?;
            }
        }
        Ok(())
    }

    /// Returns the places, or the entries of a folder, that could be a source or a calibration.
    pub(super) fn listed(&self, folder: Option<&str>) -> Result<Value> {
        let Some(folder) = folder else {
            let entries: Vec<Value> = self.0.iter().map(|path| entry(path)).collect();
            return Ok(json!({ "folder": null, "entries": entries }));
        };
        let folder = self.allowed(folder)?;
        let unreadable =
            |error| user_error!("{}: the folder cannot be read: {error}", folder.shown());
        let mut paths = Vec::new();
        for entry in fs::read_dir(&folder)
            .map_err(unreadable)?
            .take(100 * MAX_LISTED)
        {
            let path = entry.map_err(unreadable)?.path();
            let is_hidden = path
                .file_name()
                .is_none_or(|name| name.as_encoded_bytes().starts_with(b"."));
            // A name that is not text cannot be asked for.
            if !is_hidden && path.to_str().is_some() {
                paths.push(path);
            }
        }
        paths.sort_by_key(|path| (!path.is_dir(), path.clone()));
        let count = paths.len();
        paths.truncate(MAX_LISTED);
        let entries: Vec<Value> = paths.iter().map(|path| entry(path)).collect();
        let above = folder.parent().and_then(|above| {
            let above = above.to_str()?;
            self.allowed(above).is_ok().then_some(above)
        });
        Ok(json!({
            "folder": folder.to_string_lossy(),
            "above": above,
            "entries": entries,
            "left_out": count - entries.len(),
        }))
    }
}

/// Reports whether this names a camera of Linux: by its number, or by a link that is the same after a restart.
pub(super) fn is_device(input: &str) -> bool {
    let is_number = |text: &str| text.bytes().all(|byte| byte.is_ascii_digit());
    let is_link = |text: &str| !text.is_empty() && !text.contains('/') && text != "..";
    let links = ["/dev/v4l/by-id/", "/dev/v4l/by-path/"];
    input.strip_prefix("/dev/video").is_some_and(is_number)
        || links
            .iter()
            .any(|links| input.strip_prefix(links).is_some_and(is_link))
}

/// Returns all texts in a value.
fn texts_in(value: &toml::Value) -> Vec<&str> {
    match value {
        toml::Value::String(text) => vec![text],
        toml::Value::Array(values) => values.iter().flat_map(texts_in).collect(),
        toml::Value::Table(table) => table.values().flat_map(texts_in).collect(),
        _ => Vec::new(),
    }
}

fn entry(path: &Path) -> Value {
    let name = path
        .file_name()
        .map_or_else(|| path.to_string_lossy(), |name| name.to_string_lossy());
    let ending = path.extension().and_then(|ending| ending.to_str());
    let is_text = ["toml", "yml", "yaml", "json", "xml", "txt", "csv"];
    let kind = match media_kind(path) {
        _ if path.is_dir() => "folder",
        Some(kind) => kind,
        None if ending.is_some_and(|ending| is_text.contains(&ending)) => "text",
        None => "other",
    };
    json!({ "name": name, "path": path.to_string_lossy(), "kind": kind })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_outside_of_the_given_folders_is_reached() {
        let folder = tempfile::tempdir().unwrap();
        let inside = folder.path().join("in");
        fs::create_dir_all(inside.join("deep")).unwrap();
        fs::write(inside.join("deep/a.toml"), "").unwrap();
        fs::write(folder.path().join("secret.toml"), "").unwrap();
        fs::create_dir(folder.path().join("in-other")).unwrap();
        let places = Places::of(std::slice::from_ref(&inside)).unwrap();
        let name = |path: &str| folder.path().join(path).to_string_lossy().into_owned();
        assert!(places.allowed(&name("in/deep/a.toml")).is_ok());
        assert!(places.allowed(&name("in/deep/../deep/a.toml")).is_ok());
        for outside in [
            "secret.toml",
            "in/../secret.toml",
            "in/deep/../../secret.toml",
            "in-other",
            "",
            "in/missing.toml",
        ] {
            let error = places.allowed(&name(outside)).unwrap_err().to_string();
            assert!(
                error.contains("start it with the folder that holds it"),
                "{error}"
            );
        }
        assert!(places.allowed("/etc/passwd").is_err());
        assert!(places.listed(Some(&name(""))).is_err());
        let listed = places.listed(Some(&name("in/deep"))).unwrap();
        assert_eq!(listed["entries"][0]["name"], "a.toml");
        assert_eq!(listed["entries"][0]["kind"], "text");
        assert!(places.listed(Some(&name("in"))).unwrap()["above"].is_null());
    }

    #[test]
    fn scenes_name_nothing_outside_unless_they_did_before() {
        assert!(!is_device("/dev/v4l/by-id/../../../etc/passwd"));
        let folder = tempfile::tempdir().unwrap();
        let inside = folder.path().join("in");
        fs::create_dir_all(inside.join("frames")).unwrap();
        fs::write(folder.path().join("secret.toml"), "").unwrap();
        let places = Places::of(std::slice::from_ref(&inside)).unwrap();
        let check = |text: &str, known: &str| places.check_scene(text, known, &inside);
        for fine in [
            "a = ['frames', 'missing', 'udp://127.0.0.1:1', '/dev/video0', '/dev/v4l/by-id/usb-C920-index0', '']",
            "a.b = { c = 'frames' }",
        ] {
            check(fine, "").unwrap();
        }
        let absolute = folder.path().join("secret.toml");
        let absolute = format!("a = '{}'", absolute.display());
        for outside in [
            "a.b = '../secret.toml'",
            "a = [{ b = '..' }]",
            "a = '/etc/passwd'",
            &absolute,
        ] {
            let error = check(outside, "").unwrap_err().to_string();
            assert!(
                error.contains("start it with the folder that holds it"),
                "{error}"
            );
            check(outside, &format!("x = 0\n{outside}")).unwrap();
        }
        let error = check("a = ", "").unwrap_err().to_string();
        assert!(error.contains("is no scene"), "{error}");
    }

    #[cfg(unix)]
    #[test]
    fn links_lead_nowhere_else() {
        let folder = tempfile::tempdir().unwrap();
        let inside = folder.path().join("in");
        fs::create_dir(&inside).unwrap();
        fs::write(folder.path().join("secret.toml"), "").unwrap();
        std::os::unix::fs::symlink(folder.path(), inside.join("up")).unwrap();
        let places = Places::of(std::slice::from_ref(&inside)).unwrap();
        for link in ["up", "up/secret.toml"] {
            let link = inside.join(link);
            assert!(places.allowed(&link.to_string_lossy()).is_err(), "{link:?}");
        }
    }
}
