//! Results of earlier runs in numbered folders, to be compared with later ones.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::Result;

use super::previous::has_rows;
use super::{EARLIER, summary};
use crate::files::unwritable;

/// The most numbered runs that are kept. Hand-set: as many as people tell apart.
const MAX_EARLIER: usize = 20;

/// Moves rows, summary and page of an earlier run in this folder into a numbered folder in it. Of more than [`MAX_EARLIER`], the oldest is removed.
pub(super) fn number_results(folder: &Path) -> Result<()> {
    let rows = folder.join(super::ROWS);
    if !rows.is_file() || !has_rows(&rows) {
        return Ok(());
    }
    let runs = earlier_runs(folder);
    let number = runs.last().map_or(1, |(last, _)| last + 1);
    let place = folder.join(EARLIER).join(number.to_string());
    let move_all = || {
        fs::create_dir_all(&place)?;
        for file in OF_RUN.map(|name| folder.join(name)) {
            if let (true, Some(name)) = (file.is_file(), file.file_name()) {
                fs::rename(&file, place.join(name))?;
            }
        }
        Ok(())
    };
    move_all().map_err(|error| unwritable(&place, error))?;
    let kept = MAX_EARLIER - 1;
    for (_, old) in &runs[..runs.len().saturating_sub(kept)] {
        // Only what was put there.
        for name in OF_RUN {
            let _ = fs::remove_file(old.join(name));
        }
        let _ = fs::remove_dir(old);
    }
    Ok(())
}

/// The files by which a run is compared with another, and its pages.
const OF_RUN: [&str; 5] = [
    super::ROWS,
    summary::FILE,
    super::CAMERAS,
    crate::report::REPORT,
    crate::report::COMPARISON,
];

/// Returns the numbered runs in a folder of results with their folders, the oldest first.
pub(crate) fn earlier_runs(folder: &Path) -> Vec<(usize, PathBuf)> {
    let entries = fs::read_dir(folder.join(EARLIER))
        .into_iter()
        .flatten()
        .flatten();
    let numbered = entries.filter_map(|entry| {
        let is_folder = entry.file_type().is_ok_and(|kind| kind.is_dir());
        let number = entry.file_name().to_str()?.parse().ok()?;
        is_folder.then(|| (number, entry.path()))
    });
    let mut runs: Vec<_> = numbered.collect();
    runs.sort();
    runs
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_are_numbered_and_the_oldest_gives_way() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path();
        number_results(path).unwrap();
        assert_eq!(earlier_runs(path), []);
        for run in 1..=22 {
            fs::write(path.join("tracks.csv"), format!("header\n{run}\n")).unwrap();
            // One run was killed before it wrote its summary.
            if run != 3 {
                fs::write(path.join("summary.json"), format!("{{{run}}}")).unwrap();
            }
            number_results(path).unwrap();
            assert!(!path.join("tracks.csv").exists() && !path.join("summary.json").exists());
            // Something of somebody else stays.
            fs::write(path.join("earlier/1/mine.txt"), "mine").unwrap();
        }
        // A run without rows costs nothing.
        fs::write(path.join("tracks.csv"), "header\n").unwrap();
        number_results(path).unwrap();
        let runs = earlier_runs(path);
        let numbers: Vec<usize> = runs.iter().map(|(number, _)| *number).collect();
        assert_eq!(numbers, [vec![1], (3..=22).collect()].concat());
        let in_run = |number: usize, name: &str| {
            fs::read_to_string(path.join(format!("earlier/{number}/{name}"))).ok()
        };
        assert_eq!(in_run(3, "tracks.csv").unwrap(), "header\n3\n");
        assert_eq!(
            (in_run(3, "summary.json"), in_run(1, "tracks.csv")),
            (None, None)
        );
        assert_eq!(in_run(22, "summary.json").unwrap(), "{22}");
        assert_eq!(in_run(1, "mine.txt").unwrap(), "mine");
    }
}
