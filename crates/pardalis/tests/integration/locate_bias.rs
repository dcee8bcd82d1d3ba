//! The bias of distances towards larger values is caused by soft edges, not by the camera model, the outline
//! or the filter.

use crate::common::frame;
use nalgebra::{Point3, Vector3};
use pardalis::color::{ColorLearner, ColorModel, Palette, YuvEncoding};
use pardalis::shape::Shape;
use pardalis::start::Start;
use pardalis::tracker::{InitializedSettings, Tracker};
use pardalis::view::View;
use pardalis::{Frame, PixelFormat};
use pardalis_core::simd::Level;
use pardalis_filter::resample::Resampling;
use pardalis_images::RgbImage;
use pardalis_scene::calibration;

const ORANGE: [f64; 3] = [225.0, 105.0, 30.0];
const FLOOR: [f64; 3] = [95.0, 125.0, 105.0];
const PASSES_M: [f64; 3] = [0.1, 0.07, 0.04];

/// Loads the exact mirror camera.
fn mirror_view() -> View {
    let path = crate::common::data("calibration/catadioptric/exact.toml");
    let text = std::fs::read_to_string(path).unwrap();
    let camera = calibration::read(&text, None).unwrap().remove(0);
    View::new(
        camera.camera,
        camera.world_from_camera.unwrap(),
        (640, 480),
        None,
    )
    .unwrap()
}

/// Returns 1 if the image point shows the ball, else 0.
fn is_ball(view: &View, center: Point3<f64>, pixel: [f64; 2]) -> f64 {
    let Some(ray) = view.camera().unproject(pixel) else {
        return 0.0;
    };
    let origin = view.world_from_camera() * Point3::from(ray.origin);
    let direction = view.world_from_camera() * Vector3::from(ray.direction);
    let to_center = center - origin;
    let along = to_center.dot(&direction);
    let beside = (to_center - direction * along).norm();
    f64::from(u8::from(along > 0.0 && beside < crate::common::RADIUS_M))
}

/// Renders the ball in front of a uniform floor. Edges are hard, or as soft as those of a camera: each pixel
/// is the mean over its area, blurred with its neighbours.
fn picture(view: &View, center: [f64; 3], is_soft: bool) -> RgbImage {
    let center = Point3::from(center);
    let in_camera = view.camera_from_world() * center;
    let middle = view.camera().project(in_camera.into()).unwrap();
    let share = |x: i64, y: i64| {
        let (x, y) = (x as f64, y as f64);
        if (x - middle[0]).hypot(y - middle[1]) > 60.0 {
            return 0.0;
        }
        if !is_soft {
            return is_ball(view, center, [x, y]);
        }
        let steps = [-0.8, -0.4, 0.0, 0.4, 0.8];
        let samples = steps
            .iter()
            .flat_map(|dx| steps.iter().map(move |dy| (dx, dy)));
        samples
            .map(|(dx, dy)| is_ball(view, center, [x + dx, y + dy]))
            .sum::<f64>()
            / 25.0
    };
    RgbImage::from_fn(640, 480, |x, y| {
        let share = share(i64::from(x), i64::from(y));
        [0, 1, 2].map(|c| (share * ORANGE[c] + (1.0 - share) * FLOOR[c]).round() as u8)
    })
}

fn rgb_frame(picture: &RgbImage) -> Frame {
    frame(picture, PixelFormat::Rgb8, YuvEncoding::default(), 0.0)
}

fn orange() -> ColorModel {
    let picture = RgbImage::from_pixel(4, 4, ORANGE.map(|c| c as u8));
    let mut learner = ColorLearner::new(Palette::HSI).unwrap();
    learner.add(&rgb_frame(&picture), &[true; 16]).unwrap();
    learner.learn().unwrap()
}

/// Returns the errors of the distance from the mirror, in metres, for positions all around.
fn distance_errors_m(is_soft: bool) -> Vec<f64> {
    let view = mirror_view();
    let mirror = Point3::new(0.0, 0.0, 0.98);
    let mut errors = Vec::new();
    for (number, range_m) in [0.65, 1.3, 2.2, 3.2].into_iter().enumerate() {
        for direction in 0..4 {
            let angle = f64::from(direction) * 1.57 + 0.3 * number as f64;
            let center = [range_m * angle.cos(), range_m * angle.sin(), 0.11];
            let start = pardalis_filter::gaussian::GaussianStart {
                position_m: center,
                ..crate::common::ball_start()
            };
            let shape = Shape::Sphere(crate::common::ball());
            let start = Start::Gaussian(start);
            let mut target = InitializedSettings::new(shape, Some(orange()), start);
            target.filter.particle_count = 3000;
            target.filter.resampling = Resampling::Multinomial;
            let mut tracker =
                Tracker::new(vec![view.clone()], vec![target], 1, Level::best()).unwrap();
            let set = crate::common::set_of(rgb_frame(&picture(&view, center, is_soft)));
            let target = tracker.targets().next().unwrap();
            let start = tracker.starts(target).unwrap().next().unwrap();
            let found = tracker.locate(&set, &[start], &PASSES_M).unwrap();
            let found = Point3::from(found[0].kinematics.unwrap().position_m);
            errors.push((found - mirror).norm() - (Point3::from(center) - mirror).norm());
        }
    }
    errors
}

/// Returns the mean and its standard error.
fn mean_and_error_m(errors_m: &[f64]) -> (f64, f64) {
    let count = errors_m.len() as f64;
    let mean = errors_m.iter().sum::<f64>() / count;
    let squares: f64 = errors_m.iter().map(|e| (e - mean).powi(2)).sum();
    (mean, (squares / (count - 1.0) / count).sqrt())
}

#[test]
fn distances_are_unbiased_with_hard_edges_and_too_large_with_soft_edges() {
    let (hard, error) = mean_and_error_m(&distance_errors_m(false));
    println!(
        "hard edges: {:.1} mm, standard error {:.1} mm",
        1e3 * hard,
        1e3 * error
    );
    assert!(hard.abs() < 2.0 * error, "{hard} {error}");
    let (soft, error) = mean_and_error_m(&distance_errors_m(true));
    println!(
        "soft edges: {:.1} mm, standard error {:.1} mm",
        1e3 * soft,
        1e3 * error
    );
    assert!(soft > 5.0 * error, "{soft} {error}");
}
