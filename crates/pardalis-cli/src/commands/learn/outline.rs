//! The outline of a ball in an image in which somebody has said where it is.

use anyhow::Result;
use pardalis::Frame;
use pardalis::color::Palette;
use pardalis_camera::Mask;

use super::balls::Circle;
use super::contrast::{Search, ball_of_contrast};
use super::detector::fit;
use super::evidence::Evidence;
use super::inputs::LabelledFile;
use super::label::Label;

/// Around a rough outline, the outline is looked for within this many radii.
const SEARCHED_RADII: f64 = 2.0;
/// How far outlines are from circles that were drawn around balls: between the centres in radii, and by this factor larger or smaller. Hand-set: as far as labels that give way to
/// outlines.
const DRAWN_OFF: f64 = 0.2;
const DRAWN_FACTOR: f64 = 1.35;

/// Returns the outline of a ball near a circle that was drawn around it in a frame of this file; `None` if nothing there is round and differs from what surrounds it.
pub(super) fn near_label(
    (file, frame): (&LabelledFile, &Frame),
    drawn: &Circle,
) -> Result<Option<Vec<[f64; 2]>>> {
    let search = Search {
        at: drawn.center_px,
        off_radii: DRAWN_OFF,
        radius_px: drawn.radius_px / DRAWN_FACTOR..=drawn.radius_px * DRAWN_FACTOR,
    };
    let rough_px = ball_of_contrast(frame, &file.lens(frame)?, &search);
    let refined = rough_px.map(|rough_px| refined((file, frame), rough_px));
    refined.transpose()
}

/// Returns the outline of a ball near a rough one in a frame of this file.
pub(super) fn refined(
    (file, frame): (&LabelledFile, &Frame),
    rough_px: Vec<[f64; 2]>,
) -> Result<Vec<[f64; 2]>> {
    // A label has no corners beyond the image.
    let sides = [frame.width(), frame.height()].map(|side| side as f64);
    let inside = |at: [f64; 2]| [0, 1].map(|axis| at[axis].clamp(0.0, sides[axis]));
    let mut outline_px: Vec<[f64; 2]> = rough_px.into_iter().map(inside).collect();
    let Some(rough) = Circle::of_outline(&outline_px) else {
        return Ok(outline_px);
    };
    // Twice, the second time with the colours inside of what was found rather than those of a guess.
    for _ in 0..2 {
        let file = file.labelled(Label::Polygon(outline_px.clone()));
        let view = file.view(frame, Some(around(frame, &rough)?))?;
        let model = Evidence::gather(&[file], Palette::HSI)?.model()?;
        // Its colours may be found, but not its edge, as of something small.
        if let Some(found) = fit(frame, &model, &rough, view)? {
            outline_px = found.outline_px.into_iter().map(inside).collect();
        }
    }
    Ok(outline_px)
}

/// Returns the part of an image around a circle.
fn around(frame: &Frame, circle: &Circle) -> Result<Mask> {
    let (width, height) = (frame.width(), frame.height());
    let searched = SEARCHED_RADII * circle.radius_px.max(4.0);
    let grey: Vec<u8> = (0..width * height)
        .map(|index| {
            let [u, v] = circle.center_px;
            let (x, y) = ((index % width) as f64 - u, (index / width) as f64 - v);
            if libm::hypot(x, y) < searched { 255 } else { 0 }
        })
        .collect();
    Ok(Mask::from_grey(width, height, &grey)?)
}
