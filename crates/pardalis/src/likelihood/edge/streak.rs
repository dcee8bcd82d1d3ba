//! Motion blur: what an outline leaves in an image when it moves while the shutter is open.
//!
//! A pixel is the mean over the exposure. Where the outline passes, it is a mixture of the body's colours and its surroundings': by which share follows from the
//! outline at mid-exposure and its displacement during the exposure, the streak. The share is expressed as the distance at which the edge of a body at
//! rest has the same mixture, so that learnt edge profiles hold for streaks too.

use super::corners::Corner;

/// How far around the streak the map reaches, octave pixels. Derivation: the band of pixels and the reach of lines, 13 px, and interpolation.
const MARGIN_PX: f32 = 15.0;

/// The least share that the middle of a streak is assumed to have. Hand-set: keeps ratios finite.
const LEAST_SHARE: f32 = 0.05;
/// Below this share of the middle's, pixels are the surroundings' alone, and the body's from one minus this on. Hand-set: below the noise of images.
const UNMIXED_SHARE: f32 = 0.002;

/// The streak of one outline, on a grid whose first axis is along the displacement. Buffers are kept.
#[derive(Debug, Default)]
pub(super) struct Streak {
    /// The middle of the outline at mid-exposure, octave pixels.
    middle: [f32; 2],
    /// The direction of the displacement.
    along: [f32; 2],
    length_px: f32,
    /// Nodes along and across.
    size: [usize; 2],
    /// The coordinates of the first node, relative to the middle.
    first: [f32; 2],
    /// Of each node: the signed distance to the outline at mid-exposure, ...
    sharp_px: Vec<f32>,
    /// ... its nearest corner, ...
    corners: Vec<u16>,
    /// ... the share of the body in its mixture, ...
    shares: Vec<f32>,
    /// ... the signed distance to the hull of all outlines during the exposure, and the column of the node that is nearest to its outline, ...
    hulls: Vec<(f32, u16)>,
    /// ... and the distance from a body at rest with the same mixture.
    at_rest_px: Vec<f32>,
    /// Sums along a row.
    sums: Vec<f32>,
    /// Columns of a row.
    least: Vec<u16>,
}

/// A pixel near a streak.
#[derive(Debug, Clone, Copy)]
pub(super) struct Mixture {
    /// The pixel of the octave.
    pub(super) pixel: [f32; 2],
    /// The nearest corner of the outline, when it came nearest.
    pub(super) corner: usize,
    /// The signed distance to the hull of all outlines during the exposure.
    pub(super) hull_px: f32,
    /// The share of the body in its mixture.
    pub(super) share: f32,
    /// The signed distance from a body at rest at which mixtures are the same.
    pub(super) at_rest_px: f32,
}

/// Colours are unmixed with the share times each of these factors, because shares are not exact. Hand-set.
const SHARE_FACTORS: [f32; 3] = [1.0, 0.85, 1.18];

impl Mixture {
    /// The body's own colour, from that of the mixture and of what surrounds the body, and whether it is one of the target's. `None` if the share of the body is less than
    /// `min_share`.
    pub(super) fn own_color(
        &self,
        mixture: [f32; 3],
        around: [f32; 3],
        min_share: f32,
        is_target: impl Fn([f32; 3]) -> bool,
    ) -> Option<([f32; 3], bool)> {
        if self.share < min_share {
            return None;
        }
        let unmixed = |factor: f32| {
            let share = (factor * self.share).min(1.0);
            [0, 1, 2].map(|i| around[i] + (mixture[i] - around[i]) / share)
        };
        let matches = SHARE_FACTORS
            .into_iter()
            .any(|factor| is_target(unmixed(factor)));
        Some((unmixed(1.0), matches))
    }
}

impl Streak {
    /// A streak with room for this many nodes.
    pub(super) fn with_room(nodes: usize) -> Self {
        Self {
            sharp_px: Vec::with_capacity(nodes),
            corners: Vec::with_capacity(nodes),
            shares: Vec::with_capacity(nodes),
            hulls: Vec::with_capacity(nodes),
            at_rest_px: Vec::with_capacity(nodes),
            sums: Vec::with_capacity(nodes),
            least: Vec::with_capacity(nodes),
            ..Self::default()
        }
    }

    /// Maps the streak of an outline that is displaced by this much (octave pixels) during the exposure. `distance` returns the nearest corner of a point, searched from
    /// another, and the signed distance to the outline at mid-exposure. The edge of a body at rest is a logistic curve of this
    /// scale, in pixels.
    pub(super) fn map(
        &mut self,
        outline: &[Corner],
        displacement: [f32; 2],
        edge_px: f32,
        distance: impl Fn([f32; 2], Option<usize>) -> (usize, f32),
    ) {
        let [du, dv] = displacement;
        self.length_px = libm::hypotf(du, dv);
        self.along = [du / self.length_px, dv / self.length_px];
        let points = || outline.iter().map(Corner::point);
        let count = outline.len() as f32;
        self.middle = [0, 1].map(|i| points().map(|point| point[i]).sum::<f32>() / count);
        let half_px = points().map(|point| self.aligned(point)).fold(
            [0.5 * self.length_px, 0.0],
            |[a, b], [along, across]| {
                [
                    a.max(along.abs() + 0.5 * self.length_px),
                    b.max(across.abs()),
                ]
            },
        );
        let reach = half_px.map(|half_px| (half_px + MARGIN_PX).ceil());
        self.size = reach.map(|reach| 2 * reach as usize + 1);
        self.first = reach.map(|reach| -reach);
        let [width, height] = self.size;
        self.sharp_px.clear();
        self.corners.clear();
        for row in 0..height {
            let mut near = None;
            for column in 0..width {
                let (corner, sharp_px) = distance(self.point([column, row]), near);
                near = Some(corner);
                self.corners.push(corner as u16);
                self.sharp_px.push(sharp_px);
            }
        }
        self.mix(edge_px);
        self.find_hulls();
        let most = self.shares.iter().copied().fold(LEAST_SHARE, f32::max);
        let farthest_px = edge_px * libm::logf((1.0 - UNMIXED_SHARE) / UNMIXED_SHARE);
        let nodes = self.shares.iter().zip(&self.hulls);
        self.at_rest_px.clear();
        self.at_rest_px.extend(nodes.map(|(share, (hull_px, _))| {
            let share = share / most;
            if share <= UNMIXED_SHARE {
                hull_px.max(farthest_px)
            } else if share >= 1.0 - UNMIXED_SHARE {
                hull_px.min(-farthest_px)
            } else {
                edge_px * libm::logf((1.0 - share) / share)
            }
        }));
    }

    /// The coordinates of a point of the octave on the axes along and across.
    fn aligned(&self, point: [f32; 2]) -> [f32; 2] {
        let [u, v] = [0, 1].map(|i| point[i] - self.middle[i]);
        let [a, b] = self.along;
        [u * a + v * b, v * a - u * b]
    }

    /// The point of the octave at a node.
    fn point(&self, node: [usize; 2]) -> [f32; 2] {
        let [s, t] = [0, 1].map(|i| self.first[i] + node[i] as f32);
        let [a, b] = self.along;
        [
            self.middle[0] + s * a - t * b,
            self.middle[1] + s * b + t * a,
        ]
    }

    /// Averages the memberships of the outline at rest over the exposure.
    fn mix(&mut self, edge_px: f32) {
        let width = self.size[0];
        self.shares.clear();
        for row in self.sharp_px.chunks_exact(width) {
            // The integral from the row's beginning to half a pixel before each node.
            self.sums.clear();
            self.sums.push(0.0);
            let mut sum = 0.0;
            for sharp_px in row {
                sum += if sharp_px.abs() < 10.0 * edge_px {
                    1.0 / (1.0 + libm::expf(sharp_px / edge_px))
                } else {
                    f32::from(u8::from(*sharp_px < 0.0))
                };
                self.sums.push(sum);
            }
            let sums = &self.sums;
            let integral = |at: f32| {
                let at = at.clamp(0.0, width as f32);
                let (whole, part) = (at as usize, at - at.floor());
                let next = (whole + 1).min(width);
                sums[whole] + part * (sums[next] - sums[whole])
            };
            let (half, length) = (0.5 * self.length_px, self.length_px);
            self.shares.extend((0..width).map(|column| {
                let middle = column as f32 + 0.5;
                (integral(middle + half) - integral(middle - half)) / length
            }));
        }
    }

    /// Finds the least distance to the outlines during the exposure: the least of each node's neighbours along the displacement, of equal ones the first.
    fn find_hulls(&mut self) {
        let width = self.size[0];
        let half = (0.5 * self.length_px).round() as usize;
        let Self {
            sharp_px,
            hulls,
            least,
            ..
        } = self;
        hulls.clear();
        for row in sharp_px.chunks_exact(width) {
            // Nodes seen so far that are the least of all after them, the least of all first; those before `first` are out of reach.
            least.clear();
            let (mut first, mut seen) = (0, 0);
            for column in 0..width {
                while seen < (column + half + 1).min(width) {
                    while least.len() > first
                        && row[seen] < row[usize::from(least[least.len() - 1])]
                    {
                        least.pop();
                    }
                    least.push(seen as u16);
                    seen += 1;
                }
                while usize::from(least[first]) + half < column {
                    first += 1;
                }
                let nearest = least[first];
                hulls.push((row[usize::from(nearest)], nearest));
            }
        }
    }

    /// Interpolates a quantity of the nodes.
    #[inline(always)]
    fn interpolate(&self, [s, t]: [f32; 2], of: impl Fn(usize) -> f32) -> f32 {
        let [width, height] = self.size;
        let x = (s - self.first[0]).clamp(0.0, (width - 2) as f32);
        let y = (t - self.first[1]).clamp(0.0, (height - 2) as f32);
        let (i, j) = (x as usize, y as usize);
        let (dx, dy) = ((x - i as f32).min(1.0), (y - j as f32).min(1.0));
        let node = j * width + i;
        let upper = of(node) + dx * (of(node + 1) - of(node));
        let lower = of(node + width) + dx * (of(node + width + 1) - of(node + width));
        upper + dy * (lower - upper)
    }

    /// What the streak makes of a pixel of the octave; `None` beyond the map.
    pub(super) fn mixture(&self, pixel: [f32; 2]) -> Option<Mixture> {
        let at = self.aligned(pixel);
        let [x, y] = [0, 1].map(|i| (at[i] - self.first[i]).round());
        let [width, height] = self.size;
        if !(x >= 0.0 && y >= 0.0 && x < width as f32 && y < height as f32) {
            return None;
        }
        let (x, y) = (x as usize, y as usize);
        let (_, nearest) = self.hulls[y * width + x];
        Some(Mixture {
            pixel,
            corner: self.corners[y * width + usize::from(nearest)].into(),
            hull_px: self.interpolate(at, |node| self.hulls[node].0),
            share: self.interpolate(at, |node| self.shares[node]),
            at_rest_px: self.interpolate(at, |node| self.at_rest_px[node]),
        })
    }

    /// The distance from a body at rest with the same mixture as a pixel has if the outline is shifted by this much.
    #[inline(always)]
    pub(super) fn shifted_px(&self, pixel: [f32; 2], shift: [f32; 2]) -> f32 {
        let at = self.aligned([pixel[0] - shift[0], pixel[1] - shift[1]]);
        self.interpolate(at, |node| self.at_rest_px[node])
    }

    /// The bounds of the map in the octave: least and greatest along each axis.
    pub(super) fn bounds(&self, margin_px: f32) -> [[f32; 2]; 2] {
        let [width, height] = self.size;
        let cut = (MARGIN_PX - margin_px).max(0.0);
        let corners = [
            [0, 0],
            [width - 1, 0],
            [0, height - 1],
            [width - 1, height - 1],
        ];
        [0, 1].map(|i| {
            let along = corners.map(|node| self.point(node)[i]);
            let least = along.into_iter().fold(f32::INFINITY, f32::min);
            let most = along.into_iter().fold(f32::NEG_INFINITY, f32::max);
            [least + cut, most - cut]
        })
    }
}
