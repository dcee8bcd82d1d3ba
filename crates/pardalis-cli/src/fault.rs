//! Exit codes: 0 done, 2 the user's input or usage is at fault, 1 anything else.

use std::io::Write as _;
use std::process::ExitCode;

/// The user's input or usage is at fault; the text says what is wrong, where, and what is allowed.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub(crate) struct Fault(pub(crate) String);

/// An `anyhow::Error` that ends the program with exit code 2.
macro_rules! fault {
    ($($argument:tt)*) => { anyhow::Error::new($crate::fault::Fault(format!($($argument)*))) };
}
pub(crate) use fault;

/// Prints the error, if there is one, and gives the exit code that belongs to it.
///
/// What the library refuses came from the user's files, so that it counts as the user's input.
pub(crate) fn exit_code_of(outcome: &anyhow::Result<()>) -> ExitCode {
    let Err(error) = outcome else {
        return ExitCode::SUCCESS;
    };
    // Where nobody listens there is nothing to be done about it.
    let _ = writeln!(std::io::stderr(), "error: {error:#}");
    let users = error
        .chain()
        .any(|e| e.is::<Fault>() || e.is::<pardalis_core::Error>());
    ExitCode::from(if users { 2 } else { 1 })
}
