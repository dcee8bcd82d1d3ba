//! YAML, JSON and OpenCV's XML as one tree whose nodes know their lines, so that every error states
//! key and line.

use std::fmt;

use roxmltree::ParsingOptions;
use serde::de::{Deserialize, Deserializer, Error as _, MapAccess, SeqAccess, Visitor};
use serde_saphyr::options::{NonFiniteFloatPolicy, Options};
use serde_saphyr::{Spanned, budget::Budget};

use pardalis_core::Error;

/// Largest number of characters of a value in error messages.
const MAX_SHOWN: usize = 60;

/// Largest number of nodes in a document. Calibrations have a few hundred; with their corners and
/// residuals, several ten thousand.
const MAX_NODES: usize = 200_000;

/// Largest depth of a document.
const MAX_DEPTH: usize = 32;

/// A value of a document and its line, counted from 1.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Node {
    line: usize,
    value: Value,
}

#[derive(Debug, Clone, PartialEq)]
enum Value {
    Nothing,
    /// A finite number.
    Number(f64),
    /// Any other scalar, including `.Nan` and `.Inf`.
    Text(String),
    List(Vec<Node>),
    /// Entries with unique keys, in the order of the text.
    Map(Vec<(String, Node)>),
}

/// Parses YAML or its subset JSON. Accepts OpenCV's `%YAML:1.0`, rejects aliases.
pub(super) fn parse_yaml(text: &str) -> Result<Node, Error> {
    let mut budget = Budget::default();
    budget.max_nodes = MAX_NODES;
    budget.max_depth = MAX_DEPTH;
    budget.max_aliases = 0;
    let mut options = Options::default();
    options.budget = Some(budget);
    options.with_snippet = false;
    options.non_finite_float_policy = NonFiniteFloatPolicy::AsString;
    let plain = without_directive(text);
    serde_saphyr::from_str_with_options::<Spanned<Value>>(&plain, options)
        .map(Node::from)
        .map_err(|error| {
            let line = error
                .location()
                .map_or(1, |location| location.line() as usize);
            let message = match error {
                serde_saphyr::Error::DuplicateMappingKey { key: Some(key), .. } => {
                    format!("duplicate key {key}; keep one, and give each camera its own name")
                }
                error => format!("not valid YAML or JSON: {error}"),
            };
            error_at(line, message)
        })
}

/// Returns the text with OpenCV's first line blank: `%YAML:1.0` is not a valid YAML directive, and
/// old files have no `---` after it.
fn without_directive(text: &str) -> String {
    let text = text.trim_start_matches('\u{feff}');
    if !text.starts_with("%YAML") {
        return text.to_owned();
    }
    let end = text.find('\n').unwrap_or(text.len());
    text[end..].to_owned()
}

impl From<Spanned<Value>> for Node {
    fn from(spanned: Spanned<Value>) -> Self {
        Self {
            line: (spanned.referenced.line() as usize).max(1),
            value: spanned.value,
        }
    }
}

impl<'de> Deserialize<'de> for Value {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(ValueVisitor)
    }
}

struct ValueVisitor;

impl<'de> Visitor<'de> for ValueVisitor {
    type Value = Value;

    fn expecting(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str("a number, a text, a list or a map")
    }

    fn visit_unit<E>(self) -> Result<Value, E> {
        Ok(Value::Nothing)
    }

    fn visit_bool<E>(self, value: bool) -> Result<Value, E> {
        Ok(Value::Text(value.to_string()))
    }

    fn visit_i64<E>(self, value: i64) -> Result<Value, E> {
        Ok(Value::Number(value as f64))
    }

    fn visit_u64<E>(self, value: u64) -> Result<Value, E> {
        Ok(Value::Number(value as f64))
    }

    fn visit_i128<E>(self, value: i128) -> Result<Value, E> {
        Ok(Value::Number(value as f64))
    }

    fn visit_u128<E>(self, value: u128) -> Result<Value, E> {
        Ok(Value::Number(value as f64))
    }

    fn visit_f64<E>(self, value: f64) -> Result<Value, E> {
        Ok(if value.is_finite() {
            Value::Number(value)
        } else {
            Value::Text(value.to_string())
        })
    }

    fn visit_str<E>(self, value: &str) -> Result<Value, E> {
        Ok(Value::Text(value.to_owned()))
    }

    fn visit_seq<A: SeqAccess<'de>>(self, mut items: A) -> Result<Value, A::Error> {
        let mut list = Vec::new();
        while let Some(item) = items.next_element::<Spanned<Value>>()? {
            list.push(item.into());
        }
        Ok(Value::List(list))
    }

    fn visit_map<A: MapAccess<'de>>(self, mut entries: A) -> Result<Value, A::Error> {
        let mut map: Vec<(String, Node)> = Vec::new();
        while let Some((key, value)) = entries.next_entry::<Spanned<Value>, Spanned<Value>>()? {
            let key = Node::from(key);
            let name = match key.value {
                Value::Text(text) => text,
                Value::Number(number) => number.to_string(),
                _ => return Err(A::Error::custom("a key is neither a text nor a number")),
            };
            // Use the line of the key: the value of a map or list starts on a later line.
            let line = key.line;
            map.push((
                name,
                Node {
                    line,
                    value: value.value,
                },
            ));
        }
        Ok(Value::Map(map))
    }
}

/// Parses OpenCV's XML: the content of `<opencv_storage>`.
pub(super) fn parse_xml(text: &str) -> Result<Node, Error> {
    let options = ParsingOptions {
        nodes_limit: MAX_NODES as u32,
        ..ParsingOptions::default()
    };
    let document = roxmltree::Document::parse_with_options(text, options)
        .map_err(|error| error_at(error.pos().row as usize, format!("not valid XML: {error}")))?;
    let root = document.root_element();
    if !root.has_tag_name("opencv_storage") {
        let found = shortened(root.tag_name().name());
        return Err(error_at(
            line_of(root),
            format!("the outermost element is <{found}>; allowed: <opencv_storage>"),
        ));
    }
    node_from_xml(root, 0)
}

fn line_of(element: roxmltree::Node) -> usize {
    element.document().text_pos_at(element.range().start).row as usize
}

fn node_from_xml(element: roxmltree::Node, depth: usize) -> Result<Node, Error> {
    let line = line_of(element);
    if depth > MAX_DEPTH {
        return Err(error_at(
            line,
            format!("elements are nested too deeply; allowed: {MAX_DEPTH} levels"),
        ));
    }
    let mut map: Vec<(String, Node)> = Vec::new();
    let mut list = Vec::new();
    for child in element.children().filter(roxmltree::Node::is_element) {
        let node = node_from_xml(child, depth + 1)?;
        let key = child.tag_name().name();
        if key == "_" {
            list.push(node);
        } else if map.iter().any(|(known, _)| known == key) {
            let key = shortened(key);
            return Err(error_at(
                line_of(child),
                format!("duplicate element <{key}>; keep one"),
            ));
        } else {
            map.push((key.to_owned(), node));
        }
    }
    let value = if !map.is_empty() {
        Value::Map(map)
    } else if !list.is_empty() {
        Value::List(list)
    } else {
        value_from_words(element.text().unwrap_or_default().trim(), line)
    };
    Ok(Node { line, value })
}

/// Converts the text of an element without children: a quoted text, a single word or number, or a
/// list of them.
fn value_from_words(text: &str, line: usize) -> Value {
    let scalar = |word: &str| match word.parse::<f64>() {
        Ok(number) if number.is_finite() => Value::Number(number),
        _ => Value::Text(word.to_owned()),
    };
    if let Some(quoted) = text.strip_prefix('"').and_then(|t| t.strip_suffix('"')) {
        return Value::Text(quoted.to_owned());
    }
    let mut words = text.split_ascii_whitespace();
    match (words.next(), words.next()) {
        (None, _) => Value::Nothing,
        (Some(word), None) => scalar(word),
        _ => Value::List(
            text.split_ascii_whitespace()
                .map(|word| Node {
                    line,
                    value: scalar(word),
                })
                .collect(),
        ),
    }
}

pub(super) fn error_at(line: usize, message: String) -> Error {
    Error::Parse { line, message }
}

fn shortened(text: &str) -> String {
    match text.char_indices().nth(MAX_SHOWN) {
        Some((end, _)) => format!("{}...", &text[..end]),
        None => text.to_owned(),
    }
}

/// A node and its full key, such as `cam0.T_cam_imu`.
#[derive(Debug, Clone)]
pub(super) struct Entry<'a> {
    key: String,
    node: &'a Node,
}

/// A matrix in row-major order.
pub(super) struct Matrix<'a> {
    pub(super) entry: Entry<'a>,
    pub(super) size: (usize, usize),
    pub(super) data: Vec<f64>,
}

impl<'a> Entry<'a> {
    /// Returns the whole document.
    pub(super) fn root(node: &'a Node) -> Self {
        Self {
            key: String::new(),
            node,
        }
    }

    fn child(&self, key: &str, node: &'a Node) -> Self {
        let key = if self.key.is_empty() {
            shortened(key)
        } else {
            format!("{}.{}", self.key, shortened(key))
        };
        Self { key, node }
    }

    /// Returns the last part of the key.
    pub(super) fn name(&self) -> &str {
        self.key.rsplit('.').next().unwrap_or_default()
    }

    /// Creates an error about this value. The message states the problem and what is allowed.
    pub(super) fn error(&self, message: impl fmt::Display) -> Error {
        let message = if self.key.is_empty() {
            message.to_string()
        } else {
            format!("{}: {message}", self.key)
        };
        error_at(self.node.line, message)
    }

    /// Creates an error that states this value and what is allowed.
    pub(super) fn invalid(&self, allowed: &str) -> Error {
        let found = match &self.node.value {
            Value::Nothing => "empty".to_owned(),
            Value::Number(number) => number.to_string(),
            Value::Text(text) => format!("\"{}\"", shortened(text)),
            Value::List(items) => format!("a list of {}", items.len()),
            Value::Map(_) => "a map".to_owned(),
        };
        self.error(format!("is {found}; allowed: {allowed}"))
    }

    /// Adds key and line to the error of a check of this value.
    pub(super) fn checked<T>(&self, result: Result<T, Error>) -> Result<T, Error> {
        result.map_err(|error| self.error(error))
    }

    /// Returns the value of a key, or `None` if the key is missing.
    pub(super) fn get(&self, key: &str) -> Option<Self> {
        let Value::Map(map) = &self.node.value else {
            return None;
        };
        map.iter()
            .find(|(known, _)| known == key)
            .map(|(key, node)| self.child(key, node))
    }

    /// Returns the value of a key that must be present.
    pub(super) fn required(&self, key: &str) -> Result<Self, Error> {
        self.get(key)
            .ok_or_else(|| self.error(format!("{key} is missing")))
    }

    /// Returns the value of one of several synonymous keys. Rejects two of them at once.
    pub(super) fn one_of(&self, keys: &[String]) -> Result<Option<Self>, Error> {
        let mut found = keys.iter().filter_map(|key| self.get(key));
        let first = found.next();
        if let (Some(first), Some(second)) = (&first, found.next()) {
            return Err(second.error(format!(
                "conflicts with {}, which has the same meaning; keep one",
                first.key
            )));
        }
        Ok(first)
    }

    /// Returns the entries of a map in the order of the text.
    pub(super) fn entries(&self) -> Vec<Self> {
        match &self.node.value {
            Value::Map(map) => map
                .iter()
                .map(|(key, node)| self.child(key, node))
                .collect(),
            _ => Vec::new(),
        }
    }

    /// Returns the elements of a list.
    pub(super) fn items(&self) -> Result<Vec<Self>, Error> {
        let Value::List(items) = &self.node.value else {
            return Err(self.invalid("a list"));
        };
        let numbered = items.iter().enumerate();
        Ok(numbered
            .map(|(i, node)| Self {
                key: format!("{}[{i}]", self.key),
                node,
            })
            .collect())
    }

    /// Returns the value as a text; numbers are formatted.
    pub(super) fn text(&self) -> Result<String, Error> {
        match &self.node.value {
            Value::Text(text) => Ok(text.clone()),
            Value::Number(number) => Ok(number.to_string()),
            Value::Nothing => Ok(String::new()),
            _ => Err(self.invalid("a text")),
        }
    }

    /// Returns the value as a finite number.
    pub(super) fn number(&self) -> Result<f64, Error> {
        match self.node.value {
            Value::Number(number) => Ok(number),
            _ => Err(self.invalid("a finite number")),
        }
    }

    /// Returns the value as an integer between bounds.
    pub(super) fn whole(&self, min: usize, max: usize) -> Result<usize, Error> {
        match self.node.value {
            Value::Number(n) if n.fract() == 0.0 && n >= min as f64 && n <= max as f64 => {
                Ok(n as usize)
            }
            _ => Err(self.invalid(&format!("a whole number from {min} to {max}"))),
        }
    }

    /// Returns the value as a list of finite numbers.
    pub(super) fn numbers(&self) -> Result<Vec<f64>, Error> {
        self.items()?.iter().map(Self::number).collect()
    }

    /// Returns the value as a list of exactly `N` finite numbers, described by `names`.
    pub(super) fn exactly<const N: usize>(&self, names: &str) -> Result<[f64; N], Error> {
        self.numbers()?
            .try_into()
            .map_err(|_| self.invalid(&format!("{N} numbers: {names}")))
    }

    /// Returns the value as a matrix: a map with `rows`, `cols` and `data` (or `sizes` and `data`),
    /// a list of rows, or a list of numbers, which is a single column.
    pub(super) fn matrix(&self) -> Result<Matrix<'a>, Error> {
        let of = |size, data| Matrix {
            entry: self.clone(),
            size,
            data,
        };
        if let Some(data) = self.get("data") {
            let values = match data.node.value {
                Value::Number(number) => vec![number],
                _ => data.numbers()?,
            };
            let size = match self.get("sizes") {
                Some(sizes) => match sizes.numbers()?[..] {
                    [rows] => (rows, 1.0),
                    [rows, cols] => (rows, cols),
                    _ => return Err(sizes.invalid("one or two numbers")),
                },
                None => (
                    self.required("rows")?.number()?,
                    self.required("cols")?.number()?,
                ),
            };
            if size.0 < 0.0 || size.1 < 0.0 {
                return Err(self.error(format!(
                    "has the size {} x {}; allowed: 0 or more",
                    size.0, size.1
                )));
            }
            if size.0 * size.1 != values.len() as f64 {
                return Err(self.error(format!(
                    "has {} numbers, but its size is {} x {}",
                    values.len(),
                    size.0,
                    size.1
                )));
            }
            return Ok(of((size.0 as usize, size.1 as usize), values));
        }
        if matches!(self.node.value, Value::Number(_)) {
            return Ok(of((1, 1), vec![self.number()?]));
        }
        let items = self.items()?;
        if !items.iter().any(|item| item.items().is_ok()) {
            return Ok(of((items.len(), 1), self.numbers()?));
        }
        let rows: Vec<Vec<f64>> = items
            .iter()
            .map(Self::numbers)
            .collect::<Result<_, Error>>()?;
        let width = rows[0].len();
        if rows.iter().any(|row| row.len() != width) {
            return Err(self.error("has rows of different lengths"));
        }
        Ok(of((rows.len(), width), rows.concat()))
    }
}

impl Matrix<'_> {
    /// Returns the rows of a matrix of the given size.
    pub(super) fn rows<const R: usize, const C: usize>(&self) -> Result<[[f64; C]; R], Error> {
        if self.size != (R, C) && !(self.size == (R * C, 1) && R > 1 && C > 1) {
            return Err(self.invalid_size(&format!("{R} x {C}")));
        }
        Ok(std::array::from_fn(|i| {
            std::array::from_fn(|j| self.data[i * C + j])
        }))
    }

    /// Returns the elements of a single row or column.
    pub(super) fn vector(&self) -> Result<&[f64], Error> {
        if self.size.0 != 1 && self.size.1 != 1 {
            return Err(self.invalid_size("one row or one column"));
        }
        Ok(&self.data)
    }

    fn invalid_size(&self, allowed: &str) -> Error {
        let (rows, cols) = self.size;
        self.entry
            .error(format!("is {rows} x {cols}; allowed: {allowed}"))
    }
}
