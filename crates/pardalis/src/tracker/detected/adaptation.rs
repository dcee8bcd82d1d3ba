//! Step 5, adaptation: what is learnt of a target while it is certainly there: what surrounds it, and the illumination in which each camera sees it.

use crate::Frame;
use crate::color::{ColorModel, Illumination, IlluminationCorrection, PixelKind};
use crate::likelihood::edge::{Detection, EdgeSettings, Surrounding};
use crate::tracker::statistics::ImageStatistics;
use crate::tuning::AdaptationTuning;
use crate::view::View;

/// What one camera's images have taught about the target.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Adaptation {
    /// What surrounded it when the camera saw it last.
    surrounding: Option<Surrounding>,
    illumination: AdaptiveIllumination,
}

/// The illumination of the target in one camera's images.
#[derive(Debug, Clone, Copy, Default)]
struct AdaptiveIllumination {
    /// Relative to the illumination in which its colours were learnt.
    illumination: Illumination,
    /// The mean colour of the image in which it was certain first.
    first: Option<[f32; 3]>,
    /// The time of the camera's latest frame, in seconds.
    time_s: Option<f64>,
}

/// What adaptation to one camera's frame reads.
pub(super) struct Certain<'a> {
    /// The detection that is the target; `None` unless the target is certainly there.
    pub(super) detection: Option<&'a Detection>,
    pub(super) colors: &'a ColorModel,
    pub(super) settings: &'a EdgeSettings,
    pub(super) tuning: &'a AdaptationTuning,
    pub(super) time_s: f64,
}

impl Adaptation {
    /// What surrounded the target in this camera.
    pub(super) fn surrounding(&self) -> Option<&Surrounding> {
        self.surrounding.as_ref()
    }

    /// The correction from the camera's pixels to the illumination in which the target's colours were learnt.
    pub(super) fn correction(&self, kind: PixelKind) -> IlluminationCorrection {
        self.illumination.illumination.correction(kind)
    }

    /// Adapts to one frame of the camera of this number.
    pub(super) fn adapt(
        &mut self,
        camera: usize,
        (view, frame): (&View, &Frame),
        statistics: &mut ImageStatistics,
        certain: &Certain,
    ) {
        let detection = certain.detection;
        if let Some(detection) = detection.filter(|_| certain.settings.background_model) {
            detection.update_surrounding(camera, &mut self.surrounding, certain.tuning);
        }
        let adapts = certain.settings.illumination_adaptation;
        let Some(known) = certain.colors.body().filter(|_| adapts) else {
            return;
        };
        let correction = self.correction(PixelKind::FULL_RANGE_YUV);
        let seen =
            detection.and_then(|detection| detection.unoccluded_body_color(camera, certain.tuning));
        // Colours that speak against the target teach nothing.
        let seen = seen.filter(|&color| known.log_ratio(correction.color(color)) > 0.0);
        let seen = seen.map(|color| [color, statistics.mean_color(&view.prepared(frame))]);
        self.illumination
            .adapt(known.mean(), seen, certain.time_s, certain.tuning);
    }
}

impl AdaptiveIllumination {
    /// Adapts to the mean colours of the target, as it is `known` and as it is seen now, and of the image; forgets while the target is not seen.
    fn adapt(
        &mut self,
        known: [f32; 3],
        seen: Option<[[f32; 3]; 2]>,
        time_s: f64,
        tuning: &AdaptationTuning,
    ) {
        let (goal, within_s) = if let Some([target, image]) = seen {
            let first = *self.first.get_or_insert(image);
            let goal = plausible(
                Illumination::between(known, target),
                Illumination::between(first, image),
                tuning,
            );
            (goal, tuning.illumination_s)
        } else {
            (Illumination::default(), tuning.forgetting_s)
        };
        let since_s = self.time_s.replace(time_s).unwrap_or(time_s);
        let rate = 1.0 - libm::exp((since_s - time_s).min(0.0) / within_s);
        let now = &mut self.illumination;
        now.brightness += rate * (goal.brightness - now.brightness);
        now.warmth += rate * (goal.warmth - now.warmth);
    }
}

/// Returns the illumination nearest to the target's apparent one that is plausible for a target in an image whose illumination has changed by this much.
fn plausible(
    of_target: Illumination,
    of_image: Illumination,
    tuning: &AdaptationTuning,
) -> Illumination {
    let nearest = |target: f64, image: f64, max_local: f64, max: f64| {
        let least = (image.min(0.0) - max_local).max(-max);
        let most = (image.max(0.0) + max_local).min(max);
        target.clamp(least, most)
    };
    Illumination {
        brightness: nearest(
            of_target.brightness,
            of_image.brightness,
            tuning.max_local_brightness,
            tuning.max_brightness,
        ),
        warmth: nearest(
            of_target.warmth,
            of_image.warmth,
            tuning.max_local_warmth,
            tuning.max_warmth,
        ),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::color::YuvEncoding;

    fn yuv(rgb: [f64; 3]) -> [f32; 3] {
        let yuv = YuvEncoding::default().yuv_from_rgb(rgb);
        yuv.map(|value| value as f32)
    }

    const ORANGE: [f64; 3] = [185.0, 90.0, 37.0];
    const ROOM: [f64; 3] = [110.0, 120.0, 105.0];
    const TUNING: AdaptationTuning = AdaptationTuning::DEFAULT;

    /// Adapts for some seconds to a target and an image that grow darker by these factors.
    fn adapted([of_target, of_image]: [f64; 2], seconds: usize) -> AdaptiveIllumination {
        let mut adaptive = AdaptiveIllumination::default();
        for frame in 0..=25 * seconds {
            let share = frame as f64 / (25 * seconds) as f64;
            let [target, image] = [(ORANGE, of_target), (ROOM, of_image)]
                .map(|(rgb, least)| yuv(rgb.map(|level| level * libm::pow(least, share))));
            let time_s = frame as f64 / 25.0;
            adaptive.adapt(yuv(ORANGE), Some([target, image]), time_s, &TUNING);
        }
        adaptive
    }

    #[test]
    fn illumination_follows_the_whole_image_and_little_of_the_target_alone() {
        let illumination = adapted([0.4, 0.4], 10).illumination;
        assert!(
            (illumination.brightness - libm::log(0.4)).abs() < 0.12,
            "{illumination:?}"
        );
        let illumination = adapted([0.4, 1.0], 60).illumination;
        assert!(
            (illumination.brightness + TUNING.max_local_brightness).abs() < 0.01,
            "{illumination:?}"
        );
        let illumination = adapted([0.1, 0.05], 60).illumination;
        assert!(
            (illumination.brightness + TUNING.max_brightness).abs() < 0.01,
            "{illumination:?}"
        );
    }

    #[test]
    fn illumination_is_forgotten_while_the_target_is_not_seen() {
        let mut adaptive = adapted([0.4, 0.4], 10);
        adaptive.adapt(yuv(ORANGE), None, 10.0 + TUNING.forgetting_s, &TUNING);
        let kept = adaptive.illumination.brightness / libm::log(0.4);
        assert!((0.25..0.37).contains(&kept), "{kept}");
    }
}
