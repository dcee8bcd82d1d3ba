//! The Bernoulli update with the likelihood of boxes.

use super::BoxedTarget;
use super::Buffers;
use super::body_box::BodyBox;
use super::sight::{Sight, clipped, share_within, sigma_px};
use crate::tracker::detected::Visibility;
use crate::tracker::settings::DetectorSettings;
use crate::tracker::track::Instant;
use crate::view::View;

/// By how much a particle outside of the target's region is less likely, nats: it is impossible, but should all be outside, one must remain.
const OUTSIDE_NATS: f32 = 50.0;

impl BoxedTarget {
    /// Updates existence and position.
    pub(super) fn update(&mut self, instant: &Instant) {
        let (views, time_s) = (instant.views, instant.time_s);
        let rates = &self.existence.occlusion;
        let cameras = || {
            let own = instant
                .boxes
                .iter()
                .filter(|boxes| boxes.target == self.target);
            own.map(|boxes| boxes.camera)
        };
        for camera in cameras() {
            let visibility = &mut self.visibilities[camera];
            let visibility = visibility.get_or_insert(Visibility::new(rates, time_s));
            visibility.predict(rates, time_s);
        }
        let Self {
            body,
            detector,
            existence,
            filter,
            visibilities,
            log_ratios,
            buffers,
            ..
        } = self;
        let sights = &buffers.sights;
        filter.update(&buffers.components, f64::INFINITY, |particles, out| {
            out.fill(0.0);
            let [x, y, z] = particles.positions_m();
            let places = x.iter().zip(y).zip(z);
            let places = places.map(|((&x, &y), &z)| [x, y, z].map(f64::from));
            for boxes in instant.boxes {
                if boxes.target != self.target {
                    continue;
                }
                let view = &views[boxes.camera];
                let of_camera = &mut log_ratios[boxes.camera];
                of_camera.clear();
                of_camera.extend(places.clone().map(|position_m| {
                    let seen = sights.iter().filter(|sight| sight.camera == boxes.camera);
                    log_ratio((&body.outline, view), position_m, seen, detector) as f32
                }));
                if let Some(visibility) = &visibilities[boxes.camera] {
                    for (sum, &log_ratio) in out.iter_mut().zip(&*of_camera) {
                        *sum += visibility.mixture_log_ratio(log_ratio);
                    }
                }
            }
            for (sum, position_m) in out.iter_mut().zip(places) {
                if !existence.region.contains(position_m) {
                    *sum -= OUTSIDE_NATS;
                }
            }
        });
        for boxes in instant.boxes {
            if boxes.target == self.target
                && let Some(visibility) = &mut self.visibilities[boxes.camera]
            {
                let log_ratios = &self.log_ratios[boxes.camera];
                let seen = visibility.update(log_ratios, self.filter.weights(), 1.0);
                self.track.note_observation(boxes.camera, time_s, seen);
            }
        }
    }

    /// Finds the boxes that are the body's, and where they put it.
    pub(super) fn find(&mut self, views: &[View]) {
        let Buffers { sights, own, .. } = &mut self.buffers;
        own.clear();
        let Some(known) = self.filter.estimate(0.0) else {
            return;
        };
        for (camera, view) in views.iter().enumerate() {
            let outline = self.body.outline.sides_px(view, known.position_m, 1.0);
            let Some(outline) = outline.map(|sides| clipped(sides, view.size())) else {
                continue;
            };
            let likeness = |number: usize| {
                let sight: &Sight = &sights[number];
                sight.ratio(outline, sigma_px(outline, &self.detector))
            };
            let of_camera = (0..sights.len()).filter(|number| sights[*number].camera == camera);
            let likely = of_camera.map(|number| (number, likeness(number)));
            let likely = likely.filter(|(_, ratio)| *ratio > 1.0);
            let best = likely.reduce(|best, next| if next.1 > best.1 { next } else { best });
            own.extend(best.map(|(number, _)| number));
        }
        let fit = if own.is_empty() {
            None
        } else {
            let own = own.iter().map(|number| &sights[*number]);
            self.body.fit(views, own, known.position_m.into())
        };
        if let Some(fit) = fit {
            self.drift_m = fit.drift_m;
            let greatest_m2 = fit.covariance_m2.symmetric_eigenvalues().max();
            self.near_m = (2.0 * libm::sqrt(greatest_m2)).max(self.body.diameter_m);
        }
        self.found = fit;
    }
}

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
