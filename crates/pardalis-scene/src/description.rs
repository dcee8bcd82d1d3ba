//! Descriptions of the keys of a file, recorded from the code that reads them.
//!
//! The reader declares each key once, where it reads it: name, meaning, type, range and default. `keys_of` runs the
//! same code without a file and records these declarations, so that the reference and the JSON schema cannot differ
//! from what the reader accepts.

use std::fmt;

/// A key of a file.
#[derive(Debug, Clone, PartialEq)]
pub struct KeyDescription {
    /// The full key, such as `cameras.NAME.size_px`, with `NAME` for names that the user chooses.
    pub path: String,
    /// Its meaning.
    pub about: &'static str,
    /// Its content.
    pub content: Content,
    /// Whether it is required, and its default otherwise.
    pub presence: Presence,
}

/// The content of a key.
#[derive(Debug, Clone, PartialEq)]
pub enum Content {
    /// A value.
    Value {
        /// Its type.
        kind: Type,
        /// The unit of its numbers; empty if they have none.
        unit: &'static str,
        /// The range of allowed numbers.
        range: Option<Range>,
    },
    /// A table of further keys.
    Table,
    /// A table that holds exactly one of several tables.
    Choice,
    /// A table of tables whose names the user chooses.
    Named,
    /// A list of tables.
    List,
}

/// Whether a key is required.
#[derive(Debug, Clone, PartialEq)]
pub enum Presence {
    /// Always required.
    Required,
    /// Required under the condition in the text.
    RequiredIf(&'static str),
    /// Optional; the text states what applies without it, or is empty.
    Optional(&'static str),
    /// Optional with this default.
    Default(toml::Value),
    /// Optional; the text states the default, which depends on other keys.
    DefaultDepends(&'static str),
}

/// The type of a value.
#[derive(Debug, Clone, PartialEq)]
pub enum Type {
    /// A finite number.
    Number,
    /// A whole number from the first to the second number.
    Integer(i64, i64),
    /// True or false.
    Boolean,
    /// A text.
    Text,
    /// One of a few words.
    Words(Vec<&'static str>),
    /// A list of items, with its length if that is fixed.
    List(Box<Type>, Option<usize>),
    /// Either of two types.
    Either(Box<Type>, Box<Type>),
    /// Any value.
    Any,
    /// A table of values whose keys the user chooses.
    Map(Box<Type>),
}

impl Type {
    fn plural(&self) -> String {
        match self {
            Self::Number => "numbers".to_owned(),
            Self::Integer(..) => "integers".to_owned(),
            Self::Boolean => "booleans".to_owned(),
            Self::Text | Self::Words(_) => "strings".to_owned(),
            Self::List(item, Some(count)) => format!("rows of {count} {}", item.plural()),
            Self::List(item, None) => format!("rows of {}", item.plural()),
            Self::Either(a, b) => format!("{} or {}", a.plural(), b.plural()),
            Self::Any => "values".to_owned(),
            Self::Map(_) => "tables".to_owned(),
        }
    }
}

impl fmt::Display for Type {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Number => f.write_str("number"),
            Self::Integer(..) => f.write_str("integer"),
            Self::Boolean => f.write_str("boolean"),
            Self::Text => f.write_str("string"),
            Self::Words(words) => {
                let words: Vec<_> = words.iter().map(|word| format!("`\"{word}\"`")).collect();
                f.write_str(&words.join(", "))
            }
            Self::List(item, Some(count)) => write!(f, "{count} {}", item.plural()),
            Self::List(item, None) => write!(f, "list of {}", item.plural()),
            Self::Either(a, b) => write!(f, "{a} or {b}"),
            Self::Any => f.write_str("any value"),
            Self::Map(item) => write!(f, "table of {}", item.plural()),
        }
    }
}

/// A range of numbers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Range {
    /// The least number.
    pub least: f64,
    /// The greatest number.
    pub greatest: f64,
    /// Whether the least number itself is not allowed.
    pub above: bool,
    /// Whether the greatest number itself is not allowed.
    pub below: bool,
}

impl Range {
    /// Reports whether the range contains a number.
    pub fn contains(&self, value: f64) -> bool {
        let high_enough = value > self.least || (!self.above && value == self.least);
        let low_enough = value < self.greatest || (!self.below && value == self.greatest);
        high_enough && low_enough
    }
}

/// Numbers greater than `least`, up to and including `greatest`.
pub(super) fn above(least: f64, greatest: f64) -> Range {
    Range {
        least,
        greatest,
        above: true,
        below: false,
    }
}

/// Numbers greater than `least` and less than `greatest`.
pub(super) fn between(least: f64, greatest: f64) -> Range {
    Range {
        least,
        greatest,
        above: true,
        below: true,
    }
}

impl From<std::ops::RangeInclusive<f64>> for Range {
    fn from(range: std::ops::RangeInclusive<f64>) -> Self {
        Self {
            least: *range.start(),
            greatest: *range.end(),
            above: false,
            below: false,
        }
    }
}

impl From<std::ops::Range<f64>> for Range {
    fn from(range: std::ops::Range<f64>) -> Self {
        Self {
            least: range.start,
            greatest: range.end,
            above: false,
            below: true,
        }
    }
}

impl From<std::ops::RangeFrom<f64>> for Range {
    fn from(range: std::ops::RangeFrom<f64>) -> Self {
        Self {
            least: range.start,
            greatest: f64::INFINITY,
            above: false,
            below: false,
        }
    }
}

/// Formats a number the usual way: `1000000` as such, much larger and smaller numbers in scientific notation.
fn plain(value: f64) -> String {
    if value != 0.0 && !(1e-4..1e7).contains(&value.abs()) {
        format!("{value:e}")
    } else {
        format!("{value}")
    }
}

impl fmt::Display for Range {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (least, greatest) = (plain(self.least), plain(self.greatest));
        match (self.above, self.below, self.greatest.is_infinite()) {
            (false, _, true) => write!(f, "{least} or more"),
            (true, _, true) => write!(f, "above {least}"),
            (false, false, _) => write!(f, "{least} to {greatest}"),
            (true, false, _) => write!(f, "above {least} and at most {greatest}"),
            (false, true, _) => write!(f, "{least} or more and below {greatest}"),
            (true, true, _) => write!(f, "above {least} and below {greatest}"),
        }
    }
}

/// Returns the unit that the suffix of a key's name states; empty if it states none.
pub(super) fn unit_of(name: &str) -> &'static str {
    const UNITS: [(&str, &str); 20] = [
        ("_px_per_rad", "px/rad"),
        ("_deg_per_s", "degrees/s"),
        ("_per_m", "1/m"),
        ("_m2ps5", "m²/s⁵"),
        ("_m2ps3", "m²/s³"),
        ("_m2ps", "m²/s"),
        ("_mps2", "m/s²"),
        ("_mps", "m/s"),
        ("_m2", "m²"),
        ("_hz", "1/s"),
        ("_deg", "degrees"),
        ("_rad", "rad"),
        ("_px", "px"),
        ("_srgb", "sRGB, 0 to 255"),
        ("_grey", "grey levels of 255"),
        ("_frames", "frames"),
        ("_m", "m"),
        ("_s", "s"),
        ("fps", "frames/s"),
        ("_nats", "nats"),
    ];
    let found = UNITS.iter().find(|(end, _)| name.ends_with(end));
    found.map_or("", |(_, unit)| unit)
}
