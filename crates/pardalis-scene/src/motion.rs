//! The motion model of a target.

use super::description::Presence;
use super::reader::{Kind, Table};
use pardalis::shape::Shape;
use pardalis_filter::motion::{
    AccelerationNoise, ConstantAcceleration, ConstantVelocity, JumpChance, Jumps, Motion,
    PositionNoise, RandomWalk, VelocityNoise,
};

const KINDS: [Kind; 6] = [
    (
        "constant_velocity",
        "Constant velocity, disturbed by random accelerations.",
    ),
    ("planar_constant_velocity", "The same at a fixed height."),
    (
        "constant_acceleration",
        "Constant acceleration, disturbed by random jerks.",
    ),
    (
        "planar_constant_acceleration",
        "The same at a fixed height.",
    ),
    (
        "random_walk",
        "Independent random steps; there is no velocity.",
    ),
    ("planar_random_walk", "The same at a fixed height."),
];

/// Maximum strength of the process noise, in any unit.
const MAX_STRENGTH: f64 = 1e9;

/// Reads the table `motion`. The default of upright bodies and flat shapes is planar.
pub(super) fn read_motion(
    table: &Table,
    shape: Option<&Shape>,
    default: ConstantVelocity,
) -> Option<Motion> {
    let about = "The motion model. Rates in m²/s³ and the like hold for any frame rate; `_sigma_` per frame are the papers' settings for a fixed frame rate.";
    let presence = Presence::Optional(
        "`constant_velocity`; `planar_constant_velocity` for upright and flat shapes",
    );
    let read = table.choice("motion", about, &KINDS, presence, |kind, table| {
        let planar_model = kind.strip_prefix("planar_");
        let is_planar = planar_model.is_some();
        let motion = match planar_model.unwrap_or(kind) {
            "constant_velocity" => read_constant_velocity(table, default).map(Motion::from),
            "constant_acceleration" => read_constant_acceleration(table).map(Motion::from),
            _ => read_random_walk(table, is_planar).map(Motion::from),
        };
        motion.map(|motion| if is_planar { motion.in_plane() } else { motion })
    });
    if table.has("motion") {
        return read;
    }
    let motion = Motion::from(default);
    Some(match shape {
        Some(Shape::Upright(_) | Shape::Flat(_)) => motion.in_plane(),
        _ => motion,
    })
}

/// A key, its meaning, its maximum and the conversion of its number.
type Alternative<T> = (&'static str, &'static str, f64, fn(f64) -> T);

/// Reads the one of several exclusive settings that is given, or returns the default, without which one must be given.
fn one_setting_of<T>(
    table: &Table,
    settings: &[Alternative<T>],
    default: Option<T>,
    default_text: &'static str,
) -> Option<T> {
    let mut given = Vec::new();
    for &(key, about, greatest, make) in settings {
        let declared = table
            .key(key, about)
            .within(0.0..=greatest)
            .depends(default_text);
        let value = if default.is_some() {
            declared.optional()
        } else {
            declared.conditional()
        };
        given.extend(value.map(|value| (key, make(value))));
    }
    if let [(first, _), (second, _), ..] = given[..] {
        table.conflict(second, first);
        return None;
    }
    let has_any = settings.iter().any(|(key, ..)| table.has(key));
    if !has_any && default.is_none() {
        let keys: Vec<&str> = settings.iter().map(|(key, ..)| *key).collect();
        table.problem_here(format!("is incomplete; give {}", keys.join(" or ")));
    }
    if has_any {
        given.pop().map(|(_, made)| made)
    } else {
        default
    }
}

/// The condition under which one of the settings is required.
const ONE_OF_THEM: &str = "give exactly one of the alternatives";

fn read_constant_velocity(table: &Table, default: ConstantVelocity) -> Option<ConstantVelocity> {
    let noise = one_setting_of(
        table,
        &[
            (
                "acceleration_sigma_mps2",
                "Standard deviation of an acceleration that is constant during each frame.",
                MAX_STRENGTH,
                |acceleration_sigma_mps2| VelocityNoise::PiecewiseConstant {
                    acceleration_sigma_mps2,
                },
            ),
            (
                "acceleration_density_m2ps3",
                "Spectral density of white acceleration noise.",
                MAX_STRENGTH,
                |acceleration_density_m2ps3| VelocityNoise::White {
                    acceleration_density_m2ps3,
                },
            ),
            (
                "velocity_sigma_mps",
                "Standard deviation of the change of velocity per frame.",
                MAX_STRENGTH,
                |velocity_sigma_mps| VelocityNoise::PerStep { velocity_sigma_mps },
            ),
        ],
        Some(default.process_noise()),
        "`acceleration_density_m2ps3` of 100; 20 for a target with the edge cue",
    );
    table.checked(ConstantVelocity::new(noise?))
}

fn read_constant_acceleration(table: &Table) -> Option<ConstantAcceleration> {
    let noise = one_setting_of(
        table,
        &[
            (
                "acceleration_step_sigma_mps2",
                "Standard deviation of the change of acceleration per frame.",
                MAX_STRENGTH,
                |acceleration_step_sigma_mps2| AccelerationNoise::PerStep {
                    acceleration_step_sigma_mps2,
                },
            ),
            (
                "jerk_density_m2ps5",
                "Spectral density of white jerk noise.",
                MAX_STRENGTH,
                |jerk_density_m2ps5| AccelerationNoise::White { jerk_density_m2ps5 },
            ),
        ],
        None,
        ONE_OF_THEM,
    );
    table.checked(ConstantAcceleration::new(noise?))
}

fn read_random_walk(table: &Table, is_planar: bool) -> Option<RandomWalk> {
    let noise = one_setting_of(
        table,
        &[
            (
                "sigma_m",
                "Standard deviation of a frame's step on each axis.",
                MAX_STRENGTH,
                |sigma_m| PositionNoise::PerStep { sigma_m },
            ),
            (
                "density_m2ps",
                "Diffusion: the variance that each axis gains per second.",
                MAX_STRENGTH,
                |density_m2ps| PositionNoise::Diffusion { density_m2ps },
            ),
        ],
        Some(RandomWalk::PUBLISHED.process_noise()),
        "`sigma_m` of 0.03",
    );
    let about = "Particles that jump anywhere in a box, to find a lost target again.";
    let jumps = table.section("jumps", about, |jumps| read_jumps(jumps, is_planar));
    let walk = table.checked(RandomWalk::new(noise?))?;
    Some(match jumps {
        Some(jumps) => walk.with_jumps(jumps),
        None => walk,
    })
}

/// A corner has two coordinates if the height is fixed, otherwise three.
fn read_jumps(table: &Table, is_planar: bool) -> Option<Jumps> {
    let chance = one_setting_of(
        table,
        &[
            (
                "probability",
                "Probability of a jump per frame.",
                1.0,
                |share| JumpChance::PerStep { share },
            ),
            ("rate_hz", "Jumps per second.", MAX_STRENGTH, |rate_hz| {
                JumpChance::Rate { rate_hz }
            }),
        ],
        None,
        ONE_OF_THEM,
    );
    let corners = [
        ("min_m", "Corner of the box with the minimum coordinates."),
        ("max_m", "Corner of the box with the maximum coordinates."),
    ];
    let [min_m, max_m] = corners.map(|(key, about)| {
        let corner = table.key(key, about).within(-1e6..=1e6);
        if is_planar {
            corner.required().map(|[x, y]: [f64; 2]| [x, y, 0.0])
        } else {
            corner.required()
        }
    });
    table.checked(Jumps::new(chance?, min_m?, max_m?))
}
