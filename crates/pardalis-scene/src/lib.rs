//! Scene, world, calibration and experiment files: from their text to validated settings.
//!
//! All problems of a file are reported at once, with key and line. [`mod@reference`] describes every key.

mod appearance;
mod assembly;
mod body;
pub mod calibration;
mod camera;
mod camera_names;
mod camera_settings;
mod crossing;
pub mod description;
mod detector;
mod existence;
pub mod experiment;
mod filter;
mod guesses;
mod journal;
mod key;
mod keys;
mod mirror;
mod model;
mod motion;
mod plane;
mod platform;
mod reader;
pub mod reference;
mod replaced;
mod schema;
mod setting;
mod shape;
mod shared;
mod start;
mod target;
mod timing;
mod video;
mod world;

pub use assembly::{Assembly, Files};
pub use body::{BodyConfig, TrackingConfig};
pub use camera::{
    CameraConfig, FrameRange, Input, Inputs, MaskCircle, ReadCalibration, is_rectified,
};
pub use camera_settings::{CameraSetting, with_camera_settings};
pub use crossing::CrossingConfig;
pub use detector::DetectorConfig;
pub use journal::{Located, Problem};
pub use plane::RectangleConfig;
pub use platform::{PlatformConfig, PlatformMotion};
pub use start::{StartConfig, TrackStart};
pub use target::TargetConfig;
pub use video::{
    DeviceCodec, Hardware, Protocol, RtspTransport, VideoFormat, VideoInput, VideoPlace,
    VideoSettings, WhenBehind,
};
pub use world::WorldConfig;

use camera::Poses;
use camera_names::CameraNames;
use description::{KeyDescription, Presence};
use keys::keys_of;
use reader::Table;
use replaced::read_parts;

/// The rule that [`is_name`] checks, as text.
pub const NAMES_ALLOWED: &str = "1 to 64 of the characters A-Z a-z 0-9 _ -";

/// Reports whether a text may name a camera, target or object. Names appear in keys, tables and paths.
pub fn is_name(text: &str) -> bool {
    let plain = |c: char| c.is_ascii_alphanumeric() || c == '_' || c == '-';
    (1..=64).contains(&text.len()) && text.chars().all(plain)
}

/// The settings of a scene file.
#[derive(Debug, Clone, PartialEq)]
pub struct Scene {
    /// Seed of every random number.
    pub seed: u32,
    /// The cameras, in the order of the text.
    pub cameras: Vec<CameraConfig>,
    /// The moving platforms, in the order of the text.
    pub platforms: Vec<PlatformConfig>,
    /// The targets, in the order of the text.
    pub targets: Vec<TargetConfig>,
    /// How long a frame waits after its arrival for earlier frames of other cameras, in seconds.
    pub max_delay_s: f64,
    /// Full keys of values that are guesses, as the scene lists them.
    pub guesses: Vec<String>,
    /// Settings that are valid but probably not intended.
    pub warnings: Vec<Problem>,
    /// Every setting with its final value, given or default, for summaries.
    pub resolved: toml::Table,
}

impl Scene {
    /// The default seed.
    pub const DEFAULT_SEED: u32 = 1;

    /// Returns the default of [`Scene::max_delay_s`] in seconds: 0 for a single camera, which has no others to wait
    /// for.
    pub fn default_max_delay_s(camera_count: usize) -> f64 {
        if camera_count > 1 { 0.1 } else { 0.0 }
    }

    /// Reads a scene's text. The caller reads the calibration files that the scene names. Returns every problem on
    /// failure, in the order of lines.
    pub fn parse(text: &str, read_calibration: ReadCalibration) -> Result<Self, Vec<Problem>> {
        Self::parse_with(text, &toml::Table::new(), read_calibration)
    }

    /// Reads a scene's text like [`Scene::parse`], with some of its settings replaced or added.
    ///
    /// `replaced` maps full keys, such as `targets.ball.filter.particles`, to values. A table replaces the whole
    /// table of that key. Problems with these values have no line.
    pub fn parse_with(
        text: &str,
        replaced: &toml::Table,
        read_calibration: ReadCalibration,
    ) -> Result<Self, Vec<Problem>> {
        let read = read_parts(text, replaced, |_, table| {
            Self::read(table, read_calibration, (Inputs::Named, Poses::Stated))
        });
        let (warnings, resolved) = read.found?;
        Ok(read.result.with(warnings, resolved))
    }

    /// Reads a scene's text like [`Scene::parse_with`], for a caller who has the frames of its cameras and the motion of its platforms.
    /// [`Assembly`] makes its tracker.
    pub fn parse_without_inputs(
        text: &str,
        replaced: &toml::Table,
        read_calibration: ReadCalibration,
    ) -> Result<Self, Vec<Problem>> {
        let read = read_parts(text, replaced, |_, table| {
            Self::read(table, read_calibration, (Inputs::Given, Poses::Stated))
        });
        let (warnings, resolved) = read.found?;
        Ok(read.result.with(warnings, resolved))
    }

    /// Reads a scene's text like [`Scene::parse`], for a caller who finds the poses of its cameras. Cameras may lack a pose; those without
    /// one have [`CameraConfig::has_pose`] false, as have those whose pose is listed as a guess.
    pub fn parse_without_poses(
        text: &str,
        read_calibration: ReadCalibration,
    ) -> Result<Self, Vec<Problem>> {
        let read = read_parts(text, &toml::Table::new(), |_, table| {
            Self::read(table, read_calibration, (Inputs::Named, Poses::Sought))
        });
        let (warnings, resolved) = read.found?;
        Ok(read.result.with(warnings, resolved))
    }

    /// Reads a scene's text like [`Scene::parse`], with all its problems and in spite of them: the scene lacks the cameras and
    /// targets with problems, and has none after a syntax error. References between cameras and targets hold only if there
    /// are no problems.
    pub fn parse_parts(text: &str, read_calibration: ReadCalibration) -> (Self, Vec<Problem>) {
        Self::read_parts(text, read_calibration, Poses::Stated)
    }

    /// Reads a scene's text like [`Scene::parse_parts`], for a caller who shows cameras of which no pose is known: these remain in the scene, as in
    /// [`Scene::parse_without_poses`], and that their poses are missing is among the problems.
    pub fn parse_parts_without_poses(
        text: &str,
        read_calibration: ReadCalibration,
    ) -> (Self, Vec<Problem>) {
        let (mut scene, problems) = Self::read_parts(text, read_calibration, Poses::Stated);
        scene.cameras = Self::read_parts(text, read_calibration, Poses::Sought)
            .0
            .cameras;
        (scene, problems)
    }

    fn read_parts(
        text: &str,
        read_calibration: ReadCalibration,
        poses: Poses,
    ) -> (Self, Vec<Problem>) {
        let read = read_parts(text, &toml::Table::new(), |_, table| {
            Self::read(table, read_calibration, (Inputs::Named, poses))
        });
        let mut scene = read.result;
        match read.found {
            Ok((warnings, resolved)) => (scene.with(warnings, resolved), Vec::new()),
            Err(problems) => {
                let is_sound = |table: String| {
                    let inside = format!("{table}.");
                    let is_in = |key: &str| key == table || key.starts_with(&inside);
                    !read.has_syntax_error && !problems.iter().any(|problem| is_in(&problem.key))
                };
                // Invalid settings are left out of them, from which further problems would follow.
                let is_sound_camera =
                    |camera: &CameraConfig| is_sound(format!("cameras.{}", camera.name));
                scene.cameras.retain(is_sound_camera);
                let is_sound_target =
                    |target: &TargetConfig| is_sound(format!("targets.{}", target.name));
                scene.targets.retain(is_sound_target);
                (scene, problems)
            }
        }
    }

    /// Adds what was found while the scene was read.
    fn with(mut self, warnings: Vec<Problem>, resolved: toml::Table) -> Self {
        self.warnings = warnings;
        self.warnings
            .extend(timing::cameras_at_one_place(&self.cameras));
        self.resolved = resolved;
        self
    }

    /// Returns the keys of scene files.
    pub fn keys() -> Vec<KeyDescription> {
        keys_of(|_, table| {
            Self::read(
                table,
                &|_, _| Err(String::new()),
                (Inputs::Named, Poses::Stated),
            );
        })
    }

    /// Reads all settings; invalid ones are left out and reported to the journal.
    fn read(
        table: &Table,
        read_calibration: ReadCalibration,
        (inputs, poses): (Inputs, Poses),
    ) -> Self {
        let seed = table
            .key("seed", "Seed of all random numbers.")
            .or(Self::DEFAULT_SEED);
        let guesses = guesses::read_guesses(table);
        let about = "The cameras, each by its name.";
        let camera_tables = table.named_tables("cameras", about, Presence::Required);
        let camera_names: Vec<String> =
            camera_tables.iter().map(|(name, _)| name.clone()).collect();
        let about =
            "Moving platforms that carry cameras, each by its name: robots, pan-tilt heads, arms.";
        let platform_tables = table.named_tables("platforms", about, Presence::Optional(""));
        let platform_names: Vec<String> = platform_tables
            .iter()
            .map(|(name, _)| name.clone())
            .collect();
        let platforms: Vec<_> = platform_tables
            .into_iter()
            .filter_map(|(name, table)| PlatformConfig::read(name, table, inputs))
            .collect();
        let mut cameras: Vec<_> = camera_tables
            .into_iter()
            .filter_map(|(name, table)| {
                let from = (inputs, poses);
                CameraConfig::read(name, table, &platform_names, read_calibration, from)
            })
            .collect();
        for camera in &mut cameras {
            let key = format!("cameras.{}.world_from_camera", camera.name);
            camera.has_pose &= !guesses.contains(&key);
        }
        if cameras.len() == camera_names.len() {
            check_platforms(table, &platform_names, &cameras);
        }
        let names = CameraNames::new(camera_names, &cameras);
        let about = "The targets, each by its name.";
        let targets: Vec<_> = table
            .named_tables("targets", about, Presence::Required)
            .into_iter()
            .filter_map(|(name, table)| TargetConfig::read(name, table, &names))
            .collect();
        check_crowds(table, &targets);
        if cameras.len() == names.all.len() && inputs == Inputs::Named {
            check_detections(table, &cameras, &targets);
        }
        warn_of_line_delays(table, &cameras, &targets);
        let max_delay_s = timing::read_max_delay_s(table, names.all.len());
        Self {
            seed,
            cameras,
            platforms,
            targets,
            max_delay_s,
            guesses,
            warnings: Vec::new(),
            resolved: toml::Table::new(),
        }
    }
}

/// Reports platforms that carry no camera.
fn check_platforms(root: &Table, platforms: &[String], cameras: &[CameraConfig]) {
    for platform in platforms {
        if !cameras
            .iter()
            .any(|camera| camera.platform.as_ref() == Some(platform))
        {
            let message = format!(
                "{platform} carries no camera; give platform = \"{platform}\" in the tables of its cameras"
            );
            root.problem("platforms", message);
        }
    }
}

/// Reports detectors whose detections are in no file, and the other way round.
fn check_detections(root: &Table, cameras: &[CameraConfig], targets: &[TargetConfig]) {
    let mut boxed = targets
        .iter()
        .filter(|target| target.bodies.iter().any(|body| body.class().is_some()));
    let mut with_file = cameras.iter().filter(|camera| camera.detections.is_some());
    match (boxed.next(), with_file.next()) {
        (Some(target), None) => {
            let message = format!(
                "{} has a detector, and no camera has its detections; give detections = \"FILE.csv\" in the tables of cameras",
                target.name
            );
            root.problem("targets", message);
        }
        // Targets with problems are left out; one of them may be it.
        (None, Some(camera)) if !targets.is_empty() => {
            let message = format!(
                "{} has detections, and no target has a detector; add [targets.NAME.detector], or remove detections",
                camera.name
            );
            root.problem("cameras", message);
        }
        _ => {}
    }
}

/// Reports targets that have the name of a member of a crowd.
fn check_crowds(root: &Table, targets: &[TargetConfig]) {
    for crowd in targets.iter().filter(|target| target.crowd.is_some()) {
        let is_member = |target: &&TargetConfig| {
            let rest = target.name.strip_prefix(&crowd.name);
            let number = rest.and_then(|rest| rest.strip_prefix('-'));
            number.is_some_and(|number| number.parse::<u32>().is_ok())
        };
        if let Some(target) = targets.iter().find(is_member) {
            root.problem(
                "targets",
                format!(
                    "name a target {}, which is the name of a member of the crowd {}; give it another name",
                    target.name, crowd.name
                ),
            );
        }
        let is_alike = |other: &&TargetConfig| {
            let (body, own) = (&other.bodies[0], &crowd.bodies[0]);
            let file =
                |colors: &Option<Located<String>>| colors.as_ref().map(|file| file.value.clone());
            other.name != crowd.name
                && body.class() == own.class()
                && body.shape == own.shape
                && file(&body.colors) == file(&own.colors)
        };
        if let Some(target) = targets.iter().find(is_alike) {
            root.warn(
                "targets",
                format!(
                    "{} looks like the crowd {}: the same shape and colours; each is found by whichever searches first",
                    target.name, crowd.name
                ),
            );
        }
    }
}

/// Warns of targets for which the rolling shutters of cameras are not taken into account.
fn warn_of_line_delays(root: &Table, cameras: &[CameraConfig], targets: &[TargetConfig]) {
    let is_other = |body: &BodyConfig| !matches!(body.tracking, TrackingConfig::Detected { .. });
    let mut others = targets
        .iter()
        .filter(|target| target.bodies.iter().any(is_other));
    if cameras.iter().all(|camera| camera.line_delay_s == 0.0) {
        return;
    }
    if let Some(target) = others.next() {
        let message = format!(
            "line_delay_s has no effect on targets.{}, which has a start, published cues or a detector. Only targets with the edge cue use it: remove these",
            target.name,
        );
        root.warn("cameras", message);
    }
}
