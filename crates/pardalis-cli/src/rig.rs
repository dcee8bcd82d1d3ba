//! Checks before tracking that the cameras of one scene can have recorded the same events at the same time.

use std::path::Path;

use pardalis_scene::{CameraConfig, Input, Problem};

use crate::source::{Source, TimeSpan};

/// If the intervals of two cameras differ by this factor or more, their time stamps have different units.
const OTHER_UNIT: f64 = 50.0;

/// Largest distance between the time spans of single images, in seconds.
const APART_S: f64 = 1.0;

/// A camera of the scene with its source, if the source could be opened.
pub(crate) type Opened<'a> = (&'a CameraConfig, Option<&'a Source>);

/// Returns the problems of each camera with those before it; a camera that has a problem itself causes no further ones.
pub(crate) fn problems(cameras: &[Opened], folder: &Path) -> Vec<Problem> {
    let mut sound: Vec<&Opened> = Vec::new();
    let mut problems = Vec::new();
    for later in cameras {
        let message = sound.iter().find_map(|earlier| {
            same_input(earlier.0, later.0, folder).or_else(|| {
                let earlier = (earlier.0, earlier.1?);
                let later = (later.0, later.1?);
                live_and_recorded(earlier, later)
                    .or_else(|| other_frame_count(earlier, later))
                    .or_else(|| other_clock(earlier, later))
            })
        });
        match message {
            Some(message) => problems.push(later.0.input.place().problem(message)),
            None => sound.push(later),
        }
    }
    problems
}

/// Checks for two cameras with the same folder, file or device.
fn same_input(a: &CameraConfig, b: &CameraConfig, folder: &Path) -> Option<String> {
    let real = |camera: &CameraConfig| {
        let path = folder.join(&camera.input.place().value);
        path.canonicalize().unwrap_or(path)
    };
    let settings = |camera: &CameraConfig| match &camera.input {
        Input::Images { .. } | Input::Mcap { .. } | Input::Given(_) => None,
        Input::Video { video, .. } => Some(video.settings.clone()),
    };
    let topic = |camera: &CameraConfig| match &camera.input {
        Input::Mcap { topic, .. } => topic.clone(),
        _ => None,
    };
    let is_same = real(a) == real(b) && settings(a) == settings(b) && topic(a) == topic(b);
    is_same.then(|| {
        format!(
            "cameras {} and {} read the same frames; give each camera its own",
            a.name, b.name
        )
    })
}

type Camera<'a> = (&'a CameraConfig, &'a Source);

fn live_and_recorded((a, source_a): Camera, (b, source_b): Camera) -> Option<String> {
    let word = |source: &Source| {
        if source.is_live() { "live" } else { "recorded" }
    };
    (source_a.is_live() != source_b.is_live()).then(|| {
        format!(
            "camera {} is {}, {} is {}; cameras must be all live or all recorded",
            a.name,
            word(source_a),
            b.name,
            word(source_b)
        )
    })
}

/// Checks the numbers of images; with `fps` nothing states which images a camera missed.
fn other_frame_count((a, source_a): Camera, (b, source_b): Camera) -> Option<String> {
    let fps = |camera: &CameraConfig| match camera.input {
        Input::Images { fps, .. } => fps,
        Input::Video { .. } | Input::Mcap { .. } | Input::Given(_) => None,
    };
    let (fps_a, fps_b) = (fps(a)?, fps(b)?);
    let (count_a, count_b) = (source_a.frame_count()?, source_b.frame_count()?);
    let (length_a_s, length_b_s) = (count_a as f64 / fps_a, count_b as f64 / fps_b);
    let allowed_s = if fps_a == fps_b {
        0.0
    } else {
        (1.0 / fps_a).max(1.0 / fps_b)
    };
    ((length_a_s - length_b_s).abs() > allowed_s).then(|| {
        format!(
            "camera {} has {count_a} images, {length_a_s} s at {fps_a} per second, and {} has {count_b}, {length_b_s} s at {fps_b} per second; \
             with fps it is unknown which images a camera missed: put times.csv next to the images and remove fps, or shorten the longer one with frame_limit",
            a.name, b.name
        )
    })
}

/// Checks for time stamps of different units or clocks.
fn other_clock((a, source_a): Camera, (b, source_b): Camera) -> Option<String> {
    let (span_a, span_b) = (source_a.span()?, source_b.span()?);
    let describe = |camera: &CameraConfig, span: TimeSpan| {
        let step = span
            .step_s
            .map_or_else(String::new, |s| format!(", {s:.6} s apart"));
        format!(
            "camera {}'s time stamps run from {} to {} s{step}",
            camera.name, span.first_s, span.last_s
        )
    };
    let both = format!("{}, {}", describe(a, span_a), describe(b, span_b));
    if let (Some(step_a_s), Some(step_b_s)) = (span_a.step_s, span_b.step_s)
        && step_a_s.min(step_b_s) > 0.0
        && (step_a_s / step_b_s).max(step_b_s / step_a_s) > OTHER_UNIT
    {
        let coarse = if step_a_s > step_b_s { a } else { b };
        let unit = match (step_a_s / step_b_s).max(step_b_s / step_a_s) {
            200.0..2e4 => "milliseconds",
            2e5..2e7 => "microseconds",
            2e8..2e10 => "nanoseconds",
            _ => "another unit",
        };
        return Some(format!(
            "{both}: those of {} look like {unit}; time stamps must be in seconds",
            coarse.name
        ));
    }
    let apart_s = (span_a.first_s - span_b.last_s).max(span_b.first_s - span_a.last_s);
    let steps_s = [span_a.step_s, span_b.step_s].into_iter().flatten();
    let step_s = steps_s.reduce(f64::max).unwrap_or(APART_S);
    (apart_s > step_s).then(|| {
        format!(
            "{both}: they have no time in common, so their clocks differ (one may count from 1970, the other from its start); \
             record both with the same clock, or set time_offset_s (with {} for {} both would begin at the same time)",
            span_a.first_s - span_b.first_s + b.time_offset_s,
            b.name
        )
    })
}
