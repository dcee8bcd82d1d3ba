//! Settings of targets.

use super::existence::ExistenceSettings;
use crate::color::ColorModel;
use crate::likelihood::edge::SizePrior;
use crate::likelihood::{ContourSettings, Cue, CueSettings, EdgeSettings};
use crate::shape::{Shape, Sphere, SphereOutline};
use crate::start::Start;
use crate::tuning::Tuning;
use pardalis_core::Error;
use pardalis_filter::bernoulli::ParticleRange;
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
    /// Whether each body is one of a crowd instead, see [`TargetSettings::crowd`].
    pub(super) is_crowd: bool,
}

impl TargetSettings {
    /// The default for the most members of a crowd at once.
    pub const MOST: usize = 50;

    /// Returns a target of several landmarks, without a heading.
    pub fn of_landmarks(landmarks: Vec<BodySettings>) -> Self {
        Self {
            bodies: landmarks,
            heading: None,
            is_crowd: false,
        }
    }

    /// Returns a crowd: any number of bodies that look alike, of which at most this many are tracked at once. They are found when they appear and forgotten when
    /// they are gone; each is a member with a number of its own ([`Tracker::members`](super::Tracker::members_at)).
    pub fn crowd(body: DetectedSettings, most: usize) -> Self {
        Self::crowd_of(body.into(), most)
    }

    /// Returns a crowd of bodies that another program detects; see [`TargetSettings::crowd`].
    pub fn boxed_crowd(body: BoxedSettings, most: usize) -> Self {
        Self::crowd_of(body.into(), most)
    }

    fn crowd_of(body: BodySettings, most: usize) -> Self {
        Self {
            bodies: vec![body; most],
            heading: None,
            is_crowd: true,
        }
    }
}

impl<B: Into<BodySettings>> From<B> for TargetSettings {
    fn from(body: B) -> Self {
        Self {
            bodies: vec![body.into()],
            heading: None,
            is_crowd: false,
        }
    }
}

/// One of the ways in which a body or landmark is tracked.
#[derive(Debug, Clone)]
#[allow(clippy::large_enum_variant)] // settings are few, and made once
pub enum BodySettings {
    /// The tracker detects the target itself.
    Detected(DetectedSettings),
    /// The published cues track the target from a given start.
    Initialized(InitializedSettings),
    /// Another program detects the target, and gives boxes around it.
    Boxed(BoxedSettings),
}

impl BodySettings {
    /// Returns the body's shape.
    pub fn shape(&self) -> &Shape {
        match self {
            Self::Detected(settings) => &settings.shape,
            Self::Initialized(settings) => &settings.shape,
            Self::Boxed(settings) => &settings.shape,
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

impl From<BoxedSettings> for BodySettings {
    fn from(settings: BoxedSettings) -> Self {
        Self::Boxed(settings)
    }
}

/// A body that the tracker detects itself, with the edge cue and a Bernoulli filter.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct DetectedSettings {
    /// Its shape.
    pub shape: Shape,
    /// How well the size of a ball is known; without effect on other shapes.
    pub size: SizeTolerance,
    /// Whether a shape that is not round turns about the vertical. Its yaw is then estimated from its outline, and its heading from the way it moves
    /// ([`Estimate::heading_rad`](super::Estimate::heading_rad)); otherwise it is as its shape describes it. Without effect on round shapes.
    pub turns: bool,
    /// Its colours.
    pub colors: ColorModel,
    /// The edge cue.
    pub edge: EdgeSettings,
    /// Another program's detector whose boxes tell the target from other things of its colours and form; give them with
    /// [`FrameSet::with_boxes`](super::FrameSet::with_boxes). Images without a list of boxes are tracked as without a detector.
    pub detector: Option<DetectorSettings>,
    /// Motion model: white noise on velocity or position; see
    /// [`BernoulliFilter::new`](pardalis_filter::bernoulli::BernoulliFilter::new).
    pub motion: Motion,
    /// The numbers of particles.
    pub particles: ParticleRange,
    /// Rates of appearance, disappearance and occlusion.
    pub existence: ExistenceSettings,
    /// The position at first, if it is known.
    pub start: Option<GaussianStart>,
    /// Tuned constants, for sensitivity studies; they may change in any release.
    pub tuning: Tuning,
}

impl DetectedSettings {
    /// The default numbers of particles. Few suffice, because they are drawn at detections.
    pub const PARTICLES: ParticleRange = ParticleRange::fixed(500);

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
            size: SizeTolerance::default(),
            turns: true,
            colors,
            edge: EdgeSettings::default(),
            detector: None,
            motion: on_ground(ConstantVelocity::BETWEEN_VELOCITY_JUMPS.into(), &shape),
            particles: Self::PARTICLES,
            existence: ExistenceSettings::default(),
            start: None,
            tuning: Tuning::default(),
        }
    }

    /// The prior of the size before the first frames, for this number of cameras.
    ///
    /// Returns an error if the tolerance is out of range, or the size is unknown and these cameras cannot determine it.
    pub(super) fn size_prior(&self, cameras: usize) -> Result<SizePrior, Error> {
        let is_ball = matches!(self.shape, Shape::Sphere(_));
        let sigma = match self.size {
            SizeTolerance::Share(share) if (0.0..=1.0).contains(&share) => share,
            SizeTolerance::Share(share) => {
                return Err(Error::out_of_range("radius_tolerance", share, "0 to 1"));
            }
            SizeTolerance::Unknown if !is_ball => {
                let allowed = "the size of a shape other than a ball: it is not estimated";
                return Err(Error::out_of_range("size", "unknown", allowed));
            }
            SizeTolerance::Unknown if cameras < 2 && !self.motion.is_planar() => {
                let allowed = "the radius: one camera does not tell size from distance, unless the motion is planar";
                return Err(Error::out_of_range("radius_m", "unknown", allowed));
            }
            SizeTolerance::Unknown => SizeTolerance::UNKNOWN_SIGMA,
        };
        Ok(SizePrior {
            log_scale: 0.0,
            sigma: if is_ball { sigma } else { 0.0 },
        })
    }
}

/// How well the size of a detected ball is known beforehand.
///
/// Two or more cameras that see the ball, or one if it stays on the ground, determine its size. The tracker then estimates it
/// ([`Estimate::radius`](super::Estimate::radius)), and a contradiction between cameras and settings does not displace the ball. One camera alone does not
/// tell size from distance: the tolerance then counts in the covariance of the position.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum SizeTolerance {
    /// The standard deviation of the radius as a share of it, 0 to 1; 0 for a radius that is exact. Large deviations are unlikely, but not excluded (the tails are
    /// those of a Cauchy distribution).
    Share(f64),
    /// The radius of the shape is a guess, with which the search begins. Needs several cameras, or planar motion.
    Unknown,
}

impl SizeTolerance {
    /// The default share, 2 %.
    pub const DEFAULT_SHARE: f64 = 0.02;
    /// The standard deviation of the logarithm of an unknown radius. Derivation: ln 10, a guess may be ten times too small or too large.
    const UNKNOWN_SIGMA: f64 = std::f64::consts::LN_10;
}

impl Default for SizeTolerance {
    fn default() -> Self {
        Self::Share(Self::DEFAULT_SHARE)
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

/// A body that another program detects: a neural network, for example. Give its boxes with [`FrameSet::with_boxes`](super::FrameSet::with_boxes); images and colours are not needed.
///
/// Shapes that are not round do not turn. Neither the size nor the errors of cameras are estimated, and rolling shutters are not taken into account.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct BoxedSettings {
    /// Its shape, which makes a distance of the size of its box.
    pub shape: Shape,
    /// The detector's error rates and precision.
    pub detector: DetectorSettings,
    /// Motion model, as in [`DetectedSettings::motion`].
    pub motion: Motion,
    /// The numbers of particles.
    pub particles: ParticleRange,
    /// Rates of appearance, disappearance and occlusion.
    pub existence: ExistenceSettings,
    /// The position at first, if it is known.
    pub start: Option<GaussianStart>,
}

impl BoxedSettings {
    /// Returns the default settings for a body of this shape: a ball flies and bounces as in [`DetectedSettings::new`], others walk or drive.
    pub fn new(shape: Shape) -> Self {
        Self {
            shape,
            detector: DetectorSettings::default(),
            motion: on_ground(Self::motion_of(&shape).into(), &shape),
            particles: DetectedSettings::PARTICLES,
            existence: Self::existence_of(&shape),
            start: None,
        }
    }

    /// Returns how a body of this shape moves.
    pub fn motion_of(shape: &Shape) -> ConstantVelocity {
        match shape {
            Shape::Sphere(_) => ConstantVelocity::BETWEEN_VELOCITY_JUMPS,
            Shape::Upright(_) | Shape::Flat(_) => ConstantVelocity::WALKING,
        }
    }

    /// Returns how a body of this shape appears and disappears: other than balls, nothing is kicked or bounces.
    pub fn existence_of(shape: &Shape) -> ExistenceSettings {
        let mut existence = ExistenceSettings::default();
        if !matches!(shape, Shape::Sphere(_)) {
            existence.velocity_jump_rate_hz = 0.0;
        }
        existence
    }
}

/// Error rates and precision of a detector that gives boxes.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct DetectorSettings {
    /// The probability that it finds a body that nothing hides.
    pub detection_probability: f64,
    /// The mean number of boxes per image that are no such body.
    pub false_per_image: f64,
    /// The standard deviation of each side of a box as a share of its size, the square root of its area.
    pub side_sigma: f64,
    /// The standard deviation of errors of the size that all frames share, as a share of it: of the shape, and of a detector whose boxes are too large or too small.
    pub size_tolerance: f64,
    /// Boxes with a lower score are left out.
    pub min_score: f64,
}

impl Default for DetectorSettings {
    /// A usual neural network.
    fn default() -> Self {
        Self {
            detection_probability: 0.9,
            false_per_image: 0.5,
            side_sigma: 0.05,
            size_tolerance: 0.05,
            min_score: 0.0,
        }
    }
}

impl DetectorSettings {
    /// Returns an error for settings out of range.
    pub fn check(&self) -> Result<(), Error> {
        let check = |name: &str, value: f64, is_allowed: bool, allowed: &str| {
            if is_allowed {
                return Ok(());
            }
            Err(Error::out_of_range(name, value, allowed))
        };
        let Self {
            detection_probability: detected,
            false_per_image: clutter,
            side_sigma: sigma,
            size_tolerance: tolerance,
            min_score,
        } = *self;
        check(
            "detection_probability",
            detected,
            detected > 0.0 && detected <= 0.999,
            "above 0 and at most 0.999",
        )?;
        check(
            "false_per_image",
            clutter,
            clutter > 0.0 && clutter <= 1e4,
            "above 0 and at most 10000",
        )?;
        check(
            "side_sigma",
            sigma,
            sigma > 0.0 && sigma <= 1.0,
            "above 0 and at most 1",
        )?;
        check(
            "size_tolerance",
            tolerance,
            (0.0..=1.0).contains(&tolerance),
            "0 to 1",
        )?;
        check(
            "min_score",
            min_score,
            (0.0..=1.0).contains(&min_score),
            "0 to 1",
        )
    }
}

/// Returns the default motion of a shape: upright and flat ones stay on the ground.
fn on_ground(motion: Motion, shape: &Shape) -> Motion {
    match shape {
        Shape::Upright(_) | Shape::Flat(_) => motion.in_plane(),
        Shape::Sphere(_) => motion,
    }
}
