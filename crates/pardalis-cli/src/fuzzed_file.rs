//! The file that fuzzing reads, and what holds for all errors about it.

use crate::user_error::UserError;

/// The name of the file in all errors.
pub(crate) const FILE: &str = "fuzzed-file";

/// Checks that an error is the user's, names the file and is short enough to be read.
pub(crate) fn check_error(error: &anyhow::Error) {
    assert!(error.is::<UserError>(), "not a user's error: {error:?}");
    let message = error.to_string();
    assert!(message.contains(FILE), "names no file: {message}");
    check_message(&message);
}

/// Checks that a message is short enough to be read.
pub(crate) fn check_message(message: &str) {
    assert!(!message.is_empty());
    assert!(message.len() < 20_000, "{} bytes: {message}", message.len());
}
