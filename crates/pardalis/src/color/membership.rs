//! Membership of pixels near an outline: whether a colour is that of the body or of its surroundings,
//! measured relative to the colours on both sides nearby. It depends on neither the illumination, the white
//! balance nor the colour itself.

use std::sync::LazyLock;

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

/// Weights over the sectors of the turn, by their offset.
static WEIGHTS: LazyLock<[[f32; SECTORS]; 3]> = LazyLock::new(|| {
    let [body, outside] = CONCENTRATION;
    [body, outside, SHADING_CONCENTRATION].map(|concentration| {
        std::array::from_fn(|sector| {
            let angle = sector as f64 / SECTORS as f64 * std::f64::consts::TAU;
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
    /// For each sector of the turn: the mean colour around the body, and the difference from it to the body's
    /// own colour.
    sectors: [([f32; 3], [f32; 3]); SECTORS],
    sides: [Side; SECTORS],
}

impl Surroundings {
    /// Measures the colours on both sides of an outline; `None` if either side has too few pixels.
    pub fn of(pixels: &[EdgePixel]) -> Option<Self> {
        let is_deep = |pixel: &&EdgePixel| pixel.distance_px <= BODY_DEPTH_PX;
        let deepest_px = if pixels.iter().filter(is_deep).count() >= MIN_BODY_PIXELS {
            BODY_DEPTH_PX
        } else {
            deepest(pixels)?[MIN_BODY_PIXELS - 1].min(0.0)
        };
        let body = mean_colors(pixels, &WEIGHTS[0], |distance| distance <= deepest_px)?;
        let outside = mean_colors(pixels, &WEIGHTS[1], |distance| {
            SURROUNDINGS_PX.contains(&distance)
        })?;
        let sectors = std::array::from_fn(|sector| {
            let (body, outside) = (body[sector], outside[sector]);
            (outside, [0, 1, 2].map(|i| body[i] - outside[i]))
        });
        let sides = sides(pixels).unwrap_or([Side::Lit; SECTORS]);
        Some(Self { sectors, sides })
    }

    /// Returns how far the colours on both sides differ, in grey levels: the median around the turn of the weighted distance.
    pub(crate) fn contrast(&self) -> f32 {
        let mut contrasts = self.sectors.map(|(_, difference)| {
            let weighted = (0..3).map(|i| CHANNEL_WEIGHTS[i] * difference[i].powi(2));
            weighted.sum::<f32>().sqrt()
        });
        contrasts.sort_unstable_by(f32::total_cmp);
        contrasts[SECTORS / 2]
    }

    /// Returns the side of the body on which a pixel lies.
    pub fn side(&self, pixel: &EdgePixel) -> Side {
        self.sides[sector_of(pixel.turn)]
    }

    /// Returns the mean colour around the body next to a pixel.
    pub(crate) fn around(&self, pixel: &EdgePixel) -> [f32; 3] {
        self.sectors[sector_of(pixel.turn)].0
    }

    /// Returns the membership of a pixel: 0 for the colour that surrounds the body there, 1 for the body's
    /// own colour, in between for mixtures; below 0 and above 1 for colours beyond these. NaN if the two
    /// colours are too similar.
    pub fn membership(&self, pixel: &EdgePixel) -> f32 {
        let (outside, difference) = &self.sectors[sector_of(pixel.turn)];
        let (mut along, mut whole) = (0.0, 0.0);
        for i in 0..3 {
            let weighted = CHANNEL_WEIGHTS[i] * difference[i];
            along += (pixel.yuv[i] - outside[i]) * weighted;
            whole += difference[i] * weighted;
        }
        if whole < MIN_CONTRAST {
            f32::NAN
        } else {
            along / whole
        }
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

/// Classifies each sector as shaded or lit; `None` if no pixel lies at a suitable distance.
fn sides(pixels: &[EdgePixel]) -> Option<[Side; SECTORS]> {
    let (mut luma, mut count) = (0.0, 0.0);
    for pixel in pixels {
        if SHADING_PX.contains(&pixel.distance_px) {
            luma += pixel.yuv[0];
            count += 1.0;
        }
    }
    let local = mean_colors(pixels, &WEIGHTS[2], |distance| {
        SHADING_PX.contains(&distance)
    })?;
    Some(local.map(|[here, _, _]| {
        if here < luma / count {
            Side::Shaded
        } else {
            Side::Lit
        }
    }))
}

fn sector_of(turn: f32) -> usize {
    ((turn * SECTORS as f32 + 0.5) as usize) % SECTORS
}

/// Computes the mean colour around the turn of the pixels at the accepted distances.
fn mean_colors(
    pixels: &[EdgePixel],
    weights: &[f32; SECTORS],
    accepts: impl Fn(f32) -> bool,
) -> Option<[[f32; 3]; SECTORS]> {
    // Pixel count and colour sum of each sector.
    let mut sums = [[0_f32; 4]; SECTORS];
    for pixel in pixels.iter().filter(|pixel| accepts(pixel.distance_px)) {
        let [y, u, v] = pixel.yuv;
        for (sum, value) in sums[sector_of(pixel.turn)].iter_mut().zip([1.0, y, u, v]) {
            *sum += value;
        }
    }
    if sums.iter().all(|sum| sum[0] == 0.0) {
        return None;
    }
    Some(std::array::from_fn(|sector| {
        let mut total = [0_f32; 4];
        for (i, sum) in sums.iter().enumerate() {
            let weight = weights[(i + SECTORS - sector) % SECTORS];
            for (total, value) in total.iter_mut().zip(sum) {
                *total += weight * value;
            }
        }
        let [count, y, u, v] = total;
        [y, u, v].map(|sum| sum / count)
    }))
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
            assert!((surroundings.membership(pixel) - expected).abs() < 1e-5);
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
            assert!((plain.membership(pixel) - lit_too.membership(lit)).abs() < 1e-4);
        }
    }

    #[test]
    fn membership_is_nan_without_contrast() {
        let mut pixels = edge();
        for pixel in &mut pixels {
            pixel.yuv = GREEN;
        }
        let surroundings = Surroundings::of(&pixels).unwrap();
        assert!(surroundings.membership(&pixels[0]).is_nan());
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
                assert_eq!(surroundings.side(pixel), expected, "{}", pixel.turn);
            }
        }
    }
}
