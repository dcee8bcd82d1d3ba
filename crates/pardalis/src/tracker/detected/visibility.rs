//! Step 4, visibility: whether each camera sees the target or something occludes it, as a Markov chain of two states in continuous time.

use crate::tracker::existence::OcclusionRates;

/// The log-likelihood ratio that the edge cue gives to particles outside a camera's image, nats. Derivation: such a frame says nothing.
const OUT_OF_VIEW_LOG_RATIO: f32 = 0.0;

/// The visibility of a target in one camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::tracker) struct Visibility {
    /// The probability that nothing occludes the target.
    visible: f64,
    /// The time for which it holds, in seconds.
    time_s: f64,
}

impl Visibility {
    /// That of a camera without any frame before this time.
    fn new(rates: &OcclusionRates, time_s: f64) -> Self {
        Self {
            visible: rates.stationary(),
            time_s,
        }
    }

    /// Predicts to a later time, in seconds.
    fn predict(&mut self, rates: &OcclusionRates, time_s: f64) {
        let both_hz = rates.occlusion_hz + rates.reappearance_hz;
        let stationary = rates.stationary();
        let kept = libm::exp(-both_hz * (time_s - self.time_s).max(0.0));
        self.visible = stationary + (self.visible - stationary) * kept;
        self.time_s = time_s;
    }

    /// Predicts those in these cameras, of all, to a later time, in seconds.
    pub(in crate::tracker) fn predict_in(
        all: &mut [Option<Self>],
        cameras: impl Iterator<Item = usize>,
        rates: &OcclusionRates,
        time_s: f64,
    ) {
        for camera in cameras {
            let visibility = all[camera].get_or_insert(Self::new(rates, time_s));
            visibility.predict(rates, time_s);
        }
    }

    /// The log-likelihood ratio of a frame, given that of the visible target: the frame of an occluded target says nothing.
    pub(in crate::tracker) fn mixture_log_ratio(&self, log_ratio: f32) -> f32 {
        let visible = self.visible as f32;
        let most = log_ratio.max(0.0);
        most + libm::logf(
            visible * libm::expf(log_ratio - most) + (1.0 - visible) * libm::expf(-most),
        )
    }

    /// The posterior probability that the target is visible, given the log-likelihood ratio of a frame.
    fn posterior(&self, log_ratio: f32) -> f64 {
        let log_ratio = f64::from(log_ratio);
        if self.visible >= 1.0 {
            return 1.0;
        }
        let odds = self.visible / (1.0 - self.visible) * libm::exp(log_ratio.min(700.0));
        odds / (1.0 + odds)
    }

    /// Updates with the log-likelihood ratios and weights of the particles. A partly occluded target, with this visible share of its outline, will probably be
    /// occluded. Returns the probability that the target is visible and in view; first if no log-likelihood ratio counts as more than `most`, because what is seen there may be
    /// something else. The chain itself is not bounded: otherwise frames without the target would be excused as occlusion.
    pub(in crate::tracker) fn update(
        &mut self,
        (log_ratios, weights): (&[f32], &[f64]),
        visible_share: f64,
        most: f32,
    ) -> [f64; 2] {
        let of_particle = |(&log_ratio, &weight): (&f32, &f64)| {
            let bounded = weight * self.posterior(log_ratio.min(most));
            let visible = weight * self.posterior(log_ratio);
            if log_ratio == OUT_OF_VIEW_LOG_RATIO {
                [visible, 0.0, 0.0]
            } else {
                [visible, bounded, visible]
            }
        };
        let [visible, bounded, seen] = log_ratios
            .iter()
            .zip(weights)
            .map(of_particle)
            .fold([0.0; 3], |sums, of_one| {
                std::array::from_fn(|i| sums[i] + of_one[i])
            });
        self.visible = visible_share * visible.clamp(0.0, 1.0);
        [bounded, seen].map(|seen| seen.clamp(0.0, 1.0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::reference;

    fn at(visible: f64) -> Visibility {
        Visibility {
            visible,
            time_s: 0.0,
        }
    }

    #[test]
    fn two_half_steps_equal_one_and_the_start_is_forgotten() {
        let rates = OcclusionRates::default();
        let (mut whole, mut halves) = (at(1.0), at(1.0));
        whole.predict(&rates, 0.5);
        halves.predict(&rates, 0.25);
        halves.predict(&rates, 0.5);
        assert!((whole.visible - halves.visible).abs() < 1e-12);
        assert!(whole.visible < 1.0 && whole.visible > 2.0 / 3.0);
        whole.predict(&rates, 1000.0);
        assert!((whole.visible - 2.0 / 3.0).abs() < 1e-12);
    }

    #[test]
    fn frames_of_an_occluded_target_say_nothing() {
        assert_eq!(at(0.0).mixture_log_ratio(-8.0), 0.0);
        assert!((at(1.0).mixture_log_ratio(-8.0) + 8.0).abs() < 1e-5);
        assert!((at(0.5).mixture_log_ratio(300.0) - 300.0 - 0.5_f32.ln()).abs() < 1e-3);
        let expected = (0.9 * (-8.0_f32).exp() + 0.1).ln();
        assert!((at(0.9).mixture_log_ratio(-8.0) - expected).abs() < 1e-6);
        assert!((at(0.5).posterior(0.0) - 0.5).abs() < 1e-12);
        assert!(at(0.9).posterior(-20.0) < 1e-6 && at(0.1).posterior(1000.0) > 1.0 - 1e-12);
    }

    #[test]
    fn all_is_the_oracles() {
        let rates = OcclusionRates::default();
        for visible in [0.05, 0.5, 0.93] {
            for dt_s in [0.04, 0.7, 3.0] {
                let mut predicted = at(visible);
                predicted.predict(&rates, dt_s);
                let naive = reference::predicted_visibility(
                    visible,
                    rates.occlusion_hz,
                    rates.reappearance_hz,
                    dt_s,
                );
                assert!((predicted.visible - naive).abs() < 1e-4, "{naive}");
            }
            for log_ratio in [-20.0, -7.0, -0.3, 0.0, 2.0, 30.0] {
                let naive = reference::mixture_log_ratio(visible, f64::from(log_ratio));
                let fast = f64::from(at(visible).mixture_log_ratio(log_ratio));
                assert!(
                    (fast - naive).abs() < 1e-5 * naive.abs().max(1.0),
                    "{fast} {naive}"
                );
            }
            let particles = [(0.5, 3.0, true), (0.3, -5.0, true), (0.2, 0.0, false)];
            let [visible_now, seen] = reference::updated_visibility(visible, &particles);
            let (log_ratios, weights) = ([3.0, -5.0, 0.0], [0.5, 0.3, 0.2]);
            let mut updated = at(visible);
            let [_, found] = updated.update((&log_ratios, &weights), 0.8, f32::INFINITY);
            assert!((found - seen).abs() < 1e-12, "{found} {seen}");
            assert!((updated.visible - 0.8 * visible_now).abs() < 1e-12);
            let bounded = particles.map(|(weight, log_ratio, in_view)| {
                let log_ratio: f64 = log_ratio;
                (weight, log_ratio.min(-1.0), in_view)
            });
            let [_, seen] = reference::updated_visibility(visible, &bounded);
            let mut updated = at(visible);
            let [found, _] = updated.update((&log_ratios, &weights), 0.8, -1.0);
            assert!((found - seen).abs() < 1e-12, "{found} {seen}");
            assert!((updated.visible - 0.8 * visible_now).abs() < 1e-12);
        }
    }

    #[test]
    fn particles_out_of_view_do_not_count_as_seen() {
        let mut visibility = at(0.5);
        let [_, seen] = visibility.update((&[9.0, 0.0], &[0.5, 0.5]), 1.0, f32::INFINITY);
        assert!((seen - 0.5).abs() < 1e-3, "{seen}");
        assert!((visibility.visible - 0.75).abs() < 1e-3, "{visibility:?}");
        visibility.update((&[9.0, 9.0], &[0.5, 0.5]), 0.25, f32::INFINITY);
        assert!((visibility.visible - 0.25).abs() < 1e-3, "{visibility:?}");
    }
}
