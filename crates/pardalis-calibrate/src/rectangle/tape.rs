//! Fit of a whole rectangle of tape to the pixels on and around it.
//!
//! The profile across a side is a box between the two edges of the tape, blurred by the lens and the pixels. The steepest
//! points of this profile are not the edges if the tape is thin compared with the blur, or if the image is saturated:
//! overexposed tape appears too wide. Therefore the complete profile is fitted. A saturated pixel only gives a lower
//! bound of the light. The true brightness of the tape follows from its blurred edges and from its width, which is the
//! same for opposite sides on the floor, so that farther sides appear thinner.

use nalgebra::{DMatrix, DVector};
use pardalis_camera::Homography;

use super::sides::{Light, Measured};
use crate::plane::{PointPair, fit};

/// Greatest distance from the tape of the pixels that are used.
const REACH_PX: f64 = 4.0;

/// Residuals above this many levels of light (of 255) are outliers, with less weight.
const OUTLIER_LEVELS: f64 = 6.0;

/// Expected variation of saturated light along a side and between adjacent sides, in levels. A difference of this size
/// weighs as much as a residual of one level of one pixel.
const UNEVEN_LEVELS: f64 = 0.25;

/// Initial relative excess of saturated light over its level in the image.
const SATURATION_EXCESS: f64 = 0.2;

/// Initial and least standard deviation of the blur, in addition to that of the pixels themselves.
const BLUR_PX: f64 = 0.5;
const MIN_BLUR_PX: f64 = 0.05;

/// Greatest distance of the fitted corners from those of the steepest points.
const MAX_MOVE_PX: f64 = 1.5;

/// The iteration ends when no corner moves farther than this, or after this number of steps.
const CONVERGED_PX: f64 = 1e-4;
const MAX_STEPS: usize = 30;

/// Number of parameters shared by all sides, and their steps for numerical derivatives: the outer corners in pixels, the
/// width of the tape divided by each of the rectangle's two lengths, and the blur in pixels.
const SHARED: usize = 11;
const SHARED_STEPS: [f64; SHARED] = [
    1e-3, 1e-3, 1e-3, 1e-3, 1e-3, 1e-3, 1e-3, 1e-3, 1e-5, 1e-5, 1e-3,
];

/// Number of parameters per side: the levels of light of three zones (tape, outside, inside) at its start and its end.
const LEVELS: usize = 6;
const ZONES: usize = 3;

/// Corners of the rectangle on the floor, in units of its side lengths.
const SQUARE: [[f64; 2]; 4] = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]];

type Corners = [[f64; 2]; 4];

/// Fits a tape to an image, starting from measurements of its edges with corners in the same order, counter-clockwise as
/// seen in the image. Returns the corners of the outer and of the inner edge; `None` if the fit diverges.
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
            let is_visible =
                || outer.is_visible(side, center_px) && inner.is_visible(side, center_px);
            if outer_px > -REACH_PX && inner_px < REACH_PX && is_visible() {
                pixels.push(Pixel {
                    center_px,
                    light: f64::from(light[0]),
                    is_saturated: is_saturated(x, y),
                });
            }
        }
    }
    let (tape, parameters) = Tape::new(sides, start)?;
    let edges = edges(&tape.solved(parameters)?)?;
    let mut moved = start.iter().flatten().zip(edges.iter().flatten());
    let is_near =
        |(a, b): (&[f64; 2], &[f64; 2])| libm::hypot(a[0] - b[0], a[1] - b[1]) <= MAX_MOVE_PX;
    moved.all(is_near).then_some(edges)
}

/// Returns the distance of a point inwards from a side, in pixels, and its position along the side, 0 to 1.
fn inwards(corners_px: Corners, side: usize, p: [f64; 2]) -> (f64, f64) {
    let [from, to] = [corners_px[side], corners_px[(side + 1) % 4]];
    let step = [to[0] - from[0], to[1] - from[1]];
    let offset = [p[0] - from[0], p[1] - from[1]];
    let length_px = libm::hypot(step[0], step[1]);
    // The corners are counter-clockwise as seen in the image, so that the inside is on the left.
    (
        (step[1] * offset[0] - step[0] * offset[1]) / length_px,
        (step[0] * offset[0] + step[1] * offset[1]) / (length_px * length_px),
    )
}

/// Returns the homography of the rectangle in units of its side lengths, from its outer corners.
fn floor(outer_px: Corners) -> Option<Homography> {
    let pairs = [0, 1, 2, 3].map(|i| PointPair {
        pixel: outer_px[i],
        plane_m: SQUARE[i],
    });
    fit(&pairs).ok().map(|found| found.homography)
}

/// Returns the corners of the outer and of the inner edge for these parameters.
fn edges(parameters: &DVector<f64>) -> Option<[Corners; 2]> {
    let outer_px = [0, 1, 2, 3].map(|i| [parameters[2 * i], parameters[2 * i + 1]]);
    let floor = floor(outer_px)?;
    let corner = |i: usize| {
        let inset = |c: usize| SQUARE[i][c] + (1.0 - 2.0 * SQUARE[i][c]) * parameters[8 + c];
        floor.pixel_of([inset(0), inset(1)])
    };
    Some([outer_px, [corner(0)?, corner(1)?, corner(2)?, corner(3)?]])
}

/// Returns the fraction of a pixel's light that comes from the inside of an edge, for a pixel this far inside: a blurred
/// step, averaged over the length of a pixel.
fn inside_fraction(distance_px: f64, blur_px: f64) -> f64 {
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
    /// Whether `light` is only a lower bound.
    is_saturated: bool,
}

/// The observations of a tape.
struct Tape {
    /// Pixels on and around each side.
    sides: [Vec<Pixel>; 4],
    /// Fraction of saturated pixels for each side and zone (tape, outside, inside).
    saturated: [[f64; ZONES]; 4],
}

impl Tape {
    /// Returns the observations and the initial parameters; `None` if a zone of a side has no pixels.
    fn new(
        sides: [Vec<Pixel>; 4],
        [outer_px, inner_px]: [Corners; 2],
    ) -> Option<(Self, DVector<f64>)> {
        let floor = floor(outer_px)?;
        let mut parameters = DVector::zeros(SHARED + 4 * LEVELS);
        for i in 0..4 {
            let inside = floor.plane_of(inner_px[i])?;
            for c in 0..2 {
                parameters[2 * i + c] = outer_px[i][c];
                parameters[8 + c] += 0.25 * (inside[c] - SQUARE[i][c]).abs();
            }
        }
        parameters[10] = BLUR_PX;
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
                let fraction = mean(|pixel| f64::from(u8::from(pixel.is_saturated)));
                let level = mean(|pixel| pixel.light) * (1.0 + SATURATION_EXCESS * fraction);
                saturated[side][zone] = fraction;
                for end in 0..2 {
                    parameters[level_at(side, end, zone)] = level;
                }
            }
        }
        Some((Self { sides, saturated }, parameters))
    }

    /// Returns the weights of the side's levels in the light of each of its pixels.
    fn weights(
        &self,
        side: usize,
        [outer_px, inner_px]: [Corners; 2],
        blur_px: f64,
    ) -> Vec<[f64; LEVELS]> {
        let weights_of = |pixel: &Pixel| {
            let (distance_px, along) = inwards(outer_px, side, pixel.center_px);
            let past_outer = inside_fraction(distance_px, blur_px);
            let past_inner = inside_fraction(inwards(inner_px, side, pixel.center_px).0, blur_px);
            let zones = [past_outer - past_inner, 1.0 - past_outer, past_inner];
            let at = |i: usize| {
                let end = if i < ZONES { 1.0 - along } else { along };
                end * zones[i % ZONES]
            };
            [at(0), at(1), at(2), at(3), at(4), at(5)]
        };
        self.sides[side].iter().map(weights_of).collect()
    }

    /// Returns the weights of all sides; `None` if the parameters do not describe a tape.
    fn all_weights(&self, parameters: &DVector<f64>) -> Option<[Vec<[f64; LEVELS]>; 4]> {
        let edges = edges(parameters)?;
        let blur_px = libm::hypot(parameters[10], MIN_BLUR_PX);
        Some([0, 1, 2, 3].map(|side| self.weights(side, edges, blur_px)))
    }

    /// Returns the constraints between adjacent saturated levels around the tape, which should differ little: indices of
    /// both parameters, and the weight of their difference.
    fn constraints(&self) -> impl Iterator<Item = (usize, usize, f64)> {
        let constraint = |i: usize| {
            let (zone, side, end) = (i / 8, i / 2 % 4, i % 2);
            let next = if end == 0 { side } else { (side + 1) % 4 };
            let weight = (self.saturated[side][zone] * self.saturated[next][zone]).sqrt();
            let pair = [level_at(side, end, zone), level_at(next, 1 - end, zone)];
            (pair[0], pair[1], weight / UNEVEN_LEVELS)
        };
        (0..8 * ZONES).map(constraint)
    }

    /// Returns half the sum of squared residuals, with the Huber loss for outliers.
    fn cost(&self, parameters: &DVector<f64>, weights: &[Vec<[f64; LEVELS]>; 4]) -> f64 {
        let mut cost = 0.0;
        for side in 0..4 {
            for (pixel, weights) in self.sides[side].iter().zip(&weights[side]) {
                let size = pixel.residual(light(weights, side, parameters)).abs();
                cost += if size <= OUTLIER_LEVELS {
                    0.5 * size * size
                } else {
                    OUTLIER_LEVELS * (size - 0.5 * OUTLIER_LEVELS)
                };
            }
        }
        let constraint = |(a, b, weight): (usize, usize, f64)| {
            0.5 * (weight * (parameters[a] - parameters[b])).powi(2)
        };
        cost + self.constraints().map(constraint).sum::<f64>()
    }

    /// Returns the normal equations: matrix and right-hand side.
    fn normal(
        &self,
        parameters: &DVector<f64>,
        weights: &[Vec<[f64; LEVELS]>; 4],
    ) -> Option<(DMatrix<f64>, DVector<f64>)> {
        let mut changed_weights = Vec::new();
        for (a, step) in SHARED_STEPS.into_iter().enumerate() {
            let mut changed = parameters.clone();
            changed[a] += step;
            changed_weights.push(self.all_weights(&changed)?);
        }
        let count = parameters.len();
        let (mut matrix, mut right) = (DMatrix::zeros(count, count), DVector::zeros(count));
        for side in 0..4 {
            for (i, pixel) in self.sides[side].iter().enumerate() {
                let predicted = light(&weights[side][i], side, parameters);
                let residual = pixel.residual(predicted);
                if residual == 0.0 {
                    continue;
                }
                let weight = (OUTLIER_LEVELS / residual.abs()).min(1.0);
                let slope = |a: usize| match a.checked_sub(SHARED) {
                    None => {
                        let changed = light(&changed_weights[a][side][i], side, parameters);
                        (a, (changed - predicted) / SHARED_STEPS[a])
                    }
                    Some(level) => (SHARED + LEVELS * side + level, weights[side][i][level]),
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
        for (a, b, weight) in self.constraints() {
            let stiffness = weight * weight;
            let pull = stiffness * (parameters[a] - parameters[b]);
            right[a] -= pull;
            right[b] += pull;
            matrix[(a, a)] += stiffness;
            matrix[(b, b)] += stiffness;
            matrix[(a, b)] -= stiffness;
            matrix[(b, a)] -= stiffness;
        }
        Some((matrix, right))
    }

    /// Minimises the cost with the Levenberg-Marquardt method.
    fn solved(&self, mut parameters: DVector<f64>) -> Option<DVector<f64>> {
        let mut weights = self.all_weights(&parameters)?;
        let mut cost = self.cost(&parameters, &weights);
        let mut damping = 1e-3;
        for _ in 0..MAX_STEPS {
            let (matrix, right) = self.normal(&parameters, &weights)?;
            let step = loop {
                let mut damped = matrix.clone();
                // The small constant keeps parameters without influence at their values.
                for i in 0..parameters.len() {
                    damped[(i, i)] += damping * (matrix[(i, i)] + f64::EPSILON);
                }
                let step = damped.cholesky()?.solve(&right);
                let next = &parameters + &step;
                let tried = self.all_weights(&next);
                let lower = tried.map(|weights| (self.cost(&next, &weights), weights));
                if let Some((next_cost, next_weights)) = lower.filter(|l| l.0 <= cost) {
                    (parameters, weights, cost) = (next, next_weights, next_cost);
                    damping *= 0.1;
                    break step;
                }
                damping *= 10.0;
                if damping > 1e6 {
                    return Some(parameters);
                }
            };
            if step.rows(0, 8).amax() < CONVERGED_PX {
                break;
            }
        }
        Some(parameters)
    }
}

/// Returns the index of the parameter for the level of a zone at an end of a side.
fn level_at(side: usize, end: usize, zone: usize) -> usize {
    SHARED + LEVELS * side + ZONES * end + zone
}

/// Returns the light of a pixel with these weights of its side's levels.
fn light(weights: &[f64; LEVELS], side: usize, parameters: &DVector<f64>) -> f64 {
    let first = level_at(side, 0, 0);
    (0..LEVELS)
        .map(|i| weights[i] * parameters[first + i])
        .sum()
}

impl Pixel {
    /// Returns the difference between predicted and observed light in levels; 0 if the pixel is saturated and the
    /// prediction is brighter.
    fn residual(&self, light: f64) -> f64 {
        let residual = light - self.light;
        if self.is_saturated {
            residual.min(0.0)
        } else {
            residual
        }
    }
}
