//! Drawings of boards to print, in true size.

use std::fmt::Write as _;

use super::{Board, Dictionary, Geometry};

/// Least white margin around a board.
const MIN_MARGIN_MM: f64 = 12.0;

/// Height of the note's letters if the board is wide enough.
const NOTE_MM: f64 = 4.0;

/// Approximate width of a letter divided by its height.
const LETTER_WIDTH: f64 = 0.6;

/// Rectangles as x, y, width and height in metres from the print's top left corner.
type Rectangles = Vec<[f64; 4]>;

/// Black rectangles, and white ones on top of them.
#[derive(Default)]
struct Print {
    black: Rectangles,
    white: Rectangles,
}

impl Board {
    /// Returns an SVG document of the board in true size, with a white margin and a note that describes the board.
    pub fn to_svg(&self) -> String {
        let [width, height] = self.size_m().map(|side| 1e3 * side);
        let print = self.print();
        let note = self.note();
        let margin = MIN_MARGIN_MM.max(1e3 * self.quiet_zone_m());
        let note_height = NOTE_MM.min(width / (LETTER_WIDTH * note.len() as f64));
        let [page_width, page_height] =
            [width, height].map(|side| micrometres(side + 2.0 * margin));
        format!(
            "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{page_width}mm\" height=\"{page_height}mm\" \
             viewBox=\"{0} {0} {page_width} {page_height}\">\n\
             <rect x=\"{0}\" y=\"{0}\" width=\"{page_width}\" height=\"{page_height}\" fill=\"white\"/>\n\
             <path fill=\"black\" d=\"{black}\"/>\n\
             <path fill=\"white\" d=\"{white}\"/>\n\
             <text x=\"0\" y=\"{note_y}\" font-family=\"DejaVu Sans, sans-serif\" font-size=\"{note_height}\" \
             fill=\"black\">{note}</text>\n\
             </svg>\n",
            -margin,
            black = path(&print.black),
            white = path(&print.white),
            note_y = height + 0.5 * (margin + note_height),
        )
    }

    /// Describes the board and how to print it.
    fn note(&self) -> String {
        let mm = |metres: f64| micrometres(1e3 * metres);
        let what = match &self.geometry {
            Geometry::Checkerboard {
                columns,
                rows,
                square_m,
            } => {
                format!(
                    "{columns} x {rows} inner corners, squares of {} mm",
                    mm(*square_m)
                )
            }
            Geometry::Charuco {
                columns,
                rows,
                square_m,
                marker_m,
                dictionary,
            } => format!(
                "{columns} x {rows} squares of {} mm, markers of {} mm from {}",
                mm(*square_m),
                mm(*marker_m),
                dictionary.name
            ),
            Geometry::AprilGrid {
                columns,
                rows,
                tag_m,
                spacing,
                ..
            } => format!(
                "{columns} x {rows} tags of {} mm, gaps of {} mm",
                mm(*tag_m),
                mm(tag_m * spacing)
            ),
        };
        format!("{what}. Print at 100 %, then measure.")
    }

    /// Returns width and height of the printed area.
    fn size_m(&self) -> [f64; 2] {
        match self.geometry {
            Geometry::Checkerboard {
                columns,
                rows,
                square_m,
            } => [columns + 1, rows + 1].map(|n| n as f64 * square_m),
            Geometry::Charuco {
                columns,
                rows,
                square_m,
                ..
            } => [columns, rows].map(|n| n as f64 * square_m),
            Geometry::AprilGrid {
                columns,
                rows,
                tag_m,
                spacing,
                ..
            } => [columns, rows].map(|n| (n as f64 * (1.0 + spacing) + spacing) * tag_m),
        }
    }

    /// Returns the width of the white margin that detection requires.
    fn quiet_zone_m(&self) -> f64 {
        match self.geometry {
            Geometry::Checkerboard { square_m, .. } | Geometry::Charuco { square_m, .. } => {
                0.5 * square_m
            }
            Geometry::AprilGrid { tag_m, spacing, .. } => spacing * tag_m,
        }
    }

    fn print(&self) -> Print {
        let mut print = Print::default();
        match &self.geometry {
            &Geometry::Checkerboard {
                columns,
                rows,
                square_m,
            } => {
                // The square in the bottom left is dark.
                print.add_squares([columns + 1, rows + 1], square_m, rows % 2);
            }
            Geometry::Charuco {
                columns,
                rows,
                square_m,
                marker_m,
                dictionary,
            } => {
                print.add_squares([*columns, *rows], *square_m, 0);
                let inset_m = 0.5 * (square_m - marker_m);
                for id in 0.. {
                    let Some(square) = self.marker_at(id, false) else {
                        break;
                    };
                    // Squares are counted from the first inner corner.
                    let at_m = square.map(|n| f64::from(n + 1) * square_m + inset_m);
                    print.add_marker(dictionary, id, at_m, *marker_m, self);
                }
            }
            Geometry::AprilGrid {
                columns,
                rows,
                tag_m,
                spacing,
                dictionary,
            } => {
                let gap_m = spacing * tag_m;
                let position_m = |n: usize| n as f64 * (gap_m + tag_m);
                for down in 0..=*rows {
                    for column in 0..=*columns {
                        print
                            .black
                            .push([position_m(column), position_m(down), gap_m, gap_m]);
                    }
                }
                for id in 0..columns * rows {
                    let (column, down) = (id % columns, rows - 1 - id / columns);
                    let at_m = [column, down].map(|n| position_m(n) + gap_m);
                    print.add_marker(dictionary, id, at_m, *tag_m, self);
                }
            }
        }
        print
    }
}

impl Print {
    /// Adds the dark squares of a checkerboard: those with even column + row, counted from the top left, or odd if `odd`
    /// is 1.
    fn add_squares(&mut self, [columns, rows]: [usize; 2], side_m: f64, odd: usize) {
        for down in 0..rows {
            for column in (0..columns).filter(|column| (column + down) % 2 == odd) {
                let [x, y] = [column, down].map(|n| n as f64 * side_m);
                self.black.push([x, y, side_m, side_m]);
            }
        }
    }

    fn add_marker(
        &mut self,
        dictionary: &Dictionary,
        id: usize,
        [x, y]: [f64; 2],
        side_m: f64,
        board: &Board,
    ) {
        self.black.push([x, y, side_m, side_m]);
        let (side, border) = (dictionary.side(), board.marker_borders()[0]);
        let module_m = side_m / (side + 2 * border) as f64;
        for row in 0..side {
            for column in 0..side {
                let (from_row, from_column) = match board.marker_turns() {
                    0 => (row, column),
                    _ => (side - 1 - row, side - 1 - column),
                };
                if dictionary.is_light(id, from_row, from_column) {
                    let [left, top] = [column, row].map(|n| (n + border) as f64 * module_m);
                    self.white.push([x + left, y + top, module_m, module_m]);
                }
            }
        }
    }
}

/// Rounds millimetres to three decimals, which suffices for print.
fn micrometres(mm: f64) -> f64 {
    (mm * 1e3).round() / 1e3
}

/// Returns all rectangles as one path in millimetres, so that there are no seams between neighbours.
fn path(rectangles: &Rectangles) -> String {
    let mut path = String::new();
    for rectangle in rectangles {
        let [x, y, width, height] = rectangle.map(|metres| micrometres(1e3 * metres));
        // Writing to a String cannot fail.
        let _ = write!(path, "M{x} {y}h{width}v{height}h-{width}z");
    }
    path
}
