//! The settings that the bodies of a target share.

use super::appearance::CuesConfig;
use super::body::TrackingConfig;
use super::detector::DetectorConfig;
use super::existence::read_existence;
use super::filter::{read_detected_particles, read_filter};
use super::motion::read_motion;
use super::reader::{Located, Table};
use super::shape::ShapeConfig;
use super::start::{StartConfig, read_start};
use pardalis::likelihood::{CueSettings, EdgeSettings};
use pardalis::shape::Shape;
use pardalis::start::Start;
use pardalis::tracker::{BoxedSettings, ExistenceSettings, SizeTolerance};
use pardalis_filter::bernoulli::{ParticleRange, check_motion};
use pardalis_filter::motion::{ConstantVelocity, Motion};
use pardalis_filter::particle_filter::FilterSettings;

/// The settings that the bodies of a target share, before their starts are read.
pub(super) enum Shared {
    Detected {
        edge: EdgeSettings,
        detector: Option<DetectorConfig>,
        motion: Option<Motion>,
        particles: ParticleRange,
        existence: Option<ExistenceSettings>,
    },
    Initialized {
        cues: Vec<CueSettings>,
        filter: Option<FilterSettings>,
    },
    Boxed {
        detector: Option<DetectorConfig>,
        motion: Option<Motion>,
        particles: ParticleRange,
        existence: Option<ExistenceSettings>,
    },
}

/// What a target with a detector cannot have.
pub(super) const WITHOUT_DETECTOR: [&str; 5] =
    ["contour", "window", "region", "difference", "landmarks"];

impl Shared {
    pub(super) fn needs_colors(&self) -> bool {
        match self {
            Self::Detected { .. } => true,
            Self::Boxed { .. } => false,
            Self::Initialized { cues, .. } => {
                cues.iter().any(|cue| !cue.cue.works_without_color_model())
            }
        }
    }

    pub(super) fn needs_flat_shape(&self) -> bool {
        match self {
            Self::Detected { .. } | Self::Boxed { .. } => false,
            Self::Initialized { cues, .. } => cues.iter().any(|cue| cue.cue.needs_flat_shape()),
        }
    }

    /// Reports sizes that cannot be estimated with this number of cameras.
    pub(super) fn check_size(&self, table: &Table, config: &ShapeConfig, cameras: usize) {
        let is_unknown = config.size == SizeTolerance::Unknown;
        match self {
            Self::Initialized { .. } if is_unknown => {
                let message = "has radius_m = \"unknown\", but the published cues need the size; give the radius, or replace them by edge, which estimates it";
                table.problem("shape", message);
            }
            Self::Boxed { .. } if is_unknown => {
                let message = "has radius_m = \"unknown\", but boxes do not determine the size; give the radius, and detector.size_tolerance if it is a guess";
                table.problem("shape", message);
            }
            Self::Boxed { .. } if config.gives_tolerance => {
                let message = "has radius_tolerance, which has no effect on a target with a detector; give detector.size_tolerance";
                table.warn("shape", message);
            }
            Self::Boxed { .. } if config.turns == Some(true) => {
                let message = "has turns = true, which has no effect on a target with a detector: boxes do not show which way it is turned";
                table.warn("shape", message);
            }
            Self::Initialized { .. } if config.gives_tolerance => {
                let message = "has radius_tolerance, which has no effect on the published cues; they take the radius as exact";
                table.warn("shape", message);
            }
            Self::Initialized { .. } if config.turns == Some(true) => {
                let message = "has turns = true, which has no effect on the published cues; they take the body as it stands, and edge estimates its yaw";
                table.warn("shape", message);
            }
            Self::Detected {
                motion: Some(motion),
                ..
            } if is_unknown && cameras < 2 && !motion.is_planar() => {
                let message = "has radius_m = \"unknown\", but one camera does not tell size from distance; measure the radius, add a camera that sees the ball too, or give a planar motion if it stays on the ground";
                table.problem("shape", message);
            }
            _ => {}
        }
    }

    /// Combines the shared settings with the start of the body in this table.
    pub(super) fn with_start(
        &self,
        table: &Table,
        name: &str,
        cameras: &[String],
    ) -> Option<TrackingConfig> {
        match self {
            Self::Detected {
                edge,
                detector,
                motion,
                particles,
                existence,
            } => {
                let start = read_detected_start(table, name, cameras);
                Some(TrackingConfig::Detected {
                    edge: *edge,
                    detector: detector.clone(),
                    motion: (*motion)?,
                    particles: *particles,
                    existence: (*existence)?,
                    start: start.ok()?,
                })
            }
            Self::Boxed {
                detector,
                motion,
                particles,
                existence,
            } => {
                let start = read_detected_start(table, name, cameras);
                Some(TrackingConfig::Boxed {
                    detector: detector.clone()?,
                    motion: (*motion)?,
                    particles: *particles,
                    existence: (*existence)?,
                    start: start.ok()?,
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

/// Reads the settings that the bodies of a target share. Returns `None` if its cues are invalid.
pub(super) fn read_shared(
    table: &Table,
    shape: Option<&Shape>,
    cues: Option<CuesConfig>,
    detector: Option<DetectorConfig>,
) -> Option<Shared> {
    if table.is_describing() {
        // Declares the keys of both ways.
        read_filter(table, shape);
        read_existence(table, ExistenceSettings::default());
        return None;
    }
    match cues {
        Some(CuesConfig::Edge(edge)) => {
            let motion =
                read_detected_motion(table, shape, ConstantVelocity::BETWEEN_VELOCITY_JUMPS);
            let existence = standing(ExistenceSettings::default(), shape, motion);
            Some(Shared::Detected {
                edge,
                detector,
                motion,
                particles: read_detected_particles(table),
                existence: read_existence(table, existence),
            })
        }
        Some(CuesConfig::Published(cues)) => {
            if table.knows("existence") {
                let message = "needs the edge cue: the published cues track a target that always exists; remove it, or replace them by edge";
                table.problem("existence", message);
            }
            // With cues that are given, the conflict with them has been reported.
            if detector.is_some() && !WITHOUT_DETECTOR.iter().any(|key| table.has(key)) {
                let message = "needs the edge cue, and a start selects the published ones; add edge = {}, or remove the start";
                table.problem("detector", message);
            }
            Some(Shared::Initialized {
                cues,
                filter: read_filter(table, shape),
            })
        }
        // Problems of the other tables are reported nevertheless.
        None => {
            table.knows("existence");
            read_filter(table, shape);
            None
        }
    }
}

/// Reads the settings of a target with this detector.
pub(super) fn read_boxed(
    table: &Table,
    shape: Option<&Shape>,
    detector: Option<DetectorConfig>,
) -> Shared {
    let default = shape.map(|shape| {
        (
            BoxedSettings::motion_of(shape),
            BoxedSettings::existence_of(shape),
        )
    });
    let (motion, existence) = default.unwrap_or((
        ConstantVelocity::BETWEEN_VELOCITY_JUMPS,
        ExistenceSettings::default(),
    ));
    let motion = read_detected_motion(table, shape, motion);
    Shared::Boxed {
        detector,
        motion,
        particles: read_detected_particles(table),
        existence: read_existence(table, standing(existence, shape, motion)),
    }
}

/// Settings of a body that stays on the floor z = 0 if its motion is planar: the position of a ball is its centre.
fn standing(
    mut existence: ExistenceSettings,
    shape: Option<&Shape>,
    motion: Option<Motion>,
) -> ExistenceSettings {
    if let Some(ball @ Shape::Sphere(_)) = shape
        && motion.is_some_and(|motion| motion.is_planar())
    {
        existence.ground_z_m = 0.5 * ball.diameter_m();
    }
    existence
}

/// Reads the motion of a target that is searched for.
fn read_detected_motion(
    table: &Table,
    shape: Option<&Shape>,
    default: ConstantVelocity,
) -> Option<Motion> {
    let motion = read_motion(table, shape, default);
    motion.filter(|motion| match check_motion(motion) {
        Ok(()) => true,
        Err(error) => {
            table.problem("motion", error.to_string());
            false
        }
    })
}

/// Reads the optional start of a detected body. After an error, the journal contains the problem.
fn read_detected_start(
    table: &Table,
    name: &str,
    cameras: &[String],
) -> Result<Option<Located<StartConfig>>, ()> {
    if !table.has("start") {
        return Ok(None);
    }
    let start = read_start(table, name, cameras).ok_or(())?;
    if let StartConfig::Here(Start::Pixel(_)) = start.value {
        let message = "is a pixel, but the target is searched for; remove start, or give start.gaussian or start.track";
        table.problem("start", message);
        return Err(());
    }
    Ok(Some(start))
}
