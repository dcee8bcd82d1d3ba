//! The contents of an experiment file.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::Result;
use pardalis_evaluate::Settings;
use pardalis_scene::{NAMES_ALLOWED, is_name};
use serde::Deserialize;
use toml::Value;

use super::metrics::METRICS;
use crate::scene::read_text;
use crate::user_error::user_error;

/// The contents of the file, unchecked.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    name: String,
    #[expect(dead_code, reason = "for the reader of the file")]
    question: String,
    #[serde(default)]
    runs: Vec<Run>,
    #[serde(default)]
    sweeps: Vec<Run>,
    #[serde(default)]
    figures: Vec<Figure>,
}

/// An experiment: a group of related runs.
#[derive(Debug)]
pub(super) struct Experiment {
    /// The name of its result files.
    pub(super) name: String,
    /// The runs, followed by those of the sweeps.
    pub(super) runs: Vec<Run>,
    /// Figures over several runs.
    pub(super) figures: Vec<Figure>,
}

/// A figure of several runs.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Figure {
    /// The name of its files.
    pub(super) name: String,
    pub(super) kind: FigureKind,
    /// Names of runs, or of sweeps for all their runs.
    pub(super) runs: Vec<String>,
    /// For paths: draws only this number of seeds, so that they do not cover one another.
    pub(super) seeds: Option<u32>,
    /// For paths: shows nearly all estimates instead of only the surroundings of the truth.
    #[serde(default)]
    pub(super) reaches_far: bool,
    /// For a sweep: the label of the axis of values; if `None`, the key that the first sweep varies.
    pub(super) x_name: Option<String>,
    /// For a sweep: the figure of merit, a length.
    #[serde(default = "rmse_m")]
    pub(super) figure: String,
}

fn rmse_m() -> String {
    "rmse_m".to_owned()
}

/// The contents of a figure.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum FigureKind {
    /// The paths of all seeds, one colour per run.
    Paths,
    /// Errors of distance, elevation and azimuth against distance, one mark per run.
    Errors,
    /// A figure of merit against the values of sweeps, and against the time per frame.
    Sweep,
    /// The share of rows that are right against their confidence, one mark per run or sweep.
    Reliability,
}

impl Figure {
    /// Reports whether it shows this run.
    pub(super) fn shows(&self, run: &Run) -> bool {
        let sweep = run.swept.as_ref().map(|swept| &swept.sweep);
        (self.runs.iter()).any(|name| *name == run.name || Some(name) == sweep)
    }

    /// Checks the figure.
    fn check(&self, runs: &[Run]) -> Result<(), String> {
        check_name(&self.name)?;
        let sweep_of = |run: &Run| run.swept.as_ref().map(|swept| swept.sweep.clone());
        let sweeps = runs.iter().filter_map(sweep_of);
        let known: Vec<String> = match self.kind {
            FigureKind::Sweep => sweeps.collect(),
            _ => runs
                .iter()
                .map(|run| run.name.clone())
                .chain(sweeps)
                .collect(),
        };
        if let Some(unknown) = self.runs.iter().find(|name| !known.contains(name)) {
            let what = match self.kind {
                FigureKind::Sweep => "sweep",
                _ => "run or sweep",
            };
            return Err(format!("runs: \"{unknown}\" is not a {what} of this file"));
        }
        let lengths = METRICS.iter().map(|(name, _)| *name);
        let lengths: Vec<_> = lengths.filter(|name| name.ends_with("_m")).collect();
        if !lengths.contains(&&*self.figure) {
            return Err(format!(
                "figure is \"{}\"; allowed: {}",
                self.figure,
                lengths.join(", ")
            ));
        }
        Ok(())
    }
}

/// The position of a run in a sweep.
#[derive(Debug, Clone)]
pub(super) struct Swept {
    /// The sweep's name.
    pub(super) sweep: String,
    /// The key that varies, without the tables that contain it.
    pub(super) key: String,
    /// The label of the value.
    pub(super) label: String,
    /// The value, if it is a number.
    pub(super) value: Option<f64>,
}

/// One scene with several seeds.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Run {
    pub(super) name: String,
    /// Paths start at the experiment's folder. A simulated world comes with its own scene and truth.
    #[serde(default)]
    pub(super) scene: String,
    #[serde(default)]
    pub(super) truth: String,
    /// A world to simulate first.
    pub(super) world: Option<String>,
    /// Whether each seed has its own recording, simulated with the same seed.
    #[serde(default)]
    pub(super) fresh_world: bool,
    /// Number of seeds; seeds 1, 2, … are run.
    pub(super) seeds: u32,
    /// Number of seeds that `--verify` runs.
    #[serde(default)]
    pub(super) verify_seeds: u32,
    /// Values that replace those of the scene, by full key, or those of the world, by full key after `world.`.
    #[serde(default)]
    pub(super) set: toml::Table,
    /// Whether its seeds run one at a time, to measure the time per frame.
    #[serde(default)]
    pub(super) timed: bool,
    /// Origin of distance, elevation and azimuth in the world frame; if `None`, the first camera.
    pub(super) origin_m: Option<[f64; 3]>,
    /// An object counts as visible if more than this share of it is visible, and an estimate farther than
    /// `lost_beyond_m` from it counts as lost.
    #[serde(default = "visible_over")]
    pub(super) visible_over: f64,
    #[serde(default = "lost_beyond_m")]
    pub(super) lost_beyond_m: f64,
    /// Whether the truth is interpolated to the times of the tracks.
    #[serde(default)]
    pub(super) interpolate: bool,
    /// How positions are estimated.
    #[serde(default)]
    pub(super) method: Method,
    /// For `locate`: a table with a rough position for each image, like truth.csv; if `None`, the scene's start.
    pub(super) starts: Option<String>,
    /// Lowest and highest value of figures, for every seed and target.
    #[serde(default)]
    pub(super) expect: Bands,
    /// Parts of the time for which the figures are computed separately.
    #[serde(default)]
    pub(super) windows: Vec<Window>,
    /// For a sweep: the full key, or keys, whose value varies between runs.
    key: Option<Keys>,
    /// For a sweep: the values; with several keys, each value is a list with one entry per key.
    values: Option<Vec<Value>>,
    /// For a sweep: a label for each value, if the values themselves are unsuitable.
    names: Option<Vec<String>>,
    /// For a run of a sweep: its position in it.
    #[serde(skip)]
    pub(super) swept: Option<Swept>,
}

fn visible_over() -> f64 {
    Settings::VISIBLE_OVER
}

fn lost_beyond_m() -> f64 {
    Settings::LOST_BEYOND_M
}

/// Maximum number of seeds of a run.
const MAX_SEEDS: u32 = 10_000;

/// Lowest and highest value of figures, by name.
pub(super) type Bands = BTreeMap<String, [f64; 2]>;

/// How positions are estimated.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Hash, Deserialize)]
#[serde(rename_all = "lowercase")]
pub(super) enum Method {
    /// From frame to frame, like `pardalis track`.
    #[default]
    Track,
    /// In each image independently, like `pardalis locate`.
    Locate,
}

/// A selection of frames.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Window {
    pub(super) name: String,
    /// The first and the last time, in seconds; if `None`, those of the truth.
    pub(super) from_s: Option<f64>,
    pub(super) to_s: Option<f64>,
    /// Only frames in which this number of cameras see the object.
    pub(super) seen_by: Option<usize>,
    /// Like that of a run, for these frames.
    #[serde(default)]
    pub(super) expect: Bands,
}

/// The keys that a sweep varies.
#[derive(Debug, Clone, Deserialize)]
#[serde(untagged)]
enum Keys {
    One(String),
    Several(Vec<String>),
}

impl Keys {
    /// Returns the last components of the keys.
    fn shown(&self) -> String {
        let keys = match self {
            Self::One(key) => std::slice::from_ref(key),
            Self::Several(keys) => keys,
        };
        let last = keys.iter().map(|key| key.rsplit('.').next().unwrap_or(key));
        last.collect::<Vec<_>>().join(", ").replace('_', " ")
    }
}

impl Run {
    /// Returns the run's name as a folder name.
    pub(super) fn slug(&self) -> String {
        self.name
            .chars()
            .map(|c| {
                if c.is_ascii_alphanumeric() {
                    c.to_ascii_lowercase()
                } else {
                    '-'
                }
            })
            .collect()
    }

    /// Returns the runs of a sweep, one per value. Errors do not name the sweep.
    fn expanded(self) -> Result<Vec<Self>, String> {
        let (Some(key), Some(values)) = (&self.key, &self.values) else {
            return Err("needs key and values".to_owned());
        };
        if self.names.as_ref().is_some_and(|n| n.len() != values.len()) {
            return Err("the numbers of names and of values differ".to_owned());
        }
        let one_run = |(i, value): (usize, &Value)| {
            let mut set = self.set.clone();
            match key {
                Keys::One(key) => {
                    set.insert(key.clone(), value.clone());
                }
                Keys::Several(keys) => {
                    let parts = value.as_array().filter(|parts| parts.len() == keys.len());
                    let parts = parts.ok_or_else(|| {
                        format!(
                            "value {value} is not a list of {} values, one per key",
                            keys.len()
                        )
                    })?;
                    set.extend(keys.iter().cloned().zip(parts.iter().cloned()));
                }
            }
            let label = match &self.names {
                Some(names) => names[i].clone(),
                None => label(value)?,
            };
            Ok(Self {
                name: format!("{}: {label}", self.name),
                swept: Some(Swept {
                    sweep: self.name.clone(),
                    key: key.shown(),
                    label,
                    value: number(value),
                }),
                set,
                key: None,
                values: None,
                names: None,
                ..self.clone()
            })
        };
        values.iter().enumerate().map(one_run).collect()
    }

    /// Returns the values that replace those of the scene, and those that replace those of the world.
    pub(super) fn replaced(&self) -> [toml::Table; 2] {
        let (mut of_scene, mut of_world) = (toml::Table::new(), toml::Table::new());
        for (key, value) in &self.set {
            match key.strip_prefix("world.") {
                Some(key) => of_world.insert(key.to_owned(), value.clone()),
                None => of_scene.insert(key.clone(), value.clone()),
            };
        }
        [of_scene, of_world]
    }

    /// Checks the run.
    fn check(&self) -> Result<(), String> {
        let given = [&self.scene, &self.truth].map(|file| !file.is_empty());
        match (&self.world, given) {
            (None, [true, true]) | (Some(_), [false, false]) => {}
            (None, _) => return Err("needs scene and truth, or a world instead of both".to_owned()),
            (Some(_), _) => {
                return Err(
                    "a world comes with its own scene and truth; remove scene and truth".to_owned(),
                );
            }
        }
        if self.fresh_world && self.world.is_none() {
            return Err("fresh_world needs the key world".to_owned());
        }
        if self.world.is_none() && !self.replaced()[1].is_empty() {
            return Err("set: keys that begin with world. need the key world".to_owned());
        }
        if self.fresh_world && self.set.contains_key("world.seed") {
            let why = "set: world.seed has no effect with fresh_world; remove one of them";
            return Err(why.to_owned());
        }
        if self.key.is_some() || self.values.is_some() || self.names.is_some() {
            return Err(
                "key, values and names belong to sweeps; write this run under [[sweeps]]"
                    .to_owned(),
            );
        }
        if self.starts.is_some() && self.method != Method::Locate {
            return Err("starts needs method = \"locate\"".to_owned());
        }
        if self
            .origin_m
            .is_some_and(|o| !o.iter().all(|c| c.is_finite()))
        {
            return Err("origin_m: allowed: three finite numbers".to_owned());
        }
        if !(0.0..1.0).contains(&self.visible_over) {
            return Err("visible_over: allowed: 0 up to, but not including, 1".to_owned());
        }
        if !(self.lost_beyond_m > 0.0 && self.lost_beyond_m.is_finite()) {
            return Err("lost_beyond_m: allowed: more than 0".to_owned());
        }
        if !(1..=MAX_SEEDS).contains(&self.seeds) {
            return Err(format!(
                "seeds is {}; allowed: 1 to {MAX_SEEDS}",
                self.seeds
            ));
        }
        if self.set.contains_key("seed") {
            return Err(
                "set: seed has no effect because seeds 1, 2, … are run; remove it".to_owned(),
            );
        }
        known_figures(&self.expect, "expect")?;
        for (i, window) in self.windows.iter().enumerate() {
            let name = &window.name;
            if name.is_empty() || self.windows[..i].iter().any(|w| w.name == *name) {
                return Err(format!(
                    "the window \"{name}\": its name is empty or used twice; give each window a unique name"
                ));
            }
            let ends = (
                window.from_s.unwrap_or(f64::NEG_INFINITY),
                window.to_s.unwrap_or(f64::INFINITY),
            );
            if !(ends.0 < ends.1) {
                return Err(format!("the window \"{name}\": from_s must be before to_s"));
            }
            known_figures(&window.expect, &format!("the window \"{name}\": expect"))?;
        }
        Ok(())
    }
}

/// Returns a value as a part of a name.
fn label(value: &Value) -> Result<String, String> {
    match value {
        Value::String(text) => Ok(text.clone()),
        Value::Table(_) => Err("values are tables; label each in names = [..]".to_owned()),
        Value::Array(parts) => {
            let parts: Result<Vec<_>, _> = parts.iter().map(label).collect();
            Ok(parts?.join(", "))
        }
        other => Ok(other.to_string()),
    }
}

fn number(value: &Value) -> Option<f64> {
    let whole = value.as_integer().map(|number| number as f64);
    whole.or_else(|| value.as_float())
}

/// Checks a name of files or folders.
fn check_name(name: &str) -> Result<(), String> {
    if is_name(name) {
        Ok(())
    } else {
        Err(format!(
            "name is \"{name}\"; allowed: {NAMES_ALLOWED}, as it names files"
        ))
    }
}

fn known_figures(expect: &Bands, place: &str) -> Result<(), String> {
    if let Some((metric, [lowest, highest])) = expect.iter().find(|(_, [low, high])| !(low <= high))
    {
        return Err(format!(
            "{place}.{metric} is [{lowest}, {highest}]; allowed: the lowest and the highest value"
        ));
    }
    let unknown = |metric: &&String| METRICS.iter().all(|(name, _)| name != metric);
    let Some(metric) = expect.keys().find(unknown) else {
        return Ok(());
    };
    let allowed: Vec<_> = METRICS.iter().map(|(name, _)| *name).collect();
    Err(format!(
        "{place}.{metric} is not a figure; allowed: {}",
        allowed.join(", ")
    ))
}

impl Experiment {
    /// Reads and checks the file.
    pub(super) fn read(path: &Path) -> Result<Self> {
        let text = read_text(path)?;
        let place = path.display();
        let file: File = toml::from_str(&text).map_err(|error| user_error!("{place}: {error}"))?;
        check_name(&file.name).map_err(|wrong| user_error!("{place}: {wrong}"))?;
        let mut runs = file.runs;
        for sweep in file.sweeps {
            let name = sweep.name.clone();
            let expanded = sweep.expanded();
            runs.extend(
                expanded.map_err(|wrong| user_error!("{place}: sweep \"{name}\": {wrong}"))?,
            );
        }
        for (i, run) in runs.iter().enumerate() {
            run.check()
                .map_err(|wrong| user_error!("{place}: run \"{}\": {wrong}", run.name))?;
            if let Some(other) = runs[..i].iter().find(|other| other.slug() == run.slug()) {
                return Err(user_error!(
                    "{place}: the runs \"{}\" and \"{}\" would write into the same folder, {}; give names that differ in letters or digits",
                    other.name,
                    run.name,
                    run.slug()
                ));
            }
        }
        for (i, figure) in file.figures.iter().enumerate() {
            let name = &figure.name;
            let mut checked = figure.check(&runs);
            if file.figures[..i].iter().any(|other| other.name == *name) {
                checked = Err("the name is used twice".to_owned());
            }
            checked.map_err(|wrong| user_error!("{place}: figure \"{name}\": {wrong}"))?;
        }
        Ok(Self {
            name: file.name,
            runs,
            figures: file.figures,
        })
    }
}
