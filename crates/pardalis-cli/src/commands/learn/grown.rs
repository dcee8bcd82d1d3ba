//! The region of an image that has one colour, around a pixel that was pointed at: a first guess of a target, before its colours are known.

use std::collections::VecDeque;

use pardalis::Frame;

use super::balls::{Circle, circle_of};

/// Half the side of the square whose mean colour is that of the region, pixels.
const SEED_PX: usize = 2;
/// Differences of colour up to which the region grows, in steps: of chroma plus a part of those of brightness, each from 0 to 255. Hand-set: noise has
/// 4, a ball and its surroundings differ by 30 and more.
const LEVELS: [f32; 14] = [
    6.0, 8.0, 10.0, 13.0, 16.0, 20.0, 25.0, 31.0, 38.0, 47.0, 58.0, 70.0, 85.0, 100.0,
];
/// The weight of differences of brightness, which light and shade change. Hand-set.
const BRIGHTNESS_WEIGHT: f32 = 0.3;
/// The smallest region, in pixels. Hand-set: as small as a ball can be detected.
const MIN_PX: usize = 12;
/// The largest region, as a share of the image. Hand-set.
const MAX_SHARE: f64 = 0.4;

/// Returns the round region of one colour around a pixel, as the circle with its centre and area: of those that grow around it, the one that grows
/// least as its colour is given more room. `None` if none is round.
pub(super) fn round_region(frame: &Frame, [u, v]: [f64; 2]) -> Option<Circle> {
    let (width, height) = (frame.width(), frame.height());
    let inside =
        |at: f64, side: usize| (at.round() >= 0.0).then_some((at.round() as usize).min(side - 1));
    let seed = (inside(u, width)?, inside(v, height)?);
    let differences = differences(frame, seed);
    let mut regions = Vec::new();
    for level in LEVELS {
        let part = part_around(&differences, width, seed, level);
        if part.len() as f64 > MAX_SHARE * (width * height) as f64 {
            break;
        }
        regions.push(without_holes(&part));
    }
    let growth = |number: usize| {
        let before = regions[number.saturating_sub(1)].len() as f64;
        let after = regions.get(number + 1).unwrap_or(&regions[number]).len() as f64;
        (after - before) / regions[number].len() as f64
    };
    let round = regions
        .iter()
        .enumerate()
        .filter(|(_, part)| part.len() >= MIN_PX);
    let round = round.filter_map(|(number, part)| Some((growth(number), circle_of(part)?)));
    let steadiest = round.min_by(|a, b| a.0.total_cmp(&b.0));
    steadiest.map(|(_, circle)| circle)
}

/// Returns how much each pixel differs in colour from those around the seed.
fn differences(frame: &Frame, (x, y): (usize, usize)) -> Vec<f32> {
    let (width, height) = (frame.width(), frame.height());
    let rgb = frame.to_rgb8();
    let (pixels, _) = rgb.as_chunks::<3>();
    let colors: Vec<[f32; 3]> = pixels.iter().map(|rgb| opponent(*rgb)).collect();
    let (mut sum, mut count) = ([0.0; 3], 0.0);
    for row in y.saturating_sub(SEED_PX)..=(y + SEED_PX).min(height - 1) {
        for column in x.saturating_sub(SEED_PX)..=(x + SEED_PX).min(width - 1) {
            let color = colors[row * width + column];
            sum = [0, 1, 2].map(|i| sum[i] + color[i]);
            count += 1.0;
        }
    }
    let seed = sum.map(|channel| channel / count);
    let difference = |color: &[f32; 3]| {
        let [brightness, a, b] = [0, 1, 2].map(|i| color[i] - seed[i]);
        libm::sqrtf(a * a + b * b) + BRIGHTNESS_WEIGHT * brightness.abs()
    };
    colors.iter().map(difference).collect()
}

/// Returns brightness and two differences of channels, relative to the brightness so that shade changes them little.
fn opponent([r, g, b]: [u8; 3]) -> [f32; 3] {
    let [r, g, b] = [r, g, b].map(f32::from);
    let brightness = (r + g + b) / 3.0;
    // Dark pixels have no reliable colour.
    let scale = 255.0 / (brightness + 64.0);
    [
        brightness,
        0.5 * (r - g) * scale,
        0.25 * (r + g - 2.0 * b) * scale,
    ]
}

/// Returns the pixels that are connected to the seed and differ by at most this much.
fn part_around(
    differences: &[f32],
    width: usize,
    (x, y): (usize, usize),
    level: f32,
) -> Vec<(usize, usize)> {
    let height = differences.len() / width;
    let mut is_taken = vec![false; differences.len()];
    is_taken[y * width + x] = true;
    let (mut part, mut next) = (Vec::new(), VecDeque::from([(x, y)]));
    while let Some((x, y)) = next.pop_front() {
        part.push((x, y));
        for (x, y) in neighbours((x, y), (width, height)) {
            let index = y * width + x;
            if !is_taken[index] && differences[index] <= level {
                is_taken[index] = true;
                next.push_back((x, y));
            }
        }
    }
    part
}

/// Returns the pixels of a part and those that it encloses, such as highlights.
fn without_holes(part: &[(usize, usize)]) -> Vec<(usize, usize)> {
    let (columns, rows) = (part.iter().map(|p| p.0), part.iter().map(|p| p.1));
    let (left, top) = (
        columns.clone().min().unwrap_or(0),
        rows.clone().min().unwrap_or(0),
    );
    // With a margin of one pixel on all sides, which is outside.
    let width = columns.max().unwrap_or(0) - left + 3;
    let height = rows.max().unwrap_or(0) - top + 3;
    let mut is_other = vec![true; width * height];
    for (x, y) in part {
        is_other[(y - top + 1) * width + x - left + 1] = false;
    }
    let mut next = vec![(0, 0)];
    is_other[0] = false;
    let mut is_outside = vec![false; width * height];
    while let Some((x, y)) = next.pop() {
        is_outside[y * width + x] = true;
        for (x, y) in neighbours((x, y), (width, height)) {
            if std::mem::take(&mut is_other[y * width + x]) {
                next.push((x, y));
            }
        }
    }
    let inside = (0..width * height).filter(|&index| !is_outside[index]);
    inside
        .map(|index| (index % width + left - 1, index / width + top - 1))
        .collect()
}

fn neighbours(
    (x, y): (usize, usize),
    (width, height): (usize, usize),
) -> impl Iterator<Item = (usize, usize)> {
    let beside = [
        (x > 0).then(|| (x - 1, y)),
        (x + 1 < width).then_some((x + 1, y)),
        (y > 0).then(|| (x, y - 1)),
        (y + 1 < height).then_some((x, y + 1)),
    ];
    beside.into_iter().flatten()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A ball, lit from above, with a highlight, before a background that varies.
    fn ball([u, v, radius]: [f64; 3], color: [f64; 3]) -> Frame {
        let pixel = |i: usize| {
            let (x, y) = ((i % 160) as f64, (i / 160) as f64);
            let (dx, dy) = (x - u, y - v);
            let noise = ((i * 7919) % 13) as f64 - 6.0;
            let rgb = if dx.hypot(dy) >= radius {
                [90.0, 100.0 + 0.2 * x, 95.0]
            } else if (dx + 0.3 * radius).hypot(dy + 0.3 * radius) < 0.2 * radius {
                [250.0, 245.0, 240.0]
            } else {
                color.map(|channel| channel * (0.75 - 0.25 * dy / radius))
            };
            rgb.map(|channel| (channel + noise).clamp(0.0, 255.0) as u8)
        };
        let pixels: Vec<u8> = (0..160 * 120).flat_map(pixel).collect();
        Frame::from_rgb(160, 120, pixels, 0.0).unwrap()
    }

    #[test]
    fn the_region_of_a_shaded_ball_is_the_ball_wherever_it_is_pointed_at() {
        for color in [
            [240.0, 120.0, 20.0],
            [30.0, 60.0, 230.0],
            [240.0, 240.0, 30.0],
        ] {
            for [u, v, radius] in [[80.0, 60.0, 20.0], [40.0, 70.0, 8.0], [100.0, 50.0, 40.0]] {
                let frame = ball([u, v, radius], color);
                for at in [[u, v], [u + 0.5 * radius, v], [u, v + 0.7 * radius]] {
                    let found = round_region(&frame, at).unwrap();
                    let off = (found.center_px[0] - u).hypot(found.center_px[1] - v);
                    assert!(off < 0.1 * radius, "{color:?} {radius} {at:?}: {found:?}");
                    let size = found.radius_px / radius;
                    assert!(
                        (0.88..1.08).contains(&size),
                        "{color:?} {radius} {at:?}: {found:?}"
                    );
                }
            }
        }
    }

    #[test]
    fn what_is_not_round_is_no_region() {
        let frame = ball([80.0, 60.0, 20.0], [240.0, 120.0, 20.0]);
        // The background, and beyond the image.
        for at in [[10.0, 10.0], [-5.0, 4.0]] {
            assert_eq!(round_region(&frame, at), None, "{at:?}");
        }
        let bar = |i: usize| match (i % 160, i / 160) {
            (20..140, 50..58) => [240_u8, 120, 20],
            _ => [90, 100, 95],
        };
        let pixels: Vec<u8> = (0..160 * 120).flat_map(bar).collect();
        let frame = Frame::from_rgb(160, 120, pixels, 0.0).unwrap();
        assert_eq!(round_region(&frame, [80.0, 54.0]), None);
    }
}
