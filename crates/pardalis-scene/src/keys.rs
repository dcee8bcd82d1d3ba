//! The keys that a reader of files declares.

use toml::de::DeTable;

use super::description::{Content, KeyDescription};
use super::journal::Journal;
use super::reader::Table;

/// Returns the keys that a reader of files requests, in the order in which it does.
pub(super) fn keys_of(read: impl FnOnce(&Journal, &Table)) -> Vec<KeyDescription> {
    let journal = Journal::describing();
    let empty = DeTable::new();
    read(&journal, &Table::describing(&journal, &empty));
    journal.into_described()
}

/// Returns the keys directly in a table.
pub(super) fn keys_in<'k>(
    keys: &'k [KeyDescription],
    table: &'k str,
) -> impl Iterator<Item = &'k KeyDescription> {
    keys.iter()
        .filter(move |key| name_in(&key.path, table).is_some())
}

/// Returns the name of a key directly in a table.
pub(super) fn name_in<'k>(path: &'k str, table: &str) -> Option<&'k str> {
    let name = if table.is_empty() {
        path
    } else {
        path.strip_prefix(table)?.strip_prefix('.')?
    };
    (!name.contains('.')).then_some(name)
}

/// Returns the path of the table that contains the keys of a table key; below the name for tables with names.
pub(super) fn inside(key: &KeyDescription) -> String {
    match key.content {
        Content::Named => format!("{}.NAME", key.path),
        _ => key.path.clone(),
    }
}
