//! Calibration boards: what they look like, and where their corners are in an image.
//!
//! All boards are lattices of saddle points, corners at which two dark and two light squares meet: the inner corners of a
//! checkerboard or ChArUco board, and the corners of an AprilGrid's tags with the small squares between them. So all are found in the
//! same way: saddle points (`saddle`) are joined along edges to lattices (`lattice`), step by step, so that any lens may bend them;
//! lattices are placed on the print (`layout`) by their markers (`marker`), or by extent and colours; and the corners are fitted again
//! in the full image.
//!
//! # Board frame
//!
//! Of all boards: metres, z = 0 on the print, seen on the printed side with the board upright x points right, y up, and z out of the
//! print. A corner of a checkerboard or an AprilGrid has the number row x corners in a row + column, from the first corner at the
//! origin in the bottom left. ChArUco corners have OpenCV's numbers, from the top left, row by row downwards; the origin is the
//! outer bottom left corner of the board.
//!
//! A checkerboard says by its colours which way is up if the sum of its inner corners' columns and rows is odd: the square beyond the
//! first corner, in the corner of the board, is dark. If the sum is even, a board looks the same upside down; then the x axis is the
//! one that points more to the right in the image, which is good enough for one camera but means nothing to two
//! ([`Board::has_unique_origin`]).

#[cfg(test)]
mod calibration_tests;
mod lattice;
mod layout;
mod marker;
mod parse;
mod place;
mod print;
mod saddle;
#[cfg(test)]
mod tests;

use pardalis_images::GrayImage;

use marker::Dictionary;
use place::Placed;

/// The least image, along its shorter side, that is searched; smaller levels of the pyramid are not made.
const MIN_SIDE_PX: u32 = 64;

/// Images with a longer side than this are first searched at half their size, or less.
const MAX_SIDE_PX: u32 = 1600;

/// In drawings that no camera took, four pixels around a corner may be alike, so that none of them is the best; at this scale they differ.
const UNEVEN_SCALE: f64 = 0.73;

/// A corner needs this much room to be fitted: fewer pixels say too little.
const MIN_FIT_RADIUS_PX: f64 = 2.5;

/// The fit of a corner takes pixels within this distance of it at most.
const MAX_FIT_RADIUS_PX: f64 = 16.0;

/// A calibration board.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Board {
    /// Squares alternately dark and light.
    Checkerboard {
        /// Inner corners in a row.
        columns: usize,
        /// Inner corners in a column.
        rows: usize,
        /// Side of a square.
        square_m: f64,
    },
    /// A checkerboard with markers in its light squares, as OpenCV draws it.
    Charuco {
        /// Squares in a row.
        columns: usize,
        /// Squares in a column.
        rows: usize,
        /// Side of a square.
        square_m: f64,
        /// Side of a marker, with its dark border.
        marker_m: f64,
        /// What the markers are taken from.
        dictionary: Dictionary,
    },
    /// Kalibr's grid of tags with small squares between their corners; tag 0 is in the bottom left.
    AprilGrid {
        /// Tags in a row.
        columns: usize,
        /// Tags in a column.
        rows: usize,
        /// Side of a tag, with its dark border.
        tag_m: f64,
        /// Gap between tags by the side of a tag.
        spacing: f64,
        /// What the tags are taken from.
        dictionary: Dictionary,
    },
}

/// A corner of a board in an image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Corner {
    /// Its number on the board.
    pub(crate) id: usize,
    /// Its place on the board, in the board frame.
    pub(crate) board_m: [f64; 3],
    /// Its place in the image in pixels; centres of pixels are at integers.
    pub(crate) pixel: [f64; 2],
}

impl Board {
    /// Whether the corners' numbers mean the same in all images, so that several cameras may look at one board.
    pub(crate) fn has_unique_origin(&self) -> bool {
        match self {
            Board::Checkerboard { columns, rows, .. } => (columns + rows) % 2 == 1,
            _ => true,
        }
    }

    /// How many corners there are.
    pub(crate) fn corner_count(&self) -> usize {
        self.corners()[0] * self.corners()[1]
    }
}

/// Finds the board's corners, in the order of their numbers: all of a checkerboard, those in view of other boards.
///
/// # Errors
///
/// Why the board was not found, as the end of a sentence about the image.
pub(crate) fn detect(board: &Board, image: &GrayImage) -> Result<Vec<Corner>, String> {
    if image.width().min(image.height()) < MIN_SIDE_PX {
        return Err(format!(
            "the image has {} x {} pixels; needed: at least {MIN_SIDE_PX} x {MIN_SIDE_PX}",
            image.width(),
            image.height()
        ));
    }
    let mut best = Err(None);
    for scale in scales(image) {
        match detect_at(board, image, scale) {
            Ok(corners) => {
                if best.as_ref().map_or(0, Vec::len) < corners.len() {
                    best = Ok(corners);
                }
            }
            Err(reason) => best = best.map_err(|first: Option<String>| first.or(Some(reason))),
        }
        if best.as_ref().map_or(0, Vec::len) == board.corner_count() {
            break;
        }
    }
    best.map_err(Option::unwrap_or_default)
}

/// The sizes at which the image is searched, as shares of its own: small first for large images, then finer for small squares, and
/// coarser for blurred ones.
fn scales(image: &GrayImage) -> Vec<f64> {
    let mut scale = 1.0;
    while scale * f64::from(image.width().max(image.height())) > f64::from(MAX_SIDE_PX) {
        scale /= 2.0;
    }
    let mut scales = vec![scale, 2.0 * scale];
    let shorter_px = f64::from(image.width().min(image.height()));
    let coarser = [scale / 2.0, UNEVEN_SCALE * scale];
    let large_enough = |scale: &f64| scale * shorter_px >= f64::from(MIN_SIDE_PX);
    scales.extend(coarser.into_iter().filter(large_enough));
    scales
}

/// Finds the corners in the image at another scale, and fits them again in the image itself.
fn detect_at(board: &Board, image: &GrayImage, scale: f64) -> Result<Vec<Corner>, String> {
    let resized = |n: u32| (f64::from(n) * scale).round() as u32;
    let level = image.resized(resized(image.width()), resized(image.height()));
    let saddles = saddle::find(&level);
    let lattices = lattice::grow(&level, &saddles);
    let mut placed = match board {
        Board::Checkerboard { .. } => place::by_extent(board, &lattices, &saddles)?,
        Board::Charuco { dictionary, .. } | Board::AprilGrid { dictionary, .. } => {
            place::by_markers(board, dictionary, &level, &lattices, &saddles)?
        }
    };
    // Centres of pixels, not their borders, are at integers.
    let to_image = |n: f64| (n + 0.5) / scale - 0.5;
    for corner in placed.values_mut() {
        corner.pixel = corner.pixel.map(to_image);
    }
    let fitted = fit(board, image, &placed);
    let whole = matches!(board, Board::Checkerboard { .. });
    if whole && fitted.len() < placed.len() {
        return Err(format!(
            "{} of {} corners are too small, blurred or covered to be measured",
            placed.len() - fitted.len(),
            placed.len()
        ));
    }
    Ok(fitted)
}

/// Fits all corners in the image and omits those that cannot be fitted.
fn fit(board: &Board, image: &GrayImage, placed: &Placed) -> Vec<Corner> {
    let distance = |a: &[f64], b: &[f64]| (a[0] - b[0]).hypot(a[1] - b[1]);
    // The least scale towards any neighbour: perspective makes it differ.
    let pixels_per_m = |[x, y]: [i32; 2], board_m: [f64; 3], pixel: [f64; 2]| {
        [[x - 1, y], [x + 1, y], [x, y - 1], [x, y + 1]]
            .into_iter()
            .filter_map(|neighbour| {
                let (_, neighbour_m) = board.corner_at(neighbour)?;
                let length_px = distance(&placed.get(&neighbour)?.pixel, &pixel);
                Some(length_px / distance(&neighbour_m, &board_m))
            })
            .fold(f64::MAX, f64::min)
    };
    let mut corners: Vec<Corner> = placed
        .iter()
        .filter_map(|(&place, &start)| {
            let (id, board_m) = board.corner_at(place)?;
            let radius_px = board.free_radius_m() * pixels_per_m(place, board_m, start.pixel);
            if radius_px < MIN_FIT_RADIUS_PX {
                return None;
            }
            let pixel = saddle::refine(image, start, radius_px.min(MAX_FIT_RADIUS_PX))?.pixel;
            Some(Corner { id, board_m, pixel })
        })
        .collect();
    corners.sort_by_key(|corner| corner.id);
    corners
}
