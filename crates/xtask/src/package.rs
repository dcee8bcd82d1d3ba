//! Shell completions and manual pages of the program, for packages of releases.

use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result, bail};

/// Writes them into the folder, by a build of the program that does nothing else. The released program gets no larger.
pub(crate) fn run(root: &Path, folder: &Path) -> Result<()> {
    let cargo = std::env::var_os("CARGO").map_or_else(|| PathBuf::from("cargo"), PathBuf::from);
    let status = Command::new(cargo)
        .args(["run", "--quiet", "--locked", "--package", "pardalis-cli"])
        .args(["--features", "package", "--"])
        .arg(std::path::absolute(folder)?)
        .current_dir(root)
        .status()
        .context("cargo cannot be started")?;
    if !status.success() {
        bail!("the completions could not be written");
    }
    println!("{}", folder.display());
    Ok(())
}
