//! Shapes of objects and their intersection with rays.

use nalgebra::Vector3;

/// A shape. The origin of its frame is the centre of a ball and the centre of the base of any other body; z
/// is the world's vertical.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Body {
    /// A ball.
    Sphere {
        /// Radius in metres.
        radius_m: f64,
    },
    /// An upright cylinder; a flat one is a disc.
    Cylinder {
        /// Radius in metres.
        radius_m: f64,
        /// Height in metres.
        height_m: f64,
    },
    /// A box.
    Box {
        /// Sides in metres: along the heading, across it, and vertical.
        size_m: Vector3<f64>,
    },
}

/// Intersection of a ray with a body.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Hit {
    /// Distance along the ray in metres; the ray's direction has unit length.
    pub(super) distance_m: f64,
    /// Outward normal of unit length in the ray's frame.
    pub(super) normal: Vector3<f64>,
}

impl Body {
    /// Returns the centre (body frame) and the radius of a bounding sphere, in metres.
    pub(super) fn bounds(&self) -> (Vector3<f64>, f64) {
        match *self {
            Self::Sphere { radius_m } => (Vector3::zeros(), radius_m),
            Self::Cylinder { radius_m, height_m } => (
                Vector3::new(0.0, 0.0, 0.5 * height_m),
                radius_m.hypot(0.5 * height_m),
            ),
            Self::Box { size_m } => (Vector3::new(0.0, 0.0, 0.5 * size_m.z), 0.5 * size_m.norm()),
        }
    }

    /// Returns the point where a ray in the body's frame enters the body; `None` from inside.
    pub(super) fn hit(&self, origin: &Vector3<f64>, direction: &Vector3<f64>) -> Option<Hit> {
        match *self {
            Self::Sphere { radius_m } => {
                let along = -origin.dot(direction);
                let nearest = origin + direction * along;
                let square = radius_m * radius_m - nearest.norm_squared();
                if square < 0.0 {
                    return None;
                }
                let distance_m = along - square.sqrt();
                (distance_m > 0.0).then(|| Hit {
                    distance_m,
                    normal: (origin + direction * distance_m) / radius_m,
                })
            }
            Self::Cylinder { radius_m, height_m } => {
                let round = crossing_of_circle(origin, direction, radius_m)?;
                let flat = crossing_of_slab(origin.z, direction.z, [0.0, height_m])?;
                entry(
                    &[round, flat],
                    |at| (origin + direction * at).xy().push(0.0) / radius_m,
                    direction,
                )
            }
            Self::Box { size_m } => {
                let half = size_m / 2.0;
                let x = crossing_of_slab(origin.x, direction.x, [-half.x, half.x])?;
                let y = crossing_of_slab(origin.y, direction.y, [-half.y, half.y])?;
                let z = crossing_of_slab(origin.z, direction.z, [0.0, size_m.z])?;
                let enter = x[0].max(y[0]);
                let axis = usize::from(x[0] < y[0]);
                let mut side = Vector3::zeros();
                side[axis] = -direction[axis].signum();
                entry(&[[enter, x[1].min(y[1])], z], |_| side, direction)
            }
        }
    }
}

/// Returns the interval of a ray inside both crossings: of the sides, with the given normal, and of top and
/// bottom.
fn entry(
    [sides, flat]: &[[f64; 2]; 2],
    normal_of_side: impl Fn(f64) -> Vector3<f64>,
    direction: &Vector3<f64>,
) -> Option<Hit> {
    let distance_m = sides[0].max(flat[0]);
    if distance_m <= 0.0 || distance_m >= sides[1].min(flat[1]) {
        return None;
    }
    let normal = if sides[0] >= flat[0] {
        normal_of_side(distance_m)
    } else {
        Vector3::new(0.0, 0.0, -direction.z.signum())
    };
    Some(Hit { distance_m, normal })
}

/// Returns the interval of a line in which one coordinate is within bounds.
fn crossing_of_slab(origin: f64, direction: f64, [low, high]: [f64; 2]) -> Option<[f64; 2]> {
    if direction == 0.0 {
        let inside = low <= origin && origin <= high;
        return inside.then_some([f64::NEG_INFINITY, f64::INFINITY]);
    }
    let (a, b) = ((low - origin) / direction, (high - origin) / direction);
    Some([a.min(b), a.max(b)])
}

/// Returns the interval of a line inside the infinite cylinder about z.
fn crossing_of_circle(
    origin: &Vector3<f64>,
    direction: &Vector3<f64>,
    radius_m: f64,
) -> Option<[f64; 2]> {
    let (o, d) = (origin.xy(), direction.xy());
    let a = d.norm_squared();
    let outside = o.norm_squared() - radius_m * radius_m;
    if a == 0.0 {
        return (outside <= 0.0).then_some([f64::NEG_INFINITY, f64::INFINITY]);
    }
    let half_b = o.dot(&d);
    let square = half_b * half_b - a * outside;
    if square < 0.0 {
        return None;
    }
    let root = square.sqrt();
    Some([(-half_b - root) / a, (-half_b + root) / a])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rays_hit_bodies_on_their_surface_with_outward_normals() {
        let bodies = [
            Body::Sphere { radius_m: 0.5 },
            Body::Cylinder {
                radius_m: 0.4,
                height_m: 0.6,
            },
            Body::Box {
                size_m: Vector3::new(0.3, 0.8, 0.5),
            },
        ];
        for body in bodies {
            let (middle, radius_m) = body.bounds();
            let mut hits = 0;
            for i in 0..200 {
                let (a, b) = (f64::from(i) * 0.37, f64::from(i) * 0.011 - 1.1);
                let origin =
                    middle + 3.0 * Vector3::new(a.cos() * b.cos(), a.sin() * b.cos(), b.sin());
                let aim = middle + radius_m * Vector3::new((3.0 * a).sin(), (5.0 * a).cos(), 0.0);
                let direction = (aim - origin).normalize();
                let Some(hit) = body.hit(&origin, &direction) else {
                    continue;
                };
                hits += 1;
                assert!((hit.normal.norm() - 1.0).abs() < 1e-9);
                assert!(hit.normal.dot(&direction) <= 0.0);
                let point = origin + direction * hit.distance_m;
                assert!((point - middle).norm() <= radius_m + 1e-9);
                // Just outside, a ray away from the body misses it; just inside, a ray leaves it.
                let outside = point + hit.normal * 1e-6;
                assert!(body.hit(&outside, &hit.normal).is_none());
                let back = body.hit(&(point - hit.normal * 1e-6), &hit.normal);
                assert!(back.is_none(), "a body is invisible from inside");
            }
            assert!(hits > 50, "{body:?}: {hits}");
        }
    }

    #[test]
    fn disc_is_visible_from_above_but_not_edge_on() {
        let disc = Body::Cylinder {
            radius_m: 0.1,
            height_m: 0.01,
        };
        let down = -Vector3::z();
        let hit = disc.hit(&Vector3::new(0.05, 0.0, 2.0), &down).unwrap();
        assert!((hit.distance_m - 1.99).abs() < 1e-12);
        assert_eq!(hit.normal, Vector3::z());
        assert!(disc.hit(&Vector3::new(0.11, 0.0, 2.0), &down).is_none());
    }
}
