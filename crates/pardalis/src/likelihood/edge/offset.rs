//! Offsets: by how much a camera shows an outline beside its projection, because its pose, its focal length or its clock is wrong. All lines of its outline
//! share it. Fits weigh it against the other cameras instead of letting one of them contradict the outline.

use nalgebra::{
    Matrix2, Matrix2x3, Matrix3, Matrix3x2, Matrix4, Matrix4x2, SymmetricEigen, Vector2, Vector4,
};

use super::{Coordinates, LANES};

/// Directions in which the lines say less of an offset, as a share of the other direction, are not measured. Hand-set.
const LEAST_SHARE: f64 = 1e-3;

/// The tails of the prior: infinite for a Gaussian. Hand-set: Gaussian up to two standard deviations, so that cameras share what they disagree by.
const TAILS: f64 = 4.0;

/// The offset of an outline in one camera, in the frame's pixels. Its prior has heavy tails, those of a Student distribution, so that outlines overrule it.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(crate) struct Offset {
    /// The offset.
    pub(super) px: Vector2<f64>,
    /// The standard deviation of its prior; 0 for a camera without error.
    sigma_px: f64,
    /// The offset and what the lines said there before the latest step, and before a finer octave was fitted.
    before: (Vector2<f64>, OffsetSlope),
    coarse: (Vector2<f64>, OffsetSlope),
    /// What the camera's lines say at the offset.
    lines: OffsetSlope,
    /// The middle of the outline's projection at the detection.
    middle_px: Vector2<f64>,
}

/// The log-likelihood of one camera's lines: gradient and curvature in the offset, and how the latter depends on position and logarithm of the scale.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct OffsetSlope {
    gradient: Vector2<f64>,
    curvature: Matrix2<f64>,
    coupling: Matrix4x2<f64>,
}

impl OffsetSlope {
    /// Adds a line with this direction in the frame's pixels. `along` is how its shift depends on position and logarithm of the scale; gradient and curvature are those of
    /// its log-likelihood in the shift.
    pub(super) fn add(
        &mut self,
        along: &Vector4<f64>,
        normal: Vector2<f64>,
        [gradient, curvature]: [f64; 2],
    ) {
        self.gradient += normal * gradient;
        self.curvature += normal * normal.transpose() * curvature;
        self.coupling += along * normal.transpose() * curvature;
    }
}

impl Offset {
    /// The inverse variance of the Gaussian that has the same slope at the offset as the prior.
    fn information(&self) -> f64 {
        1.0 / (self.sigma_px.powi(2) + 0.5 * self.px.norm_squared() / TAILS)
    }

    /// The logarithm of the prior's density at the offset, relative to that at none.
    pub(super) fn log_density(&self) -> f64 {
        if self.px == Vector2::zeros() {
            return 0.0;
        }
        let squared_sigmas = self.px.norm_squared() / self.sigma_px.powi(2);
        -TAILS * libm::log1p(0.5 * squared_sigmas / TAILS)
    }

    /// The inverse of the curvature in the offset, prior included.
    fn covariance_px2(&self) -> Matrix2<f64> {
        let sum = self.lines.curvature + Matrix2::from_diagonal_element(self.information());
        sum.try_inverse().unwrap_or_else(Matrix2::zeros)
    }

    /// Notes what the lines say at the offset. Returns by how much the gradient and the curvature in position and logarithm of the scale are less, because the offset is
    /// unknown too; `None` for a camera without error.
    pub(super) fn note(&mut self, lines: OffsetSlope) -> Option<(Vector4<f64>, Matrix4<f64>)> {
        if self.sigma_px == 0.0 {
            return None;
        }
        self.lines = lines;
        let by_offset = lines.coupling * self.covariance_px2();
        let gradient = lines.gradient - self.information() * self.px;
        Some((by_offset * gradient, by_offset * lines.coupling.transpose()))
    }

    /// Notes the middle of the outline's projection, its first lane.
    pub(super) fn note_middle(&mut self, coordinates: &[Coordinates]) {
        if self.sigma_px == 0.0 {
            return;
        }
        let [u, v] = middles(coordinates);
        self.middle_px = Vector2::new(u[0], v[0]).map(f64::from);
    }

    /// No offset, of a camera whose error has this standard deviation in pixels.
    pub(super) fn with_sigma(sigma_px: f64) -> Self {
        Self {
            sigma_px,
            ..Self::default()
        }
    }

    /// Moves to the likeliest offset after a step of position and logarithm of the scale, by `most_px` at most.
    pub(super) fn step(&mut self, step: &Vector4<f64>, most_px: f64) {
        self.before = (self.px, self.lines);
        if self.sigma_px == 0.0 {
            return;
        }
        let gradient = self.lines.gradient
            - self.information() * self.px
            - self.lines.coupling.transpose() * step;
        self.px += (self.covariance_px2() * gradient).cap_magnitude(most_px);
    }

    /// Takes the latest step back.
    pub(super) fn restore(&mut self) {
        (self.px, self.lines) = self.before;
    }

    /// Keeps the offset until [`Offset::restore_coarse`].
    pub(super) fn keep_coarse(&mut self) {
        self.coarse = (self.px, self.lines);
    }

    pub(super) fn restore_coarse(&mut self) {
        (self.px, self.lines) = self.coarse;
    }

    /// The offsets of a block of outlines, whose projections have these middles: the likeliest ones, given where the fitted outline is seen. Also by how many nats the
    /// prior is less likely there than at the detection.
    pub(super) fn of_block(
        &self,
        middles: &[[f32; LANES]; 2],
    ) -> ([[f32; LANES]; 2], [f32; LANES]) {
        let mut offsets = [[0.0; LANES]; 2];
        let mut penalties = [0.0; LANES];
        let share = self.covariance_px2() * self.lines.curvature;
        let information = self.information();
        for lane in 0..LANES {
            let middle = Vector2::new(middles[0][lane], middles[1][lane]).map(f64::from);
            let offset = self.px - share * (middle - self.middle_px);
            offsets[0][lane] = offset.x as f32;
            offsets[1][lane] = offset.y as f32;
            let more = offset.norm_squared() - self.px.norm_squared();
            penalties[lane] = (0.5 * information * more) as f32;
        }
        (offsets, penalties)
    }

    /// Where the camera shows the middle of the outline, relative to its projection at the detection; `None` if its lines do not say.
    pub(crate) fn measured(&self) -> Option<MeasuredOffset> {
        let SymmetricEigen { eigenvalues, .. } = self.lines.curvature.symmetric_eigen();
        if self.sigma_px == 0.0 || eigenvalues.min() < LEAST_SHARE * eigenvalues.max() {
            return None;
        }
        let covariance_px2 = self.lines.curvature.try_inverse()?;
        let coupling = self.lines.coupling.fixed_view::<3, 2>(0, 0);
        Some(MeasuredOffset {
            px: self.px + covariance_px2 * (self.information() * self.px),
            covariance_px2,
            px_per_m: covariance_px2 * coupling.transpose(),
            middle_px: self.middle_px,
        })
    }

    /// How the detection's position depends on what this camera's outline is off, metres per pixel, given the covariance of the position.
    pub(super) fn m_per_px(&self, covariance_m2: &Matrix3<f64>) -> Matrix3x2<f64> {
        if self.sigma_px == 0.0 {
            return Matrix3x2::zeros();
        }
        let coupling = self.lines.coupling.fixed_view::<3, 2>(0, 0);
        covariance_m2 * coupling * self.covariance_px2() * self.information()
    }
}

/// Where one camera shows an outline.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct MeasuredOffset {
    /// The offset from the projection of the detection, and its covariance.
    pub(crate) px: Vector2<f64>,
    pub(crate) covariance_px2: Matrix2<f64>,
    /// How the projection moves with the position.
    pub(crate) px_per_m: Matrix2x3<f64>,
    /// The middle of the projection.
    pub(crate) middle_px: Vector2<f64>,
}

impl MeasuredOffset {
    /// Where the camera shows the middle of the outline.
    pub(crate) fn place_px(&self) -> Vector2<f64> {
        self.middle_px + self.px
    }
}

/// Moves outlines by an offset.
pub(super) fn shift(coordinates: &mut [Coordinates], offset: Vector2<f64>) {
    if offset == Vector2::zeros() {
        return;
    }
    let offset = offset.map(|v| v as f32);
    for point in coordinates {
        for (axis, lanes) in point.iter_mut().enumerate() {
            for v in lanes {
                *v += offset[axis];
            }
        }
    }
}

/// The middles of outlines: the means of their points that have pixels.
pub(super) fn middles(coordinates: &[Coordinates]) -> [[f32; LANES]; 2] {
    let (mut sums, mut counts) = ([[0.0_f32; LANES]; 2], [0.0_f32; LANES]);
    for [u, v] in coordinates {
        for lane in 0..LANES {
            if (u[lane] + v[lane]).is_finite() {
                sums[0][lane] += u[lane];
                sums[1][lane] += v[lane];
                counts[lane] += 1.0;
            }
        }
    }
    sums.map(|sums| std::array::from_fn(|lane| sums[lane] / counts[lane]))
}
