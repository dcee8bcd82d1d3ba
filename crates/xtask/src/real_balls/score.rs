//! Compares circles in the image with the hand-checked circles of a clip.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::{Context, Result};
use serde::Deserialize;

/// A ball counts as visible from this share of its disc on.
const VISIBLE: f64 = 0.6;

/// Beyond this many true radii an estimate counts as something else than the ball.
const WRONG_BEYOND_RADII: f64 = 1.5;

/// A true circle in pixels of the clip's full size.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Circle {
    pub(crate) u_px: f64,
    pub(crate) v_px: f64,
    pub(crate) radius_px: f64,
    /// The share of the disc in view.
    pub(crate) visible: f64,
}

/// An estimate in state `tracking`, in pixels of the clip's full size.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Estimate {
    /// The projection of the sphere's centre.
    pub(crate) centre_px: [f64; 2],
    /// The middle of the outline's ellipse in the image.
    pub(crate) image_centre_px: [f64; 2],
    /// The radius that the outline would have with the sphere turned onto the optical axis.
    pub(crate) radius_px: f64,
    /// The radius of a circle with the area of the outline's ellipse.
    pub(crate) image_radius_px: f64,
    /// `None` for a tracker without confidence.
    pub(crate) confidence: Option<f64>,
}

/// The judged frames of a clip with the true circle; `None` where the ball is absent or wholly hidden.
pub(crate) type Truth = BTreeMap<u32, Option<Circle>>;

#[derive(Deserialize)]
struct Row {
    frame: u32,
    u_px: Option<f64>,
    v_px: Option<f64>,
    radius_px: Option<f64>,
    visible_fraction: Option<f64>,
}

/// Reads `truth.csv`. Rows without `visible_fraction` could not be judged and are skipped.
pub(crate) fn read_truth(path: &Path) -> Result<Truth> {
    let mut truth = Truth::new();
    let mut reader = csv::Reader::from_path(path).with_context(|| path.display().to_string())?;
    for row in reader.deserialize() {
        let row: Row = row.with_context(|| path.display().to_string())?;
        let Some(visible) = row.visible_fraction else {
            continue;
        };
        let circle = match (row.u_px, row.v_px, row.radius_px) {
            (Some(u_px), Some(v_px), Some(radius_px)) if visible > 0.0 => Some(Circle {
                u_px,
                v_px,
                radius_px,
                visible,
            }),
            _ => None,
        };
        truth.insert(row.frame, circle);
    }
    Ok(truth)
}

/// The figures of a run in the order of the record's columns; `None` where nothing was measured.
pub(crate) type Figures = Vec<(&'static str, Option<f64>)>;

/// Scores the estimates of a run.
///
/// An estimate within one true radius of the true centre is on the ball; one beyond 1.5 radii, or while no ball is in
/// view, is wrong. Centre errors and radii are those of estimates on balls of which at least 60 % are visible.
pub(crate) fn score(truth: &Truth, estimates: &BTreeMap<u32, Estimate>) -> Figures {
    let is_visible = |circle: &Circle| circle.visible >= VISIBLE;
    let visible: Vec<u32> = truth
        .iter()
        .filter(|(_, circle)| circle.as_ref().is_some_and(is_visible))
        .map(|(&frame, _)| frame)
        .collect();
    let (mut right, mut wrong) = (Vec::new(), Vec::new());
    let mut wrong_frames = 0;
    let (mut centre, mut image_centre) = (Vec::new(), Vec::new());
    let (mut radius, mut image_radius) = (Vec::new(), Vec::new());
    let mut first_right = None;
    for (frame, circle) in truth {
        let Some(estimate) = estimates.get(frame) else {
            continue;
        };
        let Some(circle) = circle else {
            wrong_frames += 1;
            wrong.extend(estimate.confidence);
            continue;
        };
        let error_radii = |[u_px, v_px]: [f64; 2]| {
            (u_px - circle.u_px).hypot(v_px - circle.v_px) / circle.radius_px
        };
        let error = error_radii(estimate.centre_px);
        if error > WRONG_BEYOND_RADII {
            wrong_frames += 1;
            wrong.extend(estimate.confidence);
        } else if error <= 1.0 {
            right.extend(estimate.confidence);
            first_right = first_right.or(Some(*frame));
            if is_visible(circle) {
                centre.push(error);
                image_centre.push(error_radii(estimate.image_centre_px));
                radius.push(estimate.radius_px / circle.radius_px);
                image_radius.push(estimate.image_radius_px / circle.radius_px);
            }
        }
    }
    let share = |count: usize, of: usize| (of > 0).then(|| count as f64 / of as f64);
    let frames_to_find = first_right
        .zip(visible.first())
        .map(|(found, &first)| f64::from(found.saturating_sub(first)));
    vec![
        ("judged_frames", Some(truth.len() as f64)),
        ("visible_frames", Some(visible.len() as f64)),
        ("on_ball_share", share(centre.len(), visible.len())),
        ("wrong_share", share(wrong_frames, truth.len())),
        ("centre_error_radii", percentile(&centre, 50.0)),
        ("centre_error_p95_radii", percentile(&centre, 95.0)),
        ("image_centre_error_radii", percentile(&image_centre, 50.0)),
        ("radius_ratio", percentile(&radius, 50.0)),
        ("image_radius_ratio", percentile(&image_radius, 50.0)),
        ("image_radius_ratio_p5", percentile(&image_radius, 5.0)),
        ("image_radius_ratio_p95", percentile(&image_radius, 95.0)),
        ("frames_to_find", frames_to_find),
        ("confidence_right", mean(&right)),
        ("confidence_wrong", mean(&wrong)),
    ]
}

/// The percentile of a sample, interpolated linearly; `None` of an empty one.
fn percentile(values: &[f64], percent: f64) -> Option<f64> {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let last = sorted.len().checked_sub(1)?;
    let place = last as f64 * percent / 100.0;
    let (low, high) = (sorted[place as usize], sorted[place.ceil() as usize]);
    Some(low + (high - low) * place.fract())
}

fn mean(values: &[f64]) -> Option<f64> {
    (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn estimate(u_px: f64, radius_px: f64) -> Estimate {
        Estimate {
            centre_px: [u_px, 50.0],
            image_centre_px: [u_px + 1.0, 50.0],
            radius_px,
            image_radius_px: 1.1 * radius_px,
            confidence: Some(0.9),
        }
    }

    fn figure(figures: &Figures, name: &str) -> Option<f64> {
        figures.iter().find(|(n, _)| *n == name).unwrap().1
    }

    #[test]
    fn estimates_are_right_wrong_or_in_between() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("truth.csv");
        let rows = "frame,object,u_px,v_px,radius_px,visible_fraction,blur_px\n0,ball,,,,0,\n1,ball,100,50,10,1.0,\n\
                    2,ball,100,50,10,0.9,\n3,ball,100,50,10,0.3,\n4,ball,100,50,10,,\n5,ball,100,50,10,0.6,\n\
                    6,ball,100,50,10,1.0,\n7,ball,100,50,10,1.0,\n";
        std::fs::write(&path, rows).unwrap();
        let truth = read_truth(&path).unwrap();
        assert_eq!(truth.len(), 7, "frame 4 could not be judged");
        let estimates = BTreeMap::from([
            (0, estimate(100.0, 10.0)),
            (2, estimate(102.0, 9.0)),
            (3, estimate(100.0, 5.0)),
            (4, estimate(900.0, 5.0)),
            (5, estimate(104.0, 8.0)),
            (6, estimate(112.0, 8.0)),
            (
                7,
                Estimate {
                    confidence: None,
                    ..estimate(116.0, 8.0)
                },
            ),
        ]);
        let figures = score(&truth, &estimates);
        let is = |name: &str, expected: f64| {
            let measured = figure(&figures, name).unwrap();
            assert!((measured - expected).abs() < 1e-9, "{name}: {measured}");
        };
        is("judged_frames", 7.0);
        is("visible_frames", 5.0);
        is("on_ball_share", 2.0 / 5.0);
        is("wrong_share", 2.0 / 7.0);
        is("centre_error_radii", 0.3);
        is("centre_error_p95_radii", 0.39);
        is("image_centre_error_radii", 0.4);
        is("radius_ratio", 0.85);
        is("image_radius_ratio", 0.935);
        is("frames_to_find", 1.0);
        is("confidence_right", 0.9);
        is("confidence_wrong", 0.9);
    }

    #[test]
    fn nothing_found_has_no_errors() {
        let circle = Circle {
            u_px: 1.0,
            v_px: 2.0,
            radius_px: 3.0,
            visible: 1.0,
        };
        let figures = score(&Truth::from([(0, Some(circle))]), &BTreeMap::new());
        assert_eq!(figure(&figures, "on_ball_share"), Some(0.0));
        assert_eq!(figure(&figures, "centre_error_radii"), None);
        assert_eq!(figure(&figures, "frames_to_find"), None);
        assert_eq!(figure(&figures, "confidence_wrong"), None);
    }
}
