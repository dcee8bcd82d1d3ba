//! A rectangle of tape as it must be seen, fitted to the pixels on and around it.
//!
//! Across a side an image shows the tape as a box between its two edges, blurred by the lens and by the pixels. The steepest places of such a profile
//! are not the tape's edges where the tape is thin for the blur, nor where the image is saturated: tape that is brighter than white seems wider than it
//! is. Here the profile is fitted whole; where a pixel is saturated, the light was at least that. How bright the tape really is, its soft edges tell,
//! and its width: one along each two opposite sides, so that perspective makes far ones thinner.

use nalgebra::{DMatrix, DVector};
use pardalis_calibrate::plane::{PointPair, fit};
use pardalis_camera::Homography;

use super::sides::{Light, Measured};

/// How far from the tape pixels count.
const REACH_PX: f64 = 4.0;

/// Residuals in levels of light, of 255, beyond which pixels are of something else, and count less.
const OUTLIER_LEVELS: f64 = 6.0;

/// How much light that is saturated changes along a side and from one to the next, in levels. One such difference weighs like one pixel.
const UNEVEN_LEVELS: f64 = 0.25;

/// How much brighter than it seems light that is saturated is thought to be at first, as a share.
const HIDDEN_SHARE: f64 = 0.2;

/// The blur's standard deviation to start from, beside that of the pixels themselves, and the least.
const BLUR_PX: f64 = 0.5;
const MIN_BLUR_PX: f64 = 0.05;

/// The most that corners may be away from where the steepest places put them.
const MAX_MOVE_PX: f64 = 1.5;

/// Steps that move no corner farther than this are the last, or this many.
const STILL_PX: f64 = 1e-4;
const MAX_STEPS: usize = 30;

/// Numbers that all sides share: the outer corners, how wide the tape is, as shares of the rectangle's two lengths, and the blur in pixels; and by how
/// much they are changed to see what that does.
const SHARED: usize = 11;
const SHARED_STEPS: [f64; SHARED] = [
    1e-3, 1e-3, 1e-3, 1e-3, 1e-3, 1e-3, 1e-3, 1e-3, 1e-5, 1e-5, 1e-3,
];

/// Numbers of each side: the levels of light of the tape, outside and inside of it, at its start, then at its end.
const LEVELS: usize = 6;
const ZONES: usize = 3;

/// The corners of the rectangle on the floor, in its own lengths.
const SQUARE: [[f64; 2]; 4] = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];

type Corners = [[f64; 2]; 4];

/// Fits a tape to an image, from where its edges (corners counter-clockwise to the eye, in the same order) were measured in it: the corners of the outer
/// and of the inner edge. None where this leads elsewhere.
pub(super) fn fitted(
    image: &Light,
    is_saturated: impl Fn(u32, u32) -> bool,
    outer: &Measured,
    inner: &Measured,
) -> Option<[Corners; 2]> {
    let start = [outer.corners_px, inner.corners_px];
    let mut sides: [Vec<Pixel>; 4] = Default::default();
    for (x, y, light) in image.enumerate_pixels() {
        let center_px = [f64::from(x), f64::from(y)];
        for (side, pixels) in sides.iter_mut().enumerate() {
            let [outer_px, inner_px] = start.map(|corners| inwards(corners, side, center_px).0);
            let is_seen = || outer.is_seen(side, center_px) && inner.is_seen(side, center_px);
            if outer_px > -REACH_PX && inner_px < REACH_PX && is_seen() {
                pixels.push(Pixel {
                    center_px,
                    light: f64::from(light[0]),
                    is_saturated: is_saturated(x, y),
                });
            }
        }
    }
    let (tape, numbers) = Tape::new(sides, start)?;
    let edges = edges(&tape.solved(numbers)?)?;
    let mut moved = start.iter().flatten().zip(edges.iter().flatten());
    let is_near = |(a, b): (&[f64; 2], &[f64; 2])| (a[0] - b[0]).hypot(a[1] - b[1]) <= MAX_MOVE_PX;
    moved.all(is_near).then_some(edges)
}

/// How far a point lies inwards of a side, in pixels, and where along it, as a share of its length.
fn inwards(corners_px: Corners, side: usize, p: [f64; 2]) -> (f64, f64) {
    let [from, to] = [corners_px[side], corners_px[(side + 1) % 4]];
    let step = [to[0] - from[0], to[1] - from[1]];
    let offset = [p[0] - from[0], p[1] - from[1]];
    let length_px = step[0].hypot(step[1]);
    // Counter-clockwise to the eye, the inside is on the left hand.
    (
        (step[1] * offset[0] - step[0] * offset[1]) / length_px,
        (step[0] * offset[0] + step[1] * offset[1]) / (length_px * length_px),
    )
}

/// How the rectangle's own lengths are seen, by its outer corners.
fn floor(outer_px: Corners) -> Option<Homography> {
    let pairs = [0, 1, 2, 3].map(|i| PointPair {
        pixel: outer_px[i],
        plane_m: SQUARE[i],
    });
    fit(&pairs).ok().map(|found| found.homography)
}

/// The corners of the outer and of the inner edge that these numbers describe.
fn edges(numbers: &DVector<f64>) -> Option<[Corners; 2]> {
    let outer_px = [0, 1, 2, 3].map(|i| [numbers[2 * i], numbers[2 * i + 1]]);
    let floor = floor(outer_px)?;
    let corner = |i: usize| {
        let inset = |c: usize| SQUARE[i][c] + (1.0 - 2.0 * SQUARE[i][c]) * numbers[8 + c];
        floor.pixel_of([inset(0), inset(1)])
    };
    Some([outer_px, [corner(0)?, corner(1)?, corner(2)?, corner(3)?]])
}

/// The share of what lies inwards of an edge in the light of a pixel so far inwards of it: a blurred step, averaged over a pixel's length.
fn share_inwards(distance_px: f64, blur_px: f64) -> f64 {
    use std::f64::consts::{FRAC_1_SQRT_2, PI};
    let integral = |x: f64| {
        let sigmas = x / blur_px;
        let below = 0.5 * libm::erfc(-sigmas * FRAC_1_SQRT_2);
        x * below + blur_px * libm::exp(-0.5 * sigmas * sigmas) / (2.0 * PI).sqrt()
    };
    integral(distance_px + 0.5) - integral(distance_px - 0.5)
}

/// A pixel on or beside the tape.
#[derive(Debug, Clone, Copy)]
struct Pixel {
    center_px: [f64; 2],
    light: f64,
    /// Whether the light was this or more.
    is_saturated: bool,
}

/// What is known of a tape.
struct Tape {
    /// The pixels around each side.
    sides: [Vec<Pixel>; 4],
    /// For each side and zone (the tape, outside, inside) the share of pixels that are saturated.
    saturated: [[f64; ZONES]; 4],
}

impl Tape {
    /// The pixels around the sides, and the numbers to start from; none where a side is not seen.
    fn new(
        sides: [Vec<Pixel>; 4],
        [outer_px, inner_px]: [Corners; 2],
    ) -> Option<(Self, DVector<f64>)> {
        let floor = floor(outer_px)?;
        let mut numbers = DVector::zeros(SHARED + 4 * LEVELS);
        for i in 0..4 {
            let inside = floor.plane_of(inner_px[i])?;
            for c in 0..2 {
                numbers[2 * i + c] = outer_px[i][c];
                numbers[8 + c] += 0.25 * (inside[c] - SQUARE[i][c]).abs();
            }
        }
        numbers[10] = BLUR_PX;
        let mut saturated = [[0.0; ZONES]; 4];
        for (side, pixels) in sides.iter().enumerate() {
            let zone_of = |pixel: &&Pixel| {
                let is_inwards = |corners| inwards(corners, side, pixel.center_px).0 > 0.0;
                match (is_inwards(outer_px), is_inwards(inner_px)) {
                    (true, false) => 0,
                    (false, _) => 1,
                    (true, true) => 2,
                }
            };
            for zone in 0..ZONES {
                let within: Vec<&Pixel> = pixels.iter().filter(|p| zone_of(p) == zone).collect();
                if within.is_empty() {
                    return None;
                }
                let mean = |value: fn(&Pixel) -> f64| {
                    within.iter().map(|p| value(p)).sum::<f64>() / within.len() as f64
                };
                let share = mean(|pixel| f64::from(u8::from(pixel.is_saturated)));
                let level = mean(|pixel| pixel.light) * (1.0 + HIDDEN_SHARE * share);
                saturated[side][zone] = share;
                for end in 0..2 {
                    numbers[level_at(side, end, zone)] = level;
                }
            }
        }
        Some((Self { sides, saturated }, numbers))
    }

    /// For each pixel of a side, how much of each of the side's levels it shows.
    fn shares(
        &self,
        side: usize,
        [outer_px, inner_px]: [Corners; 2],
        blur_px: f64,
    ) -> Vec<[f64; LEVELS]> {
        let of = |pixel: &Pixel| {
            let (distance_px, along) = inwards(outer_px, side, pixel.center_px);
            let past_outer = share_inwards(distance_px, blur_px);
            let past_inner = share_inwards(inwards(inner_px, side, pixel.center_px).0, blur_px);
            let zones = [past_outer - past_inner, 1.0 - past_outer, past_inner];
            let at = |i: usize| {
                let end = if i < ZONES { 1.0 - along } else { along };
                end * zones[i % ZONES]
            };
            [at(0), at(1), at(2), at(3), at(4), at(5)]
        };
        self.sides[side].iter().map(of).collect()
    }

    /// The shares of all sides; none where the numbers describe no tape.
    fn all_shares(&self, numbers: &DVector<f64>) -> Option<[Vec<[f64; LEVELS]>; 4]> {
        let edges = edges(numbers)?;
        let blur_px = numbers[10].hypot(MIN_BLUR_PX);
        Some([0, 1, 2, 3].map(|side| self.shares(side, edges, blur_px)))
    }

    /// Differences between levels next to each other around the tape, which are small where they are saturated: both numbers, and what the difference
    /// weighs.
    fn ties(&self) -> impl Iterator<Item = (usize, usize, f64)> {
        let of = |i: usize| {
            let (zone, side, end) = (i / 8, i / 2 % 4, i % 2);
            let next = if end == 0 { side } else { (side + 1) % 4 };
            let weight = (self.saturated[side][zone] * self.saturated[next][zone]).sqrt();
            let pair = [level_at(side, end, zone), level_at(next, 1 - end, zone)];
            (pair[0], pair[1], weight / UNEVEN_LEVELS)
        };
        (0..8 * ZONES).map(of)
    }

    /// Half the sum of squares of all residuals, those of outliers as Huber weighs them.
    fn cost(&self, numbers: &DVector<f64>, shares: &[Vec<[f64; LEVELS]>; 4]) -> f64 {
        let mut cost = 0.0;
        for side in 0..4 {
            for (pixel, shares) in self.sides[side].iter().zip(&shares[side]) {
                let size = pixel.residual(light(shares, side, numbers)).abs();
                cost += if size <= OUTLIER_LEVELS {
                    0.5 * size * size
                } else {
                    OUTLIER_LEVELS * (size - 0.5 * OUTLIER_LEVELS)
                };
            }
        }
        let tie = |(a, b, weight): (usize, usize, f64)| {
            0.5 * (weight * (numbers[a] - numbers[b])).powi(2)
        };
        cost + self.ties().map(tie).sum::<f64>()
    }

    /// The normal equations: the matrix and the right side.
    fn normal(
        &self,
        numbers: &DVector<f64>,
        shares: &[Vec<[f64; LEVELS]>; 4],
    ) -> Option<(DMatrix<f64>, DVector<f64>)> {
        let mut beside = Vec::new();
        for (a, step) in SHARED_STEPS.into_iter().enumerate() {
            let mut changed = numbers.clone();
            changed[a] += step;
            beside.push(self.all_shares(&changed)?);
        }
        let count = numbers.len();
        let (mut matrix, mut right) = (DMatrix::zeros(count, count), DVector::zeros(count));
        for side in 0..4 {
            for (i, pixel) in self.sides[side].iter().enumerate() {
                let shown = light(&shares[side][i], side, numbers);
                let residual = pixel.residual(shown);
                if residual == 0.0 {
                    continue;
                }
                let weight = (OUTLIER_LEVELS / residual.abs()).min(1.0);
                let slope = |a: usize| match a.checked_sub(SHARED) {
                    None => {
                        let changed = light(&beside[a][side][i], side, numbers);
                        (a, (changed - shown) / SHARED_STEPS[a])
                    }
                    Some(level) => (SHARED + LEVELS * side + level, shares[side][i][level]),
                };
                let slopes: [(usize, f64); SHARED + LEVELS] = std::array::from_fn(slope);
                for (a, slope) in slopes {
                    right[a] -= weight * slope * residual;
                    for (b, other) in slopes {
                        matrix[(a, b)] += weight * slope * other;
                    }
                }
            }
        }
        for (a, b, weight) in self.ties() {
            let stiffness = weight * weight;
            let pull = stiffness * (numbers[a] - numbers[b]);
            right[a] -= pull;
            right[b] += pull;
            matrix[(a, a)] += stiffness;
            matrix[(b, b)] += stiffness;
            matrix[(a, b)] -= stiffness;
            matrix[(b, a)] -= stiffness;
        }
        Some((matrix, right))
    }

    /// The numbers with the least cost, by Levenberg and Marquardt's method.
    fn solved(&self, mut numbers: DVector<f64>) -> Option<DVector<f64>> {
        let mut shares = self.all_shares(&numbers)?;
        let mut cost = self.cost(&numbers, &shares);
        let mut damping = 1e-3;
        for _ in 0..MAX_STEPS {
            let (matrix, right) = self.normal(&numbers, &shares)?;
            let step = loop {
                let mut damped = matrix.clone();
                // A number that has no say stays as it is.
                for i in 0..numbers.len() {
                    damped[(i, i)] += damping * (matrix[(i, i)] + f64::EPSILON);
                }
                let step = damped.cholesky()?.solve(&right);
                let next = &numbers + &step;
                let tried = self.all_shares(&next);
                let lower = tried.map(|shares| (self.cost(&next, &shares), shares));
                if let Some((next_cost, next_shares)) = lower.filter(|l| l.0 <= cost) {
                    (numbers, shares, cost) = (next, next_shares, next_cost);
                    damping *= 0.1;
                    break step;
                }
                damping *= 10.0;
                if damping > 1e6 {
                    return Some(numbers);
                }
            };
            if step.rows(0, 8).amax() < STILL_PX {
                break;
            }
        }
        Some(numbers)
    }
}

/// The number that is the level of light of a zone at an end of a side.
fn level_at(side: usize, end: usize, zone: usize) -> usize {
    SHARED + LEVELS * side + ZONES * end + zone
}

/// The light of a pixel that shows these shares of its side's levels.
fn light(shares: &[f64; LEVELS], side: usize, numbers: &DVector<f64>) -> f64 {
    let first = level_at(side, 0, 0);
    (0..LEVELS).map(|i| shares[i] * numbers[first + i]).sum()
}

impl Pixel {
    /// How much brighter than this pixel some light is, in levels; a saturated one may have been that bright.
    fn residual(&self, light: f64) -> f64 {
        let residual = light - self.light;
        if self.is_saturated {
            residual.min(0.0)
        } else {
            residual
        }
    }
}
