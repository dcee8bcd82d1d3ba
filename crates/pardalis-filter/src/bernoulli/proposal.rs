//! Where new particles are drawn from: the prediction, what it agrees on with the components nearby, and the components alone.

use std::f64::consts::PI;

use crate::gaussian::MAX_START;

/// The share of particles that come from the components alone where one is near, at least.
const BIRTH_SHARE: f64 = 0.1;
/// Of the others, the share that come from the prediction alone.
const PREDICTED_SHARE: f64 = 0.25;
/// Peaks alone are widened by this factor (standard deviations): their likelihood may have wider tails than they say.
const BIRTH_WIDENING: f64 = 2.0;
/// A component is near a prediction within this squared Mahalanobis distance, 6²: nothing farther agrees with it.
const NEAR_SQUARED: f64 = 36.0;
/// No axis of a component is surer than 1 µm, in m².
const MIN_VARIANCE_M2: f64 = 1e-12;
/// Each sweep of Jacobi's rotations squares what is off the diagonal.
const SWEEPS: usize = 10;

/// A component that the images speak for: a Gaussian in the world to draw proposals from. It has no say in the weights, which correct for it.
///
/// Numbers that are not finite, positions beyond 1e6 m and covariances beyond 1e12 m² make it no component: it is left out. Of a matrix that is not positive
/// definite the variances along its principal axes count as 1 µm² at least.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MeasurementComponent {
    /// Mean in the world, metres. In a plane its height is the particles' from then on.
    pub position_m: [f64; 3],
    /// Covariance: xx, xy, xz, yy, yz, zz in m².
    pub covariance_m2: [f64; 6],
    /// How much the images speak for it beside the other components: a logarithm, of any common scale.
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
    /// Unit vectors in the world, ...
    axes: [[f64; 3]; 3],
    /// ... and the variances along them, m².
    variances_m2: [f64; 3],
    /// The evidence, its greatest among the components being 0.
    log_weight: f64,
    /// Its share of the particles that come from components alone, 0 to 1.
    birth_share: f64,
    /// Whether the prediction at hand is near: the logarithm of evidence times agreement, else -∞.
    log_agreement: f64,
}

/// The proposal density. A warm step of no more components than before allocates nothing.
#[derive(Debug)]
pub(super) struct Proposal {
    free_axes: usize,
    components: Vec<Component>,
    /// The share of particles that come from the components alone where one is near.
    birth_share: f64,
}

impl Proposal {
    pub(super) fn new(free_axes: usize) -> Self {
        Self {
            free_axes,
            components: Vec::new(),
            birth_share: 0.0,
        }
    }

    /// Takes new components. `elsewhere` is the chance, 0 to 1, that a target, if there is one, is not where particles were.
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
        // Half of them go to all components alike: what one frame speaks for is not all that may be.
        let even = 1.0 / self.components.len() as f64;
        for component in &mut self.components {
            component.birth_share = 0.5 * even + 0.5 * libm::exp(component.log_weight) / total;
        }
        self.birth_share = if self.components.is_empty() {
            0.0
        } else {
            BIRTH_SHARE + (1.0 - BIRTH_SHARE) * elsewhere
        };
    }

    /// Whether no component was left.
    pub(super) fn is_empty(&self) -> bool {
        self.components.is_empty()
    }

    /// The height of the components, where there are any.
    pub(super) fn height_m(&self) -> Option<f64> {
        self.components.first().map(|component| component.mean_m[2])
    }

    /// A position for one particle and the logarithm of the density, of all parts together, that it was drawn from. `share` in [0, 1) tells which part, `normals`
    /// are standard normal.
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
        // What would have gone to components nearby goes to either side where there are none.
        let rest = 1.0 - self.birth_share;
        let [birth_share, near_share] = if log_near > f64::NEG_INFINITY {
            [self.birth_share, rest * (1.0 - PREDICTED_SHARE)]
        } else if self.is_empty() {
            [0.0; 2]
        } else {
            [self.birth_share + rest * (1.0 - PREDICTED_SHARE) / 2.0, 0.0]
        };
        let [mut left_birth, mut left_near] = [share, share - birth_share];
        let position_m = if left_birth < birth_share {
            let component = self.pick(|component| {
                left_birth -= birth_share * component.birth_share;
                left_birth < 0.0
            });
            component.draw_birth(normals, self.free_axes)
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

    /// A position from the components alone, of which `share` in [0, 1) tells the component.
    pub(super) fn draw_birth(&self, share: f64, normals: [f64; 3]) -> [f64; 3] {
        let mut left = share;
        let is_it = |component: &&Component| {
            left -= component.birth_share;
            left < 0.0
        };
        let found = self.components.iter().find(is_it);
        let component = found.unwrap_or(&self.components[self.components.len() - 1]);
        component.draw_birth(normals, self.free_axes)
    }

    /// The logarithm of the density that these are drawn from.
    pub(super) fn log_birth_density(&self, position_m: [f64; 3]) -> f64 {
        let of_place = |component: &Component| {
            let (squared, log_height) =
                component.squared_and_log_height(position_m, self.free_axes);
            component.log_birth_density(squared, log_height, self.free_axes)
        };
        let logs = self.components.iter().map(of_place);
        logs.fold(f64::NEG_INFINITY, log_add)
    }

    /// The first component where `is_it`, or, as shares sum to one but for rounding, the last that agrees with anything.
    fn pick(&self, mut is_it: impl FnMut(&Component) -> bool) -> &Component {
        let found = self.components.iter().find(|component| is_it(component));
        found.unwrap_or_else(|| {
            let agrees = |component: &&Component| component.log_agreement > f64::NEG_INFINITY;
            let last = self.components.iter().rfind(agrees);
            last.unwrap_or(&self.components[self.components.len() - 1])
        })
    }

    /// The product of a prediction and a component, N(x; μ, P)·N(x; c, Σ), is N(c; μ, P + Σ) times the density of what they agree on: so the densities of all that is
    /// agreed on, each with its share, sum up to the prediction's times the sum of the components'.
    fn log_density(
        &self,
        position_m: [f64; 3],
        prediction: &Prediction,
        log_near: f64,
        [birth_share, near_share]: [f64; 2],
    ) -> f64 {
        let [mut log_birth, mut log_peaks] = [f64::NEG_INFINITY; 2];
        for component in &self.components {
            let (squared, log_height) =
                component.squared_and_log_height(position_m, self.free_axes);
            let of_place = component.log_birth_density(squared, log_height, self.free_axes);
            log_birth = log_add(log_birth, of_place);
            if component.log_agreement > f64::NEG_INFINITY {
                log_peaks = log_add(log_peaks, component.log_weight + log_height - squared / 2.0);
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

    /// The logarithm of its density, per m³ (per m² in a plane).
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
        Some(Self {
            mean_m: component.position_m,
            axes,
            variances_m2: variances_m2.map(|variance| variance.max(MIN_VARIANCE_M2)),
            log_weight: component.log_weight,
            birth_share: 0.0,
            log_agreement: f64::NEG_INFINITY,
        })
    }

    /// How far it is along one of its axes from a position, metres.
    fn along(&self, axis: usize, position_m: [f64; 3], free_axes: usize) -> f64 {
        (0..free_axes)
            .map(|i| self.axes[axis][i] * (self.mean_m[i] - position_m[i]))
            .sum()
    }

    /// Evidence times N(c; μ, P + Σ) as a logarithm, -∞ where that is far.
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

    /// The squared Mahalanobis distance of a position, and the logarithm of the density in the middle.
    fn squared_and_log_height(&self, position_m: [f64; 3], free_axes: usize) -> (f64, f64) {
        let (mut squared, mut determinant) = (0.0, 1.0);
        for axis in 0..free_axes {
            squared += self.along(axis, position_m, free_axes).powi(2) / self.variances_m2[axis];
            determinant *= 2.0 * PI * self.variances_m2[axis];
        }
        (squared, -0.5 * libm::log(determinant))
    }

    /// The logarithm of its share of what the widened components alone make of a position.
    fn log_birth_density(&self, squared: f64, log_height: f64, free_axes: usize) -> f64 {
        let widened = squared / BIRTH_WIDENING.powi(2);
        let log_widening = free_axes as f64 * libm::log(BIRTH_WIDENING);
        libm::log(self.birth_share) + log_height - log_widening - widened / 2.0
    }

    /// A position from the widened component alone.
    fn draw_birth(&self, normals: [f64; 3], free_axes: usize) -> [f64; 3] {
        let mut position_m = self.mean_m;
        for axis in 0..free_axes {
            let step_m = BIRTH_WIDENING * self.variances_m2[axis].sqrt() * normals[axis];
            self.go(&mut position_m, axis, step_m, free_axes);
        }
        position_m
    }

    /// A position from what the component and a prediction agree on: the Gaussian that their product is, but for scale.
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

/// Principal axes (unit vectors) of the first two axes' covariance, or of all three's, and the variances along them (Jacobi's rotations).
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

/// ln(eᵃ + eᵇ).
pub(super) fn log_add(a: f64, b: f64) -> f64 {
    let (less, more) = if a < b { (a, b) } else { (b, a) };
    if less == f64::NEG_INFINITY {
        more
    } else {
        more + libm::log1p(libm::exp(less - more))
    }
}
