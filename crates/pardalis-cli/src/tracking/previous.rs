//! Results of an earlier run that a new one would replace. Those of a live camera cannot be computed again.

use std::fs::{self, File};
use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};

use anyhow::Result;

use super::{particle_rows, summary};
use crate::files::unwritable;
use crate::output::{Shown, note};

/// Renames the rows of an earlier run in this folder, their summary and their particles, in place of those of the run before it.
pub(super) fn keep_results(folder: &Path) -> Result<()> {
    let summary = folder.join(summary::FILE);
    let cameras = folder.join(super::CAMERAS);
    let keeps_rows = keep_rows(&folder.join("tracks.csv"))?;
    let (older, particles): (Vec<_>, Vec<_>) = particle_rows::files_in(folder)
        .into_iter()
        .partition(|file| is_previous(file));
    if keeps_rows {
        // They are of the rows that have just been replaced.
        for file in older {
            let _ = fs::remove_file(file);
        }
    }
    for file in particles {
        keep_rows(&file)?;
    }
    if keeps_rows {
        let _ = fs::remove_file(previous_of(&cameras));
        if cameras.is_file() {
            rename(&cameras)?;
        }
        // A run that was killed has no summary.
        if !summary.exists() {
            let _ = fs::remove_file(previous_of(&summary));
            return Ok(());
        }
        rename(&summary)?;
    }
    Ok(())
}

/// Renames a table of an earlier run, and says so on standard error. Reports whether there is one with rows.
pub(super) fn keep_rows(table: &Path) -> Result<bool> {
    // No device, and no pipe, which would keep the program waiting.
    if !table.is_file() || !has_rows(table) {
        return Ok(false);
    }
    rename(table)?;
    note(format_args!(
        "{} of an earlier run is kept as {}",
        table.shown(),
        previous_of(table).shown()
    ));
    Ok(true)
}

fn rename(path: &Path) -> Result<()> {
    fs::rename(path, previous_of(path)).map_err(|error| unwritable(&previous_of(path), error))
}

/// Returns the name under which a file is kept: `tracks.previous.csv` for `tracks.csv`.
pub(crate) fn previous_of(path: &Path) -> PathBuf {
    let mut ending = "previous".to_owned();
    if let Some(extension) = path.extension() {
        ending = format!("{ending}.{}", extension.to_string_lossy());
    }
    path.with_extension(ending)
}

/// Reports whether this is the name under which a file is kept.
pub(crate) fn is_previous(path: &Path) -> bool {
    let ends_so = |path: &Path| path.extension().is_some_and(|ending| ending == "previous");
    ends_so(path) || ends_so(&path.with_extension(""))
}

/// Reports whether a header line is followed by anything. What cannot be read may have rows.
pub(super) fn has_rows(table: &Path) -> bool {
    let Ok(file) = File::open(table) else {
        return true;
    };
    let mut reader = BufReader::new(file);
    let mut header = Vec::new();
    let read = reader.read_until(b'\n', &mut header);
    read.is_err() || reader.fill_buf().map_or(true, |rows| !rows.is_empty())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn kept(folder: &Path) -> Vec<(String, String)> {
        let mut files: Vec<_> = fs::read_dir(folder)
            .unwrap()
            .map(|entry| {
                let path = entry.unwrap().path();
                let name = path.file_name().unwrap().to_string_lossy().into_owned();
                (name, fs::read_to_string(path).unwrap())
            })
            .collect();
        files.sort();
        files
    }

    #[test]
    fn the_last_rows_are_kept_with_their_summary() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path();
        let write = |name: &str, text: &str| fs::write(path.join(name), text).unwrap();
        let texts = |pairs: &[(&str, &str)]| -> Vec<(String, String)> {
            let owned = |&(a, b): &(&str, &str)| (a.to_owned(), b.to_owned());
            pairs.iter().map(owned).collect()
        };
        keep_results(path).unwrap();
        assert_eq!(kept(path), []);
        write("tracks.csv", "header\n1\n");
        write("summary.json", "{1}");
        keep_results(path).unwrap();
        let first = texts(&[
            ("summary.previous.json", "{1}"),
            ("tracks.previous.csv", "header\n1\n"),
        ]);
        assert_eq!(kept(path), first);
        // A run that ended before its first row costs nothing.
        write("tracks.csv", "header\n");
        keep_results(path).unwrap();
        fs::remove_file(path.join("tracks.csv")).unwrap();
        assert_eq!(kept(path), first);
        // A run that was killed.
        write("tracks.csv", "header\n2\n");
        keep_results(path).unwrap();
        assert_eq!(kept(path), texts(&[("tracks.previous.csv", "header\n2\n")]));
        assert_eq!(previous_of(Path::new("a/b")), Path::new("a/b.previous"));
        for (name, is_kept) in [("a.csv", false), ("a", false), ("previous.csv", false)] {
            assert_eq!(is_previous(Path::new(name)), is_kept, "{name}");
            assert!(is_previous(&previous_of(Path::new(name))), "{name}");
        }
    }
}
