//! Shapes of objects and their intersection with rays.

use std::f64::consts::PI;

use nalgebra::Vector3;

/// A shape. Unless stated otherwise, the origin of its frame is the centre of its base; x points ahead, y to the
/// left and z up.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Body {
    /// A ball. The origin is its centre.
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
    /// An upright cone with its tip at the top.
    Cone {
        /// Radius of the base in metres.
        radius_m: f64,
        /// Height in metres.
        height_m: f64,
    },
    /// A cylinder with round ends, such as a finger or an arm. Its origin is the centre of its first end.
    Capsule {
        /// Radius in metres.
        radius_m: f64,
        /// Centre of the other end in metres: body frame.
        to_m: Vector3<f64>,
    },
    /// An upright piece of cloth without thickness, with folds and an irregular outline. It faces ahead.
    Cloth {
        /// Width and height in metres.
        size_m: [f64; 2],
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
            Self::Cylinder { radius_m, height_m } | Self::Cone { radius_m, height_m } => (
                Vector3::new(0.0, 0.0, 0.5 * height_m),
                libm::hypot(radius_m, 0.5 * height_m),
            ),
            Self::Box { size_m } => (Vector3::new(0.0, 0.0, 0.5 * size_m.z), 0.5 * size_m.norm()),
            Self::Capsule { radius_m, to_m } => (0.5 * to_m, radius_m + 0.5 * to_m.norm()),
            Self::Cloth {
                size_m: [width, height],
            } => (
                Vector3::new(0.0, 0.0, 0.5 * height),
                0.5 * libm::hypot(width, height),
            ),
        }
    }

    /// Returns the point where a ray in the body's frame enters the body; `None` from inside.
    pub(super) fn hit(&self, origin: &Vector3<f64>, direction: &Vector3<f64>) -> Option<Hit> {
        match *self {
            Self::Sphere { radius_m } => hit_of_sphere(origin, direction, radius_m),
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
            Self::Cone { radius_m, height_m } => {
                let hits = [
                    hit_of_cone_side(origin, direction, radius_m, height_m),
                    hit_of_cone_base(origin, direction, radius_m),
                ];
                nearest(hits)
            }
            Self::Capsule { radius_m, to_m } => {
                let from_other_end = hit_of_sphere(&(origin - to_m), direction, radius_m);
                let hits = [
                    hit_of_sphere(origin, direction, radius_m),
                    from_other_end,
                    hit_of_tube(origin, direction, radius_m, &to_m),
                ];
                // The parts overlap, and a ray inside one of them enters another.
                let inside = distance_from_segment(origin, &to_m) < radius_m;
                nearest(hits).filter(|_| !inside)
            }
            Self::Cloth { size_m } => hit_of_cloth(origin, direction, size_m),
        }
    }
}

/// Returns the nearest of several hits.
fn nearest<const COUNT: usize>(hits: [Option<Hit>; COUNT]) -> Option<Hit> {
    let hits = hits.into_iter().flatten();
    hits.min_by(|a, b| a.distance_m.total_cmp(&b.distance_m))
}

fn hit_of_sphere(origin: &Vector3<f64>, direction: &Vector3<f64>, radius_m: f64) -> Option<Hit> {
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

/// Returns where a ray enters the side of a cone that stands on its base.
fn hit_of_cone_side(
    origin: &Vector3<f64>,
    direction: &Vector3<f64>,
    radius_m: f64,
    height_m: f64,
) -> Option<Hit> {
    // Points of the side satisfy x² + y² = (slope · depth)², where depth is measured down from the tip.
    let slope = radius_m / height_m;
    let (o, d) = (origin.xy(), direction.xy());
    let (depth, sinking) = (height_m - origin.z, -direction.z);
    let a = d.norm_squared() - (slope * sinking).powi(2);
    let half_b = o.dot(&d) - slope * slope * depth * sinking;
    let c = o.norm_squared() - (slope * depth).powi(2);
    let square = half_b * half_b - a * c;
    if a == 0.0 || square < 0.0 {
        return None;
    }
    let root = square.sqrt();
    let hits = [(-half_b - root) / a, (-half_b + root) / a].map(|distance_m| {
        let point = origin + direction * distance_m;
        let normal = Vector3::new(point.x, point.y, slope * slope * (height_m - point.z));
        let enters =
            distance_m > 0.0 && (0.0..height_m).contains(&point.z) && normal.dot(direction) < 0.0;
        enters.then(|| Hit {
            distance_m,
            normal: normal.normalize(),
        })
    });
    nearest(hits)
}

/// Returns where a ray enters the base of a cone from below.
fn hit_of_cone_base(origin: &Vector3<f64>, direction: &Vector3<f64>, radius_m: f64) -> Option<Hit> {
    let distance_m = -origin.z / direction.z;
    let is_hit = direction.z > 0.0
        && distance_m > 0.0
        && (origin + direction * distance_m).xy().norm() < radius_m;
    is_hit.then(|| Hit {
        distance_m,
        normal: -Vector3::z(),
    })
}

/// Returns where a ray enters the round side of the cylinder from the origin to a point.
fn hit_of_tube(
    origin: &Vector3<f64>,
    direction: &Vector3<f64>,
    radius_m: f64,
    to_m: &Vector3<f64>,
) -> Option<Hit> {
    let length_m = to_m.norm();
    let axis = to_m / length_m;
    let across = |v: &Vector3<f64>| v - axis * axis.dot(v);
    let (o, d) = (across(origin), across(direction));
    let (a, half_b) = (d.norm_squared(), o.dot(&d));
    let square = half_b * half_b - a * (o.norm_squared() - radius_m * radius_m);
    if a == 0.0 || square < 0.0 {
        return None;
    }
    let distance_m = (-half_b - square.sqrt()) / a;
    let point = origin + direction * distance_m;
    let is_hit = distance_m > 0.0 && (0.0..=length_m).contains(&axis.dot(&point));
    is_hit.then(|| Hit {
        distance_m,
        normal: across(&point) / radius_m,
    })
}

/// Returns the distance of a point from the segment between the origin and another point.
fn distance_from_segment(point: &Vector3<f64>, to_m: &Vector3<f64>) -> f64 {
    let share = (point.dot(to_m) / to_m.norm_squared()).clamp(0.0, 1.0);
    (point - to_m * share).norm()
}

/// Returns where a ray meets a cloth. Both sides are visible.
fn hit_of_cloth(
    origin: &Vector3<f64>,
    direction: &Vector3<f64>,
    [width, height]: [f64; 2],
) -> Option<Hit> {
    /// Number of folds, and their greatest slope.
    const FOLDS: f64 = 4.0;
    const SLOPE: f64 = 0.7;
    let distance_m = -origin.x / direction.x;
    let point = origin + direction * distance_m;
    // From -1 to 1 across and upwards.
    let (across, up) = (2.0 * point.y / width, 2.0 * point.z / height - 1.0);
    let angle = libm::atan2(up, across);
    // Within the ellipse in this box; three incommensurate waves leave no symmetry.
    let border = 0.8
        + 0.1 * libm::sin(2.0 * angle + 1.0)
        + 0.06 * libm::sin(3.0 * angle + 2.0)
        + 0.04 * libm::sin(7.0 * angle);
    // False as well if the ray runs along the cloth, where numbers are not finite.
    let is_hit = distance_m > 0.0 && libm::hypot(across, up) < border;
    // Folds fan out from the top.
    let fold = libm::cos(PI * FOLDS * across + up);
    let normal = Vector3::new(1.0, SLOPE * fold, 0.2 * fold).normalize();
    is_hit.then(|| Hit {
        distance_m,
        normal: normal * -direction.x.signum(),
    })
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
            Body::Cone {
                radius_m: 0.5,
                height_m: 0.4,
            },
            Body::Capsule {
                radius_m: 0.3,
                to_m: Vector3::new(0.3, -0.2, 0.1),
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
    fn cone_is_seen_up_to_its_tip_and_from_below() {
        let cone = Body::Cone {
            radius_m: 0.3,
            height_m: 0.6,
        };
        let hit = |from: [f64; 3], along: Vector3<f64>| cone.hit(&from.into(), &along);
        // At half height it is half as wide.
        let side = hit([-2.0, 0.0, 0.3], Vector3::x()).unwrap();
        assert!((side.distance_m - 1.85).abs() < 1e-12);
        assert!((side.normal - Vector3::new(-2.0, 0.0, 1.0).normalize()).norm() < 1e-12);
        assert!(hit([-2.0, 0.149, 0.3], Vector3::x()).is_some());
        assert!(hit([-2.0, 0.151, 0.3], Vector3::x()).is_none());
        assert!(hit([-2.0, 0.0, 0.61], Vector3::x()).is_none());
        let below = hit([0.2, 0.0, -1.0], Vector3::z()).unwrap();
        assert_eq!((below.distance_m, below.normal), (1.0, -Vector3::z()));
        let above = hit([0.2, 0.0, 1.0], -Vector3::z()).unwrap();
        assert!((above.distance_m - 0.8).abs() < 1e-12);
    }

    #[test]
    fn capsule_is_as_long_as_its_axis_and_both_ends() {
        let capsule = Body::Capsule {
            radius_m: 0.1,
            to_m: Vector3::new(0.5, 0.0, 0.0),
        };
        let hit = |from: [f64; 3], along: Vector3<f64>| capsule.hit(&from.into(), &along);
        let side = hit([0.25, -1.0, 0.0], Vector3::y()).unwrap();
        assert!((side.distance_m - 0.9).abs() < 1e-12 && side.normal.y < -0.999);
        assert!((hit([-1.0, 0.0, 0.0], Vector3::x()).unwrap().distance_m - 0.9).abs() < 1e-12);
        assert!((hit([2.0, 0.0, 0.0], -Vector3::x()).unwrap().distance_m - 1.4).abs() < 1e-12);
        assert!(hit([0.59, -1.0, 0.0], Vector3::y()).is_some());
        assert!(hit([0.61, -1.0, 0.0], Vector3::y()).is_none());
    }

    #[test]
    fn cloth_shows_both_sides_has_folds_and_is_no_ellipse() {
        let cloth = Body::Cloth { size_m: [0.4, 0.6] };
        let (middle, radius_m) = cloth.bounds();
        let (mut normals, mut extents) = (Vec::new(), Vec::new());
        for i in 0..360 {
            let (sin, cos) = libm::sincos(f64::from(i).to_radians());
            let at = |share: f64| {
                let across = Vector3::new(0.0, 0.2 * share * cos, 0.3 * share * sin);
                cloth.hit(&(middle + across - Vector3::x()), &Vector3::x())
            };
            normals.extend(at(0.5).map(|hit| hit.normal));
            let steps = (0..=100).map(|step| f64::from(step) / 100.0);
            extents.push(steps.take_while(|&share| at(share).is_some()).count());
        }
        assert_eq!(normals.len(), 360, "the middle is covered");
        assert!(normals.iter().all(|normal| normal.x < -0.5));
        let range = |values: &[f64]| {
            let greatest = values.iter().copied().fold(f64::MIN, f64::max);
            greatest - values.iter().copied().fold(f64::MAX, f64::min)
        };
        assert!(range(&normals.iter().map(|n| n.y).collect::<Vec<_>>()) > 0.8);
        let extents: Vec<f64> = extents
            .into_iter()
            .map(|steps| steps as f64 / 100.0)
            .collect();
        assert!(range(&extents) > 0.2 && extents.iter().all(|&extent| extent < 1.0));
        let back = cloth.hit(&(middle + Vector3::x()), &-Vector3::x()).unwrap();
        assert!(back.normal.x > 0.5 && back.distance_m == 1.0);
        assert!(radius_m >= 0.36);
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
