//! Whether the cameras agree, and which error of a camera explains it if they do not.

use nalgebra::{Matrix2, SMatrix, SVector, Vector2};

use crate::tuning::AgreementTuning;
use crate::view::View;

/// How far one camera agrees with the others ([`Tracker::camera_agreement`](super::Tracker::camera_agreement)).
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct CameraAgreement {
    /// The number of frames in which a target's outline was compared with where other cameras put it.
    pub comparisons: usize,
    /// The number of frames in which this camera showed the target where it was tracked, and others did at the same time or just before. Those in which it may not be there, or
    /// is partly hidden, are not compared.
    pub sightings: usize,
    /// By how much the outlines' middles were off, root mean square, in pixels, along the directions in which the cameras can disagree: 0.1 to 0.25 if all are right.
    pub residual_px: f64,
    /// The error of this camera that explains most of what all cameras disagree by; `None` if they agree, or if errors of other cameras explain more.
    pub likely_error: Option<LikelyError>,
}

/// An error of a camera that explains why it disagrees with the others.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LikelyError {
    /// What is wrong.
    pub cause: CameraErrorCause,
    /// By how much the outlines are off because of it, root mean square, in pixels.
    pub explained_px: f64,
    /// Its share of the squares of all that the cameras disagree by, 0 to 1.
    pub explained_share: f64,
}

/// What may be wrong with a camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum CameraErrorCause {
    /// The pose: outlines are off by the same everywhere in the image, or are turned about its principal point.
    Pose {
        /// By how much they are off in the middle of the image, pixels.
        offset_px: [f64; 2],
    },
    /// The focal length: outlines are off in proportion to the distance from the principal point.
    FocalLength {
        /// The right focal length, divided by the given one.
        ratio: f64,
    },
    /// The clock: outlines are off in proportion to their velocity in the image.
    Clock {
        /// Seconds to add to the camera's time stamps.
        correction_s: f64,
        /// Its standard deviation, seconds.
        sigma_s: f64,
    },
}

/// The parameters of a camera's errors: offset along u and v in pixels, angle about the principal point, logarithm of the focal length, and seconds.
const PARAMETERS: usize = 5;
/// Their standard deviations beforehand, which keep those finite that the frames do not determine.
const PRIOR_SIGMAS: [f64; PARAMETERS] = [30.0, 0.2, 0.2, 0.2, 0.5];

/// What an outline is off from where the other cameras put it.
pub(super) struct Innovation {
    pub(super) px: Vector2<f64>,
    pub(super) covariance_px2: Matrix2<f64>,
}

impl Innovation {
    /// Its squared length in standard deviations, of two directions.
    pub(super) fn squared_sigmas(&self) -> f64 {
        let inverse = self.covariance_px2.try_inverse();
        inverse.map_or(0.0, |inverse| self.px.dot(&(inverse * self.px)))
    }
}

/// How many pixels an outline moves with the parameters, at a place relative to the principal point and with a velocity in pixels per second.
fn of_parameters(off_px: &Vector2<f64>, velocity_px: &Vector2<f64>) -> SMatrix<f64, 2, PARAMETERS> {
    let turned_px = Vector2::new(-off_px.y, off_px.x);
    SMatrix::from_columns(&[Vector2::x(), Vector2::y(), turned_px, *off_px, *velocity_px])
}

/// Sums over the innovations of one camera, from which its errors follow by least squares.
#[derive(Debug, Clone, Copy)]
pub(super) struct ComparisonSums {
    principal_px: Vector2<f64>,
    sightings: usize,
    comparisons: usize,
    weight: f64,
    /// The weighted squares of innovations, in units of their covariances: of one pixel per camera.
    squares: f64,
    /// The normal equations of the parameters.
    information: SMatrix<f64, PARAMETERS, PARAMETERS>,
    gradient: SVector<f64, PARAMETERS>,
}

impl ComparisonSums {
    pub(super) fn new(view: &View) -> Self {
        let (width, height) = view.size();
        let middle_px = [width, height].map(|size| 0.5 * (size as f64 - 1.0));
        let principal_px = view.camera().project([0.0, 0.0, 1.0]).unwrap_or(middle_px);
        Self {
            principal_px: principal_px.into(),
            sightings: 0,
            comparisons: 0,
            weight: 0.0,
            squares: 0.0,
            information: SMatrix::zeros(),
            gradient: SVector::zeros(),
        }
    }

    /// Forgets all innovations.
    pub(super) fn reset(&mut self) {
        (self.sightings, self.comparisons) = (0, 0);
        (self.weight, self.squares) = (0.0, 0.0);
        self.information = SMatrix::zeros();
        self.gradient = SVector::zeros();
    }

    /// Counts a frame in which this camera shows the target, and others do or just did.
    pub(super) fn count_sighting(&mut self) {
        self.sightings += 1;
    }

    /// Adds an innovation of an outline at a place in the image that moves with a velocity in pixels per second.
    pub(super) fn add(
        &mut self,
        innovation: &Innovation,
        place_px: &Vector2<f64>,
        velocity_px: &Vector2<f64>,
        weight: f64,
        tuning: &AgreementTuning,
    ) {
        let Some(inverse) = innovation.covariance_px2.try_inverse() else {
            return;
        };
        let of_parameters = of_parameters(&(place_px - self.principal_px), velocity_px);
        let kept = 1.0 - 1.0 / tuning.cause_frames;
        let weighted = weight * of_parameters.transpose() * inverse;
        self.comparisons += 1;
        self.weight = kept * self.weight + weight;
        self.squares = kept * self.squares + weight * innovation.squared_sigmas();
        self.information = kept * self.information + weighted * of_parameters;
        self.gradient = kept * self.gradient + weighted * innovation.px;
    }

    /// By how many pixels the likeliest systematic error moves an outline at a place that moves with a velocity in pixels per second; zero without one.
    pub(super) fn systematic_px(
        &self,
        place_px: &Vector2<f64>,
        velocity_px: &Vector2<f64>,
        tuning: &AgreementTuning,
    ) -> Vector2<f64> {
        let Some((_, parameters)) = self.likely_error(tuning) else {
            return Vector2::zeros();
        };
        of_parameters(&(place_px - self.principal_px), velocity_px) * parameters
    }

    /// Adds those of another target.
    fn merge(&mut self, other: &Self) {
        self.sightings += other.sightings;
        self.comparisons += other.comparisons;
        self.weight += other.weight;
        self.squares += other.squares;
        self.information += other.information;
        self.gradient += other.gradient;
    }

    /// The most likely values of some parameters if all others are 0, and by how much they reduce the squares.
    fn solve<const COUNT: usize>(
        &self,
        parameters: [usize; COUNT],
    ) -> Option<(SVector<f64, COUNT>, f64)> {
        let information = SMatrix::<f64, COUNT, COUNT>::from_fn(|i, j| {
            let prior = if i == j {
                PRIOR_SIGMAS[parameters[i]].powi(-2)
            } else {
                0.0
            };
            self.information[(parameters[i], parameters[j])] + prior
        });
        let gradient = SVector::<f64, COUNT>::from_fn(|i, _| self.gradient[parameters[i]]);
        let values = information.try_inverse()? * gradient;
        Some((values, values.dot(&gradient)))
    }

    /// The same if it is systematic.
    fn likely_error(
        &self,
        tuning: &AgreementTuning,
    ) -> Option<(LikelyError, SVector<f64, PARAMETERS>)> {
        self.best_error().filter(|(error, _)| {
            self.comparisons as f64 >= tuning.min_comparisons
                && error.explained_px >= tuning.systematic_px
                && error.explained_share >= tuning.systematic_share
        })
    }

    /// The error that explains most, of those that need fewest parameters, and the parameters.
    fn best_error(&self) -> Option<(LikelyError, SVector<f64, PARAMETERS>)> {
        let (pose, of_pose) = self.solve([0, 1, 2])?;
        let (focal, of_focal) = self.solve([3])?;
        let (clock, of_clock) = self.solve([4])?;
        let left = (self.squares - of_clock).max(0.0) / self.weight;
        let causes = [
            (
                CameraErrorCause::Pose {
                    offset_px: [pose[0], pose[1]],
                },
                (of_pose, 3.0),
            ),
            (
                CameraErrorCause::FocalLength {
                    ratio: libm::exp(focal[0]),
                },
                (of_focal, 1.0),
            ),
            (
                CameraErrorCause::Clock {
                    correction_s: clock[0],
                    sigma_s: (left / self.information[(4, 4)]).sqrt(),
                },
                (of_clock, 1.0),
            ),
        ];
        // The Bayesian information criterion.
        let score = |(explained, parameters): (f64, f64)| {
            let left = (1.0 - explained / self.squares).max(1e-6);
            -self.weight * libm::log(left) - parameters * libm::log(self.weight)
        };
        let best = causes
            .into_iter()
            .reduce(|a, b| if score(b.1) > score(a.1) { b } else { a })?;
        let (cause, (explained, _)) = best;
        let mut parameters = SVector::<f64, PARAMETERS>::zeros();
        match cause {
            CameraErrorCause::Pose { .. } => parameters.fixed_rows_mut::<3>(0).copy_from(&pose),
            CameraErrorCause::FocalLength { .. } => parameters[3] = focal[0],
            CameraErrorCause::Clock { .. } => parameters[4] = clock[0],
        }
        let error = LikelyError {
            cause,
            explained_px: (explained / self.weight).sqrt(),
            explained_share: explained / self.squares,
        };
        Some((error, parameters))
    }
}

/// Two clocks only differ: if one may be too late, the other may be too early by as much. The camera counts of whose frames the clock explains more.
fn oppose_clocks(agreements: &mut [CameraAgreement]) {
    let errors = agreements.iter().filter_map(|camera| camera.likely_error);
    let best = errors.reduce(|a, b| {
        if b.explained_px > a.explained_px {
            b
        } else {
            a
        }
    });
    let Some(LikelyError {
        cause: CameraErrorCause::Clock {
            correction_s,
            sigma_s,
        },
        ..
    }) = best
    else {
        return;
    };
    let errors = agreements
        .iter_mut()
        .filter_map(|camera| camera.likely_error.as_mut());
    for error in errors.filter(|error| Some(**error) != best) {
        error.cause = CameraErrorCause::Clock {
            correction_s: -correction_s,
            sigma_s,
        };
    }
}

/// How far each camera agrees with the others, given each target's sums over each camera.
pub(super) fn agreements<'s>(
    cameras: usize,
    sums: impl Iterator<Item = (usize, &'s ComparisonSums)>,
    tuning: &AgreementTuning,
) -> Vec<CameraAgreement> {
    let mut merged: Vec<Option<ComparisonSums>> = vec![None; cameras];
    for (camera, sums) in sums {
        match &mut merged[camera] {
            Some(known) => known.merge(sums),
            unknown => *unknown = Some(*sums),
        }
    }
    let compared = merged
        .iter()
        .filter(|sums| sums.is_some_and(|sums| sums.weight > 0.0));
    // Of two cameras either may be wrong.
    let is_pair = compared.count() == 2;
    let errors = merged.iter().flatten().map(|sums| {
        let (error, _) = sums.likely_error(tuning)?;
        Some(error.explained_px.powi(2) * sums.weight)
    });
    let most = errors.flatten().fold(0.0, f64::max);
    let agreement = |sums: &Option<ComparisonSums>| {
        let Some(sums) = sums.filter(|sums| sums.weight > 0.0) else {
            return CameraAgreement {
                sightings: sums.map_or(0, |sums| sums.sightings),
                ..CameraAgreement::default()
            };
        };
        let error = sums.best_error();
        let is_likely = |error: &LikelyError| {
            let explained = error.explained_px.powi(2) * sums.weight;
            most > 0.0 && (is_pair || explained >= tuning.ambiguous_share * most)
        };
        CameraAgreement {
            comparisons: sums.comparisons,
            sightings: sums.sightings,
            residual_px: (sums.squares / sums.weight).sqrt(),
            likely_error: error.map(|(error, _)| error).filter(is_likely),
        }
    };
    let mut agreements: Vec<_> = merged.iter().map(agreement).collect();
    if is_pair {
        oppose_clocks(&mut agreements);
    }
    agreements
}

#[cfg(test)]
mod tests {
    use super::*;
    use pardalis_camera::{Camera, Pinhole, Pose};

    /// The likely error of a camera whose outlines are off by this, given their place relative to the principal point and their velocity.
    fn likely_error(
        off_px: impl Fn(Vector2<f64>, Vector2<f64>) -> Vector2<f64>,
    ) -> Option<LikelyError> {
        let camera = Camera::Pinhole(Pinhole::new([300.0; 2], [159.5, 119.5], &[]).unwrap());
        let view = View::new(camera, Pose::identity(), (320, 240), None).unwrap();
        let tuning = AgreementTuning::DEFAULT;
        let mut sums = ComparisonSums::new(&view);
        for frame in 0..100 {
            let turn = 0.06 * f64::from(frame);
            let place_px = Vector2::new(90.0 * turn.sin(), 60.0 * (2.3 * turn).sin());
            let velocity_px = 1.5 * Vector2::new(90.0 * turn.cos(), 138.0 * (2.3 * turn).cos());
            let noise_px = 0.1 * Vector2::new((31.0 * turn).sin(), (17.0 * turn).cos());
            let innovation = Innovation {
                px: off_px(place_px, velocity_px) + noise_px,
                // The others say nothing along one direction.
                covariance_px2: Matrix2::new(642.0, 480.0, 480.0, 362.0),
            };
            let place_px = place_px + Vector2::new(159.5, 119.5);
            sums.add(&innovation, &place_px, &velocity_px, 1.0, &tuning);
        }
        let agreement = agreements(1, [(0, &sums)].into_iter(), &tuning);
        assert_eq!(agreement[0].comparisons, 100);
        agreement[0].likely_error
    }

    #[test]
    fn causes_are_told_apart() {
        assert_eq!(likely_error(|_, _| Vector2::zeros()), None);
        let error = likely_error(|_, _| Vector2::new(1.0, -2.0)).unwrap();
        let CameraErrorCause::Pose { .. } = error.cause else {
            panic!("{error:?}");
        };
        let error = likely_error(|place_px, _| 0.02 * place_px).unwrap();
        let CameraErrorCause::FocalLength { ratio } = error.cause else {
            panic!("{error:?}");
        };
        assert!((ratio - 1.02).abs() < 0.003, "{error:?}");
        let error = likely_error(|_, velocity_px| -0.04 * velocity_px).unwrap();
        let CameraErrorCause::Clock {
            correction_s,
            sigma_s,
        } = error.cause
        else {
            panic!("{error:?}");
        };
        assert!((correction_s + 0.04).abs() < 0.002, "{error:?}");
        assert!(sigma_s < 0.005 && error.explained_share > 0.9, "{error:?}");
    }
}
