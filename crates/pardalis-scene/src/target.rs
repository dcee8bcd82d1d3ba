//! The targets of a scene.

use super::appearance::{read_cues, read_shape};
use super::motion::read_motion;
use super::reader::{Located, Table};
use super::start::{StartConfig, read_start};
use pardalis::color::ColorModel;
use pardalis::likelihood::{ContourSettings, Cue, CueSettings};
use pardalis::shape::Shape;
use pardalis::start::Start;
use pardalis::tracker::{BodySettings, ExistenceSettings, OcclusionRates};
use pardalis_filter::bernoulli::check_motion;
use pardalis_filter::motion::{ConstantVelocity, Motion};
use pardalis_filter::particle_filter::{FilterSettings, MAX_PARTICLES};
use pardalis_filter::resample::Resampling;

/// One target of a scene.
#[derive(Debug, Clone, PartialEq)]
pub struct TargetConfig {
    /// Its name.
    pub name: String,
    /// Its one body, which has its name, or its landmarks.
    pub bodies: Vec<BodyConfig>,
    /// The numbers of its landmarks `front` and `rear`, where it has these.
    pub heading: Option<[usize; 2]>,
}

/// A target of one body, or a landmark of one of several.
#[derive(Debug, Clone, PartialEq)]
pub struct BodyConfig {
    /// Its name.
    pub name: String,
    /// Its shape.
    pub shape: Shape,
    /// The file with its colours; none where every cue knows its own.
    pub colors: Option<Located<String>>,
    /// How it is compared with the images.
    pub cues: Vec<CueSettings>,
    /// Its filter.
    pub filter: FilterSettings,
    /// Where its particles start, with the place of the position, pixel or file.
    pub start: Located<StartConfig>,
    /// How it comes, goes and hides, where it is sought.
    pub existence: ExistenceSettings,
}

/// The cameras of a scene, as far as its targets need to know them.
#[derive(Debug)]
pub(super) struct CameraNames {
    /// All of them.
    pub(super) all: Vec<String>,
    /// Those that are known by a plane alone, so that they say nothing of heights over it.
    pub(super) without_height: Vec<String>,
    /// The one of those known by a plane that stands lowest, and its height in metres.
    pub(super) lowest: Option<(String, f64)>,
}

impl TargetConfig {
    /// Reads one target; `None` when something needed is missing or faulty, which the journal then says.
    pub(super) fn read(name: String, table: Table, cameras: &CameraNames) -> Option<Self> {
        let landmarks = if table.has("landmarks") {
            table.named_tables("landmarks", "landmark")
        } else {
            Vec::new()
        };
        let has_landmarks = table.has("landmarks");
        // Each landmark may have a shape of its own.
        let shape = (!has_landmarks || table.has("shape"))
            .then(|| read_shape(&table, cameras))
            .flatten();
        let own_shapes: Vec<_> = landmarks
            .iter()
            .map(|(_, landmark)| {
                let is_own = landmark.knows("shape") || !table.has("shape");
                if is_own {
                    read_shape(landmark, cameras)
                } else {
                    shape
                }
            })
            .collect();
        let typical = shape.or_else(|| own_shapes.iter().copied().flatten().next());
        let has_start =
            table.has("start") || landmarks.iter().any(|(_, landmark)| landmark.has("start"));
        let cues = read_cues(&table, typical.as_ref(), &cameras.all, has_start);
        let is_sought = cues
            .as_ref()
            .is_some_and(|cues| cues.iter().any(CueSettings::is_edge));
        let filter = read_filter(&table, typical.as_ref(), is_sought);
        let existence = read_existence(&table, is_sought);
        if matches!(typical, Some(Shape::Flat(_)))
            && filter.is_some_and(|filter| !filter.motion.is_planar())
        {
            let message = "lets a flat shape leave the ground; give planar_constant_velocity, planar_random_walk or planar_constant_acceleration";
            table.problem("motion", message);
        }
        let body = |name: String, table: &Table, shape: Option<Shape>| {
            let colors = table.located("colors");
            // Of cues that cannot be read their own problems are told.
            let need_colors = |cues: &Vec<CueSettings>| {
                cues.iter().any(|cue| !cue.cue.works_without_color_model())
            };
            if !table.has("colors") && cues.as_ref().is_some_and(need_colors) {
                let message = "is missing; give a colour model, made by `pardalis learn`, or, for the window cue alone, window.hue_deg and window.saturation";
                table.problem("colors", message);
            }
            // Of a shape that all share the cue's own table tells.
            let has_form = matches!(shape, Some(Shape::Sphere(_) | Shape::Upright(_)));
            let needs_flat_shape =
                |cues: &Vec<CueSettings>| cues.iter().any(|cue| cue.cue.needs_flat_shape());
            if has_form && cues.as_ref().is_some_and(needs_flat_shape) {
                let message = "is not flat, but the cues region and difference look at flat regions; give shape.disc or shape.rectangle, or leave these cues out";
                table.problem("shape", message);
            }
            let start = if is_sought {
                read_sought_start(table, &name, &cameras.all)
            } else {
                read_start(table, &name, &cameras.all)
            };
            Some(BodyConfig {
                name,
                shape: shape?,
                colors,
                cues: cues.clone()?,
                filter: filter?,
                start: start?,
                existence: existence?,
            })
        };
        let (bodies, heading) = if has_landmarks {
            for key in ["colors", "start"] {
                if table.knows(key) {
                    table.problem(key, "stands beside landmarks; give each landmark its own");
                }
            }
            let names: Vec<String> = landmarks.iter().map(|(name, _)| name.clone()).collect();
            if names.len() == 1 {
                let message =
                    "has one; give two or more, or put its settings into the target itself";
                table.problem("landmarks", message);
            }
            let mut bodies = Vec::new();
            for ((name, landmark), shape) in landmarks.into_iter().zip(own_shapes) {
                bodies.push(body(name, &landmark, shape));
                if matches!(&bodies.last(), Some(Some(body)) if matches!(body.start.value, StartConfig::Track(_)))
                {
                    let message = "is a track, which does not say where landmarks are; give start.gaussian or start.pixel";
                    landmark.problem("start", message);
                }
                landmark.finish();
            }
            (bodies, read_heading(&table, &names))
        } else {
            (vec![body(name.clone(), &table, shape)], None)
        };
        table.finish();
        Some(Self {
            name,
            bodies: bodies.into_iter().collect::<Option<_>>()?,
            heading,
        })
    }
}

/// A heading needs a landmark `front` and one `rear`.
fn read_heading(table: &Table, landmarks: &[String]) -> Option<[usize; 2]> {
    let [front, rear] = ["front", "rear"].map(|name| landmarks.iter().position(|l| l == name));
    if front.is_some() != rear.is_some() {
        let message = "has one of `front` and `rear`; a heading needs both, so there is none";
        table.warn("landmarks", message);
    }
    Some([front?, rear?])
}

impl BodyConfig {
    /// How it is tracked, once its files are read.
    pub fn settings(&self, colors: Option<ColorModel>, start: Start) -> BodySettings {
        BodySettings {
            shape: self.shape,
            colors,
            cues: self.cues.clone(),
            filter: self.filter,
            start,
            existence: self.existence,
        }
    }

    /// Its contour cue, where it has one.
    pub fn contour(&self) -> Option<&ContourSettings> {
        self.cues.iter().find_map(|cue| match &cue.cue {
            Cue::Contour(contour) => Some(contour),
            _ => None,
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

/// What is sought needs no start.
fn read_sought_start(
    table: &Table,
    name: &str,
    cameras: &[String],
) -> Option<Located<StartConfig>> {
    if !table.has("start") {
        return Some(table.at("start", StartConfig::Here(Start::Anywhere)));
    }
    let start = read_start(table, name, cameras)?;
    if let StartConfig::Here(Start::Pixel(_)) = start.value {
        let message = "is a pixel, but the edge cue finds its target by itself; leave start out, or give start.gaussian or start.track";
        table.problem("start", message);
        return None;
    }
    Some(start)
}

/// Rates of coming, going and hiding; only what is sought has them.
fn read_existence(table: &Table, is_sought: bool) -> Option<ExistenceSettings> {
    let default = ExistenceSettings::default();
    if !is_sought {
        return Some(default);
    }
    let Some(existence) = table.table("existence") else {
        return (!table.has("existence")).then_some(default);
    };
    let settings = ExistenceSettings {
        birth_rate_hz: existence.or("birth_rate_hz", default.birth_rate_hz),
        death_rate_hz: existence.or("death_rate_hz", default.death_rate_hz),
        relocation_rate_hz: existence.or("relocation_rate_hz", default.relocation_rate_hz),
        velocity_jump_rate_hz: existence.or("velocity_jump_rate_hz", default.velocity_jump_rate_hz),
        velocity_jump_sigma_mps: existence
            .or("velocity_jump_sigma_mps", default.velocity_jump_sigma_mps),
        occlusion: OcclusionRates {
            occlusion_hz: existence.or("occlusion_rate_hz", default.occlusion.occlusion_hz),
            reappearance_hz: existence
                .or("reappearance_rate_hz", default.occlusion.reappearance_hz),
        },
        ground_z_m: existence.or("ground_z_m", default.ground_z_m),
    };
    existence.checked(settings.check())?;
    existence.finish();
    Some(settings)
}

fn read_filter(table: &Table, shape: Option<&Shape>, is_sought: bool) -> Option<FilterSettings> {
    let (default_motion, default_count) = if is_sought {
        (ConstantVelocity::BETWEEN_KICKS, SOUGHT_PARTICLES)
    } else {
        (ConstantVelocity::DEFAULT, DEFAULT_FILTER.particle_count)
    };
    let motion = read_motion(table, shape, default_motion);
    if is_sought
        && let Some(motion) = &motion
        && let Err(error) = check_motion(motion)
    {
        table.problem("motion", error.to_string());
        return None;
    }
    let Some(filter) = table.table("filter") else {
        return Some(FilterSettings {
            motion: motion?,
            particle_count: default_count,
            ..DEFAULT_FILTER
        });
    };
    let particle_count = filter.or("particles", default_count);
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

/// Of the edge cue: its particles are drawn where the images say.
const SOUGHT_PARTICLES: usize = 500;

const DEFAULT_FILTER: FilterSettings = FilterSettings {
    particle_count: 2000,
    motion: Motion::DEFAULT,
    resampling: Resampling::Systematic,
    resample_below: 1.0,
};
