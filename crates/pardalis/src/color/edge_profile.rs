//! Edge profiles: how a body's colours blend into its surroundings, as P(membership | signed distance to the
//! outline, side), counted in labelled images.
//!
//! Optics, motion, chroma subsampling and compression all blur edges. How much they do, and towards which
//! side of the true outline, is learnt rather than assumed.

use std::fmt::Write as _;

use serde::Deserialize;

use super::membership::Side;
use pardalis_core::simd::to_index;

/// Standard deviation of the kernel that smooths over distance, pixels. Hand-set.
const SMOOTHING_PX: f64 = 0.35;
/// Pseudo-count of every bin, which keeps all probabilities above zero. Hand-set.
const PSEUDO_COUNT: f64 = 0.1;
/// Number of outermost rows that describe the surroundings of bodies. Hand-set.
const OUTSIDE_ROWS: usize = 3;
/// Weight of the counts of the other side, which support a side with few counts of its own. Hand-set.
const OTHER_SIDE_WEIGHT: f64 = 0.05;
/// The default edge if no profile was learnt: its blur as a standard deviation and its offset towards the
/// inside, in pixels. Origin: as in the bundled training sets.
const SOFT_PX: f64 = 1.3;
const SOFT_INSIDE_PX: f64 = 0.35;
/// The least blur in images of reduced size, a standard deviation in pixels. Hand-set: pixels are means over squares.
const MIN_SOFT_PX: f64 = 0.5;
/// Noise of the default edge as standard deviations in units of membership: outside, then the additions in
/// the middle of the edge and inside. Hand-set.
const SOFT_NOISE: [f64; 3] = [0.1, 0.5, 0.08];

/// Pixel counts per bin of membership, at each distance.
pub(super) type Counts = Vec<[u32; EdgeProfile::MEMBERSHIPS]>;

/// The edge profile of a body in the images of a camera.
#[derive(Debug, Clone, PartialEq)]
pub struct EdgeProfile {
    /// Indexed in the order of [`Side::ALL`].
    pub(super) counts: [Counts; 2],
}

/// ln P(membership | distance) / P(membership | outside), one row per distance.
pub type EdgeLogRatios = [[f32; EdgeProfile::MEMBERSHIPS]; EdgeProfile::DISTANCES];

impl EdgeProfile {
    /// Number of distances, a quarter of a pixel apart.
    pub const DISTANCES: usize = 33;
    /// Largest distance on either side of the outline, in pixels.
    pub const REACH_PX: f32 = 4.0;
    /// Number of bins of membership, from −0.5 to 1.5.
    pub const MEMBERSHIPS: usize = 32;

    /// Returns the bin of a membership, clamped to the first and last bins.
    #[inline(always)]
    pub fn bin_of(membership: f32) -> usize {
        to_index((membership + 0.5) * 16.0, Self::MEMBERSHIPS as u16 - 1)
    }

    /// Computes the smoothed tables of log ratios on either side, in the order of [`Side::ALL`]. All entries
    /// are finite.
    pub fn log_ratios(&self) -> [Box<EdgeLogRatios>; 2] {
        let own = Side::ALL.map(|side| side as usize);
        let sides = own.map(|side| {
            let rows = self.counts[side].iter().zip(&self.counts[1 - side]);
            let mixed = |(own, other): (&[u32; Self::MEMBERSHIPS], &[u32; Self::MEMBERSHIPS])| {
                std::array::from_fn(|bin| {
                    f64::from(own[bin]) + OTHER_SIDE_WEIGHT * f64::from(other[bin])
                })
            };
            shares(&smoothed(&rows.map(mixed).collect::<Vec<_>>()))
        });
        let outside = reference(&sides);
        sides.map(|shares| log_ratios_of(&shares, &outside))
    }

    /// Returns a profile that does not distinguish the sides: both have the counts of the two together.
    #[must_use]
    pub fn without_sides(&self) -> Self {
        let [shaded, lit] = &self.counts;
        let rows = shaded.iter().zip(lit);
        let both: Counts = rows
            .map(|(shaded, lit)| std::array::from_fn(|bin| shaded[bin].saturating_add(lit[bin])))
            .collect();
        Self {
            counts: [both.clone(), both],
        }
    }

    /// Computes the log ratios of a soft step on either side, for colours that were learnt without an edge. `scale` is
    /// the size of the image as a share of the full size.
    pub fn soft_step(scale: f64) -> [Box<EdgeLogRatios>; 2] {
        let blur_px = (scale * SOFT_PX).max(MIN_SOFT_PX);
        let row = |distance: usize| {
            let distance_px = 0.25 * distance as f64 - f64::from(Self::REACH_PX);
            let off = (distance_px + scale * SOFT_INSIDE_PX) / (blur_px * std::f64::consts::SQRT_2);
            let mean = 0.5 * libm::erfc(off);
            let [outside, middle, inside] = SOFT_NOISE;
            let sigma = outside + middle * mean * (1.0 - mean) + inside * mean;
            std::array::from_fn(|bin| {
                let membership = (bin as f64 + 0.5) / 16.0 - 0.5;
                let normal = libm::exp(-0.5 * ((membership - mean) / sigma).powi(2));
                normal / sigma + 0.01
            })
        };
        let shares = shares(&(0..Self::DISTANCES).map(row).collect::<Vec<_>>());
        let outside = reference(std::slice::from_ref(&shares));
        [(); 2].map(|()| log_ratios_of(&shares, &outside))
    }

    /// Computes the mean membership at each distance on one side.
    pub fn mean_memberships(&self, side: Side) -> Vec<f64> {
        let mean = |row: &[u32; Self::MEMBERSHIPS]| {
            let (mut sum, mut total) = (0.0, 0.0);
            for (bin, &count) in row.iter().enumerate() {
                sum += f64::from(count) * ((bin as f64 + 0.5) / 16.0 - 0.5);
                total += f64::from(count);
            }
            sum / total
        };
        self.counts[side as usize].iter().map(mean).collect()
    }

    /// Formats the profiles of an image's octaves as sections of a colour model file.
    pub(super) fn all_to_text(octaves: &[Self]) -> String {
        let mut text = String::new();
        for (octave, profile) in octaves.iter().enumerate() {
            text.push_str(match octave {
                0 => {
                    "\n# how the target's colours blend into its surroundings, on the side darker than its mean and on the other: pixels at -4 to 4 px from the outline, one \
                     row per quarter of a pixel, in 32 bins of membership from -0.5 to 1.5 (0: as outside, 1: as inside)\n[edge]\n"
                }
                1 => "\n# the same in images of half the size, a quarter of the size and so on\n[[coarser_edges]]\n",
                _ => "\n[[coarser_edges]]\n",
            });
            for (name, counts) in ["shaded", "lit"].iter().zip(&profile.counts) {
                let _ = writeln!(text, "{name} = [");
                for row in counts {
                    let _ = writeln!(text, "    {row:?},");
                }
                text.push_str("]\n");
            }
        }
        text
    }
}

/// Smooths over distance with a Gaussian and over membership with (¼, ½, ¼), and adds the pseudo-count to
/// every bin.
fn smoothed(counts: &[[f64; EdgeProfile::MEMBERSHIPS]]) -> Vec<[f64; EdgeProfile::MEMBERSHIPS]> {
    let weight = |rows: usize| {
        let off = 0.25 * rows as f64 / SMOOTHING_PX;
        libm::exp(-0.5 * off * off)
    };
    let row = |distance: usize| {
        let mut sums = [PSEUDO_COUNT; EdgeProfile::MEMBERSHIPS];
        for (other, row) in counts.iter().enumerate() {
            let weight = weight(other.abs_diff(distance));
            for (bin, sum) in sums.iter_mut().enumerate() {
                let at = |bin: usize| row[bin.min(EdgeProfile::MEMBERSHIPS - 1)];
                let near = 0.25 * at(bin.saturating_sub(1)) + 0.5 * at(bin) + 0.25 * at(bin + 1);
                *sum += weight * near;
            }
        }
        sums
    };
    (0..counts.len()).map(row).collect()
}

/// Share of each bin at each distance.
type Shares = Vec<[f64; EdgeProfile::MEMBERSHIPS]>;

fn shares(rows: &[[f64; EdgeProfile::MEMBERSHIPS]]) -> Shares {
    let share = |row: &[f64; EdgeProfile::MEMBERSHIPS]| {
        let total: f64 = row.iter().sum();
        row.map(|value| value / total)
    };
    rows.iter().map(share).collect()
}

/// Computes the shares of a body's surroundings, over all sides.
fn reference(sides: &[Shares]) -> [f64; EdgeProfile::MEMBERSHIPS] {
    let rows = || {
        let outside = |side: &Shares| side[EdgeProfile::DISTANCES - OUTSIDE_ROWS..].to_vec();
        sides.iter().flat_map(outside)
    };
    let count = rows().count() as f64;
    std::array::from_fn(|bin| rows().map(|row| row[bin]).sum::<f64>() / count)
}

fn log_ratios_of(shares: &Shares, outside: &[f64; EdgeProfile::MEMBERSHIPS]) -> Box<EdgeLogRatios> {
    let mut table = Box::new([[0.0; EdgeProfile::MEMBERSHIPS]; EdgeProfile::DISTANCES]);
    for (row, shares) in table.iter_mut().zip(shares) {
        for ((log_ratio, share), outside) in row.iter_mut().zip(shares).zip(outside) {
            *log_ratio = libm::log(share / outside) as f32;
        }
    }
    table
}

/// The section `[edge]` of a colour model file.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct EdgeText {
    shaded: CountsText,
    lit: CountsText,
}

type CountsText = toml::Spanned<Vec<toml::Spanned<Vec<u32>>>>;

impl EdgeText {
    /// Validates the section; on failure returns the offset in the text and the message.
    pub(super) fn read(&self) -> Result<EdgeProfile, (usize, String)> {
        Ok(EdgeProfile {
            counts: [read_counts(&self.shaded)?, read_counts(&self.lit)?],
        })
    }
}

fn read_counts(text: &CountsText) -> Result<Counts, (usize, String)> {
    let rows = text.get_ref();
    if rows.len() != EdgeProfile::DISTANCES {
        let message = format!(
            "{} rows of counts; expected {}, one per distance",
            rows.len(),
            EdgeProfile::DISTANCES
        );
        return Err((text.span().start, message));
    }
    let row = |row: &toml::Spanned<Vec<u32>>| {
        let counts: Result<[u32; EdgeProfile::MEMBERSHIPS], _> =
            row.get_ref().as_slice().try_into();
        let refused = |message| (row.span().start, message);
        let counts = counts.map_err(|_| {
            let found = row.get_ref().len();
            refused(format!(
                "{found} numbers; expected {}",
                EdgeProfile::MEMBERSHIPS
            ))
        })?;
        if counts.iter().all(|&count| count == 0) {
            let message = "no pixels at this distance; learn the model again from more images";
            return Err(refused(message.to_owned()));
        }
        Ok(counts)
    };
    rows.iter().map(row).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::color::edge_learner::{EdgeLearner, Follows};

    /// Learns from discs on a plain background, blurred by `sigma_px`.
    fn learnt(sigma_px: f64) -> EdgeProfile {
        learnt_octaves(sigma_px).swap_remove(0)
    }

    /// The same in all octaves.
    fn learnt_octaves(sigma_px: f64) -> Vec<EdgeProfile> {
        let (width, height) = (64, 64);
        let mut learner = EdgeLearner::default();
        for n in 0..20 {
            let n = f64::from(n);
            let (u, v, r) = (32.0 + 0.37 * n, 31.0 - 0.21 * n, 9.0 + 0.43 * n);
            let distance = |x: usize, y: usize| (x as f64 - u).hypot(y as f64 - v) - r;
            let labels: Vec<bool> = (0..width * height)
                .map(|i| distance(i % width, i / width) < 0.0)
                .collect();
            learner.add(&labels, width, Follows::Outline, |x, y| {
                let share = 0.5 * libm::erfc(distance(x, y) / sigma_px / 2.0_f64.sqrt());
                let grain = ((x * 7 + y * 13) % 11) as f32 - 5.0;
                [60.0 + 100.0 * share as f32 + grain, 128.0, 128.0]
            });
        }
        learner.profiles()
    }

    #[test]
    fn the_blur_of_an_edge_is_recovered() {
        let profile = learnt(1.2);
        for side in Side::ALL {
            for (row, mean) in profile.mean_memberships(side).into_iter().enumerate() {
                let distance_px = 0.25 * row as f64 - 4.0;
                let expected = 0.5 * libm::erfc(distance_px / 1.2 / 2.0_f64.sqrt());
                assert!(
                    (mean - expected).abs() < 0.07,
                    "{distance_px}: {mean} {expected}"
                );
            }
        }
    }

    #[test]
    fn edges_are_sharper_in_reduced_images() {
        let [fine, half] = &learnt_octaves(1.6)[..] else {
            panic!("the discs are large enough for half the size, not for a quarter");
        };
        // Across the edge from 1 px inside to 1 px outside.
        let drop = |profile: &EdgeProfile| {
            let mean = profile.mean_memberships(Side::Lit);
            mean[12] - mean[20]
        };
        assert!((drop(fine) - 0.47).abs() < 0.07, "{}", drop(fine));
        assert!(drop(half) > 0.65, "{}", drop(half));
    }

    #[test]
    fn log_ratios_are_finite_positive_inside_and_negative_outside() {
        let tables = [learnt(0.8).log_ratios(), EdgeProfile::soft_step(1.0)];
        for table in tables.into_iter().flatten() {
            assert!(
                table
                    .iter()
                    .flatten()
                    .all(|log_ratio| log_ratio.is_finite())
            );
            let [body, around] = [1.0, 0.0].map(EdgeProfile::bin_of);
            assert!(table[0][body] > 3.0 && table[0][around] < -3.0);
            let last = EdgeProfile::DISTANCES - 1;
            assert!(table[last][around].abs() < 0.2);
            for rows in table.windows(2) {
                assert!(rows[0][body] > rows[1][body] - 0.7);
            }
        }
        for membership in [f32::NEG_INFINITY, -3.0, 0.0, 1.49, 7.0, f32::INFINITY] {
            assert!(EdgeProfile::bin_of(membership) < EdgeProfile::MEMBERSHIPS);
        }
    }

    #[test]
    fn no_profile_without_whole_bodies() {
        let mut learner = EdgeLearner::default();
        assert_eq!(learner.profiles(), []);
        // A body that touches the image border.
        let labels: Vec<bool> = (0..400).map(|i| i % 20 < 8).collect();
        learner.add(&labels, 20, Follows::Outline, |x, _| {
            [10.0 * x as f32, 0.0, 0.0]
        });
        assert_eq!(learner.profiles(), []);
    }

    #[test]
    fn without_sides_both_sides_have_all_counts() {
        let profile = learnt(1.2);
        let both = profile.without_sides();
        let [shaded, lit] = Side::ALL.map(|side| both.mean_memberships(side));
        assert_eq!(shaded, lit);
        let total = |profile: &EdgeProfile, side: usize| -> u32 {
            profile.counts[side].iter().flatten().sum()
        };
        let all = total(&profile, 0) + total(&profile, 1);
        assert_eq!((total(&both, 0), total(&both, 1)), (all, all));
    }

    #[test]
    fn invalid_sections_are_rejected_with_their_offset() {
        let read = |text: &str| {
            let parsed: EdgeText = toml::from_str(text).unwrap();
            parsed.read()
        };
        let profile = learnt(0.8);
        let text = EdgeProfile::all_to_text(std::slice::from_ref(&profile));
        let (_, section) = text.split_once("[edge]").unwrap();
        assert_eq!(read(section).unwrap(), profile);
        let (offset, message) = read("shaded = [[1, 2]]\nlit = []").unwrap_err();
        assert!(offset == 9 && message.contains("33"), "{message}");
        let few = section.replacen(", 0]", "]", 1);
        assert!(read(&few).unwrap_err().1.contains("31 numbers"));
        let none = "    [0".to_owned() + &", 0".repeat(31) + "],";
        let first = section.lines().nth(2).unwrap();
        let empty = section.replacen(first, &none, 1);
        assert!(read(&empty).unwrap_err().1.contains("no pixel"));
    }
}
