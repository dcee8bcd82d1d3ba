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

/// Between outlines, a target's image moves as they and the one before say. What is left is about this share of what its acceleration alone does. Hand-set: at 25 frames per
/// second, it is 0.2 of it for an object that swings once in 0.6 s, and 0.5 in 0.25 s.
const UNKNOWN_MOTION_SHARE: f64 = 0.3;

/// The same for the first two outlines: what is left is what an acceleration does. Hand-set: that of a fall.
const UNKNOWN_ACCELERATION_MPS2: f64 = 10.0;

/// How far the cameras agree on one target.
#[derive(Debug, Clone, Default)]
pub(super) struct Agreement {
    /// One per camera.
    cameras: Vec<CameraState>,
    /// The time of the latest frames.
    time_s: f64,
    /// The time at which cameras were compared last: that of frames of at least one of them.
    compared_s: Option<f64>,
}

/// The state of one camera.
#[derive(Debug, Clone)]
struct CameraState {
    /// The variance of its error, px².
    variance_px2: f64,
    /// The number of comparisons so far.
    comparisons: u32,
    /// When it showed the target last, seconds.
    seen_s: f64,
    /// The outlines of the latest frame and of those before, without a gap, the latest first.
    outlines: [Option<Outline>; 3],
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
    /// How the position depends on what it is off, as a covariance per px², m²/px².
    m2_per_px2: Matrix3<f64>,
}

/// A camera's outline, as it would have been seen at the time of a comparison.
#[derive(Clone, Copy)]
struct Seen {
    /// From the projection of a position that all cameras share, pixels.
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
            seen_s: f64::NEG_INFINITY,
            outlines: [None; 3],
            sums: ComparisonSums::new(view),
            systematic_px2: 0.0,
        };
        Self {
            cameras: views.iter().map(state).collect(),
            time_s: 0.0,
            compared_s: None,
        }
    }

    /// Forgets everything.
    pub(super) fn reset(&mut self, tuning: &AgreementTuning) {
        for camera in &mut self.cameras {
            camera.variance_px2 = tuning.sigma_px.powi(2);
            camera.comparisons = 0;
            camera.seen_s = f64::NEG_INFINITY;
            camera.outlines = [None; 3];
            camera.sums.reset();
            camera.systematic_px2 = 0.0;
        }
        self.compared_s = None;
    }

    /// The standard deviation of a camera's error in pixels; 0 for a camera alone.
    pub(super) fn sigma_px(&self, camera: usize) -> f64 {
        if self.cameras.len() > 1 {
            self.cameras[camera].variance_px2.sqrt()
        } else {
            0.0
        }
    }

    /// Notes that these cameras show the target. It counts as a sighting if others do or just did, so that they could be compared.
    pub(super) fn note_sighting(
        &mut self,
        cameras: impl Iterator<Item = usize> + Clone,
        time_s: f64,
        tuning: &AgreementTuning,
    ) {
        let just = |seen_s: f64| time_s - seen_s <= tuning.max_age_s;
        let together = cameras.clone().count() > 1;
        for camera in cameras.clone() {
            let has_other = (self.cameras.iter().enumerate())
                .any(|(other, state)| other != camera && just(state.seen_s));
            let state = &mut self.cameras[camera];
            // A frame between those of others is compared once there is another one of its camera.
            if together || has_other && just(state.seen_s) {
                state.sums.count_sighting();
            }
        }
        for camera in cameras {
            self.cameras[camera].seen_s = time_s;
        }
    }

    /// The comparisons of each camera with the others.
    pub(super) fn sums(&self) -> impl Iterator<Item = &ComparisonSums> {
        self.cameras.iter().map(|camera| &camera.sums)
    }

    /// The covariance of a position from errors of the cameras, beyond those that all cameras have, m².
    pub(super) fn covariance_m2(&self, tuning: &AgreementTuning) -> Matrix3<f64> {
        let of_camera = |camera: &CameraState| {
            let outline = camera.recent(self.time_s, tuning)?;
            let more_px2 = (camera.variance_px2 - tuning.sigma_px.powi(2)).max(0.0);
            Some(outline.m2_per_px2 * more_px2.max(camera.systematic_px2))
        };
        self.cameras.iter().filter_map(of_camera).sum()
    }

    /// Takes the outlines of a detection, and compares the cameras at the latest time at which it is known where each of them shows the target.
    ///
    /// Frames at the same time are compared at once. Otherwise a frame is compared when the other cameras have later ones: between frames, motion is known better than
    /// ahead of them.
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
        for camera in detection.cameras() {
            let share = detection.visible_share_in(camera);
            let is_unoccluded = share.is_some_and(|share| share >= f64::from(min_visible_share));
            let offset = detection.offset(camera);
            let measured = offset.measured().filter(|_| is_unoccluded);
            let outline = measured.map(|measured| Outline {
                time_s,
                position_m: Vector3::from(detection.position_m()),
                measured,
                m2_per_px2: detection.m2_per_px2(camera),
            });
            self.cameras[camera].note(outline, tuning);
        }
        let recent = |camera: &CameraState| camera.recent(time_s, tuning);
        let latest = self.cameras.iter().filter_map(recent);
        let Some(first) = latest.reduce(|a, b| if b.time_s < a.time_s { b } else { a }) else {
            return;
        };
        if self
            .compared_s
            .is_none_or(|compared_s| compared_s < first.time_s)
        {
            self.compared_s = Some(first.time_s);
            self.compare(&first, tuning);
        }
    }

    /// Compares the cameras at the time of an outline.
    fn compare(&mut self, at: &Outline, tuning: &AgreementTuning) {
        let time_s = self.time_s;
        let seen_then = |camera: &CameraState| {
            camera.recent(time_s, tuning)?;
            camera.seen_at(at)
        };
        let (mut joint, mut even, mut count, mut sum_px2) = (Joint::new(), Joint::new(), 0, 0.0);
        for camera in &self.cameras {
            if let Some(seen) = seen_then(camera) {
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
            let is_of_frame = camera.outlines[0].is_some_and(|outline| outline.time_s == at.time_s);
            let Some(seen) = seen_then(camera).filter(|_| is_of_frame) else {
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
            let velocity_px = camera.velocity_px();
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
            let px_per_m = camera.outlines[0]?.measured.px_per_m;
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
    /// Notes what the camera shows in its latest frame.
    fn note(&mut self, outline: Option<Outline>, tuning: &AgreementTuning) {
        let [latest, before, _] = self.outlines;
        let is_next = outline
            .zip(latest)
            .is_some_and(|(next, latest)| latest.is_recent(next.time_s, tuning));
        self.outlines = if is_next {
            [outline, latest, before]
        } else {
            [outline, None, None]
        };
    }

    /// The outline of the latest frame, unless it is older than the tuning says.
    fn recent(&self, time_s: f64, tuning: &AgreementTuning) -> Option<Outline> {
        self.outlines[0].filter(|outline| outline.is_recent(time_s, tuning))
    }

    /// Its velocity in the image, pixels per second; zero without an earlier frame.
    fn velocity_px(&self) -> Vector2<f64> {
        let [Some(latest), Some(before), _] = self.outlines else {
            return Vector2::zeros();
        };
        let moved_px = latest.measured.place_px() - before.measured.place_px();
        moved_px / (latest.time_s - before.time_s)
    }

    /// Where the camera would have shown the target at the time of an outline, relative to the projection of that one's position; `None` if that is not known.
    fn seen_at(&self, at: &Outline) -> Option<Seen> {
        let latest = self.outlines[0]?;
        let mut measured = latest.measured;
        let mut moved_px = Vector2::zeros();
        if latest.time_s > at.time_s {
            let before = self.outlines[1].filter(|before| before.time_s <= at.time_s)?;
            let [since_s, from_s] = [latest.time_s, before.time_s].map(|s| at.time_s - s);
            let velocity_px = self.velocity_px();
            moved_px = velocity_px * since_s;
            if let Some(first) = &self.outlines[2] {
                // The interpolation polynomial of Newton.
                let moved_before_px = before.measured.place_px() - first.measured.place_px();
                let earlier_px = moved_before_px / (before.time_s - first.time_s);
                let curvature_px = (velocity_px - earlier_px) / (latest.time_s - first.time_s);
                let curved_px = curvature_px * (since_s * from_s);
                let unknown_px = curved_px * UNKNOWN_MOTION_SHARE;
                moved_px += curved_px;
                measured.covariance_px2 += unknown_px * unknown_px.transpose();
            } else {
                let unknown_m = 0.5 * UNKNOWN_ACCELERATION_MPS2 * since_s * from_s;
                let unknown_px = measured.px_per_m * unknown_m;
                measured.covariance_px2 += unknown_px * unknown_px.transpose();
            }
        }
        let from_m = latest.position_m - at.position_m;
        Some(Seen {
            offset_px: measured.px + moved_px + measured.px_per_m * from_m,
            measured,
        })
    }

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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::tracker::camera_agreement::agreements;
    use pardalis_camera::{Camera, Pinhole, Pose};

    /// The sightings of two cameras that show the target at these times, in seconds.
    fn sightings(seen: &[(&[usize], f64)]) -> [usize; 2] {
        let camera = Camera::Pinhole(Pinhole::new([300.0; 2], [159.5, 119.5], &[]).unwrap());
        let view = View::new(camera, Pose::identity(), (320, 240), None).unwrap();
        let tuning = AgreementTuning::DEFAULT;
        let mut agreement = Agreement::new(&[view.clone(), view], &tuning);
        for (cameras, time_s) in seen {
            agreement.note_sighting(cameras.iter().copied(), *time_s, &tuning);
        }
        let found = agreements(2, agreement.sums().enumerate(), &tuning);
        assert!(found.iter().all(|camera| camera.comparisons == 0));
        [0, 1].map(|camera| found[camera].sightings)
    }

    #[test]
    fn sightings_are_frames_that_could_be_compared() {
        assert_eq!(sightings(&[(&[0, 1], 0.0), (&[0, 1], 1.0)]), [2, 2]);
        // Each between those of the other; the first one has nothing to be interpolated from.
        let alternating: [(&[usize], f64); 4] =
            [(&[0], 0.0), (&[1], 0.1), (&[0], 0.2), (&[1], 0.3)];
        assert_eq!(sightings(&alternating), [1, 1]);
        // One alone, and frames that are too far apart.
        assert_eq!(sightings(&[(&[0], 0.0), (&[0], 0.1), (&[0], 0.2)]), [0, 0]);
        let slow = alternating.map(|(cameras, time_s)| (cameras, 3.0 * time_s));
        assert_eq!(sightings(&slow), [0, 0]);
    }
}
