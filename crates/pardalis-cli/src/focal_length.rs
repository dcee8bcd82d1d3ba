//! The focal length of a pinhole camera that has not been calibrated.

use std::path::Path;

use anyhow::Result;
use pardalis_images::{exif_focal_length_px, size};

use crate::output::Shown;
use crate::source::decode::check_file;
use crate::user_error::user_error;

/// The angle across the longer side of an image that is assumed for unknown cameras, degrees. Webcams and phones have 50 to 75.
pub(crate) const TYPICAL_FOV_DEG: f64 = 60.0;
/// The angles that a pinhole camera may have, degrees.
const FOV_ALLOWED_DEG: std::ops::RangeInclusive<f64> = 1.0..=170.0;

/// Returns the focal length in pixels of a camera with images of this width and height, from the angle across the longer
/// side in degrees, which must be above 0 and below 180.
pub(crate) fn focal_length_px((width, height): (usize, usize), fov_deg: f64) -> f64 {
    0.5 * width.max(height) as f64 / libm::tan((0.5 * fov_deg).to_radians())
}

/// Returns the middle of an image of this width and height in pixels, pixel centres at integers.
pub(crate) fn middle_px((width, height): (usize, usize)) -> [f64; 2] {
    [width, height].map(|side| 0.5 * (side as f64 - 1.0))
}

/// Returns the angle across the longer side of a JPEG image in degrees, if its EXIF data state a focal length.
///
/// Errors: the file is no image that can be read.
pub(crate) fn exif_fov_deg(path: &Path) -> Result<Option<f64>> {
    check_file(path)?;
    let name = path.shown();
    check_file(path)?;
    let file =
        std::fs::read(path).map_err(|error| user_error!("{name}: cannot be read: {error}"))?;
    let stated = size(&file).and_then(|size| Ok((size, exif_focal_length_px(&file)?)));
    let ((width, height), focal_px) = stated.map_err(|error| user_error!("{name}: {error}"))?;
    let fov_deg = focal_px.map(|focal_px| {
        let half = 0.5 * width.max(height) as f64;
        2.0 * libm::atan2(half, focal_px).to_degrees()
    });
    Ok(fov_deg.filter(|fov_deg| FOV_ALLOWED_DEG.contains(fov_deg)))
}

/// Parses an angle across the longer side in degrees.
pub(crate) fn parse_fov_deg(text: &str) -> Result<f64, String> {
    let fov_deg: f64 = text.parse().map_err(|_| "is not a number".to_owned())?;
    if FOV_ALLOWED_DEG.contains(&fov_deg) {
        Ok(fov_deg)
    } else {
        let (least, most) = (FOV_ALLOWED_DEG.start(), FOV_ALLOWED_DEG.end());
        Err(format!(
            "allowed: {least} to {most} degrees; wider lenses are no pinhole cameras"
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_angle_is_that_across_the_longer_side() {
        assert!((focal_length_px((800, 600), 90.0) - 400.0).abs() < 1e-9);
        assert!((focal_length_px((600, 800), 90.0) - 400.0).abs() < 1e-9);
        assert_eq!(middle_px((640, 480)), [319.5, 239.5]);
    }

    #[test]
    fn angles_that_no_pinhole_camera_has_are_refused() {
        assert_eq!(parse_fov_deg("62.5"), Ok(62.5));
        for text in ["0", "-60", "175", "NaN", "inf", "wide", ""] {
            assert!(parse_fov_deg(text).is_err(), "{text}");
        }
    }
}
