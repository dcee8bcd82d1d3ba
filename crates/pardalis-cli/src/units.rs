//! Whether the sizes of the targets and the positions of the cameras can be in metres.

use std::path::Path;

use pardalis::shape::Shape;
use pardalis::tuning::Tuning;
use pardalis_scene::{CameraConfig, Scene, TargetConfig};

use crate::numbers::significant;
use crate::output::Shown;

/// From this radius on, metres, a ball is more likely one whose radius is in centimetres. Hand-set: below that of a table-tennis ball in centimetres.
const LARGE_RADIUS_M: f64 = 1.5;

/// Returns a warning for each target whose size, or whose distance from two cameras, is unlikely in metres.
pub(crate) fn warnings(scene: &Scene, path: &Path) -> Vec<String> {
    let apart = nearest(&scene.cameras);
    let mut warnings = Vec::new();
    for target in &scene.targets {
        for body in &target.bodies {
            let place = format!("{}: targets.{}", path.shown(), target.name);
            if let Shape::Sphere(sphere) = body.shape
                && sphere.radius_m >= LARGE_RADIUS_M
            {
                let radius_m = significant(sphere.radius_m);
                warnings.push(format!(
                    "{place}: the radius of the ball is {radius_m} m: is it in metres?"
                ));
            }
            let reach_m = Tuning::default().detection.farthest_diameters * body.shape.diameter_m();
            // Without a start it is looked for up to there.
            if is_searched(target)
                && let Some(Apart {
                    cameras,
                    distance_m,
                }) = &apart
                && *distance_m > 2.0 * reach_m
            {
                let [distance_m, reach_m] = [*distance_m, reach_m].map(significant);
                warnings.push(format!(
                    "{place}: no two cameras can show it at the same time: the nearest, {}, are {distance_m} m from each other, and it is looked for up to {reach_m} m \
                     from a camera: are their positions and its size in metres?",
                    cameras.join(" and ")
                ));
            }
        }
    }
    warnings
}

/// Reports whether a target is detected, and not followed from a start.
pub(crate) fn is_searched(target: &TargetConfig) -> bool {
    target.bodies.iter().all(|body| body.cues().is_empty())
}

/// Two cameras and how far they are from each other.
struct Apart<'a> {
    cameras: [&'a str; 2],
    distance_m: f64,
}

/// Returns the two cameras, both at rest or on the same platform, that are nearest to each other.
fn nearest(cameras: &[CameraConfig]) -> Option<Apart<'_>> {
    let pairs = cameras.iter().enumerate().flat_map(|(number, one)| {
        let others = cameras[..number].iter();
        others.filter_map(move |other| {
            let [from, to] = [other, one].map(|camera| camera.world_from_camera.translation.vector);
            (one.platform == other.platform).then(|| Apart {
                cameras: [&other.name, &one.name],
                distance_m: (to - from).norm(),
            })
        })
    });
    pairs.min_by(|a, b| a.distance_m.total_cmp(&b.distance_m))
}
