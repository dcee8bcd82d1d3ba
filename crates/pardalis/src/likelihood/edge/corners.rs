//! Corners: the points of an outline in an octave, with their neighbours.

use super::frame::Octave;
use crate::likelihood::outline::Coordinates;

/// A point of an outline and its direction outwards.
#[derive(Debug, Clone, Copy)]
pub(super) struct Crossing {
    pub(super) point: [f32; 2],
    pub(super) normal: [f32; 2],
}

/// A point of an outline, with its neighbours.
#[derive(Debug)]
pub(super) struct Corner {
    pub(super) crossing: Crossing,
    tangent: [f32; 2],
    /// The length of the outline that belongs to the point, in pixels.
    pub(super) length_px: f32,
    /// The curvature of the outline, 1/px: 1/r for a circle.
    bend_a_px: f32,
}

impl Corner {
    /// A corner at a pixel, with the direction outwards, of an outline that counts as straight there.
    #[cfg(test)]
    pub(super) fn at(point: [f32; 2], normal: [f32; 2]) -> Self {
        Self {
            crossing: Crossing { point, normal },
            tangent: [-normal[1], normal[0]],
            length_px: 1.0,
            bend_a_px: 0.0,
        }
    }

    /// Its pixel in the octave.
    pub(super) fn point(&self) -> [f32; 2] {
        self.crossing.point
    }

    /// The squared distance of a pixel.
    fn squared_px(&self, pixel: [f32; 2]) -> f32 {
        let point = self.crossing.point;
        (pixel[0] - point[0]).powi(2) + (pixel[1] - point[1]).powi(2)
    }

    /// The signed distance of a pixel for which it is the nearest corner.
    pub(super) fn distance_px(&self, pixel: [f32; 2]) -> f32 {
        let [du, dv] = [0, 1].map(|i| pixel[i] - self.crossing.point[i]);
        let [nu, nv] = self.crossing.normal;
        let across = du * self.tangent[0] + dv * self.tangent[1];
        du * nu + dv * nv + 0.5 * self.bend_a_px * across * across
    }
}

/// The corner of number `k` in an octave; NaN if the outline has no pixel there or on either side.
pub(super) fn corner(
    outline: &[Coordinates],
    octave: Octave,
    k: usize,
    orientation: f32,
) -> Corner {
    let count = outline.len();
    let at = |k: usize| outline[k % count].map(|lanes| octave.coordinate(lanes[0]));
    let [before, point, after] = [at(k + count - 1), at(k), at(k + 1)];
    let along = [after[0] - before[0], after[1] - before[1]];
    let length = (along[0] * along[0] + along[1] * along[1]).sqrt();
    let tangent = along.map(|v| v / length);
    Corner {
        crossing: Crossing {
            point,
            normal: [orientation * tangent[1], -orientation * tangent[0]],
        },
        tangent,
        length_px: 0.5 * length,
        bend_a_px: 0.0,
    }
}

/// 1 for outlines that run from u to v, −1 for the others.
pub(super) fn orientation(outline: &[Coordinates]) -> f32 {
    let is_pixel = |point: &&Coordinates| point[0][0].is_finite() && point[1][0].is_finite();
    let Some([u, v]) = outline.iter().find(is_pixel) else {
        return 1.0;
    };
    let (u0, v0) = (u[0], v[0]);
    let area: f32 = outline
        .windows(2)
        .map(|pair| {
            let [a, b] = [0, 1].map(|i| [pair[i][0][0] - u0, pair[i][1][0] - v0]);
            a[0] * b[1] - a[1] * b[0]
        })
        .filter(|area| area.is_finite())
        .sum();
    1_f32.copysign(area)
}

/// Computes the curvature at each corner from its neighbours' normals.
pub(super) fn bend(corners: &mut [Corner]) {
    let count = corners.len();
    for k in 0..count {
        let normal = |k: usize| corners[k % count].crossing.normal;
        let (before, after) = (normal(k + count - 1), normal(k + 1));
        let Corner {
            tangent, length_px, ..
        } = corners[k];
        let turned = (after[0] - before[0]) * tangent[0] + (after[1] - before[1]) * tangent[1];
        // Beside points without a pixel the outline counts as straight.
        let bend = (turned / (2.0 * length_px)).clamp(-1.0, 1.0);
        corners[k].bend_a_px = if bend.is_nan() { 0.0 } else { bend };
    }
}

/// The nearest corner and its squared distance, searched from one near it, or from all.
#[inline(always)]
pub(super) fn nearest(corners: &[Corner], pixel: [f32; 2], near: Option<usize>) -> (usize, f32) {
    let squared = |k: usize| corners[k].squared_px(pixel);
    let Some(near) = near else {
        let mut nearest = (0, f32::NAN);
        for k in 0..corners.len() {
            let there = squared(k);
            // Corners without a pixel are never nearer.
            if there < nearest.1 || nearest.1.is_nan() {
                nearest = (k, there);
            }
        }
        return nearest;
    };
    let last = corners.len() - 1;
    let after = |k: usize| if k < last { k + 1 } else { 0 };
    let before = |k: usize| if k > 0 { k - 1 } else { last };
    let ahead = walk((near, squared(near)), squared, after);
    walk(ahead, squared, before)
}

/// The corner reached from another one by steps in one direction for as long as they come nearer, and its squared distance.
#[inline(always)]
fn walk(
    (mut nearest, mut least): (usize, f32),
    squared: impl Fn(usize) -> f32,
    next_of: impl Fn(usize) -> usize,
) -> (usize, f32) {
    loop {
        let next = next_of(nearest);
        let there = squared(next);
        // Corners without a pixel are never nearer.
        if !(there < least) {
            return (nearest, least);
        }
        (nearest, least) = (next, there);
    }
}
