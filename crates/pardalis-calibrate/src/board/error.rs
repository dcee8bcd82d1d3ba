//! Reasons why a board was not found.

/// Least width and height of an image that is searched, in pixels.
pub(super) const MIN_SIDE_PX: u32 = 64;

/// Least number of markers that must agree on the position of the board.
pub(super) const MIN_MARKERS: usize = 2;

/// The reason why a board was not found in an image.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum BoardNotFound {
    /// The image is too small to be searched.
    #[error(
        "the image has {width} x {height} pixels; needed: at least {MIN_SIDE_PX} x {MIN_SIDE_PX}"
    )]
    ImageTooSmall {
        /// Width of the image in pixels.
        width: u32,
        /// Height of the image in pixels.
        height: u32,
    },
    /// Nothing in the image resembles a board.
    #[error("no board is in view")]
    NotInView,
    /// Part of a checkerboard is outside the image or covered, or it has fewer corners than stated.
    #[error(
        "the whole board of {columns} x {rows} inner corners must be in view; the largest part found has {found}"
    )]
    Incomplete {
        /// Number of inner corners in a row of the board.
        columns: usize,
        /// Number of inner corners in a column of the board.
        rows: usize,
        /// Number of corners of the largest part.
        found: usize,
    },
    /// Several checkerboards of this size are in view, or a larger one.
    #[error(
        "several parts could be the board of {columns} x {rows} inner corners; count the corners again, and show one board only"
    )]
    Ambiguous {
        /// Number of inner corners in a row of the board.
        columns: usize,
        /// Number of inner corners in a column of the board.
        rows: usize,
    },
    /// There is a lattice of squares, but without readable markers of the board's dictionary.
    #[error(
        "a lattice of {corners} corners is in view, but none of the board's markers ({dictionary}) could be read in it"
    )]
    NoMarkers {
        /// Number of corners of the largest lattice.
        corners: usize,
        /// Name of the board's dictionary.
        dictionary: &'static str,
    },
    /// Markers were read, but they contradict each other or the board.
    #[error(
        "fewer than {MIN_MARKERS} of the board's markers agree on its position; check the board's columns, rows and dictionary"
    )]
    TooFewMarkers,
    /// Corners of a checkerboard could not be located accurately.
    #[error("{unmeasured} of {corners} corners are too small, blurred or covered to be measured")]
    Unmeasured {
        /// Number of corners that could not be located.
        unmeasured: usize,
        /// Number of corners of the board.
        corners: usize,
    },
}
