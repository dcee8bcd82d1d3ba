//! Exposures: for what share of the time between frames the shutter is open, as far as streaks tell.

/// For what share of the time between frames the shutter may be open. Hand-set: a streak between two of them fits nearly as well.
pub(super) const EXPOSURES: [f64; 5] = [0.25, 0.4, 0.6, 0.8, 1.0];
/// The weight of one frame in the running means of log-likelihood ratios. Hand-set: exposures rarely change.
const RATE: f64 = 0.3;
/// Streaks whose means are less than this share of outlines' at rest are not looked for where an outline at rest fits. Hand-set.
pub(super) const LIKELY_SHARE: f64 = 0.5;
/// By how much a target is wider than the blob of its streak, and the streak longer than follows from the blob, whose ends are too pale. Hand-set.
pub(super) const BLOB_FACTORS: [[f64; 2]; 4] = [[1.3, 1.3], [1.3, 2.0], [1.8, 1.3], [1.8, 2.0]];
/// The same for what moves, whose pale ends differ from what was there before. Hand-set.
pub(super) const MOVING_FACTORS: [[f64; 2]; 4] = [[1.0, 1.0], [1.0, 1.4], [1.2, 1.0], [0.85, 0.8]];
/// Of how many blobs streaks are looked for, the largest first. Hand-set: bounds the time.
pub(super) const BLOBS: usize = 3;
/// The greatest number of streaks that are fitted in one instant.
pub(super) const MAX_FITS: usize =
    EXPOSURES.len() + BLOBS * (BLOB_FACTORS.len() + MOVING_FACTORS.len());

/// How well each exposure explained the frames so far: running means of log-likelihood ratios, nats.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Exposures {
    pub(super) at_rest: f64,
    pub(super) streaks: [f64; EXPOSURES.len()],
}

impl Exposures {
    /// The exposures, the likeliest first.
    pub(super) fn ranked(&self) -> [usize; EXPOSURES.len()] {
        let mut ranked = std::array::from_fn(|exposure| exposure);
        // Of equally likely ones the shortest comes first.
        ranked.sort_by(|&a, &b| self.streaks[b].total_cmp(&self.streaks[a]));
        ranked
    }
}

/// Moves a running mean of log-likelihood ratios. What does not fit counts 0.
pub(super) fn note(mean: &mut f64, log_ratio: f64) {
    *mean += RATE * (log_ratio.max(0.0) - *mean);
}
