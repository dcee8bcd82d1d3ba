//! Live sources: opening them within a limit, and once more after they have failed.

use std::sync::Arc;
use std::sync::mpsc::{RecvTimeoutError, Sender, channel};
use std::thread::JoinHandle;
use std::time::Duration;

use anyhow::{Error, Result};
use pardalis_scene::{VideoInput, WhenBehind};

use super::ffmpeg::{Decode, Process, Programs, name_of, not_allowed};
use super::probed::ProbedStream;
use super::running::Running;
use super::start_thread;
use crate::capture_clock::CaptureClock;
use crate::interrupt::Stop;
use crate::output::{note, warn};
use crate::timing::{Stopwatch, now_s};
use crate::user_error::user_error;

/// How ffmpeg says that nobody listens at an address.
const REFUSED: &str = "Connection refused";

/// How long to wait for the first frame of a live source, in seconds, if the scene does not state it.
const FIRST_FRAME_TIMEOUT_S: f64 = 20.0;

/// How long to retry an address that refuses connections, in seconds. Servers that take a single connection, such as ffmpeg, are started again after each.
const REFUSED_S: f64 = 5.0;

/// How long to wait for a live source before a message appears.
const SILENT_WAIT: Duration = Duration::from_secs(2);
/// How often a wait for a live source looks whether it is to stop.
const STOP_POLL: Duration = Duration::from_millis(50);

/// A camera's clock has been set if it goes back by more than this, in seconds. Frames that are delivered in another order do
/// not differ by so much.
const SET_BACK_S: f64 = 1.0;

/// A camera's clock has been set if a frame is further ahead of this computer's clock than any before by more than this, in
/// seconds. Frames that a slow camera lost while a network held back the others do not look so far ahead.
const SET_FORWARD_S: f64 = 5.0;

/// Number of jumps of a camera's clock that are reported; all are counted.
const NAMED_JUMPS: usize = 3;

/// How long to wait before attempts to open a source again: before the first, long enough for a device to be released, then twice as long each time, up
/// to the second.
const PAUSES: [Duration; 2] = [Duration::from_millis(500), Duration::from_secs(2)];

/// The first frames of a stream have waited, and arrive in a burst. A frame still belongs to the burst if it arrives sooner after the frame before it than this
/// share of the interval between their time stamps.
const BURST_SHARE: f64 = 0.5;

/// A burst is over after this time in any case, in seconds.
const BURST_S: f64 = 2.0;

/// Time stamps continue if they advance like this computer's clock between the frames before and after a failure, up to so
/// many seconds. Otherwise the clock of the source has started anew.
const SAME_CLOCK_S: f64 = 1.0;

/// The first frames after a clock was set may have come late, and those that follow catch up. They have caught up once no frame was quicker by
/// [`QUICKER_S`] for [`SETTLED_S`]. Streams that go on being faster than their time stamps for [`UNSETTLED_S`] are not sent in real time. Frames as quick as
/// the quickest before the clock was set may be rare: they are awaited for [`FOLLOWED_S`]. All in seconds.
const QUICKER_S: f64 = 0.005;
const SETTLED_S: f64 = 1.0;
const UNSETTLED_S: f64 = 10.0;
const FOLLOWED_S: f64 = 60.0;

/// Returns the longest wait for a frame of a live source.
pub(super) fn timeout(video: &VideoInput) -> Duration {
    let timeout_s = video.settings.timeout_s.unwrap_or(FIRST_FRAME_TIMEOUT_S);
    Duration::from_secs_f64(timeout_s)
}

/// Opens a live source, and returns its stream and its size in pixels.
///
/// Errors: those of [`first_of`].
pub(super) fn open(
    programs: &Programs,
    video: &VideoInput,
    stop: &Stop,
) -> Result<(Decode, ProbedStream, (usize, usize))> {
    let input = &*name_of(&video.place);
    let watch = Stopwatch::start();
    let mut is_said = false;
    loop {
        let mut decode = programs.decode_live(video)?;
        match first_of(input, &mut decode, timeout(video), Announce::Waiting, stop) {
            Ok((stream, size_px)) => return Ok((decode, stream, size_px)),
            Err(error) => {
                let is_refused = format!("{error:#}").contains(REFUSED);
                if !is_refused || watch.elapsed_s() >= REFUSED_S || stop.is_requested() {
                    return Err(error);
                }
            }
        }
        if !is_said {
            note(format_args!(
                "nobody listens at {input}; trying for {REFUSED_S} s"
            ));
            is_said = true;
        }
        std::thread::sleep(PAUSES[0]);
    }
}

/// How a live source that has failed is opened again.
pub(super) struct Again {
    programs: Programs,
    video: VideoInput,
    /// How long it is tried.
    limit: Duration,
    clock: SteadyClock,
}

impl Again {
    /// Returns `None` for sources that are not opened again.
    pub(super) fn of(programs: &Programs, video: &VideoInput) -> Option<Self> {
        let limit_s = video.reopen_s();
        (limit_s > 0.0).then(|| Self {
            programs: programs.clone(),
            video: video.clone(),
            limit: Duration::from_secs_f64(limit_s),
            clock: SteadyClock {
                keeps_up: video.when_behind() == WhenBehind::Drop,
                ..SteadyClock::default()
            },
        })
    }

    /// Returns the time of a frame with this time stamp that arrives now, in seconds; `None` for one to be left out. Says so if the camera's clock has been
    /// set.
    pub(super) fn time_s(&mut self, running: &Running, stamp_s: f64) -> Option<f64> {
        let (time_s, jump_s) = self.clock.take(stamp_s, now_s());
        if let Some(jump_s) = jump_s {
            let input = name_of(&self.video.place);
            let jumps = running.count_clock_jump();
            if jumps <= NAMED_JUMPS {
                warn(format!(
                    "{input}: its time stamps jumped by {jump_s:.1} s, as if it had begun anew or its clock had been set; the times go on by this computer's clock"
                ));
            }
            if jumps == NAMED_JUMPS {
                warn(format!("{input}: further jumps are counted, but not named"));
            }
        }
        time_s
    }

    /// Tries to open the source until it succeeds, `check` accepts its stream and its size in pixels, the time is over or
    /// the source is stopped. Says so on standard error. `why` is the error that ended it, if any.
    ///
    /// Errors: the reason of the last failure.
    pub(super) fn open(
        &mut self,
        running: &Running,
        why: Option<Error>,
        check: impl Fn(&ProbedStream, (usize, usize)) -> Result<()>,
    ) -> Result<Decode> {
        let input = &*name_of(&self.video.place);
        let limit_s = self.limit.as_secs_f64();
        let timeout = timeout(&self.video);
        let mut why = if running.was_silent() {
            user_error!("{input}: no frame came for {} s", timeout.as_secs_f64())
        } else {
            why.unwrap_or_else(|| user_error!("{input}: ended"))
        };
        let shown = format!("{why:#}");
        // Messages of ffmpeg have lines of their own.
        let joint = if shown.contains('\n') { "\n" } else { "; " };
        let shown = shown.trim_end_matches('.');
        warn(format!("{shown}{joint}opening it again for {limit_s} s"));
        let watch = Stopwatch::start();
        let [mut pause, longest_pause] = PAUSES;
        while watch.elapsed_s() < limit_s && !running.is_stopped_after(pause) {
            pause = (2 * pause).min(longest_pause);
            let opened = self
                .programs
                .decode_live(&self.video)
                .and_then(|mut decode| {
                    running.replace(Arc::clone(&decode.process));
                    let (stream, size_px) = first_of(
                        input,
                        &mut decode,
                        timeout,
                        Announce::Nothing,
                        &Stop::default(),
                    )?;
                    check(&stream, size_px)?;
                    Ok(decode)
                });
            match opened {
                Ok(decode) => {
                    running.count_reopened();
                    self.clock.is_reopened = true;
                    warn(format!("{input}: is back after {:.1} s", watch.elapsed_s()));
                    return Ok(decode);
                }
                Err(error) => why = error,
            }
        }
        Err(why.context(format!("{input}: did not come back within {limit_s} s")))
    }
}

/// The clock of a live source that continues when the source is opened again or the clock is set.
#[derive(Default)]
struct SteadyClock {
    offset_s: f64,
    /// The last time, in seconds.
    last_s: Option<f64>,
    /// The times and arrivals of frames.
    arrivals: CaptureClock,
    /// Whether the next frame is the first after a failure.
    is_reopened: bool,
    /// After the clock was set, until it is known by how much the first frames came late.
    settling: Option<Settling>,
    /// Whether frames that come late may be left out.
    keeps_up: bool,
    /// Where frames are left out: the first ones after the clock was set or began anew.
    burst: Option<Burst>,
}

/// Frames that come at once.
struct Burst {
    /// When it began, in seconds.
    begin_s: f64,
    /// The time stamp and the arrival of its latest frame, in seconds.
    stamp_s: f64,
    arrival_s: f64,
}

/// What is known after a clock was set.
struct Settling {
    /// The times and arrivals of frames before.
    before: CaptureClock,
    /// When the clock was found to be set, in seconds.
    begin_s: f64,
    /// The shortest delay since, up to [`QUICKER_S`], and since when, in seconds.
    least_s: f64,
    since_s: f64,
    /// Whether frames have caught up.
    has_settled: bool,
}

impl SteadyClock {
    /// Returns the time of a frame as [`SteadyClock::time_at_s`], but `None` for one of those that come at once after a jump: how old they are is not known.
    fn take(&mut self, stamp_s: f64, arrival_s: f64) -> (Option<f64>, Option<f64>) {
        if let Some(burst) = &mut self.burst {
            let is_at_once = arrival_s - burst.arrival_s < BURST_SHARE * (stamp_s - burst.stamp_s);
            (burst.stamp_s, burst.arrival_s) = (stamp_s, arrival_s);
            if is_at_once && arrival_s - burst.begin_s < BURST_S {
                return (None, None);
            }
            self.burst = None;
            self.is_reopened = true;
        } else if self.keeps_up
            && let Some(expected_s) = self.expected_after_jump_s(stamp_s, arrival_s)
        {
            self.burst = Some(Burst {
                begin_s: arrival_s,
                stamp_s,
                arrival_s,
            });
            let jump_s = stamp_s + self.offset_s - expected_s;
            return (None, (!self.is_reopened).then_some(jump_s));
        }
        let (time_s, jump_s) = self.time_at_s(stamp_s, arrival_s);
        (Some(time_s), jump_s)
    }

    /// Returns the time that is expected of a frame with this time stamp that arrives at this time, in seconds, if its time stamp has jumped away from it.
    fn expected_after_jump_s(&self, stamp_s: f64, arrival_s: f64) -> Option<f64> {
        let time_s = stamp_s + self.offset_s;
        // The last frame may have arrived late, such as one that ffmpeg held back until a sender began anew.
        let (last_s, expected_s) = (self.last_s?, self.arrivals.stamp_s(arrival_s)?);
        let has_jumped = if self.is_reopened {
            (time_s - expected_s).abs() > SAME_CLOCK_S
        } else {
            time_s < last_s - SET_BACK_S || time_s > expected_s + SET_FORWARD_S
        };
        has_jumped.then_some(expected_s)
    }

    /// Returns the time of a frame with this time stamp that arrives at this time, in seconds, and the jump of the time stamps
    /// if they jumped while the source was open.
    ///
    /// After a jump, the first frame is taken for a quick one. If later ones turn out to be quicker, the times go back by the difference.
    fn time_at_s(&mut self, stamp_s: f64, arrival_s: f64) -> (f64, Option<f64>) {
        let mut time_s = stamp_s + self.offset_s;
        let mut jump_s = None;
        if let Some(expected_s) = self.expected_after_jump_s(stamp_s, arrival_s) {
            jump_s = (!self.is_reopened).then_some(time_s - expected_s);
            self.offset_s = expected_s - stamp_s;
            time_s = expected_s;
            self.settling = Some(Settling {
                before: self.arrivals.clone(),
                begin_s: arrival_s,
                least_s: arrival_s - time_s,
                since_s: arrival_s,
                has_settled: false,
            });
        }
        self.is_reopened = false;
        self.arrivals.take(time_s, arrival_s);
        if let Some(ahead_s) = self.settled_ahead_s(arrival_s) {
            self.offset_s -= ahead_s;
            time_s -= ahead_s;
            self.arrivals.take(time_s, arrival_s);
        }
        self.last_s = Some(time_s);
        (time_s, jump_s)
    }

    /// Returns by how much times are ahead since the clock was set, in seconds, once that is known. The quickest frames are again those from before.
    fn settled_ahead_s(&mut self, arrival_s: f64) -> Option<f64> {
        let settling = self.settling.as_mut()?;
        let least_s = self.arrivals.least_delay_s()?;
        let limit_s = [UNSETTLED_S, FOLLOWED_S][usize::from(settling.has_settled)];
        if arrival_s - settling.begin_s > limit_s {
            self.settling = None;
            return None;
        }
        if least_s < settling.least_s - QUICKER_S {
            settling.least_s = least_s;
            settling.since_s = arrival_s;
        }
        settling.has_settled |= arrival_s - settling.since_s >= SETTLED_S;
        if !settling.has_settled {
            return None;
        }
        let ahead_s = settling.before.least_delay_s()? - least_s;
        self.arrivals.clone_from(&settling.before);
        (ahead_s > 0.0).then_some(ahead_s)
    }
}

/// Returns ffmpeg's last messages for an error.
pub(super) fn quoted(messages: &[String]) -> String {
    if messages.is_empty() {
        "ffmpeg printed no further messages.".to_owned()
    } else {
        format!("ffmpeg's messages:\n{}", messages.join("\n"))
    }
}

/// What a wait for a live source says.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum Announce {
    /// What is waited for.
    Waiting,
    /// Nothing: it has been said.
    Nothing,
}

/// Waits for the first frame of a live source and returns its stream and its size in pixels. Fails if it does not come
/// within the limit, or if it is to stop before.
pub(super) fn first_of(
    input: &str,
    decode: &mut Decode,
    limit: Duration,
    announce: Announce,
    stop: &Stop,
) -> Result<(ProbedStream, (usize, usize))> {
    let watch = Watch::start(input, &decode.process, limit, (announce, stop))?;
    let size_px = decode.frames.size_px();
    let stream = decode.colors.recv();
    if watch.has_expired() {
        if stop.is_requested() {
            return Err(user_error!("{input}: stopped before its first frame came"));
        }
        let check = if input.starts_with("udp://") || input.starts_with("rtp://") {
            "check that the camera sends to this port of this computer, and that no firewall keeps it out"
        } else {
            "check that the camera is on and its address is right"
        };
        return Err(user_error!(
            "{input}: no frame came within {} s; {check}, or give input.timeout_s a longer time",
            limit.as_secs_f64()
        ));
    }
    if let (Ok(Some((width, height))), Ok(stream)) = (size_px, stream) {
        let stream = ProbedStream {
            width,
            height,
            ..stream
        };
        return Ok((stream, (width, height)));
    }
    decode.process.kill();
    let (_, messages) = decode.end()?;
    if messages
        .iter()
        .any(|message| message.contains("not on whitelist"))
    {
        return Err(not_allowed(input, &messages[0]));
    }
    Err(user_error!(
        "{input}: ffmpeg cannot open it; {}, and the keys `fps` and `input`. {}",
        what_to_check(input, &messages),
        quoted(&messages)
    ))
}

/// Returns what is probably wrong with a source that cannot be opened, with these messages of ffmpeg.
fn what_to_check(input: &str, messages: &[String]) -> &'static str {
    if input == name_of(&pardalis_scene::VideoPlace::StandardInput) {
        "it is empty, or an MP4, which cannot be read from a pipe (give the name of the file, or pipe Matroska or MPEG-TS); else check its format"
    } else if messages.iter().any(|message| message.contains(REFUSED)) {
        "nobody listens there: start the sender, or check the address"
    } else if input.contains("://") {
        "check the address and the network"
    } else {
        "check the name (`pardalis devices` lists cameras)"
    }
}

/// Tells the user that a source keeps them waiting, and ends ffmpeg after a time, or if it is to stop.
struct Watch {
    /// Closed to end the thread.
    open: Option<Sender<()>>,
    thread: Option<JoinHandle<bool>>,
}

impl Watch {
    fn start(
        input: &str,
        process: &Arc<Process>,
        limit: Duration,
        (announce, stop): (Announce, &Stop),
    ) -> Result<Self> {
        let (open, is_open) = channel();
        let (input, process, stop) = (input.to_owned(), Arc::clone(process), stop.clone());
        let thread = start_thread(move || {
            let watch = Stopwatch::start();
            let mut is_said = announce == Announce::Nothing;
            while is_open.recv_timeout(STOP_POLL) == Err(RecvTimeoutError::Timeout) {
                let waited_s = watch.elapsed_s();
                if stop.is_requested() || waited_s >= limit.as_secs_f64() {
                    process.kill();
                    return true;
                }
                if !is_said && waited_s >= SILENT_WAIT.as_secs_f64() {
                    let limit_s = limit.as_secs_f64();
                    note(format_args!(
                        "waiting for the first frame of {input}, at most {limit_s} s"
                    ));
                    is_said = true;
                }
            }
            false
        })?;
        Ok(Self {
            open: Some(open),
            thread: Some(thread),
        })
    }

    /// Ends the watch. Reports whether it has ended ffmpeg.
    fn has_expired(mut self) -> bool {
        drop(self.open.take());
        let ended = self.thread.take().map(JoinHandle::join);
        matches!(ended, Some(Ok(true)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_go_on_whether_or_not_the_clock_of_the_source_does() {
        // The stamps before and after a failure of 3 s, and the times that follow.
        for (after_s, wanted_s) in [
            ([107.0, 107.1], [107.0, 107.1]),
            ([0.0, 0.1], [107.25, 107.35]),
            ([9000.0, 9000.1], [107.25, 107.35]),
        ] {
            let mut clock = SteadyClock::default();
            assert_eq!(clock.time_at_s(104.0, 50.0), (104.0, None));
            clock.is_reopened = true;
            let times_s = [(after_s[0], 53.25), (after_s[1], 53.25)];
            for ((stamp_s, arrival_s), wanted_s) in times_s.into_iter().zip(wanted_s) {
                let (found_s, jump_s) = clock.time_at_s(stamp_s, arrival_s);
                assert!((found_s - wanted_s).abs() < 1e-9, "{found_s} {wanted_s}");
                assert_eq!(jump_s, None);
            }
        }
    }

    #[test]
    fn times_are_right_again_although_the_clock_was_set_while_frames_came_late() {
        // Ten frames a second that take 20 ms and, on every other frame, 10 ms more.
        let arrival_s = |number: i32| 0.1 * f64::from(number) + 0.02 + 0.01 * f64::from(number % 2);
        let mut clock = SteadyClock::default();
        for number in 0..50 {
            assert_eq!(
                clock
                    .time_at_s(0.1 * f64::from(number), arrival_s(number))
                    .1,
                None
            );
        }
        // The clock is set by an hour at 5 s. The network held the frames of 5 s to 5.7 s back until then.
        let mut jumps = 0;
        let mut times_s = Vec::new();
        for number in 50..120 {
            let stamp_s = 3600.0 + 0.1 * f64::from(number);
            let (time_s, jump_s) = clock.time_at_s(stamp_s, arrival_s(number).max(5.72));
            jumps += usize::from(jump_s.is_some());
            times_s.push(time_s - 0.1 * f64::from(number));
        }
        assert_eq!(jumps, 1);
        // Ahead by how late the first frame came, for about as long as the frames need to settle.
        let settled = times_s
            .iter()
            .position(|ahead_s| ahead_s.abs() < 1e-9)
            .unwrap();
        assert!((17..=19).contains(&settled), "{settled} {times_s:?}");
        assert!(
            times_s[..settled]
                .iter()
                .all(|ahead_s| (ahead_s - 0.7).abs() < 1e-9)
        );
        assert!(
            times_s[settled..]
                .iter()
                .all(|ahead_s| ahead_s.abs() < 1e-9)
        );
    }

    #[test]
    fn times_follow_rare_quick_frames_after_the_clock_was_set() {
        // Ten frames a second that take 30 ms, and 20 ms every four seconds.
        let delay_s = |number: i32| if number % 40 == 0 { 0.02 } else { 0.03 };
        let mut clock = SteadyClock::default();
        let mut ahead_s = Vec::new();
        for number in 0..1000 {
            let taken_s = 0.1 * f64::from(number);
            let set_s = if number < 50 { 0.0 } else { 3600.0 };
            let (time_s, _) = clock.time_at_s(taken_s + set_s, taken_s + delay_s(number));
            ahead_s.push(time_s - taken_s);
        }
        assert!(ahead_s[50..80].iter().all(|s| (s - 0.01).abs() < 1e-9));
        let others = ahead_s[..50].iter().chain(&ahead_s[80..]);
        assert!(others.clone().all(|s| s.abs() < 1e-9), "{ahead_s:?}");
    }

    #[test]
    fn streams_that_are_not_sent_in_real_time_keep_the_steps_of_their_stamps() {
        let mut clock = SteadyClock::default();
        clock.time_at_s(100.0, 50.0);
        clock.is_reopened = true;
        // Twice as fast as their time stamps.
        let times_s: Vec<f64> = (0..1000)
            .map(|number| 0.1 * f64::from(number))
            .map(|stamp_s| clock.time_at_s(stamp_s, 53.0 + stamp_s / 2.0).0)
            .collect();
        let is_regular = |pair: &[f64]| (pair[1] - pair[0] - 0.1).abs() < 1e-9;
        assert!(times_s.windows(2).all(is_regular));
    }

    #[test]
    fn the_first_images_after_a_jump_are_left_out_if_they_come_at_once() {
        let mut clock = SteadyClock {
            keeps_up: true,
            ..SteadyClock::default()
        };
        for number in 0..50 {
            let taken_s = 0.04 * f64::from(number);
            assert_eq!(clock.take(taken_s, taken_s + 0.01), (Some(taken_s), None));
        }
        // The sender begins anew at 3 s; its images of the first 0.5 s come at once.
        let mut times_s = Vec::new();
        for number in 0..100 {
            let taken_s = 3.0 + 0.04 * f64::from(number);
            let arrival_s = (taken_s + 0.01).max(3.5 + 0.001 * f64::from(number));
            let (time_s, jump_s) = clock.take(1000.0 + taken_s, arrival_s);
            assert_eq!(jump_s.is_some(), number == 0);
            times_s.extend(time_s.map(|time_s| time_s - taken_s));
        }
        assert!((80..90).contains(&times_s.len()), "{}", times_s.len());
        assert!(
            times_s.iter().all(|off_s| off_s.abs() < 1e-9),
            "{times_s:?}"
        );
        // A single wrong time stamp costs one image, and those of a regular stream that begins anew one as well.
        assert_eq!(clock.take(9000.0, 7.01).0, None);
        assert!(
            clock
                .take(1007.04, 7.05)
                .0
                .is_some_and(|s| (s - 7.04).abs() < 1e-9)
        );
        clock.is_reopened = true;
        assert_eq!(clock.take(0.0, 9.01), (None, None));
        assert!(
            clock
                .take(0.04, 9.05)
                .0
                .is_some_and(|s| (s - 9.04).abs() < 1e-9)
        );
    }

    #[test]
    fn only_stamps_that_a_steady_clock_cannot_have_are_jumps() {
        // Stamps and arrivals after a frame at 100 s that arrived at 50 s, and the times that are wanted.
        for (name, frames, wanted_s, jumps) in [
            ("late", [(100.1, 53.0), (100.2, 53.0)], [100.1, 100.2], 0),
            (
                "caught up",
                [(100.1, 53.0), (103.1, 53.1)],
                [100.1, 103.1],
                0,
            ),
            ("lost", [(700.0, 650.0), (700.1, 650.1)], [700.0, 700.1], 0),
            ("reordered", [(99.9, 50.1), (100.2, 50.2)], [99.9, 100.2], 0),
            ("set back", [(40.0, 50.1), (40.2, 50.3)], [100.1, 100.3], 1),
            (
                "set forward",
                [(3700.0, 50.1), (3700.2, 50.3)],
                [100.1, 100.3],
                1,
            ),
            (
                "begun anew",
                // The last frame of the sender before came only with the first of the new one.
                [(100.1, 55.0), (0.0, 55.1)],
                [100.1, 105.1],
                1,
            ),
            (
                "one stamp",
                [(3700.0, 50.1), (100.2, 50.2)],
                [100.1, 100.2],
                2,
            ),
        ] {
            let mut clock = SteadyClock::default();
            clock.time_at_s(100.0, 50.0);
            let mut found_jumps = 0;
            for ((stamp_s, arrival_s), wanted_s) in frames.into_iter().zip(wanted_s) {
                let (found_s, jump_s) = clock.time_at_s(stamp_s, arrival_s);
                assert!((found_s - wanted_s).abs() < 1e-9, "{name}: {found_s}");
                found_jumps += usize::from(jump_s.is_some());
            }
            assert_eq!(found_jumps, jumps, "{name}");
        }
    }
}
