//! Effect of noise in the corners of a plane's rectangle on positions on the plane: the table of
//! experiments/plane.

use pardalis_calibrate::plane::{PointPair, fit};
use pardalis_core::rng::{Draws, Stage};

/// Outer corners of plane-robot's tape: pixels and positions in metres (data/plane-robot/rectangle.json).
const CORNERS: [PointPair; 4] = [
    corner([184.3446, 327.5206], [-0.845_247, -0.267_930]),
    corner([448.7292, 304.7143], [1.149_881, -0.128_417]),
    corner([402.4226, 198.8209], [1.045_247, 1.367_930]),
    corner([195.5667, 212.6953], [-0.949_881, 1.228_417]),
];

/// Positions on the plane within the robot's range: inside the rectangle, at its edge, and the farthest
/// outside.
const POSITIONS_M: [[f64; 2]; 4] = [[0.1, 0.5], [-0.9, 1.2], [-1.45, -0.35], [-1.43, 1.53]];

const fn corner(pixel: [f64; 2], plane_m: [f64; 2]) -> PointPair {
    PointPair { pixel, plane_m }
}

/// Returns the mean error at each position in metres, with independent normal noise of this standard
/// deviation on every coordinate of the corners.
fn mean_errors_m(sigma_px: f64) -> [f64; 4] {
    let truth = fit(&CORNERS).unwrap().homography;
    let draws = Draws::new(1, 0);
    let count = 500;
    let mut sums_m = [0.0; 4];
    for trial in 0..count {
        let mut corners = CORNERS;
        for (i, corner) in corners.iter_mut().enumerate() {
            let [du, dv, ..] = draws.normals(i as u32, trial, Stage::Still, 0);
            corner.pixel[0] += sigma_px * f64::from(du);
            corner.pixel[1] += sigma_px * f64::from(dv);
        }
        let noisy = fit(&corners).unwrap().homography;
        for (sum_m, position_m) in sums_m.iter_mut().zip(POSITIONS_M) {
            let found_m = noisy.plane_of(truth.pixel_of(position_m).unwrap()).unwrap();
            *sum_m += libm::hypot(found_m[0] - position_m[0], found_m[1] - position_m[1]);
        }
    }
    sums_m.map(|sum_m| sum_m / f64::from(count))
}

#[test]
fn errors_grow_with_corner_noise_and_outside_the_rectangle() {
    println!("sigma (px)  inside  edge  outside  farther, mean error in mm");
    let mut before = mean_errors_m(0.0);
    assert!(before.iter().all(|&error_m| error_m < 1e-9), "{before:?}");
    for sigma_px in [0.25, 0.5, 1.0, 2.0] {
        let errors_m = mean_errors_m(sigma_px);
        println!(
            "{sigma_px:>10}  {:.1?}",
            errors_m.map(|error_m| 1e3 * error_m)
        );
        // A pixel covers about 10 mm here.
        let share = errors_m[0] / (0.01 * sigma_px);
        assert!((0.3..1.2).contains(&share), "{sigma_px} px: {errors_m:?}");
        assert!(errors_m[2] > 1.5 * errors_m[0], "outside: {errors_m:?}");
        assert!(
            errors_m
                .iter()
                .zip(before)
                .all(|(now, before)| *now > before)
        );
        before = errors_m;
    }
}
