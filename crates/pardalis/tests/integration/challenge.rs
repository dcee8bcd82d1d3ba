//! Two things that may be the target: evidence over time decides between them.

use nalgebra::Vector3;
use pardalis::camera::{Pinhole, Pose};
use pardalis::color::{ColorModel, YuvEncoding};
use pardalis::tracker::{DetectedSettings, TrackState};
use pardalis::view::View;
use pardalis::{Frame, PixelFormat, TargetId, Tracker};
use pardalis_core::simd::Level;
use pardalis_images::RgbImage;

use crate::common::{frame, set_of};

const SIZE: (u32, u32) = (320, 240);
const CENTER_PX: [f64; 2] = [159.5, 119.5];
const FOCAL_PX: f64 = 400.0;
const RADIUS_M: f64 = 0.1;

/// A thing in the target's colours: a superellipse of this exponent, radius and middle. With the exponent 2 it is a ball far away.
#[derive(Clone, Copy)]
struct Thing {
    exponent: f64,
    radius_px: f64,
    middle_px: [f64; 2],
}

/// Returns a picture of these things and a mask of the first.
fn picture(things: &[Thing]) -> (RgbImage, Vec<bool>) {
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
        let share = things.iter().map(coverage).fold(0.0, f64::max);
        mask.push(things.first().is_some_and(|thing| coverage(thing) > 0.5));
        for (value, [orange, green]) in
            pixel
                .iter_mut()
                .zip([[230.0, 60.0], [110.0, 110.0], [20.0, 70.0]])
        {
            // As grainy as those of cameras, and darker to the right.
            grain = (0.618 * f64::from(x) + 0.382 * f64::from(y) + 7.3 * grain).fract();
            let light = 1.0 - 0.0005 * f64::from(x);
            *value = (light * (green + share * (orange - green)) + 24.0 * (grain - 0.5))
                .clamp(0.0, 255.0) as u8;
        }
    }
    (picture, mask)
}

/// A thing that swings from side to side.
fn swinging(number: usize, exponent: f64) -> Thing {
    Thing {
        exponent,
        radius_px: 22.0,
        middle_px: [160.0 + 100.0 * (0.08 * number as f64).cos(), 60.0],
    }
}

/// Tracks 60 frames of these things. Returns the distances of the estimates from what swings, in radii; `None` if it is not tracked.
fn off_swinging(things: impl Fn(usize) -> Vec<Thing>) -> Vec<Option<f64>> {
    let show = |things: &[Thing], time_s: f64| -> Frame {
        frame(
            &picture(things).0,
            PixelFormat::Rgb8,
            YuvEncoding::default(),
            time_s,
        )
    };
    let mask = picture(&[swinging(0, 2.0)]).1;
    let colors = ColorModel::from_image(&show(&[swinging(0, 2.0)], 0.0), &mask).unwrap();
    let settings = DetectedSettings::ball(RADIUS_M, colors).unwrap();
    let lens = Pinhole::new([FOCAL_PX; 2], CENTER_PX, &[]).unwrap();
    let size = (SIZE.0 as usize, SIZE.1 as usize);
    let view = View::new(lens, Pose::identity(), size, None).unwrap();
    let mut tracker = Tracker::new(vec![view], vec![settings], 1, Level::best()).unwrap();
    let track = |number: usize| {
        let frame = show(&things(number), 0.04 * number as f64);
        tracker.observe(&set_of(frame)).unwrap();
        let estimate = tracker.estimate(TargetId::new(0)).unwrap();
        let [x, y, z] = estimate
            .kinematics
            .filter(|_| estimate.state == TrackState::Tracking)?
            .position_m;
        let seen_px = [
            FOCAL_PX * x / z + CENTER_PX[0],
            FOCAL_PX * y / z + CENTER_PX[1],
        ];
        let swinging = swinging(number, 2.0);
        let off_px = Vector3::new(
            seen_px[0] - swinging.middle_px[0],
            seen_px[1] - swinging.middle_px[1],
            0.0,
        );
        Some(off_px.norm() / swinging.radius_px)
    };
    (0..60).map(track).collect()
}

/// Something at rest with this exponent.
fn still(exponent: f64) -> Thing {
    Thing {
        exponent,
        radius_px: 30.0,
        middle_px: [160.0, 170.0],
    }
}

/// The exponent of something that is taken for a ball where there is no ball.
const CUSHION: f64 = 3.2;

#[test]
fn a_ball_that_appears_wins_over_something_still_that_looks_less_like_it() {
    let off = off_swinging(|number| {
        let mut things = vec![still(CUSHION)];
        things.extend((number >= 10).then(|| swinging(number, 2.0)));
        things
    });
    println!("{off:.1?}");
    // At first, nothing else is there.
    assert!(off[9].is_some_and(|off| off > 2.0), "{:?}", off[9]);
    let late = &off[25..];
    assert!(
        late.iter().all(|off| off.is_some_and(|off| off < 0.1)),
        "{late:?}"
    );
}

#[test]
fn what_is_still_does_not_win_over_what_moves() {
    let off = off_swinging(|number| {
        let mut things = vec![swinging(number, CUSHION)];
        // Even if it looks more like a ball.
        things.extend((number >= 25).then(|| still(2.0)));
        things
    });
    println!("{off:.1?}");
    let followed = |off: &Option<f64>| off.is_some_and(|off| off < 0.5);
    assert!(off[2..].iter().all(followed), "{off:?}");
}
