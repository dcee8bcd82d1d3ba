//! Remedies for balls that the detector does not find. Only those are recommended that were tried with success.

use std::fmt;

use anyhow::Result;
use pardalis::color::Palette;

use super::balls::Circle;
use super::check::{Check, ImageCheck};
use super::evidence::Evidence;
use super::inputs::LabelledFile;
use super::label::Label;

/// The options of other palettes that are tried.
const PALETTES: [(&str, Palette); 3] = [
    (
        "--bins 24,16,6",
        Palette::Hsi {
            hue_bins: 24,
            saturation_bins: 16,
            intensity_bins: 6,
        },
    ),
    ("--palette yuv", Palette::YUV),
    ("--palette rgb", Palette::Rgb { channel_bins: 8 }),
];
/// The size of boxes that are tried, as a share of the labels'.
const CLOSER: f64 = 0.85;

/// What to change, and in how many images the ball is found then.
#[derive(Debug)]
pub(super) struct Remedy {
    change: Change,
    pub(super) found: usize,
}

#[derive(Debug, Clone, Copy)]
enum Change {
    /// The options of another palette.
    Options(&'static str),
    /// Boxes that are smaller than the labels.
    CloserBoxes,
}

impl Remedy {
    /// Returns the change that makes the detector find the ball in most images, and in more than `check` did; of equal ones
    /// the first that was tried.
    ///
    /// Errors: an image cannot be read.
    pub(super) fn find(
        files: &[LabelledFile],
        palette: Palette,
        check: &Check,
    ) -> Result<Option<Self>> {
        let closer = closer_boxes(files, check);
        let others = PALETTES.iter().filter(|(_, other)| *other != palette);
        let palettes = others.map(|&(options, other)| (Change::Options(options), files, other));
        let boxes = (Change::CloserBoxes, &*closer, palette);
        // If labels are too large, that is the likely cause.
        let is_too_large = check.label_error().is_some_and(|error| error > 0.0);
        let [first, last] = [is_too_large, !is_too_large].map(|tries| tries.then_some(boxes));
        let tried = first.into_iter().chain(palettes).chain(last);
        let balls = check.ball_count();
        let mut best: Option<Self> = None;
        for (change, files, palette) in tried {
            let evidence = Evidence::gather(files, palette)?;
            let tried = Check::run(files, &mut evidence.learner(), &evidence.model()?)?;
            let found = tried.ball_count() - tried.failures();
            let best_found = best
                .as_ref()
                .map_or(balls - check.failures(), |best| best.found);
            if found > best_found {
                best = Some(Self { change, found });
            }
            if found >= balls {
                break;
            }
        }
        Ok(best)
    }
}

/// Returns the files with boxes that are smaller than the labelled balls.
fn closer_boxes(files: &[LabelledFile], check: &Check) -> Vec<LabelledFile> {
    let with_boxes = |(file, image): (&LabelledFile, &ImageCheck)| {
        let mut file = file.clone();
        if let ImageCheck::Ball { labels, .. } = image {
            file.labels = labels.iter().map(closer_box).collect();
        }
        file
    };
    files.iter().zip(&check.images).map(with_boxes).collect()
}

/// Returns a box that is smaller than a labelled ball.
fn closer_box(ball: &Circle) -> Label {
    let reach_px = CLOSER * ball.radius_px;
    let corner = |center_px: f64| (center_px + 0.5 - reach_px).round().max(0.0) as usize;
    let [x, y] = ball.center_px.map(corner);
    let side = ((2.0 * reach_px).round() as usize).max(1);
    Label::Rect {
        x,
        y,
        width: side,
        height: side,
    }
}

impl fmt::Display for Remedy {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.change {
            Change::Options(options) => write!(f, "With {options}"),
            Change::CloserBoxes => write!(
                f,
                "With boxes {:.0} % smaller than these labels",
                100.0 * (1.0 - CLOSER)
            ),
        }?;
        write!(f, ", it is found in {}", self.found)
    }
}

impl Remedy {
    /// Reports whether it is about the size of the labels.
    pub(super) fn changes_labels(&self) -> bool {
        matches!(self.change, Change::CloserBoxes)
    }

    /// Says what to do.
    pub(super) fn advice(&self) -> &'static str {
        match self.change {
            Change::Options(_) => "learn again with this option",
            Change::CloserBoxes => {
                "the labels are too large; draw boxes that touch the ball on all sides"
            }
        }
    }
}
