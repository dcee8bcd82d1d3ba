//! The likelihood and the fit of boxes.

use super::body_box::BodyBox;
use super::*;
use crate::reference::boxes_log_ratio;
use crate::shape::{Section, Shape, Sphere, SphereOutline, Upright, UprightOutline};
use crate::tracker::{DetectorSettings, ImageBox};
use crate::view::View;
use nalgebra::{Matrix3, Vector3};
use pardalis_camera::{Camera, Equidistant, Pinhole, looking_at};
use pardalis_core::rng::Draws;

fn view(camera: impl Into<Camera>) -> View {
    let [from_m, at_m] = [[0.0, -3.0, 2.0], [0.0, 0.0, 0.5]].map(Vector3::from);
    let pose = looking_at(from_m, at_m, 0.0).unwrap();
    View::new(camera, pose, (640, 480), None).unwrap()
}

fn views() -> [View; 2] {
    let pinhole = Pinhole::new([500.0; 2], [319.5, 239.5], &[]).unwrap();
    let fisheye = Equidistant::new(200.0, [319.5, 239.5], 1.6).unwrap();
    [view(pinhole), view(fisheye)]
}

fn shapes() -> [Shape; 2] {
    let section = Section::circle(0.3).unwrap();
    [
        Shape::Sphere(Sphere::new(0.15, SphereOutline::Tangent).unwrap()),
        Shape::Upright(Upright::new(section, 1.2, UprightOutline::Exact).unwrap()),
    ]
}

fn body(shape: &Shape) -> Body {
    Body::new(shape, matches!(shape, Shape::Upright(_)).then_some(0.0))
}

#[test]
fn likelihoods_are_the_oracles() {
    let detector = DetectorSettings {
        false_per_image: 2.0,
        ..DetectorSettings::default()
    };
    for (view, shape) in views()
        .iter()
        .zip(shapes())
        .chain(views().iter().zip(shapes()).rev())
    {
        let outline = BodyBox::new(&shape);
        let [u0, v0, u1, v1] = outline.sides_px(view, [0.4, 0.3, 0.0], 1.0).unwrap();
        let boxes = [
            ImageBox::new([u0 - 2.0, v0 + 1.0, u1, v1 + 3.0]).unwrap(),
            ImageBox::new([u0 + 9.0, v0 - 30.0, u1, v1])
                .unwrap()
                .with_score(0.9)
                .unwrap(),
            ImageBox::new([30.0, 20.0, 70.0, 55.0])
                .unwrap()
                .with_score(1.0)
                .unwrap(),
            // Cut off by the image's border.
            ImageBox::new([600.0, 300.0, 700.0, 460.0]).unwrap(),
        ];
        let sights = |found| Sight::new(0, view, found, &detector);
        let sights: Vec<Sight> = boxes.iter().filter_map(sights).collect();
        assert_eq!(sights.len(), 4);
        let mut compared = 0;
        // Near and far.
        for (i, j, step) in (0..800).map(|n| (n % 20, n / 20 % 20, [0.3, 0.02][n / 400])) {
            let [x, y] = [
                0.4 + step * (i as f64 - 10.0),
                0.3 + step * (j as f64 - 6.0),
            ];
            let position_m = [x, y, 0.0];
            let fast = log_ratio((&outline, view), position_m, sights.iter(), &detector);
            let naive = boxes_log_ratio(view, &shape, position_m, &boxes, &detector);
            assert!(
                (fast - naive).abs() < 0.05,
                "{shape:?} {position_m:?}: {fast} {naive}"
            );
            compared += usize::from(naive > 0.0);
        }
        assert!(compared > 50, "{compared}");
    }
}

#[test]
fn fits_of_exact_boxes_are_exact() {
    for view in views() {
        for shape in shapes() {
            let body = body(&shape);
            for position_m in [[0.4, 0.3, 0.0], [-0.8, 1.5, 0.0], [1.0, 5.0, 0.0]] {
                let sides = body.outline.sides_px(&view, position_m, 1.0).unwrap();
                let found = ImageBox::new(sides).unwrap();
                let sight = Sight::new(0, &view, &found, &DetectorSettings::default()).unwrap();
                let fit = body.fit_one(std::slice::from_ref(&view), &sight).unwrap();
                let off_m = (fit.position_m - Vector3::from(position_m)).norm();
                assert!(
                    off_m < 2e-3 && fit.squares < 1e-3,
                    "{shape:?} {position_m:?} {fit:?}"
                );
                // A body of another size would be elsewhere: boxes larger by 2 %.
                let larger = body.outline.sides_px(&view, position_m, 1.02).unwrap();
                let found = ImageBox::new(larger).unwrap();
                let sight = Sight::new(0, &view, &found, &DetectorSettings::default()).unwrap();
                let there = body.fit_one(std::slice::from_ref(&view), &sight).unwrap();
                let drift_m = -0.02 * fit.drift_m;
                let error_m = (there.position_m - fit.position_m - drift_m).norm();
                assert!(error_m < 0.1 * drift_m.norm() + 2e-3, "{there:?} {drift_m}");
            }
        }
    }
}

#[test]
fn covariances_are_the_scatter_of_fits() {
    let [view, _] = views();
    let body = body(&shapes()[0]);
    let position_m = [0.4, 0.8, 0.3];
    let sides = body.outline.sides_px(&view, position_m, 1.0).unwrap();
    let detector = DetectorSettings::default();
    let draws = Draws::new(5, 0);
    let (mut sum, mut stated, count) = (Matrix3::zeros(), Matrix3::zeros(), 400_u32);
    for i in 0..count {
        let normals = draws.normals(i, 0, pardalis_core::rng::Stage::Start, 0);
        let exact = Sight::new(0, &view, &ImageBox::new(sides).unwrap(), &detector).unwrap();
        let mut noisy = sides;
        for (side, normal) in noisy.iter_mut().zip(normals) {
            *side += exact.sigma_px * f64::from(normal);
        }
        let sight = Sight::new(0, &view, &ImageBox::new(noisy).unwrap(), &detector).unwrap();
        let fit = body.fit_one(std::slice::from_ref(&view), &sight).unwrap();
        let off = fit.position_m - Vector3::from(position_m);
        sum += off * off.transpose();
        stated += fit.covariance_m2;
    }
    for axis in 0..3 {
        let ratio = sum[(axis, axis)] / stated[(axis, axis)];
        assert!((0.75..1.33).contains(&ratio), "{axis}: {ratio}");
    }
}
