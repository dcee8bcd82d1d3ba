//! Levenberg-Marquardt on pixel residuals, each of which depends on a few of the unknowns.
//!
//! Our own, because the normal matrix is wanted for robust weights and covariances, and is accumulated in a fixed order: a library that
//! takes the whole Jacobian would hold 30 000 rows of some 300 columns that are almost all zero.

use nalgebra::{Cholesky, DMatrix, DVector, Dyn};

/// How a residual's two coordinates move with some of the unknowns: blocks of consecutive unknowns.
pub(super) struct Slopes<'a> {
    /// The first unknown of each block, and the derivatives by the block's unknowns.
    pub(super) blocks: &'a [(usize, &'a [[f64; 2]])],
}

/// Something that is fitted.
pub(super) trait Problem: Sized {
    /// How many unknowns there are.
    fn unknowns(&self) -> usize;

    /// The problem at other unknowns: a step away. `None` where that is outside of what is allowed.
    fn stepped(&self, step: &DVector<f64>) -> Option<Self>;

    /// Calls `visit` with every residual in pixels (`None`: the point has no pixel) and its slopes, in a fixed order.
    fn visit(&self, visit: &mut dyn FnMut(Option<[f64; 2]>, Slopes<'_>));
}

/// What a residual costs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Loss {
    /// Its square.
    Squares,
    /// Cauchy's loss, c²·ln(1 + r²/c²), with this c in pixels: residuals far beyond it hardly pull.
    Cauchy(f64),
}

/// What a point without a pixel counts as, in pixels.
const MISSING_PX: f64 = 1000.0;

impl Loss {
    /// The cost and the weight of a residual of this squared length.
    fn of(self, square: f64) -> (f64, f64) {
        match self {
            Self::Squares => (square, 1.0),
            Self::Cauchy(c) => {
                let scaled = square / (c * c);
                (c * c * libm::log1p(scaled), 1.0 / (1.0 + scaled))
            }
        }
    }

    /// The relative gain of a step at which to stop: a robust fit only chooses between starts and names outliers; squares give the result.
    fn least_gain(self) -> f64 {
        match self {
            Self::Squares => 1e-12,
            Self::Cauchy(_) => 1e-8,
        }
    }
}

/// Cost, normal matrix and right-hand side at the present unknowns.
struct Normal {
    cost: f64,
    matrix: DMatrix<f64>,
    gradient: DVector<f64>,
}

fn normal<P: Problem>(problem: &P, loss: Loss) -> Normal {
    let n = problem.unknowns();
    let mut matrix = DMatrix::zeros(n, n);
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
                        matrix[(start + i, other_start + j)] += weight * (su * tu + sv * tv);
                    }
                }
            }
        }
    });
    matrix.fill_upper_triangle_with_lower_triangle();
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

/// Steps until the cost falls no more, at most `iterations` times. Returns the fitted problem and its cost.
pub(super) fn minimise<P: Problem>(mut problem: P, loss: Loss, iterations: usize) -> (P, f64) {
    let mut lambda = 1e-3;
    let mut present = normal(&problem, loss);
    for _ in 0..iterations {
        let scale = scales(&present.matrix);
        let scaled = scaled(&present.matrix, &scale);
        let right = -present.gradient.component_mul(&scale);
        let mut better = None;
        while lambda < 1e12 {
            let mut damped = scaled.clone();
            for i in 0..damped.nrows() {
                damped[(i, i)] += lambda;
            }
            let stepped = Cholesky::new(damped)
                .map(|c| c.solve(&right).component_mul(&scale))
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

/// What makes the diagonal 1; unknowns on which nothing depends keep their scale.
fn scales(matrix: &DMatrix<f64>) -> DVector<f64> {
    matrix
        .diagonal()
        .map(|d| if d > 0.0 { 1.0 / d.sqrt() } else { 1.0 })
}

fn scaled(matrix: &DMatrix<f64>, scale: &DVector<f64>) -> DMatrix<f64> {
    DMatrix::from_fn(matrix.nrows(), matrix.ncols(), |i, j| {
        matrix[(i, j)] * scale[i] * scale[j]
    })
}

/// The covariance of the unknowns for residuals of one pixel s.d. a coordinate; `None` where the residuals do not determine them.
pub(super) fn covariance<P: Problem>(problem: &P) -> Option<DMatrix<f64>> {
    let matrix = normal(problem, Loss::Squares).matrix;
    let scale = scales(&matrix);
    let inverse = Cholesky::<f64, Dyn>::new(scaled(&matrix, &scale))?.inverse();
    let finite = inverse.iter().all(|v| v.is_finite());
    finite.then(|| scaled(&inverse, &scale))
}
