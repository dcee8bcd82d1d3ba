//! A naive implementation of the likelihood of boxes in images.

use crate::shape::{Shape, Stance};
use crate::tracker::{DetectorSettings, ImageBox};
use crate::view::View;

/// Returns the logarithm of how much likelier the boxes of a camera's image are if there is a body at a position (metres) than if there is none: one of them is the body's, or it was missed, and
/// all others are clutter.
pub fn boxes_log_ratio(
    view: &View,
    shape: &Shape,
    position_m: [f64; 3],
    boxes: &[ImageBox],
    detector: &DetectorSettings,
) -> f64 {
    let pose = view.camera_from_world();
    let stance = Stance::default();
    let outline = shape.outline_px(view.camera(), pose, position_m, stance, 5000);
    let Some(pixels) = outline.into_iter().collect::<Option<Vec<[f64; 2]>>>() else {
        return 0.0;
    };
    let (width, height) = view.size();
    let extreme = |axis: usize| {
        let along = pixels.iter().map(|pixel| pixel[axis]);
        [
            along.clone().fold(f64::INFINITY, f64::min),
            along.fold(f64::NEG_INFINITY, f64::max),
        ]
    };
    let whole = [extreme(0), extreme(1)];
    let within = |side: f64, last: usize| side.clamp(-0.5, last as f64 - 0.5);
    let cut = [
        whole[0].map(|side| within(side, width)),
        whole[1].map(|side| within(side, height)),
    ];
    let area = |[[u0, u1], [v0, v1]]: [[f64; 2]; 2]| (u1 - u0) * (v1 - v0);
    let share = area(cut) / area(whole);
    let middle = cut.map(|[first, last]| f64::midpoint(first, last));
    if share <= 0.0 || super::open_pixel(view, middle).is_none() {
        return 0.0;
    }
    let seen = detector.detection_probability * (2.0 * share).min(1.0);
    let normal = |off: f64, sigma: f64| {
        (-0.5 * (off / sigma).powi(2)).exp() / (sigma * std::f64::consts::TAU.sqrt())
    };
    let of_box = |found: &ImageBox| {
        let [u0, v0, u1, v1] = found.sides_px();
        let found_px = [
            [within(u0, width), within(u1, width)],
            [within(v0, height), within(v1, height)],
        ];
        let found_area = area(found_px);
        let sigma = (0.25 + detector.side_sigma.powi(2) * area(cut)).sqrt();
        let mut density = 1.0;
        for axis in 0..2 {
            for end in 0..2 {
                let off = found_px[axis][end] - cut[axis][end];
                density *= 0.9 * normal(off, sigma) + 0.1 * normal(off, 5.0 * sigma);
            }
        }
        let score = found.score().unwrap_or(0.5);
        let odds = (score / (1.0 - score)).clamp(1.0 / 19.0, 19.0);
        // Anywhere in the image, of a hundredth of its size to all of it, and of any form from 1 : 4 to 4 : 1.
        let clutter =
            1.0 / (width as f64 * height as f64) / (found_area * 100.0_f64.ln() * 16.0_f64.ln());
        odds * density / (detector.false_per_image * clutter)
    };
    (1.0 - seen + seen * boxes.iter().map(of_box).sum::<f64>()).ln()
}
