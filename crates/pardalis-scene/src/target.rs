//! The targets of a scene.

use super::appearance::{CuesConfig, read_cues, read_shape};
use super::motion::read_motion;
use super::reader::{Located, Table};
use super::start::{StartConfig, read_start};
use pardalis::color::ColorModel;
use pardalis::likelihood::{ContourSettings, Cue, CueSettings, EdgeSettings};
use pardalis::shape::Shape;
use pardalis::start::Start;
use pardalis::tracker::{
    BodySettings, DetectedSettings, ExistenceSettings, InitializedSettings, OcclusionRates,
};
use pardalis_core::Error;
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
    /// In which way it is tracked.
    pub tracking: TrackingConfig,
}

/// One of the two ways in which a body is tracked.
#[derive(Debug, Clone, PartialEq)]
pub enum TrackingConfig {
    /// The tracker detects the target itself.
    Detected {
        /// The edge cue.
        edge: EdgeSettings,
        /// How it moves.
        motion: Motion,
        /// The number of particles.
        particle_count: usize,
        /// How it appears, disappears and becomes occluded.
        existence: ExistenceSettings,
        /// Where it is at first, if that is known, with the place of the position or file.
        start: Option<Located<StartConfig>>,
    },
    /// The published cues track it from a given start.
    Initialized {
        /// The cues.
        cues: Vec<CueSettings>,
        /// Its particle filter.
        filter: FilterSettings,
        /// Where its particles start, with the place of the position, pixel or file.
        start: Located<StartConfig>,
    },
}

/// What the bodies of a target share, before their starts are read.
enum Shared {
    Detected {
        edge: EdgeSettings,
        motion: Option<Motion>,
        particle_count: usize,
        existence: Option<ExistenceSettings>,
    },
    Initialized {
        cues: Vec<CueSettings>,
        filter: Option<FilterSettings>,
    },
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
        let shared = read_shared(&table, typical.as_ref(), cues);
        let motion = match &shared {
            Some(Shared::Detected { motion, .. }) => *motion,
            Some(Shared::Initialized { filter, .. }) => filter.map(|filter| filter.motion),
            None => None,
        };
        if matches!(typical, Some(Shape::Flat(_)))
            && motion.is_some_and(|motion| !motion.is_planar())
        {
            let message = "lets a flat shape leave the ground; give planar_constant_velocity, planar_random_walk or planar_constant_acceleration";
            table.problem("motion", message);
        }
        let body = |name: String, table: &Table, shape: Option<Shape>| {
            let colors = table.located("colors");
            // Cues that cannot be read have problems of their own.
            let needs_colors = match &shared {
                Some(Shared::Detected { .. }) => true,
                Some(Shared::Initialized { cues, .. }) => {
                    cues.iter().any(|cue| !cue.cue.knows_its_colors())
                }
                None => false,
            };
            if !table.has("colors") && needs_colors {
                let message = "is missing; give a colour model, made by `pardalis learn`, or, for the window cue alone, window.hue_deg and window.saturation";
                table.problem("colors", message);
            }
            // If all share a shape, the cue's own table reports it.
            let has_form = matches!(shape, Some(Shape::Sphere(_) | Shape::Upright(_)));
            let looks_at_regions = |shared: &Shared| match shared {
                Shared::Detected { .. } => false,
                Shared::Initialized { cues, .. } => {
                    cues.iter().any(|cue| cue.cue.looks_at_regions())
                }
            };
            if has_form && shared.as_ref().is_some_and(looks_at_regions) {
                let message = "is not flat, but the cues region and difference look at flat regions; give shape.disc or shape.rectangle, or leave these cues out";
                table.problem("shape", message);
            }
            let tracking = match &shared {
                Some(shared) => shared.with_start(table, &name, &cameras.all),
                // Problems of the start are reported all the same.
                None => read_start(table, &name, &cameras.all).and(None),
            };
            Some(BodyConfig {
                name,
                shape: shape?,
                colors,
                tracking: tracking?,
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
                let start = bodies.last().and_then(|body| body.as_ref()?.start());
                if start.is_some_and(|start| matches!(start.value, StartConfig::Track(_))) {
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
    /// Where it starts, if the scene says so.
    pub fn start(&self) -> Option<&Located<StartConfig>> {
        match &self.tracking {
            TrackingConfig::Detected { start, .. } => start.as_ref(),
            TrackingConfig::Initialized { start, .. } => Some(start),
        }
    }

    /// The published cues; none if the tracker detects the body itself.
    pub fn cues(&self) -> &[CueSettings] {
        match &self.tracking {
            TrackingConfig::Detected { .. } => &[],
            TrackingConfig::Initialized { cues, .. } => cues,
        }
    }

    /// How it moves.
    pub fn motion(&self) -> &Motion {
        match &self.tracking {
            TrackingConfig::Detected { motion, .. } => motion,
            TrackingConfig::Initialized { filter, .. } => &filter.motion,
        }
    }

    /// The number of its particles.
    pub fn particle_count(&self) -> usize {
        match &self.tracking {
            TrackingConfig::Detected { particle_count, .. } => *particle_count,
            TrackingConfig::Initialized { filter, .. } => filter.particle_count,
        }
    }

    /// Its settings, once its files are read.
    ///
    /// Errors: a detected body without colours or with a start in a pixel, an initialised one without start.
    pub fn settings(
        &self,
        colors: Option<ColorModel>,
        start: Option<Start>,
    ) -> Result<BodySettings, Error> {
        let missing = |what: &str, remedy: &str| Error::Empty {
            what: what.to_owned(),
            remedy: remedy.to_owned(),
        };
        match &self.tracking {
            TrackingConfig::Detected {
                edge,
                motion,
                particle_count,
                existence,
                ..
            } => {
                let start = match start {
                    Some(Start::Gaussian(start)) => Some(start),
                    Some(Start::Pixel(_)) => {
                        let allowed = "none or a position for detected targets";
                        return Err(Error::out_of_range("start", "a pixel", allowed));
                    }
                    None => None,
                };
                Ok(BodySettings::Detected(DetectedSettings {
                    shape: self.shape,
                    colors: colors
                        .ok_or_else(|| missing("the edge cue's colour model", "learn one"))?,
                    edge: *edge,
                    motion: *motion,
                    particle_count: *particle_count,
                    existence: *existence,
                    start,
                }))
            }
            TrackingConfig::Initialized { cues, filter, .. } => {
                let no_start = || missing("the start", "give a position or a pixel");
                Ok(BodySettings::Initialized(InitializedSettings {
                    shape: self.shape,
                    colors,
                    cues: cues.clone(),
                    filter: *filter,
                    start: start.ok_or_else(no_start)?,
                }))
            }
        }
    }

    /// Its contour cue, if it has one.
    pub fn contour(&self) -> Option<&ContourSettings> {
        self.cues().iter().find_map(|cue| match &cue.cue {
            Cue::Contour(contour) => Some(contour),
            _ => None,
        })
    }
}

impl Shared {
    /// What the bodies share, with the start of the body in this table.
    fn with_start(&self, table: &Table, name: &str, cameras: &[String]) -> Option<TrackingConfig> {
        match self {
            Self::Detected {
                edge,
                motion,
                particle_count,
                existence,
            } => {
                let start = read_detected_start(table, name, cameras);
                Some(TrackingConfig::Detected {
                    edge: *edge,
                    motion: (*motion)?,
                    particle_count: *particle_count,
                    existence: (*existence)?,
                    start: start?,
                })
            }
            Self::Initialized { cues, filter } => {
                let start = read_start(table, name, cameras);
                Some(TrackingConfig::Initialized {
                    cues: cues.clone(),
                    filter: (*filter)?,
                    start: start?,
                })
            }
        }
    }
}

/// Reads what the bodies of a target share; `None` if its cues cannot be read.
fn read_shared(table: &Table, shape: Option<&Shape>, cues: Option<CuesConfig>) -> Option<Shared> {
    match cues {
        Some(CuesConfig::Edge(edge)) => {
            let motion = read_motion(table, shape, ConstantVelocity::BETWEEN_KICKS);
            let motion = motion.filter(|motion| match check_motion(motion) {
                Ok(()) => true,
                Err(error) => {
                    table.problem("motion", error.to_string());
                    false
                }
            });
            Some(Shared::Detected {
                edge,
                motion,
                particle_count: read_detected_particles(table),
                existence: read_existence(table),
            })
        }
        Some(CuesConfig::Published(cues)) => {
            if table.knows("existence") {
                let message = "stands without the edge cue: the published cues track a target that is always there; leave it out, or give edge in their place";
                table.problem("existence", message);
            }
            Some(Shared::Initialized {
                cues,
                filter: read_filter(table, shape),
            })
        }
        // Problems of the other tables are reported all the same.
        None => {
            table.knows("existence");
            read_filter(table, shape);
            None
        }
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

/// Reads the start of a detected body, which needs none.
fn read_detected_start(
    table: &Table,
    name: &str,
    cameras: &[String],
) -> Option<Option<Located<StartConfig>>> {
    if !table.has("start") {
        return Some(None);
    }
    let start = read_start(table, name, cameras)?;
    if let StartConfig::Here(Start::Pixel(_)) = start.value {
        let message = "is a pixel, but the edge cue detects its target by itself; leave start out, or give start.gaussian or start.track";
        table.problem("start", message);
        return None;
    }
    Some(Some(start))
}

/// Reads how a detected target appears, disappears and becomes occluded.
fn read_existence(table: &Table) -> Option<ExistenceSettings> {
    let default = ExistenceSettings::default();
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

/// Reads the number of particles of a detected target.
fn read_detected_particles(table: &Table) -> usize {
    let default = DetectedSettings::PARTICLE_COUNT;
    let Some(filter) = table.table("filter") else {
        return default;
    };
    let count = read_particles(&filter, default);
    for key in ["resampling", "resample_below"] {
        if filter.knows(key) {
            let message = "has no effect on a target that the edge cue detects: its filter resamples in a way of its own";
            filter.warn(key, message);
        }
    }
    filter.finish();
    count
}

fn read_particles(filter: &Table, default: usize) -> usize {
    let count = filter.or("particles", default);
    if !(1..=MAX_PARTICLES).contains(&count) {
        filter.refuse("particles", &format!("1 to {MAX_PARTICLES}"));
    }
    count
}

fn read_filter(table: &Table, shape: Option<&Shape>) -> Option<FilterSettings> {
    let default = FilterSettings::default();
    let motion = read_motion(table, shape, ConstantVelocity::DEFAULT);
    let Some(filter) = table.table("filter") else {
        return Some(FilterSettings {
            motion: motion?,
            ..default
        });
    };
    let particle_count = read_particles(&filter, default.particle_count);
    let schemes = [
        ("systematic", Resampling::Systematic),
        ("stratified", Resampling::Stratified),
        ("residual", Resampling::Residual),
        ("multinomial", Resampling::Multinomial),
    ];
    let resampling = filter.word("resampling", &schemes, "systematic");
    let resample_below = filter.or("resample_below", default.resample_below);
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
