//! Rectangles: what else the outline of a ball may be.
//!
//! A line that shows an edge anywhere else speaks against an outline only a little, because anything may cover part of a ball. But things in a ball's colours that are
//! not round are mostly boxes, books and cans, and their outlines are close to rectangles: against them, all lines speak together.

use super::fit::{DEVIATIONS, deviations_px};
use super::frame::SECTORS;
use super::lines::{CorrespondenceLines, log_mean_exp};
use super::table::{REACH_PX, SHIFTS, SHIFTS_A_PX};
use crate::likelihood::outline::Coordinates;
use pardalis_core::real::{exp_f32, ln_f32};

/// Ratios of the sides of rectangles, each with its number of directions, and the angle in radians over which these are spread. Hand-set: directions 22.5 degrees
/// apart; longer rectangles are no outline that fits a circle.
const FORMS: [(f64, usize, f64); 2] = [
    (1.0, 4, std::f64::consts::FRAC_PI_2),
    (1.25, 8, std::f64::consts::PI),
];
/// Their sizes: the radius of a circle of the same area, relative to the outline's. Hand-set: fits of a circle are off by as much.
const SIZES: [f64; 3] = [0.95, 1.0, 1.05];
/// The number of rectangles.
const RECTANGLES: usize = (FORMS[0].1 + FORMS[1].1) * SIZES.len();

/// The least likelihood of a shift, relative to a sector's likeliest one. Derivation: its logarithm is finite, and below all that makes a difference.
const LEAST_LIKELIHOOD: f32 = 1e-30;

/// The rectangles with which an outline is compared.
#[derive(Debug)]
pub(super) struct Rectangles {
    /// How far each lies beyond a circle around the same middle at each point of the circle, in radii.
    beyond: Vec<[f32; RECTANGLES]>,
}

impl Rectangles {
    /// Those around an outline of this many points.
    pub(super) fn new(points: usize) -> Self {
        let turns = move |k: usize| std::f64::consts::TAU * k as f64 / points as f64;
        let rectangles = FORMS.iter().flat_map(|&(ratio, directions, angle)| {
            (0..directions).map(move |i| (ratio, angle * i as f64 / directions as f64))
        });
        let rectangles = rectangles.flat_map(|form| SIZES.map(|size| (form, size)));
        let mut beyond = vec![[0.0; RECTANGLES]; points];
        for (number, ((ratio, direction), size)) in rectangles.enumerate() {
            let short = size * libm::sqrt(std::f64::consts::FRAC_PI_4 / ratio);
            for (k, beyond) in beyond.iter_mut().enumerate() {
                let (sin, cos) = libm::sincos(turns(k) - direction);
                let radius = (ratio * short / cos.abs()).min(short / sin.abs());
                beyond[number] = (radius - 1.0) as f32;
            }
        }
        Self { beyond }
    }

    /// The log-likelihood ratio of a rectangle around the middle of an outline, in place of which the lines were placed, against an edge anywhere: the mean likelihood
    /// of all rectangles. Each sector may deviate by up to a tolerance.
    pub(super) fn log_ratio(
        &self,
        lines: &CorrespondenceLines,
        outline: &[Coordinates],
        tolerance_px: f32,
    ) -> f32 {
        let tolerant = lines
            .sector_sums()
            .map(|sums| tolerant(&sums, tolerance_px));
        let points = outline.iter().map(|[u, v]| [u[0], v[0]]);
        let points = points.filter(|point| point.iter().all(|v| v.is_finite()));
        let mut sums = [0.0_f32; 3];
        for [u, v] in points {
            sums = [sums[0] + 1.0, sums[1] + u, sums[2] + v];
        }
        let middle = [sums[1] / sums[0], sums[2] / sums[0]];
        let mut sums = [[0.0_f32; RECTANGLES]; SECTORS];
        let mut counts = [0.0_f32; SECTORS];
        for (k, beyond) in self.beyond.iter().enumerate() {
            let radius_px = -lines.shift_px(k, middle);
            // Points without a pixel show no edge.
            if radius_px.is_finite() {
                let sector = lines.sector(k);
                for (sum, share) in sums[sector].iter_mut().zip(beyond) {
                    *sum += interpolated(&tolerant[sector], share * radius_px);
                }
                counts[sector] += 1.0;
            }
        }
        let log_ratios: [f32; RECTANGLES] = std::array::from_fn(|rectangle| {
            let mean = |sector: usize| sums[sector][rectangle] / counts[sector].max(1.0);
            lines.log_likelihood_ratio(&std::array::from_fn(mean))
        });
        log_mean_exp(&log_ratios)
    }
}

/// A sector's log-likelihoods for the shifts of lines, if it may deviate by up to a tolerance.
fn tolerant(sums: &[f32; SHIFTS], tolerance_px: f32) -> [f32; SHIFTS] {
    let most = sums.iter().copied().fold(f32::NEG_INFINITY, f32::max);
    let likelihoods = sums.map(|sum| exp_f32(sum - most));
    std::array::from_fn(|i| {
        let shift_px = i as f32 / SHIFTS_A_PX as f32 - REACH_PX;
        let total: f32 = deviations_px(tolerance_px)
            .map(|deviation_px| interpolated(&likelihoods, shift_px + deviation_px))
            .iter()
            .sum();
        most + ln_f32((total / DEVIATIONS as f32).max(LEAST_LIKELIHOOD))
    })
}

/// The value at a shift in pixels, between those of the shifts of lines; the last one beyond their reach.
fn interpolated(values: &[f32; SHIFTS], shift_px: f32) -> f32 {
    let last = (SHIFTS - 1) as f32;
    let step = ((shift_px + REACH_PX) * SHIFTS_A_PX as f32).clamp(0.0, last - 1e-3);
    let i = step as usize;
    values[i] + (step - i as f32) * (values[i + 1] - values[i])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn likelihoods_of_shifts_stay_finite_where_edges_are_steep() {
        let sums = std::array::from_fn(|i| -20.0 * (i as f32 - 20.0).abs());
        let tolerant = tolerant(&sums, 0.5);
        assert!(tolerant.iter().all(|value| value.is_finite()));
        assert!(
            (tolerant[20] + libm::logf(5.0)).abs() < 1e-4,
            "one of five deviations fits"
        );
        assert!(tolerant[0] < -60.0 && interpolated(&tolerant, 9.0) < -60.0);
    }
}
