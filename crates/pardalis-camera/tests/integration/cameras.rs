//! Properties that every camera model must satisfy over its whole field of view.

use nalgebra::{Matrix3, Point3};
use pardalis_camera::Homography;
use pardalis_camera::{
    Camera, DoubleSphere, Equidistant, ExactMirror, ExtendedUnified, KannalaBrandt, Mei,
    MirrorProfile, Ocam, PerspectiveMirror, Pinhole, Plane, Projection, Ray, Unified, looking_at,
};
use pardalis_core::simd::Level;

type ProjectF32 = Box<dyn Fn([f32; 3]) -> ([f32; 2], bool)>;
type UnprojectF32 = Box<dyn Fn([f32; 2]) -> Option<Ray<f32>>>;

/// A model in both precisions and the range of its domain.
struct Example {
    name: &'static str,
    camera: Camera,
    project_f32: ProjectF32,
    unproject_f32: UnprojectF32,
    valid_angles_rad: std::ops::Range<f64>,
    /// Viewpoint in the camera frame: the origin, except for cameras of a plane, whose frame is
    /// that of the plane.
    vertex_m: [f64; 3],
}

impl Example {
    /// Returns the point in a direction from the viewpoint.
    fn point(&self, direction: [f64; 3], range_m: f64) -> [f64; 3] {
        std::array::from_fn(|c| self.vertex_m[c] + range_m * direction[c])
    }
}

macro_rules! example {
    ($name:literal, $variant:ident, $model:expr, $angles:expr) => {{
        let model = $model.unwrap();
        let (single, single_unproject) = (model.clone(), model.clone());
        Example {
            name: $name,
            camera: Camera::$variant(model),
            project_f32: Box::new(move |p| single.to_f32().project(p)),
            unproject_f32: Box::new(move |p| single_unproject.to_f32().unproject(p)),
            valid_angles_rad: $angles,
            vertex_m: [0.0; 3],
        }
    }};
}

#[allow(clippy::too_many_lines)] // a table
fn examples() -> Vec<Example> {
    let deg = f64::to_radians;
    let pi = std::f64::consts::PI;
    vec![
        example!(
            "fisheye of 185 degrees",
            Equidistant,
            Equidistant::new(145.562, [319.5, 239.5], deg(92.5)),
            0.0..deg(92.5)
        ),
        example!(
            "equidistant all around",
            Equidistant,
            Equidistant::new(200.0, [640.2, 480.7], pi),
            0.0..deg(179.9)
        ),
        example!(
            "ideal pinhole",
            Pinhole,
            Pinhole::new([600.0, 610.0], [320.0, 240.0], &[]),
            0.0..deg(89.0)
        ),
        // Intrinsics of the left camera in OpenCV's calibration example.
        example!(
            "pinhole with barrel distortion",
            Pinhole,
            Pinhole::new(
                [535.91, 535.91],
                [342.28, 235.57],
                &[-0.2663, -0.0385, 0.00178, -0.00028, 0.2384]
            ),
            0.0..deg(39.0)
        ),
        example!(
            "pinhole with pincushion distortion",
            Pinhole,
            Pinhole::new([800.0, 800.0], [320.0, 240.0], &[0.1, 0.02, 0.0, 0.0, 0.0]),
            0.0..deg(70.0)
        ),
        example!(
            "unified, l below 1",
            Unified,
            Unified::new(0.9, 1.2, 150.0, [320.0, 240.0]),
            deg(30.0)..pi
        ),
        example!(
            "unified, parabolic",
            Unified,
            Unified::new(1.0, 0.0, 200.0, [320.0, 240.0]),
            deg(5.0)..pi
        ),
        example!(
            "unified, l above 1",
            Unified,
            Unified::new(1.4, 0.8, 120.0, [320.0, 240.0]),
            deg(46.0)..pi
        ),
        // All coefficients that OpenCV writes, from a calibration of a wide-angle webcam.
        example!(
            "pinhole with rational and prism distortion",
            Pinhole,
            Pinhole::new(
                [610.2, 611.9],
                [323.4, 241.8],
                &[
                    0.42, 0.11, 0.0007, -0.0004, 0.004, 0.75, 0.21, 0.02, 0.0011, -0.0003, 0.0008,
                    0.0002
                ]
            ),
            0.0..deg(60.0)
        ),
        example!(
            "Kannala-Brandt of 200 degrees",
            KannalaBrandt,
            KannalaBrandt::new(
                [380.8, 380.6],
                [510.2, 514.3],
                [0.0101, -0.0031, 0.0019, -0.0007],
                deg(100.0)
            ),
            0.0..deg(100.0)
        ),
        // The polynomial folds back at 78.5 degrees.
        example!(
            "Kannala-Brandt that folds",
            KannalaBrandt,
            KannalaBrandt::new([300.0, 300.0], [320.0, 240.0], [-0.05, -0.03, 0.0, 0.0], pi),
            0.0..deg(75.0)
        ),
        // OpenCV's omnidir result for the mirror camera of its tutorial.
        example!(
            "Mei, xi above 1",
            Mei,
            Mei::new(
                [408.9, 410.5],
                0.3,
                [630.3, 431.9],
                1.053,
                [-0.02, 0.003, 0.0005, -0.0003]
            ),
            0.0..deg(155.0)
        ),
        example!(
            "Mei, xi below 1",
            Mei,
            Mei::new([450.0, 450.0], 0.0, [640.0, 480.0], 0.8, [0.0; 4]),
            0.0..deg(140.0)
        ),
        example!(
            "double sphere, alpha above a half",
            DoubleSphere,
            DoubleSphere::new([313.2, 313.3], [638.7, 514.4], -0.18, 0.59),
            0.0..deg(110.0)
        ),
        example!(
            "double sphere, alpha below a half",
            DoubleSphere,
            DoubleSphere::new([400.0, 400.0], [320.0, 240.0], 0.2, 0.3),
            0.0..deg(110.0)
        ),
        example!(
            "extended unified, alpha above a half",
            ExtendedUnified,
            ExtendedUnified::new([380.0, 381.0], [320.0, 240.0], 0.63, 1.04),
            0.0..deg(120.0)
        ),
        example!(
            "extended unified, alpha below a half",
            ExtendedUnified,
            ExtendedUnified::new([380.0, 381.0], [320.0, 240.0], 0.4, 0.9),
            0.0..deg(120.0)
        ),
        // OCamCalib's samples.
        example!(
            "OCamCalib's fisheye",
            Ocam,
            Ocam::new(
                &[-551.7655, 0.0, 8.372_454e-4, -6.474_789e-7, 1.235_631e-9],
                [505.480_427, 381.777_786],
                [1.0, 0.0, 0.0],
                640.0
            ),
            0.0..deg(70.0)
        ),
        example!(
            "OCamCalib's mirror",
            Ocam,
            Ocam::new(
                &[-131.4797, 0.0, 1.848_991e-3, 2.251_206e-7, -7.343_233e-10],
                [515.323_794, 382.294_245],
                [0.999_845, 0.000_044, 0.000_008],
                470.0
            ),
            0.0..deg(110.0)
        ),
        example!(
            "perspective for a mirror",
            PerspectiveMirror,
            PerspectiveMirror::new(140.0, [320.0, 240.0]),
            deg(91.0)..pi
        ),
        example!(
            "ball as a mirror",
            ExactMirror,
            ExactMirror::new(
                [580.0, 570.0],
                [320.0, 240.0],
                MirrorProfile::sphere(0.1, 0.05, 0.04).unwrap()
            ),
            deg(70.0)..pi
        ),
        measured_at_viewpoint(example!(
            "plane straight below",
            Plane,
            Plane::new(&straight_below(), Some([0.25, -0.5, 4.0])),
            deg(90.5)..pi
        )),
        // The camera looks 53 degrees up from straight down.
        measured_at_viewpoint(example!(
            "plane from a mast",
            Plane,
            Plane::new(&from_a_mast(), Some([0.0, -3.2, 3.0])),
            deg(144.0)..pi
        )),
    ]
}

/// A camera on a mast, fitted to a rectangle of tape.
fn from_a_mast() -> Homography {
    let rows = [
        [131.2446, 51.8354, 298.7085],
        [-1.7206, -33.8075, 298.4342],
        [0.0092, 0.1826, 1.0],
    ];
    Homography::new(Matrix3::from_row_slice(rows.as_flattened())).unwrap()
}

/// A camera with a focal length of 800 px, 4 m above (0.25, −0.5).
fn straight_below() -> Homography {
    let rows = [[200.0, 0.0, 270.0], [0.0, -200.0, 140.0], [0.0, 0.0, 1.0]];
    Homography::new(Matrix3::from_row_slice(rows.as_flattened())).unwrap()
}

/// Measures the angles of an example at its viewpoint.
fn measured_at_viewpoint(example: Example) -> Example {
    Example {
        vertex_m: example.camera.viewpoint_m(),
        ..example
    }
}

/// Returns the point of a ray that is as far from the ray's origin as the given point.
fn point_at_same_range(ray: &Ray<f64>, point: [f64; 3]) -> [f64; 3] {
    let range_m = (0..3)
        .map(|c| (point[c] - ray.origin[c]).powi(2))
        .sum::<f64>()
        .sqrt();
    std::array::from_fn(|c| ray.origin[c] + range_m * ray.direction[c])
}

fn direction(angle_rad: f64, azimuth_rad: f64) -> [f64; 3] {
    let (sin, cos) = angle_rad.sin_cos();
    [sin * azimuth_rad.cos(), sin * azimuth_rad.sin(), cos]
}

/// Returns directions throughout the sphere and their angles from the optical axis.
fn directions() -> impl Iterator<Item = (f64, [f64; 3])> + Clone {
    (0..=1800).flat_map(|i| {
        let angle_rad = f64::from(i) / 1800.0 * std::f64::consts::PI;
        (0..24).map(move |j| {
            (
                angle_rad,
                direction(angle_rad, f64::from(j) / 24.0 * std::f64::consts::TAU + 0.1),
            )
        })
    })
}

#[test]
fn unproject_inverts_project_over_the_whole_domain() {
    for example in examples() {
        let mut checked = 0;
        for (angle_rad, direction) in directions() {
            for range_m in [0.05, 1.0, 40.0] {
                let point = example.point(direction, range_m);
                let Some(pixel) = example.camera.project(point) else {
                    assert!(
                        !example.valid_angles_rad.contains(&angle_rad),
                        "{}: no pixel at {:.2} degrees",
                        example.name,
                        angle_rad.to_degrees()
                    );
                    continue;
                };
                let ray = example.camera.unproject(pixel).unwrap_or_else(|| {
                    panic!(
                        "{}: no ray for {pixel:?} at {:.3} degrees",
                        example.name,
                        angle_rad.to_degrees()
                    )
                });
                let central = !matches!(example.camera, Camera::ExactMirror(_));
                assert_eq!(ray.origin == example.vertex_m, central, "{}", example.name);
                let back = point_at_same_range(&ray, point);
                let error = (0..3)
                    .map(|c| ((back[c] - point[c]) / range_m).powi(2))
                    .sum::<f64>()
                    .sqrt();
                // Where the image is extremely stretched or compressed, compare pixels instead of
                // angles.
                let again = example.camera.project(back).unwrap_or(pixel);
                let error_px = (again[0] - pixel[0]).hypot(again[1] - pixel[1])
                    / (1.0 + pixel[0].hypot(pixel[1]));
                assert!(
                    error < 1e-9 || error_px < 1e-9,
                    "{}: {error} at {:.3} degrees",
                    example.name,
                    angle_rad.to_degrees()
                );
                assert!(
                    error < 1e-4,
                    "{}: {error} at {:.3} degrees",
                    example.name,
                    angle_rad.to_degrees()
                );
                checked += 1;
            }
        }
        assert!(
            checked > 5000,
            "{}: only {checked} directions in the domain",
            example.name
        );
    }
}

#[test]
fn single_precision_is_accurate_to_a_hundredth_of_a_pixel() {
    for example in examples() {
        for (angle_rad, direction) in directions() {
            // Single precision serves pixels inside images, at some distance from the border of the
            // domain.
            let inside = example.valid_angles_rad.contains(&(angle_rad + 0.02))
                && (angle_rad < 0.02 || example.valid_angles_rad.contains(&(angle_rad - 0.02)));
            let point = example.point(direction, 1.0);
            let Some(expected) = example
                .camera
                .project(point)
                .filter(|p| inside && p[0].hypot(p[1]) < 2000.0)
            else {
                continue;
            };
            let (pixel, valid) = (example.project_f32)(point.map(|c| c as f32));
            assert!(
                valid,
                "{}: {:.2} degrees",
                example.name,
                angle_rad.to_degrees()
            );
            let error =
                (f64::from(pixel[0]) - expected[0]).hypot(f64::from(pixel[1]) - expected[1]);
            assert!(
                error < 0.01,
                "{}: {error} px at {:.2} degrees",
                example.name,
                angle_rad.to_degrees()
            );
            // Farther out in the parabolic image, a direction in single precision is itself too
            // coarse.
            if expected[0].hypot(expected[1]) > 1500.0 {
                continue;
            }
            let back = (example.unproject_f32)(pixel).expect("a ray for a pixel in the domain");
            let back = Ray {
                origin: back.origin.map(f64::from),
                direction: back.direction.map(f64::from),
            };
            let ([u, v], _) =
                (example.project_f32)(point_at_same_range(&back, point).map(|c| c as f32));
            let error = (u - pixel[0]).hypot(v - pixel[1]);
            assert!(
                error < 0.01,
                "{}: {error} px there and back at {:.2} degrees",
                example.name,
                angle_rad.to_degrees()
            );
        }
    }
}

#[test]
fn batches_yield_the_pixels_of_single_points() {
    for example in examples() {
        let points: Vec<[f32; 3]> = directions()
            .map(|(_, direction)| example.point(direction, 1.0).map(|c| c as f32))
            .collect();
        let columns = [0, 1, 2].map(|c| points.iter().map(|p| p[c]).collect::<Vec<f32>>());
        for level in Level::available() {
            // Sizes that are not multiples of the block.
            for count in [points.len(), 21, 0] {
                let (mut u, mut v) = (vec![0.0; count], vec![0.0; count]);
                let columns = [0, 1, 2].map(|c| &columns[c][..count]);
                example
                    .camera
                    .project_points(level, columns, [&mut u, &mut v]);
                for i in 0..count {
                    let (pixel, valid) = (example.project_f32)(points[i]);
                    if valid {
                        assert_eq!([u[i], v[i]], pixel, "{}: {:?}", example.name, points[i]);
                    } else {
                        assert!(
                            u[i].is_nan() && v[i].is_nan(),
                            "{}: {:?}",
                            example.name,
                            points[i]
                        );
                    }
                }
            }
        }
    }
}

#[test]
fn rows_yield_the_pixels_of_single_points_in_double_precision() {
    let world_from_camera = looking_at([0.4, -1.2, 2.5].into(), [0.1, 0.3, 0.2].into(), 0.3);
    let world_from_camera = world_from_camera.unwrap();
    let camera_from_world = world_from_camera.inverse();
    let (mut inside, mut outside) = (0, 0);
    for example in examples() {
        let points_m: Vec<[f64; 3]> = directions()
            .map(|(_, direction)| {
                (world_from_camera * Point3::from(example.point(direction, 1.0))).into()
            })
            .collect();
        for level in Level::available() {
            let mut pixels = vec![[0.0; 2]; points_m.len()];
            let camera = &example.camera;
            camera.project_rows(level, &camera_from_world, &points_m, &mut pixels);
            for (point_m, pixel) in points_m.iter().zip(&pixels) {
                let in_camera = camera_from_world * Point3::from(*point_m);
                if let Some(expected) = camera.project(in_camera.into()) {
                    assert_eq!(*pixel, expected, "{}", example.name);
                    inside += 1;
                } else {
                    assert!(pixel.iter().all(|c| c.is_nan()), "{}", example.name);
                    outside += 1;
                }
            }
        }
    }
    assert!(inside > 1000 && outside > 1000, "{inside}, {outside}");
}

#[test]
fn points_behind_or_beyond_the_domain_have_no_pixel() {
    let behind = [0.0, 0.0, -1.0];
    let ahead = [0.0, 0.0, 1.0];
    for example in examples() {
        let forbidden = if example.valid_angles_rad.start > 0.0 {
            ahead
        } else {
            behind
        };
        let forbidden = example.point(forbidden, 1.0);
        assert_eq!(example.camera.project(forbidden), None, "{}", example.name);
        // A mirror may show the pinhole; for a plane, rounding may make the viewpoint valid.
        if !matches!(example.camera, Camera::ExactMirror(_) | Camera::Plane(_)) {
            let vertex = example.camera.project(example.vertex_m);
            assert_eq!(vertex, None, "{}", example.name);
        }
        let (_, valid) = (example.project_f32)(forbidden.map(|c| c as f32));
        assert!(!valid, "{}", example.name);
        for point in [[f64::NAN, 0.0, 1.0], [0.0, f64::NAN, -1.0]] {
            assert_eq!(example.camera.project(point), None, "{}", example.name);
        }
        assert_eq!(
            example.camera.unproject([f64::NAN, 0.0]),
            None,
            "{}",
            example.name
        );
    }
    // The barrel polynomial folds back at about 45 degrees: points beyond must not reappear in the
    // image.
    let barrel = Camera::Pinhole(
        Pinhole::new([500.0, 500.0], [320.0, 240.0], &[-0.3, 0.0, 0.0, 0.0, 0.0]).unwrap(),
    );
    assert!(barrel.project([1.0, 0.0, 1.0]).is_some());
    assert!(barrel.project([1.1, 0.0, 1.0]).is_none());
}

#[test]
fn jacobians_agree_with_finite_differences() {
    check_jacobians(directions().step_by(5 * 37), 60);
}

#[test]
#[ignore = "exhaustive: the gate runs it with --ignored"]
fn jacobians_agree_with_finite_differences_in_many_directions() {
    check_jacobians(directions().step_by(37), 300);
}

/// Checks the Jacobians of every camera in these directions, with at least `least` derivatives for each camera.
fn check_jacobians(directions: impl Iterator<Item = (f64, [f64; 3])> + Clone, least: usize) {
    for example in examples() {
        let camera = &example.camera;
        let values: Vec<f64> = camera.parameters().iter().map(|p| p.1).collect();
        let mut checked = 0;
        for (angle_rad, direction) in directions.clone() {
            let inside = |a: f64| example.valid_angles_rad.contains(&a);
            // Includes the axis, but not the border, where finite differences leave the domain.
            if !inside(angle_rad + 0.02) || (angle_rad > 0.02 && !inside(angle_rad - 0.02)) {
                continue;
            }
            let point = example.point(direction, 1.3);
            let jacobian = camera.project_with_jacobian(point).unwrap();
            assert_eq!(
                Some(jacobian.pixel),
                camera.project(point),
                "{}",
                example.name
            );
            let size = jacobian.pixel[0].hypot(jacobian.pixel[1]).max(1.0);
            if size > 3000.0 {
                continue;
            }
            for axis in 0..3 {
                let step = 1e-6;
                let shifted = |sign: f64| {
                    let mut p = point;
                    p[axis] += sign * step;
                    camera.project(p).unwrap()
                };
                let (after, before) = (shifted(1.0), shifted(-1.0));
                for c in 0..2 {
                    let numeric = (after[c] - before[c]) / (2.0 * step);
                    let derivative = jacobian.by_point[c][axis];
                    assert!(
                        (derivative - numeric).abs() < 1e-5 * (1.0 + size + numeric.abs()),
                        "{}: {derivative} {numeric} by axis {axis} at {:.2} degrees",
                        example.name,
                        angle_rad.to_degrees()
                    );
                }
            }
            for (i, derivatives) in jacobian.by_parameters.iter().enumerate() {
                let step = 1e-6
                    * values[i]
                        .abs()
                        .max(if values[i] == 0.0 { 1e-6 } else { 0.0 });
                let shifted = |sign: f64| {
                    let mut values = values.clone();
                    values[i] += sign * step;
                    camera.with_parameters(&values).ok()?.project(point)
                };
                // Some parameters are at the limit of their range or unused in this example.
                let (Some(after), Some(before)) = (shifted(1.0), shifted(-1.0)) else {
                    continue;
                };
                if after == before {
                    continue;
                }
                for c in 0..2 {
                    let numeric = (after[c] - before[c]) / (2.0 * step);
                    let noise = 1e-12 * size / step;
                    assert!(
                        (derivatives[c] - numeric).abs() < 1e-5 * (1.0 + numeric.abs()) + noise,
                        "{}: {} {numeric} by parameter {i} at {:.2} degrees",
                        example.name,
                        derivatives[c],
                        angle_rad.to_degrees()
                    );
                }
                checked += 1;
            }
        }
        assert!(
            checked > least,
            "{}: only {checked} derivatives",
            example.name
        );
    }
}

#[test]
fn known_points_have_known_pixels() {
    // ρ = f·θ: the published check of the rendered fisheye sequences.
    let fisheye =
        Camera::Equidistant(Equidistant::new(145.562_250_654_857_8, [319.5, 239.5], 1.62).unwrap());
    let [u, v] = fisheye.project([1.25, -1.35, 0.28]).unwrap();
    assert!(
        (u - 459.9096).abs() < 1e-4 && (v - 87.8576).abs() < 1e-4,
        "{u} {v}"
    );
    // The unified model with l = 0 is the perspective model.
    let unified = Camera::Unified(Unified::new(0.0, 140.0, 1.0, [320.0, 240.0]).unwrap());
    let perspective =
        Camera::PerspectiveMirror(PerspectiveMirror::new(140.0, [320.0, 240.0]).unwrap());
    assert_eq!(
        unified.project([0.3, 0.4, -0.5]),
        perspective.project([0.3, 0.4, -0.5])
    );
    assert_eq!(
        perspective.project([0.3, 0.4, -0.5]),
        Some([320.0 + 84.0, 240.0 + 112.0])
    );
}

#[test]
fn invalid_parameters_are_rejected() {
    for bad in [f64::NAN, f64::INFINITY, 0.0, -1.0] {
        assert!(Equidistant::new(bad, [0.0; 2], 1.0).is_err());
        assert!(Equidistant::new(100.0, [0.0; 2], bad).is_err());
        assert!(Pinhole::new([bad, 1.0], [0.0; 2], &[]).is_err());
        assert!(PerspectiveMirror::new(bad, [0.0; 2]).is_err());
        assert!(Unified::new(0.5, 1.0, bad, [0.0; 2]).is_err());
    }
    assert!(Unified::new(-0.1, 1.0, 1.0, [0.0; 2]).is_err());
    assert!(Unified::new(0.5, -0.5, 1.0, [0.0; 2]).is_err());
    assert!(Equidistant::new(100.0, [f64::NAN, 0.0], 1.0).is_err());
    assert!(Pinhole::new([1.0; 2], [0.0; 2], &[f64::NAN, 0.0, 0.0, 0.0, 0.0]).is_err());
}
