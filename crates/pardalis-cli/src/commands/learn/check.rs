//! The detector on the images that a model was learnt from: whether it finds what was labelled, and whether the labels
//! follow the outlines in the images.

use anyhow::Result;
use pardalis::color::{ColorLearner, ColorModel};
use pardalis::shape::{Shape, Stance};
use pardalis::tracker::DetectedSettings;
use pardalis::view::View;
use pardalis::{Frame, FrameSet, TargetId, Tracker};

use super::balls::{Circle, labelled_balls};
use super::inputs::LabelledFile;

/// The radius of the ball, metres. Any would do: with one camera it only scales the distance.
const RADIUS_M: f64 = 0.1;
/// Points of the found outline.
const OUTLINE_POINTS: usize = 72;
/// Labels that are larger or smaller than the outlines by more than this share ... Hand-set: labels drawn with care on real
/// clips deviate by at most 7 %.
const MAX_LABEL_ERROR: f64 = 0.08;
/// ... and by more than this many pixels are wrong. Hand-set: whole pixels and blur account for less.
const MAX_LABEL_ERROR_PX: f64 = 0.8;

/// Labels whose centres are off those of the outlines by more than this share of the radius, and by more than that many
/// pixels, are wrong. Hand-set: half of the labels drawn with care on 15 real clips are off by at most 5 %, one by 15 %.
const MAX_LABEL_SHIFT: f64 = 0.15;

/// What is found farther from the label, as a share of the radius, is not the labelled ball. Hand-set: labels are rarely off by a quarter.
const MAX_FOUND_SHIFT: f64 = 0.5;

/// By how much a fitted outline may differ from a rough one in place and size, as a share of the radius, and at least in pixels. Hand-set: rough ones are off
/// by a tenth, small ones by up to a pixel, and the thin ellipses of mirrors by a quarter.
#[cfg(feature = "studio")]
const ROUGH: (f64, f64) = (0.3, 1.0);

/// By how much outlines are too small that are fitted with the general soft edge, pixels. Origin: the mean over the training images and sequences of the
/// bundled fisheye camera, in which balls darken towards their outline.
const TOO_SMALL_PX: f64 = 0.07;

/// Circles and polygons that are larger or smaller than the outlines by these shares give way to the outlines, ... Hand-set: labels that are 5 % too large make the colours those of
/// a paler ball, and outlines are right to 2 %.
const FOLLOWED: std::ops::RangeInclusive<f64> = 0.035..=0.25;
/// ... if the shares of the images differ by less than this, and all centres by less than that, in radii. Hand-set: sharp balls on real clips have at most 0.02 and 0.04, blurred ones 0.03 to 0.06 and
/// 0.06 to 0.18.
const FOLLOWED_SPREAD: f64 = 0.025;
const FOLLOWED_SHIFT: f64 = 0.05;

/// What the detector found in each image, in the order of the files.
#[derive(Debug)]
pub(super) struct Check {
    pub(super) images: Vec<ImageCheck>,
}

/// What the detector found in one image.
#[derive(Debug)]
pub(super) enum ImageCheck {
    /// No label is whole and round. The detector was not run.
    NoBall,
    /// The detector was run.
    Ball {
        /// The labelled balls, the one nearest to what was found first.
        labels: Vec<Circle>,
        found: Option<Found>,
        /// The outline in the image near the first label, by its colours alone: the detector without the learnt edge, which
        /// repeats the labels.
        outline: Option<Found>,
    },
}

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

impl Check {
    /// Runs the detector on each image as `track` runs it on a first frame. `learner`
    /// has the palette of the model.
    ///
    /// Errors: an image cannot be read.
    pub(super) fn run(
        files: &[LabelledFile],
        learner: &mut ColorLearner,
        model: &ColorModel,
    ) -> Result<Self> {
        let images = files.iter().map(|file| {
            let (frame, marked) = file.load()?;
            let is_target = learner.target_pixels(&frame, &marked)?;
            let mut labels = labelled_balls(&is_target, frame.width());
            if labels.is_empty() {
                return Ok(ImageCheck::NoBall);
            }
            let found = detect(&frame, model, LearntEdge::Used, file.view(&frame, None)?)?;
            if let Some(Found { circle, .. }) = &found {
                labels.sort_by(|a, b| a.radii_to(circle).total_cmp(&b.radii_to(circle)));
            }
            let outline = detect(&frame, model, LearntEdge::Ignored, file.view(&frame, None)?)?;
            Ok(ImageCheck::Ball {
                outline: outline.filter(|outline| labels[0].radii_to(&outline.circle) <= 1.0),
                labels,
                found,
            })
        });
        Ok(Self {
            images: images.collect::<Result<_>>()?,
        })
    }

    /// Returns the number of images with a labelled ball.
    pub(super) fn ball_count(&self) -> usize {
        let is_ball = |image: &&ImageCheck| matches!(image, ImageCheck::Ball { .. });
        self.images.iter().filter(is_ball).count()
    }

    /// Returns the number of images in which the labelled ball was not found.
    pub(super) fn failures(&self) -> usize {
        let failed = self.images.iter().filter(|image| image.failed());
        failed.count()
    }

    /// Returns by which share the labels are too large, the median; negative if they are too small. `None` if most are
    /// right, or nothing is known.
    pub(super) fn label_error(&self) -> Option<f64> {
        error_of(self.median_of(ImageCheck::size_of_label)?)
    }

    /// Returns how far the labels are off the outlines, the median as a share of the radius. `None` if most are right, or
    /// nothing is known.
    pub(super) fn label_shift(&self) -> Option<f64> {
        shift_of(self.median_of(ImageCheck::offset_of_label)?)
    }

    /// Returns the images with labels along the sharp outlines in them, if all are circles and polygons that are larger than these by the same share, or smaller.
    pub(super) fn followed(&self, files: &[LabelledFile]) -> Option<Vec<LabelledFile>> {
        let pairs = self.images.iter().filter_map(ImageCheck::label_and_outline);
        let of_pair = |(label, outline): (&Circle, &Circle)| {
            let [label_px, outline_px] = [label, outline].map(|circle| circle.radius_px);
            (label_px / outline_px, outline.radii_to(label))
        };
        let (mut sizes, offsets): (Vec<f64>, Vec<f64>) = pairs.map(of_pair).unzip();
        sizes.sort_by(f64::total_cmp);
        let (&least, &most) = (sizes.first()?, sizes.last()?);
        let error = (sizes[sizes.len() / 2] - 1.0).abs();
        // Where outlines are blurred or partly hidden, it is these that are wrong, and each otherwise.
        let are_sharp = sizes.len() > 1
            && most - least < FOLLOWED_SPREAD
            && offsets.iter().all(|offset| *offset < FOLLOWED_SHIFT);
        if !(are_sharp && FOLLOWED.contains(&error)) {
            return None;
        }
        let followed = |(file, image): (&LabelledFile, &ImageCheck)| match image {
            ImageCheck::Ball {
                outline: Some(outline),
                ..
            } => file.with_outline(&outline.clone().enlarged(TOO_SMALL_PX).outline_px),
            _ => Some(file.clone()),
        };
        files.iter().zip(&self.images).map(followed).collect()
    }

    fn median_of(&self, figure: impl Fn(&ImageCheck) -> Option<f64>) -> Option<f64> {
        let mut figures: Vec<f64> = self.images.iter().filter_map(figure).collect();
        figures.sort_by(f64::total_cmp);
        figures.get(figures.len() / 2).copied()
    }
}

impl ImageCheck {
    /// Reports whether the labelled ball was not found: nothing was, or something beside the label.
    pub(super) fn failed(&self) -> bool {
        match self {
            Self::NoBall => false,
            Self::Ball { labels, found, .. } => found
                .as_ref()
                .is_none_or(|found| labels[0].radii_to(&found.circle) > MAX_FOUND_SHIFT),
        }
    }

    /// Returns the outline in the image near the label.
    pub(super) fn outline(&self) -> Option<&Circle> {
        self.label_and_outline().map(|(_, outline)| outline)
    }

    /// Returns what was found.
    pub(super) fn found(&self) -> Option<&Found> {
        match self {
            Self::NoBall => None,
            Self::Ball { found, .. } => found.as_ref(),
        }
    }

    /// Returns by which share the label is too large; negative if it is too small. `None` if it is right, or nothing is
    /// known.
    pub(super) fn label_error(&self) -> Option<f64> {
        error_of(self.size_of_label()?)
    }

    /// Returns how far the label is off the outline, as a share of the radius. `None` if it is right, or nothing is known.
    pub(super) fn label_shift(&self) -> Option<f64> {
        shift_of(self.offset_of_label()?)
    }

    /// Returns the label and the outline in the image near it.
    fn label_and_outline(&self) -> Option<(&Circle, &Circle)> {
        match self {
            Self::Ball {
                labels,
                outline: Some(outline),
                ..
            } => Some((&labels[0], &outline.circle)),
            _ => None,
        }
    }

    /// Returns the distance between the centres of label and outline in radii of the outline; 0 if they hardly differ.
    fn offset_of_label(&self) -> Option<f64> {
        let (label, outline) = self.label_and_outline()?;
        let radii = outline.radii_to(label);
        let differs = radii * outline.radius_px > MAX_LABEL_ERROR_PX;
        Some(if differs { radii } else { 0.0 })
    }

    /// Returns the radius of the label as a multiple of that of the outline; 1 if they hardly differ.
    fn size_of_label(&self) -> Option<f64> {
        let (label, outline) = self.label_and_outline()?;
        let (label_px, outline_px) = (label.radius_px, outline.radius_px);
        let differs = (label_px - outline_px).abs() > MAX_LABEL_ERROR_PX;
        Some(if differs { label_px / outline_px } else { 1.0 })
    }
}

fn error_of(size: f64) -> Option<f64> {
    Some(size - 1.0).filter(|error| error.abs() > MAX_LABEL_ERROR)
}

fn shift_of(offset: f64) -> Option<f64> {
    Some(offset).filter(|offset| *offset > MAX_LABEL_SHIFT)
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
#[cfg(feature = "studio")]
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
