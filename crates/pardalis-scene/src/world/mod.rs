//! World files: the worlds that [`simulate`](pardalis_simulate) renders.

mod cameras;
mod objects;
mod platforms;

use std::ops::RangeInclusive;

use nalgebra::Vector3;

use super::camera::ReadCalibration;
use super::description::{KeyDescription, Presence, above};
use super::key::Key;
use super::keys::keys_of;
use super::reader::{Journal, Kind, Problem, Table};
use super::replaced::read_with;
use pardalis_simulate::{
    Detector, Ground, Light, Pattern, Room, Tape, Texture, World, linear_from_srgb,
};

/// The settings of a world file.
#[derive(Debug, Clone, PartialEq)]
pub struct WorldConfig {
    /// The world.
    pub world: World,
    /// Number of labelled stills from which colours are learned.
    pub training_stills: usize,
    /// Standard deviation of the targets' starts in the scene, on each axis, in metres; `None` if the scene finds them without a start.
    pub start_sigma_m: Option<f64>,
    /// The detector by whose boxes the scene tracks the targets, in place of their colours.
    pub detector: Option<Detector>,
}

/// Maximum number of stills.
const MAX_STILLS: f64 = 1000.0;
/// Maximum simulated time, in seconds.
const MAX_DURATION_S: f64 = 100_000.0;
/// Minimum size of any object, in metres.
const MIN_LENGTH_M: f64 = 1e-6;
/// Maximum distance of any object, in metres.
const MAX_DISTANCE_M: f64 = 10_000.0;

impl WorldConfig {
    /// Default number of stills for learning colours.
    pub const DEFAULT_TRAINING_STILLS: usize = 6;

    /// Reads a world's text. The caller reads the calibration files that the world names. Returns every problem on
    /// failure, in the order of lines.
    pub fn parse(text: &str, read_calibration: ReadCalibration) -> Result<Self, Vec<Problem>> {
        Self::parse_with(text, &toml::Table::new(), read_calibration)
    }

    /// Reads a world's text like [`WorldConfig::parse`], with some of its settings replaced or added, like
    /// [`super::Scene::parse_with`].
    pub fn parse_with(
        text: &str,
        replaced: &toml::Table,
        read_calibration: ReadCalibration,
    ) -> Result<Self, Vec<Problem>> {
        let (config, ..) = read_with(text, replaced, |journal, table| {
            Self::read(journal, table, read_calibration)
        })?;
        Ok(config.unwrap_or_else(|| unreachable!("a missing setting is a problem")))
    }

    /// Returns the keys of world files.
    pub fn keys() -> Vec<KeyDescription> {
        keys_of(|journal, table| {
            Self::read(journal, table, &|_, _| Err(String::new()));
        })
    }

    fn read(journal: &Journal, table: &Table, read_calibration: ReadCalibration) -> Option<Self> {
        let seed = table
            .key("seed", "Seed of all random numbers.")
            .or(World::DEFAULT_SEED);
        let duration_s = table
            .key(
                "duration_s",
                "Cameras take frames from 0 s up to this time.",
            )
            .within(above(0.0, MAX_DURATION_S))
            .required();
        let training_stills = table
            .key(
                "training_stills",
                "Number of additional labelled images from which colours are learned.",
            )
            .within(0.0..=MAX_STILLS)
            .or(Self::DEFAULT_TRAINING_STILLS);
        let start_sigma_m = table
            .key(
                "start_sigma_m",
                "Gives the targets starts in the scene that is written, with this standard deviation, and with them the published contour cue. Without it, the scene finds them by itself, with default settings.",
            )
            .within(0.0..=100.0)
            .optional();
        let about = "A detector whose boxes are written, too: the scene tracks the targets by them, and not by their colours.";
        let detector = table.section("detector", about, |table| Some(read_detector(table)));
        let ground = table.section("ground", "The floor.", read_ground);
        let about = "The background: the inside of a sphere around the world's origin.";
        let room = table.section("room", about, read_room);
        let light = table.section("light", "The illumination.", read_light);
        let objects = objects::read(journal, table);
        let (platforms, platform_names) = platforms::read(table);
        let cameras = cameras::read(table, duration_s, &platform_names, read_calibration);
        Some(Self {
            world: World {
                seed,
                duration_s: duration_s?,
                ground,
                room: room.unwrap_or_default(),
                light: light.unwrap_or_default(),
                objects,
                platforms,
                cameras,
            },
            training_stills,
            start_sigma_m,
            detector,
        })
    }
}

fn read_detector(table: &Table) -> Detector {
    let default = Detector::default();
    Detector {
        detection_probability: table
            .key(
                "detection_probability",
                "Probability that a target is found that nothing hides.",
            )
            .within(above(0.0, 0.999))
            .or(default.detection_probability),
        false_per_image: table
            .key(
                "false_per_image",
                "Mean number of boxes in an image that are no target.",
            )
            .within(above(0.0, 100.0))
            .or(default.false_per_image),
        side_sigma: table
            .key("side_sigma", "Standard deviation of each side of a box, as a share of the square root of its area.")
            .within(above(0.0, 1.0))
            .or(default.side_sigma),
        size_bias: table
            .key("size_bias", "Share by which all boxes are too large.")
            .within(-0.5..=1.0)
            .or(default.size_bias),
    }
}

fn read_ground(table: &Table) -> Option<Ground> {
    let z_m = table
        .key("z_m", "Height of the floor.")
        .within(-MAX_DISTANCE_M..=MAX_DISTANCE_M)
        .or(0.0);
    let texture = read_texture(table, Presence::Required);
    let tape = table.section(
        "tape",
        "A rectangle of tape on the floor, along the world's axes.",
        read_tape,
    );
    if table.has("tape") && tape.is_none() {
        return None;
    }
    Some(Ground {
        z_m,
        texture: texture?,
        tape,
    })
}

fn read_tape(table: &Table) -> Option<Tape> {
    let center_m = table
        .key("center_m", "Centre of the rectangle.")
        .or([0.0; 2]);
    let size_m = table
        .key("size_m", "Outer sides along x and y.")
        .within(1e-3..=MAX_DISTANCE_M)
        .required::<[f64; 2]>();
    let width_m = length(table, "width_m", "Width of the tape.");
    let color = read_color(table);
    Some(Tape {
        center_m,
        size_m: size_m?,
        width_m: width_m?,
        color: color?,
    })
}

fn read_room(table: &Table) -> Option<Room> {
    let radius_m = table
        .key("radius_m", "Radius of the sphere.")
        .within(0.1..=MAX_DISTANCE_M)
        .or(Room::default().radius_m);
    let texture = read_texture(table, Presence::Required);
    Some(Room {
        radius_m,
        texture: texture?,
    })
}

fn read_light(table: &Table) -> Option<Light> {
    let default = Light::default();
    let direction = table
        .key(
            "direction",
            "Direction towards a distant lamp; any length except 0.",
        )
        .or(<[f64; 3]>::from(default.direction));
    let unit = Vector3::from(direction).try_normalize(1e-9);
    if unit.is_none() {
        table.reject("direction", "a direction towards the lamp, not all zero");
    }
    let ambient = table
        .key(
            "ambient",
            "Share of the light that comes equally from all directions.",
        )
        .within(0.0..=1.0)
        .or(default.ambient);
    Some(Light {
        direction: unit?,
        ambient,
    })
}

const TEXTURES: [Kind; 4] = [
    ("plain", "One colour."),
    ("checker", "A checkerboard of two colours."),
    ("stripes", "Stripes of two colours."),
    ("noise", "Clouds between two colours."),
];

/// Reads a pattern of two colours.
fn read_texture(table: &Table, presence: Presence) -> Option<Texture> {
    let about = "Colours and their pattern.";
    table.choice("texture", about, &TEXTURES, presence, |kind, texture| {
        if kind == "plain" {
            let color = read_color(texture);
            return Some(Texture {
                pattern: Pattern::Plain,
                colors: [color?; 2],
            });
        }
        let rows = texture
            .key(
                "colors_srgb",
                "Two colours, [[red, green, blue], [red, green, blue]].",
            )
            .within(COLOR_RANGE)
            .required::<Vec<Vec<f64>>>();
        let colors = rows.and_then(|rows| {
            let colors = match &rows[..] {
                [first, second] => linear(first).zip(linear(second)),
                _ => None,
            };
            if colors.is_none() {
                let allowed = "two colours, [[red, green, blue], [red, green, blue]], 0 to 255";
                texture.reject("colors_srgb", allowed);
            }
            colors.map(<[_; 2]>::from)
        });
        let pattern = match kind {
            "checker" => length(texture, "size_m", "Side of a square.")
                .map(|size_m| Pattern::Checker { size_m }),
            "stripes" => {
                let rotation_deg: f64 = texture
                    .key(
                        "rotation_deg",
                        "Angle of the direction across the stripes from the x axis.",
                    )
                    .or(0.0);
                length(texture, "width_m", "Width of a stripe.").map(|width_m| Pattern::Stripes {
                    width_m,
                    turn_rad: rotation_deg.to_radians(),
                })
            }
            _ => {
                let octaves = texture
                    .key("octaves", "Number of octaves of finer and finer clouds.")
                    .within(1.0..=12.0)
                    .or(Pattern::DEFAULT_OCTAVES);
                length(texture, "size_m", "Size of the largest clouds.")
                    .map(|size_m| Pattern::Noise { size_m, octaves })
            }
        };
        Some(Texture {
            pattern: pattern?,
            colors: colors?,
        })
    })
}

const COLOR_RANGE: RangeInclusive<f64> = 0.0..=255.0;

/// Reads a colour and converts it to linear light.
fn read_color(table: &Table) -> Option<[f64; 3]> {
    let srgb = color_key(table).required::<[f64; 3]>()?;
    Some(linear_from_srgb(srgb))
}

fn color_key<'k, 'a, 't>(table: &'k Table<'a, 't>) -> Key<'k, 'a, 't> {
    table
        .key("color_srgb", "Colour, [red, green, blue].")
        .within(COLOR_RANGE)
}

fn linear(srgb: &[f64]) -> Option<[f64; 3]> {
    srgb.try_into().ok().map(linear_from_srgb)
}

/// Reads a required point or velocity.
fn read_point(table: &Table, key: &'static str, about: &'static str) -> Option<Vector3<f64>> {
    let point = table
        .key(key, about)
        .within(-MAX_DISTANCE_M..=MAX_DISTANCE_M)
        .required::<[f64; 3]>()?;
    Some(point.into())
}

/// Reads a required length.
fn length(table: &Table, key: &'static str, about: &'static str) -> Option<f64> {
    table
        .key(key, about)
        .within(MIN_LENGTH_M..=MAX_DISTANCE_M)
        .required()
}
