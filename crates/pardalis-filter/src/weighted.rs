//! Statistics of weighted positions and velocities: the weight near a point, the scatter, the heaviest and the likeliest particle.

/// Returns the share of the weight within `distance_m` of a point.
pub(crate) fn weight_within(
    positions: impl Iterator<Item = ([f64; 3], f64)>,
    point_m: [f64; 3],
    distance_m: f64,
) -> f64 {
    let near = |position_m: &[f64; 3]| {
        let squares = position_m.iter().zip(point_m).map(|(a, b)| (a - b).powi(2));
        squares.sum::<f64>() <= distance_m * distance_m
    };
    positions
        .filter(|(position_m, _)| near(position_m))
        // Starts from +0: an empty sum would be -0.
        .fold(0.0_f64, |sum, (_, weight)| sum + weight)
        // The weights sum to one up to rounding.
        .min(1.0)
}

/// Adds the scatter of weighted positions or velocities around their mean to their covariance (xx, xy, xz, yy, yz, zz).
pub(crate) fn add_scatter(
    vectors: impl Iterator<Item = ([f64; 3], f64)>,
    mean: [f64; 3],
    covariance: &mut [f64; 6],
) {
    for (vector, weight) in vectors {
        let [dx, dy, dz] = [0, 1, 2].map(|axis| vector[axis] - mean[axis]);
        let products = [dx * dx, dx * dy, dx * dz, dy * dy, dy * dz, dz * dz];
        for (sum, product) in covariance.iter_mut().zip(products) {
            *sum += weight * product;
        }
    }
}

/// Returns the index of the largest weight, the first one in case of ties.
pub(crate) fn heaviest(weights: &[f64]) -> usize {
    let heavier = |best: usize, i: usize| {
        if weights[i] > weights[best] { i } else { best }
    };
    (0..weights.len()).reduce(heavier).unwrap_or(0)
}

/// Returns the index of the particle with the greatest log-likelihood among those with a weight above 0; in case of
/// ties the one with the greatest weight, then the first.
pub(crate) fn likeliest(log_likelihoods: &[f32], log_weights: &[f64]) -> usize {
    let rank = |i: usize| (log_likelihoods[i], log_weights[i]);
    let is_possible = |&i: &usize| log_weights[i] > f64::NEG_INFINITY && !rank(i).0.is_nan();
    let likelier = |best: usize, i: usize| if rank(i) > rank(best) { i } else { best };
    (0..log_weights.len())
        .filter(is_possible)
        .reduce(likelier)
        .unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_likeliest_is_possible_and_of_equals_the_heaviest() {
        let none = f64::NEG_INFINITY;
        assert_eq!(likeliest(&[1.0, 3.0, 2.0], &[-1.0, -9.0, -0.1]), 1);
        assert_eq!(likeliest(&[1.0, 9.0, 2.0], &[-1.0, none, -3.0]), 2);
        assert_eq!(likeliest(&[f32::NAN, 0.0], &[-1.0, -1.0]), 1);
        assert_eq!(likeliest(&[2.0, 2.0, 2.0], &[-3.0, -1.0, -1.0]), 1);
        assert_eq!(likeliest(&[1.0, 2.0], &[none, none]), 0);
    }
}
