//! Means, standard deviations and quantiles.

use serde::Serialize;

/// Distribution of a non-negative quantity, in the unit of that quantity.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Distribution {
    /// Mean.
    pub mean: f64,
    /// Standard deviation: root mean square deviation from the mean.
    pub sd: f64,
    /// Root mean square.
    pub rmse: f64,
    /// Median. Quantiles are interpolated linearly between order statistics.
    pub median: f64,
    /// 95 % quantile.
    pub p95: f64,
    /// Maximum.
    pub max: f64,
}

/// Mean and standard deviation, in the unit of the quantity.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct MeanSd {
    /// Mean.
    pub mean: f64,
    /// Standard deviation: root mean square deviation from the mean.
    pub sd: f64,
}

/// Computes the distribution of at least one value.
pub(super) fn distribution(mut values: Vec<f64>) -> Distribution {
    values.sort_by(f64::total_cmp);
    let last = values.len() - 1;
    let quantile = |share: f64| {
        let rank = share * last as f64;
        let below = rank.floor() as usize;
        let above = values[(below + 1).min(last)];
        values[below] + (above - values[below]) * rank.fract()
    };
    let MeanSd { mean, sd } = mean_sd(values.iter().copied());
    let squares = values.iter().map(|v| v * v).sum::<f64>();
    Distribution {
        mean,
        sd,
        rmse: (squares / values.len() as f64).sqrt(),
        median: quantile(0.5),
        p95: quantile(0.95),
        max: values[last],
    }
}

/// Computes mean and standard deviation of at least one value.
pub(super) fn mean_sd(values: impl Iterator<Item = f64> + Clone) -> MeanSd {
    let count = values.clone().count() as f64;
    let mean = values.clone().sum::<f64>() / count;
    let variance = values.map(|v| (v - mean).powi(2)).sum::<f64>() / count;
    MeanSd {
        mean,
        sd: variance.sqrt(),
    }
}

/// Computes the mean; `None` if there are no values.
pub(super) fn mean(values: &[f64]) -> Option<f64> {
    (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
}
