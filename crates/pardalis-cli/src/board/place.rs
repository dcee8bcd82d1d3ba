//! Lattices laid onto the print of a board: which corner is which.

use std::collections::BTreeMap;

use pardalis_images::GrayImage;

use super::Board;
use super::lattice::Lattice;
use super::layout::Placement;
use super::marker::Dictionary;
use super::saddle::Saddle;

/// Markers that must agree on where the board lies.
const MIN_MARKERS: usize = 2;

/// Corners by their place on the print, with their saddle points.
pub(crate) type Placed = BTreeMap<[i32; 2], Saddle>;

/// Places a checkerboard: the one part of a lattice that has all of its corners.
pub(crate) fn by_extent(
    board: &Board,
    lattices: &[Lattice],
    saddles: &[Saddle],
) -> Result<Placed, String> {
    let [columns, rows] = board.corners().map(|n| n as i32);
    let saddle_at = |lattice: &Lattice, place| lattice.nodes.get(&place).map(|n| saddles[n.saddle]);
    let whole = |lattice: &Lattice, placement: Placement| -> Option<Placed> {
        (0..rows)
            .flat_map(|y| (0..columns).map(move |x| [x, y]))
            .map(|place| Some((place, saddle_at(lattice, placement.to_lattice(place))?)))
            .collect()
    };
    // Each whole board with whether the square at its first corner is dark.
    let mut boards: Vec<(bool, Placed)> = Vec::new();
    for lattice in lattices {
        for turns in 0..4 {
            for &corner in lattice.nodes.keys() {
                let placement = Placement::of_corner(turns, corner, [0, 0]);
                if let Some(placed) = whole(lattice, placement) {
                    let first_square = placement.square_to_lattice([0, rows - 2]);
                    boards.push((lattice.is_dark(first_square) == Some(true), placed));
                }
            }
        }
    }
    let Some((_, some)) = boards.first() else {
        return Err(match lattices.first() {
            None => format!("no checkerboard of {columns} x {rows} inner corners is in view"),
            Some(largest) => format!(
                "the whole board of {columns} x {rows} inner corners must be in view; the largest part found has {}",
                largest.nodes.len()
            ),
        });
    };
    let corner_of_print = [
        [0, 0],
        [columns - 1, 0],
        [0, rows - 1],
        [columns - 1, rows - 1],
    ];
    let same_corners = |a: &Placed, b: &Placed| {
        let among = |p: &[i32; 2]| corner_of_print.iter().any(|q| a[p].pixel == b[q].pixel);
        corner_of_print.iter().all(among)
    };
    if !boards.iter().all(|(_, other)| same_corners(some, other)) {
        return Err(format!(
            "several parts could be the board of {columns} x {rows} inner corners; count the corners again, and show one board only"
        ));
    }
    let any_dark = boards.iter().any(|&(dark, _)| dark);
    let to_the_right =
        |placed: &Placed| placed[&[columns - 1, 0]].pixel[0] - placed[&[0, 0]].pixel[0];
    boards
        .into_iter()
        .filter_map(|(dark, placed)| (dark == any_dark).then_some(placed))
        .max_by(|a, b| to_the_right(a).total_cmp(&to_the_right(b)))
        .ok_or_else(|| "no board is in view".into())
}

/// Places lattices by the markers in their squares; corners beyond the board are left out.
pub(crate) fn by_markers(
    board: &Board,
    dictionary: &Dictionary,
    image: &GrayImage,
    lattices: &[Lattice],
    saddles: &[Saddle],
) -> Result<Placed, String> {
    let mut placed = Placed::new();
    let mut most_votes = 0;
    for lattice in lattices {
        let (votes, placement) = vote(board, dictionary, image, lattice, saddles);
        most_votes = most_votes.max(votes);
        let Some(placement) = placement else { continue };
        for (&place, node) in &lattice.nodes {
            let place = placement.to_print(place);
            if board.corner_at(place).is_some() {
                // Lattices stand in the order of their size: the larger one is trusted.
                placed.entry(place).or_insert(saddles[node.saddle]);
            }
        }
    }
    if !placed.is_empty() {
        return Ok(placed);
    }
    Err(match (lattices.first(), most_votes) {
        (None, _) => "no board is in view".into(),
        (Some(largest), 0) => format!(
            "a lattice of {} corners is in view, but none of the board's markers ({}) could be read in it",
            largest.nodes.len(),
            dictionary.name
        ),
        _ => format!(
            "fewer than {MIN_MARKERS} of the board's markers agree on where it lies; check the board's columns, rows and dictionary"
        ),
    })
}

/// The placement on which most of a lattice's markers agree, if they are enough, and how many they are.
fn vote(
    board: &Board,
    dictionary: &Dictionary,
    image: &GrayImage,
    lattice: &Lattice,
    saddles: &[Saddle],
) -> (usize, Option<Placement>) {
    // By the border's width and the pattern as well: one print has one of each.
    let mut votes: BTreeMap<(Placement, usize, bool), usize> = BTreeMap::new();
    for &least in lattice.nodes.keys() {
        if lattice.is_dark(least) != Some(board.markers_are_dark()) {
            continue;
        }
        let [x, y] = least;
        let around = [[x, y], [x + 1, y], [x + 1, y + 1], [x, y + 1]].map(|place| {
            let node = lattice.nodes.get(&place)?;
            Some(saddles[node.saddle].pixel)
        });
        let [Some(a), Some(b), Some(c), Some(d)] = around else {
            continue;
        };
        for &border in board.marker_borders() {
            let share = board.marker_share();
            let Some(reading) = dictionary.read(image, [a, b, c, d], share, border) else {
                continue;
            };
            let turns = (reading.turns + board.marker_turns()) % 4;
            for &old_pattern in board.patterns() {
                if let Some(square) = board.marker_at(reading.id, old_pattern) {
                    let placement = Placement::of_square(turns, least, square);
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
