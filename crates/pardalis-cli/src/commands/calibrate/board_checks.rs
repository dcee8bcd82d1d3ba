//! Checks of a board and its images, for single cameras and rigs.

use std::ops::RangeInclusive;
use std::path::Path;

use anyhow::Result;
use pardalis_calibrate::board::{Board, BoardKind};

use super::images::SearchedImage;
use crate::output::Shown;
use crate::user_error::user_error;

/// Plausible side lengths of a board's squares and tags, in metres.
const USUAL_SIDES_M: RangeInclusive<f64> = 0.002..=0.5;

/// Fails if the board was found in none of the images.
pub(super) fn check_found(source: &Path, images: &[SearchedImage]) -> Result<()> {
    if images.iter().any(|image| image.found.is_ok()) {
        return Ok(());
    }
    let reasons = images.iter().filter_map(|image| {
        let reason = image.found.as_ref().err()?;
        Some(format!("\n  {}: {reason}", image.name))
    });
    Err(user_error!(
        "{}: the board was found in none of the images; check whether --board describes it correctly{}",
        source.shown(),
        reasons.collect::<String>()
    ))
}

/// Returns the name of a board's elements and their side length in metres.
pub(super) fn side(board: &Board) -> (&'static str, f64) {
    let name = match board.kind() {
        BoardKind::Checkerboard | BoardKind::Charuco => "square",
        BoardKind::AprilGrid => "tag",
    };
    (name, board.side_m())
}

/// Warns of a board whose side length is implausible in metres.
pub(super) fn side_note(board: &Board) -> Option<String> {
    let (what, side_m) = side(board);
    (!USUAL_SIDES_M.contains(&side_m)).then(|| {
        format!("--board states a side of {side_m} m for a {what} of the board: is it in metres?")
    })
}
