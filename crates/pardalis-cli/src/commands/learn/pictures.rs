//! Pictures of a learnt model: its histogram, and the labels with what the detector found and the scores of the pixels
//! around them.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::Result;
use pardalis::color::{ColorModel, Palette};

use super::check::Check;
use super::evidence::{Evidence, ImageEvidence};
use super::inputs::LabelledFile;
use crate::draw::histogram::{ColorBin, ColorModelPlot, write_color_model_plot};
use crate::draw::mosaic::{Tile, write_mosaic};
use crate::draw::picture::picture_of;
use crate::files::refuse_links;
use crate::output::Shown;
use crate::user_error::user_error;

/// Maximum number of images shown; of more, those that fit worst.
const MAX_TILES: usize = 12;

/// Creates the folder for pictures if it is missing.
///
/// Errors: it cannot be created, or holds links.
pub(super) fn make_folder(folder: &Path) -> Result<()> {
    refuse_links(folder)?;
    fs::create_dir_all(folder).map_err(|error| {
        user_error!(
            "--pictures {}: the folder cannot be created: {error}; choose another, or give --no-pictures",
            folder.shown()
        )
    })
}

/// The picture of the labels and of what was found.
pub(super) const MOSAIC: &str = "mosaic.png";

/// Draws `histogram.svg`, `histogram.png` and `mosaic.png` into a folder.
///
/// Errors: they cannot be written.
pub(super) fn write(
    folder: &Path,
    files: &[LabelledFile],
    evidence: &Evidence,
    model: &ColorModel,
    check: &Check,
) -> Result<Vec<PathBuf>> {
    let plot = write_color_model_plot(folder, "histogram", &histogram(evidence, model))?;
    let mosaic = folder.join(MOSAIC);
    write_mosaic(&mosaic, tiles(files, evidence, check), 0.0)?;
    Ok(plot.into_iter().chain([mosaic]).collect())
}

fn histogram(evidence: &Evidence, model: &ColorModel) -> ColorModelPlot {
    let palette = model.palette();
    let shares = model.histogram().shares();
    let bins = (0..).zip(shares).filter(|(_, share)| **share > 0.0);
    let scores = |counts: &[u64]| {
        let scores = evidence.separation.log_odds.iter().copied();
        scores.zip(counts.iter().copied()).collect()
    };
    let (object, background) = evidence.counts();
    ColorModelPlot {
        bins: bins
            .map(|(bin, &share)| ColorBin {
                color: palette.rgb_of_bin(bin),
                label: short_name(palette, bin),
                share,
            })
            .collect(),
        object_log_odds: scores(object),
        background_log_odds: scores(background),
        threshold: 0.0,
    }
}

/// Formats a bin as `H0 S10 I1`: the initials of the channels and the indices of the bin.
fn short_name(palette: Palette, bin: u16) -> String {
    let names = palette.channel_names();
    let indices = palette.channels_of_bin(bin);
    let part = |(name, index): (&str, u16)| format!("{}{index}", name[..1].to_uppercase());
    let parts: Vec<String> = names.into_iter().zip(indices).map(part).collect();
    parts.join(" ")
}

/// Returns the images with their labels, what was found and the scores; if there are too many, those in which the target was
/// not found and those that fit the others worst.
fn tiles(
    files: &[LabelledFile],
    evidence: &Evidence,
    check: &Check,
) -> impl Iterator<Item = Result<Tile>> {
    let judged = evidence.images.iter().zip(&check.images);
    let mut shown: Vec<_> = files.iter().zip(judged).collect();
    if shown.len() > MAX_TILES {
        let fit = |image: &ImageEvidence| image.fit.unwrap_or(1.0);
        shown.sort_by(|(_, (a, a_found)), (_, (b, b_found))| {
            let first = b_found.failed().cmp(&a_found.failed());
            first.then(fit(a).total_cmp(&fit(b)))
        });
        shown.truncate(MAX_TILES);
    }
    let mut learner = evidence.learner();
    let log_odds = &evidence.separation.log_odds;
    shown.into_iter().map(move |(file, (image, found))| {
        let (frame, marked) = file.load()?;
        let mask = learner.target_pixels(&frame, &marked)?;
        let bins = learner.bins_of(&frame);
        let verdict = if image.is_suspect() {
            ": check this label"
        } else if found.failed() {
            ": not found"
        } else {
            ""
        };
        Ok(Tile {
            label: format!("{}{verdict}", image.name),
            image: picture_of(&frame),
            mask,
            log_odds: bins
                .into_iter()
                .map(|bin| log_odds[usize::from(bin)] as f32)
                .collect(),
            found_px: found
                .found()
                .map_or_else(Vec::new, |found| found.outline_px.clone()),
        })
    })
}
