//! Positions of corners and markers on a printed board.
//!
//! An index on the print is a pair of integers: columns to the right and rows downwards, counted from 0 at the top left
//! corner, seen from the printed side. A square has the index of its top left corner.

use super::{Board, Geometry};

/// Possible widths of the dark border of tags in modules: 2 as printed by Kalibr, 1 as printed by other programs.
const KALIBR_BORDERS: [usize; 2] = [2, 1];

/// A rotation and a shift that map indices in a lattice to indices on the print. Never a reflection.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Placement {
    /// Number of clockwise quarter turns, before the shift.
    turns: usize,
    shift: [i32; 2],
}

impl Placement {
    /// Returns the placement, with this number of quarter turns, that maps one square to another.
    pub(super) fn of_square(turns: usize, from: [i32; 2], to: [i32; 2]) -> Self {
        let middle = turn(turns, from.map(|n| 2 * n + 1));
        let shift = |n: usize| (2 * to[n] + 1 - middle[n]) / 2;
        Self {
            turns,
            shift: [shift(0), shift(1)],
        }
    }

    /// Returns the placement, with this number of quarter turns, that maps one corner to another.
    pub(super) fn of_corner(turns: usize, from: [i32; 2], to: [i32; 2]) -> Self {
        let turned = turn(turns, from);
        Self {
            turns,
            shift: [to[0] - turned[0], to[1] - turned[1]],
        }
    }

    /// Maps an index in the lattice to the print.
    pub(super) fn to_print(self, index: [i32; 2]) -> [i32; 2] {
        let [x, y] = turn(self.turns, index);
        [x + self.shift[0], y + self.shift[1]]
    }

    /// Maps an index on the print to the lattice.
    pub(super) fn to_lattice(self, [x, y]: [i32; 2]) -> [i32; 2] {
        turn(4 - self.turns, [x - self.shift[0], y - self.shift[1]])
    }

    /// Maps a square on the print to the lattice.
    pub(super) fn square_to_lattice(self, [x, y]: [i32; 2]) -> [i32; 2] {
        let [a, b] = [[x, y], [x + 1, y + 1]].map(|corner| self.to_lattice(corner));
        [a[0].min(b[0]), a[1].min(b[1])]
    }
}

/// Rotates an index clockwise about the origin by this number of quarter turns.
fn turn(turns: usize, [x, y]: [i32; 2]) -> [i32; 2] {
    match turns % 4 {
        0 => [x, y],
        1 => [-y, x],
        2 => [-x, -y],
        _ => [y, -x],
    }
}

impl Board {
    /// Returns the number of corners in a row and in a column.
    pub(super) fn corners(&self) -> [usize; 2] {
        match self.geometry {
            Geometry::Checkerboard { columns, rows, .. } => [columns, rows],
            Geometry::Charuco { columns, rows, .. } => [columns - 1, rows - 1],
            Geometry::AprilGrid { columns, rows, .. } => [2 * columns, 2 * rows],
        }
    }

    /// Returns number and position in metres of the corner at an index on the print; `None` beyond the board.
    pub(super) fn corner_at(&self, [x, y]: [i32; 2]) -> Option<(usize, [f64; 3])> {
        let [columns, rows] = self.corners();
        let (column, down) = (usize::try_from(x).ok()?, usize::try_from(y).ok()?);
        if column >= columns || down >= rows {
            return None;
        }
        let up = rows - 1 - down;
        Some(match self.geometry {
            Geometry::Checkerboard { square_m, .. } => (
                up * columns + column,
                [column as f64 * square_m, up as f64 * square_m, 0.0],
            ),
            Geometry::Charuco { square_m, .. } => (
                down * columns + column,
                [
                    (column + 1) as f64 * square_m,
                    (up + 1) as f64 * square_m,
                    0.0,
                ],
            ),
            Geometry::AprilGrid { tag_m, spacing, .. } => {
                let position_m =
                    |n: usize| (n / 2) as f64 * (1.0 + spacing) * tag_m + (n % 2) as f64 * tag_m;
                (
                    up * columns + column,
                    [position_m(column), position_m(up), 0.0],
                )
            }
        })
    }

    /// Returns the patterns that the board may have: the present one (false) or that of OpenCV before 4.6 (true), which
    /// swaps the colours of ChArUco boards with an even number of rows.
    pub(super) fn patterns(&self) -> &'static [bool] {
        match self.geometry {
            Geometry::Charuco { rows, .. } if rows % 2 == 0 => &[false, true],
            _ => &[false],
        }
    }

    /// Returns the square on the print that contains a marker; `None` if a board of this pattern lacks the marker.
    pub(super) fn marker_at(&self, id: usize, old_pattern: bool) -> Option<[i32; 2]> {
        match self.geometry {
            Geometry::Checkerboard { .. } => None,
            Geometry::Charuco { columns, rows, .. } => {
                let light = usize::from(!old_pattern);
                let mut light_squares = (0..rows)
                    .flat_map(|down| (0..columns).map(move |column| (column, down)))
                    .filter(|(column, down)| (column + down) % 2 == light);
                let (column, down) = light_squares.nth(id)?;
                Some([column as i32 - 1, down as i32 - 1])
            }
            Geometry::AprilGrid { columns, rows, .. } => {
                let (column, up) = (id % columns, id / columns);
                (up < rows).then(|| [2 * column as i32, 2 * (rows - 1 - up) as i32])
            }
        }
    }

    /// Returns the number of quarter turns from an upright marker of the dictionary to the print.
    pub(super) fn marker_turns(&self) -> usize {
        // Kalibr prints tags upside down compared with OpenCV.
        match self.geometry {
            Geometry::AprilGrid { .. } => 2,
            _ => 0,
        }
    }

    /// Reports whether markers are in the dark squares of the lattice.
    pub(super) fn markers_are_dark(&self) -> bool {
        matches!(self.geometry, Geometry::AprilGrid { .. })
    }

    /// Returns the side of a marker divided by the side of its square.
    pub(super) fn marker_fraction(&self) -> f64 {
        match self.geometry {
            Geometry::Charuco {
                square_m, marker_m, ..
            } => marker_m / square_m,
            _ => 1.0,
        }
    }

    /// Returns the possible widths of the markers' dark borders, in modules.
    pub(super) fn marker_borders(&self) -> &'static [usize] {
        match self.geometry {
            Geometry::AprilGrid { .. } => &KALIBR_BORDERS,
            _ => &[1],
        }
    }

    /// Returns the radius around a corner, in metres, within which the board has only that corner's own edges.
    pub(super) fn free_radius_m(&self) -> f64 {
        match self.geometry {
            Geometry::Checkerboard { square_m, .. } => 0.5 * square_m,
            // Markers are equally far from both edges.
            Geometry::Charuco {
                square_m, marker_m, ..
            } => (std::f64::consts::FRAC_1_SQRT_2 * (square_m - marker_m)).min(0.5 * square_m),
            // The small squares between tags are as wide as the gap.
            Geometry::AprilGrid { tag_m, spacing, .. } => 0.5 * spacing * tag_m,
        }
    }
}
