//! Symmetric matrices whose first unknowns form a band, such as the points of a path, while the rest, such as the
//! poses of cameras, couple with all.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

/// The band at the beginning of a matrix.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Band {
    /// Number of its unknowns.
    pub(crate) unknowns: usize,
    /// Two of its unknowns that share a residual are less than this apart.
    pub(crate) width: usize,
}

impl Band {
    /// No band: all unknowns couple.
    pub(crate) const NONE: Self = Self {
        unknowns: 0,
        width: 0,
    };
}

/// A symmetric matrix, of which the lower triangle is stored.
#[derive(Clone)]
pub(super) struct Arrow {
    /// Row k of column j has element (j + k, j).
    band: DMatrix<f64>,
    /// Rows of the unknowns behind the band, columns of those in it.
    border: DMatrix<f64>,
    corner: DMatrix<f64>,
}

impl Arrow {
    pub(super) fn zeros(band: Band, unknowns: usize) -> Self {
        let rest = unknowns - band.unknowns;
        Self {
            band: DMatrix::zeros(band.width, band.unknowns),
            border: DMatrix::zeros(rest, band.unknowns),
            corner: DMatrix::zeros(rest, rest),
        }
    }

    /// Adds to an element; above the diagonal, it does nothing.
    pub(super) fn add(&mut self, row: usize, column: usize, value: f64) {
        let first = self.band.ncols();
        if row < column {
        } else if column >= first {
            self.corner[(row - first, column - first)] += value;
        } else if row >= first {
            self.border[(row - first, column)] += value;
        } else {
            self.band[(row - column, column)] += value;
        }
    }

    /// Returns the factors that make the diagonal 1; unknowns without influence keep their scale.
    pub(super) fn scales(&self) -> DVector<f64> {
        let banded = (0..self.band.ncols()).map(|i| self.band[(0, i)]);
        let rest = (0..self.corner.ncols()).map(|i| self.corner[(i, i)]);
        let scale = |d: f64| if d > 0.0 { 1.0 / d.sqrt() } else { 1.0 };
        DVector::from_vec(banded.chain(rest).map(scale).collect())
    }

    pub(super) fn scaled(&self, scale: &DVector<f64>) -> Self {
        let mut scaled = self.clone();
        let first = self.band.ncols();
        for j in 0..first {
            for k in 0..self.band.nrows().min(first - j) {
                scaled.band[(k, j)] *= scale[j + k] * scale[j];
            }
            for i in 0..self.border.nrows() {
                scaled.border[(i, j)] *= scale[first + i] * scale[j];
            }
        }
        for j in 0..self.corner.ncols() {
            for i in j..self.corner.nrows() {
                scaled.corner[(i, j)] = self.corner[(i, j)] * scale[first + i] * scale[first + j];
            }
        }
        scaled
    }

    /// Adds to the diagonal.
    pub(super) fn damped(mut self, lambda: f64) -> Self {
        for j in 0..self.band.ncols() {
            self.band[(0, j)] += lambda;
        }
        for i in 0..self.corner.ncols() {
            self.corner[(i, i)] += lambda;
        }
        self
    }

    /// Factors the matrix; `None` unless it is positive definite. The band is eliminated first, which leaves its
    /// Schur complement as the corner.
    pub(super) fn factored(mut self) -> Option<Factors> {
        let (width, first) = self.band.shape();
        for j in 0..first {
            let pivot = self.band[(0, j)];
            if !(pivot > 0.0) {
                return None;
            }
            let inverse = 1.0 / pivot.sqrt();
            self.band.column_mut(j).scale_mut(inverse);
            self.border.column_mut(j).scale_mut(inverse);
            let reach = width.min(first - j);
            for k in 1..reach {
                let factor = self.band[(k, j)];
                if factor == 0.0 {
                    continue;
                }
                for m in k..reach {
                    let change = self.band[(m, j)] * factor;
                    self.band[(m - k, j + k)] -= change;
                }
                let (done, mut open) = self.border.columns_range_pair_mut(j, j + k);
                open.axpy(-factor, &done, 1.0);
            }
            let column = self.border.column(j);
            self.corner.syger(-1.0, &column, &column, 1.0);
        }
        self.corner.fill_upper_triangle_with_lower_triangle();
        Some(Factors {
            band: self.band,
            border: self.border,
            corner: Cholesky::new(self.corner)?,
        })
    }
}

/// The Cholesky factors of a matrix.
pub(super) struct Factors {
    band: DMatrix<f64>,
    border: DMatrix<f64>,
    corner: Cholesky<f64, Dyn>,
}

impl Factors {
    pub(super) fn solve(&self, right: &DVector<f64>) -> DVector<f64> {
        let (width, first) = self.band.shape();
        let mut x = right.clone();
        let (mut banded, mut rest) = x.rows_range_pair_mut(..first, first..);
        for j in 0..first {
            banded[j] /= self.band[(0, j)];
            for k in 1..width.min(first - j) {
                banded[j + k] -= self.band[(k, j)] * banded[j];
            }
            rest.axpy(-banded[j], &self.border.column(j), 1.0);
        }
        let solved = self.corner.solve(&rest);
        rest.copy_from(&solved);
        for j in (0..first).rev() {
            let mut sum = banded[j] - self.border.column(j).dot(&rest);
            for k in 1..width.min(first - j) {
                sum -= self.band[(k, j)] * banded[j + k];
            }
            banded[j] = sum / self.band[(0, j)];
        }
        x
    }

    /// Returns the part of the inverse that belongs to the unknowns behind the band.
    pub(super) fn corner_inverse(&self) -> DMatrix<f64> {
        self.corner.inverse()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_banded_matrix_is_solved_like_a_full_one() {
        let band = Band {
            unknowns: 9,
            width: 3,
        };
        let unknowns = 13;
        let mut arrow = Arrow::zeros(band, unknowns);
        let mut full = DMatrix::<f64>::zeros(unknowns, unknowns);
        for row in 0..unknowns {
            for column in 0..=row {
                if row < band.unknowns && row - column >= band.width {
                    continue;
                }
                let value = libm::sin((3 * row + 7 * column) as f64)
                    + if row == column { 8.0 } else { 0.0 };
                arrow.add(row, column, value);
                arrow.add(column, row, if row == column { 0.0 } else { value });
                full[(row, column)] = value;
                full[(column, row)] = value;
            }
        }
        let scale = arrow.scales();
        let scaled = DMatrix::from_fn(unknowns, unknowns, |i, j| {
            full[(i, j)] * scale[i] * scale[j]
        });
        let damped: DMatrix<f64> = scaled + 0.5 * DMatrix::identity(unknowns, unknowns);
        let right = DVector::from_fn(unknowns, |i, _| i as f64 - 3.0);
        let factors = arrow.scaled(&scale).damped(0.5).factored().unwrap();
        let wanted = damped.clone().cholesky().unwrap();
        assert!((factors.solve(&right) - wanted.solve(&right)).amax() < 1e-13);
        let inverse = wanted.inverse();
        let corner = inverse.view((9, 9), (4, 4));
        assert!((factors.corner_inverse() - corner).amax() < 1e-13);
        let negative = Arrow::zeros(band, unknowns).damped(-1.0);
        assert!(negative.factored().is_none());
    }
}
