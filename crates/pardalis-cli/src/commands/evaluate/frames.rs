//! The frames of the truth, and the rows of tracks that belong to them.

use std::ops::Range;

use crate::tables::{Series, times_of};

/// Largest distance between a row and the time of its frame, in seconds.
const TOLERANCE_S: f64 = 0.001;

/// The times of the truth, over all objects.
pub(super) struct Frames {
    /// Times in seconds, ascending, each once.
    times_s: Vec<f64>,
    /// [`TOLERANCE_S`], or a tenth of the typical interval of the truth if that is less.
    pub(super) tolerance_s: f64,
    /// The number of frames in a second, if the typical interval is known; otherwise 1.
    pub(super) in_a_second: usize,
}

impl Frames {
    /// Returns the frames in which any object has a truth.
    pub(super) fn of<T>(objects: &[Series<T>]) -> Self {
        let times_s = times_of(objects);
        let mut intervals_s: Vec<f64> = times_s.windows(2).map(|w| w[1] - w[0]).collect();
        intervals_s.sort_by(f64::total_cmp);
        let median_s = intervals_s.get(intervals_s.len() / 2);
        Self {
            times_s,
            tolerance_s: median_s.map_or(TOLERANCE_S, |&median_s| TOLERANCE_S.min(median_s / 10.0)),
            in_a_second: median_s.map_or(1, |&median_s| (1.0 / median_s).round() as usize),
        }
    }

    /// Returns the frames between two times in seconds, both included.
    pub(super) fn between(&self, from_s: f64, to_s: f64) -> Range<usize> {
        let first = self.times_s.partition_point(|&t| t < from_s);
        let behind = self.times_s.partition_point(|&t| t <= to_s);
        first..behind.max(first)
    }

    /// Returns for each frame the row nearest in time, or `None` if no row lies within the tolerance.
    pub(super) fn place<'a, T>(&self, series: &'a Series<T>) -> Vec<Option<&'a T>> {
        let mut placed: Vec<Option<(f64, &T)>> = vec![None; self.times_s.len()];
        for (time_s, row) in &series.rows {
            let (frame, distance_s) = self.nearest(*time_s);
            let nearer = placed[frame].is_none_or(|(known_s, _)| distance_s < known_s);
            if distance_s <= self.tolerance_s && nearer {
                placed[frame] = Some((distance_s, row));
            }
        }
        placed.into_iter().map(|p| p.map(|(_, row)| row)).collect()
    }

    /// Returns the nearest frame and its distance in seconds.
    fn nearest(&self, time_s: f64) -> (usize, f64) {
        let after = self.times_s.partition_point(|&t| t < time_s);
        let around = after.saturating_sub(1)..=after.min(self.times_s.len() - 1);
        around
            .map(|frame| (frame, (self.times_s[frame] - time_s).abs()))
            .min_by(|a, b| a.1.total_cmp(&b.1))
            .unwrap_or((0, f64::INFINITY))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A series whose values are their own indices.
    fn series(times_s: &[f64]) -> Series<usize> {
        Series {
            name: "ball".to_owned(),
            rows: times_s.iter().copied().zip(0..).collect(),
        }
    }

    #[test]
    fn rows_belong_to_the_nearest_frame_within_a_millisecond() {
        let frames = Frames::of(&[series(&[0.0, 0.04, 0.08, 0.12])]);
        assert_eq!(frames.tolerance_s, 0.001);
        // Two rows are near 0.04, the later one nearer; 0.0822 is too far from any frame; 5 lies outside.
        let rows = series(&[-0.0005, 0.0393, 0.0404, 0.0822, 0.12, 5.0]);
        assert_eq!(frames.place(&rows), [Some(&0), Some(&2), None, Some(&4)]);
    }

    #[test]
    fn a_fast_truth_has_a_tighter_tolerance() {
        let frames = Frames::of(&[series(&[0.0, 0.002, 0.004])]);
        assert_eq!(frames.tolerance_s, 0.0002);
        assert_eq!(frames.place(&series(&[0.0023])), [None; 3]);
    }

    #[test]
    fn objects_share_their_frames() {
        let (first, second) = (series(&[0.0, 1.0]), series(&[1.0, 2.0]));
        let frames = Frames::of(&[series(&[1.0, 2.0]), series(&[0.0, 1.0])]);
        assert_eq!(frames.place(&first), [Some(&0), Some(&1), None]);
        assert_eq!(frames.place(&second), [None, Some(&0), Some(&1)]);
    }
}
