//! The predicted density at a measurement.

use nalgebra::{Matrix3, SymmetricEigen, Vector3};

use super::BernoulliFilter;

/// Squared standard deviations beyond which the density is taken as 0. Derivation: it is e⁻⁶⁰ of that in the middle.
const NEGLIGIBLE_SQUARES: f64 = 120.0;

impl BernoulliFilter {
    /// Returns the predicted density of the target's position at a measurement with this covariance (metres, m²),
    /// given that the target is where the particles predict it: ∫p(x)·N(x; position, covariance) dx in 1/m³. In a
    /// plane it is in 1/m² and the third axis is ignored. 0 if the target does not exist. Call it after
    /// [`BernoulliFilter::predict`].
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
            let (mut squares, mut volume) = (0.0, 1.0);
            for axis in (0..3).filter(|&axis| is_free(axis)) {
                let variance = eigenvalues[axis].max(0.0) + variance_m2;
                squares += off[axis] * off[axis] / variance;
                volume *= std::f64::consts::TAU * variance;
            }
            if squares > NEGLIGIBLE_SQUARES {
                return 0.0;
            }
            libm::exp(-0.5 * squares) / volume.sqrt()
        };
        let ways = self.ways(self.pending_s);
        let hypotheses = self.hypotheses.iter().zip(&self.weights);
        let terms = hypotheses.map(|(hypothesis, weight)| {
            let ahead = Vector3::from(hypothesis.ahead(self.pending_s));
            let off = eigenvectors.tr_mul(&(Vector3::from(position_m) - ahead));
            let given = ways.all().map(|way| {
                let variance = hypothesis.velocity_variance_m2ps2;
                let step = way.kinematics.step(variance, self.pending_s);
                way.chance * density(&off, step.variance_m2)
            });
            weight * given.sum::<f64>()
        });
        terms.sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bernoulli::kinematics::Kinematics;
    use crate::bernoulli::{BernoulliSettings, ParticleRange};
    use crate::gaussian::{GaussianStart, diagonal_m2};
    use crate::motion::Motion;
    use pardalis_core::rng::Draws;

    /// Returns the density of a mixture of Gaussians with these weights, means (m) and variances (m²) at a position
    /// measured with this covariance, 1/m³: ∫p(x)·N(x; position, covariance) dx.
    fn naive_density(
        mixture: &[(f64, Vector3<f64>, f64)],
        position_m: Vector3<f64>,
        covariance_m2: &Matrix3<f64>,
    ) -> f64 {
        let density = |(weight, mean_m, variance_m2): &(f64, Vector3<f64>, f64)| {
            let sum = covariance_m2 + Matrix3::identity() * *variance_m2;
            let inverse = sum.try_inverse().expect("a covariance");
            let off = position_m - mean_m;
            let squared = (off.transpose() * inverse * off)[0];
            weight * (-0.5 * squared).exp() / (sum * std::f64::consts::TAU).determinant().sqrt()
        };
        mixture.iter().map(density).sum()
    }

    #[test]
    fn the_density_is_the_oracles() {
        let settings = BernoulliSettings {
            particles: ParticleRange::fixed(50),
            velocity_jump_rate_hz: 1.0,
            velocity_jump_sigma_mps: 3.0,
            ..BernoulliSettings::of(Motion::DEFAULT)
        };
        let mut filter = BernoulliFilter::new(settings, Draws::new(3, 0)).unwrap();
        let start = GaussianStart {
            covariance_m2: diagonal_m2([0.2; 3]),
            velocity_mps: [1.0, 0.0, -1.0],
            velocity_sigma_mps: [0.5; 3],
            ..GaussianStart::default()
        };
        filter.start(&start, 1.0).unwrap();
        let time_s: f64 = 0.2;
        filter.predict(time_s);
        let Kinematics::Velocity {
            acceleration_density_m2ps3: density,
        } = filter.kinematics
        else {
            unreachable!("the default motion has a velocity");
        };
        let jumped = 1.0 - (-time_s).exp();
        let of_particle = |(hypothesis, weight): (&super::super::Hypothesis, &f64)| {
            let own_m2 = hypothesis.velocity_variance_m2ps2 * time_s.powi(2) + 1e-10;
            let mean_m = Vector3::from(hypothesis.ahead(time_s));
            let way = |chance: f64, change_m2ps2: f64| {
                let variance_m2 = own_m2 + change_m2ps2 * time_s.powi(2) / 3.0;
                (chance * *weight, mean_m, variance_m2)
            };
            [
                way(1.0 - jumped, density * time_s),
                way(jumped, density * time_s + 9.0),
            ]
        };
        let particles = filter.hypotheses.iter().zip(&filter.weights);
        let mixture: Vec<_> = particles.flat_map(of_particle).collect();
        let estimate = filter.estimate(0.0).unwrap();
        let total: f64 = mixture.iter().map(|(weight, ..)| weight).sum();
        assert!((total - 1.0).abs() < 1e-12, "{total}");
        let mean_m: Vector3<f64> = mixture.iter().map(|(weight, mean, _)| *weight * mean).sum();
        let variance_m2: f64 = mixture
            .iter()
            .map(|(weight, mean, variance)| weight * (variance + (mean - mean_m).x.powi(2)))
            .sum();
        let off = estimate.covariance_m2[0] / variance_m2 - 1.0;
        assert!(off.abs() < 1e-6, "{off}");
        let covariance_m2 = Matrix3::new(0.04, 0.01, 0.0, 0.01, 0.02, -0.005, 0.0, -0.005, 0.09);
        for position_m in [[0.2, 0.0, -0.2], [0.5, 0.3, 0.1], [-1.0, 1.0, 0.0]] {
            let found = filter.predicted_density(position_m, &covariance_m2);
            let position_m = Vector3::from(position_m);
            let expected = naive_density(&mixture, position_m, &covariance_m2);
            assert!((found / expected - 1.0).abs() < 1e-9, "{found} {expected}");
        }
    }
}
