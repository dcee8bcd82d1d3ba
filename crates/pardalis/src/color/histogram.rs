//! Colour histograms and their similarity.

/// Shares of pixels over the bins of a palette, which sum to one (Taiana 2007, eq. 4.9).
#[derive(Debug, Clone, PartialEq)]
pub struct Histogram {
    shares: Vec<f64>,
}

impl Histogram {
    /// Normalises counts; `None` if they are all zero.
    pub fn from_counts(counts: &[u64]) -> Option<Self> {
        let total: u64 = counts.iter().sum();
        (total > 0).then(|| Self {
            shares: counts.iter().map(|&n| n as f64 / total as f64).collect(),
        })
    }

    /// Returns the share of each bin.
    pub fn shares(&self) -> &[f64] {
        &self.shares
    }

    /// Computes the Bhattacharyya similarity: 1 for equal histograms, 0 for disjoint ones (Taiana 2007, eq.
    /// 4.10).
    ///
    /// # Panics
    ///
    /// The histograms differ in their number of bins.
    pub fn similarity(&self, other: &Self) -> f64 {
        assert_eq!(
            self.shares.len(),
            other.shares.len(),
            "histograms of one palette"
        );
        self.shares
            .iter()
            .zip(&other.shares)
            .map(|(a, b)| (a * b).sqrt())
            .sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn similarity_is_one_if_equal_zero_if_disjoint_and_exact_in_between() {
        let of = |counts: &[u64]| Histogram::from_counts(counts).unwrap();
        assert!((of(&[3, 1, 0]).similarity(&of(&[6, 2, 0])) - 1.0).abs() < 1e-15);
        assert_eq!(of(&[3, 0, 0]).similarity(&of(&[0, 1, 1])), 0.0);
        let expected = (0.5_f64 * 0.25).sqrt() + (0.5_f64 * 0.75).sqrt();
        assert!((of(&[1, 1]).similarity(&of(&[1, 3])) - expected).abs() < 1e-15);
        assert!(Histogram::from_counts(&[0, 0]).is_none());
    }
}
