//! Confidence interval for the mean of an autocorrelated series.

use pardalis_core::rng::{Draws, Stage};

/// Number of resampled series: five lie beyond each end of a 99 % interval.
const RESAMPLES: u32 = 1000;

/// Returns the 99 % confidence interval of the mean by circular block bootstrap (Politis and Romano 1992):
/// the range of the means of series resampled in blocks from this one. The draws are the same for every call.
/// `None` if the series is shorter than two blocks.
pub(super) fn mean_band_99(values: &[f64]) -> Option<[f64; 2]> {
    let count = values.len();
    let length = block_length(values);
    if count < 2 * length {
        return None;
    }
    // sums[i] is the sum of the first i values of the series, which continues cyclically.
    let mut sums = vec![0.0];
    for value in values.iter().chain(&values[..length]) {
        sums.push(sums[sums.len() - 1] + value);
    }
    let draws = Draws::new(0, 0);
    let mean = |resample| {
        let starts = (0..).step_by(length).zip(0..);
        let blocks = starts.take_while(|&(from, _)| from < count);
        let block = |(from, block)| {
            let start = (draws.uniform(block, resample, Stage::Bootstrap) * count as f64) as usize;
            // The last block is cut to the remaining length.
            sums[start + length.min(count - from)] - sums[start]
        };
        blocks.map(block).sum::<f64>() / count as f64
    };
    let mut means: Vec<f64> = (0..RESAMPLES).map(mean).collect();
    means.sort_by(f64::total_cmp);
    let beyond = RESAMPLES as usize / 200;
    Some([means[beyond], means[means.len() - 1 - beyond]])
}

/// Returns the block length with the smallest error of the variance for an autoregressive series of first
/// order: (6 ρ²/(1 − ρ²)²)^⅓ n^⅓ (Carlstein 1986), with the measured correlation ρ of neighbours. The length
/// is at least n^⅓, in case correlations extend beyond neighbours.
fn block_length(values: &[f64]) -> usize {
    let count = values.len() as f64;
    let mean = values.iter().sum::<f64>() / count;
    let product = |a: f64, b: f64| (a - mean) * (b - mean);
    let variance = values.iter().map(|&v| product(v, v)).sum::<f64>();
    let covariance = values.windows(2).map(|v| product(v[0], v[1])).sum::<f64>();
    // For a constant series any length is equally good, but it must be finite.
    let correlation = (covariance / variance.max(f64::MIN_POSITIVE)).clamp(0.0, 0.999);
    let squared = correlation * correlation;
    let ratio = 6.0 * squared / (1.0 - squared).powi(2);
    libm::cbrt(count.max(1.0) * ratio.max(1.0)).ceil() as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns x' = ρ x + e with normal e of variance 1 around 3, from its steady state.
    fn autoregressive(correlation: f64, count: u32, seed: u32) -> Vec<f64> {
        let normal = |i| f64::from(Draws::new(seed, 1).normals(i, 0, Stage::Pixel, 0)[0]);
        let mut off = normal(count) / (1.0 - correlation * correlation).sqrt();
        (0..count)
            .map(|i| {
                off = correlation * off + normal(i);
                3.0 + off
            })
            .collect()
    }

    #[test]
    fn interval_width_matches_the_uncertainty_of_the_mean() {
        // The variance of the mean of n values is 1/(1 − ρ)²/n up to terms of n⁻². Without correlation it
        // would be 1/(1 − ρ²)/n.
        for (correlation, count) in [(0.0, 500), (0.5, 1000), (0.8, 2000)] {
            let sd = 1.0 / (1.0 - correlation) / f64::from(count).sqrt();
            let half_width = |seed| {
                let series = autoregressive(correlation, count, seed);
                let [low, high] = mean_band_99(&series).unwrap();
                (high - low) / 2.0
            };
            let mean = (0..40).map(half_width).sum::<f64>() / 40.0;
            let ratio = mean / (2.576 * sd);
            // Blocks ignore correlations across their borders, which makes the interval a few percent too
            // narrow.
            assert!((0.88..1.04).contains(&ratio), "{correlation}: {ratio}");
        }
    }

    #[test]
    fn interval_contains_the_true_mean() {
        let holds = |seed| {
            let series = autoregressive(0.8, 400, seed);
            let [low, high] = mean_band_99(&series).unwrap();
            (low..=high).contains(&3.0)
        };
        let held = (0..400).filter(|&seed| holds(seed)).count();
        // 396 of 400 with many blocks; few blocks make the interval narrower.
        assert!((376..=399).contains(&held), "{held} of 400");
    }

    #[test]
    fn short_series_have_no_interval_and_constant_series_a_narrow_one() {
        assert_eq!(mean_band_99(&[]), None);
        assert_eq!(mean_band_99(&[1.0]), None);
        assert_eq!(mean_band_99(&[2.0; 50]), Some([2.0; 2]));
        // A ramp: its two ends differ strongly.
        let slope: Vec<f64> = (0..20).map(f64::from).collect();
        assert_eq!(mean_band_99(&slope), None);
    }
}
