//! The scene of a page: cameras with what they see, and targets in their shape.

use nalgebra::{Point3, Vector3};
use pardalis::shape::{FlatForm, Section, Shape};
use pardalis_camera::{Camera, Plane, Pose};
use pardalis_scene::{Scene, TargetConfig};
use serde::Serialize;
use serde_json::{Value, json};

use super::frames::PageFrame;

/// Directions along each side of an image.
const PER_SIDE: usize = 16;

/// Steps from the middle of an image to its border, in search of the last pixel that has a ray.
const STEPS: usize = 64;

/// The border of an image on the plane is drawn to this many sizes of its nearer half; the rest is towards the horizon.
const MAX_FOOTPRINT: f64 = 3.0;

/// The scene of a page.
#[derive(Debug, Serialize)]
pub(crate) struct PageScene {
    pub(crate) title: String,
    units: &'static str,
    cameras: Vec<Value>,
    targets: Vec<Value>,
    /// What is a guess, in words.
    guesses: Vec<String>,
    /// The images, added last.
    pub(super) frames: Vec<PageFrame>,
}

/// What the file of a scene does not say about a camera.
#[derive(Debug, Clone, Default)]
pub(crate) struct PageCamera {
    /// The size of its images in pixels.
    pub(crate) size_px: Option<(usize, usize)>,
    /// Where it was in the world, by times in seconds, if it moves.
    pub(crate) path: Vec<(f64, Pose)>,
}

impl PageScene {
    /// Returns the scene with the cameras of `scene`, about each of which `cameras` says more, in the same order.
    pub(crate) fn new(title: String, scene: &Scene, cameras: &[PageCamera]) -> Self {
        let is_image = |camera: &Camera| *camera == Camera::Plane(Plane::image());
        let is_in_pixels = scene.cameras.iter().any(|camera| is_image(&camera.camera));
        let entries = scene.cameras.iter().zip(cameras).map(|(camera, more)| {
            let pose = camera
                .platform
                .is_none()
                .then_some(camera.world_from_camera);
            let pose = pose.or_else(|| more.path.first().map(|(_, pose)| *pose));
            camera_entry(&camera.name, &camera.camera, pose, more)
        });
        Self {
            title,
            units: if is_in_pixels { "px" } else { "m" },
            cameras: entries.collect(),
            targets: scene.targets.iter().map(target_entry).collect(),
            guesses: guesses(&scene.guesses),
            frames: Vec::new(),
        }
    }

    /// Returns a scene without cameras, of balls with these names and diameters in metres.
    pub(crate) fn of_balls(title: String, diameters_m: &[(String, f64)]) -> Self {
        let target = |(name, diameter_m): &(String, f64)| json!({ "name": name, "shape": { "kind": "sphere", "radius_m": 0.5 * diameter_m } });
        Self {
            title,
            units: "m",
            cameras: Vec::new(),
            targets: diameters_m.iter().map(target).collect(),
            guesses: Vec::new(),
            frames: Vec::new(),
        }
    }
}

impl PageScene {
    /// Returns the name of the first camera.
    pub(super) fn first_camera(&self) -> &str {
        let first = self.cameras.first();
        first
            .and_then(|camera| camera["name"].as_str())
            .unwrap_or("camera")
    }
}

/// Names guesses by their keys.
fn guesses(keys: &[String]) -> Vec<String> {
    let mut named: Vec<String> = Vec::new();
    for key in keys {
        let mut parts = key.split('.');
        let (table, name, setting) = (parts.next(), parts.next(), parts.next());
        let text = match (table, name, setting) {
            (Some("cameras"), Some(name), Some("world_from_camera")) => {
                format!("the pose of {name}")
            }
            (Some("cameras"), Some(name), Some("model")) => format!("the lens of {name}"),
            (Some("targets"), Some(name), Some("shape")) => format!("the size of {name}"),
            _ => key.clone(),
        };
        if !named.contains(&text) {
            named.push(text);
        }
    }
    named
}

fn camera_entry(name: &str, camera: &Camera, pose: Option<Pose>, more: &PageCamera) -> Value {
    let mut entry = json!({ "name": name, "image_size": more.size_px });
    if let Camera::Plane(plane) = camera {
        let center_m = plane.center_m();
        let footprint_m = more.size_px.map(|size_px| footprint_m(camera, size_px));
        let footprint_m = footprint_m.unwrap_or_default();
        entry["position_m"] = json!(center_m);
        // Its frame is that of the world.
        entry["world_from_camera"] = json!([[1, 0, 0], [0, 1, 0], [0, 0, 1]]);
        if let Some(center_m) = center_m {
            let rays = footprint_m.iter().map(|place| {
                let away = Point3::from(*place) - Point3::from(center_m);
                <[f64; 3]>::from(away.normalize())
            });
            entry["border_rays"] = rays.collect();
        }
        entry["footprint_m"] = json!(footprint_m);
        return entry;
    }
    if let Some(pose) = pose {
        entry["position_m"] = json!(<[f64; 3]>::from(pose.translation.vector));
        let rows = pose.rotation.matrix().row_iter();
        entry["world_from_camera"] = rows.map(|row| json!([row[0], row[1], row[2]])).collect();
    }
    if let Some(size_px) = more.size_px {
        entry["border_rays"] = json!(border_rays(camera, size_px));
    }
    if !more.path.is_empty() {
        let poses = more.path.iter().map(|(time_s, pose)| {
            let [x, y, z] = pose.translation.vector.into();
            let turn = nalgebra::UnitQuaternion::from_rotation_matrix(&pose.rotation);
            json!([time_s, x, y, z, turn.w, turn.i, turn.j, turn.k])
        });
        entry["path"] = poses.collect();
    }
    entry
}

/// Returns the pixels along the border of an image, clockwise from its first.
fn border_px((width, height): (usize, usize)) -> impl Iterator<Item = [f64; 2]> {
    let [right, bottom] = [width as f64 - 1.0, height as f64 - 1.0];
    let corners = [[0.0, 0.0], [right, 0.0], [right, bottom], [0.0, bottom]];
    (0..4 * PER_SIDE).map(move |number| {
        let (from, to) = (
            corners[number / PER_SIDE],
            corners[(number / PER_SIDE + 1) % 4],
        );
        let share = (number % PER_SIDE) as f64 / PER_SIDE as f64;
        [0, 1].map(|axis| from[axis] + share * (to[axis] - from[axis]))
    })
}

/// Returns the unit directions of the camera frame around an image, or around the part of it that has rays.
fn border_rays(camera: &Camera, size_px: (usize, usize)) -> Vec<[f64; 3]> {
    let middle = [
        0.5 * (size_px.0 as f64 - 1.0),
        0.5 * (size_px.1 as f64 - 1.0),
    ];
    let rays = border_px(size_px).filter_map(|border| {
        let direction = |share: f64| {
            let pixel = [0, 1].map(|axis| middle[axis] + share * (border[axis] - middle[axis]));
            camera.unproject(pixel).map(|ray| ray.direction)
        };
        if let Some(outermost) = direction(1.0) {
            return Some(outermost);
        }
        let mut shares = (0..STEPS).map(|step| 1.0 - step as f64 / STEPS as f64);
        let mut inside = shares.find(|&share| direction(share).is_some())?;
        let mut outside = inside + 1.0 / STEPS as f64;
        for _ in 0..STEPS {
            let between = 0.5 * (inside + outside);
            *(if direction(between).is_some() {
                &mut inside
            } else {
                &mut outside
            }) = between;
        }
        direction(inside)
    });
    rays.collect()
}

/// Returns the border of an image on the plane, in metres in the world, without what is near or above the horizon.
fn footprint_m(camera: &Camera, size_px: (usize, usize)) -> Vec<[f64; 3]> {
    let places = border_px(size_px).filter_map(|pixel| {
        let ray = camera.unproject(pixel)?;
        let [from, along] = [ray.origin, ray.direction].map(Vector3::from);
        (along.z < 0.0).then(|| from - along * (from.z / along.z))
    });
    let places: Vec<Vector3<f64>> = places.collect();
    let Some(nearest) = nearest_half(&places) else {
        return Vec::new();
    };
    let (middle, size_m) = nearest;
    let is_near = |place: &&Vector3<f64>| (*place - middle).norm() <= MAX_FOOTPRINT * size_m;
    let near = places.iter().filter(is_near);
    near.map(|place| [place.x, place.y, 0.0]).collect()
}

/// Returns the middle of the half of some places that is nearest to their median, and its radius.
fn nearest_half(places: &[Vector3<f64>]) -> Option<(Vector3<f64>, f64)> {
    let median = |axis: usize| {
        let mut values: Vec<f64> = places.iter().map(|place| place[axis]).collect();
        values.sort_by(f64::total_cmp);
        values.get(values.len() / 2).copied()
    };
    let middle = Vector3::new(median(0)?, median(1)?, 0.0);
    let mut distances_m: Vec<f64> = places.iter().map(|place| (place - middle).norm()).collect();
    distances_m.sort_by(f64::total_cmp);
    Some((middle, distances_m[distances_m.len() / 2]))
}

/// Returns a target with its shape; of several landmarks, that of the first.
fn target_entry(target: &TargetConfig) -> Value {
    json!({ "name": target.name, "shape": shape_entry(&target.bodies[0].shape) })
}

fn shape_entry(shape: &Shape) -> Value {
    match shape {
        Shape::Sphere(sphere) => json!({ "kind": "sphere", "radius_m": sphere.radius_m }),
        Shape::Upright(upright) => {
            let height_m = upright.height_m;
            match upright.section {
                Section::Circle { radius_m } => {
                    json!({ "kind": "cylinder", "radius_m": radius_m, "height_m": height_m })
                }
                Section::Polygon {
                    sides,
                    apothem_m,
                    turn,
                } => json!({
                    "kind": "prism",
                    "sides": sides,
                    "across_flats_m": 2.0 * apothem_m,
                    "rotation_rad": std::f64::consts::TAU * turn,
                    "height_m": height_m,
                }),
                Section::Rectangle { size_m: [x, y] } => {
                    json!({ "kind": "box", "size_m": [x, y, height_m] })
                }
            }
        }
        Shape::Flat(flat) => {
            let height_m = flat.height_m;
            match flat.form {
                FlatForm::Disc { radius_m } => {
                    json!({ "kind": "disc", "radius_m": radius_m, "height_m": height_m })
                }
                FlatForm::Rectangle { size_m } => {
                    json!({ "kind": "rectangle", "size_m": size_m, "height_m": height_m })
                }
            }
        }
    }
}
