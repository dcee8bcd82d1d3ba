use super::*;
use crate::draw::picture::{picture_of, write_picture};
use crate::draw::test_folder;
use crate::source::decode::decode_image;

fn grey(width: u32, height: u32) -> RgbImage {
    RgbImage::from_pixel(width, height, [100; 3])
}

fn circle(centre_px: [f64; 2], radius_px: f64) -> Vec<Option<[f64; 2]>> {
    let point = |i: u32| {
        let angle_rad = f64::from(i) * std::f64::consts::TAU / 32.0;
        Some([
            centre_px[0] + radius_px * angle_rad.cos(),
            centre_px[1] + radius_px * angle_rad.sin(),
        ])
    };
    (0..32).map(point).collect()
}

fn zoomed(center_px: [f64; 2], radius_px: f64) -> Zoomed {
    Zoomed {
        center_px,
        radius_px,
    }
}

fn mark(shape: Shape, points_px: Vec<Option<[f64; 2]>>, color: Rgb) -> Overlay {
    Overlay {
        marks: vec![Mark {
            shape,
            points_px,
            color,
        }],
        notes: Vec::new(),
        label: String::new(),
        zoom: None,
    }
}

#[test]
fn a_dot_colours_the_pixel_under_it() {
    let overlay = mark(Shape::Dots, vec![Some([7.0, 3.0])], [255, 0, 0]);
    let picture = annotated(&grey(20, 10), &overlay);
    let [r, g, _] = picture.get_pixel(7, 3);
    assert!(r > 150 && g < 80, "{r} {g}");
    assert_eq!(picture.get_pixel(5, 3), [100; 3]);
    assert_eq!(picture.get_pixel(9, 3), [100; 3]);
}

#[test]
fn a_line_runs_through_pixel_centres_and_stops_at_gaps() {
    let points = vec![
        Some([2.0, 5.0]),
        Some([8.0, 5.0]),
        None,
        Some([12.0, 5.0]),
        Some([18.0, 5.0]),
    ];
    let picture = annotated(&grey(20, 10), &mark(Shape::Line, points, [255; 3]));
    assert_eq!(picture.get_pixel(5, 5), [255; 3]);
    assert_eq!(picture.get_pixel(15, 5), [255; 3]);
    assert_eq!(picture.get_pixel(10, 5), [100; 3]);
    assert_eq!(picture.get_pixel(5, 4), picture.get_pixel(5, 6));
}

#[test]
fn a_contour_is_closed_and_a_line_is_not() {
    let corners = vec![
        Some([2.0, 2.0]),
        Some([17.0, 2.0]),
        Some([17.0, 7.0]),
        Some([2.0, 7.0]),
    ];
    let left = |shape| {
        let picture = annotated(&grey(20, 10), &mark(shape, corners.clone(), [0; 3]));
        picture.get_pixel(2, 4)[0]
    };
    assert!(left(Shape::Contour) < 10);
    assert_eq!(left(Shape::Line), 100);
}

#[test]
fn points_far_outside_or_not_finite_are_harmless() {
    let wild = [f64::NAN, f64::INFINITY, -1e308, 1e308, -1e9, 1e9, 5.0];
    let points: Vec<_> = wild
        .iter()
        .flat_map(|&u| wild.map(|v| Some([u, v])))
        .collect();
    for shape in [Shape::Dots, Shape::Line, Shape::Contour] {
        for u in wild {
            let note = |at_px| Note {
                at_px,
                text: "wild".into(),
                color: [255; 3],
            };
            let overlay = Overlay {
                zoom: Some(zoomed([u, 5.0], u.abs())),
                label: "wild".to_owned(),
                notes: points.iter().copied().flatten().map(note).collect(),
                ..mark(shape, points.clone(), [255; 3])
            };
            for (width, height) in [(1, 1), (41, 1), (320, 240), (100, 400)] {
                annotated(&grey(width, height), &overlay);
            }
        }
    }
    let through = vec![Some([-1e9, 5.0]), Some([1e9, 5.0])];
    let picture = annotated(&grey(20, 10), &mark(Shape::Line, through, [255; 3]));
    assert!((0..20).all(|x| picture.get_pixel(x, 5) == [255; 3]));
    annotated(&grey(0, 0), &mark(Shape::Line, vec![], [0; 3]));
}

#[test]
fn a_note_is_a_cross_with_its_text_to_the_right() {
    let overlay = Overlay {
        notes: vec![Note {
            at_px: [40.0, 30.0],
            text: "too-far".into(),
            color: [255, 0, 0],
        }],
        ..mark(Shape::Line, vec![], [0; 3])
    };
    let picture = annotated(&grey(160, 60), &overlay);
    let reddish = |x, y| picture.get_pixel(x, y)[0] > picture.get_pixel(x, y)[1] + 50;
    assert!(reddish(37, 30) && reddish(40, 33) && !reddish(37, 33));
    let bright = picture
        .enumerate_pixels()
        .filter(|(_, _, p)| p.iter().all(|&c| c > 200));
    let columns: Vec<u32> = bright.map(|(x, _, _)| x).collect();
    assert!(
        columns.len() > 20 && columns.iter().all(|&x| x > 44),
        "{columns:?}"
    );
}

#[test]
fn the_inset_shows_the_neighbourhood_enlarged_away_from_it() {
    let mut image = grey(640, 480);
    image.put_pixel(600, 440, [0, 255, 0]);
    let overlay = Overlay {
        zoom: Some(zoomed([600.0, 440.0], 8.0)),
        ..mark(Shape::Contour, circle([600.0, 440.0], 8.0), [255; 3])
    };
    let picture = annotated(&image, &overlay);
    let green: Vec<_> = picture
        .enumerate_pixels()
        .filter(|(_, _, p)| *p == [0, 255, 0])
        .collect();
    // The pixel itself, and five by five in the inset.
    assert_eq!(green.len(), 1 + 25);
    let enlarged = green.iter().filter(|(x, y, _)| *x < 320 && *y > 240);
    assert_eq!(enlarged.count(), 25);
}

#[test]
fn the_inset_shows_the_whole_outline_or_there_is_none() {
    let image = RgbImage::from_pixel(640, 480, [100; 3]);
    // Columns of the inset at half its height where the outline, in red, is left and right of the middle.
    for radius_px in [8.0, 22.0, 40.0, 48.0] {
        let overlay = Overlay {
            zoom: Some(zoomed([500.0, 240.0], radius_px)),
            ..mark(
                Shape::Contour,
                circle([500.0, 240.0], radius_px),
                [255, 0, 0],
            )
        };
        let picture = annotated(&image, &overlay);
        let is_red = |p: [u8; 3]| i32::from(p[0]) > i32::from(p[1]) + 100;
        let in_inset: Vec<u32> = picture
            .enumerate_pixels()
            .filter(|(x, _, p)| *x < 320 && is_red(*p))
            .map(|(x, _, _)| x)
            .collect();
        let [left, right] = [in_inset.iter().min(), in_inset.iter().max()].map(|x| *x.unwrap());
        assert!(
            left > 8 && right - left > 3 * radius_px as u32,
            "{left} {right}"
        );
        let largest_px = 216.0;
        let side_px = (2.6 * radius_px).max(40.0).min(largest_px / 2.0);
        let zoom = (largest_px / side_px).floor().min(8.0);
        let expected = 2.0 * radius_px * zoom;
        assert!(
            (f64::from(right - left) - expected).abs() < 4.0,
            "{radius_px}: {left} {right}"
        );
    }
    let large = Overlay {
        zoom: Some(zoomed([500.0, 240.0], 60.0)),
        ..mark(Shape::Contour, circle([500.0, 240.0], 60.0), [255, 0, 0])
    };
    let picture = annotated(&image, &large);
    let corner = picture.enumerate_pixels().filter(|(x, ..)| *x < 320);
    assert!(corner.into_iter().all(|(.., p)| p == [100; 3]));
}

#[test]
fn a_wide_contour_shows_on_both_sides_of_another() {
    let points = circle([50.0, 40.0], 20.0);
    let mut overlay = mark(Shape::WideContour, points.clone(), [0; 3]);
    overlay.marks.push(Mark {
        shape: Shape::Contour,
        points_px: points,
        color: [255; 3],
    });
    let picture = annotated(&grey(100, 80), &overlay);
    let row: Vec<u8> = (66..75).map(|x| picture.get_pixel(x, 40)[0]).collect();
    let brightest = row.iter().position(|&c| c > 200).unwrap();
    assert!(row[..brightest].iter().any(|&c| c < 80), "{row:?}");
    assert!(row[brightest..].iter().any(|&c| c < 80), "{row:?}");
}

#[test]
fn dashes_have_gaps() {
    let points = vec![Some([5.0, 5.0]), Some([45.0, 5.0]), Some([95.0, 5.0])];
    let picture = annotated(&grey(100, 10), &mark(Shape::Dashes, points, [255; 3]));
    let drawn = (5..95).filter(|&x| picture.get_pixel(x, 5)[0] > 200);
    let share = drawn.count();
    assert!((20..60).contains(&share), "{share}");
}

#[test]
fn of_notes_that_overlap_the_last_keeps_its_text() {
    let note = |at_px, text: &'static str| Note {
        at_px,
        text: text.into(),
        color: [255, 0, 0],
    };
    let drawn = |notes| {
        let overlay = Overlay {
            notes,
            ..mark(Shape::Line, vec![], [0; 3])
        };
        annotated(&grey(300, 80), &overlay)
    };
    let bright = |picture: &RgbImage, columns: std::ops::Range<u32>| {
        let text = picture
            .enumerate_pixels()
            .filter(|(x, _, p)| columns.contains(x) && p.iter().all(|&c| c > 200));
        text.count()
    };
    let target = note([40.0, 40.0], "target");
    let alone = drawn(vec![target.clone()]);
    let both = drawn(vec![
        note([36.0, 38.0], "other-outline"),
        target.clone(),
        note([200.0, 40.0], "covered"),
    ]);
    assert!(bright(&alone, 0..150) > 5);
    assert_eq!(bright(&both, 0..150), bright(&alone, 0..150));
    assert!(bright(&both, 200..300) > 5);
    // The cross of the other note is there.
    assert!(both.get_pixel(36, 36)[0] > 200 && both.get_pixel(36, 36)[1] < 100);
}

#[test]
fn pictures_are_written_in_the_format_of_their_extension() {
    let folder = test_folder("overlay");
    let encoding = pardalis::color::YuvEncoding::default();
    let format = pardalis::PixelFormat::Rgb8;
    let frame = pardalis::Frame::new(format, encoding, 64, 48, vec![100; 3 * 64 * 48], 0.0);
    let image = picture_of(&frame.unwrap());
    for name in ["a.jpg", "a.JPEG", "a.png"] {
        let path = folder.join(name);
        write_picture(&path, &image).unwrap();
        let back = decode_image(&path).unwrap();
        assert_eq!(back.dimensions(), (64, 48));
        assert!(
            back.pixels()
                .all(|p| p.iter().all(|c| c.abs_diff(100) <= 2))
        );
    }
    for name in ["a", "a.gif", "none/a.png"] {
        let error = write_picture(&folder.join(name), &image).unwrap_err();
        assert!(error.is::<crate::user_error::UserError>(), "{error}");
    }
}

#[test]
fn a_frame_is_annotated_with_particles_contours_label_and_zoom() {
    let image = RgbImage::from_fn(640, 480, |x, y| [(x / 5) as u8, (y / 4) as u8, 60]);
    let centre_px = [459.9, 87.9];
    let cloud = (0..400).map(|i| {
        let angle_rad = f64::from(i) * 2.4;
        let radius_px = 0.3 * f64::from(i).sqrt();
        Some([
            centre_px[0] + radius_px * angle_rad.cos(),
            centre_px[1] + radius_px * angle_rad.sin(),
        ])
    });
    let mut overlay = mark(Shape::Dots, cloud.collect(), crate::draw::PALETTE[4]);
    for (radius_px, shape, color) in [
        (9.0, Shape::WideContour, [0; 3]),
        (6.0, Shape::Contour, [255; 3]),
    ] {
        overlay.marks.push(Mark {
            shape,
            points_px: circle(centre_px, radius_px),
            color,
        });
    }
    overlay.label =
        "frame 0   0.000 s   ball: tracking   x 1.350  y −1.250  z 0.620 m   confidence 0.98"
            .to_owned();
    overlay.zoom = Some(zoomed(centre_px, 9.0));
    let picture = annotated(&image, &overlay);
    let folder = test_folder("overlay-all");
    write_picture(&folder.join("frame.png"), &picture).unwrap();
    let strip = (0..300).flat_map(|x| (0..22).map(move |y| (x, y)));
    let white = strip
        .filter(|&(x, y)| picture.get_pixel(x, y)[0] > 230)
        .count();
    assert!(white > 200, "{white} pixels of text");
}
