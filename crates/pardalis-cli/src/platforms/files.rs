//! Files of poses and of odometry.

use std::path::Path;

use anyhow::Result;
use nalgebra::{Quaternion, Translation3, UnitQuaternion, Vector3};
use pardalis::camera::{Pose, RigidMotion};
use pardalis::platform::{Increment, PoseCovariance, StampedPose};

use super::Motion;
use crate::output::Shown;
use crate::tables::{Column, Row, Table};
use crate::user_error::user_error;

/// A quaternion whose length differs from 1 by more than this is no rotation.
const MAX_LENGTH_ERROR: f64 = 1e-2;

/// Maximum size of a file in bytes: hours of poses at a thousand a second.
const MAX_BYTES: u64 = 1 << 30;

/// Rows further apart than this many typical intervals have others missing between them.
const MISSING_INTERVALS: f64 = 1.5;

/// The columns of files of poses.
const POSE_COLUMNS: &str = "time_s,x_m,y_m,z_m,qx,qy,qz,qw or time_s,x_m,y_m,heading_rad";

/// The names of the axes in the names of covariances.
const AXES: [&str; 6] = ["x", "y", "z", "rx", "ry", "rz"];

/// The columns of errors: standard deviations along and about all axes, or a covariance.
enum ErrorColumns<'n> {
    None,
    Sigmas([Column<'n>; 2]),
    Covariance(Vec<Column<'n>>),
}

/// The names of the columns of a covariance: the upper triangle, row by row.
pub(super) fn covariance_names() -> Vec<String> {
    let pairs = (0..6).flat_map(|row| (row..6).map(move |column| (row, column)));
    pairs
        .map(|(row, column)| format!("cov_{}_{}", AXES[row], AXES[column]))
        .collect()
}

/// Returns the covariance with this upper triangle, row by row.
pub(super) fn covariance_of(upper: &[f64]) -> Result<PoseCovariance, pardalis_core::Error> {
    let mut rows = [[0.0; 6]; 6];
    let pairs = (0..6).flat_map(|row| (row..6).map(move |column| (row, column)));
    for ((row, column), number) in pairs.zip(upper) {
        rows[row][column] = *number;
        rows[column][row] = *number;
    }
    PoseCovariance::from_matrix(rows)
}

impl<'n> ErrorColumns<'n> {
    /// Finds the columns. Errors: some of them are missing.
    fn of(table: &Table, names: &'n [String]) -> Result<Self> {
        let sigmas = ["sigma_m", "sigma_rad"];
        let is_error = |column: &&str| column.starts_with("sigma") || column.starts_with("cov");
        let is_known = |column: &&str| sigmas.contains(column) || names.iter().any(|n| n == column);
        let mut columns = table.header().filter(is_error);
        if let Some(unknown) = columns.find(|column| !is_known(column)) {
            return Err(user_error!(
                "{}, line 1: column \"{unknown}\" is unknown; allowed: sigma_m and sigma_rad, or {} to {}, the upper triangle",
                table.path().shown(),
                names[0],
                names[names.len() - 1]
            ));
        }
        if sigmas
            .iter()
            .any(|name| table.optional_column(name).is_some())
        {
            return Ok(Self::Sigmas(table.columns(sigmas)?));
        }
        if names
            .iter()
            .all(|name| table.optional_column(name).is_none())
        {
            return Ok(Self::None);
        }
        let columns = names.iter().map(|name| table.column(name));
        Ok(Self::Covariance(columns.collect::<Result<_>>()?))
    }

    fn read(&self, row: &Row) -> Result<PoseCovariance> {
        let read = match self {
            Self::None => Ok(PoseCovariance::zero()),
            Self::Sigmas(columns) => {
                let [sigma_m, sigma_rad] = row.numbers(*columns)?;
                PoseCovariance::of_sigmas(sigma_m, sigma_rad)
            }
            Self::Covariance(columns) => {
                let mut numbers = Vec::with_capacity(columns.len());
                for column in columns {
                    let [number] = row.numbers([*column])?;
                    numbers.push(number);
                }
                covariance_of(&numbers)
            }
        };
        read.map_err(|error| user_error!("{}: {error}", row.place()))
    }
}

/// Returns the rotation by a heading as a quaternion, w last.
pub(super) fn quaternion_of(heading_rad: f64) -> [f64; 4] {
    let (sin, cos) = libm::sincos(0.5 * heading_rad);
    [0.0, 0.0, sin, cos]
}

/// Returns the pose at a position with a rotation; `None` unless the quaternion has length 1.
pub(crate) fn pose_of(position_m: [f64; 3], [x, y, z, w]: [f64; 4]) -> Option<Pose> {
    let quaternion = Quaternion::new(w, x, y, z);
    if !((quaternion.norm() - 1.0).abs() <= MAX_LENGTH_ERROR) {
        return None;
    }
    let rotation = UnitQuaternion::from_quaternion(quaternion).to_rotation_matrix();
    Some(Pose::from_parts(Translation3::from(position_m), rotation))
}

/// The error of a quaternion that is no rotation.
pub(crate) fn no_rotation(place: &str, quaternion: [f64; 4]) -> anyhow::Error {
    user_error!(
        "{place}: the quaternion {quaternion:?} does not have length 1; allowed: qx, qy, qz, qw of a rotation, with w last"
    )
}

/// Reads a file of up to [`MAX_BYTES`].
fn read_text(path: &Path) -> Result<String> {
    let name = path.shown();
    let unreadable = |error: std::io::Error| user_error!("{name}: {error}; give a CSV file");
    let metadata = std::fs::metadata(path).map_err(unreadable)?;
    if !metadata.is_file() {
        return Err(user_error!(
            "{name}: is a folder or a device; give a CSV file"
        ));
    }
    if metadata.len() > MAX_BYTES {
        return Err(user_error!(
            "{name}: has {} bytes; allowed: at most {MAX_BYTES}; keep the rows of the recording",
            metadata.len()
        ));
    }
    text_of(path, std::fs::read(path).map_err(unreadable)?)
}

/// Returns the text of a file with these bytes.
fn text_of(path: &Path, bytes: Vec<u8>) -> Result<String> {
    String::from_utf8(bytes).map_err(|error| {
        let before = &error.as_bytes()[..error.utf8_error().valid_up_to()];
        let line = before.split(|byte| *byte == b'\n').count();
        user_error!(
            "{}, line {line}: is not UTF-8 text; save the file as UTF-8",
            path.shown()
        )
    })
}

/// Reads a file of poses: a table, or the format of the TUM benchmark. Returns the poses with their lines.
pub(super) fn read_poses(path: &Path, offset_s: f64) -> Result<Vec<(Motion, u64)>> {
    poses_in(path, &read_text(path)?, offset_s)
}

/// Returns the poses in the text of a file, like [`read_poses`].
fn poses_in(path: &Path, text: &str, offset_s: f64) -> Result<Vec<(Motion, u64)>> {
    if is_tum(text) {
        return read_tum(path, text, offset_s);
    }
    let table = Table::from_reader(path, text.as_bytes())?;
    let found = || table.header().collect::<Vec<_>>().join(",");
    if table.optional_column("time_s").is_none() || table.optional_column("x_m").is_none() {
        return Err(user_error!(
            "{}, line 1: needed are the columns {POSE_COLUMNS}, or numbers without a header in the format of the TUM benchmark; found: {}",
            path.shown(),
            found()
        ));
    }
    let time = table.column("time_s")?;
    let heading = table.optional_column("heading_rad");
    let quaternion = match heading {
        Some(_) if table.optional_column("qw").is_some() => {
            return Err(user_error!(
                "{}, line 1: has heading_rad and quaternions, which may differ; keep one of them",
                path.shown()
            ));
        }
        Some(_) => None,
        None => Some(table.columns(["qx", "qy", "qz", "qw"]).map_err(|_| {
            user_error!(
                "{}, line 1: has neither the columns qx,qy,qz,qw nor heading_rad; needed: {POSE_COLUMNS}; found: {}",
                path.shown(),
                found()
            )
        })?),
    };
    let [x, y] = table.columns(["x_m", "y_m"])?;
    let z = match heading {
        Some(_) => table.optional_column("z_m"),
        None => Some(table.column("z_m")?),
    };
    let names = covariance_names();
    let errors = ErrorColumns::of(&table, &names)?;
    let mut poses = Vec::new();
    for row in table.rows() {
        let [time_s, x_m, y_m] = row.numbers([time, x, y])?;
        let z_m = row.all_or_none(z.map(|z| [z]))?.map_or(0.0, |[z_m]| z_m);
        let rotation = match (heading, quaternion) {
            (Some(heading), _) => {
                let [heading_rad] = row.numbers([heading])?;
                quaternion_of(heading_rad)
            }
            (None, Some(columns)) => row.numbers(columns)?,
            (None, None) => [0.0, 0.0, 0.0, 1.0],
        };
        let pose = pose_of([x_m, y_m, z_m], rotation);
        let stamped = StampedPose {
            time_s: time_s + offset_s,
            world_from_platform: pose.ok_or_else(|| no_rotation(&row.place(), rotation))?,
            covariance: errors.read(&row)?,
        };
        poses.push((Motion::Pose(stamped), row.line));
    }
    Ok(poses)
}

/// Returns the lines of a file in the format of the TUM benchmark that are not comments, with their numbers.
fn tum_lines(text: &str) -> impl Iterator<Item = (u64, &str)> {
    let lines = (1..).zip(text.lines().map(str::trim));
    lines.filter(|(_, line)| !line.is_empty() && !line.starts_with('#'))
}

/// Reports whether a text is in the format of the TUM benchmark: no header, and numbers between spaces.
fn is_tum(text: &str) -> bool {
    let first = tum_lines(text).next();
    first.is_some_and(|(_, line)| {
        let mut words = line.split_whitespace();
        words.clone().count() > 1 && words.all(|word| word.parse::<f64>().is_ok())
    })
}

/// Reads poses in the format of the TUM benchmark: `time x y z qx qy qz qw`, between spaces.
fn read_tum(path: &Path, text: &str, offset_s: f64) -> Result<Vec<(Motion, u64)>> {
    let mut poses = Vec::new();
    for (line, words) in tum_lines(text) {
        let place = || format!("{}, line {line}", path.shown());
        let numbers = words.split_whitespace().map(|word| {
            let number = word.parse().ok().filter(|number: &f64| number.is_finite());
            number.ok_or_else(|| user_error!("{}: \"{word}\" is not a finite number", place()))
        });
        let numbers = numbers.collect::<Result<Vec<f64>>>()?;
        let [time_s, x, y, z, qx, qy, qz, qw] = numbers[..] else {
            return Err(user_error!(
                "{}: has {} numbers; needed: time x y z qx qy qz qw",
                place(),
                numbers.len()
            ));
        };
        let rotation = [qx, qy, qz, qw];
        let pose = pose_of([x, y, z], rotation);
        let stamped = StampedPose {
            time_s: time_s + offset_s,
            world_from_platform: pose.ok_or_else(|| no_rotation(&place(), rotation))?,
            covariance: PoseCovariance::zero(),
        };
        poses.push((Motion::Pose(stamped), line));
    }
    Ok(poses)
}

/// Reads a file of odometry. Returns the pose at its start and the increments, with their lines.
///
/// An increment begins at `from_time_s`, if there is this column, or else at the time of the row before, unless rows are missing there.
pub(super) fn read_odometry(
    path: &Path,
    offset_s: f64,
    start: &Pose,
) -> Result<Vec<(Motion, u64)>> {
    let text = read_text(path)?;
    let table = Table::from_reader(path, text.as_bytes())?;
    odometry_in(path, &table, offset_s, start)
}

/// Returns the start and the increments in a table, like [`read_odometry`].
fn odometry_in(
    path: &Path,
    table: &Table,
    offset_s: f64,
    start: &Pose,
) -> Result<Vec<(Motion, u64)>> {
    let time = table.column("time_s")?;
    let from = table.optional_column("from_time_s");
    let motion = table.columns(["dx_m", "dy_m", "dtheta_rad"])?;
    let names = covariance_names();
    let errors = ErrorColumns::of(table, &names)?;
    let mut times_s = Vec::new();
    for row in table.rows() {
        let [time_s] = row.numbers([time])?;
        times_s.push(time_s);
    }
    let interval_s = typical_interval_s(&times_s);
    if interval_s.is_none() && from.is_none() {
        return Err(user_error!(
            "{}: has one row, and its increment may begin at any time; give more rows, or the column from_time_s",
            path.shown()
        ));
    }
    let interval_s = interval_s.unwrap_or(0.0);
    let mut motions: Vec<(Motion, u64)> = Vec::new();
    let mut latest_s = f64::NEG_INFINITY;
    for (row, time_s) in table.rows().zip(times_s) {
        let from_s = match from {
            Some(from) => {
                let [from_s] = row.numbers([from])?;
                if from_s >= time_s {
                    return Err(user_error!(
                        "{}: from_time_s is {from_s}, and time_s is {time_s}; allowed: a time before time_s",
                        row.place()
                    ));
                }
                from_s
            }
            None if time_s > latest_s && time_s - latest_s <= MISSING_INTERVALS * interval_s => {
                latest_s
            }
            None => time_s - interval_s,
        };
        latest_s = latest_s.max(time_s);
        let [dx_m, dy_m, dtheta_rad] = row.numbers(motion)?;
        let turn = RigidMotion {
            velocity_m: Vector3::zeros(),
            turn_rad: Vector3::new(0.0, 0.0, dtheta_rad),
        };
        let moved = Translation3::new(dx_m, dy_m, 0.0);
        let increment = Increment {
            from_s: from_s + offset_s,
            to_s: time_s + offset_s,
            before_from_after: Pose::from_parts(moved, turn.pose().rotation),
            covariance: errors.read(&row)?,
        };
        if motions.is_empty() {
            let pose = StampedPose {
                time_s: increment.from_s,
                world_from_platform: *start,
                covariance: PoseCovariance::zero(),
            };
            motions.push((Motion::Pose(pose), row.line));
        }
        motions.push((Motion::Increment(increment), row.line));
    }
    Ok(motions)
}

/// Reads any bytes as a file of poses or of odometry.
#[cfg(any(test, feature = "fuzz"))]
pub(super) fn rows_in(bytes: &[u8], path: &Path, is_odometry: bool) -> Result<Vec<(Motion, u64)>> {
    let text = text_of(path, bytes.to_vec())?;
    if is_odometry {
        let table = Table::from_reader(path, text.as_bytes())?;
        odometry_in(path, &table, 0.0, &Pose::identity())
    } else {
        poses_in(path, &text, 0.0)
    }
}

/// Returns the median of the positive differences between times that follow one another; `None` without any.
pub(super) fn typical_interval_s(times_s: &[f64]) -> Option<f64> {
    let mut steps_s: Vec<f64> = times_s.windows(2).map(|pair| pair[1] - pair[0]).collect();
    steps_s.retain(|step_s| *step_s > 0.0);
    steps_s.sort_by(f64::total_cmp);
    steps_s.get(steps_s.len() / 2).copied()
}
