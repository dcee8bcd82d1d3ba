//! Tooling of this repository, run as `cargo xtask COMMAND`.

mod compare;
mod contents;
mod cycles;
mod examples;
mod links;
mod package;
mod real_balls;
mod reference;
mod tables;

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use anyhow::Result;

const USAGE: &str = "\
Usage: cargo xtask COMMAND

  cycles               fail if modules of a crate import each other in a circle
  links                fail if a link in a Markdown page leads nowhere, or ARCHITECTURE.md or docs/faults.md
                       names a file or test that does not exist
  tables [--check]     put the newest record of each experiment into the tables of the pages, and the
                       examples into their places; with --check, change nothing and fail if a
                       page is out of date
  reference [--check]  write the reference of keys and the JSON schemas in docs/reference; with --check, change
                       nothing and fail if one is out of date
  package FOLDER       write the shell completions and manual pages of the program into a folder
  contents TARGET FOLDER
                       write what the program for a target contains into a folder: the list of packages (SBOM,
                       CycloneDX) and the licences that must accompany it
  real-balls [OPTIONS] score the program on the real clips of data/real-balls; --help lists the options
  compare CHECKOUT     track scenes with the release binaries of this checkout and of another one,
                       and fail if a track differs in any byte";

fn main() -> ExitCode {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let words: Vec<&str> = arguments.iter().map(String::as_str).collect();
    let root = root();
    let result = match words[..] {
        ["cycles"] => cycles::run(&root),
        ["links"] => links::run(&root),
        ["tables"] => tables::run(&root, false).and_then(|()| examples::run(&root, false)),
        ["tables", "--check"] => tables::run(&root, true).and_then(|()| examples::run(&root, true)),
        ["reference"] => reference::run(&root, false),
        ["reference", "--check"] => reference::run(&root, true),
        ["package", folder] => package::run(&root, Path::new(folder)),
        ["contents", target, folder] => contents::run(&root, target, Path::new(folder)),
        ["real-balls", "--help"] => {
            println!("{}", real_balls::USAGE);
            Ok(())
        }
        ["real-balls", ref options @ ..] => real_balls::run(&root, options),
        ["compare", other] => compare::run(&root, Path::new(other)),
        _ => {
            eprintln!("{USAGE}");
            return ExitCode::from(2);
        }
    };
    match result {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error:#}");
            ExitCode::FAILURE
        }
    }
}

/// Returns the root of the repository.
fn root() -> PathBuf {
    let crate_folder = Path::new(env!("CARGO_MANIFEST_DIR"));
    let root = crate_folder.ancestors().nth(2);
    root.expect("this crate lies in crates/xtask").to_owned()
}

/// Returns the files below a folder whose names end in `.EXTENSION`, sorted; build folders and hidden ones are skipped.
fn files(folder: &Path, extension: &str) -> Result<Vec<PathBuf>> {
    let mut found = Vec::new();
    let mut folders = vec![folder.to_owned()];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(&folder)? {
            let path = entry?.path();
            let name = path.file_name().unwrap_or_default().to_string_lossy();
            if path.is_dir() {
                if name != "target" && !name.starts_with('.') {
                    folders.push(path);
                }
            } else if path.extension().is_some_and(|e| e == extension) {
                found.push(path);
            }
        }
    }
    found.sort();
    Ok(found)
}
