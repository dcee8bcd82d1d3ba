//! Membership of pixels near an outline: whether a colour is that of the body or of its surroundings,
//! measured relative to the colours on both sides nearby. It depends on neither the illumination, the white
//! balance nor the colour itself.

use std::sync::LazyLock;

use pardalis_core::simd::to_index;

/// A pixel near an outline.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EdgePixel {
    /// Colour: Y, U and V of BT.601, full range, 0 to 255.
    pub yuv: [f32; 3],
    /// Signed distance of the pixel's centre to the outline in pixels, negative inside.
    pub distance_px: f32,
    /// Position around the outline, as a share of a full turn from 0 to 1.
    pub turn: f32,
}

/// Sectors of the turn around an outline, each with colours of its own. Hand-set.
const SECTORS: usize = 64;
/// Signed distance in pixels below which pixels show only the body. Hand-set: beyond the blur of edges.
const BODY_DEPTH_PX: f32 = -2.0;
/// Minimum number of pixels of the body; if fewer lie deep enough, the deepest ones are used. Hand-set.
const MIN_BODY_PIXELS: usize = 6;
/// Signed distances from the outline, in pixels, at which pixels show the surroundings. Hand-set.
const SURROUNDINGS_PX: std::ops::Range<f32> = 3.0..7.0;
/// Concentrations of the von Mises densities that weight colours around the turn, for the body and for its
/// surroundings. Hand-set.
const CONCENTRATION: [f64; 2] = [2.0, 4.0];
/// Concentration of the von Mises density that weights brightness around the turn, and the signed distances
/// from the outline, in pixels, of the pixels used for it. Hand-set.
const SHADING_CONCENTRATION: f64 = 4.0;
const SHADING_PX: std::ops::RangeInclusive<f32> = -6.0..=-1.2;
/// Weights of squared differences in Y, U and V. Hand-set: chroma changes less with shadows.
pub(crate) const CHANNEL_WEIGHTS: [f32; 3] = [1.0, 15.0, 15.0];
/// Minimum squared weighted difference of two colours; closer colours have no membership. Hand-set.
const MIN_CONTRAST: f32 = 100.0;

/// Weights over the sectors of the turn, by their offset: for the body, for its surroundings and for brightness, each twice in a row.
static WEIGHTS: LazyLock<[[f32; 2 * SECTORS]; 3]> = LazyLock::new(|| {
    let [body, outside] = CONCENTRATION;
    [body, outside, SHADING_CONCENTRATION].map(|concentration| {
        std::array::from_fn(|offset| {
            let angle = (offset % SECTORS) as f64 / SECTORS as f64 * std::f64::consts::TAU;
            libm::exp(concentration * (libm::cos(angle) - 1.0)) as f32
        })
    })
});

/// The shaded or lit side of a body: a round body darkens well inside its outline where it turns away from
/// the light, and stays bright up to the outline on the other side.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Side {
    /// Darker than the mean of the body.
    Shaded,
    /// As bright as the mean, or brighter.
    Lit,
}

impl Side {
    /// Both sides, in the order of tables.
    pub const ALL: [Self; 2] = [Self::Shaded, Self::Lit];
}

/// The colours inside and outside along an outline.
#[derive(Debug, Clone, PartialEq)]
pub struct Surroundings {
    sectors: [LocalColors; SECTORS],
}

/// The colours inside and outside along one sector of the turn.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LocalColors {
    /// The mean colour around the body.
    outside: [f32; 3],
    /// By how much membership rises with each channel.
    slopes: [f32; 3],
    /// The weighted distance from the colour around the body to the body's own.
    contrast: f32,
    side: Side,
}

impl Surroundings {
    /// Measures the colours on both sides of an outline; `None` if either side has too few pixels.
    pub fn of(pixels: &[EdgePixel]) -> Option<Self> {
        let mut sums = OutlineSums::default();
        for pixel in pixels {
            sums.add(pixel);
        }
        if sums.body.count() < MIN_BODY_PIXELS as f32 {
            let deepest_px = deepest(pixels)?[MIN_BODY_PIXELS - 1].min(0.0);
            sums.body = TurnSums::default();
            for pixel in pixels
                .iter()
                .filter(|pixel| pixel.distance_px <= deepest_px)
            {
                sums.body.add(sector_of(pixel.turn), pixel.yuv);
            }
        }
        let [of_body, of_outside, of_shading] = &*WEIGHTS;
        let body = sums.body.means(of_body)?;
        let outside = sums.outside.means(of_outside)?;
        let brightness = sums.shading.means(of_shading);
        let mean_brightness = sums.shading.mean_luma();
        let sectors = std::array::from_fn(|sector| {
            let at = |means: &[[f32; SECTORS]; 3]| [0, 1, 2].map(|i| means[i][sector]);
            let (outside, body) = (at(&outside), at(&body));
            let difference = [0, 1, 2].map(|i| body[i] - outside[i]);
            let weighted = [0, 1, 2].map(|i| CHANNEL_WEIGHTS[i] * difference[i]);
            let whole: f32 = (0..3).map(|i| difference[i] * weighted[i]).sum();
            let slope = if whole < MIN_CONTRAST {
                f32::NAN
            } else {
                1.0 / whole
            };
            let is_shaded = brightness
                .as_ref()
                .is_some_and(|brightness| brightness[0][sector] < mean_brightness);
            LocalColors {
                outside,
                slopes: weighted.map(|weighted| slope * weighted),
                contrast: whole.sqrt(),
                side: if is_shaded { Side::Shaded } else { Side::Lit },
            }
        });
        Some(Self { sectors })
    }

    /// Returns how far the colours on both sides differ, in grey levels: the median around the turn of the weighted distance.
    pub(crate) fn contrast(&self) -> f32 {
        let mut contrasts = self.sectors.map(|sector| sector.contrast);
        contrasts.sort_unstable_by(f32::total_cmp);
        contrasts[SECTORS / 2]
    }

    /// Returns the colours next to a pixel.
    #[inline(always)]
    pub fn at(&self, pixel: &EdgePixel) -> &LocalColors {
        &self.sectors[sector_of(pixel.turn)]
    }
}

impl LocalColors {
    /// Returns the side of the body.
    #[inline(always)]
    pub fn side(&self) -> Side {
        self.side
    }

    /// Returns the mean colour around the body.
    pub(crate) fn around(&self) -> [f32; 3] {
        self.outside
    }

    /// Returns the membership of a colour (Y, U and V): 0 for that which surrounds the body, 1 for the body's
    /// own, in between for mixtures; below 0 and above 1 for colours beyond these. NaN if the two are too similar.
    #[inline(always)]
    pub fn membership(&self, yuv: &[f32; 3]) -> f32 {
        let of_channel = |i: usize| (yuv[i] - self.outside[i]) * self.slopes[i];
        of_channel(0) + of_channel(1) + of_channel(2)
    }
}

/// Sums over the pixels near an outline.
#[derive(Default)]
struct OutlineSums {
    body: TurnSums,
    outside: TurnSums,
    shading: TurnSums,
}

impl OutlineSums {
    #[inline(always)]
    fn add(&mut self, pixel: &EdgePixel) {
        let sector = sector_of(pixel.turn);
        if pixel.distance_px <= BODY_DEPTH_PX {
            self.body.add(sector, pixel.yuv);
        }
        if SURROUNDINGS_PX.contains(&pixel.distance_px) {
            self.outside.add(sector, pixel.yuv);
        }
        if SHADING_PX.contains(&pixel.distance_px) {
            self.shading.add(sector, pixel.yuv);
        }
    }
}

/// The number of pixels and the sum of their colours in each sector of the turn.
struct TurnSums([[f32; 4]; SECTORS]);

impl Default for TurnSums {
    fn default() -> Self {
        Self([[0.0; 4]; SECTORS])
    }
}

impl TurnSums {
    #[inline(always)]
    fn add(&mut self, sector: usize, [y, u, v]: [f32; 3]) {
        for (sum, value) in self.0[sector].iter_mut().zip([1.0, y, u, v]) {
            *sum += value;
        }
    }

    /// The number of pixels.
    fn count(&self) -> f32 {
        self.0.iter().map(|[count, ..]| count).sum()
    }

    /// Their mean Y.
    fn mean_luma(&self) -> f32 {
        self.0.iter().map(|[_, luma, ..]| luma).sum::<f32>() / self.count()
    }

    /// The mean colour around the turn, weighted by the offset between sectors; `None` without pixels. One row per channel.
    fn means(&self, weights: &[f32; 2 * SECTORS]) -> Option<[[f32; SECTORS]; 3]> {
        let mut totals = [[0_f32; SECTORS]; 4];
        for (i, sums) in self.0.iter().enumerate().filter(|(_, sums)| sums[0] > 0.0) {
            // As far from one sector as to it: weights are even.
            let weights = &weights[SECTORS - i..][..SECTORS];
            for (totals, sum) in totals.iter_mut().zip(sums) {
                for (total, weight) in totals.iter_mut().zip(weights) {
                    *total += weight * sum;
                }
            }
        }
        let [counts, colors @ ..] = &mut totals;
        if counts[0] == 0.0 {
            return None;
        }
        for color in colors.iter_mut() {
            for (sum, count) in color.iter_mut().zip(&*counts) {
                *sum /= count;
            }
        }
        Some(*colors)
    }
}

/// Returns the distances of the deepest pixels in ascending order; `None` if there are too few pixels.
fn deepest(pixels: &[EdgePixel]) -> Option<[f32; MIN_BODY_PIXELS]> {
    if pixels.len() < MIN_BODY_PIXELS {
        return None;
    }
    // Positive NaN is the last in the total order.
    let mut deepest = [f32::NAN; MIN_BODY_PIXELS];
    for pixel in pixels {
        let mut distance_px = pixel.distance_px;
        for kept in &mut deepest {
            if distance_px.total_cmp(kept).is_lt() {
                std::mem::swap(kept, &mut distance_px);
            }
        }
    }
    Some(deepest)
}

#[inline(always)]
fn sector_of(turn: f32) -> usize {
    to_index(turn * SECTORS as f32 + 0.5, SECTORS as u16) % SECTORS
}

#[cfg(test)]
mod tests {
    use super::*;

    const ORANGE: [f32; 3] = [140.0, 60.0, 190.0];
    const GREEN: [f32; 3] = [90.0, 110.0, 100.0];

    fn mixed(share: f32) -> [f32; 3] {
        [0, 1, 2].map(|i| GREEN[i] + share * (ORANGE[i] - GREEN[i]))
    }

    /// An edge that changes from one colour to the other between −2 and 2 px.
    fn edge() -> Vec<EdgePixel> {
        let mut pixels = Vec::new();
        for turn in 0..100 {
            for step in -8..=8 {
                let distance_px = step as f32;
                pixels.push(EdgePixel {
                    yuv: mixed((0.5 - 0.25 * distance_px).clamp(0.0, 1.0)),
                    distance_px,
                    turn: turn as f32 / 100.0,
                });
            }
        }
        pixels
    }

    #[test]
    fn contrast_is_the_weighted_distance_of_the_colours_on_both_sides() {
        let [y, u, v] = [0, 1, 2].map(|i| (ORANGE[i] - GREEN[i]).powi(2));
        let expected = (y + 15.0 * u + 15.0 * v).sqrt();
        let contrast = |pixels: &[EdgePixel]| Surroundings::of(pixels).unwrap().contrast();
        let mut pixels = edge();
        assert!((contrast(&pixels) - expected).abs() < 1e-2 * expected);
        // The median hardly depends on the surroundings along a sixth of the turn, but for the smoothing along it.
        for pixel in pixels.iter_mut().filter(|pixel| pixel.turn < 0.16) {
            pixel.yuv = ORANGE;
        }
        assert!((contrast(&pixels) - expected).abs() < 5e-2 * expected);
        for pixel in &mut pixels {
            pixel.yuv = ORANGE;
        }
        assert!(contrast(&pixels) < 1e-3);
    }

    #[test]
    fn membership_falls_from_one_inside_to_zero_outside() {
        let pixels = edge();
        let surroundings = Surroundings::of(&pixels).unwrap();
        for pixel in &pixels {
            let expected = (0.5 - 0.25 * pixel.distance_px).clamp(0.0, 1.0);
            assert!((surroundings.at(pixel).membership(&pixel.yuv) - expected).abs() < 1e-5);
        }
    }

    #[test]
    fn membership_is_invariant_to_illumination_and_white_balance() {
        let pixels = edge();
        let lit: Vec<EdgePixel> = pixels
            .iter()
            .map(|pixel| EdgePixel {
                yuv: [0, 1, 2].map(|i| 0.7 * pixel.yuv[i] + [0.0, 11.0, -7.0][i]),
                ..*pixel
            })
            .collect();
        let [plain, lit_too] = [&pixels, &lit].map(|pixels| Surroundings::of(pixels).unwrap());
        for (pixel, lit) in pixels.iter().zip(&lit) {
            let [plain, lit] = [(&plain, pixel), (&lit_too, lit)]
                .map(|(surroundings, pixel)| surroundings.at(pixel).membership(&pixel.yuv));
            assert!((plain - lit).abs() < 1e-4);
        }
    }

    #[test]
    fn membership_is_nan_without_contrast() {
        let mut pixels = edge();
        for pixel in &mut pixels {
            pixel.yuv = GREEN;
        }
        let surroundings = Surroundings::of(&pixels).unwrap();
        assert!(
            surroundings
                .at(&pixels[0])
                .membership(&pixels[0].yuv)
                .is_nan()
        );
        assert_eq!(Surroundings::of(&[]), None);
        pixels.retain(|pixel| pixel.distance_px < 3.0);
        assert_eq!(Surroundings::of(&pixels), None);
    }

    #[test]
    fn the_darker_side_is_shaded() {
        let mut pixels = edge();
        for pixel in &mut pixels {
            let light = 1.0 + 0.2 * libm::cosf(std::f32::consts::TAU * pixel.turn);
            pixel.yuv[0] *= light;
        }
        let surroundings = Surroundings::of(&pixels).unwrap();
        for pixel in &pixels {
            let light = libm::cosf(std::f32::consts::TAU * pixel.turn);
            if light.abs() > 0.1 {
                let expected = if light > 0.0 { Side::Lit } else { Side::Shaded };
                assert_eq!(surroundings.at(pixel).side(), expected, "{}", pixel.turn);
            }
        }
    }
}
