//! Agreement: whether each camera shows the target where the others do. A camera whose pose, focal length or clock is wrong does not, frame after frame.
//!
//! Each camera's own outline, measured by the fit ([`MeasuredOffset`]), is compared with where the others' outlines put it. How far they disagree is the
//! variance of the camera's error, by expectation maximisation: fits and covariances take it into account. How they disagree tells the cause.

use nalgebra::{Matrix2, Matrix3, Vector2, Vector3};

use crate::likelihood::edge::{Detection, MeasuredOffset};
use crate::tracker::camera_agreement::{ComparisonSums, Innovation};
use crate::tuning::AgreementTuning;
use crate::view::View;

/// The information on a position before any camera, 1/m²: keeps what one camera leaves open finite. Derivation: kilometres.
const PRIOR_INFORMATION: f64 = 1e-6;

/// How far the cameras agree on one target.
#[derive(Debug, Clone, Default)]
pub(super) struct Agreement {
    /// One per camera.
    cameras: Vec<CameraState>,
    /// The time of the latest comparison.
    time_s: f64,
}

/// The state of one camera.
#[derive(Debug, Clone)]
struct CameraState {
    /// The variance of its error, px².
    variance_px2: f64,
    /// The number of comparisons so far.
    comparisons: u32,
    /// The latest outline.
    latest: Option<Outline>,
    sums: ComparisonSums,
    /// The mean square, along an axis, of what its likeliest systematic error does to the latest outline, px².
    systematic_px2: f64,
}

/// An outline that a camera showed.
#[derive(Debug, Clone, Copy)]
struct Outline {
    time_s: f64,
    /// The position around which it was measured, metres.
    position_m: Vector3<f64>,
    measured: MeasuredOffset,
    /// Its velocity in the image, pixels per second; `None` without an earlier frame.
    velocity_px: Option<Vector2<f64>>,
    /// How the position depends on what it is off, as a covariance per px², m²/px².
    m2_per_px2: Matrix3<f64>,
}

/// A camera's outline, as if it had been seen now.
#[derive(Clone, Copy)]
struct Seen {
    /// From the projection of the detection, pixels.
    offset_px: Vector2<f64>,
    measured: MeasuredOffset,
}

/// The outlines of several cameras, weighted by the inverse covariances of their errors.
#[derive(Clone, Copy)]
struct Joint {
    information: Matrix3<f64>,
    sum: Vector3<f64>,
}

impl Joint {
    fn new() -> Self {
        Self {
            information: Matrix3::from_diagonal_element(PRIOR_INFORMATION),
            sum: Vector3::zeros(),
        }
    }

    /// Adds an outline, or takes one away with the weight -1.
    fn add(&mut self, seen: &Seen, weight: &Matrix2<f64>, times: f64) {
        let weighted = times * seen.measured.px_per_m.transpose() * weight;
        self.information += weighted * seen.measured.px_per_m;
        self.sum += weighted * seen.offset_px;
    }

    /// Where these outlines put the target, relative to the detection, and the covariance of this.
    fn position(&self) -> (Vector3<f64>, Matrix3<f64>) {
        let covariance = self
            .information
            .try_inverse()
            .unwrap_or_else(Matrix3::zeros);
        (covariance * self.sum, covariance)
    }
}

/// The inverse covariance of an outline whose camera has an error of this variance.
fn weight(seen: &Seen, variance_px2: f64) -> Matrix2<f64> {
    let sum = seen.measured.covariance_px2 + Matrix2::from_diagonal_element(variance_px2);
    sum.try_inverse().unwrap_or_else(Matrix2::zeros)
}

impl Agreement {
    pub(super) fn new(views: &[View], tuning: &AgreementTuning) -> Self {
        let state = |view: &View| CameraState {
            variance_px2: tuning.sigma_px.powi(2),
            comparisons: 0,
            latest: None,
            sums: ComparisonSums::new(view),
            systematic_px2: 0.0,
        };
        Self {
            cameras: views.iter().map(state).collect(),
            time_s: 0.0,
        }
    }

    /// Forgets everything.
    pub(super) fn reset(&mut self, tuning: &AgreementTuning) {
        for camera in &mut self.cameras {
            camera.variance_px2 = tuning.sigma_px.powi(2);
            camera.comparisons = 0;
            camera.latest = None;
            camera.sums.reset();
            camera.systematic_px2 = 0.0;
        }
    }

    /// The standard deviation of a camera's error in pixels; 0 for a camera alone.
    pub(super) fn sigma_px(&self, camera: usize) -> f64 {
        if self.cameras.len() > 1 {
            self.cameras[camera].variance_px2.sqrt()
        } else {
            0.0
        }
    }

    /// The comparisons of each camera with the others.
    pub(super) fn sums(&self) -> impl Iterator<Item = &ComparisonSums> {
        self.cameras.iter().map(|camera| &camera.sums)
    }

    /// The covariance of a position from errors of the cameras, beyond those that all cameras have, m².
    pub(super) fn covariance_m2(&self, tuning: &AgreementTuning) -> Matrix3<f64> {
        let of_camera = |camera: &CameraState| {
            let outline = camera
                .latest
                .filter(|outline| outline.is_recent(self.time_s, tuning))?;
            let more_px2 = (camera.variance_px2 - tuning.sigma_px.powi(2)).max(0.0);
            Some(outline.m2_per_px2 * more_px2.max(camera.systematic_px2))
        };
        self.cameras.iter().filter_map(of_camera).sum()
    }

    /// Compares the cameras that show a detection with the others.
    pub(super) fn update(
        &mut self,
        (detection, min_visible_share): (&Detection, f32),
        time_s: f64,
        tuning: &AgreementTuning,
    ) {
        if self.cameras.len() < 2 {
            return;
        }
        self.time_s = time_s;
        let position_m = Vector3::from(detection.position_m());
        for camera in detection.cameras() {
            let share = detection.visible_share_in(camera);
            let is_unoccluded = share.is_some_and(|share| share >= f64::from(min_visible_share));
            let offset = detection.offset(camera);
            let measured = offset.measured().filter(|_| is_unoccluded);
            let state = &mut self.cameras[camera];
            let before = state
                .latest
                .filter(|outline| outline.is_recent(time_s, tuning));
            state.latest = measured.map(|measured| Outline {
                time_s,
                position_m,
                measured,
                velocity_px: before.map(|before| {
                    let moved_px = measured.place_px() - before.measured.place_px();
                    moved_px / (time_s - before.time_s)
                }),
                m2_per_px2: detection.m2_per_px2(camera),
            });
        }
        let seen_now = |camera: &CameraState| {
            let outline = camera
                .latest
                .filter(|outline| outline.is_recent(time_s, tuning))?;
            let (measured, since_s) = (outline.measured, time_s - outline.time_s);
            let moved_px = if since_s > 0.0 {
                outline.velocity_px? * since_s
            } else {
                Vector2::zeros()
            };
            let from_m = outline.position_m - position_m;
            Some(Seen {
                offset_px: measured.px + moved_px + measured.px_per_m * from_m,
                measured,
            })
        };
        let (mut joint, mut even, mut count, mut sum_px2) = (Joint::new(), Joint::new(), 0, 0.0);
        for camera in &self.cameras {
            if let Some(seen) = seen_now(camera) {
                joint.add(&seen, &weight(&seen, camera.variance_px2), 1.0);
                even.add(&seen, &weight(&seen, 1.0), 1.0);
                count += 1;
            }
            sum_px2 += camera.variance_px2;
        }
        if count < 2 {
            return;
        }
        let mean_px2 = sum_px2 / self.cameras.len() as f64;
        let (off_m, covariance_m2) = joint.position();
        for camera in &mut self.cameras {
            let is_new = camera
                .latest
                .is_some_and(|outline| outline.time_s == time_s);
            let Some(seen) = seen_now(camera).filter(|_| is_new) else {
                continue;
            };
            let (variance_px2, px_per_m) = (camera.variance_px2, seen.measured.px_per_m);
            let weight_px2 = weight(&seen, variance_px2);
            // Where the others put the outline.
            let mut others = joint;
            others.add(&seen, &weight_px2, -1.0);
            let squared_sigmas = innovation(&seen, variance_px2, &others).squared_sigmas();
            let mut even_others = even;
            even_others.add(&seen, &weight(&seen, 1.0), -1.0);
            let velocity_px = camera.latest.and_then(|outline| outline.velocity_px);
            let velocity_px = velocity_px.unwrap_or_default();
            camera.sums.add(
                &innovation(&seen, 1.0, &even_others),
                &seen.measured.middle_px,
                &velocity_px,
                1.0 / (1.0 + squared_sigmas / tuning.outlier_sigmas.powi(2)),
                tuning,
            );
            let systematic_px =
                (camera.sums).systematic_px(&seen.measured.middle_px, &velocity_px, tuning);
            camera.systematic_px2 = 0.5 * systematic_px.norm_squared();
            // The camera's error, if all have theirs.
            let error_px = variance_px2 * weight_px2 * (seen.offset_px - px_per_m * off_m);
            let known = weight_px2
                - weight_px2 * px_per_m * covariance_m2 * px_per_m.transpose() * weight_px2;
            let unknown_px2 = 2.0 * variance_px2 - variance_px2 * variance_px2 * known.trace();
            let found_px2 = 0.5 * (error_px.norm_squared() + unknown_px2);
            let found_px2 = found_px2.min(tuning.max_growth * variance_px2);
            let found_px2 = found_px2 + tuning.shared_share * (mean_px2 - found_px2);
            camera.comparisons += 1;
            camera.learn(found_px2, tuning);
        }
        self.share_pair();
    }

    /// Two cameras do not tell whose error it is: both have the same, in metres at the target.
    fn share_pair(&mut self) {
        let [one, other] = &mut self.cameras[..] else {
            return;
        };
        let squared_px_per_m = |camera: &CameraState| {
            let px_per_m = camera.latest?.measured.px_per_m;
            Some(0.5 * px_per_m.norm_squared()).filter(|squared| *squared > 0.0)
        };
        let (Some(of_one), Some(of_other)) = (squared_px_per_m(one), squared_px_per_m(other))
        else {
            return;
        };
        let mean_m2 = 0.5 * (one.variance_px2 / of_one + other.variance_px2 / of_other);
        one.variance_px2 = mean_m2 * of_one;
        other.variance_px2 = mean_m2 * of_other;
    }
}

impl CameraState {
    /// Moves the variance of the camera's error towards what the latest comparison says.
    fn learn(&mut self, found_px2: f64, tuning: &AgreementTuning) {
        let rate = 1.0 / tuning.memory_frames.min(f64::from(self.comparisons) + 3.0);
        self.variance_px2 += rate * (found_px2 - self.variance_px2);
        self.variance_px2 = self.variance_px2.max(tuning.sigma_px.powi(2));
    }
}

/// What an outline, of a camera with an error of this variance, is off from where the others put it.
fn innovation(seen: &Seen, variance_px2: f64, others: &Joint) -> Innovation {
    let (others_m, covariance_m2) = others.position();
    let px_per_m = seen.measured.px_per_m;
    Innovation {
        px: seen.offset_px - px_per_m * others_m,
        covariance_px2: seen.measured.covariance_px2
            + Matrix2::from_diagonal_element(variance_px2)
            + px_per_m * covariance_m2 * px_per_m.transpose(),
    }
}

impl Outline {
    fn is_recent(&self, time_s: f64, tuning: &AgreementTuning) -> bool {
        time_s - self.time_s <= tuning.max_age_s
    }
}
