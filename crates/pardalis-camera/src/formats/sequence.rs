//! `camera.json` and `cameras.json` of sequence folders, as described in `data/README.md`.

use super::document::Entry;
use super::intrinsics::{sanitized_name, size_px};
use crate::pose::{CalibratedCamera, Pose, pose_from_matrix};
use crate::{Camera, Equidistant, ExactMirror, MirrorProfile, Pinhole};
use pardalis_core::Error;

/// A key that no other format uses.
const POSE: &str = "T_world_from_camera";

/// The pose of a camera that moves with a robot, on that robot.
const POSE_ON_ROBOT: &str = "T_robot_from_camera";

/// Reports whether the document is a camera with a pose, or a list of cameras.
pub(super) fn recognizes(root: &Entry) -> bool {
    root.get(POSE).is_some()
        || root
            .get("cameras")
            .is_some_and(|cameras| cameras.items().is_ok())
}

/// Reads the cameras of a document.
pub(super) fn read(root: &Entry) -> Result<Vec<CalibratedCamera>, Error> {
    match root.get("cameras") {
        Some(cameras) => read_several(&cameras.items()?),
        None => Ok(vec![read_one(root)?]),
    }
}

/// Reads a list of cameras, whose names must be unique.
fn read_several(entries: &[Entry]) -> Result<Vec<CalibratedCamera>, Error> {
    let mut cameras: Vec<CalibratedCamera> = Vec::new();
    for (number, entry) in entries.iter().enumerate() {
        let camera = read_one(entry)?;
        if let Some(first) = cameras.iter().position(|other| other.name == camera.name) {
            let message = format!(
                "has the name {}, like camera {} of the list (this is camera {}); give each camera its own name",
                camera.name,
                first + 1,
                number + 1
            );
            return Err(entry.error(message));
        }
        cameras.push(camera);
    }
    Ok(cameras)
}

fn read_one(entry: &Entry) -> Result<CalibratedCamera, Error> {
    let size_px = size_px(&entry.required("width")?, &entry.required("height")?)?;
    let name = entry.get("name").map(|name| name.text()).transpose()?;
    Ok(CalibratedCamera {
        name: sanitized_name(&name.unwrap_or_default(), "camera"),
        camera: read_model(entry)?,
        size_px: Some(size_px),
        world_from_camera: read_pose(entry)?,
    })
}

/// Reads the transform from the camera to the world, in metres. A moving camera has a text there, and
/// its pose on the robot instead.
fn read_pose(entry: &Entry) -> Result<Option<Pose>, Error> {
    let Some(matrix) = entry.get(POSE) else {
        return Ok(None);
    };
    let on_robot = entry.get(POSE_ON_ROBOT);
    let matrix = match on_robot {
        Some(on_robot) if matrix.items().is_err() => on_robot,
        None if matrix.items().is_err() => {
            let allowed = format!("a 4 x 4 matrix, or {POSE_ON_ROBOT} for a moving camera");
            return Err(matrix.invalid(&allowed));
        }
        _ => matrix,
    };
    let rows = matrix.matrix()?.rows::<4, 4>()?;
    matrix.checked(pose_from_matrix(rows)).map(Some)
}

fn read_model(entry: &Entry) -> Result<Camera, Error> {
    let model = entry.required("model")?;
    match model.text()?.as_str() {
        "fisheye_equidistant" => {
            let f_px_per_rad = entry.required("f_px_per_rad")?.number()?;
            let fov_deg = match entry.get("fov_deg") {
                Some(angle) => angle.number()?,
                None => 360.0,
            };
            let max_angle_rad = (fov_deg / 2.0).to_radians();
            let camera = Equidistant::new(f_px_per_rad, center_px(entry)?, max_angle_rad);
            model.checked(camera).map(Camera::Equidistant)
        }
        "pinhole" => {
            let mut distortion = match entry.get("distortion") {
                Some(distortion) => distortion.numbers()?,
                None => Vec::new(),
            };
            // Files may contain only the first of k1, k2, p1, p2, k3; the others are zero.
            distortion.resize(distortion.len().max(5), 0.0);
            let camera = Pinhole::new(focals_px(entry)?, center_px(entry)?, &distortion);
            model.checked(camera).map(Camera::Pinhole)
        }
        "catadioptric_constant_floor_resolution" => {
            let before = entry.required("perspective_camera")?;
            if let Some(distortion) = before.get("distortion")
                && distortion.numbers()?.iter().any(|&k| k != 0.0)
            {
                return Err(
                    distortion.error("is not zero; allowed: no distortion in front of a mirror")
                );
            }
            let profile = read_profile(&entry.required("mirror_profile")?)?;
            let camera = ExactMirror::new(focals_px(&before)?, center_px(&before)?, profile);
            model.checked(camera).map(Camera::ExactMirror)
        }
        _ => {
            Err(model
                .invalid("fisheye_equidistant, pinhole, catadioptric_constant_floor_resolution"))
        }
    }
}

fn pair(entry: &Entry, keys: [&str; 2]) -> Result<[f64; 2], Error> {
    let [a, b] = keys.map(|key| entry.required(key)?.number());
    Ok([a?, b?])
}

fn focals_px(entry: &Entry) -> Result<[f64; 2], Error> {
    pair(entry, ["fx", "fy"])
}

fn center_px(entry: &Entry) -> Result<[f64; 2], Error> {
    pair(entry, ["cx", "cy"])
}

/// Reads the columns t, F and F' of a mirror, in metres.
fn read_profile(entry: &Entry) -> Result<MirrorProfile, Error> {
    let [t, f, slope] = ["t_m", "F_m", "dF"].map(|key| entry.required(key)?.numbers());
    let (t, f, slope) = (t?, f?, slope?);
    if f.len() != t.len() || slope.len() != t.len() {
        return Err(entry.error(format!(
            "has {} t_m, {} F_m and {} dF; allowed: columns of equal length",
            t.len(),
            f.len(),
            slope.len()
        )));
    }
    let rows: Vec<_> = (0..t.len()).map(|i| [t[i], f[i], slope[i]]).collect();
    entry.checked(MirrorProfile::from_rows_with_slopes(&rows))
}
