//! The largest circle inside a blob: where a ball is whose blob has grown together with its shadow or with other things in its colours.

use super::{BlobSearch, PIXEL_OF_PART};

/// The largest circle inside a blob, of which holes are a part.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct InscribedCircle {
    /// Its centre, pixels.
    pub(crate) center_px: [f64; 2],
    /// Its radius, pixels: up to the border between pixels inside and outside.
    pub(crate) radius_px: f64,
}

impl BlobSearch {
    /// Returns the largest circle inside the blob of this number in the image that was searched last; of several as large, the first in row order.
    pub(crate) fn inscribed_circle(&self, number: usize) -> InscribedCircle {
        let blob = &self.blobs[number];
        // With a frame of one pixel that is outside.
        let [width, height] = [0, 1].map(|i| blob.max_px[i] - blob.min_px[i] + 3);
        let outside = self.outside(number, (width, height));
        let squared = squared_distances(&outside, width);
        let first_largest =
            |best: usize, i: usize| if squared[i] > squared[best] { i } else { best };
        let center = (0..squared.len()).fold(0, first_largest);
        let at = [center % width, center / width];
        InscribedCircle {
            center_px: [0, 1].map(|i| (blob.min_px[i] + at[i]) as f64 - 1.0),
            radius_px: libm::sqrt(squared[center]) - 0.5,
        }
    }

    /// Which pixels of a blob's box, with a frame of one pixel, lie outside the blob: those that a path along rows and columns outside the blob joins to the frame.
    fn outside(&self, number: usize, (width, height): (usize, usize)) -> Vec<bool> {
        let blob = &self.blobs[number];
        let mut is_part = vec![false; width * height];
        let of_image = |i: usize| {
            let [x, y] = [i % width, i / width].map(|at| at.wrapping_sub(1));
            (x < width - 2 && y < height - 2)
                .then(|| (blob.min_px[1] + y) * self.image_width + blob.min_px[0] + x)
        };
        let seed = self.seeds[number];
        let [x, y] = [seed % self.image_width, seed / self.image_width];
        let seed = (y - blob.min_px[1] + 1) * width + x - blob.min_px[0] + 1;
        fill(&mut is_part, width, seed, |i| {
            of_image(i).is_some_and(|i| self.filtered[i] == PIXEL_OF_PART)
        });
        let mut outside = vec![false; width * height];
        fill(&mut outside, width, 0, |i| !is_part[i]);
        outside
    }
}

/// Sets the elements that paths along rows and columns of allowed ones join to the first.
fn fill(set: &mut [bool], width: usize, first: usize, is_allowed: impl Fn(usize) -> bool) {
    let mut stack = vec![first];
    while let Some(i) = stack.pop() {
        if set[i] || !is_allowed(i) {
            continue;
        }
        set[i] = true;
        let x = i % width;
        stack.extend((x > 0).then(|| i - 1));
        stack.extend((x + 1 < width).then_some(i + 1));
        stack.extend(i.checked_sub(width));
        stack.extend((i + width < set.len()).then_some(i + width));
    }
}

/// The squared distance of each pixel's centre from that of the nearest pixel that is set: the lower envelope of parabolas along columns, then along rows (Felzenszwalb and
/// Huttenlocher 2012).
fn squared_distances(set: &[bool], width: usize) -> Vec<f64> {
    let height = set.len() / width;
    let far = (set.len() * set.len()) as f64;
    let mut squared: Vec<f64> = set.iter().map(|&set| if set { 0.0 } else { far }).collect();
    let mut line = Vec::new();
    let lines = (0..width)
        .map(|x| (x, width, height))
        .chain((0..height).map(|y| (y * width, 1, width)));
    for (first, step, count) in lines {
        line.clear();
        line.extend((0..count).map(|i| squared[first + i * step]));
        lower_envelope(&line, |i, value| squared[first + i * step] = value);
    }
    squared
}

/// Writes the least of (i - j)² + `line`\[j\] over j for each i.
fn lower_envelope(line: &[f64], mut write: impl FnMut(usize, f64)) {
    // Apices of the parabolas of the envelope, each with the place from which on it is the lowest.
    let mut envelope: Vec<(usize, f64)> = Vec::with_capacity(line.len());
    let meeting = |left: usize, right: usize| {
        let [l, r] = [left as f64, right as f64];
        ((line[right] + r * r) - (line[left] + l * l)) / (2.0 * (r - l))
    };
    for right in 0..line.len() {
        let mut from = f64::NEG_INFINITY;
        while let Some(&(left, left_from)) = envelope.last() {
            from = meeting(left, right);
            if from > left_from {
                break;
            }
            envelope.pop();
            from = f64::NEG_INFINITY;
        }
        envelope.push((right, from));
    }
    let mut lowest = 0;
    for i in 0..line.len() {
        while envelope
            .get(lowest + 1)
            .is_some_and(|next| next.1 < i as f64)
        {
            lowest += 1;
        }
        let apex = envelope[lowest].0;
        write(i, (i as f64 - apex as f64).powi(2) + line[apex]);
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::search;
    use super::*;
    use pardalis_core::rng::{Draws, Stage};

    #[test]
    fn squared_distances_are_those_of_a_search_of_all_pixels() {
        let draws = Draws::new(7, 0);
        for (width, height) in [(1, 1), (7, 1), (1, 9), (13, 8), (24, 31)] {
            let is_set = |i| draws.uniform(i as u32, 0, Stage::Resampling) < 0.06;
            let mut set: Vec<bool> = (0..width * height).map(is_set).collect();
            set[width * height / 2] = true;
            let found = squared_distances(&set, width);
            for (i, squared) in found.iter().enumerate() {
                let to = |j: usize| {
                    let apart = |a: usize, b: usize| (a as f64 - b as f64).powi(2);
                    apart(i % width, j % width) + apart(i / width, j / width)
                };
                let all = (0..set.len()).filter(|&j| set[j]).map(to);
                assert_eq!(
                    *squared,
                    all.fold(f64::INFINITY, f64::min),
                    "{width}x{height}, {i}"
                );
            }
        }
    }

    #[test]
    fn the_circle_is_the_ball_and_not_what_has_grown_together_with_it() {
        // A ball of 9 px on a shadow that is as long as the ball, but flat.
        let shadow = (0..15).map(|i| ([26.0 + f64::from(i), 24.0], 3.0));
        let mut discs: Vec<_> = shadow.collect();
        discs.push(([20.0, 18.0], 9.0));
        let search = search(&discs, None);
        assert_eq!(search.found().len(), 1, "{:?}", search.found());
        let [u, v] = search.found()[0].centroid_px;
        assert!((u - 20.0).hypot(v - 18.0) > 3.0, "the middle of both");
        let circle = search.inscribed_circle(0);
        let [u, v] = circle.center_px;
        assert!((u - 20.0).hypot(v - 18.0) < 1.5, "{circle:?}");
        assert!((circle.radius_px - 9.0).abs() < 1.0, "{circle:?}");
    }

    #[test]
    fn each_blob_has_a_circle_of_its_own_and_the_border_limits_it() {
        let search = search(&[([41.0, 22.0], 6.0), ([10.0, 1.0], 5.0)], None);
        let [large, cut] = [0, 1].map(|number| search.inscribed_circle(number));
        assert_eq!(large.center_px, [41.0, 22.0]);
        assert!((large.radius_px - 6.0).abs() < 0.6, "{large:?}");
        // The second one has the rows 0 to 5: the lowest, a single pixel, is smoothed away.
        assert_eq!((cut.center_px[1], cut.radius_px), (2.0, 2.5), "{cut:?}");
    }
}
