//! The detector on the images that a model was learnt from: whether it finds what was labelled.

use anyhow::Result;
use pardalis::color::{ColorLearner, ColorModel};
use pardalis::tracker::DetectedSettings;
use pardalis::view::View;
use pardalis::{Frame, FrameSet, Tracker};
use pardalis_camera::{Pinhole, Pose};

use super::balls::{Circle, LabelledBall, Outline};
use super::inputs::LabelledFile;
use crate::focal_length::{TYPICAL_FOV_DEG, focal_length_px, middle_px};

/// The radius of the ball, metres. Any would do: with one camera it only scales the distance.
const RADIUS_M: f64 = 0.1;
/// Points of the found outline.
const OUTLINE_POINTS: usize = 72;
/// The least ratio of the axes of a ball's outline. Hand-set: a ball near the border of a wide image has 0.7.
const MIN_AXES_RATIO: f64 = 0.6;
/// What is found is the labelled ball if its centre is at most this far from the ball's, in radii of the ball, and its size within this
/// range, as a multiple of the ball's. Hand-set: beyond, it is something else, or a part of the ball.
const SAME_PLACE: f64 = 0.5;
const SAME_SIZE: std::ops::RangeInclusive<f64> = 0.7..=1.4;

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
        labels: Vec<LabelledBall>,
        found: Option<Outline>,
    },
}

impl Check {
    /// Runs the detector on each image as `track` runs it on a first frame, with a typical pinhole camera. `learner`
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
            let outlines = learner.outlines(&frame, &marked)?;
            let mut labels: Vec<_> = outlines.iter().map(LabelledBall::of).collect();
            // In images of a mirror, a typical camera finds nothing.
            if !labels.iter().any(|ball| ball.axes_ratio >= MIN_AXES_RATIO) {
                return Ok(ImageCheck::NoBall);
            }
            labels.sort_by(|a, b| b.place().radius_px.total_cmp(&a.place().radius_px));
            let found = detect(&frame, model)?;
            if let Some(Outline { circle, .. }) = &found {
                let off = |ball: &LabelledBall| ball.place().radii_to(circle);
                labels.sort_by(|a, b| off(a).total_cmp(&off(b)));
            }
            Ok(ImageCheck::Ball { labels, found })
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

    /// Returns the numbers of the images in which no outline is seen at a label.
    pub(super) fn unfitted(&self) -> impl Iterator<Item = usize> {
        let images = self.images.iter().enumerate();
        let unfitted = images.filter(|(_, image)| {
            let balls = image.balls().iter();
            balls.clone().any(|ball| ball.outline.is_none())
        });
        unfitted.map(|(number, _)| number)
    }
}

impl ImageCheck {
    /// Reports whether the labelled ball was not found: nothing was, or something at another place or of another size.
    pub(super) fn failed(&self) -> bool {
        match self {
            Self::NoBall => false,
            Self::Ball { labels, found, .. } => found.as_ref().is_none_or(|found| {
                let ball = labels[0].place();
                let size = found.circle.radius_px / ball.radius_px;
                ball.radii_to(&found.circle) > SAME_PLACE || !SAME_SIZE.contains(&size)
            }),
        }
    }

    /// Returns the labelled balls, the one nearest to what was found first.
    pub(super) fn balls(&self) -> &[LabelledBall] {
        match self {
            Self::NoBall => &[],
            Self::Ball { labels, .. } => labels,
        }
    }

    /// Returns what was found.
    pub(super) fn found(&self) -> Option<&Outline> {
        match self {
            Self::NoBall => None,
            Self::Ball { found, .. } => found.as_ref(),
        }
    }
}

/// By how much outlines may deviate from those of the guessed camera, pixels: a fisheye lens changes a ball far off its axis by a tenth.
const TOLERANCE_PX: f32 = 1.5;

/// Detects a ball as in the first frame of a track, with default settings except that the camera is a guess.
fn detect(frame: &Frame, model: &ColorModel) -> Result<Option<Outline>> {
    let size = (frame.width(), frame.height());
    let focal_px = focal_length_px(size, TYPICAL_FOV_DEG);
    let lens = Pinhole::new([focal_px; 2], middle_px(size), &[])?;
    let mut ball = DetectedSettings::ball(RADIUS_M, model.clone())?;
    ball.tuning.edge.judged_tolerance_px = TOLERANCE_PX;
    let shape = ball.shape;
    let mut setup = Tracker::builder();
    let camera = setup.camera(View::new(lens, Pose::identity(), size, None)?);
    let target = setup.target(ball);
    let mut tracker = setup.build()?;
    tracker.observe(&FrameSet::of(camera, frame.clone()))?;
    let Some(known) = tracker.estimate(target)?.kinematics else {
        return Ok(None);
    };
    let view = &tracker.views()[camera.index()];
    let outline = shape.outline_px(
        view.camera(),
        view.camera_from_world(),
        known.position_m,
        1.0,
        OUTLINE_POINTS,
    );
    let points_px: Vec<[f64; 2]> = outline.into_iter().flatten().collect();
    Ok(Circle::of_outline(&points_px).map(|circle| Outline { circle, points_px }))
}
