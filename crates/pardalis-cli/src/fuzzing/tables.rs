//! Tables.

use std::path::Path;

use anyhow::Result;

use crate::commands::calibrate::observations::{Columns, read_table};
use crate::commands::devices::formats::{best, formats_in};
use crate::commands::evaluate::circles_of;
use crate::detections;
use crate::fuzzed_file::{FILE, check_error};
use crate::measurements;
use crate::platforms;
use crate::report::{json_of_tracks, poses_of};
use crate::tables::{Series, Table, tracks_of, truth_of};

/// Returns what a reader reads from a table, if it accepts it.
fn read<T>(bytes: &[u8], reader: impl Fn(&Table) -> Result<T>) -> Option<T> {
    let table = Table::from_reader(Path::new(FILE), bytes);
    match table.and_then(|table| reader(&table)) {
        Ok(value) => Some(value),
        Err(error) => {
            check_error(&error);
            None
        }
    }
}

/// Checks that each series has a name of its own and ascending times.
fn check_series<T>(all: &[Series<T>]) {
    assert!(!all.is_empty());
    for (index, series) in all.iter().enumerate() {
        assert!(!series.name.is_empty());
        assert!(all[..index].iter().all(|other| other.name != series.name));
        assert!(series.rows.iter().all(|(time_s, _)| time_s.is_finite()));
        assert!(series.rows.is_sorted_by(|a, b| a.0 < b.0));
    }
}

fn are_finite<const N: usize>(numbers: Option<[f64; N]>) -> bool {
    numbers.iter().flatten().all(|number| number.is_finite())
}

/// Reads where cameras were.
pub(super) fn camera_poses(bytes: &[u8]) -> bool {
    let Some(all) = read(bytes, poses_of) else {
        return false;
    };
    assert!(!all.is_empty());
    for poses in all.values() {
        assert!(poses.is_sorted_by(|a, b| a.0 < b.0));
        for (time_s, pose) in poses {
            assert!(time_s.is_finite() && are_finite(Some(pose.translation.vector.into())));
            let error = pose.rotation.matrix() * pose.rotation.matrix().transpose();
            assert!((error - nalgebra::Matrix3::identity()).norm() < 1e-9);
        }
    }
    true
}

/// Reads tracks as `evaluate` and, because `view` takes more, as pages do.
pub(super) fn tracks(bytes: &[u8]) -> bool {
    if let Some(json) = read(bytes, json_of_tracks) {
        let columns: serde_json::Value = serde_json::from_str(&json).unwrap();
        for track in columns.as_object().unwrap().values() {
            let count = |name: &str| track[name].as_array().unwrap().len();
            assert!(count("state") > 0 && count("state") == count("time_s"));
            let times = track["time_s"].as_array().unwrap();
            assert!(times.iter().all(serde_json::Value::is_number));
        }
    }
    let Some(tracks) = read(bytes, tracks_of) else {
        return false;
    };
    check_series(&tracks);
    for (_, row) in tracks.iter().flat_map(|track| &track.rows) {
        assert!(
            row.confidence
                .is_none_or(|share| (0.0..=1.0).contains(&share))
        );
        let Some(estimate) = row.estimate else {
            continue;
        };
        assert!(are_finite(Some(estimate.position_m)));
        assert!(are_finite(estimate.best_position_m) && are_finite(estimate.velocity_mps));
        assert!(are_finite(estimate.covariance_m2));
        assert!(estimate.heading_rad.is_none_or(f64::is_finite));
    }
    true
}

pub(super) fn truth(bytes: &[u8]) -> bool {
    let Some(truth) = read(bytes, truth_of) else {
        return false;
    };
    check_series(&truth);
    for (_, state) in truth.iter().flat_map(|object| &object.rows) {
        assert!(are_finite(Some(state.position_m)) && are_finite(state.velocity_mps));
        assert!(
            state
                .visible_fraction
                .is_none_or(|share| (0.0..=1.0).contains(&share))
        );
    }
    true
}

/// Reads circles around objects in images.
pub(super) fn circles(bytes: &[u8]) -> bool {
    let Some(all) = read(bytes, circles_of) else {
        return false;
    };
    assert!(!all.is_empty());
    let circles = all.iter().flat_map(|one| &one.images);
    for circle in circles.filter_map(|(_, circle)| circle.as_ref()) {
        assert!(
            are_finite(Some(circle.center_px))
                && circle.radius_px.is_finite()
                && circle.radius_px > 0.0
        );
        assert!(
            circle
                .visible_fraction
                .is_none_or(|share| share > 0.0 && share <= 1.0)
        );
    }
    true
}

/// Reads the points of `calibrate points` and `calibrate pose`.
pub(super) fn points(bytes: &[u8]) -> bool {
    let read = read(bytes, |table| read_table(table, &Columns::default()));
    let Some(observations) = read else {
        return false;
    };
    assert_eq!(observations.views.len(), observations.numbers.len());
    for (view, lines) in observations.views.iter().zip(&observations.numbers) {
        assert!(!view.correspondences.is_empty());
        assert_eq!(view.correspondences.len(), lines.len());
        let are_all = |point: &pardalis_calibrate::Correspondence| {
            are_finite(Some(point.point_m)) && are_finite(Some(point.pixel))
        };
        assert!(view.correspondences.iter().all(are_all));
    }
    true
}

/// Reads a file of poses or of odometry.
fn motion(bytes: &[u8], is_odometry: bool) -> bool {
    match platforms::read_bytes(bytes, Path::new(FILE), is_odometry) {
        Ok(rows) => rows > 0,
        Err(error) => {
            check_error(&error);
            false
        }
    }
}

pub(super) fn poses(bytes: &[u8]) -> bool {
    motion(bytes, false)
}

pub(super) fn odometry(bytes: &[u8]) -> bool {
    motion(bytes, true)
}

/// Reads a pose that comes over the network.
pub(super) fn pose_datagram(bytes: &[u8]) -> bool {
    match platforms::live::read_bytes(bytes, Path::new(FILE)) {
        Ok(pose) => {
            // Its clock is nearly that of the reader.
            assert!((pose.time_s - platforms::live::READ_UNIX_S).abs() < 11.0);
            let position_m = pose.world_from_platform.translation.vector;
            assert!(are_finite(Some(<[f64; 3]>::from(position_m))));
            true
        }
        Err(error) => {
            check_error(&error);
            false
        }
    }
}

/// Reads what other sensors measure.
pub(super) fn measurements(bytes: &[u8]) -> bool {
    let Some(rows) = read(bytes, measurements::rows_in) else {
        return false;
    };
    for (measurement, line) in &rows {
        // Carriage returns alone end rows, but not lines.
        assert!(measurement.time_s().is_finite() && *line > 0);
        if let Some((position_m, covariance_m2)) = measurement.full_position(3) {
            assert!(are_finite(Some(position_m)) && are_finite(Some(covariance_m2)));
            assert!([0, 3, 5].iter().all(|&axis| covariance_m2[axis] > 0.0));
        }
    }
    !rows.is_empty()
}

pub(super) fn detections(bytes: &[u8]) -> bool {
    let table =
        Table::from_reader_with_or_without_header(Path::new(FILE), bytes, &detections::MOT_COLUMNS);
    check_detections(table.and_then(|table| detections::boxes_in(&table)))
}

pub(super) fn detections_coco(bytes: &[u8]) -> bool {
    let names = ["000001.jpg", "clip_7.jpg"].map(str::to_owned);
    let accepted = [None, Some(names.to_vec())].map(|names| {
        let images = detections::Images {
            size_px: (640, 480),
            count: None,
            names,
        };
        check_detections(detections::coco::boxes_in(Path::new(FILE), bytes, &images))
    });
    accepted.contains(&true)
}

fn check_detections(found: anyhow::Result<Vec<detections::Found>>) -> bool {
    match found {
        Ok(found) => {
            assert!(!found.is_empty());
            for found in found.iter().filter_map(|one| one.found) {
                let [left, top, right, bottom] = found.sides_px();
                assert!(left < right && top < bottom && are_finite(Some(found.sides_px())));
                let score = found.score();
                assert!(score.is_none_or(|score| (0.0..=1.0).contains(&score)));
            }
            true
        }
        Err(error) => {
            check_error(&error);
            false
        }
    }
}

/// Reads the columns of `locate --starts`, of `locate --clicks` and of `calibrate plane --points`.
pub(super) fn starts(bytes: &[u8]) -> bool {
    let numbers = read(bytes, |table| {
        let frame = table.column("frame")?;
        let columns = table.columns(["x_m", "y_m", "z_m"])?;
        let object = table.optional_column("object");
        let mut numbers = Vec::new();
        for row in table.rows() {
            row.count(frame)?;
            object
                .map(|object| row.text(object).map(str::len))
                .transpose()?;
            numbers.push(row.all_or_none(Some(columns))?);
        }
        Ok(numbers)
    });
    let Some(numbers) = numbers else {
        return false;
    };
    assert!(!numbers.is_empty() && numbers.into_iter().all(are_finite));
    true
}

/// Reads ffmpeg's list of the formats of a camera.
pub(super) fn device_formats(bytes: &[u8]) -> bool {
    let messages = String::from_utf8_lossy(bytes);
    match formats_in(&messages) {
        Ok(formats) => {
            if let Some(best) = best(&formats) {
                let size_px = best.size_px(1280 * 720);
                assert_eq!(size_px.is_some(), !best.sizes_px.is_empty());
            }
            !formats.is_empty()
        }
        Err(reason) => {
            assert!(reason.len() <= messages.len() + 100, "{reason}");
            false
        }
    }
}
