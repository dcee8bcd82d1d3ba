//! Writes or checks the reference of keys and the JSON schemas in `docs/reference`, by the test of `pardalis-scene` that generates them.

use std::path::Path;
use std::process::Command;

use anyhow::{Result, ensure};

const GENERATOR: &str = "reference::reference_files_are_up_to_date";

pub(crate) fn run(root: &Path, only_check: bool) -> Result<()> {
    let mut cargo = Command::new(env!("CARGO"));
    cargo
        .current_dir(root)
        .args(["test", "--quiet", "--locked"]);
    cargo.args(["--package", "pardalis-scene", "--test", "integration"]);
    cargo.args(["--", "--exact", GENERATOR]);
    if only_check {
        cargo.env_remove("UPDATE");
    } else {
        cargo.env("UPDATE", "1");
    }
    ensure!(cargo.status()?.success(), "{GENERATOR} failed");
    Ok(())
}
