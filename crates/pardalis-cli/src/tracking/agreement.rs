//! Cameras that disagree with the others, and why.

use std::fmt::Write as _;

use pardalis::Tracker;
use pardalis::tracker::{CameraErrorCause, LikelyError};
use pardalis_scene::Scene;
use serde_json::{Value, json};

/// Returns a warning if cameras disagree: by how much, which may be wrong, and what to do.
pub(crate) fn warning(scene: &Scene, tracker: &Tracker) -> Option<String> {
    let agreements = tracker.camera_agreement();
    let compared = agreements.iter().filter(|camera| camera.comparisons > 0);
    let compared = compared.count();
    let mut wrong: Vec<(&str, LikelyError)> = (scene.cameras.iter().zip(&agreements))
        .filter_map(|(camera, agreement)| Some((&*camera.name, agreement.likely_error?)))
        .collect();
    wrong.sort_by(|a, b| b.1.explained_px.total_cmp(&a.1.explained_px));
    let (name, error) = wrong.first()?;
    let px = error.explained_px;
    let mut text = if wrong.len() == 1 {
        format!("warning: cameras.{name}: disagrees with the other cameras by {px:.1} pixels")
    } else {
        let names: Vec<String> = wrong
            .iter()
            .map(|(name, _)| format!("cameras.{name}"))
            .collect();
        let which = if compared == 2 {
            "with two cameras either may be wrong"
        } else {
            "any of them may be wrong"
        };
        format!(
            "warning: {}: disagree by {px:.1} pixels; {which}; correct only one",
            names.join(", ")
        )
    };
    for (name, error) in &wrong {
        let _ = write!(text, "\n  cameras.{name}: {}", cause(error));
    }
    Some(text)
}

/// Returns the likely cause in words, and what to do.
fn cause(error: &LikelyError) -> String {
    match error.cause {
        CameraErrorCause::Pose { .. } => {
            "likely cause: its pose; calibrate the rig again".to_owned()
        }
        CameraErrorCause::FocalLength { ratio } => format!(
            "likely cause: its focal length, {:.1} % too {}; calibrate it again",
            100.0 * (1.0 / ratio - 1.0).abs(),
            if ratio > 1.0 { "short" } else { "long" }
        ),
        CameraErrorCause::Clock {
            correction_s,
            sigma_s,
        } => format!(
            "likely cause: its clock; add {:+.0} ± {:.0} ms to its time_offset_s, or measure it with `pardalis calibrate time`",
            1000.0 * correction_s,
            1000.0 * sigma_s
        ),
    }
}

/// Returns how far a camera agrees with the others, for `summary.json`; `None` without comparisons.
pub(crate) fn entry(tracker: &Tracker, camera: usize) -> Option<Value> {
    let agreement = tracker.camera_agreement()[camera];
    let error = agreement.likely_error;
    let error = error.map(|error| {
        let mut entry = match error.cause {
            CameraErrorCause::Pose { offset_px } => {
                json!({"cause": "pose", "offset_px": offset_px})
            }
            CameraErrorCause::FocalLength { ratio } => {
                json!({"cause": "focal_length", "ratio": ratio})
            }
            CameraErrorCause::Clock {
                correction_s,
                sigma_s,
            } => {
                json!({"cause": "clock", "correction_s": correction_s, "sigma_s": sigma_s})
            }
        };
        entry["explained_px"] = json!(error.explained_px);
        entry["explained_share"] = json!(error.explained_share);
        entry
    });
    (agreement.comparisons > 0).then(|| {
        json!({
            "comparisons": agreement.comparisons,
            "residual_px": agreement.residual_px,
            "likely_error": error,
        })
    })
}
