//! Extent of a set of points along its principal axes.

use nalgebra::{Matrix3, SymmetricEigen, Vector3};

/// Principal axes of a set of points, by decreasing width, with the standard deviations along them.
pub(super) struct Spread {
    /// Mean of the points, metres.
    pub(super) mean: Vector3<f64>,
    /// Columns: a right-handed frame; the last axis has the smallest width.
    pub(super) axes: Matrix3<f64>,
    /// Standard deviations along the axes, in metres.
    pub(super) widths_m: [f64; 3],
}

impl Spread {
    /// Computes the extent of a set of points given in metres.
    pub(super) fn of(points: impl Iterator<Item = [f64; 3]> + Clone) -> Self {
        let count = points.clone().count().max(1) as f64;
        let mean = points.clone().map(Vector3::from).sum::<Vector3<f64>>() / count;
        let scatter = points
            .map(|p| Vector3::from(p) - mean)
            .map(|d| d * d.transpose())
            .sum::<Matrix3<f64>>()
            / count;
        let eigen = SymmetricEigen::new(scatter);
        let mut order = [0, 1, 2];
        order.sort_by(|&a, &b| eigen.eigenvalues[b].total_cmp(&eigen.eigenvalues[a]));
        let (x, y) = (
            eigen.eigenvectors.column(order[0]).into_owned(),
            eigen.eigenvectors.column(order[1]).into_owned(),
        );
        Self {
            mean,
            axes: Matrix3::from_columns(&[x, y, x.cross(&y)]),
            widths_m: order.map(|i| eigen.eigenvalues[i].max(0.0).sqrt()),
        }
    }

    /// Reports whether the points lie in a plane.
    pub(super) fn flat(&self) -> bool {
        self.widths_m[2] < 1e-3 * self.widths_m[0]
    }
}
