//! Detection of rectangles in images with known corners, and in images without one.

use pardalis_calibrate::rectangle::{Edge, RectangleNotFound, detect};
use pardalis_images::RgbImage;

/// Corners of the outer edge in these images, counter-clockwise from the one nearest to the bottom left.
const OUTER_PX: [[f64; 2]; 4] = [[59.5, 199.5], [259.5, 199.5], [259.5, 49.5], [59.5, 49.5]];

/// Width of the tape.
const WIDTH_PX: u32 = 8;

/// Draws tape, or a patch, whose outer edge begins this far to the right of [`OUTER_PX`].
fn image(is_tape: bool, shift_px: u32, color: [u8; 3]) -> RgbImage {
    RgbImage::from_fn(320, 240, |u, v| {
        let is_inside = |inset_px: u32| {
            (60 + shift_px + inset_px..260 + shift_px - inset_px).contains(&u)
                && (50 + inset_px..200 - inset_px).contains(&v)
        };
        if is_inside(0) && !(is_tape && is_inside(WIDTH_PX)) {
            color
        } else {
            [90; 3]
        }
    })
}

fn largest_error_px(found: [[f64; 2]; 4], expected: [[f64; 2]; 4]) -> f64 {
    let errors = found
        .iter()
        .zip(expected)
        .map(|([u, v], [u2, v2])| (u - u2).hypot(v - v2));
    errors.fold(0.0, f64::max)
}

#[test]
fn locates_both_edges_of_tape() {
    let images = [image(true, 0, [200; 3]), image(true, 0, [200; 3])];
    let outer = detect(&images, Edge::Outer).unwrap();
    assert!(outer.is_tape && outer.is_bright, "{outer:?}");
    assert!(
        largest_error_px(outer.corners_px, OUTER_PX) < 0.1,
        "{outer:?}"
    );
    assert_eq!(outer.scatter_px, Some(0.0));
    let inner = detect(&images, Edge::Inner).unwrap();
    let inset = f64::from(WIDTH_PX);
    let [[left, bottom], [right, _], [_, top], _] = OUTER_PX;
    let (left, right) = (left + inset, right - inset);
    let (top, bottom) = (top + inset, bottom - inset);
    let expected = [[left, bottom], [right, bottom], [right, top], [left, top]];
    assert!(
        largest_error_px(inner.corners_px, expected) < 0.1,
        "{inner:?}"
    );
}

/// The patch has the same luma as the floor, so that only single channels show it.
#[test]
fn finds_patches_that_differ_in_color_only() {
    let patch = image(false, 0, [180, 52, 62]);
    let found = detect(&[patch], Edge::Outer).unwrap();
    assert!(!found.is_tape);
    assert_eq!(found.scatter_px, None);
    assert!(
        largest_error_px(found.corners_px, OUTER_PX) < 0.1,
        "{found:?}"
    );
}

#[test]
fn reports_why_there_is_no_rectangle() {
    assert_eq!(detect(&[], Edge::Outer), Err(RectangleNotFound::NotInView));
    for (width, height) in [(0, 0), (1, 1), (320, 240)] {
        let plain = RgbImage::from_pixel(width, height, [90; 3]);
        let expected = Err(RectangleNotFound::NotInView);
        assert_eq!(
            detect(&[plain], Edge::Outer),
            expected,
            "{width} x {height}"
        );
    }
    let sizes = [image(true, 0, [200; 3]), RgbImage::new(8, 8)];
    assert_eq!(
        detect(&sizes, Edge::Outer),
        Err(RectangleNotFound::SizesDiffer)
    );
    let moving = [0, 0, 2, 4, 4].map(|shift_px| image(false, shift_px, [200; 3]));
    let error = detect(&moving, Edge::Outer).unwrap_err();
    assert!(matches!(error, RectangleNotFound::Moving { .. }), "{error}");
    let two = RgbImage::from_fn(320, 240, |u, v| {
        let is_patch = (20..140).contains(&u) || (180..300).contains(&u);
        [if is_patch && (60..180).contains(&v) {
            200
        } else {
            90
        }; 3]
    });
    let error = detect(&[two], Edge::Outer).unwrap_err();
    assert!(
        matches!(error, RectangleNotFound::Ambiguous { .. }),
        "{error}"
    );
}
