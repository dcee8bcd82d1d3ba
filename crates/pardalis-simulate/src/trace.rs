//! Ray casting.

use nalgebra::{Point3, Vector3};

use super::body::Hit;
use super::{Placed, World, turned};
use pardalis_camera::Pose;
use pardalis_camera::{Camera, Ray};

/// The world at one instant.
pub(super) struct Snapshot<'a> {
    world: &'a World,
    placed: Vec<Placed>,
    /// Sine and cosine of each object's heading.
    turns: Vec<(f64, f64)>,
    /// Indices of the objects present.
    present: Vec<usize>,
}

/// Exponent of the highlights (Phong 1975).
const SHININESS: i32 = 30;

impl<'a> Snapshot<'a> {
    pub(super) fn new(world: &'a World, time_s: f64) -> Self {
        let placed = world.placed(time_s);
        Self {
            world,
            turns: placed.iter().map(|p| libm::sincos(p.heading_rad)).collect(),
            placed,
            present: (0..world.objects.len()).collect(),
        }
    }

    /// Returns the world without objects that ever move.
    pub(super) fn still(world: &'a World) -> Self {
        let mut snapshot = Self::new(world, 0.0);
        snapshot.present.retain(|&object| !world.moves(object));
        snapshot
    }

    /// Returns the placement of an object.
    pub(super) fn placed(&self, object: usize) -> &Placed {
        &self.placed[object]
    }

    /// Returns centre and radius of a sphere around an object, world frame, metres.
    pub(super) fn bounds(&self, object: usize) -> (Vector3<f64>, f64) {
        let (middle, radius_m) = self.world.objects[object].body.bounds();
        (self.placed[object].position_m + middle, radius_m)
    }

    /// Returns the intersection of a world ray with one object.
    pub(super) fn hit(&self, object: usize, ray: &WorldRay) -> Option<Hit> {
        let placed = &self.placed[object];
        let (sin, cos) = self.turns[object];
        let origin = turned(&(ray.origin - placed.position_m), (-sin, cos));
        let direction = turned(&ray.direction, (-sin, cos));
        let hit = self.world.objects[object].body.hit(&origin, &direction)?;
        Some(Hit {
            normal: turned(&hit.normal, (sin, cos)),
            ..hit
        })
    }

    /// Returns the first object that a ray meets in front of the ground.
    pub(super) fn first(&self, ray: &WorldRay) -> Option<(usize, Hit)> {
        let (object, hit) = self
            .present
            .iter()
            .filter_map(|&object| Some((object, self.hit(object, ray)?)))
            .min_by(|a, b| a.1.distance_m.total_cmp(&b.1.distance_m))?;
        let behind_ground = self.ground_distance_m(ray) < hit.distance_m;
        (!behind_ground).then_some((object, hit))
    }

    fn ground_distance_m(&self, ray: &WorldRay) -> f64 {
        match &self.world.ground {
            Some(ground) if ray.direction.z < 0.0 && ray.origin.z > ground.z_m => {
                (ground.z_m - ray.origin.z) / ray.direction.z
            }
            _ => f64::INFINITY,
        }
    }

    /// Returns the light along a ray: linear red, green and blue.
    pub(super) fn color(&self, ray: &WorldRay) -> Vector3<f64> {
        if let Some((object, hit)) = self.first(ray) {
            return self.shaded(object, &hit, ray);
        }
        let room = &self.world.room;
        let room_m = ray.leaves_sphere_m(room.radius_m);
        let ground_m = self.ground_distance_m(ray);
        // Each surface has its own noise; no other random draw uses these keys.
        let key = |surface: u32| [self.world.seed, u32::MAX - surface];
        match &self.world.ground {
            Some(ground) if ground_m < room_m => {
                let mut point = ray.at(ground_m);
                if let Some(tape) = ground.tape.filter(|tape| tape.covers(&point)) {
                    return tape.color.into();
                }
                point.z = 0.0;
                ground.texture.color_at(&point, key(0))
            }
            _ => room.texture.color_at(&ray.at(room_m), key(1)),
        }
    }

    /// Applies Lambert's law and Phong's highlight.
    fn shaded(&self, object: usize, hit: &Hit, ray: &WorldRay) -> Vector3<f64> {
        let (object, light) = (&self.world.objects[object], &self.world.light);
        let facing = hit.normal.dot(&light.direction).max(0.0);
        let color = Vector3::from(object.color) * (light.ambient + (1.0 - light.ambient) * facing);
        let mirrored = ray.direction - hit.normal * (2.0 * hit.normal.dot(&ray.direction));
        let glance = mirrored.dot(&light.direction).max(0.0);
        color.add_scalar(object.highlight * glance.powi(SHININESS))
    }
}

/// A ray in the world frame.
pub(super) struct WorldRay {
    /// Origin in metres.
    pub(super) origin: Vector3<f64>,
    /// Direction of unit length.
    pub(super) direction: Vector3<f64>,
}

impl WorldRay {
    /// Returns the ray of a pixel; `None` if the camera has none.
    pub(super) fn of_pixel(
        camera: &Camera,
        world_from_camera: &Pose,
        pixel: [f64; 2],
    ) -> Option<Self> {
        let Ray { origin, direction } = camera.unproject(pixel)?;
        Some(Self {
            origin: (world_from_camera * Point3::from(origin)).coords,
            direction: world_from_camera.rotation * Vector3::from(direction),
        })
    }

    pub(super) fn at(&self, distance_m: f64) -> Vector3<f64> {
        self.origin + self.direction * distance_m
    }

    /// Returns the distance at which the ray leaves a sphere around the world's origin; from outside, the
    /// distance to the nearest point.
    fn leaves_sphere_m(&self, radius_m: f64) -> f64 {
        let along = -self.origin.dot(&self.direction);
        let square = radius_m * radius_m - self.at(along).norm_squared();
        (along + square.max(0.0).sqrt()).max(0.0)
    }
}

impl super::Tape {
    fn covers(&self, point: &Vector3<f64>) -> bool {
        let from_rim =
            |axis: usize| 0.5 * self.size_m[axis] - (point[axis] - self.center_m[axis]).abs();
        let inward_m = from_rim(0).min(from_rim(1));
        (0.0..=self.width_m).contains(&inward_m)
    }
}
