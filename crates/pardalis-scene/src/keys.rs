//! The keys that reading a file declares.

use toml::de::DeTable;

use super::description::{Content, KeyDescription};
use super::journal::Journal;
use super::reader::Table;

/// Returns the keys that a reader of files asks for, in the order in which it does.
pub(super) fn keys_of(read: impl FnOnce(&Journal, &Table)) -> Vec<KeyDescription> {
    let journal = Journal::describing();
    let empty = DeTable::new();
    read(&journal, &Table::describing(&journal, &empty));
    journal.into_described()
}

/// The keys directly in a table.
pub(super) fn keys_in<'k>(
    keys: &'k [KeyDescription],
    table: &'k str,
) -> impl Iterator<Item = &'k KeyDescription> {
    keys.iter()
        .filter(move |key| name_in(&key.path, table).is_some())
}

/// The name of a key directly in a table.
pub(super) fn name_in<'k>(path: &'k str, table: &str) -> Option<&'k str> {
    let name = if table.is_empty() {
        path
    } else {
        path.strip_prefix(table)?.strip_prefix('.')?
    };
    (!name.contains('.')).then_some(name)
}

/// The path of the table in which the keys of a table key are: below the name for tables with names.
pub(super) fn inside(key: &KeyDescription) -> String {
    match key.content {
        Content::Named => format!("{}.NAME", key.path),
        _ => key.path.clone(),
    }
}
