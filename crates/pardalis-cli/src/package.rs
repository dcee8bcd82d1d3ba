//! Shell completions and manual pages, from the declaration of the command line.

use std::ffi::OsString;
use std::fs;
use std::path::Path;

use anyhow::{Context, Result};
use clap::{Command, ValueEnum};
use clap_complete::Shell;

use crate::output::Shown;
use crate::user_error::user_error;

/// Writes the completions of all shells and a manual page for each command into the folder in the first argument.
pub(crate) fn write(
    mut command: Command,
    arguments: impl IntoIterator<Item = OsString>,
) -> Result<()> {
    let folder = arguments.into_iter().nth(1);
    let folder = folder.ok_or_else(|| user_error!("give a folder"))?;
    let folder = Path::new(&folder);
    let (completions, pages) = (folder.join("completions"), folder.join("man"));
    for folder in [&completions, &pages] {
        fs::create_dir_all(folder).with_context(|| folder.shown())?;
    }
    // First, because completions add the commands `help` for good.
    clap_mangen::generate_to(without_help(command.clone()), &pages)?;
    for &shell in Shell::value_variants() {
        clap_complete::generate_to(shell, &mut command, "pardalis", &completions)?;
    }
    Ok(())
}

/// Removes the commands `help`, which need no manual pages.
fn without_help(command: Command) -> Command {
    command
        .disable_help_subcommand(true)
        .mut_subcommands(without_help)
}
