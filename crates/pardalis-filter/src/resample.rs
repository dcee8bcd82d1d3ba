//! Resampling schemes.
//!
//! Each scheme is a function from weights, which sum to one, and uniform numbers in `[0, 1)` to
//! ancestors: `ancestors[i]` is the index of the particle whose state particle `i` copies. All
//! schemes are unbiased: the expected number of copies of a particle is its weight times the number
//! of particles (Douc, Cappé and Moulines 2005).

/// Scheme that selects the surviving particles.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(
    feature = "serde",
    derive(serde::Deserialize, serde::Serialize),
    serde(rename_all = "lowercase")
)]
pub enum Resampling {
    /// Independent draws, as in the published trackers. Has the largest variance.
    Multinomial,
    /// One draw from each of N equal strata.
    Stratified,
    /// N equally spaced points with one common random offset (the default).
    #[default]
    Systematic,
    /// Deterministic whole copies, and a multinomial draw for the remainders.
    Residual,
}

impl Resampling {
    /// Selects `ancestors.len()` survivors. `uniform(i)` returns the i-th uniform number. `scratch`
    /// must have the length of `weights`.
    pub fn draw(
        self,
        weights: &[f64],
        uniform: impl FnMut(usize) -> f64,
        ancestors: &mut [u32],
        scratch: &mut [f64],
    ) {
        match self {
            Self::Multinomial => multinomial(weights, uniform, ancestors, scratch),
            Self::Stratified => stratified(weights, uniform, ancestors),
            Self::Systematic => systematic(weights, uniform, ancestors),
            Self::Residual => residual(weights, uniform, ancestors, scratch),
        }
    }
}

/// Selects survivors by N independent draws.
pub fn multinomial(
    weights: &[f64],
    uniform: impl FnMut(usize) -> f64,
    ancestors: &mut [u32],
    scratch: &mut [f64],
) {
    let mut sum = 0.0;
    for (cumulative, &weight) in scratch.iter_mut().zip(weights) {
        sum += weight;
        *cumulative = sum;
    }
    search(scratch, uniform, ancestors);
}

/// Draws independently from cumulative weights.
fn search(cumulative: &[f64], mut uniform: impl FnMut(usize) -> f64, ancestors: &mut [u32]) {
    let last = cumulative.len() - 1;
    for (i, ancestor) in ancestors.iter_mut().enumerate() {
        let target = uniform(i) * cumulative[last];
        *ancestor = cumulative.partition_point(|&c| c <= target).min(last) as u32;
    }
}

/// Selects survivors by one draw from each of N equal strata of the cumulative weights.
pub fn stratified(weights: &[f64], mut uniform: impl FnMut(usize) -> f64, ancestors: &mut [u32]) {
    let count = ancestors.len() as f64;
    walk(weights, |i| (i as f64 + uniform(i)) / count, ancestors);
}

/// Selects survivors at N equally spaced points of the cumulative weights with a common random
/// offset.
pub fn systematic(weights: &[f64], mut uniform: impl FnMut(usize) -> f64, ancestors: &mut [u32]) {
    let count = ancestors.len() as f64;
    let offset = uniform(0);
    walk(weights, |i| (i as f64 + offset) / count, ancestors);
}

/// Looks up increasing points in the cumulative weights.
fn walk(weights: &[f64], mut point: impl FnMut(usize) -> f64, ancestors: &mut [u32]) {
    let total: f64 = weights.iter().sum();
    let last = weights.len() - 1;
    let (mut particle, mut cumulative) = (0, weights[0]);
    for (i, ancestor) in ancestors.iter_mut().enumerate() {
        let target = point(i) * total;
        while cumulative <= target && particle < last {
            particle += 1;
            cumulative += weights[particle];
        }
        *ancestor = particle as u32;
    }
}

/// Selects ⌊N·weight⌋ copies of each particle and draws the rest independently from the remainders
/// (Liu and Chen 1998).
pub fn residual(
    weights: &[f64],
    uniform: impl FnMut(usize) -> f64,
    ancestors: &mut [u32],
    scratch: &mut [f64],
) {
    let total: f64 = weights.iter().sum();
    let count = ancestors.len();
    let mut filled = 0;
    let mut remainder_sum = 0.0;
    for (particle, &weight) in weights.iter().enumerate() {
        let share = weight / total * count as f64;
        let copies = (share.floor() as usize).min(count - filled);
        ancestors[filled..filled + copies].fill(particle as u32);
        filled += copies;
        remainder_sum += (share - copies as f64).max(0.0);
        scratch[particle] = remainder_sum;
    }
    search(scratch, uniform, &mut ancestors[filled..]);
}

#[cfg(test)]
mod tests {
    use super::*;
    use pardalis_core::rng::{Draws, Stage};

    const SCHEMES: [Resampling; 4] = [
        Resampling::Multinomial,
        Resampling::Stratified,
        Resampling::Systematic,
        Resampling::Residual,
    ];

    fn copies(scheme: Resampling, weights: &[f64], count: usize, seed: u32) -> Vec<f64> {
        let draws = Draws::new(seed, 0);
        let mut ancestors = vec![0; count];
        let mut scratch = vec![0.0; weights.len()];
        scheme.draw(
            weights,
            |i| draws.uniform(i as u32, 0, Stage::Resampling),
            &mut ancestors,
            &mut scratch,
        );
        let mut copies = vec![0.0; weights.len()];
        for ancestor in ancestors {
            copies[ancestor as usize] += 1.0;
        }
        copies
    }

    #[test]
    fn schemes_are_unbiased_and_keep_their_bounds_on_copies() {
        let weights = [0.05, 0.0, 0.31, 0.24, 0.4];
        let (count, rounds) = (20, 4000);
        for scheme in SCHEMES {
            let mut sum = [0.0; 5];
            for seed in 0..rounds {
                let copies = copies(scheme, &weights, count, seed);
                assert_eq!(copies.iter().sum::<f64>(), count as f64);
                for (i, (total, &n)) in sum.iter_mut().zip(&copies).enumerate() {
                    *total += n;
                    let expected = count as f64 * weights[i];
                    let closest = match scheme {
                        Resampling::Multinomial | Resampling::Residual => f64::INFINITY,
                        Resampling::Stratified => 2.0,
                        Resampling::Systematic => 1.0,
                    };
                    assert!(
                        (n - expected).abs() < closest,
                        "{scheme:?}: {n} copies for {expected}"
                    );
                    if scheme == Resampling::Residual {
                        assert!(
                            n >= (expected + 1e-9).floor(),
                            "{scheme:?}: {n} copies for {expected}"
                        );
                    }
                }
            }
            for (total, weight) in sum.iter().zip(weights) {
                let mean = total / f64::from(rounds);
                let sigma = (count as f64 * weight * (1.0 - weight) / f64::from(rounds)).sqrt();
                assert!(
                    (mean - count as f64 * weight).abs() <= 4.5 * sigma,
                    "{scheme:?}: {mean} for {weight}"
                );
            }
        }
    }

    #[test]
    fn a_particle_with_all_the_weight_gets_all_copies() {
        for scheme in SCHEMES {
            assert_eq!(copies(scheme, &[0.0, 1.0, 0.0], 7, 1), [0.0, 7.0, 0.0]);
            assert_eq!(copies(scheme, &[1.0], 1, 1), [1.0]);
        }
    }
}
