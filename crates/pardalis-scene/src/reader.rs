//! Reads the tables of a TOML text and reports every problem with its key and line, whereas serde stops at the first.

use std::cell::RefCell;
use std::ops::Range;

use toml::Spanned;
use toml::de::{DeTable, DeValue};

use super::description::{Content, KeyDescription, Presence};
pub(super) use super::journal::{Journal, Located, Problem};
use super::{NAMES_ALLOWED, is_name};
use pardalis_core::Error;

/// A table of the text. It records the keys that the reader requests and reports all others as unknown.
pub(super) struct Table<'a, 't> {
    pub(super) journal: &'a Journal,
    path: String,
    table: &'a DeTable<'t>,
    span: Range<usize>,
    known: RefCell<Vec<&'static str>>,
}

/// The key and the meaning of a table in a group of which a file contains exactly one.
pub(super) type Kind = (&'static str, &'static str);

impl<'a, 't> Table<'a, 't> {
    pub(super) fn root(journal: &'a Journal, root: &'a Spanned<DeTable<'t>>) -> Self {
        Self::new(journal, String::new(), root.get_ref(), 0..0)
    }

    /// Creates a table without a file, to which the reader describes its keys.
    pub(super) fn describing(journal: &'a Journal, empty: &'a DeTable<'t>) -> Self {
        Self::new(journal, String::new(), empty, 0..0)
    }

    fn new(journal: &'a Journal, path: String, table: &'a DeTable<'t>, span: Range<usize>) -> Self {
        Self {
            journal,
            path,
            table,
            span,
            known: RefCell::default(),
        }
    }

    /// Returns the table below this one to which the reader describes the keys of a table.
    fn described(&self, key: &str) -> Self {
        Self::new(self.journal, self.path_of(key), self.table, 0..0)
    }

    /// Reports whether the reader describes its keys instead of reading a file. It then visits every branch.
    pub(super) fn is_describing(&self) -> bool {
        self.journal.is_describing()
    }

    fn describe(&self, key: &str, about: &'static str, content: Content, presence: Presence) {
        if self.is_describing() {
            self.journal.describe(KeyDescription {
                path: self.path_of(key),
                about,
                content,
                presence,
            });
        }
    }

    pub(super) fn path_of(&self, key: &str) -> String {
        if self.path.is_empty() {
            key.to_owned()
        } else {
            format!("{}.{key}", self.path)
        }
    }

    /// Returns the key's value and marks the key as known.
    pub(super) fn get(&self, key: &'static str) -> Option<&'a Spanned<DeValue<'t>>> {
        self.known.borrow_mut().push(key);
        self.table.get(key)
    }

    /// Returns the position of a key, or of the table if the key is missing.
    fn offset_of(&self, key: &str) -> usize {
        match self.table.get(key) {
            Some(value) => value.span().start,
            None => self.span.start,
        }
    }

    /// Reports a problem with a key of this table.
    pub(super) fn problem(&self, key: &str, message: impl Into<String>) {
        self.journal
            .add(self.offset_of(key), self.path_of(key), message.into());
    }

    /// Reports that a key cannot be given together with another one.
    pub(super) fn conflict(&self, key: &str, other: &str) {
        let message = format!("cannot be combined with {other}; remove one of them");
        self.problem(key, message);
    }

    /// Warns about a key that is valid but probably not intended.
    pub(super) fn warn(&self, key: &str, message: impl Into<String>) {
        self.journal
            .warn(self.offset_of(key), self.path_of(key), message.into());
    }

    /// Reports that the value of a key is not allowed. The value is printed as written.
    pub(super) fn reject(&self, key: &str, allowed: &str) {
        let value = self.table.get(key).map(|value| shown(value.get_ref()));
        self.problem(
            key,
            format!("is {}; allowed: {allowed}", value.unwrap_or_default()),
        );
    }

    /// Reports a problem with this table as a whole.
    pub(super) fn problem_here(&self, message: impl Into<String>) {
        self.journal
            .add(self.span.start, self.path.clone(), message.into());
    }

    /// Reports whether the key is given.
    pub(super) fn has(&self, key: &str) -> bool {
        self.table.get(key).is_some()
    }

    /// Returns the line of the value with this path of keys below this table, if it is given.
    pub(super) fn given(&self, path: &str) -> Option<usize> {
        let (parents, key) = path.rsplit_once('.').unwrap_or(("", path));
        let mut table = self.table;
        for parent in parents.split('.').filter(|parent| !parent.is_empty()) {
            table = table.get(parent)?.get_ref().as_table()?;
        }
        let value = table.get(key)?;
        Some(self.journal.line_of(value.span().start))
    }

    /// Reports whether the key is given and marks it as known, for a better message than that the key does not exist.
    pub(super) fn knows(&self, key: &'static str) -> bool {
        self.get(key).is_some()
    }

    /// Returns a value that was made from a key, with the key's position.
    pub(super) fn at<T>(&self, key: &str, value: T) -> Located<T> {
        Located {
            value,
            key: self.path_of(key),
            line: self.journal.line_of(self.offset_of(key)),
        }
    }

    /// Returns the position of the table itself.
    pub(super) fn here(&self) -> Located<String> {
        Located {
            value: String::new(),
            key: self.path.clone(),
            line: self.journal.line_of(self.span.start),
        }
    }

    /// Returns the value of a checked type, or reports the problem at the key that the library's error names.
    pub(super) fn checked<T>(&self, result: Result<T, Error>) -> Option<T> {
        match result {
            Ok(value) => Some(value),
            Err(Error::OutOfRange {
                name,
                value,
                allowed,
            }) if self.known.borrow().contains(&name.as_str()) => {
                if self.has(&name) {
                    self.reject(&name, &allowed);
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

    /// Returns a table under a key that is declared elsewhere, if it is given.
    pub(super) fn peek(&self, key: &'static str) -> Option<Table<'a, 't>> {
        let value = self.get(key)?;
        self.as_table(key, value)
    }

    /// Declares a table and reads it, if it is given. Without the table, [`Table::has`] is false; a key that is not a
    /// table is reported here.
    pub(super) fn section<T>(
        &self,
        key: &'static str,
        about: &'static str,
        read: impl FnOnce(&Table<'a, 't>) -> Option<T>,
    ) -> Option<T> {
        self.describe(key, about, Content::Table, Presence::Optional(""));
        let table = if self.is_describing() {
            self.described(key)
        } else {
            self.peek(key)?
        };
        let read = read(&table);
        table.finish();
        read
    }

    fn as_table(&self, key: &str, value: &'a Spanned<DeValue<'t>>) -> Option<Table<'a, 't>> {
        let DeValue::Table(table) = value.get_ref() else {
            self.reject(key, "a table");
            return None;
        };
        Some(Self::new(
            self.journal,
            self.path_of(key),
            table,
            value.span(),
        ))
    }

    /// Declares a table of tables whose names the user chooses, and returns these in the order of the text. The
    /// caller finishes each.
    pub(super) fn named_tables(
        &self,
        key: &'static str,
        about: &'static str,
        presence: Presence,
    ) -> Vec<(String, Table<'a, 't>)> {
        let is_required = matches!(presence, Presence::Required | Presence::RequiredIf(_));
        self.describe(key, about, Content::Named, presence);
        if self.is_describing() {
            let name = "NAME".to_owned();
            return vec![(name.clone(), self.described(key).described(&name))];
        }
        let wanted = format!("describe each in a table [{}.NAME]", self.path_of(key));
        let Some(tables) = self.peek(key) else {
            if is_required && !self.has(key) {
                self.problem(key, format!("is missing; {wanted}"));
            }
            return Vec::new();
        };
        let mut entries: Vec<_> = tables.table.iter().collect();
        entries.sort_by_key(|(name, _)| name.span().start);
        if entries.is_empty() {
            tables.problem_here(format!("is empty; {wanted}"));
        }
        let mut named = Vec::new();
        for (name, value) in entries {
            let name = name.get_ref();
            if !is_name(name) {
                tables.problem(
                    name,
                    format!("is not a valid name; allowed: {NAMES_ALLOWED}"),
                );
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

    /// Declares a list of tables and returns these. The caller finishes each.
    pub(super) fn tables(&self, key: &'static str, about: &'static str) -> Vec<Table<'a, 't>> {
        self.describe(key, about, Content::List, Presence::Optional(""));
        if self.is_describing() {
            return vec![self.described(key)];
        }
        let Some(value) = self.get(key) else {
            return Vec::new();
        };
        let items = value.get_ref().as_array();
        let tables: Option<Vec<_>> = items.and_then(|items| {
            let table_of = |(i, item): (usize, &'a Spanned<DeValue<'t>>)| {
                let path = format!("{}[{}]", self.path_of(key), i + 1);
                let table = item.get_ref().as_table()?;
                Some(Self::new(self.journal, path, table, item.span()))
            };
            items.iter().enumerate().map(table_of).collect()
        });
        tables.unwrap_or_else(|| {
            self.reject(key, "a list of tables");
            Vec::new()
        })
    }

    /// Declares a table that holds exactly one of several tables, and reads that one.
    pub(super) fn choice<T>(
        &self,
        key: &'static str,
        about: &'static str,
        kinds: &[Kind],
        presence: Presence,
        read: impl FnMut(&'static str, &Table<'a, 't>) -> Option<T>,
    ) -> Option<T> {
        let is_required = presence == Presence::Required;
        self.describe(key, about, Content::Choice, presence);
        if self.is_describing() {
            return self.described(key).one_of(kinds, read);
        }
        let Some(outer) = self.peek(key) else {
            if is_required && !self.has(key) {
                self.missing_choice(key, kinds);
            }
            return None;
        };
        let found = outer.one_of(kinds, read);
        outer.finish();
        found
    }

    /// Reports that none of several tables is given.
    pub(super) fn missing_choice(&self, key: &str, kinds: &[Kind]) {
        let wanted: Vec<_> = kinds
            .iter()
            .map(|(kind, _)| format!("{key}.{kind}"))
            .collect();
        let message = format!("is missing; give a table {}", wanted.join(" or "));
        self.problem(key, message);
    }

    /// Declares several tables of which this one must contain exactly one, and reads that one.
    pub(super) fn one_of<T>(
        &self,
        kinds: &[Kind],
        mut read: impl FnMut(&'static str, &Table<'a, 't>) -> Option<T>,
    ) -> Option<T> {
        if self.is_describing() {
            for &(kind, about) in kinds {
                self.describe(kind, about, Content::Table, Presence::Optional(""));
                read(kind, &self.described(kind));
            }
            return None;
        }
        let names: Vec<&'static str> = kinds.iter().map(|(kind, _)| *kind).collect();
        let given: Vec<_> = names
            .iter()
            .copied()
            .filter(|kind| self.has(kind))
            .collect();
        match given[..] {
            [kind] => {
                let table = self.peek(kind)?;
                let read = read(kind, &table);
                table.finish();
                read
            }
            [] => {
                let wanted: Vec<_> = names
                    .iter()
                    .map(|kind| format!("[{}.{kind}]", self.path))
                    .collect();
                self.problem_here(format!(
                    "is incomplete; give a table {}",
                    wanted.join(" or ")
                ));
                self.known.borrow_mut().extend(names);
                None
            }
            _ => {
                self.problem_here(format!(
                    "has {}; keep one of them",
                    listed(given.into_iter())
                ));
                self.known.borrow_mut().extend(names);
                None
            }
        }
    }

    /// Reports the keys that the reader did not request.
    pub(super) fn finish(self) {
        let known = self.known.borrow();
        for (key, _) in self
            .table
            .iter()
            .filter(|(key, _)| !known.contains(&&**key.get_ref()))
        {
            let name = key.get_ref();
            // Much longer names are never similar, and costly to compare.
            let near = known
                .iter()
                .filter(|k| name.len() <= 2 * k.len())
                .map(|k| (distance(name, k), *k))
                .min()
                .filter(|&(d, k)| d <= 1 + k.len() / 4);
            let hint = if let Some((_, near)) = near {
                if !self.has(near) {
                    self.journal.is_misspelt(&self.path_of(near));
                }
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

/// Formats a value as written, shortened.
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

/// Returns the number of edits between two words (Levenshtein).
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
