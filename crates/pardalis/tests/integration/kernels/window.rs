//! The window cue against the reference: both methods of counting, every camera, format and mask, windows of
//! all sizes.

use nalgebra::Point3;
use pardalis::Frame;
use pardalis::color::{ColorRanges, YuvEncoding};
use pardalis::likelihood::{Cue, Cues, WindowCounting, WindowSettings};
use pardalis::reference::window_log_likelihood;
use pardalis::shape::Shape;
use pardalis::view::View;
use pardalis_camera::Mask;
use pardalis_core::simd::Level;
use pardalis_filter::Likelihood;
use pardalis_filter::Particles;

use super::{BORDER_PX, FORMATS, Uniform, VIDEO, cameras, particles, patches, view, world_from};
use crate::common::{ball, fisheye, frame, jump_picture, world_from_fisheye};

/// Half the colours of the patches, and the orange ball.
const ORANGE: ColorRanges = ColorRanges {
    hue_deg: [300.0, 60.0],
    saturation: [0.2, 1.0],
    intensity: [0.15, 0.8],
};

fn cues(settings: WindowSettings, counting: WindowCounting, level: Level) -> Cues {
    let settings = [Cue::Window(settings).into()];
    Cues::counting(&settings, Shape::Sphere(ball()), None, counting, level).unwrap()
}

/// Compares every method of counting at every level with the reference. Returns the numbers of compared
/// particles and of matching pixels.
fn compare(
    views: &[View],
    frames: &[(usize, Frame)],
    settings: WindowSettings,
    particles: &Particles,
) -> [usize; 2] {
    let mut all = Vec::new();
    for counting in [
        WindowCounting::LookUps,
        WindowCounting::Sums,
        WindowCounting::Cheaper,
    ] {
        for level in Level::available() {
            let mut out = vec![f32::NAN; particles.count()];
            cues(settings, counting, level)
                .of(views, frames)
                .log_likelihoods(particles, &mut out);
            all.push(out);
        }
    }
    let (mut compared, mut above_floor) = (0, 0);
    for i in 0..particles.count() {
        let fast = all[0][i];
        assert!(all.iter().all(|out| out[i].to_bits() == fast.to_bits()));
        let position_m = particles.position_m(i);
        // Single precision may round to the other pixel, and cannot hold squares of such distances.
        let borderline = frames.iter().any(|(camera, _)| {
            let in_camera = views[*camera].camera_from_world() * Point3::from(position_m);
            let pixel = views[*camera].camera().project(in_camera.into());
            let near = |c: f64| ((c - c.floor()) - 0.5).abs() < BORDER_PX;
            // The very centre of the camera has no direction.
            in_camera.coords.norm() < 1e-6 || pixel.is_some_and(|pixel| pixel.into_iter().any(near))
        });
        if borderline || position_m.iter().any(|c| c.abs() > 1e18) {
            continue;
        }
        let naive = window_log_likelihood(&settings, &ORANGE, views, frames, position_m);
        assert!(
            (f64::from(fast) - naive).abs() <= 1e-5,
            "{fast}, but the reference is {naive}: {position_m:?}, {settings:?}"
        );
        compared += 1;
        above_floor += usize::from(naive > settings.floor.max(settings.outside).ln() + 1e-9);
    }
    [compared, above_floor]
}

#[test]
fn window_counts_agree_with_the_reference_for_every_camera_format_and_mask() {
    let mut random = Uniform::new(21);
    let mut tally = [0; 2];
    for (number, picture) in [jump_picture(30), patches(5)].iter().enumerate() {
        let encoding = [YuvEncoding::default(), VIDEO][number];
        let frames = FORMATS.map(|format| frame(picture, format, encoding, 0.0));
        let (width, height) = (frames[0].width(), frames[0].height());
        let grey: Vec<u8> = (0..width * height)
            .map(|i| u8::from(i % width > width / 3 && i % 61 != 0) * 255)
            .collect();
        let mask = Mask::from_grey(width, height, &grey).unwrap();
        for camera in cameras() {
            for mask in [None, Some(mask.clone())] {
                let mut views = [view(camera.clone(), world_from(&camera), &frames[0], mask)];
                for frame in &frames {
                    let [floor, outside] = [(); 2].map(|()| random.between(0.01, 0.1));
                    let mut settings = WindowSettings::of_size(1 + 2 * random.below(12));
                    settings.ranges = Some(ORANGE);
                    settings.floor = floor;
                    settings.outside = outside;
                    cues(settings, WindowCounting::Cheaper, Level::best())
                        .prepare(&mut views[0], frame);
                    let particles = particles(&views[0], 60, &mut random);
                    let [compared, above] =
                        compare(&views, &[(0, frame.clone())], settings, &particles);
                    tally[0] += compared;
                    tally[1] += above;
                }
            }
        }
    }
    let [compared, above_floor] = tally;
    assert!(compared > 10_000, "{tally:?}");
    assert!(above_floor > 1_500, "{tally:?}");
}

#[test]
fn likelihoods_of_a_rig_multiply_for_any_number_of_particles() {
    let picture = jump_picture(0);
    let frames = FORMATS.map(|format| frame(&picture, format, YuvEncoding::default(), 0.0));
    let frames: Vec<(usize, Frame)> = frames.into_iter().enumerate().collect();
    let mut settings = WindowSettings::default();
    settings.ranges = Some(ORANGE);
    let mut views: Vec<View> = frames
        .iter()
        .map(|(_, frame)| view(fisheye(), world_from_fisheye(), frame, None))
        .collect();
    for (camera, frame) in &frames {
        cues(settings, WindowCounting::Cheaper, Level::best()).prepare(&mut views[*camera], frame);
    }
    for count in [1, 15, 16, 17, 1023, 1024, 1025, 3000] {
        let particles = particles(&views[0], count, &mut Uniform::new(22));
        compare(&views, &frames, settings, &particles);
    }
}

#[test]
fn window_likelihoods_follow_the_paper() {
    let settings = WindowSettings::default();
    assert_eq!(
        [0, 1, 2, 25].map(|matching| settings.likelihood(matching)),
        [0.04, 0.04, 0.08, 1.0]
    );
    assert_eq!(settings.outside, 1.0 / 25.0);
    let breaks: [fn(&mut WindowSettings); 3] = [
        |settings| settings.size_px = 4,
        |settings| settings.floor = 0.0,
        |settings| settings.outside = f64::NAN,
    ];
    for make_invalid in breaks {
        let mut broken = settings;
        make_invalid(&mut broken);
        assert!(broken.check().is_err(), "{broken:?}");
    }
    // Without a colour model the settings must give the ranges.
    let nothing_to_count = [Cue::Window(settings).into()];
    let made = Cues::new(
        &nothing_to_count,
        Shape::Sphere(ball()),
        None,
        Level::best(),
    );
    assert!(made.unwrap_err().to_string().contains("hue_deg"));
}
