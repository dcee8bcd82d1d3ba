//! The picture of one camera: recorded frames one at a time or played, live ones as they come.

use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::task::Poll;
use std::thread::JoinHandle;
use std::time::Duration;

use anyhow::{Context as _, Result};
use pardalis::Frame;
use pardalis_scene::FrameRange;
use pardalis_studio::Feed;
use serde_json::{Value, json};

use super::replay::Replayed;
use crate::draw::picture::{jpeg_of, picture_of};
use crate::interrupt::Stop;
use crate::source::{Delivery, Source, SourceConfig};
use crate::timing::{Stopwatch, now_s};

/// The shortest time between two pictures of a live camera, in seconds. Hand-set: as many as people see.
const INTERVAL_S: f64 = 0.04;
/// Encoding pictures takes at most this share of the time.
const MAX_ENCODING: f64 = 0.5;
/// The interval between statistics, in seconds.
const TOLD_S: f64 = 0.5;
/// The longest wait between two recorded frames, in seconds.
const MAX_PAUSE_S: f64 = 1.0;
/// How often waits look for new orders.
const POLL: Duration = Duration::from_millis(3);
/// How long a live camera that has failed is left alone before it is opened again.
const RETRY: Duration = Duration::from_secs(2);
/// A live camera that gives no frame for this time, in seconds, is reported as silent. Hand-set: webcams in the dark give five frames per second.
const SILENT_S: f64 = 1.5;
/// A frame was lost if the time since the one before is longer than this multiple of the usual one. Hand-set.
const LOST_INTERVALS: f64 = 1.6;

/// What comes in this time after the first frame says nothing about the rate, seconds: many cameras begin with frames that have waited, all at once. Hand-set.
const BEGINNING_S: f64 = 1.0;

/// Shows the frames of a camera until it is dropped.
#[derive(Debug)]
pub(super) struct Player {
    shared: Arc<Shared>,
    /// The settings of its source, by which changes are recognised.
    config: SourceConfig,
    is_live: bool,
    /// Returns the source of a live camera that was open at the end.
    thread: Option<JoinHandle<Option<Source>>>,
}

#[derive(Debug)]
struct Shared {
    camera: String,
    feed: Feed,
    /// What is drawn over recorded frames.
    replayed: Replayed,
    stop: Stop,
    orders: Mutex<Orders>,
    ordered: Condvar,
    seen: Mutex<Seen>,
}

/// What the page wants to see.
#[derive(Debug)]
struct Orders {
    is_playing: bool,
    /// The number of a recorded frame.
    frame: Option<usize>,
}

/// What was seen of the source.
#[derive(Debug, Default)]
struct Seen {
    size_px: Option<(usize, usize)>,
    frame_count: Option<usize>,
    /// The frame that is shown, with its number.
    shown: Option<(usize, Frame)>,
    error: Option<String>,
}

impl Player {
    /// Shows the frames of a source, which is opened unless it is open already.
    pub(super) fn start(
        camera: &str,
        config: SourceConfig,
        open: Option<Source>,
        (feed, replayed): (&Feed, &Replayed),
    ) -> Result<Self> {
        let is_live = config.is_live();
        let shared = Arc::new(Shared {
            camera: camera.to_owned(),
            feed: feed.clone(),
            replayed: replayed.clone(),
            stop: Stop::default(),
            orders: Mutex::new(Orders {
                is_playing: is_live,
                frame: (!is_live).then_some(0),
            }),
            ordered: Condvar::new(),
            seen: Mutex::default(),
        });
        if let Some(source) = &open {
            shared.see(source);
        }
        let thread = std::thread::Builder::new()
            .name(format!("player of {camera}"))
            .spawn({
                let (shared, config) = (Arc::clone(&shared), config.clone());
                move || {
                    let mut open = open;
                    loop {
                        match shared.play(&config, open.take()) {
                            Ok(source) => return source,
                            Err(error) => shared.fail(format!("{error:#}")),
                        }
                        // A file may come back, too.
                        if shared.is_stopped_after(RETRY) {
                            return None;
                        }
                    }
                }
            })
            .context("no further thread can be started; use fewer cameras")?;
        Ok(Self {
            shared,
            config,
            is_live,
            thread: Some(thread),
        })
    }

    /// Reports whether it shows this source.
    pub(super) fn shows(&self, config: &SourceConfig) -> bool {
        self.config.is_same(config)
    }

    /// Ends it; returns the source of a live camera with its settings, for whoever takes its frames from now on. `None` if it is not open, or if its first
    /// frames matter and are gone.
    pub(super) fn into_source(mut self) -> Option<(SourceConfig, Source)> {
        self.shared.stop.request();
        // A panic has been reported.
        let mut source = self.thread.take()?.join().ok()??;
        source.count_anew();
        let is_whole = self.config.frames == FrameRange::ALL;
        is_whole.then(|| (self.config.clone(), source))
    }

    pub(super) fn is_live(&self) -> bool {
        self.is_live
    }

    /// Returns width and height of the images in pixels, once they are known.
    pub(super) fn size_px(&self) -> Option<(usize, usize)> {
        self.shared.seen().size_px
    }

    /// Returns the number of frames of a recording, once it is known.
    pub(super) fn frame_count(&self) -> Option<usize> {
        self.shared.seen().frame_count
    }

    /// Returns the frame that is shown, with its number.
    pub(super) fn shown(&self) -> Option<(usize, Frame)> {
        self.shared.seen().shown.clone()
    }

    /// Describes the source.
    pub(super) fn about(&self) -> Value {
        let seen = self.shared.seen();
        json!({
            "is_live": self.is_live,
            "size_px": seen.size_px,
            "frame_count": seen.frame_count,
            "error": seen.error,
        })
    }

    /// Plays or pauses, and goes to a recorded frame.
    pub(super) fn order(&self, is_playing: Option<bool>, frame: Option<usize>) {
        let mut orders = self.shared.orders();
        orders.is_playing = is_playing.unwrap_or(orders.is_playing);
        if !self.is_live {
            orders.frame = frame.or(orders.frame);
        }
        drop(orders);
        self.shared.ordered.notify_all();
    }
}

impl Drop for Player {
    fn drop(&mut self) {
        self.shared.stop.request();
        self.shared.ordered.notify_all();
        if let Some(thread) = self.thread.take() {
            // The camera is free once the thread has ended; a panic has been reported.
            let _ = thread.join();
        }
        for topic in ["image", "source"] {
            self.shared
                .feed
                .withdraw(&format!("{topic}/{}", self.shared.camera));
        }
    }
}

/// How the frames of a source come.
#[derive(Debug, Default)]
struct Statistics {
    frames: usize,
    lost: usize,
    broken: usize,
    /// The time stamp and the arrival of the last frame, in seconds.
    last: Option<(f64, f64)>,
    /// The arrival of the first frame, in seconds.
    first_s: Option<f64>,
    /// The usual interval of time stamps in seconds.
    interval_s: Option<f64>,
    /// The least time from a time stamp to the arrival, in seconds. The clocks of cameras begin at any time.
    least_delay_s: Option<f64>,
    /// How much later than that the last frame came, in seconds.
    delay_s: f64,
    told_s: f64,
}

impl Statistics {
    fn add(&mut self, time_s: f64, arrival_s: f64) {
        self.frames += 1;
        let delay_s = arrival_s - time_s;
        let least_s = self
            .least_delay_s
            .map_or(delay_s, |least| least.min(delay_s));
        self.least_delay_s = Some(least_s);
        self.delay_s = delay_s - least_s;
        let has_begun = arrival_s - *self.first_s.get_or_insert(arrival_s) >= BEGINNING_S;
        let last = self
            .last
            .filter(|(last_s, _)| has_begun && *last_s < time_s);
        if let Some((last_s, _)) = last {
            let step_s = time_s - last_s;
            let usual_s = self.interval_s.unwrap_or(step_s);
            if step_s > LOST_INTERVALS * usual_s {
                self.lost += (step_s / usual_s).round() as usize - 1;
            }
            // Follows the rate in about 20 frames, and hardly the gaps.
            let step_s = step_s.min(LOST_INTERVALS * usual_s);
            self.interval_s = Some(usual_s + 0.05 * (step_s - usual_s));
        }
        self.last = Some((time_s, arrival_s));
    }
}

impl Shared {
    fn orders(&self) -> MutexGuard<'_, Orders> {
        self.orders.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn seen(&self) -> MutexGuard<'_, Seen> {
        self.seen.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn see(&self, source: &Source) {
        let mut seen = self.seen();
        seen.size_px = Some(source.size());
        seen.frame_count = source.frame_count();
    }

    /// Says why there is no picture.
    fn fail(&self, error: String) {
        let before = self.seen().error.replace(error);
        self.tell(&Statistics::default(), None);
        if before.is_none() {
            self.feed.show("changed", &json!(self.camera));
        }
    }

    /// Waits for this time, or until the player is stopped. Reports whether it is.
    fn is_stopped_after(&self, time: Duration) -> bool {
        let watch = Stopwatch::start();
        while watch.elapsed_s() < time.as_secs_f64() && !self.stop.is_requested() {
            std::thread::sleep(POLL);
        }
        self.stop.is_requested()
    }

    /// Shows the frames of a source until it is stopped; returns it if it is live.
    fn play(&self, config: &SourceConfig, open: Option<Source>) -> Result<Option<Source>> {
        let source = match open {
            Some(source) => source,
            None => Source::open_until(config, &self.stop)?,
        };
        self.see(&source);
        self.seen().error = None;
        self.feed.show("changed", &json!(self.camera));
        if source.is_live() {
            self.play_live(source).map(Some)
        } else {
            drop(source);
            self.play_recorded(config).map(|()| None)
        }
    }

    /// Takes every frame, and shows some, until it is stopped. Returns the source.
    fn play_live(&self, mut source: Source) -> Result<Source> {
        let mut statistics = Statistics::default();
        let mut next_s = now_s();
        let mut arrived = Stopwatch::start();
        loop {
            if self.stop.is_requested() {
                return Ok(source);
            }
            match source.poll_next() {
                Poll::Pending => std::thread::sleep(POLL),
                Poll::Ready(None) => anyhow::bail!("the stream has ended"),
                Poll::Ready(Some(Err(error))) => return Err(error),
                Poll::Ready(Some(Ok(Delivery::Broken(_)))) => statistics.broken += 1,
                Poll::Ready(Some(Ok(Delivery::Frame { frame, arrival_s }))) => {
                    arrived = Stopwatch::start();
                    statistics.add(frame.time_s(), arrival_s);
                    let is_due = now_s() >= next_s && self.orders().is_playing;
                    if is_due {
                        let watch = Stopwatch::start();
                        self.show(statistics.frames - 1, frame)?;
                        let encoding_s = watch.elapsed_s() / MAX_ENCODING;
                        next_s = now_s() + encoding_s.max(INTERVAL_S);
                    }
                }
            }
            if now_s() > statistics.told_s + TOLD_S {
                statistics.told_s = now_s();
                let silent_s = Some(arrived.elapsed_s()).filter(|silent_s| *silent_s > SILENT_S);
                self.tell(&statistics, silent_s);
            }
        }
    }

    /// Shows the frames that are ordered.
    fn play_recorded(&self, config: &SourceConfig) -> Result<()> {
        let mut opened: Option<(Source, usize)> = None;
        let mut statistics = Statistics::default();
        let mut last_s = None;
        let mut told_playing = false;
        while let Some((is_playing, ordered)) = self.next_order(told_playing) {
            if !is_playing && ordered.is_none() {
                told_playing = self.tell(&statistics, None);
                continue;
            }
            if let Some(number) = ordered {
                let mut config = config.clone();
                config.frames.first += number * config.frames.step;
                config.frames.limit = config
                    .frames
                    .limit
                    .map(|limit| limit.saturating_sub(number).max(1));
                opened = Some((Source::open(&config)?, number));
                last_s = None;
            }
            let Some((source, number)) = &mut opened else {
                continue;
            };
            match source.next() {
                Some(Ok(Delivery::Frame { frame, arrival_s })) => {
                    let time_s = frame.time_s();
                    if let Some(last_s) = last_s.filter(|_| is_playing) {
                        self.wait(time_s - last_s);
                    }
                    last_s = Some(time_s);
                    statistics.add(time_s, arrival_s);
                    self.show(*number, frame)?;
                    *number += 1;
                }
                Some(Ok(Delivery::Broken(_))) => statistics.broken += 1,
                Some(Err(error)) => return Err(error),
                None => self.orders().is_playing = false,
            }
            told_playing = self.tell(&statistics, None);
        }
        Ok(())
    }

    /// Waits until there is something to show, or to tell if it was told that frames are played; `None` if it is stopped.
    fn next_order(&self, told_playing: bool) -> Option<(bool, Option<usize>)> {
        let mut orders = self.orders();
        loop {
            if self.stop.is_requested() {
                return None;
            }
            let frame = orders.frame.take();
            if frame.is_some() || orders.is_playing || told_playing {
                return Some((orders.is_playing, frame));
            }
            // An interrupt wakes nobody.
            let waited = self
                .ordered
                .wait_timeout(orders, Duration::from_millis(200));
            (orders, _) = waited.unwrap_or_else(PoisonError::into_inner);
        }
    }

    /// Waits as long as a recording says, unless something else is ordered.
    fn wait(&self, seconds: f64) {
        let watch = Stopwatch::start();
        let is_disturbed = || {
            let orders = self.orders();
            orders.frame.is_some() || !orders.is_playing || self.stop.is_requested()
        };
        while watch.elapsed_s() < seconds.min(MAX_PAUSE_S) && !is_disturbed() {
            std::thread::sleep(POLL);
        }
    }

    fn show(&self, number: usize, frame: Frame) -> Result<()> {
        let [marks, notes, targets] = self.replayed.at(&self.camera, frame.time_s());
        let about = json!({ "index": number, "time_s": frame.time_s(), "marks": marks, "notes": notes, "targets": targets });
        let jpeg = jpeg_of(&picture_of(&frame))?;
        self.seen().shown = Some((number, frame));
        let topic = format!("image/{}", self.camera);
        self.feed.show_image(&topic, &about, &jpeg);
        Ok(())
    }

    /// Tells how the frames come, and for how many seconds none has come if a camera is silent. Returns whether it told that they are played.
    fn tell(&self, statistics: &Statistics, silent_s: Option<f64>) -> bool {
        let is_playing = self.orders().is_playing;
        let seen = self.seen();
        let value = json!({
            "frame": seen.shown.as_ref().map(|(number, _)| number),
            "frame_count": seen.frame_count,
            "is_playing": is_playing,
            "rate_hz": statistics.interval_s.map(f64::recip),
            "delay_ms": 1e3 * statistics.delay_s,
            "frames": statistics.frames,
            "lost": statistics.lost,
            "broken": statistics.broken,
            "silent_s": silent_s,
            "error": seen.error,
        });
        drop(seen);
        self.feed.show(&format!("source/{}", self.camera), &value);
        is_playing
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gaps_of_time_stamps_are_lost_frames_and_late_arrivals_are_delay() {
        let mut statistics = Statistics::default();
        // Those that have waited come at once, with the times of their arrival.
        for number in 0..10 {
            let waited_s = 0.001 * f64::from(number);
            statistics.add(999.96 + waited_s, 49.96 + waited_s);
        }
        let mut arrival_s = 50.0;
        for number in 0..40 {
            arrival_s = 50.0 + 0.04 * f64::from(number);
            statistics.add(1000.0 + 0.04 * f64::from(number), arrival_s);
        }
        assert_eq!((statistics.frames, statistics.lost), (50, 0));
        assert!(statistics.delay_s.abs() < 1e-9);
        // Three frames are missing, and the next comes 100 ms late.
        statistics.add(1000.0 + 0.04 * 43.0, arrival_s + 4.0 * 0.04 + 0.1);
        assert_eq!((statistics.frames, statistics.lost), (51, 3));
        assert!((statistics.delay_s - 0.1).abs() < 1e-9);
        let rate_hz = 1.0 / statistics.interval_s.unwrap();
        assert!((24.0..26.0).contains(&rate_hz), "{rate_hz}");
    }
}
