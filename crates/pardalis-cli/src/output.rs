//! Messages for the user: results on standard output, warnings and errors on standard error.
//!
//! Names of files and text from files can contain control characters, which would change the terminal or hide parts of a
//! message. They are shown as escapes. Line ends are, too, in names of files ([`Shown`]).

use std::fmt::{Display, Write as _};
use std::io::{self, Write as _};
use std::path::Path;
use std::sync::{Mutex, PoisonError};

/// Why results could not be printed, until [`finish`] takes it.
static FAILURE: Mutex<Option<io::Error>> = Mutex::new(None);

/// Prints lines on standard output. If they cannot be written, the program fails when it has finished; see [`finish`].
pub(crate) fn print(lines: impl Display) {
    if let Err(error) = writeln!(io::stdout(), "{}", escaped(lines)) {
        let mut failure = FAILURE.lock().unwrap_or_else(PoisonError::into_inner);
        failure.get_or_insert(error);
    }
}

/// Prints a warning on standard error.
pub(crate) fn warn(line: impl Display) {
    note(format_args!("warning: {line}"));
}

/// Prints lines on standard error. A failure cannot be reported anywhere.
pub(crate) fn note(lines: impl Display) {
    let _ = writeln!(io::stderr(), "{}", escaped(lines));
}

/// Names of files and folders in messages.
pub(crate) trait Shown {
    /// Returns the name in one line.
    fn shown(&self) -> String;
}

impl Shown for Path {
    fn shown(&self) -> String {
        in_line(&self.display().to_string())
    }
}

/// Returns part of a message in one line: a line end in a name would make the rest look like a message of its own.
pub(crate) fn in_line(text: &str) -> String {
    text.replace('\n', "\\n")
}

/// Fails if something that was printed did not arrive, unless its reader closed the pipe deliberately (`| head`).
pub(crate) fn finish() -> anyhow::Result<()> {
    let failure = FAILURE
        .lock()
        .unwrap_or_else(PoisonError::into_inner)
        .take();
    failure.map_or(Ok(()), failed)
}

/// Fails because of this error of standard output, unless its reader closed the pipe.
pub(crate) fn failed(error: io::Error) -> anyhow::Result<()> {
    match error.kind() {
        io::ErrorKind::BrokenPipe => Ok(()),
        _ => Err(anyhow::Error::new(error).context("standard output: cannot be written")),
    }
}

/// Returns text whose control characters, besides ends of lines and tabs, are escapes such as `\u{1b}`, and those that
/// reverse the direction of writing as well.
fn escaped(text: impl Display) -> String {
    let mut safe = String::new();
    for c in text.to_string().chars() {
        let reverses = matches!(c, '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}');
        if (c.is_control() && !matches!(c, '\n' | '\t')) || reverses {
            // Writing to a String cannot fail.
            let _ = write!(safe, "{}", c.escape_unicode());
        } else {
            safe.push(c);
        }
    }
    safe
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn control_characters_are_shown_and_not_sent() {
        assert_eq!(escaped("ü 1\n\t2"), "ü 1\n\t2");
        assert_eq!(escaped("a\u{1b}[2Jb\r"), "a\\u{1b}[2Jb\\u{d}");
        assert_eq!(escaped("\u{9b}x\u{7f}\u{202e}"), "\\u{9b}x\\u{7f}\\u{202e}");
    }
}
