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
    /// Orientation of each object.
    turns: Vec<Turn>,
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
            turns: placed.iter().map(Turn::of).collect(),
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
        let middle = self.turns[object].world_from_body(&middle);
        (self.placed[object].position_m + middle, radius_m)
    }

    /// Returns the intersection of a world ray with one object.
    pub(super) fn hit(&self, object: usize, ray: &WorldRay) -> Option<Hit> {
        let placed = &self.placed[object];
        let turn = &self.turns[object];
        let origin = turn.body_from_world(&(ray.origin - placed.position_m));
        let direction = turn.body_from_world(&ray.direction);
        let hit = self.world.objects[object].body.hit(&origin, &direction)?;
        Some(Hit {
            normal: turn.world_from_body(&hit.normal),
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
        match &self.world.ground {
            Some(ground) if ground_m < room_m => {
                let mut point = ray.at(ground_m);
                if let Some(tape) = ground.tape.filter(|tape| tape.covers(&point)) {
                    return tape.color.into();
                }
                point.z = 0.0;
                ground.texture.color_at(&point, self.key(0))
            }
            _ => room.texture.color_at(&ray.at(room_m), self.key(1)),
        }
    }

    /// Returns the key of a surface's noise. Each has its own, which no other random draw uses.
    fn key(&self, surface: u32) -> [u32; 2] {
        [self.world.seed, u32::MAX - surface]
    }

    /// Returns the colour of an object's surface in full light.
    fn painted(&self, number: usize, hit: &Hit, ray: &WorldRay) -> Vector3<f64> {
        /// Depth below the surface, in metres, at which the pattern is read: rounding does not decide on a face that
        /// coincides with the border of two cells.
        const DEPTH_M: f64 = 1e-6;
        let object = &self.world.objects[number];
        let point = ray.at(hit.distance_m) - hit.normal * DEPTH_M;
        let point = self.turns[number].body_from_world(&(point - self.placed[number].position_m));
        let mut marks = object.marks.iter().rev();
        match marks.find_map(|mark| mark.color_at(&point)) {
            Some(color) => color.into(),
            None => object.texture.color_at(&point, self.key(2 + number as u32)),
        }
    }

    /// Applies Lambert's law and Phong's highlight.
    fn shaded(&self, number: usize, hit: &Hit, ray: &WorldRay) -> Vector3<f64> {
        let (object, light) = (&self.world.objects[number], &self.world.light);
        let facing = hit.normal.dot(&light.direction).max(0.0);
        let painted = self.painted(number, hit, ray);
        let color = painted * (light.ambient + (1.0 - light.ambient) * facing);
        let mirrored = ray.direction - hit.normal * (2.0 * hit.normal.dot(&ray.direction));
        let glance = mirrored.dot(&light.direction).max(0.0);
        color.add_scalar(object.highlight * glance.powi(SHININESS))
    }
}

/// Orientation of an object: sines and cosines of its angles.
struct Turn {
    heading: (f64, f64),
    tilt: (f64, f64),
}

impl Turn {
    fn of(placed: &Placed) -> Self {
        Self {
            heading: libm::sincos(placed.heading_rad),
            tilt: libm::sincos(placed.tilt_rad),
        }
    }

    fn world_from_body(&self, v: &Vector3<f64>) -> Vector3<f64> {
        turned(&tilted(v, self.tilt), self.heading)
    }

    fn body_from_world(&self, v: &Vector3<f64>) -> Vector3<f64> {
        let back = |(sin, cos): (f64, f64)| (-sin, cos);
        tilted(&turned(v, back(self.heading)), back(self.tilt))
    }
}

/// Rotates a vector forward about the y axis by the angle with this sine and cosine.
fn tilted(v: &Vector3<f64>, (sin, cos): (f64, f64)) -> Vector3<f64> {
    Vector3::new(cos * v.x + sin * v.z, v.y, cos * v.z - sin * v.x)
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
