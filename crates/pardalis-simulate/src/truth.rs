//! What is true of each object as a camera sees it.

use std::f64::consts::{PI, TAU};

use nalgebra::{Point3, Vector3};

use super::trace::{Snapshot, WorldRay};
use super::{Placed, World, WorldCamera};
use pardalis::shape::{OutlineCircle, SphereOutline};

/// An object at one time, and how one camera sees it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Truth {
    /// Where it is in the world.
    pub placed: Placed,
    /// Its position in the camera's frame, metres.
    pub position_in_camera_m: [f64; 3],
    /// The pixel of its position, `None` outside the camera's domain.
    pub pixel: Option<[f64; 2]>,
    /// The share of what the camera would see of it alone that is neither hidden nor outside the image, 0 to 1.
    pub visible_fraction: f64,
}

/// The truth of every object at a time, as one of the world's cameras sees it.
pub fn truth(world: &World, camera: &WorldCamera, time_s: f64) -> Vec<Truth> {
    let snapshot = Snapshot::new(world, time_s);
    let camera_from_world = camera.world_from_camera.inverse();
    (0..world.objects.len())
        .map(|object| {
            let placed = *snapshot.placed(object);
            let in_camera = camera_from_world * Point3::from(placed.position_m);
            Truth {
                placed,
                position_in_camera_m: in_camera.into(),
                pixel: camera.camera.project(in_camera.into()),
                visible_fraction: visible_fraction(&snapshot, camera, object),
            }
        })
        .collect()
}

/// Rays by which visibility is judged: steps of a quarter of a per cent.
const RAYS: usize = 400;

fn visible_fraction(snapshot: &Snapshot, camera: &WorldCamera, object: usize) -> f64 {
    let camera_from_world = camera.world_from_camera.inverse();
    let viewpoint = camera.world_from_camera * Point3::from(camera.camera.viewpoint_m());
    let (middle, radius_m) = snapshot.bounds(object);
    let (mut seen, mut alone) = (0, 0);
    for i in 0..RAYS {
        let aim = aim_at(&(middle - viewpoint.coords), radius_m, i);
        let ray = WorldRay {
            origin: viewpoint.coords,
            direction: aim.normalize(),
        };
        let Some(hit) = snapshot.hit(object, &ray) else {
            continue;
        };
        alone += 1;
        let is_first = snapshot
            .first(&ray)
            .is_some_and(|(first, _)| first == object);
        let point = camera_from_world * Point3::from(ray.at(hit.distance_m));
        let pixel = camera.camera.project(point.into());
        seen += i32::from(is_first && pixel.is_some_and(|pixel| camera.shows(pixel)));
    }
    if alone == 0 {
        return 0.0;
    }
    f64::from(seen) / f64::from(alone)
}

impl WorldCamera {
    /// Whether a place in the image plane is covered by a pixel.
    fn shows(&self, pixel: [f64; 2]) -> bool {
        let inside = |at: f64, count: usize| -0.5 <= at && at < count as f64 - 0.5;
        inside(pixel[0], self.size_px.0) && inside(pixel[1], self.size_px.1)
    }
}

/// One of [`RAYS`] directions spread evenly (Vogel's spiral) over the disc that a sphere appears as; from within it, over all directions.
fn aim_at(middle: &Vector3<f64>, radius_m: f64, number: usize) -> Vector3<f64> {
    let share = (number as f64 + 0.5) / RAYS as f64;
    let golden_angle = PI * (3.0 - 5.0_f64.sqrt());
    let (sin, cos) = libm::sincos((number as f64 * golden_angle) % TAU);
    let (circle, outside) =
        OutlineCircle::of_sphere((*middle).into(), radius_m, SphereOutline::Tangent);
    if outside {
        let reach = share.sqrt();
        return Vector3::from(circle.point(reach * cos, reach * sin));
    }
    let z = 1.0 - 2.0 * share;
    let across = (1.0 - z * z).sqrt();
    Vector3::new(across * cos, across * sin, z)
}
