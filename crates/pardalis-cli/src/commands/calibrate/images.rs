//! Boards in images: which files, and what was found in each.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::Result;
use indicatif::{ProgressBar, ProgressStyle};
use pardalis_calibrate::{CalibrationView, Correspondence};
use rayon::prelude::*;

use crate::board::{Board, Corner, detect};
use crate::source::decode::decode_mask;
use crate::user_error::user_error;

use super::observations::Observations;

/// What became of an image.
pub(super) struct SearchedImage {
    /// The file's name.
    pub(super) name: String,
    /// The board's corners in it, or why there are none.
    pub(super) found: Result<Vec<Corner>, String>,
}

/// The images of a folder, of a pattern with `*` and `?` in its last part, or a single one; sorted by name.
///
/// Errors: there are none.
pub(super) fn files(path: &Path) -> Result<Vec<PathBuf>> {
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
            folder.display()
        )
    };
    let mut files = Vec::new();
    for entry in fs::read_dir(folder).map_err(unreadable)? {
        let file = entry.map_err(unreadable)?.path();
        let name = name_of(&file);
        let extension = file.extension().map(|e| e.to_string_lossy().to_lowercase());
        let is_image = matches!(extension.as_deref(), Some("jpg" | "jpeg" | "png"));
        let wanted = !is_pattern || fits(pattern.as_bytes(), name.as_bytes());
        if is_image && wanted && !name.starts_with('.') && file.is_file() {
            files.push(file);
        }
    }
    files.sort();
    if files.is_empty() {
        return Err(user_error!(
            "{}: no images there; allowed: files ending in .jpg, .jpeg or .png",
            path.display()
        ));
    }
    Ok(files)
}

/// Whether a name fits a pattern; `*` stands for any characters, `?` for one.
fn fits(pattern: &[u8], name: &[u8]) -> bool {
    match (pattern.split_first(), name.split_first()) {
        (None, None) => true,
        (Some((b'*', rest)), _) if fits(rest, name) => true,
        (Some((b'*', _)), Some((_, name))) => fits(pattern, name),
        (Some((p, rest)), Some((n, name))) => (p == n || *p == b'?') && fits(rest, name),
        _ => false,
    }
}

/// Searches all images for the board; also gives their size, which must be the same.
///
/// Errors: an image cannot be read, or has another size than the first.
pub(super) fn search(
    board: &Board,
    files: &[PathBuf],
) -> Result<(Vec<SearchedImage>, (usize, usize))> {
    let bar = progress_bar(files.len());
    let searched: Vec<(SearchedImage, (usize, usize))> = files
        .par_iter()
        .map(|file| {
            let grey = decode_mask(file)?;
            let size_px = (grey.width, grey.height);
            let image = image::GrayImage::from_raw(size_px.0 as u32, size_px.1 as u32, grey.bytes);
            let found = image.map_or(Err("no pixels".to_owned()), |image| detect(board, &image));
            bar.inc(1);
            Ok((
                SearchedImage {
                    name: name_of(file),
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
                "{}: has {} x {} pixels, {} has {} x {}; images of one camera have one size",
                file.display(),
                size_px.0,
                size_px.1,
                files[0].display(),
                first.0,
                first.1
            ));
        }
    }
    let images = searched.into_iter().map(|searched| searched.0).collect();
    Ok((images, first))
}

/// A view of the corners in an image, if the board was found.
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

/// The corners of all images in which the board was found.
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

/// A bar on a terminal; nothing elsewhere.
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
    fn patterns_fit_names() {
        for (pattern, name, wanted) in [
            ("left*.jpg", "left01.jpg", true),
            ("left??.jpg", "left01.jpg", true),
            ("left??.jpg", "left.jpg", false),
            ("*", "", true),
            ("*1*", "left01.jpg", true),
            ("right*", "left01.jpg", false),
        ] {
            assert_eq!(
                fits(pattern.as_bytes(), name.as_bytes()),
                wanted,
                "{pattern} {name}"
            );
        }
    }
}
