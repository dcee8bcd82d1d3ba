//! Where in the world a target may be, from the blobs of its colours: along each blob's ray by its apparent size, and where rays of two cameras meet.

use nalgebra::{Point3, Vector3};

use crate::detect::{Blob, blobs_alike};
use crate::likelihood::edge::{EdgeCue, Look};
use crate::shape::Shape;

/// The nearest and the farthest place along a ray that is thought of, in diameters of the target.
const NEAREST_DIAMETERS: f64 = 0.75;
const FARTHEST_DIAMETERS: f64 = 200.0;
/// Halvings of the logarithm of the distance: to a hundredth.
const HALVINGS: usize = 12;
/// Rays meet where they pass this close, in diameters.
const MEET_DIAMETERS: f64 = 1.0;

/// What is known of a target before it is looked for.
pub(super) struct Wanted {
    pub(super) shape: Shape,
    /// Its height where it stays on the ground, metres.
    pub(super) ground_z_m: Option<f64>,
}

/// A ray in the world.
struct Ray {
    origin: Point3<f64>,
    direction: Vector3<f64>,
}

impl Ray {
    fn of(look: &Look, pixel: [f64; 2]) -> Option<Self> {
        let view = look.evidence().view();
        let ray = view.camera().unproject(pixel)?;
        Some(Self {
            origin: view.world_from_camera() * Point3::from(ray.origin),
            direction: view.world_from_camera() * Vector3::from(ray.direction),
        })
    }

    fn at(&self, distance_m: f64) -> Point3<f64> {
        self.origin + self.direction * distance_m
    }
}

impl Wanted {
    /// The position of a target whose middle is here.
    fn position_m(&self, middle: Point3<f64>) -> [f64; 3] {
        let [x, y, z] = middle.into();
        [
            x,
            y,
            self.ground_z_m.unwrap_or(z - self.shape.middle_height_m()),
        ]
    }

    /// The middle of a target on the ground that is seen along a ray.
    fn on_ground(&self, ray: &Ray, ground_z_m: f64) -> Option<[f64; 3]> {
        let height_m = ground_z_m + self.shape.middle_height_m();
        let distance_m = (height_m - ray.origin.z) / ray.direction.z;
        let farthest_m = FARTHEST_DIAMETERS * self.shape.diameter_m();
        (distance_m > 0.0 && distance_m < farthest_m).then(|| self.position_m(ray.at(distance_m)))
    }

    /// Where along its ray a target has a blob's area.
    fn by_size(&self, edge: &mut EdgeCue, look: &Look, ray: &Ray, blob: &Blob) -> Option<[f64; 3]> {
        let diameter_m = self.shape.diameter_m();
        let [mut near, mut far] = [NEAREST_DIAMETERS, FARTHEST_DIAMETERS]
            .map(|diameters| libm::log(diameters * diameter_m));
        for _ in 0..HALVINGS {
            let middle = 0.5 * (near + far);
            let position_m = self.position_m(ray.at(libm::exp(middle)));
            let is_small = edge.area_px(look, position_m) < blob.area_px;
            *(if is_small { &mut far } else { &mut near }) = middle;
        }
        let distance_m = libm::exp(0.5 * (near + far));
        let is_inside = distance_m > 1.02 * NEAREST_DIAMETERS * diameter_m
            && distance_m < 0.98 * FARTHEST_DIAMETERS * diameter_m;
        is_inside.then(|| self.position_m(ray.at(distance_m)))
    }

    /// The places, in the world, in metres, that the frames' blobs speak for; those of one camera alone, then of two.
    pub(super) fn places_m(&self, edge: &mut EdgeCue, looks: &[Look]) -> Vec<[f64; 3]> {
        let mut places_m = Vec::new();
        let mut rays: Vec<(usize, Ray)> = Vec::new();
        for look in looks {
            let (palette, ranges) = (edge.palette(), edge.ranges());
            for blob in blobs_alike(
                look.evidence(),
                palette,
                look.likeness(),
                ranges,
                look.relight(),
            ) {
                let Some(ray) = Ray::of(look, blob.centroid_px) else {
                    continue;
                };
                places_m.extend(match self.ground_z_m {
                    Some(ground_z_m) => self.on_ground(&ray, ground_z_m),
                    None => self.by_size(edge, look, &ray, &blob),
                });
                rays.push((look.camera(), ray));
            }
        }
        if self.ground_z_m.is_none() {
            for (i, (camera, ray)) in rays.iter().enumerate() {
                for (other, other_ray) in &rays[..i] {
                    if camera != other {
                        places_m.extend(self.meeting_m(ray, other_ray));
                    }
                }
            }
        }
        places_m
    }

    /// Where two rays meet, or pass close by each other.
    fn meeting_m(&self, a: &Ray, b: &Ray) -> Option<[f64; 3]> {
        let between = b.origin - a.origin;
        let cos = a.direction.dot(&b.direction);
        let sin_squared = 1.0 - cos * cos;
        let [along_a, along_b] = [a.direction.dot(&between), b.direction.dot(&between)];
        let distance_a = (along_a - cos * along_b) / sin_squared;
        let distance_b = (cos * along_a - along_b) / sin_squared;
        let farthest_m = FARTHEST_DIAMETERS * self.shape.diameter_m();
        let fits = |distance: f64| distance > 0.0 && distance < farthest_m;
        // Not so for parallel rays, of which the distances are no numbers.
        if !(fits(distance_a) && fits(distance_b)) {
            return None;
        }
        let [at_a, at_b] = [a.at(distance_a), b.at(distance_b)];
        let is_close = (at_a - at_b).norm() < MEET_DIAMETERS * self.shape.diameter_m();
        is_close.then(|| self.position_m(nalgebra::center(&at_a, &at_b)))
    }
}
