//! truth.csv and the cameras of a sequence.

use std::fmt::Write as _;

use anyhow::Result;
use nalgebra::UnitQuaternion;
use pardalis_camera::Camera;
use pardalis_camera::{CalibratedCamera, Pose};
use pardalis_scene::calibration::{self, CalibrationFormat};
use pardalis_simulate::{Body, Course, Object, Platform, World, WorldCamera, truth as truth_of};
use rayon::prelude::*;
use serde_json::{Value, json};

use super::Sequence;
use crate::folder::Folder;

const HEADER: &str = "frame,time_s,object,camera,x_m,y_m,z_m,vx_mps,vy_mps,vz_mps,xc_m,yc_m,zc_m,u_px,v_px,visible_fraction,heading_rad\n";

/// Returns the text of truth.csv: one row per delivered image and object, in order of true times. `frame` is the
/// index of the image in its camera's folder.
pub(super) fn truth(sequence: &Sequence) -> String {
    let mut images: Vec<(f64, usize, usize)> = Vec::new();
    for (camera, deliveries) in sequence.deliveries.iter().enumerate() {
        let frames = deliveries.iter().enumerate();
        images.extend(frames.map(|(frame, delivery)| (delivery.time_s, camera, frame)));
    }
    images.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
    let rows: Vec<String> = images
        .par_iter()
        .map(|&(time_s, camera, frame)| rows_of(sequence.world(), time_s, camera, frame))
        .collect();
    HEADER.to_owned() + &rows.concat()
}

/// Returns the rows of one image.
fn rows_of(world: &World, time_s: f64, camera: usize, frame: usize) -> String {
    let camera = &world.cameras[camera];
    let mut rows = String::new();
    for (number, seen) in truth_of(world, camera, time_s).into_iter().enumerate() {
        let object = &world.objects[number];
        let _ = write!(rows, "{frame},{time_s},{},{}", object.name, camera.name);
        let placed = &seen.placed;
        let numbers = placed.position_m.iter().chain(placed.velocity_mps.iter());
        for number in numbers.chain(&seen.position_in_camera_m) {
            // Adding zero turns minus zero into zero.
            let _ = write!(rows, ",{}", number + 0.0);
        }
        match seen.pixel {
            Some([u, v]) => {
                let _ = write!(rows, ",{u},{v}");
            }
            None => rows.push_str(",,"),
        }
        let _ = write!(rows, ",{},", seen.visible_fraction);
        if has_heading(world, number) {
            let _ = write!(rows, "{}", placed.heading_rad);
        }
        rows.push('\n');
    }
    rows
}

/// Reports whether the heading is meaningful: for objects that are not balls, and for carriers of other objects.
fn has_heading(world: &World, object: usize) -> bool {
    let carries = |other: &Object| matches!(other.course, Course::Attached { carrier, .. } if carrier == object);
    !matches!(world.objects[object].body, Body::Sphere { .. }) || world.objects.iter().any(carries)
}

/// Returns the name of the file with a platform's true poses.
pub(super) fn poses_of(platform: &Platform) -> String {
    format!("{}.poses.csv", platform.name)
}

/// Returns the name of the file with a platform's odometry.
pub(super) fn odometry_of(platform: &Platform) -> String {
    format!("{}.odometry.csv", platform.name)
}

/// Writes the true poses and the odometry of every platform.
pub(super) fn write_platforms(world: &World, folder: &Folder) -> Result<()> {
    for (platform, number) in world.platforms.iter().zip(0..) {
        let mut odometry = "time_s,dx_m,dy_m,dtheta_rad\n".to_owned();
        let mut poses = "time_s,x_m,y_m,z_m,qx,qy,qz,qw\n".to_owned();
        let rows = platform.odometry(world.seed, number, world.duration_s);
        let times_s = std::iter::once(0.0).chain(rows.iter().map(|row| row.time_s));
        for time_s in times_s {
            let pose = platform.pose(time_s);
            let [x, y, z]: [f64; 3] = pose.translation.vector.into();
            let rotation = UnitQuaternion::from_rotation_matrix(&pose.rotation);
            let [qx, qy, qz, qw]: [f64; 4] = rotation.coords.into();
            let _ = writeln!(poses, "{time_s},{x},{y},{z},{qx},{qy},{qz},{qw}");
        }
        for row in rows {
            let _ = writeln!(
                odometry,
                "{},{},{},{}",
                row.time_s, row.dx_m, row.dy_m, row.dtheta_rad
            );
        }
        folder.write(odometry_of(platform), odometry.as_bytes())?;
        folder.write(poses_of(platform), poses.as_bytes())?;
    }
    Ok(())
}

/// Writes cameras.toml, which the scene uses, and cameras.json in the format of other sequences if it supports the
/// models and no camera moves.
pub(super) fn write_cameras(world: &World, folder: &Folder) -> Result<()> {
    let cameras: Vec<_> = world.cameras.iter().map(calibrated).collect();
    let text = calibration::write(CalibrationFormat::Pardalis, &cameras)?;
    folder.write("cameras.toml", text.as_bytes())?;
    let described: Option<Vec<_>> = world.cameras.iter().map(description).collect();
    if let Some(cameras) = described.filter(|_| world.platforms.is_empty()) {
        let target = world.objects.iter().find(|object| object.is_target);
        let radius_m = match target.map(|target| target.body) {
            Some(Body::Sphere { radius_m }) => Some(radius_m),
            _ => None,
        };
        let document = json!({
            "sequence": { "fps": world.cameras[0].timing.fps, "ball_radius_m": radius_m },
            "cameras": cameras,
        });
        folder.write("cameras.json", format!("{document:#}\n").as_bytes())?;
    }
    Ok(())
}

fn calibrated(camera: &WorldCamera) -> CalibratedCamera {
    CalibratedCamera {
        name: camera.name.clone(),
        camera: camera.camera.clone(),
        size_px: Some(camera.size_px),
        world_from_camera: Some(camera.world_from_camera),
    }
}

/// Returns a camera in the format of sequence folders; `None` if that format lacks the model.
fn description(camera: &WorldCamera) -> Option<Value> {
    let values: Vec<f64> = camera.camera.parameters().iter().map(|p| p.1).collect();
    let mut entry = match &camera.camera {
        Camera::Pinhole(_) => json!({
            "model": "pinhole",
            "fx": values[0],
            "fy": values[1],
            "cx": values[2],
            "cy": values[3],
            "distortion": values[4..],
        }),
        Camera::Equidistant(model) => json!({
            "model": "fisheye_equidistant",
            "f_px_per_rad": values[0],
            "cx": values[1],
            "cy": values[2],
            "fov_deg": 2.0 * model.max_angle_rad().to_degrees(),
        }),
        _ => return None,
    };
    entry["name"] = json!(camera.name);
    entry["width"] = json!(camera.size_px.0);
    entry["height"] = json!(camera.size_px.1);
    entry["T_world_from_camera"] = json!(rows(&camera.world_from_camera));
    Some(entry)
}

fn rows(pose: &Pose) -> Vec<Vec<f64>> {
    let matrix = pose.to_homogeneous();
    matrix
        .row_iter()
        .map(|row| row.iter().map(|v| v + 0.0).collect())
        .collect()
}
