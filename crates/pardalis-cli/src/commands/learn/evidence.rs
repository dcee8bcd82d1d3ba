//! What labelled images say of a target's colours, together and each by itself.

use anyhow::Result;
use pardalis::color::{ColorLearner, ColorModel, ColorRanges, Palette, Separation};

use super::inputs::LabelledFile;

/// An image whose fit is below this is likely to be labelled wrongly.
const MIN_FIT: f64 = 0.7;

/// Counted pixels of all images.
pub(super) struct Evidence {
    learner: ColorLearner,
    /// How well the bins tell the target from the rest.
    pub(super) separation: Separation,
    /// In the order of the files.
    pub(super) images: Vec<ImageEvidence>,
}

/// One image beside all of them.
pub(super) struct ImageEvidence {
    /// Name of the file.
    pub(super) name: String,
    /// Number of the target's pixels.
    pub(super) pixels: u64,
    /// Share of the target's pixels with log odds above 0.
    pub(super) found: f64,
    /// Share of the others with log odds above 0; none where all pixels are the target's.
    pub(super) mistaken: Option<f64>,
    /// Share of the target's pixels whose colours the other images' labels tell to be the target's; none without
    /// other images.
    pub(super) fit: Option<f64>,
}

/// The pixels of one image in each bin.
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
        for file in files {
            let (frame, is_object) = file.load()?;
            let before = Counts::of(&learner);
            learner.add(&frame, &is_object)?;
            counts.push(Counts::of(&learner).without(&before));
        }
        let separation = learner.separation();
        let all = Counts::of(&learner);
        let is_targets = |bin: usize| separation.log_odds[bin] > 0.0;
        let images = files.iter().zip(&counts).map(|(file, own)| {
            let others = all.without(own);
            let by_others = Separation::of(&others.object, &others.background).log_odds;
            // A bin that none of the others has ever seen says nothing for the target.
            let is_others = |bin: usize| others.object[bin] > 0 && by_others[bin] > 0.0;
            ImageEvidence {
                name: file.name(),
                pixels: own.object.iter().sum(),
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

    /// The model of the labelled pixels.
    pub(super) fn model(&self) -> Result<ColorModel> {
        Ok(self.learner.learn()?)
    }

    /// The share of the target's pixels and of the others that lie in ranges.
    pub(super) fn shares_within(&self, ranges: &ColorRanges) -> [f64; 2] {
        self.learner.shares_within(ranges)
    }

    /// The target's pixels and the others in each bin.
    pub(super) fn counts(&self) -> (&[u64], &[u64]) {
        self.learner.counts()
    }

    /// A learner of the palette, for the bins of further images.
    pub(super) fn learner(&self) -> ColorLearner {
        self.learner.clone()
    }

    /// The number of pixels that are not the target's.
    pub(super) fn background_pixels(&self) -> u64 {
        self.counts().1.iter().sum()
    }
}

impl ImageEvidence {
    /// Whether the labelled pixels look unlike those of the other images.
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

    /// What remains when a part is taken away.
    fn without(&self, part: &Self) -> Self {
        let less = |all: &[u64], part: &[u64]| all.iter().zip(part).map(|(a, p)| a - p).collect();
        Self {
            object: less(&self.object, &part.object),
            background: less(&self.background, &part.background),
        }
    }
}

/// The share of the pixels that lie in certain bins; none without pixels.
fn share_where(counts: &[u64], is_counted: impl Fn(usize) -> bool) -> Option<f64> {
    let total: u64 = counts.iter().sum();
    let counted = counts
        .iter()
        .enumerate()
        .filter(|&(bin, _)| is_counted(bin));
    let counted: u64 = counted.map(|(_, pixels)| pixels).sum();
    (total > 0).then(|| counted as f64 / total as f64)
}
