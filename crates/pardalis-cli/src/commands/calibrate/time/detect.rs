//! Detections of a target by each camera on its own, in each frame on its own.

use std::panic::resume_unwind;
use std::task::Poll;
use std::thread;
use std::time::Duration;

use anyhow::{Context as _, Result};
use indicatif::{ProgressBar, ProgressStyle};
use pardalis::color::ColorModel;
use pardalis::shape::{Shape, Stance};
use pardalis::tracker::{
    BodySettings, Candidate, DetectedSettings, PASSES_SIGMA_M, SizeTolerance, Verdict,
};
use pardalis::view::View;
use pardalis::{Frame, FrameSet, Tracker};
use pardalis_calibrate::{Detection, DetectionFrame};
use pardalis_scene::BodyConfig;

use crate::interrupt::Stop;
use crate::output::warn;
use crate::sight::Sight;
use crate::source::{Delivery, Source};
use crate::timing::Stopwatch;
use crate::user_error::user_error;

/// How often a live camera is asked for a frame.
const POLL: Duration = Duration::from_millis(3);

/// When detection ends before the frames do.
#[derive(Debug, Clone, Default)]
pub(in crate::commands) struct Until {
    /// How long live cameras are watched, in seconds.
    pub(in crate::commands) duration_s: Option<f64>,
    pub(in crate::commands) stop: Stop,
}

/// Returns what each camera detects of a body of this shape in each frame. Calls `seen` with each frame and the number of its camera.
///
/// Each camera has a thread of its own: live ones do not wait for each other.
pub(in crate::commands::calibrate) fn detect(
    sources: &mut [Source],
    views: &[View],
    (shape, settings): (&Shape, &DetectedSettings),
    until: &Until,
    seen: &(impl Fn(usize, &Frame, &[Detection]) + Sync),
) -> Result<Vec<Vec<DetectionFrame>>> {
    if until.duration_s.is_none()
        && let Some(live) = sources.iter().find(|source| source.is_live())
    {
        return Err(user_error!(
            "{}: is live and has no end; give --duration SECONDS",
            live.describe().input
        ));
    }
    let counts = sources.iter().map(Source::frame_count);
    let bar = progress_bar(counts.sum());
    let of_camera = &|number: usize, source: &mut Source, view: &View| {
        let mut setup = Tracker::builder();
        let camera = setup.camera(view.clone());
        let target = setup.target(settings.clone());
        let mut tracker = setup.build()?;
        let mut frames = Vec::new();
        let watch = Stopwatch::start();
        while let Some(delivery) = next(source, until, &watch) {
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
            tracker.locate(
                &FrameSet::of(camera, frame.clone()),
                &[None],
                &PASSES_SIGMA_M,
            )?;
            let candidates = tracker.candidates(target)?.flatten();
            let detections: Vec<Detection> = candidates
                .filter_map(|candidate| detection(view, shape, candidate))
                .collect();
            seen(number, &frame, &detections);
            frames.push(DetectionFrame { time_s, detections });
        }
        // A source may deliver frames out of order.
        frames.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
        Ok(frames)
    };
    let cameras: Vec<Result<_>> = thread::scope(|scope| {
        let cameras = sources.iter_mut().zip(views).enumerate();
        let start = |(number, (source, view))| {
            let run = move || of_camera(number, source, view);
            thread::Builder::new().spawn_scoped(scope, run)
        };
        let threads: Vec<_> = cameras.map(start).collect();
        let ended = threads.into_iter().map(|thread| {
            let thread = thread.context("no further thread can be started; use fewer cameras")?;
            thread.join().unwrap_or_else(|panic| resume_unwind(panic))
        });
        ended.collect()
    });
    bar.finish_and_clear();
    // Reports the error of the first camera, whichever failed first in time.
    cameras.into_iter().collect()
}

/// Returns the next delivery, of a live camera the newest; none if this is the end.
fn next(source: &mut Source, until: &Until, watch: &Stopwatch) -> Option<Result<Delivery>> {
    let mut newest = None;
    loop {
        if until.stop.is_requested() {
            return None;
        }
        if !source.is_live() {
            return source.next();
        }
        if until
            .duration_s
            .is_some_and(|end_s| watch.elapsed_s() >= end_s)
        {
            return None;
        }
        match source.poll_next() {
            Poll::Ready(Some(Ok(frame @ Delivery::Frame { .. }))) => newest = Some(Ok(frame)),
            Poll::Ready(Some(Err(error))) => return Some(Err(error)),
            Poll::Ready(other) => return newest.or(other),
            Poll::Pending if newest.is_some() => return newest,
            Poll::Pending => thread::sleep(POLL),
        }
    }
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
