//! Remedies for balls that the detector does not find. Only those are recommended that were tried with success.

use std::fmt;

use anyhow::Result;
use pardalis::color::Palette;

use super::check::Check;
use super::evidence::Evidence;
use super::inputs::LabelledFile;

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
/// What to change, and in how many images the ball is found then.
#[derive(Debug)]
pub(super) struct Remedy {
    /// The options of another palette.
    options: &'static str,
    pub(super) found: usize,
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
        are_labels_exact: bool,
    ) -> Result<Option<Self>> {
        let balls = check.ball_count();
        let mut best: Option<Self> = None;
        for &(options, other) in PALETTES.iter().filter(|(_, other)| *other != palette) {
            let evidence = Evidence::gather(files, other, are_labels_exact)?;
            let tried = Check::run(files, &mut evidence.learner(), &evidence.model()?)?;
            let found = tried.ball_count() - tried.failures();
            let best_found = best
                .as_ref()
                .map_or(balls - check.failures(), |best| best.found);
            if found > best_found {
                best = Some(Self { options, found });
            }
            if found >= balls {
                break;
            }
        }
        Ok(best)
    }
}

impl fmt::Display for Remedy {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "With {}, it is found in {}", self.options, self.found)
    }
}
