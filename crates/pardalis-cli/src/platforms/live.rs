//! The motion of a platform as it happens: poses that another program sends over UDP.

use std::collections::VecDeque;
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
use super::files::{covariance_names, covariance_of, no_rotation, pose_of, quaternion_of};
use crate::output::{Shown, in_line};
use crate::timing::{now_s, now_s_at_unix, unix_s_at};
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
    /// When the address was opened, on the clock of the program, in seconds.
    opened_s: f64,
    /// Where odometry was before its first increment in the world; poses are those of the world without it.
    start: Option<Pose>,
    /// The last pose of odometry, in its own frame.
    previous: Option<StampedPose>,
    /// Whether it has been said that nothing comes.
    is_silent: bool,
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
    /// When the last one came, on the clock of the program, in seconds.
    last_s: Option<f64>,
    /// What was wrong with the first datagram that was left out, if that has not been reported yet.
    refusal: Option<String>,
}

/// How many datagrams have come.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct LiveCounts {
    pub(super) received: usize,
    /// Those that are no pose, or of no possible time.
    pub(super) unusable: usize,
    /// The shortest time from the time stamp of a pose to its arrival, in seconds; negative if the clock of the sender is ahead.
    pub(super) least_age_s: Option<f64>,
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
    text.contains("://") || text.to_ascii_lowercase().starts_with("udp:")
}

impl Live {
    /// Waits for poses at an address of this computer: of the world, or of odometry that began there.
    ///
    /// Errors: it is none, or another program has it.
    pub(super) fn open(place: &str, start: Option<Pose>) -> Result<Self> {
        let address = place.strip_prefix(SCHEME).map(str::parse::<SocketAddr>);
        let address = address.and_then(Result::ok);
        let address = address.filter(|a| a.port() > 0 && !a.ip().is_multicast());
        let address = address.ok_or_else(|| {
            user_error!(
                "{place}: poses come over UDP; allowed: udp://ADDRESS:PORT, an address of this computer in numbers, such as udp://127.0.0.1:7001 for programs on it, or udp://0.0.0.0:7001 for any"
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
            opened_s: now_s(),
            start,
            previous: None,
            is_silent: false,
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

    /// Returns what was wrong with the first datagram that was left out, if that has not been said.
    pub(super) fn refusal(&mut self) -> Option<String> {
        self.shared.arrived().refusal.take()
    }

    /// Returns what should be said while tracking, and has not been said.
    pub(super) fn news(&mut self) -> Vec<String> {
        let mut arrived = self.shared.arrived();
        let mut news = Vec::new();
        if let Some(refusal) = arrived.refusal.take() {
            news.push(format!(
                "left out a datagram, and will count others like it: {refusal}"
            ));
        }
        let since_s = now_s() - arrived.last_s.unwrap_or(self.opened_s);
        if self.is_silent != (since_s > SILENT_S) {
            self.is_silent = !self.is_silent;
            news.push(match (self.is_silent, arrived.last_s) {
                (false, _) => format!("poses come to {} again", self.place),
                (true, Some(_)) => format!(
                    "no pose has come to {} for {SILENT_S} s, and images are not used without; does the other program still run?",
                    self.place
                ),
                (true, None) => format!(
                    "no pose has come to {} yet, and images are not used without; does the other program send to this address?",
                    self.place
                ),
            });
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
        let arrival_s = now_s();
        let arrival_unix_s = unix_s_at(arrival_s);
        let pose = pose_in(&bytes[..length], Path::new(place), arrival_unix_s);
        let mut arrived = shared.arrived();
        arrived.counts.received += 1;
        arrived.last_s = Some(arrival_s);
        match pose {
            Ok(mut pose) => {
                let age_s = arrival_unix_s - pose.time_s;
                let least_s = arrived.counts.least_age_s;
                arrived.counts.least_age_s = Some(least_s.map_or(age_s, |s| s.min(age_s)));
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
/// of arrival stands in for a missing one. Other keys are ignored.
fn pose_in(bytes: &[u8], place: &Path, arrival_unix_s: f64) -> Result<StampedPose> {
    let shown = place.shown();
    let object: Map<String, Value> = serde_json::from_slice(bytes).map_err(|error| {
        user_error!(
            "{shown}: is not one object in JSON ({error}); needed: {KEYS}, all finite numbers"
        )
    })?;
    if object.contains_key("time_s") {
        return Err(user_error!(
            "{shown}: time_s is a column of files; give time_unix_s, seconds since 1970, or leave it out: then the time of arrival counts"
        ));
    }
    let number = |key: &str| -> Result<Option<f64>> {
        let Some(value) = object.get(key) else {
            return Ok(None);
        };
        let number = value.as_f64().filter(|number| number.is_finite());
        let number =
            number.ok_or_else(|| user_error!("{shown}: {key} is {value}; allowed: numbers"))?;
        Ok(Some(number))
    };
    let needed = |key: &str| {
        number(key)?.ok_or_else(|| {
            let found: Vec<&str> = object.keys().map(String::as_str).collect();
            user_error!(
                "{shown}: needed: {KEYS}; found: {}",
                in_line(&found.join(","))
            )
        })
    };
    let [x_m, y_m] = [needed("x_m")?, needed("y_m")?];
    let (z_m, quaternion) = match number("heading_rad")? {
        Some(_) if object.contains_key("qw") => {
            return Err(user_error!(
                "{shown}: has heading_rad and a quaternion, which may differ; keep one of them"
            ));
        }
        Some(heading_rad) => (number("z_m")?.unwrap_or(0.0), quaternion_of(heading_rad)),
        None => (
            needed("z_m")?,
            [needed("qx")?, needed("qy")?, needed("qz")?, needed("qw")?],
        ),
    };
    let world_from_platform =
        pose_of([x_m, y_m, z_m], quaternion).ok_or_else(|| no_rotation(&shown, quaternion))?;
    Ok(StampedPose {
        time_s: time_of(number("time_unix_s")?, arrival_unix_s)
            .map_err(|problem| user_error!("{shown}: {problem}"))?,
        world_from_platform,
        covariance: covariance_in(&object, &needed, &number)
            .map_err(|error| user_error!("{shown}: {error}"))?,
    })
}

/// Returns the time of a pose that comes at this time, both in seconds since 1970; an error if their clocks are others.
fn time_of(time_unix_s: Option<f64>, arrival_unix_s: f64) -> Result<f64, String> {
    let Some(time_unix_s) = time_unix_s else {
        return Ok(arrival_unix_s);
    };
    let ahead_s = time_unix_s - arrival_unix_s;
    if ahead_s.abs() <= MAX_CLOCK_ERROR_S {
        return Ok(time_unix_s);
    }
    let remedy = if (1e-3 * time_unix_s - arrival_unix_s).abs() <= MAX_CLOCK_ERROR_S {
        "give seconds, not milliseconds"
    } else {
        "set both clocks, such as with NTP, or leave it out: then the time of arrival counts"
    };
    let (by_s, way) = (
        ahead_s.abs(),
        if ahead_s > 0.0 { "ahead of" } else { "behind" },
    );
    Err(format!(
        "time_unix_s is {time_unix_s}, {by_s:.1} s {way} the clock of this computer; {remedy}"
    ))
}

/// Reads the errors of a pose.
fn covariance_in(
    object: &Map<String, Value>,
    needed: &impl Fn(&str) -> Result<f64>,
    number: &impl Fn(&str) -> Result<Option<f64>>,
) -> Result<PoseCovariance> {
    if object.contains_key("sigma_m") || object.contains_key("sigma_rad") {
        let sigmas = [number("sigma_m")?, number("sigma_rad")?];
        let [Some(sigma_m), Some(sigma_rad)] = sigmas else {
            return Err(user_error!(
                "needed: sigma_m and sigma_rad, or none of them"
            ));
        };
        return Ok(PoseCovariance::of_sigmas(sigma_m, sigma_rad)?);
    }
    if !object.keys().any(|key| key.starts_with("cov_")) {
        return Ok(PoseCovariance::zero());
    }
    let names = covariance_names();
    let upper = names.iter().map(|name| needed(name));
    Ok(covariance_of(&upper.collect::<Result<Vec<_>>>()?)?)
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
            ("7", "is not one object in JSON"),
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
                "time_unix_s is 12.5, 1749999987.5 s behind the clock of this computer; set both clocks",
            ),
            (
                "{\"x_m\": 1, \"y_m\": 2, \"z_m\": 3, \"qx\": 0, \"qy\": 0, \"qz\": 0.6, \"qw\": 0.6}",
                "does not have length 1",
            ),
            (
                "{\"x_m\": 1, \"y_m\": 2, \"heading_rad\": 0, \"qw\": 1}",
                "has heading_rad and a quaternion",
            ),
            (
                "{\"x_m\": 1, \"y_m\": 2, \"heading_rad\": 0, \"time_unix_s\": 1750000000000}",
                "give seconds, not milliseconds",
            ),
            (
                "{\"x_m\": 1, \"y_m\": 2, \"heading_rad\": 0, \"time_s\": 1}",
                "give time_unix_s",
            ),
            (
                "{\"x_m\": 1, \"y_m\": 2, \"heading_rad\": 0, \"cov_x_x\": 1}",
                "needed",
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
