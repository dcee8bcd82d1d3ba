//! Pictures of things in the target's colours, drawn pixel by pixel, and a camera that sees them.

use pardalis::camera::{Pinhole, Pose};
use pardalis::color::{ColorModel, YuvEncoding};
use pardalis::tracker::DetectedSettings;
use pardalis::view::View;
use pardalis::{Frame, PixelFormat, Tracker};
use pardalis_core::simd::Level;
use pardalis_images::RgbImage;

use super::frame;

const SIZE: (u32, u32) = (320, 240);
/// The middle of the pictures.
pub(crate) const CENTER_PX: [f64; 2] = [159.5, 119.5];
pub(crate) const FOCAL_PX: f64 = 400.0;
/// The radius of the target.
pub(crate) const RADIUS_M: f64 = 0.1;

/// A thing in the target's colours: a superellipse of this exponent, radius and middle. With the exponent 2 it is a ball far away.
#[derive(Clone, Copy)]
pub(crate) struct Thing {
    pub(crate) exponent: f64,
    pub(crate) radius_px: f64,
    pub(crate) middle_px: [f64; 2],
}

/// Returns a picture of these things, with `covers` in another colour before them, and a mask of the first.
fn picture(things: &[Thing], covers: &[Thing]) -> (RgbImage, Vec<bool>) {
    let mut picture = RgbImage::new(SIZE.0, SIZE.1);
    let mut mask = Vec::new();
    let mut grain = 0.0;
    for (x, y, pixel) in picture.enumerate_pixels_mut() {
        let coverage = |thing: &Thing| {
            let [u, v] = [
                f64::from(x) - thing.middle_px[0],
                f64::from(y) - thing.middle_px[1],
            ];
            let n = thing.exponent;
            let out = (u.abs().powf(n) + v.abs().powf(n)).powf(1.0 / n) - thing.radius_px;
            0.5 * libm::erfc(out)
        };
        let covered = covers.iter().map(coverage).fold(0.0, f64::max);
        let share = things.iter().map(coverage).fold(0.0, f64::max);
        mask.push(things.first().is_some_and(|thing| coverage(thing) > 0.5));
        let colors = [
            [230.0, 60.0, 70.0],
            [110.0, 110.0, 60.0],
            [20.0, 70.0, 120.0],
        ];
        for (value, [orange, green, blue]) in pixel.iter_mut().zip(colors) {
            // As grainy as those of cameras, and darker to the right.
            grain = (0.618 * f64::from(x) + 0.382 * f64::from(y) + 7.3 * grain).fract();
            let light = 1.0 - 0.0005 * f64::from(x);
            let seen = green + share * (orange - green);
            *value = (light * (seen + covered * (blue - seen)) + 24.0 * (grain - 0.5))
                .clamp(0.0, 255.0) as u8;
        }
    }
    (picture, mask)
}

/// Returns the frame at a time of these things, with `covers` before them.
pub(crate) fn shown(things: &[Thing], covers: &[Thing], time_s: f64) -> Frame {
    let picture = picture(things, covers).0;
    frame(&picture, PixelFormat::Rgb8, YuvEncoding::default(), time_s)
}

/// Returns the camera at a pose.
pub(crate) fn view(world_from_camera: Pose) -> View {
    let lens = Pinhole::new([FOCAL_PX; 2], CENTER_PX, &[]).unwrap();
    let size = (SIZE.0 as usize, SIZE.1 as usize);
    View::new(lens, world_from_camera, size, None).unwrap()
}

/// Returns the settings of a ball whose colours are learnt from a picture of this one.
pub(crate) fn settings_of(ball: Thing) -> DetectedSettings {
    let mask = picture(&[ball], &[]).1;
    let colors = ColorModel::from_image(&shown(&[ball], &[], 0.0), &mask).unwrap();
    DetectedSettings::ball(RADIUS_M, colors).unwrap()
}

/// Returns a tracker of a ball whose colours are learnt from a picture of this one.
pub(crate) fn tracker_of(ball: Thing) -> Tracker {
    let view = view(Pose::identity());
    Tracker::new(vec![view], vec![settings_of(ball)], 1, Level::best()).unwrap()
}
