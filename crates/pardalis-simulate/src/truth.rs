//! Ground truth of each object as seen by a camera.

use std::f64::consts::{PI, TAU};

use nalgebra::{Point3, Vector3};

use super::trace::{Snapshot, WorldRay};
use super::{Placed, World, WorldCamera};
use pardalis::shape::{OutlineCircle, SphereOutline};
use pardalis_camera::Pose;

/// State of an object at one time, and its appearance in one camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Truth {
    /// Position, velocity and heading in the world frame.
    pub placed: Placed,
    /// Position in the camera's frame, in metres.
    pub position_in_camera_m: [f64; 3],
    /// Pixel of the position; `None` outside the camera's domain.
    pub pixel: Option<[f64; 2]>,
    /// Visible share, 0 to 1: the part that is neither occluded nor outside the image, relative to the
    /// object's unoccluded appearance.
    pub visible_fraction: f64,
}

/// Returns the truth of every object at a time in seconds, as seen by one of the world's cameras.
pub fn truth(world: &World, camera: &WorldCamera, time_s: f64) -> Vec<Truth> {
    let snapshot = Snapshot::new(world, time_s);
    let world_from_camera = world.world_from_camera(camera, time_s);
    let camera_from_world = world_from_camera.inverse();
    (0..world.objects.len())
        .map(|object| {
            let placed = *snapshot.placed(object);
            let in_camera = camera_from_world * Point3::from(placed.position_m);
            Truth {
                placed,
                position_in_camera_m: in_camera.into(),
                pixel: camera.camera.project(in_camera.into()),
                visible_fraction: visible_fraction(&snapshot, (camera, &world_from_camera), object),
            }
        })
        .collect()
}

/// Number of rays that sample visibility: steps of a quarter of a percent.
const RAYS: usize = 400;

fn visible_fraction(
    snapshot: &Snapshot,
    (camera, world_from_camera): (&WorldCamera, &Pose),
    object: usize,
) -> f64 {
    let camera_from_world = world_from_camera.inverse();
    let viewpoint = world_from_camera * Point3::from(camera.camera.viewpoint_m());
    let (middle, radius_m) = snapshot.bounds(object);
    let (mut seen, mut alone) = (0, 0);
    for i in 0..RAYS {
        let aim = direction_towards(&(middle - viewpoint.coords), radius_m, i);
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
        seen += i32::from(is_first && pixel.is_some_and(|pixel| camera.contains(pixel)));
    }
    if alone == 0 {
        return 0.0;
    }
    f64::from(seen) / f64::from(alone)
}

impl WorldCamera {
    /// Reports whether a pixel covers a position in the image plane.
    fn contains(&self, pixel: [f64; 2]) -> bool {
        let inside = |at: f64, count: usize| -0.5 <= at && at < count as f64 - 0.5;
        inside(pixel[0], self.size_px.0) && inside(pixel[1], self.size_px.1)
    }
}

/// Returns one of [`RAYS`] directions spread evenly (Vogel's spiral) over the disc of a sphere's image; from
/// inside the sphere, over all directions.
fn direction_towards(middle: &Vector3<f64>, radius_m: f64, number: usize) -> Vector3<f64> {
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
