//! Errors in the user's input, and the exit codes: 0 success, 2 invalid input or usage, 1 any other error.

use crate::output::{self, note};

/// An error in the user's input or usage. The text states the problem, its position, and the remedy.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub(crate) struct UserError(pub(crate) String);

/// An address that sends single JPEG images, which the scene does not say.
#[derive(Debug, thiserror::Error)]
#[error(
    "{0}: sends single JPEG images without time stamps; give input.format = \"mpjpeg\", so that each gets the time of its arrival"
)]
pub(crate) struct SingleImages(pub(crate) String);

/// Formats an `anyhow::Error` that ends the program with exit code 2.
macro_rules! user_error {
    ($($argument:tt)*) => { anyhow::Error::new($crate::user_error::UserError(format!($($argument)*))) };
}
pub(crate) use user_error;

/// Prints help, the version, or what is wrong with the command line, and returns the exit code.
pub(crate) fn exit_code_of_usage(message: &clap::Error) -> u8 {
    let printed = message.print();
    if message.use_stderr() {
        return 2;
    }
    exit_code_of(&printed.map_or_else(output::failed, Ok))
}

/// Prints the error of a failed command and returns its exit code.
///
/// Errors of the library count as the user's input, because its arguments come from the user's files.
pub(crate) fn exit_code_of(outcome: &anyhow::Result<()>) -> u8 {
    let Err(error) = outcome else {
        return 0;
    };
    note(format_args!("error: {error:#}"));
    let users = error
        .chain()
        .any(|e| e.is::<UserError>() || e.is::<SingleImages>() || e.is::<pardalis_core::Error>());
    if users { 2 } else { 1 }
}
