//! How well the mean of a series is known whose neighbours resemble one another.

use pardalis_core::rng::{Draws, Stage};

/// How many times the series is drawn anew: five lie beyond either end of a 99 % band.
const RESAMPLES: u32 = 1000;

/// Within which the mean of what the series was drawn from lies with 99 % probability: the band of the means of series that are put together
/// of blocks of this one (circular block bootstrap, Politis and Romano 1992). The draws are the same each time. None of fewer than two blocks.
pub(super) fn mean_band_99(values: &[f64]) -> Option<[f64; 2]> {
    let count = values.len();
    let length = block_length(values);
    if count < 2 * length {
        return None;
    }
    // sums[i]: of the first i values of the series, which begins anew where it ends.
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
            // The last is as long as there is room.
            sums[start + length.min(count - from)] - sums[start]
        };
        blocks.map(block).sum::<f64>() / count as f64
    };
    let mut means: Vec<f64> = (0..RESAMPLES).map(mean).collect();
    means.sort_by(f64::total_cmp);
    let beyond = RESAMPLES as usize / 200;
    Some([means[beyond], means[means.len() - 1 - beyond]])
}

/// The length of blocks that makes the variance of the mean most accurate where the series is autoregressive of first order:
/// (6 ρ²/(1 − ρ²)²)^⅓ n^⅓ (Carlstein 1986), with its correlation ρ of neighbours as it is found; at least n^⅓, in case that correlations reach farther than
/// to neighbours.
fn block_length(values: &[f64]) -> usize {
    let count = values.len() as f64;
    let mean = values.iter().sum::<f64>() / count;
    let product = |a: f64, b: f64| (a - mean) * (b - mean);
    let variance = values.iter().map(|&v| product(v, v)).sum::<f64>();
    let covariance = values.windows(2).map(|v| product(v[0], v[1])).sum::<f64>();
    // Where the series never changes any length is as good; none may be endless.
    let correlation = (covariance / variance.max(f64::MIN_POSITIVE)).clamp(0.0, 0.999);
    let squared = correlation * correlation;
    let ratio = 6.0 * squared / (1.0 - squared).powi(2);
    libm::cbrt(count.max(1.0) * ratio.max(1.0)).ceil() as usize
}

#[cfg(test)]
mod tests {
    use super::*;

    /// x' = ρ x + e with normal e of variance 1, around 3, from its steady state.
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
    fn bands_are_as_wide_as_the_mean_is_uncertain() {
        // The variance of the mean of n is 1/(1 − ρ)²/n, but for terms of n⁻²; without regard to ρ it would be taken for 1/(1 − ρ²)/n.
        for (correlation, count) in [(0.0, 500), (0.5, 1000), (0.8, 2000)] {
            let sd = 1.0 / (1.0 - correlation) / f64::from(count).sqrt();
            let half_width = |seed| {
                let series = autoregressive(correlation, count, seed);
                let [low, high] = mean_band_99(&series).unwrap();
                (high - low) / 2.0
            };
            let mean = (0..40).map(half_width).sum::<f64>() / 40.0;
            let ratio = mean / (2.576 * sd);
            // Blocks leave out what holds between them: some per cent too narrow.
            assert!((0.88..1.04).contains(&ratio), "{correlation}: {ratio}");
        }
    }

    #[test]
    fn bands_hold_the_true_mean() {
        let holds = |seed| {
            let series = autoregressive(0.8, 400, seed);
            let [low, high] = mean_band_99(&series).unwrap();
            (low..=high).contains(&3.0)
        };
        let held = (0..400).filter(|&seed| holds(seed)).count();
        // 396 of 400 with blocks of any number; few of them make the band narrower.
        assert!((376..=399).contains(&held), "{held} of 400");
    }

    #[test]
    fn what_is_too_short_or_never_changes_has_no_band_or_a_narrow_one() {
        assert_eq!(mean_band_99(&[]), None);
        assert_eq!(mean_band_99(&[1.0]), None);
        assert_eq!(mean_band_99(&[2.0; 50]), Some([2.0; 2]));
        // One slope: its ends resemble each other not at all.
        let slope: Vec<f64> = (0..20).map(f64::from).collect();
        assert_eq!(mean_band_99(&slope), None);
    }
}
