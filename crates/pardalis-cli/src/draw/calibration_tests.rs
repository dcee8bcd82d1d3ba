//! Tests of the pictures of a calibration; they are left in `draw-tests/calibration` beside the test program.

use super::*;
use crate::draw::svg::write_svg_and_png;
use crate::draw::test_folder;

/// Points on a spiral, one of them left out of the fit and one without a projection.
fn points() -> Vec<ObservedPoint> {
    (0..60)
        .map(|i| {
            let (sin, cos) = (0.7 * f64::from(i)).sin_cos();
            let radius_px = 3.5 * f64::from(i);
            ObservedPoint {
                observed: [320.0 + radius_px * cos, 240.0 + radius_px * sin],
                residual_px: (i != 7).then_some(if i == 9 {
                    [30.0, -20.0]
                } else {
                    [0.3 * sin, 0.2 * cos]
                }),
                outlier: i == 9 || i == 7,
            }
        })
        .collect()
}

#[test]
fn pictures_are_drawn() {
    let folder = test_folder("calibration");
    let (size, points) = ((640, 480), points());
    for (name, document) in [
        ("points", observed_and_projected(size, &points)),
        ("arrows", residual_arrows(size, &points)),
        ("scatter", residual_scatter(&points, 0.3)),
        ("coverage", coverage(size, &points)),
        (
            "views",
            rms_bars(&[("board_0.jpg", 0.2), ("board_1.jpg", 0.35)], 0.3),
        ),
    ] {
        write_svg_and_png(&folder, name, &document.unwrap()).unwrap();
    }
}

#[test]
fn pictures_accept_any_numbers() {
    for number in [0.0, 1e300, -1e300] {
        let wild = [ObservedPoint {
            observed: [number; 2],
            residual_px: Some([number; 2]),
            outlier: false,
        }];
        for document in [
            observed_and_projected((1, 1), &wild),
            residual_arrows((1, 1), &wild),
            residual_scatter(&[], 0.0),
            coverage((1, 1), &wild),
            rms_bars(&[("<&>", number)], number.abs()),
        ] {
            roxmltree::Document::parse(&document.unwrap().svg).unwrap();
        }
    }
}

#[test]
fn cells_count_their_points() {
    let at = |observed| ObservedPoint {
        observed,
        residual_px: None,
        outlier: false,
    };
    let points = [
        at([-0.5, -0.5]),
        at([63.0, 47.0]),
        at([639.5, 479.5]),
        at([640.0, 3.0]),
    ];
    let counts = cell_counts((640, 480), &points);
    assert_eq!((counts[0][0], counts[9][9]), (2, 1));
    assert_eq!(counts.iter().flatten().sum::<usize>(), 3);
}

#[test]
fn many_residuals_are_averaged_in_cells() {
    let point = |u: f64, residual_px, outlier| ObservedPoint {
        observed: [u, 3.0],
        residual_px,
        outlier,
    };
    let points = [
        point(1.0, Some([0.4, 0.0]), false),
        point(5.0, Some([0.2, -0.6]), false),
        point(5.0, Some([9.0, 9.0]), true),
        point(4.0, None, false),
        point(600.0, Some([1.0, 1.0]), false),
    ];
    let means = mean_residuals((640, 480), &points);
    assert_eq!(means.len(), 2);
    assert_eq!(means[0].observed, [3.0, 3.0]);
    let [du, dv] = means[0].residual_px.unwrap();
    assert!(
        (du - 0.3).abs() < 1e-12 && (dv + 0.3).abs() < 1e-12,
        "{du} {dv}"
    );
}

#[test]
fn arrows_are_magnified_by_round_factors() {
    assert_eq!(
        [0.2, 1.0, 4.9, 70.0, 500.0].map(round_factor),
        [1.0, 1.0, 2.0, 50.0, 500.0]
    );
}
