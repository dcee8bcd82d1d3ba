//! World files: what [`simulate`](pardalis_simulate) is to make images of.

mod cameras;
mod objects;

use std::ops::RangeInclusive;

use nalgebra::Vector3;

use super::camera::ReadCalibration;
use super::reader::{Journal, Problem, Table};
use super::replaced;
use super::target::kind_of;
use pardalis_simulate::{Ground, Light, Pattern, Room, Tape, Texture, World, linear_from_srgb};

/// All that a world file says.
#[derive(Debug, Clone, PartialEq)]
pub struct WorldConfig {
    /// The world.
    pub world: World,
    /// Stills to be labelled, from which colours are learnt.
    pub training_stills: usize,
    /// Standard deviation of where targets start in the scene, on each axis, in metres.
    pub start_sigma_m: f64,
}

/// The most stills.
const MAX_STILLS: usize = 1000;
/// The longest time that is simulated, in seconds.
const MAX_DURATION_S: f64 = 100_000.0;
/// The farthest that anything may be, in metres.
const MAX_DISTANCE_M: f64 = 10_000.0;

impl WorldConfig {
    /// Reads a world's text whole; calibration files that it names are read by way of the caller. On failure: every problem, in the order of lines.
    pub fn parse(text: &str, read_calibration: ReadCalibration) -> Result<Self, Vec<Problem>> {
        Self::parse_with(text, &toml::Table::new(), read_calibration)
    }

    /// Reads a world's text as [`WorldConfig::parse`] does, with some of its settings replaced or added, as [`super::Scene::parse_with`] does.
    pub fn parse_with(
        text: &str,
        replaced: &toml::Table,
        read_calibration: ReadCalibration,
    ) -> Result<Self, Vec<Problem>> {
        let (journal, mut root) = Journal::parse(text);
        let values = replaced::text_behind(text, replaced);
        replaced::put_all(&mut root, replaced, &values);
        let table = Table::root(&journal, &root);
        let seed = table.or("seed", 1_u32);
        let duration_s = table.required("duration_s");
        if let Some(duration_s) = duration_s {
            let allowed = format!("above 0 and at most {MAX_DURATION_S}");
            let positive = f64::MIN_POSITIVE..=MAX_DURATION_S;
            check_within(&table, "duration_s", duration_s, positive, &allowed);
        }
        let training_stills = table.or("training_stills", 6);
        if training_stills > MAX_STILLS {
            table.refuse("training_stills", &format!("0 to {MAX_STILLS}"));
        }
        let start_sigma_m = non_negative(&table, "start_sigma_m", 0.05, 100.0);
        let ground = table.table("ground").map(read_ground);
        let room = table.table("room").map_or(Some(DEFAULT_ROOM), read_room);
        let light = table
            .table("light")
            .map_or(Some(default_light()), read_light);
        let objects = objects::read(&journal, &table);
        let cameras = cameras::read(&table, duration_s, read_calibration);
        table.finish();
        journal.finish()?;
        // Where there is no problem, nothing is missing.
        let parts = (
            duration_s,
            ground.map_or(Some(None), |g| g.map(Some)),
            room,
            light,
        );
        let (Some(duration_s), Some(ground), Some(room), Some(light)) = parts else {
            unreachable!("what cannot be read is a problem")
        };
        Ok(Self {
            world: World {
                seed,
                duration_s,
                ground,
                room,
                light,
                objects,
                cameras,
            },
            training_stills,
            start_sigma_m,
        })
    }
}

/// A room of grey clouds.
const DEFAULT_ROOM: Room = Room {
    radius_m: 20.0,
    texture: Texture {
        pattern: Pattern::Noise {
            size_m: 5.0,
            octaves: 4,
        },
        colors: [[0.1, 0.1, 0.11], [0.35, 0.35, 0.34]],
    },
};

fn default_light() -> Light {
    Light {
        direction: Vector3::new(0.3, 0.2, 1.0).normalize(),
        ambient: 0.5,
    }
}

fn read_ground(table: Table) -> Option<Ground> {
    let z_m = bounded(&table, "z_m", 0.0, -MAX_DISTANCE_M..=MAX_DISTANCE_M);
    let texture = read_texture(&table);
    let tape = table.table("tape").map(read_tape);
    table.finish();
    Some(Ground {
        z_m,
        texture: texture?,
        tape: tape.map_or(Some(None), |tape| tape.map(Some))?,
    })
}

fn read_tape(table: Table) -> Option<Tape> {
    let center_m = table.or("center_m", [0.0; 2]);
    let size_m = table.required::<[f64; 2]>("size_m");
    let width_m = length(&table, "width_m");
    let color = read_color(&table, "color_srgb");
    if let Some([a, b]) = size_m {
        for side_m in [a, b] {
            check_within(
                &table,
                "size_m",
                side_m,
                1e-3..=MAX_DISTANCE_M,
                "0.001 to 10000",
            );
        }
    }
    table.finish();
    Some(Tape {
        center_m,
        size_m: size_m?,
        width_m: width_m?,
        color: color?,
    })
}

fn read_room(table: Table) -> Option<Room> {
    let radius_m = bounded(
        &table,
        "radius_m",
        DEFAULT_ROOM.radius_m,
        0.1..=MAX_DISTANCE_M,
    );
    let texture = read_texture(&table);
    table.finish();
    Some(Room {
        radius_m,
        texture: texture?,
    })
}

fn read_light(table: Table) -> Option<Light> {
    let default = default_light();
    let direction = table.or("direction", <[f64; 3]>::from(default.direction));
    let unit = Vector3::from(direction).try_normalize(1e-9);
    if unit.is_none() {
        table.refuse("direction", "a direction towards the lamp, not all zero");
    }
    let ambient = share(&table, "ambient", default.ambient);
    table.finish();
    Some(Light {
        direction: unit?,
        ambient,
    })
}

/// Two colours and their pattern.
fn read_texture(table: &Table) -> Option<Texture> {
    let kinds = ["plain", "checker", "stripes", "noise"];
    let (kind, texture) = kind_of(table, "texture", &kinds)?;
    if kind == "plain" {
        let color = read_color(&texture, "color_srgb");
        texture.finish();
        return Some(Texture {
            pattern: Pattern::Plain,
            colors: [color?; 2],
        });
    }
    let rows = texture.required::<Vec<Vec<f64>>>("colors_srgb");
    let colors = rows.and_then(|rows| {
        let colors = match &rows[..] {
            [first, second] => checked_color(first).zip(checked_color(second)),
            _ => None,
        };
        let colors = colors.map(<[_; 2]>::from);
        if colors.is_none() {
            let allowed = "two colours, [[red, green, blue], [red, green, blue]], 0 to 255";
            texture.refuse("colors_srgb", allowed);
        }
        colors
    });
    let pattern = match kind {
        "checker" => length(&texture, "size_m").map(|size_m| Pattern::Checker { size_m }),
        "stripes" => {
            let turn_deg: f64 = texture.or("turn_deg", 0.0);
            length(&texture, "width_m").map(|width_m| Pattern::Stripes {
                width_m,
                turn_rad: turn_deg.to_radians(),
            })
        }
        _ => {
            let octaves = texture.or("octaves", 4_u32);
            if !(1..=12).contains(&octaves) {
                texture.refuse("octaves", "1 to 12");
            }
            length(&texture, "size_m").map(|size_m| Pattern::Noise { size_m, octaves })
        }
    };
    texture.finish();
    Some(Texture {
        pattern: pattern?,
        colors: colors?,
    })
}

/// A colour that must be given, as linear light.
fn read_color(table: &Table, key: &'static str) -> Option<[f64; 3]> {
    let srgb = table.required::<[f64; 3]>(key)?;
    let color = checked_color(&srgb);
    if color.is_none() {
        table.refuse(key, "[red, green, blue], each from 0 to 255");
    }
    color
}

fn checked_color(srgb: &[f64]) -> Option<[f64; 3]> {
    let srgb: [f64; 3] = srgb.try_into().ok()?;
    let allowed = srgb.iter().all(|grey| (0.0..=255.0).contains(grey));
    allowed.then(|| linear_from_srgb(srgb))
}

/// A point in the world that must be given.
fn read_point(table: &Table, key: &'static str) -> Option<Vector3<f64>> {
    let point = table.required::<[f64; 3]>(key)?;
    if point.iter().any(|c| c.abs() > MAX_DISTANCE_M) {
        table.refuse(key, "three numbers from -10000 to 10000 metres");
        return None;
    }
    Some(point.into())
}

/// A length that must be given.
fn length(table: &Table, key: &'static str) -> Option<f64> {
    let length_m = table.required(key)?;
    let allowed = "1e-6 to 10000 metres";
    check_within(table, key, length_m, 1e-6..=MAX_DISTANCE_M, allowed).then_some(length_m)
}

/// A share, or its default.
fn share(table: &Table, key: &'static str, default: f64) -> f64 {
    bounded(table, key, default, 0.0..=1.0)
}

/// A number from 0, or its default.
fn non_negative(table: &Table, key: &'static str, default: f64, most: f64) -> f64 {
    bounded(table, key, default, 0.0..=most)
}

/// A number within bounds, or its default.
fn bounded(table: &Table, key: &'static str, default: f64, bounds: RangeInclusive<f64>) -> f64 {
    let value = table.or(key, default);
    let allowed = format!("{} to {}", bounds.start(), bounds.end());
    check_within(table, key, value, bounds, &allowed);
    value
}

fn check_within(
    table: &Table,
    key: &str,
    value: f64,
    bounds: RangeInclusive<f64>,
    allowed: &str,
) -> bool {
    let inside = bounds.contains(&value);
    if !inside {
        table.refuse(key, allowed);
    }
    inside
}
