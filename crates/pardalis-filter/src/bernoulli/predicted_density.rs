//! How dense a prediction is where something was measured.

use nalgebra::{Matrix3, SymmetricEigen, Vector3};

use super::BernoulliFilter;

impl BernoulliFilter {
    /// The density of where the target is predicted, if it is located, around a position that was measured with this covariance (metres, m²): ∫p(x)·N(x; position, covariance) dx,
    /// 1/m³, or 1/m² in a plane, where the third axis does not count. 0 where it is not located. Meant for after [`BernoulliFilter::predict`].
    pub fn predicted_density(&self, position_m: [f64; 3], covariance_m2: &Matrix3<f64>) -> f64 {
        if self.located() == 0.0 {
            return 0.0;
        }
        let free_axes = self.settings.motion.free_axes();
        let mut covariance = *covariance_m2;
        for axis in 0..2 * usize::from(free_axes < 3) {
            covariance[(axis, 2)] = 0.0;
            covariance[(2, axis)] = 0.0;
        }
        let SymmetricEigen {
            eigenvectors,
            eigenvalues,
        } = SymmetricEigen::new(covariance);
        let is_free = |axis: usize| free_axes == 3 || eigenvectors[(2, axis)].abs() < 0.5;
        let density = |off: &Vector3<f64>, variance_m2: f64| -> f64 {
            let log = |axis: usize| {
                let variance = eigenvalues[axis].max(0.0) + variance_m2;
                off[axis] * off[axis] / variance + libm::log(std::f64::consts::TAU * variance)
            };
            libm::exp(-0.5 * (0..3).filter(|&axis| is_free(axis)).map(log).sum::<f64>())
        };
        let velocity_jump = self.velocity_jump(self.pending_s);
        let hypotheses = self.hypotheses.iter().zip(&self.weights);
        let terms = hypotheses.map(|(hypothesis, weight)| {
            let ahead = Vector3::from(hypothesis.ahead(self.pending_s));
            let off = eigenvectors.tr_mul(&(Vector3::from(position_m) - ahead));
            let given = |kinematics: super::Kinematics| {
                let velocity_variance = hypothesis.velocity_variance_m2ps2;
                density(
                    &off,
                    kinematics
                        .step(velocity_variance, self.pending_s)
                        .variance_m2,
                )
            };
            let (chance, jumped) =
                velocity_jump.map_or((0.0, 0.0), |(chance, k)| (chance, given(k)));
            weight * ((1.0 - chance) * given(self.kinematics) + chance * jumped)
        });
        terms.sum()
    }
}
