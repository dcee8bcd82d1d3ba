//! The problems, warnings and resolved settings of one file, collected while its tables are read.

use std::cell::RefCell;
use std::fmt;

use toml::Spanned;
use toml::de::DeTable;

use super::description::KeyDescription;

/// A problem in a file and its position.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct Problem {
    /// The line, from 1; 0 for a value that was set outside the file.
    pub line: usize,
    /// The full key, such as `targets.ball.shape.sphere.radius_m`; empty for the file as a whole.
    pub key: String,
    /// What is wrong and how to correct it.
    pub message: String,
}

impl fmt::Display for Problem {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.line {
            0 => f.write_str("as set")?,
            line => write!(f, "line {line}")?,
        }
        // A line end in a key or in a file's name must not make the rest look like a message of its own.
        if !self.key.is_empty() {
            write!(f, ": {}", self.key.replace('\n', "\\n"))?;
        }
        write!(f, ": {}", self.message.replace('\n', "\n      "))
    }
}

/// A setting and its position, for problems that appear only when the setting is used.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Located<T> {
    /// The setting.
    pub value: T,
    /// Its full key.
    pub key: String,
    /// Its line, from 1; 0 if it was set outside the file.
    pub line: usize,
}

impl<T> Located<T> {
    /// Returns a problem with this setting.
    pub fn problem(&self, message: impl Into<String>) -> Problem {
        Problem {
            line: self.line,
            key: self.key.clone(),
            message: message.into(),
        }
    }
}

/// Problems and resolved settings, shared by all tables of one file.
pub(super) struct Journal {
    /// Offset of the beginning of each line except the first.
    line_starts: Vec<usize>,
    /// The text's length in bytes. Values at larger offsets were set outside the file.
    text_len: usize,
    problems: RefCell<Vec<Problem>>,
    warnings: RefCell<Vec<Problem>>,
    /// Every setting with its final value, given or default.
    resolved: RefCell<toml::Table>,
    /// The syntax error. All other problems may follow from it.
    syntax: Option<Problem>,
    /// The keys that the reader requests, while it describes them instead of reading a file.
    described: Option<RefCell<Vec<KeyDescription>>>,
}

/// Maximum length of a key or message in characters.
const MAX_SHOWN: usize = 300;

/// A longer line is not shown in a message.
const MAX_QUOTED: usize = 80;

/// Returns the line at an offset in bytes, without spaces around it.
fn line_at(text: &str, offset: usize) -> &str {
    let bytes = text.as_bytes();
    let offset = offset.min(bytes.len());
    let is_end = |byte: &u8| *byte == b'\n';
    let first = bytes[..offset]
        .iter()
        .rposition(is_end)
        .map_or(0, |at| at + 1);
    let last = bytes[offset..].iter().position(is_end);
    let line = text.get(first..last.map_or(bytes.len(), |at| offset + at));
    line.unwrap_or_default().trim()
}

impl Journal {
    /// Parses the text. A syntax error is reported alone; of duplicate keys the first is kept, and the rest of the
    /// file is still read.
    pub(super) fn parse(text: &str) -> (Self, Spanned<DeTable<'_>>) {
        let (root, errors) = DeTable::parse_recoverable(text);
        let mut journal = Self {
            line_starts: text.match_indices('\n').map(|(at, _)| at + 1).collect(),
            text_len: text.len(),
            problems: RefCell::default(),
            warnings: RefCell::default(),
            syntax: None,
            resolved: RefCell::default(),
            described: None,
        };
        let mut has_duplicate_name = false;
        for error in errors {
            let offset = error.span().map_or(0, |span| span.start);
            match error.message() {
                "duplicate key" => {
                    let key = text.get(error.span().unwrap_or(0..0)).unwrap_or_default();
                    let key = key.trim();
                    let message = match first_of_name(text, offset, key) {
                        Some((kind, line)) => {
                            has_duplicate_name = true;
                            format!(
                                "two {kind} are named {key}, the first in line {line}; rename one"
                            )
                        }
                        // The duplicate keys of the second table follow from its name.
                        None if has_duplicate_name => continue,
                        None => format!("the key {key} is given twice; remove one"),
                    };
                    journal.add(offset, String::new(), message);
                }
                "recursion limit" | "cannot recurse further; max recursion depth met" => {
                    let message = "tables or lists are nested too deeply; allowed: a few levels";
                    // It also makes brackets appear to be unclosed.
                    let problem = journal.problem_at(offset, String::new(), message.to_owned());
                    journal.syntax = Some(problem);
                }
                message => {
                    let mut message = message.replace('\n', ", ");
                    let line = line_at(text, offset);
                    if !line.is_empty() && line.chars().count() <= MAX_QUOTED {
                        message = format!("at `{line}`: {message}");
                    }
                    if is_decimal_comma(text, offset) {
                        message += "; use a decimal point instead of the comma";
                    }
                    let problem = journal.problem_at(offset, String::new(), message);
                    journal.syntax.get_or_insert(problem);
                }
            }
        }
        (journal, root)
    }

    /// Creates a journal that collects descriptions of the keys that a reader requests.
    pub(super) fn describing() -> Self {
        Self {
            line_starts: Vec::new(),
            text_len: 0,
            problems: RefCell::default(),
            warnings: RefCell::default(),
            syntax: None,
            resolved: RefCell::default(),
            described: Some(RefCell::default()),
        }
    }

    pub(super) fn is_describing(&self) -> bool {
        self.described.is_some()
    }

    /// Adds a key's description, unless another branch of the reader has already added it.
    pub(super) fn describe(&self, key: KeyDescription) {
        if let Some(described) = &self.described {
            let mut described = described.borrow_mut();
            if described.iter().all(|other| other.path != key.path) {
                described.push(key);
            }
        }
    }

    /// Returns the descriptions, in the order in which the keys are read.
    pub(super) fn into_described(self) -> Vec<KeyDescription> {
        self.described.map(RefCell::into_inner).unwrap_or_default()
    }

    /// Returns the line of an offset into the text, from 1; 0 beyond the text.
    pub(super) fn line_of(&self, offset: usize) -> usize {
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

    pub(super) fn add(&self, offset: usize, key: String, message: String) {
        let problem = self.problem_at(offset, key, message);
        self.problems.borrow_mut().push(problem);
    }

    /// Removes the problem that a key is missing, because it is given under a similar name.
    pub(super) fn is_misspelt(&self, key: &str) {
        let is_missing =
            |problem: &Problem| problem.key == key && problem.message.starts_with("is missing");
        self.problems.borrow_mut().retain(|p| !is_missing(p));
    }

    pub(super) fn warn(&self, offset: usize, key: String, message: String) {
        let warning = self.problem_at(offset, key, message);
        self.warnings.borrow_mut().push(warning);
    }

    /// Reports whether the text has a syntax error.
    pub(super) fn has_syntax_error(&self) -> bool {
        self.syntax.is_some()
    }

    /// Returns all problems in the order of their lines or, if there are none, the warnings and every setting with
    /// its final value.
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

    /// Adds a problem that was found after its table had been read.
    pub(super) fn report(&self, problem: Problem) {
        self.problems.borrow_mut().push(problem);
    }

    /// Records the final value of a setting.
    pub(super) fn record(&self, path: &str, value: toml::Value) {
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

/// Returns the kind of a duplicate key that names a camera or target, and the line in which the first table of that
/// name begins.
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

/// Reports whether the text around an offset is a number with a comma, such as `0,035`.
fn is_decimal_comma(text: &str, offset: usize) -> bool {
    let bytes = text.as_bytes();
    let is_digit = |at: usize| bytes.get(at).is_some_and(u8::is_ascii_digit);
    let is_comma = |at: usize| at > 0 && bytes.get(at) == Some(&b',');
    let places = [Some(offset), offset.checked_sub(1)].into_iter().flatten();
    places
        .filter(|&at| is_comma(at))
        .any(|at| is_digit(at - 1) && is_digit(at + 1))
}

fn shortened(text: String) -> String {
    match text.char_indices().nth(MAX_SHOWN) {
        Some((end, _)) => format!("{}...", &text[..end]),
        None => text,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_of_a_message_do_not_look_like_messages_of_their_own() {
        let problem = Problem {
            key: "cameras.a\nb.video".to_owned(),
            line: 7,
            message: "cannot be opened. Messages:\nerror: refused".to_owned(),
        };
        let text = "line 7: cameras.a\\nb.video: cannot be opened. Messages:\n      error: refused";
        assert_eq!(problem.to_string(), text);
    }
}
