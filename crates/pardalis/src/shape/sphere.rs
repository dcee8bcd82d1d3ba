//! Spheres and their outlines seen from a point.

use serde::{Deserialize, Serialize};

use pardalis_core::Error;
use pardalis_core::real::Real;

/// The circle of the sphere that is used as its outline.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum SphereOutline {
    /// The circle where rays from the camera touch the sphere: the exact outline.
    #[default]
    Tangent,
    /// The great circle perpendicular to the viewing ray, a slightly larger approximation (Taiana 2007,
    /// section 4.2).
    Greatcircle,
}

/// A sphere.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sphere {
    /// Radius in metres.
    pub radius_m: f64,
    /// The circle used as the outline.
    pub outline: SphereOutline,
}

impl Sphere {
    /// Creates a sphere.
    ///
    /// # Errors
    ///
    /// The radius is not above 0 and at most 1000 m.
    pub fn new(radius_m: f64, outline: SphereOutline) -> Result<Self, Error> {
        if radius_m > 0.0 && radius_m <= 1000.0 {
            return Ok(Self { radius_m, outline });
        }
        Err(Error::out_of_range(
            "radius_m",
            radius_m,
            "above 0 and at most 1000",
        ))
    }
}

/// A circle in the camera frame, with the points `center + cos φ·a + sin φ·b`. The lengths of `a` and `b` are
/// its radius.
#[derive(Debug, Clone, Copy)]
pub struct OutlineCircle<R> {
    /// Centre, metres.
    pub center: [R; 3],
    /// Vector from the centre to the point at φ = 0.
    pub a: [R; 3],
    /// Vector from the centre to the point at φ = 90°.
    pub b: [R; 3],
}

impl<R: Real> OutlineCircle<R> {
    /// Computes the outline of the sphere around `center` as seen from the origin, and whether it exists:
    /// there is none from inside the sphere.
    ///
    /// For a centre C at distance d and radius R, the tangent circle has radius R·√(1 − R²/d²) and lies at
    /// distance d − R²/d; the great circle has radius R and lies at distance d. The code is free of branches.
    #[inline(always)]
    pub fn of_sphere(center: [R; 3], radius: R, outline: SphereOutline) -> (Self, bool) {
        let [x, y, z] = center;
        let one = R::of(1.0);
        let d2 = x * x + y * y + z * z;
        let outside = d2 > radius * radius;
        let d2 = if outside { d2 } else { one };
        let inverse_d = one / d2.sqrt();
        let [nx, ny, nz] = [x * inverse_d, y * inverse_d, z * inverse_d];
        let sine2 = radius * radius / d2;
        let (shrink, circle_radius) = match outline {
            SphereOutline::Tangent => {
                let rest = one - sine2;
                let rest = if rest > R::of(0.0) { rest } else { R::of(0.0) };
                (rest, radius * rest.sqrt())
            }
            SphereOutline::Greatcircle => (one, radius),
        };
        // Two directions perpendicular to the ray (Duff et al. 2017), without branches or singular
        // directions.
        let sign = nz.signum();
        let p = -one / (sign + nz);
        let q = nx * ny * p;
        let a = [one + sign * nx * nx * p, sign * q, -sign * nx];
        let b = [q, sign + ny * ny * p, -ny];
        let circle = Self {
            center: [x * shrink, y * shrink, z * shrink],
            a: a.map(|c| c * circle_radius),
            b: b.map(|c| c * circle_radius),
        };
        (circle, outside)
    }

    /// Returns the point at the angle with the given cosine and sine.
    #[inline(always)]
    pub fn point(&self, cos: R, sin: R) -> [R; 3] {
        let at = |i: usize| self.center[i] + cos * self.a[i] + sin * self.b[i];
        [at(0), at(1), at(2)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
        a.iter().zip(b).map(|(a, b)| a * b).sum()
    }

    #[test]
    fn tangent_points_lie_on_the_sphere_and_their_rays_are_tangent() {
        let radius = 0.11;
        for center in [
            [0.3, -0.2, 0.5],
            [0.0, 0.0, 0.12],
            [0.0, 0.0, -3.0],
            [2.0, 1.0, -0.1],
            [-1.0, 0.0, 0.0],
        ] {
            let (circle, outside) =
                OutlineCircle::of_sphere(center, radius, SphereOutline::Tangent);
            assert!(outside);
            for i in 0..12 {
                let (sin, cos) = (f64::from(i) * 0.53).sin_cos();
                let point = circle.point(cos, sin);
                let from_center = [0, 1, 2].map(|c| point[c] - center[c]);
                assert!((dot(from_center, from_center).sqrt() - radius).abs() < 1e-12);
                assert!(
                    dot(from_center, point).abs() < 1e-12,
                    "the ray must be perpendicular to the radius"
                );
            }
        }
    }

    #[test]
    fn the_great_circle_is_perpendicular_to_the_viewing_ray() {
        let center = [0.5, 0.4, -0.6];
        let (circle, _) = OutlineCircle::of_sphere(center, 0.2, SphereOutline::Greatcircle);
        for (cos, sin) in [(1.0, 0.0), (0.0, 1.0), (-0.6, 0.8)] {
            let from_center = [0, 1, 2].map(|c| circle.point(cos, sin)[c] - center[c]);
            assert!((dot(from_center, from_center).sqrt() - 0.2).abs() < 1e-12);
            assert!(dot(from_center, center).abs() < 1e-12);
        }
    }

    #[test]
    fn a_viewpoint_inside_the_sphere_has_no_outline() {
        assert!(!OutlineCircle::of_sphere([0.0, 0.05, 0.05], 0.11, SphereOutline::Tangent).1);
        assert!(!OutlineCircle::of_sphere([0.0; 3], 0.11, SphereOutline::Greatcircle).1);
        assert!(!OutlineCircle::of_sphere([f64::NAN, 0.0, 1.0], 0.11, SphereOutline::Tangent).1);
        for bad in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            assert!(Sphere::new(bad, SphereOutline::Tangent).is_err());
        }
    }
}
