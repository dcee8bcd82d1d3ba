//! The views of a board that is moved by hand before a camera: which of them add something to a calibration.

use std::collections::BTreeMap;

use super::Corner;

/// The most views: further ones hardly change a calibration, and make it slow.
const MAX_VIEWS: usize = 40;

/// The greatest speed in the image of a board that is held still, in diagonals of the image per second. Hand-set: a hand trembles by less, and a rolling
/// shutter distorts the board by a fraction of a pixel.
const MAX_SPEED_PER_S: f64 = 0.02;

/// Frames farther apart than this, in seconds, are pictures of their own, between which the board may be anywhere.
const MAX_STEP_S: f64 = 0.5;

/// The greatest width of edges in a sharp image, as a share of the image's diagonal, and in pixels. Hand-set.
const MAX_EDGE_WIDTH: f64 = 0.003;
const MAX_EDGE_WIDTH_PX: f64 = 2.0;

/// A board at another place by this share of the diagonal, or whose image has another shape by this share of its size, adds something. Hand-set: the
/// shape changes by as much if the board is tilted by 30 degrees or comes nearer by a fifth.
const NEW_PLACE: f64 = 0.1;
const NEW_SHAPE: f64 = 0.15;

/// A board is tilted if one direction appears shortened by at least this factor relative to the other, as at 25 degrees.
const TILTED: f64 = 0.906;

/// The reason why a view was not added.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, thiserror::Error)]
#[non_exhaustive]
pub enum NotAdded {
    /// The board was elsewhere in the frame before.
    #[error("the board moves; hold it still for a moment")]
    Moving,
    /// The edges of the squares are wide.
    #[error("the board is blurred; hold it still, add light, or focus the camera")]
    Blurred,
    /// The board looked like this before.
    #[error("the board was seen like this before; move it, or tilt it")]
    Alike,
    /// There are enough views.
    #[error("there are enough views")]
    Full,
}

/// Views of a board, each of which adds something to those before.
///
/// A view is added if the board is at rest, sharp, and at another place, nearer or farther, or tilted otherwise than in every view before.
#[derive(Debug, Clone, Default)]
pub struct Collection {
    size_px: (usize, usize),
    views: Vec<Vec<Corner>>,
    last: Option<(f64, Vec<Corner>)>,
}

impl Collection {
    /// Begins a collection of views in images of this width and height in pixels.
    pub fn new(size_px: (usize, usize)) -> Self {
        Self {
            size_px,
            ..Self::default()
        }
    }

    /// Adds the corners of the board in a frame if they add something. `time_s` is the time of the frame in seconds.
    ///
    /// # Errors
    ///
    /// The view does not add anything, or is not good enough.
    pub fn offer(&mut self, time_s: f64, corners: &[Corner]) -> Result<(), NotAdded> {
        let diagonal_px = self.diagonal_px();
        let before = self.last.replace((time_s, corners.to_vec()));
        let verdict = if self.views.len() >= MAX_VIEWS {
            Err(NotAdded::Full)
        } else if before.is_some_and(|(before_s, before)| {
            let step_s = time_s - before_s;
            let is_near = step_s > 0.0 && step_s <= MAX_STEP_S;
            is_near && mean_distance_px(&before, corners) > MAX_SPEED_PER_S * diagonal_px * step_s
        }) {
            Err(NotAdded::Moving)
        } else if edge_width_px(corners) > MAX_EDGE_WIDTH_PX.max(MAX_EDGE_WIDTH * diagonal_px) {
            Err(NotAdded::Blurred)
        } else if self
            .views
            .iter()
            .any(|view| are_alike(view, corners, diagonal_px))
        {
            Err(NotAdded::Alike)
        } else {
            Ok(())
        };
        if verdict.is_ok() {
            self.views.push(corners.to_vec());
        }
        verdict
    }

    /// Adds the corners of the board in a picture that somebody took for the calibration, whatever it adds.
    pub fn add(&mut self, corners: &[Corner]) {
        self.views.push(corners.to_vec());
    }

    /// Returns the width and height of the images in pixels.
    pub fn size_px(&self) -> (usize, usize) {
        self.size_px
    }

    /// Returns the corners of each view that was added.
    pub fn views(&self) -> &[Vec<Corner>] {
        &self.views
    }

    /// Returns the number of views in which the board is clearly tilted, without which the focal length is not determined.
    pub fn tilted_count(&self) -> usize {
        let is_tilted = |view: &&Vec<Corner>| foreshortening(view) < TILTED;
        self.views.iter().filter(is_tilted).count()
    }

    fn diagonal_px(&self) -> f64 {
        libm::hypot(self.size_px.0 as f64, self.size_px.1 as f64)
    }
}

/// Returns the pixels of the corners that two views share.
fn shared(a: &[Corner], b: &[Corner]) -> Vec<([f64; 2], [f64; 2])> {
    let of_b: BTreeMap<usize, [f64; 2]> = b.iter().map(|c| (c.id, c.pixel)).collect();
    a.iter()
        .filter_map(|corner| Some((corner.pixel, *of_b.get(&corner.id)?)))
        .collect()
}

/// Returns the mean distance between the corners of two views; infinite if they share none.
fn mean_distance_px(a: &[Corner], b: &[Corner]) -> f64 {
    let pairs = shared(a, b);
    if pairs.is_empty() {
        return f64::INFINITY;
    }
    let sum: f64 = pairs
        .iter()
        .map(|([u, v], [x, y])| libm::hypot(x - u, y - v))
        .sum();
    sum / pairs.len() as f64
}

/// Returns the median width of edges.
fn edge_width_px(corners: &[Corner]) -> f64 {
    let mut widths: Vec<f64> = corners.iter().map(|corner| corner.edge_width_px).collect();
    widths.sort_by(f64::total_cmp);
    widths.get(widths.len() / 2).copied().unwrap_or(0.0)
}

/// Reports whether two views show the board at about the same place with about the same shape.
fn are_alike(a: &[Corner], b: &[Corner], diagonal_px: f64) -> bool {
    let pairs = shared(a, b);
    if 2 * pairs.len() < a.len().max(b.len()) {
        return false;
    }
    let [from, to] = [
        mean(pairs.iter().map(|p| p.0)),
        mean(pairs.iter().map(|p| p.1)),
    ];
    let place = libm::hypot(to[0] - from[0], to[1] - from[1]) / diagonal_px;
    let (mut change, mut extent) = (0.0, 0.0);
    for ([u, v], [x, y]) in &pairs {
        let ([u, v], [x, y]) = ([u - from[0], v - from[1]], [x - to[0], y - to[1]]);
        change += (x - u).powi(2) + (y - v).powi(2);
        extent += u * u + v * v;
    }
    let shape = (change / extent).sqrt();
    place / NEW_PLACE + shape / NEW_SHAPE < 1.0
}

fn mean(points: impl Iterator<Item = [f64; 2]>) -> [f64; 2] {
    let (mut sum, mut count) = ([0.0; 2], 0.0);
    for [u, v] in points {
        sum = [sum[0] + u, sum[1] + v];
        count += 1.0;
    }
    sum.map(|value| value / count)
}

/// Returns by how much the board appears shortened in one direction relative to the other: 1 if it faces the camera, and the cosine of its tilt if it is
/// far away.
fn foreshortening(corners: &[Corner]) -> f64 {
    let board = mean(corners.iter().map(|c| [c.board_m[0], c.board_m[1]]));
    let image = mean(corners.iter().map(|c| c.pixel));
    // The affine map from the board to the image, by least squares.
    let (mut of_board, mut across) = ([0.0; 3], [[0.0; 2]; 2]);
    for corner in corners {
        let [x, y] = [corner.board_m[0] - board[0], corner.board_m[1] - board[1]];
        let [u, v] = [corner.pixel[0] - image[0], corner.pixel[1] - image[1]];
        of_board = [
            of_board[0] + x * x,
            of_board[1] + x * y,
            of_board[2] + y * y,
        ];
        for (row, at) in across.iter_mut().zip([u, v]) {
            *row = [row[0] + at * x, row[1] + at * y];
        }
    }
    let [xx, xy, yy] = of_board;
    let map = across.map(|[x, y]| [x * yy - y * xy, y * xx - x * xy]);
    // Its singular values are half the sum and half the difference of these.
    let sum = libm::hypot(map[0][0] + map[1][1], map[1][0] - map[0][1]);
    let difference = libm::hypot(map[0][0] - map[1][1], map[1][0] + map[0][1]);
    (sum - difference).abs() / (sum + difference)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The corners of a board of 5 x 4 squares of 40 pixels, shortened in one direction, at a place in an image of 640 x 480.
    fn board([u, v]: [f64; 2], shortened: f64, edge_width_px: f64) -> Vec<Corner> {
        let corner = |id: usize| {
            let [x, y] = [(id % 5) as f64, (id / 5) as f64];
            Corner {
                id,
                board_m: [0.03 * x, 0.03 * y, 0.0],
                pixel: [u + 40.0 * shortened * x, v - 40.0 * y],
                edge_width_px,
            }
        };
        (0..20).map(corner).collect()
    }

    #[test]
    fn views_that_differ_are_added_and_others_are_not_with_the_reason() {
        let mut all = Collection::new((640, 480));
        assert_eq!(all.offer(1.0, &board([100.0, 300.0], 1.0, 1.0)), Ok(()));
        // Trembling, at 13 pixels per second, and with a speed of 25.
        let trembling = board([100.5, 300.0], 1.0, 1.0);
        assert_eq!(all.offer(1.04, &trembling), Err(NotAdded::Alike));
        let moving = board([101.5, 300.0], 1.0, 1.0);
        assert_eq!(all.offer(1.08, &moving), Err(NotAdded::Moving));
        // Elsewhere: first on the way, then at rest.
        let elsewhere = board([400.0, 300.0], 1.0, 1.0);
        assert_eq!(all.offer(1.2, &elsewhere), Err(NotAdded::Moving));
        assert_eq!(all.offer(1.3, &elsewhere), Ok(()));
        // Pictures of their own may be anywhere.
        let third = board([100.0, 470.0], 1.0, 1.0);
        assert_eq!(all.offer(2.3, &third), Ok(()));
        assert_eq!(all.offer(3.3, &third), Err(NotAdded::Alike));
        let blurred = board([400.0, 470.0], 1.0, 2.5);
        assert_eq!(all.offer(4.3, &blurred), Err(NotAdded::Blurred));
        assert_eq!(all.tilted_count(), 0);
        // At the same place, but tilted.
        let tilted = board([100.0 + 16.0, 470.0], 0.8, 1.0);
        assert_eq!(all.offer(5.3, &tilted), Ok(()));
        assert_eq!(all.tilted_count(), 1);
        assert_eq!(all.views().len(), 4);
    }

    #[test]
    fn a_turned_board_is_not_a_tilted_one() {
        let (sin, cos) = libm::sincos(0.7);
        let turned = |shortened: f64| -> Vec<Corner> {
            let mut corners = board([0.0, 0.0], shortened, 1.0);
            for corner in &mut corners {
                let [u, v] = corner.pixel;
                corner.pixel = [cos * u - sin * v, sin * u + cos * v];
            }
            corners
        };
        for shortened in [1.0, 0.9, 0.5] {
            let found = foreshortening(&turned(shortened));
            assert!((found - shortened).abs() < 1e-9, "{found}");
        }
    }

    #[test]
    fn the_number_of_views_is_bounded() {
        let mut all = Collection::new((100_000, 100_000));
        let at = |number: u32| board([20_000.0 * f64::from(number), 300.0], 1.0, 1.0);
        for number in 0..40 {
            assert_eq!(all.offer(f64::from(number), &at(number)), Ok(()));
        }
        assert_eq!(all.offer(40.0, &at(40)), Err(NotAdded::Full));
        assert_eq!(all.views().len(), 40);
    }
}
