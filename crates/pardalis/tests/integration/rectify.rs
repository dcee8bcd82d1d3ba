//! Maps of the plane from simulated images of a floor with a known pattern, and from images that are already
//! maps.

use nalgebra::{Matrix3, Vector3};
use pardalis::color::YuvEncoding;
use pardalis::rectify::{Area, Rectifier, default_step_m, visible_area_m};
use pardalis::view::View;
use pardalis::{Frame, PixelFormat};
use pardalis_calibrate::plane::{PointPair, fit};
use pardalis_camera::Homography;
use pardalis_camera::{Camera, Mask, Plane, Projection};
use pardalis_camera::{Pose, looking_at};
use pardalis_core::Error;
use pardalis_scene::WorldConfig;
use pardalis_simulate::Renderer;

/// Size of the floor's squares. Their greys are so similar that brightness and light are proportional.
const SQUARE_M: f64 = 0.5;
const SIZE_PX: (usize, usize) = (321, 243);

const PINHOLE: &str =
    "pinhole = { f_px = [270, 272], center_px = [160.5, 119], distortion = [-0.1, 0.02, 0, 0, 0] }";
const STRAIGHT: &str = "pinhole = { f_px = [270, 270], center_px = [160.5, 119], distortion = [] }";
const FISHEYE: &str =
    "equidistant = { f_px_per_rad = 120, center_px = [158, 121], field_of_view_deg = 185 }";

/// Returns a camera of the given model, 3 m above the floor and looking down at an angle, and its image.
fn seen(model: &str) -> (View, Frame) {
    let text = format!(
        "duration_s = 0.1
        [cameras.mast]
        size_px = [{}, {}]
        model.{model}
        look_from_m = [0, -2.2, 3]
        look_at_m = [0.1, 0.2, 0]
        [cameras.mast.image]
        samples = 4
        blur_px = 0.6
        [cameras.mast.timing]
        fps = 25
        [ground]
        z_m = 0
        texture.checker = {{ size_m = {SQUARE_M}, colors_srgb = [[110, 110, 110], [140, 140, 140]] }}
        [objects.ball]
        target = true
        shape.sphere.radius_m = 0.05
        color_srgb = [255, 0, 0]
        path.still.position_m = [40, 40, 0.05]
        ",
        SIZE_PX.0, SIZE_PX.1
    );
    let config = WorldConfig::parse(&text, &|_, _| Err("no files here".to_owned()));
    let world = config
        .unwrap_or_else(|problems| panic!("{problems:#?}"))
        .world;
    let camera = &world.cameras[0];
    let rgb = Renderer::new(&world, 0).image(0, 0.0);
    let view = View::new(
        camera.camera.clone(),
        camera.world_from_camera,
        SIZE_PX,
        None,
    )
    .unwrap();
    (view, frame(PixelFormat::Rgb8, SIZE_PX, rgb))
}

fn frame(format: PixelFormat, (width, height): (usize, usize), bytes: Vec<u8>) -> Frame {
    Frame::new(format, YuvEncoding::default(), width, height, bytes, 0.0).unwrap()
}

/// Returns the position in pixels where the brightness crosses the mean of the two greys; there is exactly
/// one.
#[track_caller]
fn edge(grey: &[f64]) -> f64 {
    let middle = f64::midpoint(110.0, 140.0);
    let passes = |i: &usize| (grey[*i] < middle) != (grey[i + 1] < middle);
    let found: Vec<usize> = (0..grey.len() - 1).filter(passes).collect();
    assert_eq!(found.len(), 1, "{grey:?}");
    found[0] as f64 + (middle - grey[found[0]]) / (grey[found[0] + 1] - grey[found[0]])
}

/// Asserts that every edge between squares lies at its position on the floor, along its whole length, with
/// subpixel accuracy.
#[track_caller]
fn assert_checker(rectifier: &Rectifier, rgb: &[u8], [low, high]: Area, step_m: f64) {
    let (width, height) = rectifier.size_px();
    assert!(rgb.iter().all(|&v| v > 0), "the whole area must be in view");
    let red = |x: usize, y: usize| f64::from(rgb[3 * (y * width + x)]);
    // The positions of lines across the map, and how to read its pixels along them.
    let across_x = |m: f64| (m - low[0]) / step_m - 0.5;
    let across_y = |m: f64| (high[1] - m) / step_m - 0.5;
    let column = |x: f64, y: usize| red(x as usize, y);
    let row = |y: f64, x: usize| red(x, y as usize);
    let reach = (0.3 * SQUARE_M / step_m) as i32;
    let (mut edges, mut worst) = (0, 0.0_f64);
    let mut check = |line_px: f64,
                     count: usize,
                     clear: &dyn Fn(usize) -> bool,
                     read: &dyn Fn(f64, usize) -> f64| {
        for along in (0..count).filter(|&i| clear(i)) {
            let grey: Vec<f64> = (-reach..=reach)
                .map(|d| read(line_px.round() + f64::from(d), along))
                .collect();
            let found_px = edge(&grey) - f64::from(reach) + line_px.round();
            worst = worst.max((found_px - line_px).abs());
            edges += 1;
        }
    };
    // Clear of the corners of squares.
    let clear = |m: f64| ((m / SQUARE_M).rem_euclid(1.0) - 0.5).abs() < 0.3;
    for line in -1..=1 {
        let line_m = f64::from(line) * SQUARE_M;
        check(
            across_x(line_m),
            height,
            &|y| clear(high[1] - (y as f64 + 0.5) * step_m),
            &column,
        );
        check(
            across_y(line_m),
            width,
            &|x| clear(low[0] + (x as f64 + 0.5) * step_m),
            &row,
        );
    }
    assert!(edges > 150, "{edges}");
    assert!(worst < 0.3, "{worst} px");
}

#[test]
fn a_known_pattern_is_straight_and_to_scale_with_any_camera() {
    let area: Area = [[-0.8, -0.8], [0.8, 0.81]];
    for model in [PINHOLE, FISHEYE] {
        let (view, frame) = seen(model);
        let step_m = default_step_m(&view, area).unwrap();
        let rectifier = Rectifier::new(&view, area, step_m).unwrap();
        assert_checker(
            &rectifier,
            &rectifier.rectify(&frame).unwrap(),
            area,
            step_m,
        );
    }
}

#[test]
fn four_points_are_as_accurate_as_a_full_calibration() {
    let (view, frame) = seen(STRAIGHT);
    let area = [[-0.8, -0.8], [0.8, 0.8]];
    let pair = |[x, y]: [f64; 2]| {
        let in_camera = view.camera_from_world() * nalgebra::Point3::new(x, y, 0.0);
        let pixel = view.camera().project(in_camera.coords.into()).unwrap();
        PointPair {
            pixel,
            plane_m: [x, y],
        }
    };
    let corners = [[-1.0, -0.5], [1.0, -0.5], [1.0, 1.0], [-1.0, 1.0]].map(pair);
    let plane = Plane::new(&fit(&corners).unwrap().homography, None).unwrap();
    let by_points = View::new(Camera::Plane(plane), Pose::identity(), SIZE_PX, None).unwrap();
    let of = |view| {
        Rectifier::new(view, area, 0.01)
            .unwrap()
            .rectify(&frame)
            .unwrap()
    };
    let most = of(&view)
        .iter()
        .zip(of(&by_points))
        .map(|(a, b)| a.abs_diff(b))
        .max();
    assert!(most <= Some(1), "{most:?}");
}

/// A point above the plane appears on the map where its ray meets the plane, and the map's camera accounts
/// for that.
#[test]
fn the_camera_of_the_map_projects_heights_correctly() {
    for model in [PINHOLE, FISHEYE] {
        let (view, _) = seen(model);
        let rectifier = Rectifier::new(&view, [[-2.0, -1.0], [2.0, 3.0]], 0.01).unwrap();
        for place in [[0.3, 0.2, 0.0], [-0.4, 0.5, 0.406], [0.2, -0.3, 1.2]] {
            let in_camera = view.camera_from_world() * nalgebra::Point3::from(place);
            let pixel = view.camera().project(in_camera.coords.into()).unwrap();
            let ray = view.camera().unproject(pixel).unwrap();
            let origin = view.world_from_camera() * nalgebra::Point3::from(ray.origin);
            let direction = view.world_from_camera().rotation * Vector3::from(ray.direction);
            let met = origin - direction * (origin.z / direction.z);
            let expected = [(met.x + 2.0) / 0.01 - 0.5, (3.0 - met.y) / 0.01 - 0.5];
            let (found, valid) = rectifier.camera().project(place);
            assert!(valid);
            for axis in 0..2 {
                assert!((found[axis] - expected[axis]).abs() < 1e-6, "{place:?}");
            }
        }
    }
}

/// Returns a camera straight above with the given mask, whose image is already a map: pixels of one
/// centimetre, the centre of the first at the origin.
fn above(size_px: (usize, usize), mask: Option<Mask>) -> View {
    let matrix = Matrix3::new(100.0, 0.0, 0.0, 0.0, -100.0, 0.0, 0.0, 0.0, 1.0);
    let plane = Plane::new(&Homography::new(matrix).unwrap(), None).unwrap();
    View::new(Camera::Plane(plane), Pose::identity(), size_px, mask).unwrap()
}

/// Returns the area of the same map, extended by `more` pixels on each side.
fn same_area((width, height): (usize, usize), more: f64) -> Area {
    let (w, h) = (width as f64, height as f64);
    [
        [-0.01 * (0.5 + more), -0.01 * (h - 0.5 + more)],
        [0.01 * (w - 0.5 + more), 0.01 * (0.5 + more)],
    ]
}

#[test]
fn maps_stay_unchanged_in_every_pixel_format() {
    let formats = [
        PixelFormat::Rgb8,
        PixelFormat::Yuyv,
        PixelFormat::Uyvy,
        PixelFormat::Nv12,
        PixelFormat::I420,
    ];
    for size_px in [(7, 5), (8, 6), (1, 3), (2, 1)] {
        let rectifier =
            Rectifier::new(&above(size_px, None), same_area(size_px, 0.0), 0.01).unwrap();
        assert_eq!(rectifier.size_px(), size_px);
        for format in formats {
            let count = format.byte_count(size_px.0, size_px.1);
            let bytes = (0..count).map(|i| (40 + 37 * i % 180) as u8).collect();
            let frame = frame(format, size_px, bytes);
            assert_eq!(
                rectifier.rectify(&frame).unwrap(),
                frame.to_rgb8(),
                "{format:?} {size_px:?}"
            );
        }
    }
}

#[test]
fn native_components_are_interpolated_between_pixels() {
    let view = above((2, 2), None);
    let rectifier = Rectifier::new(&view, [[0.0, -0.01], [0.01, 0.0]], 0.01).unwrap();
    let bytes = [[0, 10, 200], [100, 30, 0], [40, 20, 100], [60, 0, 0]].concat();
    let rgb = rectifier
        .rectify(&frame(PixelFormat::Rgb8, (2, 2), bytes))
        .unwrap();
    assert_eq!(rgb, [50, 15, 75]);
}

#[test]
fn unusable_pixels_are_black() {
    let size_px = (9, 7);
    let white = frame(PixelFormat::Rgb8, size_px, vec![255; 3 * 63]);
    let open: Vec<u8> = (0..63).map(|i| if i % 9 == 4 { 0 } else { 255 }).collect();
    let mask = Mask::from_grey(9, 7, &open).unwrap();
    let view = above(size_px, Some(mask));
    let rectifier = Rectifier::new(&view, same_area(size_px, 1.0), 0.01).unwrap();
    assert_eq!(rectifier.size_px(), (11, 9));
    let rgb = rectifier.rectify(&white).unwrap();
    let shown: Vec<bool> = rectifier.shown().collect();
    for y in 0..9 {
        for x in 0..11 {
            let inside = (1..10).contains(&x) && (1..8).contains(&y) && x != 5;
            assert_eq!(shown[y * 11 + x], inside);
            assert_eq!(rgb[3 * (y * 11 + x)], if inside { 255 } else { 0 });
        }
    }
    // Between pixels, the masked column is on both sides.
    let [low, high] = same_area(size_px, 0.0);
    let aside = [[low[0] + 0.004, low[1]], [high[0] + 0.004, high[1]]];
    let shown: Vec<bool> = Rectifier::new(&view, aside, 0.01)
        .unwrap()
        .shown()
        .collect();
    assert_eq!(
        shown[..9],
        [true, true, true, false, false, true, true, true, true]
    );
}

#[test]
fn an_area_is_found_with_and_without_the_horizon_in_view() {
    // Straight down on 4 m x 3 m, to a pixel.
    let model: Camera = above((400, 300), None).camera().clone();
    let view = View::new(model, Pose::identity(), (400, 300), None).unwrap();
    assert_eq!(visible_area_m(&view).unwrap(), [[-0.01, -3.0], [4.0, 0.01]]);
    assert!((default_step_m(&view, [[1.0, -2.0], [2.0, -1.0]]).unwrap() - 0.01).abs() < 1e-12);
    for model in [PINHOLE, FISHEYE] {
        let camera = seen(model).0.camera().clone();
        // Nearly level, with the horizon in view but not the point below the camera.
        let pose = looking_at(
            Vector3::new(0.0, 0.0, 1.5),
            Vector3::new(0.0, 10.0, 0.9),
            0.0,
        )
        .unwrap();
        let view = View::new(camera, pose, SIZE_PX, None).unwrap();
        let area = visible_area_m(&view).unwrap();
        assert!(area[1][1] > 3.0 && area[1][1] < 25.0, "{area:?}");
        assert!(area[0][0] < -2.0 && area[1][0] > 2.0, "{area:?}");
        let step_m = default_step_m(&view, area).unwrap();
        let (width, height) = Rectifier::new(&view, area, step_m).unwrap().size_px();
        assert!(width.max(height) < 3000, "{width} x {height}");
    }
}

#[test]
fn invalid_maps_are_rejected() {
    let view = above((40, 30), None);
    let refused = |view: &View, area: Area, step_m: f64, wanted: &str| {
        let error = Rectifier::new(view, area, step_m).unwrap_err().to_string();
        assert!(error.contains(wanted), "{error}");
    };
    let area = same_area((40, 30), 0.0);
    refused(&view, [area[1], area[0]], 0.01, "the minimum x and y");
    refused(
        &view,
        [[f64::NAN, 0.0], [1.0, 1.0]],
        0.01,
        "the minimum x and y",
    );
    refused(&view, [[0.0, 0.0], [1e9, 1.0]], 0.01, "the minimum x and y");
    for step_m in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        refused(&view, area, step_m, "positive number of metres");
    }
    refused(&view, area, 1e-5, "1 to 16384 per side");
    refused(&view, area, 5.0, "1 to 16384 per side");
    refused(
        &view,
        [[7.0, 7.0], [8.0, 8.0]],
        0.01,
        "shows nothing of the area",
    );
    let image = View::new(
        Camera::Plane(Plane::image()),
        Pose::identity(),
        (40, 30),
        None,
    )
    .unwrap();
    refused(&image, area, 0.01, "no metric scale");
    let camera = seen(PINHOLE).0.camera().clone();
    let below = looking_at(
        Vector3::new(0.0, 0.0, -2.0),
        Vector3::new(0.0, 1.0, 0.0),
        0.0,
    )
    .unwrap();
    let below = View::new(camera.clone(), below, SIZE_PX, None).unwrap();
    refused(&below, area, 0.01, "2 m below the plane");
    let up = looking_at(
        Vector3::new(0.0, 0.0, 2.0),
        Vector3::new(0.0, 1.0, 9.0),
        0.0,
    )
    .unwrap();
    let up = View::new(camera, up, SIZE_PX, None).unwrap();
    let error = visible_area_m(&up).unwrap_err().to_string();
    assert!(error.contains("nothing of the plane"), "{error}");
    let rectifier = Rectifier::new(&view, area, 0.01).unwrap();
    let other = frame(PixelFormat::Rgb8, (30, 40), vec![0; 3600]);
    assert!(matches!(
        rectifier.rectify(&other),
        Err(Error::SizeMismatch { .. })
    ));
}
