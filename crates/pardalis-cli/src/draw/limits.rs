//! The part of the world that a plot shows: estimates far off the path must not shrink everything else to a dot.

use std::ops::{Range, RangeInclusive};

use super::panel::extent;

/// Plots extend beyond the trusted positions by this share of the longest side.
const GROWTH: f64 = 0.25;

/// Plots extend beyond the trusted positions by at least this much.
const MIN_GROWTH_M: f64 = 0.1;

/// Cameras are left out if they would shrink the path below this share of the longest side ...
const MIN_PATH_SHARE: f64 = 0.2;

/// ... where a target at rest counts as a path this long.
const MIN_PATH_M: f64 = 0.2;

/// Returns the range of all but the lowest and the highest percent of the values.
pub(super) fn central(values: impl Iterator<Item = f64>) -> Option<RangeInclusive<f64>> {
    let mut values: Vec<f64> = values.filter(|value| value.is_finite()).collect();
    values.sort_by(f64::total_cmp);
    let last = values.len().checked_sub(1)?;
    let at = |share: f64| values[(share * last as f64).round() as usize];
    Some(at(0.01)..=at(0.99))
}

/// Returns the ranges of x, y and z in metres that contain truth, cameras and the estimates that are not far from them;
/// without truth, those not far from 98 % of the estimates. `None` if there is nothing to show.
pub(super) fn shown_ranges_m(
    estimates_m: &[[f64; 3]],
    truth_m: &[[f64; 3]],
    cameras_m: &[[f64; 3]],
) -> [Option<RangeInclusive<f64>>; 3] {
    let column = |places: &[[f64; 3]], axis: usize| -> Vec<f64> {
        places.iter().map(|place| place[axis]).collect()
    };
    let trusted = [0, 1, 2].map(|axis| {
        let path = if truth_m.is_empty() {
            central(column(estimates_m, axis).into_iter())
        } else {
            extent(column(truth_m, axis).into_iter())
        };
        let ends = path
            .into_iter()
            .flat_map(|path| [*path.start(), *path.end()]);
        extent(ends.chain(column(cameras_m, axis)))
    });
    let growth_m = trusted
        .iter()
        .flatten()
        .map(|range| GROWTH * (range.end() - range.start()))
        .fold(MIN_GROWTH_M, f64::max);
    let mut axes = 0..3;
    trusted.map(|trusted| {
        let (axis, trusted) = (axes.next()?, trusted?);
        let (low_m, high_m) = (trusted.start() - growth_m, trusted.end() + growth_m);
        let reached = column(estimates_m, axis).into_iter();
        let reached = reached.map(|at_m| at_m.clamp(low_m, high_m));
        extent(reached.chain([*trusted.start(), *trusted.end()]))
    })
}

/// Reports whether a camera is near enough to the shown path to be drawn with it.
pub(super) fn is_near(camera_m: &[f64; 3], path_m: &[Option<RangeInclusive<f64>>; 3]) -> bool {
    let length_m = |range: &RangeInclusive<f64>| range.end() - range.start();
    let longest_m = path_m.iter().flatten().map(length_m);
    let longest_m = longest_m.fold(MIN_PATH_M, f64::max);
    let reach_m = longest_m / MIN_PATH_SHARE;
    camera_m.iter().zip(path_m).all(|(at_m, path_m)| {
        path_m.as_ref().is_none_or(|path_m| {
            let both_m = path_m.end().max(*at_m) - path_m.start().min(*at_m);
            both_m <= reach_m
        })
    })
}

/// Returns the range of 0 and of the values that are not far from 98 % of them.
pub(super) fn shown_range_with_zero(values: &[f64]) -> RangeInclusive<f64> {
    let trusted = central(values.iter().copied()).unwrap_or(0.0..=0.0);
    let (low, high) = (trusted.start().min(0.0), trusted.end().max(0.0));
    let growth = GROWTH * (high - low);
    let reached = values.iter().filter(|value| value.is_finite());
    let reached = reached.map(|value| value.clamp(low - growth, high + growth));
    extent(reached.chain([low, high])).unwrap_or(trusted)
}

/// Reports whether a point lies in the ranges of its coordinates.
pub(super) fn is_inside<const N: usize>(point: &[f64; N], ranges: &[Range<f64>; N]) -> bool {
    let mut both = point.iter().zip(ranges);
    both.all(|(at, range)| (range.start..=range.end).contains(at))
}

/// Returns the pieces of a path within the ranges of its coordinates, cut where it crosses them.
pub(super) fn clipped<const N: usize>(
    path: &[[f64; N]],
    ranges: &[Range<f64>; N],
) -> Vec<Vec<[f64; N]>> {
    if let [point] = path {
        return if is_inside(point, ranges) {
            vec![vec![*point]]
        } else {
            Vec::new()
        };
    }
    let mut pieces: Vec<Vec<[f64; N]>> = Vec::new();
    // Whether the last piece ends where the next segment begins.
    let mut goes_on = false;
    for ends in path.windows(2) {
        let (from, to) = (ends[0], ends[1]);
        let Some([enters, leaves]) = shares_inside(&from, &to, ranges) else {
            goes_on = false;
            continue;
        };
        let at = |share: f64| match share {
            0.0 => from,
            1.0 => to,
            _ => std::array::from_fn(|i| from[i] + share * (to[i] - from[i])),
        };
        if !goes_on {
            pieces.push(vec![at(enters)]);
        }
        if let Some(piece) = pieces.last_mut() {
            piece.push(at(leaves));
        }
        goes_on = leaves == 1.0;
    }
    pieces
}

/// Returns the shares of its length at which a segment enters and leaves the ranges (Liang and Barsky 1984).
fn shares_inside<const N: usize>(
    from: &[f64; N],
    to: &[f64; N],
    ranges: &[Range<f64>; N],
) -> Option<[f64; 2]> {
    let [mut enters, mut leaves] = [0.0_f64, 1.0_f64];
    for ((from, to), range) in from.iter().zip(to).zip(ranges) {
        if from == to {
            if !(range.start..=range.end).contains(from) {
                return None;
            }
        } else {
            let crossings = [range.start, range.end].map(|edge| (edge - from) / (to - from));
            enters = enters.max(crossings[0].min(crossings[1]));
            leaves = leaves.min(crossings[0].max(crossings[1]));
        }
    }
    (enters <= leaves).then_some([enters, leaves])
}

/// Returns the note about points that a plot leaves out; `None` if it leaves out none.
pub(super) fn outside_note(outside: usize, all: usize) -> Option<String> {
    (outside > 0).then(|| format!("{outside} of {all} estimates are outside"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_are_cut_at_the_edges() {
        let square = [0.0..1.0, 0.0..1.0];
        let path = [
            [-1.0, 0.5],
            [0.5, 0.5],
            [0.5, 0.75],
            [0.5, 2.0],
            [3.0, 2.0],
            [-1.0, -2.0],
        ];
        let pieces = clipped(&path, &square);
        assert_eq!(pieces[0], [[0.0, 0.5], [0.5, 0.5], [0.5, 0.75], [0.5, 1.0]]);
        assert_eq!(pieces.len(), 2, "{pieces:?}");
        assert_eq!(clipped(&[[0.5, 0.5]], &square), [[[0.5, 0.5]]]);
        assert!(clipped(&[[0.5, 1.5]], &square).is_empty());
        assert!(clipped(&[[2.0, 0.0], [2.0, 1.0]], &square).is_empty());
        assert!(clipped(&[], &square).is_empty());
    }

    #[test]
    fn the_shown_range_follows_the_truth_or_most_estimates() {
        let mut estimates: Vec<_> = (0..1000)
            .map(|i| [0.001 * f64::from(i), 0.0, 0.0])
            .collect();
        let close = |ranges: [Option<RangeInclusive<f64>>; 3], low: f64, high: f64| {
            let x = ranges[0].clone().unwrap();
            assert!(
                (x.start() - low).abs() < 0.02 && (x.end() - high).abs() < 0.02,
                "{x:?}"
            );
        };
        close(shown_ranges_m(&estimates, &[], &[]), 0.0, 1.0);
        estimates.push([1e4, 0.0, 0.0]);
        close(shown_ranges_m(&estimates, &[], &[]), 0.0, 1.235);
        close(
            shown_ranges_m(&estimates, &[[0.5, 0.0, 0.0]], &[]),
            0.4,
            0.6,
        );
        close(
            shown_ranges_m(&estimates, &[[0.5, 0.0, 0.0]], &[[1.5, 0.0, 0.0]]),
            0.25,
            1.75,
        );
        assert_eq!(shown_ranges_m(&[], &[], &[]), [None, None, None]);
    }

    #[test]
    fn cameras_are_near_unless_they_dwarf_the_path() {
        let path_m = [Some(0.0..=1.0), Some(2.0..=2.5), Some(0.1..=0.1)];
        for near in [
            [0.5, 2.2, 0.1],
            [-4.0, 2.0, 0.0],
            [0.0, 7.0, 5.0],
            [0.0, 0.0, -4.8],
        ] {
            assert!(is_near(&near, &path_m), "{near:?}");
        }
        for far in [
            [-4.1, 2.0, 0.0],
            [5.1, 2.0, 0.0],
            [0.0, 7.1, 0.0],
            [0.0, 0.0, 5.2],
        ] {
            assert!(!is_near(&far, &path_m), "{far:?}");
        }
        // A target at rest, and no path.
        let still_m = [Some(1.0..=1.0), Some(0.0..=0.0), Some(0.0..=0.0)];
        assert!(is_near(&[0.0, 0.0, 1.0], &still_m));
        assert!(!is_near(&[0.0, 0.0, 1.1], &still_m));
        assert!(is_near(&[1e3; 3], &[None, None, None]));
    }
}
