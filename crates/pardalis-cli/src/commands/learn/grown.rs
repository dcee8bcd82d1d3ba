//! The region of an image that has one colour, around a pixel that was pointed at: a first guess of a target, before its colours are known.

use std::collections::VecDeque;

use pardalis::Frame;

use super::balls::{Circle, circle_of, circle_of_area, parts};

/// Half the side of the square whose mean colour is that of the region, pixels.
const SEED_PX: usize = 2;
/// Differences of colour up to which the region grows, in steps: of chroma plus a part of those of brightness, each from 0 to 255. Hand-set: noise has
/// 4, a ball and its surroundings differ by 30 and more.
const LEVELS: [f32; 27] = [
    6.0, 7.0, 8.0, 9.0, 10.0, 11.5, 13.0, 14.5, 16.0, 18.0, 20.0, 22.5, 25.0, 28.0, 31.0, 34.0,
    38.0, 42.0, 47.0, 52.0, 58.0, 64.0, 70.0, 77.0, 85.0, 92.0, 100.0,
];
/// The growth of a region is measured from this many levels below its own to this many above.
const GROWTH_LEVELS: usize = 2;
/// The weight of differences of brightness, which light and shade change. Hand-set.
const BRIGHTNESS_WEIGHT: f32 = 0.3;
/// The smallest region, in pixels. Hand-set: as small as a ball can be detected.
const MIN_PX: usize = 12;
/// Half the width of arms that are cut off a region, such as bridges to what has a similar colour, as a share of its radius. Hand-set.
const ARM_RADII: f64 = 0.15;
/// The largest region, as a share of the image. Hand-set.
const MAX_SHARE: f64 = 0.4;

/// Returns the round region of one colour around a pixel, as the circle with its centre and area: of those that grow around it, the one that grows
/// least as its colour is given more room. `None` if none is round.
pub(super) fn round_region(frame: &Frame, at: [f64; 2]) -> Option<Circle> {
    steadiest(frame, at, circle_of)
}

/// Returns the circle with the centre and area of the region of one colour around a pixel, like [`round_region`], whatever its shape: where a ball has
/// highlights and is reflected, the region is a part of it, or more than it.
pub(super) fn rough_region(frame: &Frame, at: [f64; 2]) -> Option<Circle> {
    steadiest(frame, at, |part| Some(circle_of_area(part)))
}

/// Returns the circle of the region that grows least, among those that have one.
fn steadiest(
    frame: &Frame,
    [u, v]: [f64; 2],
    circle: impl Fn(&[(usize, usize)]) -> Option<Circle>,
) -> Option<Circle> {
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
        regions.push(without_arms(&without_holes(&part)));
    }
    // Of the first and the last ones, how much they grow is not known.
    let known = GROWTH_LEVELS..regions.len().saturating_sub(GROWTH_LEVELS);
    let circles = known.filter_map(|number| {
        let part = &regions[number];
        let pixels = |number: usize| regions[number].len() as f64;
        let grown = pixels(number + GROWTH_LEVELS) - pixels(number - GROWTH_LEVELS);
        let circle = circle(part).filter(|_| part.len() >= MIN_PX)?;
        Some((grown / pixels(number), circle))
    });
    let steadiest = circles.min_by(|a, b| a.0.total_cmp(&b.0));
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

/// A part as a picture of its own.
struct Window {
    /// The column and row of its first pixel. Beyond the part, it has a margin of one pixel on all sides.
    first: (usize, usize),
    size: (usize, usize),
    is_in: Vec<bool>,
}

impl Window {
    fn of(part: &[(usize, usize)]) -> Self {
        let (columns, rows) = (part.iter().map(|p| p.0), part.iter().map(|p| p.1));
        let left = columns.clone().min().unwrap_or(0);
        let top = rows.clone().min().unwrap_or(0);
        let width = columns.max().unwrap_or(0) - left + 3;
        let height = rows.max().unwrap_or(0) - top + 3;
        let mut is_in = vec![false; width * height];
        for (x, y) in part {
            is_in[(y - top + 1) * width + x - left + 1] = true;
        }
        Self {
            first: (left, top),
            size: (width, height),
            is_in,
        }
    }

    /// Returns the pixels that are in, in the image.
    fn part(&self) -> Vec<(usize, usize)> {
        let inside = (0..self.is_in.len()).filter(|&index| self.is_in[index]);
        let (width, (left, top)) = (self.size.0, self.first);
        inside
            .map(|index| (index % width + left - 1, index / width + top - 1))
            .collect()
    }

    /// Takes a layer of pixels off the outline, or adds one. Layers of diamonds and squares take turns, which makes octagons of points.
    fn change_layer(&mut self, number: usize, is_added: bool) {
        let (width, height) = self.size;
        let before = self.is_in.clone();
        for y in 1..height - 1 {
            for x in 1..width - 1 {
                let around = (y - 1..y + 2).flat_map(|v| (x - 1..x + 2).map(move |u| (u, v)));
                let near = around.filter(|(u, v)| number.is_multiple_of(2) || *u == x || *v == y);
                let mut near = near.map(|(u, v)| before[v * width + u]);
                if near.any(|is_in| is_in == is_added) {
                    self.is_in[y * width + x] = is_added;
                }
            }
        }
    }
}

/// Returns the pixels of a part and those that it encloses, such as highlights.
fn without_holes(part: &[(usize, usize)]) -> Vec<(usize, usize)> {
    let mut window = Window::of(part);
    let mut is_other: Vec<bool> = window.is_in.iter().map(|is_in| !is_in).collect();
    let width = window.size.0;
    let mut next = vec![(0, 0)];
    is_other[0] = false;
    window.is_in.fill(true);
    while let Some((x, y)) = next.pop() {
        window.is_in[y * width + x] = false;
        for (x, y) in neighbours((x, y), window.size) {
            if std::mem::take(&mut is_other[y * width + x]) {
                next.push((x, y));
            }
        }
    }
    window.part()
}

/// Returns the main body of a part, without arms.
fn without_arms(part: &[(usize, usize)]) -> Vec<(usize, usize)> {
    let layers = (ARM_RADII * (part.len() as f64 / std::f64::consts::PI).sqrt()) as usize;
    let mut window = Window::of(part);
    let whole = window.is_in.clone();
    for layer in 0..layers {
        window.change_layer(layer, false);
    }
    let width = window.size.0;
    let bodies = parts(&window.is_in, width);
    let Some(main) = bodies.iter().max_by_key(|body| body.len()) else {
        return part.to_vec();
    };
    window.is_in.fill(false);
    for (x, y) in main {
        window.is_in[y * width + x] = true;
    }
    for layer in (0..layers).rev() {
        window.change_layer(layer, true);
    }
    for (is_in, was_in) in window.is_in.iter_mut().zip(whole) {
        *is_in &= was_in;
    }
    window.part()
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
    fn what_touches_a_ball_and_has_a_similar_colour_is_cut_off() {
        let frame = ball([80.0, 60.0, 20.0], [240.0, 120.0, 20.0]);
        let mut rgb = frame.to_rgb8();
        for (x, y) in (95..150).flat_map(|x| (58..62).map(move |y| (x, y))) {
            rgb[3 * (y * 160 + x)..][..3].copy_from_slice(&[190, 95, 20]);
        }
        let frame = Frame::from_rgb(160, 120, rgb, 0.0).unwrap();
        let found = round_region(&frame, [80.0, 60.0]).unwrap();
        let off = (found.center_px[0] - 80.0).hypot(found.center_px[1] - 60.0);
        assert!(
            off < 1.5 && (found.radius_px - 20.0).abs() < 1.5,
            "{found:?}"
        );
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
