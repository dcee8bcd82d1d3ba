//! The size of a ball that several cameras see, or that stays on the ground: it does not change, so that frames add up.

use crate::likelihood::edge::{FormEvidence, SizePrior};
use crate::tuning::SizeTuning;

/// Steps towards the likeliest size. Derivation: each at least halves what is left.
const STEPS: usize = 60;

/// The size of a target: what is known beforehand, and the sum of what the frames say.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Size {
    prior: SizePrior,
    /// The sum of the frames' information, ...
    information: f64,
    /// ... its product with the logarithms of the scale, ...
    weighted: f64,
    /// ... and with the inverse radii of outlines in pixels.
    inverse_px: f64,
    /// The posterior.
    known: SizePrior,
}

impl Size {
    /// What is known before the first frames.
    pub(super) fn new(prior: SizePrior) -> Self {
        Self {
            prior,
            information: 0.0,
            weighted: 0.0,
            inverse_px: 0.0,
            known: prior,
        }
    }

    /// What is known now.
    pub(super) fn known(&self) -> SizePrior {
        self.known
    }

    /// Whether frames have said anything.
    pub(super) fn is_estimated(&self) -> bool {
        self.information > 0.0
    }

    /// Forgets all frames.
    pub(super) fn reset(&mut self) {
        *self = Self::new(self.prior);
    }

    /// Adds what the frames of one instant say. Errors of the outlines' radii that all frames share have this standard deviation in pixels.
    pub(super) fn update(
        &mut self,
        evidence: &FormEvidence,
        shared_sigma_px: f64,
        tuning: &SizeTuning,
    ) {
        // Frames long past fade, so that those of another thing do not stay.
        let kept = 1.0 - 1.0 / tuning.memory_frames;
        self.information = kept * self.information + evidence.information;
        self.weighted = kept * self.weighted + evidence.information * evidence.form;
        self.inverse_px = kept * self.inverse_px + evidence.information / evidence.px_per_unit;
        let mean = self.weighted / self.information;
        let shared_sigma = shared_sigma_px * self.inverse_px / self.information;
        let variance = 1.0 / self.information + shared_sigma * shared_sigma;
        self.known = posterior(&self.prior, mean, variance);
    }
}

/// The most likely size near a measured mean of the logarithm of the scale, and its standard deviation.
fn posterior(prior: &SizePrior, mean: f64, variance: f64) -> SizePrior {
    let mut log_scale = mean;
    for _ in 0..STEPS {
        let information = prior.information(log_scale);
        log_scale =
            (mean / variance + information * prior.log_scale) / (1.0 / variance + information);
    }
    SizePrior {
        log_scale,
        sigma: 1.0 / (1.0 / variance + prior.curvature(log_scale)).sqrt(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::reference;

    const PRIOR: SizePrior = SizePrior {
        log_scale: 0.0,
        sigma: 0.02,
    };

    fn evidence(log_scale: f64, sigma: f64) -> FormEvidence {
        FormEvidence {
            form: log_scale,
            information: sigma.powi(-2),
            px_per_unit: 20.0,
        }
    }

    #[test]
    fn posteriors_are_the_oracles() {
        for measured in [-0.22, -0.05, 0.0, 0.01, 0.03, 0.1, 0.69] {
            for sigma in [0.002, 0.007, 0.02] {
                let found = posterior(&PRIOR, measured, sigma * sigma);
                let [log_scale, of_scale] = reference::size_posterior(0.02, measured, sigma);
                assert!(
                    (found.log_scale - log_scale).abs() < 2e-5,
                    "{measured} {sigma}: {found:?} {log_scale}"
                );
                assert!(
                    (found.sigma / of_scale - 1.0).abs() < 0.01,
                    "{measured} {sigma}: {found:?} {of_scale}"
                );
            }
        }
    }

    #[test]
    fn frames_add_up_but_for_the_errors_that_they_share() {
        let mut size = Size::new(PRIOR);
        assert!(!size.is_estimated());
        for frame in 0..2000 {
            let off = if frame % 2 == 0 { 0.01 } else { -0.01 };
            size.update(&evidence(0.1 + off, 0.01), 0.1, &SizeTuning::DEFAULT);
        }
        let known = size.known();
        // The shared error is 0.1 px of 20 px.
        assert!(
            (known.sigma - 0.005).abs() < 3e-4 && (known.log_scale - 0.1).abs() < 2e-3,
            "{known:?}"
        );
        size.reset();
        assert!(!size.is_estimated() && size.known() == PRIOR);
    }

    #[test]
    fn what_another_thing_said_fades() {
        let mut size = Size::new(PRIOR);
        let tuning = SizeTuning::DEFAULT;
        for _ in 0..50 {
            size.update(&evidence(0.5, 0.01), 0.1, &tuning);
        }
        for _ in 0..4 * tuning.memory_frames as usize {
            size.update(&evidence(0.0, 0.01), 0.1, &tuning);
        }
        assert!(size.known().log_scale.abs() < 0.005, "{size:?}");
    }
}
