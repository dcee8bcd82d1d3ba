//! The kernels against the reference, and the CPU levels against each other, on real and synthetic images.

mod colors;
mod plane;
mod window;

use crate::common::robot::mast;
use crate::common::{ball_colors, fisheye, frame, jump_picture, world_from_fisheye};
use nalgebra::Point3;
use pardalis::color::{ColorModel, Palette, PixelKind, YuvEncoding, YuvMatrix, YuvRange};
use pardalis::likelihood::{
    ContourSettings, Cue, Cues, Sampling, ScaledSampling, SharedPixels, SplineSampling,
};
use pardalis::reference::{
    boundary, boundary_along_normals, boundary_of_scales, contour_log_likelihood,
};
use pardalis::shape::{Flat, Section, Shape, Sphere, SphereOutline, Upright, UprightOutline};
use pardalis::view::View;
use pardalis::{Frame, PixelFormat};
use pardalis_camera::Pose;
use pardalis_camera::{
    Camera, DoubleSphere, ExactMirror, ExtendedUnified, KannalaBrandt, Mask, Mei, MirrorProfile,
    Ocam, PerspectiveMirror, Pinhole, Ray, Unified,
};
use pardalis_core::rng::{Draws, Stage};
use pardalis_core::simd::Level;
use pardalis_filter::Likelihood;
use pardalis_filter::Particles;
use pardalis_images::RgbImage;

/// Single precision has an error of some 2e-4 px, so a point this close to a pixel border may be rounded to
/// either side.
const BORDER_PX: f64 = 1e-3;
const FORMATS: [PixelFormat; 5] = [
    PixelFormat::Rgb8,
    PixelFormat::Yuyv,
    PixelFormat::Uyvy,
    PixelFormat::Nv12,
    PixelFormat::I420,
];
const VIDEO: YuvEncoding = YuvEncoding {
    matrix: YuvMatrix::Bt709,
    range: YuvRange::Limited,
};

fn cameras() -> Vec<Camera> {
    let center = [322.3, 238.1];
    let pinhole =
        |distortion: [f64; 5]| Pinhole::new([535.91, 540.2], center, &distortion).unwrap();
    let mirror = MirrorProfile::hyperboloid(0.1, [0.02, 0.02], 0.04).unwrap();
    vec![
        fisheye(),
        Camera::Pinhole(pinhole([0.0; 5])),
        Camera::Pinhole(pinhole([-0.2663, -0.0385, 0.00178, -0.00028, 0.2384])),
        Camera::Unified(Unified::new(0.9, 1.2, 75.0, center).unwrap()),
        Camera::Unified(Unified::new(1.0, 0.0, 150.0, center).unwrap()),
        Camera::Unified(Unified::new(1.4, 0.8, 60.0, center).unwrap()),
        Camera::PerspectiveMirror(PerspectiveMirror::new(140.0, center).unwrap()),
        Camera::ExactMirror(ExactMirror::new([480.0, 485.0], center, mirror).unwrap()),
        Camera::KannalaBrandt(
            KannalaBrandt::new(
                [145.0, 146.0],
                center,
                [0.0101, -0.0031, 0.0019, -0.0007],
                1.6,
            )
            .unwrap(),
        ),
        Camera::Mei(
            Mei::new(
                [260.0, 262.0],
                0.3,
                center,
                1.05,
                [-0.02, 0.003, 0.0005, -0.0003],
            )
            .unwrap(),
        ),
        Camera::DoubleSphere(DoubleSphere::new([157.0, 158.0], center, -0.18, 0.59).unwrap()),
        Camera::ExtendedUnified(ExtendedUnified::new([190.0, 191.0], center, 0.63, 1.04).unwrap()),
        Camera::Ocam(
            Ocam::new(
                &[-131.48, 0.0, 1.849e-3, 2.251e-7, -7.343e-10],
                center,
                [0.999_8, 0.000_04, 0.000_01],
                470.0,
            )
            .unwrap(),
        ),
        Camera::Plane(mast(true)),
        Camera::Plane(mast(false)),
    ]
}

/// Returns the pose of one of the cameras: the identity for a plane camera, which knows only the world.
fn world_from(camera: &Camera) -> Pose {
    match camera {
        Camera::Plane(_) => Pose::identity(),
        _ => world_from_fisheye(),
    }
}

fn palettes() -> Vec<ColorModel> {
    let odd_bins = Palette::Yuv {
        y_bins: 5,
        u_bins: 9,
        v_bins: 7,
        encoding: VIDEO,
    };
    let palettes = [
        Palette::HSI,
        Palette::YUV,
        odd_bins,
        Palette::Rgb { channel_bins: 6 },
    ];
    palettes.map(ball_colors).into()
}

/// A sequence of numbers in `[0, 1)`.
struct Uniform(Draws, u32);

impl Uniform {
    fn new(seed: u32) -> Self {
        Self(Draws::new(seed, 0), 0)
    }

    fn next(&mut self) -> f64 {
        self.1 += 1;
        self.0.uniform(self.1, 0, Stage::Start)
    }

    fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.next()
    }

    fn below(&mut self, count: usize) -> usize {
        (self.next() * count as f64) as usize
    }
}

/// Creates a picture of coarse random patches, of odd size.
fn patches(seed: u32) -> RgbImage {
    let draws = Draws::new(seed, 1);
    RgbImage::from_fn(401, 333, |x, y| {
        let channel = |c| (256.0 * draws.uniform(x / 9 + 1000 * (y / 7), c, Stage::Start)) as u8;
        [channel(0), channel(1), channel(2)]
    })
}

/// Creates positions all over the view and slightly outside it, near and far, including some that no camera
/// can project properly.
fn particles(view: &View, count: usize, random: &mut Uniform) -> Particles {
    let (width, height) = (view.size().0 as f64, view.size().1 as f64);
    let mut particles = Particles::new(count, 3);
    for i in 0..count {
        let pixel = [
            random.between(-0.1, 1.1) * width,
            random.between(-0.1, 1.1) * height,
        ];
        let range_m = 0.1 * 100_f64.powf(random.next());
        let position = match i % 20 {
            // Around the camera, also inside the ball and behind the camera.
            3 => [0.0, 0.0, 0.9],
            5 => [0.0, 0.02, 0.95],
            7 => [f64::NAN, 1.0, 0.3],
            9 => [f64::INFINITY, 0.0, 0.3],
            11 => [1e30, -1e30, 1e20],
            _ => {
                let in_camera = match view.camera().unproject(pixel) {
                    Some(ray) if i % 20 != 13 => point_along(view.camera(), &ray, range_m),
                    _ => [0, 1, 2].map(|_| range_m * random.between(-1.0, 1.0)),
                };
                (view.world_from_camera() * Point3::from(in_camera)).into()
            }
        };
        for axis in 0..3 {
            particles.columns_mut()[axis][i] = position[axis] as f32;
        }
    }
    particles
}

/// Returns the point at a given distance along a ray. For plane cameras, which may be far above the plane,
/// the point is a tenth of that distance before the plane.
fn point_along(camera: &Camera, ray: &Ray<f64>, range_m: f64) -> [f64; 3] {
    let range_m = match camera {
        Camera::Plane(_) => -ray.origin[2] / ray.direction[2] - 0.1 * range_m,
        _ => range_m,
    };
    [0, 1, 2].map(|axis| ray.origin[axis] + range_m * ray.direction[axis])
}

/// Reports whether single precision may round a point to another pixel than double precision, place it across
/// the border of the camera's domain, or consider another side of an upright body visible.
fn is_borderline(
    view: &View,
    shape: &Shape,
    settings: &ContourSettings,
    position_m: [f64; 3],
) -> bool {
    // Squares of such distances exceed single precision.
    if position_m.iter().any(|c| c.abs() > 1e18) {
        return true;
    }
    let image = [view.size().0 as f64, view.size().1 as f64];
    let near_border = |pixel: [f64; 2], border_px: f64| {
        let in_image = [0, 1].iter().all(|&c| (-1.0..image[c]).contains(&pixel[c]));
        in_image
            && pixel
                .iter()
                .any(|c| ((c - c.floor()) - 0.5).abs() < border_px)
    };
    let points = settings.points;
    // The scales that are compared with the image, and their distance from the outline along normals.
    let compared = |position_m: [f64; 3]| match settings.sampling {
        Sampling::Scaled(scaled) => {
            let scales = [scaled.inner_scale, scaled.outer_scale];
            let sides = boundary_of_scales(view, shape, points, position_m, scales);
            let mut all = vec![(sides.concat(), 0.0)];
            if let Some(SharedPixels { distance_px, .. }) = scaled.shared_pixels {
                let sides = boundary_along_normals(view, shape, points, position_m, distance_px);
                all.push((sides.concat(), distance_px));
            }
            all
        }
        Sampling::Spline(spline) => {
            let sides = boundary(view, shape, settings, position_m);
            vec![(sides.concat(), spline.reach_px)]
        }
    };
    // The lookup table of the exact mirror is coarser than single precision.
    let error_px = match view.camera() {
        Camera::ExactMirror(_) => 5.0 * BORDER_PX,
        _ => BORDER_PX,
    };
    // Errors of the points rotate the normals of small outlines.
    let [outline, _] = boundary_of_scales(view, shape, points, position_m, [1.0; 2]);
    let shortest_px = (0..outline.len())
        .filter_map(|k| {
            let (a, b) = (outline[k]?, outline[(k + 2) % outline.len()]?);
            Some((a[0] - b[0]).hypot(a[1] - b[1]))
        })
        .fold(f64::INFINITY, f64::min);
    let pixels = compared(position_m);
    for (pixels, distance_px) in &pixels {
        let border_px = error_px * (1.0 + 2.0 * distance_px / shortest_px);
        if pixels
            .iter()
            .flatten()
            .any(|&pixel| near_border(pixel, border_px))
        {
            return true;
        }
    }
    let shift = 1e-5 * position_m.iter().map(|c| c.abs()).sum::<f64>().max(0.1);
    (0..6).any(|k| {
        let mut shifted = position_m;
        shifted[k % 3] += if k < 3 { shift } else { -shift };
        let others = compared(shifted);
        pixels
            .iter()
            .zip(&others)
            .any(|((pixels, _), (others, _))| {
                others.len() != pixels.len()
                    || pixels.iter().zip(others).any(|pair| match pair {
                        (Some(a), Some(b)) => (0..2).any(|c| (a[c] - b[c]).abs() > 0.2),
                        (a, b) => a.is_some() != b.is_some(),
                    })
            })
    })
}

/// Returns a ball, cylinder, prism or box of random size with either outline, or a flat shape; always a flat shape
/// if the camera cannot see heights.
fn some_shape(camera: &Camera, random: &mut Uniform) -> Shape {
    if matches!(camera, Camera::Plane(plane) if plane.center_m().is_none()) {
        return some_flat_shape(random, 1.0);
    }
    let outline = [UprightOutline::Exact, UprightOutline::Facing][random.below(2)];
    let height_m = random.between(0.1, 0.9);
    let section = match random.below(6) {
        0 => Section::circle(random.between(0.03, 0.3)),
        1 => Section::polygon(
            3 + random.below(7),
            random.between(0.05, 0.6),
            random.between(-3.0, 3.0),
        ),
        4 => return some_flat_shape(random, 1.0),
        5 => Section::rectangle([random.between(0.05, 0.6), random.between(0.05, 0.6)]),
        ball => {
            let outline = [SphereOutline::Tangent, SphereOutline::Greatcircle][ball - 2];
            return Shape::Sphere(Sphere::new(random.between(0.05, 0.2), outline).unwrap());
        }
    };
    Shape::Upright(Upright::new(section.unwrap(), height_m, outline).unwrap())
}

/// Returns a disc or rectangle of random size and height, in metres times `unit_m`.
fn some_flat_shape(random: &mut Uniform, unit_m: f64) -> Shape {
    let height_m = unit_m * random.between(0.0, 0.5) * random.below(2) as f64;
    let mut size_m = || unit_m * random.between(0.03, 0.5);
    let sizes_m = [size_m(), size_m()];
    let flat = match random.below(2) {
        0 => Flat::disc(sizes_m[0], height_m),
        _ => Flat::rectangle(sizes_m, height_m),
    };
    Shape::Flat(flat.unwrap())
}

/// Returns random settings with any sampling.
fn some_settings(random: &mut Uniform) -> ContourSettings {
    let points = 3 + random.below(57);
    let shared_pixels = (random.below(2) == 0).then(|| SharedPixels {
        max_share: random.between(0.0, 0.9),
        distance_px: random.between(0.5, 4.0),
    });
    let scaled = Sampling::Scaled(ScaledSampling {
        inner_scale: random.between(0.5, 0.95),
        outer_scale: random.between(1.05, 1.5),
        shared_pixels,
    });
    let spline = Sampling::Spline(SplineSampling {
        control_points: 3 + random.below((points / 2).saturating_sub(2)),
        reach_px: random.between(0.5, 4.0),
        steps: 1 + random.below(3),
        middle: random.below(2) == 0,
    });
    let mut settings = ContourSettings::default();
    settings.points = points;
    settings.sampling = if random.below(3) == 0 && points >= 6 {
        spline
    } else {
        scaled
    };
    settings
}

/// Counts of compared particles.
#[derive(Debug, Default)]
struct Tally {
    compared: usize,
    borderline: usize,
    /// Compared, and visible to a camera.
    seen: usize,
}

/// Compares the kernels with the reference, and the levels with each other, for one set of particles.
fn compare(
    views: &[View],
    frames: &[(usize, Frame)],
    colors: &ColorModel,
    shape: Shape,
    settings: ContourSettings,
    particles: &Particles,
    tally: &mut Tally,
) {
    let fast = Level::available().into_iter().map(|level| {
        let settings = [Cue::Contour(settings).into()];
        let mut cues = Cues::new(&settings, shape, Some(colors), level).unwrap();
        let mut out = vec![f32::NAN; particles.count()];
        cues.of(views, frames).log_likelihoods(particles, &mut out);
        out
    });
    let fast: Vec<Vec<f32>> = fast.collect();
    for level in &fast[1..] {
        assert!(
            fast[0]
                .iter()
                .zip(level)
                .all(|(a, b)| a.to_bits() == b.to_bits()),
            "{fast:?}"
        );
    }
    let background = frames.len() as f64 * settings.background_log_likelihood();
    for (i, &fast) in fast[0].iter().enumerate() {
        let position_m = particles.position_m(i);
        assert!(fast.is_finite(), "{fast}: {position_m:?}");
        let borderline = |(camera, _): &(usize, Frame)| {
            is_borderline(&views[*camera], &shape, &settings, position_m)
        };
        if frames.iter().any(borderline) {
            tally.borderline += 1;
            continue;
        }
        let naive = contour_log_likelihood(&settings, &shape, colors, views, frames, position_m);
        assert!(
            (f64::from(fast) - naive).abs() <= 1e-4 * naive.abs(),
            "{fast}, but the reference is {naive}: {position_m:?}, {:?}, {:?}, {settings:?}, {shape:?}, {:?}",
            views[0].camera(),
            colors.palette(),
            frames[0].1.format()
        );
        tally.compared += 1;
        tally.seen += usize::from(naive != background);
    }
}

fn view(camera: Camera, pose: Pose, frame: &Frame, mask: Option<Mask>) -> View {
    View::new(camera, pose, (frame.width(), frame.height()), mask).unwrap()
}

/// Compares the kernels for every camera, format and mask, with as many palettes in turn, and as many outlines each.
fn compare_combinations(palettes_in_turn: usize, outlines: usize) {
    let mut random = Uniform::new(11);
    let mut tally = Tally::default();
    let models = palettes();
    let mut turn = models.iter().cycle();
    for (number, picture) in [jump_picture(30), patches(5)].iter().enumerate() {
        let encoding = [YuvEncoding::default(), VIDEO][number];
        let frames = FORMATS.map(|format| frame(picture, format, encoding, 0.0));
        let grey: Vec<u8> = (0..picture.width() * picture.height())
            .map(|i| {
                if i % picture.width() > picture.width() / 3 && i % 61 != 0 {
                    255
                } else {
                    0
                }
            })
            .collect();
        for camera in cameras() {
            for masked in [false, true] {
                let mask = masked.then(|| {
                    Mask::from_grey(frames[0].width(), frames[0].height(), &grey).unwrap()
                });
                let mut views = [view(camera.clone(), world_from(&camera), &frames[0], mask)];
                for frame in &frames {
                    for _ in 0..palettes_in_turn {
                        let colors = turn.next().unwrap();
                        views[0].prepare(PixelKind::of(frame), colors.palette());
                        for _ in 0..outlines {
                            let shape = some_shape(&camera, &mut random);
                            let settings = some_settings(&mut random);
                            let particles = particles(&views[0], 40, &mut random);
                            let frames = [(0, frame.clone())];
                            compare(
                                &views, &frames, colors, shape, settings, &particles, &mut tally,
                            );
                        }
                    }
                }
            }
        }
    }
    assert!(tally.compared > tally.borderline, "{tally:?}");
    assert!(4 * tally.seen > tally.compared, "{tally:?}");
}

#[test]
fn kernels_agree_with_the_reference_for_every_camera_format_and_mask() {
    compare_combinations(1, 1);
}

#[test]
#[ignore = "exhaustive: the gate runs it with --ignored"]
fn kernels_agree_with_the_reference_for_every_camera_outline_format_palette_and_mask() {
    compare_combinations(palettes().len(), 3);
}

#[test]
fn kernels_agree_with_the_reference_for_any_number_of_particles_and_points() {
    let frame = frame(
        &jump_picture(30),
        PixelFormat::Yuyv,
        YuvEncoding::default(),
        0.0,
    );
    let colors = ball_colors(Palette::YUV);
    let mut views = [view(fisheye(), world_from_fisheye(), &frame, None)];
    views[0].prepare(PixelKind::of(&frame), colors.palette());
    let mut random = Uniform::new(12);
    let mut tally = Tally::default();
    for (count, points) in [
        (1, 50),
        (15, 3),
        (16, 4),
        (17, 200),
        (255, 50),
        (256, 7),
        (257, 50),
        (1000, 49),
    ] {
        let mut settings = ContourSettings::default();
        settings.points = points;
        let particles = particles(&views[0], count, &mut random);
        let frames = [(0, frame.clone())];
        compare(
            &views,
            &frames,
            &colors,
            Shape::Sphere(crate::common::ball()),
            settings,
            &particles,
            &mut tally,
        );
    }
    assert!(tally.compared > tally.borderline, "{tally:?}");
}

#[test]
fn likelihoods_of_cameras_multiply() {
    let picture = jump_picture(30);
    let frames = [
        (
            0,
            frame(&picture, PixelFormat::Rgb8, YuvEncoding::default(), 0.0),
        ),
        (1, frame(&picture, PixelFormat::Nv12, VIDEO, 0.0)),
        (2, frame(&picture, PixelFormat::I420, VIDEO, 0.0)),
    ];
    let colors = ball_colors(Palette::HSI);
    let aside = Pose::translation(0.3, -0.1, 0.2) * world_from_fisheye();
    let poses = [world_from_fisheye(), aside, aside.inverse()];
    let mut views = poses.map(|pose| view(fisheye(), pose, &frames[0].1, None));
    for (camera, frame) in &frames {
        views[*camera].prepare(PixelKind::of(frame), colors.palette());
    }
    let mut settings = ContourSettings::default();
    settings.points = 20;
    let mut tally = Tally::default();
    let particles = particles(&views[0], 500, &mut Uniform::new(13));
    compare(
        &views,
        &frames,
        &colors,
        Shape::Sphere(crate::common::ball()),
        settings,
        &particles,
        &mut tally,
    );
    assert!(
        tally.compared > tally.borderline && tally.seen > 200,
        "{tally:?}"
    );
}

/// Checks the reference itself against known facts: outline points lie on the sphere's tangents, and the
/// likelihood is highest at the true position.
#[test]
fn the_reference_finds_the_ball() {
    let frame = frame(
        &jump_picture(0),
        PixelFormat::Rgb8,
        YuvEncoding::default(),
        0.0,
    );
    let colors = ball_colors(Palette::HSI);
    let views = [view(fisheye(), world_from_fisheye(), &frame, None)];
    let frames = [(0, frame)];
    let at = |offset: [f64; 3]| {
        let position_m = [0, 1, 2].map(|axis| crate::common::FIRST_POSITION_M[axis] + offset[axis]);
        let settings = ContourSettings::default();
        contour_log_likelihood(
            &settings,
            &Shape::Sphere(crate::common::ball()),
            &colors,
            &views,
            &frames,
            position_m,
        )
    };
    let truth = at([0.0; 3]);
    for offset in [
        [0.06, 0.0, 0.0],
        [-0.06, 0.0, 0.0],
        [0.0, 0.06, 0.0],
        [0.0, 0.0, 0.06],
        [0.0, 0.0, -0.06],
    ] {
        assert!(
            at(offset) < truth - 1.0,
            "{offset:?}: {} and {truth}",
            at(offset)
        );
    }
    assert_eq!(
        at([0.0, 0.0, 1000.0]),
        -30.0,
        "a ball behind the camera must count as background"
    );
}
