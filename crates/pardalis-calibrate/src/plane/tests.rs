use nalgebra::{Matrix3, Vector3};

use super::{PointPair, camera_center_m, fit};
use pardalis_camera::Homography;
use pardalis_core::rng::{Draws, Stage};

/// Corners of a rectangle of 2 x 1.5 m: pixels and positions in metres. The camera is 3 m above the plane and
/// looks down at it.
const CORNERS: [([f64; 2], [f64; 2]); 4] = [
    (
        [184.344_608_813_894_47, 327.520_608_999_532_3],
        [-0.845_246_694_951_730_2, -0.267_929_511_438_993_35],
    ),
    (
        [448.729_156_981_712_44, 304.714_280_487_841_7],
        [1.149_881_405_567_918_3, -0.128_416_563_950_742_75],
    ),
    (
        [402.422_565_187_290_45, 198.820_937_515_488_03],
        [1.045_246_694_951_730_3, 1.367_929_511_438_993_6],
    ),
    (
        [195.566_659_969_759_54, 212.695_317_364_078_33],
        [-0.949_881_405_567_918_2, 1.228_416_563_950_742_7],
    ),
];

fn corners() -> Vec<PointPair> {
    let pair = |(pixel, plane_m)| PointPair { pixel, plane_m };
    CORNERS.map(pair).to_vec()
}

/// Returns the homography of the camera of [`CORNERS`].
fn true_homography() -> Homography {
    let camera_from_world = Matrix3::new(
        0.998_720_613_581_360_2,
        -0.030_560_171_417_446_564,
        0.040_289_104_365_916_23,
        -0.050_568_132_333_234_3,
        -0.603_563_385_494_569_7,
        0.795_709_811_226_845_5,
        0.0,
        -0.796_729_135_662_346_6,
        -0.604_336_565_488_743_4,
    )
    .transpose();
    let translation = -camera_from_world * Vector3::new(0.0, -3.2, 3.0);
    let intrinsics = Matrix3::new(560.0, 0.0, 319.5, 0.0, 560.0, 239.5, 0.0, 0.0, 1.0);
    let pose = Matrix3::from_columns(&[
        camera_from_world.column(0).into(),
        camera_from_world.column(1).into(),
        translation,
    ]);
    Homography::new(intrinsics * pose).unwrap()
}

/// Returns points on a grid over the plane, as seen by the camera of [`CORNERS`].
fn grid(count: usize) -> Vec<PointPair> {
    let point = |i: usize| {
        let plane_m = [
            (i % 5) as f64 * 0.5 - 1.0,
            (i / 5) as f64 * 0.45 - 0.5 + 0.03 * (i % 3) as f64,
        ];
        let pixel = true_homography().pixel_of(plane_m).unwrap();
        PointPair { pixel, plane_m }
    };
    (0..count).map(point).collect()
}

fn distance([a, b]: [f64; 2], [c, d]: [f64; 2]) -> f64 {
    (a - c).hypot(b - d)
}

fn error_of(pairs: &[PointPair]) -> String {
    fit(pairs).unwrap_err().to_string()
}

#[test]
fn fits_four_points_exactly() {
    let fitted = fit(&corners()).unwrap();
    assert!(fitted.rms_px < 1e-9, "{}", fitted.rms_px);
    assert!(fitted.outliers.is_empty());
    for pair in grid(20) {
        let pixel = fitted.homography.pixel_of(pair.plane_m).unwrap();
        assert!(distance(pixel, pair.pixel) < 1e-6);
        let plane_m = fitted.homography.plane_of(pair.pixel).unwrap();
        assert!(distance(plane_m, pair.plane_m) < 1e-8);
    }
}

/// Points behind the camera have no pixel, and pixels above the horizon have no point.
#[test]
fn plane_ends_at_horizon() {
    let homography = fit(&corners()).unwrap().homography;
    assert_eq!(homography.pixel_of([0.0, -20.0]), None);
    // The optical axis points 37 degrees below the horizon, which is 425 px above the principal point.
    assert!(homography.plane_of([319.5, -180.0]).is_some());
    assert_eq!(homography.plane_of([319.5, -190.0]), None);
}

/// With n points of noise sigma, the fitted points have errors of sigma sqrt(8 / n), and the residuals are
/// sigma sqrt((2 n - 8) / n).
#[test]
fn noise_is_averaged_as_least_squares_predict() {
    const SIGMA_PX: f64 = 0.5;
    const TRIALS: u32 = 200;
    let exact = grid(20);
    let (mut errors, mut residuals) = (0.0, 0.0);
    for trial in 0..TRIALS {
        let mut pairs = exact.clone();
        for (i, pair) in pairs.iter_mut().enumerate() {
            let noise = Draws::new(1, trial).normals(i as u32, 0, Stage::Pixel, 0);
            for c in 0..2 {
                pair.pixel[c] += SIGMA_PX * f64::from(noise[c]);
            }
        }
        let fitted = fit(&pairs).unwrap();
        assert!(fitted.outliers.is_empty());
        residuals += fitted.rms_px.powi(2);
        let square = |p: &PointPair| {
            distance(fitted.homography.pixel_of(p.plane_m).unwrap(), p.pixel).powi(2)
        };
        errors += exact.iter().map(square).sum::<f64>() / 20.0;
    }
    let rms = |sum: f64| (sum / f64::from(TRIALS)).sqrt() / SIGMA_PX;
    // 1600 and 6400 degrees of freedom: standard deviations of 1.8 % and 0.9 %.
    let (expected_error, expected_residual) = (0.4_f64.sqrt(), 1.6_f64.sqrt());
    assert!(
        (rms(errors) / expected_error - 1.0).abs() < 0.06,
        "{}",
        rms(errors)
    );
    assert!(
        (rms(residuals) / expected_residual - 1.0).abs() < 0.03,
        "{}",
        rms(residuals)
    );
}

#[test]
fn reports_and_excludes_outliers() {
    for (count, wrong) in [
        (6, vec![2]),
        (10, vec![0, 7]),
        (20, vec![1, 4, 9, 16]),
        (60, vec![3, 50]),
    ] {
        let mut pairs = grid(count);
        for (n, &i) in wrong.iter().enumerate() {
            pairs[i].pixel[n % 2] += 15.0 + 10.0 * n as f64;
        }
        let fitted = fit(&pairs).unwrap();
        assert_eq!(fitted.outliers, wrong);
        assert!(fitted.rms_px < 1e-6, "{}", fitted.rms_px);
        let residual = fitted.residuals_px[wrong[0]].unwrap();
        assert!((residual[0] + 15.0).abs() < 1e-6, "{residual:?}");
    }
}

#[test]
fn rejects_invalid_points_with_the_reason() {
    let changed = |change: fn(&mut Vec<PointPair>)| {
        let mut pairs = corners();
        change(&mut pairs);
        error_of(&pairs)
    };
    for (message, expected) in [
        (changed(|p| p.truncate(3)), "3 points are too few"),
        (
            changed(|p| p[1].pixel[0] = f64::NAN),
            "point 2 has a coordinate that is not a number",
        ),
        (
            changed(|p| p[3].plane_m[1] = 1e7),
            "point 4 has a coordinate",
        ),
        (
            changed(|p| p[2] = p[0]),
            "points 1 and 3 are the same on the plane",
        ),
        (
            changed(|p| p[2].pixel = p[0].pixel),
            "points 1 and 3 are the same in the image",
        ),
        (
            changed(|p| {
                p[2].plane_m = [0, 1].map(|c| 2.0 * p[1].plane_m[c] - p[0].plane_m[c]);
            }),
            "points 1, 2 and 3 lie on one line",
        ),
        (
            changed(|p| {
                p[3].pixel = [0, 1].map(|c| f64::midpoint(p[1].pixel[c], p[2].pixel[c]));
            }),
            "points 2, 3 and 4 lie on one line",
        ),
        (
            changed(|p| (p[1].pixel, p[2].pixel) = (p[2].pixel, p[1].pixel)),
            "the order of the points is crossed",
        ),
        (
            changed(|p| p.iter_mut().for_each(|pair| pair.plane_m[0] *= -1.0)),
            "left and right are swapped",
        ),
        // In the image alone, the fourth point lies within the triangle of the others.
        (
            changed(|p| p[3].pixel = [350.0, 280.0]),
            "would lie behind the horizon",
        ),
    ] {
        assert!(message.contains(expected), "{message}");
    }
}

#[test]
fn rejects_points_that_are_collinear_except_one() {
    let mut pairs = grid(7);
    for pair in &mut pairs[..6] {
        pair.plane_m[1] = 0.2 * pair.plane_m[0];
    }
    let mut observed = pairs.clone();
    for pair in &mut observed {
        pair.pixel = true_homography().pixel_of(pair.plane_m).unwrap();
    }
    // Two columns of the grid coincide after the change.
    observed.remove(5);
    assert!(error_of(&observed).contains("all points but one lie on one line"));
}

/// Any four of five points agree, whichever is wrong; the same holds for six points with two wrong ones.
#[test]
fn rejects_inconsistent_points() {
    let mut pairs = corners();
    pairs.extend(&grid(8)[6..]);
    pairs[4].pixel[1] += 30.0;
    pairs[0].pixel[0] -= 30.0;
    let message = error_of(&pairs);
    assert!(
        message.contains("one plane explains at most 4 of 6 within 4 pixels"),
        "{message}"
    );
    assert!(error_of(&pairs[..5]).contains("are inconsistent"));
}

#[test]
fn scale_and_sign_of_the_matrix_do_not_matter() {
    let matrix = true_homography().matrix();
    let other = Homography::new(-7.0 * matrix).unwrap();
    assert!((other.matrix() - matrix).norm() < 1e-15);
    for broken in [Matrix3::zeros(), matrix * f64::NAN, Matrix3::repeat(1.0)] {
        assert!(Homography::new(broken).is_err());
    }
}

#[test]
fn recovers_the_camera_position() {
    let homography = fit(&corners()).unwrap().homography;
    let center_m = camera_center_m(&homography, [560.0; 2], [319.5, 239.5]).unwrap();
    for (found, expected) in center_m.into_iter().zip([0.0, -3.2, 3.0]) {
        assert!((found - expected).abs() < 1e-6, "{center_m:?}");
    }
}

#[test]
fn rejects_intrinsics_that_do_not_fit() {
    let homography = fit(&corners()).unwrap().homography;
    let error_of = |f_px, center_px| {
        let error = camera_center_m(&homography, f_px, center_px).unwrap_err();
        error.to_string()
    };
    assert!(error_of([1400.0; 2], [319.5, 239.5]).contains("the intrinsics do not fit"));
    assert!(error_of([200.0; 2], [319.5, 239.5]).contains("the intrinsics do not fit"));
    for f_px in [[0.0, 560.0], [1e300; 2], [f64::NAN, 560.0]] {
        let message = error_of(f_px, [319.5, 239.5]);
        assert!(
            message.contains("allowed: focal lengths from 0.001"),
            "{message}"
        );
    }
}
