//! Particles as structure of arrays: one column a state component, so that kernels run over particles.

/// State of every particle and the logarithm of its weight.
///
/// The columns' meaning is the motion model's; the first three are always the position in the world, in metres.
#[derive(Debug, Clone, PartialEq)]
pub struct Particles {
    columns: Vec<Vec<f32>>,
    /// Natural logarithms of the weights, normalised so that the weights sum to one.
    pub log_weights: Vec<f64>,
}

impl Particles {
    /// `count` particles of equal weight at the origin.
    pub fn new(count: usize, columns: usize) -> Self {
        Self {
            columns: vec![vec![0.0; count]; columns],
            log_weights: vec![-libm::log(count as f64); count],
        }
    }

    /// The number of particles.
    pub fn count(&self) -> usize {
        self.log_weights.len()
    }

    /// The columns, in the motion model's order.
    pub fn columns(&self) -> &[Vec<f32>] {
        &self.columns
    }

    /// The columns, to be written to.
    pub fn columns_mut(&mut self) -> &mut [Vec<f32>] {
        &mut self.columns
    }

    /// The three position columns in the world, metres.
    pub fn positions_m(&self) -> [&[f32]; 3] {
        [&self.columns[0], &self.columns[1], &self.columns[2]]
    }

    /// One particle's position in the world, metres.
    pub fn position_m(&self, particle: usize) -> [f64; 3] {
        [0, 1, 2].map(|axis| f64::from(self.columns[axis][particle]))
    }

    /// Gives every particle the same weight.
    pub fn reset_weights(&mut self) {
        let count = self.count() as f64;
        self.log_weights.fill(-libm::log(count));
    }
}
