//! Visibility, data association and existence of detected targets, naively.

/// The log-likelihood ratio of a frame in which the target is visible with this probability: that of an occluded target is 1.
pub fn mixture_log_ratio(visible: f64, log_ratio: f64) -> f64 {
    (visible * log_ratio.exp() + (1.0 - visible)).ln()
}

/// The visibility after `dt_s` seconds of a Markov chain with these rates (1/s), integrated in small steps.
pub fn predicted_visibility(
    visible: f64,
    occlusion_hz: f64,
    reappearance_hz: f64,
    dt_s: f64,
) -> f64 {
    const STEPS: usize = 100_000;
    let step_s = dt_s / STEPS as f64;
    (0..STEPS).fold(visible, |visible, _| {
        visible + step_s * (reappearance_hz * (1.0 - visible) - occlusion_hz * visible)
    })
}

/// The posterior visibility and the probability to be visible and in view: sums over particles, each with its weight, its frame's log-likelihood ratio and whether the
/// camera has it in view.
pub fn updated_visibility(visible: f64, particles: &[(f64, f64, bool)]) -> [f64; 2] {
    let posterior = |log_ratio: f64| {
        let evidence = visible * log_ratio.exp();
        evidence / (evidence + 1.0 - visible)
    };
    let sum = |counts: &dyn Fn(bool) -> bool| -> f64 {
        let counted = particles.iter().filter(|(_, _, in_view)| counts(*in_view));
        counted
            .map(|(weight, log_ratio, _)| weight * posterior(*log_ratio))
            .sum()
    };
    [sum(&|_| true), sum(&|in_view| in_view)]
}

/// What data association compares a detection with, all densities in 1/m³.
#[derive(Debug, Clone, Copy)]
pub struct Rivals {
    /// Of clutter.
    pub clutter: f64,
    /// Of the target itself, by its prediction.
    pub own: f64,
    /// Of look-alikes that were updated with the same frames.
    pub updated: f64,
    /// Of look-alikes that are only predicted.
    pub predicted: f64,
}

/// The log-weight of a detection whose log-likelihood ratio against clutter is `likeness`: the ratio of the target's likelihood to that of clutter, divided by
/// what updated and predicted look-alikes claim of it.
pub fn association_log_weight(likeness: f64, rivals: &Rivals) -> f64 {
    let ratio = likeness.exp();
    let updated = 1.0 + ratio * rivals.updated / rivals.clutter;
    let predicted = 1.0 + ratio * rivals.predicted / (rivals.clutter + ratio * rivals.own);
    (ratio / rivals.clutter / (updated * predicted)).ln()
}
