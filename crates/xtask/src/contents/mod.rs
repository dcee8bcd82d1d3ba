//! What the released program contains: a list for machines (SBOM) and the licences that must accompany it.

mod notices;
mod packages;
mod sbom;

use std::fs;
use std::path::Path;

use anyhow::{Context, Result};

/// Writes both for the program that is built for a target, such as `x86_64-unknown-linux-musl`, into a folder.
pub(crate) fn run(root: &Path, target: &str, folder: &Path) -> Result<()> {
    let packages = packages::in_the_program(root, target)?;
    fs::create_dir_all(folder).with_context(|| folder.display().to_string())?;
    let web = packages::of_web_pages(root)?;
    let sbom = sbom::of(&packages, &web, &rust_version()?);
    fs::write(folder.join("pardalis.cdx.json"), sbom)?;
    fs::write(
        folder.join("THIRD-PARTY-LICENSES"),
        notices::of(root, &packages)?,
    )?;
    fs::copy(notices::of_rust()?, folder.join("RUST-LICENSES.html"))?;
    println!("{} packages", packages.len());
    Ok(())
}

/// Returns what the compiler prints about itself.
fn rustc(option: &str) -> Result<String> {
    let rustc = std::env::var_os("RUSTC").unwrap_or_else(|| "rustc".into());
    packages::output(std::process::Command::new(rustc).args(option.split(' ')))
}

/// Returns the version of the compiler, which is that of its standard library.
fn rust_version() -> Result<String> {
    let text = rustc("--version")?;
    let version = text.split(' ').nth(1);
    Ok(version.context("rustc prints no version")?.to_owned())
}
