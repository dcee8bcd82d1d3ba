//! Tabulated profiles: quintic interpolation with continuous curvature.

use pardalis_core::Error;

const MIN_ROWS: usize = 5;
const MAX_ROWS: usize = 100_000;

/// F(t) − F(0) as quintic polynomials that match F, F' and F'' at every row.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct ProfileTable {
    t_m: Vec<f64>,
    /// Polynomial coefficients of each interval, in powers of the relative position 0 to 1.
    coefficients: Vec<[f64; 6]>,
}

impl ProfileTable {
    /// Creates a table from rows t, F, F' in metres. F'' is the derivative of the cubic spline
    /// through F'.
    pub(super) fn new(rows: &[[f64; 3]]) -> Result<Self, Error> {
        check_rows(rows)?;
        let t_m: Vec<f64> = rows.iter().map(|row| row[0]).collect();
        let slopes: Vec<f64> = rows.iter().map(|row| row[2]).collect();
        // A smooth profile continues symmetrically beyond the vertex: F' is odd. This does not hold
        // for a tip.
        let curvatures = if slopes[0] == 0.0 {
            spline_slopes_of_half(&t_m, &slopes, -1.0)
        } else {
            spline_slopes(&t_m, &slopes)
        };
        let coefficients = (0..rows.len() - 1)
            .map(|i| {
                let h = t_m[i + 1] - t_m[i];
                let [f0, f1] = [rows[i][1] - rows[0][1], rows[i + 1][1] - rows[0][1]];
                let [d0, d1] = [slopes[i] * h, slopes[i + 1] * h];
                let [e0, e1] = [curvatures[i] * h * h, curvatures[i + 1] * h * h];
                let a = f1 - f0 - d0 - 0.5 * e0;
                let b = d1 - d0 - e0;
                let c = e1 - e0;
                [
                    f0,
                    d0,
                    0.5 * e0,
                    10.0 * a - 4.0 * b + 0.5 * c,
                    -15.0 * a + 7.0 * b - c,
                    6.0 * a - 3.0 * b + 0.5 * c,
                ]
            })
            .collect();
        Ok(Self { t_m, coefficients })
    }

    /// Returns the distances of the rows from the axis, in metres.
    pub(super) fn t_m(&self) -> &[f64] {
        &self.t_m
    }

    /// Returns F − F(0), F' and F''.
    pub(super) fn at(&self, t: f64) -> [f64; 3] {
        let last = self.coefficients.len() - 1;
        let i = self.t_m[1..=last].partition_point(|&node| node <= t);
        let h = self.t_m[i + 1] - self.t_m[i];
        let x = (t - self.t_m[i]) / h;
        let [c0, c1, c2, c3, c4, c5] = self.coefficients[i];
        [
            c0 + x * (c1 + x * (c2 + x * (c3 + x * (c4 + x * c5)))),
            (c1 + x * (2.0 * c2 + x * (3.0 * c3 + x * (4.0 * c4 + x * 5.0 * c5)))) / h,
            (2.0 * c2 + x * (6.0 * c3 + x * (12.0 * c4 + x * 20.0 * c5))) / (h * h),
        ]
    }

    /// Returns distances from the axis at which the profile is checked, several per interval.
    pub(super) fn check_points(&self) -> impl Iterator<Item = f64> {
        let between = |pair: &[f64]| {
            let (low, high) = (pair[0], pair[1]);
            [0.0, 0.25, 0.5, 0.75, 1.0].map(|share| low + share * (high - low))
        };
        self.t_m.windows(2).flat_map(between)
    }
}

/// Adds F' to rows t, F: the derivative of the cubic spline through F, continued symmetrically
/// beyond the vertex.
pub(super) fn with_slopes(rows: &[[f64; 2]]) -> Result<Vec<[f64; 3]>, Error> {
    check_rows(rows)?;
    let (t_m, f_m): (Vec<f64>, Vec<f64>) = rows.iter().map(|&[t, f]| (t, f)).unzip();
    let mut slopes = spline_slopes_of_half(&t_m, &f_m, 1.0);
    slopes[0] = 0.0;
    let row = |(&[t, f], slope): (&[f64; 2], f64)| [t, f, slope];
    Ok(rows.iter().zip(slopes).map(row).collect())
}

fn check_rows<const N: usize>(rows: &[[f64; N]]) -> Result<(), Error> {
    let reject = |found: String, allowed: &str| {
        let allowed = format!("rows of t and F in metres: {allowed}");
        Err(Error::out_of_range("profile", found, &allowed))
    };
    if !(MIN_ROWS..=MAX_ROWS).contains(&rows.len()) {
        return reject(format!("{} rows long", rows.len()), "5 to 100000 rows");
    }
    let invalid = |row: &[f64; N]| row.iter().any(|v| !(v.abs() <= 1e6));
    if let Some(i) = rows.iter().position(invalid) {
        return reject(
            format!("{:?} in row {}", rows[i], i + 1),
            "numbers up to 1e6",
        );
    }
    if rows[0][0] != 0.0 {
        return reject(
            format!("{:?} in its first row", rows[0]),
            "t = 0 (the vertex) in the first row",
        );
    }
    // The differences of closer rows would be dominated by rounding.
    let least_step = 1e-9 * rows[rows.len() - 1][0];
    let unordered = |pair: &[[f64; N]]| !(pair[1][0] - pair[0][0] > least_step);
    if let Some(i) = rows.windows(2).position(unordered) {
        return reject(
            format!("{:?} in row {}", rows[i + 1], i + 2),
            "t increasing from row to row",
        );
    }
    Ok(())
}

/// Returns the slopes of the spline through the points and their images at −t, whose values are
/// multiplied by `sign`.
fn spline_slopes_of_half(t: &[f64], y: &[f64], sign: f64) -> Vec<f64> {
    let whole = |half: &[f64], sign: f64| -> Vec<f64> {
        let beyond = half[1..].iter().rev().map(|v| sign * v);
        beyond.chain(half.iter().copied()).collect()
    };
    let slopes = spline_slopes(&whole(t, -1.0), &whole(y, sign));
    slopes[t.len() - 1..].to_vec()
}

/// Returns the slopes at its points of the cubic spline with continuous second derivative, with the
/// "not-a-knot" end condition (continuous third derivative at the second and the second last
/// point).
fn spline_slopes(t: &[f64], y: &[f64]) -> Vec<f64> {
    let n = t.len();
    let h: Vec<f64> = t.windows(2).map(|pair| pair[1] - pair[0]).collect();
    let secant: Vec<f64> = (0..n - 1).map(|i| (y[i + 1] - y[i]) / h[i]).collect();
    // Each row: coefficients of the previous, current and next slope, and the right-hand side.
    let end = |h0: f64, h1: f64, secant0: f64, secant1: f64| {
        let both = h0 + h1;
        let right = ((h0 + 2.0 * both) * h1 * secant0 + h0 * h0 * secant1) / both;
        (h1, both, right)
    };
    let (here, after, right) = end(h[0], h[1], secant[0], secant[1]);
    let mut factor = vec![after / here];
    let mut slopes = vec![right / here];
    let last = end(h[n - 2], h[n - 3], secant[n - 2], secant[n - 3]);
    for i in 1..n {
        let (before, here, after, right) = if i < n - 1 {
            let right = 3.0 * (h[i] * secant[i - 1] + h[i - 1] * secant[i]);
            (h[i], 2.0 * (h[i - 1] + h[i]), h[i - 1], right)
        } else {
            (last.1, last.0, 0.0, last.2)
        };
        let pivot = here - before * factor[i - 1];
        factor.push(after / pivot);
        slopes.push((right - before * slopes[i - 1]) / pivot);
    }
    for i in (0..n - 1).rev() {
        slopes[i] -= factor[i] * slopes[i + 1];
    }
    slopes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spline_through_a_cubic_reproduces_the_cubic() {
        let t = [-1.0, -0.2, 0.3, 0.4, 1.1, 2.0];
        let cubic = |t: f64| 1.0 + t * (2.0 + t * (-0.5 + t * 0.3));
        let slopes = spline_slopes(&t, &t.map(cubic));
        for (t, slope) in t.into_iter().zip(slopes) {
            assert!((slope - (2.0 + t * (-1.0 + t * 0.9))).abs() < 1e-13, "{t}");
        }
    }

    #[test]
    fn interpolation_passes_through_the_rows_with_continuous_slope_and_curvature() {
        let f = |t: f64| 0.2 + (t * t + 0.001).sqrt();
        let slope = |t: f64| t / (t * t + 0.001).sqrt();
        let nodes: Vec<f64> = (0..60).map(|i| f64::from(i * (i + 40)) * 2e-5).collect();
        let rows: Vec<_> = nodes.iter().map(|&t| [t, f(t), slope(t)]).collect();
        let table = ProfileTable::new(&rows).unwrap();
        let without: Vec<_> = nodes.iter().map(|&t| [t, f(t)]).collect();
        let from_f = ProfileTable::new(&with_slopes(&without).unwrap()).unwrap();
        for i in 0..2000 {
            let t = nodes[59] * f64::from(i) / 2000.0;
            let exact = [f(t) - f(0.0), slope(t)];
            for (table, bounds) in [(&table, [1e-9, 1e-6]), (&from_f, [1e-7, 1e-4])] {
                let [sag, slope, _] = table.at(t);
                assert!((sag - exact[0]).abs() < bounds[0], "{t}: {sag}");
                assert!((slope - exact[1]).abs() < bounds[1], "{t}: {slope}");
            }
        }
        for &t in &nodes[1..59] {
            let (before, after) = (table.at(t - 1e-12), table.at(t + 1e-12));
            assert!((before[1] - after[1]).abs() < 1e-9, "{t}");
            assert!((before[2] - after[2]).abs() < 1e-6, "{t}");
        }
    }
}
