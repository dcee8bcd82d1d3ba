//! JPEG and PNG images: a folder in natural order, one file, or a list of files.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::vec::IntoIter;

use anyhow::Result;
use pardalis::frame::MAX_TIME_S;
use pardalis_scene::FrameRange;

use super::decode::{check_file, decode_image, image_size};
use super::times::{ImageTimes, read_times};
use super::{Pixels, TimeSpan, TimedBytes, Timing};
use crate::output::{Shown, in_line};
use crate::recordings::recordings_in;
use crate::user_error::user_error;

/// The images that are still to be delivered.
pub(super) struct ImageFrames {
    /// Each file with its times.
    files: IntoIter<(PathBuf, ImageTimes)>,
    /// Width and height of all images in pixels, and the file that determines them.
    size_px: (usize, usize),
    first_file: PathBuf,
}

impl ImageFrames {
    /// Lists the folder, which may also be one image, and determines the time of each image before any is decoded. Only the images of the
    /// range are delivered, in order of arrival; times count from the folder's first image nevertheless.
    pub(super) fn open(folder: &Path, timing: &Timing, range: FrameRange) -> Result<Self> {
        let files = list_images(folder)?;
        let count = files.len();
        if range.first >= count {
            return Err(user_error!(
                "{}: first_frame is {}, but the folder holds {count} images; allowed: 0 to {}",
                folder.shown(),
                range.first,
                count - 1
            ));
        }
        let files = with_times(folder, files, timing)?;
        let mut taken: Vec<_> = files
            .into_iter()
            .skip(range.first)
            .step_by(range.step)
            .take(range.limit.unwrap_or(usize::MAX))
            .collect();
        // A stable sort: images with equal arrival times, and all images without arrival times, keep their order.
        let arrival_s = |times: &ImageTimes| times.arrival_s.unwrap_or_default();
        taken.sort_by(|a, b| arrival_s(&a.1).total_cmp(&arrival_s(&b.1)));
        if taken.is_empty() {
            return Err(user_error!(
                "{}: frame_limit is 0; allowed: 1 or more",
                folder.shown()
            ));
        }
        Self::of(taken)
    }

    /// Opens a list of images whose times are one second apart. All must exist.
    pub(super) fn stills(files: &[PathBuf]) -> Result<Self> {
        for file in files {
            check_file(file)?;
        }
        let times = (0..files.len()).map(|index| ImageTimes::at(index as f64));
        Self::of(files.iter().cloned().zip(times).collect())
    }

    /// Opens one or more files with their times. The first image with a valid header determines the size of all; if
    /// there is none, the error of the first is returned.
    fn of(files: Vec<(PathBuf, ImageTimes)>) -> Result<Self> {
        let mut sizes = files.iter().map(|(file, _)| (file, image_size(file)));
        let first = sizes.by_ref().find(|(_, size)| size.is_ok());
        let (first_file, size_px) = match first {
            Some((file, size)) => (file.clone(), size?),
            None => (files[0].0.clone(), image_size(&files[0].0)?),
        };
        Ok(Self {
            size_px,
            files: files.into_iter(),
            first_file,
        })
    }

    /// Returns the time span of the images that are still to be delivered.
    pub(super) fn span(&self) -> TimeSpan {
        TimeSpan::of(self.files.as_slice().iter().map(|f| f.1.time_s).collect())
    }

    /// Returns the width and height of all images in pixels.
    pub(super) fn size_px(&self) -> (usize, usize) {
        self.size_px
    }

    /// Returns the number of images that are still to be delivered.
    pub(super) fn frame_count(&self) -> usize {
        self.files.len()
    }

    /// Returns a description of the content: number and names of the images.
    pub(super) fn content(&self) -> String {
        match self.files.as_slice() {
            [] => "no images".to_owned(),
            [only] => format!("1 image, {}", file_name(&only.0)),
            [first, .., last] => format!(
                "{} images, {} to {}",
                self.files.len(),
                file_name(&first.0),
                file_name(&last.0)
            ),
        }
    }
}

impl Iterator for ImageFrames {
    type Item = Result<Pixels>;

    fn next(&mut self) -> Option<Self::Item> {
        let (file, times) = self.files.next()?;
        let timed = decode_image(&file).and_then(|image| {
            let (width, height) = self.size_px;
            if image.size_px() != self.size_px {
                return Err(user_error!(
                    "{}: the image is {} x {} pixels where {} has {width} x {height}; \
                     all images must have one size",
                    file.shown(),
                    image.width(),
                    image.height(),
                    self.first_file.shown()
                ));
            }
            Ok(TimedBytes {
                bytes: image.into_raw(),
                time_s: times.time_s,
                arrival_s: times.arrival_s,
            })
        });
        Some(Ok(timed.map_or_else(Pixels::Broken, Pixels::Frame)))
    }
}

/// The names of the images of a folder in natural order.
pub(crate) fn image_names(folder: &Path) -> Result<Vec<String>> {
    let name = |(file, _): (PathBuf, u64)| {
        let name = file.file_name().unwrap_or_default();
        name.to_string_lossy().into_owned()
    };
    Ok(list_images(folder)?.into_iter().map(name).collect())
}

/// The names of the folders with images in a folder, in order, the first few.
fn folders_with_images(folder: &Path) -> Vec<String> {
    const MOST: usize = 4;
    let entries_of = |folder: &Path| std::fs::read_dir(folder).into_iter().flatten().flatten();
    let holds_images = |folder: &Path| entries_of(folder).any(|entry| is_image_name(&entry.path()));
    let folders = entries_of(folder).map(|entry| entry.path());
    let mut names: Vec<String> = folders
        .filter(|path| path.is_dir() && holds_images(path))
        .filter_map(|path| {
            path.file_name()
                .map(|name| in_line(&name.to_string_lossy()))
        })
        .collect();
    names.sort_unstable();
    names.truncate(MOST);
    names
}

/// Lists the images of a folder in natural order, each with its index in time.
///
/// If all names end in a number, the index is that number minus the first one, so that a missing file
/// leaves a gap in time; otherwise it is the position in the list. Hidden and other files are skipped. Folders, pipes and links
/// that lead nowhere are listed if they are called like images: they are broken images, and not to be overlooked.
fn list_images(folder: &Path) -> Result<Vec<(PathBuf, u64)>> {
    let unreadable = |error| {
        user_error!(
            "{}: the folder cannot be read: {error}; give a folder of JPEG or PNG images",
            folder.shown()
        )
    };
    if folder.is_file() {
        if is_image_name(folder) {
            return Ok(vec![(folder.to_owned(), 0)]);
        }
        return Err(user_error!(
            "{}: this is a file, but no image; give the folder that holds the images, or one image",
            folder.shown()
        ));
    }
    let mut files = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(unreadable)? {
        let path = entry.map_err(unreadable)?.path();
        if is_image_name(&path) {
            files.push(path);
        }
    }
    if files.is_empty() {
        if let Some(recordings) = recordings_in(folder) {
            return Err(user_error!(
                "{}: the folder holds no images, but recordings; give one of them: {recordings}",
                folder.shown()
            ));
        }
        let folders = folders_with_images(folder);
        if !folders.is_empty() {
            return Err(user_error!(
                "{}: the folder holds no images, but folders with images: {}; give one of them; for several cameras, write a scene with a table \
                 [cameras.NAME] for each (docs/several-cameras.md)",
                folder.shown(),
                folders.join(", ")
            ));
        }
        return Err(user_error!(
            "{}: the folder holds no images; allowed: files ending in .jpg, .jpeg or .png",
            folder.shown()
        ));
    }
    let numbers: Option<Vec<u64>> = files.iter().map(|file| trailing_number(file)).collect();
    let Some(numbers) = numbers else {
        files.sort_by_cached_key(|file| (natural_key(&file_name(file)), file.clone()));
        return Ok(files.into_iter().zip(0..).collect());
    };
    let mut numbered: Vec<_> = files.into_iter().zip(numbers).collect();
    numbered.sort_by(|a, b| (a.1, &a.0).cmp(&(b.1, &b.0)));
    if let Some([(a, number), (b, _)]) = numbered.array_windows().find(|[a, b]| a.1 == b.1) {
        return Err(user_error!(
            "{}: {} and {} have the same number, {number}; each image of a folder needs a number of its own",
            folder.shown(),
            file_name(a),
            file_name(b)
        ));
    }
    let first = numbered[0].1;
    Ok(numbered
        .into_iter()
        .map(|(file, number)| (file, number - first))
        .collect())
}

/// Replaces each image's index by its times.
fn with_times(
    folder: &Path,
    files: Vec<(PathBuf, u64)>,
    timing: &Timing,
) -> Result<Vec<(PathBuf, ImageTimes)>> {
    match timing {
        Timing::Fps(fps) => {
            if !(fps.is_finite() && *fps > 0.0) {
                return Err(user_error!(
                    "{}: fps is {fps}; allowed: a number of frames per second over 0",
                    folder.shown()
                ));
            }
            files
                .into_iter()
                .map(|(file, index)| {
                    let time_s = index as f64 / fps;
                    if time_s > MAX_TIME_S {
                        return Err(user_error!(
                            "{}: by its number its time_s is {time_s}; allowed: at most 1e12; number the images from the first on",
                            file.shown()
                        ));
                    }
                    Ok((file, ImageTimes::at(time_s)))
                })
                .collect()
        }
        Timing::TimesFile => {
            let path = folder.join("times.csv");
            let times = read_times(&path)?;
            check_rows(&path, &times, &files)?;
            files
                .into_iter()
                .map(|(file, index)| match times.get(&index) {
                    Some(&times) => Ok((file, times)),
                    None => Err(user_error!(
                        "{}: there is no row for frame {index} ({}); give each image its time_s",
                        path.shown(),
                        file_name(&file)
                    )),
                })
                .collect()
        }
    }
}

/// Fails if the table goes on after the last image, so that images before it may be missing and all others get wrong times.
/// Images that are numbered from 0 keep theirs whatever is missing.
fn check_rows(
    table: &Path,
    times: &BTreeMap<u64, ImageTimes>,
    files: &[(PathBuf, u64)],
) -> Result<()> {
    let (Some((&last_row, _)), Some((last_file, last)), Some((first_file, _))) =
        (times.last_key_value(), files.last(), files.first())
    else {
        return Ok(());
    };
    if last_row > *last && trailing_number(first_file) != Some(0) {
        return Err(user_error!(
            "{}: has times up to frame {last_row}, but the last image, {}, is frame {last}, so that other images may have \
             wrong times as well; remove the rows of images that are missing, or number the images from 0",
            table.shown(),
            file_name(last_file)
        ));
    }
    Ok(())
}

fn file_name(path: &Path) -> String {
    path.file_name()
        .map_or_else(String::new, |name| in_line(&name.to_string_lossy()))
}

fn is_image_name(path: &Path) -> bool {
    let extension = path.extension().map(|e| e.to_string_lossy().to_lowercase());
    matches!(extension.as_deref(), Some("jpg" | "jpeg" | "png"))
        && !file_name(path).starts_with('.')
}

/// Returns the number at the end of a file's name before its extension; `None` if there is none or it overflows.
pub(crate) fn trailing_number(path: &Path) -> Option<u64> {
    let stem = path.file_stem()?.to_string_lossy();
    let digits = stem.len() - stem.trim_end_matches(|c: char| c.is_ascii_digit()).len();
    stem[stem.len() - digits..].parse().ok()
}

/// Returns a key that alternates text and numbers, each number as its length and its digits, so that `b2` sorts
/// before `b10`.
fn natural_key(name: &str) -> Vec<(String, usize, String)> {
    let mut key = Vec::new();
    let mut rest = name;
    while !rest.is_empty() {
        let text_end = rest
            .find(|c: char| c.is_ascii_digit())
            .unwrap_or(rest.len());
        let (text, after) = rest.split_at(text_end);
        let digits_end = after
            .find(|c: char| !c.is_ascii_digit())
            .unwrap_or(after.len());
        let (digits, after) = after.split_at(digits_end);
        let number = digits.trim_start_matches('0');
        key.push((text.to_owned(), number.len(), number.to_owned()));
        rest = after;
    }
    key
}

#[cfg(test)]
#[path = "images_tests.rs"]
mod tests;
