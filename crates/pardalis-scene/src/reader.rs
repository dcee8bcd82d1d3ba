//! Reads a TOML text whole and gathers every problem with its key and line, where serde would stop at the first.

use std::cell::RefCell;
use std::fmt;
use std::ops::Range;

use toml::Spanned;
use toml::de::{DeTable, DeValue};

use super::setting::Setting;
use super::{NAMES_ALLOWED, is_name};
use pardalis_core::Error;

/// What is wrong with a text, and where.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct Problem {
    /// The line, from 1; 0 where a value that was put in the place of the text's is at fault.
    pub line: usize,
    /// The full key, as `targets.ball.shape.sphere.radius_m`; empty for the text as a whole.
    pub key: String,
    /// What is wrong and what is allowed.
    pub message: String,
}

impl fmt::Display for Problem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.line {
            0 => f.write_str("as set")?,
            line => write!(f, "line {line}")?,
        }
        if self.key.is_empty() {
            write!(f, ": {}", self.message)
        } else {
            write!(f, ": {}: {}", self.key, self.message)
        }
    }
}

/// A setting together with the place where it stands, for problems that show only when the setting is used.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Located<T> {
    /// The setting.
    pub value: T,
    /// Its full key.
    pub key: String,
    /// Its line, from 1; 0 where it was put in the place of the text's.
    pub line: usize,
}

impl<T> Located<T> {
    /// A problem with this setting.
    pub fn problem(&self, message: impl Into<String>) -> Problem {
        Problem {
            line: self.line,
            key: self.key.clone(),
            message: message.into(),
        }
    }
}

/// Problems and resolved settings, shared by all tables of one text.
pub(super) struct Journal {
    /// Where each line but the first begins.
    line_starts: Vec<usize>,
    /// The text's length in bytes; what lies behind it was put in from outside.
    text_len: usize,
    problems: RefCell<Vec<Problem>>,
    /// What is allowed but deserves a word.
    warnings: RefCell<Vec<Problem>>,
    /// Every setting with its final value, given or default.
    resolved: RefCell<toml::Table>,
    /// Why the text is no TOML: what else seems wrong with it follows from that.
    syntax: Option<Problem>,
}

/// Characters of a problem's key or message that are shown at most.
const MAX_SHOWN: usize = 300;

impl Journal {
    /// Parses the text. Where it is no TOML the first fault is all that will be told; of doubled keys the first is taken, and the rest is still read.
    pub(super) fn parse(text: &str) -> (Self, Spanned<DeTable<'_>>) {
        let (root, errors) = DeTable::parse_recoverable(text);
        let mut journal = Self {
            line_starts: text.match_indices('\n').map(|(at, _)| at + 1).collect(),
            text_len: text.len(),
            problems: RefCell::default(),
            warnings: RefCell::default(),
            syntax: None,
            resolved: RefCell::default(),
        };
        let mut has_doubled_name = false;
        for error in errors {
            let offset = error.span().map_or(0, |span| span.start);
            match error.message() {
                "duplicate key" => {
                    let key = text.get(error.span().unwrap_or(0..0)).unwrap_or_default();
                    let key = key.trim();
                    let message = match first_of_name(text, offset, key) {
                        Some((kind, line)) => {
                            has_doubled_name = true;
                            format!(
                                "two {kind} are named {key}, the first in line {line}; give each a name of its own"
                            )
                        }
                        // That the second has the keys of the first follows from it.
                        None if has_doubled_name => continue,
                        None => format!("the key {key} stands there twice; keep one"),
                    };
                    journal.add(offset, String::new(), message);
                }
                "recursion limit" | "cannot recurse further; max recursion depth met" => {
                    let message =
                        "tables or lists lie too deep in one another; allowed: a few levels";
                    // Brackets that seem not to be closed follow from it.
                    let problem = journal.problem_at(offset, String::new(), message.to_owned());
                    journal.syntax = Some(problem);
                }
                message => {
                    let message = message.replace('\n', ", ");
                    let problem = journal.problem_at(offset, String::new(), message);
                    journal.syntax.get_or_insert(problem);
                }
            }
        }
        (journal, root)
    }

    /// The line of a place in the text, from 1; 0 behind the text.
    fn line_of(&self, offset: usize) -> usize {
        if offset > self.text_len {
            return 0;
        }
        self.line_starts.partition_point(|&start| start <= offset) + 1
    }

    fn problem_at(&self, offset: usize, key: String, message: String) -> Problem {
        Problem {
            line: self.line_of(offset),
            key: shortened(key),
            message: shortened(message),
        }
    }

    fn add(&self, offset: usize, key: String, message: String) {
        let problem = self.problem_at(offset, key, message);
        self.problems.borrow_mut().push(problem);
    }

    /// All problems, in the order of their lines; where there are none, what deserves a word, and every setting with its final value.
    pub(super) fn finish(self) -> Result<(Vec<Problem>, toml::Table), Vec<Problem>> {
        if let Some(problem) = self.syntax {
            return Err(vec![problem]);
        }
        let mut problems = self.problems.into_inner();
        problems.sort();
        problems.dedup();
        if problems.is_empty() {
            Ok((self.warnings.into_inner(), self.resolved.into_inner()))
        } else {
            Err(problems)
        }
    }

    /// A problem that shows only when settings are put together.
    pub(super) fn report(&self, problem: Problem) {
        self.problems.borrow_mut().push(problem);
    }

    fn record(&self, path: &str, value: toml::Value) {
        let mut table = &mut *self.resolved.borrow_mut();
        let mut parts = path.split('.').peekable();
        while let Some(part) = parts.next() {
            if parts.peek().is_none() {
                table.insert(part.to_owned(), value);
                return;
            }
            let entry = table
                .entry(part)
                .or_insert_with(|| toml::Value::Table(toml::Table::new()));
            match entry {
                toml::Value::Table(inner) => table = inner,
                _ => return,
            }
        }
    }
}

/// A table of the text, which knows the keys that were asked for, so that the others can be named as unknown.
pub(super) struct Table<'a, 't> {
    journal: &'a Journal,
    path: String,
    table: &'a DeTable<'t>,
    span: Range<usize>,
    known: RefCell<Vec<&'static str>>,
}

impl<'a, 't> Table<'a, 't> {
    pub(super) fn root(journal: &'a Journal, root: &'a Spanned<DeTable<'t>>) -> Self {
        Self {
            journal,
            path: String::new(),
            table: root.get_ref(),
            span: 0..0,
            known: RefCell::default(),
        }
    }

    fn path_of(&self, key: &str) -> String {
        if self.path.is_empty() {
            key.to_owned()
        } else {
            format!("{}.{key}", self.path)
        }
    }

    /// The key's value; the key counts as known from now on.
    fn get(&self, key: &'static str) -> Option<&'a Spanned<DeValue<'t>>> {
        self.known.borrow_mut().push(key);
        self.table.get(key)
    }

    /// The place of a key, or of the table where the key is not given.
    fn offset_of(&self, key: &str) -> usize {
        match self.table.get(key) {
            Some(value) => value.span().start,
            None => self.span.start,
        }
    }

    /// A problem with a key of this table.
    pub(super) fn problem(&self, key: &str, message: impl Into<String>) {
        self.journal
            .add(self.offset_of(key), self.path_of(key), message.into());
    }

    /// Something about a key of this table that is allowed but deserves a word.
    pub(super) fn warn(&self, key: &str, message: impl Into<String>) {
        let warning =
            self.journal
                .problem_at(self.offset_of(key), self.path_of(key), message.into());
        self.journal.warnings.borrow_mut().push(warning);
    }

    /// A problem with the value of a key, which is shown as it was written.
    pub(super) fn refuse(&self, key: &str, allowed: &str) {
        let value = self.table.get(key).map(|value| shown(value.get_ref()));
        self.problem(
            key,
            format!("is {}; allowed: {allowed}", value.unwrap_or_default()),
        );
    }

    /// A problem with this table as a whole.
    pub(super) fn problem_here(&self, message: impl Into<String>) {
        self.journal
            .add(self.span.start, self.path.clone(), message.into());
    }

    /// Whether the key is given.
    pub(super) fn has(&self, key: &str) -> bool {
        self.table.get(key).is_some()
    }

    /// Whether the key is given; it counts as known from now on.
    pub(super) fn knows(&self, key: &'static str) -> bool {
        self.get(key).is_some()
    }

    /// The setting, if it is given and of the right type.
    pub(super) fn optional<T: Setting>(&self, key: &'static str) -> Option<T> {
        let value = self.get(key)?;
        if let Some(setting) = T::read(value.get_ref()) {
            self.journal.record(&self.path_of(key), setting.write());
            return Some(setting);
        }
        self.refuse(key, T::ALLOWED);
        None
    }

    /// The setting, which must be given.
    pub(super) fn required<T: Setting>(&self, key: &'static str) -> Option<T> {
        if !self.has(key) {
            self.known.borrow_mut().push(key);
            self.problem(key, format!("is missing; give {}", T::ALLOWED));
            return None;
        }
        self.optional(key)
    }

    /// The setting, or its default.
    pub(super) fn or<T: Setting>(&self, key: &'static str, default: T) -> T {
        let given = self.optional(key);
        if given.is_none() {
            self.journal.record(&self.path_of(key), default.write());
        }
        given.unwrap_or(default)
    }

    /// A text that is one of a few words, or its default.
    pub(super) fn word<T: Copy>(
        &self,
        key: &'static str,
        words: &[(&str, T)],
        default: &str,
    ) -> Option<T> {
        let word: String = self.or(key, default.to_owned());
        let found = words
            .iter()
            .find(|(name, _)| *name == word)
            .map(|&(_, value)| value);
        if found.is_none() {
            self.problem(
                key,
                format!(
                    "is \"{word}\"; allowed: {}",
                    listed(words.iter().map(|w| w.0))
                ),
            );
        }
        found
    }

    /// A setting with its place.
    pub(super) fn located<T: Setting>(&self, key: &'static str) -> Option<Located<T>> {
        self.optional(key).map(|value| self.at(key, value))
    }

    /// A value that was made from a key, with the key's place.
    pub(super) fn at<T>(&self, key: &str, value: T) -> Located<T> {
        Located {
            value,
            key: self.path_of(key),
            line: self.journal.line_of(self.offset_of(key)),
        }
    }

    /// The value of a checked type, or the problem at the key that the library's error names.
    pub(super) fn checked<T>(&self, result: Result<T, Error>) -> Option<T> {
        match result {
            Ok(value) => Some(value),
            Err(Error::OutOfRange {
                name,
                value,
                allowed,
            }) if self.known.borrow().contains(&name.as_str()) => {
                if self.has(&name) {
                    self.refuse(&name, &allowed);
                } else {
                    self.problem(&name, format!("is {value}; allowed: {allowed}"));
                }
                None
            }
            Err(error) => {
                self.problem_here(error.to_string());
                None
            }
        }
    }

    /// A table under this key, if it is given.
    pub(super) fn table(&self, key: &'static str) -> Option<Table<'a, 't>> {
        let value = self.get(key)?;
        self.as_table(key, value)
    }

    fn as_table(&self, key: &str, value: &'a Spanned<DeValue<'t>>) -> Option<Table<'a, 't>> {
        let DeValue::Table(table) = value.get_ref() else {
            self.refuse(key, "a table");
            return None;
        };
        Some(Table {
            journal: self.journal,
            path: self.path_of(key),
            table,
            span: value.span(),
            known: RefCell::default(),
        })
    }

    /// The tables of names that the user chooses, in the order of the text.
    pub(super) fn named_tables(
        &self,
        key: &'static str,
        what: &str,
    ) -> Vec<(String, Table<'a, 't>)> {
        let Some(tables) = self.table(key) else {
            if !self.has(key) {
                self.problem(
                    key,
                    format!("is missing; describe each {what} in a table [{key}.NAME]"),
                );
            }
            return Vec::new();
        };
        let mut entries: Vec<_> = tables.table.iter().collect();
        entries.sort_by_key(|(name, _)| name.span().start);
        if entries.is_empty() {
            tables.problem_here(format!(
                "is empty; describe each {what} in a table [{key}.NAME]"
            ));
        }
        let mut named = Vec::new();
        for (name, value) in entries {
            let name = name.get_ref();
            if !is_name(name) {
                tables.problem(name, format!("is no name; allowed: {NAMES_ALLOWED}"));
                continue;
            }
            named.extend(
                tables
                    .as_table(name, value)
                    .map(|table| (name.to_string(), table)),
            );
        }
        named
    }

    /// The one table that this table must hold, of those allowed: which kind of thing this is, and its parameters.
    pub(super) fn one_of(&self, kinds: &[&'static str]) -> Option<(&'static str, Table<'a, 't>)> {
        let given: Vec<_> = kinds
            .iter()
            .copied()
            .filter(|kind| self.has(kind))
            .collect();
        match given[..] {
            [kind] => self.table(kind).map(|table| (kind, table)),
            [] => {
                let wanted = kinds
                    .iter()
                    .map(|kind| format!("[{}.{kind}]", self.path))
                    .collect::<Vec<_>>()
                    .join(" or ");
                self.problem_here(format!("says no kind; give a table {wanted}"));
                self.known.borrow_mut().extend(kinds);
                None
            }
            _ => {
                self.known.borrow_mut().extend(kinds);
                self.problem_here(format!(
                    "has {}; allowed: one of them",
                    listed(given.into_iter())
                ));
                None
            }
        }
    }

    /// Names the keys that nobody asked for.
    pub(super) fn finish(self) {
        let known = self.known.borrow();
        for (key, _) in self
            .table
            .iter()
            .filter(|(key, _)| !known.contains(&&**key.get_ref()))
        {
            let name = key.get_ref();
            // Far longer names are near to none, and costly to compare.
            let near = known
                .iter()
                .filter(|k| name.len() <= 2 * k.len())
                .map(|k| (distance(name, k), *k))
                .min()
                .filter(|&(d, k)| d <= 1 + k.len() / 4);
            let hint = if let Some((_, near)) = near {
                format!("did you mean {near}?")
            } else {
                let mut sorted: Vec<_> = known.clone();
                sorted.sort_unstable();
                sorted.dedup();
                format!("allowed here: {}", sorted.join(", "))
            };
            self.journal.add(
                key.span().start,
                self.path_of(name),
                format!("is not a key; {hint}"),
            );
        }
    }
}

/// Where a doubled key is the name of a camera or target: which of them, and the line in which its table begins first.
fn first_of_name(text: &str, offset: usize, key: &str) -> Option<(&'static str, usize)> {
    let before = text.get(..offset)?.trim_end().strip_suffix('.')?;
    let kinds = ["cameras", "targets"];
    let kind = kinds.into_iter().find(|kind| before.ends_with(kind))?;
    let header = format!("[{kind}.{key}");
    let is_its = |line: &str| {
        let rest = line.trim_start().strip_prefix(&header);
        rest.is_some_and(|rest| rest.starts_with([']', '.']))
    };
    let line = text.lines().position(is_its)?;
    Some((kind, line + 1))
}

fn shortened(text: String) -> String {
    match text.char_indices().nth(MAX_SHOWN) {
        Some((end, _)) => format!("{}...", &text[..end]),
        None => text,
    }
}

/// A value as a person wrote it, shortened.
fn shown(value: &DeValue) -> String {
    match value {
        DeValue::String(text) => {
            format!("the text \"{}\"", text.chars().take(40).collect::<String>())
        }
        DeValue::Integer(number) => number.as_str().to_owned(),
        DeValue::Float(number) => number.as_str().to_owned(),
        DeValue::Boolean(value) => value.to_string(),
        DeValue::Datetime(_) => "a date".to_owned(),
        DeValue::Array(items) if (1..=5).contains(&items.len()) => {
            let items: Vec<_> = items.iter().map(|item| shown(item.get_ref())).collect();
            format!("[{}]", items.join(", "))
        }
        DeValue::Array(items) => format!("a list of {}", items.len()),
        DeValue::Table(_) => "a table".to_owned(),
    }
}

fn listed<'w>(words: impl Iterator<Item = &'w str>) -> String {
    words
        .map(|word| format!("\"{word}\""))
        .collect::<Vec<_>>()
        .join(", ")
}

/// Edits from one word to another (Levenshtein).
fn distance(a: &str, b: &str) -> usize {
    let b: Vec<char> = b.chars().collect();
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, ca) in a.chars().enumerate() {
        let mut diagonal = row[0];
        row[0] = i + 1;
        for (j, cb) in b.iter().enumerate() {
            let replaced = diagonal + usize::from(ca != *cb);
            diagonal = row[j + 1];
            row[j + 1] = replaced.min(row[j] + 1).min(diagonal + 1);
        }
    }
    row[b.len()]
}
