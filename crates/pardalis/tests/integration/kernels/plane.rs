//! The region and difference cues against the reference: every camera, format and mask, discs and rectangles,
//! any samples and bins.

use pardalis::color::{ChannelBins, ColorModel, Palette, YuvEncoding};
use pardalis::likelihood::{Cue, CueSettings, Cues, PatchSettings};
use pardalis::reference::{
    difference_log_likelihood, open_pixel, region_log_likelihood, region_pixels,
};
use pardalis::shape::Shape;
use pardalis::view::View;
use pardalis::{Frame, PixelFormat};
use pardalis_camera::Pose;
use pardalis_camera::{Camera, Mask, Plane};
use pardalis_core::simd::Level;
use pardalis_filter::Likelihood;
use pardalis_filter::Particles;
use pardalis_images::RgbImage;

use super::{
    BORDER_PX, FORMATS, Tally, Uniform, VIDEO, cameras, particles, patches, some_flat_shape, view,
    world_from,
};
use crate::common::robot::{self, landmark, landmark_colors, mast_view};
use crate::common::{ball, ball_colors, fisheye, frame, jump_picture, world_from_fisheye};

/// Colours of YUV pixels this close to halfway between two bytes may be rounded either way.
const HALFWAY: f64 = 1e-4;

fn some_settings(random: &mut Uniform) -> PatchSettings {
    let mut settings = PatchSettings::around();
    settings.scale = random.between(0.3, 2.0);
    settings.samples = 1 + random.below(12);
    settings.bins = ChannelBins::new(2 << random.below(6)).unwrap();
    settings.sigma = random.between(0.05, 0.5);
    settings
}

fn log_likelihoods(
    cue: Cue,
    level: Level,
    views: &[View],
    frames: &[(usize, Frame)],
    (shape, colors): (Shape, &ColorModel),
    particles: &Particles,
) -> Vec<f32> {
    let settings: [CueSettings; 1] = [cue.into()];
    let mut cues = Cues::new(&settings, shape, Some(colors), level).unwrap();
    let mut out = vec![f32::NAN; particles.count()];
    cues.of(views, frames).log_likelihoods(particles, &mut out);
    out
}

/// Reports whether single precision may round a sample to another pixel than double precision, or fixed point
/// a colour to another bin.
fn is_borderline(
    view: &View,
    frame: &Frame,
    shape: &Shape,
    settings: &PatchSettings,
    position_m: [f64; 3],
) -> bool {
    // Products of such distances exceed single precision.
    if position_m.iter().any(|c| c.abs() > 1e18) {
        return true;
    }
    let (width, height) = (view.size().0 as f64, view.size().1 as f64);
    let border_px = match view.camera() {
        Camera::ExactMirror(_) => 5.0 * BORDER_PX,
        _ => BORDER_PX,
    };
    let samples = region_pixels(view, shape, settings, position_m);
    let near_border = |&[u, v]: &[f64; 2]| {
        let in_image = (-1.0..width).contains(&u) && (-1.0..height).contains(&v);
        in_image
            && [u, v]
                .iter()
                .any(|c| ((c - c.floor()) - 0.5).abs() < border_px)
    };
    let is_halfway = |&pixel: &[f64; 2]| {
        open_pixel(view, pixel).is_some_and(|[x, y]| {
            let rgb = frame
                .encoding()
                .rgb_from_yuv(frame.components(x, y).map(f64::from));
            rgb.iter().any(|c| ((c - c.floor()) - 0.5).abs() < HALFWAY)
        })
    };
    let seen = || samples.iter().flatten();
    if seen().any(near_border) || frame.format() != PixelFormat::Rgb8 && seen().any(is_halfway) {
        return true;
    }
    // Far away, or at the border of the camera's domain, single precision itself is too coarse.
    let shift = 1e-5 * position_m.iter().map(|c| c.abs()).sum::<f64>().max(0.1);
    (0..6).any(|k| {
        let mut shifted = position_m;
        shifted[k % 3] += if k < 3 { shift } else { -shift };
        let others = region_pixels(view, shape, settings, shifted);
        samples.iter().zip(&others).any(|pair| match pair {
            (Some(a), Some(b)) => (0..2).any(|c| (a[c] - b[c]).abs() > 0.2),
            (a, b) => a.is_some() != b.is_some(),
        })
    })
}

/// Compares both cues with the reference, and the levels with each other, for one set of particles.
fn compare(
    views: &[View],
    frames: &[(usize, Frame)],
    colors: &ColorModel,
    (shape, settings): (Shape, PatchSettings),
    particles: &Particles,
    tally: &mut Tally,
) {
    let [region, difference] = [Cue::Region(settings), Cue::Difference(settings)].map(|cue| {
        let of = |level| log_likelihoods(cue, level, views, frames, (shape, colors), particles);
        let best = of(Level::best());
        for level in Level::available() {
            let same = |(a, b): (&f32, &f32)| a.to_bits() == b.to_bits();
            assert!(best.iter().zip(&of(level)).all(same), "{level:?}: {cue:?}");
        }
        best
    });
    // The likelihood if none of a camera's samples were visible.
    let unseen = settings.log_likelihood(frames.len() as f64);
    for i in 0..particles.count() {
        let position_m = particles.position_m(i);
        let borderline = |(camera, frame): &(usize, Frame)| {
            is_borderline(&views[*camera], frame, &shape, &settings, position_m)
        };
        if frames.iter().any(borderline) {
            tally.borderline += 1;
            continue;
        }
        let naive_region =
            region_log_likelihood(&settings, &shape, colors, views, frames, position_m);
        let naive_difference =
            difference_log_likelihood(&settings, &shape, views, frames, position_m);
        for (fast, naive) in [(region[i], naive_region), (difference[i], naive_difference)] {
            // Similarities are sums of some hundred terms in single precision.
            let error = (f64::from(fast) - naive).abs();
            assert!(
                error <= -settings.log_likelihood(1e-5) + 1e-6 * naive.abs(),
                "{fast}, but the reference is {naive}: {position_m:?}, {:?}, {settings:?}, {shape:?}, {:?}",
                views[0].camera(),
                frames[0].1.format()
            );
        }
        tally.compared += 1;
        tally.seen += usize::from(naive_difference > unseen + 1e-9);
    }
}

/// Returns the picture a little later: one part has moved, the other is static.
fn moved(picture: &RgbImage) -> RgbImage {
    let (width, height) = picture.dimensions();
    RgbImage::from_fn(width, height, |x, y| {
        let by = if y % 50 < 35 { 4 } else { 0 };
        picture.get_pixel((x + by).min(width - 1), y)
    })
}

fn mask(frame: &Frame) -> Mask {
    let (width, height) = (frame.width(), frame.height());
    let grey: Vec<u8> = (0..width * height)
        .map(|i| u8::from(i % width > width / 3 && i % 61 != 0) * 255)
        .collect();
    Mask::from_grey(width, height, &grey).unwrap()
}

#[test]
fn regions_agree_with_the_reference_for_every_camera_format_and_mask() {
    let mut random = Uniform::new(31);
    let colors = ball_colors(Palette::HSI);
    let mut tally = Tally::default();
    for (number, picture) in [jump_picture(30), patches(5)].iter().enumerate() {
        let encoding = [YuvEncoding::default(), VIDEO][number];
        let frames = FORMATS.map(|format| frame(picture, format, encoding, 0.0));
        let before = FORMATS.map(|format| frame(&moved(picture), format, encoding, -0.04));
        // In the image itself, metres are pixels.
        let image = (Camera::Plane(Plane::image()), 100.0);
        for (camera, unit_m) in cameras()
            .into_iter()
            .map(|camera| (camera, 1.0))
            .chain([image])
        {
            for mask in [None, Some(mask(&frames[0]))] {
                for (number, frame) in frames.iter().enumerate() {
                    let pose = world_from(&camera);
                    let mut views = [view(camera.clone(), pose, frame, mask.clone())];
                    // A camera may change its format from one frame to the next.
                    views[0].keep(before[(number + random.below(2)) % before.len()].clone());
                    let scene = (
                        some_flat_shape(&mut random, unit_m),
                        some_settings(&mut random),
                    );
                    let particles = particles(&views[0], 40, &mut random);
                    let frames = [(0, frame.clone())];
                    compare(&views, &frames, &colors, scene, &particles, &mut tally);
                }
            }
        }
    }
    assert!(tally.compared > tally.borderline, "{tally:?}");
    assert!(4 * tally.seen > tally.compared, "{tally:?}");
}

#[test]
fn likelihoods_of_a_rig_multiply_for_any_number_of_particles() {
    let picture = jump_picture(30);
    let frames = [PixelFormat::Rgb8, PixelFormat::Nv12, PixelFormat::I420];
    let frames = frames.map(|format| frame(&picture, format, VIDEO, 0.0));
    let aside = Pose::translation(0.3, -0.1, 0.2) * world_from_fisheye();
    let mut views = [
        view(fisheye(), world_from_fisheye(), &frames[0], None),
        view(fisheye(), aside, &frames[0], None),
        mast_view(),
    ];
    // The second camera has no previous frame.
    views[0].keep(frame(&moved(&picture), PixelFormat::Rgb8, VIDEO, -0.04));
    views[2].keep(frame(&moved(&picture), PixelFormat::Rgb8, VIDEO, -0.04));
    let frames: Vec<(usize, Frame)> = frames.into_iter().enumerate().collect();
    let colors = ball_colors(Palette::HSI);
    let mut random = Uniform::new(32);
    let mut tally = Tally::default();
    for count in [1, 15, 16, 17, 63, 64, 65, 1000] {
        let scene = (
            some_flat_shape(&mut random, 1.0),
            some_settings(&mut random),
        );
        let particles = particles(&views[0], count, &mut random);
        compare(&views, &frames, &colors, scene, &particles, &mut tally);
    }
    assert!(tally.compared > 300 && tally.seen > 300, "{tally:?}");
}

/// Checks the reference itself against known facts: the red landmark of a moving robot, and a static red
/// disc.
#[test]
fn the_reference_finds_the_landmark_and_its_motion() {
    // True position in frame 20 of data/plane-robot.
    let landmark_m = [-0.835_225, -0.35, 0.0];
    let still_disc_m = [1.25, 1.6, 0.0];
    let frame_of = |index| frame(&robot::picture(index), PixelFormat::Rgb8, VIDEO, 0.0);
    let mut views = [mast_view()];
    views[0].keep(frame_of(19));
    let frames = [(0, frame_of(20))];
    let colors = landmark_colors("red");
    let region = |shape: &Shape, position_m| {
        let settings = PatchSettings::within(shape);
        region_log_likelihood(&settings, shape, &colors, &views, &frames, position_m)
    };
    let truth = region(&landmark(), landmark_m);
    for offset_m in [[0.06, 0.0], [-0.06, 0.0], [0.0, 0.06], [0.0, -0.06]] {
        let [x, y, z] = landmark_m;
        let beside = region(&landmark(), [x + offset_m[0], y + offset_m[1], z]);
        assert!(beside < truth - 1.0, "{offset_m:?}: {beside} and {truth}");
    }
    let unseen = -3.0 / (2.0 * 0.15 * 0.15);
    assert_eq!(
        region(&landmark(), [0.0, -9.0, 0.0]),
        unseen,
        "a region behind the camera must count as background"
    );
    let difference = |position_m| {
        let settings = PatchSettings::around();
        difference_log_likelihood(&settings, &landmark(), &views, &frames, position_m)
    };
    let (moving, still) = (difference(landmark_m), difference(still_disc_m));
    assert!(moving > still + 1.0, "{moving} and {still}");
}

#[test]
fn region_cues_require_a_flat_shape_and_valid_settings() {
    let around = PatchSettings::around();
    for cue in [Cue::Region(around), Cue::Difference(around)] {
        let colors = landmark_colors("red");
        let made = |shape, cue: Cue| Cues::new(&[cue.into()], shape, Some(&colors), Level::best());
        assert!(made(landmark(), cue).is_ok());
        let refused = made(Shape::Sphere(ball()), cue).unwrap_err().to_string();
        assert!(refused.contains("disc or rectangle"), "{refused}");
    }
    let breaks: [fn(&mut PatchSettings); 5] = [
        |settings| settings.scale = 0.0,
        |settings| settings.scale = f64::NAN,
        |settings| settings.sigma = 0.0,
        |settings| settings.samples = 0,
        |settings| settings.samples = 65,
    ];
    for make_invalid in breaks {
        let mut broken = around;
        make_invalid(&mut broken);
        assert!(broken.check().is_err(), "{broken:?}");
    }
}
