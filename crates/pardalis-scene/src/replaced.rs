//! Reading a text as a whole, with settings that replace its own before it is checked, for the sweeps of experiments.

use std::fmt::Write as _;

use toml::Spanned;
use toml::de::{DeTable, DeValue};

use super::journal::Problem;
use super::reader::{Journal, Table};

/// What a text says, and what is wrong with it.
pub(super) struct Read<T> {
    /// What was read; where there are problems, its valid parts.
    pub(super) result: T,
    /// Whether everything that was read, and all other problems, may follow from a syntax error.
    pub(super) has_syntax_error: bool,
    /// All warnings and all resolved settings, or every problem, in the order of lines.
    pub(super) found: Result<(Vec<Problem>, toml::Table), Vec<Problem>>,
}

/// Reads the root table of a text with some of its settings replaced or added, whatever its problems are.
pub(super) fn read_parts<T>(
    text: &str,
    replaced: &toml::Table,
    read: impl FnOnce(&Journal, &Table) -> T,
) -> Read<T> {
    let (journal, mut root) = Journal::parse(text);
    let values = text_behind(text, replaced);
    put_all(&mut root, replaced, &values);
    let table = Table::root(&journal, &root);
    let result = read(&journal, &table);
    table.finish();
    Read {
        result,
        has_syntax_error: journal.has_syntax_error(),
        found: journal.finish(),
    }
}

/// Reads the root table of a text with some of its settings replaced or added. Returns the result, all warnings and all
/// resolved settings; on failure, every problem, in the order of lines.
pub(super) fn read_with<T>(
    text: &str,
    replaced: &toml::Table,
    read: impl FnOnce(&Journal, &Table) -> T,
) -> Result<(T, Vec<Problem>, toml::Table), Vec<Problem>> {
    let Read { result, found, .. } = read_parts(text, replaced, read);
    found.map(|(warnings, resolved)| (result, warnings, resolved))
}

/// Returns the values as a TOML text in which all offsets lie beyond the scene's text, so that messages about them
/// state no line.
fn text_behind(scene_text: &str, replaced: &toml::Table) -> String {
    let mut text = " ".repeat(scene_text.len() + 1);
    for (number, value) in replaced.values().enumerate() {
        let _ = writeln!(text, "{number} = {value}");
    }
    text
}

/// Replaces or inserts the values of the text from [`text_behind`]. Creates missing parent tables.
fn put_all<'t>(root: &mut Spanned<DeTable<'t>>, replaced: &'t toml::Table, values: &'t str) {
    let (values, _) = DeTable::parse_recoverable(values);
    let mut values = values.into_inner();
    // In the order of the keys, so that tables precede the settings inside them.
    for (number, path) in replaced.keys().enumerate() {
        if let Some(value) = values.remove(&*number.to_string()) {
            put(root.get_mut(), path, value);
        }
    }
}

fn put<'t>(table: &mut DeTable<'t>, path: &'t str, value: Spanned<DeValue<'t>>) {
    let span = value.span();
    let Some((name, rest)) = path.split_once('.') else {
        table.insert(Spanned::new(span, path.into()), value);
        return;
    };
    let empty = || Spanned::new(span.clone(), DeValue::Table(DeTable::new()));
    let inner = table
        .entry(Spanned::new(span.clone(), name.into()))
        .or_insert_with(empty);
    if !inner.get_ref().is_table() {
        *inner = empty();
    }
    if let DeValue::Table(inner) = inner.get_mut() {
        put(inner, rest, value);
    }
}
