//! The cameras of a world.

use std::f64::consts::TAU;

use nalgebra::Vector3;

use super::super::camera::{ReadCalibration, read_calibrated, read_model, read_pose};
use super::super::reader::Table;
use super::{bounded, length, non_negative, read_point, share};
use pardalis_camera::Camera;
use pardalis_camera::formats::MAX_CAMERAS;
use pardalis_camera::{Pose, looking_at};
use pardalis_simulate::{ImageSettings, Timing, WorldCamera};

/// The longest side of an image, in pixels.
const MAX_SIDE_PX: f64 = 4096.0;
/// The most exposures of one camera.
const MAX_EXPOSURES: f64 = 100_000.0;
/// Stamps whose errors are this share of a frame's interval at most still ascend: errors are cut at three times their standard deviation.
const MAX_JITTER: f64 = 0.15;

/// Reads the cameras; those with a problem, which the journal then says, are left out.
pub(super) fn read(
    table: &Table,
    duration_s: Option<f64>,
    read_calibration: ReadCalibration,
) -> Vec<WorldCamera> {
    let duration_s = duration_s.unwrap_or(0.0);
    let image = read_image(table, ImageSettings::default());
    let timing = read_timing(table, &Timing::default());
    let mut cameras = table
        .table("ring")
        .map(|ring| read_ring(ring, image, &timing, read_calibration))
        .unwrap_or_default();
    if !table.has("ring") || table.has("cameras") {
        for (name, table) in table.named_tables("cameras", "camera") {
            if cameras.iter().any(|camera| camera.name == name) {
                table.problem_here("is the name of a camera of the ring; give it another name");
            }
            let image = read_image(&table, image);
            let timing = read_timing(&table, &timing);
            cameras.extend(read_camera(name, &table, image, timing, read_calibration));
            table.finish();
        }
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

/// Cameras evenly around a point, all looking at it; counter-clockwise from the direction of x.
fn read_ring(
    table: Table,
    image: ImageSettings,
    timing: &Timing,
    read_calibration: ReadCalibration,
) -> Vec<WorldCamera> {
    let count = table.required::<usize>("count");
    let count = count.filter(|&count| {
        let allowed = (1..=MAX_CAMERAS).contains(&count);
        if !allowed {
            table.refuse("count", &format!("1 to {MAX_CAMERAS}"));
        }
        allowed
    });
    let center_m = read_point(&table, "center_m");
    let radius_m = length(&table, "radius_m");
    let height_m = bounded(&table, "height_m", 0.0, -1e4..=1e4);
    let start_deg: f64 = table.or("start_deg", 0.0);
    let roll_deg: f64 = table.or("roll_deg", 0.0);
    let optics = read_optics("cam1", &table, read_calibration);
    table.finish();
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
                image,
                timing: timing.clone(),
            })
        })
        .collect()
}

fn read_camera(
    name: String,
    table: &Table,
    image: ImageSettings,
    timing: Timing,
    read_calibration: ReadCalibration,
) -> Option<WorldCamera> {
    let optics = read_optics(&name, table, read_calibration);
    let file_pose = optics.as_ref().and_then(|(_, _, pose)| *pose);
    let world_from_camera = read_view(table, file_pose);
    let (camera, size_px, _) = optics?;
    Some(WorldCamera {
        name,
        camera,
        size_px,
        world_from_camera: world_from_camera?,
        image,
        timing,
    })
}

/// Model and size, and the pose of the calibration file where there is one.
fn read_optics(
    name: &str,
    table: &Table,
    read_calibration: ReadCalibration,
) -> Option<(Camera, (usize, usize), Option<Pose>)> {
    let file = read_calibrated(name, table, read_calibration);
    let model = if table.has("calibration") {
        if table.knows("model") {
            table.problem("model", "stands beside calibration; keep one of them");
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
        let message = "is known by a plane alone, and a world has more than that to see; give a camera such as model.pinhole with a pose";
        table.problem(key, message);
        return None;
    }
    let file_size = file.as_ref().and_then(|file| file.size_px);
    let size_px = if file_size.is_some() && !table.has("size_px") {
        file_size.map(|(width, height)| [width as f64, height as f64])
    } else {
        table.required::<[f64; 2]>("size_px")
    };
    let whole = |v: f64| v.fract() == 0.0 && (1.0..=MAX_SIDE_PX).contains(&v);
    if size_px.is_some_and(|size| !size.into_iter().all(whole)) {
        let key = if table.has("size_px") {
            "size_px"
        } else {
            "calibration"
        };
        table.problem(key, "says a size that cannot be simulated; allowed: two whole numbers from 1 to 4096, [width, height]");
        return None;
    }
    let [width, height] = size_px?;
    Some((
        model?,
        (width as usize, height as usize),
        file.and_then(|f| f.world_from_camera),
    ))
}

/// The pose: a matrix, where it looks from and at, or the calibration file's.
fn read_view(table: &Table, file_pose: Option<Pose>) -> Option<Pose> {
    let given = read_pose(table);
    let looks = ["look_from_m", "look_at_m", "roll_deg"].map(|key| table.knows(key));
    if looks == [false; 3] {
        let is_missing = file_pose.is_none() && !table.has("world_from_camera");
        if is_missing {
            let message =
                "is missing; give four rows of four finite numbers, or look_from_m and look_at_m";
            table.problem("world_from_camera", message);
        }
        return given.or(file_pose);
    }
    if table.has("world_from_camera") {
        table.problem(
            "world_from_camera",
            "stands beside look_from_m and look_at_m; keep one of them",
        );
    }
    let (from_m, at_m) = (
        read_point(table, "look_from_m"),
        read_point(table, "look_at_m"),
    );
    let roll_deg: f64 = table.or("roll_deg", 0.0);
    let pose = looking_at(from_m?, at_m?, roll_deg.to_radians());
    if pose.is_none() {
        table.refuse("look_at_m", "another point than look_from_m");
    }
    pose
}

/// The table `image`, or what stands in its place.
fn read_image(table: &Table, default: ImageSettings) -> ImageSettings {
    let Some(table) = table.table("image") else {
        return default;
    };
    let samples = table.or("samples", default.samples);
    if !(1..=16).contains(&samples) {
        table.refuse("samples", "1 to 16");
    }
    let instants = table.or("instants", default.instants);
    if !(1..=64).contains(&instants) {
        table.refuse("instants", "1 to 64");
    }
    let jpeg_quality = table.or("jpeg_quality", default.jpeg_quality.map_or(0, usize::from));
    if jpeg_quality > 100 {
        table.refuse("jpeg_quality", "1 to 100, or 0 for PNG");
    }
    let settings = ImageSettings {
        samples,
        shutter_s: non_negative(&table, "shutter_s", default.shutter_s, 10.0),
        instants,
        blur_px: non_negative(&table, "blur_px", default.blur_px, 20.0),
        shot_noise: share(&table, "shot_noise", default.shot_noise),
        read_noise: non_negative(&table, "read_noise", default.read_noise, 100.0),
        gain_drift: non_negative(&table, "gain_drift", default.gain_drift, 0.9),
        white_balance_drift: non_negative(
            &table,
            "white_balance_drift",
            default.white_balance_drift,
            0.9,
        ),
        drift_period_s: bounded(&table, "drift_period_s", default.drift_period_s, 0.01..=1e6),
        jpeg_quality: (jpeg_quality > 0).then_some(jpeg_quality as u8),
    };
    table.finish();
    settings
}

/// The table `timing`, or what stands in its place.
fn read_timing(table: &Table, default: &Timing) -> Timing {
    let Some(table) = table.table("timing") else {
        return default.clone();
    };
    let d = default;
    let fps = bounded(&table, "fps", d.fps, 0.001..=10_000.0);
    let stamp_jitter_s = non_negative(&table, "stamp_jitter_s", d.stamp_jitter_s, 1e6);
    if stamp_jitter_s * fps > MAX_JITTER {
        let allowed = format!("at most {MAX_JITTER} / fps, so that stamps ascend");
        table.problem(
            "stamp_jitter_s",
            format!("is {stamp_jitter_s}; allowed: {allowed}"),
        );
    }
    let timing = Timing {
        fps,
        phase_s: non_negative(&table, "phase_s", d.phase_s, 1e6),
        random_phase: table.or("random_phase", d.random_phase),
        rate_sigma: non_negative(&table, "rate_sigma", d.rate_sigma, 0.1),
        clock_offset_s: bounded(&table, "clock_offset_s", d.clock_offset_s, -1e9..=1e9),
        clock_offset_sigma_s: non_negative(
            &table,
            "clock_offset_sigma_s",
            d.clock_offset_sigma_s,
            1e6,
        ),
        stamp_jitter_s,
        drop_probability: non_negative(&table, "drop_probability", d.drop_probability, 0.99),
        drops_s: read_spans(&table, "drops_s", &d.drops_s),
        freezes_s: read_spans(&table, "freezes_s", &d.freezes_s),
        delay_s: non_negative(&table, "delay_s", d.delay_s, 1e6),
        delay_jitter_s: non_negative(&table, "delay_jitter_s", d.delay_jitter_s, 1e6),
        broken_frames: table.or("broken_frames", d.broken_frames.clone()),
    };
    table.finish();
    timing
}

/// Spans of time in seconds.
fn read_spans(table: &Table, key: &'static str, default: &[[f64; 2]]) -> Vec<[f64; 2]> {
    let default: Vec<Vec<f64>> = default.iter().map(|span| span.to_vec()).collect();
    let rows: Vec<Vec<f64>> = table.or(key, default);
    let span = |row: &Vec<f64>| match row[..] {
        [from, to] if from < to => Some([from, to]),
        _ => None,
    };
    let spans: Option<Vec<_>> = rows.iter().map(span).collect();
    if spans.is_none() {
        table.refuse(key, "rows of [from, to] in seconds, from before to");
    }
    spans.unwrap_or_default()
}
