//! `summary.json`: the scene, its settings, and the outcome of the run.

use std::path::{Path, PathBuf};

use anyhow::Result;
use pardalis::TargetId;
use serde_json::{Map, Value, json};

use super::agreement;
use super::radius::EstimatedRadius;
use super::{Doubts, MissedFrames, Outcome, SeriesCollector};
use crate::files::write_file;
use crate::measurements;
use crate::platforms;
use crate::scene::OpenScene;

/// The name of the file in the output folder.
pub(crate) const FILE: &str = "summary.json";

/// Writes the summary beside the rows.
pub(crate) fn write(
    folder: &Path,
    scene_path: &Path,
    open: &OpenScene,
    outcome: &Outcome,
    results: (&SeriesCollector, &MissedFrames, &Doubts),
    (threads, is_smoothed): (usize, bool),
) -> Result<PathBuf> {
    let mut decoding_s = 0.0;
    let mut cameras = Map::new();
    let records = open.sources.iter().zip(&outcome.cameras);
    for (camera, (source, record)) in open.scene.cameras.iter().zip(records) {
        let counters = source.counters();
        decoding_s += counters.decode_s;
        let mut entry = json!({
            "source": source.describe(),
            "frames": record.frames,
            "stopped": record.stopped,
            "ffmpeg_errors": counters.ffmpeg_errors,
            "reopened": counters.reopened,
            "clock_jumps": counters.clock_jumps,
        });
        if let Some(position_m) = camera.position_m() {
            let key = match &camera.platform {
                Some(platform) => {
                    entry["platform"] = json!(platform);
                    "position_on_platform_m"
                }
                None => "position_m",
            };
            entry[key] = json!(position_m);
        }
        entry["agreement"] = json!(agreement::entry(&open.tracker, cameras.len()));
        cameras.insert(camera.name.clone(), entry);
    }
    let mut targets = Map::new();
    for (number, target) in open.scene.targets.iter().enumerate() {
        let entry = target_entry(open, number, results)?;
        targets.insert(target.name.clone(), entry);
    }
    let summary = json!({
        "program": "pardalis",
        "version": env!("CARGO_PKG_VERSION"),
        "scene": scene_path.to_string_lossy().into_owned(),
        "seed": open.scene.seed,
        "threads": threads,
        "smoothed": is_smoothed,
        "frame_sets": outcome.frame_sets,
        "max_delay_s": open.scene.max_delay_s,
        "interrupted": outcome.interrupted,
        "limit_reached": outcome.limit_reached,
        "error": outcome.error,
        "time": {
            "decoding_beside_tracking_s": decoding_s,
            "waiting_for_frames_s": outcome.waiting_s,
            "tracking_s": outcome.tracking_s,
            "writing_s": outcome.writing_s,
            "latency": outcome.latency,
        },
        "cameras": cameras,
        "platforms": platforms::entries(&open.platforms, &open.tracker),
        "targets": targets,
        "settings": open.scene.resolved,
    });
    let path = folder.join(FILE);
    let text = serde_json::to_string_pretty(&summary)? + "\n";
    write_file(&path, text.as_bytes())?;
    Ok(path)
}

/// Returns the entry of a target, by its number.
fn target_entry(
    open: &OpenScene,
    number: usize,
    (series, missed, doubts): (&SeriesCollector, &MissedFrames, &Doubts),
) -> Result<Value> {
    let target = &open.scene.targets[number];
    let states = &series.states()[number];
    let id = TargetId::new(number);
    let mut per_camera = Map::new();
    let contributions = open.tracker.contributions(id)?;
    for (camera, contribution) in open.scene.cameras.iter().zip(contributions) {
        let frames = contribution.frames;
        let mean_log_ratio =
            (frames > 0).then(|| contribution.log_likelihood_ratio / frames as f64);
        let entry = json!({
            "used_frames": frames,
            "visible_frames": contribution.visible_frames,
            "blind_frames": contribution.blind_frames,
            "searched_frames": contribution.searched_frames,
            "elsewhere_frames": contribution.elsewhere_frames,
            "mean_log_likelihood_ratio": mean_log_ratio,
        });
        per_camera.insert(camera.name.clone(), entry);
    }
    let diameters_m = target.bodies.iter().map(|body| body.shape.diameter_m());
    let diameter_m = diameters_m.fold(0.0, f64::max);
    let not_found = missed.lines(number, &target.name, states.searching + states.lost);
    let missed: Map<_, _> = (missed.by_reason(number))
        .map(|(reason, frames)| (reason.name().to_owned(), json!(frames)))
        .collect();
    let radii = EstimatedRadius::of(&open.scene, &open.tracker, number)?;
    let radii = radii.iter().map(|radius| {
        let entry = json!({
            "radius_m": radius.estimate.radius_m,
            "sigma_m": radius.estimate.sigma_m,
        });
        (radius.key.clone(), entry)
    });
    let radii: Map<_, _> = radii.collect();
    let mut entry = json!({
        "estimated_radii": radii,
        "diameter_m": diameter_m,
        "rows": states,
        "missed": missed,
        "not_found": not_found,
        "doubts": doubts.lines(number),
        "cameras": per_camera,
    });
    if target.crowd.is_some() {
        entry["members"] = json!(series.crowds()[number]);
    }
    if let Some(counts) = measurements::entry(&open.measurements, id, &open.tracker) {
        entry["measurements"] = counts;
    }
    Ok(entry)
}
