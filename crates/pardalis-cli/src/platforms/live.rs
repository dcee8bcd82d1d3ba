//! The motion of a platform as it happens: poses that another program sends over UDP.

use std::collections::VecDeque;
use std::fmt::Write as _;
use std::io::ErrorKind;
use std::net::{SocketAddr, UdpSocket};
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;

use anyhow::{Context as _, Result};
use pardalis::camera::Pose;
use pardalis::platform::{Increment, PoseCovariance, StampedPose};
use serde_json::{Map, Value};

use super::Motion;
use super::files::poses_in;
use crate::output::{Shown, in_line};
use crate::timing::{Stopwatch, now_s, now_s_at_unix, unix_s_at};
use crate::user_error::user_error;

/// What addresses begin with.
const SCHEME: &str = "udp://";
/// The most bytes of a datagram.
const MAX_DATAGRAM_BYTES: usize = 1 << 16;
/// The most poses that wait for images; older ones give way to newer.
const MAX_WAITING: usize = 4096;
/// How long the thread waits before it looks whether it shall end.
const LOOK: Duration = Duration::from_millis(100);
/// A clock that differs from this computer's by more than this many seconds is another one.
const MAX_CLOCK_ERROR_S: f64 = 10.0;
/// No pose for this many seconds is worth a word.
const SILENT_S: f64 = 2.0;

/// What a pose consists of.
const KEYS: &str = "x_m,y_m,z_m,qx,qy,qz,qw or x_m,y_m,heading_rad, and perhaps time_unix_s";

/// Receives poses on a thread of its own.
#[derive(Debug)]
pub(super) struct Live {
    place: String,
    shared: Arc<Shared>,
    thread: Option<JoinHandle<()>>,
    opened: OpenedAt,
    /// Where odometry was before its first increment in the world; poses are those of the world without it.
    start: Option<Pose>,
    /// The last pose of odometry, in its own frame.
    previous: Option<StampedPose>,
    has_warned_of_silence: bool,
}

/// When the address was opened.
struct OpenedAt(Stopwatch);

impl std::fmt::Debug for OpenedAt {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} s ago", self.0.elapsed_s())
    }
}

#[derive(Debug, Default)]
struct Shared {
    is_over: AtomicBool,
    arrived: Mutex<Arrived>,
}

/// What has come.
#[derive(Debug, Default)]
struct Arrived {
    /// Poses on the clock of the program.
    poses: VecDeque<StampedPose>,
    counts: LiveCounts,
    /// What was wrong with the first datagram that was left out, if that has not been reported yet.
    refusal: Option<String>,
}

/// How many datagrams have come.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct LiveCounts {
    pub(super) received: usize,
    /// Those that are no pose, or of no possible time.
    pub(super) unusable: usize,
}

impl Arrived {
    fn refuse(&mut self, error: &anyhow::Error) {
        if self.counts.unusable == 0 {
            self.refusal = Some(format!("{error:#}"));
        }
        self.counts.unusable += 1;
    }
}

impl Shared {
    fn arrived(&self) -> MutexGuard<'_, Arrived> {
        // Poses are added whole.
        self.arrived.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Reports whether a `poses` or `odometry` of a scene is an address and not a file.
pub(crate) fn is_address(text: &str) -> bool {
    text.starts_with(SCHEME)
}

impl Live {
    /// Waits for poses at an address of this computer: of the world, or of odometry that began there.
    ///
    /// Errors: it is none, or another program has it.
    pub(super) fn open(place: &str, start: Option<Pose>) -> Result<Self> {
        let address = place.strip_prefix(SCHEME).map(str::parse::<SocketAddr>);
        let address = address.and_then(Result::ok).filter(|a| a.port() > 0);
        let address = address.ok_or_else(|| {
            user_error!(
                "{place}: allowed: udp://ADDRESS:PORT, an address of this computer in numbers, such as udp://127.0.0.1:7001 for programs on it, or udp://0.0.0.0:7001 for any"
            )
        })?;
        let socket = UdpSocket::bind(address)
            .and_then(|socket| socket.set_read_timeout(Some(LOOK)).map(|()| socket))
            .map_err(|error| {
                user_error!("{place}: cannot wait for poses there: {error}; give an address of this computer and a port that no other program has")
            })?;
        let shared = Arc::new(Shared::default());
        let thread = std::thread::Builder::new()
            .name("poses".to_owned())
            .spawn({
                let (shared, place) = (Arc::clone(&shared), place.to_owned());
                move || receive(&socket, &place, &shared)
            })
            .context("no further thread can be started")?;
        Ok(Self {
            place: place.to_owned(),
            shared,
            thread: Some(thread),
            opened: OpenedAt(Stopwatch::start()),
            start,
            previous: None,
            has_warned_of_silence: false,
        })
    }

    /// Returns what has come since the last call. `offset_s` is added to times on the clock of the program.
    pub(super) fn take(&mut self, offset_s: f64) -> Vec<Motion> {
        let poses = std::mem::take(&mut self.shared.arrived().poses);
        let mut motions = Vec::with_capacity(poses.len());
        for mut pose in poses {
            pose.time_s += offset_s;
            match self.start {
                Some(start) => self.take_odometry(&pose, &start, &mut motions),
                None => motions.push(Motion::Pose(pose)),
            }
        }
        motions
    }

    /// Adds the increment to a pose of odometry from the last one.
    fn take_odometry(&mut self, pose: &StampedPose, start: &Pose, motions: &mut Vec<Motion>) {
        let Some(previous) = self.previous else {
            self.previous = Some(*pose);
            motions.push(Motion::Pose(StampedPose {
                world_from_platform: *start,
                covariance: PoseCovariance::zero(),
                ..*pose
            }));
            return;
        };
        if pose.time_s <= previous.time_s {
            self.refuse(&user_error!(
                "{}: is not later than the one before",
                self.place
            ));
            return;
        }
        motions.push(Motion::Increment(Increment {
            from_s: previous.time_s,
            to_s: pose.time_s,
            before_from_after: previous.world_from_platform.inverse() * pose.world_from_platform,
            covariance: pose.covariance,
        }));
        self.previous = Some(*pose);
    }

    /// Counts a pose that cannot be used.
    pub(super) fn refuse(&self, error: &anyhow::Error) {
        self.shared.arrived().refuse(error);
    }

    pub(super) fn counts(&self) -> LiveCounts {
        self.shared.arrived().counts
    }

    /// Returns what should be said while tracking, once.
    pub(super) fn news(&mut self) -> Vec<String> {
        let mut arrived = self.shared.arrived();
        let mut news = Vec::new();
        if let Some(refusal) = arrived.refusal.take() {
            news.push(format!(
                "left out what is no pose, and will count others like it: {refusal}"
            ));
        }
        let is_silent = arrived.counts.received == 0 && self.opened.0.elapsed_s() > SILENT_S;
        if is_silent && !self.has_warned_of_silence {
            self.has_warned_of_silence = true;
            news.push(format!(
                "no pose has come to {} yet, and images are not used without; does the other program send to this address?",
                self.place
            ));
        }
        news
    }
}

impl Drop for Live {
    fn drop(&mut self) {
        self.shared.is_over.store(true, Ordering::Relaxed);
        // A panic has been reported.
        let _ = self.thread.take().map(JoinHandle::join);
    }
}

/// Takes datagrams until it shall end.
fn receive(socket: &UdpSocket, place: &str, shared: &Shared) {
    let mut bytes = vec![0; MAX_DATAGRAM_BYTES];
    while !shared.is_over.load(Ordering::Relaxed) {
        let length = match socket.recv(&mut bytes) {
            Ok(length) => length,
            Err(error) => {
                // Anything else than silence would come again at once.
                if !matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) {
                    std::thread::sleep(LOOK);
                }
                continue;
            }
        };
        let pose = pose_in(&bytes[..length], Path::new(place), unix_s_at(now_s()));
        let mut arrived = shared.arrived();
        arrived.counts.received += 1;
        match pose {
            Ok(mut pose) => {
                pose.time_s = now_s_at_unix(pose.time_s);
                if arrived.poses.len() == MAX_WAITING {
                    arrived.poses.pop_front();
                }
                arrived.poses.push_back(pose);
            }
            Err(error) => arrived.refuse(&error),
        }
    }
}

/// Reads the pose in a datagram: an object in JSON whose keys are the columns of files of poses, but `time_unix_s` for the time, in seconds since 1970; that
/// of arrival stands in for a missing one.
fn pose_in(bytes: &[u8], place: &Path, arrival_unix_s: f64) -> Result<StampedPose> {
    let shown = place.shown();
    let object: Map<String, Value> = serde_json::from_slice(bytes)
        .map_err(|error| user_error!("{shown}: is no object in JSON ({error}); needed: {KEYS}"))?;
    let mut numbers = Vec::new();
    for (key, value) in &object {
        let number = value.as_f64().filter(|number| number.is_finite());
        let number = number
            .ok_or_else(|| user_error!("{shown}: {} is {value}; allowed: numbers", in_line(key)))?;
        numbers.push((&**key, number));
    }
    let has = |keys: &[&str]| keys.iter().all(|key| object.contains_key(*key));
    let is_planar = has(&["x_m", "y_m", "heading_rad"]);
    if !is_planar && !has(&["x_m", "y_m", "z_m", "qx", "qy", "qz", "qw"]) {
        let found: Vec<&str> = object.keys().map(String::as_str).collect();
        return Err(user_error!(
            "{shown}: needed: {KEYS}; found: {}",
            in_line(&found.join(","))
        ));
    }
    let time_unix_s = match object.get("time_unix_s").and_then(Value::as_f64) {
        Some(time_s) if (time_s - arrival_unix_s).abs() > MAX_CLOCK_ERROR_S => {
            return Err(user_error!(
                "{shown}: time_unix_s is {time_s}, and the clock of this computer shows {arrival_unix_s:.3}; set both clocks, such as with NTP, or leave it out: then the time of arrival counts"
            ));
        }
        time_s => time_s.unwrap_or(arrival_unix_s),
    };
    let (mut header, mut row) = ("time_s".to_owned(), time_unix_s.to_string());
    for (key, number) in numbers {
        if !matches!(key, "time_s" | "time_unix_s") && !key.contains([',', '"', '\n', '\r']) {
            // Writing to a String cannot fail.
            let _ = write!(header, ",{key}");
            let _ = write!(row, ",{number}");
        }
    }
    let poses = poses_in(place, &format!("{header}\n{row}\n"), 0.0)?;
    match poses[..] {
        [(Motion::Pose(pose), _)] => Ok(pose),
        _ => Err(user_error!("{shown}: needed: {KEYS}")),
    }
}

/// When datagrams of [`read_bytes`] arrive, in seconds since 1970.
#[cfg(any(test, feature = "fuzz"))]
pub(crate) const READ_UNIX_S: f64 = 1_750_000_000.0;

/// Reads any bytes as a datagram.
#[cfg(any(test, feature = "fuzz"))]
pub(crate) fn read_bytes(bytes: &[u8], place: &Path) -> Result<StampedPose> {
    pose_in(bytes, place, READ_UNIX_S)
}

#[cfg(test)]
mod tests {
    use super::*;

    const PLACE: &str = "udp://127.0.0.1:7001";

    fn read(text: &str) -> Result<StampedPose> {
        read_bytes(text.as_bytes(), Path::new(PLACE))
    }

    #[test]
    fn poses_have_the_columns_of_files_and_times_of_their_own_or_of_arrival() {
        let pose = read(r#"{"x_m": 1, "y_m": -2.5, "heading_rad": 0.5, "note": 7}"#).unwrap();
        assert_eq!(pose.time_s, READ_UNIX_S);
        assert_eq!(pose.covariance, PoseCovariance::zero());
        let position = pose.world_from_platform.translation.vector;
        assert_eq!(<[f64; 3]>::from(position), [1.0, -2.5, 0.0]);
        let forward = pose.world_from_platform.rotation * nalgebra::Vector3::x();
        assert!((forward.y - libm::sin(0.5)).abs() < 1e-15);

        let text = r#"{"time_unix_s": 1750000000.25, "x_m": 1, "y_m": 2, "z_m": 3, "qx": 0, "qy": 0, "qz": 0.6, "qw": 0.8, "sigma_m": 0.1, "sigma_rad": 0.2}"#;
        let pose = read(text).unwrap();
        assert_eq!(pose.time_s, READ_UNIX_S + 0.25);
        let covariance = PoseCovariance::of_sigmas(0.1, 0.2).unwrap();
        assert_eq!(pose.covariance, covariance);
    }

    #[test]
    fn what_is_no_pose_is_refused_with_the_remedy() {
        let refused = [
            ("7", "is no object in JSON"),
            (
                "{\"x_m\": 1, \"y_m\": 2}",
                "needed: x_m,y_m,z_m,qx,qy,qz,qw or x_m,y_m,heading_rad, and perhaps time_unix_s; found: x_m,y_m",
            ),
            (
                "{\"x_m\": 1, \"y_m\": 2, \"heading_rad\": \"0\"}",
                "heading_rad is \"0\"; allowed: numbers",
            ),
            (
                "{\"x_m\": 1, \"y_m\": null, \"heading_rad\": 0}",
                "y_m is null; allowed: numbers",
            ),
            (
                "{\"x_m\": 1, \"y_m\": 2, \"heading_rad\": 0, \"time_unix_s\": 12.5}",
                "time_unix_s is 12.5, and the clock of this computer shows 1750000000.000; set both clocks",
            ),
            (
                "{\"x_m\": 1, \"y_m\": 2, \"z_m\": 3, \"qx\": 0, \"qy\": 0, \"qz\": 0.6, \"qw\": 0.6}",
                "does not have length 1",
            ),
            (
                "{\"x_m\": 1, \"y_m\": 2, \"heading_rad\": 0, \"qw\": 1}",
                "has heading_rad and quaternions",
            ),
            (
                "{\"x_m\": 1, \"y_m\": 2, \"heading_rad\": 0, \"sigma_m\": 0.1}",
                "sigma_rad",
            ),
        ];
        for (text, wanted) in refused {
            let error = format!("{:#}", read(text).unwrap_err());
            assert!(
                error.starts_with(PLACE) && error.contains(wanted),
                "{error}"
            );
        }
    }

    #[test]
    fn odometry_is_told_as_increments_from_the_start() {
        let start = Pose::translation(5.0, 0.0, 0.0);
        let mut live = Live::open("udp://127.0.0.1:0", None);
        assert!(live.is_err());
        let free = UdpSocket::bind("127.0.0.1:0").unwrap();
        let place = format!("udp://{}", free.local_addr().unwrap());
        // Another program has it.
        let taken = Live::open(&place, None).unwrap_err().to_string();
        assert!(taken.contains("cannot wait for poses there"), "{taken}");
        drop(free);
        live = Live::open(&place, Some(start));
        let mut live = live.unwrap();
        let at = |time_s: f64, x_m: f64| StampedPose {
            time_s,
            world_from_platform: Pose::translation(x_m, 1.0, 0.0),
            covariance: PoseCovariance::zero(),
        };
        let mut motions = Vec::new();
        for pose in [at(1.0, 7.0), at(1.1, 7.25), at(1.1, 9.0), at(1.2, 7.5)] {
            live.take_odometry(&pose, &start, &mut motions);
        }
        let [
            Motion::Pose(first),
            Motion::Increment(second),
            Motion::Increment(third),
        ] = motions[..]
        else {
            panic!("{motions:?}")
        };
        assert_eq!((first.time_s, first.world_from_platform), (1.0, start));
        assert_eq!((second.from_s, second.to_s), (1.0, 1.1));
        assert_eq!((third.from_s, third.to_s), (1.1, 1.2));
        for increment in [second, third] {
            let moved_m = increment.before_from_after.translation.vector;
            assert!((moved_m - nalgebra::Vector3::new(0.25, 0.0, 0.0)).norm() < 1e-12);
        }
        assert_eq!(live.counts().unusable, 1);
    }
}
