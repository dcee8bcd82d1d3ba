//! Histograms of red, green and blue, each on its own.

use serde::Deserialize;

/// Steps of a channel that are kept.
const STEPS: usize = 64;

/// What a target's pixels, and all others of the images it was learnt from, have of each channel.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ChannelHistograms {
    red: Vec<u64>,
    green: Vec<u64>,
    blue: Vec<u64>,
    background_red: Vec<u64>,
    background_green: Vec<u64>,
    background_blue: Vec<u64>,
}

impl ChannelHistograms {
    /// Shares.
    pub fn shares(&self, bins: usize) -> [Vec<f64>; 3] {
        [&self.red, &self.green, &self.blue].map(|c| shares(c, bins))
    }

    /// Shares.
    pub fn background_shares(&self, bins: usize) -> [Vec<f64>; 3] {
        [
            &self.background_red,
            &self.background_green,
            &self.background_blue,
        ]
        .map(|c| shares(c, bins))
    }
}

fn shares(counts: &[u64], bins: usize) -> Vec<f64> {
    let total: u64 = counts.iter().sum();
    counts
        .chunks(STEPS / bins)
        .map(|c| c.iter().sum::<u64>() as f64 / total as f64)
        .collect()
}
