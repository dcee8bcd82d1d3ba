//! The moving platforms of a scene: robots, pan-tilt heads and arms that carry cameras.

use super::camera::Inputs;
use super::reader::{Located, Table};
use nalgebra::{Rotation3, Translation3, Vector3};
use pardalis::frame::MAX_TIME_S;
use pardalis::platform::OdometryErrors;
use pardalis_camera::Pose;

/// One platform of a scene.
#[derive(Debug, Clone, PartialEq)]
pub struct PlatformConfig {
    /// Its name.
    pub name: String,
    /// The file or address that says how it moves.
    pub motion: PlatformMotion,
    /// Added to the times that come from there, in seconds.
    pub time_offset_s: f64,
}

/// The file that says how a platform moves, or the address where another program says it while tracking.
#[derive(Debug, Clone, PartialEq)]
pub enum PlatformMotion {
    /// Its poses in the world.
    Poses(Located<String>),
    /// The increments of its odometry, the errors that they share, and where it was before the first.
    Odometry(Located<String>, OdometryErrors, Pose),
    /// The caller knows, of a scene that was read with [`Inputs::Given`](super::Inputs::Given): the place of the platform's table, and the
    /// errors that increments share.
    Given(Located<String>, OdometryErrors),
}

impl PlatformMotion {
    /// What is wrong with a platform that has none.
    pub const MISSING: &str =
        "says nothing about its motion; give poses = \"FILE.csv\" or odometry = \"FILE.csv\"";

    /// Returns the file or address, with its position in the scene; no name without one.
    pub fn file(&self) -> &Located<String> {
        match self {
            Self::Poses(file) | Self::Odometry(file, ..) | Self::Given(file, _) => file,
        }
    }
}

impl PlatformConfig {
    /// Reads one platform. Returns `None` after reporting a problem to the journal.
    pub(super) fn read(name: String, table: Table, inputs: Inputs) -> Option<Self> {
        let poses = table
            .key(
                "poses",
                "CSV file of its poses in the world, `time_s,x_m,y_m,z_m,qx,qy,qz,qw` or `time_s,x_m,y_m,heading_rad`, perhaps with covariances; or a file in the format of the TUM benchmark; of live cameras: `udp://ADDRESS:PORT`, where another program sends them. Give either this or `odometry`.",
            )
            .depends("unless `odometry` is given")
            .located_conditional::<String>();
        let odometry = table
            .key(
                "odometry",
                "CSV file of its motion from row to row, `time_s,dx_m,dy_m,dtheta_rad`, in its own frame before (x forward, y left). The first row's motion begins at the start. Of live cameras: `udp://ADDRESS:PORT`, where another program sends its poses by odometry.",
            )
            .depends("unless `poses` is given")
            .located_conditional::<String>();
        let time_offset_s = table
            .key(
                "time_offset_s",
                "Added to the times in that file, if its clock is not that of the frames. Of live cameras: how long their fastest image takes from the lens to the program.",
            )
            .within(-MAX_TIME_S..=MAX_TIME_S)
            .or(0.0);
        let default = OdometryErrors::default();
        let scale_sigma = table
            .key(
                "scale_sigma",
                "Standard deviation of the scale of distances and turns in the odometry, 0.02 for 2 %.",
            )
            .within(0.0..=1.0)
            .or(default.scale_sigma);
        let drift_sigma_deg_per_m = table
            .key(
                "drift_sigma_deg_per_m",
                "Standard deviation of the turn that the odometry does not measure, per metre driven.",
            )
            .unit("degrees/m")
            .within(0.0..=57.0)
            .or(DRIFT_SIGMA_DEG_PER_M);
        let tilt_sigma_deg = table
            .key(
                "tilt_sigma_deg",
                "Standard deviation of pitch and roll, which the odometry does not measure: of uneven ground, or when it brakes.",
            )
            .within(0.0..=57.0)
            .or(TILT_SIGMA_DEG);
        let start_position_m = table
            .key(
                "start_position_m",
                "Where it was in the world before the first row of the odometry.",
            )
            .within(-1e6..=1e6)
            .or([0.0; 3]);
        let start_heading_deg: f64 = table
            .key(
                "start_heading_deg",
                "Its heading then, counterclockwise from the x axis.",
            )
            .or(0.0);
        let errors = OdometryErrors {
            scale_sigma,
            drift_sigma_rad_per_m: drift_sigma_deg_per_m.to_radians(),
            tilt_sigma_rad: tilt_sigma_deg.to_radians(),
        };
        let motion = match (poses, odometry) {
            (Some(poses), None) => {
                for key in ODOMETRY_KEYS {
                    if table.has(key) {
                        table.problem(key, "applies to odometry only; remove it");
                    }
                }
                Some(PlatformMotion::Poses(poses))
            }
            (None, Some(odometry)) => Some(PlatformMotion::Odometry(
                odometry,
                errors,
                start_pose(start_position_m, start_heading_deg.to_radians()),
            )),
            (Some(_), Some(_)) => {
                table.conflict("odometry", "poses");
                None
            }
            // A key with a problem has reported it.
            (None, None) if table.has("poses") || table.has("odometry") => None,
            (None, None) if inputs == Inputs::Given => {
                Some(PlatformMotion::Given(table.here(), errors))
            }
            (None, None) => {
                table.problem_here(PlatformMotion::MISSING);
                None
            }
        };
        table.finish();
        Some(Self {
            name,
            motion: motion?,
            time_offset_s,
        })
    }
}

/// The keys that concern odometry alone.
const ODOMETRY_KEYS: [&str; 5] = [
    "scale_sigma",
    "drift_sigma_deg_per_m",
    "tilt_sigma_deg",
    "start_position_m",
    "start_heading_deg",
];

fn start_pose(position_m: [f64; 3], heading_rad: f64) -> Pose {
    let rotation = Rotation3::new(Vector3::z() * heading_rad);
    Pose::from_parts(Translation3::from(position_m), rotation)
}

/// [`OdometryErrors::default`], in degrees.
const DRIFT_SIGMA_DEG_PER_M: f64 = 0.5;
/// The same.
const TILT_SIGMA_DEG: f64 = 0.3;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn default_angles_are_those_of_the_library() {
        let default = OdometryErrors::default();
        let angles = [default.drift_sigma_rad_per_m, default.tilt_sigma_rad];
        let here = [DRIFT_SIGMA_DEG_PER_M, TILT_SIGMA_DEG].map(f64::to_radians);
        assert_eq!(angles, here);
    }
}
