//! Interpolation of the truth, for tracks of cameras with their own clocks.

use pardalis_evaluate::{TrueState, wrapped_rad};

use crate::tables::{Series, times_of};

/// Gaps in the truth longer than this many of its typical intervals are not interpolated.
const LONGEST_GAP: f64 = 3.0;

/// Returns each object's truth at all times of the tracks that lie between two of its rows.
pub(super) fn at_times_of<T>(
    tracks: &[Series<T>],
    objects: &[Series<TrueState>],
) -> Vec<Series<TrueState>> {
    let times_s = times_of(tracks);
    let at_times = |object: &Series<TrueState>| {
        let mut intervals_s: Vec<f64> = object.rows.windows(2).map(|w| w[1].0 - w[0].0).collect();
        intervals_s.sort_by(f64::total_cmp);
        let usual_s = intervals_s.get(intervals_s.len() / 2).copied();
        let longest_s = usual_s.map_or(0.0, |usual_s| LONGEST_GAP * usual_s);
        let rows = times_s
            .iter()
            .filter_map(|&time_s| Some((time_s, at_time(&object.rows, time_s, longest_s)?)));
        Series {
            name: object.name.clone(),
            rows: rows.collect(),
        }
    };
    objects.iter().map(at_times).collect()
}

/// Interpolates the state at a time between rows in ascending order of time.
fn at_time(rows: &[(f64, TrueState)], time_s: f64, longest_s: f64) -> Option<TrueState> {
    let after = rows.partition_point(|row| row.0 < time_s);
    let &(after_s, ref end) = rows.get(after)?;
    if after_s == time_s {
        return Some(*end);
    }
    let &(before_s, ref start) = rows.get(after.checked_sub(1)?)?;
    let interval_s = after_s - before_s;
    if interval_s > longest_s {
        return None;
    }
    let share = (time_s - before_s) / interval_s;
    let linear = |a: f64, b: f64| a + share * (b - a);
    let headings_rad = start.heading_rad.zip(end.heading_rad);
    let nearer = TrueState {
        // The shorter way around the circle.
        heading_rad: headings_rad.map(|(from, to)| from + share * wrapped_rad(to - from)),
        ..*if share < 0.5 { start } else { end }
    };
    let (from_m, to_m) = (start.position_m, end.position_m);
    Some(match start.velocity_mps.zip(end.velocity_mps) {
        None => TrueState {
            position_m: [0, 1, 2].map(|axis| linear(from_m[axis], to_m[axis])),
            ..nearer
        },
        Some((from_mps, to_mps)) => TrueState {
            // The cubic with these positions and velocities at its ends.
            position_m: [0, 1, 2].map(|axis| {
                let (s, s2, s3) = (share, share.powi(2), share.powi(3));
                (2.0 * s3 - 3.0 * s2 + 1.0) * from_m[axis]
                    + (3.0 * s2 - 2.0 * s3) * to_m[axis]
                    + interval_s * ((s3 - 2.0 * s2 + s) * from_mps[axis] + (s3 - s2) * to_mps[axis])
            }),
            velocity_mps: Some([0, 1, 2].map(|axis| linear(from_mps[axis], to_mps[axis]))),
            ..nearer
        },
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn state(x_m: f64, vx_mps: Option<f64>) -> TrueState {
        TrueState {
            position_m: [x_m, 1.0, 2.0],
            velocity_mps: vx_mps.map(|vx| [vx, 0.0, 0.0]),
            heading_rad: None,
            visible_fraction: Some(1.0),
            seeing_cameras: Some(2),
        }
    }

    fn series<T>(rows: Vec<(f64, T)>) -> Series<T> {
        Series {
            name: "ball".to_owned(),
            rows,
        }
    }

    #[test]
    fn a_cubic_path_is_interpolated_exactly_and_not_extrapolated() {
        let x_m = |t: f64| 1.0 + 2.0 * t - 3.0 * t * t + t.powi(3);
        let vx_mps = |t: f64| 2.0 - 6.0 * t + 3.0 * t * t;
        let rows = (0..6).map(|i| f64::from(i) * 0.5);
        let truth = series(rows.map(|t| (t, state(x_m(t), Some(vx_mps(t))))).collect());
        let track = series(vec![
            (-0.1, ()),
            (0.5, ()),
            (0.62, ()),
            (2.4, ()),
            (2.6, ()),
        ]);
        let found = at_times_of(&[track], &[truth]);
        let times: Vec<f64> = found[0].rows.iter().map(|row| row.0).collect();
        assert_eq!(times, [0.5, 0.62, 2.4]);
        for (time_s, state) in &found[0].rows {
            assert!((state.position_m[0] - x_m(*time_s)).abs() < 1e-12);
            assert_eq!(state.position_m[1..], [1.0, 2.0]);
        }
    }

    #[test]
    fn headings_turn_the_shorter_way() {
        let facing = |degrees: f64| TrueState {
            heading_rad: Some(degrees.to_radians()),
            ..state(0.0, None)
        };
        let nowhere = state(0.0, None);
        let rows = vec![(0.0, facing(170.0)), (1.0, facing(-170.0)), (2.0, nowhere)];
        let track = series(vec![(0.75, ()), (1.5, ())]);
        let found = at_times_of(&[track], &[series(rows)]);
        let headings_rad = [0, 1].map(|i| found[0].rows[i].1.heading_rad);
        assert!((headings_rad[0].unwrap().to_degrees() - 185.0).abs() < 1e-9);
        assert_eq!(headings_rad[1], None);
    }

    #[test]
    fn without_velocities_rows_are_joined_by_lines_except_over_gaps() {
        let times_s = [0.0, 1.0, 2.0, 3.0, 9.0];
        let truth = series(times_s.map(|t| (t, state(t * t, None))).to_vec());
        let track = series(vec![(1.5, ()), (5.0, ()), (9.0, ())]);
        let found = at_times_of(&[track], &[truth]);
        let x: Vec<_> = found[0]
            .rows
            .iter()
            .map(|(t, s)| (*t, s.position_m[0]))
            .collect();
        assert_eq!(x, [(1.5, 2.5), (9.0, 81.0)]);
    }
}
