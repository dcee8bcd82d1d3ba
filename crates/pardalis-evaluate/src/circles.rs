//! Tracks against circles that somebody drew around an object in images: for recordings whose positions nobody measured.

use serde::Serialize;

use crate::distribution::{Distribution, distribution, mean};

/// Within this many radii of a circle's middle an outline is on the object. Derivation: its own middle then lies in the circle.
const ON_WITHIN_RADII: f64 = 1.0;

/// Beyond this many radii it is on something else. Hand-set: half hidden objects and labels that are a little off lie in between.
const ELSEWHERE_BEYOND_RADII: f64 = 1.5;

/// A circle around an object in one image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Circle {
    /// Its middle in pixels.
    pub center_px: [f64; 2],
    /// Its radius in pixels, above 0.
    pub radius_px: f64,
    /// The share of the object that is in view, 0 to 1; `None` if that is not known.
    pub visible_fraction: Option<f64>,
}

/// Where a camera shows a target that is tracked.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ProjectedOutline {
    /// The middle of the area within its outline in pixels; infinite if the camera does not show it.
    pub center_px: [f64; 2],
    /// The radius of a circle with that area, in pixels.
    pub radius_px: f64,
    /// 0 to 1; `None` if the track has none.
    pub confidence: Option<f64>,
}

/// One image that somebody judged.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CircleSample {
    /// `None` if the object is not in view.
    pub circle: Option<Circle>,
    /// `None` if the target is not tracked there.
    pub outline: Option<ProjectedOutline>,
}

/// What a track says of an object in one image.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Sighting {
    /// The target is tracked within one radius of the circle's middle.
    OnObject,
    /// It is tracked within one and a half radii.
    Beside,
    /// It is tracked farther away, or while the object is not in view.
    Elsewhere,
    /// It is not tracked.
    None,
}

impl CircleSample {
    /// Returns what the track says of the object.
    pub fn sighting(&self) -> Sighting {
        match (&self.circle, &self.outline) {
            (_, None) => Sighting::None,
            (None, Some(_)) => Sighting::Elsewhere,
            (Some(circle), Some(outline)) => {
                let away_radii = circle.distance_px(outline) / circle.radius_px;
                if away_radii <= ON_WITHIN_RADII {
                    Sighting::OnObject
                } else if away_radii <= ELSEWHERE_BEYOND_RADII {
                    Sighting::Beside
                } else {
                    Sighting::Elsewhere
                }
            }
        }
    }

    /// Reports whether more than a share of the object is in view. An unknown share counts as all of it.
    pub fn is_visible(&self, visible_over: f64) -> bool {
        let share = |circle: &Circle| circle.visible_fraction.unwrap_or(1.0);
        self.circle
            .as_ref()
            .is_some_and(|circle| share(circle) > visible_over)
    }
}

impl Circle {
    fn distance_px(&self, outline: &ProjectedOutline) -> f64 {
        let [du, dv] = [0, 1].map(|axis| outline.center_px[axis] - self.center_px[axis]);
        libm::hypot(du, dv)
    }
}

/// How well a target follows circles.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct CircleEvaluation {
    /// The images that were judged.
    pub frames: usize,
    /// Those in which the object is visible.
    pub visible_frames: usize,
    /// Those of them in which the target is tracked on the object.
    pub on_object_frames: usize,
    /// Their share of the visible ones; `None` without visible frames.
    pub on_object_share: Option<f64>,
    /// The judged images in which the target is tracked on something else.
    pub elsewhere_frames: usize,
    /// Their share of the judged ones; `None` without frames.
    pub elsewhere_share: Option<f64>,
    /// Distance of the middle of the outline from that of the circle in radii of the circle, in the visible frames on the object; `None` without any.
    pub center_error_radii: Option<Distribution>,
    /// The same in pixels.
    pub center_error_px: Option<Distribution>,
    /// The radius of the outline by that of the circle, in these frames.
    pub radius_ratio: Option<Distribution>,
    /// Mean confidence in all frames on the object; `None` without confidences.
    pub confidence_on_object: Option<f64>,
    /// Mean confidence in the frames on something else.
    pub confidence_elsewhere: Option<f64>,
}

/// Compares a target with circles, of which more than a share must be in view for the object to count as visible.
///
/// ```
/// use pardalis_evaluate::{Circle, CircleSample, ProjectedOutline, evaluate_circles};
///
/// let circle = Circle { center_px: [100.0, 50.0], radius_px: 10.0, visible_fraction: None };
/// let outline = ProjectedOutline { center_px: [102.0, 50.0], radius_px: 9.0, confidence: Some(0.9) };
/// let samples = [
///     CircleSample { circle: Some(circle), outline: Some(outline) },
///     CircleSample { circle: Some(circle), outline: None },
///     CircleSample { circle: None, outline: Some(outline) },
/// ];
/// let evaluation = evaluate_circles(&samples, 0.6);
/// assert_eq!(evaluation.on_object_share, Some(0.5));
/// assert_eq!(evaluation.elsewhere_frames, 1);
/// assert_eq!(evaluation.center_error_radii.unwrap().median, 0.2);
/// ```
pub fn evaluate_circles(samples: &[CircleSample], visible_over: f64) -> CircleEvaluation {
    let visible = || {
        samples
            .iter()
            .filter(|sample| sample.is_visible(visible_over))
    };
    let on_object = |sample: &&CircleSample| sample.sighting() == Sighting::OnObject;
    let confidences = |wanted: Sighting| {
        let of_these = samples.iter().filter(|sample| sample.sighting() == wanted);
        let confidences = of_these.filter_map(|sample| sample.outline?.confidence);
        mean(&confidences.collect::<Vec<_>>())
    };
    let pairs: Vec<(Circle, ProjectedOutline)> = visible()
        .filter(on_object)
        .filter_map(|sample| Some((sample.circle?, sample.outline?)))
        .collect();
    let figures = |figure: fn(&(Circle, ProjectedOutline)) -> f64| {
        let values: Vec<f64> = pairs.iter().map(figure).collect();
        (!values.is_empty()).then(|| distribution(values))
    };
    let elsewhere = |sample: &&CircleSample| sample.sighting() == Sighting::Elsewhere;
    let elsewhere_frames = samples.iter().filter(elsewhere).count();
    let visible_frames = visible().count();
    let share = |count: usize, of: usize| (of > 0).then(|| count as f64 / of as f64);
    CircleEvaluation {
        frames: samples.len(),
        visible_frames,
        on_object_frames: pairs.len(),
        on_object_share: share(pairs.len(), visible_frames),
        elsewhere_frames,
        elsewhere_share: share(elsewhere_frames, samples.len()),
        center_error_radii: figures(|(circle, outline)| {
            circle.distance_px(outline) / circle.radius_px
        }),
        center_error_px: figures(|(circle, outline)| circle.distance_px(outline)),
        radius_ratio: figures(|(circle, outline)| outline.radius_px / circle.radius_px),
        confidence_on_object: confidences(Sighting::OnObject),
        confidence_elsewhere: confidences(Sighting::Elsewhere),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample(visible_fraction: Option<f64>, off_px: Option<f64>) -> CircleSample {
        CircleSample {
            circle: Some(Circle {
                center_px: [100.0, 50.0],
                radius_px: 10.0,
                visible_fraction,
            }),
            outline: off_px.map(|off_px| ProjectedOutline {
                center_px: [100.0, 50.0 + off_px],
                radius_px: 11.0,
                confidence: Some(0.01 * off_px),
            }),
        }
    }

    #[test]
    fn tracks_are_on_the_object_beside_it_or_elsewhere() {
        let absent = CircleSample {
            circle: None,
            ..sample(None, Some(0.0))
        };
        let unseen = |circle| CircleSample {
            circle,
            outline: sample(None, Some(f64::INFINITY)).outline,
        };
        for (sample, expected) in [
            (sample(None, Some(10.0)), Sighting::OnObject),
            (sample(None, Some(10.1)), Sighting::Beside),
            (sample(None, Some(-15.0)), Sighting::Beside),
            (sample(None, Some(15.1)), Sighting::Elsewhere),
            (sample(None, None), Sighting::None),
            (absent, Sighting::Elsewhere),
            (unseen(absent.circle), Sighting::Elsewhere),
            (unseen(sample(None, None).circle), Sighting::Elsewhere),
        ] {
            assert_eq!(sample.sighting(), expected, "{sample:?}");
        }
    }

    #[test]
    fn only_visible_objects_need_be_followed() {
        let samples = [
            sample(Some(0.6), Some(2.0)),
            sample(Some(0.61), Some(4.0)),
            sample(None, None),
            sample(Some(0.2), Some(20.0)),
        ];
        let evaluation = evaluate_circles(&samples, 0.6);
        assert_eq!((evaluation.frames, evaluation.visible_frames), (4, 2));
        assert_eq!(evaluation.on_object_share, Some(0.5));
        assert_eq!(evaluation.elsewhere_share, Some(0.25));
        assert_eq!(evaluation.center_error_px.unwrap().max, 4.0);
        assert!((evaluation.center_error_radii.unwrap().mean - 0.4).abs() < 1e-12);
        assert!((evaluation.radius_ratio.unwrap().median - 1.1).abs() < 1e-12);
        // Those of hidden objects, too.
        assert!((evaluation.confidence_on_object.unwrap() - 0.03).abs() < 1e-12);
        assert!((evaluation.confidence_elsewhere.unwrap() - 0.2).abs() < 1e-12);
        let nothing = evaluate_circles(&[], 0.6);
        assert_eq!(
            (nothing.on_object_share, nothing.center_error_px),
            (None, None)
        );
    }
}
