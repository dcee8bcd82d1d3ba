//! Settings of targets.

use super::existence::ExistenceSettings;
use crate::color::ColorModel;
use crate::likelihood::{ContourSettings, Cue, CueSettings, EdgeSettings};
use crate::shape::{Shape, Sphere, SphereOutline};
use crate::start::Start;
use crate::tuning::Tuning;
use pardalis_core::Error;
use pardalis_filter::gaussian::GaussianStart;
use pardalis_filter::motion::{ConstantVelocity, Motion};
use pardalis_filter::particle_filter::FilterSettings;

/// A target: a body, or several landmarks of one that are tracked separately (Campos 2009, section 4).
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct TargetSettings {
    /// The body or the landmarks; their mean is the target's position.
    pub bodies: Vec<BodySettings>,
    /// The indices of the front and the rear landmark, if the target has a heading.
    pub heading: Option<[usize; 2]>,
}

impl TargetSettings {
    /// Returns a target of several landmarks, without a heading.
    pub fn of_landmarks(landmarks: Vec<BodySettings>) -> Self {
        Self {
            bodies: landmarks,
            heading: None,
        }
    }
}

impl<B: Into<BodySettings>> From<B> for TargetSettings {
    fn from(body: B) -> Self {
        Self {
            bodies: vec![body.into()],
            heading: None,
        }
    }
}

/// One of the two ways in which a body or landmark is tracked.
#[derive(Debug, Clone)]
#[allow(clippy::large_enum_variant)] // settings are few, and made once
pub enum BodySettings {
    /// The tracker detects the target itself.
    Detected(DetectedSettings),
    /// The published cues track the target from a given start.
    Initialized(InitializedSettings),
}

impl BodySettings {
    /// Returns the body's shape.
    pub fn shape(&self) -> &Shape {
        match self {
            Self::Detected(settings) => &settings.shape,
            Self::Initialized(settings) => &settings.shape,
        }
    }
}

impl From<DetectedSettings> for BodySettings {
    fn from(settings: DetectedSettings) -> Self {
        Self::Detected(settings)
    }
}

impl From<InitializedSettings> for BodySettings {
    fn from(settings: InitializedSettings) -> Self {
        Self::Initialized(settings)
    }
}

/// A body that the tracker detects itself, with the edge cue and a Bernoulli filter.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct DetectedSettings {
    /// Its shape.
    pub shape: Shape,
    /// Its colours.
    pub colors: ColorModel,
    /// The edge cue.
    pub edge: EdgeSettings,
    /// Motion model: white noise on velocity or position; see
    /// [`BernoulliFilter::new`](pardalis_filter::bernoulli::BernoulliFilter::new).
    pub motion: Motion,
    /// The number of particles.
    pub particle_count: usize,
    /// Rates of appearance, disappearance and occlusion.
    pub existence: ExistenceSettings,
    /// The position at first, if it is known.
    pub start: Option<GaussianStart>,
    /// Tuned constants, for sensitivity studies; they may change in any release.
    pub tuning: Tuning,
}

impl DetectedSettings {
    /// The default number of particles. Few suffice, because they are drawn at detections.
    pub const PARTICLE_COUNT: usize = 500;

    /// Returns the default settings for a ball with a radius in metres.
    ///
    /// Returns an error unless the radius is above 0 and at most 1000 m.
    pub fn ball(radius_m: f64, colors: ColorModel) -> Result<Self, Error> {
        let ball = Sphere::new(radius_m, SphereOutline::Tangent)?;
        Ok(Self::new(Shape::Sphere(ball), colors))
    }

    /// Returns the default settings for a body of this shape and these colours.
    pub fn new(shape: Shape, colors: ColorModel) -> Self {
        Self {
            shape,
            colors,
            edge: EdgeSettings::default(),
            motion: on_ground(ConstantVelocity::BETWEEN_VELOCITY_JUMPS.into(), &shape),
            particle_count: Self::PARTICLE_COUNT,
            existence: ExistenceSettings::default(),
            start: None,
            tuning: Tuning::default(),
        }
    }
}

/// A body that the published cues track from a given start.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct InitializedSettings {
    /// Its shape.
    pub shape: Shape,
    /// Its colours; not needed by cues with settings for colours of their own.
    pub colors: Option<ColorModel>,
    /// At least one cue.
    pub cues: Vec<CueSettings>,
    /// Its particle filter.
    pub filter: FilterSettings,
    /// The start of its particles.
    pub start: Start,
}

impl InitializedSettings {
    /// Returns the default settings for a body of this shape: the contour cue and 2000 particles. `colors` is `None`
    /// for cues that need none.
    pub fn new(shape: Shape, colors: Option<ColorModel>, start: Start) -> Self {
        let mut filter = FilterSettings::default();
        filter.motion = on_ground(filter.motion, &shape);
        Self {
            shape,
            colors,
            cues: vec![Cue::Contour(ContourSettings::of_shape(&shape)).into()],
            filter,
            start,
        }
    }
}

/// Returns the default motion of a shape: upright and flat ones stay on the ground.
fn on_ground(motion: Motion, shape: &Shape) -> Motion {
    match shape {
        Shape::Upright(_) | Shape::Flat(_) => motion.in_plane(),
        Shape::Sphere(_) => motion,
    }
}
