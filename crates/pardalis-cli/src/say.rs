//! Words for people on standard output, and warnings.

use std::fmt::Display;
use std::io::Write as _;

/// Prints a line. Whoever reads may have seen enough (`| head`): the results are in files, and are finished all the same.
pub(crate) fn say(line: impl Display) {
    let _ = writeln!(std::io::stdout(), "{line}");
}

/// Says on standard error what may not be meant.
pub(crate) fn warn(line: impl Display) {
    let _ = writeln!(std::io::stderr(), "warning: {line}");
}
