//! Runs and sweeps of an experiment.

use std::collections::BTreeMap;

use pardalis_evaluate::Settings;
use toml::Value;
use toml::de::DeValue;

use super::super::description::{Type, above};
use super::super::reader::Table;
use super::super::setting::{Setting, Word};
use super::FIGURES_OF_MERIT;

/// One scene with several seeds. Paths start at the experiment's folder.
#[derive(Debug, Clone, PartialEq)]
pub struct Run {
    /// Its name in results and messages.
    pub name: String,
    /// The scene's file; empty if there is a world, which comes with its own scene and truth.
    pub scene: String,
    /// The file with the truth; empty if there is a world.
    pub truth: String,
    /// The file of a world to simulate first.
    pub world: Option<String>,
    /// Whether each seed has its own recording, simulated with the same seed.
    pub fresh_world: bool,
    /// Number of seeds; seeds 1, 2, ... are run.
    pub seeds: u32,
    /// Number of seeds of a quick check.
    pub verify_seeds: u32,
    /// Values that replace those of the scene, by full key, or those of the world, by full key after `world.`.
    pub set: toml::Table,
    /// Whether its seeds run one at a time, to measure the time per frame.
    pub timed: bool,
    /// Origin of distance, elevation and azimuth in the world frame; if `None`, the first camera.
    pub origin_m: Option<[f64; 3]>,
    /// See [`Settings::visible_over`].
    pub visible_over: f64,
    /// See [`Settings::lost_beyond_m`].
    pub lost_beyond_m: f64,
    /// Whether the truth is interpolated to the times of the tracks.
    pub interpolate: bool,
    /// How positions are estimated.
    pub method: Method,
    /// To locate: a table with a rough position for each image, like truth.csv; if `None`, the scene's start.
    pub starts: Option<String>,
    /// Lowest and highest value of figures of merit, for every seed and target.
    pub expect: Bands,
    /// Parts of the recording for which the figures of merit are computed separately.
    pub windows: Vec<Window>,
    /// For a run of a sweep: its position in it.
    pub swept: Option<Swept>,
}

/// The position of a run in a sweep.
#[derive(Debug, Clone, PartialEq)]
pub struct Swept {
    /// The sweep's name.
    pub sweep: String,
    /// The key that varies, without the tables that contain it.
    pub key: String,
    /// The label of the value.
    pub label: String,
    /// The value, if it is a number.
    pub value: Option<f64>,
}

/// Lowest and highest value of figures of merit, by name.
pub type Bands = BTreeMap<String, [f64; 2]>;

/// How positions are estimated.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Hash)]
pub enum Method {
    /// From frame to frame, like `pardalis track`.
    #[default]
    Track,
    /// From frame to frame, then smoothed, like `pardalis track --smooth`.
    Smooth,
    /// In each image independently, like `pardalis locate`.
    Locate,
}

impl Word for Method {
    const WORDS: &'static [(&'static str, Self)] = &[
        ("track", Self::Track),
        ("smooth", Self::Smooth),
        ("locate", Self::Locate),
    ];
}

/// A selection of frames.
#[derive(Debug, Clone, PartialEq)]
pub struct Window {
    /// Its name in results.
    pub name: String,
    /// The first time in seconds; if `None`, that of the truth.
    pub from_s: Option<f64>,
    /// The last time in seconds; if `None`, that of the truth.
    pub to_s: Option<f64>,
    /// Only frames in which exactly this number of cameras see the object.
    pub seen_by: Option<usize>,
    /// Like that of a run, for these frames.
    pub expect: Bands,
}

/// The key that a sweep varies, or several.
enum Keys {
    One(String),
    Several(Vec<String>),
}

impl Setting for Keys {
    fn kind() -> Type {
        Type::Either(Box::new(String::kind()), Box::new(Vec::<String>::kind()))
    }
    fn allowed() -> String {
        "a full key in quotes, or a list of them".to_owned()
    }
    fn read(value: &DeValue) -> Option<Self> {
        let several = || Vec::<String>::read(value).map(Self::Several);
        String::read(value).map(Self::One).or_else(several)
    }
    fn write(&self) -> Value {
        match self {
            Self::One(key) => key.write(),
            Self::Several(keys) => keys.write(),
        }
    }
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

/// Maximum number of seeds of a run.
const MAX_SEEDS: f64 = 10_000.0;

impl Run {
    /// Returns the run's name as a folder name.
    pub fn slug(&self) -> String {
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

    /// Returns the values that replace those of the scene, and those that replace those of the world.
    pub fn replaced(&self) -> [toml::Table; 2] {
        let (mut of_scene, mut of_world) = (toml::Table::new(), toml::Table::new());
        for (key, value) in &self.set {
            match key.strip_prefix("world.") {
                Some(key) => of_world.insert(key.to_owned(), value.clone()),
                None => of_scene.insert(key.clone(), value.clone()),
            };
        }
        [of_scene, of_world]
    }

    /// Reads a run, or the runs of a sweep.
    pub(super) fn read(table: &Table, is_sweep: bool) -> Option<Vec<Self>> {
        let name = table
            .key("name", "Name in results and messages.")
            .required::<String>();
        if name.as_ref().is_some_and(String::is_empty) {
            table.reject("name", "a text that is not empty");
        }
        let recording = Recording::read(table);
        let seeds = table
            .key("seeds", "Number of seeds; the seeds 1, 2, ... are run.")
            .within(1.0..=MAX_SEEDS)
            .required();
        let verify_seeds = table
            .key("verify_seeds", "Number of seeds with `--verify`.")
            .within(0.0..=MAX_SEEDS)
            .or(0);
        let set = table
            .key(
                "set",
                "Values that replace those of the scene, by full key, such as `\"targets.ball.filter.particles\" = 100`; after `world.`, values of the world.",
            )
            .optional::<BTreeMap<String, Value>>();
        let timed = table
            .key(
                "timed",
                "Whether the seeds run one at a time, to measure `ms_a_frame`.",
            )
            .or(false);
        let method = table
            .key(
                "method",
                "Track from frame to frame, like `pardalis track`, or smooth such tracks, like `pardalis track --smooth`, or locate in each image by itself, like `pardalis locate`.",
            )
            .word(Method::default());
        let starts = table
            .key(
                "starts",
                "For `locate`: table with a rough position for each image, like truth.csv.",
            )
            .depends("the scene's start")
            .optional();
        if starts.is_some() && method == Some(Method::Track) {
            table.problem("starts", "needs method = \"locate\"");
        }
        let scoring = Scoring::read(table);
        let sweep = Sweep::read(table, is_sweep);
        let run = Self {
            name: name?,
            scene: recording.scene.unwrap_or_default(),
            truth: recording.truth.unwrap_or_default(),
            world: recording.world,
            fresh_world: recording.fresh_world,
            seeds: seeds?,
            verify_seeds,
            set: set.unwrap_or_default().into_iter().collect(),
            timed,
            origin_m: scoring.origin_m,
            visible_over: scoring.visible_over,
            lost_beyond_m: scoring.lost_beyond_m,
            interpolate: scoring.interpolate,
            method: method?,
            starts,
            expect: scoring.expect,
            windows: scoring.windows,
            swept: None,
        };
        let (key, runs) = if is_sweep {
            ("key", sweep?.runs(table, &run)?)
        } else {
            ("set", vec![run])
        };
        if let Some(wrong) = runs.iter().find_map(Self::wrong_setting) {
            table.problem(key, wrong);
        }
        Some(runs)
    }

    /// Returns what is wrong with the keys of the replaced values.
    fn wrong_setting(&self) -> Option<&'static str> {
        if self.set.contains_key("seed") {
            return Some("seed has no effect because seeds 1, 2, ... are run; remove it");
        }
        if self.world.is_none() && !self.replaced()[1].is_empty() {
            return Some("keys that begin with world. need the key world");
        }
        if self.fresh_world && self.set.contains_key("world.seed") {
            return Some("world.seed has no effect with fresh_world; remove one of them");
        }
        None
    }
}

/// What a run tracks: a scene with its truth, or a world.
struct Recording {
    scene: Option<String>,
    truth: Option<String>,
    world: Option<String>,
    fresh_world: bool,
}

impl Recording {
    fn read(table: &Table) -> Self {
        let file = |key, about| {
            let file = table.key(key, about).depends("unless `world` is given");
            file.conditional::<String>()
        };
        let scene = file(
            "scene",
            "Scene file. This and other paths start at the experiment's folder.",
        );
        let truth = file("truth", "Table with the true positions.");
        let world = table
            .key(
                "world",
                "World file to simulate first; it gives the scene and the truth.",
            )
            .optional::<String>();
        for key in ["scene", "truth"] {
            if table.has("world") && table.has(key) {
                table.conflict(key, "world");
            } else if !table.has("world") && !table.has(key) && !table.is_describing() {
                table.problem(key, "is missing; give scene and truth, or a world");
            }
        }
        let fresh_world = table
            .key(
                "fresh_world",
                "Whether each seed has its own recording, simulated with the same seed.",
            )
            .or(false);
        if fresh_world && !table.has("world") {
            table.problem("fresh_world", "fresh_world needs the key world");
        }
        Self {
            scene,
            truth,
            world,
            fresh_world,
        }
    }
}

/// How a run is compared with the truth.
struct Scoring {
    origin_m: Option<[f64; 3]>,
    visible_over: f64,
    lost_beyond_m: f64,
    interpolate: bool,
    expect: Bands,
    windows: Vec<Window>,
}

impl Scoring {
    fn read(table: &Table) -> Self {
        let origin_m = table
            .key(
                "origin_m",
                "Origin of distance, elevation and azimuth in the world frame.",
            )
            .depends("the first camera")
            .optional();
        let visible_over = table
            .key(
                "visible_over",
                "An object counts as visible above this share of it.",
            )
            .within(0.0..1.0)
            .or(Settings::VISIBLE_OVER);
        let lost_beyond_m = table
            .key(
                "lost_beyond_m",
                "An estimate farther than this from the truth counts as lost.",
            )
            .within(above(0.0, 1e9))
            .or(Settings::LOST_BEYOND_M);
        let interpolate = table
            .key(
                "interpolate",
                "Whether every row is evaluated, with the truth interpolated to its time.",
            )
            .or(false);
        Self {
            origin_m,
            visible_over,
            lost_beyond_m,
            interpolate,
            expect: read_bands(table),
            windows: read_windows(table),
        }
    }
}

/// The settings of a sweep that a run does not have.
struct Sweep {
    key: Keys,
    values: Vec<Value>,
    names: Option<Vec<String>>,
}

impl Sweep {
    fn read(table: &Table, is_sweep: bool) -> Option<Self> {
        if !is_sweep {
            for key in ["key", "values", "names"] {
                if table.knows(key) {
                    table.problem(key, "belongs to sweeps; write this run under [[sweeps]]");
                }
            }
            return None;
        }
        let key = table
            .key(
                "key",
                "Full key, as in `set`, whose value varies between the runs; or a list of keys.",
            )
            .required();
        let values = table
            .key(
                "values",
                "The values; with a list of keys, each is a list with one value per key.",
            )
            .required();
        let names = table
            .key("names", "Labels of the values.")
            .depends("the values")
            .optional();
        Some(Self {
            key: key?,
            values: values?,
            names,
        })
    }

    /// Returns one run per value.
    fn runs(&self, table: &Table, base: &Run) -> Option<Vec<Run>> {
        let count = self.values.len();
        if self.names.as_ref().is_some_and(|n| n.len() != count) {
            table.problem("names", "the numbers of names and of values differ");
            return None;
        }
        let runs: Result<_, String> = (0..count).map(|i| self.run(i, base)).collect();
        runs.map_err(|wrong| table.problem("values", wrong)).ok()
    }

    fn run(&self, index: usize, base: &Run) -> Result<Run, String> {
        let value = &self.values[index];
        let mut set = base.set.clone();
        match &self.key {
            Keys::One(key) => {
                set.insert(key.clone(), value.clone());
            }
            Keys::Several(keys) => {
                let parts = value.as_array().filter(|parts| parts.len() == keys.len());
                let parts = parts.ok_or_else(|| {
                    let count = keys.len();
                    format!("the value {value} is not a list of {count} values, one per key")
                })?;
                set.extend(keys.iter().cloned().zip(parts.iter().cloned()));
            }
        }
        let label = match &self.names {
            Some(names) => names[index].clone(),
            None => label(value)?,
        };
        Ok(Run {
            name: format!("{}: {label}", base.name),
            swept: Some(Swept {
                sweep: base.name.clone(),
                key: self.key.shown(),
                label,
                value: number(value),
            }),
            set,
            ..base.clone()
        })
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

/// Reads the bands of a run or window.
fn read_bands(table: &Table) -> Bands {
    let about = "Lowest and highest value of figures of merit, such as `rmse_m = [0, 0.1]`, for every seed and target.";
    let bands: Bands = table.key("expect", about).optional().unwrap_or_default();
    let Some(given) = table.peek("expect") else {
        return bands;
    };
    for (name, [lowest, highest]) in &bands {
        if !FIGURES_OF_MERIT.iter().any(|(known, _)| known == name) {
            let allowed: Vec<_> = FIGURES_OF_MERIT.iter().map(|(name, _)| *name).collect();
            let allowed = allowed.join(", ");
            given.problem(
                name,
                format!("is not a figure of merit; allowed: {allowed}"),
            );
        } else if lowest > highest {
            given.reject(name, "the lowest and the highest value");
        }
    }
    bands
}

/// Reads the windows of a run.
fn read_windows(run: &Table) -> Vec<Window> {
    let about = "Parts of the recording for which the figures of merit are computed separately.";
    let mut windows: Vec<Window> = Vec::new();
    for table in run.tables("windows", about) {
        let name = table
            .key("name", "Name in results.")
            .required::<String>()
            .unwrap_or_default();
        let is_given = table.has("name");
        if is_given && (name.is_empty() || windows.iter().any(|other| other.name == name)) {
            table.problem(
                "name",
                "its name is empty or used twice; give each window its own name",
            );
        }
        let time = |key, about, otherwise| table.key(key, about).depends(otherwise).optional();
        let from_s: Option<f64> = time("from_s", "First time.", "that of the truth");
        let to_s: Option<f64> = time("to_s", "Last time.", "that of the truth");
        if let (Some(from_s), Some(to_s)) = (from_s, to_s)
            && from_s >= to_s
        {
            table.problem("from_s", "from_s must be before to_s");
        }
        let seen_by = table
            .key(
                "seen_by",
                "Only frames in which exactly this number of cameras see the object.",
            )
            .depends("all frames")
            .optional();
        windows.push(Window {
            name,
            from_s,
            to_s,
            seen_by,
            expect: read_bands(&table),
        });
        table.finish();
    }
    windows
}
