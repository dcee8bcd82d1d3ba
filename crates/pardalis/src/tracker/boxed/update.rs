//! The Bernoulli update with the likelihood of boxes.

use super::BoxedTarget;
use super::Buffers;
use crate::tracker::box_model::{Sight, clipped, log_ratio, sigma_px};
use crate::tracker::detected::Visibility;
use crate::tracker::track::Instant;
use crate::view::View;

/// By how much a particle outside of the target's region is less likely, nats: it is impossible, but should all be outside, one must remain.
const OUTSIDE_NATS: f32 = 50.0;

impl BoxedTarget {
    /// Updates existence and position.
    pub(super) fn update(&mut self, instant: &Instant) {
        let (views, time_s) = (instant.views, instant.time_s);
        let rates = &self.existence.occlusion;
        let own = instant.boxes.iter();
        let own = own.filter(|boxes| boxes.target == self.target);
        let cameras = own.map(|boxes| boxes.camera);
        Visibility::predict_in(&mut self.visibilities, cameras, rates, time_s);
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
                let [_, seen] =
                    visibility.update((log_ratios, self.filter.weights()), 1.0, f32::INFINITY);
                self.track.note_observation(boxes.camera, time_s, [seen; 2]);
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
