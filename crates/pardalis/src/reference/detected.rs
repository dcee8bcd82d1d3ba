//! Naive implementations of the visibility, data association and existence of detected targets.

/// Returns the log-likelihood ratio of a frame in which the target is visible with this probability. The likelihood
/// ratio of an occluded target is 1.
pub fn mixture_log_ratio(visible: f64, log_ratio: f64) -> f64 {
    (visible * log_ratio.exp() + (1.0 - visible)).ln()
}

/// Returns the visibility after `dt_s` seconds of a Markov chain with these rates (1/s), integrated in small steps.
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

/// Returns the posterior visibility, and the probability of being both visible and in view. Each particle has a
/// weight, a log-likelihood ratio, and a flag for whether it is in the camera's view.
pub fn updated_visibility(visible: f64, particles: &[(f64, f64, bool)]) -> [f64; 2] {
    let posterior = |log_ratio: f64| {
        let weighted = visible * log_ratio.exp();
        weighted / (weighted + 1.0 - visible)
    };
    let sum = |counts: &dyn Fn(bool) -> bool| -> f64 {
        let counted = particles.iter().filter(|(_, _, in_view)| counts(*in_view));
        counted
            .map(|(weight, log_ratio, _)| weight * posterior(*log_ratio))
            .sum()
    };
    [sum(&|_| true), sum(&|in_view| in_view)]
}

/// Densities with which data association compares a detection, in 1/m³.
#[derive(Debug, Clone, Copy)]
pub struct Rivals {
    /// Density of clutter.
    pub clutter: f64,
    /// Predicted density of the target itself.
    pub own: f64,
    /// Density of look-alikes that were updated with the same frames.
    pub updated: f64,
    /// Density of look-alikes that are only predicted.
    pub predicted: f64,
}

/// Returns the log-weight of a detection with this log-likelihood ratio against clutter: the ratio of the target's
/// likelihood to that of clutter, divided by the claims of updated and predicted look-alikes.
pub fn association_log_weight(log_ratio: f64, rivals: &Rivals) -> f64 {
    let ratio = log_ratio.exp();
    let updated = 1.0 + ratio * rivals.updated / rivals.clutter;
    let predicted = 1.0 + ratio * rivals.predicted / (rivals.clutter + ratio * rivals.own);
    (ratio / rivals.clutter / (updated * predicted)).ln()
}

/// Returns the likeliest logarithm of a scale and its standard deviation, given a measurement with Gaussian errors and a prior around 0 with the tails of a Cauchy
/// distribution: the greatest of a fine grid, and the curvature there, to which the prior's tails add nothing.
pub fn size_posterior(tolerance: f64, measured: f64, sigma: f64) -> [f64; 2] {
    const STEP: f64 = 1e-5;
    let of_prior = |x: f64| -(1.0 + 0.5 * (x / tolerance).powi(2)).ln();
    let of_measurement = |x: f64| -0.5 * ((x - measured) / sigma).powi(2);
    let grid = (-100_000..=100_000).map(|i| STEP * f64::from(i));
    let density = |x: f64| of_prior(x) + of_measurement(x);
    let likeliest = grid.max_by(|a, b| density(*a).total_cmp(&density(*b)));
    let likeliest = likeliest.unwrap_or(0.0);
    let bend = |f: &dyn Fn(f64) -> f64| {
        let wide = 1e-4;
        (2.0 * f(likeliest) - f(likeliest - wide) - f(likeliest + wide)) / (wide * wide)
    };
    let information = bend(&of_prior).max(0.0) + bend(&of_measurement);
    [likeliest, 1.0 / information.sqrt()]
}
