//! The detector on one image: as `track` runs it on a first frame, and near an outline that somebody has drawn.

use anyhow::Result;
use pardalis::color::ColorModel;
use pardalis::shape::{Shape, Stance};
use pardalis::tracker::DetectedSettings;
use pardalis::view::View;
use pardalis::{Frame, FrameSet, TargetId, Tracker};

use super::balls::Circle;

/// The radius of the ball, metres. Any would do: with one camera it only scales the distance.
const RADIUS_M: f64 = 0.1;
/// Points of the found outline.
const OUTLINE_POINTS: usize = 72;

/// By how much a fitted outline may differ from a rough one in place and size, as a share of the radius, and at least in pixels. Hand-set: rough ones are off
/// by a tenth, small ones by up to a pixel, and the thin ellipses of mirrors by a quarter.
const ROUGH: (f64, f64) = (0.3, 1.0);

/// By how much outlines are too small that are fitted with the general soft edge, pixels. Origin: the mean over the training images and sequences of the
/// bundled fisheye camera, in which balls darken towards their outline.
const TOO_SMALL_PX: f64 = 0.07;

/// A ball that the detector found.
#[derive(Debug, Clone)]
pub(super) struct Found {
    /// The circle with the centroid and area of the outline.
    pub(super) circle: Circle,
    pub(super) outline_px: Vec<[f64; 2]>,
}

impl Found {
    /// Moves the outline away from its centre by this many pixels.
    fn enlarged(self, by_px: f64) -> Self {
        let Circle {
            center_px,
            radius_px,
        } = self.circle;
        let scale = 1.0 + by_px / radius_px;
        let moved = |at: [f64; 2]| [0, 1].map(|i| center_px[i] + scale * (at[i] - center_px[i]));
        Self {
            circle: Circle {
                center_px,
                radius_px: radius_px + by_px,
            },
            outline_px: self.outline_px.into_iter().map(moved).collect(),
        }
    }
}

/// Whether the detector uses the edge profile of the model, or a general soft edge.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum LearntEdge {
    Used,
    Ignored,
}

/// By how much outlines may deviate from those of the camera, pixels: first as in a track, then by what a guessed camera leaves, since a fisheye lens changes a
/// ball far off its axis by a tenth. The latter alone would take outlines for right that are 5 pixels off those of a ball with a dark side, and find less
/// of what is clear.
const TOLERANCES_PX: [Option<f32>; 2] = [None, Some(1.5)];

/// Detects a ball in a view as in the first frame of a track, with default settings, or else as one of which the camera is a guess.
pub(super) fn detect(
    frame: &Frame,
    model: &ColorModel,
    edge: LearntEdge,
    view: View,
) -> Result<Option<Found>> {
    for tolerance_px in TOLERANCES_PX {
        let (shape, tracker, target) = observed(frame, model, (edge, tolerance_px), view.clone())?;
        let known = tracker.estimate(target)?.kinematics;
        let found = known.and_then(|known| outline_at(&tracker, shape, known.position_m));
        if found.is_some() {
            return Ok(found);
        }
    }
    Ok(None)
}

/// Lets a tracker of a ball observe one frame.
fn observed(
    frame: &Frame,
    model: &ColorModel,
    (edge, tolerance_px): (LearntEdge, Option<f32>),
    view: View,
) -> Result<(Shape, Tracker, TargetId)> {
    let mut ball = DetectedSettings::ball(RADIUS_M, model.clone())?;
    ball.edge.learned_profile = edge == LearntEdge::Used;
    if let Some(tolerance_px) = tolerance_px {
        ball.tuning.edge.judged_tolerance_px = tolerance_px;
    }
    let shape = ball.shape;
    let mut setup = Tracker::builder();
    let camera = setup.camera(view);
    let target = setup.target(ball);
    let mut tracker = setup.build()?;
    tracker.observe(&FrameSet::of(camera, frame.clone()))?;
    Ok((shape, tracker, target))
}

/// Returns the outline of a ball at a position, as the only camera shows it.
fn outline_at(tracker: &Tracker, shape: Shape, position_m: [f64; 3]) -> Option<Found> {
    let view = &tracker.views()[0];
    let stance = Stance::default();
    let (camera, pose) = (view.camera(), view.camera_from_world());
    let outline = shape.outline_px(camera, pose, position_m, stance, OUTLINE_POINTS);
    let outline_px: Vec<[f64; 2]> = outline.into_iter().flatten().collect();
    Circle::of_outline(&outline_px).map(|circle| Found { circle, outline_px })
}

/// Fits the outline of a ball of these colours near a rough outline of it, in a view that shows little else. Nothing need be certain, unlike for [`detect`]:
/// somebody has said that the ball is there.
pub(super) fn fit(
    frame: &Frame,
    model: &ColorModel,
    rough: &Circle,
    view: View,
) -> Result<Option<Found>> {
    for tolerance_px in TOLERANCES_PX {
        let settings = (LearntEdge::Ignored, tolerance_px);
        let (shape, tracker, target) = observed(frame, model, settings, view.clone())?;
        let candidates = tracker.candidates(target)?.flatten();
        let allowed_px = (ROUGH.0 * rough.radius_px).max(ROUGH.1);
        let fits = candidates.filter_map(|candidate| {
            let found = outline_at(&tracker, shape, candidate.position_m?)?;
            let off_px = rough.radii_to(&found.circle) * rough.radius_px;
            let larger_px = found.circle.radius_px - rough.radius_px;
            let is_it = off_px < allowed_px && larger_px.abs() < allowed_px;
            is_it.then_some((candidate.outline_nats?, found))
        });
        if let Some((_, best)) = fits.max_by(|a, b| a.0.total_cmp(&b.0)) {
            return Ok(Some(best.enlarged(TOO_SMALL_PX)));
        }
    }
    Ok(None)
}
