//! Recordings of robots.

use std::fs;
use std::path::PathBuf;

use pardalis_scene::FrameRange;

use crate::fuzzed_file::{FILE, check_error, check_message};
use crate::mcap::{Images, calibrations, image_topics};

/// Larger images in recordings are not asked for, because decoding them takes long.
const DECODED_PX: usize = 1 << 18;

/// A file that is removed with its folder at the end.
struct Recording(PathBuf);

impl Recording {
    fn new(bytes: &[u8]) -> Self {
        let thread = std::thread::current().id();
        let folder = format!("pardalis-{}-{thread:?}", std::process::id());
        let folder = std::env::temp_dir().join(folder);
        fs::create_dir_all(&folder).expect("a place for the file");
        let path = folder.join(FILE);
        fs::write(&path, bytes).expect("a place for the file");
        Self(path)
    }
}

impl Drop for Recording {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(self.0.parent().expect("a folder"));
    }
}

/// Reads the calibrations and images of a recording.
pub(super) fn mcap(bytes: &[u8]) -> bool {
    let file = Recording::new(bytes);
    let path = &file.0;
    let check = |message: &str| {
        assert!(message.contains(FILE), "names no file: {message}");
        check_message(message);
    };
    let mut is_read = false;
    match calibrations(path, None) {
        Ok((cameras, problems)) => {
            assert!(!cameras.is_empty());
            for problem in &problems {
                check(problem);
            }
            is_read = true;
        }
        Err(error) => check(&error),
    }
    let topics = match image_topics(path) {
        Ok(topics) => topics,
        Err(error) => {
            check(&error);
            return is_read;
        }
    };
    for (_, topic) in &topics {
        let images = match Images::open(path, Some(topic), FrameRange::ALL) {
            Ok(images) => images,
            Err(error) => {
                check_error(&error);
                continue;
            }
        };
        let ((width, height), format) = images.format();
        assert!(width > 0 && height > 0);
        if width * height > DECODED_PX {
            continue;
        }
        let length = format.byte_count(width, height);
        for image in images {
            match image.and_then(|image| image) {
                Ok(image) => {
                    assert_eq!(image.bytes.len(), length);
                    assert!(image.time_s.is_finite() && image.arrival_s.is_finite());
                    is_read = true;
                }
                Err(error) => check_error(&error),
            }
        }
    }
    is_read
}
