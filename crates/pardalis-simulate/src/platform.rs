//! Moving platforms that carry cameras, and what their odometry says.

use std::f64::consts::TAU;

use nalgebra::{Rotation3, Translation3};

use super::{Path, Sine};
use pardalis_camera::Pose;
use pardalis_core::rng::{Draws, Stage};

/// A moving platform: a robot, a pan-tilt head, an arm.
#[derive(Debug, Clone, PartialEq)]
pub struct Platform {
    /// Name.
    pub name: String,
    /// Path of its origin.
    pub path: Path,
    /// Constant heading in radians; if `None`, the platform faces its direction of motion.
    pub heading_rad: Option<f64>,
    /// What is added to the heading, and what its pitch (nose down) and roll (right side down) are: sums of sines with amplitudes in radians.
    pub sway: [Vec<Sine>; 3],
    /// Its odometry.
    pub odometry: OdometrySettings,
}

/// The odometry of a platform: increments in the plane, with errors.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OdometrySettings {
    /// Increments per second.
    pub rate_hz: f64,
    /// Share by which distances and turns are too large.
    pub scale_error: f64,
    /// Standard deviation of an additional random share, which is constant for the platform.
    pub scale_error_sigma: f64,
    /// Turn to the left that is added per metre driven, radians.
    pub drift_rad_per_m: f64,
    /// Standard deviation of an additional random drift, which is constant for the platform, radians per metre.
    pub drift_sigma_rad_per_m: f64,
    /// Standard deviation of each increment's own error along x and y, metres.
    pub noise_m: f64,
    /// Standard deviation of each increment's own error of the turn, radians.
    pub noise_rad: f64,
}

impl Default for OdometrySettings {
    /// Returns 50 exact increments per second.
    fn default() -> Self {
        Self {
            rate_hz: 50.0,
            scale_error: 0.0,
            scale_error_sigma: 0.0,
            drift_rad_per_m: 0.0,
            drift_sigma_rad_per_m: 0.0,
            noise_m: 0.0,
            noise_rad: 0.0,
        }
    }
}

/// One increment of odometry: the motion since the one before, in the platform's frame before.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OdometryRow {
    /// Its time in seconds.
    pub time_s: f64,
    /// Forward, metres.
    pub dx_m: f64,
    /// To the left, metres.
    pub dy_m: f64,
    /// Turn to the left, radians.
    pub dtheta_rad: f64,
}

impl Platform {
    /// Returns the pose at a time in seconds: `world_from_platform`, with x ahead, y to the left and z up.
    pub fn pose(&self, time_s: f64) -> Pose {
        let [yaw, pitch, roll] = [0, 1, 2].map(|axis| {
            let sines = self.sway[axis].iter();
            let of_sine = |sine: &Sine| {
                sine.amplitude_m * libm::sin(TAU / sine.period_s * time_s + sine.phase_rad)
            };
            sines.map(of_sine).sum::<f64>()
        });
        let heading = self
            .heading_rad
            .unwrap_or_else(|| self.path.course_rad(time_s));
        let position = self.path.at(time_s).0;
        Pose::from_parts(
            Translation3::from(position),
            Rotation3::from_euler_angles(roll, pitch, heading + yaw),
        )
    }

    /// Returns its odometry from time 0 to `duration_s`, in seconds. `number` is the platform's index in the world.
    pub fn odometry(&self, seed: u32, number: u32, duration_s: f64) -> Vec<OdometryRow> {
        let settings = &self.odometry;
        // Cameras use the numbers from 0.
        let draws = Draws::new(seed, u32::MAX - number);
        let normals = |step: u32| draws.normals(step, 0, Stage::Clock, 0).map(f64::from);
        let [of_scale, of_drift, ..] = normals(u32::MAX);
        let scale = 1.0 + settings.scale_error + settings.scale_error_sigma * of_scale;
        let drift_rad_per_m = settings.drift_rad_per_m + settings.drift_sigma_rad_per_m * of_drift;
        let count = (duration_s * settings.rate_hz).ceil() as u32;
        let row = |step: u32| {
            let [before_s, time_s] =
                [step - 1, step].map(|step| f64::from(step) / settings.rate_hz);
            let moved = self.pose(before_s).inverse() * self.pose(time_s);
            let (_, _, turn_rad) = moved.rotation.euler_angles();
            let [x_m, y_m] = [moved.translation.x, moved.translation.y];
            let [nx, ny, nt, _] = normals(step);
            let drift_rad = drift_rad_per_m * libm::hypot(x_m, y_m);
            OdometryRow {
                time_s,
                dx_m: scale * x_m + settings.noise_m * nx,
                dy_m: scale * y_m + settings.noise_m * ny,
                dtheta_rad: scale * turn_rad + drift_rad + settings.noise_rad * nt,
            }
        };
        (1..=count).map(row).collect()
    }
}
