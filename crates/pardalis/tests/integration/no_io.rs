//! Libraries perform no I/O and read no clock: their sources do not contain names of functions that could.

use std::fs;
use std::path::{Path, PathBuf};

/// Names that libraries must not contain outside tests.
const FORBIDDEN: [&str; 19] = [
    "std::fs",
    "std::io",
    "std::env",
    "std::net",
    "std::os",
    "std::process",
    "std::thread",
    "std::time",
    "Instant::now",
    "SystemTime",
    "println!",
    "eprintln!",
    "print!(",
    "dbg!",
    "include_bytes!",
    "include_str!",
    "thread_rng",
    "getrandom",
    "RandomState",
];

/// Exceptions that contain a forbidden name: reading from memory, an example as documentation, and a constant table
/// that is compiled into the program.
const ALLOWED: [&str; 3] = [
    "use std::io::Cursor;",
    "#![doc = include_str!",
    "const DICTIONARIES: &str = include_str!",
];

/// Returns the numbered lines of a source file up to the first `#[cfg(test)]`, without comments.
fn code(text: &str) -> impl Iterator<Item = (usize, &str)> {
    text.lines()
        .take_while(|line| line.trim() != "#[cfg(test)]")
        .enumerate()
        .map(|(i, line)| (i + 1, line.split("//").next().unwrap_or(line)))
        .filter(|(_, line)| !ALLOWED.iter().any(|allowed| line.starts_with(allowed)))
}

/// Returns the forbidden names in a source file, with their line numbers.
fn found(text: &str) -> Vec<(usize, &'static str)> {
    code(text)
        .flat_map(|(number, line)| {
            let names = FORBIDDEN
                .into_iter()
                .filter(move |name| line.contains(name));
            names.map(move |name| (number, name))
        })
        .collect()
}

/// Collects all Rust files in a folder.
fn sources(folder: &Path, files: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            sources(&path, files);
        } else if path.extension().is_some_and(|kind| kind == "rs")
            && !path.to_string_lossy().ends_with("tests.rs")
        {
            files.push(path);
        }
    }
}

#[test]
fn libraries_use_no_files_clocks_threads_or_console() {
    let crates = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let mut files = Vec::new();
    for entry in fs::read_dir(crates).unwrap() {
        let folder = entry.unwrap().path();
        // A program for its users, which reads files, and a server.
        if folder.ends_with("pardalis-python") || folder.ends_with("pardalis-studio") {
            continue;
        }
        let folder = folder.join("src");
        // Programs have a main.rs; all other crates are libraries.
        if folder.join("lib.rs").is_file() && !folder.join("main.rs").is_file() {
            sources(&folder, &mut files);
        }
    }
    assert!(files.len() > 100, "only {} source files found", files.len());
    let mut problems = Vec::new();
    for file in files {
        // The viewer is a page, compiled into the program.
        let is_page = file
            .components()
            .any(|part| part.as_os_str() == "pardalis-viewer");
        for (line, name) in found(&fs::read_to_string(&file).unwrap()) {
            if !(is_page && name.starts_with("include_")) {
                problems.push(format!("{}:{line}: {name}", file.display()));
            }
        }
    }
    assert!(problems.is_empty(), "{}", problems.join("\n"));
}

#[test]
fn comments_and_tests_are_not_scanned() {
    let text = "use std::fs; // std::io\n/// println!\nlet t = Instant::now();\n#[cfg(test)]\nuse std::env;\n";
    assert_eq!(found(text), [(1, "std::fs"), (3, "Instant::now")]);
}
