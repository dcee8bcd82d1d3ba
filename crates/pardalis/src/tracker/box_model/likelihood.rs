//! How likely the boxes of an image are, given where a body is.

use super::body_box::BodyBox;
use super::sight::{Sight, clipped, share_within, sigma_px};
use crate::tracker::settings::DetectorSettings;
use crate::view::View;

/// The log-likelihood ratio of the boxes in one camera's image, given that a body is at a position (metres), against no body.
pub(in crate::tracker) fn log_ratio<'s>(
    (outline, view): (&BodyBox, &View),
    position_m: [f64; 3],
    sights: impl Iterator<Item = &'s Sight>,
    detector: &DetectorSettings,
) -> f64 {
    let Some(sides_px) = outline.sides_px(view, position_m, 1.0) else {
        return 0.0;
    };
    let seen = detection_probability(view, sides_px, detector);
    if seen == 0.0 {
        return 0.0;
    }
    let body_px = clipped(sides_px, view.size());
    let sigma_px = sigma_px(body_px, detector);
    let ratios = sights.map(|sight| sight.ratio(body_px, sigma_px));
    libm::log(1.0 - seen + seen * ratios.sum::<f64>())
}

/// The probability that a body with this box (pixels) is detected: less if most of it is out of the image, none if its middle is masked.
fn detection_probability(view: &View, sides_px: [f64; 4], detector: &DetectorSettings) -> f64 {
    let share = share_within(sides_px, view.size());
    let [u0, v0, u1, v1] = clipped(sides_px, view.size());
    let middle = [0.5 * (u0 + u1), 0.5 * (v0 + v1)].map(|v| v as f32);
    if share > 0.0 && view.holds_point(middle) {
        detector.detection_probability * (2.0 * share).min(1.0)
    } else {
        0.0
    }
}
