//! What targets are and how they are tracked.

use super::existence::ExistenceSettings;
use crate::color::ColorModel;
use crate::likelihood::{ContourSettings, Cue, CueSettings, EdgeSettings};
use crate::shape::{Shape, Sphere, SphereOutline};
use crate::start::Start;
use pardalis_core::Error;
use pardalis_filter::gaussian::GaussianStart;
use pardalis_filter::motion::{ConstantVelocity, Motion};
use pardalis_filter::particle_filter::FilterSettings;

/// A target: a body, or several landmarks of one, each of which is tracked on its own (Campos 2009, section 4).
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct TargetSettings {
    /// The body or the landmarks; their mean is the target's position.
    pub bodies: Vec<BodySettings>,
    /// The numbers of the landmarks in front and behind, if the target has a heading.
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
pub enum BodySettings {
    /// The tracker detects the target itself.
    Detected(DetectedSettings),
    /// The published cues track it from a given start.
    Initialized(InitializedSettings),
}

impl BodySettings {
    /// The body's shape.
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

/// A body that the tracker detects itself: by the edge cue and a Bernoulli filter.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct DetectedSettings {
    /// Its shape.
    pub shape: Shape,
    /// Its colours.
    pub colors: ColorModel,
    /// The edge cue.
    pub edge: EdgeSettings,
    /// How it moves: white noise on velocity or position ([`BernoulliFilter::new`](pardalis_filter::bernoulli::BernoulliFilter::new)).
    pub motion: Motion,
    /// The number of particles.
    pub particle_count: usize,
    /// How it appears, disappears and becomes occluded.
    pub existence: ExistenceSettings,
    /// Where it is at first, if that is known.
    pub start: Option<GaussianStart>,
}

impl DetectedSettings {
    /// The default number of particles: they are drawn where the images say, so that few suffice.
    pub const PARTICLE_COUNT: usize = 500;

    /// Returns the default settings for a ball with a radius in metres.
    ///
    /// Errors: a radius that is not above 0 and at most 1000 m.
    pub fn ball(radius_m: f64, colors: ColorModel) -> Result<Self, Error> {
        let ball = Sphere::new(radius_m, SphereOutline::Tangent)?;
        Ok(Self::new(Shape::Sphere(ball), colors))
    }

    /// Default settings for a body of this shape and these colours.
    pub fn new(shape: Shape, colors: ColorModel) -> Self {
        Self {
            shape,
            colors,
            edge: EdgeSettings::default(),
            motion: on_ground(ConstantVelocity::BETWEEN_VELOCITY_JUMPS.into(), &shape),
            particle_count: Self::PARTICLE_COUNT,
            existence: ExistenceSettings::default(),
            start: None,
        }
    }
}

/// A body that the published cues track from a given start.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct InitializedSettings {
    /// Its shape.
    pub shape: Shape,
    /// Its colours; cues that know theirs do without.
    pub colors: Option<ColorModel>,
    /// The cues, one at least.
    pub cues: Vec<CueSettings>,
    /// Its particle filter.
    pub filter: FilterSettings,
    /// Where its particles start.
    pub start: Start,
}

impl InitializedSettings {
    /// Returns the default settings for a body of this shape, of these colours if its cues need any: the contour cue and 2000 particles.
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

/// The motion of upright and flat shapes stays on the ground, unless a caller says otherwise.
fn on_ground(motion: Motion, shape: &Shape) -> Motion {
    match shape {
        Shape::Upright(_) | Shape::Flat(_) => motion.in_plane(),
        Shape::Sphere(_) => motion,
    }
}
