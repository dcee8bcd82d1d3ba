//! Whether a camera sees the target: visible or hidden, and how long either lasts.

/// How often a target that a camera sees is hidden from it by something, and how often one that is hidden comes forth, a second.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OcclusionRates {
    /// Of what is seen, a second.
    pub occlusion_hz: f64,
    /// Of what is hidden, a second.
    pub reappearance_hz: f64,
}

impl Default for OcclusionRates {
    fn default() -> Self {
        Self {
            occlusion_hz: 0.5,
            reappearance_hz: 1.0,
        }
    }
}

/// What is known of one camera's sight of a target.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Sight {
    /// The probability that nothing hides the target from it.
    pub(super) visible: f64,
    /// The probability that the target lies in its image and is seen there.
    pub(super) sees: f64,
    /// The time of its last frame, in seconds.
    pub(super) time_s: f64,
}

impl Sight {
    /// Of a camera that never had a frame.
    pub(super) fn new(rates: &OcclusionRates, time_s: f64) -> Self {
        Self {
            visible: rates.reappearance_hz / (rates.reappearance_hz + rates.occlusion_hz),
            sees: 0.0,
            time_s,
        }
    }

    /// Lets time pass: a Markov chain of two states.
    pub(super) fn predict(&mut self, rates: &OcclusionRates, time_s: f64) {
        let both_hz = rates.occlusion_hz + rates.reappearance_hz;
        let settled = rates.reappearance_hz / both_hz;
        let kept = libm::exp(-both_hz * (time_s - self.time_s).max(0.0));
        self.visible = settled + (self.visible - settled) * kept;
        self.time_s = time_s;
    }

    /// ln of the likelihood ratio of a frame whose ratio is this where the target is visible: where it is hidden, the frame says nothing.
    pub(super) fn mixed(&self, log_ratio: f32) -> f32 {
        let visible = self.visible as f32;
        let most = log_ratio.max(0.0);
        most + libm::logf(
            visible * libm::expf(log_ratio - most) + (1.0 - visible) * libm::expf(-most),
        )
    }

    /// The probability that the target is visible, given a frame of this log ratio.
    pub(super) fn given(&self, log_ratio: f32) -> f64 {
        let log_ratio = f64::from(log_ratio);
        if self.visible >= 1.0 {
            return 1.0;
        }
        let odds = self.visible / (1.0 - self.visible) * libm::exp(log_ratio.min(700.0));
        odds / (1.0 + odds)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_half_steps_are_one_and_all_is_forgotten_in_the_end() {
        let rates = OcclusionRates::default();
        let seen = Sight {
            visible: 1.0,
            sees: 1.0,
            time_s: 0.0,
        };
        let (mut whole, mut halves) = (seen, seen);
        whole.predict(&rates, 0.5);
        halves.predict(&rates, 0.25);
        halves.predict(&rates, 0.5);
        assert!((whole.visible - halves.visible).abs() < 1e-12);
        assert!(whole.visible < 1.0 && whole.visible > 2.0 / 3.0);
        whole.predict(&rates, 1000.0);
        assert!((whole.visible - 2.0 / 3.0).abs() < 1e-12);
    }

    #[test]
    fn what_a_hidden_target_would_show_says_nothing() {
        let rates = OcclusionRates::default();
        let sight = |visible| Sight {
            visible,
            ..Sight::new(&rates, 0.0)
        };
        assert_eq!(sight(0.0).mixed(-8.0), 0.0);
        assert!((sight(1.0).mixed(-8.0) + 8.0).abs() < 1e-5);
        assert!((sight(0.5).mixed(300.0) - 300.0 - 0.5_f32.ln()).abs() < 1e-3);
        let expected = (0.9 * (-8.0_f32).exp() + 0.1).ln();
        assert!((sight(0.9).mixed(-8.0) - expected).abs() < 1e-6);
        assert!((sight(0.5).given(0.0) - 0.5).abs() < 1e-12);
        assert!(sight(0.9).given(-20.0) < 1e-6 && sight(0.1).given(1000.0) > 1.0 - 1e-12);
    }
}
