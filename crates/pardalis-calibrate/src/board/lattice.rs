//! Lattices: saddle points linked along the edges of squares.
//!
//! Each link is judged locally, so that lenses may bend the board.

use std::collections::{BTreeMap, VecDeque};

use pardalis_images::GrayImage;

use super::saddle::{Saddle, brightness};

/// Greatest angle between the direction of an edge at its ends and the line between them.
const MAX_TURN_RAD: f64 = 0.35;

/// Number of nearest saddle points in a direction that are tried.
const MAX_TRIES: usize = 6;

/// A neighbour along an edge: index of its saddle point, and of the direction that leads back.
type Link = Option<(usize, usize)>;

/// Saddle points on an integer lattice. In the image, the second axis is a clockwise quarter turn from the first.
#[derive(Debug)]
pub(super) struct Lattice {
    /// Saddle points by their index in the lattice.
    pub(super) nodes: BTreeMap<[i32; 2], Node>,
}

/// A saddle point of a lattice.
#[derive(Debug, Clone, Copy)]
pub(super) struct Node {
    /// Index among all saddle points.
    pub(super) saddle: usize,
    /// Index of the saddle point's direction along the lattice's first axis.
    first_direction: usize,
}

impl Lattice {
    /// Reports whether the square whose corner with the least coordinates this is, is dark; `None` if the lattice lacks
    /// that corner.
    pub(super) fn is_dark(&self, corner: [i32; 2]) -> Option<bool> {
        self.nodes
            .get(&corner)
            .map(|node| node.first_direction % 2 == 0)
    }
}

/// Links saddle points to lattices, the largest first. Lattices of fewer than four points are omitted.
pub(super) fn grow(image: &GrayImage, saddles: &[Saddle]) -> Vec<Lattice> {
    let links = closed(&link(image, saddles));
    let mut seen = vec![false; saddles.len()];
    let mut lattices = Vec::new();
    for seed in 0..saddles.len() {
        if !seen[seed] {
            let lattice = grow_from(seed, &links, &mut seen);
            if lattice.nodes.len() >= 4 {
                lattices.push(lattice);
            }
        }
    }
    lattices.sort_by_key(|lattice| std::cmp::Reverse(lattice.nodes.len()));
    lattices
}

/// Returns the lattice of all saddle points that are connected with one.
fn grow_from(seed: usize, links: &[[Link; 4]], seen: &mut [bool]) -> Lattice {
    let mut nodes = BTreeMap::new();
    let mut queue = VecDeque::from([([0, 0], seed, 0)]);
    seen[seed] = true;
    while let Some((index, saddle, first_direction)) = queue.pop_front() {
        let node = Node {
            saddle,
            first_direction,
        };
        // After a false link two points may get the same index: the one reached in fewer steps keeps it.
        if nodes.contains_key(&index) {
            continue;
        }
        nodes.insert(index, node);
        for side in 0..4 {
            let Some((next, back)) = links[saddle][(side + first_direction) % 4] else {
                continue;
            };
            if seen[next] {
                continue;
            }
            seen[next] = true;
            let step = [[1, 0], [0, 1], [-1, 0], [0, -1]][side];
            let next_index = [index[0] + step[0], index[1] + step[1]];
            queue.push_back((next_index, next, (back + 6 - side) % 4));
        }
    }
    Lattice { nodes }
}

/// Returns the mutual neighbours of each saddle point in its four directions.
fn link(image: &GrayImage, saddles: &[Saddle]) -> Vec<[Link; 4]> {
    let chosen: Vec<[Link; 4]> = (0..saddles.len())
        .map(|from| choose(image, saddles, from))
        .collect();
    let mutual = |from: usize, direction: usize| {
        chosen[from][direction].filter(
            |&(to, back)| matches!(chosen[to][back], Some((f, d)) if f == from && d == direction),
        )
    };
    (0..saddles.len())
        .map(|from| std::array::from_fn(|direction| mutual(from, direction)))
        .collect()
}

/// Keeps the links that are sides of a square of four links; false links hardly ever close a square.
fn closed(links: &[[Link; 4]]) -> Vec<[Link; 4]> {
    // Four steps with a turn to the same side after each lead back to the start.
    let closes = |from: usize, direction: usize, turn: usize| {
        let mut at = Some((from, direction));
        for _ in 0..4 {
            at = at.and_then(|(saddle, direction)| links[saddle][direction]);
            at = at.map(|(saddle, back)| (saddle, (back + turn) % 4));
        }
        at == Some((from, direction))
    };
    let kept = |from: usize, direction: usize| {
        links[from][direction].filter(|_| closes(from, direction, 1) || closes(from, direction, 3))
    };
    (0..links.len())
        .map(|from| std::array::from_fn(|direction| kept(from, direction)))
        .collect()
}

/// Returns, for each direction, the nearest saddle point to which an edge leads.
fn choose(image: &GrayImage, saddles: &[Saddle], from: usize) -> [Link; 4] {
    let start = saddles[from];
    let mut candidates: [Vec<(f64, usize)>; 4] = Default::default();
    let axes = start
        .directions_rad
        .map(|angle| [libm::cos(angle), libm::sin(angle)]);
    let cos_max = libm::cos(MAX_TURN_RAD);
    for (to, end) in saddles.iter().enumerate() {
        let [dx, dy] = [end.pixel[0] - start.pixel[0], end.pixel[1] - start.pixel[1]];
        let distance = libm::hypot(dx, dy);
        if distance < 3.0 {
            continue;
        }
        for direction in 0..4 {
            if axes[direction][0] * dx + axes[direction][1] * dy > cos_max * distance {
                candidates[direction].push((distance, to));
            }
        }
    }
    std::array::from_fn(|direction| {
        let near = &mut candidates[direction];
        near.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
        near.iter()
            .take(MAX_TRIES)
            .find_map(|&(_, to)| Some((to, edge(image, start, direction, saddles[to])?)))
    })
}

/// Checks whether the edge of a square connects one saddle point, in one of its directions, with another. Returns the
/// direction of the other that leads back.
fn edge(image: &GrayImage, start: Saddle, direction: usize, end: Saddle) -> Option<usize> {
    let [dx, dy] = [end.pixel[0] - start.pixel[0], end.pixel[1] - start.pixel[1]];
    let length = libm::hypot(dx, dy);
    let back = (0..4).find(|&back| {
        let angle = end.directions_rad[back];
        -(libm::cos(angle) * dx + libm::sin(angle) * dy) > libm::cos(MAX_TURN_RAD) * length
    })?;
    // The same side of the edge must be dark at both ends.
    if (direction + back).is_multiple_of(2) {
        return None;
    }
    // The samples beside the edge must be nearer to it than the markers in the squares are.
    let beside_px = (0.08 * length).max(1.5);
    let normal = [-dy / length * beside_px, dx / length * beside_px];
    let sign = if direction.is_multiple_of(2) {
        1.0
    } else {
        -1.0
    };
    let steps = [0.2, 0.35, 0.5, 0.65, 0.8].map(|t| {
        let at = [start.pixel[0] + t * dx, start.pixel[1] + t * dy];
        let light = brightness(image, [at[0] - normal[0], at[1] - normal[1]]);
        let dark = brightness(image, [at[0] + normal[0], at[1] + normal[1]]);
        sign * (light - dark)
    });
    let least = steps.into_iter().fold(f64::MAX, f64::min);
    let most = steps.into_iter().fold(f64::MIN, f64::max);
    (least >= 5.0 && least >= 0.25 * most).then_some(back)
}
