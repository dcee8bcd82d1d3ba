//! The detector on the images that a model was learnt from: whether it finds what was labelled, and whether the labels
//! follow the outlines in the images.

use anyhow::Result;
use pardalis::color::{ColorLearner, ColorModel};

use super::balls::{Circle, labelled_balls};
use super::detector::{Found, LearntEdge, detect};
use super::inputs::LabelledFile;
use super::label::Label;
use super::outline::near_label;

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

/// Circles and polygons that are larger or smaller than the outlines by these shares give way to the outlines, ... Hand-set: labels that are 5 % too large make the colours those of
/// a paler ball, and outlines are right to 2 %.
const FOLLOWED: std::ops::RangeInclusive<f64> = 0.035..=0.25;
/// ... if the shares of most images are less than this off their median, and the centres less than that off, in radii. Hand-set: sharp balls on real clips have at most 0.02 and 0.06,
/// blurred ones 0.03 to 0.06 and 0.06 to 0.18.
const FOLLOWED_SPREAD: f64 = 0.035;
const FOLLOWED_SHIFT: f64 = 0.07;

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

/// A sharp outline in an image.
struct Sharp {
    outline_px: Vec<[f64; 2]>,
    /// The radius of the label as a multiple of its radius.
    share: f64,
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

    /// Returns the number of images in which a labelled ball was found.
    pub(super) fn found(&self) -> usize {
        self.ball_count() - self.failures()
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

    /// Returns the images with labels along the sharp outlines in them, if most are circles and polygons that are larger than these by the same share, or smaller. The
    /// others are enlarged or reduced by that share.
    ///
    /// Errors: an image cannot be read.
    pub(super) fn followed(&self, files: &[LabelledFile]) -> Result<Option<Vec<LabelledFile>>> {
        let sharp = files.iter().zip(&self.images);
        let sharp: Vec<Option<Sharp>> = sharp
            .map(|(file, image)| image.sharp_outline(file))
            .collect::<Result<_>>()?;
        let mut shares: Vec<f64> = sharp.iter().flatten().map(|sharp| sharp.share).collect();
        shares.sort_by(f64::total_cmp);
        let Some(&median) = shares.get(shares.len() / 2) else {
            return Ok(None);
        };
        // Where outlines are blurred or partly hidden, it is these that are wrong, and each otherwise.
        let agrees = |share: f64| (share - median).abs() < FOLLOWED_SPREAD;
        let agreeing = shares.iter().filter(|share| agrees(**share)).count();
        let are_sharp = agreeing > 1 && 2 * agreeing > self.ball_count();
        if !(are_sharp && FOLLOWED.contains(&(median - 1.0).abs())) {
            return Ok(None);
        }
        let followed = files.iter().zip(&self.images).zip(sharp);
        let followed = followed.map(|((file, image), sharp)| match (image, sharp) {
            (ImageCheck::NoBall, _) => Some(file.clone()),
            (_, Some(sharp)) if agrees(sharp.share) => {
                Some(file.labelled(Label::Polygon(sharp.outline_px)))
            }
            // Most of the labels tell by how much this one, too, is too large or too small.
            _ => file.resized(1.0 / median),
        });
        Ok(followed.collect())
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

    /// Returns the outline of something round near a label that was drawn around it, and around the same centre, whatever the colours of the labels.
    fn sharp_outline(&self, file: &LabelledFile) -> Result<Option<Sharp>> {
        let Self::Ball { labels, .. } = self else {
            return Ok(None);
        };
        if !file.has_drawn_outline() {
            return Ok(None);
        }
        let (frame, _) = file.load()?;
        let sharp = near_label((file, &frame), &labels[0])?.and_then(|outline_px| {
            let circle = Circle::of_outline(&outline_px)?;
            let share = labels[0].radius_px / circle.radius_px;
            let is_centered = circle.radii_to(&labels[0]) < FOLLOWED_SHIFT;
            is_centered.then_some(Sharp { outline_px, share })
        });
        Ok(sharp)
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
