//! Targets: their names, shapes and sizes.

use std::collections::BTreeMap;
use std::path::Path;

use anyhow::Result;
use pardalis::shape::Shape;
use pardalis_scene::{NAMES_ALLOWED, is_name};
use serde::Deserialize;
use toml_edit::{Array, Value};

use super::edits::{with_shape, with_table, with_value};
use super::session::{Inner, Session};
use crate::commands::init::text::target_text;
use crate::user_error::user_error;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct NewTarget {
    name: String,
    radius_m: Option<f64>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct OfTarget {
    target: String,
}

/// A whole number in the scene.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct SetNumber {
    /// Its full key.
    key: String,
    value: f64,
}

/// The shape of a target, as in the scene.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Shaped {
    target: String,
    /// The key of the shape, such as `box`.
    kind: String,
    /// Keys in its table, such as `size_m`. The others stay as they are.
    sizes: BTreeMap<String, Size>,
}

#[derive(Deserialize)]
#[serde(untagged)]
enum Size {
    Count(i64),
    Number(f64),
    Numbers(Vec<f64>),
    /// `"unknown"`.
    Word(String),
}

impl Size {
    fn value(&self) -> Value {
        match self {
            Self::Count(count) => (*count).into(),
            Self::Number(number) => (*number).into(),
            Self::Numbers(numbers) => numbers.iter().copied().collect::<Array>().into(),
            Self::Word(word) => word.into(),
        }
    }
}

impl Session {
    /// Adds a ball.
    pub(super) fn add_target(&self, target: &NewTarget) -> Result<()> {
        let name = &target.name;
        if !is_name(name) {
            return Err(user_error!("the name {name}: allowed: {NAMES_ALLOWED}"));
        }
        let inner = self.inner();
        if inner.table_of("targets", name).is_some() {
            return Err(user_error!(
                "targets.{name}: is in the scene already; correct what the steps say of it, or choose another name"
            ));
        }
        let folder = inner.project.folder().to_owned();
        drop(inner);
        let colors = unused_colors(&folder, name);
        self.edit(
            &format!("targets.{name}.shape"),
            format!("add {name}"),
            |state| {
                let table = target_text(name, target.radius_m, &colors);
                state.text = with_table(&state.text, &table)?.into();
                Ok(())
            },
        )
    }

    /// Gives a target a new file of colours, so that they are learnt anew from labels. The file before stays.
    pub(super) fn learn_anew(&self, target: &OfTarget) -> Result<()> {
        let name = &target.target;
        let inner = self.inner();
        inner.colors_file(name)?;
        let colors = unused_colors(inner.project.folder(), name);
        drop(inner);
        let path = ["targets", name, "colors"];
        self.edit(
            // The file comes with the first label.
            &format!("targets.{name}.shape"),
            format!("other colours of {name}"),
            |state| {
                state.text = with_value(&state.text, &path, colors)?.into();
                state.samples.remove(name);
                Ok(())
            },
        )
    }

    /// Gives a target a shape with these sizes.
    pub(super) fn set_shape(&self, shaped: &Shaped) -> Result<()> {
        let Shaped {
            target,
            kind,
            sizes,
        } = shaped;
        let sizes: Vec<(&str, Value)> = sizes
            .iter()
            .map(|(key, size)| (&**key, size.value()))
            .collect();
        let words = sizes.iter().map(|(key, size)| format!("{key} {size}"));
        let what = format!(
            "{kind}: {} for {target}",
            words.collect::<Vec<_>>().join(", ")
        );
        self.edit(&format!("targets.{target}"), what, |state| {
            state.text = with_shape(&state.text, target, kind, &sizes)?.into();
            Ok(())
        })
    }
}

impl Session {
    /// Sets the seed of the scene, the number of particles of a target, or the rate of the images of a camera.
    pub(super) fn set_number(&self, set: &SetNumber) -> Result<()> {
        let SetNumber { key, value } = set;
        let path: Vec<&str> = key.split('.').collect();
        let is_whole = match path[..] {
            ["seed"] => true,
            ["targets", name, "filter", "particles"] => {
                self.inner().table_in_scene("targets", name)?;
                true
            }
            ["cameras", name, "fps"] => {
                self.inner().table_in_scene("cameras", name)?;
                false
            }
            _ => {
                return Err(user_error!(
                    "{key}: allowed: seed, targets.NAME.filter.particles, cameras.NAME.fps"
                ));
            }
        };
        // Larger ones have no digits after the point.
        let is_integer = value.fract() == 0.0 && value.abs() < 1e15;
        if is_whole && !is_integer {
            return Err(user_error!("{key}: {value} is no whole number"));
        }
        let value = if is_whole {
            Value::from(*value as i64)
        } else {
            Value::from(*value)
        };
        self.edit(key, format!("{key} {value}"), |state| {
            state.text = with_value(&state.text, &path, value)?.into();
            Ok(())
        })
    }
}

impl Inner {
    fn table_in_scene(&self, kind: &str, name: &str) -> Result<toml::Table> {
        self.table_of(kind, name)
            .ok_or_else(|| user_error!("{kind}.{name}: is not in the scene"))
    }

    /// Reports whether a target is a ball, or not known well enough to be something else.
    pub(super) fn is_ball(&self, target: &str) -> bool {
        let targets = self.parts().scene.targets;
        let named = targets.iter().find(|one| one.name == target);
        named.is_none_or(|one| matches!(one.bodies[0].shape, Shape::Sphere(_)))
    }
}

/// Returns a name for a file of colours that does not exist.
fn unused_colors(folder: &Path, target: &str) -> String {
    let numbered = (2..).map(|number| format!("{target}-{number}.colors.toml"));
    let mut names = std::iter::once(format!("{target}.colors.toml")).chain(numbered);
    let free = names.find(|name| !folder.join(name).exists());
    free.unwrap_or_else(|| format!("{target}.colors.toml"))
}
