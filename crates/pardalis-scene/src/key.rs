//! One key of a table: its declaration, and reading it.

use super::description::{Content, KeyDescription, Presence, Range, unit_of};
use super::reader::{Located, Table};
use super::setting::{Setting, Word};

/// A key, declared where it is read.
pub(super) struct Key<'k, 'a, 't> {
    table: &'k Table<'a, 't>,
    name: &'static str,
    about: &'static str,
    unit: &'static str,
    range: Option<Range>,
    /// The condition that determines the default or whether the key is required.
    depends: &'static str,
}

impl<'a, 't> Table<'a, 't> {
    /// Declares a key of this table, with its meaning for the reference.
    pub(super) fn key(&self, name: &'static str, about: &'static str) -> Key<'_, 'a, 't> {
        Key {
            table: self,
            name,
            about,
            unit: unit_of(name),
            range: None,
            depends: "",
        }
    }
}

impl Key<'_, '_, '_> {
    /// States the unit, if the key's name does not.
    pub(super) fn unit(self, unit: &'static str) -> Self {
        Self { unit, ..self }
    }

    /// Restricts every number of the value.
    pub(super) fn within(self, range: impl Into<Range>) -> Self {
        Self {
            range: Some(range.into()),
            ..self
        }
    }

    /// States the default if it depends on other keys, the condition under which the key is required, or what applies
    /// without an optional key.
    pub(super) fn depends(self, depends: &'static str) -> Self {
        Self { depends, ..self }
    }

    fn describe<T: Setting>(&self, presence: Presence) {
        if self.table.journal.is_describing() {
            self.table.journal.describe(KeyDescription {
                path: self.table.path_of(self.name),
                about: self.about,
                content: Content::Value {
                    kind: T::kind(),
                    unit: self.unit,
                    range: self.range,
                },
                presence,
            });
        }
    }

    fn read<T: Setting>(&self) -> Option<T> {
        let value = self.table.get(self.name)?;
        let Some(setting) = T::read(value.get_ref()) else {
            self.table.reject(self.name, &T::allowed());
            return None;
        };
        let written = setting.write();
        if let Some(range) = self.range
            && !numbers(&written).all(|number| range.contains(number))
        {
            self.table.reject(self.name, &range.to_string());
            return None;
        }
        self.table
            .journal
            .record(&self.table.path_of(self.name), written);
        Some(setting)
    }

    /// Reads the setting, if it is given.
    pub(super) fn optional<T: Setting>(self) -> Option<T> {
        self.describe::<T>(Presence::Optional(self.depends));
        self.read()
    }

    /// Reads the setting, if it is given. The caller reports a missing setting, under the condition that
    /// [`Key::depends`] states.
    pub(super) fn conditional<T: Setting>(self) -> Option<T> {
        self.describe::<T>(Presence::RequiredIf(self.depends));
        self.read()
    }

    /// Reads the setting, which must be given.
    pub(super) fn required<T: Setting>(self) -> Option<T> {
        self.describe::<T>(if self.depends.is_empty() {
            Presence::Required
        } else {
            Presence::RequiredIf(self.depends)
        });
        if !self.table.knows(self.name) {
            let allowed = self
                .range
                .map_or_else(T::allowed, |range| format!("{}, {range}", T::allowed()));
            self.table
                .problem(self.name, format!("is missing; give {allowed}"));
            return None;
        }
        self.read()
    }

    /// Reads the setting; returns the default if it is not given.
    pub(super) fn or<T: Setting>(self, default: T) -> T {
        self.describe::<T>(if self.depends.is_empty() {
            Presence::Default(default.write())
        } else {
            Presence::DefaultDepends(self.depends)
        });
        self.read().unwrap_or_else(|| {
            let path = self.table.path_of(self.name);
            self.table.journal.record(&path, default.write());
            default
        })
    }

    /// Reads one of a few words; `None` if another one is given.
    pub(super) fn word<T: Word>(self, default: T) -> Option<T> {
        let (table, name) = (self.table, self.name);
        let is_given = table.has(name);
        let path = table.path_of(name);
        self.describe::<T>(Presence::Default(default.write()));
        let read = self.read();
        if is_given {
            return read;
        }
        table.journal.record(&path, default.write());
        Some(default)
    }

    /// Reads the setting with its position, if it is given.
    pub(super) fn located<T: Setting>(self) -> Option<Located<T>> {
        let (table, name) = (self.table, self.name);
        self.optional().map(|value| table.at(name, value))
    }

    /// Like [`Key::conditional`], with the position.
    pub(super) fn located_conditional<T: Setting>(self) -> Option<Located<T>> {
        let (table, name) = (self.table, self.name);
        self.conditional().map(|value| table.at(name, value))
    }
}

/// Returns every number in a value.
fn numbers(value: &toml::Value) -> Box<dyn Iterator<Item = f64> + '_> {
    match value {
        toml::Value::Float(number) => Box::new(std::iter::once(*number)),
        toml::Value::Integer(number) => Box::new(std::iter::once(*number as f64)),
        toml::Value::Array(items) => Box::new(items.iter().flat_map(numbers)),
        _ => Box::new(std::iter::empty()),
    }
}
