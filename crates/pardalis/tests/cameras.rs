//! One law checker over every camera model's valid and invalid examples, over the whole field of view.

use pardalis::camera::{Camera, Equidistant, PerspectiveMirror, Pinhole, Projection, Unified};

type ProjectF32 = Box<dyn Fn([f32; 3]) -> ([f32; 2], bool)>;

/// A model in both precisions with the bound of its domain as an angle from +z in radians (`nearest`, `farthest`).
struct Example {
    name: &'static str,
    camera: Camera,
    project_f32: ProjectF32,
    valid_angles_rad: std::ops::Range<f64>,
}

macro_rules! example {
    ($name:literal, $variant:ident, $model:expr, $angles:expr) => {{
        let model = $model.unwrap();
        let single = model.to_f32();
        Example {
            name: $name,
            camera: Camera::$variant(model),
            project_f32: Box::new(move |p| single.project(p)),
            valid_angles_rad: $angles,
        }
    }};
}

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
            Pinhole::new([600.0, 610.0], [320.0, 240.0], [0.0; 5]),
            0.0..deg(89.0)
        ),
        // Intrinsics of OpenCV's own calibration example, left camera.
        example!(
            "pinhole with barrel distortion",
            Pinhole,
            Pinhole::new(
                [535.91, 535.91],
                [342.28, 235.57],
                [-0.2663, -0.0385, 0.00178, -0.00028, 0.2384]
            ),
            0.0..deg(39.0)
        ),
        example!(
            "pinhole with pincushion distortion",
            Pinhole,
            Pinhole::new([800.0, 800.0], [320.0, 240.0], [0.1, 0.02, 0.0, 0.0, 0.0]),
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
        example!(
            "perspective for a mirror",
            PerspectiveMirror,
            PerspectiveMirror::new(140.0, [320.0, 240.0]),
            deg(91.0)..pi
        ),
    ]
}

fn direction(angle_rad: f64, azimuth_rad: f64) -> [f64; 3] {
    let (sin, cos) = angle_rad.sin_cos();
    [sin * azimuth_rad.cos(), sin * azimuth_rad.sin(), cos]
}

/// Directions all over the sphere, with their angle from the optical axis.
fn directions() -> impl Iterator<Item = (f64, [f64; 3])> {
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
                let point = direction.map(|c| c * range_m);
                let Some(pixel) = example.camera.project(point) else {
                    assert!(
                        !example.valid_angles_rad.contains(&angle_rad),
                        "{}: no pixel at {:.2} degrees",
                        example.name,
                        angle_rad.to_degrees()
                    );
                    continue;
                };
                let back = example.camera.unproject(pixel).unwrap_or_else(|| {
                    panic!(
                        "{}: no ray for {pixel:?} at {:.3} degrees",
                        example.name,
                        angle_rad.to_degrees()
                    )
                });
                let error = (0..3)
                    .map(|c| (back[c] - direction[c]).powi(2))
                    .sum::<f64>()
                    .sqrt();
                // Where the image is infinitely stretched or compressed the angle is worth less than the pixel.
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
fn single_precision_stays_within_a_hundredth_of_a_pixel() {
    for example in examples() {
        for (angle_rad, direction) in directions() {
            // Single precision is for pixels inside images, a little away from the border of the domain.
            let inside = example.valid_angles_rad.contains(&(angle_rad + 0.02))
                && (angle_rad < 0.02 || example.valid_angles_rad.contains(&(angle_rad - 0.02)));
            let Some(expected) = example
                .camera
                .project(direction)
                .filter(|p| inside && p[0].hypot(p[1]) < 2000.0)
            else {
                continue;
            };
            let (pixel, valid) = (example.project_f32)(direction.map(|c| c as f32));
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
        }
    }
}

#[test]
fn what_lies_behind_or_beyond_gets_no_pixel() {
    let behind = [0.0, 0.0, -1.0];
    let ahead = [0.0, 0.0, 1.0];
    for example in examples() {
        let forbidden = if example.valid_angles_rad.start > 0.0 {
            ahead
        } else {
            behind
        };
        assert_eq!(example.camera.project(forbidden), None, "{}", example.name);
        assert_eq!(example.camera.project([0.0; 3]), None, "{}", example.name);
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
    // The barrel polynomial turns back at about 45 degrees: beyond it points would come back into the image.
    let barrel = Camera::Pinhole(
        Pinhole::new([500.0, 500.0], [320.0, 240.0], [-0.3, 0.0, 0.0, 0.0, 0.0]).unwrap(),
    );
    assert!(barrel.project([1.0, 0.0, 1.0]).is_some());
    assert!(barrel.project([1.1, 0.0, 1.0]).is_none());
}

#[test]
fn known_pixels() {
    // rho = f * theta: the published check of the rendered fisheye sequences.
    let fisheye =
        Camera::Equidistant(Equidistant::new(145.562_250_654_857_8, [319.5, 239.5], 1.62).unwrap());
    let [u, v] = fisheye.project([1.25, -1.35, 0.28]).unwrap();
    assert!(
        (u - 459.9096).abs() < 1e-4 && (v - 87.8576).abs() < 1e-4,
        "{u} {v}"
    );
    // Unified with l = 0 is the perspective model.
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
fn impossible_parameters_are_refused() {
    for bad in [f64::NAN, f64::INFINITY, 0.0, -1.0] {
        assert!(Equidistant::new(bad, [0.0; 2], 1.0).is_err());
        assert!(Equidistant::new(100.0, [0.0; 2], bad).is_err());
        assert!(Pinhole::new([bad, 1.0], [0.0; 2], [0.0; 5]).is_err());
        assert!(PerspectiveMirror::new(bad, [0.0; 2]).is_err());
        assert!(Unified::new(0.5, 1.0, bad, [0.0; 2]).is_err());
    }
    assert!(Unified::new(-0.1, 1.0, 1.0, [0.0; 2]).is_err());
    assert!(Unified::new(0.5, -0.5, 1.0, [0.0; 2]).is_err());
    assert!(Equidistant::new(100.0, [f64::NAN, 0.0], 1.0).is_err());
    assert!(Pinhole::new([1.0; 2], [0.0; 2], [f64::NAN, 0.0, 0.0, 0.0, 0.0]).is_err());
}
