//! A detected target that is reset.

use super::exposures::note;
use super::*;
use crate::color::YuvEncoding;
use crate::{Frame, PixelFormat};
use pardalis_camera::{Pinhole, Pose};

/// A red ball before a grey wall.
fn target() -> DetectedTarget {
    let (mut bytes, mut mask) = (Vec::new(), Vec::new());
    for pixel in 0..40 * 40 {
        let is_ball = (pixel / 40_i32 - 20).pow(2) + (pixel % 40 - 20).pow(2) < 100;
        bytes.extend(if is_ball { [220, 40, 30] } else { [120; 3] });
        mask.push(is_ball);
    }
    let encoding = YuvEncoding::default();
    let frame = Frame::new(PixelFormat::Rgb8, encoding, 40, 40, bytes, 0.0).unwrap();
    let colors = ColorModel::from_image(&frame, &mask).unwrap();
    let lens = Pinhole::new([100.0; 2], [19.5; 2], &[]).unwrap();
    let view = View::new(lens, Pose::identity(), (40, 40), None).unwrap();
    let settings = DetectedSettings::ball(0.1, colors).unwrap();
    DetectedTarget::new(&settings, 0, Draws::new(1, 0), &[view], Level::best()).unwrap()
}

#[test]
fn a_reset_forgets_how_well_exposures_explained_the_frames() {
    let mut target = target();
    let exposures = &mut target.detector.exposures;
    note(&mut exposures.at_rest, 10.0);
    note(&mut exposures.streaks[3], 20.0);
    assert_eq!(exposures.ranked()[0], 3);
    target.reset();
    assert_eq!(target.detector.exposures, Exposures::default());
    assert_eq!(target.detector.exposures.ranked()[0], 0);
}
