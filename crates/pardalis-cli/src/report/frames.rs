//! The images of a page: reduced copies of annotated frames.

use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};

use anyhow::Result;
use pardalis_images::{JpegSampling, encode_jpeg};
use pardalis_viewer::data_address;
use serde::Serialize;

use crate::source::decode::decode_image;

/// The most bytes that images take in a page.
const MAX_BYTES: usize = 20 << 20;

/// The greatest width of a copy, in pixels: that of its place in the page, on a screen with fine pixels.
const MAX_WIDTH: u32 = 480;

const JPEG_QUALITY: u8 = 72;

/// The images of one time.
#[derive(Debug, Serialize)]
pub(super) struct PageFrame {
    time_s: f64,
    /// The address of the image of each camera.
    images: BTreeMap<String, String>,
}

/// The files of one frame, each with its camera's name.
type Files = Vec<(String, PathBuf)>;

/// Reads the annotated frames in a folder, as many as fit into a page, and returns them with a note if that is not all. Frames without rows are left
/// out. Without the folder there are none. Frames that are not in folders named after cameras are those of `only_camera`.
pub(super) fn read(
    folder: &Path,
    times_s: &BTreeMap<usize, f64>,
    only_camera: &str,
) -> Result<(Vec<PageFrame>, Option<String>)> {
    let mut files: BTreeMap<usize, Files> = BTreeMap::new();
    for (camera, folder) in camera_folders(folder, only_camera) {
        for (number, path) in frames_in(&folder) {
            if times_s.contains_key(&number) {
                files
                    .entry(number)
                    .or_default()
                    .push((camera.clone(), path));
            }
        }
    }
    let count = files.len();
    let files: Vec<(usize, Files)> = files.into_iter().collect();
    let mut step = 1;
    let mut frames = Vec::new();
    let mut bytes = 0;
    let mut at = 0;
    while let Some((number, files)) = files.get(at) {
        let frame = read_frame(times_s[number], files)?;
        let size = frame.images.values().map(String::len).sum::<usize>();
        if frames.is_empty() {
            // As if all were as large as the first.
            step = (count * size).div_ceil(MAX_BYTES).max(1);
        }
        bytes += size;
        frames.push((frame, size));
        at += step;
        if bytes > MAX_BYTES && frames.len() > 1 {
            let mut place = 0;
            frames.retain(|_| {
                place += 1;
                place % 2 == 1
            });
            step *= 2;
            bytes = frames.iter().map(|(_, size)| size).sum();
            at = frames.len() * step;
        }
    }
    let note = (step > 1)
        .then(|| format!("This page has one of {step} annotated frames, so that it stays small."));
    Ok((frames.into_iter().map(|(frame, _)| frame).collect(), note))
}

/// Returns the folder of each camera: the folder itself if it has frames, for the only camera, or its subfolders.
fn camera_folders(folder: &Path, only: &str) -> Vec<(String, PathBuf)> {
    if !frames_in(folder).is_empty() {
        return vec![(only.to_owned(), folder.to_owned())];
    }
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    let folders = entries.filter(|entry| entry.file_type().is_ok_and(|kind| kind.is_dir()));
    let named = |entry: fs::DirEntry| {
        (
            entry.file_name().to_string_lossy().into_owned(),
            entry.path(),
        )
    };
    let mut folders: Vec<_> = folders.map(named).collect();
    folders.sort();
    folders
}

/// Returns the frames in a folder, each with its number.
fn frames_in(folder: &Path) -> Vec<(usize, PathBuf)> {
    let entries = fs::read_dir(folder).into_iter().flatten().flatten();
    let frames = entries.filter_map(|entry| {
        let path = entry.path();
        let is_file = entry.file_type().is_ok_and(|kind| kind.is_file());
        let is_jpeg = path.extension().is_some_and(|ending| ending == "jpg");
        let number = path.file_stem()?.to_str()?.parse().ok()?;
        (is_file && is_jpeg).then_some((number, path))
    });
    frames.collect()
}

fn read_frame(time_s: f64, files: &Files) -> Result<PageFrame> {
    let mut images = BTreeMap::new();
    for (camera, path) in files {
        let copy = decode_image(path)?.at_most(MAX_WIDTH);
        let jpeg = encode_jpeg(&copy, JPEG_QUALITY, JpegSampling::Automatic)?;
        images.insert(camera.clone(), data_address("image/jpeg", &jpeg));
    }
    Ok(PageFrame { time_s, images })
}
