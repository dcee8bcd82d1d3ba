//! Calibration boards: their geometry, their detection in images, and drawings of them to print.
//!
//! ```
//! use pardalis_calibrate::board::{Board, detect};
//! use pardalis_images::GrayImage;
//!
//! // A checkerboard of 4 x 3 inner corners, with squares of 30 mm that are 30 pixels wide in the image.
//! let board = Board::checkerboard(4, 3, 0.03)?;
//! let image = GrayImage::from_fn(250, 220, |u, v| {
//!     let is_on_board = (50..200).contains(&u) && (50..170).contains(&v);
//!     let (column, row) = (u.wrapping_sub(50) / 30, v.wrapping_sub(50) / 30);
//!     [if is_on_board && (column + row) % 2 == 1 { 20 } else { 230 }]
//! });
//! let corners = detect(&board, &image)?;
//! assert_eq!(corners.len(), 12);
//! // Corner 0 is the inner corner at the bottom left, between columns 79 and 80 and rows 139 and 140.
//! let [u, v] = corners[0].pixel;
//! assert!((u - 79.5).abs() < 0.1 && (v - 139.5).abs() < 0.1);
//! assert_eq!(corners[1].board_m, [0.03, 0.0, 0.0]);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # Board frame
//!
//! Metres; z = 0 on the print. Seen from the printed side with the board upright, x points right, y up and z out of
//! the print. The corners of checkerboards and AprilGrids are numbered row by row upwards from the bottom left corner,
//! which is the origin. ChArUco corners have OpenCV's numbers, row by row downwards from the top left; the origin is
//! the outer bottom left corner of the board.
//!
//! A checkerboard has a unique orientation if the numbers of its inner corners per row and per column add up to an odd
//! number: the square in the corner of the board next to corner 0 is dark, the opposite one is light. Otherwise it
//! looks the same upside down. The x axis then is the one that points more to the right in the image. This suffices
//! for one camera, but two cameras may disagree ([`Board::has_unique_origin`]).
//!
//! # Method
//!
//! The corners of all boards are saddle points of the brightness, at which two dark and two light squares meet: the
//! inner corners of checkerboards and ChArUco boards, and the corners of an AprilGrid's tags, which touch the small
//! squares between them. Saddle points are linked along the edges of squares to lattices. Each link is judged locally,
//! so that any lens may bend the board. Markers, or the extent and the colours of a checkerboard, determine the
//! position of a lattice on the board. Finally each corner is fitted in the image at full size.

mod collection;
mod detect;
mod error;
mod lattice;
mod layout;
mod marker;
mod place;
mod print;
mod saddle;

use pardalis_core::Error;

use marker::Dictionary;

pub use collection::{Collection, NotAdded};
pub use detect::detect;
pub use error::BoardNotFound;

/// Maximum number of corners, squares or tags along one side.
const MAX_COUNT: usize = 200;

/// Dictionary of the tags of Kalibr's AprilGrids.
const TAG36H11: &str = "DICT_APRILTAG_36h11";

/// A calibration board.
#[derive(Debug, Clone, PartialEq)]
pub struct Board {
    geometry: Geometry,
}

/// Kind of a calibration board.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum BoardKind {
    /// Alternating dark and light squares.
    Checkerboard,
    /// A checkerboard with markers in its light squares, as drawn by OpenCV.
    Charuco,
    /// Kalibr's grid of tags with small squares between their corners.
    AprilGrid,
}

/// Kind and dimensions of a board.
#[derive(Debug, Clone, PartialEq)]
enum Geometry {
    Checkerboard {
        /// Number of inner corners in a row.
        columns: usize,
        /// Number of inner corners in a column.
        rows: usize,
        /// Side of a square.
        square_m: f64,
    },
    Charuco {
        /// Number of squares in a row.
        columns: usize,
        /// Number of squares in a column.
        rows: usize,
        /// Side of a square.
        square_m: f64,
        /// Side of a marker including its dark border.
        marker_m: f64,
        dictionary: Dictionary,
    },
    AprilGrid {
        /// Number of tags in a row.
        columns: usize,
        /// Number of tags in a column.
        rows: usize,
        /// Side of a tag including its dark border.
        tag_m: f64,
        /// Gap between tags divided by the side of a tag.
        spacing: f64,
        dictionary: Dictionary,
    },
}

/// A corner of a board in an image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Corner {
    /// Number of the corner on the board.
    pub id: usize,
    /// Position in the board frame, in metres.
    pub board_m: [f64; 3],
    /// Position in the image in pixels; pixel centres have integer coordinates.
    pub pixel: [f64; 2],
    /// How blurred the edges are that meet there, in pixels: the brightness across an edge follows tanh(distance / width).
    pub edge_width_px: f64,
}

impl Board {
    /// Creates a checkerboard of `columns` x `rows` *inner* corners (3 to 200 each) with squares of this side in metres.
    pub fn checkerboard(columns: usize, rows: usize, square_m: f64) -> Result<Self, Error> {
        check_counts(columns, rows, 3)?;
        check_length("square_m", square_m)?;
        Ok(Self {
            geometry: Geometry::Checkerboard {
                columns,
                rows,
                square_m,
            },
        })
    }

    /// Creates a ChArUco board of `columns` x `rows` squares (3 to 200 each) with squares and markers of these sides in
    /// metres. The dictionary has one of OpenCV's names, such as `DICT_4X4_50`.
    ///
    /// Both OpenCV's present pattern and the one of versions before 4.6 are detected.
    pub fn charuco(
        columns: usize,
        rows: usize,
        square_m: f64,
        marker_m: f64,
        dictionary: &str,
    ) -> Result<Self, Error> {
        check_counts(columns, rows, 3)?;
        check_length("square_m", square_m)?;
        let Some(dictionary) = Dictionary::named(dictionary) else {
            let names: Vec<&str> = marker::names().collect();
            return Err(Error::out_of_range(
                "dictionary",
                dictionary,
                &names.join(", "),
            ));
        };
        check_marker_count([columns, rows], (columns * rows).div_ceil(2), &dictionary)?;
        if !(marker_m > 0.0 && marker_m < square_m) {
            let allowed = format!("above 0 and below square_m, which is {square_m}");
            return Err(Error::out_of_range("marker_m", marker_m, &allowed));
        }
        Ok(Self {
            geometry: Geometry::Charuco {
                columns,
                rows,
                square_m,
                marker_m,
                dictionary,
            },
        })
    }

    /// Creates Kalibr's AprilGrid of `columns` x `rows` tags of the family 36h11 (at most 587) with tags of this side
    /// in metres. `spacing` is the gap between tags divided by the side of a tag, at most 1. Tag 0 is at the bottom
    /// left.
    pub fn april_grid(
        columns: usize,
        rows: usize,
        tag_m: f64,
        spacing: f64,
    ) -> Result<Self, Error> {
        check_counts(columns, rows, 1)?;
        let Some(dictionary) = Dictionary::named(TAG36H11) else {
            unreachable!("the dictionary file contains {TAG36H11}")
        };
        check_marker_count([columns, rows], columns * rows, &dictionary)?;
        if !(spacing > 0.0 && spacing <= 1.0) {
            let allowed = "above 0, at most 1 (the gap between tags divided by the side of a tag)";
            return Err(Error::out_of_range("spacing", spacing, allowed));
        }
        check_length("tag_m", tag_m)?;
        Ok(Self {
            geometry: Geometry::AprilGrid {
                columns,
                rows,
                tag_m,
                spacing,
                dictionary,
            },
        })
    }

    /// Returns the kind of the board.
    pub fn kind(&self) -> BoardKind {
        match self.geometry {
            Geometry::Checkerboard { .. } => BoardKind::Checkerboard,
            Geometry::Charuco { .. } => BoardKind::Charuco,
            Geometry::AprilGrid { .. } => BoardKind::AprilGrid,
        }
    }

    /// Returns the side of a square in metres; of an AprilGrid, that of a tag.
    pub fn side_m(&self) -> f64 {
        match self.geometry {
            Geometry::Checkerboard { square_m, .. } | Geometry::Charuco { square_m, .. } => {
                square_m
            }
            Geometry::AprilGrid { tag_m, .. } => tag_m,
        }
    }

    /// Reports whether the corners have the same numbers in all images, as required for several cameras that see one
    /// board.
    pub fn has_unique_origin(&self) -> bool {
        match self.geometry {
            Geometry::Checkerboard { columns, rows, .. } => (columns + rows) % 2 == 1,
            _ => true,
        }
    }

    /// Returns the number of corners.
    pub fn corner_count(&self) -> usize {
        let [columns, rows] = self.corners();
        columns * rows
    }
}

fn check_counts(columns: usize, rows: usize, least: usize) -> Result<(), Error> {
    for (name, count) in [("columns", columns), ("rows", rows)] {
        if !(least..=MAX_COUNT).contains(&count) {
            let allowed = format!("{least} to {MAX_COUNT}");
            return Err(Error::out_of_range(name, count, &allowed));
        }
    }
    Ok(())
}

fn check_length(name: &str, value: f64) -> Result<(), Error> {
    if value > 0.0 && value.is_finite() {
        return Ok(());
    }
    Err(Error::out_of_range(name, value, "above 0"))
}

fn check_marker_count(
    [columns, rows]: [usize; 2],
    needed: usize,
    dictionary: &Dictionary,
) -> Result<(), Error> {
    if needed <= dictionary.len() {
        return Ok(());
    }
    Err(Error::refused(
        format!(
            "a board of {columns} x {rows} needs {needed} markers, but {} has {}",
            dictionary.name,
            dictionary.len()
        ),
        "use fewer columns or rows or, for a ChArUco board, a larger dictionary",
    ))
}
