//! The types of settings: how each is read from a TOML value, and which values are allowed.

use std::collections::BTreeMap;

use toml::de::DeValue;

use super::description::Type;

/// A type of settings.
pub(super) trait Setting: Sized {
    /// The type, for the reference.
    fn kind() -> Type;
    /// The allowed values, as text.
    fn allowed() -> String;
    /// The allowed values of a list of them.
    const LIST: &'static str = "a list";
    fn read(value: &DeValue) -> Option<Self>;
    fn write(&self) -> toml::Value;
}

impl Setting for f64 {
    fn kind() -> Type {
        Type::Number
    }
    fn allowed() -> String {
        "a finite number".to_owned()
    }
    const LIST: &'static str = "a list of finite numbers";
    fn read(value: &DeValue) -> Option<Self> {
        let number: f64 = match value {
            DeValue::Float(float) => float.as_str().replace('_', "").parse().ok()?,
            DeValue::Integer(_) => i64::read(value)? as f64,
            _ => return None,
        };
        number.is_finite().then_some(number)
    }
    fn write(&self) -> toml::Value {
        toml::Value::Float(*self)
    }
}

impl Setting for bool {
    fn kind() -> Type {
        Type::Boolean
    }
    fn allowed() -> String {
        "true or false".to_owned()
    }
    fn read(value: &DeValue) -> Option<Self> {
        match value {
            DeValue::Boolean(value) => Some(*value),
            _ => None,
        }
    }
    fn write(&self) -> toml::Value {
        toml::Value::Boolean(*self)
    }
}

impl Setting for i64 {
    fn kind() -> Type {
        Type::Integer(i64::MIN, i64::MAX)
    }
    fn allowed() -> String {
        "a whole number".to_owned()
    }
    fn read(value: &DeValue) -> Option<Self> {
        let DeValue::Integer(integer) = value else {
            return None;
        };
        Self::from_str_radix(&integer.as_str().replace('_', ""), integer.radix()).ok()
    }
    fn write(&self) -> toml::Value {
        toml::Value::Integer(*self)
    }
}

impl Setting for usize {
    fn kind() -> Type {
        Type::Integer(0, i64::MAX)
    }
    fn allowed() -> String {
        "a whole number, 0 or more".to_owned()
    }
    const LIST: &'static str = "a list of whole numbers, 0 or more";
    fn read(value: &DeValue) -> Option<Self> {
        i64::read(value)?.try_into().ok()
    }
    fn write(&self) -> toml::Value {
        toml::Value::Integer(i64::try_from(*self).unwrap_or(i64::MAX))
    }
}

impl Setting for u32 {
    fn kind() -> Type {
        Type::Integer(0, i64::from(u32::MAX))
    }
    fn allowed() -> String {
        "a whole number from 0 to 4294967295".to_owned()
    }
    fn read(value: &DeValue) -> Option<Self> {
        i64::read(value)?.try_into().ok()
    }
    fn write(&self) -> toml::Value {
        toml::Value::Integer(i64::from(*self))
    }
}

impl Setting for String {
    fn kind() -> Type {
        Type::Text
    }
    fn allowed() -> String {
        "a text in quotes".to_owned()
    }
    const LIST: &'static str = "a list of texts";
    fn read(value: &DeValue) -> Option<Self> {
        value.as_str().map(str::to_owned)
    }
    fn write(&self) -> toml::Value {
        toml::Value::String(self.clone())
    }
}

impl<T: Setting> Setting for Vec<T> {
    fn kind() -> Type {
        Type::List(Box::new(T::kind()), None)
    }
    fn allowed() -> String {
        T::LIST.to_owned()
    }
    const LIST: &'static str = "a list of rows of finite numbers";
    fn read(value: &DeValue) -> Option<Self> {
        value
            .as_array()?
            .iter()
            .map(|item| T::read(item.get_ref()))
            .collect()
    }
    fn write(&self) -> toml::Value {
        toml::Value::Array(self.iter().map(Setting::write).collect())
    }
}

/// Any value, for settings of another file.
impl Setting for toml::Value {
    fn kind() -> Type {
        Type::Any
    }
    fn allowed() -> String {
        "a value other than a date".to_owned()
    }
    const LIST: &'static str = "a list of values";
    fn read(value: &DeValue) -> Option<Self> {
        Some(match value {
            DeValue::Float(float) => Self::Float(float.as_str().replace('_', "").parse().ok()?),
            DeValue::Integer(_) => Self::Integer(i64::read(value)?),
            DeValue::Boolean(value) => Self::Boolean(*value),
            DeValue::String(text) => Self::String(text.to_string()),
            // No setting is a date. After a syntax error it may have no part, and then panics when it is shown.
            DeValue::Datetime(_) => return None,
            DeValue::Array(_) => Self::Array(Vec::read(value)?),
            DeValue::Table(_) => Self::Table(BTreeMap::read(value)?.into_iter().collect()),
        })
    }
    fn write(&self) -> toml::Value {
        self.clone()
    }
}

/// A table with keys of the user's choice.
impl<T: Setting> Setting for BTreeMap<String, T> {
    fn kind() -> Type {
        Type::Map(Box::new(T::kind()))
    }
    fn allowed() -> String {
        format!("a table; each value: {}", T::allowed())
    }
    fn read(value: &DeValue) -> Option<Self> {
        value
            .as_table()?
            .iter()
            .map(|(key, value)| Some((key.get_ref().to_string(), T::read(value.get_ref())?)))
            .collect()
    }
    fn write(&self) -> toml::Value {
        let values = self.iter().map(|(key, value)| (key.clone(), value.write()));
        toml::Value::Table(values.collect())
    }
}

impl<const N: usize> Setting for [f64; N] {
    fn kind() -> Type {
        Type::List(Box::new(Type::Number), Some(N))
    }
    fn allowed() -> String {
        let allowed = match N {
            2 => "two finite numbers, [a, b]",
            3 => "three finite numbers, [a, b, c]",
            4 => "four finite numbers, [a, b, c, d]",
            5 => "five finite numbers, [a, b, c, d, e]",
            6 => "six finite numbers, [xx, xy, xz, yy, yz, zz]",
            _ => "a list of finite numbers",
        };
        allowed.to_owned()
    }
    const LIST: &'static str = match N {
        4 => "a list of points of four finite numbers, [[u, v, x, y], ...]",
        _ => "a list of rows of finite numbers",
    };
    fn read(value: &DeValue) -> Option<Self> {
        Vec::<f64>::read(value)?.try_into().ok()
    }
    fn write(&self) -> toml::Value {
        toml::Value::Array(self.iter().map(Setting::write).collect())
    }
}

impl<const ROWS: usize, const COLUMNS: usize> Setting for [[f64; COLUMNS]; ROWS] {
    fn kind() -> Type {
        Type::List(Box::new(<[f64; COLUMNS]>::kind()), Some(ROWS))
    }
    fn allowed() -> String {
        let allowed = match (ROWS, COLUMNS) {
            (3, 3) => "three rows of three finite numbers",
            (4, 2) => "four points of two finite numbers, [[x, y], ...]",
            (4, 4) => "four rows of four finite numbers",
            _ => "rows of finite numbers",
        };
        allowed.to_owned()
    }
    fn read(value: &DeValue) -> Option<Self> {
        let rows: Vec<[f64; COLUMNS]> = value
            .as_array()?
            .iter()
            .map(|row| <[f64; COLUMNS]>::read(row.get_ref()))
            .collect::<Option<_>>()?;
        rows.try_into().ok()
    }
    fn write(&self) -> toml::Value {
        toml::Value::Array(self.iter().map(Setting::write).collect())
    }
}

/// A setting that is one of a few words.
pub(super) trait Word: Copy + PartialEq + 'static {
    /// Each word and its value.
    const WORDS: &'static [(&'static str, Self)];
}

impl<T: Word> Setting for T {
    fn kind() -> Type {
        Type::Words(Self::WORDS.iter().map(|(word, _)| *word).collect())
    }
    fn allowed() -> String {
        let words: Vec<_> = Self::WORDS
            .iter()
            .map(|(w, _)| format!("\"{w}\""))
            .collect();
        words.join(", ")
    }
    fn read(value: &DeValue) -> Option<Self> {
        let word = value.as_str()?;
        let found = Self::WORDS.iter().find(|(name, _)| *name == word);
        found.map(|&(_, value)| value)
    }
    fn write(&self) -> toml::Value {
        let found = Self::WORDS.iter().find(|(_, value)| value == self);
        toml::Value::String(found.map_or_else(String::new, |(word, _)| (*word).to_owned()))
    }
}

/// One number for all three axes, or three numbers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct PerAxis(pub(super) [f64; 3]);

impl Setting for PerAxis {
    fn kind() -> Type {
        Type::Either(Box::new(Type::Number), Box::new(<[f64; 3]>::kind()))
    }
    fn allowed() -> String {
        "a finite number, or three of them, [x, y, z]".to_owned()
    }
    fn read(value: &DeValue) -> Option<Self> {
        f64::read(value)
            .map(|v| [v; 3])
            .or_else(|| <[f64; 3]>::read(value))
            .map(Self)
    }
    fn write(&self) -> toml::Value {
        self.0.write()
    }
}

/// A positive length, or one that is not known.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Length {
    Metres(f64),
    Unknown,
}

/// The word for a value that is not known.
const UNKNOWN: &str = "unknown";

impl Setting for Length {
    fn kind() -> Type {
        Type::Either(Box::new(Type::Number), Box::new(Type::Words(vec![UNKNOWN])))
    }
    fn allowed() -> String {
        format!("a finite number, or \"{UNKNOWN}\"")
    }
    fn read(value: &DeValue) -> Option<Self> {
        if value.as_str() == Some(UNKNOWN) {
            return Some(Self::Unknown);
        }
        f64::read(value).map(Self::Metres)
    }
    fn write(&self) -> toml::Value {
        match self {
            Self::Metres(metres) => metres.write(),
            Self::Unknown => toml::Value::String(UNKNOWN.to_owned()),
        }
    }
}
