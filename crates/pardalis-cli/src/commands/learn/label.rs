//! Labels: which pixels of an image show the target.

use std::fmt;
use std::ops::Range;
use std::path::{Path, PathBuf};

use anyhow::Result;

use crate::source::decode::decode_mask;
use crate::user_error::user_error;

/// Pixels of a mask at least this bright are the target's.
const MASK_THRESHOLD: u8 = 128;

/// Which pixels of an image show the target. Coordinates in pixels from the top left corner, x right, y down.
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
    /// The pixels whose centres lie inside the corners; what is enclosed twice is outside.
    Polygon(Vec<[f64; 2]>),
}

impl Label {
    /// Reads `X,Y,WIDTH,HEIGHT`.
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
                "allowed: X,Y,WIDTH,HEIGHT as whole numbers of pixels, width and height 1 or more"
                    .to_owned(),
            ),
        }
    }

    /// Reads `X,Y,X,Y,X,Y,...`.
    pub(super) fn polygon(text: &str) -> Result<Self, String> {
        let number = |n: &str| n.trim().parse().ok().filter(|n: &f64| n.is_finite());
        let numbers: Option<Vec<f64>> = text.split(',').map(number).collect();
        let numbers = numbers.unwrap_or_default();
        match numbers.as_chunks() {
            (corners @ [_, _, _, ..], []) => Ok(Self::Polygon(corners.to_vec())),
            _ => Err(
                "allowed: X,Y of three corners or more, in pixels, as in 10,10,40,10,25,30"
                    .to_owned(),
            ),
        }
    }

    /// Marks the target's pixels of an image of this width and height, row by row.
    ///
    /// Errors: the mask cannot be read, the label fits another size of image, or it has no pixel.
    pub(super) fn mark(
        &self,
        image: &Path,
        (width, height): (usize, usize),
        is_object: &mut [bool],
    ) -> Result<()> {
        let outside = |allowed: &str| {
            user_error!(
                "{}: {self} reaches out of the image of {width} x {height} pixels; allowed: {allowed}",
                image.display()
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
                    return Err(outside("X + WIDTH and Y + HEIGHT up to the image's"));
                }
                for row in is_object.chunks_exact_mut(width).skip(*y).take(*rows) {
                    row[*x..x + columns].fill(true);
                }
                Ok(())
            }
            Self::Polygon(corners) => {
                let (right, bottom) = (width as f64, height as f64);
                let inside =
                    |&[x, y]: &[f64; 2]| (0.0..=right).contains(&x) && (0.0..=bottom).contains(&y);
                if !corners.iter().all(inside) {
                    return Err(outside("X up to its width, Y up to its height"));
                }
                let mut is_empty = true;
                for (y, row) in is_object.chunks_exact_mut(width).enumerate() {
                    for columns in columns_inside(corners, y as f64, width) {
                        is_empty &= columns.is_empty();
                        row[columns].fill(true);
                    }
                }
                if is_empty {
                    return Err(user_error!(
                        "{}: {self} has no pixel's centre inside; give corners that span an area",
                        image.display()
                    ));
                }
                Ok(())
            }
        }
    }
}

/// As on the command line.
impl fmt::Display for Label {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Mask(path) => write!(f, "--mask {}", path.display()),
            Self::Rect {
                x,
                y,
                width,
                height,
            } => write!(f, "--rect {x},{y},{width},{height}"),
            Self::Polygon(corners) => {
                let numbers: Vec<String> = corners.iter().flatten().map(f64::to_string).collect();
                write!(f, "--polygon {}", numbers.join(","))
            }
        }
    }
}

fn mark_mask(
    path: &Path,
    image: &Path,
    size: (usize, usize),
    is_object: &mut [bool],
) -> Result<()> {
    let mask = decode_mask(path)?;
    if (mask.width, mask.height) != size {
        return Err(user_error!(
            "{}: the mask is {} x {} pixels where {} has {} x {}; a mask has the size of its image",
            path.display(),
            mask.width,
            mask.height,
            image.display(),
            size.0,
            size.1
        ));
    }
    let is_bright = |&grey: &u8| grey >= MASK_THRESHOLD;
    if !mask.bytes.iter().any(is_bright) {
        return Err(user_error!(
            "{}: no pixel of the mask is {MASK_THRESHOLD} or brighter, so that it labels nothing; \
             paint the target white, or leave out the image",
            path.display()
        ));
    }
    for (object, grey) in is_object.iter_mut().zip(&mask.bytes) {
        *object |= is_bright(grey);
    }
    Ok(())
}

/// The stretches of row `y`, cut at `width`, whose pixels have their centres inside the corners. Left and upper edges
/// count as inside, so that polygons side by side share no pixel.
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
    let column = |x: f64| (x.ceil().max(0.0) as usize).min(width);
    pairs
        .iter()
        .map(|[from, to]| column(*from)..column(*to))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The marked pixels of an image of 8 x 6, as rows of text.
    fn marked(label: &Label) -> Result<Vec<String>> {
        let mut is_object = vec![false; 48];
        label.mark(Path::new("a.jpg"), (8, 6), &mut is_object)?;
        let row = |row: &[bool]| row.iter().map(|&o| if o { '#' } else { '.' }).collect();
        Ok(is_object.chunks(8).map(row).collect())
    }

    #[test]
    fn a_polygon_of_a_rectangles_corners_is_the_rectangle() {
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
    fn slanted_and_hollow_polygons() {
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
    fn malformed_labels_are_refused() {
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
    fn labels_without_pixels_or_outside_are_refused() {
        for (label, expected) in [
            (
                Label::rect("6,0,3,1"),
                "--rect 6,0,3,1 reaches out of the image of 8 x 6",
            ),
            (Label::rect("0,6,1,1"), "reaches out"),
            (Label::rect("18446744073709551615,0,1,1"), "reaches out"),
            (
                Label::polygon("0,0,9,0,0,5"),
                "--polygon 0,0,9,0,0,5 reaches out",
            ),
            (Label::polygon("0,-1,5,0,0,5"), "reaches out"),
            (Label::polygon("0,0,4,4,2,2"), "no pixel's centre"),
            (
                Label::polygon("1.2,1.2,1.8,1.2,1.5,1.8"),
                "no pixel's centre",
            ),
        ] {
            let message = marked(&label.unwrap()).unwrap_err().to_string();
            assert!(
                message.starts_with("a.jpg: ") && message.contains(expected),
                "{message}"
            );
        }
    }
}
