//! The law of reflection in the meridian plane, solved for points and for image radii.

use super::MirrorProfile;

/// Maximum number of iterations. Newton's method needs fewer than ten, bisection fifty.
const MAX_STEPS: u32 = 100;

/// A profile at a given distance from the pinhole.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Meridian<'a> {
    pub(crate) profile: &'a MirrorProfile,
    pub(crate) vertex_m: f64,
}

impl Meridian<'_> {
    /// Returns F, F' and F'' at t.
    pub(crate) fn at(&self, t: f64) -> [f64; 3] {
        let [sag, slope, curvature] = self.profile.sag_at(t);
        [self.vertex_m + sag, slope, curvature]
    }

    /// Returns the image radius of the rim.
    pub(crate) fn max_rho(&self) -> f64 {
        let rim_m = self.profile.rim_m();
        rim_m / self.at(rim_m)[0]
    }

    /// Returns the distance by which the ray reflected at t misses the point (r, z), multiplied by
    /// the length of the ray's unnormalised direction (A, −B), and its derivative with respect to
    /// t. Positive if the ray passes between the point and the axis.
    fn miss(&self, t: f64, [r, z]: [f64; 2]) -> [f64; 2] {
        let [f, p, q] = self.at(t);
        // (A, B) = (sin φ, cos φ)·√(t² + F²)·(1 + F'²)
        let a = t * (1.0 - p * p) + 2.0 * p * f;
        let b = f * (1.0 - p * p) - 2.0 * p * t;
        let slope_of_a = 1.0 + p * p + 2.0 * q * (f - t * p);
        let slope_of_b = -p * (1.0 + p * p) - 2.0 * q * (t + f * p);
        let miss = (r - t) * b - (f - z) * a;
        [
            miss,
            (r - t) * slope_of_b - b - (f - z) * slope_of_a - p * a,
        ]
    }

    /// Returns the t at which the mirror shows the point (r ≥ 0, z), or `None` if it does not show
    /// the point.
    ///
    /// Reflected rays diverge and lead away from the axis. At most one ray meets the point
    /// therefore, and it starts at t ≤ r.
    pub(crate) fn reflection(&self, point: [f64; 2]) -> Option<f64> {
        let [r, z] = point;
        let rim_m = self.profile.rim_m();
        let in_front = r > rim_m || z < self.at(r)[0];
        let end = r.min(rim_m);
        let between = self.miss(0.0, point)[0] >= 0.0 && self.miss(end, point)[0] <= 0.0;
        let is_finite = r.is_finite() && z.is_finite();
        (is_finite && in_front && between).then(|| self.nearest_reflection(point))
    }

    /// Like [`Self::reflection`], but returns the closest border of the visible region for points
    /// that the mirror does not show, so that the result is continuous.
    pub(super) fn nearest_reflection(&self, point: [f64; 2]) -> f64 {
        let end = point[0].min(self.profile.rim_m());
        root(end, |t| self.miss(t, point))
    }

    /// Returns the t at which the pinhole sees the mirror at an image radius between 0 and that of
    /// the rim.
    pub(crate) fn mirror_point(&self, rho: f64) -> f64 {
        root(self.profile.rim_m(), |t| {
            let [f, p, _] = self.at(t);
            [rho * f - t, rho * p - 1.0]
        })
    }
}

/// Returns the root between 0 and `end` of a function that decreases through its only root, by
/// bracketed Newton iteration. If there is no root, returns the end closer to zero. The function
/// returns its value and derivative.
fn root(end: f64, function: impl Fn(f64) -> [f64; 2]) -> f64 {
    let (mut low, mut high) = (0.0, end);
    let mut t = 0.5 * end;
    for _ in 0..MAX_STEPS {
        let [value, slope] = function(t);
        if value > 0.0 {
            low = t;
        } else {
            high = t;
        }
        let newton = t - value / slope;
        let next = if newton >= low && newton <= high {
            newton
        } else {
            0.5 * (low + high)
        };
        if (next - t).abs() <= 1e-16 * end {
            return next;
        }
        t = next;
    }
    t
}
