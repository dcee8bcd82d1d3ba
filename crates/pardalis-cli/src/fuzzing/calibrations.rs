//! Calibrations of all formats.

use pardalis_camera::CalibratedCamera;
use pardalis_camera::formats::{Format, Lens};
use pardalis_core::Error;
use pardalis_scene::calibration::{CalibrationFormat, read, read_toml, write};

use super::text_of;
use crate::commands::init::sequence::Recording;
use crate::fuzzed_file::check_message;

/// Reads a file of a format that states its lens.
pub(super) fn calibration(bytes: &[u8]) -> bool {
    read_as(&[None], bytes)
}

/// Reads a file of a format that need not state its lens, as each lens in turn.
pub(super) fn ambiguous(bytes: &[u8]) -> bool {
    let lenses = [
        None,
        Some(Lens::Pinhole),
        Some(Lens::Fisheye),
        Some(Lens::Omnidir),
        Some(Lens::Rectified),
    ];
    read_as(&lenses, bytes)
}

fn read_as(lenses: &[Option<Lens>], bytes: &[u8]) -> bool {
    let Some(text) = text_of(bytes) else {
        return false;
    };
    let mut is_read = false;
    for lens in lenses {
        match read(&text, *lens) {
            Ok(cameras) => {
                check_cameras(&cameras);
                is_read = true;
            }
            Err(error) => check_located(&error, &text),
        }
    }
    is_read
}

/// Like [`calibration`], and `pardalis init` reads the recording data in the same file.
pub(super) fn sequence(bytes: &[u8]) -> bool {
    if let Some(text) = text_of(bytes) {
        let recording = Recording::of(&text);
        let numbers = [recording.fps, recording.ball_radius_m];
        assert!(numbers.into_iter().flatten().all(f64::is_finite));
    }
    calibration(bytes)
}

/// Checks that cameras are written and read again as the same ones in every format that can represent them.
fn check_cameras(cameras: &[CalibratedCamera]) {
    assert!((1..=pardalis_camera::formats::MAX_CAMERAS).contains(&cameras.len()));
    for camera in cameras {
        let values = camera.camera.parameters();
        assert!(values.iter().all(|(_, v)| v.is_finite()), "{values:?}");
        if let Some((width, height)) = camera.size_px {
            assert!(width > 0 && height > 0, "{width} x {height}");
        }
    }
    let Ok(written) = write(CalibrationFormat::Pardalis, cameras) else {
        panic!("two cameras have the same name: {cameras:?}");
    };
    let again = read_toml(&written).unwrap_or_else(|problems| panic!("{problems:?}\n{written}"));
    assert_eq!(again.len(), cameras.len());
    for (again, camera) in again.iter().zip(cameras) {
        assert_eq!(again.name, camera.name);
        assert_eq!(again.size_px, camera.size_px);
        assert_eq!(
            again.camera.parameters(),
            camera.camera.parameters(),
            "{written}"
        );
        assert_eq!(
            again.world_from_camera.is_some(),
            camera.world_from_camera.is_some()
        );
    }
    for format in Format::ALL {
        let Ok(written) = write(CalibrationFormat::Foreign(format), cameras) else {
            continue;
        };
        let again = read(&written, None).unwrap_or_else(|error| panic!("{error}\n{written}"));
        assert_eq!(again.len(), cameras.len());
    }
}

/// Checks that an error is in a line of the text.
fn check_located(error: &Error, text: &str) {
    let message = error.to_string();
    check_message(&message);
    let line = message
        .strip_prefix("line ")
        .and_then(|rest| rest.split(':').next());
    let line: usize = line.and_then(|line| line.parse().ok()).expect(&message);
    // In YAML, a lone carriage return also ends a line.
    let last = text.matches(['\n', '\r']).count() + 1;
    assert!((1..=last).contains(&line), "{message}");
}
