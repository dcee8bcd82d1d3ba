//! Cameras that disagree with the others, and why.

use std::fmt::Write as _;

use pardalis::Tracker;
use pardalis::tracker::{CameraAgreement, CameraErrorCause, LikelyError};
use pardalis_scene::Scene;
use serde_json::{Value, json};

/// From this on cameras disagree even if nothing explains it, pixels. Experiment: below 0.4 if all are right, in experiments/camera-error and
/// in others.
const UNEXPLAINED_PX: f64 = 1.0;
/// Fewer comparisons say nothing. Hand-set: a second, as for errors that are explained.
const MIN_COMPARISONS: usize = 25;
/// Fewer frames in which a camera and others show the target say nothing. Hand-set: two seconds.
const MIN_SIGHTINGS: usize = 50;
/// Below this share of them the cameras could hardly be compared. Hand-set: above 0.7 if all are right and nothing hides the target for long, and below 0.25 with clocks that are
/// wrong by more than the time between frames.
const MIN_COMPARED_SHARE: f64 = 1.0 / 3.0;
/// Below this share a single camera of several could hardly be compared either. Hand-set: one that something hides now and then is above it, and one of three whose pose is
/// wrong by more than the target's width is compared by chance only.
const MIN_COMPARED_SHARE_OF_ONE: f64 = 0.1;

/// Returns a warning if cameras disagree: by how much, which may be wrong, and what to do.
pub(crate) fn warning(scene: &Scene, tracker: &Tracker) -> Option<String> {
    let names = scene.cameras.iter().map(|camera| &*camera.name);
    let agreements: Vec<_> = names.zip(tracker.camera_agreement()).collect();
    explained(&agreements)
        .or_else(|| unexplained(&agreements))
        .or_else(|| uncompared(&agreements))
}

/// Returns the warning that names the likely errors.
fn explained(agreements: &[(&str, CameraAgreement)]) -> Option<String> {
    let compared = agreements
        .iter()
        .filter(|(_, camera)| camera.comparisons > 0);
    let compared = compared.count();
    let mut wrong: Vec<(&str, LikelyError)> = (agreements.iter())
        .filter_map(|(name, agreement)| Some((*name, agreement.likely_error?)))
        .collect();
    wrong.sort_by(|a, b| b.1.explained_px.total_cmp(&a.1.explained_px));
    let (name, error) = wrong.first()?;
    let px = error.explained_px;
    let mut text = if wrong.len() == 1 {
        format!("warning: cameras.{name}: disagrees with the other cameras by {px:.1} pixels")
    } else {
        let which = if compared == 2 {
            "with two cameras either may be wrong"
        } else {
            "any of them may be wrong"
        };
        format!(
            "warning: {}: disagree by {px:.1} pixels; {which}; correct only one",
            listed(wrong.iter().map(|(name, _)| *name))
        )
    };
    let is_clock = |error: &LikelyError| matches!(error.cause, CameraErrorCause::Clock { .. });
    if wrong.len() > 2 && wrong.iter().all(|(_, error)| is_clock(error)) {
        // Each is off from the mean of others that are off, too: no amount is right.
        return Some(format!(
            "warning: {}: disagree by {px:.1} pixels\n  likely cause: the clock of one or more of them; measure the clocks with `pardalis calibrate time`",
            listed(wrong.iter().map(|(name, _)| *name))
        ));
    }
    for (name, error) in &wrong {
        let _ = write!(text, "\n  cameras.{name}: {}", cause(error));
    }
    Some(text)
}

/// Returns the warning of cameras that disagree although no error of one of them explains it.
fn unexplained(agreements: &[(&str, CameraAgreement)]) -> Option<String> {
    let is_off = |agreement: &CameraAgreement| {
        agreement.residual_px >= UNEXPLAINED_PX && agreement.comparisons >= MIN_COMPARISONS
    };
    let off = agreements.iter().filter(|(_, agreement)| is_off(agreement));
    let px = off.clone().map(|(_, agreement)| agreement.residual_px);
    let px = px.reduce(f64::max)?;
    Some(format!(
        "warning: {}: off by up to {px:.1} pixels from where other cameras show the target, and neither pose, focal length nor clock alone explains \
         it: check all of them, and in annotated frames (--annotate) whether all cameras show the same thing",
        listed(off.map(|(name, _)| *name))
    ))
}

/// Returns the warning of cameras that show the target and could hardly be compared: what they show is too far apart to be sure that it is the same.
fn uncompared(agreements: &[(&str, CameraAgreement)]) -> Option<String> {
    let below = |min_share: f64| {
        let is_below = move |(_, agreement): &&(&str, CameraAgreement)| {
            agreement.sightings >= MIN_SIGHTINGS
                && (agreement.comparisons as f64) < min_share * agreement.sightings as f64
        };
        agreements.iter().filter(is_below)
    };
    // One alone may be one that is often hidden, unless it is hardly ever compared.
    let cameras = below(MIN_COMPARED_SHARE);
    if cameras.clone().count() < 2 && below(MIN_COMPARED_SHARE_OF_ONE).next().is_none() {
        return None;
    }
    let [mut compared, mut sightings] = [0; 2];
    for (_, agreement) in cameras.clone() {
        compared += agreement.comparisons;
        sightings += agreement.sightings;
    }
    Some(format!(
        "warning: {}: could be compared with other cameras in only {compared} of the {sightings} frames that show the target: in the others it was partly hidden, or \
         not at one place for all cameras; if nothing hid it, check clocks (`pardalis calibrate time`), poses, and in annotated frames (--annotate) \
         whether all cameras show the same thing",
        listed(cameras.map(|(name, _)| *name))
    ))
}

/// Lists cameras by their keys.
fn listed<'a>(names: impl Iterator<Item = &'a str>) -> String {
    let keys = names.map(|name| format!("cameras.{name}"));
    keys.collect::<Vec<_>>().join(", ")
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
    (agreement.sightings > 0).then(|| {
        json!({
            "comparisons": agreement.comparisons,
            "sightings": agreement.sightings,
            "residual_px": agreement.residual_px,
            "likely_error": error,
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cameras_that_disagree_for_no_known_reason_are_named() {
        let camera = |residual_px: f64, comparisons: usize| CameraAgreement {
            comparisons,
            sightings: 100,
            residual_px,
            likely_error: None,
        };
        let right = [("left", camera(0.4, 100)), ("right", camera(20.0, 24))];
        assert_eq!(unexplained(&right), None);
        let wrong = [
            ("left", camera(9.96, 25)),
            ("top", camera(0.9, 70)),
            ("right", camera(1.2, 60)),
        ];
        let warning = unexplained(&wrong).unwrap();
        assert!(
            warning.starts_with("warning: cameras.left, cameras.right: off by up to 10.0 pixels from where other cameras"),
            "{warning}"
        );
    }

    #[test]
    fn of_several_clocks_that_may_be_wrong_no_amount_is_named() {
        let camera = |cause: CameraErrorCause| CameraAgreement {
            comparisons: 100,
            sightings: 100,
            residual_px: 4.0,
            likely_error: Some(LikelyError {
                cause,
                explained_px: 3.5,
                explained_share: 0.9,
            }),
        };
        let clock = |correction_s: f64| {
            let sigma_s = 0.003;
            camera(CameraErrorCause::Clock {
                correction_s,
                sigma_s,
            })
        };
        let [left, mid, right] = [("left", 0.03), ("mid", -0.034), ("right", 0.035)]
            .map(|(name, correction_s)| (name, clock(correction_s)));
        let warning = explained(&[left, mid, right]).unwrap();
        let advice = "disagree by 3.5 pixels\n  likely cause: the clock of one or more of them; measure the clocks with `pardalis calibrate time`";
        assert!(warning.ends_with(advice), "{warning}");
        let warning = explained(&[left, mid]).unwrap();
        assert!(warning.contains("add -34 ± 3 ms"), "{warning}");
        let offset_px = [3.0, 0.0];
        let pose = ("top", camera(CameraErrorCause::Pose { offset_px }));
        let warning = explained(&[left, mid, pose]).unwrap();
        assert!(warning.contains("add -34 ± 3 ms"), "{warning}");
    }

    #[test]
    fn cameras_that_hardly_could_be_compared_are_named() {
        let camera = |comparisons: usize, sightings: usize| CameraAgreement {
            comparisons,
            sightings,
            residual_px: 1.2,
            likely_error: None,
        };
        let alone = ("mid", camera(1, 111));
        let warning = uncompared(&[("left", camera(75, 119)), alone]).unwrap();
        assert!(
            warning.starts_with(
                "warning: cameras.mid: could be compared with other cameras in only 1 of the 111 frames that show"
            ),
            "{warning}"
        );
        let off = ("left", camera(11, 68));
        for other in [camera(67, 68), camera(11, 33), camera(3, 8)] {
            assert_eq!(uncompared(&[off, ("right", other)]), None);
        }
        let warning = uncompared(&[off, ("top", camera(90, 100)), ("right", camera(8, 67))]);
        let warning = warning.unwrap();
        assert!(
            warning.starts_with("warning: cameras.left, cameras.right: could be compared with other cameras in only 19 of the 135 frames that show"),
            "{warning}"
        );
    }
}
