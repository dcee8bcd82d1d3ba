//! Moving platforms: where the robots, pan-tilt heads and arms that carry cameras are, over time.
//!
//! A [`Platform`] takes poses, from a localisation or the joints of an arm, or increments, from odometry, and answers where it is at the time of a
//! frame, how it moves then, and how certain that is. Between poses it moves at constant rates (along a screw, in SE(3)).

use std::collections::VecDeque;

use nalgebra::{Matrix3, Matrix6, Matrix6x2, Vector2, Vector3, Vector6};
use pardalis_camera::{Pose, RigidMotion};
use pardalis_core::Error;

use crate::frame::check_time;

/// Frames up to this long after the latest pose, or before the first, have one: at the rates of the poses nearby, in seconds. Hand-set.
pub const MAX_EXTRAPOLATION_S: f64 = 0.25;

/// Frames between poses further apart than this have none, in seconds. Hand-set: a robot can turn round in it.
pub const MAX_GAP_S: f64 = 1.0;

/// The standard deviation of what is not known of the motion between poses: of the acceleration along an axis (m/s²) and about it (rad/s²).
/// Hand-set: a robot that starts and stops.
const UNKNOWN_ACCELERATION: [f64; 2] = [2.0, 4.0];

/// The standard deviation of the rates of a platform with a single pose: m/s and rad/s. Hand-set: a slow robot.
const UNKNOWN_RATES: [f64; 2] = [1.0, 1.0];

/// A pose off by more than this from where constant rates lead is a jump: metres and radians ... Hand-set.
const JUMP: [f64; 2] = [0.15, 0.15];
/// ... beyond what these accelerations explain, m/s² and rad/s². Hand-set: twice gravity, and a pan-tilt head.
const GREATEST_ACCELERATION: [f64; 2] = [20.0, 60.0];

/// How many poses are kept. At 1000 poses per second, those of a quarter of a second.
const KEPT: usize = 256;

/// Increments of odometry that end and begin at times this close follow one another, in seconds.
const SAME_TIME_S: f64 = 1e-6;

/// The largest coordinate of a platform, metres.
const MAX_COORDINATE_M: f64 = 1e6;

/// The covariance of a pose: of the position (m²) and of a small rotation about the axes of the world through that position (rad²). Order: x, y, z,
/// rotation about x, y, z; as in the messages of ROS.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PoseCovariance(Matrix6<f64>);

impl PoseCovariance {
    /// A pose known exactly.
    pub fn zero() -> Self {
        Self(Matrix6::zeros())
    }

    /// Independent errors with these standard deviations along and about each axis, in metres and radians.
    ///
    /// Returns an error unless both are from 0 to 1e6.
    pub fn of_sigmas(sigma_m: f64, sigma_rad: f64) -> Result<Self, Error> {
        for (name, sigma) in [("sigma_m", sigma_m), ("sigma_rad", sigma_rad)] {
            if !(0.0..=1e6).contains(&sigma) {
                return Err(Error::out_of_range(name, sigma, "0 to 1e6"));
            }
        }
        Ok(Self(diagonal([sigma_m, sigma_rad])))
    }

    /// The covariance with these rows.
    ///
    /// Returns an error unless the matrix is finite, symmetric and positive semidefinite.
    pub fn from_matrix(rows: [[f64; 6]; 6]) -> Result<Self, Error> {
        let matrix = Matrix6::from_fn(|row, column| rows[row][column]);
        let refuse = |value: &str| {
            let allowed = "a symmetric, positive semidefinite matrix of numbers up to 1e12";
            Err(Error::out_of_range("the covariance", value, allowed))
        };
        if !matrix.iter().all(|v| v.abs() <= 1e12) {
            return refuse("not finite, or too large");
        }
        let scale = matrix.diagonal().amax();
        if (matrix - matrix.transpose()).amax() > 1e-6 * scale {
            return refuse("not symmetric");
        }
        let matrix = 0.5 * (matrix + matrix.transpose());
        if matrix.symmetric_eigenvalues().min() < -1e-6 * scale {
            return refuse("not positive semidefinite");
        }
        Ok(Self(matrix))
    }

    /// Returns the matrix.
    pub fn matrix(&self) -> &Matrix6<f64> {
        &self.0
    }

    /// Returns the covariance, in m², of the position of a point that is fixed on the platform. It is due to errors of the platform's position and, in
    /// proportion to the distance of the point, of its rotation. Positions are in metres in the world frame.
    pub fn of_point_m2(&self, platform_m: &Vector3<f64>, point_m: &Vector3<f64>) -> Matrix3<f64> {
        let turned = -(point_m - platform_m).cross_matrix();
        let of_position = self.0.fixed_view::<3, 3>(0, 0);
        let mixed = self.0.fixed_view::<3, 3>(0, 3) * turned.transpose();
        let of_rotation = turned * self.0.fixed_view::<3, 3>(3, 3) * turned.transpose();
        of_position + mixed + mixed.transpose() + of_rotation
    }
}

/// The covariance of independent errors along and about the axes.
fn diagonal([sigma_m, sigma_rad]: [f64; 2]) -> Matrix6<f64> {
    let [m2, rad2] = [sigma_m * sigma_m, sigma_rad * sigma_rad];
    Matrix6::from_diagonal(&Vector6::new(m2, m2, m2, rad2, rad2, rad2))
}

/// Where a platform is at one time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StampedPose {
    /// In seconds, on the clock of the frames.
    pub time_s: f64,
    /// Takes coordinates on the platform to the world.
    pub world_from_platform: Pose,
    /// How certain it is.
    pub covariance: PoseCovariance,
}

/// How a platform moved between two times, by odometry.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Increment {
    /// The time before, in seconds, on the clock of the frames.
    pub from_s: f64,
    /// The time after, in seconds.
    pub to_s: f64,
    /// The pose after in the platform's frame before.
    pub before_from_after: Pose,
    /// Errors of this increment alone, in the axes of the platform's frame before. Those that all increments share are [`OdometryErrors`].
    pub covariance: PoseCovariance,
}

/// Errors of an odometry beyond those of each increment. Scale and drift are shared by all increments, so that they add up: wheels of another radius,
/// another distance between them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OdometryErrors {
    /// The standard deviation of the scale of distances and turns, 0.02 for 2 %.
    pub scale_sigma: f64,
    /// The standard deviation of a turn about the platform's z axis that the odometry does not measure, radians per metre driven.
    pub drift_sigma_rad_per_m: f64,
    /// The standard deviation of pitch and roll that the odometry does not show, radians: of uneven ground, or when it brakes. They do not add up.
    pub tilt_sigma_rad: f64,
}

impl Default for OdometryErrors {
    /// Those of wheels that were calibrated with a tape measure, on the floor of a building.
    fn default() -> Self {
        Self {
            scale_sigma: 0.02,
            drift_sigma_rad_per_m: 0.5_f64.to_radians(),
            tilt_sigma_rad: 0.3_f64.to_radians(),
        }
    }
}

impl OdometryErrors {
    /// Returns an error unless all are from 0 to 1.
    pub fn check(&self) -> Result<(), Error> {
        for (name, sigma) in [
            ("scale_sigma", self.scale_sigma),
            ("drift_sigma_rad_per_m", self.drift_sigma_rad_per_m),
            ("tilt_sigma_rad", self.tilt_sigma_rad),
        ] {
            if !(0.0..=1.0).contains(&sigma) {
                return Err(Error::out_of_range(name, sigma, "0 to 1"));
            }
        }
        Ok(())
    }
}

/// What became of a pose or an increment.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ObservedMotion {
    /// It was used.
    Used,
    /// It is no later than one before, and was ignored.
    Late,
    /// It is where no motion leads from the poses before. A pose was used: the world has moved, and known targets with it. An increment was ignored:
    /// the platform is taken to move as before.
    Jump,
}

/// What a platform reported so far.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct PlatformCounts {
    /// Poses and increments that were used.
    pub used: usize,
    /// Those that were ignored because they are no later than one before.
    pub late: usize,
    /// Jumps.
    pub jumps: usize,
    /// Times without increments of odometry between one and the next.
    pub gaps: usize,
}

/// Where a platform is at the time of a frame, and how it moves.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlatformState {
    /// Takes coordinates on the platform to the world.
    pub world_from_platform: Pose,
    /// The velocity of its origin in the world, m/s.
    pub velocity_mps: Vector3<f64>,
    /// Its angular velocity about the axes of the world, rad/s.
    pub turn_radps: Vector3<f64>,
    /// How certain the pose is.
    pub covariance: PoseCovariance,
}

/// A known pose.
#[derive(Debug, Clone, Copy)]
struct Known {
    time_s: f64,
    pose: Pose,
    covariance: Matrix6<f64>,
    /// If it is a jump: takes where something was in the world before to where it is now.
    now_from_before: Option<Pose>,
}

/// A moving body that carries cameras.
#[derive(Debug, Clone)]
pub struct Platform {
    odometry: OdometryErrors,
    /// How many poses are kept.
    kept: usize,
    /// In the order of time.
    known: VecDeque<Known>,
    /// What the errors of each increment alone add up to.
    random: Matrix6<f64>,
    /// How the latest pose depends on the errors that all increments share.
    of_shared: Matrix6x2<f64>,
    counts: PlatformCounts,
}

impl Platform {
    /// Creates a platform of which nothing is known yet. `odometry` concerns increments only.
    ///
    /// Returns an error if errors of odometry are out of range.
    pub fn new(odometry: OdometryErrors) -> Result<Self, Error> {
        odometry.check()?;
        Ok(Self {
            odometry,
            kept: KEPT,
            known: VecDeque::with_capacity(KEPT),
            random: Matrix6::zeros(),
            of_shared: Matrix6x2::zeros(),
            counts: PlatformCounts::default(),
        })
    }

    /// Sets how many poses are kept, at least two; 256 by default. Cameras are placed at the time of the latest frames, which need few.
    pub fn with_history(mut self, poses: usize) -> Self {
        self.kept = poses.max(2);
        self.known
            .reserve(self.kept.saturating_sub(self.known.len()));
        self
    }

    /// Returns what it reported so far.
    pub fn counts(&self) -> PlatformCounts {
        self.counts
    }

    /// Returns the time of the latest pose, in seconds.
    pub fn latest_s(&self) -> Option<f64> {
        self.known.back().map(|latest| latest.time_s)
    }

    /// Takes a pose.
    ///
    /// Returns an error if the time is not a number within ±1e12, or a coordinate beyond 1e6 m.
    pub fn observe_pose(&mut self, observed: &StampedPose) -> Result<ObservedMotion, Error> {
        check_time(observed.time_s)?;
        check_pose(&observed.world_from_platform)?;
        if self.is_late(observed.time_s) {
            return Ok(ObservedMotion::Late);
        }
        let now_from_before = self.known.back().and_then(|latest| {
            let dt_s = observed.time_s - latest.time_s;
            let expected = latest.pose * self.rates()?.times(dt_s).pose();
            let is_jump = dt_s <= MAX_GAP_S
                && is_jump(&(expected.inverse() * observed.world_from_platform), dt_s);
            is_jump.then(|| observed.world_from_platform * expected.inverse())
        });
        self.random = observed.covariance.0;
        self.of_shared = Matrix6x2::zeros();
        self.push(&Known {
            time_s: observed.time_s,
            pose: observed.world_from_platform,
            covariance: observed.covariance.0,
            now_from_before,
        });
        Ok(self.noted(now_from_before.is_some()))
    }

    /// Takes an increment of odometry. The first one begins where the latest pose is; without any, the world is the platform's frame then.
    ///
    /// Returns an error if a time is not a number within ±1e12, they are not in order, or the increment is beyond 1e6 m.
    pub fn observe_increment(&mut self, observed: &Increment) -> Result<ObservedMotion, Error> {
        check_time(observed.from_s)?;
        check_time(observed.to_s)?;
        check_pose(&observed.before_from_after)?;
        let dt_s = observed.to_s - observed.from_s;
        if !(dt_s > 0.0) {
            let allowed = format!(
                "a time after {}, where the increment begins",
                observed.from_s
            );
            return Err(Error::out_of_range("to_s", observed.to_s, &allowed));
        }
        if self.known.is_empty() {
            self.push(&Known {
                time_s: observed.from_s,
                pose: Pose::identity(),
                covariance: Matrix6::zeros(),
                now_from_before: None,
            });
        }
        let latest_s = self.latest_s().unwrap_or(observed.from_s);
        if observed.from_s < latest_s - SAME_TIME_S {
            self.counts.late += 1;
            return Ok(ObservedMotion::Late);
        }
        let rates = RigidMotion::to(&observed.before_from_after).times(1.0 / dt_s);
        let expected = self.rates().map(|rates| rates.times(dt_s).pose());
        let jumps =
            |expected: &Pose| is_jump(&(expected.inverse() * observed.before_from_after), dt_s);
        let gap_s = observed.from_s - latest_s;
        if gap_s > SAME_TIME_S {
            self.counts.gaps += 1;
            let unknown = diagonal(UNKNOWN_ACCELERATION.map(|a| 0.5 * a * gap_s * gap_s));
            self.advance(observed.from_s, &rates.times(gap_s).pose(), &unknown);
        }
        let expected = expected.filter(|expected| gap_s <= MAX_GAP_S && jumps(expected));
        match &expected {
            None => {
                let increment = &observed.before_from_after;
                self.advance(observed.to_s, increment, &observed.covariance.0);
            }
            Some(expected) => {
                let unknown = diagonal(JUMP);
                let own = observed.covariance.0 + unknown;
                self.advance(observed.to_s, expected, &own);
            }
        }
        Ok(self.noted(expected.is_some()))
    }

    /// Adds a motion to the latest pose, with the covariance of its own errors in the axes of the platform.
    fn advance(&mut self, to_s: f64, increment: &Pose, own: &Matrix6<f64>) {
        let Some(latest) = self.known.back().copied() else {
            return;
        };
        let rotation = *latest.pose.rotation.matrix();
        let moved_m = rotation * increment.translation.vector;
        // Errors of rotation turn the way that follows.
        let mut kept = Matrix6::identity();
        kept.fixed_view_mut::<3, 3>(0, 3)
            .copy_from(&-moved_m.cross_matrix());
        let mut turned = Matrix6::zeros();
        for at in [0, 3] {
            turned.fixed_view_mut::<3, 3>(at, at).copy_from(&rotation);
        }
        self.random = kept * self.random * kept.transpose() + turned * own * turned.transpose();
        self.of_shared = kept * self.of_shared;
        let turn_rad = rotation * RigidMotion::to(increment).turn_rad;
        let drift_rad = rotation * Vector3::z() * increment.translation.vector.norm();
        let mut added = Matrix6x2::zeros();
        added.fixed_view_mut::<3, 1>(0, 0).copy_from(&moved_m);
        added.fixed_view_mut::<3, 1>(3, 0).copy_from(&turn_rad);
        added.fixed_view_mut::<3, 1>(3, 1).copy_from(&drift_rad);
        // The drift also turns half of the way on which it arises.
        added
            .fixed_view_mut::<3, 1>(0, 1)
            .copy_from(&(0.5 * drift_rad.cross(&moved_m)));
        self.of_shared += added;
        let OdometryErrors {
            scale_sigma,
            drift_sigma_rad_per_m,
            tilt_sigma_rad,
        } = self.odometry;
        let sigmas = Vector2::new(scale_sigma, drift_sigma_rad_per_m);
        let shared = self.of_shared * nalgebra::Matrix2::from_diagonal(&sigmas);
        let mut pose = latest.pose * increment;
        pose.rotation.renormalize();
        let tilts = Vector3::new(1.0, 1.0, 0.0) * tilt_sigma_rad;
        let tilts = pose.rotation.matrix() * Matrix3::from_diagonal(&tilts);
        let mut covariance = self.random + shared * shared.transpose();
        let mut of_rotation = covariance.fixed_view_mut::<3, 3>(3, 3);
        of_rotation += tilts * tilts.transpose();
        self.push(&Known {
            time_s: to_s,
            pose,
            covariance,
            now_from_before: None,
        });
    }

    fn is_late(&mut self, time_s: f64) -> bool {
        let is_late = self.latest_s().is_some_and(|latest_s| time_s <= latest_s);
        self.counts.late += usize::from(is_late);
        is_late
    }

    fn noted(&mut self, is_jump: bool) -> ObservedMotion {
        if is_jump {
            self.counts.jumps += 1;
            return ObservedMotion::Jump;
        }
        self.counts.used += 1;
        ObservedMotion::Used
    }

    fn push(&mut self, known: &Known) {
        if self.known.len() >= self.kept {
            self.known.pop_front();
        }
        self.known.push_back(*known);
    }

    /// The rates between two poses that follow one another, as a motion per second in the frame of the first; `None` if the second is a jump or far
    /// later.
    fn rates_between(before: &Known, after: &Known) -> Option<RigidMotion> {
        let dt_s = after.time_s - before.time_s;
        if after.now_from_before.is_some() || dt_s > MAX_GAP_S {
            return None;
        }
        Some(RigidMotion::to(&(before.pose.inverse() * after.pose)).times(1.0 / dt_s))
    }

    /// The rates between the latest poses of which they are known.
    fn rates(&self) -> Option<RigidMotion> {
        self.rates_before(self.known.len())
    }

    /// The same of those before the pose of this number.
    fn rates_before(&self, number: usize) -> Option<RigidMotion> {
        let known = self.known.range(..number);
        let after = known.clone().skip(1);
        let mut rates = known.zip(after).rev().take(2);
        rates.find_map(|(before, after)| Self::rates_between(before, after))
    }

    /// Returns where it is at a time in seconds; `None` if no pose is near enough ([`MAX_EXTRAPOLATION_S`], [`MAX_GAP_S`]).
    pub fn state_at(&self, time_s: f64) -> Option<PlatformState> {
        let number = self.known.partition_point(|known| known.time_s <= time_s);
        let before = number
            .checked_sub(1)
            .and_then(|before| self.known.get(before));
        let after = self.known.get(number);
        let (from, rates, unknown_s2) = match (before, after) {
            (Some(before), Some(after)) => {
                let [since_s, until_s] = [time_s - before.time_s, after.time_s - time_s];
                if since_s + until_s > MAX_GAP_S {
                    return None;
                }
                match Self::rates_between(before, after) {
                    Some(rates) => (before, Some(rates), since_s * until_s),
                    // Across a jump, the pose nearer in time holds.
                    None if since_s <= until_s => {
                        (before, self.rates_before(number), since_s * since_s)
                    }
                    None => {
                        let rates = self.known.get(number + 1);
                        let rates = rates.and_then(|next| Self::rates_between(after, next));
                        (after, rates, until_s * until_s)
                    }
                }
            }
            (Some(latest), None) => {
                let since_s = time_s - latest.time_s;
                (latest, self.rates(), since_s * since_s)
            }
            (None, Some(first)) => {
                let second = self.known.get(1);
                let rates = second.and_then(|second| Self::rates_between(first, second));
                (first, rates, (time_s - first.time_s).powi(2))
            }
            (None, None) => return None,
        };
        let since_s = time_s - from.time_s;
        if (before.is_none() || after.is_none()) && since_s.abs() > MAX_EXTRAPOLATION_S {
            return None;
        }
        let mut covariance = from.covariance;
        if let (Some(before), Some(after)) = (before, after) {
            let share = (time_s - before.time_s) / (after.time_s - before.time_s);
            covariance = (1.0 - share) * before.covariance + share * after.covariance;
        }
        covariance += diagonal(UNKNOWN_ACCELERATION.map(|a| 0.5 * a * unknown_s2));
        if rates.is_none() {
            covariance += diagonal(UNKNOWN_RATES.map(|rate| rate * since_s));
        }
        let rates = rates.unwrap_or_default();
        let world_from_platform = from.pose * rates.times(since_s).pose();
        // Constant rates are constant in the moving frame.
        let rotation = &world_from_platform.rotation;
        Some(PlatformState {
            velocity_mps: rotation * rates.velocity_m,
            turn_radps: rotation * rates.turn_rad,
            world_from_platform,
            covariance: PoseCovariance(covariance),
        })
    }

    /// Returns what takes places in the world before a time (seconds) to where they are at a later one, if poses jumped in between.
    pub(crate) fn jumped(&self, before_s: f64, now_s: f64) -> Option<Pose> {
        let after = self.known.iter().skip(1);
        let pairs = self.known.iter().zip(after);
        let jumps = pairs.filter_map(|(before, after)| {
            // The nearer pose holds.
            let at_s = 0.5 * (before.time_s + after.time_s);
            let is_between = before_s < at_s && at_s <= now_s;
            after.now_from_before.filter(|_| is_between)
        });
        jumps.reduce(|first, second| second * first)
    }
}

/// Whether what a pose is off from where constant rates lead, after a time in seconds, is more than a platform can do.
fn is_jump(off: &Pose, dt_s: f64) -> bool {
    let motion = RigidMotion::to(off);
    let off = [off.translation.vector.norm(), motion.turn_rad.norm()];
    let accelerations = GREATEST_ACCELERATION.map(|a| 0.5 * a * dt_s * dt_s);
    let least = [0, 1].map(|i| JUMP[i] + accelerations[i]);
    off[0] > least[0] || off[1] > least[1]
}

/// Returns an error for coordinates that are not numbers, or too large.
fn check_pose(pose: &Pose) -> Result<(), Error> {
    let position = pose.translation.vector;
    let is_valid = position.iter().all(|v| v.abs() <= MAX_COORDINATE_M)
        && pose.rotation.matrix().iter().all(|v| v.is_finite());
    if is_valid {
        return Ok(());
    }
    let value = format!("{:?}", position.as_slice());
    let allowed = "coordinates of -1e6 to 1e6 metres and a rotation";
    Err(Error::out_of_range("the pose", value, allowed))
}

#[cfg(test)]
mod tests;
