//! The bodies of targets: a single one, or landmarks.

use super::detector::DetectorConfig;
use super::reader::Located;
use super::start::StartConfig;
use pardalis::color::ColorModel;
use pardalis::likelihood::{ContourSettings, Cue, CueSettings, EdgeSettings};
use pardalis::shape::Shape;
use pardalis::start::Start;
use pardalis::tracker::{
    BodySettings, BoxedSettings, DetectedSettings, ExistenceSettings, InitializedSettings,
    SizeTolerance,
};
use pardalis_core::Error;
use pardalis_filter::bernoulli::ParticleRange;
use pardalis_filter::gaussian::GaussianStart;
use pardalis_filter::motion::Motion;
use pardalis_filter::particle_filter::FilterSettings;

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
