//! The motion of a scene's platforms, read from files of poses or odometry or received from another program, and told to the tracker as time passes.

pub(crate) mod files;
pub(crate) mod live;

use std::path::{Path, PathBuf};

use anyhow::Result;
use pardalis::Tracker;
use pardalis::platform::{
    Increment, MAX_EXTRAPOLATION_S, MAX_GAP_S, OdometryErrors, Platform, PlatformCounts,
    StampedPose,
};
use pardalis::tracker::PlatformId;
use pardalis_scene::{PlatformConfig, PlatformMotion};
use serde_json::{Map, Value, json};

use crate::numbers::counted;
use crate::output::Shown;
use crate::source::TimeSpan;
use crate::user_error::user_error;
use files::{read_odometry, read_poses, typical_interval_s};
use live::Live;

/// Poses whose times are later than their arrival by more than this many seconds, or earlier by [`MAX_AGE_S`], are of another clock, or useless.
const MAX_AHEAD_S: f64 = 0.05;
/// See [`MAX_AHEAD_S`].
const MAX_AGE_S: f64 = 0.2;

/// One row of a file, or what has come at one time.
#[derive(Debug, Clone, Copy)]
enum Motion {
    Pose(StampedPose),
    Increment(Increment),
}

impl Motion {
    fn time_s(&self) -> f64 {
        match self {
            Self::Pose(pose) => pose.time_s,
            Self::Increment(increment) => increment.to_s,
        }
    }

    /// Tells a platform.
    fn tell(&self, platform: &mut Platform) -> Result<(), pardalis_core::Error> {
        match self {
            Self::Pose(pose) => platform.observe_pose(pose)?,
            Self::Increment(increment) => platform.observe_increment(increment)?,
        };
        Ok(())
    }
}

/// The motion of one platform of a scene.
#[derive(Debug)]
pub(crate) struct PlatformRows {
    name: String,
    /// The file, or the address where they come in.
    path: PathBuf,
    errors: OdometryErrors,
    is_odometry: bool,
    /// Those of the file, or what has come and has not been told yet.
    rows: Vec<Motion>,
    /// The number of rows that were told.
    told: usize,
    live: Option<Live>,
    /// Added to the times of what comes, in seconds; those of a file have it added already.
    time_offset_s: f64,
}

impl PlatformRows {
    /// Waits for the motion of a platform at the address in its table.
    pub(crate) fn listen(config: &PlatformConfig) -> Result<Self> {
        let place = &config.motion.file().value;
        let (errors, start) = match &config.motion {
            PlatformMotion::Odometry(_, errors, start) => (*errors, Some(*start)),
            _ => (OdometryErrors::default(), None),
        };
        Ok(Self {
            name: config.name.clone(),
            path: place.into(),
            errors,
            is_odometry: start.is_some(),
            rows: Vec::new(),
            told: 0,
            live: Some(Live::open(place, start)?),
            time_offset_s: config.time_offset_s,
        })
    }

    /// Reads the file of a platform in this folder.
    pub(crate) fn read(config: &PlatformConfig, folder: &Path) -> Result<Self> {
        let path = folder.join(&config.motion.file().value);
        let offset_s = config.time_offset_s;
        let (rows, errors) = match &config.motion {
            PlatformMotion::Given(..) => return Err(user_error!("{}", PlatformMotion::MISSING)),
            PlatformMotion::Poses(_) => (read_poses(&path, offset_s)?, OdometryErrors::default()),
            PlatformMotion::Odometry(_, errors, start) => {
                (read_odometry(&path, offset_s, start)?, *errors)
            }
        };
        let late = check(&path, &rows, errors)?;
        if 2 * late > rows.len() {
            return Err(user_error!(
                "{}: {late} of {} rows are not later than those before; sort the file by time",
                path.shown(),
                rows.len()
            ));
        }
        let times_s: Vec<f64> = rows.iter().map(|(motion, _)| motion.time_s()).collect();
        if let Some(interval_s) = typical_interval_s(&times_s).filter(|s| *s > MAX_GAP_S) {
            return Err(user_error!(
                "{}: its rows are {interval_s} s apart, and more than {MAX_GAP_S} s say nothing about what is between; times are in seconds: are these milliseconds?",
                path.shown()
            ));
        }
        Ok(Self {
            name: config.name.clone(),
            path,
            errors,
            is_odometry: matches!(config.motion, PlatformMotion::Odometry(..)),
            rows: rows.into_iter().map(|(motion, _)| motion).collect(),
            told: 0,
            live: None,
            time_offset_s: 0.0,
        })
    }

    /// Returns the platform's name.
    pub(crate) fn name(&self) -> &str {
        &self.name
    }

    /// Returns the platform with all of the motion in its file.
    ///
    /// Errors: its motion comes in while tracking.
    pub(crate) fn whole(&self) -> Result<Platform> {
        if self.live.is_some() {
            return Err(user_error!(
                "platforms.{}: {} is live; needed is a file of poses, and a recording of the camera",
                self.name,
                self.path.shown()
            ));
        }
        let mut platform = Platform::new(self.errors)?.with_history(self.rows.len() + 1);
        for motion in &self.rows {
            motion.tell(&mut platform)?;
        }
        Ok(platform)
    }

    /// Returns what is wrong if it is nowhere known where the platform was while a camera took these frames.
    pub(crate) fn problem_with(&self, frames: &TimeSpan) -> Option<String> {
        let times_s = || self.rows.iter().map(Motion::time_s);
        let first_s = times_s().fold(f64::INFINITY, f64::min);
        let last_s = times_s().fold(f64::NEG_INFINITY, f64::max);
        let is_near = frames.first_s <= last_s + MAX_EXTRAPOLATION_S
            && first_s - MAX_EXTRAPOLATION_S <= frames.last_s;
        (!is_near).then(|| {
            format!(
                "{}: covers {first_s} to {last_s} s, and the frames {} to {} s; give the motion during the frames in seconds, \
                 or set platforms.{}.time_offset_s if the clocks differ",
                self.path.shown(),
                frames.first_s,
                frames.last_s,
                self.name
            )
        })
    }

    /// Returns warnings about what the platform reported.
    fn warnings(&self, counts: &PlatformCounts, frames_without_pose: usize) -> Vec<String> {
        let place = format!("warning: platforms.{}", self.name);
        let file = self.path.shown();
        let mut warnings = Vec::new();
        let live = self.live.as_ref().map(Live::counts);
        warnings.extend(self.silence().map(|silence| format!("warning: {silence}")));
        if let Some(live) = live.filter(|live| live.unusable > 0) {
            warnings.push(format!(
                "{place}: left out {} of {} that came to {file}",
                live.unusable,
                counted(live.received as u64, "datagram")
            ));
        }
        if frames_without_pose > 0 {
            let frames = counted(frames_without_pose as u64, "frame");
            warnings.push(format!(
                "{place}: {file} has no pose near the times of {frames}, which were not used{}",
                if live.is_some() {
                    ": none came, or their times are not those of the images"
                } else {
                    "; targets were predicted meanwhile"
                }
            ));
        }
        let age_s = live.and_then(|live| live.least_age_s);
        if let Some(age_s) = age_s.filter(|age_s| !(-MAX_AHEAD_S..MAX_AGE_S).contains(age_s)) {
            let way = if age_s > 0.0 { "behind" } else { "ahead of" };
            warnings.push(format!(
                "{place}: the times of all poses that came to {file} are {:.2} s or more {way} this computer's clock; set both clocks, such as with NTP, or leave out time_unix_s",
                age_s.abs()
            ));
        }
        if counts.late > 0 {
            let rows = counted(counts.late as u64, "row");
            let remedy = if live.is_some() {
                "send each once, in order"
            } else {
                "sort the file by time, and look for repeated rows"
            };
            warnings.push(format!(
                "{place}: ignored {rows} of {file} whose times are not later than those before; {remedy}"
            ));
        }
        if counts.gaps > 0 {
            let gaps = counted(counts.gaps as u64, "gap");
            warnings.push(format!(
                "{place}: {gaps} between the increments of {file}; the platform was taken to move evenly meanwhile"
            ));
        }
        if counts.jumps > 0 {
            let jumps = counted(counts.jumps as u64, "jump");
            let consequence = if self.is_odometry {
                "these increments were ignored"
            } else {
                "known targets kept their places relative to the platform"
            };
            let cause = if live.is_some() {
                "do two programs send, or do poses without time_unix_s come irregularly? Are positions in metres and angles in radians?"
            } else {
                "are positions in metres and angles in radians?"
            };
            warnings.push(format!(
                "{place}: {jumps} in {file} that no motion explains; {consequence}; {cause}"
            ));
        }
        if self.is_upside_down() {
            warnings.push(format!(
                "{place}: {file} has the platform upside down in every pose; quaternions have w last: qx, qy, qz, qw"
            ));
        }
        warnings
    }

    /// Returns a warning if it is live, and nothing has come.
    fn silence(&self) -> Option<String> {
        let received = self.live.as_ref()?.counts().received;
        (received == 0).then(|| {
            format!(
                "platforms.{}: nothing came to {}; let the other program send its poses to this address",
                self.name,
                self.path.shown()
            )
        })
    }

    /// Reports whether the platform's z axis points down in every pose of a file.
    fn is_upside_down(&self) -> bool {
        let is_down = |motion: &Motion| match motion {
            Motion::Pose(pose) => pose.world_from_platform.rotation[(2, 2)] < -0.5,
            Motion::Increment(_) => false,
        };
        self.live.is_none() && self.rows.iter().all(is_down)
    }

    /// Tells the tracker what is needed for images of this time, see [`tell`].
    fn tell(
        &mut self,
        tracker: &mut Tracker,
        id: PlatformId,
        time_s: f64,
    ) -> Result<(), pardalis_core::Error> {
        while let Some(motion) = self.rows.get(self.told)
            && tracker
                .platform(id)?
                .latest_s()
                .is_none_or(|latest_s| latest_s < time_s)
        {
            self.told += 1;
            let told = match motion {
                Motion::Pose(pose) => tracker.observe_pose(id, pose),
                Motion::Increment(increment) => tracker.observe_increment(id, increment),
            };
            match (told, &self.live) {
                // It must not end the run.
                (Err(error), Some(live)) => live.refuse(&error.into()),
                (told, _) => drop(told?),
            }
        }
        Ok(())
    }
}

/// Returns warnings about what the platforms of a tracker reported, one per line.
pub(crate) fn warnings(platforms: &[PlatformRows], tracker: &Tracker) -> Vec<String> {
    let of_platform = |(number, platform): (usize, &PlatformRows)| {
        let id = PlatformId::new(number);
        let counts = tracker.platform(id).ok()?.counts();
        let frames = tracker.frames_without_pose(id).ok()?;
        Some(platform.warnings(&counts, frames))
    };
    let platforms = platforms.iter().enumerate();
    platforms.filter_map(of_platform).flatten().collect()
}

/// Returns the entries of the summary about the platforms, by name.
pub(crate) fn entries(platforms: &[PlatformRows], tracker: &Tracker) -> Map<String, Value> {
    let of_platform = |(number, platform): (usize, &PlatformRows)| {
        let id = PlatformId::new(number);
        let counts = tracker.platform(id).ok()?.counts();
        let mut entry = json!({
            "file": platform.path.to_string_lossy().into_owned(),
            "used": counts.used,
            "late": counts.late,
            "jumps": counts.jumps,
            "gaps": counts.gaps,
            "frames_without_pose": tracker.frames_without_pose(id).ok()?,
        });
        if let Some(live) = platform.live.as_ref().map(Live::counts) {
            entry["received"] = json!(live.received);
            entry["unusable"] = json!(live.unusable);
        }
        Some((platform.name.clone(), entry))
    };
    let platforms = platforms.iter().enumerate();
    platforms.filter_map(of_platform).collect()
}

/// Tells the tracker where these platforms are, up to the first row at or after a time in seconds. `least_delay_s` is what to add to such times for those on the
/// clock of the program, with live cameras.
pub(crate) fn tell(
    platforms: &mut [PlatformRows],
    tracker: &mut Tracker,
    time_s: f64,
    least_delay_s: Option<f64>,
) -> Result<()> {
    for (number, platform) in platforms.iter_mut().enumerate() {
        if let (Some(live), Some(least_delay_s)) = (&mut platform.live, least_delay_s) {
            // Weeks of them would fill the memory.
            platform.rows.drain(..platform.told);
            platform.told = 0;
            let offset_s = platform.time_offset_s - least_delay_s;
            platform.rows.extend(live.take(offset_s));
        }
        platform.tell(tracker, PlatformId::new(number), time_s)?;
    }
    Ok(())
}

/// Returns what has come of live platforms, in words, and warnings about what is wrong with it.
pub(crate) fn heard(platforms: &mut [PlatformRows]) -> (Vec<String>, Vec<String>) {
    let (mut said, mut warnings) = (Vec::new(), Vec::new());
    for platform in platforms {
        warnings.extend(platform.silence());
        let Some(live) = &mut platform.live else {
            continue;
        };
        let counts = live.counts();
        let poses = counted((counts.received - counts.unusable) as u64, "pose");
        let (name, place) = (&platform.name, platform.path.shown());
        said.push(format!("platforms.{name}: {poses} came to {place}"));
        let refusal = live.refusal().into_iter();
        warnings.extend(refusal.map(|refusal| format!("platforms.{name}: {refusal}")));
    }
    (said, warnings)
}

/// Returns what should be said of live platforms while tracking, and has not been said.
pub(crate) fn news(platforms: &mut [PlatformRows]) -> Vec<String> {
    let mut news = Vec::new();
    for platform in platforms {
        let of_platform = platform.live.iter_mut().flat_map(Live::news);
        news.extend(of_platform.map(|text| format!("platforms.{}: {text}", platform.name)));
    }
    news
}

/// Tells a platform these rows of a file, which come with their lines, to see whether it takes them. Returns how many are late.
fn check(path: &Path, rows: &[(Motion, u64)], errors: OdometryErrors) -> Result<usize> {
    let mut platform = Platform::new(errors)?;
    for (motion, line) in rows {
        let told = motion.tell(&mut platform);
        told.map_err(|error| user_error!("{}, line {line}: {error}", path.shown()))?;
    }
    Ok(platform.counts().late)
}

/// Reads any bytes as a file of poses or of odometry. Returns the number of rows that a platform takes.
#[cfg(any(test, feature = "fuzz"))]
pub(crate) fn read_bytes(bytes: &[u8], path: &Path, is_odometry: bool) -> Result<usize> {
    let rows = files::rows_in(bytes, path, is_odometry)?;
    check(path, &rows, OdometryErrors::default())?;
    Ok(rows.len())
}
