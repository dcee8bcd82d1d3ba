//! The `pardalis` program. All of it is in the library, whose readers fuzzing calls.

use std::process::ExitCode;

fn main() -> ExitCode {
    pardalis_cli::main()
}
