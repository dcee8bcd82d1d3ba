//! Where cameras were that move: `cameras.csv`.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::Result;
use pardalis_camera::Pose;

use crate::platforms::files::{no_rotation, pose_of};
use crate::tables::Table;
use crate::user_error::user_error;

/// The most poses of a camera on a page. Hand-set: as many as of the page of a run.
const MAX_POSES: usize = 1 << 15;

/// The poses of cameras in the world, by their names and by times in seconds.
pub(crate) type CameraPoses = BTreeMap<String, Vec<(f64, Pose)>>;

/// Reads the poses of cameras that move. Of many, every second, third and so on are left out.
pub(crate) fn read_poses(path: &Path) -> Result<CameraPoses> {
    let mut all = poses_of(&Table::read(path)?)?;
    for poses in all.values_mut() {
        let step = poses.len().div_ceil(MAX_POSES).max(1);
        *poses = poses.iter().copied().step_by(step).collect();
    }
    Ok(all)
}

/// Returns the poses in a table.
pub(crate) fn poses_of(table: &Table) -> Result<CameraPoses> {
    let (time, camera) = (table.column("time_s")?, table.column("camera")?);
    let position = table.columns(["x_m", "y_m", "z_m"])?;
    let rotation = table.columns(["qx", "qy", "qz", "qw"])?;
    let mut all = CameraPoses::new();
    for row in table.rows() {
        let [time_s] = row.numbers([time])?;
        let quaternion = row.numbers(rotation)?;
        let pose = pose_of(row.numbers(position)?, quaternion);
        let pose = pose.ok_or_else(|| no_rotation(&row.place(), quaternion))?;
        let poses = all.entry(row.text(camera)?.to_owned()).or_default();
        if let Some((last_s, _)) = poses.last().filter(|(last_s, _)| *last_s >= time_s) {
            return Err(user_error!(
                "{}: is at {time_s} s, not after the row of this camera before, which is at {last_s} s; the rows must be in order of time",
                row.place()
            ));
        }
        poses.push((time_s, pose));
    }
    Ok(all)
}
