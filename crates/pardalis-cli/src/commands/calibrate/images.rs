//! Board detection: the image files and the result for each.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::Result;
use indicatif::{ProgressBar, ProgressStyle};
use pardalis_calibrate::board::{Board, BoardNotFound, Corner, detect};
use pardalis_calibrate::{CalibrationView, Correspondence};
use rayon::prelude::*;

use crate::output::{Shown, in_line};
use crate::source::decode::decode_mask;
use crate::user_error::user_error;

use super::observations::Observations;

/// Detection result of one image.
pub(super) struct SearchedImage {
    /// File name.
    pub(super) name: String,
    /// Corners of the board, or the reason why it was not found.
    pub(super) found: Result<Vec<Corner>, BoardNotFound>,
}

/// Returns the images of a folder, of a pattern with `*` and `?` in its last component, or a single image,
/// sorted by name.
///
/// Fails if there are none.
pub(in crate::commands) fn files(path: &Path) -> Result<Vec<PathBuf>> {
    let pattern = path.file_name().unwrap_or_default().to_string_lossy();
    let is_pattern = pattern.contains(['*', '?']) && !path.exists();
    if !path.is_dir() && !is_pattern {
        return Ok(vec![path.to_owned()]);
    }
    let folder = if is_pattern {
        path.parent()
            .filter(|folder| *folder != Path::new(""))
            .unwrap_or(Path::new("."))
    } else {
        path
    };
    let unreadable = |error| {
        user_error!(
            "{}: cannot be read ({error}); give a folder of images",
            folder.shown()
        )
    };
    let mut files = Vec::new();
    for entry in fs::read_dir(folder).map_err(unreadable)? {
        let file = entry.map_err(unreadable)?.path();
        let name = name_of(&file);
        let extension = file.extension().map(|e| e.to_string_lossy().to_lowercase());
        let is_image = matches!(extension.as_deref(), Some("jpg" | "jpeg" | "png"));
        let wanted = !is_pattern || matches(pattern.as_bytes(), name.as_bytes());
        if is_image && wanted && !name.starts_with('.') && file.is_file() {
            files.push(file);
        }
    }
    files.sort();
    if files.is_empty() {
        return Err(user_error!(
            "{}: no images there; allowed: files ending in .jpg, .jpeg or .png",
            path.shown()
        ));
    }
    Ok(files)
}

/// Reports whether a name matches a pattern; `*` matches any characters, `?` exactly one.
fn matches(pattern: &[u8], name: &[u8]) -> bool {
    match (pattern.split_first(), name.split_first()) {
        (None, None) => true,
        (Some((b'*', rest)), _) if matches(rest, name) => true,
        (Some((b'*', _)), Some((_, name))) => matches(pattern, name),
        (Some((p, rest)), Some((n, name))) => (p == n || *p == b'?') && matches(rest, name),
        _ => false,
    }
}

/// Searches all images for the board. Also returns their size, which must be the same for all.
///
/// Fails if an image cannot be read or differs in size from the first.
pub(super) fn search(
    board: &Board,
    files: &[PathBuf],
) -> Result<(Vec<SearchedImage>, (usize, usize))> {
    let bar = progress_bar(files.len());
    let searched: Vec<(SearchedImage, (usize, usize))> = files
        .par_iter()
        .map(|file| {
            let grey = decode_mask(file)?;
            let size_px = grey.size_px();
            let found = detect(board, &grey);
            bar.inc(1);
            Ok((
                SearchedImage {
                    name: in_line(&name_of(file)),
                    found,
                },
                size_px,
            ))
        })
        .collect::<Result<_>>()?;
    bar.finish_and_clear();
    let first = searched.first().map_or((0, 0), |searched| searched.1);
    for (file, (_, size_px)) in files.iter().zip(&searched) {
        if *size_px != first {
            return Err(user_error!(
                "{}: has {} x {} pixels, but {} has {} x {}; all images of a camera must have the same size",
                file.shown(),
                size_px.0,
                size_px.1,
                files[0].shown(),
                first.0,
                first.1
            ));
        }
    }
    let images = searched.into_iter().map(|searched| searched.0).collect();
    Ok((images, first))
}

/// Returns a view of the corners in an image, if the board was found.
pub(super) fn view(image: &SearchedImage) -> Option<CalibrationView> {
    let corners = image.found.as_ref().ok()?;
    let correspondence = |corner: &Corner| Correspondence {
        point_m: corner.board_m,
        pixel: corner.pixel,
    };
    Some(CalibrationView {
        name: image.name.clone(),
        correspondences: corners.iter().map(correspondence).collect(),
    })
}

/// Collects the corners of all images in which the board was found.
pub(super) fn observations(images: &[SearchedImage]) -> Observations {
    let found = images.iter().filter_map(|image| image.found.as_ref().ok());
    Observations {
        views: images.iter().filter_map(view).collect(),
        numbers: found
            .map(|corners| corners.iter().map(|corner| corner.id).collect())
            .collect(),
        numbered_by: "corner",
        repeated: 0,
    }
}

fn name_of(file: &Path) -> String {
    file.file_name()
        .unwrap_or_default()
        .to_string_lossy()
        .into_owned()
}

/// Creates a progress bar on a terminal; hidden elsewhere.
fn progress_bar(images: usize) -> ProgressBar {
    let bar = ProgressBar::new(images as u64);
    match ProgressStyle::with_template("searching {bar:32} {pos}/{len} images, {eta} left") {
        Ok(style) => bar.with_style(style),
        Err(_) => bar,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn patterns_match_names() {
        for (pattern, name, wanted) in [
            ("left*.jpg", "left01.jpg", true),
            ("left??.jpg", "left01.jpg", true),
            ("left??.jpg", "left.jpg", false),
            ("*", "", true),
            ("*1*", "left01.jpg", true),
            ("right*", "left01.jpg", false),
        ] {
            assert_eq!(
                matches(pattern.as_bytes(), name.as_bytes()),
                wanted,
                "{pattern} {name}"
            );
        }
    }
}
