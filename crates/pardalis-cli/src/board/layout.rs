//! Where corners and markers are on a printed board.
//!
//! Places on the print are pairs of integers: corners are counted from 0 along columns to the right and along rows downwards from
//! the top left corner, seen on the printed side; a square has the place of its top left corner.

use super::Board;

/// Modules of the dark border of Kalibr's tags; others print them with one.
const KALIBR_BORDERS: [usize; 2] = [2, 1];

/// A turn and a shift that take places in a lattice to places on the print: never a mirror image.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Placement {
    /// Quarter turns clockwise, before the shift.
    pub(crate) turns: usize,
    /// The shift.
    pub(crate) shift: [i32; 2],
}

impl Placement {
    /// Returns the placement, with this number of quarter turns, that maps one square to another.
    pub(crate) fn of_square(turns: usize, from: [i32; 2], to: [i32; 2]) -> Self {
        let middle = turn(turns, from.map(|n| 2 * n + 1));
        let shift = |n: usize| (2 * to[n] + 1 - middle[n]) / 2;
        Self {
            turns,
            shift: [shift(0), shift(1)],
        }
    }

    /// Returns the placement, with this number of quarter turns, that maps one corner to another.
    pub(crate) fn of_corner(turns: usize, from: [i32; 2], to: [i32; 2]) -> Self {
        let turned = turn(turns, from);
        Self {
            turns,
            shift: [to[0] - turned[0], to[1] - turned[1]],
        }
    }

    /// The place on the print of a place in the lattice.
    pub(crate) fn to_print(self, place: [i32; 2]) -> [i32; 2] {
        let [x, y] = turn(self.turns, place);
        [x + self.shift[0], y + self.shift[1]]
    }

    /// The place in the lattice of a place on the print.
    pub(crate) fn to_lattice(self, [x, y]: [i32; 2]) -> [i32; 2] {
        turn(4 - self.turns, [x - self.shift[0], y - self.shift[1]])
    }

    /// The place in the lattice of a square on the print.
    pub(crate) fn square_to_lattice(self, [x, y]: [i32; 2]) -> [i32; 2] {
        let [a, b] = [[x, y], [x + 1, y + 1]].map(|corner| self.to_lattice(corner));
        [a[0].min(b[0]), a[1].min(b[1])]
    }
}

/// A place turned clockwise about the origin.
fn turn(turns: usize, [x, y]: [i32; 2]) -> [i32; 2] {
    match turns % 4 {
        0 => [x, y],
        1 => [-y, x],
        2 => [-x, -y],
        _ => [y, -x],
    }
}

impl Board {
    /// Corners along columns and along rows.
    pub(crate) fn corners(&self) -> [usize; 2] {
        match *self {
            Board::Checkerboard { columns, rows, .. } => [columns, rows],
            Board::Charuco { columns, rows, .. } => [columns - 1, rows - 1],
            Board::AprilGrid { columns, rows, .. } => [2 * columns, 2 * rows],
        }
    }

    /// Number and place in metres of the corner at a place on the print, if there is one.
    pub(crate) fn corner_at(&self, [x, y]: [i32; 2]) -> Option<(usize, [f64; 3])> {
        let [columns, rows] = self.corners();
        let (column, down) = (usize::try_from(x).ok()?, usize::try_from(y).ok()?);
        if column >= columns || down >= rows {
            return None;
        }
        let up = rows - 1 - down;
        Some(match *self {
            Board::Checkerboard { square_m, .. } => (
                up * columns + column,
                [column as f64 * square_m, up as f64 * square_m, 0.0],
            ),
            Board::Charuco { square_m, .. } => (
                down * columns + column,
                [
                    (column + 1) as f64 * square_m,
                    (up + 1) as f64 * square_m,
                    0.0,
                ],
            ),
            Board::AprilGrid { tag_m, spacing, .. } => {
                let place_m =
                    |n: usize| (n / 2) as f64 * (1.0 + spacing) * tag_m + (n % 2) as f64 * tag_m;
                (up * columns + column, [place_m(column), place_m(up), 0.0])
            }
        })
    }

    /// The patterns that the board may have: whether it may be OpenCV's from before 4.6. That one has the colours of a ChArUco board the
    /// other way round if its rows are even.
    pub(crate) fn patterns(&self) -> &'static [bool] {
        match self {
            Board::Charuco { rows, .. } if rows % 2 == 0 => &[false, true],
            _ => &[false],
        }
    }

    /// The square on the print that holds a marker, if a board of this pattern has that marker.
    pub(crate) fn marker_at(&self, id: usize, old_pattern: bool) -> Option<[i32; 2]> {
        match *self {
            Board::Checkerboard { .. } => None,
            Board::Charuco { columns, rows, .. } => {
                let light = usize::from(!old_pattern);
                let mut light_squares = (0..rows)
                    .flat_map(|down| (0..columns).map(move |column| (column, down)))
                    .filter(|(column, down)| (column + down) % 2 == light);
                let (column, down) = light_squares.nth(id)?;
                Some([column as i32 - 1, down as i32 - 1])
            }
            Board::AprilGrid { columns, rows, .. } => {
                let (column, up) = (id % columns, id / columns);
                (up < rows).then(|| [2 * column as i32, 2 * (rows - 1 - up) as i32])
            }
        }
    }

    /// Quarter turns that take directions in an upright marker of the dictionary to those on the print.
    pub(crate) fn marker_turns(&self) -> usize {
        // Kalibr prints the tags upside down, by OpenCV's notion of upright.
        match self {
            Board::AprilGrid { .. } => 2,
            _ => 0,
        }
    }

    /// Whether markers are in the dark squares of the lattice.
    pub(crate) fn markers_are_dark(&self) -> bool {
        matches!(self, Board::AprilGrid { .. })
    }

    /// Side of a marker by the side of its square.
    pub(crate) fn marker_share(&self) -> f64 {
        match *self {
            Board::Charuco {
                square_m, marker_m, ..
            } => marker_m / square_m,
            _ => 1.0,
        }
    }

    /// Widths in modules that the dark borders of markers may have.
    pub(crate) fn marker_borders(&self) -> &'static [usize] {
        match self {
            Board::AprilGrid { .. } => &KALIBR_BORDERS,
            _ => &[1],
        }
    }

    /// How far from a corner the board is free of anything but the corner's own edges.
    pub(crate) fn free_radius_m(&self) -> f64 {
        match *self {
            Board::Checkerboard { square_m, .. } => 0.5 * square_m,
            // Markers begin at the same distance from both edges.
            Board::Charuco {
                square_m, marker_m, ..
            } => (std::f64::consts::FRAC_1_SQRT_2 * (square_m - marker_m)).min(0.5 * square_m),
            // The small squares between tags are as wide as the gap.
            Board::AprilGrid { tag_m, spacing, .. } => 0.5 * spacing * tag_m,
        }
    }
}
