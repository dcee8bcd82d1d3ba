//! Detection of boards in images with known corners, and in images without boards.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use pardalis_calibrate::board::{Board, BoardNotFound, Corner, detect};
use pardalis_core::Error;
use pardalis_images::{GrayImage, decode_grey};

fn data(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../../data/calibration")
        .join(name)
}

fn drawn(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("tests/boards")
        .join(name)
}

fn grey(path: &Path) -> GrayImage {
    decode_grey(&std::fs::read(path).unwrap()).unwrap()
}

fn checkerboard(columns: usize, rows: usize, square_m: f64) -> Board {
    Board::checkerboard(columns, rows, square_m).unwrap()
}

fn charuco(columns: usize, rows: usize, square_m: f64, marker_m: f64, dictionary: &str) -> Board {
    Board::charuco(columns, rows, square_m, marker_m, dictionary).unwrap()
}

fn april_grid(columns: usize, rows: usize, tag_m: f64, spacing: f64) -> Board {
    Board::april_grid(columns, rows, tag_m, spacing).unwrap()
}

fn distance(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

/// Returns the median and the largest distance of the corners from their true positions.
fn errors_px(corners: &[Corner], truth: &BTreeMap<usize, [f64; 2]>) -> (f64, f64) {
    let mut errors: Vec<f64> = corners
        .iter()
        .filter_map(|corner| Some(distance(corner.pixel, *truth.get(&corner.id)?)))
        .collect();
    errors.sort_by(f64::total_cmp);
    (errors[errors.len() / 2], errors[errors.len() - 1])
}

/// Returns the true corners of a rendered checkerboard image by number, and their positions on the board in metres.
fn dioptric_truth(n: usize) -> (BTreeMap<usize, [f64; 2]>, Vec<[f64; 3]>) {
    let text = std::fs::read_to_string(data(&format!("dioptric/board_{n}.json"))).unwrap();
    let value: serde_json::Value = serde_json::from_str(&text).unwrap();
    let pixels: Vec<[f64; 2]> = serde_json::from_value(value["corners_px"].clone()).unwrap();
    let positions_m = serde_json::from_value(value["corners_board_m"].clone()).unwrap();
    (pixels.into_iter().enumerate().collect(), positions_m)
}

/// Rasterises a printed board from the rectangles of its SVG document, with anti-aliasing.
fn printed(document: &str, px_per_mm: f64) -> GrayImage {
    let numbers = |text: &str| -> Vec<f64> {
        let split = text.split(|c: char| !c.is_ascii_digit() && c != '.' && c != '-');
        split.filter_map(|n| n.parse().ok()).collect()
    };
    let attribute = |from: &str, name: &str| {
        let (_, rest) = document.split_once(from).unwrap();
        let (_, rest) = rest.split_once(&format!("{name}=\"")).unwrap();
        rest.split_once('"').unwrap().0.to_owned()
    };
    let page = numbers(&attribute("<svg", "viewBox"));
    let [width, height] = [page[2], page[3]].map(|side| (side * px_per_mm).ceil() as usize);
    let cover = |color: &str| {
        let mut shares = vec![0.0_f64; width * height];
        for rectangle in attribute(&format!("<path fill=\"{color}\""), "d").split('z') {
            let [x, y, w, h, back] = numbers(rectangle)[..] else {
                assert_eq!(rectangle, "");
                continue;
            };
            assert_eq!(back, -w);
            let range = |from: f64, length: f64, origin: f64| {
                [from - origin, from + length - origin].map(|mm| mm * px_per_mm)
            };
            let ([left, right], [top, bottom]) = (range(x, w, page[0]), range(y, h, page[1]));
            let share = |i: usize, [low, high]: [f64; 2]| {
                (high.min(i as f64 + 1.0) - low.max(i as f64)).max(0.0)
            };
            for row in top as usize..(bottom.ceil() as usize).min(height) {
                for column in left as usize..(right.ceil() as usize).min(width) {
                    shares[row * width + column] +=
                        share(row, [top, bottom]) * share(column, [left, right]);
                }
            }
        }
        shares
    };
    let levels = cover("black").into_iter().zip(cover("white"));
    let levels = levels.map(|(black, white)| {
        (255.0 * (1.0 - black.min(1.0) * (1.0 - white.min(1.0)))).round() as u8
    });
    GrayImage::from_raw(width as u32, height as u32, levels.collect()).unwrap()
}

/// Blurs an image with a Gaussian.
fn blurred(image: &GrayImage, sigma_px: f64) -> GrayImage {
    let weights = (-3..=3).map(|i: i32| (-0.5 * (f64::from(i) / sigma_px).powi(2)).exp());
    let weights: Vec<f64> = weights.collect();
    let sum: f64 = weights.iter().sum();
    let near = |at: u32, i: usize, size: u32| (at + i as u32).saturating_sub(3).min(size - 1);
    let mean = |level: &dyn Fn(usize) -> u8| {
        let terms = weights.iter().enumerate();
        let total: f64 = terms.map(|(i, w)| w * f64::from(level(i))).sum();
        [(total / sum).round() as u8]
    };
    let (width, height) = image.dimensions();
    let rows = GrayImage::from_fn(width, height, |x, y| {
        mean(&|i| image.get_pixel(near(x, i, width), y)[0])
    });
    GrayImage::from_fn(width, height, |x, y| {
        mean(&|i| rows.get_pixel(x, near(y, i, height))[0])
    })
}

/// Rotates an image by 180 degrees.
fn upside_down(image: &GrayImage) -> GrayImage {
    let (width, height) = image.dimensions();
    GrayImage::from_fn(width, height, |x, y| {
        image.get_pixel(width - 1 - x, height - 1 - y)
    })
}

#[test]
fn locates_all_corners_in_fisheye_images() {
    for n in 0..6 {
        let image = grey(&data(&format!("dioptric/board_{n}.jpg")));
        let corners = detect(&checkerboard(9, 6, 0.06), &image).unwrap();
        let (truth, positions_m) = dioptric_truth(n);
        assert_eq!(corners.len(), 54, "board {n}");
        for (number, corner) in corners.iter().enumerate() {
            assert_eq!(corner.id, number);
            for axis in 0..3 {
                assert!((corner.board_m[axis] - positions_m[number][axis]).abs() < 1e-9);
            }
        }
        let (median, most) = errors_px(&corners, &truth);
        println!("board {n}: median {median:.3} px, at most {most:.3} px");
        assert!(median <= 0.1 && most <= 0.25, "board {n}: {median} {most}");
    }
}

#[test]
fn detects_printed_boards_completely_and_upright() {
    for board in [
        checkerboard(9, 6, 0.025),
        checkerboard(6, 9, 0.03),
        charuco(5, 7, 0.04, 0.03, "DICT_4X4_50"),
        charuco(6, 8, 0.03, 0.0225, "DICT_5X5_100"),
        april_grid(6, 6, 0.03, 0.3),
    ] {
        let kind = board.kind();
        // First sharp corners on the borders between pixels, then blurred ones at any position.
        let drawn = |px_per_m: f64| printed(&board.to_svg(), px_per_m / 1000.0);
        let corners =
            detect(&board, &drawn(4000.0)).unwrap_or_else(|why| panic!("{kind:?}: {why}"));
        assert_eq!(corners.len(), board.corner_count(), "{kind:?}");
        let px_per_m = 3910.0;
        let image = blurred(&drawn(px_per_m), 0.8);
        let corners = detect(&board, &image).unwrap_or_else(|why| panic!("{kind:?}: {why}"));
        assert_eq!(corners.len(), board.corner_count(), "{kind:?}");
        let origin = corners[0];
        for corner in &corners {
            for (axis, up) in [(0, 1.0), (1, -1.0)] {
                let printed_px = up * (corner.pixel[axis] - origin.pixel[axis]);
                let expected_px = px_per_m * (corner.board_m[axis] - origin.board_m[axis]);
                let error_px = (printed_px - expected_px).abs();
                // Each of both corners may be off by an eighth of a pixel.
                assert!(
                    error_px < 0.25,
                    "{kind:?}, corner {}: {error_px}",
                    corner.id
                );
            }
        }
    }
}

#[test]
fn numbers_corners_consistently_in_real_stereo_pairs() {
    for n in (1..=9).chain(11..=14) {
        let [left, right] = ["left", "right"].map(|side| {
            let image = grey(&data(&format!("opencv-stereo/{side}{n:02}.jpg")));
            let corners = detect(&checkerboard(9, 6, 0.025), &image).unwrap();
            assert_eq!(corners.len(), 54, "{side}{n:02}");
            corners
        });
        for corners in [&left, &right] {
            // x right and y up, never mirrored: the cross product is negative because the image's y points down.
            let [a, b, c] = [0, 8, 45].map(|id: usize| corners[id].pixel);
            assert!((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]) < 0.0);
        }
        // The cameras are side by side, so that the board has nearly the same orientation in both images.
        let along = |corners: &[Corner]| {
            let [a, b] = [corners[0].pixel, corners[8].pixel];
            [
                (b[0] - a[0]) / distance(a, b),
                (b[1] - a[1]) / distance(a, b),
            ]
        };
        let ([a, b], [c, d]) = (along(&left), along(&right));
        assert!(
            a * c + b * d > 0.9,
            "pair {n}: {:?} {:?}",
            along(&left),
            along(&right)
        );
    }
}

#[test]
fn keeps_the_numbers_of_an_upside_down_board() {
    let image = grey(&data("dioptric/board_2.jpg"));
    let board = checkerboard(9, 6, 0.06);
    let upright = detect(&board, &image).unwrap();
    let turned = detect(&board, &upside_down(&image)).unwrap();
    for (a, b) in upright.iter().zip(&turned) {
        let back = [
            f64::from(image.width() - 1) - b.pixel[0],
            f64::from(image.height() - 1) - b.pixel[1],
        ];
        assert!(distance(a.pixel, back) < 0.05, "corner {}", a.id);
    }
}

#[test]
fn locates_corners_of_large_images_at_full_size() {
    let image = grey(&data("dioptric/board_3.jpg"));
    let large = image.resized(2560, 1920);
    let corners = detect(&checkerboard(9, 6, 0.06), &large).unwrap();
    let truth = dioptric_truth(3).0.into_iter();
    let truth = truth.map(|(id, pixel)| (id, pixel.map(|n| (n + 0.5) * 4.0 - 0.5)));
    let (median, most) = errors_px(&corners, &truth.collect());
    assert_eq!(corners.len(), 54);
    assert!(median <= 0.5 && most <= 1.0, "{median} {most}");
}

/// Detects a rendered board with `columns` corners in a row. All corners with a completely visible square must be found,
/// within 0.3 px.
fn check_rendered(board: &Board, name: &str, columns: usize) {
    let corners = detect(board, &grey(&drawn(&format!("{name}.jpg")))).unwrap();
    let table = std::fs::read_to_string(drawn(&format!("{name}.csv"))).unwrap();
    let mut truth = BTreeMap::new();
    let mut positions_m = BTreeMap::new();
    for row in table.lines().skip(1) {
        let numbers: Vec<f64> = row.split(',').map(|n| n.parse().unwrap()).collect();
        let [id, x, y, z, u, v] = numbers[..] else {
            panic!("{name}: {row}");
        };
        truth.insert(id as usize, [u, v]);
        positions_m.insert(id as usize, [x, y, z]);
    }
    for corner in &corners {
        if let Some(position_m) = positions_m.get(&corner.id) {
            for axis in 0..3 {
                assert!(
                    (corner.board_m[axis] - position_m[axis]).abs() < 1e-6,
                    "{name}"
                );
            }
        }
    }
    for id in truth.keys() {
        let (row, column) = ((id / columns) as i32, (id % columns) as i32);
        let in_view = |row: i32, column: i32| {
            row >= 0
                && (0..columns as i32).contains(&column)
                && truth.contains_key(&((row * columns as i32 + column) as usize))
        };
        let in_a_square = [(1, 1), (1, -1), (-1, 1), (-1, -1)]
            .iter()
            .any(|&(down, right)| {
                in_view(row + down, column)
                    && in_view(row, column + right)
                    && in_view(row + down, column + right)
            });
        let found = corners.iter().any(|corner| corner.id == *id);
        assert!(found || !in_a_square, "{name}: corner {id} is missing");
    }
    let (median, most) = errors_px(&corners, &truth);
    println!(
        "{name}: {} corners, median {median:.3} px, at most {most:.3} px",
        corners.len()
    );
    assert!(most <= 0.3, "{name}: {most}");
}

#[test]
fn detects_complete_and_cut_charuco_boards() {
    for name in ["charuco_whole", "charuco_turned", "charuco_cut"] {
        check_rendered(&charuco(5, 7, 0.04, 0.03, "DICT_4X4_50"), name, 4);
    }
}

#[test]
fn detects_charuco_boards_of_the_old_pattern() {
    check_rendered(
        &charuco(8, 6, 0.03, 0.022, "DICT_5X5_100"),
        "charuco_old_pattern",
        7,
    );
}

#[test]
fn detects_complete_and_cut_april_grids() {
    check_rendered(&april_grid(6, 6, 0.04, 0.3), "aprilgrid_whole", 12);
    check_rendered(&april_grid(6, 6, 0.04, 0.3), "aprilgrid_turned", 12);
    check_rendered(&april_grid(4, 3, 0.06, 0.25), "aprilgrid_cut", 8);
}

#[test]
fn images_without_a_board_are_rejected() {
    let boards = [
        checkerboard(9, 6, 0.06),
        charuco(5, 7, 0.04, 0.03, "DICT_4X4_50"),
        april_grid(6, 6, 0.04, 0.3),
    ];
    // Reproducible noise from a Lehmer generator.
    let mut state = 1u64;
    let noise = GrayImage::from_fn(320, 240, |_, _| {
        state = state * 48271 % 0x7fff_ffff;
        [(state >> 16) as u8]
    });
    let upright = grey(&drawn("charuco_whole.jpg"));
    let mirrored = GrayImage::from_fn(upright.width(), upright.height(), |x, y| {
        upright.get_pixel(upright.width() - 1 - x, y)
    });
    for board in &boards {
        let kind = board.kind();
        for (width, height) in [(0, 0), (1, 1), (1, 900), (63, 64)] {
            let blank = GrayImage::from_pixel(width, height, [128]);
            let expected = BoardNotFound::ImageTooSmall { width, height };
            assert_eq!(detect(board, &blank), Err(expected), "{kind:?}");
        }
        for (width, height) in [(64, 64), (70, 2000)] {
            let blank = GrayImage::from_pixel(width, height, [128]);
            let expected = Err(BoardNotFound::NotInView);
            assert_eq!(detect(board, &blank), expected, "{kind:?}");
        }
        assert!(detect(board, &noise).is_err(), "{kind:?}");
        assert!(detect(board, &mirrored).is_err(), "{kind:?}");
    }
}

#[test]
fn incomplete_and_ambiguous_boards_are_reported() {
    let image = grey(&data("opencv-stereo/left01.jpg"));
    let board = checkerboard(9, 6, 0.025);
    let whole = detect(&board, &image).unwrap();
    let middle = whole.iter().map(|corner| corner.pixel[0]).sum::<f64>() / 54.0;
    let cut = image.crop(0, 0, middle as u32, image.height());
    let BoardNotFound::Incomplete {
        columns,
        rows,
        found,
    } = detect(&board, &cut).unwrap_err()
    else {
        panic!("the cut board was not reported as incomplete");
    };
    assert_eq!((columns, rows), (9, 6));
    assert!((12..54).contains(&found), "{found}");
    let smaller = detect(&checkerboard(8, 6, 0.025), &image);
    let expected = BoardNotFound::Ambiguous {
        columns: 8,
        rows: 6,
    };
    assert_eq!(smaller, Err(expected));
    let other = detect(&charuco(5, 7, 0.04, 0.03, "DICT_4X4_50"), &image).unwrap_err();
    assert!(
        matches!(other, BoardNotFound::NoMarkers { .. }),
        "{other:?}"
    );
}

#[test]
fn rejects_invalid_dimensions() {
    for (board, name) in [
        (Board::checkerboard(2, 6, 0.06), "columns"),
        (Board::checkerboard(9, 201, 0.06), "rows"),
        (Board::checkerboard(9, 6, f64::NAN), "square_m"),
        (Board::charuco(5, 7, 0.04, 0.04, "DICT_4X4_50"), "marker_m"),
        (Board::charuco(5, 7, 0.04, 0.03, "DICT_3X3_5"), "dictionary"),
        (Board::april_grid(6, 6, 0.0, 0.3), "tag_m"),
        (Board::april_grid(6, 6, 0.088, 1.5), "spacing"),
    ] {
        match board {
            Err(Error::OutOfRange { name: found, .. }) => assert_eq!(found, name),
            other => panic!("{name}: {other:?}"),
        }
    }
    // 588 tags, but the family has 587.
    let tags = Board::april_grid(42, 14, 0.088, 0.3);
    assert!(matches!(tags, Err(Error::Refused { .. })), "{tags:?}");
    assert!(Board::april_grid(1, 1, 0.088, 1.0).is_ok());
}

#[test]
fn only_odd_checkerboards_have_a_unique_origin() {
    assert!(checkerboard(9, 6, 0.06).has_unique_origin());
    assert!(!checkerboard(8, 6, 0.06).has_unique_origin());
    assert!(april_grid(6, 6, 0.088, 0.3).has_unique_origin());
}
