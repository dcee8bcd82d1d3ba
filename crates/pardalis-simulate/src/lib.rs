//! Worlds with exact truth, seen by any camera: what the experiments run on where nothing was filmed.
//!
//! A [`World`] is a pure function of time: where everything is ([`World::placed`]), what each camera sees ([`Renderer`]), when it says
//! that it saw it ([`Timing::deliveries`]) and what is true then ([`truth`]). Images are made by casting rays with the camera's own
//! [`Camera::unproject`](pardalis_camera::Camera::unproject). All that is random is a function of the seed and of what it is for.

mod body;
mod path;
mod render;
mod sensor;
mod texture;
mod timing;
mod trace;
mod truth;

pub use body::Body;
pub use path::{Path, Sine, Throw, Waypoints};
pub use render::Renderer;
pub use sensor::{ImageSettings, linear_from_srgb};
pub use texture::{Pattern, Texture};
pub use timing::{Delivery, Timing};
pub use truth::{Truth, truth};

use nalgebra::Vector3;

use pardalis_camera::Camera;
use pardalis_camera::Pose;

/// All there is: things, light, and the cameras that look.
#[derive(Debug, Clone, PartialEq)]
pub struct World {
    /// Seed of every random number.
    pub seed: u32,
    /// Cameras take frames from 0 up to this time, in seconds.
    pub duration_s: f64,
    /// The floor, if there is one.
    pub ground: Option<Ground>,
    /// What is beyond.
    pub room: Room,
    /// Where light comes from.
    pub light: Light,
    /// The things, in the order of their names in the world file.
    pub objects: Vec<Object>,
    /// The cameras.
    pub cameras: Vec<WorldCamera>,
}

/// A horizontal plane, seen from above.
#[derive(Debug, Clone, PartialEq)]
pub struct Ground {
    /// Its height in metres.
    pub z_m: f64,
    /// Its colours.
    pub texture: Texture,
    /// A rectangle of tape on it.
    pub tape: Option<Tape>,
}

/// A rectangular line on the ground, its sides along the world's axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tape {
    /// The rectangle's middle, x and y in metres.
    pub center_m: [f64; 2],
    /// Its outer sides along x and y in metres.
    pub size_m: [f64; 2],
    /// How wide the tape is, in metres.
    pub width_m: f64,
    /// Red, green, blue, linear, 0 to 1.
    pub color: [f64; 3],
}

/// The inside of a sphere around the world's origin, on which the background is painted.
#[derive(Debug, Clone, PartialEq)]
pub struct Room {
    /// Its radius in metres.
    pub radius_m: f64,
    /// Its colours.
    pub texture: Texture,
}

/// A far lamp, and light from everywhere. Both together are 1 where a surface faces the lamp.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Light {
    /// Towards the lamp, world frame, unit length.
    pub direction: Vector3<f64>,
    /// The share that comes from everywhere, 0 to 1.
    pub ambient: f64,
}

/// A thing in the world.
#[derive(Debug, Clone, PartialEq)]
pub struct Object {
    /// Its name.
    pub name: String,
    /// Its shape and size.
    pub body: Body,
    /// Red, green, blue, linear, 0 to 1.
    pub color: [f64; 3],
    /// How strong its highlight is, 0 (none) to 1 (white).
    pub highlight: f64,
    /// Where it goes.
    pub course: Course,
    /// Its heading in radians where it is fixed; else it faces where it goes.
    pub heading_rad: Option<f64>,
    /// Whether it is to be tracked: the scene has it as a target, and colours are learnt from it.
    pub is_target: bool,
}

/// Where an object goes.
#[derive(Debug, Clone, PartialEq)]
pub enum Course {
    /// Along a path of its own.
    Path(Path),
    /// With another object, at an offset in metres in that one's frame: x ahead, y to its left, z up.
    Rides {
        /// The carrier's place in [`World::objects`]; it rides on nothing itself.
        carrier: usize,
        /// From the carrier's position.
        offset_m: Vector3<f64>,
    },
}

/// A camera in the world.
#[derive(Debug, Clone, PartialEq)]
pub struct WorldCamera {
    /// Its name.
    pub name: String,
    /// Its model.
    pub camera: Camera,
    /// Width and height of its images in pixels.
    pub size_px: (usize, usize),
    /// Its pose.
    pub world_from_camera: Pose,
    /// What its images are like.
    pub image: ImageSettings,
    /// When it takes them, and when it says that it did.
    pub timing: Timing,
}

/// Where an object is at one time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Placed {
    /// A ball's centre, the middle of the base of any other body; world frame, metres.
    pub position_m: Vector3<f64>,
    /// Its velocity in the world, m/s.
    pub velocity_mps: Vector3<f64>,
    /// Where its front points, about the world's vertical; 0 along x.
    pub heading_rad: f64,
}

impl Default for Room {
    /// A sphere of 20 m, painted with grey clouds.
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
    /// A lamp nearly overhead; half of the light comes from everywhere.
    fn default() -> Self {
        Self {
            direction: Vector3::new(0.3, 0.2, 1.0).normalize(),
            ambient: 0.5,
        }
    }
}

impl World {
    /// The seed of worlds that state none.
    pub const DEFAULT_SEED: u32 = 1;

    /// Where every object is at a time, in the order of the objects.
    pub fn placed(&self, time_s: f64) -> Vec<Placed> {
        let of_object = |object: &Object| match &object.course {
            Course::Path(path) => on_path(object, path, time_s),
            Course::Rides { carrier, offset_m } => {
                let carrier = &self.objects[*carrier];
                let Course::Path(path) = &carrier.course else {
                    unreachable!("carriers have paths of their own")
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
                    // Turning moves it too; differences are exact to a micrometre per second.
                    velocity_mps: (at(time_s + STEP_S).0 - at(time_s - STEP_S).0) / (2.0 * STEP_S),
                    heading_rad: object.heading_rad.unwrap_or(heading_rad),
                }
            }
        };
        self.objects.iter().map(of_object).collect()
    }

    /// Whether an object ever moves.
    pub(crate) fn moves(&self, object: usize) -> bool {
        let path_of = match &self.objects[object].course {
            Course::Path(path) => path,
            Course::Rides { carrier, .. } => match &self.objects[*carrier].course {
                Course::Path(path) => path,
                Course::Rides { .. } => unreachable!("carriers have paths of their own"),
            },
        };
        !matches!(path_of, Path::Still { .. })
    }
}

/// Half of the step by which a rider's velocity is taken, in seconds.
const STEP_S: f64 = 1e-4;

fn on_path(object: &Object, path: &Path, time_s: f64) -> Placed {
    let (position_m, velocity_mps) = path.at(time_s);
    Placed {
        position_m,
        velocity_mps,
        heading_rad: object
            .heading_rad
            .unwrap_or_else(|| path.course_rad(time_s)),
    }
}

/// A vector turned about the vertical by an angle of this sine and cosine.
fn turned(v: &Vector3<f64>, (sin, cos): (f64, f64)) -> Vector3<f64> {
    Vector3::new(cos * v.x - sin * v.y, sin * v.x + cos * v.y, v.z)
}
