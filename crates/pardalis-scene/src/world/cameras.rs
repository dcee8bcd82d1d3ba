//! The cameras of a world.

use std::f64::consts::TAU;

use nalgebra::Vector3;

use super::super::camera::{
    ReadCalibration, pose_key, read_any_pose, read_calibrated, read_platform,
};
use super::super::description::Presence;
use super::super::model::read_model;
use super::super::reader::Table;
use super::{MAX_DISTANCE_M, length, read_point};
use pardalis_camera::Camera;
use pardalis_camera::formats::MAX_CAMERAS;
use pardalis_camera::{Pose, looking_at};
use pardalis_simulate::{ImageSettings, Timing, WorldCamera};

/// Maximum side of an image, in pixels.
const MAX_SIDE_PX: f64 = 4096.0;
/// Maximum number of exposures of one camera.
const MAX_EXPOSURES: f64 = 100_000.0;
/// Maximum standard deviation of time stamps as a share of the frame interval. Errors are cut at three standard
/// deviations, so that time stamps still ascend.
const MAX_JITTER: f64 = 0.15;

/// Reads the cameras; invalid ones are left out and reported to the journal.
pub(super) fn read(
    table: &Table,
    duration_s: Option<f64>,
    platforms: &[String],
    read_calibration: ReadCalibration,
) -> Vec<WorldCamera> {
    let duration_s = duration_s.unwrap_or(0.0);
    let image = read_image(table, ImageSettings::default());
    let timing = read_timing(table, &Timing::default());
    let about = "Cameras at even angles around a point, all looking at it: `cam1`, `cam2`, ... counterclockwise.";
    let mut cameras = table
        .section("ring", about, |ring| {
            Some(read_ring(ring, image, &timing, read_calibration))
        })
        .unwrap_or_default();
    let presence = if table.has("ring") {
        Presence::Optional("")
    } else {
        Presence::RequiredIf("unless there is a `ring`")
    };
    let about = "The cameras, each by its name.";
    for (name, table) in table.named_tables("cameras", about, presence) {
        if cameras.iter().any(|camera| camera.name == name) {
            table.problem_here("is the name of a camera of the ring; rename it");
        }
        let image = read_image(&table, image);
        let timing = read_timing(&table, &timing);
        cameras.extend(read_camera(
            name,
            &table,
            (image, timing),
            platforms,
            read_calibration,
        ));
        table.finish();
    }
    let exposures = |camera: &&WorldCamera| camera.timing.fps * duration_s > MAX_EXPOSURES;
    if let Some(camera) = cameras.iter().find(exposures) {
        let message = format!(
            "gives more than {MAX_EXPOSURES} images of camera {} at {} a second; shorten it",
            camera.name, camera.timing.fps
        );
        table.problem("duration_s", message);
    }
    if cameras.len() > MAX_CAMERAS {
        let message = format!("are {}; allowed: at most {MAX_CAMERAS}", cameras.len());
        table.problem("cameras", message);
    }
    cameras
}

/// Reads cameras at even angles around a point, all looking at it, counter-clockwise from the x axis.
fn read_ring(
    table: &Table,
    image: ImageSettings,
    timing: &Timing,
    read_calibration: ReadCalibration,
) -> Vec<WorldCamera> {
    let count = table
        .key("count", "Number of cameras.")
        .within(1.0..=MAX_CAMERAS as f64)
        .required::<usize>();
    let center_m = read_point(table, "center_m", "The point that they look at.");
    let radius_m = length(table, "radius_m", "Radius of the ring.");
    let height_m = table
        .key("height_m", "Height of the ring above that point.")
        .within(-MAX_DISTANCE_M..=MAX_DISTANCE_M)
        .or(0.0);
    let start_deg: f64 = table
        .key("start_deg", "Angle of the first camera from the x axis.")
        .or(0.0);
    let roll_deg = read_roll_deg(table);
    let optics = read_optics("cam1", table, read_calibration);
    let all = || Some((count?, center_m?, radius_m?, optics?));
    let Some((count, center_m, radius_m, (camera, size_px, _))) = all() else {
        return Vec::new();
    };
    (0..count)
        .filter_map(|i| {
            let angle = start_deg.to_radians() + TAU * i as f64 / count as f64;
            let (sin, cos) = libm::sincos(angle);
            let from_m = center_m + Vector3::new(radius_m * cos, radius_m * sin, height_m);
            Some(WorldCamera {
                name: format!("cam{}", i + 1),
                camera: camera.clone(),
                size_px,
                world_from_camera: looking_at(from_m, center_m, roll_deg.to_radians())?,
                platform: None,
                image,
                timing: timing.clone(),
            })
        })
        .collect()
}

fn read_camera(
    name: String,
    table: &Table,
    (image, timing): (ImageSettings, Timing),
    platforms: &[String],
    read_calibration: ReadCalibration,
) -> Option<WorldCamera> {
    let platform = read_platform(table, platforms);
    let optics = read_optics(&name, table, read_calibration);
    let file_pose = optics.as_ref().and_then(|(_, _, pose)| *pose);
    let world_from_camera = read_view(table, file_pose);
    let (camera, size_px, _) = optics?;
    Some(WorldCamera {
        name,
        camera,
        size_px,
        world_from_camera: world_from_camera?,
        platform: platform.and_then(|name| platforms.iter().position(|other| *other == name)),
        image,
        timing,
    })
}

/// Reads model and size, and the pose of the calibration file if it has one.
fn read_optics(
    name: &str,
    table: &Table,
    read_calibration: ReadCalibration,
) -> Option<(Camera, (usize, usize), Option<Pose>)> {
    let file = read_calibrated(name, table, read_calibration, None);
    let model = if table.has("calibration") {
        if table.knows("model") {
            table.conflict("model", "calibration");
        }
        file.as_ref().map(|file| file.camera.clone())
    } else {
        read_model(table)
    };
    if matches!(model, Some(Camera::Plane(_))) {
        let key = if table.has("model") {
            "model"
        } else {
            "calibration"
        };
        let message =
            "is a plane, with which a world cannot be rendered; give a model such as model.pinhole";
        table.problem(key, message);
        return None;
    }
    let file_size = file.as_ref().and_then(|file| file.size_px);
    let given_size = table
        .key("size_px", "Width and height of the images, whole numbers.")
        .within(1.0..=MAX_SIDE_PX)
        .depends("unless the calibration file contains it")
        .conditional::<[f64; 2]>();
    let size_px = if table.has("size_px") {
        given_size
    } else {
        if file_size.is_none() {
            table.problem(
                "size_px",
                "is missing; give two whole numbers, [width, height]",
            );
        }
        file_size.map(|(width, height)| [width as f64, height as f64])
    };
    let whole = |v: f64| v.fract() == 0.0 && (1.0..=MAX_SIDE_PX).contains(&v);
    if size_px.is_some_and(|size| !size.into_iter().all(whole)) {
        let key = if table.has("size_px") {
            "size_px"
        } else {
            "calibration"
        };
        table.problem(key, "has a size that cannot be simulated; allowed: two whole numbers from 1 to 4096, [width, height]");
        return None;
    }
    let [width, height] = size_px?;
    Some((
        model?,
        (width as usize, height as usize),
        file.and_then(|f| f.world_from_camera),
    ))
}

fn read_roll_deg(table: &Table) -> f64 {
    table
        .key(
            "roll_deg",
            "Rotation about the viewing direction, from upright.",
        )
        .or(0.0)
}

/// Reads the pose: a matrix, or the position and the point at which the camera looks, or the pose of the calibration
/// file.
fn read_view(table: &Table, file_pose: Option<Pose>) -> Option<Pose> {
    let given = read_any_pose(table);
    let pose_key = pose_key(table);
    let looks = ["look_from_m", "look_at_m", "roll_deg"].map(|key| table.knows(key));
    if table.is_describing() {
        for (key, about) in LOOKS {
            let key = table.key(key, about);
            key.depends("unless another pose is given")
                .conditional::<[f64; 3]>();
        }
        read_roll_deg(table);
    }
    if looks == [false; 3] {
        let is_missing = file_pose.is_none() && !table.has(pose_key);
        if is_missing {
            let message =
                "is missing; give four rows of four finite numbers, or look_from_m and look_at_m";
            table.problem(pose_key, message);
        }
        return given.or(file_pose);
    }
    if table.has(pose_key) {
        table.conflict(pose_key, "look_from_m and look_at_m");
    }
    let [from_m, at_m] = LOOKS.map(|(key, about)| read_point(table, key, about));
    let roll_deg = read_roll_deg(table);
    let pose = looking_at(from_m?, at_m?, roll_deg.to_radians());
    if pose.is_none() {
        table.reject("look_at_m", "a point other than look_from_m");
    }
    pose
}

/// The keys of the points that determine a pose.
const LOOKS: [(&str, &str); 2] = [
    (
        "look_from_m",
        "Position of the camera, in place of `world_from_camera` or `platform_from_camera`, in the frame of that key.",
    ),
    (
        "look_at_m",
        "The point at the centre of its view, in the same frame.",
    ),
];

/// Reads the table `image`, or returns the default.
fn read_image(table: &Table, default: ImageSettings) -> ImageSettings {
    let about =
        "Image properties. At the top level for all cameras; a camera's own table overrides it.";
    let settings = table.section("image", about, |table| {
        let samples = table
            .key("samples", "Rays along each side of a pixel.")
            .within(1.0..=16.0)
            .or(default.samples);
        let non_negative = |name, about, default: f64, greatest: f64| {
            table.key(name, about).within(0.0..=greatest).or(default)
        };
        let shutter_s = non_negative("shutter_s", "Exposure time.", default.shutter_s, 10.0);
        let instants = table
            .key(
                "instants",
                "Number of instants within the exposure time whose images are averaged.",
            )
            .within(1.0..=64.0)
            .or(default.instants);
        let line_delay_s = table
            .key(
                "line_delay_s",
                "Time from the exposure of one row to that of the next, of a rolling shutter. The middle row is exposed around the frame's time.",
            )
            .within(-1e-3..=1e-3)
            .or(default.line_delay_s);
        let blur_px = non_negative(
            "blur_px",
            "Standard deviation of the blur of the lens; large out of focus.",
            default.blur_px,
            20.0,
        );
        let shot_noise = non_negative(
            "shot_noise",
            "Standard deviation of the shot noise of white, as a share of white.",
            default.shot_noise,
            1.0,
        );
        let read_noise = table
            .key("read_noise", "Standard deviation of the read noise.")
            .unit("grey levels of 255")
            .within(0.0..=100.0)
            .or(default.read_noise);
        let gains = table
            .key(
                "gains",
                "Gains of red, green and blue in linear light, as of a camera with another white balance.",
            )
            .within(0.01..=100.0)
            .or(default.gains);
        let gain_drift = non_negative(
            "gain_drift",
            "Amplitude of the drift of the exposure, as a share.",
            default.gain_drift,
            0.9,
        );
        let white_balance_drift = non_negative(
            "white_balance_drift",
            "Amplitude of the drift of red against blue, as a share.",
            default.white_balance_drift,
            0.9,
        );
        let drift_period_s = table
            .key("drift_period_s", "Period of both drifts.")
            .within(0.01..=1e6)
            .or(default.drift_period_s);
        let jpeg_quality = table
            .key("jpeg_quality", "JPEG quality; 0 writes PNG.")
            .within(0.0..=100.0)
            .or(default.jpeg_quality.map_or(0, usize::from));
        let mut settings = default;
        settings.samples = samples;
        settings.shutter_s = shutter_s;
        settings.instants = instants;
        settings.line_delay_s = line_delay_s;
        settings.blur_px = blur_px;
        settings.shot_noise = shot_noise;
        settings.read_noise = read_noise;
        settings.gains = gains;
        settings.gain_drift = gain_drift;
        settings.white_balance_drift = white_balance_drift;
        settings.drift_period_s = drift_period_s;
        settings.jpeg_quality = (jpeg_quality > 0).then_some(jpeg_quality as u8);
        Some(settings)
    });
    settings.unwrap_or(default)
}

/// Reads the table `timing`, or returns the default.
fn read_timing(table: &Table, default: &Timing) -> Timing {
    let about = "Exposure times, time stamps and delivery of images. At the top level for all cameras; a camera's own table overrides it.";
    let timing = table.section("timing", about, |table| {
        let d = default;
        let non_negative = |name, about, default: f64, greatest: f64| {
            table.key(name, about).within(0.0..=greatest).or(default)
        };
        let fps = table
            .key("fps", "Frame rate.")
            .within(0.001..=10_000.0)
            .or(d.fps);
        let stamp_jitter_s = non_negative(
            "stamp_jitter_s",
            "Standard deviation of each time stamp's own error, cut at three times that; at most 0.15 / `fps`.",
            d.stamp_jitter_s,
            1e6,
        );
        if stamp_jitter_s * fps > MAX_JITTER {
            let allowed = format!("at most {MAX_JITTER} / fps, so that time stamps ascend");
            table.problem(
                "stamp_jitter_s",
                format!("is {stamp_jitter_s}; allowed: {allowed}"),
            );
        }
        Some(Timing {
            fps,
            phase_s: non_negative(
                "phase_s",
                "Middle of the first exposure.",
                d.phase_s,
                1e6,
            ),
            random_phase: table
                .key(
                    "random_phase",
                    "Whether a random part of the frame interval is added to `phase_s`, as for cameras without a trigger.",
                )
                .or(d.random_phase),
            rate_sigma: non_negative(
                "rate_sigma",
                "Standard deviation of the relative error of the frame rate.",
                d.rate_sigma,
                0.1,
            ),
            clock_offset_s: table
                .key("clock_offset_s", "Offset of the camera's clock: time stamp minus true time.")
                .within(-1e9..=1e9)
                .or(d.clock_offset_s),
            clock_offset_sigma_s: non_negative(
                "clock_offset_sigma_s",
                "Standard deviation of a random part of that offset, the same for all frames.",
                d.clock_offset_sigma_s,
                1e6,
            ),
            stamp_jitter_s,
            drop_probability: non_negative(
                "drop_probability",
                "Probability that a frame is dropped.",
                d.drop_probability,
                0.99,
            ),
            drops_s: read_spans(
                table,
                "drops_s",
                "Spans [from, to] of time in which all frames are dropped.",
                &d.drops_s,
            ),
            freezes_s: read_spans(
                table,
                "freezes_s",
                "Spans [from, to] of time in which the previous image is delivered again.",
                &d.freezes_s,
            ),
            delay_s: non_negative(
                "delay_s",
                "Time from the middle of the exposure to the image's arrival.",
                d.delay_s,
                1e6,
            ),
            delay_jitter_s: non_negative(
                "delay_jitter_s",
                "Standard deviation of an additional random delay, of which the absolute value is used.",
                d.delay_jitter_s,
                1e6,
            ),
            broken_frames: table
                .key("broken_frames", "Numbers of delivered images whose files are truncated.")
                .or(d.broken_frames.clone()),
        })
    });
    timing.unwrap_or_else(|| default.clone())
}

/// Reads spans of time in seconds.
fn read_spans(
    table: &Table,
    key: &'static str,
    about: &'static str,
    default: &[[f64; 2]],
) -> Vec<[f64; 2]> {
    let default: Vec<Vec<f64>> = default.iter().map(|span| span.to_vec()).collect();
    let rows: Vec<Vec<f64>> = table.key(key, about).or(default);
    let span = |row: &Vec<f64>| match row[..] {
        [from, to] if from < to => Some([from, to]),
        _ => None,
    };
    let spans: Option<Vec<_>> = rows.iter().map(span).collect();
    if spans.is_none() {
        table.reject(key, "rows of [from, to] in seconds, from before to");
    }
    spans.unwrap_or_default()
}
