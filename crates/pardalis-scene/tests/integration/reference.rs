//! The reference of keys and the JSON schemas are up to date and agree with the readers.
//!
//! `cargo xtask reference` writes the files in `docs/reference`: it runs this test with the variable `UPDATE`.

use std::path::{Path, PathBuf};

use pardalis_camera::CalibratedCamera;
use pardalis_camera::formats::Lens;
use pardalis_scene::description::{Content, KeyDescription, Presence, Type};
use pardalis_scene::experiment::Experiment;
use pardalis_scene::reference::FileKind;
use pardalis_scene::{Problem, Scene, WorldConfig, calibration};
use serde_json::Value;

fn repository() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

#[test]
fn reference_files_are_up_to_date() {
    let folder = repository().join("docs/reference");
    for kind in FileKind::ALL {
        let name = kind.name();
        for (file, text) in [
            (format!("{name}.md"), kind.markdown()),
            (format!("{name}.schema.json"), kind.json_schema()),
        ] {
            let path = folder.join(&file);
            if std::env::var_os("UPDATE").is_some() {
                std::fs::write(&path, &text).unwrap();
            }
            let written = std::fs::read_to_string(&path).unwrap_or_default();
            assert!(
                written == text,
                "docs/reference/{file} is out of date; run cargo xtask reference"
            );
        }
    }
}

/// A file of the repository or of `tests/reference`.
struct Sample {
    path: PathBuf,
    text: String,
    kind: FileKind,
}

/// Returns every scene, world and experiment of the repository, and files that together contain every key.
fn samples() -> Vec<Sample> {
    let mut samples = Vec::new();
    let root = repository();
    let folders = [
        "experiments",
        "data",
        "crates/pardalis-scene/tests/reference",
    ];
    let mut folders: Vec<_> = folders.iter().map(|folder| root.join(folder)).collect();
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(&folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                folders.push(path);
                continue;
            }
            if path.extension().is_none_or(|extension| extension != "toml") {
                continue;
            }
            let text = std::fs::read_to_string(&path).unwrap();
            let parsed: Result<toml::Table, _> = text.parse();
            let table = parsed.unwrap_or_else(|error| panic!("{}: {error}", path.display()));
            let kind = if table.contains_key("targets") {
                FileKind::Scene
            } else if table.contains_key("objects") {
                FileKind::World
            } else if table.contains_key("cameras") {
                FileKind::Calibration
            } else if table.contains_key("question") {
                FileKind::Experiment
            } else {
                continue;
            };
            samples.push(Sample { path, text, kind });
        }
    }
    samples.sort_by(|a, b| a.path.cmp(&b.path));
    assert!(samples.len() > 40, "{} samples", samples.len());
    samples
}

impl Sample {
    fn problems(&self, replaced: &toml::Table) -> Vec<Problem> {
        let read = |file: &str, lens: Option<Lens>| -> Result<Vec<CalibratedCamera>, String> {
            let path = self.path.parent().unwrap().join(file);
            let text = std::fs::read_to_string(&path).map_err(|error| error.to_string())?;
            calibration::read(&text, lens).map_err(|error| error.to_string())
        };
        match self.kind {
            FileKind::Scene => Scene::parse_with(&self.text, replaced, &read).err(),
            FileKind::World => WorldConfig::parse_with(&self.text, replaced, &read).err(),
            FileKind::Calibration => calibration::read_toml(&self.text).err(),
            FileKind::Experiment => Experiment::parse(&self.text).err(),
        }
        .unwrap_or_default()
    }

    fn value(&self) -> Value {
        serde_json::to_value(self.text.parse::<toml::Table>().unwrap()).unwrap()
    }

    /// Returns the keys of the file's values: each full key, with the numbers of tables in lists, and the same with
    /// `NAME` for names and without numbers.
    fn keys(&self, described: &[KeyDescription]) -> Vec<(String, String)> {
        fn walk(
            value: &Value,
            [path, pattern]: [&str; 2],
            described: &[KeyDescription],
            found: &mut Vec<(String, String)>,
        ) {
            let below = |path: &str, key: &str| match path {
                "" => key.to_owned(),
                _ => format!("{path}.{key}"),
            };
            let content = described.iter().find(|key| key.path == pattern);
            let content = content.map(|key| &key.content);
            let is_named = content == Some(&Content::Named);
            match (content, value) {
                (Some(Content::List), Value::Array(tables)) => {
                    for (i, table) in tables.iter().enumerate() {
                        let path = below(path, &i.to_string());
                        walk(table, [&path, pattern], described, found);
                    }
                }
                (Some(Content::Value { .. }), _) => {
                    found.push((path.to_owned(), pattern.to_owned()));
                }
                (_, Value::Object(table)) => {
                    for (key, value) in table {
                        let name = if is_named { "NAME" } else { key };
                        let paths = [&*below(path, key), &*below(pattern, name)];
                        walk(value, paths, described, found);
                    }
                }
                _ => found.push((path.to_owned(), pattern.to_owned())),
            }
        }
        let mut found = Vec::new();
        walk(&self.value(), ["", ""], described, &mut found);
        found
    }
}

#[test]
fn every_key_of_the_reference_is_accepted_and_every_accepted_key_is_in_the_reference() {
    let samples = samples();
    // The same declaration serves several tables: all cameras have the same models.
    let declaration = |key: &KeyDescription| {
        let (_, name) = key.path.rsplit_once('.').unwrap_or(("", &key.path));
        (name.to_owned(), key.about)
    };
    let mut given = Vec::new();
    let described = FileKind::ALL.map(FileKind::keys);
    for (kind, keys) in FileKind::ALL.into_iter().zip(&described) {
        for sample in samples.iter().filter(|sample| sample.kind == kind) {
            let problems = sample.problems(&toml::Table::new());
            assert!(problems.is_empty(), "{:?}: {problems:#?}", sample.path);
            for (path, pattern) in sample.keys(keys) {
                let key = keys.iter().find(|key| key.path == pattern);
                let key = key
                    .unwrap_or_else(|| panic!("{:?}: {path} is not in the reference", sample.path));
                given.push(declaration(key));
            }
        }
    }
    for (kind, keys) in FileKind::ALL.into_iter().zip(&described) {
        let values = keys
            .iter()
            .filter(|key| matches!(key.content, Content::Value { .. }));
        assert!(values.clone().count() > 30, "{kind:?}");
        let unused: Vec<_> = values
            .filter(|key| !given.contains(&declaration(key)))
            .map(|key| &key.path)
            .collect();
        assert!(
            unused.is_empty(),
            "{kind:?}: no file of tests/reference contains {unused:#?}"
        );
    }
}

#[test]
fn settings_with_defaults_are_in_the_reference() {
    fn walk(table: &toml::Table, pattern: &str, keys: &[KeyDescription]) {
        for (key, value) in table {
            let is_named =
                |key: &KeyDescription| key.path == pattern && key.content == Content::Named;
            let name = if keys.iter().any(is_named) {
                "NAME"
            } else {
                key
            };
            let path = match pattern {
                "" => name.to_owned(),
                _ => format!("{pattern}.{name}"),
            };
            let known = keys.iter().any(|key| key.path == path);
            assert!(known || name == "NAME", "{path} is not in the reference");
            if let toml::Value::Table(inner) = value {
                walk(inner, &path, keys);
            }
        }
    }
    let keys = FileKind::Scene.keys();
    for sample in samples()
        .iter()
        .filter(|sample| sample.kind == FileKind::Scene)
    {
        let no_file = |_: &str, _: Option<Lens>| Err(String::new());
        if let Ok(scene) = Scene::parse(&sample.text, &no_file) {
            walk(&scene.resolved, "", &keys);
        }
    }
}

#[test]
fn numbers_outside_the_stated_ranges_are_rejected() {
    let mut checked = 0;
    let samples = samples();
    for kind in [FileKind::Scene, FileKind::World] {
        let described = kind.keys();
        for sample in samples.iter().filter(|sample| sample.kind == kind) {
            for (path, pattern) in sample.keys(&described) {
                let key = described.iter().find(|key| key.path == pattern);
                let Some(Content::Value {
                    range: Some(range), ..
                }) = key.map(|key| &key.content)
                else {
                    continue;
                };
                let given = path
                    .split('.')
                    .fold(sample.value(), |value, key| value[key].clone());
                // A number, or a list whose first number is replaced.
                let outside = |number: f64| -> Option<toml::Value> {
                    match &given {
                        Value::Number(given) if given.is_i64() && number.fract() == 0.0 => {
                            Some((number as i64).into())
                        }
                        Value::Number(_) => Some(number.into()),
                        Value::Array(items) => {
                            let mut items: Vec<f64> =
                                items.iter().map(Value::as_f64).collect::<Option<_>>()?;
                            *items.first_mut()? = number;
                            Some(toml::Value::from(items))
                        }
                        _ => None,
                    }
                };
                let numbers = [range.least - 1.0, range.greatest * 1.5 + 1.0];
                for number in numbers.into_iter().filter(|number| number.is_finite()) {
                    let Some(value) = outside(number) else {
                        continue;
                    };
                    let replaced = toml::Table::from_iter([(path.clone(), value)]);
                    let problems = sample.problems(&replaced);
                    assert!(
                        problems.iter().any(|problem| problem.key == path),
                        "{path} = {number}: {problems:?}"
                    );
                    checked += 1;
                }
            }
        }
    }
    assert!(checked > 200, "{checked}");
}

/// Checks a value against a schema. Supports only those keywords of JSON Schema that the schemas use.
#[allow(clippy::too_many_lines)] // one arm per keyword
fn check(schema: &Value, value: &Value, path: &str) -> Result<(), String> {
    let schema = schema.as_object().unwrap();
    let wrong = |what: &str| Err(format!("{path}: {what}: {value}"));
    for (keyword, argument) in schema {
        let number = value.as_f64();
        let bound = || argument.as_f64().unwrap();
        match keyword.as_str() {
            "type" => {
                let is_right = match argument.as_str().unwrap() {
                    "object" => value.is_object(),
                    "array" => value.is_array(),
                    "number" => value.is_number(),
                    "integer" => value.is_i64(),
                    "boolean" => value.is_boolean(),
                    "string" => value.is_string(),
                    other => panic!("type {other}"),
                };
                if !is_right {
                    return wrong("type");
                }
            }
            "enum" => {
                if !argument.as_array().unwrap().contains(value) {
                    return wrong("enum");
                }
            }
            "minimum" if number.is_some_and(|v| v < bound()) => return wrong(keyword),
            "maximum" if number.is_some_and(|v| v > bound()) => return wrong(keyword),
            "exclusiveMinimum" if number.is_some_and(|v| v <= bound()) => return wrong(keyword),
            "exclusiveMaximum" if number.is_some_and(|v| v >= bound()) => return wrong(keyword),
            "items" => {
                for item in value.as_array().into_iter().flatten() {
                    check(argument, item, path)?;
                }
            }
            "minItems" | "maxItems" => {
                let count = value.as_array().map_or(0, Vec::len) as f64;
                let is_right = if keyword == "minItems" {
                    count >= bound()
                } else {
                    count <= bound()
                };
                if !is_right {
                    return wrong(keyword);
                }
            }
            "minProperties" | "maxProperties" => {
                let count = value.as_object().map_or(0, serde_json::Map::len) as f64;
                let is_right = if keyword == "minProperties" {
                    count >= bound()
                } else {
                    count <= bound()
                };
                if !is_right {
                    return wrong(keyword);
                }
            }
            "anyOf" => {
                let mut options = argument.as_array().unwrap().iter();
                if !options.any(|option| check(option, value, path).is_ok()) {
                    return wrong("anyOf");
                }
            }
            "required" => {
                for name in argument.as_array().unwrap() {
                    if value.get(name.as_str().unwrap()).is_none() {
                        return wrong(&format!("lacks {name}"));
                    }
                }
            }
            // Bounds that are satisfied, annotations, and keywords that are checked below.
            "minimum"
            | "maximum"
            | "exclusiveMinimum"
            | "exclusiveMaximum"
            | "$schema"
            | "title"
            | "description"
            | "default"
            | "properties"
            | "patternProperties"
            | "additionalProperties" => {}
            other => panic!("keyword {other}"),
        }
    }
    let Some(table) = value.as_object() else {
        return Ok(());
    };
    for (name, inner) in table {
        let path = format!("{path}.{name}");
        let property = schema.get("properties").and_then(|all| all.get(name));
        let named = schema
            .get("patternProperties")
            .and_then(|patterns| patterns.get("^[A-Za-z0-9_-]{1,64}$"))
            .filter(|_| pardalis_scene::is_name(name));
        match property.or(named) {
            Some(schema) => check(schema, inner, &path)?,
            None if schema.get("additionalProperties") == Some(&Value::Bool(false)) => {
                return Err(format!("{path}: is not a key"));
            }
            None => {
                if let Some(schema @ Value::Object(_)) = schema.get("additionalProperties") {
                    check(schema, inner, &path)?;
                }
            }
        }
    }
    Ok(())
}

#[test]
fn schemas_accept_every_file_and_reject_unknown_keys_and_wrong_types() {
    let schemas = FileKind::ALL.map(|kind| {
        let schema: Value = serde_json::from_str(&kind.json_schema()).unwrap();
        (kind, schema)
    });
    for sample in samples() {
        let (_, schema) = schemas
            .iter()
            .find(|(kind, _)| *kind == sample.kind)
            .unwrap();
        let value = sample.value();
        let checked = check(schema, &value, "");
        assert!(checked.is_ok(), "{:?}: {checked:?}", sample.path);
        let described = sample.kind.keys();
        for key in sample.keys(&described) {
            let pointer = format!("/{}", key.0.replace('.', "/"));
            // Tables in the place of values.
            let takes_any_table = described.iter().any(|described| {
                let Content::Value { kind, .. } = &described.content else {
                    return false;
                };
                described.path == key.1 && *kind == Type::Map(Box::new(Type::Any))
            });
            let mut wrong = value.clone();
            let instead = if takes_any_table {
                serde_json::json!(1)
            } else {
                serde_json::json!({ "no_such_key": 1 })
            };
            *wrong.pointer_mut(&pointer).unwrap() = instead;
            assert!(check(schema, &wrong, "").is_err(), "{}", key.0);
            // Unknown keys beside them.
            let mut wrong = value.clone();
            let table = pointer.rsplit_once('/').unwrap().0;
            wrong
                .pointer_mut(table)
                .and_then(Value::as_object_mut)
                .unwrap()
                .insert("no_such_key".to_owned(), 1.into());
            assert!(check(schema, &wrong, "").is_err(), "beside {}", key.0);
        }
    }
}

#[test]
fn every_key_has_a_meaning_and_every_length_a_unit() {
    for kind in FileKind::ALL {
        for key in kind.keys() {
            assert!(key.about.ends_with('.'), "{}: {}", key.path, key.about);
            assert!(!key.about.contains('|'), "{}: breaks the table", key.path);
            let is_length = key.path.ends_with("_m") || key.path.ends_with("_px");
            if let Content::Value { unit, .. } = key.content {
                assert!(!is_length || !unit.is_empty(), "{}", key.path);
            }
            if let Presence::Default(value) = &key.presence {
                assert!(!value.is_table(), "{}", key.path);
            }
        }
    }
}
