//! The targets of a scene.

use super::appearance::{CuesConfig, read_cues};
use super::camera_names::CameraNames;
use super::crossing::{CrossingConfig, read_crossing};
use super::description::{Presence, above};
use super::detector::{DetectorConfig, read_detector};
use super::existence::read_existence;
use super::motion::read_motion;
use super::reader::{Located, Table};
use super::setting::Word;
use super::shape::{ShapeConfig, read_shape};
use super::start::{StartConfig, read_start};
use pardalis::color::ColorModel;
use pardalis::likelihood::{ContourSettings, Cue, CueSettings, EdgeSettings};
use pardalis::shape::Shape;
use pardalis::start::Start;
use pardalis::tracker::{
    BodySettings, BoxedSettings, DetectedSettings, ExistenceSettings, InitializedSettings,
    SizeTolerance, TargetSettings,
};
use pardalis_core::Error;
use pardalis_filter::bernoulli::{ParticleRange, check_motion};
use pardalis_filter::gaussian::GaussianStart;
use pardalis_filter::motion::{ConstantVelocity, Motion};
use pardalis_filter::particle_filter::{FilterSettings, MAX_PARTICLES};
use pardalis_filter::resample::Resampling;

/// One target of a scene.
#[derive(Debug, Clone, PartialEq)]
pub struct TargetConfig {
    /// Its name.
    pub name: String,
    /// Its single body, which has its name, or its landmarks.
    pub bodies: Vec<BodyConfig>,
    /// The indices of its landmarks `front` and `rear`, if it has both.
    pub heading: Option<[usize; 2]>,
    /// If there may be any number of them, the most that are tracked at once.
    pub crowd: Option<usize>,
    /// The plane that it is predicted to cross when it flies.
    pub crossing: Option<CrossingConfig>,
    /// The file with what other sensors measure of it.
    pub measurements: Option<Located<String>>,
}

/// How many targets of a kind there are.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Count {
    One,
    Any,
}

impl Word for Count {
    const WORDS: &'static [(&'static str, Self)] = &[("one", Self::One), ("any", Self::Any)];
}

/// The body of a target, or one of its landmarks.
#[derive(Debug, Clone, PartialEq)]
pub struct BodyConfig {
    /// Its name.
    pub name: String,
    /// Its shape.
    pub shape: Shape,
    /// How well its size is known.
    pub size: SizeTolerance,
    /// The file with its colours; `None` if no cue needs it.
    pub colors: Option<Located<String>>,
    /// Whether its yaw is estimated, if it is not round.
    pub turns: bool,
    /// How it is tracked.
    pub tracking: TrackingConfig,
}

/// One of the ways to track a body.
#[derive(Debug, Clone, PartialEq)]
pub enum TrackingConfig {
    /// The tracker detects the target itself.
    Detected {
        /// The edge cue.
        edge: EdgeSettings,
        /// Another program's detector beside it.
        detector: Option<DetectorConfig>,
        /// Its motion model.
        motion: Motion,
        /// The numbers of particles.
        particles: ParticleRange,
        /// How it appears, disappears and becomes occluded.
        existence: ExistenceSettings,
        /// Its initial position, if known, with its position in the scene file.
        start: Option<Located<StartConfig>>,
    },
    /// Published cues track it from a given start.
    Initialized {
        /// The cues.
        cues: Vec<CueSettings>,
        /// Its particle filter.
        filter: FilterSettings,
        /// The start of its particles, with its position in the scene file.
        start: Located<StartConfig>,
    },
    /// Another program alone detects it.
    Boxed {
        /// The detector.
        detector: DetectorConfig,
        /// Its motion model.
        motion: Motion,
        /// The numbers of particles.
        particles: ParticleRange,
        /// How it appears, disappears and becomes occluded.
        existence: ExistenceSettings,
        /// Its initial position, if known, with its position in the scene file.
        start: Option<Located<StartConfig>>,
    },
}

/// The settings that the bodies of a target share, before their starts are read.
enum Shared {
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
const WITHOUT_DETECTOR: [&str; 5] = ["contour", "window", "region", "difference", "landmarks"];

impl TargetConfig {
    /// Reads one target. Returns `None` after reporting a problem to the journal.
    #[allow(clippy::too_many_lines)] // one table, read from top to bottom
    pub(super) fn read(name: String, table: Table, cameras: &CameraNames) -> Option<Self> {
        let about = "Landmarks on the target, two or more, each with its own `colors`, `start` and optionally `shape`. Landmarks named `front` and `rear` determine the heading of the target.";
        let landmarks = table.named_tables("landmarks", about, Presence::Optional(""));
        let has_landmarks = table.has("landmarks") || table.is_describing();
        // Each landmark may have its own shape.
        let shape = (!has_landmarks || table.has("shape") || table.is_describing())
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
        let typical = typical.map(|config| config.shape);
        let has_start =
            table.has("start") || landmarks.iter().any(|(_, landmark)| landmark.has("start"));
        let cues = read_cues(&table, typical.as_ref(), &cameras.all, has_start);
        let detector = read_detector(&table);
        let has_detector = table.has("detector") && !table.is_describing();
        // With colours, it is beside the tracker's own cue.
        let is_boxed = has_detector && !table.has("colors");
        if has_detector {
            let without_colors = is_boxed.then_some("edge");
            for key in WITHOUT_DETECTOR.into_iter().chain(without_colors) {
                if table.knows(key) {
                    table.conflict(key, "detector");
                }
            }
        }
        let shared = if is_boxed {
            Some(read_boxed(&table, typical.as_ref(), detector))
        } else {
            read_shared(&table, typical.as_ref(), cues, detector)
        };
        let motion = match &shared {
            Some(Shared::Detected { motion, .. } | Shared::Boxed { motion, .. }) => *motion,
            Some(Shared::Initialized { filter, .. }) => filter.map(|filter| filter.motion),
            None => None,
        };
        if matches!(typical, Some(Shape::Flat(_)))
            && motion.is_some_and(|motion| !motion.is_planar())
        {
            let message = "lets a flat shape leave the ground; give planar_constant_velocity, planar_random_walk or planar_constant_acceleration";
            table.problem("motion", message);
        }
        let body = |name: String, table: &Table, config: Option<ShapeConfig>| {
            let shape = config.map(|config| config.shape);
            if let (Some(config), Some(shared)) = (&config, &shared) {
                shared.check_size(table, config, cameras.all.len());
            }
            let colors = table
                .key("colors", "Colour model of the target, made by `pardalis learn`. Relative to this file.")
                .depends("unless the target has a detector, only the difference cue, or the window cue with `hue_deg`")
                .located_conditional();
            // Invalid cues report their own problems.
            let needs_colors = shared.as_ref().is_some_and(Shared::needs_colors);
            if !table.has("colors") && needs_colors {
                let message = "is missing; give a colour model, made by `pardalis learn`, or, for the window cue alone, window.hue_deg and window.saturation";
                table.problem("colors", message);
            }
            // If the landmarks share a shape, the cue's own table reports it.
            let has_form = matches!(shape, Some(Shape::Sphere(_) | Shape::Upright(_)));
            let needs_flat_shape = shared.as_ref().is_some_and(Shared::needs_flat_shape);
            if has_form && needs_flat_shape {
                let message = "is not flat, but the cues region and difference apply to flat targets only; give shape.disc or shape.rectangle, or remove these cues";
                table.problem("shape", message);
            }
            let tracking = match &shared {
                Some(shared) => shared.with_start(table, &name, &cameras.all),
                // The start is read anyway, to report its problems.
                None => read_start(table, &name, &cameras.all).and(None),
            };
            Some(BodyConfig {
                name,
                shape: shape?,
                size: config?.size,
                turns: config?.turns.unwrap_or(true),
                colors,
                tracking: tracking?,
            })
        };
        if table.is_describing() {
            body(name.clone(), &table, shape);
        }
        let (bodies, heading) = if has_landmarks {
            for key in ["colors", "start"] {
                if table.knows(key) {
                    table.problem(
                        key,
                        "cannot be combined with landmarks; move it into each landmark",
                    );
                }
            }
            let names: Vec<String> = landmarks.iter().map(|(name, _)| name.clone()).collect();
            if names.len() == 1 {
                let message =
                    "has one; give two or more, or move its settings into the target itself";
                table.problem("landmarks", message);
            }
            let mut bodies = Vec::new();
            for ((name, landmark), shape) in landmarks.into_iter().zip(own_shapes) {
                bodies.push(body(name, &landmark, shape));
                let start = bodies.last().and_then(|body| body.as_ref()?.start());
                if start.is_some_and(|start| matches!(start.value, StartConfig::Track(_))) {
                    let message = "is a track, which does not contain the positions of landmarks; give start.gaussian or start.pixel";
                    landmark.problem("start", message);
                }
                landmark.finish();
            }
            (bodies, read_heading(&table, &names))
        } else {
            (vec![body(name.clone(), &table, shape)], None)
        };
        let crowd = read_crowd(&table, has_landmarks, shared.as_ref());
        let crossing = read_crossing(&table);
        if crossing.is_some() && !table.is_describing() {
            check_crossing(&table, has_landmarks, shared.as_ref());
        }
        let measurements =
            read_measurements(&table, has_landmarks || crowd.is_some(), shared.as_ref());
        table.finish();
        Some(Self {
            name,
            bodies: bodies.into_iter().collect::<Option<_>>()?,
            heading,
            crowd,
            crossing,
            measurements,
        })
    }

    /// Returns its settings, given those of its bodies.
    pub fn settings(&self, bodies: Vec<BodySettings>) -> TargetSettings {
        match (&bodies[..], self.crowd) {
            ([BodySettings::Detected(body)], Some(most)) => {
                return TargetSettings::crowd(body.clone(), most);
            }
            ([BodySettings::Boxed(body)], Some(most)) => {
                return TargetSettings::boxed_crowd(body.clone(), most);
            }
            _ => {}
        }
        let mut settings = TargetSettings::of_landmarks(bodies);
        settings.heading = self.heading;
        settings
    }
}

/// Reports targets of which no flight is measured.
fn check_crossing(table: &Table, has_landmarks: bool, shared: Option<&Shared>) {
    let message = match shared {
        _ if has_landmarks => "is given, but a target with landmarks does not fly; remove it",
        Some(Shared::Initialized { .. }) => {
            "is given, but the published cues, which a start selects, measure no single positions; remove them and the start, or add edge = {}, or remove this"
        }
        Some(
            Shared::Detected {
                motion: Some(motion),
                ..
            }
            | Shared::Boxed {
                motion: Some(motion),
                ..
            },
        ) if motion.is_planar() => {
            "is given, but the target stays on the ground; give a motion in space, or remove this"
        }
        _ => return,
    };
    table.problem("crossing", message);
}

/// Reads the file of what other sensors measure. A target of several bodies has none.
fn read_measurements(
    table: &Table,
    has_bodies: bool,
    shared: Option<&Shared>,
) -> Option<Located<String>> {
    let measurements = table
        .key("measurements", "File of what other sensors measure of the target: positions, velocities, ranges and bearings in the world, each at a time of its own. Relative to this file.")
        .depends("none")
        .located()?;
    let message = match shared {
        _ if has_bodies => {
            "does not say which landmark or member of a crowd is measured; remove it, or give one target for each"
        }
        Some(Shared::Initialized { .. }) => {
            "needs a target that is searched for; remove the published cues and the start, or add edge = {}, or remove this"
        }
        _ => return Some(measurements),
    };
    table.problem("measurements", message);
    None
}

/// Reads how many of the target there are; if any number, returns the most at once.
fn read_crowd(table: &Table, has_landmarks: bool, shared: Option<&Shared>) -> Option<usize> {
    let count = table
        .key("count", "How many there are: one, or any number that look alike, a crowd; for a known number, give one target for each. Each member of a crowd has rows of its own while it is there: `NAME-1`, `NAME-2` and so on, in the order in which they are found.")
        .word(Count::One);
    let most = table
        .key("max_count", "The most members of a crowd at once. More cost time, if there are as many things that look like the target.")
        .within(1.0..=1000.0)
        .or(TargetSettings::MOST);
    if count != Some(Count::Any) {
        if table.has("max_count") && !table.is_describing() {
            table.problem(
                "max_count",
                "is only for count = \"any\"; add that, or remove it",
            );
        }
        return None;
    }
    if has_landmarks && !table.is_describing() {
        table.problem("count", "is \"any\", but a crowd has no landmarks; give count = \"one\", or a target without landmarks");
    }
    match shared {
        _ if table.has("start") && !table.is_describing() => {
            table.problem("count", "is \"any\", but a start is that of one target; remove start, or give one target for each");
        }
        Some(Shared::Detected {
            detector: Some(_), ..
        }) => {
            let message = "is \"any\", but boxes beside colours are those of one target; remove the detector, or the colours";
            table.problem("count", message);
        }
        Some(Shared::Initialized { .. }) => {
            let message = "is \"any\", but the published cues follow one target from its start; remove them, so that the targets are detected";
            table.problem("count", message);
        }
        _ => {}
    }
    Some(most)
}

/// Returns the landmarks `front` and `rear`, which a heading needs.
fn read_heading(table: &Table, landmarks: &[String]) -> Option<[usize; 2]> {
    let [front, rear] = ["front", "rear"].map(|name| landmarks.iter().position(|l| l == name));
    if front.is_some() != rear.is_some() {
        let message = "has one of `front` and `rear`; a heading needs both, so there is none";
        table.warn("landmarks", message);
    }
    Some([front?, rear?])
}

impl BodyConfig {
    /// Returns its start, if the scene states one.
    pub fn start(&self) -> Option<&Located<StartConfig>> {
        match &self.tracking {
            TrackingConfig::Detected { start, .. } | TrackingConfig::Boxed { start, .. } => {
                start.as_ref()
            }
            TrackingConfig::Initialized { start, .. } => Some(start),
        }
    }

    /// Returns the published cues; empty if the tracker detects the body itself.
    pub fn cues(&self) -> &[CueSettings] {
        match &self.tracking {
            TrackingConfig::Detected { .. } | TrackingConfig::Boxed { .. } => &[],
            TrackingConfig::Initialized { cues, .. } => cues,
        }
    }

    /// Returns its motion model.
    pub fn motion(&self) -> &Motion {
        match &self.tracking {
            TrackingConfig::Detected { motion, .. } | TrackingConfig::Boxed { motion, .. } => {
                motion
            }
            TrackingConfig::Initialized { filter, .. } => &filter.motion,
        }
    }

    /// Returns the greatest number of its particles.
    pub fn particle_count(&self) -> usize {
        match &self.tracking {
            TrackingConfig::Detected { particles, .. }
            | TrackingConfig::Boxed { particles, .. } => particles.max,
            TrackingConfig::Initialized { filter, .. } => filter.particle_count,
        }
    }

    /// Returns whether its motion model has a velocity.
    pub fn has_velocity(&self) -> bool {
        let motion = match &self.tracking {
            TrackingConfig::Detected { motion, .. } | TrackingConfig::Boxed { motion, .. } => {
                motion
            }
            TrackingConfig::Initialized { filter, .. } => &filter.motion,
        };
        motion.orders() > 1
    }

    /// Returns the class of its boxes, if another program detects it.
    pub fn class(&self) -> Option<&str> {
        match &self.tracking {
            TrackingConfig::Boxed { detector, .. }
            | TrackingConfig::Detected {
                detector: Some(detector),
                ..
            } => Some(detector.class.as_deref().unwrap_or(&self.name)),
            _ => None,
        }
    }

    /// Returns its settings, given the contents of its files.
    ///
    /// Errors: a detected body without colours or with a pixel as start, an initialised one without start.
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
                detector,
                motion,
                particles,
                existence,
                ..
            } => {
                let start = position_of(start)?;
                let no_colors = || missing("the edge cue's colour model", "learn one");
                let colors = colors.ok_or_else(no_colors)?;
                let mut settings = DetectedSettings::new(self.shape, colors);
                settings.size = self.size;
                settings.turns = self.turns;
                settings.edge = *edge;
                settings.detector = detector.as_ref().map(|detector| detector.settings);
                settings.motion = *motion;
                settings.particles = *particles;
                settings.existence = *existence;
                settings.start = start;
                Ok(settings.into())
            }
            TrackingConfig::Initialized { cues, filter, .. } => {
                let no_start = || missing("the start", "give a position or a pixel");
                let start = start.ok_or_else(no_start)?;
                let mut settings = InitializedSettings::new(self.shape, colors, start);
                settings.cues.clone_from(cues);
                settings.filter = *filter;
                Ok(settings.into())
            }
            TrackingConfig::Boxed {
                detector,
                motion,
                particles,
                existence,
                ..
            } => {
                let mut settings = BoxedSettings::new(self.shape);
                settings.detector = detector.settings;
                settings.motion = *motion;
                settings.particles = *particles;
                settings.existence = *existence;
                settings.start = position_of(start)?;
                Ok(settings.into())
            }
        }
    }

    /// Returns its contour cue, if it has one.
    pub fn contour(&self) -> Option<&ContourSettings> {
        self.cues().iter().find_map(|cue| match &cue.cue {
            Cue::Contour(contour) => Some(contour),
            _ => None,
        })
    }
}

/// Returns the start of a target that is searched for.
///
/// Errors: it is a pixel.
fn position_of(start: Option<Start>) -> Result<Option<GaussianStart>, Error> {
    match start {
        Some(Start::Gaussian(start)) => Ok(Some(start)),
        Some(Start::Pixel(_)) => {
            let allowed = "none or a position for detected targets";
            Err(Error::out_of_range("start", "a pixel", allowed))
        }
        None => Ok(None),
    }
}

impl Shared {
    fn needs_colors(&self) -> bool {
        match self {
            Self::Detected { .. } => true,
            Self::Boxed { .. } => false,
            Self::Initialized { cues, .. } => {
                cues.iter().any(|cue| !cue.cue.works_without_color_model())
            }
        }
    }

    fn needs_flat_shape(&self) -> bool {
        match self {
            Self::Detected { .. } | Self::Boxed { .. } => false,
            Self::Initialized { cues, .. } => cues.iter().any(|cue| cue.cue.needs_flat_shape()),
        }
    }

    /// Reports sizes that cannot be estimated with this number of cameras.
    fn check_size(&self, table: &Table, config: &ShapeConfig, cameras: usize) {
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
    fn with_start(&self, table: &Table, name: &str, cameras: &[String]) -> Option<TrackingConfig> {
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
fn read_shared(
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
        Some(CuesConfig::Edge(edge)) => Some(Shared::Detected {
            edge,
            detector,
            motion: read_detected_motion(table, shape, ConstantVelocity::BETWEEN_VELOCITY_JUMPS),
            particles: read_detected_particles(table),
            existence: read_existence(table, ExistenceSettings::default()),
        }),
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
fn read_boxed(table: &Table, shape: Option<&Shape>, detector: Option<DetectorConfig>) -> Shared {
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
    Shared::Boxed {
        detector,
        motion: read_detected_motion(table, shape, motion),
        particles: read_detected_particles(table),
        existence: read_existence(table, existence),
    }
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

/// Description of the table `filter`.
const ABOUT_FILTER: &str = "The particle filter.";

/// Reads the numbers of particles of a detected target.
fn read_detected_particles(table: &Table) -> ParticleRange {
    let default = DetectedSettings::PARTICLES;
    let particles = table.section("filter", ABOUT_FILTER, |filter| {
        let max = read_particles(filter, default.max);
        let min = read_min_particles(filter, max);
        for key in ["resampling", "resample_below"] {
            if filter.knows(key) {
                let message =
                    "has no effect on a detected target, whose filter resamples differently";
                filter.warn(key, message);
            }
        }
        Some(ParticleRange { min, max })
    });
    particles.unwrap_or(default)
}

/// Reads the least number of particles of a target that has up to `max`.
fn read_min_particles(filter: &Table, max: usize) -> usize {
    let min = filter
        .key(
            "min_particles",
            "Number of particles with which an update begins, for a target with the edge cue or a detector. Where too few of them agree with the images, more are drawn, up to `particles`. Fewer are faster, and velocities noisier.",
        )
        .within(1.0..=MAX_PARTICLES as f64)
        .depends("as many as `particles`")
        .or(max);
    if min > max {
        let message =
            format!("is {min}, and there are at most {max}; raise particles, or lower this");
        filter.problem("min_particles", message);
    }
    min
}

fn read_particles(filter: &Table, default: usize) -> usize {
    filter
        .key(
            "particles",
            "Number of particles; the greatest, for a target with the edge cue or a detector.",
        )
        .within(1.0..=MAX_PARTICLES as f64)
        .depends("2000; 500 for a target with the edge cue or a detector")
        .or(default)
}

fn read_filter(table: &Table, shape: Option<&Shape>) -> Option<FilterSettings> {
    let default = FilterSettings::default();
    let motion = read_motion(table, shape, ConstantVelocity::DEFAULT);
    let settings = table.section("filter", ABOUT_FILTER, |filter| {
        let particle_count = read_particles(filter, default.particle_count);
        if filter.is_describing() {
            read_min_particles(filter, particle_count);
        } else if filter.knows("min_particles") {
            let message = "has no effect on a target with published cues, whose number of particles is constant";
            filter.warn("min_particles", message);
        }
        let resampling = filter
            .key("resampling", "Resampling scheme.")
            .word(default.resampling);
        let resample_below = filter
            .key(
                "resample_below",
                "Resample when the effective sample size falls to this share of the particles; 1 resamples at every step.",
            )
            .within(above(0.0, 1.0))
            .or(default.resample_below);
        let mut settings = default;
        settings.particle_count = particle_count;
        settings.resampling = resampling?;
        settings.resample_below = resample_below;
        Some(settings)
    });
    let settings = if table.has("filter") {
        settings
    } else {
        Some(default)
    };
    let mut settings = settings?;
    settings.motion = motion?;
    Some(settings)
}

impl Word for Resampling {
    const WORDS: &'static [(&'static str, Self)] = &[
        ("systematic", Self::Systematic),
        ("stratified", Self::Stratified),
        ("residual", Self::Residual),
        ("multinomial", Self::Multinomial),
    ];
}
