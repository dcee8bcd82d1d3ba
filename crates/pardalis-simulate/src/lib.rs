//! Simulated worlds with exact ground truth, rendered through any camera model.
//!
//! A [`World`] is a pure function of time. [`World::placed`] returns the objects, [`Renderer`] the images of
//! a camera, [`Timing::deliveries`] their time stamps and arrival, and [`truth`] the ground truth as a camera
//! sees it. Images are ray-cast with the camera's own
//! [`Camera::unproject`](pardalis_camera::Camera::unproject). Every random number is a function of the seed
//! and its purpose, so that results do not depend on the order of calls or the number of threads.
//!
//! # Example
//!
//! A red ball that circles in front of a camera:
//!
//! ```
//! use nalgebra::Vector3;
//! use pardalis_camera::{Camera, Pinhole, Pose};
//! use pardalis_simulate::{
//! Body, Course, ImageSettings, Light, Object, Path, Pattern, Renderer, Room, Texture, Timing, World,
//! WorldCamera,
//!     truth,
//! };
//!
//! let world = World {
//!     seed: 1,
//!     duration_s: 2.0,
//!     ground: None,
//!     room: Room {
//!         radius_m: 10.0,
//!         texture: Texture { pattern: Pattern::Plain, colors: [[0.2; 3]; 2] },
//!     },
//!     light: Light { direction: Vector3::z(), ambient: 0.4 },
//!     objects: vec![Object {
//!         name: "ball".to_owned(),
//!         body: Body::Sphere { radius_m: 0.1 },
//!         texture: Texture { pattern: Pattern::Plain, colors: [[0.8, 0.1, 0.1]; 2] },
//!         marks: vec![],
//!         highlight: 0.0,
//!         course: Course::Path(Path::Circle {
//!             center_m: Vector3::new(0.0, 0.0, 2.0),
//!             radius_m: 0.3,
//!             period_s: 4.0,
//!             phase_rad: 0.0,
//!         }),
//!         heading_rad: None,
//!         tilt_rad: 0.0,
//!         spin_rad_per_s: 0.0,
//!         is_target: true,
//!         crowd: None,
//!     }],
//!     platforms: vec![],
//!     cameras: vec![WorldCamera {
//!         name: "front".to_owned(),
//!         camera: Camera::Pinhole(Pinhole::new([100.0; 2], [79.5, 59.5], &[])?),
//!         size_px: (160, 120),
//!         world_from_camera: Pose::identity(),
//!         platform: None,
//!         image: ImageSettings::default(),
//!         timing: Timing::default(),
//!     }],
//! };
//!
//! let rgb = Renderer::new(&world, 0).image(0, 0.0);
//! assert_eq!(rgb.len(), 3 * 160 * 120);
//! let ball = truth(&world, &world.cameras[0], 0.0)[0];
//! assert_eq!(ball.position_in_camera_m, [0.3, 0.0, 2.0]);
//! assert_eq!(ball.visible_fraction, 1.0);
//! // The image shows the ball where the ground truth says: red exceeds green.
//! let [u, v] = ball.pixel.expect("in view").map(|c| c.round() as usize);
//! let at = 3 * (160 * v + u);
//! assert!(rgb[at] > 2 * rgb[at + 1]);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! # Units and frames
//!
//! Lengths are in metres, times in seconds, angles in radians. The z axis of the world points up. Camera
//! frames have x to the right, y down and z forwards; `world_from_camera` maps camera coordinates to world
//! coordinates. Pixel centres have integer coordinates. Colours are linear red, green and blue from 0 to 1;
//! rendered images are sRGB with three bytes per pixel, row by row.

mod body;
mod detector;
mod mark;
mod path;
mod platform;
mod render;
mod sensor;
mod texture;
mod timing;
mod trace;
mod truth;

pub use body::Body;
pub use detector::{DetectedBox, Detector};
pub use mark::Mark;
pub use path::{Path, Sine, Throw, Waypoints};
pub use platform::{OdometryRow, OdometrySettings, Platform};
pub use render::Renderer;
pub use sensor::ImageSettings;
pub use texture::{Pattern, Texture};
pub use timing::{Delivery, Timing};
pub use truth::{Truth, truth};

pub use pardalis_core::srgb::linear_from_srgb;

use nalgebra::Vector3;

use pardalis_camera::Camera;
use pardalis_camera::Pose;

/// A world: objects, light and cameras.
#[derive(Debug, Clone, PartialEq)]
pub struct World {
    /// Seed of every random number.
    pub seed: u32,
    /// Cameras take frames from time 0 to this time, in seconds.
    pub duration_s: f64,
    /// Floor, if any.
    pub ground: Option<Ground>,
    /// Background.
    pub room: Room,
    /// Illumination.
    pub light: Light,
    /// Objects, in the order of their names in the world file.
    pub objects: Vec<Object>,
    /// Moving platforms that carry cameras.
    pub platforms: Vec<Platform>,
    /// Cameras.
    pub cameras: Vec<WorldCamera>,
}

/// A horizontal plane that is visible from above.
#[derive(Debug, Clone, PartialEq)]
pub struct Ground {
    /// Height in metres.
    pub z_m: f64,
    /// Colours.
    pub texture: Texture,
    /// Rectangle of tape on the ground, if any.
    pub tape: Option<Tape>,
}

/// A rectangular strip of tape on the ground, with sides parallel to the world's axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tape {
    /// Centre of the rectangle: x and y in metres.
    pub center_m: [f64; 2],
    /// Outer side lengths along x and y in metres.
    pub size_m: [f64; 2],
    /// Width of the tape in metres.
    pub width_m: f64,
    /// Linear red, green and blue, 0 to 1.
    pub color: [f64; 3],
}

/// The inside of a sphere around the world's origin that shows the background.
#[derive(Debug, Clone, PartialEq)]
pub struct Room {
    /// Radius in metres.
    pub radius_m: f64,
    /// Colours.
    pub texture: Texture,
}

/// A distant lamp plus ambient light. Together they have intensity 1 on surfaces that face the lamp.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Light {
    /// Direction towards the lamp: world frame, unit length.
    pub direction: Vector3<f64>,
    /// Share of ambient light, 0 to 1.
    pub ambient: f64,
}

/// An object in the world.
#[derive(Debug, Clone, PartialEq)]
pub struct Object {
    /// Name.
    pub name: String,
    /// Shape and size.
    pub body: Body,
    /// Colours, fixed to the body.
    pub texture: Texture,
    /// What is painted over the texture; later marks cover earlier ones.
    pub marks: Vec<Mark>,
    /// Strength of the highlight, from 0 (none) to 1 (white).
    pub highlight: f64,
    /// Motion.
    pub course: Course,
    /// Constant heading in radians; if `None`, the object faces its direction of motion.
    pub heading_rad: Option<f64>,
    /// Forward tilt at time 0 about the object's y axis through its position, in radians.
    pub tilt_rad: f64,
    /// Rate of the tilt in rad/s, as of a ball that rolls.
    pub spin_rad_per_s: f64,
    /// Whether the object is a target: the scene tracks it, and its colours are learnt.
    pub is_target: bool,
    /// The crowd of objects that look alike of which a target is a member: the scene tracks that.
    pub crowd: Option<String>,
}

impl Object {
    /// Returns the name of the target of the scene that this object is, or one of.
    pub fn target_name(&self) -> &str {
        self.crowd.as_deref().unwrap_or(&self.name)
    }
}

/// Motion of an object.
#[derive(Debug, Clone, PartialEq)]
pub enum Course {
    /// Along its own path.
    Path(Path),
    /// On another object, at an offset in metres in the carrier's frame: x ahead, y to the left, z up.
    Attached {
        /// Index of the carrier in [`World::objects`]; it must have its own path.
        carrier: usize,
        /// Offset from the carrier's position, in metres.
        offset_m: Vector3<f64>,
    },
}

/// A camera in the world.
#[derive(Debug, Clone, PartialEq)]
pub struct WorldCamera {
    /// Name.
    pub name: String,
    /// Camera model.
    pub camera: Camera,
    /// Width and height of the images in pixels.
    pub size_px: (usize, usize),
    /// Pose: maps camera coordinates to world coordinates, or to those of the platform.
    pub world_from_camera: Pose,
    /// Index in [`World::platforms`] of the platform that carries the camera.
    pub platform: Option<usize>,
    /// Image properties.
    pub image: ImageSettings,
    /// Exposure times, time stamps and delivery.
    pub timing: Timing,
}

/// State of an object at one time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Placed {
    /// Centre of a ball, or centre of the base of any other body: world frame, metres.
    pub position_m: Vector3<f64>,
    /// Velocity in the world frame, m/s.
    pub velocity_mps: Vector3<f64>,
    /// Heading about the world's vertical, in radians; 0 along x.
    pub heading_rad: f64,
    /// Forward tilt, in radians; objects attached to this one do not follow it.
    pub tilt_rad: f64,
}

impl Default for Room {
    /// Returns a sphere with a radius of 20 m and a pattern of grey clouds.
    fn default() -> Self {
        Self {
            radius_m: 20.0,
            texture: Texture {
                pattern: Pattern::Noise {
                    size_m: 5.0,
                    octaves: Pattern::DEFAULT_OCTAVES,
                },
                colors: [[0.1, 0.1, 0.11], [0.35, 0.35, 0.34]],
            },
        }
    }
}

impl Default for Light {
    /// Returns a lamp nearly overhead with 50 % ambient light.
    fn default() -> Self {
        Self {
            direction: Vector3::new(0.3, 0.2, 1.0).normalize(),
            ambient: 0.5,
        }
    }
}

impl World {
    /// Seed of worlds that state none.
    pub const DEFAULT_SEED: u32 = 1;

    /// Returns where a camera is at a time in seconds.
    pub fn world_from_camera(&self, camera: &WorldCamera, time_s: f64) -> Pose {
        match camera.platform {
            Some(platform) => self.platforms[platform].pose(time_s) * camera.world_from_camera,
            None => camera.world_from_camera,
        }
    }

    /// Returns the state of every object at a time in seconds, in the order of the objects.
    pub fn placed(&self, time_s: f64) -> Vec<Placed> {
        let of_object = |object: &Object| match &object.course {
            Course::Path(path) => on_path(object, path, time_s),
            Course::Attached { carrier, offset_m } => {
                let carrier = &self.objects[*carrier];
                let Course::Path(path) = &carrier.course else {
                    unreachable!("carriers have their own paths")
                };
                let at = |time_s: f64| {
                    let carrier = on_path(carrier, path, time_s);
                    let position_m =
                        carrier.position_m + turned(offset_m, libm::sincos(carrier.heading_rad));
                    (position_m, carrier.heading_rad)
                };
                let (position_m, heading_rad) = at(time_s);
                Placed {
                    position_m,
                    // Rotation moves it as well; finite differences are accurate to a micrometre per second.
                    velocity_mps: (at(time_s + STEP_S).0 - at(time_s - STEP_S).0) / (2.0 * STEP_S),
                    heading_rad: object.heading_rad.unwrap_or(heading_rad),
                    tilt_rad: object.tilt_at(time_s),
                }
            }
        };
        self.objects.iter().map(of_object).collect()
    }

    /// Reports whether an object ever moves.
    pub(crate) fn moves(&self, object: usize) -> bool {
        let path_of = match &self.objects[object].course {
            Course::Path(path) => path,
            Course::Attached { carrier, .. } => match &self.objects[*carrier].course {
                Course::Path(path) => path,
                Course::Attached { .. } => unreachable!("carriers have their own paths"),
            },
        };
        !matches!(path_of, Path::Still { .. }) || self.objects[object].spin_rad_per_s != 0.0
    }
}

impl Object {
    fn tilt_at(&self, time_s: f64) -> f64 {
        self.tilt_rad + self.spin_rad_per_s * time_s
    }
}

/// Half of the step for the velocity of an attached object by finite differences, in seconds.
const STEP_S: f64 = 1e-4;

fn on_path(object: &Object, path: &Path, time_s: f64) -> Placed {
    let (position_m, velocity_mps) = path.at(time_s);
    Placed {
        position_m,
        velocity_mps,
        heading_rad: object
            .heading_rad
            .unwrap_or_else(|| path.course_rad(time_s)),
        tilt_rad: object.tilt_at(time_s),
    }
}

/// Rotates a vector about the vertical by the angle with this sine and cosine.
fn turned(v: &Vector3<f64>, (sin, cos): (f64, f64)) -> Vector3<f64> {
    Vector3::new(cos * v.x - sin * v.y, sin * v.x + cos * v.y, v.z)
}
