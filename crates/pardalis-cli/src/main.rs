//! The `pardalis` program.

mod commands;
#[allow(dead_code)]
mod draw;
mod fault;
mod files;
#[allow(dead_code)]
mod source;
mod tables;
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
enum Command {
    Evaluate(commands::evaluate::Arguments),
    Learn(commands::learn::Arguments),
}

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    let outcome = match arguments.command {
        None => Err(fault::fault!("no command given; see pardalis --help")),
        Some(Command::Evaluate(arguments)) => commands::evaluate::run(&arguments),
        Some(Command::Learn(arguments)) => commands::learn::run(&arguments),
    };
    fault::exit_code_of(&outcome)
}
