//! Whether a body that the published cues located shows its own colours, and an outline.
//!
//! Those cues compare hypotheses with each other, and the inside of an outline with its surroundings. So they find a best
//! place also where there is no body.

use crate::color::{ColorModel, Histogram, Palette};
use crate::frame::Frame;
use crate::shape::{Shape, Stance};
use crate::view::View;

/// The least Bhattacharyya similarity between the pixels inside of the outline and the colour model. Hand-set: bundled balls
/// have 0.78 and more, through mirrors as well, and the best places without a ball up to 0.32, at a goal of similar colour.
const MIN_SIMILARITY: f64 = 0.4;

/// The greatest Bhattacharyya similarity between the pixels inside of the outline and those around it. Hand-set: bundled balls
/// have up to 0.66, in four webcams that do not all see them, and images all in a ball's colour with strong noise 0.86.
const MAX_SIMILARITY_AROUND: f64 = 0.75;

/// The outlines along which pixels are taken, relative to the body's, and the number of pixels along each.
const INSIDE: [f64; 4] = [0.2, 0.45, 0.7, 0.9];
const AROUND: [f64; 4] = [1.2, 1.6, 2.2, 3.0];
const PIXELS: usize = 24;

/// Reports whether the images of a body at this position, in metres, show its colours, if they are known, and others around
/// it. If no camera sees it, there is nothing against it.
pub(super) fn is_shown(
    (shape, colors): (&Shape, Option<&ColorModel>),
    views: &[View],
    frames: &[(usize, Frame)],
    position_m: [f64; 3],
) -> bool {
    let palette = colors.map_or(Palette::HSI, ColorModel::palette);
    let along = |scales: &[f64]| {
        let mut counts = vec![0; palette.bin_count()];
        for (camera, frame) in frames {
            let (lens, pose) = (views[*camera].camera(), views[*camera].camera_from_world());
            for scale in scales {
                let stance = Stance::scaled(*scale);
                let pixels = shape.outline_px(lens, pose, position_m, stance, PIXELS);
                for [u, v] in pixels.into_iter().flatten() {
                    let (u, v) = (u.round(), v.round());
                    let is_inside = (0.0..frame.width() as f64).contains(&u)
                        && (0.0..frame.height() as f64).contains(&v);
                    if is_inside {
                        let rgb = frame.rgb(u as usize, v as usize).map(f64::from);
                        counts[usize::from(palette.bin_of_rgb(rgb))] += 1;
                    }
                }
            }
        }
        Histogram::from_counts(&counts)
    };
    let Some(inside) = along(&INSIDE) else {
        return true;
    };
    let has_colors =
        colors.is_none_or(|colors| inside.similarity(colors.histogram()) >= MIN_SIMILARITY);
    let has_outline =
        along(&AROUND).is_none_or(|around| inside.similarity(&around) <= MAX_SIMILARITY_AROUND);
    has_colors && has_outline
}
