//! A detector that gives boxes around the targets, with misses, errors and false boxes.

use super::{Body, Object, Placed, World, truth};
use pardalis::shape::{Section, Shape, Sphere, SphereOutline, Stance, Upright, UprightOutline};
use pardalis_core::rng::{Draws, Stage};

/// A detector of targets in the images of all cameras.
#[derive(Debug, Clone, Copy, PartialEq)]
#[allow(clippy::exhaustive_structs)] // a description
pub struct Detector {
    /// The probability that it finds a target that nothing hides.
    pub detection_probability: f64,
    /// The mean number of boxes in an image that are no target.
    pub false_per_image: f64,
    /// The standard deviation of each side, as a share of the square root of the box's area.
    pub side_sigma: f64,
    /// By which share all boxes are too large.
    pub size_bias: f64,
}

impl Default for Detector {
    /// One as boxed targets expect it.
    fn default() -> Self {
        Self {
            detection_probability: 0.9,
            false_per_image: 0.5,
            side_sigma: 0.05,
            size_bias: 0.0,
        }
    }
}

/// A box in an image.
#[derive(Debug, Clone, Copy, PartialEq)]
#[allow(clippy::exhaustive_structs)] // a description
pub struct DetectedBox {
    /// The number of the object; `None` for clutter.
    pub object: Option<usize>,
    /// Left, top, right and bottom side, pixels, within the image.
    pub sides_px: [f64; 4],
    /// The probability that it is right, in the detector's opinion. It is right about that if there are as many targets as false boxes.
    pub score: f64,
}

/// A target of which less than this share is visible is not found.
const LEAST_VISIBLE: f64 = 0.35;
/// A target whose box is smaller than this is not found, pixels.
const LEAST_PX: f64 = 4.0;
/// Points on outlines.
const OUTLINE_POINTS: usize = 1000;
/// The sizes of clutter, pixels at least and as a share of the image's width at most.
const CLUTTER_PX: f64 = 8.0;
const CLUTTER_SHARE: f64 = 0.3;
/// The most false boxes in an image.
const MOST_CLUTTER: u32 = 1000;

impl Detector {
    /// Returns what it finds in the image of a camera (of this number) of an exposure, at a time in seconds.
    pub fn detect(
        &self,
        world: &World,
        camera: usize,
        (exposure, time_s): (u32, f64),
    ) -> Vec<DetectedBox> {
        let draws = Draws::new(world.seed, camera as u32);
        let of_camera = &world.cameras[camera];
        let (width, height) = of_camera.size_px;
        let last = [width, height].map(|side| side as f64 - 0.5);
        let within = |[u0, v0, u1, v1]: [f64; 4]| {
            let [right, bottom] = last;
            let inside = [
                u0.clamp(-0.5, right),
                v0.clamp(-0.5, bottom),
                u1.clamp(-0.5, right),
                v1.clamp(-0.5, bottom),
            ];
            (inside[2] - inside[0] >= LEAST_PX && inside[3] - inside[1] >= LEAST_PX)
                .then_some(inside)
        };
        let mut found = Vec::new();
        for (number, seen) in truth(world, of_camera, time_s).into_iter().enumerate() {
            let object = &world.objects[number];
            let [hit, score, other, _] = draws.uniforms(number as u32, exposure, Stage::Box);
            let is_found =
                hit < self.detection_probability && seen.visible_fraction >= LEAST_VISIBLE;
            if !(object.is_target && is_found) {
                continue;
            }
            let Some([u0, v0, u1, v1]) = exact_box(world, camera, time_s, object, &seen.placed)
            else {
                continue;
            };
            let size_px = ((u1 - u0) * (v1 - v0)).sqrt();
            let normals = draws
                .normals(number as u32, exposure, Stage::Box, 1)
                .map(f64::from);
            let grown = [u1 - u0, v1 - v0].map(|side| 0.5 * self.size_bias * side);
            let sides_px = [
                u0 - grown[0] + self.side_sigma * size_px * normals[0],
                v0 - grown[1] + self.side_sigma * size_px * normals[1],
                u1 + grown[0] + self.side_sigma * size_px * normals[2],
                v1 + grown[1] + self.side_sigma * size_px * normals[3],
            ];
            found.extend(within(sides_px).map(|sides_px| DetectedBox {
                object: Some(number),
                sides_px,
                score: score.max(other),
            }));
        }
        for number in 0..self.clutter_count(draws, exposure) {
            let [u, v, size, form] = draws.uniforms(number, exposure, Stage::Clutter);
            let [score, other, ..] =
                draws.uniforms(number + MOST_CLUTTER, exposure, Stage::Clutter);
            let most = (CLUTTER_SHARE * width as f64).max(CLUTTER_PX);
            let size_px = CLUTTER_PX * libm::pow(most / CLUTTER_PX, size);
            // From half as wide as high to twice.
            let form = libm::exp2(0.5 * (2.0 * form - 1.0));
            let [u, v] = [u * width as f64, v * height as f64];
            let half = [0.5 * size_px * form, 0.5 * size_px / form];
            let sides_px = [u - half[0], v - half[1], u + half[0], v + half[1]];
            found.extend(within(sides_px).map(|sides_px| DetectedBox {
                object: None,
                sides_px,
                score: score.min(other),
            }));
        }
        found
    }

    /// Draws how many false boxes there are: from a Poisson distribution, by the times between arrivals.
    fn clutter_count(&self, draws: Draws, exposure: u32) -> u32 {
        let mut left = self.false_per_image;
        for count in 0..MOST_CLUTTER {
            let share = draws.uniform(2 * MOST_CLUTTER + count, exposure, Stage::Clutter);
            left += libm::log(1.0 - share);
            if left < 0.0 {
                return count;
            }
        }
        MOST_CLUTTER
    }
}

/// Returns the box around an object as a camera sees it; `None` if a part of it has no pixel.
fn exact_box(
    world: &World,
    camera: usize,
    time_s: f64,
    object: &Object,
    placed: &Placed,
) -> Option<[f64; 4]> {
    let shape = match object.body {
        Body::Sphere { radius_m } => {
            Shape::Sphere(Sphere::new(radius_m, SphereOutline::Tangent).ok()?)
        }
        Body::Cylinder { radius_m, height_m } => {
            let section = Section::circle(radius_m).ok()?;
            Shape::Upright(Upright::new(section, height_m, UprightOutline::Exact).ok()?)
        }
        Body::Box { size_m } => {
            let section = Section::rectangle([size_m.x, size_m.y]).ok()?;
            Shape::Upright(Upright::new(section, size_m.z, UprightOutline::Exact).ok()?)
        }
        _ => return None,
    };
    let stance = Stance {
        yaw_rad: placed.heading_rad,
        ..Stance::default()
    };
    let of_camera = &world.cameras[camera];
    let camera_from_world = world.world_from_camera(of_camera, time_s).inverse();
    let position_m = placed.position_m.into();
    let outline = shape.outline_px(
        &of_camera.camera,
        &camera_from_world,
        position_m,
        stance,
        OUTLINE_POINTS,
    );
    let mut sides = [
        f64::INFINITY,
        f64::INFINITY,
        f64::NEG_INFINITY,
        f64::NEG_INFINITY,
    ];
    for pixel in outline {
        let [u, v] = pixel?;
        sides = [
            sides[0].min(u),
            sides[1].min(v),
            sides[2].max(u),
            sides[3].max(v),
        ];
    }
    Some(sides)
}

#[cfg(test)]
mod tests {
    use nalgebra::Vector3;

    use super::*;
    use crate::{Course, ImageSettings, Light, Path, Pattern, Room, Texture, Timing, WorldCamera};
    use pardalis_camera::{Camera, Pinhole, Pose};

    fn ball(x_m: f64, is_target: bool) -> Object {
        Object {
            name: "ball".to_owned(),
            body: Body::Sphere { radius_m: 0.2 },
            texture: plain(),
            marks: vec![],
            highlight: 0.0,
            course: Course::Path(Path::Still {
                position_m: Vector3::new(x_m, 0.0, 2.0),
            }),
            heading_rad: None,
            tilt_rad: 0.0,
            spin_rad_per_s: 0.0,
            is_target,
            crowd: None,
        }
    }

    fn plain() -> Texture {
        Texture {
            pattern: Pattern::Plain,
            colors: [[0.5; 3]; 2],
        }
    }

    /// A target and another ball before a camera.
    fn world() -> World {
        World {
            seed: 3,
            duration_s: 1.0,
            ground: None,
            room: Room {
                radius_m: 10.0,
                texture: plain(),
            },
            light: Light {
                direction: Vector3::z(),
                ambient: 0.4,
            },
            objects: vec![ball(0.0, true), ball(0.8, false)],
            platforms: vec![],
            cameras: vec![WorldCamera {
                name: "front".to_owned(),
                camera: Camera::Pinhole(Pinhole::new([400.0; 2], [319.5, 239.5], &[]).unwrap()),
                size_px: (640, 480),
                world_from_camera: Pose::identity(),
                platform: None,
                image: ImageSettings::default(),
                timing: Timing::default(),
            }],
        }
    }

    #[test]
    fn misses_clutter_and_errors_are_as_often_and_as_large_as_stated() {
        let detector = Detector {
            size_bias: 0.1,
            ..Detector::default()
        };
        let world = world();
        let count = 1000_u32;
        let all: Vec<DetectedBox> = (0..count)
            .flat_map(|exposure| detector.detect(&world, 0, (exposure, 0.0)))
            .collect();
        let (own, clutter): (Vec<DetectedBox>, _) =
            all.iter().partition(|one| one.object.is_some());
        assert!(
            own.iter().all(|one| one.object == Some(0)),
            "the other is no target"
        );
        let share = own.len() as f64 / f64::from(count);
        assert!((share - 0.9).abs() < 0.03, "{share}");
        let false_boxes = clutter.len() as f64 / f64::from(count);
        assert!((false_boxes - 0.5).abs() < 0.07, "{false_boxes}");
        // The outline of a ball of 0.2 m, 2 m away.
        let radius_px = 400.0 * 0.2 / (4.0_f64 - 0.04).sqrt();
        let left_px = own.iter().map(|one| one.sides_px[0]);
        let mean_px = left_px.clone().sum::<f64>() / own.len() as f64;
        assert!(
            (mean_px - (319.5 - 1.1 * radius_px)).abs() < 0.4,
            "{mean_px}"
        );
        let squares = left_px
            .map(|left_px| (left_px - mean_px).powi(2))
            .sum::<f64>();
        let sigma_px = (squares / own.len() as f64).sqrt();
        let ratio = sigma_px / (0.05 * 2.0 * radius_px);
        assert!((0.93..1.07).contains(&ratio), "{ratio}");
        let mean_score = |boxes: &[DetectedBox]| {
            boxes.iter().map(|one| one.score).sum::<f64>() / boxes.len() as f64
        };
        assert!(mean_score(&own) > 0.6 && mean_score(&clutter) < 0.4);
    }
}
