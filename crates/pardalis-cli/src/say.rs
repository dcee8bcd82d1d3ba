//! Words for people on standard output.

use std::fmt::Display;
use std::io::Write as _;

/// Prints a line. Whoever reads may have seen enough (`| head`): the results are in files, and are finished all the same.
pub(crate) fn say(line: impl Display) {
    let _ = writeln!(std::io::stdout(), "{line}");
}
