//! Statistics of a target's colours from labelled images, all together and each by itself.

use anyhow::Result;
use pardalis::color::{ColorLearner, ColorModel, ColorRanges, Palette, Separation};

use super::inputs::LabelledFile;

/// Fit below which an image is probably labelled incorrectly.
const MIN_FIT: f64 = 0.7;

/// Pixel counts of all images.
pub(super) struct Evidence {
    learner: ColorLearner,
    /// How well the bins separate the target from the background.
    pub(super) separation: Separation,
    /// Per image, in the order of the files.
    pub(super) images: Vec<ImageEvidence>,
}

/// One image, compared with the others.
pub(super) struct ImageEvidence {
    /// Name of the file.
    pub(super) name: String,
    /// Number of the target's pixels.
    pub(super) pixels: u64,
    /// Whether a label is a box around the target, of which the inscribed ellipse is learnt.
    pub(super) has_box: bool,
    /// Share of the target's pixels with positive log odds.
    pub(super) found: f64,
    /// Share of the other pixels with positive log odds; `None` if all pixels are the target's.
    pub(super) mistaken: Option<f64>,
    /// Share of the target's pixels whose colours count as the target's by the labels of the other images;
    /// `None` without other images.
    pub(super) fit: Option<f64>,
}

/// Pixel counts per bin of one image.
struct Counts {
    object: Vec<u64>,
    background: Vec<u64>,
}

impl Evidence {
    /// Counts the pixels of all images.
    ///
    /// Errors: an image or its labels cannot be used.
    pub(super) fn gather(files: &[LabelledFile], palette: Palette) -> Result<Self> {
        let mut learner = ColorLearner::new(palette)?;
        let mut counts = Vec::with_capacity(files.len());
        let mut has_box = Vec::with_capacity(files.len());
        for file in files {
            let (frame, is_object) = file.load()?;
            let before = Counts::of(&learner);
            learner.add(&frame, &is_object)?;
            counts.push(Counts::of(&learner).without(&before));
            has_box.push(learner.target_pixels(&frame, &is_object)? != is_object);
        }
        let separation = learner.separation();
        let all = Counts::of(&learner);
        let is_targets = |bin: usize| separation.log_odds[bin] > 0.0;
        let images = files
            .iter()
            .zip(&counts)
            .zip(has_box)
            .map(|((file, own), has_box)| {
                let others = all.without(own);
                let by_others = Separation::of(&others.object, &others.background).log_odds;
                // A bin that occurs in none of the other images is no evidence for the target.
                let is_others = |bin: usize| others.object[bin] > 0 && by_others[bin] > 0.0;
                ImageEvidence {
                    name: file.name_among(files),
                    pixels: own.object.iter().sum(),
                    has_box,
                    found: share_where(&own.object, is_targets).unwrap_or(0.0),
                    mistaken: share_where(&own.background, is_targets),
                    fit: share_where(&own.object, is_others).filter(|_| files.len() > 1),
                }
            });
        Ok(Self {
            images: images.collect(),
            separation,
            learner,
        })
    }

    /// Computes the model of the labelled pixels.
    pub(super) fn model(&self) -> Result<ColorModel> {
        Ok(self.learner.learn()?)
    }

    /// Returns the shares of the target's pixels and of the others that lie in the ranges.
    pub(super) fn shares_within(&self, ranges: &ColorRanges) -> [f64; 2] {
        self.learner.shares_within(ranges)
    }

    /// Returns the pixel counts per bin, of the target and of the others.
    pub(super) fn counts(&self) -> (&[u64], &[u64]) {
        self.learner.counts()
    }

    /// Returns a learner of the same palette, for the bins of further images.
    pub(super) fn learner(&self) -> ColorLearner {
        self.learner.clone()
    }

    /// Returns the number of pixels that are not the target's.
    pub(super) fn background_pixels(&self) -> u64 {
        self.counts().1.iter().sum()
    }
}

impl ImageEvidence {
    /// Reports whether the labelled pixels differ from those of the other images.
    pub(super) fn is_suspect(&self) -> bool {
        self.fit.is_some_and(|fit| fit < MIN_FIT)
    }
}

impl Counts {
    fn of(learner: &ColorLearner) -> Self {
        let (object, background) = learner.counts();
        Self {
            object: object.to_vec(),
            background: background.to_vec(),
        }
    }

    /// Returns the counts without those of `part`.
    fn without(&self, part: &Self) -> Self {
        let less = |all: &[u64], part: &[u64]| all.iter().zip(part).map(|(a, p)| a - p).collect();
        Self {
            object: less(&self.object, &part.object),
            background: less(&self.background, &part.background),
        }
    }
}

/// Computes the share of the pixels in the selected bins; `None` without pixels.
fn share_where(counts: &[u64], is_counted: impl Fn(usize) -> bool) -> Option<f64> {
    let total: u64 = counts.iter().sum();
    let counted = counts
        .iter()
        .enumerate()
        .filter(|&(bin, _)| is_counted(bin));
    let counted: u64 = counted.map(|(_, pixels)| pixels).sum();
    (total > 0).then(|| counted as f64 / total as f64)
}
