//! Assignment of lattices to the board: which saddle point is which corner.

use std::collections::BTreeMap;

use pardalis_images::GrayImage;

use super::Board;
use super::error::{BoardNotFound, MIN_MARKERS};
use super::lattice::Lattice;
use super::layout::Placement;
use super::marker::Dictionary;
use super::saddle::Saddle;

/// Saddle points by the index of their corner on the print.
pub(super) type PlacedCorners = BTreeMap<[i32; 2], Saddle>;

/// Places a checkerboard: the only part of a lattice that has all of its corners.
pub(super) fn by_extent(
    board: &Board,
    lattices: &[Lattice],
    saddles: &[Saddle],
) -> Result<PlacedCorners, BoardNotFound> {
    let size = board.corners();
    let [columns, rows] = size.map(|n| n as i32);
    let saddle_at = |lattice: &Lattice, index| lattice.nodes.get(&index).map(|n| saddles[n.saddle]);
    let complete = |lattice: &Lattice, placement: Placement| -> Option<PlacedCorners> {
        (0..rows)
            .flat_map(|y| (0..columns).map(move |x| [x, y]))
            .map(|index| Some((index, saddle_at(lattice, placement.to_lattice(index))?)))
            .collect()
    };
    // Each complete board, and whether the square at its corner 0 is dark.
    let mut boards: Vec<(bool, PlacedCorners)> = Vec::new();
    for lattice in lattices {
        for turns in 0..4 {
            for &corner in lattice.nodes.keys() {
                let placement = Placement::of_corner(turns, corner, [0, 0]);
                if let Some(placed) = complete(lattice, placement) {
                    let first_square = placement.square_to_lattice([0, rows - 2]);
                    boards.push((lattice.is_dark(first_square) == Some(true), placed));
                }
            }
        }
    }
    let Some((_, some)) = boards.first() else {
        return Err(match lattices.first() {
            None => BoardNotFound::NotInView,
            Some(largest) => BoardNotFound::Incomplete {
                columns: size[0],
                rows: size[1],
                found: largest.nodes.len(),
            },
        });
    };
    let outermost = [
        [0, 0],
        [columns - 1, 0],
        [0, rows - 1],
        [columns - 1, rows - 1],
    ];
    let same_corners = |a: &PlacedCorners, b: &PlacedCorners| {
        let among = |p: &[i32; 2]| outermost.iter().any(|q| a[p].pixel == b[q].pixel);
        outermost.iter().all(among)
    };
    if !boards.iter().all(|(_, other)| same_corners(some, other)) {
        return Err(BoardNotFound::Ambiguous {
            columns: size[0],
            rows: size[1],
        });
    }
    let any_dark = boards.iter().any(|&(dark, _)| dark);
    let to_the_right =
        |placed: &PlacedCorners| placed[&[columns - 1, 0]].pixel[0] - placed[&[0, 0]].pixel[0];
    boards
        .into_iter()
        .filter_map(|(dark, placed)| (dark == any_dark).then_some(placed))
        .max_by(|a, b| to_the_right(a).total_cmp(&to_the_right(b)))
        .ok_or(BoardNotFound::NotInView)
}

/// Places lattices by the markers in their squares and omits corners beyond the board.
pub(super) fn by_markers(
    board: &Board,
    dictionary: &Dictionary,
    image: &GrayImage,
    lattices: &[Lattice],
    saddles: &[Saddle],
) -> Result<PlacedCorners, BoardNotFound> {
    let mut placed = PlacedCorners::new();
    let mut most_votes = 0;
    for lattice in lattices {
        let (votes, placement) = vote(board, dictionary, image, lattice, saddles);
        most_votes = most_votes.max(votes);
        let Some(placement) = placement else { continue };
        for (&index, node) in &lattice.nodes {
            let index = placement.to_print(index);
            if board.corner_at(index).is_some() {
                // Lattices are ordered by size: the larger one takes precedence.
                placed.entry(index).or_insert(saddles[node.saddle]);
            }
        }
    }
    if !placed.is_empty() {
        return Ok(placed);
    }
    Err(match (lattices.first(), most_votes) {
        (None, _) => BoardNotFound::NotInView,
        (Some(largest), 0) => BoardNotFound::NoMarkers {
            corners: largest.nodes.len(),
            dictionary: dictionary.name,
        },
        _ => BoardNotFound::TooFewMarkers,
    })
}

/// Returns the number of markers that agree on the most frequent placement of a lattice, and that placement if the
/// agreement suffices.
fn vote(
    board: &Board,
    dictionary: &Dictionary,
    image: &GrayImage,
    lattice: &Lattice,
    saddles: &[Saddle],
) -> (usize, Option<Placement>) {
    // Votes also distinguish the border's width and the pattern: a print has one of each.
    let mut votes: BTreeMap<(Placement, usize, bool), usize> = BTreeMap::new();
    for &square in lattice.nodes.keys() {
        if lattice.is_dark(square) != Some(board.markers_are_dark()) {
            continue;
        }
        let [x, y] = square;
        let around = [[x, y], [x + 1, y], [x + 1, y + 1], [x, y + 1]].map(|index| {
            let node = lattice.nodes.get(&index)?;
            Some(saddles[node.saddle].pixel)
        });
        let [Some(a), Some(b), Some(c), Some(d)] = around else {
            continue;
        };
        for &border in board.marker_borders() {
            let fraction = board.marker_fraction();
            let Some(reading) = dictionary.read(image, [a, b, c, d], fraction, border) else {
                continue;
            };
            let turns = (reading.turns + board.marker_turns()) % 4;
            for &old_pattern in board.patterns() {
                if let Some(printed) = board.marker_at(reading.id, old_pattern) {
                    let placement = Placement::of_square(turns, square, printed);
                    *votes.entry((placement, border, old_pattern)).or_default() += 1;
                }
            }
        }
    }
    let Some((&(placement, ..), &most)) = votes.iter().max_by_key(|(_, count)| **count) else {
        return (0, None);
    };
    let others = votes.iter().filter(|((other, ..), _)| *other != placement);
    let second = others.map(|(_, &count)| count).max().unwrap_or(0);
    let agreed = most >= MIN_MARKERS && most > second;
    (most, agreed.then_some(placement))
}
