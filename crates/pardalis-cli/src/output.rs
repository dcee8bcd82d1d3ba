//! Messages for the user: results on standard output, warnings on standard error.

use std::fmt::Display;
use std::io::Write as _;

/// Prints a line on standard output.
///
/// Write errors are ignored: the reader may have closed the pipe (`| head`), and the results are in files anyway.
pub(crate) fn print(line: impl Display) {
    let _ = writeln!(std::io::stdout(), "{line}");
}

/// Prints a warning on standard error.
pub(crate) fn warn(line: impl Display) {
    let _ = writeln!(std::io::stderr(), "warning: {line}");
}
