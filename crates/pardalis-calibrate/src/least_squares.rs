//! Levenberg-Marquardt on pixel residuals, each of which depends on a few of the unknowns.
//!
//! The module accumulates the normal matrix in a fixed order, because robust weights and covariances need it.
//! A library that takes the whole Jacobian would hold 30 000 rows of about 300 columns, almost all of them
//! zero.

mod arrow;

use nalgebra::{DMatrix, DVector};

use arrow::Arrow;
pub(super) use arrow::Band;

/// Derivatives of a residual's two coordinates with respect to blocks of consecutive unknowns.
pub(super) struct Slopes<'a> {
    /// First unknown of each block, and the derivatives with respect to the unknowns of the block.
    pub(super) blocks: &'a [(usize, &'a [[f64; 2]])],
}

/// A least-squares problem at its current unknowns.
pub(super) trait Problem: Sized {
    /// Returns the number of unknowns.
    fn unknowns(&self) -> usize;

    /// Returns which of the first unknowns form a band, so that they are eliminated one after the other.
    fn band(&self) -> Band {
        Band::NONE
    }

    /// Returns the problem after a step of its unknowns; `None` if the step leaves the valid range.
    fn stepped(&self, step: &DVector<f64>) -> Option<Self>;

    /// Calls `visit` with every residual in pixels (`None` if the point has no pixel) and its derivatives, in
    /// a fixed order.
    fn visit(&self, visit: &mut dyn FnMut(Option<[f64; 2]>, Slopes<'_>));
}

/// Cost of a residual.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Loss {
    /// The squared length.
    Squares,
    /// Cauchy's loss c²·ln(1 + r²/c²) with this c in pixels: residuals far beyond c have little influence.
    Cauchy(f64),
}

/// Residual in pixels that stands for a point without a pixel.
const MISSING_PX: f64 = 1000.0;

impl Loss {
    /// Returns the cost and the weight of a residual with this squared length.
    fn of(self, square: f64) -> (f64, f64) {
        match self {
            Self::Squares => (square, 1.0),
            Self::Cauchy(c) => {
                let scaled = square / (c * c);
                (c * c * libm::log1p(scaled), 1.0 / (1.0 + scaled))
            }
        }
    }

    /// Returns the relative improvement below which the iteration stops. A robust fit only selects a start
    /// and finds outliers; the squared loss gives the result.
    fn least_gain(self) -> f64 {
        match self {
            Self::Squares => 1e-12,
            Self::Cauchy(_) => 1e-8,
        }
    }
}

/// Cost, normal matrix and right-hand side at the current unknowns.
struct Normal {
    cost: f64,
    matrix: Arrow,
    gradient: DVector<f64>,
}

fn normal<P: Problem>(problem: &P, loss: Loss) -> Normal {
    let n = problem.unknowns();
    let mut matrix = Arrow::zeros(problem.band(), n);
    let mut gradient = DVector::zeros(n);
    let mut cost = 0.0;
    problem.visit(&mut |residual, slopes| {
        let Some([ru, rv]) = residual else {
            cost += loss.of(MISSING_PX * MISSING_PX).0;
            return;
        };
        let (value, weight) = loss.of(ru * ru + rv * rv);
        cost += value;
        for &(start, block) in slopes.blocks {
            for (i, &[su, sv]) in block.iter().enumerate() {
                gradient[start + i] += weight * (su * ru + sv * rv);
                for &(other_start, other) in slopes.blocks {
                    if other_start > start {
                        continue;
                    }
                    for (j, &[tu, tv]) in other.iter().enumerate() {
                        matrix.add(start + i, other_start + j, weight * (su * tu + sv * tv));
                    }
                }
            }
        }
    });
    Normal {
        cost,
        matrix,
        gradient,
    }
}

fn cost<P: Problem>(problem: &P, loss: Loss) -> f64 {
    let mut cost = 0.0;
    problem.visit(&mut |residual, _| {
        let square = residual.map_or(MISSING_PX * MISSING_PX, |[u, v]| u * u + v * v);
        cost += loss.of(square).0;
    });
    cost
}

/// Iterates until the cost no longer decreases, at most `iterations` times. Returns the fitted problem and
/// its cost.
pub(super) fn minimise<P: Problem>(mut problem: P, loss: Loss, iterations: usize) -> (P, f64) {
    let mut lambda = 1e-3;
    let mut present = normal(&problem, loss);
    for _ in 0..iterations {
        let scale = present.matrix.scales();
        let scaled = present.matrix.scaled(&scale);
        let right = -present.gradient.component_mul(&scale);
        let mut better = None;
        while lambda < 1e12 {
            let stepped = scaled
                .clone()
                .damped(lambda)
                .factored()
                .map(|factors| factors.solve(&right).component_mul(&scale))
                .and_then(|step| problem.stepped(&step));
            if let Some(candidate) = stepped {
                let candidate_cost = cost(&candidate, loss);
                if candidate_cost < present.cost {
                    better = Some((candidate, candidate_cost));
                    break;
                }
            }
            lambda *= 8.0;
        }
        let Some((candidate, candidate_cost)) = better else {
            break;
        };
        let gain = (present.cost - candidate_cost) / present.cost;
        problem = candidate;
        lambda = (lambda / 8.0).max(1e-12);
        present = normal(&problem, loss);
        if gain < loss.least_gain() {
            break;
        }
    }
    (problem, present.cost)
}

/// Computes the covariance of the unknowns behind the band, which are all if there is none, for residuals with a
/// standard deviation of one pixel per coordinate; `None` if the residuals do not determine the unknowns.
pub(super) fn covariance<P: Problem>(problem: &P) -> Option<DMatrix<f64>> {
    let matrix = normal(problem, Loss::Squares).matrix;
    let scale = matrix.scales();
    let inverse = matrix.scaled(&scale).factored()?.corner_inverse();
    let first = problem.band().unknowns;
    let covariance = DMatrix::from_fn(inverse.nrows(), inverse.ncols(), |i, j| {
        inverse[(i, j)] * scale[first + i] * scale[first + j]
    });
    covariance
        .iter()
        .all(|v| v.is_finite())
        .then_some(covariance)
}
