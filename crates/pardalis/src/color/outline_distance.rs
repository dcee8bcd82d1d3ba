//! Signed distances of pixels from the outline of a labelled body, with subpixel accuracy.
//!
//! If the labels of a body form an ellipse, as for balls and discs, its outline is the ellipse with the same
//! moments. Otherwise the labels are smoothed, and the outline is their level line at one half.

use std::collections::VecDeque;

/// Labelled parts with fewer pixels are ignored. Hand-set.
const MIN_AREA_PX: usize = 20;
/// Minimum intersection over union of a fitted ellipse with the labels. Hand-set.
const MIN_IOU: f64 = 0.92;
/// Distances are computed up to this many pixels inside and outside. Derivation: covers the bands that are
/// evaluated.
const NEAR_PX: f64 = 9.0;
/// Standard deviation of the smoothing of labels in pixels, and the largest distance, in standard deviations,
/// that the smoothed labels determine. Hand-set.
const SMOOTH_PX: f64 = 1.5;
const TRUSTED: f64 = 2.5;

/// The outline of one labelled part.
pub(super) struct OutlineDistance {
    centroid_px: [f64; 2],
    area_px: usize,
    /// Pixels near the part: column, row and signed distance.
    near: Vec<(usize, usize, f64)>,
}

/// The pixels of a part: column and row.
pub(super) type Part = Vec<(usize, usize)>;

impl OutlineDistance {
    /// Finds the outlines of all sufficiently large parts that do not touch the image border.
    pub(super) fn of_parts(labels: &[bool], width: usize) -> Vec<Self> {
        let height = labels.len() / width.max(1);
        parts(labels, width)
            .into_iter()
            .filter(|part| {
                let inside =
                    |&(x, y): &(usize, usize)| x > 0 && y > 0 && x + 1 < width && y + 1 < height;
                part.len() >= MIN_AREA_PX && part.iter().all(inside)
            })
            .map(|part| Self::of(&part, labels, width, height))
            .collect()
    }

    fn of(part: &Part, labels: &[bool], width: usize, height: usize) -> Self {
        let count = part.len() as f64;
        let mean = |axis: fn(&(usize, usize)) -> usize| {
            part.iter().map(|place| axis(place) as f64).sum::<f64>() / count
        };
        let centroid_px = [mean(|place| place.0), mean(|place| place.1)];
        let range = |axis: fn(&(usize, usize)) -> usize, size: usize| {
            let along = || part.iter().map(axis);
            let least = along().min().unwrap_or(0).saturating_sub(NEAR_PX as usize);
            let most = along().max().unwrap_or(0) + NEAR_PX as usize;
            least..(most + 1).min(size)
        };
        let (columns, rows) = (range(|p| p.0, width), range(|p| p.1, height));
        let ellipse = Ellipse::of(part, centroid_px);
        let at = |x: usize, y: usize| labels[y * width + x];
        let (mut both, mut either) = (0_u32, 0_u32);
        for y in rows.clone() {
            for x in columns.clone() {
                let within = ellipse.distance_px([x as f64, y as f64]) < 0.0;
                both += u32::from(within && at(x, y));
                either += u32::from(within || at(x, y));
            }
        }
        let is_ellipse = f64::from(both) >= MIN_IOU * f64::from(either);
        let smooth = Smooth {
            labels,
            width,
            height,
        };
        let mut near = Vec::new();
        for y in rows {
            for x in columns.clone() {
                let distance_px = if is_ellipse {
                    ellipse.distance_px([x as f64, y as f64])
                } else {
                    smooth.distance_px(x, y)
                };
                if distance_px.abs() <= NEAR_PX {
                    near.push((x, y, distance_px));
                }
            }
        }
        Self {
            centroid_px,
            area_px: part.len(),
            near,
        }
    }

    /// The centroid of the part, pixels.
    pub(super) fn centroid_px(&self) -> [f64; 2] {
        self.centroid_px
    }

    /// The number of pixels of the part.
    pub(super) fn area_px(&self) -> usize {
        self.area_px
    }

    /// Calls `take` with the column, row, signed distance in pixels and share of the turn around the part's
    /// centroid.
    pub(super) fn for_each_near(&self, mut take: impl FnMut(usize, usize, f32, f32)) {
        let [u, v] = self.centroid_px;
        for &(x, y, distance_px) in &self.near {
            let turn = libm::atan2(y as f64 - v, x as f64 - u) / std::f64::consts::TAU;
            take(x, y, distance_px as f32, turn.rem_euclid(1.0) as f32);
        }
    }
}

/// Finds the connected parts of the labels.
pub(super) fn parts(labels: &[bool], width: usize) -> Vec<Part> {
    let height = labels.len() / width.max(1);
    let mut left = labels.to_vec();
    let mut parts = Vec::new();
    let mut first = 0;
    while let Some(next) = left[first..].iter().position(|label| *label) {
        let seed = first + next;
        left[seed] = false;
        first = seed + 1;
        let mut part = Vec::new();
        let mut queue = VecDeque::from([(seed % width, seed / width)]);
        while let Some((x, y)) = queue.pop_front() {
            part.push((x, y));
            for (nx, ny) in [
                (x.wrapping_sub(1), y),
                (x + 1, y),
                (x, y.wrapping_sub(1)),
                (x, y + 1),
            ] {
                if nx < width && ny < height && std::mem::take(&mut left[ny * width + nx]) {
                    queue.push_back((nx, ny));
                }
            }
        }
        parts.push(part);
    }
    parts
}

/// The ellipse with the same moments as a part.
struct Ellipse {
    center: [f64; 2],
    /// For x and y relative to the centre, the form a·x² + 2b·xy + c·y² equals 1 on the outline.
    form: [f64; 3],
    /// The shorter semi-axis in pixels.
    min_radius_px: f64,
}

impl Ellipse {
    fn of(part: &Part, center: [f64; 2]) -> Self {
        let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
        for &(x, y) in part {
            let [dx, dy] = [x as f64 - center[0], y as f64 - center[1]];
            xx += dx * dx;
            xy += dx * dy;
            yy += dy * dy;
        }
        let count = part.len() as f64;
        // Sums over pixel centres equal those over the area, averaged over the subpixel position.
        let [xx, xy, yy] = [xx, xy, yy].map(|sum| sum / count);
        // The variance of an ellipse's area along a semi-axis r is r²/4.
        let determinant = xx * yy - xy * xy;
        let form = [yy, -xy, xx].map(|entry| 0.25 * entry / determinant);
        let middle = 0.5 * (xx + yy);
        let spread = (0.25 * (xx - yy).powi(2) + xy * xy).sqrt();
        Self {
            center,
            form,
            min_radius_px: 2.0 * (middle - spread).max(0.0).sqrt(),
        }
    }

    /// Computes the signed distance of a point to first order, which is exact for circles.
    fn distance_px(&self, point: [f64; 2]) -> f64 {
        let [x, y] = [0, 1].map(|i| point[i] - self.center[i]);
        let [a, b, c] = self.form;
        let [fx, fy] = [a * x + b * y, b * x + c * y];
        let root = (x * fx + y * fy).sqrt();
        let slope = libm::hypot(fx, fy);
        let distance = (root - 1.0) * root / slope;
        // The distance is undefined at the centre.
        if distance > -self.min_radius_px {
            distance
        } else {
            -self.min_radius_px
        }
    }
}

/// Labels of any shape, smoothed.
struct Smooth<'a> {
    labels: &'a [bool],
    width: usize,
    height: usize,
}

impl Smooth<'_> {
    /// Computes the signed distance of a pixel. Where the smoothed labels have the value s, an edge lies
    /// −σ·Φ⁻¹(s) away; far from edges, the nearest pixel of the other class decides.
    fn distance_px(&self, x: usize, y: usize) -> f64 {
        let reach = (NEAR_PX as usize) + 1;
        let here = self.labels[y * self.width + x];
        let (mut sum, mut total) = (0.0, 0.0);
        let mut nearest_squared = f64::INFINITY;
        for v in y.saturating_sub(reach)..(y + reach + 1).min(self.height) {
            for u in x.saturating_sub(reach)..(x + reach + 1).min(self.width) {
                let squared = (u.abs_diff(x).pow(2) + v.abs_diff(y).pow(2)) as f64;
                let weight = libm::exp(-0.5 * squared / (SMOOTH_PX * SMOOTH_PX));
                let label = self.labels[v * self.width + u];
                total += weight;
                sum += if label { weight } else { 0.0 };
                if label != here {
                    nearest_squared = squared.min(nearest_squared);
                }
            }
        }
        let smoothed = sum / total;
        let by_smoothing = -SMOOTH_PX * normal_quantile(smoothed);
        if by_smoothing.abs() <= TRUSTED * SMOOTH_PX {
            return by_smoothing;
        }
        let far = nearest_squared.sqrt() - 0.5;
        if here { -far } else { far }
    }
}

/// Computes Φ⁻¹ by bisection.
fn normal_quantile(share: f64) -> f64 {
    let (mut low, mut high) = (-8.0, 8.0);
    for _ in 0..40 {
        let middle: f64 = 0.5 * (low + high);
        let below = 0.5 * libm::erfc(-middle / std::f64::consts::SQRT_2);
        *(if below < share { &mut low } else { &mut high }) = middle;
    }
    0.5 * (low + high)
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: usize = 64;

    /// Returns the mean and standard deviation of the distance errors within 4 px of an outline, over shapes
    /// at many positions.
    fn errors(distance: impl Fn(f64, [f64; 2]) -> f64, needed: usize) -> (f64, f64) {
        let mut errors = Vec::new();
        for n in 0..30 {
            let n = f64::from(n);
            let true_px = |x: usize, y: usize| {
                distance(n, [x as f64 - 31.3 - 0.17 * n, y as f64 - 32.6 + 0.13 * n])
            };
            let labels: Vec<bool> = (0..SIZE * SIZE)
                .map(|i| true_px(i % SIZE, i / SIZE) < 0.0)
                .collect();
            let found = OutlineDistance::of_parts(&labels, SIZE);
            assert_eq!(found.len(), 1);
            found[0].for_each_near(|x, y, distance_px, _| {
                if distance_px.abs() < 4.0 {
                    errors.push(f64::from(distance_px) - true_px(x, y));
                }
            });
        }
        assert!(errors.len() > needed);
        let count = errors.len() as f64;
        let mean = errors.iter().sum::<f64>() / count;
        let variance = errors.iter().map(|e| (e - mean).powi(2)).sum::<f64>() / count;
        (mean, variance.sqrt())
    }

    #[test]
    fn distances_from_discs_of_all_sizes_are_unbiased() {
        let disc = |n: f64, [x, y]: [f64; 2]| x.hypot(y) - (4.0 + 0.5 * n);
        let (mean, sd) = errors(disc, 10_000);
        assert!(mean.abs() < 0.02 && sd < 0.15, "{mean} {sd}");
    }

    #[test]
    fn distances_from_boxes_are_unbiased() {
        // Along the sides, clear of the corners.
        let slanted = |n: f64, [x, y]: [f64; 2]| {
            let (sin, cos) = (0.1 * n).sin_cos();
            let [a, b] = [cos * x + sin * y, cos * y - sin * x];
            (a.abs() - 16.0).max(b.abs() - 11.0)
        };
        let (mean, sd) = errors(slanted, 10_000);
        assert!(mean.abs() < 0.15 && sd < 0.5, "{mean} {sd}");
    }
}
