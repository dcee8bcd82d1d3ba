//! Detections of a target by each camera on its own, in each frame on its own.

use anyhow::Result;
use indicatif::{ProgressBar, ProgressStyle};
use pardalis::color::ColorModel;
use pardalis::shape::{Shape, Stance};
use pardalis::tracker::{
    BodySettings, Candidate, DetectedSettings, PASSES_SIGMA_M, SizeTolerance, Verdict,
};
use pardalis::view::View;
use pardalis::{FrameSet, Tracker};
use pardalis_calibrate::{Detection, DetectionFrame};
use pardalis_scene::BodyConfig;
use rayon::prelude::*;

use crate::output::warn;
use crate::sight::Sight;
use crate::source::{Delivery, Source};

/// Returns what each camera detects of a body of this shape in each frame.
pub(in crate::commands::calibrate) fn detect(
    sources: &mut [Source],
    views: &[View],
    shape: &Shape,
    settings: &DetectedSettings,
) -> Result<Vec<Vec<DetectionFrame>>> {
    let counts = sources.iter().map(Source::frame_count);
    let bar = progress_bar(counts.sum());
    let of_camera = |(source, view): (&mut Source, &View)| {
        let mut setup = Tracker::builder();
        let camera = setup.camera(view.clone());
        let target = setup.target(settings.clone());
        let mut tracker = setup.build()?;
        let mut frames = Vec::new();
        for delivery in source {
            bar.inc(1);
            let frame = match delivery? {
                Delivery::Frame { frame, .. } => frame,
                Delivery::Broken(error) => {
                    warn(format!("{error:#}; the frame is ignored"));
                    continue;
                }
            };
            let time_s = frame.time_s();
            // Without those before: where a target is predicted says something of where it is found.
            tracker.locate(&FrameSet::of(camera, frame), &[None], &PASSES_SIGMA_M)?;
            let candidates = tracker.candidates(target)?.flatten();
            let detections = candidates.filter_map(|candidate| detection(view, shape, candidate));
            frames.push(DetectionFrame {
                time_s,
                detections: detections.collect(),
            });
        }
        // A source may deliver frames out of order.
        frames.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
        Ok(frames)
    };
    let cameras: Vec<Result<_>> = sources.par_iter_mut().zip(views).map(of_camera).collect();
    bar.finish_and_clear();
    // Reports the error of the first camera, whichever failed first in time.
    cameras.into_iter().collect()
}

/// Returns the settings with which a single camera detects the body, also one that the scene gives a start.
pub(in crate::commands::calibrate) fn settings(
    body: &BodyConfig,
    colors: &ColorModel,
) -> DetectedSettings {
    let mut settings = match body.settings(Some(colors.clone()), None) {
        Ok(BodySettings::Detected(settings)) => settings,
        _ => DetectedSettings::new(body.shape, colors.clone()),
    };
    if settings.size == SizeTolerance::Unknown {
        // One camera does not tell size from distance, and the size matters little.
        settings.size = SizeTolerance::default();
    }
    settings
}

/// Returns a candidate that may be the target as its camera shows it.
fn detection(view: &View, shape: &Shape, candidate: &Candidate) -> Option<Detection> {
    let position_m = candidate
        .position_m
        .filter(|_| candidate.verdict >= Verdict::Rival)?;
    let sight = Sight::of(view, shape, position_m, Stance::scaled(candidate.scale()))?;
    Some(Detection {
        pixel: sight.pixel,
        radius_px: sight.radius_px,
        distance_m: sight.distance_m,
    })
}

/// Creates a progress bar on a terminal; hidden elsewhere.
fn progress_bar(frames: Option<usize>) -> ProgressBar {
    let (bar, template) = match frames {
        Some(frames) => (
            ProgressBar::new(frames as u64),
            "detecting {bar:32} {pos}/{len} frames, {eta} left",
        ),
        None => (ProgressBar::no_length(), "detecting {spinner} {pos} frames"),
    };
    match ProgressStyle::with_template(template) {
        Ok(style) => bar.with_style(style),
        Err(_) => bar,
    }
}
