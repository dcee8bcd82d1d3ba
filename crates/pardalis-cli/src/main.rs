//! The `pardalis` program. All of it is in the library, whose readers fuzzing calls.

use std::process::ExitCode;

fn main() -> ExitCode {
    let file = std::env::current_exe().ok();
    ExitCode::from(pardalis_cli::run(std::env::args_os(), file))
}
