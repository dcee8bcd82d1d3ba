//! The video devices of Linux.

use std::fs::{self, File};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

/// A device of Linux that may be a camera.
pub(super) struct Node {
    pub(super) path: PathBuf,
    /// The name that its driver gives it.
    pub(super) name: String,
    /// Why it cannot be opened, and what to do, if so.
    pub(super) trouble: Option<String>,
    /// A link to it whose name depends on the camera and not on the order in which cameras are found.
    pub(super) stable_link: Option<PathBuf>,
}

/// Returns the devices `video...` below these roots of `/dev` and `/sys`, in the order of their numbers. Those that the
/// kernel knows and that `/dev` lacks are among them.
pub(super) fn nodes(dev: &Path, sys: &Path) -> Vec<Node> {
    let classes = sys.join("class/video4linux");
    let mut numbers: Vec<u32> = [dev, &classes]
        .into_iter()
        .flat_map(|folder| fs::read_dir(folder).into_iter().flatten().flatten())
        .filter_map(|entry| {
            entry
                .file_name()
                .to_str()?
                .strip_prefix("video")?
                .parse()
                .ok()
        })
        .collect();
    numbers.sort_unstable();
    numbers.dedup();
    let node = |number: u32| {
        let file = format!("video{number}");
        let path = dev.join(&file);
        let name = fs::read_to_string(classes.join(&file).join("name"));
        let name = name.map_or_else(
            |_| "without a name".to_owned(),
            |name| name.trim().to_owned(),
        );
        Node {
            name,
            trouble: File::open(&path)
                .err()
                .map(|error| trouble(error.kind(), &error.to_string())),
            stable_link: stable_link(dev, &path),
            path,
        }
    };
    numbers.into_iter().map(node).collect()
}

/// Says why a device cannot be opened, and what to do.
pub(super) fn trouble(kind: ErrorKind, message: &str) -> String {
    match kind {
        ErrorKind::PermissionDenied => "you may not open it: add yourself to the group video (sudo usermod -aG video $USER), and log in again".to_owned(),
        ErrorKind::NotFound => "the kernel knows it, and there is no such file: in a container, pass the device on to it (docker run --device)".to_owned(),
        ErrorKind::ResourceBusy => "another program uses it: close that program".to_owned(),
        _ => format!("it cannot be opened: {message}"),
    }
}

fn stable_link(dev: &Path, path: &Path) -> Option<PathBuf> {
    let path = fs::canonicalize(path).ok()?;
    let entries = fs::read_dir(dev.join("v4l/by-id")).ok()?.flatten();
    let leads_there = |link: &PathBuf| fs::canonicalize(link).is_ok_and(|place| place == path);
    entries.map(|entry| entry.path()).filter(leads_there).min()
}
