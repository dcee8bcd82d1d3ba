//! What must hold for any table of times and any output of ffmpeg; see [`crate::fuzzing`].

use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::channel;

use pardalis::frame::MAX_TIME_S;
use pardalis_images::MAX_PIXELS;
use pardalis_scene::VideoSettings;

use super::ffmpeg::{read_log, seconds};
use super::nut::Nut;
use super::probed::probed_in;
use super::times::times_in;
use super::video::{Layout, check_size, content, upright_size_px};
use crate::fuzzed_file::{FILE, check_error};

pub(crate) fn times(bytes: &[u8]) -> bool {
    match times_in(Path::new(FILE), bytes) {
        Ok(times) => {
            let seconds = times.values().flat_map(|t| [Some(t.time_s), t.arrival_s]);
            assert!(seconds.flatten().all(|s| s.abs() <= MAX_TIME_S));
            true
        }
        Err(error) => {
            check_error(&error);
            false
        }
    }
}

/// Reads frames of any size as [`super::video::VideoFrames`] reads those of one size.
pub(crate) fn nut(bytes: &[u8]) -> bool {
    let mut nut = Nut::new(bytes);
    // After an error the program reads no further.
    let Ok(Some(_)) = nut.size_px() else {
        return false;
    };
    let mut read = 0;
    let mut is_whole = false;
    loop {
        let header = match nut.next_frame() {
            Ok(Some(header)) => header,
            Ok(None) => {
                is_whole = true;
                break;
            }
            Err(_) => break,
        };
        assert!(seconds(header.ticks, nut.time_base()).is_finite());
        // Frames of another size than the stream's are not read.
        if header.byte_count > bytes.len() {
            break;
        }
        let mut frame = vec![0; header.byte_count];
        if nut.read(&mut frame).is_err() {
            break;
        }
        read += 1;
        assert!(read <= bytes.len(), "frames without bytes");
    }
    is_whole && read > 0
}

pub(crate) fn ffprobe(bytes: &[u8]) -> bool {
    let stream = match probed_in(FILE, bytes) {
        Ok(stream) => stream,
        Err(error) => {
            assert!(format!("{error:#}").contains(FILE));
            return false;
        }
    };
    let size_px = upright_size_px(&stream);
    match check_size(FILE, size_px) {
        Ok(()) => assert!((1..=MAX_PIXELS).contains(&(size_px.0 * size_px.1))),
        Err(error) => check_error(&error),
    }
    let settings = VideoSettings::default();
    if let Some(span) = stream.span(&settings) {
        assert!(span.first_s.is_finite() && span.first_s <= span.last_s && span.last_s.is_finite());
        assert!(
            span.step_s
                .is_none_or(|step_s| step_s > 0.0 && step_s.is_finite()),
            "{span:?}"
        );
    }
    stream.frame_count(&settings);
    let layout = Layout::of(&stream, None);
    assert!(!content(&stream, &layout, false).is_empty());
    true
}

/// Reads ffmpeg's messages.
pub(crate) fn messages(bytes: &[u8]) -> bool {
    let (sender, colors) = channel();
    let error_count = AtomicUsize::new(0);
    let quoted = read_log(bytes, sender, &error_count);
    assert!(quoted.len() <= 5);
    let lines = bytes.split(|&byte| byte == b'\n').count();
    assert!(error_count.load(Ordering::Relaxed) <= lines);
    let Ok(stream) = colors.recv() else {
        return false;
    };
    assert!(colors.recv().is_err(), "colours are sent once");
    if let Err(error) = Layout::of_live(FILE, &stream, None) {
        check_error(&error);
    }
    true
}
