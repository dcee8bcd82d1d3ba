//! Particles as a structure of arrays: one column per state component, so that kernels vectorise
//! over particles.

/// States and log-weights of all particles.
///
/// The motion model defines the meaning of the columns. The first three are always the position in
/// the world frame, in metres.
#[derive(Debug, Clone, PartialEq)]
pub struct Particles {
    columns: Vec<Vec<f32>>,
    /// Natural logarithms of the weights, normalised so that the weights sum to one.
    pub log_weights: Vec<f64>,
}

impl Particles {
    /// Creates `count` particles of equal weight at the origin.
    pub fn new(count: usize, columns: usize) -> Self {
        Self {
            columns: vec![vec![0.0; count]; columns],
            log_weights: vec![-libm::log(count as f64); count],
        }
    }

    /// Returns the number of particles.
    pub fn count(&self) -> usize {
        self.log_weights.len()
    }

    /// Changes the number of particles. States and weights are then meaningless.
    pub(crate) fn resize(&mut self, count: usize) {
        for column in &mut self.columns {
            column.resize(count, 0.0);
        }
        self.log_weights.resize(count, 0.0);
    }

    /// Returns the columns in the motion model's order.
    pub fn columns(&self) -> &[Vec<f32>] {
        &self.columns
    }

    /// Returns the columns for writing.
    pub fn columns_mut(&mut self) -> &mut [Vec<f32>] {
        &mut self.columns
    }

    /// Returns the three position columns in the world frame, in metres.
    pub fn positions_m(&self) -> [&[f32]; 3] {
        [&self.columns[0], &self.columns[1], &self.columns[2]]
    }

    /// Returns the position of a particle in the world frame, in metres.
    pub fn position_m(&self, particle: usize) -> [f64; 3] {
        [0, 1, 2].map(|axis| f64::from(self.columns[axis][particle]))
    }

    /// Sets all weights equal.
    pub fn reset_weights(&mut self) {
        let count = self.count() as f64;
        self.log_weights.fill(-libm::log(count));
    }
}
