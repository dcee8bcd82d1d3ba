//! Straight edges in an image: Canny edges, grouped by a Hough transform and fitted.
//!
//! Each edge has a brighter side, so that the two edges of a tape are not confused.

use std::f64::consts::PI;

use pardalis_images::GrayImage;

use super::{canny, hough};

/// Low and high threshold of the Canny detector, as Sobel gradients: steps of about 8 and 16 grey levels.
const CANNY_THRESHOLDS: [f32; 2] = [16.0, 32.0];

/// Standard deviation of the blur before the gradients are computed.
const BLUR_PX: f32 = 1.4;

/// Sobel gradient of one grey level per pixel.
const SOBEL_GAIN: f64 = 8.0;

/// Edges vote in groups of similar direction: number of groups, and half the range of directions in each.
const SECTORS: usize = 12;
const SECTOR_HALF_RAD: f64 = 22.0 * PI / 180.0;

/// Least number of votes divided by the image's shorter side.
const MIN_VOTES_FRACTION: f64 = 0.06;
const SUPPRESSION_RADIUS: usize = 3;

/// An edge pixel belongs to a line within this distance and angle.
const HIT_DISTANCE_PX: f64 = 1.5;
const HIT_ANGLE_RAD: f64 = 15.0 * PI / 180.0;

/// Lines within this distance along their visible parts and within this angle are the same.
const SAME_DISTANCE_PX: f64 = 1.5;
const SAME_ANGLE_RAD: f64 = 2.0 * PI / 180.0;

/// Maximum number of lines; the most conspicuous are kept.
const MAX_LINES: usize = 100;

/// A pixel on an edge.
#[derive(Debug, Clone, Copy)]
struct EdgePixel {
    pixel: [f64; 2],
    /// Direction to the brighter side, from x towards y of the image.
    direction_rad: f64,
    /// In grey levels per pixel.
    gradient: f64,
}

/// A straight line with edges along it: the points p with `normal` · p = `offset_px`.
#[derive(Debug, Clone)]
pub(super) struct Line {
    /// Unit vector towards the brighter side.
    pub(super) normal: [f64; 2],
    pub(super) offset_px: f64,
    /// Position along the line, `tangent` · p, at which `sums` begin, in pixels.
    first_px: f64,
    /// For each pixel along the line, the number of earlier pixels with an edge and the sum of their gradients.
    sums: Vec<(f64, f64)>,
}

impl Line {
    /// Returns the unit vector along the line.
    pub(super) fn tangent(&self) -> [f64; 2] {
        [self.normal[1], -self.normal[0]]
    }

    /// Returns the position of a point along the line, in pixels.
    pub(super) fn along(&self, p: [f64; 2]) -> f64 {
        dot(self.tangent(), p)
    }

    /// Returns the intersection of two lines; `None` if they are parallel.
    pub(super) fn meets(&self, other: &Line) -> Option<[f64; 2]> {
        let ([a, b], [c, d]) = (self.normal, other.normal);
        let determinant = a * d - b * c;
        let (p, q) = (self.offset_px, other.offset_px);
        (determinant.abs() > 1e-6)
            .then(|| [(p * d - q * b) / determinant, (a * q - c * p) / determinant])
    }

    /// Returns, between two positions along the line, the fraction with an edge and the mean gradient in grey levels per
    /// pixel, where pixels without an edge count as 0.
    pub(super) fn support(&self, from_px: f64, to_px: f64) -> (f64, f64) {
        let last = (self.sums.len() - 1) as f64;
        let at =
            |position: f64| self.sums[(position - self.first_px).round().clamp(0.0, last) as usize];
        let (from, to) = (at(from_px), at(to_px));
        let length_px = (to_px - from_px).max(1.0);
        ((to.0 - from.0) / length_px, (to.1 - from.1) / length_px)
    }

    /// Returns the sum of the gradients along the line.
    fn strength(&self) -> f64 {
        self.sums[self.sums.len() - 1].1
    }
}

pub(super) fn dot(a: [f64; 2], b: [f64; 2]) -> f64 {
    a[0] * b[0] + a[1] * b[1]
}

/// Returns the straight edges of an image, the most conspicuous first.
pub(super) fn find(image: &GrayImage) -> Vec<Line> {
    let edges = edge_pixels(image);
    let (width, height) = image.dimensions();
    let least_votes = (MIN_VOTES_FRACTION * f64::from(width.min(height))).max(16.0) as u32;
    let mut found = Vec::new();
    for sector in 0..SECTORS {
        let middle_rad = 2.0 * PI * sector as f64 / SECTORS as f64;
        let is_near = |e: &&EdgePixel| turn(e.direction_rad, middle_rad) <= SECTOR_HALF_RAD;
        let near: Vec<EdgePixel> = edges.iter().filter(is_near).copied().collect();
        let voters = near.iter().map(|e| e.pixel.map(|c| c as u32));
        for polar in hough::lines(voters, (width, height), least_votes, SUPPRESSION_RADIUS) {
            let angle_rad = f64::from(polar.angle_deg as u32).to_radians();
            // Lines of the Hough transform do not distinguish the sides.
            let (angle_rad, offset_px) = if turn(angle_rad, middle_rad) <= PI / 2.0 {
                (angle_rad, f64::from(polar.offset_px))
            } else {
                (angle_rad + PI, -f64::from(polar.offset_px))
            };
            if turn(angle_rad, middle_rad) <= SECTOR_HALF_RAD {
                found.extend(fitted(&near, angle_rad, offset_px));
            }
        }
    }
    found.sort_by(|a, b| b.strength().total_cmp(&a.strength()));
    let mut lines: Vec<Line> = Vec::new();
    for line in found {
        if lines.len() < MAX_LINES && !lines.iter().any(|known| is_same(known, &line)) {
            lines.push(line);
        }
    }
    lines
}

/// Returns the angle between two directions, 0 to pi.
fn turn(a_rad: f64, b_rad: f64) -> f64 {
    let difference = (a_rad - b_rad).rem_euclid(2.0 * PI);
    difference.min(2.0 * PI - difference)
}

/// Finds edge pixels with the Canny detector.
fn edge_pixels(image: &GrayImage) -> Vec<EdgePixel> {
    let gradients = canny::blurred_gradients(image, BLUR_PX);
    let edges = canny::edges(&gradients, CANNY_THRESHOLDS);
    edges
        .enumerate_pixels()
        .filter(|(_, _, value)| value[0] > 0)
        .map(|(x, y, _)| {
            let [gx, gy] = gradients.get_pixel(x, y).map(f64::from);
            EdgePixel {
                pixel: [f64::from(x), f64::from(y)],
                direction_rad: libm::atan2(gy, gx),
                gradient: libm::hypot(gx, gy) / SOBEL_GAIN,
            }
        })
        .collect()
}

/// Fits a line to the edges near one of the Hough transform.
fn fitted(edges: &[EdgePixel], angle_rad: f64, offset_px: f64) -> Option<Line> {
    let (mut angle_rad, mut offset_px) = (angle_rad, offset_px);
    for distance_px in [2.5, HIT_DISTANCE_PX] {
        let near = |e: &&EdgePixel| is_hit(e, angle_rad, offset_px, distance_px);
        let near: Vec<[f64; 2]> = edges.iter().filter(near).map(|e| e.pixel).collect();
        let count = near.len() as f64;
        let mean = [0, 1].map(|c| near.iter().map(|p| p[c]).sum::<f64>() / count);
        let moment = |a: usize, b: usize| {
            let products = near.iter().map(|p| (p[a] - mean[a]) * (p[b] - mean[b]));
            products.sum::<f64>()
        };
        // The scatter is greatest along the line.
        let along_rad = 0.5 * libm::atan2(2.0 * moment(0, 1), moment(0, 0) - moment(1, 1));
        let across_rad = along_rad + PI / 2.0;
        angle_rad = if turn(across_rad, angle_rad) < PI / 2.0 {
            across_rad
        } else {
            across_rad + PI
        };
        offset_px = dot([libm::cos(angle_rad), libm::sin(angle_rad)], mean);
    }
    // NaN if there were no edges.
    offset_px.is_finite().then_some(())?;
    let normal = [libm::cos(angle_rad), libm::sin(angle_rad)];
    let tangent = [normal[1], -normal[0]];
    let hits: Vec<(f64, f64)> = edges
        .iter()
        .filter(|e| is_hit(e, angle_rad, offset_px, HIT_DISTANCE_PX))
        .map(|e| (dot(tangent, e.pixel), e.gradient))
        .collect();
    let ends = |pick: fn(f64, f64) -> f64| hits.iter().map(|h| h.0).reduce(pick);
    let (first_px, last_px) = (ends(f64::min)?.floor() - 1.0, ends(f64::max)?.ceil() + 1.0);
    let mut gradients = vec![0.0_f64; (last_px - first_px) as usize + 1];
    for (position, gradient) in hits {
        // Pixels of diagonal edges are up to 1.4 apart.
        let middle = (position - first_px).round() as usize;
        for gradient_there in &mut gradients[middle - 1..=middle + 1] {
            *gradient_there = gradient_there.max(gradient);
        }
    }
    let mut sums = vec![(0.0, 0.0)];
    let mut sum = (0.0, 0.0);
    for gradient in gradients {
        sum = (sum.0 + f64::from(gradient > 0.0), sum.1 + gradient);
        sums.push(sum);
    }
    Some(Line {
        normal,
        offset_px,
        first_px,
        sums,
    })
}

/// Reports whether an edge pixel belongs to a line.
fn is_hit(edge: &EdgePixel, angle_rad: f64, offset_px: f64, distance_px: f64) -> bool {
    let (sin, cos) = libm::sincos(angle_rad);
    (dot([cos, sin], edge.pixel) - offset_px).abs() <= distance_px
        && turn(edge.direction_rad, angle_rad) <= HIT_ANGLE_RAD
}

/// Reports whether two lines are the same edge.
fn is_same(a: &Line, b: &Line) -> bool {
    let cosine = dot(a.normal, b.normal);
    let (normal, tangent) = (b.normal, b.tangent());
    let end = |position: f64| [0, 1].map(|c| b.offset_px * normal[c] + position * tangent[c]);
    let ends = [end(b.first_px), end(b.first_px + b.sums.len() as f64)];
    cosine > libm::cos(SAME_ANGLE_RAD)
        && ends
            .into_iter()
            .all(|p| (dot(a.normal, p) - a.offset_px).abs() <= SAME_DISTANCE_PX)
}
