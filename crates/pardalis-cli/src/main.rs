//! The `pardalis` program.

mod commands;
mod draw;
mod fault;
mod scene;
mod source;
mod tables;
mod timing;
mod tracking;

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
    Demo(commands::demo::Arguments),
    Init(commands::init::Arguments),
    Track(commands::track::Arguments),
    Evaluate(commands::evaluate::Arguments),
    Measure(commands::measure::Arguments),
    Report(commands::report::Arguments),
}

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    let outcome = match arguments.command {
        None => Err(fault::fault!("no command given; see pardalis --help")),
        Some(Command::Demo(arguments)) => commands::demo::run(&arguments),
        Some(Command::Init(arguments)) => commands::init::run(&arguments),
        Some(Command::Track(arguments)) => commands::track::run(&arguments),
        Some(Command::Evaluate(arguments)) => commands::evaluate::run(&arguments),
        Some(Command::Measure(arguments)) => commands::measure::run(&arguments),
        Some(Command::Report(arguments)) => commands::report::run(&arguments),
    };
    fault::exit_code_of(&outcome)
}
