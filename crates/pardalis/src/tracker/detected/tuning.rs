//! Tuned constants of detected targets, with units and origins.
//!
//! "Hand-set" constants were chosen by hand and not fitted. How much results depend on the settings that scenes can change is recorded in
//! `experiments/sensitivity`; these constants are not swept there.

/// Targets appear anywhere in a cube with sides of this many diameters: the birth density is one over its volume. Hand-set: a 0.2 m ball within 10 m.
pub(super) const BIRTH_DIAMETERS: f64 = 50.0;
/// Standard deviation of a new target's velocity on each axis, m/s. Hand-set: walking pace to a slow throw.
pub(super) const BIRTH_VELOCITY_SIGMA_MPS: f64 = 1.5;
/// Before the first frames a target may have appeared for this long, seconds. Hand-set.
pub(super) const TIME_BEFORE_START_S: f64 = 2.0;

/// Log-likelihood ratio, in nats, of a frame in which a visible target is nowhere near a detection: how often the colours of a target that is there are not
/// recognised. Hand-set: once in a thousand frames.
pub(super) const MISSED_NATS: f32 = -7.0;
/// The log-likelihood ratio that the edge cue gives to particles outside a camera's image. Derivation: such a frame says nothing.
pub(super) const OUT_OF_VIEW_LOG_RATIO: f32 = 0.0;

/// The number of detections kept per instant. Hand-set: bounds the time of the update.
pub(super) const MAX_DETECTIONS: usize = 6;
/// Detections with a smaller log-likelihood ratio are dropped, nats: an outline anywhere nearby would do as well. Hand-set.
pub(super) const MIN_LOG_RATIO: f64 = 0.5;
/// Detections closer than this are one, in diameters. Hand-set.
pub(super) const DISTINCT_DIAMETERS: f64 = 0.25;
/// Whole images are searched at least once in this many frame sets. Hand-set: bounds how long a wrong track goes unchallenged.
pub(super) const FRAMES_BETWEEN_SEARCHES: u32 = 10;
/// A detection near the prediction with a greater log-likelihood ratio makes the search unnecessary, nats. Hand-set.
pub(super) const SURE_LOG_RATIO: f64 = 12.0;
/// Above this probability of existence the search may be skipped. Hand-set.
pub(super) const SURE_EXISTENCE: f64 = 0.9;
/// Above this probability of existence the target is looked for near its prediction. Hand-set.
pub(super) const MIN_PREDICTED_EXISTENCE: f64 = 0.1;

/// Clutter (things that look like the target) per frame, over all places where targets appear. Hand-set.
pub(super) const CLUTTER_PER_FRAME: f64 = 0.1;
/// The log-likelihood ratio of target against clutter, nats: the smallest and the greatest, ... Hand-set.
pub(super) const LOG_RATIO_NATS: [f64; 2] = [-5.0, 15.0];
/// ... rising by one per this many nats of the edge cue's log-likelihood ratio per camera. Hand-set: pixels are not independent.
pub(super) const LOG_RATIO_SCALE: f64 = 1.5;
/// By how many nats a detection is less likely the target if none of its outline shows the target's colours, in proportion for parts. Hand-set.
pub(super) const OCCLUDED_COLOR_NATS: f64 = 12.0;
/// The greatest standard deviation of a detection along any axis, in diameters: the depth of a small body is measured no worse. Hand-set.
pub(super) const MAX_SIGMA_DIAMETERS: f64 = 5.0;
/// The landmarks of one target lie within this distance of one another, in diameters, ... Hand-set.
pub(super) const LANDMARK_REACH_DIAMETERS: f64 = 10.0;
/// ... and a detection farther from another landmark is less likely one of them by this many nats. Hand-set.
pub(super) const STRAY_LANDMARK_NATS: f64 = 8.0;

/// The confidence from which a target is found: its distance may be less certain than a diameter. Hand-set.
pub(super) const FOUND_CONFIDENCE: f64 = 0.25;
/// Below this confidence a target is lost. Hand-set.
pub(super) const LOST_CONFIDENCE: f64 = 0.01;

/// From this confidence on a target is certain enough to learn from. Hand-set.
pub(super) const CERTAIN_CONFIDENCE: f64 = 0.9;
/// The time constant of adaptation to illumination, seconds. Hand-set: lamps change faster, clouds slower.
pub(super) const ADAPTATION_S: f64 = 0.5;
/// The time constant with which illumination is forgotten while the target is not seen, seconds. Hand-set.
pub(super) const FORGETTING_S: f64 = 10.0;
/// How far illumination may differ from that in which the colours were learnt: ln of brightness, and warmth. Hand-set: a factor of 3.3.
pub(super) const MAX_ILLUMINATION: [f64; 2] = [1.2, 0.4];
/// How far the target's may differ from that of its whole image, by shadows and lamps: ln of brightness, and warmth. Hand-set. Any further change of the target
/// alone is not illumination.
pub(super) const MAX_LOCAL_ILLUMINATION: [f64; 2] = [0.2, 0.05];
