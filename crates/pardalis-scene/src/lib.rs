//! Scene and world files: from their text to checked settings. Configuration enters here once; the rest of the library takes values that are valid.

mod appearance;
pub mod calibration;
mod camera;
mod mirror;
mod motion;
mod offsets;
mod plane;
mod reader;
mod replaced;
mod setting;
mod start;
mod target;
mod timing;
mod world;

pub use camera::{CameraConfig, FrameRange, Input, MaskCircle, ReadCalibration};
pub use offsets::with_time_offsets;
pub use plane::RectangleConfig;
pub use reader::{Located, Problem};
pub use start::{StartConfig, TrackStart};
pub use target::{BodyConfig, TargetConfig, TrackingConfig};
pub use world::WorldConfig;

use reader::{Journal, Table};
use target::CameraNames;

/// What [`is_name`] holds for, in words.
pub const NAMES_ALLOWED: &str = "1 to 64 of the characters A-Z a-z 0-9 _ -";

/// Whether a text may name a camera, target or object: such names are keys of files, fields of tables and parts of paths.
pub fn is_name(text: &str) -> bool {
    let plain = |c: char| c.is_ascii_alphanumeric() || c == '_' || c == '-';
    (1..=64).contains(&text.len()) && text.chars().all(plain)
}

/// All that a scene file says.
#[derive(Debug, Clone, PartialEq)]
pub struct Scene {
    /// Seed of every random number.
    pub seed: u32,
    /// The cameras, in the order of the text.
    pub cameras: Vec<CameraConfig>,
    /// The targets, in the order of the text.
    pub targets: Vec<TargetConfig>,
    /// How long a frame waits, from its arrival, for earlier ones of other cameras, in seconds.
    pub max_delay_s: f64,
    /// What is allowed but may not be meant.
    pub warnings: Vec<Problem>,
    /// Every setting with its final value, given or default, for summaries.
    pub resolved: toml::Table,
}

impl Scene {
    /// Reads a scene's text whole; calibration files that it names are read by way of the caller. On failure: every problem, in the order of lines.
    pub fn parse(text: &str, read_calibration: ReadCalibration) -> Result<Self, Vec<Problem>> {
        Self::parse_with(text, &toml::Table::new(), read_calibration)
    }

    /// Reads a scene's text as [`Scene::parse`] does, with some of its settings replaced or added.
    ///
    /// `replaced` maps full keys, as `targets.ball.filter.particles`, to values; a table replaces all of the table that stands there.
    /// Problems with these values have no line.
    pub fn parse_with(
        text: &str,
        replaced: &toml::Table,
        read_calibration: ReadCalibration,
    ) -> Result<Self, Vec<Problem>> {
        let (journal, mut root) = Journal::parse(text);
        let values = replaced::text_behind(text, replaced);
        replaced::put_all(&mut root, replaced, &values);
        let table = Table::root(&journal, &root);
        let seed = table.or("seed", 1_u32);
        let camera_tables = table.named_tables("cameras", "camera");
        let camera_names: Vec<String> =
            camera_tables.iter().map(|(name, _)| name.clone()).collect();
        let cameras: Vec<_> = camera_tables
            .into_iter()
            .filter_map(|(name, table)| CameraConfig::read(name, table, read_calibration))
            .collect();
        let names = CameraNames {
            without_height: plane::without_height(&cameras),
            lowest: plane::lowest(&cameras),
            all: camera_names,
        };
        let targets: Vec<_> = table
            .named_tables("targets", "target")
            .into_iter()
            .filter_map(|(name, table)| TargetConfig::read(name, table, &names))
            .collect();
        let max_delay_s = timing::read_max_delay_s(&table, names.all.len());
        table.finish();
        let (mut warnings, resolved) = journal.finish()?;
        warnings.extend(timing::cameras_at_one_place(&cameras));
        Ok(Self {
            seed,
            cameras,
            targets,
            max_delay_s,
            warnings,
            resolved,
        })
    }
}
