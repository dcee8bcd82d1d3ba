//! The targets of a scene.

use super::appearance::{read_cues, read_shape};
use super::reader::{Located, Table};
use super::start::{StartConfig, read_start};
use crate::filter::{FilterSettings, MAX_PARTICLES};
use crate::likelihood::{ContourSettings, Cue, CueSettings};
use crate::motion::{ConstantVelocity, Disturbance, Motion, RandomWalk, Stray};
use crate::resample::Resampling;
use crate::shape::Shape;

/// One target of a scene.
#[derive(Debug, Clone, PartialEq)]
pub struct TargetConfig {
    /// Its name.
    pub name: String,
    /// Its shape.
    pub shape: Shape,
    /// The file with its colours; none where every cue knows its own.
    pub colors: Option<Located<String>>,
    /// How it is compared with the images, with the place of its table.
    pub cues: Vec<CueSettings>,
    /// Its filter.
    pub filter: FilterSettings,
    /// Where its particles start, with the place of the position, pixel or file.
    pub start: Located<StartConfig>,
}

impl TargetConfig {
    /// Reads one target; `None` when something needed is missing or faulty, which the journal then says.
    pub(super) fn read(name: String, table: Table, cameras: &[String]) -> Option<Self> {
        let shape = read_shape(&table);
        let cues = read_cues(&table, shape.as_ref(), cameras);
        let colors = table.located("colors");
        // Of cues that cannot be read their own problems are told.
        let need_colors =
            |cues: &Vec<CueSettings>| cues.iter().any(|cue| !cue.cue.knows_its_colors());
        if !table.has("colors") && cues.as_ref().is_some_and(need_colors) {
            let message = "is missing; give a colour model, made by `pardalis learn`, or, for the window cue alone, window.hue_deg and window.saturation";
            table.problem("colors", message);
        }
        let filter = read_filter(&table, shape.as_ref());
        let start = read_start(&table, &name, cameras);
        table.finish();
        Some(Self {
            name,
            shape: shape?,
            colors,
            cues: cues?,
            filter: filter?,
            start: start?,
        })
    }
}

impl TargetConfig {
    /// Its contour cue, where it has one.
    pub fn contour(&self) -> Option<&ContourSettings> {
        self.cues.iter().find_map(|cue| match &cue.cue {
            Cue::Contour(contour) => Some(contour),
            Cue::Window(_) => None,
        })
    }
}

/// A table that holds one of several kinds of things.
pub(super) fn kind_of<'a, 't>(
    table: &Table<'a, 't>,
    key: &'static str,
    kinds: &[&'static str],
) -> Option<(&'static str, Table<'a, 't>)> {
    let Some(outer) = table.table(key) else {
        if !table.has(key) {
            let wanted = kinds
                .iter()
                .map(|kind| format!("{key}.{kind}"))
                .collect::<Vec<_>>()
                .join(" or ");
            table.problem(key, format!("is missing; give a table {wanted}"));
        }
        return None;
    };
    let found = outer.one_of(kinds);
    outer.finish();
    found
}

fn read_filter(table: &Table, shape: Option<&Shape>) -> Option<FilterSettings> {
    let motion = read_motion(table, shape);
    let Some(filter) = table.table("filter") else {
        return Some(FilterSettings {
            motion: motion?,
            ..DEFAULT_FILTER
        });
    };
    let particle_count = filter.or("particles", DEFAULT_FILTER.particle_count);
    if !(1..=MAX_PARTICLES).contains(&particle_count) {
        filter.refuse("particles", &format!("1 to {MAX_PARTICLES}"));
    }
    let schemes = [
        ("systematic", Resampling::Systematic),
        ("stratified", Resampling::Stratified),
        ("residual", Resampling::Residual),
        ("multinomial", Resampling::Multinomial),
    ];
    let resampling = filter.word("resampling", &schemes, "systematic");
    let resample_below = filter.or("resample_below", DEFAULT_FILTER.resample_below);
    if !(resample_below > 0.0 && resample_below <= 1.0) {
        filter.refuse("resample_below", "above 0 and at most 1 (1: at every step)");
    }
    filter.finish();
    Some(FilterSettings {
        particle_count,
        motion: motion?,
        resampling: resampling?,
        resample_below,
    })
}

const DEFAULT_FILTER: FilterSettings = FilterSettings {
    particle_count: 2000,
    motion: Motion::ConstantVelocity(ConstantVelocity::DEFAULT),
    resampling: Resampling::Systematic,
    resample_below: 1.0,
};

/// Upright bodies and flat shapes stay on the ground where nothing else is said.
fn read_motion(table: &Table, shape: Option<&Shape>) -> Option<Motion> {
    if !table.has("motion") {
        let _ = table.table("motion");
        return Some(match shape {
            Some(Shape::Upright(_) | Shape::Flat(_)) => {
                Motion::ConstantVelocity(ConstantVelocity::DEFAULT.in_plane())
            }
            _ => DEFAULT_FILTER.motion,
        });
    }
    let kinds = [
        "constant_velocity",
        "planar_constant_velocity",
        "random_walk",
        "planar_random_walk",
    ];
    let (kind, motion) = kind_of(table, "motion", &kinds)?;
    let is_planar = kind.starts_with("planar_");
    let model = if kind.ends_with("constant_velocity") {
        read_constant_velocity(&motion)
            .map(|model| Motion::ConstantVelocity(if is_planar { model.in_plane() } else { model }))
    } else {
        read_random_walk(&motion)
            .map(|model| Motion::RandomWalk(if is_planar { model.in_plane() } else { model }))
    };
    motion.finish();
    model
}

fn read_constant_velocity(motion: &Table) -> Option<ConstantVelocity> {
    let sigma = motion.optional("acceleration_sigma_mps2");
    let density = motion.optional("acceleration_density_m2ps3");
    let disturbance = match (sigma, density) {
        (Some(acceleration_sigma_mps2), None) => Disturbance::PiecewiseConstant {
            acceleration_sigma_mps2,
        },
        (None, Some(acceleration_density_m2ps3)) => Disturbance::White {
            acceleration_density_m2ps3,
        },
        (None, None) => ConstantVelocity::DEFAULT.disturbance(),
        (Some(_), Some(_)) => {
            motion.problem(
                "acceleration_density_m2ps3",
                "stands beside acceleration_sigma_mps2; keep one of them",
            );
            return None;
        }
    };
    motion.checked(ConstantVelocity::new(disturbance))
}

fn read_random_walk(motion: &Table) -> Option<RandomWalk> {
    let sigma = motion.optional("sigma_m");
    let density = motion.optional("density_m2ps");
    let stray = match (sigma, density) {
        (Some(sigma_m), None) => Stray::PerStep { sigma_m },
        (None, Some(density_m2ps)) => Stray::Diffusion { density_m2ps },
        (None, None) => return Some(RandomWalk::PUBLISHED),
        (Some(_), Some(_)) => {
            motion.problem("density_m2ps", "stands beside sigma_m; keep one of them");
            return None;
        }
    };
    motion.checked(RandomWalk::new(stray))
}
