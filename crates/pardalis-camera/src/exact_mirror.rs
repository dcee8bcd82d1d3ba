//! Exact model of a perspective camera in front of a mirror of revolution. The model is not
//! central: each ray starts on the mirror.

use std::sync::{Arc, OnceLock};

use super::mirror::{Meridian, MirrorLookUp, MirrorProfile, ReflectedRays};
use super::{Projection, Ray, check_focals, check_principal_point};
use pardalis_core::Error;
use pardalis_core::real::Real;

/// Points closer to the axis than this share of the mirror's distance are treated as on the axis.
const ON_AXIS: f64 = 1e-9;

/// A perspective camera in front of a mirror of revolution.
///
/// A point (r, φ, z) is seen through the mirror point (t, F(t)) for which atan(t/F) + 2·atan(F'(t))
/// = atan2(r − t, F − z). With ρ = t/F, u = cx + fx·ρ·x/r and v = cy + fy·ρ·y/r (Taiana 2007, eq.
/// 3.2, with the tangent missing there). The camera looks along +z into the mirror, so that most of
/// the scene has z < 0.
///
/// Domain: points in front of the mirror's surface that a ray reflected within the rim meets; see
/// [`MirrorProfile`].
#[derive(Debug, Clone)]
pub struct ExactMirror<R> {
    fx_px: R,
    fy_px: R,
    cx_px: R,
    cy_px: R,
    /// Distance of the vertex from the pinhole, which overrides that of the profile.
    vertex_m: R,
    profile: Arc<MirrorProfile>,
    /// Look-up table, built on first use.
    look_up: Arc<OnceLock<ReflectedRays>>,
}

impl PartialEq for ExactMirror<f64> {
    /// Compares the cameras, regardless of whether their look-up tables are built.
    fn eq(&self, other: &Self) -> bool {
        self.parameters() == other.parameters() && self.profile == other.profile
    }
}

impl ExactMirror<f64> {
    /// Creates a camera from the focal lengths and principal point of the perspective camera, in
    /// pixels, and the mirror.
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

    /// Returns the mirror.
    pub fn profile(&self) -> &MirrorProfile {
        &self.profile
    }

    /// Returns the camera with other parameters, in the order of [`Self::NAMES`].
    pub(super) fn with_parameters(
        &self,
        [fx, fy, cx, cy, vertex_m]: [f64; 5],
    ) -> Result<Self, Error> {
        Self::new([fx, fy], [cx, cy], self.profile.at_vertex(vertex_m)?)
    }

    /// Returns the point on the axis, in metres, from which the ray halfway between vertex and rim
    /// appears to come.
    pub(super) fn viewpoint_m(&self) -> [f64; 3] {
        let t = 0.5 * self.profile.rim_m();
        let [f, slope, _] = self.at(t);
        // The ray from the pinhole through (t, f), reflected at the normal (slope, −1).
        let along_normal = 2.0 * (t * slope - f) / (slope * slope + 1.0);
        let (dr, dz) = (t - along_normal * slope, f + along_normal);
        [0.0, 0.0, f - t * dz / dr]
    }

    /// Returns the camera in single precision, for vectorised kernels: a look-up table within 0.02
    /// px, which the first call builds.
    pub fn to_f32(&self) -> MirrorLookUp<'_> {
        let rays = self
            .look_up
            .get_or_init(|| ReflectedRays::new(self.meridian()));
        rays.with_camera(self.parameters().map(|p| p as f32))
    }
}

impl<R: Real> ExactMirror<R> {
    /// Names of the parameters, in order. The shape of the mirror is not a parameter.
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

    /// Returns the camera with other parameters, unchecked and of any number type, and the same
    /// shape.
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

    /// Returns F, F' and F'' at t, treating t as a constant for dual numbers.
    fn at(&self, t: f64) -> [R; 3] {
        let [sag, slope, curvature] = self.profile.sag_at(t).map(R::of);
        [self.vertex_m + sag, slope, curvature]
    }

    /// Returns the limit of ρ/r for a point on the axis.
    fn scale_on_axis(&self, z: R) -> R {
        let [f, _, curvature] = self.at(0.0);
        let one = R::of(1.0);
        one / (f + (f - z) * (one + R::of(2.0) * curvature * f))
    }

    /// Returns ρ/r of a point at distance r from the axis that is seen through the mirror at t. A
    /// Newton step at the solution propagates the derivatives of dual numbers.
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
    /// Solves for the reflection by a bracketed Newton iteration in double precision.
    /// [`ExactMirror::to_f32`] is faster.
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
        // The tolerance absorbs rounding for pixels of points on the border.
        if !(rho <= meridian.max_rho() * (1.0 + 1e-12)) {
            return None;
        }
        // The mirror point's F, and (sin φ)/ρ and cos φ scaled by a common factor.
        let (f, sin_over_rho, cos);
        if rho > ON_AXIS {
            let t = meridian.mirror_point(rho);
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
