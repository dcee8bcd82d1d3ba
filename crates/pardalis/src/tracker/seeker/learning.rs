//! What is learnt of a target while it is surely there: what surrounds it, and the light in which each camera sees it.

use nalgebra::Vector3;

use super::{Seeker, TrackState};
use crate::Frame;
use crate::color::{Illumination, IlluminationCorrection, PixelKind};
use crate::detect::mean_color;
use crate::likelihood::edge::Sighting;
use crate::view::View;

/// From this belief on, the target is surely there.
const SURE: f64 = 0.9;
/// Light is learnt, all but 1/e of it, in so many seconds, ...
const LEARN_S: f64 = 0.5;
/// ... and forgotten in so many where the target is not seen.
const FORGET_S: f64 = 10.0;
/// How far light may be from that in which the colours were learnt, in brightness and warmth, ...
const FARTHEST: [f64; 2] = [1.2, 0.4];
/// ... and how far a target's from that of its whole image: by shadows, lamps and its path. What changes further alone is not the light.
const APART: [f64; 2] = [0.2, 0.05];

/// The light in which one camera sees the target.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Lighting {
    /// Beside that in which its colours were learnt.
    light: Illumination,
    /// The mean colour of the image in which it was surely seen first.
    first: Option<[f32; 3]>,
    /// The time of the camera's last frame, in seconds.
    time_s: Option<f64>,
}

impl Lighting {
    /// From its frames' pixels to those in the light in which the target's colours were learnt.
    pub(super) fn relight(&self, kind: PixelKind) -> IlluminationCorrection {
        self.light.correction(kind)
    }

    /// Learns from the mean colours of the target, as it is `known` and as it is seen now, and of the image; forgets where the target is not seen.
    fn learn(&mut self, known: [f32; 3], seen: Option<[[f32; 3]; 2]>, time_s: f64) {
        let (aim, within_s) = if let Some([body, image]) = seen {
            let first = *self.first.get_or_insert(image);
            let aim = possible(
                Illumination::between(known, body),
                Illumination::between(first, image),
            );
            (aim, LEARN_S)
        } else {
            (Illumination::default(), FORGET_S)
        };
        let since_s = self.time_s.replace(time_s).unwrap_or(time_s);
        let rate = 1.0 - libm::exp((since_s - time_s).min(0.0) / within_s);
        self.light.brightness += rate * (aim.brightness - self.light.brightness);
        self.light.warmth += rate * (aim.warmth - self.light.warmth);
    }
}

/// The nearest light that the target may be in where that of the whole image has become so different.
fn possible(of_target: Illumination, of_image: Illumination) -> Illumination {
    let nearest = |target: f64, image: f64, i: usize| {
        let least = (image.min(0.0) - APART[i]).max(-FARTHEST[i]);
        let most = (image.max(0.0) + APART[i]).min(FARTHEST[i]);
        target.clamp(least, most)
    };
    Illumination {
        brightness: nearest(of_target.brightness, of_image.brightness, 0),
        warmth: nearest(of_target.warmth, of_image.warmth, 1),
    }
}

impl Seeker {
    /// Learns from the sighting that is the target, if it is surely there.
    pub(super) fn learn(
        &mut self,
        views: &[View],
        frames: &[(usize, Frame)],
        sightings: &[Sighting],
        time_s: f64,
    ) {
        let sighting = self.sure(sightings);
        let settings = self.edge.settings();
        for (camera, frame) in frames {
            if let Some(sighting) = sighting.filter(|_| settings.background_model) {
                sighting.learn_around(*camera, &mut self.known_around[*camera]);
            }
            if let Some(known) = self
                .colors
                .body()
                .filter(|_| settings.illumination_adaptation)
            {
                let lighting = &mut self.lighting[*camera];
                let relight = lighting.relight(PixelKind::FULL_RANGE_YUV);
                let seen = sighting.and_then(|sighting| sighting.whole_body(*camera));
                // Nothing is learnt from colours that speak against the target.
                let seen = seen.filter(|&body| known.log_ratio(relight.color(body)) > 0.0);
                let image = || mean_color(&views[*camera].evidence(frame));
                lighting.learn(known.mean(), seen.map(|body| [body, image()]), time_s);
            }
        }
    }

    /// The sighting that is the target, if it is surely there.
    fn sure<'a>(&self, sightings: &'a [Sighting]) -> Option<&'a Sighting> {
        if self.state != TrackState::Tracking || self.belief() < SURE {
            return None;
        }
        let here = Vector3::from(self.filter.estimate(0.0)?.position_m);
        let near_m = 0.5 * self.shape.diameter_m();
        sightings
            .iter()
            .find(|sighting| (here - Vector3::from(sighting.position_m)).norm() < near_m)
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

    /// The light after so many seconds of a target and an image that grow darker by these shares.
    fn learnt([of_target, of_image]: [f64; 2], seconds: usize) -> Lighting {
        let mut lighting = Lighting::default();
        for frame in 0..=25 * seconds {
            let share = frame as f64 / (25 * seconds) as f64;
            let [target, image] = [(ORANGE, of_target), (ROOM, of_image)]
                .map(|(rgb, least)| yuv(rgb.map(|level| level * libm::pow(least, share))));
            lighting.learn(yuv(ORANGE), Some([target, image]), frame as f64 / 25.0);
        }
        lighting
    }

    #[test]
    fn light_is_followed_where_the_whole_image_changes_and_little_where_the_target_does_alone() {
        let light = learnt([0.4, 0.4], 10).light;
        assert!(
            (light.brightness - libm::log(0.4)).abs() < 0.12,
            "{light:?}"
        );
        let light = learnt([0.4, 1.0], 60).light;
        assert!((light.brightness + APART[0]).abs() < 0.01, "{light:?}");
        let light = learnt([0.1, 0.05], 60).light;
        assert!((light.brightness + FARTHEST[0]).abs() < 0.01, "{light:?}");
    }

    #[test]
    fn light_is_forgotten_where_the_target_is_not_seen() {
        let mut lighting = learnt([0.4, 0.4], 10);
        lighting.learn(yuv(ORANGE), None, 10.0 + FORGET_S);
        let kept = lighting.light.brightness / libm::log(0.4);
        assert!((0.25..0.37).contains(&kept), "{kept}");
    }
}
