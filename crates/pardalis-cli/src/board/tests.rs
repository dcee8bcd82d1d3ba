//! Boards in images whose corners are known, and in images in which there is none.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use pardalis_images::GrayImage;

use super::*;
use crate::source::decode::decode_mask;

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
    decode_mask(path).unwrap()
}

fn board(argument: &str) -> Board {
    Board::from_argument(argument).unwrap()
}

fn distance(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

/// Median and largest distance of the corners from the truth, by their numbers.
fn errors_px(corners: &[Corner], truth: &BTreeMap<usize, [f64; 2]>) -> (f64, f64) {
    let mut errors: Vec<f64> = corners
        .iter()
        .filter_map(|corner| Some(distance(corner.pixel, *truth.get(&corner.id)?)))
        .collect();
    errors.sort_by(f64::total_cmp);
    (errors[errors.len() / 2], errors[errors.len() - 1])
}

/// The true corners of a rendered checkerboard image, by number, and their places on the board.
fn dioptric_truth(n: usize) -> (BTreeMap<usize, [f64; 2]>, Vec<[f64; 3]>) {
    let text = std::fs::read_to_string(data(&format!("dioptric/board_{n}.json"))).unwrap();
    let value: serde_json::Value = serde_json::from_str(&text).unwrap();
    let pixels: Vec<[f64; 2]> = serde_json::from_value(value["corners_px"].clone()).unwrap();
    let places = serde_json::from_value(value["corners_board_m"].clone()).unwrap();
    (pixels.into_iter().enumerate().collect(), places)
}

/// A printed board: how much of each pixel is black, and not white again. Reads the document's rectangles as `print` writes them.
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

/// The image blurred with a Gaussian.
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

fn turned_by_half(image: &GrayImage) -> GrayImage {
    let (width, height) = image.dimensions();
    GrayImage::from_fn(width, height, |x, y| {
        image.get_pixel(width - 1 - x, height - 1 - y)
    })
}

#[test]
fn all_corners_of_the_fisheye_boards_are_found_where_they_are() {
    for n in 0..6 {
        let image = grey(&data(&format!("dioptric/board_{n}.jpg")));
        let corners = detect(&board("checkerboard:9x6:0.06"), &image).unwrap();
        let (truth, places) = dioptric_truth(n);
        assert_eq!(corners.len(), 54, "board {n}");
        for (number, corner) in corners.iter().enumerate() {
            assert_eq!(corner.id, number);
            for axis in 0..3 {
                assert!((corner.board_m[axis] - places[number][axis]).abs() < 1e-9);
            }
        }
        let (median, most) = errors_px(&corners, &truth);
        println!("board {n}: median {median:.3} px, at most {most:.3} px");
        assert!(median <= 0.1 && most <= 0.25, "board {n}: {median} {most}");
    }
}

#[test]
fn printed_boards_are_found_whole_and_upright() {
    for argument in [
        "checkerboard:9x6:0.025",
        "checkerboard:6x9:0.03",
        "charuco:5x7:0.04:0.03:DICT_4X4_50",
        "charuco:6x8:0.03:0.0225:DICT_5X5_100",
        "aprilgrid:6x6:0.03:0.3",
    ] {
        let board = board(argument);
        // Corners on the borders between pixels, all alike; and blurred as cameras blur, anywhere.
        let drawn = |px_per_m: f64| printed(&board.svg(), px_per_m / 1000.0);
        let corners =
            detect(&board, &drawn(4000.0)).unwrap_or_else(|why| panic!("{argument}: {why}"));
        assert_eq!(corners.len(), board.corner_count(), "{argument}");
        let px_per_m = 3910.0;
        let image = blurred(&drawn(px_per_m), 0.8);
        let corners = detect(&board, &image).unwrap_or_else(|why| panic!("{argument}: {why}"));
        assert_eq!(corners.len(), board.corner_count(), "{argument}");
        let origin = corners[0];
        for corner in &corners {
            for (axis, up) in [(0, 1.0), (1, -1.0)] {
                let printed_px = up * (corner.pixel[axis] - origin.pixel[axis]);
                let expected_px = px_per_m * (corner.board_m[axis] - origin.board_m[axis]);
                let error_px = (printed_px - expected_px).abs();
                // Both corners may be an eighth of a pixel off.
                assert!(
                    error_px < 0.25,
                    "{argument}, corner {}: {error_px}",
                    corner.id
                );
            }
        }
    }
}

#[test]
fn both_cameras_of_all_real_pairs_see_the_whole_board_with_the_same_origin() {
    for n in (1..=9).chain(11..=14) {
        let [left, right] = ["left", "right"].map(|side| {
            let image = grey(&data(&format!("opencv-stereo/{side}{n:02}.jpg")));
            let corners = detect(&board("checkerboard:9x6:0.025"), &image).unwrap();
            assert_eq!(corners.len(), 54, "{side}{n:02}");
            corners
        });
        for corners in [&left, &right] {
            // x right and y up, never mirrored: the cross product is negative where the image's y points down.
            let [a, b, c] = [0, 8, 45].map(|id: usize| corners[id].pixel);
            assert!((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]) < 0.0);
        }
        // The cameras stand side by side, so that the board is turned nearly alike in both images.
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
fn a_board_seen_upside_down_keeps_its_numbers() {
    let image = grey(&data("dioptric/board_2.jpg"));
    let checkerboard = board("checkerboard:9x6:0.06");
    let upright = detect(&checkerboard, &image).unwrap();
    let turned = detect(&checkerboard, &turned_by_half(&image)).unwrap();
    for (a, b) in upright.iter().zip(&turned) {
        let back = [
            f64::from(image.width() - 1) - b.pixel[0],
            f64::from(image.height() - 1) - b.pixel[1],
        ];
        assert!(distance(a.pixel, back) < 0.05, "corner {}", a.id);
    }
}

#[test]
fn large_images_are_measured_in_their_own_pixels() {
    let image = grey(&data("dioptric/board_3.jpg"));
    let large = image.resized(2560, 1920);
    let corners = detect(&board("checkerboard:9x6:0.06"), &large).unwrap();
    let truth = dioptric_truth(3).0.into_iter();
    let truth = truth.map(|(id, pixel)| (id, pixel.map(|n| (n + 0.5) * 4.0 - 0.5)));
    let (median, most) = errors_px(&corners, &truth.collect());
    assert_eq!(corners.len(), 54);
    assert!(median <= 0.5 && most <= 1.0, "{median} {most}");
}

/// Finds a drawn board: all corners must be there of which a whole square is in view, within 0.3 px.
fn find_drawn(argument: &str, name: &str, columns: usize) {
    let board = board(argument);
    let corners = detect(&board, &grey(&drawn(&format!("{name}.jpg")))).unwrap();
    let mut reader = csv::Reader::from_path(drawn(&format!("{name}.csv"))).unwrap();
    let mut truth = BTreeMap::new();
    let mut places = BTreeMap::new();
    for row in reader.deserialize() {
        let (id, x, y, z, u, v): (usize, f64, f64, f64, f64, f64) = row.unwrap();
        truth.insert(id, [u, v]);
        places.insert(id, [x, y, z]);
    }
    for corner in &corners {
        if let Some(place) = places.get(&corner.id) {
            for axis in 0..3 {
                assert!((corner.board_m[axis] - place[axis]).abs() < 1e-6, "{name}");
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
fn charuco_boards_are_found_whole_and_cut() {
    for name in ["charuco_whole", "charuco_turned", "charuco_cut"] {
        find_drawn("charuco:5x7:0.04:0.03:DICT_4X4_50", name, 4);
    }
}

#[test]
fn charuco_boards_of_the_old_pattern_are_found() {
    find_drawn(
        "charuco:8x6:0.03:0.022:DICT_5X5_100",
        "charuco_old_pattern",
        7,
    );
}

#[test]
fn aprilgrids_are_found_whole_and_cut() {
    find_drawn("aprilgrid:6x6:0.04:0.3", "aprilgrid_whole", 12);
    find_drawn("aprilgrid:6x6:0.04:0.3", "aprilgrid_turned", 12);
    find_drawn("aprilgrid:4x3:0.06:0.25", "aprilgrid_cut", 8);
}

#[test]
fn what_is_no_board_gets_a_reason() {
    let boards = [
        "checkerboard:9x6:0.06",
        "charuco:5x7:0.04:0.03:DICT_4X4_50",
        "aprilgrid:6x6:0.04:0.3",
    ];
    // A generator of Lehmer's, for noise that is the same each time.
    let mut state = 1u64;
    let noise = GrayImage::from_fn(320, 240, |_, _| {
        state = state * 48271 % 0x7fff_ffff;
        [(state >> 16) as u8]
    });
    let upright = grey(&drawn("charuco_whole.jpg"));
    let mirrored = GrayImage::from_fn(upright.width(), upright.height(), |x, y| {
        upright.get_pixel(upright.width() - 1 - x, y)
    });
    for argument in boards {
        for size in [(0, 0), (1, 1), (1, 900), (63, 64), (64, 64), (70, 2000)] {
            let blank = GrayImage::from_pixel(size.0, size.1, [128]);
            let reason = detect(&board(argument), &blank).unwrap_err();
            assert!(!reason.is_empty(), "{argument}");
        }
        assert!(detect(&board(argument), &noise).is_err(), "{argument}");
        assert!(detect(&board(argument), &mirrored).is_err(), "{argument}");
    }
}

#[test]
fn a_checkerboard_cut_at_the_border_says_how_much_is_in_view() {
    let image = grey(&data("opencv-stereo/left01.jpg"));
    let checkerboard = board("checkerboard:9x6:0.025");
    let whole = detect(&checkerboard, &image).unwrap();
    let middle = whole.iter().map(|corner| corner.pixel[0]).sum::<f64>() / 54.0;
    let cut = image.crop(0, 0, middle as u32, image.height());
    let reason = detect(&checkerboard, &cut).unwrap_err();
    assert!(reason.contains("the whole board of 9 x 6"), "{reason}");
    let smaller = detect(&board("checkerboard:8x6:0.025"), &image).unwrap_err();
    assert!(smaller.contains("count the corners"), "{smaller}");
    let other = detect(&board("charuco:5x7:0.04:0.03:DICT_4X4_50"), &image).unwrap_err();
    assert!(other.contains("none of the board's markers"), "{other}");
}

#[test]
fn boards_are_read_from_words_and_files() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| {
        let path = folder.path().join(name);
        std::fs::write(&path, text).unwrap();
        path.to_str().unwrap().to_owned()
    };
    let checkerboard = write(
        "a.toml",
        "[checkerboard]\ncolumns = 9\nrows = 6\nsquare_m = 0.06\n",
    );
    assert_eq!(board(&checkerboard), board("checkerboard:9x6:0.06"));
    let charuco = "[charuco]\ncolumns = 5\nrows = 7\nsquare_m = 0.04\nmarker_m = 0.03\ndictionary = \"DICT_4X4_50\"\n";
    let charuco = board(&write("b.toml", charuco));
    assert_eq!(charuco, board("charuco:5x7:0.04:0.03:DICT_4X4_50"));
    let grid = "[aprilgrid]\ncolumns = 6\nrows = 6\ntag_m = 0.088\nspacing = 0.3\n";
    assert_eq!(
        board(&write("c.toml", grid)),
        board("aprilgrid:6x6:0.088:0.3")
    );
    let kalibr = "target_type: 'aprilgrid' #gridtype\ntagCols: 6 #tags\ntagRows: 6\ntagSize: 0.088\ntagSpacing: 0.3\n";
    assert_eq!(
        board(&write("d.yaml", kalibr)),
        board("aprilgrid:6x6:0.088:0.3")
    );
    let kalibr = "target_type: 'checkerboard'\ntargetCols: 6\ntargetRows: 7\nrowSpacingMeters: 0.06\ncolSpacingMeters: 0.06\n";
    assert_eq!(
        board(&write("e.yaml", kalibr)),
        board("checkerboard:6x7:0.06")
    );

    for (text, named) in [
        ("checkerboard:9x6", "checkerboard:9x6:0.06"),
        ("checkerboard:2x6:0.06", "columns is 2"),
        ("checkerboard:9x6:nan", "square_m is NaN"),
        ("charuco:5x7:0.04:0.04:DICT_4X4_50", "marker_m is 0.04"),
        ("charuco:5x7:0.04:0.03:DICT_3X3_5", "DICT_4X4_50"),
        ("charuco:50x7:0.04:0.03:DICT_4X4_50", "a larger dictionary"),
        ("aprilgrid:6x6:0.088:30", "spacing is 30"),
        ("missing.toml", "missing.toml"),
        (
            write(
                "f.toml",
                "[checkerboard]\ncolumns = 9\nrows = 6\nsquare = 1\n",
            )
            .as_str(),
            "square",
        ),
        (
            write("g.yaml", "target_type: 'circlegrid'\n").as_str(),
            "g.yaml",
        ),
        (
            write(
                "h.yaml",
                kalibr
                    .replace("colSpacingMeters: 0.06", "colSpacingMeters: 0.05")
                    .as_str(),
            )
            .as_str(),
            "both the same",
        ),
    ] {
        let error = Board::from_argument(text).unwrap_err();
        assert!(error.is::<crate::user_error::UserError>(), "{text}");
        let message = format!("{error:#}");
        assert!(
            message.contains(named) && message.contains(text),
            "{text}: {message}"
        );
    }
}

#[test]
fn only_colours_tell_which_way_a_checkerboard_is_up() {
    assert!(board("checkerboard:9x6:0.06").has_unique_origin());
    assert!(!board("checkerboard:8x6:0.06").has_unique_origin());
    assert!(board("aprilgrid:6x6:0.088:0.3").has_unique_origin());
}

#[test]
fn a_crossing_is_fitted_to_hundredths_of_a_pixel() {
    let (place, first, second, width) = ([20.37, 18.81], 0.3_f64, 2.0_f64, 1.3);
    let image = GrayImage::from_fn(40, 40, |x, y| {
        let (dx, dy) = (f64::from(x) - place[0], f64::from(y) - place[1]);
        let side = |angle: f64| ((angle.cos() * dy - angle.sin() * dx) / width).tanh();
        [(120.0 + 80.0 * side(first) * side(second)).round() as u8]
    });
    let start = saddle::Saddle {
        pixel: [21.0, 18.0],
        directions_rad: [
            0.4,
            1.9,
            0.4 + std::f64::consts::PI,
            1.9 + std::f64::consts::PI,
        ],
    };
    let fitted = saddle::refine(&image, start, 8.0).unwrap();
    assert!(distance(fitted.pixel, place) < 0.005, "{:?}", fitted.pixel);
    assert!((fitted.directions_rad[0] - first).abs() < 0.002);
}
