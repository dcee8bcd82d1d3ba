//! Fixtures shared by tests and benchmarks: the rendered fisheye sequence, its camera and the ball's colours.
#![allow(dead_code)] // each test uses its part

pub(crate) mod drawn;
pub(crate) mod robot;

use std::path::PathBuf;

use pardalis::color::{ColorLearner, ColorModel, Palette, YuvEncoding};
use pardalis::shape::{Shape, Sphere, SphereOutline};
use pardalis::start::Start;
use pardalis::tracker::{DetectedSettings, InitializedSettings};
use pardalis::view::View;
use pardalis::{CameraId, Frame, FrameSet, PixelFormat};
use pardalis_camera::{Camera, Equidistant};
use pardalis_camera::{Pose, pose_from_matrix};
use pardalis_filter::gaussian::{GaussianStart, diagonal_m2};
use pardalis_filter::motion::{ConstantVelocity, VelocityNoise};
use pardalis_filter::particle_filter::FilterSettings;
use pardalis_images::{RgbImage, decode};

/// Width and height of the sequence's images in pixels.
pub(crate) const SIZE: (usize, usize) = (640, 480);
/// Frame rate of the sequence in frames per second.
pub(crate) const FPS: f64 = 25.0;
/// Radius of the ball in metres.
pub(crate) const RADIUS_M: f64 = 0.11;
/// Position of the ball in the first frames, in metres.
pub(crate) const FIRST_POSITION_M: [f64; 3] = [1.35, -1.25, 0.62];

pub(crate) fn data(path: &str) -> PathBuf {
    PathBuf::from(env!("CARGO_MANIFEST_DIR"))
        .join("../../data")
        .join(path)
}

/// Decodes a bundled image.
pub(crate) fn open(path: &str) -> RgbImage {
    let file = std::fs::read(data(path)).unwrap_or_else(|error| panic!("{path}: {error}"));
    decode(&file).unwrap_or_else(|error| panic!("{path}: {error}"))
}

/// Loads a picture of data/dioptric-jump.
pub(crate) fn jump_picture(index: usize) -> RgbImage {
    open(&format!("dioptric-jump/frames/{index:06}.jpg"))
}

/// Returns the set of a single frame of the first camera.
pub(crate) fn set_of(frame: Frame) -> FrameSet {
    FrameSet::of(CameraId::new(0), frame)
}

/// Converts a picture to a frame of the given format.
pub(crate) fn frame(
    picture: &RgbImage,
    format: PixelFormat,
    encoding: YuvEncoding,
    time_s: f64,
) -> Frame {
    let (width, height) = (picture.width() as usize, picture.height() as usize);
    let bytes = match format {
        PixelFormat::Rgb8 => picture.as_raw().to_vec(),
        _ => yuv_bytes(picture, format, encoding),
    };
    Frame::new(format, encoding, width, height, bytes, time_s).unwrap()
}

/// Converts a picture to a YUV format. The chroma of pixels that share it is that of the top left one.
fn yuv_bytes(picture: &RgbImage, format: PixelFormat, encoding: YuvEncoding) -> Vec<u8> {
    let (width, height) = picture.dimensions();
    let yuv = |x: u32, y: u32| {
        let rgb = picture.get_pixel(x.min(width - 1), y).map(f64::from);
        encoding.yuv_from_rgb(rgb).map(|c| c.round() as u8)
    };
    let mut bytes = Vec::new();
    match format {
        PixelFormat::Rgb8 => unreachable!("not a YUV format"),
        PixelFormat::Yuyv | PixelFormat::Uyvy => {
            for y in 0..height {
                for x in (0..width).step_by(2) {
                    let ([y0, u, v], [y1, ..]) = (yuv(x, y), yuv(x + 1, y));
                    bytes.extend(match format {
                        PixelFormat::Yuyv => [y0, u, y1, v],
                        _ => [u, y0, v, y1],
                    });
                }
            }
        }
        PixelFormat::Nv12 | PixelFormat::I420 => {
            let mut v_plane = Vec::new();
            bytes.extend(
                (0..height)
                    .flat_map(|y| (0..width).map(move |x| (x, y)))
                    .map(|(x, y)| yuv(x, y)[0]),
            );
            for y in (0..height).step_by(2) {
                for x in (0..width).step_by(2) {
                    let [_, u, v] = yuv(x, y);
                    bytes.push(u);
                    if format == PixelFormat::Nv12 {
                        bytes.push(v);
                    } else {
                        v_plane.push(v);
                    }
                }
            }
            bytes.extend(v_plane);
        }
    }
    bytes
}

/// Returns the sequence's camera.
pub(crate) fn fisheye() -> Camera {
    let model = Equidistant::new(145.562_250_654_857_8, [319.5, 239.5], 92.5_f64.to_radians());
    Camera::Equidistant(model.unwrap())
}

/// Returns the pose of the sequence's camera: 0.9 m above the floor, looking down.
pub(crate) fn world_from_fisheye() -> Pose {
    let rows = [
        [0.0, -1.0, 0.0, 0.0],
        [-1.0, 0.0, 0.0, 0.0],
        [0.0, 0.0, -1.0, 0.9],
        [0.0, 0.0, 0.0, 1.0],
    ];
    pose_from_matrix(rows).unwrap()
}

/// Returns the view of the sequence's camera.
pub(crate) fn fisheye_view() -> View {
    View::new(fisheye(), world_from_fisheye(), SIZE, None).unwrap()
}

/// Learns the ball's colours from the labelled images of data/training/dioptric.
pub(crate) fn ball_colors(palette: Palette) -> ColorModel {
    let mut learner = ColorLearner::new(palette).unwrap();
    for i in 0..6 {
        let picture = open(&format!("training/dioptric/{i:03}.jpg"));
        let mask = open(&format!("training/dioptric/{i:03}_ball_mask.png"));
        let labels: Vec<bool> = mask.pixels().map(|[grey, ..]| grey >= 128).collect();
        let frame = frame(&picture, PixelFormat::Rgb8, YuvEncoding::default(), 0.0);
        learner.add(&frame, &labels).unwrap();
    }
    learner.learn().unwrap()
}

/// Returns the sequence's ball.
pub(crate) fn ball() -> Sphere {
    Sphere::new(RADIUS_M, SphereOutline::Tangent).unwrap()
}

/// Returns the paper's offline filter for the ball: 90 mm/frame² of acceleration, resampling at every step.
pub(crate) fn ball_filter(particle_count: usize) -> FilterSettings {
    let noise = VelocityNoise::PiecewiseConstant {
        acceleration_sigma_mps2: 0.09 * FPS * FPS,
    };
    let mut filter = FilterSettings::default();
    filter.particle_count = particle_count;
    filter.motion = ConstantVelocity::new(noise).unwrap().into();
    filter
}

/// Returns a rough start position of the ball in the first frames.
pub(crate) fn ball_start() -> GaussianStart {
    GaussianStart {
        position_m: FIRST_POSITION_M,
        covariance_m2: diagonal_m2([0.1; 3]),
        velocity_mps: [0.0; 3],
        velocity_sigma_mps: [0.5; 3],
    }
}

/// Returns the ball as a target of the tracker.
pub(crate) fn ball_target(palette: Palette, particle_count: usize) -> InitializedSettings {
    let (shape, colors) = (Shape::Sphere(ball()), ball_colors(palette));
    let start = Start::Gaussian(ball_start());
    let mut target = InitializedSettings::new(shape, Some(colors), start);
    target.filter = ball_filter(particle_count);
    target
}

/// Returns the ball as a detected target with default settings.
pub(crate) fn detected_ball() -> DetectedSettings {
    DetectedSettings::new(Shape::Sphere(ball()), ball_colors(Palette::HSI))
}
