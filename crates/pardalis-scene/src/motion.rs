//! How a target moves.

use super::reader::Table;
use super::target::kind_of;
use pardalis::shape::Shape;
use pardalis_filter::motion::{
    AccelerationNoise, ConstantAcceleration, ConstantVelocity, JumpChance, Jumps, Motion,
    PositionNoise, RandomWalk, VelocityNoise,
};

/// Upright bodies and flat shapes stay on the ground where nothing else is said.
pub(super) fn read_motion(
    table: &Table,
    shape: Option<&Shape>,
    default: ConstantVelocity,
) -> Option<Motion> {
    if !table.knows("motion") {
        let motion = Motion::from(default);
        return Some(match shape {
            Some(Shape::Upright(_) | Shape::Flat(_)) => motion.in_plane(),
            _ => motion,
        });
    }
    let kinds = [
        "constant_velocity",
        "planar_constant_velocity",
        "constant_acceleration",
        "planar_constant_acceleration",
        "random_walk",
        "planar_random_walk",
    ];
    let (kind, table) = kind_of(table, "motion", &kinds)?;
    let planar_model = kind.strip_prefix("planar_");
    let is_planar = planar_model.is_some();
    let motion = match planar_model.unwrap_or(kind) {
        "constant_velocity" => read_constant_velocity(&table, default).map(Motion::from),
        "constant_acceleration" => read_constant_acceleration(&table).map(Motion::from),
        _ => read_random_walk(&table, is_planar).map(Motion::from),
    };
    table.finish();
    motion.map(|motion| if is_planar { motion.in_plane() } else { motion })
}

/// A key and what is made of its number.
type Setting<T> = (&'static str, fn(f64) -> T);

/// The one that is given of settings that exclude each other, as what is made of it, or the default, without which one must be given.
fn one_setting_of<T>(table: &Table, settings: &[Setting<T>], default: Option<T>) -> Option<T> {
    let mut given = Vec::new();
    for (key, make) in settings {
        given.extend(table.optional(key).map(|value| (key, make(value))));
    }
    if let [(first, _), (second, _), ..] = given[..] {
        table.problem(second, format!("stands beside {first}; keep one of them"));
        return None;
    }
    let has_any = settings.iter().any(|(key, _)| table.has(key));
    if !has_any && default.is_none() {
        let keys: Vec<&str> = settings.iter().map(|(key, _)| *key).collect();
        table.problem_here(format!("says too little; give {}", keys.join(" or ")));
    }
    given.pop().map(|(_, made)| made).or(default)
}

fn read_constant_velocity(table: &Table, default: ConstantVelocity) -> Option<ConstantVelocity> {
    let noise = one_setting_of(
        table,
        &[
            ("acceleration_sigma_mps2", |acceleration_sigma_mps2| {
                VelocityNoise::PiecewiseConstant {
                    acceleration_sigma_mps2,
                }
            }),
            ("acceleration_density_m2ps3", |acceleration_density_m2ps3| {
                VelocityNoise::White {
                    acceleration_density_m2ps3,
                }
            }),
            ("velocity_sigma_mps", |velocity_sigma_mps| {
                VelocityNoise::PerStep { velocity_sigma_mps }
            }),
        ],
        Some(default.process_noise()),
    );
    table.checked(ConstantVelocity::new(noise?))
}

fn read_constant_acceleration(table: &Table) -> Option<ConstantAcceleration> {
    let noise = one_setting_of(
        table,
        &[
            (
                "acceleration_step_sigma_mps2",
                |acceleration_step_sigma_mps2| AccelerationNoise::PerStep {
                    acceleration_step_sigma_mps2,
                },
            ),
            ("jerk_density_m2ps5", |jerk_density_m2ps5| {
                AccelerationNoise::White { jerk_density_m2ps5 }
            }),
        ],
        None,
    );
    table.checked(ConstantAcceleration::new(noise?))
}

fn read_random_walk(table: &Table, is_planar: bool) -> Option<RandomWalk> {
    let noise = one_setting_of(
        table,
        &[
            ("sigma_m", |sigma_m| PositionNoise::PerStep { sigma_m }),
            ("density_m2ps", |density_m2ps| PositionNoise::Diffusion {
                density_m2ps,
            }),
        ],
        Some(RandomWalk::PUBLISHED.process_noise()),
    );
    let jumps = table.table("jumps").and_then(|jumps| {
        let read = read_jumps(&jumps, is_planar);
        jumps.finish();
        read
    });
    let walk = table.checked(RandomWalk::new(noise?))?;
    Some(match jumps {
        Some(jumps) => walk.with_jumps(jumps),
        None => walk,
    })
}

/// Two numbers are a corner where the height is fixed, three else.
fn read_jumps(table: &Table, is_planar: bool) -> Option<Jumps> {
    let chance = one_setting_of(
        table,
        &[
            ("share", |share| JumpChance::PerStep { share }),
            ("rate_hz", |rate_hz| JumpChance::Rate { rate_hz }),
        ],
        None,
    );
    let [min_m, max_m] = ["min_m", "max_m"].map(|key| {
        if is_planar {
            table.required(key).map(|[x, y]: [f64; 2]| [x, y, 0.0])
        } else {
            table.required(key)
        }
    });
    table.checked(Jumps::new(chance?, min_m?, max_m?))
}
