//! Which side of an outline a pixel's colour belongs to, by the colours on both sides nearby: whatever the light, the white balance and the colour.

use std::sync::LazyLock;

/// A pixel near an outline.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EdgePixel {
    /// Its colour: Y, U and V of BT.601, full range, 0 to 255.
    pub yuv: [f32; 3],
    /// How far its centre lies from the outline in pixels, negative inside.
    pub distance_px: f32,
    /// Where around the outline it lies, as a share of the turn from 0 to 1.
    pub turn: f32,
}

/// Parts of the turn around an outline that have colours of their own. Hand-set.
const PARTS: usize = 64;
/// Pixels at least this deep inside show the body alone, pixels, ... Hand-set: beyond the blur of edges.
const BODY_PX: f32 = -2.0;
/// ... or, in small bodies, this many of the deepest. Hand-set.
const FEWEST: usize = 6;
/// Pixels at these signed distances show what surrounds it, pixels. Hand-set.
const AROUND_PX: std::ops::Range<f32> = 3.0..7.0;
/// The concentration of the von Mises weights of colours around the turn, for the body and for what surrounds it. Hand-set.
const CONCENTRATION: [f64; 2] = [2.0, 4.0];
/// The same for brightness, and the signed distances of the pixels that give it, pixels. Hand-set.
const SHADING_CONCENTRATION: f64 = 4.0;
const SHADING_PX: std::ops::RangeInclusive<f32> = -6.0..=-1.2;
/// Weights of squared differences of Y, U and V. Hand-set: chroma changes less with shadows.
const CHANNEL_WEIGHTS: [f32; 3] = [1.0, 15.0, 15.0];
/// Colours with a smaller squared weighted difference have no membership. Hand-set.
const LEAST_CONTRAST: f32 = 100.0;

/// Weights over the parts of the turn, by how far they are away.
static WEIGHTS: LazyLock<[[f32; PARTS]; 3]> = LazyLock::new(|| {
    let [body, outside] = CONCENTRATION;
    [body, outside, SHADING_CONCENTRATION].map(|concentration| {
        std::array::from_fn(|part| {
            let angle = part as f64 / PARTS as f64 * std::f64::consts::TAU;
            libm::exp(concentration * (libm::cos(angle) - 1.0)) as f32
        })
    })
});

/// A side of a body, by its shading: what is round grows dark well inside its outline where it turns away from the light, and stays bright up to it on the other side.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Side {
    /// Darker than the mean of the body.
    Shaded,
    /// As bright, or brighter.
    Lit,
}

impl Side {
    /// Both.
    pub const ALL: [Self; 2] = [Self::Shaded, Self::Lit];
}

/// The colours inside and outside along an outline.
#[derive(Debug, Clone, PartialEq)]
pub struct Surroundings {
    /// Of each part of the turn: the mean colour around the body, and the difference from there to the body's own.
    parts: [([f32; 3], [f32; 3]); PARTS],
    sides: [Side; PARTS],
}

impl Surroundings {
    /// Of the pixels on both sides of an outline; `None` where there are too few on either.
    pub fn of(pixels: &[EdgePixel]) -> Option<Self> {
        let is_deep = |pixel: &&EdgePixel| pixel.distance_px <= BODY_PX;
        let deepest_px = if pixels.iter().filter(is_deep).count() >= FEWEST {
            BODY_PX
        } else {
            deepest(pixels)?[FEWEST - 1].min(0.0)
        };
        let body = around(pixels, &WEIGHTS[0], |distance| distance <= deepest_px)?;
        let outside = around(pixels, &WEIGHTS[1], |distance| {
            AROUND_PX.contains(&distance)
        })?;
        let parts = std::array::from_fn(|part| {
            let (body, outside) = (body[part], outside[part]);
            (outside, [0, 1, 2].map(|i| body[i] - outside[i]))
        });
        let sides = sides(pixels).unwrap_or([Side::Lit; PARTS]);
        Some(Self { parts, sides })
    }

    /// The side of the body on which a pixel lies.
    pub fn side(&self, pixel: &EdgePixel) -> Side {
        self.sides[part_of(pixel.turn)]
    }

    /// 0 for the colour that surrounds the body there, 1 for the body's own, in between for mixtures; below and above for colours beyond them. NaN where the two
    /// are not told apart.
    pub fn membership(&self, pixel: &EdgePixel) -> f32 {
        let (outside, difference) = &self.parts[part_of(pixel.turn)];
        let (mut along, mut whole) = (0.0, 0.0);
        for i in 0..3 {
            let weighted = CHANNEL_WEIGHTS[i] * difference[i];
            along += (pixel.yuv[i] - outside[i]) * weighted;
            whole += difference[i] * weighted;
        }
        if whole < LEAST_CONTRAST {
            f32::NAN
        } else {
            along / whole
        }
    }
}

/// The distances of the deepest pixels, in ascending order; `None` if there are not enough pixels.
fn deepest(pixels: &[EdgePixel]) -> Option<[f32; FEWEST]> {
    if pixels.len() < FEWEST {
        return None;
    }
    // Positive NaN is the last in the total order.
    let mut deepest = [f32::NAN; FEWEST];
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

/// The side of each part of the turn; `None` where no pixel tells.
fn sides(pixels: &[EdgePixel]) -> Option<[Side; PARTS]> {
    let (mut luma, mut count) = (0.0, 0.0);
    for pixel in pixels {
        if SHADING_PX.contains(&pixel.distance_px) {
            luma += pixel.yuv[0];
            count += 1.0;
        }
    }
    let local = around(pixels, &WEIGHTS[2], |distance| {
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

fn part_of(turn: f32) -> usize {
    ((turn * PARTS as f32 + 0.5) as usize) % PARTS
}

/// The mean colour, around the turn, of the pixels at some distances.
fn around(
    pixels: &[EdgePixel],
    weights: &[f32; PARTS],
    takes: impl Fn(f32) -> bool,
) -> Option<[[f32; 3]; PARTS]> {
    // Number and sum of the colours in each part.
    let mut sums = [[0_f32; 4]; PARTS];
    for pixel in pixels.iter().filter(|pixel| takes(pixel.distance_px)) {
        let [y, u, v] = pixel.yuv;
        for (sum, value) in sums[part_of(pixel.turn)].iter_mut().zip([1.0, y, u, v]) {
            *sum += value;
        }
    }
    if sums.iter().all(|sum| sum[0] == 0.0) {
        return None;
    }
    Some(std::array::from_fn(|part| {
        let mut total = [0_f32; 4];
        for (i, sum) in sums.iter().enumerate() {
            let weight = weights[(i + PARTS - part) % PARTS];
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

    /// An edge that goes over from one colour to the other between −2 and 2 px.
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
    fn colours_go_over_from_one_inside_to_zero_outside() {
        let pixels = edge();
        let surroundings = Surroundings::of(&pixels).unwrap();
        for pixel in &pixels {
            let expected = (0.5 - 0.25 * pixel.distance_px).clamp(0.0, 1.0);
            assert!((surroundings.membership(pixel) - expected).abs() < 1e-5);
        }
    }

    #[test]
    fn neither_light_nor_white_balance_matters() {
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
    fn what_cannot_be_told_apart_has_no_membership() {
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
    fn the_darker_side_is_the_shaded_one() {
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
