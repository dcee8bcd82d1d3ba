//! A perspective camera in front of a mirror of revolution, exactly. Not central: each pixel's ray begins on the mirror.

use std::sync::{Arc, OnceLock};

use super::mirror::{Meridian, MirrorLookUp, MirrorProfile, ReflectedRays};
use super::{Projection, Ray, check_focals, check_principal_point};
use pardalis_core::Error;
use pardalis_core::real::Real;

/// Points nearer to the axis than this share of the mirror's distance lie on it.
const ON_AXIS: f64 = 1e-9;

/// A point (r, φ, z) is seen through the mirror point (t, F(t)) where atan(t/F) + 2·atan(F'(t)) = atan2(r − t, F − z); ρ = t/F,
/// u = cx + fx·ρ·x/r, v = cy + fy·ρ·y/r (Taiana 2007, eq. 3.2, with the tangent that it lacks). The camera looks along +z into the mirror,
/// so that the scene has mostly z < 0.
///
/// Domain: points in front of the mirror's surface that are met by a ray reflected within the rim; see [`MirrorProfile`].
#[derive(Debug, Clone)]
pub struct ExactMirror<R> {
    fx_px: R,
    fy_px: R,
    cx_px: R,
    cy_px: R,
    /// The vertex' distance from the pinhole, which counts instead of the profile's own.
    vertex_m: R,
    profile: Arc<MirrorProfile>,
    /// Made when it is first asked for.
    look_up: Arc<OnceLock<ReflectedRays>>,
}

impl PartialEq for ExactMirror<f64> {
    /// The same camera, whether its look-up table is made or not.
    fn eq(&self, other: &Self) -> bool {
        self.parameters() == other.parameters() && self.profile == other.profile
    }
}

impl ExactMirror<f64> {
    /// Focal lengths and principal point of the perspective camera in pixels, and the mirror.
    pub fn new(f_px: [f64; 2], center_px: [f64; 2], profile: MirrorProfile) -> Result<Self, Error> {
        check_focals(f_px)?;
        check_principal_point(center_px)?;
        Ok(Self {
            fx_px: f_px[0],
            fy_px: f_px[1],
            cx_px: center_px[0],
            cy_px: center_px[1],
            vertex_m: profile.vertex_m(),
            profile: Arc::new(profile),
            look_up: Arc::default(),
        })
    }

    /// The mirror.
    pub fn profile(&self) -> &MirrorProfile {
        &self.profile
    }

    /// The same camera with other parameters, in the order of [`Self::NAMES`].
    pub(super) fn with_parameters(
        &self,
        [fx, fy, cx, cy, vertex_m]: [f64; 5],
    ) -> Result<Self, Error> {
        Self::new([fx, fy], [cx, cy], self.profile.at_vertex(vertex_m)?)
    }

    /// Where the ray halfway between vertex and rim seems to come from, on the axis, metres.
    pub(super) fn viewpoint_m(&self) -> [f64; 3] {
        let t = 0.5 * self.profile.rim_m();
        let [f, slope, _] = self.at(t);
        // The ray from the pinhole (t, f), mirrored at the normal (slope, −1).
        let along_normal = 2.0 * (t * slope - f) / (slope * slope + 1.0);
        let (dr, dz) = (t - along_normal * slope, f + along_normal);
        [0.0, 0.0, f - t * dz / dr]
    }

    /// The same camera in single precision, for kernels: a look-up within 0.02 px, whose table is made at the first call.
    pub fn to_f32(&self) -> MirrorLookUp<'_> {
        let rays = self
            .look_up
            .get_or_init(|| ReflectedRays::new(self.meridian()));
        rays.seen_by(self.parameters().map(|p| p as f32))
    }
}

impl<R: Real> ExactMirror<R> {
    /// The names of the parameters, in their order. The mirror's shape is not among them.
    pub(super) const NAMES: [&'static str; 5] = ["fx_px", "fy_px", "cx_px", "cy_px", "vertex_m"];

    pub(super) fn parameters(&self) -> [R; 5] {
        [
            self.fx_px,
            self.fy_px,
            self.cx_px,
            self.cy_px,
            self.vertex_m,
        ]
    }

    /// The same shape with other parameters, unchecked, in any arithmetic.
    pub(super) fn vary<S: Real>(
        &self,
        [fx_px, fy_px, cx_px, cy_px, vertex_m]: [S; 5],
    ) -> ExactMirror<S> {
        ExactMirror {
            fx_px,
            fy_px,
            cx_px,
            cy_px,
            vertex_m,
            profile: self.profile.clone(),
            look_up: Arc::default(),
        }
    }

    fn meridian(&self) -> Meridian<'_> {
        Meridian {
            profile: &self.profile,
            vertex_m: self.vertex_m.to_f64(),
        }
    }

    /// F, F' and F'' at t; numbers do not vary with t.
    fn at(&self, t: f64) -> [R; 3] {
        let [sag, slope, curvature] = self.profile.sag_at(t).map(R::of);
        [self.vertex_m + sag, slope, curvature]
    }

    /// ρ/r of a point on the axis, in the limit of ever smaller r.
    fn scale_on_axis(&self, z: R) -> R {
        let [f, _, curvature] = self.at(0.0);
        let one = R::of(1.0);
        one / (f + (f - z) * (one + R::of(2.0) * curvature * f))
    }

    /// ρ/r of a point at r from the axis that is seen through the mirror at t: one step of Newton's iteration at its solution, which carries
    /// the derivatives over.
    fn scale_off_axis(&self, t: f64, r: R, z: R) -> R {
        let (one, two) = (R::of(1.0), R::of(2.0));
        let [f, p, q] = self.at(t);
        let start = R::of(t);
        let a = start * (one - p * p) + two * p * f;
        let b = f * (one - p * p) - two * p * start;
        let slope_of_a = one + p * p + two * q * (f - start * p);
        let slope_of_b = -p * (one + p * p) - two * q * (start + f * p);
        let miss = (r - start) * b - (f - z) * a;
        let slope = (r - start) * slope_of_b - b - (f - z) * slope_of_a - p * a;
        let step = -miss / slope;
        (start + step) / ((f + p * step) * r)
    }
}

impl<R: Real> Projection<R> for ExactMirror<R> {
    /// A bracketed Newton iteration in double precision: for kernels there is [`ExactMirror::to_f32`].
    fn project(&self, [x, y, z]: [R; 3]) -> ([R; 2], bool) {
        let square = x * x + y * y;
        let point = [square.to_f64().sqrt(), z.to_f64()];
        let Some(t) = self.meridian().reflection(point) else {
            return ([self.cx_px, self.cy_px], false);
        };
        let scale = if point[0] > ON_AXIS * self.vertex_m.to_f64() {
            self.scale_off_axis(t, square.sqrt(), z)
        } else {
            self.scale_on_axis(z)
        };
        (
            [
                self.cx_px + self.fx_px * scale * x,
                self.cy_px + self.fy_px * scale * y,
            ],
            true,
        )
    }

    fn unproject(&self, [u, v]: [R; 2]) -> Option<Ray<R>> {
        let (one, two) = (R::of(1.0), R::of(2.0));
        let (x, y) = ((u - self.cx_px) / self.fx_px, (v - self.cy_px) / self.fy_px);
        let square = x * x + y * y;
        let meridian = self.meridian();
        let rho = square.to_f64().sqrt();
        // A hair beyond, so that the pixel of a point on the border has its ray despite rounding.
        if !(rho <= meridian.max_rho() * (1.0 + 1e-12)) {
            return None;
        }
        // The mirror point, and sin φ and cos φ, both over the same length and sin φ over ρ too.
        let (f, sin_over_rho, cos);
        if rho > ON_AXIS {
            let t = meridian.seen_at(rho);
            let [f_start, p_start, q] = self.at(t);
            let rho = square.sqrt();
            let step = (rho * f_start - R::of(t)) / (one - rho * p_start);
            let p = p_start + q * step;
            f = f_start + p_start * step;
            sin_over_rho = f * (one - p * p) + two * p * f / rho;
            cos = f * (one - p * p) - two * p * rho * f;
        } else if self.profile.has_tip() {
            return None;
        } else {
            let [vertex, _, curvature] = self.at(0.0);
            f = vertex;
            sin_over_rho = f + two * curvature * f * f;
            cos = f;
        }
        let direction = [x * sin_over_rho, y * sin_over_rho, -cos];
        let [a, b, c] = direction;
        let inverse = one / (a * a + b * b + c * c).sqrt();
        Some(Ray {
            origin: [x * f, y * f, f],
            direction: direction.map(|d| d * inverse),
        })
    }
}
