//! The proposal density of new particles: a mixture of the prediction, its products with nearby measurement
//! components, and births at components.

use std::f64::consts::PI;

use super::tuning::ProposalTuning;
use crate::gaussian::MAX_START;

/// Maximum squared Mahalanobis distance of a component near a prediction: six standard deviations. Derivation: 1e-8
/// of the probability lies farther away.
const NEAR_SQUARED: f64 = 36.0;
/// Minimum variance of a component along any axis, m²: 1 µm squared. Hand-set: keeps densities finite.
const MIN_VARIANCE_M2: f64 = 1e-12;
/// Number of components for which memory is allocated in advance. Hand-set.
const COMPONENT_ROOM: usize = 8;
/// Number of sweeps of Jacobi rotations. Derivation: each squares the magnitude of the off-diagonal elements, so that fewer
/// than these reach the precision of numbers.
const SWEEPS: usize = 10;

/// A Gaussian in the world that a detection contributes to the proposal. It does not bias the posterior, because
/// importance weights correct for it.
///
/// Components with numbers that are not finite, positions beyond 1e6 m or covariances beyond 1e12 m² are ignored.
/// Variances along the principal axes are raised to at least 1 µm².
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MeasurementComponent {
    /// Mean in the world, metres. In planar motion, it determines the height of the particles.
    pub position_m: [f64; 3],
    /// Covariance: xx, xy, xz, yy, yz, zz in m².
    pub covariance_m2: [f64; 6],
    /// Logarithm of its weight relative to the other components, up to a common constant, in nats.
    pub log_weight: f64,
}

/// The prediction for one particle: a Gaussian of one variance along each free axis.
pub(super) struct Prediction {
    pub(super) mean_m: [f64; 3],
    pub(super) variance_m2: f64,
}

/// A component along its principal axes.
#[derive(Debug)]
struct Component {
    mean_m: [f64; 3],
    /// Principal axes: unit vectors in the world.
    axes: [[f64; 3]; 3],
    /// Variances along the principal axes, m².
    variances_m2: [f64; 3],
    /// Logarithm of its weight, which is 0 for the component with the greatest weight.
    log_weight: f64,
    /// Share of the births, 0 to 1.
    birth_share: f64,
    /// Logarithms of its density at the mean, and of its part of the density of births there.
    log_height: f64,
    log_birth_height: f64,
    /// For the current prediction: logarithm of weight times predicted density if the prediction is near, else -∞.
    log_agreement: f64,
}

/// The proposal density. Steps with at most [`COMPONENT_ROOM`] components, or as many as before, allocate no memory.
#[derive(Debug)]
pub(super) struct Proposal {
    free_axes: usize,
    tuning: ProposalTuning,
    components: Vec<Component>,
    /// Share of births if a component is near the prediction.
    birth_share: f64,
}

impl Proposal {
    pub(super) fn new(free_axes: usize, tuning: ProposalTuning) -> Self {
        Self {
            free_axes,
            tuning,
            components: Vec::with_capacity(COMPONENT_ROOM),
            birth_share: 0.0,
        }
    }

    /// Builds the proposal from new components. `elsewhere` is the probability that the target, given that it
    /// exists, is not where the particles predict it.
    pub(super) fn condition_on(&mut self, components: &[MeasurementComponent], elsewhere: f64) {
        self.components.clear();
        let free_axes = self.free_axes;
        let components = components
            .iter()
            .filter_map(|component| Component::of(component, free_axes));
        self.components.extend(components);
        let log_weights = self.components.iter().map(|component| component.log_weight);
        let greatest = log_weights.fold(f64::NEG_INFINITY, f64::max);
        let mut total = 0.0;
        for component in &mut self.components {
            component.log_weight -= greatest;
            total += libm::exp(component.log_weight);
        }
        // Some of the births are distributed evenly, because the weights are based on a single frame.
        let even_share = self.tuning.even_birth_share;
        let even = 1.0 / self.components.len() as f64;
        for component in &mut self.components {
            let by_weight = libm::exp(component.log_weight) / total;
            component.birth_share = even_share * even + (1.0 - even_share) * by_weight;
            let log_widening = free_axes as f64 * libm::log(self.tuning.birth_widening);
            component.log_birth_height =
                libm::log(component.birth_share) + component.log_height - log_widening;
        }
        self.birth_share = if self.components.is_empty() {
            0.0
        } else {
            self.tuning.birth_share + (1.0 - self.tuning.birth_share) * elsewhere
        };
    }

    /// Reports whether there is no component.
    pub(super) fn is_empty(&self) -> bool {
        self.components.is_empty()
    }

    /// Returns the height of the components in metres, if there are any.
    pub(super) fn height_m(&self) -> Option<f64> {
        self.components.first().map(|component| component.mean_m[2])
    }

    /// Draws a position for one particle. Returns it with the logarithm of the density of the whole mixture there.
    /// `share` in [0, 1) selects the part of the mixture, `normals` are standard normal.
    pub(super) fn draw(
        &mut self,
        prediction: &Prediction,
        share: f64,
        normals: [f64; 3],
    ) -> ([f64; 3], f64) {
        let mut log_near = f64::NEG_INFINITY;
        for component in &mut self.components {
            component.log_agreement = component.log_agreement(prediction, self.free_axes);
            log_near = log_add(log_near, component.log_agreement);
        }
        // Without components nearby, their share is divided between births and the prediction.
        let predicted_share = self.tuning.predicted_share;
        let rest = 1.0 - self.birth_share;
        let [birth_share, near_share] = if log_near > f64::NEG_INFINITY {
            [self.birth_share, rest * (1.0 - predicted_share)]
        } else if self.is_empty() {
            [0.0; 2]
        } else {
            [self.birth_share + rest * (1.0 - predicted_share) / 2.0, 0.0]
        };
        let [mut left_birth, mut left_near] = [share, share - birth_share];
        let position_m = if left_birth < birth_share {
            let component = self.pick(|component| {
                left_birth -= birth_share * component.birth_share;
                left_birth < 0.0
            });
            component.draw_birth(normals, self.free_axes, self.tuning.birth_widening)
        } else if left_near < near_share {
            let component = self.pick(|component| {
                left_near -= near_share * libm::exp(component.log_agreement - log_near);
                left_near < 0.0
            });
            component.agreed(prediction, normals, self.free_axes)
        } else {
            prediction.draw(normals, self.free_axes)
        };
        let log_density =
            self.log_density(position_m, prediction, log_near, [birth_share, near_share]);
        (position_m, log_density)
    }

    /// Draws a birth; `share` in [0, 1) selects the component.
    pub(super) fn draw_birth(&self, share: f64, normals: [f64; 3]) -> [f64; 3] {
        let mut left = share;
        let is_it = |component: &&Component| {
            left -= component.birth_share;
            left < 0.0
        };
        let found = self.components.iter().find(is_it);
        let component = found.unwrap_or(&self.components[self.components.len() - 1]);
        component.draw_birth(normals, self.free_axes, self.tuning.birth_widening)
    }

    /// Returns the logarithm of the density of births.
    pub(super) fn log_birth_density(&self, position_m: [f64; 3]) -> f64 {
        let of_place = |component: &Component| {
            let squared = component.squared(position_m, self.free_axes);
            component.log_birth_density(squared, self.tuning.birth_widening)
        };
        let logs = self.components.iter().map(of_place);
        logs.fold(f64::NEG_INFINITY, log_add)
    }

    /// Returns the first component for which `is_it` holds or, because of rounding, the last one near the prediction.
    fn pick(&self, mut is_it: impl FnMut(&Component) -> bool) -> &Component {
        let found = self.components.iter().find(|component| is_it(component));
        found.unwrap_or_else(|| {
            let agrees = |component: &&Component| component.log_agreement > f64::NEG_INFINITY;
            let last = self.components.iter().rfind(agrees);
            last.unwrap_or(&self.components[self.components.len() - 1])
        })
    }

    /// The product of a prediction and a component, N(x; μ, P)·N(x; c, Σ), is N(c; μ, P + Σ) times the density of the
    /// normalised product. The densities of all products, multiplied by their shares, therefore sum to the density of
    /// the prediction times the sum of those of the components.
    fn log_density(
        &self,
        position_m: [f64; 3],
        prediction: &Prediction,
        log_near: f64,
        [birth_share, near_share]: [f64; 2],
    ) -> f64 {
        let [mut log_birth, mut log_peaks] = [f64::NEG_INFINITY; 2];
        for component in &self.components {
            let squared = component.squared(position_m, self.free_axes);
            let of_place = component.log_birth_density(squared, self.tuning.birth_widening);
            log_birth = log_add(log_birth, of_place);
            if component.log_agreement > f64::NEG_INFINITY {
                let log_peak = component.log_weight + component.log_height;
                log_peaks = log_add(log_peaks, log_peak - squared / 2.0);
            }
        }
        let predicted_share = 1.0 - birth_share - near_share;
        let mut log_predicted = libm::log(predicted_share);
        if near_share > 0.0 {
            log_predicted = log_add(log_predicted, libm::log(near_share) + log_peaks - log_near);
        }
        log_add(
            log_predicted + prediction.log_density(position_m, self.free_axes),
            libm::log(birth_share) + log_birth,
        )
    }
}

impl Prediction {
    fn draw(&self, normals: [f64; 3], free_axes: usize) -> [f64; 3] {
        let sigma_m = self.variance_m2.sqrt();
        let mut position_m = self.mean_m;
        for axis in 0..free_axes {
            position_m[axis] += sigma_m * normals[axis];
        }
        position_m
    }

    /// Returns the logarithm of its density, per m³ (per m² in a plane).
    pub(super) fn log_density(&self, position_m: [f64; 3], free_axes: usize) -> f64 {
        let squared: f64 = (0..free_axes)
            .map(|axis| (position_m[axis] - self.mean_m[axis]).powi(2))
            .sum();
        let log_variance = libm::log(2.0 * PI * self.variance_m2);
        -0.5 * (squared / self.variance_m2 + free_axes as f64 * log_variance)
    }
}

impl Component {
    fn of(component: &MeasurementComponent, free_axes: usize) -> Option<Self> {
        let fits = |values: &[f64], most: f64| values.iter().all(|value| value.abs() <= most);
        if !(fits(&component.position_m, MAX_START)
            && fits(&component.covariance_m2, MAX_START * MAX_START)
            && component.log_weight.is_finite())
        {
            return None;
        }
        let (axes, variances_m2) = principal_axes(component.covariance_m2, free_axes);
        let variances_m2 = variances_m2.map(|variance| variance.max(MIN_VARIANCE_M2));
        let free = variances_m2[..free_axes].iter();
        let determinant: f64 = free.map(|variance_m2| 2.0 * PI * variance_m2).product();
        Some(Self {
            mean_m: component.position_m,
            axes,
            variances_m2,
            log_weight: component.log_weight,
            birth_share: 0.0,
            log_height: -0.5 * libm::log(determinant),
            log_birth_height: f64::NEG_INFINITY,
            log_agreement: f64::NEG_INFINITY,
        })
    }

    /// Returns the distance of its mean from a position along one of its axes, metres.
    fn along(&self, axis: usize, position_m: [f64; 3], free_axes: usize) -> f64 {
        (0..free_axes)
            .map(|i| self.axes[axis][i] * (self.mean_m[i] - position_m[i]))
            .sum()
    }

    /// Returns the logarithm of its weight times N(c; μ, P + Σ); -∞ if the prediction is far away.
    fn log_agreement(&self, prediction: &Prediction, free_axes: usize) -> f64 {
        let (mut squared, mut determinant) = (0.0, 1.0);
        for axis in 0..free_axes {
            let variance_m2 = prediction.variance_m2 + self.variances_m2[axis];
            squared += self.along(axis, prediction.mean_m, free_axes).powi(2) / variance_m2;
            determinant *= 2.0 * PI * variance_m2;
        }
        if squared <= NEAR_SQUARED {
            self.log_weight - 0.5 * (squared + libm::log(determinant))
        } else {
            f64::NEG_INFINITY
        }
    }

    /// Returns the squared Mahalanobis distance of a position.
    fn squared(&self, position_m: [f64; 3], free_axes: usize) -> f64 {
        let of_axis =
            |axis: usize| self.along(axis, position_m, free_axes).powi(2) / self.variances_m2[axis];
        (0..free_axes).map(of_axis).sum()
    }

    /// Returns the logarithm of its part of the density of births at this squared Mahalanobis distance.
    fn log_birth_density(&self, squared: f64, widening: f64) -> f64 {
        self.log_birth_height - squared / widening.powi(2) / 2.0
    }

    /// Draws a birth from the widened component.
    fn draw_birth(&self, normals: [f64; 3], free_axes: usize, widening: f64) -> [f64; 3] {
        let mut position_m = self.mean_m;
        for axis in 0..free_axes {
            let step_m = widening * self.variances_m2[axis].sqrt() * normals[axis];
            self.go(&mut position_m, axis, step_m, free_axes);
        }
        position_m
    }

    /// Draws a position from the normalised product of the component and a prediction.
    fn agreed(&self, prediction: &Prediction, normals: [f64; 3], free_axes: usize) -> [f64; 3] {
        let mut position_m = prediction.mean_m;
        for axis in 0..free_axes {
            let variance_m2 = self.variances_m2[axis];
            let gain = prediction.variance_m2 / (prediction.variance_m2 + variance_m2);
            let step_m = gain * self.along(axis, prediction.mean_m, free_axes)
                + (gain * variance_m2).sqrt() * normals[axis];
            self.go(&mut position_m, axis, step_m, free_axes);
        }
        position_m
    }

    fn go(&self, position_m: &mut [f64; 3], axis: usize, step_m: f64, free_axes: usize) {
        for i in 0..free_axes {
            position_m[i] += self.axes[axis][i] * step_m;
        }
    }
}

/// Returns the principal axes (unit vectors) of the covariance of the first two axes, or of all three, and the
/// variances along them (Jacobi rotations).
fn principal_axes(
    [xx, xy, xz, yy, yz, zz]: [f64; 6],
    free_axes: usize,
) -> ([[f64; 3]; 3], [f64; 3]) {
    let mut matrix = [[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]];
    let mut axes = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    let pairs = [(0, 1), (0, 2), (1, 2)];
    let pairs = pairs.into_iter().filter(|&(_, q)| q < free_axes);
    for (p, q) in pairs.cycle().take(SWEEPS * free_axes * (free_axes - 1) / 2) {
        if matrix[p][q] == 0.0 {
            continue;
        }
        let theta = (matrix[q][q] - matrix[p][p]) / (2.0 * matrix[p][q]);
        let tangent = 1_f64.copysign(theta) / (theta.abs() + (theta * theta + 1.0).sqrt());
        let cos = 1.0 / (tangent * tangent + 1.0).sqrt();
        let sin = tangent * cos;
        let rotate = |a: &mut f64, b: &mut f64| {
            (*a, *b) = (cos * *a - sin * *b, sin * *a + cos * *b);
        };
        for rows in [&mut matrix, &mut axes] {
            let (head, tail) = rows.split_at_mut(q);
            for (a, b) in head[p].iter_mut().zip(&mut tail[0]) {
                rotate(a, b);
            }
        }
        for row in &mut matrix {
            let (head, tail) = row.split_at_mut(q);
            rotate(&mut head[p], &mut tail[0]);
        }
    }
    (axes, [0, 1, 2].map(|axis| matrix[axis][axis]))
}

/// The greatest logarithm of a share that does not change a sum. Derivation: less than half a unit in the last place of 1. Most parts of a mixture are far away.
const NEGLIGIBLE_LOG: f64 = -45.0;

/// Returns ln(eᵃ + eᵇ).
pub(super) fn log_add(a: f64, b: f64) -> f64 {
    let (less, more) = if a < b { (a, b) } else { (b, a) };
    // Both may be -∞.
    if less == f64::NEG_INFINITY || less - more < NEGLIGIBLE_LOG {
        more
    } else {
        more + libm::log1p(libm::exp(less - more))
    }
}
