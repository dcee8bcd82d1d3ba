//! The reference of all keys as Markdown, and JSON schemas, from the declarations that the readers of files make.

use std::fmt::Write as _;

use super::description::{Content, KeyDescription, Presence};
use super::experiment::{Experiment, FIGURES_OF_MERIT};
use super::keys::{inside, keys_in, name_in};
use super::{Scene, WorldConfig, calibration, schema};

/// A kind of file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FileKind {
    /// Scenes: cameras and targets, for `pardalis track` and other commands.
    Scene,
    /// Worlds, for `pardalis simulate`.
    World,
    /// Calibrations of cameras.
    Calibration,
    /// Experiments, for `pardalis measure`.
    Experiment,
}

impl FileKind {
    /// All kinds.
    pub const ALL: [Self; 4] = [
        Self::Scene,
        Self::World,
        Self::Calibration,
        Self::Experiment,
    ];

    /// Returns the kind's name, as in `scene.md` and `scene.schema.json`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Scene => "scene",
            Self::World => "world",
            Self::Calibration => "calibration",
            Self::Experiment => "experiment",
        }
    }

    /// Returns the keys of files of this kind, in the order in which they are read.
    pub fn keys(self) -> Vec<KeyDescription> {
        match self {
            Self::Scene => Scene::keys(),
            Self::World => WorldConfig::keys(),
            Self::Calibration => calibration::keys(),
            Self::Experiment => Experiment::keys(),
        }
    }

    fn title(self) -> &'static str {
        match self {
            Self::Scene => "Scene files",
            Self::World => "World files",
            Self::Calibration => "Calibration files",
            Self::Experiment => "Experiment files",
        }
    }

    fn introduction(self) -> &'static str {
        match self {
            Self::Scene => {
                "A scene file describes the cameras and the targets to track. `pardalis init` writes one to start from."
            }
            Self::World => {
                "A world file describes what `pardalis simulate` renders: objects, cameras and their imperfections."
            }
            Self::Calibration => {
                "A calibration file describes the cameras of a rig. `pardalis calibrate` and `pardalis camera convert` write them, and a scene names one with `calibration`."
            }
            Self::Experiment => {
                "An experiment file names the scenes that `pardalis measure` runs with several seeds, and the bands within which their figures of merit must lie."
            }
        }
    }

    /// Returns the reference of the keys as Markdown.
    pub fn markdown(self) -> String {
        let keys = self.keys();
        let names = if keys.iter().any(|key| key.content == Content::Named) {
            let allowed = super::NAMES_ALLOWED;
            format!("`NAME` stands for a name of your choice: {allowed}. ")
        } else {
            String::new()
        };
        let mut text = format!(
            "<!-- Generated from the code that reads these files; do not edit. -->\n# {}\n\n{} The format is [TOML](https://toml.io). \
             All problems of a file are reported at once, with line and key; unknown keys are errors. \
             {names}An editor that knows JSON schemas completes and checks these files with [{name}.schema.json]({name}.schema.json).\n",
            self.title(),
            self.introduction(),
            name = self.name(),
        );
        let mut printed: Vec<&str> = Vec::new();
        push_table(&mut text, &keys, "", &mut printed);
        if self == Self::Experiment {
            push_figures_of_merit(&mut text);
        }
        text
    }

    /// Returns the JSON schema (draft 2020-12).
    pub fn json_schema(self) -> String {
        schema::of(self.title(), &self.keys())
    }
}

/// Returns the contents of a table with paths relative to it, so that equal tables are printed once.
fn contents<'k>(keys: &'k [KeyDescription], table: &str) -> Vec<(&'k str, &'k KeyDescription)> {
    keys.iter()
        .filter_map(|key| Some((key.path.strip_prefix(table)?.strip_prefix('.')?, key)))
        .collect()
}

fn is_same(keys: &[KeyDescription], a: &str, b: &str) -> bool {
    let (a, b) = (contents(keys, a), contents(keys, b));
    let equal =
        |((path_a, a), (path_b, b)): (&(&str, &KeyDescription), &(&str, &KeyDescription))| {
            path_a == path_b
                && a.about == b.about
                && a.content == b.content
                && a.presence == b.presence
        };
    a.len() == b.len() && a.iter().zip(&b).all(equal)
}

/// Appends the section of a table, then those of the tables in it.
fn push_table<'k>(
    text: &mut String,
    keys: &'k [KeyDescription],
    table: &str,
    printed: &mut Vec<&'k str>,
) {
    let values: Vec<_> = keys_in(keys, table)
        .filter(|key| matches!(key.content, Content::Value { .. }))
        .collect();
    if !values.is_empty() {
        text.push_str(
            "\n| Key | Type | Unit | Default | Range | Meaning |\n|---|---|---|---|---|---|\n",
        );
    }
    for key in values {
        push_row(text, key, name_in(&key.path, table).unwrap_or_default());
    }
    // Landmarks and cameras share keys with the tables before them, which are printed there.
    let (named, tables): (Vec<_>, Vec<_>) =
        keys_in(keys, table).partition(|key| key.content == Content::Named);
    for key in tables.into_iter().chain(named) {
        let place = inside(key);
        let _ = match key.content {
            Content::Value { .. } => continue,
            Content::Choice => {
                let kinds: Vec<_> = keys_in(keys, &key.path)
                    .filter_map(|kind| name_in(&kind.path, &key.path))
                    .map(|kind| format!("`{kind}`"))
                    .collect();
                write!(
                    text,
                    "\n## `{place}`\n\n{} Give exactly one of {}.{}\n",
                    key.about,
                    kinds.join(", "),
                    presence_sentence(&key.presence)
                )
            }
            Content::Table | Content::Named => write!(
                text,
                "\n## `[{place}]`\n\n{}{}\n",
                key.about,
                presence_sentence(&key.presence)
            ),
            Content::List => write!(text, "\n## `[[{place}]]`\n\n{}\n", key.about),
        };
        let twin = printed
            .iter()
            .copied()
            .find(|other| is_same(keys, other, &place));
        if contents(keys, &place).is_empty() {
            text.push_str("\nNo keys.\n");
        } else if let Some(twin) = twin {
            let _ = write!(text, "\nThe same keys as in `{twin}`.\n");
        } else {
            push_table(text, keys, &place, printed);
            printed.extend(keys.iter().map(|k| &*k.path).find(|path| *path == place));
        }
    }
}

fn presence_sentence(presence: &Presence) -> String {
    match presence {
        Presence::Required => " Required.".to_owned(),
        Presence::RequiredIf(condition) => format!(" Required {condition}."),
        Presence::Optional("") | Presence::Default(_) => String::new(),
        Presence::Optional(otherwise) | Presence::DefaultDepends(otherwise) => {
            format!(" Default: {otherwise}.")
        }
    }
}

fn push_row(text: &mut String, key: &KeyDescription, name: &str) {
    let Content::Value { kind, unit, range } = &key.content else {
        return;
    };
    let default = match &key.presence {
        Presence::Required => "required".to_owned(),
        Presence::RequiredIf(condition) => format!("required {condition}"),
        Presence::Optional("") => "none".to_owned(),
        Presence::Optional(otherwise) | Presence::DefaultDepends(otherwise) => {
            (*otherwise).to_owned()
        }
        Presence::Default(value) => format!("`{}`", shown(value)),
    };
    let range = range.map_or_else(String::new, |range| range.to_string());
    let _ = writeln!(
        text,
        "| `{name}` | {kind} | {unit} | {default} | {range} | {} |",
        key.about
    );
}

/// Appends the columns of the results of experiments.
fn push_figures_of_merit(text: &mut String) {
    text.push_str(
        "\n## Figures of merit\n\nThe names in `expect`, and the columns of `results.csv` after `run`, `seed`, `target`, `object` and `window`. \
         Errors are estimate minus truth, over all frames with an estimate; units are those of the names' endings.\n\n\
         | Name | Meaning |\n|---|---|\n",
    );
    for (name, about) in FIGURES_OF_MERIT {
        let _ = writeln!(text, "| `{name}` | {about} |");
    }
}

/// Formats a default as in TOML, rounded to six digits.
fn shown(value: &toml::Value) -> String {
    match value {
        toml::Value::Float(number) => {
            let rounded: f64 = format!("{number:.5e}").parse().unwrap_or(*number);
            format!("{rounded}")
        }
        toml::Value::Array(items) => {
            let items: Vec<_> = items.iter().map(shown).collect();
            format!("[{}]", items.join(", "))
        }
        other => other.to_string(),
    }
}
