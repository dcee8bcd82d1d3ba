//! Labels: the pixels of an image that show the target.

use std::fmt;
use std::ops::Range;
use std::path::{Path, PathBuf};

use anyhow::Result;

use crate::output::Shown;
use crate::shell_word::shell_word;
use crate::source::decode::decode_mask;
use crate::user_error::user_error;

/// Minimum brightness of a mask on the target.
const MASK_THRESHOLD: u8 = 128;

/// A set of pixels that show the target. Coordinates are in pixels from the top left corner, x right, y down.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Label {
    /// The bright pixels of another image of the same size.
    Mask(PathBuf),
    /// The pixels of a rectangle.
    Rect {
        x: usize,
        y: usize,
        width: usize,
        height: usize,
    },
    /// The pixels whose centres lie inside a circle, which may reach beyond the image.
    Circle { center_px: [f64; 2], radius_px: f64 },
    /// The pixels whose centres lie inside the polygon; doubly enclosed areas are outside.
    Polygon(Vec<[f64; 2]>),
}

impl Label {
    /// Returns a circle enlarged by this factor; `None` of any other label.
    pub(super) fn resized(&self, factor: f64) -> Option<Self> {
        let &Self::Circle {
            center_px,
            radius_px,
        } = self
        else {
            return None;
        };
        Some(Self::Circle {
            center_px,
            radius_px: factor * radius_px,
        })
    }

    /// Parses `X,Y,WIDTH,HEIGHT`.
    pub(super) fn rect(text: &str) -> Result<Self, String> {
        let numbers: Option<Vec<usize>> = text.split(',').map(|n| n.trim().parse().ok()).collect();
        match numbers.as_deref() {
            Some(&[x, y, width, height]) if width > 0 && height > 0 => Ok(Self::Rect {
                x,
                y,
                width,
                height,
            }),
            _ => Err(
                "allowed: X,Y,WIDTH,HEIGHT as whole numbers of pixels, with commas and without spaces, width and height 1 or more"
                    .to_owned(),
            ),
        }
    }

    /// Parses `U,V,R`.
    pub(super) fn circle(text: &str) -> Result<Self, String> {
        match numbers(text).as_deref() {
            Some(&[u, v, radius_px]) if radius_px > 0.0 => Ok(Self::Circle {
                center_px: [u, v],
                radius_px,
            }),
            _ => Err("allowed: U,V,R in pixels, R above 0, as in 410,96.5,14".to_owned()),
        }
    }

    /// Parses `X,Y,X,Y,X,Y,...`.
    pub(super) fn polygon(text: &str) -> Result<Self, String> {
        match numbers(text).unwrap_or_default().as_chunks() {
            (corners @ [_, _, _, ..], []) => Ok(Self::Polygon(corners.to_vec())),
            _ => Err(
                "allowed: X,Y of three corners or more, in pixels, as in 10,10,40,10,25,30"
                    .to_owned(),
            ),
        }
    }

    /// Marks the target's pixels of an image of the given width and height, row by row.
    ///
    /// Errors: the mask cannot be read, the label is for another image size, or it contains no pixel.
    pub(super) fn mark(
        &self,
        image: &Path,
        (width, height): (usize, usize),
        is_object: &mut [bool],
    ) -> Result<()> {
        let outside = |allowed: &str| {
            user_error!(
                "{}: {self} exceeds the image of {width} x {height} pixels; allowed: {allowed}",
                image.shown()
            )
        };
        match self {
            Self::Mask(path) => mark_mask(path, image, (width, height), is_object),
            Self::Rect {
                x,
                y,
                width: columns,
                height: rows,
            } => {
                let inside = |from: usize, count: usize, side: usize| {
                    from.checked_add(count).is_some_and(|end| end <= side)
                };
                if !inside(*x, *columns, width) || !inside(*y, *rows, height) {
                    let allowed = "X + WIDTH and Y + HEIGHT up to the image size";
                    // The numbers as X1,Y1,X2,Y2.
                    let from_corners = Self::Rect {
                        x: *x,
                        y: *y,
                        width: columns.saturating_sub(*x),
                        height: rows.saturating_sub(*y),
                    };
                    let are_corners =
                        columns > x && *columns <= width && rows > y && *rows <= height;
                    return Err(if are_corners {
                        outside(&format!(
                            "{allowed}; if these are two corners, X1,Y1,X2,Y2, give {from_corners}"
                        ))
                    } else {
                        outside(allowed)
                    });
                }
                for row in is_object.chunks_exact_mut(width).skip(*y).take(*rows) {
                    row[*x..x + columns].fill(true);
                }
                Ok(())
            }
            Self::Circle {
                center_px: center @ [u, v],
                radius_px,
            } => {
                if !is_within((width, height), center) {
                    return Err(outside("U up to its width, V up to its height"));
                }
                self.fill(image, width, is_object, "a larger radius", |y| {
                    let half = (radius_px * radius_px - (y - v) * (y - v)).sqrt();
                    // Pixels on the circle are outside, so that the labelled pixels are symmetric.
                    let end = column(u + half, width);
                    let start = column((u - half).floor() + 1.0, width).min(end);
                    // Not a number in rows beyond the circle.
                    (!half.is_nan()).then_some(start..end)
                })
            }
            Self::Polygon(corners) => {
                if !corners
                    .iter()
                    .all(|corner| is_within((width, height), corner))
                {
                    return Err(outside("X up to its width, Y up to its height"));
                }
                let remedy = "corners that span an area";
                self.fill(image, width, is_object, remedy, |y| {
                    columns_inside(corners, y, width)
                })
            }
        }
    }

    /// Marks the columns that are returned for each row.
    ///
    /// Errors: they contain no pixel; `remedy` says what to give instead.
    fn fill<C: IntoIterator<Item = Range<usize>>>(
        &self,
        image: &Path,
        width: usize,
        is_object: &mut [bool],
        remedy: &str,
        columns_of_row: impl Fn(f64) -> C,
    ) -> Result<()> {
        let mut is_empty = true;
        for (y, row) in is_object.chunks_exact_mut(width).enumerate() {
            for columns in columns_of_row(y as f64) {
                is_empty &= columns.is_empty();
                row[columns].fill(true);
            }
        }
        if is_empty {
            return Err(user_error!(
                "{}: {self} contains no pixel centre; give {remedy}",
                image.shown()
            ));
        }
        Ok(())
    }
}

/// Formats the label as on the command line.
impl fmt::Display for Label {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Mask(path) => write!(f, "--mask {}", shell_word(path)),
            Self::Rect {
                x,
                y,
                width,
                height,
            } => write!(f, "--rect {x},{y},{width},{height}"),
            Self::Circle {
                center_px: [u, v],
                radius_px,
            } => write!(f, "--circle {u},{v},{radius_px}"),
            Self::Polygon(corners) => {
                let numbers: Vec<String> = corners.iter().flatten().map(f64::to_string).collect();
                write!(f, "--polygon {}", numbers.join(","))
            }
        }
    }
}

/// Parses finite numbers, separated by commas; `None` if there is anything else.
fn numbers(text: &str) -> Option<Vec<f64>> {
    let number = |n: &str| n.trim().parse().ok().filter(|n: &f64| n.is_finite());
    text.split(',').map(number).collect()
}

fn mark_mask(
    path: &Path,
    image: &Path,
    size: (usize, usize),
    is_object: &mut [bool],
) -> Result<()> {
    let mask = decode_mask(path)?;
    if mask.size_px() != size {
        return Err(user_error!(
            "{}: the mask has {} x {} pixels, but {} has {} x {}; a mask must have the size of its image",
            path.shown(),
            mask.width(),
            mask.height(),
            image.shown(),
            size.0,
            size.1
        ));
    }
    let is_bright = |&grey: &u8| grey >= MASK_THRESHOLD;
    if !mask.as_raw().iter().any(is_bright) {
        return Err(user_error!(
            "{}: no pixel of the mask is {MASK_THRESHOLD} or brighter, so it labels nothing; \
             paint the target white, or remove the image",
            path.shown()
        ));
    }
    for (object, grey) in is_object.iter_mut().zip(mask.as_raw()) {
        *object |= is_bright(grey);
    }
    Ok(())
}

/// Returns the ranges of columns of row `y`, cut at `width`, whose pixel centres lie inside the corners. Left
/// and upper edges count as inside, so that adjacent polygons share no pixel.
fn columns_inside(corners: &[[f64; 2]], y: f64, width: usize) -> Vec<Range<usize>> {
    let next = corners.iter().cycle().skip(1);
    let mut crossings: Vec<f64> = corners
        .iter()
        .zip(next)
        .filter(|([_, y0], [_, y1])| (*y0 <= y) != (*y1 <= y))
        .map(|([x0, y0], [x1, y1])| x0 + (y - y0) / (y1 - y0) * (x1 - x0))
        .collect();
    crossings.sort_by(f64::total_cmp);
    let (pairs, _) = crossings.as_chunks();
    pairs
        .iter()
        .map(|[from, to]| column(*from, width)..column(*to, width))
        .collect()
}

/// Returns the first column from `x` on, cut at `width`.
fn column(x: f64, width: usize) -> usize {
    (x.ceil().max(0.0) as usize).min(width)
}

fn is_within((width, height): (usize, usize), &[x, y]: &[f64; 2]) -> bool {
    (0.0..=width as f64).contains(&x) && (0.0..=height as f64).contains(&y)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the marked pixels of an image of 8 x 6, as rows of text.
    fn marked(label: &Label) -> Result<Vec<String>> {
        let mut is_object = vec![false; 48];
        label.mark(Path::new("a.jpg"), (8, 6), &mut is_object)?;
        let row = |row: &[bool]| row.iter().map(|&o| if o { '#' } else { '.' }).collect();
        Ok(is_object.chunks(8).map(row).collect())
    }

    #[test]
    fn a_polygon_with_the_corners_of_a_rectangle_equals_the_rectangle() {
        let rect = marked(&Label::rect("2, 1,3,4").unwrap()).unwrap();
        assert_eq!(rect[0], "........");
        assert_eq!(rect[1..5], ["..###..."; 4]);
        for corners in ["2,1,5,1,5,5,2,5", "2,5,5,5,5,1,2,1"] {
            assert_eq!(marked(&Label::polygon(corners).unwrap()).unwrap(), rect);
        }
        let whole = marked(&Label::polygon("0,0,8,0,8,6,0,6").unwrap()).unwrap();
        assert_eq!(whole, ["########"; 6]);
    }

    #[test]
    fn slanted_and_self_intersecting_polygons_are_filled() {
        let triangle = marked(&Label::polygon("0,0,6,0,0,6").unwrap()).unwrap();
        let expected = [
            "######..", "#####...", "####....", "###.....", "##......", "#.......",
        ];
        assert_eq!(triangle, expected);
        // A bow tie, whose halves cancel in signed area.
        let bow_tie = marked(&Label::polygon("0,0,8,6,8,0,0,6").unwrap()).unwrap();
        assert_eq!(
            (bow_tie[1].as_str(), bow_tie[2].as_str()),
            ("##.....#", "###...##")
        );
    }

    #[test]
    fn a_circle_marks_the_pixels_whose_centres_it_encloses() {
        let circle = marked(&Label::circle("3, 2.5,1.6").unwrap()).unwrap();
        let expected = [
            "........", "...#....", "..###...", "..###...", "...#....", "........",
        ];
        assert_eq!(circle, expected);
        // Centres on the circle are outside, on all sides.
        let even = marked(&Label::circle("3,3,2").unwrap()).unwrap();
        let expected = [
            "........", "........", "..###...", "..###...", "..###...", "........",
        ];
        assert_eq!(even, expected);
        // Balls at the border of the image.
        let cut = marked(&Label::circle("0,5,2.2").unwrap()).unwrap();
        let expected = [
            "........", "........", "........", "#.......", "##......", "###.....",
        ];
        assert_eq!(cut, expected);
    }

    #[test]
    fn corners_instead_of_width_and_height_are_recognised() {
        let message = |text: &str| marked(&Label::rect(text).unwrap()).unwrap_err().to_string();
        let corners = message("3,2,8,5");
        assert!(
            corners.ends_with("X1,Y1,X2,Y2, give --rect 3,2,5,3"),
            "{corners}"
        );
        // Outside the image, or reversed.
        for text in ["3,2,9,5", "3,2,8,7", "6,2,5,5", "3,4,8,4"] {
            let message = message(text);
            assert!(message.ends_with("up to the image size"), "{message}");
        }
    }

    #[test]
    fn malformed_labels_are_rejected() {
        for text in [
            "",
            "1,2,3",
            "1,2,0,4",
            "1,2,3,0",
            "-1,2,3,4",
            "1,2,3,4,5",
            "1.5,2,3,4",
            "a",
        ] {
            assert!(Label::rect(text).is_err(), "{text}");
        }
        for text in [
            "", "1,2", "1,2,0", "1,2,-3", "1,2,3,4", "1,2,NaN", "1,2,inf", "a,2,3",
        ] {
            assert!(Label::circle(text).is_err(), "{text}");
        }
        for text in [
            "",
            "1,2,3,4",
            "1,2,3,4,5",
            "1,2,3,4,5,NaN",
            "1,2,3,4,5,6,7",
            "1,2,3,4,5,inf",
        ] {
            assert!(Label::polygon(text).is_err(), "{text}");
        }
    }

    #[test]
    fn empty_labels_and_labels_outside_the_image_are_rejected() {
        for (label, expected) in [
            (
                Label::rect("6,0,3,1"),
                "--rect 6,0,3,1 exceeds the image of 8 x 6",
            ),
            (Label::rect("0,6,1,1"), "exceeds"),
            (Label::rect("18446744073709551615,0,1,1"), "exceeds"),
            (
                Label::polygon("0,0,9,0,0,5"),
                "--polygon 0,0,9,0,0,5 exceeds",
            ),
            (Label::polygon("0,-1,5,0,0,5"), "exceeds"),
            (Label::circle("9,2,3"), "--circle 9,2,3 exceeds"),
            (Label::circle("2,-0.5,3"), "exceeds"),
            (Label::circle("2.5,2.5,0.5"), "no pixel centre"),
            (Label::circle("2,2.5,0.5"), "no pixel centre"),
            (Label::polygon("0,0,4,4,2,2"), "no pixel centre"),
            (Label::polygon("1.2,1.2,1.8,1.2,1.5,1.8"), "no pixel centre"),
        ] {
            let message = marked(&label.unwrap()).unwrap_err().to_string();
            assert!(
                message.starts_with("a.jpg: ") && message.contains(expected),
                "{message}"
            );
        }
    }
}
