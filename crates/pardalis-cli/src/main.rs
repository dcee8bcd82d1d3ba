//! The `pardalis` program.

mod fault;
#[allow(dead_code)]
mod source;
mod timing;

use std::process::ExitCode;

use clap::{Parser, Subcommand};

/// Tracks coloured objects in 3D from images, videos and cameras.
#[derive(Parser)]
#[command(version, about)]
struct Arguments {
    #[command(subcommand)]
    command: Option<Command>,
}

/// One variant a command, each in its own file under `commands/`.
#[derive(Subcommand)]
enum Command {}

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    let outcome = match arguments.command {
        None => Err(fault::fault!("no command given; see pardalis --help")),
        Some(command) => match command {},
    };
    fault::exit_code_of(&outcome)
}
