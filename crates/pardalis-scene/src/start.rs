//! The starts of a scene's targets.

use super::description::{Presence, above};
use super::reader::{Kind, Located, Table};
use super::setting::PerAxis;
use pardalis::start::{PixelStart, Start};
use pardalis_camera::{Pose, pose_from_matrix};
use pardalis_filter::gaussian::{GaussianStart, MAX_START, diagonal_m2};

/// The start of a target, as described by a scene.
#[derive(Debug, Clone, PartialEq)]
pub enum StartConfig {
    /// The scene describes it completely.
    Here(Start),
    /// The last estimate of a track, such as another robot's, which the caller reads.
    Track(TrackStart),
}

/// A start from a track: its last estimate before the first frames.
#[derive(Debug, Clone, PartialEq)]
pub struct TrackStart {
    /// The tracks.csv.
    pub file: String,
    /// The target's name in it.
    pub target: String,
    /// Pose of the track's world in this one.
    pub world_from_other: Pose,
    /// Standard deviation of the velocity on each axis in m/s; `None` for what the track says.
    pub velocity_sigma_mps: Option<f64>,
}

const KINDS: [Kind; 3] = [
    ("gaussian", "Around a rough position."),
    (
        "pixel",
        "Where the target is most likely along the ray through a pixel, for targets without the edge cue.",
    ),
    (
        "track",
        "From another track, such as another robot's: its last estimate before the first frames.",
    ),
];

/// Reads the table `start` of a target of this name.
pub(super) fn read_start(
    table: &Table,
    name: &str,
    cameras: &[String],
) -> Option<Located<StartConfig>> {
    let about = "Initial position of the target. A target with the edge cue needs none because it is detected.";
    let presence = if table.has("start") {
        Presence::Optional("")
    } else {
        Presence::RequiredIf("unless the target has the edge cue")
    };
    let start = table.choice("start", about, &KINDS, presence, |kind, start| match kind {
        "gaussian" => read_gaussian(start),
        "pixel" => read_pixel(start, cameras),
        _ => read_track(start, name),
    });
    if !table.has("start") {
        let message = "is missing; give a table start.gaussian or start.pixel or start.track, or remove the target's cues, so that it is detected";
        table.problem("start", message);
    }
    start
}

fn read_gaussian(table: &Table) -> Option<Located<StartConfig>> {
    let default = GaussianStart::at([0.0; 3]);
    let position_m = table
        .key("position_m", "Mean position in the world.")
        .within(-MAX_START..=MAX_START)
        .required();
    let covariance_m2 = table
        .key(
            "covariance_m2",
            "Covariance of the position: xx, xy, xz, yy, yz, zz.",
        )
        .depends("from `position_sigma_m`")
        .optional::<[f64; 6]>();
    let sigma = table
        .key("position_sigma_m", "Standard deviation of the position.")
        .within(0.0..=MAX_START)
        .or(PerAxis(GaussianStart::POSITION_SIGMA_M))
        .0;
    let has_covariance = table.has("covariance_m2");
    if has_covariance && table.has("position_sigma_m") {
        table.conflict("position_sigma_m", "covariance_m2");
    }
    let covariance_m2 = if has_covariance {
        covariance_m2
    } else {
        Some(diagonal_m2(sigma))
    };
    let velocity_mps = table
        .key("velocity_mps", "Mean velocity.")
        .within(-MAX_START..=MAX_START)
        .or(default.velocity_mps);
    let velocity_sigma_mps = table
        .key("velocity_sigma_mps", "Standard deviation of the velocity.")
        .within(0.0..=MAX_START)
        .or(PerAxis(default.velocity_sigma_mps))
        .0;
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
    let default = PixelStart::at(0, [0.0; 2]);
    let pixel_px = table
        .key(
            "pixel_px",
            "Column and row of a pixel near the middle of the target.",
        )
        .required();
    let camera = table
        .key("camera", "The camera whose pixel it is.")
        .depends("unless the scene has one camera");
    let camera: Option<String> = if cameras.len() == 1 && !table.is_describing() {
        Some(camera.or(cameras[0].clone()))
    } else {
        camera.required()
    };
    let pixel_sigma_px = table
        .key(
            "pixel_sigma_px",
            "Standard deviation of the pixel; 0 searches one ray only, as the thesis does.",
        )
        .within(0.0..=1000.0)
        .or(default.pixel_sigma_px);
    let min_range_m = table
        .key(
            "min_range_m",
            "Distance at which the search along the ray begins.",
        )
        .within(above(0.0, MAX_START))
        .or(default.min_range_m);
    let max_range_m = table
        .key(
            "max_range_m",
            "Distance at which the search ends, unless the ray meets the ground before; greater than `min_range_m`.",
        )
        .within(above(0.0, MAX_START))
        .or(default.max_range_m);
    let ground_z_m = table
        .key("ground_z_m", "Height of the ground in the world.")
        .within(-MAX_START..=MAX_START)
        .or(default.ground_z_m);
    let ray_particles = table
        .key("ray_particles", "Number of particles along the ray.")
        .within(2.0..=100_000.0)
        .or(default.ray_particles);
    let position_sigma_m = table
        .key(
            "position_sigma_m",
            "Standard deviation of the position around the best particle.",
        )
        .within(0.0..=MAX_START)
        .or(PerAxis(default.position_sigma_m))
        .0;
    let velocity_sigma_mps = table
        .key(
            "velocity_sigma_mps",
            "Standard deviation of the velocity around zero.",
        )
        .within(0.0..=MAX_START)
        .or(PerAxis(default.velocity_sigma_mps))
        .0;
    let camera = camera?;
    let Some(camera_number) = cameras.iter().position(|name| *name == camera) else {
        table.reject("camera", &cameras.join(", "));
        return None;
    };
    let start = PixelStart {
        camera: camera_number,
        pixel: pixel_px?,
        pixel_sigma_px,
        min_range_m,
        max_range_m,
        ground_z_m,
        ray_particles,
        position_sigma_m,
        velocity_sigma_mps,
    };
    table.checked(start.check())?;
    Some(table.at("pixel_px", StartConfig::Here(Start::Pixel(start))))
}

fn read_track(table: &Table, name: &str) -> Option<Located<StartConfig>> {
    let file = table
        .key("file", "A `tracks.csv` that `pardalis track` wrote.")
        .required();
    let target = table
        .key("target", "The target's name in that file.")
        .depends("the target's own name")
        .or(name.to_owned());
    let rows = table
        .key(
            "world_from_other",
            "Pose of that file's world in this one, as a homogeneous matrix in metres.",
        )
        .unit("m")
        .depends("the same world")
        .optional::<[[f64; 4]; 4]>();
    let world_from_other = match rows {
        None if table.has("world_from_other") => None,
        None => Some(Pose::identity()),
        Some(rows) => pose_from_matrix(rows)
            .map_err(|error| table.problem("world_from_other", error.to_string()))
            .ok(),
    };
    let velocity_sigma_mps = table
        .key("velocity_sigma_mps", "Standard deviation of the velocity.")
        .within(0.0..=MAX_START)
        .depends("that of the track; 0.5 if it has none")
        .optional();
    let start = TrackStart {
        file: file?,
        target,
        world_from_other: world_from_other?,
        velocity_sigma_mps,
    };
    Some(table.at("file", StartConfig::Track(start)))
}
