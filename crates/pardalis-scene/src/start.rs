//! Where the targets of a scene start.

use super::reader::{Located, Table};
use super::setting::PerAxis;
use super::target::kind_of;
use pardalis::start::{PixelStart, Start};
use pardalis_camera::{Pose, pose_from_matrix};
use pardalis_filter::gaussian::{GaussianStart, check_sigma, diagonal_m2};

/// Where a target starts, as a scene says it.
#[derive(Debug, Clone, PartialEq)]
pub enum StartConfig {
    /// The scene says it all.
    Here(Start),
    /// A track does, another robot's say, that the caller reads.
    Track(TrackStart),
}

/// A start from a track: its last estimate before the first frames.
#[derive(Debug, Clone, PartialEq)]
pub struct TrackStart {
    /// The tracks.csv.
    pub file: String,
    /// The target's name there.
    pub target: String,
    /// The track's world in this one.
    pub world_from_other: Pose,
    /// Standard deviation of the velocity on each axis, m/s, which tracks do not say.
    pub velocity_sigma_mps: f64,
}

/// Reads the table `start` of a target of this name.
pub(super) fn read_start(
    table: &Table,
    name: &str,
    cameras: &[String],
) -> Option<Located<StartConfig>> {
    let (kind, start) = kind_of(table, "start", &["gaussian", "pixel", "track"])?;
    let read = match kind {
        "gaussian" => read_gaussian(&start),
        "pixel" => read_pixel(&start, cameras),
        _ => read_track(&start, name),
    };
    start.finish();
    read
}

fn read_gaussian(table: &Table) -> Option<Located<StartConfig>> {
    let position_m = table.required("position_m");
    let given = table.optional::<[f64; 6]>("covariance_m2");
    let covariance_m2 = if table.has("covariance_m2") {
        if table.optional::<PerAxis>("position_sigma_m").is_some() {
            let message = "stands beside covariance_m2; keep one of them";
            table.problem("position_sigma_m", message);
        }
        given
    } else {
        let sigma = table.or("position_sigma_m", PerAxis([0.1; 3])).0;
        let checked = table.checked(check_sigma("position_sigma_m", sigma));
        checked.map(|()| diagonal_m2(sigma))
    };
    let velocity_mps = table.or("velocity_mps", [0.0; 3]);
    let velocity_sigma_mps = table.or("velocity_sigma_mps", PerAxis([0.5; 3])).0;
    let start = GaussianStart {
        position_m: position_m?,
        covariance_m2: covariance_m2?,
        velocity_mps,
        velocity_sigma_mps,
    };
    table.checked(start.check())?;
    Some(table.at("position_m", StartConfig::Here(Start::Gaussian(start))))
}

fn read_pixel(table: &Table, cameras: &[String]) -> Option<Located<StartConfig>> {
    let pixel = table.required("pixel");
    let camera: Option<String> = if cameras.len() == 1 {
        Some(table.or("camera", cameras[0].clone()))
    } else {
        table.required("camera")
    };
    let default = PixelStart::at(0, [0.0; 2]);
    let pixel_sigma_px = table.or("pixel_sigma_px", default.pixel_sigma_px);
    let min_range_m = table.or("min_range_m", default.min_range_m);
    let max_range_m = table.or("max_range_m", default.max_range_m);
    let ground_z_m = table.or("ground_z_m", default.ground_z_m);
    let ray_particles = table.or("ray_particles", default.ray_particles);
    let sigma = |key, default| table.or(key, PerAxis(default)).0;
    let position_sigma_m = sigma("position_sigma_m", default.position_sigma_m);
    let velocity_sigma_mps = sigma("velocity_sigma_mps", default.velocity_sigma_mps);
    let camera = camera?;
    let Some(camera_number) = cameras.iter().position(|name| *name == camera) else {
        table.problem(
            "camera",
            format!("is \"{camera}\"; allowed: {}", cameras.join(", ")),
        );
        return None;
    };
    let start = PixelStart {
        camera: camera_number,
        pixel: pixel?,
        pixel_sigma_px,
        min_range_m,
        max_range_m,
        ground_z_m,
        ray_particles,
        position_sigma_m,
        velocity_sigma_mps,
    };
    table.checked(start.check())?;
    Some(table.at("pixel", StartConfig::Here(Start::Pixel(start))))
}

fn read_track(table: &Table, name: &str) -> Option<Located<StartConfig>> {
    let file = table.required("file");
    let target = table.or("target", name.to_owned());
    let rows = table.optional::<[[f64; 4]; 4]>("world_from_other");
    let world_from_other = match rows {
        None if table.has("world_from_other") => None,
        None => Some(Pose::identity()),
        Some(rows) => pose_from_matrix(rows)
            .map_err(|error| table.problem("world_from_other", error.to_string()))
            .ok(),
    };
    let velocity_sigma_mps = table.or("velocity_sigma_mps", 0.5);
    table.checked(check_sigma("velocity_sigma_mps", [velocity_sigma_mps; 3]))?;
    let start = TrackStart {
        file: file?,
        target,
        world_from_other: world_from_other?,
        velocity_sigma_mps,
    };
    Some(table.at("file", StartConfig::Track(start)))
}
