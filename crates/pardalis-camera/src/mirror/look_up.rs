//! The exact mirror for vectorised kernels: a branch-free look-up in single precision, without a
//! solver.

use std::fmt;

use super::Meridian;
use crate::{Projection, Ray};

/// Number of tabulated reflected rays.
const RAYS: usize = 512;
/// Number of columns (directions) and rows (inverse distances) of the table of initial guesses.
const GUESSES: usize = 64;
/// Number of secant steps. After two, all rays except those that almost graze the rim are within
/// 0.005 px.
const STEPS: usize = 3;
/// The iteration has not converged if its last step exceeds this share of the distance between
/// rays.
const MAX_LAST_STEP: f32 = 0.5;

/// Rays reflected at points of the mirror from vertex to rim, equally spaced in t, and initial
/// guesses for all surrounding points.
///
/// A ray starts at (t, F) with the direction (sin φ, −cos φ). The offset of a point (r, z) across
/// the ray is r·cos φ + z·sin φ − (t·cos φ + F·sin φ), which is linear in the point; its distance
/// along the ray is r·sin φ − z·cos φ + (F·cos φ − t·sin φ). Secant steps through neighbouring rays
/// lead from the guess to the ray that meets the point. They converge from anywhere in the domain,
/// arbitrarily close to the mirror. Points for which they do not converge, or that lie behind the
/// start of their ray, have no pixel.
pub(crate) struct ReflectedRays {
    /// cos φ, sin φ, t·cos φ + F·sin φ, F·cos φ − t·sin φ.
    rays: [[f32; 4]; RAYS],
    /// Positions on the mirror in units of rays, in row-major order: columns by tan(θ/2) and rows
    /// by `nearest_m`/d, where θ is the angle from −z and d the distance, both measured from
    /// `center_z_m` on the axis.
    guesses: [f32; GUESSES * GUESSES],
    center_z_m: f32,
    nearest_m: f32,
    columns_per_tan: f32,
    max_rho: f32,
}

impl fmt::Debug for ReflectedRays {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("ReflectedRays").finish_non_exhaustive()
    }
}

impl ReflectedRays {
    pub(crate) fn new(meridian: Meridian) -> Self {
        let last_ray = (RAYS - 1) as f64;
        let rim_m = meridian.profile.rim_m();
        let rays: [[f64; 4]; RAYS] = std::array::from_fn(|i| {
            let t = rim_m * i as f64 / last_ray;
            let [f, p, _] = meridian.at(t);
            let length = (t * t + f * f).sqrt() * (1.0 + p * p);
            let sin = (t * (1.0 - p * p) + 2.0 * p * f) / length;
            let cos = (f * (1.0 - p * p) - 2.0 * p * t) / length;
            [cos, sin, t * cos + f * sin, f * cos - t * sin]
        });
        // Seen from where the middle ray appears to originate, the points of a ray lie in almost
        // the same direction.
        let [_, sin, across, _] = rays[RAYS / 2];
        let center_z = (across / sin).max(meridian.vertex_m + 0.25 * rim_m);
        let nearest = (0..=100)
            .map(|i| {
                let t = rim_m * f64::from(i) / 100.0;
                libm::hypot(t, center_z - meridian.at(t)[0])
            })
            .fold(f64::INFINITY, f64::min);
        // Widest direction of a point in the domain: along the ray of the rim, seen from nearby or
        // from afar.
        let [cos, sin, ..] = rays[RAYS - 1];
        let up_to_rim = center_z - meridian.at(rim_m)[0];
        let tan_rim = rim_m / (libm::hypot(rim_m, up_to_rim) + up_to_rim);
        let columns_per_tan = (GUESSES - 1) as f64 / (sin / (1.0 + cos)).max(tan_rim);
        let guesses = std::array::from_fn(|i| {
            let (row, column) = (i / GUESSES, i % GUESSES);
            let tan_half = column as f64 / columns_per_tan;
            let scale = 1.0 / (1.0 + tan_half * tan_half);
            let sin = 2.0 * tan_half * scale;
            let cos = (1.0 - tan_half * tan_half) * scale;
            // The row of infinite distance holds points that are merely far away.
            let distance = nearest * (GUESSES - 1) as f64 / (row as f64).max(1e-6);
            let t = meridian.nearest_reflection([distance * sin, center_z - distance * cos]);
            (t / rim_m * last_ray) as f32
        });
        Self {
            rays: rays.map(|ray| ray.map(|v| v as f32)),
            guesses,
            center_z_m: center_z as f32,
            nearest_m: nearest as f32,
            columns_per_tan: columns_per_tan as f32,
            max_rho: meridian.max_rho() as f32,
        }
    }

    /// Combines the rays with the focal lengths and principal point of a camera. The last
    /// parameter, the distance of the mirror, is already contained in the rays.
    pub(crate) fn with_camera(
        &self,
        [fx_px, fy_px, cx_px, cy_px, _]: [f32; 5],
    ) -> MirrorLookUp<'_> {
        MirrorLookUp {
            rays: self,
            f_px: [fx_px, fy_px],
            center_px: [cx_px, cy_px],
        }
    }

    /// Returns the image radius of a point, and whether the point is visible.
    #[inline(always)]
    fn project(&self, r: f32, z: f32) -> (f32, bool) {
        let up = self.center_z_m - z;
        let distance = (r * r + up * up).sqrt();
        let column = clamped(self.columns_per_tan * r / (distance + up), GUESSES - 1);
        let row = (GUESSES - 1) as f32 * self.nearest_m / distance;
        let mut position = self.guess(clamped(row, GUESSES - 1), column);
        let (mut last_step, mut ray) = (0.0, [0.0; 4]);
        for _ in 0..STEPS {
            let (i, start) = floor(clamped(position, RAYS - 1));
            let (before, after) = (self.rays[i % RAYS], self.rays[(i + 1) % RAYS]);
            let miss = |[cos, sin, across, _]: [f32; 4]| r * cos + z * sin - across;
            let share = miss(before) / (miss(before) - miss(after));
            last_step = start + share - position;
            position = start + share;
            ray = between(before, after, share);
        }
        let [cos, sin, _, along] = ray;
        let in_front = r * sin - z * cos + along > 0.0;
        let inside = (position > -0.01) & (position <= (RAYS - 1) as f32);
        let converged = last_step.abs() < MAX_LAST_STEP;
        let [t, f] = start_of(ray);
        (t / f, inside & converged & in_front)
    }

    /// Interpolates the initial guess bilinearly.
    #[inline(always)]
    fn guess(&self, row: f32, column: f32) -> f32 {
        let (i, start_row) = floor(row);
        let (j, start_column) = floor(column);
        let at = |i: usize, j: usize| self.guesses[(i * GUESSES + j) % (GUESSES * GUESSES)];
        let (share_i, share_j) = (row - start_row, column - start_column);
        let before = at(i, j) + share_j * (at(i, j + 1) - at(i, j));
        let after = at(i + 1, j) + share_j * (at(i + 1, j + 1) - at(i + 1, j));
        before + share_i * (after - before)
    }
}

/// Interpolates between two rays.
#[inline(always)]
fn between(before: [f32; 4], after: [f32; 4], share: f32) -> [f32; 4] {
    [0, 1, 2, 3].map(|k| before[k] + share * (after[k] - before[k]))
}

/// Returns t and F of a ray, multiplied by the squared length of its direction, which is slightly
/// below 1 for interpolated rays.
#[inline(always)]
fn start_of([cos, sin, across, along]: [f32; 4]) -> [f32; 2] {
    [across * cos - along * sin, across * sin + along * cos]
}

/// Clamps a number to 0 to `last`; NaN becomes `last`.
#[inline(always)]
fn clamped(x: f32, last: usize) -> f32 {
    let x = if x < last as f32 { x } else { last as f32 };
    if x > 0.0 { x } else { 0.0 }
}

/// Returns the largest integer below x (or, at the end of an interval, x itself) for x between 0
/// and 2^16. Adding 1.5·2²³ rounds to an integer.
#[inline(always)]
fn floor(x: f32) -> (usize, f32) {
    let whole = (x - 0.5) + 12_582_912.0;
    ((whole.to_bits() & 0xffff) as usize, whole - 12_582_912.0)
}

/// An exact mirror camera in single precision.
///
/// Within 0.02 px of the exact solution in its whole domain, which starts at the mirror's surface.
/// The border of the domain agrees with the exact model within half a pixel.
#[derive(Debug, Clone, Copy)]
pub struct MirrorLookUp<'a> {
    rays: &'a ReflectedRays,
    f_px: [f32; 2],
    center_px: [f32; 2],
}

impl Projection<f32> for MirrorLookUp<'_> {
    #[inline(always)]
    fn project(&self, [x, y, z]: [f32; 3]) -> ([f32; 2], bool) {
        let r = (x * x + y * y).sqrt();
        let (rho, valid) = self.rays.project(r, z);
        let rho = if rho > 0.0 { rho } else { 0.0 };
        let scale = rho / if r > 1e-30 { r } else { 1e-30 };
        let [fx, fy] = self.f_px;
        let [cx, cy] = self.center_px;
        ([cx + fx * scale * x, cy + fy * scale * y], valid)
    }

    fn unproject(&self, [u, v]: [f32; 2]) -> Option<Ray<f32>> {
        let x = (u - self.center_px[0]) / self.f_px[0];
        let y = (v - self.center_px[1]) / self.f_px[1];
        let rho = (x * x + y * y).sqrt();
        if !(rho <= self.rays.max_rho * (1.0 + 1e-6)) {
            return None;
        }
        let rays = &self.rays.rays;
        let rho_of = |ray: [f32; 4]| {
            let [t, f] = start_of(ray);
            t / f
        };
        let i = rays[1..RAYS - 1].partition_point(|&ray| rho_of(ray) < rho);
        let [before, after] = [rays[i], rays[i + 1]];
        let share = (rho - rho_of(before)) / (rho_of(after) - rho_of(before));
        let ray @ [cos, sin, ..] = between(before, after, share);
        // On the axis only a smooth vertex has a ray, straight down.
        let on_axis = !(rho > 1e-6);
        if on_axis && rays[0][1] > 0.0 {
            return None;
        }
        let (x, y) = if on_axis {
            (0.0, 0.0)
        } else {
            (x / rho, y / rho)
        };
        let square = sin * sin + cos * cos;
        let [t, f] = start_of(ray).map(|v| v / square);
        let length = square.sqrt();
        Some(Ray {
            origin: [x * t, y * t, f],
            direction: [x * sin / length, y * sin / length, -cos / length],
        })
    }
}
